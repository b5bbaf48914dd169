// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// `slicecorr hologram` as people run it.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "run_program.hpp"
#include "slicecorr/stack.hpp"
#include "stack_fixture.hpp"

namespace slicecorr {
namespace {

namespace fs = std::filesystem;

class HologramProgram : public testing::Test {
 protected:
  HologramProgram() : folder_(temporary_.path()) {
    GreyImage target{128, 128, std::vector<std::uint8_t>(128 * 128)};
    for (int y = 80; y < 112; ++y) {
      for (int x = 80; x < 112; ++x) target.pixels[static_cast<std::size_t>(y) * 128 + x] = 255;
    }
    write("target.png", target);
    write("black.png", {16, 16, std::vector<std::uint8_t>(256)});
    write("white.png", {16, 16, std::vector<std::uint8_t>(256, 255)});
  }
  void write(const std::string& name, const GreyImage& image) {
    const auto png = encode_png(image);
    std::ofstream(folder_ / name, std::ios::binary)
        .write(reinterpret_cast<const char*>(png.data()), static_cast<std::streamsize>(png.size()));
  }
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  test::RunResult run(const std::string& target, std::vector<std::string> more = {}) const {
    std::vector<std::string> words{SLICECORR_BIN_DIR "/slicecorr", "hologram", path(target), "-o",
                                   path("phase.png")};
    if (more.empty() || more[0] != "--bare") {
      for (const char* w : {"--pitch-um", "8", "--wavelength-nm", "532", "--focal-mm", "100"}) {
        words.emplace_back(w);
      }
    } else {
      more.erase(more.begin());
    }
    words.insert(words.end(), more.begin(), more.end());
    return test::run_program(words);
  }
  std::string bytes(const std::string& name) const {
    std::ifstream in(folder_ / name, std::ios::binary);
    std::stringstream text;
    text << in.rdbuf();
    return text.str();
  }

  test::TemporaryFolder temporary_;
  fs::path folder_;
};

TEST_F(HologramProgram, TellsItsFiguresAndWritesItsSeed) {
  const auto r = run("target.png", {"--json", "-", "--threads", "1"});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  const auto json = nlohmann::json::parse(r.out);
  EXPECT_NEAR(json["efficiency"].get<double>(), 0.943, 6e-4);
  EXPECT_NEAR(json["rms_error"].get<double>(), 0.1707, 6e-4);
  EXPECT_NEAR(json["rms_error_padded"].get<double>(), 0.748, 6e-4);
  const std::string first = bytes("phase.png");
  EXPECT_NE(first.find("hologram: seed 1, 50 steps"), std::string::npos);
  const std::vector<std::uint8_t> png(first.begin(), first.end());
  EXPECT_EQ(decode_png(png, 128, 128, "phase.png", "").pixels.size(), 128U * 128U);
  ASSERT_EQ(run("target.png", {"--threads", "3"}).exit_code, 0);
  EXPECT_EQ(bytes("phase.png"), first);
  ASSERT_EQ(run("target.png", {"--seed", "2"}).exit_code, 0);
  EXPECT_NE(bytes("phase.png"), first);
}

TEST_F(HologramProgram, LooksThroughDepth) {
  const auto r = run("target.png", {"--steps", "5", "--holograms", "2", "--stack", path("depth"),
                                    "--stack-mm=-10,10,10", "--picture", path("seen.png")});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  EXPECT_TRUE(fs::exists(folder_ / "phase-0001.png"));
  EXPECT_TRUE(fs::exists(folder_ / "phase-0002.png"));
  EXPECT_TRUE(fs::exists(folder_ / "seen.png"));
  int images = 0;
  for ([[maybe_unused]] const auto& e : fs::directory_iterator(folder_ / "depth")) ++images;
  EXPECT_EQ(images, 3);
}

/// What stays on the axis stands in the middle of the focal plane, where the target is dark.
TEST_F(HologramProgram, DepthHasItsZeroOrder) {
  const auto middle = [&](const std::vector<std::string>& more) {
    std::vector<std::string> words{"--steps", "5", "--stack", path("depth"), "--stack-mm=0,0,1"};
    words.insert(words.end(), more.begin(), more.end());
    const auto r = run("target.png", words);
    EXPECT_EQ(r.exit_code, 0) << r.err;
    const std::string png = bytes("depth/0000_+0.0000mm.png");
    const GreyImage image = decode_png({png.begin(), png.end()}, 256, 256, "depth", "");
    return image.pixels[128U * 256 + 128];
  };
  EXPECT_LT(middle({}), 100);
  EXPECT_EQ(middle({"--fill", "0.8", "--stroke-turns", "1"}), 255);
}

TEST_F(HologramProgram, RefusesWhatCanNotBe) {
  const auto refused = [&](const std::string& target, const std::vector<std::string>& more,
                           int code, const std::string& words) {
    const auto r = run(target, more);
    EXPECT_EQ(r.exit_code, code) << r.err;
    EXPECT_NE(r.err.find(words), std::string::npos) << r.err;
    EXPECT_FALSE(fs::exists(folder_ / "phase.png"));
  };
  refused("target.png", {"--bare", "--pitch-um", "8", "--wavelength-nm", "532"}, 2, "--focal-mm");
  refused("target.png", {"--bare", "--focal-mm", "8", "--wavelength-nm", "532"}, 2, "--pitch-um");
  refused("target.png", {"--levels", "1"}, 2, "--levels");
  refused("target.png", {"--dx-mm", "3"}, 2, "reaches");
  refused("target.png", {"--dz-mm", "700"}, 2, "half a turn");
  refused("black.png", {}, 2, "black");
  refused("white.png", {}, 2, "lit all over");
  refused("target.png", {"--display-px", "64,64"}, 2, "no more");
  refused("target.png", {"--target-pixel-um", "60"}, 2, "field");
  refused("target.png", {"--holograms", "4", "--inhibition-s", "0.05"}, 3, "4 or more");
  refused("target.png", {"--holograms", "8", "--inhibition-s", "0.1"}, 3, "up to 6");
  refused("none.png", {}, 2, "none.png");
}

}  // namespace
}  // namespace slicecorr
