// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The dead zone over the window: figures, schedules of the UV lamp, patterns in stacks.

#include "slicecorr/dead_zone.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "memory_slices.hpp"
#include "models.hpp"
#include "slicecorr/bodies.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/left_alone.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/units.hpp"
#include "stack_fixture.hpp"

namespace slicecorr {
namespace {

using test::TemporaryFolder;
using testing::HasSubstr;

Resin resin_1() {
  Resin r;
  r.name = "resin 1";
  r.model = CureModelKind::kinetic;
  r.m = 0.99;
  r.absorbance_height10_um = units::height10_from_e(408);
  r.critical_dose_prime = 64;
  r.inhibition = Inhibition{0.73, units::height10_from_e(37.8), 0.99, 0};
  return r;
}

Setup setup_of(UvKind kind, double uv_mw_cm2, double dead_zone_um) {
  Setup s;
  s.printer = test::linear_printer(1, 100);
  s.printer.uv = UvLamp{365, kind == UvKind::patterned, {{0, 0}, {255, 275}}};
  s.resin = resin_1();
  s.process = test::process(1000);
  s.process.uv.kind = kind;
  s.process.uv.uv_mw_cm2 = uv_mw_cm2;
  s.process.uv.dead_zone_um = dead_zone_um;
  return s;
}

CureModel model_of(const Setup& s) { return make_cure_model(s.printer, s.resin, s.process, 50); }

/// A block with a hole through it, and a thin plate, in an image of 16 x 16.
class Block final : public SliceSource {
 public:
  Block() {
    grid_.width_px = grid_.height_px = 16;
    grid_.layers = 60;
    grid_.pixel_x_um = grid_.pixel_y_um = grid_.layer_um = 50;
  }
  const Grid& grid() const override { return grid_; }
  PixelBox bounds() const override { return {2, 2, 12, 12}; }
  void read_band(const PixelBox& band, const Sink& sink) const override {
    std::vector<std::uint8_t> rows;
    for (int n = 0; n < grid_.layers; ++n) {
      rows.clear();
      for (int y = band.y0; y < band.y1; ++y) {
        for (int x = band.x0; x < band.x1; ++x) rows.push_back(solid(x, y, n) ? 255 : 0);
      }
      sink(n, rows.data());
    }
  }
  static bool solid(int x, int y, int n) {
    if (x < 2 || y < 2 || x >= 12 || y >= 12) return false;
    return x < 7 ? n < 60 : n >= 20 && n < 30;
  }

 private:
  Grid grid_;
};

TEST(WindowWatch, FindsLeastAndGreatestDeadZone) {
  const auto s = setup_of(UvKind::constant, 200, 0);
  const CureModel model = model_of(s);
  const Kinetics k = make_kinetics(s.resin, true, true);
  WindowWatch watch(model, 3, 4);
  const std::vector<std::uint8_t> first{0, 255, 51, 0}, second{0, 0, 0, 0}, third{9, 9, 9, 9};
  watch.add_slice(0, first.data());
  watch.add_slice(1, second.data());
  watch.add_slice(2, third.data());
  WindowTotal total(model, 3);
  total.merge(watch);
  const DeadZones zones = total.result();
  const auto intensity = level_intensities(s.printer);
  // (3.25)
  const auto zone = [&](int level) {
    return std::log(0.73 * 200 / intensity[static_cast<std::size_t>(level)]) /
           (1 / k.huv_um - 1 / k.hb_um);
  };
  EXPECT_NEAR(zones.least_um[0], zone(255), 1e-9);
  EXPECT_NEAR(zones.least_um[0], 15.766, 1e-3);  // physics.md: resin 1 at 100/200
  EXPECT_NEAR(zones.greatest_um[0], zone(51), 1e-9);
  EXPECT_TRUE(std::isnan(zones.least_um[1]));
  EXPECT_NEAR(zones.greatest_um[2], zone(9), 1e-9);
  EXPECT_EQ(zones.least(), zones.least_um[0]);
  EXPECT_EQ(zones.cured_pixels, 0U);
}

TEST(WindowWatch, CuresAfterTheTimeOfTheFront) {
  // 100 over 60 mW/cm²: the front reaches the window after D'c / (Ib - beta Iuv)^m.
  auto s = setup_of(UvKind::constant, 60, 0);
  s.process.allow_window_cure = true;
  const CureModel model = model_of(s);
  const Kinetics gel = make_kinetics(s.resin, true, false);
  const double slices = window_time_s(gel, 100, 60) / units::slice_time_s(50, 1000);
  const int enough = static_cast<int>(std::ceil(slices));
  ASSERT_GT(enough, 3);
  const std::uint8_t full = 255, safe = 90;
  const auto cured = [&](const std::vector<std::uint8_t>& shown) {
    WindowWatch watch(model, static_cast<int>(shown.size()), 1);
    for (std::size_t n = shown.size(); n-- > 0;) watch.add_slice(static_cast<int>(n), &shown[n]);
    WindowTotal total(model, static_cast<int>(shown.size()));
    total.merge(watch);
    return total.result().cured_pixels;
  };
  const auto many = [&](int n, std::uint8_t v) {
    return std::vector<std::uint8_t>(static_cast<std::size_t>(n), v);
  };
  EXPECT_EQ(cured(many(enough, full)), 1U);
  EXPECT_EQ(cured(many(enough - 1, full)), 0U);
  EXPECT_EQ(cured(many(10 * enough, safe)), 0U);
  // A slice with a dead zone between them brings fresh resin.
  auto broken = many(2 * enough - 2, full);
  broken[broken.size() / 2] = safe;
  EXPECT_EQ(cured(broken), 0U);
}

// The window gets as much more as an exposure takes longer.
TEST(WindowWatch, LongExposuresCountAsLongAsTheyAre) {
  auto s = setup_of(UvKind::constant, 20, 0);
  s.process.mode = ExposureMode::layerwise;
  s.process.allow_window_cure = true;
  s.process.exposure_s = 0.1;
  const double dose = model_of(s).inhibited()->window_dose(0, 255);
  ASSERT_GT(dose, 0);
  ASSERT_LT(dose, 0.9);
  const std::uint8_t full = 255;
  for (const double times : {0.99 / dose, 1.01 / dose}) {
    s.process.layer_exposure_s = {s.process.exposure_s * times, s.process.exposure_s};
    const CureModel model = model_of(s);
    WindowWatch watch(model, 1, 1);
    watch.add_slice(0, &full);
    WindowTotal total(model, 1);
    total.merge(watch);
    EXPECT_EQ(total.result().cured_pixels, times * dose > 1 ? 1U : 0U);
  }
}

TEST(ScheduleUv, ConstantStaysAsItIs) {
  const auto s = setup_of(UvKind::constant, 200, 0);
  EXPECT_EQ(schedule_uv(Block(), s), s.process);
}

TEST(ScheduleUv, EachSliceGetsWhatItsBrightestPixelNeeds) {
  const auto s = setup_of(UvKind::per_slice, 0, 12);
  const Process process = schedule_uv(Block(), s);
  const auto& uv = process.uv.slice_mw_cm2;
  ASSERT_GE(uv.size(), 60U);
  const Kinetics k = make_kinetics(s.resin, true, true);
  const double most = uv_for_dead_zone(k, 100, 12);
  EXPECT_NEAR(*std::max_element(uv.begin(), uv.end()), most, 1e-9 * most);
  // Deep in the block light is steady at about half of full light, and so is the lamp.
  EXPECT_LT(uv[45], 0.7 * most);
  // What is then shown keeps the dead zone in every slice.
  auto with = s;
  with.process = process;
  TemporaryFolder folder;
  const Correction c = correct_stack(Block(), with, folder / "a.uvj", {});
  ASSERT_TRUE(c.after.dead_zones);
  EXPECT_GE(c.after.dead_zones->least(), 12.0 - 1e-9);
  EXPECT_EQ(c.after.cure_through_voxels + c.after.undercure_voxels, 0U);
  EXPECT_LT(c.after.height_error_um.greatest(), 8.0);
  // Scheduled by correct_stack itself: the same stack.
  correct_stack(Block(), s, folder / "b.uvj", {});
  EXPECT_EQ(test::read_file(folder / "a.uvj"), test::read_file(folder / "b.uvj"));
  // The stack brings its schedule.
  const StackInfo info = StackReader::read_info(folder / "a.uvj");
  EXPECT_EQ(info.process, process);
}

/// A table upside down: a plate on the platform, two legs, and a bar that is thicker than it needs to be printed.
/// By sums in steps of 0.25 um its legs were once cut in two below the bar, and liquid at the platform.
test::MemorySlices table() {
  Grid grid;
  grid.width_px = grid.height_px = 16;
  grid.layers = 50;
  grid.pixel_x_um = grid.pixel_y_um = grid.layer_um = 50;
  test::MemorySlices part(grid);
  for (int n = 0; n < grid.layers; ++n) {
    for (int y = 0; y < 4; ++y) {
      for (int x = 0; x < 12; ++x) {
        const bool leg = x < 3 || x >= 9;
        part.at(n, x, y) = n < 12 || n >= 40 || leg ? 255 : 0;
      }
    }
  }
  return part;
}

TEST(ScheduleUv, FeaturesHangTogetherAndHoldAtThePlatform) {
  for (const auto& [speed_mm_h, zone_um] : {std::pair{30.0, 30.0}, {60.0, 15.0}, {60.0, 30.0}}) {
    slicecorr::Setup s = setup_of(UvKind::per_slice, 0, zone_um);
    s.process = test::process(speed_mm_h);
    s.process.uv.kind = UvKind::per_slice;
    s.process.uv.dead_zone_um = zone_um;
    s.resin.m = 0.9448115;
    s.resin.absorbance_height10_um = units::height10_from_e(389.7673);
    s.resin.critical_dose_mj_cm3 = s.resin.gel_dose_mj_cm3 = 0;
    s.resin.critical_dose_prime = 5 * 69.58752;
    s.resin.inhibition->beta = 0.7915055;
    s.resin.inhibition->absorbance_height10_um = units::height10_from_e(41.49307);
    s.resin.inhibition->m = s.resin.m;
    TemporaryFolder folder;
    const Correction c = correct_stack(table(), s, folder / "a.uvj", {});
    EXPECT_EQ(c.after.split_features, 0U) << speed_mm_h << " " << zone_um;
    EXPECT_EQ(c.after.runs_on_platform, 48U);
    EXPECT_EQ(c.after.liquid_at_platform, 0U) << speed_mm_h << " " << zone_um;
    EXPECT_GE(c.after.dead_zones->least(), zone_um - 1e-9);
  }
}

TEST(ScheduleUv, ThePartHangsOnItsSupports) {
  // Pillars of full light below a block, of which nothing else is asked.
  Grid grid;
  grid.width_px = grid.height_px = 16;
  grid.layers = 50;
  grid.pixel_x_um = grid.pixel_y_um = grid.layer_um = 50;
  test::MemorySlices part(grid), pillars(grid);
  for (int n = 0; n < grid.layers; ++n) {
    for (int y = 0; y < 16; ++y) {
      for (int x = 0; x < 16; ++x) {
        part.at(n, x, y) = n >= 20 ? 255 : 0;
        pillars.at(n, x, y) = n < 20 && x % 8 < 4 && y % 8 < 4 ? 255 : 0;
      }
    }
  }
  const LeavingAlone supported(part, {{&pillars, "pillars"}});
  for (const double zone_um : {12.0, 25.0}) {
    slicecorr::Setup s = setup_of(UvKind::per_slice, 0, zone_um);
    s.process = test::process(60);
    s.process.uv.kind = UvKind::per_slice;
    s.process.uv.dead_zone_um = zone_um;
    TemporaryFolder folder;
    const Correction c = correct_stack(supported, s, folder / "a.uvj", {});
    ASSERT_TRUE(c.after.bodies);
    EXPECT_EQ(c.after.bodies->printed.loose_bodies, 0) << zone_um;
    EXPECT_EQ(c.after.bodies->printed.sealed_in_all, 0) << zone_um;
    EXPECT_EQ(c.after.undercure_voxels, 0U) << zone_um;
  }
}

TEST(UvPattern, IsWrittenBesideTheSlices) {
  const auto s = setup_of(UvKind::patterned, 0, 12);
  TemporaryFolder folder;
  const Correction c = correct_stack(Block(), s, folder / "a.uvj", {});
  EXPECT_GE(c.after.dead_zones->least(), 12.0 - 1e-9);
  EXPECT_EQ(c.after.cure_through_voxels + c.after.undercure_voxels, 0U);
  const auto entries = test::unzip(folder / "a.uvj");
  const auto at = [](auto& list, const std::string& name) -> auto& {
    return std::find_if(list.begin(), list.end(), [&](auto& e) { return e.first == name; })->second;
  };
  const CureModel model = model_of(s);
  const auto& uv_levels = model.inhibited()->uv_levels();
  for (int n = 0; n < c.info.grid.layers; n += 13) {
    char blue_name[40], uv_name[40];
    std::snprintf(blue_name, sizeof blue_name, "slice/%08d.png", n);
    std::snprintf(uv_name, sizeof uv_name, "uv/%08d.png", n);
    const GreyImage blue = decode_png(at(entries, blue_name), 16, 16, "a.uvj", blue_name);
    const GreyImage uv = decode_png(at(entries, uv_name), 16, 16, "a.uvj", uv_name);
    for (std::size_t i = 0; i < blue.pixels.size(); ++i) {
      ASSERT_EQ(uv.pixels[i], uv_levels[blue.pixels[i]]) << n << " " << i;
    }
  }
  // Read back whole, with the same figures; a changed image is told.
  std::vector<std::string> told;
  ExecutionContext context;
  context.notice = [&](const std::string& text) { told.push_back(text); };
  const StackReader reader(folder / "a.uvj", folder.path(), context);
  EXPECT_TRUE(told.empty());
  EXPECT_EQ(verify_stack(reader, Block(), s).to_json(), c.after.to_json());
  auto changed = entries;
  at(changed, "uv/00000003.png") = at(entries, "uv/00000061.png");
  test::make_zip(folder / "b.uvj", changed);
  const StackReader other(folder / "b.uvj", folder.path(), context);
  ASSERT_EQ(told.size(), 1U);
  EXPECT_THAT(told[0], HasSubstr("UV images were changed"));
  std::erase_if(changed, [](auto& e) { return e.first == "uv/00000004.png"; });
  test::make_zip(folder / "c.uvj", changed);
  try {
    const StackReader missing(folder / "c.uvj", folder.path());
    FAIL() << "a missing UV image was not noticed";
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr("uv/00000004.png: is missing"));
  }
}

TEST(WindowCure, IsRefusedUnlessAllowed) {
  DeadZones zones;
  Process p;
  EXPECT_NO_THROW(check_window(zones, p));
  zones.cured_pixels = 12;
  zones.cured_slice = 3;
  try {
    check_window(zones, p);
    FAIL();
  } catch (const InfeasibleError& e) {
    EXPECT_THAT(e.what(), HasSubstr("at 12 pixels, first in slice 3"));
  }
  p.allow_window_cure = true;
  EXPECT_NO_THROW(check_window(zones, p));
}

TEST(UvCorrection, SameBytesForAnyNumberOfThreads) {
  const auto s = setup_of(UvKind::constant, 200, 0);
  TemporaryFolder folder;
  for (const int threads : {1, 2, 8}) {
    ExecutionContext context;
    context.threads = threads;
    correct_stack(Block(), s, folder / (std::to_string(threads) + ".uvj"), {}, context);
  }
  EXPECT_EQ(test::read_file(folder / "1.uvj"), test::read_file(folder / "2.uvj"));
  EXPECT_EQ(test::read_file(folder / "1.uvj"), test::read_file(folder / "8.uvj"));
}

}  // namespace
}  // namespace slicecorr
