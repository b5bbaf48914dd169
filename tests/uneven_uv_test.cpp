// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// UV light that is uneven beside a display that is, in patterns, and where light spreads; what lamps are asked for.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "memory_slices.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/even_dead_zone.hpp"
#include "slicecorr/even_light.hpp"
#include "slicecorr/inhibited.hpp"
#include "slicecorr/machine_light.hpp"
#include "slicecorr/machine_motion.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/place_models.hpp"
#include "uv_models.hpp"

namespace slicecorr {
namespace {

using test::MemorySlices;
using namespace test::uv;
using testing::HasSubstr;

FlatField field_of(int width, int height, std::vector<std::uint8_t> values) {
  return {width, height, std::make_shared<const std::vector<std::uint8_t>>(std::move(values)), 255,
          false};
}

/// From `first` to `last` along x, or along y.
FlatField ramp(int width, int height, double first, double last, bool along_y = false) {
  std::vector<std::uint8_t> values;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const double at = along_y ? y / (height - 1.0) : x / (width - 1.0);
      values.push_back(static_cast<std::uint8_t>(std::lround(first + at * (last - first))));
    }
  }
  return field_of(width, height, std::move(values));
}

slicecorr::Setup setup_of(int width_px, int height_px, double speed_mm_h = 300) {
  slicecorr::Setup s;
  s.printer = uv_printer();
  s.printer.width_px = width_px;
  s.printer.height_px = height_px;
  s.resin = resin_1();
  s.process = uv_process(speed_mm_h, 200);
  return s;
}

Grid grid_of(const slicecorr::Setup& s) {
  return {s.printer.width_px, s.printer.height_px, 20, 50, 50, 50};
}

/// The value of a picture with as many values as the display has pixels, of its calibration.
double share_at(const FlatField& field, int x, int y) {
  return 1.0 * (*field.values)[static_cast<std::size_t>(y * field.width_px + x)] / field.reference;
}

TEST(TwoUnevenLamps, EachPlaceHasTheModelOfBothLights) {
  slicecorr::Setup s = setup_of(6, 4);
  s.printer.flat_field = ramp(6, 4, 255, 160);
  s.printer.uv_flat_field = ramp(6, 4, 255, 190, true);
  const Printer uneven = s.printer;
  const PlaceModels models(uneven, s.resin, s.process, grid_of(s), {});
  s.printer.flat_field.reset();
  s.printer.uv_flat_field.reset();
  std::set<std::uint8_t> values;
  for (int y = 0; y < 4; ++y) {
    for (int x = 0; x < 6; ++x) {
      const double blue = share_at(*uneven.flat_field, x, y),
                   uv = share_at(*uneven.uv_flat_field, x, y);
      Process process = s.process;
      process.uv.uv_mw_cm2 *= uv;
      const CureModel expected = make_cure_model(dimmed(s.printer, blue), s.resin, process, 50);
      const CureModel& got = models.model_at(x, y);
      ASSERT_EQ(got.level_phi.size(), expected.level_phi.size());
      for (std::size_t l = 0; l < expected.level_phi.size(); ++l) {
        ASSERT_NEAR(got.level_phi[l], expected.level_phi[l], 1e-9) << x << " " << y << " " << l;
      }
      EXPECT_NEAR(got.inhibited()->uv_mw_cm2(0, 0), 200 * uv, 1e-9);
      values.insert(models.map().value(x, y));
    }
  }
  EXPECT_EQ(values.size(), 24U);
  // The greatest value has the least UV light over its blue light.
  EXPECT_EQ(models.map().value(0, 3), models.map().greatest());
}

TEST(TwoUnevenLamps, PlacesAreToldApartToHalfAPercentOrRefused) {
  slicecorr::Setup s = setup_of(64, 64);
  s.printer.flat_field = ramp(64, 64, 255, 217);
  s.printer.uv_flat_field = ramp(64, 64, 255, 217, true);
  const PlaceModels models(s.printer, s.resin, s.process, grid_of(s), {});
  std::set<std::uint8_t> values;
  for (int y = 0; y < 64; ++y) {
    for (int x = 0; x < 64; ++x) {
      const std::uint8_t v = models.map().value(x, y);
      values.insert(v);
      EXPECT_NEAR(models.curing_factor(v) / share_at(*s.printer.flat_field, x, y), 1, 0.005);
      EXPECT_NEAR(models.uv_factor(v) / share_at(*s.printer.uv_flat_field, x, y), 1, 0.005);
    }
  }
  // 39 values of each light, by threes.
  EXPECT_GT(values.size(), 160U);
  EXPECT_LE(values.size(), 169U);
  s.printer.flat_field = ramp(64, 64, 255, 150);
  s.printer.uv_flat_field = ramp(64, 64, 255, 150, true);
  try {
    const PlaceModels wide(s.printer, s.resin, s.process, grid_of(s), {});
    FAIL() << "both lights fall by 40 %, across each other";
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr("uv.flat_field"));
    EXPECT_THAT(e.what(), HasSubstr("0.5 %"));
  }
  // Where both fall together there are few pairs, however far they fall.
  s.printer.uv_flat_field = ramp(64, 64, 255, 150);
  EXPECT_NO_THROW(PlaceModels(s.printer, s.resin, s.process, grid_of(s), {}));
}

TEST(UnevenTables, FewValuesNeedNoSharingAndManyAreRefused) {
  slicecorr::Setup s = setup_of(6, 4);
  for (const bool heights : {true, false}) {
    s.process.layer_heights_um.clear();
    s.printer.platform_reflectance = heights ? 0 : 0.3;
    if (heights) s.process.layer_heights_um.assign(20, 50);
    if (heights) s.process.layer_heights_um.push_back(30);
    // Three values, far from each other.
    s.printer.uv_flat_field =
        field_of(6, 4, {255, 255, 222, 222, 180, 180, 255, 255, 222, 222, 180, 180,
                        255, 255, 222, 222, 180, 180, 255, 255, 222, 222, 180, 180});
    const PlaceModels models(s.printer, s.resin, s.process, grid_of(s), {});
    ASSERT_FALSE(models.brightest().inhibited()->alike());
    for (const int x : {0, 2, 4}) {
      EXPECT_EQ(models.uv_factor(models.map().value(x, 1)),
                share_at(*s.printer.uv_flat_field, x, 1));
    }
    // All values between them have no room, and are off by more than half a percent together.
    slicecorr::Setup wide = setup_of(96, 4);
    wide.process = s.process;
    wide.printer.platform_reflectance = s.printer.platform_reflectance;
    wide.printer.uv_flat_field = ramp(96, 4, 255, 60);
    try {
      const PlaceModels many(wide.printer, wide.resin, wide.process, grid_of(wide), {});
      FAIL() << "196 values of light, with tables of each slice";
    } catch (const InputError& e) {
      EXPECT_THAT(e.what(), HasSubstr("uv.flat_field"));
      EXPECT_THAT(e.what(), HasSubstr("tables of their own"));
    }
  }
}

TEST(UnevenPatterns, AreMadeForTheWeakestPlace) {
  for (const bool both : {false, true}) {
    slicecorr::Setup s = setup_of(6, 4);
    s.printer.uv->patterned = true;
    s.printer.uv_flat_field = ramp(6, 4, 255, 200);
    if (both) s.printer.flat_field = ramp(6, 4, 220, 255, true);
    s.process.uv = {UvKind::patterned, 0, 15, {}};
    const PlaceModels models(s.printer, s.resin, s.process, grid_of(s), {});
    const InhibitedKernel& weakest = *models.brightest().inhibited();
    double least_um = 1e9;
    for (int y = 0; y < 4; ++y) {
      for (int x = 0; x < 6; ++x) {
        const InhibitedKernel& kernel = *models.model_at(x, y).inhibited();
        ASSERT_EQ(kernel.uv_levels(), weakest.uv_levels());
        const double uv = share_at(*s.printer.uv_flat_field, x, y);
        for (int level = 20; level < 256; ++level) {
          // The lamp's calibration is 275 mW/cm² at level 255.
          const double of_level = 275.0 * kernel.uv_levels()[static_cast<std::size_t>(level)] / 255;
          ASSERT_NEAR(kernel.uv_mw_cm2(0, level), uv * of_level, 1e-9);
          ASSERT_GE(kernel.dead_zone_um(0, level), 15 * (1 - 1e-9)) << x << " " << y;
        }
        least_um = std::min(least_um, kernel.dead_zone_um(0, 255));
      }
    }
    // No thicker there than the next level of the lamp makes it: 1/255 of 275 of 150 mW/cm² is 0.3 um.
    EXPECT_LT(least_um, 15.5);
  }
}

/// Two walls and what hangs between them.
MemorySlices part(int width, int height) {
  MemorySlices t({width, height, 40, 50, 50, 50});
  for (int n = 0; n < 38; ++n) {
    for (int y = 5; y < height - 5; ++y) {
      for (int x = 5; x < width - 5; ++x) {
        const bool gap = n >= 10 && n < 22 && x >= 12 && x < width - 12;
        t.at(n, x, y) = gap ? 0 : 255;
      }
    }
  }
  return t;
}

TEST(UnevenPatterns, OfAnEvenDeadZoneMakeItsLightEven) {
  slicecorr::Setup s = setup_of(40, 20);
  s.printer.uv->patterned = true;
  s.resin = resin_1(1);
  s.resin.viscosity_pa_s = 0.3;
  s.resin.dose_diffusion_m2_s = 1e-10;
  EvenLight light;
  light.columns = 2;
  light.rows = 1;
  light.pitch_um = 1000;
  light.gap_um = 60;
  light.slices = {0};
  using Bytes = std::vector<std::uint8_t>;
  light.blue = std::make_shared<const Bytes>(Bytes{120, 200});
  light.uv = std::make_shared<const Bytes>(Bytes{60, 150});
  s.process.uv = {UvKind::patterned, 0, 0, {100}};
  s.process.even_dead_zone = EvenDeadZone::both;
  s.process.even_light = light;
  const Grid images = grid_of(s);
  const EvenUvImages even(s, images, {});
  slicecorr::Setup lamp = s;
  lamp.printer.uv_flat_field = ramp(40, 20, 255, 170);
  const EvenUvImages uneven(lamp, images, {});
  const FlatField& field = *lamp.printer.uv_flat_field;
  int brighter = 0;
  for (const int blue : {80, 160, 255}) {
    Bytes shown(40, static_cast<std::uint8_t>(blue)), wanted(shown);
    uneven.make_row(0, 7, shown);
    even.make_row(0, 7, wanted);
    for (int x = 0; x < 40; ++x) {
      const auto at = static_cast<std::size_t>(x);
      // Levels of the lamp are linear, and each picture shows the next one up.
      const double comes = shown[at] * share_at(field, x, 7);
      EXPECT_GE(comes, wanted[at] - 1.1) << x;
      EXPECT_LE(comes, wanted[at] + 1.1) << x;
      brighter += shown[at] > wanted[at];
    }
  }
  EXPECT_GT(brighter, 60);
  // With a lamp that floods the window nothing makes it even.
  lamp.printer.uv->patterned = false;
  lamp.process.even_light.reset();
  lamp.process.even_dead_zone = EvenDeadZone::constant;
  try {
    find_even_light(part(40, 20), lamp, {});
    FAIL() << "an uneven flood";
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr("uv.flat_field"));
  }
}

Prediction corrected(const MemorySlices& target, slicecorr::Setup s, int rounds) {
  s.process.spread_rounds = rounds;
  const CorrectedSlices slices(target, s, {});
  return verify_stack(slices, target, s, {});
}

std::uint64_t wrong(const Prediction& p) { return p.cure_through_voxels + p.undercure_voxels; }

TEST(UnevenUvSpread, ColumnsAreCorrectedTogetherForTheLightOfTheirPlaces) {
  const MemorySlices target = part(34, 20);
  slicecorr::Setup s = setup_of(34, 20, 100);
  s.printer.spread = {{{40, 1}}, std::nullopt};
  s.printer.uv_flat_field = ramp(34, 20, 255, 150);
  for (const bool both : {false, true}) {
    if (both) s.printer.flat_field = ramp(34, 20, 255, 220);
    const Prediction alone = corrected(target, s, 0), together = corrected(target, s, 3);
    RecordProperty(both ? "both_alone" : "alone", std::to_string(wrong(alone)));
    RecordProperty(both ? "both_together" : "together", std::to_string(wrong(together)));
    EXPECT_GT(wrong(alone), 1000U);
    // As under even UV light: walls, an overhang and a channel print.
    EXPECT_LE(wrong(together), wrong(alone) / 50);
    EXPECT_EQ(together.lost_features, 0U);
    // A correction that takes UV light for even puts edges elsewhere.
    slicecorr::Setup even = s;
    even.printer.uv_flat_field.reset();
    even.process.spread_rounds = 3;
    const CorrectedSlices slices(target, even, {});
    const Prediction blind = verify_stack(slices, target, s, {});
    RecordProperty(both ? "both_um" : "um", std::to_string(together.height_error_um.mean()));
    RecordProperty(both ? "both_blind_um" : "blind_um",
                   std::to_string(blind.height_error_um.mean()));
    EXPECT_LT(together.height_error_um.mean(), 0.8 * blind.height_error_um.mean());
  }
}

TEST(CheckLamps, ADeadZoneIsHeldOverTheLightThatSlicesGet) {
  slicecorr::Setup s = setup_of(6, 4);
  s.process.uv = {UvKind::constant, 0, 20, {}};
  MachineMotion machine;
  machine.printer = "p";
  machine.least_uv_share = 0.99;  // whatever is asked for is too little, and is told
  const auto asked = [&](const std::vector<double>& shares) {
    s.process.light_share = shares;
    try {
      check_lamps({s.printer, s.resin, s.process, 50, 10}, machine);
    } catch (const InfeasibleError& e) {
      return std::string(e.what());
    }
    return std::string("nothing was thrown");
  };
  // Iuv = Ib/beta e^(z (1/huv - 1/hb)) of full light: 232.5 mW/cm².
  const double full = 100 / 0.73 * std::exp(20 * (1 / 37.8 - 1 / 408.0));
  const auto in_words = [](double mw_cm2) {
    char text[32];
    std::snprintf(text, sizeof text, "%.4g to %.4g mW", mw_cm2, mw_cm2);
    return std::string(text);
  };
  EXPECT_THAT(asked({}), HasSubstr(in_words(full)));
  EXPECT_THAT(asked({0.8}), HasSubstr(in_words(0.8 * full)));
  EXPECT_THAT(asked({0.5, 0.9, 0.7}), HasSubstr(in_words(0.9 * full)));
  // What the kernel sets is the same.
  const CureModel model = make_cure_model(s.printer, s.resin, s.process, 50);
  EXPECT_NEAR(model.inhibited()->uv_mw_cm2(1, 255) * model.inhibited()->blue_share(1), 0.9 * full,
              1e-6 * full);
}

}  // namespace
}  // namespace slicecorr
