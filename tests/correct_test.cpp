// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The correction of columns: published values, and properties of random columns.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "models.hpp"
#include "rounds.hpp"

namespace slicecorr {
namespace {

using test::column;
using test::figure_2_2;
using test::plan_for;
using test::process;

#define EXPECT_PRINTED(value, printed) EXPECT_NEAR(value, printed, std::abs(printed) * 5e-5)

constexpr double kNoCap = 1e300;

TEST(CorrectExactly, Figure22WithCapOne) {
  const auto plan = plan_for(figure_2_2(), process(1000, 1.0), 50);
  EXPECT_EQ(plan.all_layers, 54);
  const auto phi = solve_column_exactly(plan, column(50, {{11, 20}, {31, 40}}));
  EXPECT_PRINTED(phi[21], 6.2500);
  EXPECT_PRINTED(phi[22], 1.2778);
  EXPECT_PRINTED(phi[41], 6.2500);
  EXPECT_PRINTED(phi[42], 6.2500);
  EXPECT_PRINTED(phi[43], 5.9633);
  for (const std::size_t n : {11, 15, 20, 31, 35, 40}) EXPECT_NEAR(phi[n], 1.0, 1e-12);
}

TEST(CorrectExactly, Figure22WithoutCap) {
  const auto plan = plan_for(figure_2_2(), process(1000), 50);
  const auto phi = solve_column_exactly(plan, column(50, {{11, 20}, {31, 40}}));
  EXPECT_PRINTED(phi[19], 5.8461);
  EXPECT_PRINTED(phi[20], 6.2500);
  EXPECT_PRINTED(phi[39], 5.8461);
  EXPECT_PRINTED(phi[40], 6.2500);
  for (const std::size_t n : {11, 18, 31, 38}) EXPECT_NEAR(phi[n], plan.model.phi_min(), 1e-12);
  const auto dose = node_doses(plan.model, phi);
  EXPECT_PRINTED(1 - dose[23], 0.34598);
  EXPECT_EQ(std::min_element(dose.begin() + 21, dose.begin() + 32) - dose.begin(), 23);
  // Greatest dose in a feature of ten slices, at a node.
  EXPECT_PRINTED(*std::max_element(dose.begin() + 31, dose.begin() + 42), 1.5483);
}

TEST(CorrectExactly, PeakOfTwentySlices) {
  const auto plan = plan_for(figure_2_2(), process(1000), 60);
  const auto dose = node_doses(plan.model, solve_column_exactly(plan, column(60, {{11, 30}})));
  EXPECT_PRINTED(*std::max_element(dose.begin(), dose.end()), 2.2857);
}

TEST(CorrectExactly, PlatformFeatureOfTen) {
  const auto plan = plan_for(figure_2_2(), process(1000), 40);
  const auto dose = node_doses(plan.model, solve_column_exactly(plan, column(40, {{0, 9}})));
  EXPECT_PRINTED(dose[0], 3.2977);
  EXPECT_NEAR(dose[10], 1.0, 1e-12);
}

TEST(CorrectExactly, RailToTheEnd) {
  const auto plan = plan_for(figure_2_2(), process(1000), 50);
  const auto phi = solve_column_exactly(plan, column(50, {{0, 49}}));
  ASSERT_EQ(phi.size(), 54U);
  for (const std::size_t n : {0, 25, 49, 50, 51, 52}) EXPECT_PRINTED(phi[n], 6.25);
  EXPECT_PRINTED(phi[53], 0.18526);
  // With a cap of 1 platform-borne features are capped as well.
  const auto capped = plan_for(figure_2_2(), process(1000, 1.0), 50);
  EXPECT_NEAR(solve_column_exactly(capped, column(50, {{0, 49}}))[25], 1.0, 1e-12);
}

TEST(CorrectExactly, TwoSliceGap) {
  const auto plan = plan_for(figure_2_2(), process(1000), 60);
  const auto phi = solve_column_exactly(plan, column(60, {{10, 19}, {22, 31}}));
  const auto dose = node_doses(plan.model, phi);
  EXPECT_PRINTED(dose[21], 0.94756);
  EXPECT_PRINTED(phi[20], 1.8851);
  EXPECT_PRINTED(phi[21], 0.062500);
}

TEST(CorrectExactly, OneSliceGapStaysOpenUnlessMerged) {
  const auto design = column(60, {{10, 19}, {21, 31}});
  const auto plan = plan_for(figure_2_2(), process(1000), 60);
  const auto phi = solve_column_exactly(plan, design);
  const auto dose = node_doses(plan.model, phi);
  EXPECT_EQ(phi[20], plan.model.phi_min());
  EXPECT_NEAR(dose[21], 1.0, 1e-12);
  EXPECT_LT(dose[20], 1.0);
  EXPECT_GE(dose[19], 1.0);
  // The upper feature's lower edge moves by 8.63 um.
  EXPECT_NEAR(plan.model.crossing(phi[19], dose[20]) * 50, 8.63, 0.005);

  Process merging = process(1000);
  merging.one_slice_gaps = OneSliceGaps::merge;
  const auto merged = plan_for(figure_2_2(), merging, 60);
  const auto both = node_doses(merged.model, solve_column_exactly(merged, design));
  // One feature.
  EXPECT_GT(both[20], 1.0);
  EXPECT_GT(both[21], 1.0);
}

/// A random column: runs of one slice or more, gaps of two or more; maybe on the platform, maybe to
/// the end.
std::vector<std::uint8_t> random_column(std::mt19937& random) {
  std::uniform_int_distribution<int> length(1, 14), gap(2, 14);
  std::vector<std::uint8_t> c;
  if (random() % 2) c.insert(c.end(), static_cast<std::size_t>(gap(random)), 0);
  for (int runs = 1 + static_cast<int>(random() % 6); runs-- > 0;) {
    c.insert(c.end(), static_cast<std::size_t>(length(random)), 255);
    if (runs || random() % 2) c.insert(c.end(), static_cast<std::size_t>(gap(random)), 0);
  }
  return c;
}

struct RandomProcess {
  CureModel model;
  double cap;
};

RandomProcess random_process(std::mt19937& random, double gamma = 1, int bits = 8) {
  std::uniform_real_distribution<double> unit(0, 1);
  // phi_max 1.05 to 40, phi_min 0 to 0.9, eta 0.0005 to 0.5.
  const double high = 1.05 * std::pow(40 / 1.05, unit(random));
  const double low = random() % 4 ? 0.9 * unit(random) : 0.0;
  const double eta = 0.0005 * std::pow(1000, unit(random));
  const double caps[] = {1.0, 1.0 + 3 * unit(random), kNoCap};
  // At Dc 36000 / 1000 the critical intensity is 1 at 1000 mm/h.
  return {make_cure_model(test::gamma_printer(low, high, gamma, bits), test::resin(36, 50 / eta),
                          process(1000), 50),
          caps[random() % 3]};
}

TEST(CorrectExactly, RandomColumnsMeetAllConstraints) {
  std::mt19937 random(11);
  for (int round = 0; round < test::rounds(4000); ++round) {
    const auto [model, cap] = random_process(random);
    const auto design = random_column(random);
    const int layers = static_cast<int>(design.size());
    const auto plan = plan_for(model, process(1000, cap), layers);
    const auto phi = solve_column_exactly(plan, design);
    const auto dose = node_doses(model, phi);
    for (const double p : phi) {
      ASSERT_GE(p, model.phi_min());
      ASSERT_LE(p, model.phi_max());
    }
    const auto full = [&](int n) {
      return n >= 0 && n < layers && design[static_cast<std::size_t>(n)];
    };
    // Errors of a dose of the greatest size in the column, as the recursion rounds.
    const double tolerance = 1e-12 * std::max(1.0, *std::max_element(dose.begin(), dose.end()));
    for (int k = 0; k <= plan.all_layers; ++k) {
      const double d = dose[static_cast<std::size_t>(k)];
      const std::string where = "round " + std::to_string(round) + " node " + std::to_string(k);
      if (full(k) && full(k - 1)) {
        ASSERT_GE(d, 1 - tolerance) << where;
        ASSERT_LE(d, std::max(1.0, cap) + tolerance) << where;
      } else if (full(k) || full(k - 1)) {
        if (k == 0) {
          ASSERT_GE(d, 1 - tolerance) << where;
        } else {
          ASSERT_NEAR(d, 1.0, tolerance) << where;
        }
      } else {
        ASSERT_LT(d, 1.0) << where;
      }
    }
  }
}

TEST(CorrectToLevels, RandomColumnsHaveNoWrongVoxel) {
  std::mt19937 random(12);
  int solvable = 0;
  for (int round = 0; round < test::rounds(6000); ++round) {
    const double gamma = round % 2 ? 1.0 : 3.0;
    const auto [model, cap] = random_process(random, gamma, round % 3 ? 8 : 6);
    const auto design = random_column(random);
    const int layers = static_cast<int>(design.size());
    // What one level can move a node by, against how far the dose falls off in the first layer of a
    // gap: twice the step must fit, or no choice of levels is right by construction.
    double step = 0;
    for (std::size_t i = 1; i < model.level_phi.size(); ++i) {
      step = std::max(step, model.level_phi[i] - model.level_phi[i - 1]);
    }
    const double fall = std::min(1 - model.phi_min(), (model.phi_max() - 1) / model.a);
    if (2 * step >= fall) continue;
    ++solvable;
    const auto plan = plan_for(model, process(1000, cap), layers);
    const auto levels = solve_column(plan, design);
    std::vector<double> phi;
    for (const std::uint8_t l : levels) phi.push_back(model.level_phi[l]);
    const auto dose = node_doses(model, phi);
    for (int n = 0; n < plan.all_layers; ++n) {
      const auto k = static_cast<std::size_t>(n);
      const std::string where = "round " + std::to_string(round) + " layer " + std::to_string(n);
      if (n < layers && design[k]) {
        ASSERT_GE(model.middle(phi[k], dose[k + 1]), 1.0) << where;
      } else {
        ASSERT_LT(model.middle(phi[k], dose[k + 1]), 1.0) << where;
      }
    }
  }
  EXPECT_GT(solvable, test::rounds(2000));
}

TEST(CorrectToLevels, EveryLevelIsUsedSomewhere) {
  // A wall of each grey level asks for each dose; with cap 1 each level of a linear projector up to
  // phi = 1 must come out.
  const CureModel m = figure_2_2();
  std::vector<bool> used(256);
  for (int c = 0; c < 256; ++c) {
    const auto plan = plan_for(m, process(1000, 1.0), 60);
    for (const std::uint8_t l :
         solve_column(plan, std::vector<std::uint8_t>(60, static_cast<std::uint8_t>(c)))) {
      used[l] = true;
    }
  }
  for (int l = 0; l < 256 && m.level_phi[static_cast<std::size_t>(l)] < 1; ++l) {
    EXPECT_TRUE(used[static_cast<std::size_t>(l)]) << l;
  }
}

/// Doses of the levels chosen for a column.
struct Solved {
  std::vector<double> phi, dose;
};
Solved solved(const CorrectionPlan& plan, const std::vector<std::uint8_t>& design) {
  Solved s;
  for (const std::uint8_t l : solve_column(plan, design)) s.phi.push_back(plan.levels.phi(l));
  s.dose = node_doses(plan.model, s.phi);
  return s;
}

int wrong_voxels(const CorrectionPlan& plan, const std::vector<std::uint8_t>& design) {
  const Solved s = solved(plan, design);
  int wrong = 0;
  for (std::size_t n = 0; n < s.phi.size(); ++n) {
    const bool printed = plan.model.middle(s.phi[n], s.dose[n + 1]) >= 1.0;
    wrong += printed != (n < design.size() && design[n] == 255);
  }
  return wrong;
}

/// Runs and gaps of 1 to `longest` slices, in any order.
std::vector<std::uint8_t> random_pattern(std::mt19937& random, unsigned longest) {
  std::vector<std::uint8_t> design;
  for (std::uint8_t c = random() % 2 ? 255 : 0; design.size() < 60;
       c = static_cast<std::uint8_t>(255 - c)) {
    design.insert(design.end(), 1 + random() % longest, c);
  }
  return design;
}

TEST(CorrectToLevels, AnyPatternOfSlicesPrintsVoxelForVoxel) {
  // With the process of figure 2.2 every voxel is right at mid-layer, also where one-slice features
  // stand on one-slice gaps.
  std::mt19937 random(13);
  int wrong = 0, voxels = 0;
  const CureModel linear = figure_2_2();
  const CureModel gamma =
      make_cure_model(test::gamma_printer(1, 100, 3), test::resin(576, 2000), process(1000), 50);
  for (int round = 0; round < test::rounds(400); ++round) {
    const auto longest = 1 + static_cast<unsigned>(random() % 6);
    const auto design = random_pattern(random, longest);
    const Process p = process(1000, round % 3 ? kNoCap : 1.0);
    const int layers = static_cast<int>(design.size());
    ASSERT_EQ(wrong_voxels(plan_for(gamma, p, layers), design), 0) << round;
    if (longest > 1) {
      wrong += wrong_voxels(plan_for(linear, p, layers), design);
      voxels += layers;
    }
  }
  // See below: where single slices alternate by chance, a linear curve can lack the level.
  EXPECT_LE(wrong, voxels / 20000);
}

TEST(CorrectToLevels, AlternatingSlicesKeepAllFeaturesAndMostGaps) {
  // Single slices of feature and gap in turn leave a window for each dose that is narrower (0.0012)
  // than a step of 256 linear levels (0.0014): now and then no level fits, and a gap gives way.
  // Shown as they are, all gaps merge.
  const CureModel m = figure_2_2();
  const auto design = [] {
    std::vector<std::uint8_t> d;
    for (int n = 0; n < 400; ++n) d.push_back(n % 2 ? 255 : 0);
    return d;
  }();
  const auto plan = plan_for(m, process(1000), 400);
  const Solved s = solved(plan, design);
  for (std::size_t n = 1; n < design.size(); n += 2) {
    ASSERT_GE(m.middle(s.phi[n], s.dose[n + 1]), 1.0) << n;
  }
  EXPECT_LE(wrong_voxels(plan, design), 200 / 3);
}

TEST(CorrectToLevels, GapsStayOpenWhereOneLevelCuresALayer) {
  // Slices of 50 um in a resin that takes all light within 10 um: a slice's own light decides, and
  // no level lies between 1 / (1 - a) and 1 / (1 - sqrt(a)).
  const auto design = column(50, {{11, 20}, {31, 40}});
  for (const double ha : {1.0, 5.0, 10.0, 20.0, 50.0}) {
    const CureModel m =
        make_cure_model(test::linear_printer(1, 100), test::resin(576, ha), process(1000), 50);
    EXPECT_EQ(wrong_voxels(plan_for(m, process(1000), 50), design), 0) << ha;
  }
}

TEST(CorrectToLevels, PlatformFeaturesMayBeUncapped) {
  Process p = process(1000, 1.0);
  const auto design = column(50, {{0, 49}});
  const auto top_dose = [&] { return solved(plan_for(figure_2_2(), p, 50), design).dose[0]; };
  EXPECT_LT(top_dose(), 1.01);
  p.cap_platform_features = false;
  EXPECT_GT(top_dose(), 5.9);
}

TEST(CorrectToLevels, GreyWallsGetTheirCoverage) {
  const CureModel m = figure_2_2();
  const auto plan = plan_for(m, process(1000), 80);
  for (int c = 20; c < 255; c += 5) {
    std::vector<std::uint8_t> design(80, 0);
    for (std::size_t n = 20; n < 60; ++n) design[n] = static_cast<std::uint8_t>(c);
    const auto phi = solve_column_exactly(plan, design);
    const auto dose = node_doses(m, phi);
    for (std::size_t n = 20; n < 60; ++n) {
      ASSERT_NEAR(m.middle(phi[n], dose[n + 1]), c / 255.0, 1e-6) << c << " at " << n;
    }
  }
}

TEST(CorrectToLevels, BandsOfAnyWidthAgreeWithColumns) {
  std::mt19937 random(14);
  const CureModel m = figure_2_2();
  for (const std::size_t columns : {1, 7, 31, 32, 33, 64, 100}) {
    const int layers = 70;
    std::vector<std::vector<std::uint8_t>> designs;
    for (std::size_t i = 0; i < columns; ++i) {
      auto d = random_column(random);
      d.resize(static_cast<std::size_t>(layers));
      if (i % 3 == 0) d.assign(static_cast<std::size_t>(layers), 0);
      if (i % 5 == 0) {  // any coverage
        for (auto& c : d)
          c = static_cast<std::uint8_t>(random() % 4 ? (random() % 2) * 255 : random());
      }
      designs.push_back(std::move(d));
    }
    const auto plan = plan_for(m, process(1000), layers);
    BandCorrector band(plan, columns);
    std::vector<std::uint8_t> row(columns);
    for (int n = 0; n < layers; ++n) {
      for (std::size_t i = 0; i < columns; ++i) row[i] = designs[i][static_cast<std::size_t>(n)];
      band.add_layer(row.data());
    }
    std::vector<std::vector<std::uint8_t>> got(
        columns, std::vector<std::uint8_t>(static_cast<std::size_t>(plan.all_layers)));
    int expected_slice = plan.all_layers;
    band.solve([&](int slice, const std::uint8_t* levels, const std::uint8_t* coverage, bool dark) {
      ASSERT_EQ(slice, --expected_slice);
      for (std::size_t i = 0; i < columns; ++i) {
        got[i][static_cast<std::size_t>(slice)] = levels[i];
        const std::uint8_t design =
            slice < layers ? designs[i][static_cast<std::size_t>(slice)] : 0;
        ASSERT_EQ(coverage[i], design);
        if (dark) {
          ASSERT_EQ(levels[i] | coverage[i], 0);
        }
      }
    });
    for (std::size_t i = 0; i < columns; ++i)
      ASSERT_EQ(got[i], solve_column(plan, designs[i])) << i;
  }
}

}  // namespace
}  // namespace slicecorr
