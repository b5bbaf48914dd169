// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Features over gaps that gel a shelf early (docs/bodies.md): when they gel, by sums of light that share no
/// code with the library, what edges and doses are then, and how much hangs on nothing for how long.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "bodies_grid.hpp"
#include "memory_slices.hpp"
#include "models.hpp"
#include "slicecorr/bodies.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/setup.hpp"

namespace slicecorr::test {
namespace {

struct OverhangRun {
  int upper, lower;  ///< nodes
};

/// A column with one feature over a gap, and what its light makes of it.
class Overhang {
 public:
  Overhang(double brightest, OverhangRun run, Overhangs overhangs) : run_(run) {
    // Black is a five hundredth of full light, which gives `brightest` critical doses in the end.
    const double speed = 100 / brightest * 3600 / 576 * 10;
    Process how = process(speed);
    how.overhangs = overhangs;
    const CureModel model =
        make_cure_model(linear_printer(0.2, 100), resin(576, 1500), how, kSliceUm);
    std::vector<std::uint8_t> design(static_cast<std::size_t>(run.lower), 0);
    std::fill(design.begin() + run.upper, design.end(), std::uint8_t{255});
    const int layers = run.lower;
    const int all = slices_with_burst(model, layers, layers - 1);
    const auto levels = solve_column(CorrectionPlan(model, how, layers, all), design);
    for (const std::uint8_t level : levels)
      phi_.push_back((0.2 + 99.8 * level / 255.0) / 100 * brightest);
  }

  /// Per slice: by how much a dose falls, and how many slices make it fall to a half.
  static constexpr double kSliceUm = 50, kHeightUm = 1500;
  static double fall(double slices) { return std::pow(10.0, -slices * kSliceUm / kHeightUm); }

  /// Dose at `place`, in slices from the platform, of the slices up to `until`.
  double dose(double place, int until) const {
    double sum = 0;
    for (int n = static_cast<int>(std::floor(place)); n <= until; ++n) {
      // The window passes from n to n + 1.
      const double near = std::max(0.0, n - place);
      sum += phi_[static_cast<std::size_t>(n)] * (fall(near) - fall(n + 1 - place));
    }
    return sum;
  }
  int last() const { return static_cast<int>(phi_.size()) - 1; }
  /// Slice that is shown when the first voxel of the feature gels.
  int first_gelled() const {
    for (int n = run_.upper; n <= last(); ++n) {
      for (int m = run_.upper; m <= std::min(n, run_.lower - 1); ++m) {
        if (dose(m + 0.5, n) >= 1) return n;
      }
    }
    return last() + 1;
  }
  int wrong_voxels() const {
    int wrong = 0;
    for (int m = 0; m < last(); ++m) {
      const bool designed = m >= run_.upper && m < run_.lower;
      wrong += designed != (dose(m + 0.5, last()) >= 1);
    }
    return wrong;
  }
  /// How far the upper edge is from its node, in slices: beside it the dose falls as one without light.
  double upper_error() const { return std::log10(dose(run_.upper, last())) * kHeightUm / kSliceUm; }
  double least_inside() const {
    double least = 1e300;
    for (int m = run_.upper; m < run_.lower; ++m) {
      least = std::min(least, dose(m + 0.5, last()));
    }
    return least;
  }

 private:
  const OverhangRun run_;
  std::vector<double> phi_;
};

TEST(Overhangs, GelAShelfEarlyAndKeepTheirEdges) {
  for (const double brightest : {20.0, 39.0, 150.0}) {
    for (const int thick : {60, 100, 200}) {
      SCOPED_TRACE(testing::Message() << brightest << " " << thick);
      const OverhangRun run{40, 40 + thick};
      const Overhang early(brightest, run, Overhangs::early);
      const Overhang bright(brightest, run, Overhangs::bright);
      for (const Overhang* one : {&early, &bright}) {
        EXPECT_EQ(one->wrong_voxels(), 0);
        // Aimed at: a thousandth of a slice, or a 25th of what a level does, up to a hundredth; the black
        // level's light beside the edge moves it by less than that again.
        EXPECT_LT(std::abs(one->upper_error()), 0.02);
        EXPECT_GE(one->least_inside(), 1);
      }
      // As bright as can be: black from where full light alone falls to 1 at the edge. Light that climbs for
      // 30 slices more is nine tenths of that, and the reserve for the levels before the edge leaves less
      // room by a seventh.
      const double whole = std::log10(brightest) * 1500 / 50;
      if (thick > whole + 30) {
        EXPECT_GE(bright.first_gelled() - run.upper, whole - 1);
      }
      // A shelf ends where the dose falls to 0.15, and takes a fifth of that way at most. The reserve moves
      // it by less than two slices.
      const double shelf = std::log10(1 / 0.15) * 1500 / 50;
      EXPECT_LE(early.first_gelled() - run.upper, 1.2 * shelf + 3);
      // No light gels anything sooner: a dose of 1 in one place and of 1 at the next slice both fall to the
      // edge, where they may have 1 together.
      EXPECT_GE(early.first_gelled() - run.upper, std::log10(2) * 1500 / 50 - 2);
    }
  }
}

TEST(Overhangs, AreLeftAsBrightWhereAShelfGainsNothing) {
  // Too little light, or too thin for one.
  for (const auto& [brightest, thick] : {std::pair{5.0, 100}, std::pair{39.0, 20}}) {
    const OverhangRun run{40, 40 + thick};
    EXPECT_EQ(Overhang(brightest, run, Overhangs::early).first_gelled(),
              Overhang(brightest, run, Overhangs::bright).first_gelled());
  }
}

TEST(Overhangs, AreRefusedWhereNoShelfIsMade) {
  slicecorr::Setup setup{linear_printer(1, 100), resin(576, 2000), process(1000)};
  setup.process.overhangs = Overhangs::early;
  EXPECT_NO_THROW(check_correction(setup, {}));
  EXPECT_THROW(check_correction(setup, {.doses = true}), InputError);
  setup.process.mode = ExposureMode::layerwise;
  EXPECT_THROW(check_correction(setup, {}), InputError);
  setup.process.overhangs = Overhangs::bright;
  EXPECT_NO_THROW(check_correction(setup, {}));
}

/// What hangs on nothing, in voxels times slices.
double hanging(const Bodies& bodies) {
  double sum = 0;
  for (const Island& i : bodies.islands) {
    sum += static_cast<double>(i.voxels) * std::max(0, i.until - i.begins);
  }
  return sum;
}

TEST(Overhangs, HoldWhatIsThinBesideThem) {
  // The lower half of a lying cylinder hangs over a gap; it is thick in the middle, where it stands on the
  // platform, and thin at both sides, which gel first.
  constexpr int kRadius = 50, kWidth = 82;
  const Grid grid{kWidth, 2, 2 * kRadius, 50, 50, 50};
  MemorySlices design(grid);
  for (int x = 0; x < kWidth; ++x) {
    const double from_middle = (x + 0.5 - kWidth / 2.0) * kRadius / (kWidth / 2.0);
    const double half = std::sqrt(std::max(0.0, kRadius * kRadius - from_middle * from_middle));
    const int upper = static_cast<int>(std::lround(kRadius - half));
    fill(design, {x, 0, upper}, {x + 1, 2, 2 * kRadius - upper});
  }
  double hang_early = 0, hang_bright = 0;
  for (const Overhangs overhangs : {Overhangs::early, Overhangs::bright}) {
    slicecorr::Setup setup{linear_printer(1, 100), resin(230, 1500), process(400)};
    setup.printer.pixel_x_um = setup.printer.pixel_y_um = 50;
    setup.printer.width_px = kWidth;
    setup.printer.height_px = 2;
    setup.process.overhangs = overhangs;
    const CorrectedSlices corrected(design, setup);
    const Prediction p = verify_stack(corrected, design, setup);
    ASSERT_TRUE(p.bodies);
    EXPECT_TRUE(p.bodies->printed.in_time);
    EXPECT_EQ(p.bodies->printed.loose_bodies, 0U);
    EXPECT_EQ(p.undercure_voxels, 0U);
    (overhangs == Overhangs::early ? hang_early : hang_bright) = hanging(p.bodies->printed);
  }
  // The sides are bodies on their own by either light. They grow until what is thick beside them gels,
  // log10(39) absorbance heights or the shelf's height late: 48 slices or 26, of which they are on
  // their own for about the half, and in this time grow as its square. So less than a third is left.
  EXPECT_GT(hang_bright, 1000);
  EXPECT_LT(hang_early, hang_bright / 3);
}

}  // namespace
}  // namespace slicecorr::test
