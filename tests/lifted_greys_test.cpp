// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Layer by layer with lifts: grey pixels of a slicer's antialiasing hold where they held as sliced.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "gel_time_models.hpp"
#include "models.hpp"
#include "real_files.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/units.hpp"
#include "stack_fixture.hpp"

namespace slicecorr {
namespace {

constexpr double kLayerUm = 50, kHeightE = 65;

Process lifted(double exposure_s) {
  Process p;
  p.mode = ExposureMode::layerwise;
  p.exposure_s = exposure_s;
  p.lifts = Lifts::each;
  return p;
}

struct Law {
  const char* name;
  Resin resin;
  double exposure_s;  ///< some five times what holds
};

std::vector<Law> laws() {
  Resin plain = test::resin(230, units::height10_from_e(300));
  Resin bleaching = plain;
  bleaching.bleaching = Bleaching{units::height10_from_e(600), 400};
  return {{"plain", plain, 0.5},
          {"gel-time", test::bright_resin(300), 5},
          {"bleaching", bleaching, 0.5}};
}

std::vector<std::uint8_t> solved(const CorrectionPlan& plan, std::uint8_t above, std::uint8_t c) {
  std::vector<std::uint8_t> coverage(90, 0);
  std::fill(coverage.begin(), coverage.begin() + 20, above);
  std::fill(coverage.begin() + 40, coverage.begin() + 60, c);
  return solve_column(plan, coverage, {});
}

TEST(LiftedGreys, HoldWhereTheSlicersLightDoes) {
  for (const Law& law : laws()) {
    SCOPED_TRACE(law.name);
    const Process process = lifted(law.exposure_s);
    const CureModel model =
        make_cure_model(test::linear_printer(1, 100), law.resin, process, kLayerUm);
    const CorrectionPlan plan(model, process, 90, 90);
    // Every layer of a feature holds, so the least of its levels does.
    const auto full = solved(plan, 0, 255);
    const std::uint8_t holds = *std::min_element(full.begin() + 40, full.begin() + 60);
    ASSERT_GT(holds, 8);
    ASSERT_LT(holds, 250);
    for (const int c : {1, 40, 127, 128, 200, 254}) {
      const auto grey = static_cast<std::uint8_t>(c);
      const auto levels = solved(plan, grey, grey);
      for (int n = 0; n < 90; ++n) {
        const int level = levels[static_cast<std::size_t>(n)];
        if (n < 20) {
          // What stands on the platform keeps the slicer's light.
          EXPECT_EQ(level, c) << n;
        } else if (n < 40 || n >= 60) {
          EXPECT_EQ(level, 0) << c << " " << n;
        } else {
          EXPECT_LE(level, c) << n;
          EXPECT_GE(level, std::min<int>(c, holds)) << n;
        }
      }
    }
  }
}

// A slope: greys, then full layers, below a gap. Each of the full ones and each grey whose light is enough holds by its
// own exposure, by the closed form.
TEST(LiftedGreys, BeforeAndAfterAFeatureHold) {
  const Process process = lifted(0.5);
  const Resin resin = test::resin(230, units::height10_from_e(300));
  const CureModel model = make_cure_model(test::linear_printer(1, 100), resin, process, kLayerUm);
  const CorrectionPlan plan(model, process, 80, 80);
  std::vector<std::uint8_t> coverage(80, 0);
  const std::vector<std::uint8_t> slope{60, 150, 255, 255, 255, 255, 255, 255, 255, 255, 220, 90};
  std::copy(slope.begin(), slope.end(), coverage.begin() + 30);
  const auto levels = solve_column(plan, coverage, {});
  const double strength = model.lifts->green_strength;
  for (std::size_t n = 30; n < 30 + slope.size(); ++n) {
    const double phi = model.level_phi[levels[n]], slicers = model.level_phi[coverage[n]];
    if (slicers * model.a >= strength) {
      EXPECT_GE(phi * model.a, strength) << n;
    } else {
      EXPECT_EQ(levels[n], coverage[n]) << n;
    }
  }
}

// A real file of a slicer with antialiasing, of a part without a gap: nothing is to be corrected.
TEST(LiftedGreys, OfARealFileWithoutGapsStay) {
  const test::TemporaryFolder folder;
  const StackReader design(test::real_file("slices/binary/mariner_pyramid.v3.ctb"), folder.path());
  slicecorr::Setup setup;
  setup.printer = test::linear_printer(0.003, 3);
  setup.printer.width_px = design.grid().width_px;
  setup.printer.height_px = design.grid().height_px;
  setup.printer.pixel_x_um = design.grid().pixel_x_um;
  setup.printer.pixel_y_um = design.grid().pixel_y_um;
  setup.resin = test::resin(615, units::height10_from_e(kHeightE));  // 4 mJ/cm²
  setup.process = lifted(8);
  const std::string out = folder / "part.uvj";
  const Correction made = correct_stack(design, setup, StackFile(out), {}, {});
  EXPECT_EQ(made.after.joints->not_holding_voxels, 0U);
  const StackReader shown(out, folder.path());
  const PixelBox box = design.bounds();
  std::vector<std::vector<std::uint8_t>> wanted;
  const std::size_t pixels =
      static_cast<std::size_t>(box.width()) * static_cast<std::size_t>(box.height());
  design.read_band(box, [&](int, const std::uint8_t* rows) {
    wanted.push_back(rows ? std::vector<std::uint8_t>(rows, rows + pixels)
                          : std::vector<std::uint8_t>(pixels, 0));
  });
  std::uint64_t greys = 0, changed = 0;
  shown.read_band(box, [&](int n, const std::uint8_t* rows) {
    const auto& of_slice = wanted.at(static_cast<std::size_t>(n));
    for (std::size_t i = 0; i < pixels; ++i) {
      greys += of_slice[i] != 0 && of_slice[i] != 255;
      changed += (rows ? rows[i] : 0) != of_slice[i];
    }
  });
  EXPECT_GT(greys, 10000U);
  EXPECT_EQ(changed, 0U);
}

}  // namespace
}  // namespace slicecorr
