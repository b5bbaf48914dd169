// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file program_fixture.hpp
/// The program `slicecorr` as people run it, in a folder of its own with a small printer.
#pragma once

#include <gtest/gtest.h>
#include <png.h>

#include <cstring>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "run_program.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::test {

/// The printer of the examples with a small image, so that the programs take no time.
inline constexpr int kSmallWidth = 160, kSmallHeight = 120;
inline constexpr const char* kSmallPrinter =
    "name = \"small\"\n[display]\nwidth_px = 160\nheight_px = 120\npixel_um = 50.0\n[blue]\n"
    "calibration = [[0, 1.0], [255, 100.0]]\n";

/// Pixels of a greyscale PNG of 8 bits or a palette of greys, by libpng's own simplified reader.
inline Bytes grey_of_png(const Bytes& png) {
  png_image image;
  std::memset(&image, 0, sizeof image);
  image.version = PNG_IMAGE_VERSION;
  EXPECT_TRUE(png_image_begin_read_from_memory(&image, png.data(), png.size()) != 0);
  // Values as they are: nothing is known of a gamma.
  image.format = PNG_FORMAT_GRAY;
  image.flags |= PNG_IMAGE_FLAG_16BIT_sRGB;
  Bytes pixels(PNG_IMAGE_SIZE(image));
  EXPECT_TRUE(png_image_finish_read(&image, nullptr, pixels.data(), 0, nullptr) != 0);
  return pixels;
}

class ProgramFixture : public ::testing::Test {
 protected:
  ProgramFixture() {
    options_.folder = folder_.path();
    options_.environment = {
        {"SLICECORR_DB", SLICECORR_DB_DIR}, {"HOME", folder_.path()}, {"XDG_CONFIG_HOME", ""}};
  }
  RunResult call(const Command& arguments) const {
    return run_program(Command{SLICECORR_BIN_DIR "/slicecorr"} + arguments, options_);
  }
  RunResult good(const Command& arguments) const {
    RunResult r = call(arguments);
    EXPECT_EQ(r.exit_code, 0) << ::testing::PrintToString(arguments) << r.err;
    return r;
  }
  /// Refused with this code, in words that have all of these, and nothing is left behind.
  RunResult bad(int code, const Command& arguments, const std::vector<std::string>& words) const {
    const auto before = folder_.count();
    RunResult r = call(arguments);
    EXPECT_EQ(r.exit_code, code) << ::testing::PrintToString(arguments) << r.err;
    for (const auto& word : words) EXPECT_NE(r.err.find(word), std::string::npos) << word << r.err;
    EXPECT_EQ(folder_.count(), before);
    return r;
  }
  void write(const std::string& name, const std::string& text) const {
    write_file(folder_ / name, to_bytes(text));
  }
  nlohmann::json figures(const std::string& stack, const std::string& target,
                         const Command& more = {}) const {
    const RunResult r = good(Command{"verify", stack, "--target", target, "--json", "-"} + more);
    return nlohmann::json::parse(r.out);
  }
  /// The images of a stack, in order.
  std::vector<Bytes> images(const std::string& stack) const {
    std::map<std::string, Bytes> sorted;
    for (const auto& [name, data] : unzip(folder_ / stack)) {
      if (name.starts_with("slice/") && name.ends_with(".png")) sorted[name] = grey_of_png(data);
    }
    std::vector<Bytes> all;
    for (auto& [name, pixels] : sorted) {
      EXPECT_EQ(pixels.size(), static_cast<std::size_t>(kSmallWidth * kSmallHeight)) << name;
      all.push_back(std::move(pixels));
    }
    EXPECT_GT(all.size(), 0U);
    return all;
  }

  TemporaryFolder folder_;
  RunOptions options_;
};

}  // namespace slicecorr::test
