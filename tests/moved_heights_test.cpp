// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Slices of different heights in continuous exposure: doses, corrections and figures of random columns against
// integrals over the window's way that share no code with the library.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "layer_places.hpp"
#include "models.hpp"
#include "rounds.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/predict.hpp"

namespace slicecorr {
namespace {

constexpr int kTarget = 60;
constexpr double kUsualUm = 50;

/// A moving print and all that its doses follow from.
struct Moved {
  Printer printer = test::linear_printer(0.5, 100);
  Resin resin;
  Process process;

  double node_um(int n) const { return test::node_um(process, n, 0); }
  double height_um(int n) const { return test::height_um(process, n, 0); }
  double speed_mm_h(int n) const {
    const auto& own = process.slice_speed_mm_h;
    return own.empty() ? process.speed_mm_h
                       : own[std::min(static_cast<std::size_t>(n), own.size() - 1)];
  }
  /// Dose at a place: while slice n is shown, the window goes from its upper to its lower node, and from each
  /// place of the window on light falls to 10^(-distance / ha).
  double dose(double z_um, const std::vector<double>& mw_cm2) const {
    const double fall_per_um = resin.m * std::numbers::ln10 / resin.absorbance_height10_um;
    double sum = 0, from_um = 0;
    for (std::size_t n = 0; n < mw_cm2.size(); ++n) {
      const double to_um = from_um + height_um(static_cast<int>(n));
      const double begin_um = std::max(from_um, z_um);
      if (to_um > begin_um) {
        const double s_per_um = 3.6 / speed_mm_h(static_cast<int>(n));
        sum +=
            std::pow(mw_cm2[n], resin.m) * s_per_um / fall_per_um *
            (std::exp(-fall_per_um * (begin_um - z_um)) - std::exp(-fall_per_um * (to_um - z_um)));
      }
      from_um = to_um;
    }
    return sum / resin.critical_dose_prime;
  }
  std::vector<double> light(const std::vector<std::uint8_t>& levels) const {
    const double black = printer.calibration.front().intensity_mw_cm2,
                 full = printer.calibration.back().intensity_mw_cm2;
    std::vector<double> mw_cm2;
    for (const int level : levels) mw_cm2.push_back(black + (full - black) * level / 255.0);
    return mw_cm2;
  }
  CureModel model() const { return make_cure_model(printer, resin, process, kUsualUm); }
};

Moved random_moved(std::mt19937& random, bool speeds) {
  const auto among = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  Moved u;
  u.resin.name = "r";
  u.resin.model = CureModelKind::kinetic;
  u.resin.m = among(0.7, 1.2);
  u.resin.absorbance_height10_um = among(300, 900);
  u.process = test::process(600);
  for (int n = 0; n < kTarget; ++n) {
    u.process.layer_heights_um.push_back(5 * std::round(among(4, 20)));
    if (speeds) u.process.slice_speed_mm_h.push_back(std::round(among(300, 600)));
  }
  if (speeds) u.process.slice_lamps = SliceLamps::stay;
  // Full light leaves four times the dose aimed at after a long run.
  u.resin.critical_dose_prime = std::pow(100.0, u.resin.m) * 3.6 / 600 / 4 *
                                u.resin.absorbance_height10_um / u.resin.m / std::numbers::ln10;
  return u;
}

std::vector<std::uint8_t> random_levels(std::mt19937& random, int slices) {
  std::vector<std::uint8_t> levels;
  for (int n = 0; n < slices; ++n) levels.push_back(static_cast<std::uint8_t>(random() % 256));
  return levels;
}

TEST(MovedHeights, DosesAreIntegralsOverTheWay) {
  std::mt19937 random(3);
  for (int round = 0; round < test::rounds(20); ++round) {
    const Moved u = random_moved(random, round % 2 == 1);
    // Later slices are as high, and as fast, as the last that is listed.
    const std::vector<std::uint8_t> levels = random_levels(random, kTarget + 5);
    const ColumnDose doses = column_dose(u.model(), levels);
    const std::vector<double> light = u.light(levels);
    for (int n = 0; n < kTarget + 5; ++n) {
      const auto i = static_cast<std::size_t>(n);
      const double upper = u.dose(u.node_um(n), light), lower = u.dose(u.node_um(n + 1), light),
                   middle = u.dose(0.5 * (u.node_um(n) + u.node_um(n + 1)), light);
      EXPECT_NEAR(doses.upper[i], upper, 1e-9 * upper) << n;
      EXPECT_NEAR(doses.middle[i], middle, 1e-9 * middle) << n;
      EXPECT_NEAR(doses.lower[i], lower, 1e-9 * std::max(lower, 1e-3)) << n;
    }
  }
}

TEST(MovedHeights, ASliceCutInTwoGivesTheSameDoses) {
  std::mt19937 random(5);
  for (int round = 0; round < test::rounds(20); ++round) {
    const Moved whole = random_moved(random, round % 2 == 1);
    Moved cut = whole;
    cut.process.layer_heights_um.clear();
    cut.process.slice_speed_mm_h.clear();
    const std::vector<std::uint8_t> levels = random_levels(random, kTarget);
    std::vector<std::uint8_t> twice;
    for (int n = 0; n < kTarget; ++n) {
      const double part = std::uniform_real_distribution<double>(0.1, 0.9)(random);
      for (const double share : {part, 1 - part}) {
        cut.process.layer_heights_um.push_back(share * whole.height_um(n));
        if (round % 2 == 1) cut.process.slice_speed_mm_h.push_back(whole.speed_mm_h(n));
        twice.push_back(levels[static_cast<std::size_t>(n)]);
      }
    }
    const ColumnDose a = column_dose(whole.model(), levels), b = column_dose(cut.model(), twice);
    for (std::size_t n = 0; n < levels.size(); ++n) {
      // A step rounds by some 1e-16 of a dose.
      EXPECT_NEAR(a.upper[n], b.upper[2 * n], 1e-13 * a.upper[n]) << n;
      EXPECT_NEAR(a.lower[n], b.lower[2 * n + 1], 1e-13 * a.upper[n]) << n;
    }
  }
}

/// Features and gaps of some slices each.
std::vector<std::uint8_t> random_column(std::mt19937& random, int thick, int apart) {
  return test::column(kTarget, test::random_runs(random, 8, kTarget - 1, thick, apart));
}

// Images that no correction made: voxels that print, and edges, of which all are looked for in steps.
TEST(MovedHeights, FiguresOfAnyImagesAreThoseOfTheDoses) {
  std::mt19937 random(17);
  std::size_t edges = 0, wrong = 0;
  for (int round = 0; round < test::rounds(20); ++round) {
    const Moved u = random_moved(random, round % 2 == 1);
    const CureModel model = u.model();
    const PixelCurve curve = pixel_curve(model);
    const std::vector<std::uint8_t> column = random_column(random, 3, 3);
    std::vector<std::uint8_t> levels = column;
    for (std::uint8_t& level : levels) {
      level = static_cast<std::uint8_t>(level == 0 ? random() % 60 : 60 + random() % 196);
    }
    BandPredictor predictor(model, curve, kTarget, 1);
    std::vector<std::pair<int, double>> told;
    predictor.tell_edges([&](std::size_t, int node, bool upper, double um) {
      if (upper && um > 0) told.emplace_back(node, um);
    });
    for (int n = kTarget; n-- > 0;) {
      const auto i = static_cast<std::size_t>(n);
      predictor.add_slice(n, &levels[i], &column[i]);
    }
    const Prediction p = predictor.finish([](std::size_t) { return Pixel{0, 0}; });
    const std::vector<double> light = u.light(levels);
    std::uint64_t through = 0, under = 0;
    for (int n = 0; n < kTarget; ++n) {
      const bool prints = u.dose(0.5 * (u.node_um(n) + u.node_um(n + 1)), light) >= 1;
      const bool designed = column[static_cast<std::size_t>(n)] != 0;
      through += prints && !designed;
      under += !prints && designed;
    }
    EXPECT_EQ(p.cure_through_voxels, through) << round;
    EXPECT_EQ(p.undercure_voxels, under) << round;
    wrong += through + under;
    for (const auto& [node, um] : told) {
      // As far beyond the edge as the print goes, at most to the end of the gap.
      int top = node;
      while (top > 0 && column[static_cast<std::size_t>(top) - 1] == 0) --top;
      const double at_um = u.node_um(node), most_um = at_um - u.node_um(top);
      double reach = 0;
      while (reach + 0.1 < most_um && u.dose(at_um - reach - 0.1, light) >= 1) reach += 0.1;
      EXPECT_NEAR(um, reach, 0.2) << node;
      ++edges;
    }
  }
  EXPECT_GT(edges, 30u);
  EXPECT_GT(wrong, 50u);
}

TEST(MovedHeights, AlikeTheyAreTheSameToTheLastBit) {
  std::mt19937 random(7);
  for (int round = 0; round < test::rounds(10); ++round) {
    Moved u = random_moved(random, false);
    u.process.layer_heights_um.clear();
    const CureModel plain = u.model();
    u.process.layer_heights_um.assign(7, kUsualUm);
    const CureModel listed = u.model();
    EXPECT_TRUE(listed.is_plain());
    const std::vector<std::uint8_t> column = random_column(random, 2, 2);
    const std::vector<std::uint8_t> levels =
        solve_column(CorrectionPlan(plain, u.process, kTarget, kTarget + 9), column);
    EXPECT_EQ(levels,
              solve_column(CorrectionPlan(listed, u.process, kTarget, kTarget + 9), column));
    EXPECT_EQ(column_dose(plain, levels).upper, column_dose(listed, levels).upper);
  }
}

TEST(MovedHeights, ExactLightPutsEachEdgeAtItsNode) {
  std::mt19937 random(11);
  int edges = 0;
  for (int round = 0; round < test::rounds(20); ++round) {
    const Moved u = random_moved(random, round % 2 == 1);
    const CureModel model = u.model();
    const std::vector<std::uint8_t> column = random_column(random, 6, 9);
    const int slices = slices_with_burst(model, kTarget, kTarget - 1);
    const CorrectionPlan plan(model, u.process, kTarget, slices);
    std::vector<double> light;
    const std::vector<double> phi = solve_column_exactly(plan, column);
    for (std::size_t n = 0; n < phi.size(); ++n) {
      light.push_back(model.intensity_mw_cm2(phi[n] / model.ratio(static_cast<int>(n))));
      EXPECT_GE(light.back(), 0.5 * (1 - 1e-12)) << n;
      EXPECT_LE(light.back(), 100 * (1 + 1e-12)) << n;
    }
    for (int n = 1; n < kTarget; ++n) {
      const auto i = static_cast<std::size_t>(n);
      const double middle = u.dose(0.5 * (u.node_um(n) + u.node_um(n + 1)), light);
      EXPECT_EQ(middle >= 1 - 1e-9, column[i] != 0) << n << " " << middle;
      if (column[i] == column[i - 1]) continue;
      ++edges;
      EXPECT_NEAR(u.dose(u.node_um(n), light), 1, 1e-8) << n;
    }
  }
  EXPECT_GT(edges, 30);
}

/// How far from each edge the dose is 1, um; `wrong` counts slices whose middle is not as designed.
std::vector<double> errors_um(const Moved& u, const std::vector<std::uint8_t>& column,
                              const std::vector<std::uint8_t>& levels, int& wrong) {
  std::vector<double> errors;
  const std::vector<double> light = u.light(levels);
  for (int n = 0; n < kTarget; ++n) {
    const auto i = static_cast<std::size_t>(n);
    wrong += (u.dose(0.5 * (u.node_um(n) + u.node_um(n + 1)), light) >= 1) != (column[i] != 0);
    if (n == 0 || column[i] == column[i - 1]) continue;
    const double at_um = u.node_um(n);
    const auto prints = [&](double z_um) { return u.dose(z_um, light) >= 1; };
    double nearest = 1e9;
    for (double off = -60; off < 60; off += 0.5) {
      if (prints(at_um + off) == prints(at_um + off + 0.5)) continue;
      double low = off, high = off + 0.5;
      for (int k = 0; k < 30; ++k) {
        const double middle = 0.5 * (low + high);
        (prints(at_um + middle) == prints(at_um + low) ? low : high) = middle;
      }
      if (std::abs(low) < nearest) nearest = std::abs(low);
    }
    errors.push_back(nearest);
  }
  return errors;
}

TEST(MovedHeights, LevelsPlaceEdgesAsNearAsTheyAreAimed) {
  std::mt19937 random(13);
  double sums[2] = {}, worst[2] = {}, aimed[2] = {};
  std::size_t edges[2] = {};
  int wrong[2] = {};
  for (int round = 0; round < test::rounds(12); ++round) {
    Moved u = random_moved(random, round % 2 == 1);
    const std::vector<std::uint8_t> column = random_column(random, 6, 9);
    for (const std::size_t even : {0, 1}) {
      if (even == 1) u.process.layer_heights_um = {kUsualUm};
      const CureModel model = u.model();
      const int slices = slices_with_burst(model, kTarget, kTarget - 1);
      const CorrectionPlan plan(model, u.process, kTarget, slices);
      const auto errors = errors_um(u, column, solve_column(plan, column), wrong[even]);
      for (const double um : errors) {
        sums[even] += um;
        worst[even] = std::max(worst[even], um);
        // What the plan aims at, the next tolerance that it tries, and the one after that.
        aimed[even] += std::max(0.05, model.level_step_um() / 25) * 1.2 * 1.2;
      }
      edges[even] += errors.size();
    }
  }
  ASSERT_EQ(edges[0], edges[1]);
  EXPECT_EQ(wrong[0], 0);
  EXPECT_EQ(wrong[1], 0);
  const auto count = static_cast<double>(edges[0]);
  RecordProperty("mean_um", std::to_string(sums[0] / count));
  RecordProperty("mean_even_um", std::to_string(sums[1] / count));
  RecordProperty("worst_um", std::to_string(worst[0]));
  RecordProperty("worst_even_um", std::to_string(worst[1]));
  for (const std::size_t even : {0, 1}) {
    RecordProperty(even ? "aimed_even_um" : "aimed_um", std::to_string(aimed[even] / count));
    EXPECT_LT(sums[even], aimed[even]) << even;
  }
}

}  // namespace
}  // namespace slicecorr
