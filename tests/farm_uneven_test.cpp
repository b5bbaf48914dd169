// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Jobs for displays that shine unevenly: what is refused before the night, and how much memory a
// worker is given.

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "farm_fixture.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr::farm {
namespace {

using namespace slicecorr::test;
using nlohmann::json;
using testing::HasSubstr;

class FarmUneven : public FarmPrograms {
 protected:
  struct Display {
    int width_px = 96, height_px = 64;
    double travel_mm = 100;
    std::string more = {};  ///< of the file
  };
  /// A printer whose flat-field is `light` of each pixel of the plate.
  template <typename Light>
  std::string make_printer(const std::string& name, const Display& display, const Light& light) {
    std::vector<std::uint8_t> levels;
    for (int y = 0; y < display.height_px; ++y) {
      for (int x = 0; x < display.width_px; ++x) {
        levels.push_back(static_cast<std::uint8_t>(light(x, y)));
      }
    }
    const auto png = encode_png({display.width_px, display.height_px, levels});
    write_file(dir / (name + ".png"), std::string(png.begin(), png.end()));
    const std::string path = dir / (name + ".toml");
    write_file(path, fmt::format(R"(
name = "{0}"
[display]
width_px = {1}
height_px = {2}
pixel_um = 50.0
bit_depth = 8
flat_field = "{0}.png"
[blue]
wavelength_nm = 460
calibration = [[0, 1.0], [255, 100.0]]
[stage]
max_speed_mm_h = 2000
travel_mm = {3}
{4})",
                                 name, display.width_px, display.height_px, display.travel_mm,
                                 display.more));
    return path;
  }
  std::vector<std::string> how(const std::string& printer, const std::string& speed_mm_h) const {
    return {"--printer", printer, "--resin", dir / "clear.toml", "--speed-mm-h", speed_mm_h};
  }
  RunResult submit_with(std::vector<std::string> arguments,
                        const std::vector<std::string>& more) const {
    arguments.insert(arguments.end(), more.begin(), more.end());
    return farm("submit", arguments);
  }
  RunResult submit_mesh(const std::string& part, const std::string& center_mm,
                        const std::vector<std::string>& more) const {
    std::vector<std::string> arguments = {part, "--layer-um", "50"};
    if (!center_mm.empty()) {
      const std::size_t comma = center_mm.find(',');
      arguments.insert(arguments.end(),
                       {"--center-mm", center_mm.substr(0, comma), center_mm.substr(comma + 1)});
    }
    return submit_with(arguments, more);
  }
  std::int64_t queued() const { return ReadModel(database()).count({}); }
};

/// Two thirds of the plate shine as they should, the rest hardly: the part fits into either.
constexpr int kDimFromPx = 64;
int mostly_bright(int x, int) { return x < kDimFromPx ? 255 : 5; }

TEST_F(FarmUneven, APartOnDimPlacesIsRefusedBeforeTheNight) {
  const std::string printer = make_printer("dim", {}, mostly_bright);
  write_file(dir / "post.stl", stl_of({{0, 1, 0, 1, 0, 1.5F}}));
  const auto process = how(printer, "700");
  const RunResult refused = submit_mesh(dir / "post.stl", "4,1.6", process);
  EXPECT_EQ(refused.exit_code, 3) << refused.err;
  EXPECT_THAT(refused.err, HasSubstr("is too weak for this part: it fails at 400 of its pixels"));
  EXPECT_EQ(queued(), 0);
  // With another error it is not physics alone.
  write_file(dir / "jobs.csv", "part,center_mm\npost.stl,4;1.6\nnothing.stl,\n");
  const RunResult both = submit_with({dir / "jobs.csv", "--layer-um", "50"}, process);
  EXPECT_EQ(both.exit_code, 2) << both.err;
  EXPECT_THAT(both.err, HasSubstr("jobs.csv: line 2: the light of printer 'dim'"));
  EXPECT_THAT(both.err, HasSubstr("nothing.stl: is not there"));
  EXPECT_EQ(queued(), 0);

  ASSERT_EQ(submit_mesh(dir / "post.stl", "1.6,1.6", process).exit_code, 0);
  ASSERT_EQ(run_all().exit_code, 0);
  EXPECT_EQ(ReadModel(database()).job(1)->state, JobState::done);
}

TEST_F(FarmUneven, AnArchiveOnDimPlacesToo) {
  const std::string printer = make_printer("dim", {}, mostly_bright);
  write_file(dir / "post.stl", stl_of({{0, 1, 0, 1, 0, 1.5F}}));
  for (const auto& [name, x_mm] : {std::pair{"dim-place", "4"}, {"bright-place", "1.6"}}) {
    const RunResult r = program(
        "slicecorr", {"slice", dir / "post.stl", "-o", dir / (std::string(name) + ".uvj"),
                      "--printer", printer, "--layer-um", "50", "--center-mm", x_mm, "1.6"});
    ASSERT_EQ(r.exit_code, 0) << r.err;
  }
  const auto process = how(printer, "700");
  const RunResult refused = submit_with({dir / "dim-place.uvj"}, process);
  EXPECT_EQ(refused.exit_code, 3) << refused.err;
  EXPECT_THAT(refused.err, HasSubstr("fails at 400 of its pixels"));
  EXPECT_EQ(submit_with({dir / "dim-place.uvj", "--dry-run"}, process).exit_code, 3);
  EXPECT_EQ(queued(), 0);
  EXPECT_THAT(leftovers(farm_dir()), testing::IsEmpty());
  ASSERT_EQ(submit_with({dir / "bright-place.uvj"}, process).exit_code, 0);
  ASSERT_EQ(run_all().exit_code, 0);
  EXPECT_EQ(ReadModel(database()).job(1)->state, JobState::done);
}

/// How far the stage has to go on after the part's end depends on the light of its own places.
TEST_F(FarmUneven, TheStagesTravelIsThatOfThePartsPlaces) {
  const auto light = [](int x, int) { return x < kDimFromPx ? 255 : 128; };
  write_file(dir / "post.stl", stl_of({{0, 1, 0, 1, 0, 1.5F}}));
  const auto slices_at = [&](const std::string& x_mm) {
    const std::string out = dir / ("at-" + x_mm + ".uvj");
    auto arguments = how(make_printer("far", {}, light), "700");
    arguments.insert(arguments.begin(), {"run", dir / "post.stl", "-o", out, "--layer-um", "50",
                                         "--center-mm", x_mm, "1.6"});
    const RunResult r = program("slicecorr", arguments);
    EXPECT_EQ(r.exit_code, 0) << r.err;
    return json::parse(text_of_file(dir / ("at-" + x_mm + ".json")))["layers"].get<int>();
  };
  const int bright = slices_at("1.6"), dim = slices_at("4");
  ASSERT_LT(bright, dim);
  const auto process = how(make_printer("near", {.travel_mm = bright * 0.05 + 0.01}, light), "700");
  const RunResult refused = submit_mesh(dir / "post.stl", "4,1.6", process);
  EXPECT_EQ(refused.exit_code, 3) << refused.err;
  EXPECT_THAT(refused.err, HasSubstr(fmt::format("takes {} slices after it", dim - 30)));
  const RunResult taken = submit_mesh(dir / "post.stl", "1.6,1.6", process);
  EXPECT_EQ(taken.exit_code, 0) << taken.err;
}

/// A lattice of bars that fills most of the display: every band has columns of every light.
std::string lattice_stl(float width_mm, float depth_mm, float height_mm) {
  std::vector<BoxMm> boxes;
  for (float z = 0; z + 2 < height_mm; z += 3) {
    for (float y = 0; y + 1 < depth_mm; y += 2) boxes.push_back({0, width_mm, y, y + 1, z, z + 1});
    for (float x = 0; x + 1 < width_mm; x += 2) {
      boxes.push_back({x, x + 1, 0, depth_mm, z + 0.75F, z + 1.75F});
    }
  }
  for (float x = 0; x + 1 < width_mm; x += 4) {
    boxes.push_back({x, x + 1, 0, 1, 0, height_mm});
  }
  return stl_of(boxes);
}

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool kSanitized = true;
#else
constexpr bool kSanitized = false;
#endif

class MemoryOfLight : public FarmUneven {
 protected:
  void SetUp() override {
    if (kSanitized) GTEST_SKIP() << "sanitizers take memory of their own";
    FarmUneven::SetUp();
  }
  /// What the job was given, and what it took.
  Attempt attempt_of(JobId id) const {
    ReadModel model(database());
    EXPECT_EQ(model.job(id)->state, JobState::done) << model.job(id)->message;
    const auto attempts = model.attempts(id);
    EXPECT_EQ(attempts.size(), 1U) << "ran out of memory";
    return attempts.at(0);
  }
  static void expect_near(const Attempt& a) {
    EXPECT_GE(a.memory_mb, a.peak_mb);
    // A third of it is for what programs keep for their next band, which small parts have none of (memory_need.cpp).
    constexpr double kept_for_next = 1.3;
    EXPECT_LE(static_cast<double>(a.memory_mb),
              kept_for_next * static_cast<double>(2 * a.peak_mb + 200));
  }
};

TEST_F(MemoryOfLight, FollowsTheNumberOfItsValues) {
  const Display display{.width_px = 640, .height_px = 400};
  write_file(dir / "lattice.stl", lattice_stl(30, 18, 5));
  const std::map<std::string, int> values = {{"weak", 2}, {"strong", 156}};
  for (const auto& [name, n] : values) {
    const auto light = [n = n](int x, int) { return 255 - x % n; };
    const RunResult r =
        submit_mesh(dir / "lattice.stl", "", how(make_printer(name, display, light), "400"));
    ASSERT_EQ(r.exit_code, 0) << r.err;
  }
  const RunResult r = run_all();
  ASSERT_EQ(r.exit_code, 0) << r.err;
  const Attempt strong = attempt_of(1), weak = attempt_of(2);
  RecordProperty("weak", fmt::format("{} of {} MB", weak.peak_mb, weak.memory_mb));
  RecordProperty("strong", fmt::format("{} of {} MB", strong.peak_mb, strong.memory_mb));
  expect_near(weak);
  expect_near(strong);
}

TEST_F(MemoryOfLight, FollowsTheTablesUnderUvLight) {
  const Display display{
      .width_px = 320,
      .height_px = 32,
      .more =
          "[uv]\nwavelength_nm = 365\nkind = \"flood\"\ncalibration = [[0, 0.0], [255, 275.0]]\n"};
  write_file(
      dir / "rungs.stl",
      stl_of({{0, 15, 0, 0.2F, 0, 0.5F}, {0, 1, 0, 0.2F, 0.5F, 1.5F}, {0, 15, 0, 0.2F, 1.5F, 2}}));
  const std::map<std::string, int> values = {{"weak", 2}, {"strong", 60}};
  for (const auto& [name, n] : values) {
    const auto light = [n = n](int x, int) { return 255 - x % n; };
    std::vector<std::string> process = how(make_printer(name, display, light), "40");
    process[3] = "custom-resin-1";
    process.insert(process.end(), {"--uv-mw-cm2", "20"});
    const RunResult r = submit_mesh(dir / "rungs.stl", "", process);
    ASSERT_EQ(r.exit_code, 0) << r.err;
  }
  const RunResult r = run_all();
  ASSERT_EQ(r.exit_code, 0) << r.err;
  const Attempt strong = attempt_of(1), weak = attempt_of(2);
  RecordProperty("weak", fmt::format("{} of {} MB", weak.peak_mb, weak.memory_mb));
  RecordProperty("strong", fmt::format("{} of {} MB", strong.peak_mb, strong.memory_mb));
  EXPECT_GT(strong.memory_mb, weak.memory_mb + 20) << "tables of 60 values";
  expect_near(weak);
  expect_near(strong);
}

}  // namespace
}  // namespace slicecorr::farm
