// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Doses that are wanted layer by layer: sums of the test's own over what each slice adds.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "models.hpp"
#include "rounds.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/dose_target.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/predict.hpp"

namespace slicecorr {
namespace {

/// `strength` 0: without lifts.
CorrectionPlan plan_of(double ha_um, double full, double strength, int layers,
                       double exchange = kUnknownExchange) {
  CureModel m;
  m.mode = ExposureMode::layerwise;
  m.layer_um = 50;
  m.eta = m.layer_um / ha_um;
  m.a = std::pow(10.0, -m.eta);
  m.one_minus_a = 1 - m.a;
  m.root_a = std::sqrt(m.a);
  m.critical_intensity_mw_cm2 = 1;
  for (int v = 0; v < 256; ++v) m.level_phi.push_back(full * (0.002 + 0.998 * v / 255));
  Process p;
  p.mode = ExposureMode::layerwise;
  p.exposure_s = 1;
  p.lifts = strength > 0 ? Lifts::each : Lifts::none;
  if (strength > 0) {
    LiftModel& lifts = m.lifts.emplace();
    lifts.green_strength = strength;
    lifts.film = std::pow(m.a, -lifts.skin);
    if (exchange >= 0) lifts.exchange = exchange;
  }
  return {m, p, layers, layers};
}

/// Doses as all slices leave them.
struct Summed {
  std::vector<double> own, node,
      middle;  ///< of a layer: own exposure at its window; W; in its middle
  Summed(const CureModel& m, const std::vector<std::uint8_t>& levels)
      : own(levels.size()), node(levels.size(), 0), middle(levels.size(), 0) {
    for (std::size_t n = 0; n < levels.size(); ++n) {
      own[n] = m.level_phi[levels[n]];
      for (std::size_t k = n; k < levels.size(); ++k) {
        const double d = static_cast<double>(k - n) + 1;
        node[n] += m.level_phi[levels[k]] * std::pow(10.0, -m.eta * d);
        middle[n] += m.level_phi[levels[k]] * std::pow(10.0, -m.eta * (d - 0.5));
      }
    }
  }
};

DoseScale scale_to(double most, DoseSide side) {
  DoseScale scale = DoseScale::even(most);
  scale.side = side;
  return scale;
}

TEST(GradedLayers, AnEvenDoseIsHeldToHalfALevel) {
  for (const double strength : {0.0, 1.2}) {
    const CorrectionPlan plan = plan_of(300, 30, strength, 80);
    // Held layers add up to 1.2 / (sqrt(a) (1 - a)): a dose above that can be had.
    const double wanted = 12;
    const DoseScale scale = scale_to(wanted, DoseSide::nearest);
    const auto levels = solve_graded_column(plan, scale, test::column(80, {{0, 79}}),
                                            std::vector<std::uint8_t>(80, 255));
    const Summed print(plan.model, levels);
    const double half = 0.5 * 30 / 255 * plan.model.root_a;
    for (std::size_t n = 0; n < 80; ++n) {
      if (n >= 70) continue;
      EXPECT_NEAR(print.middle[n], wanted, half * 1.01) << strength << " " << n;
    }
    // A step down towards the platform: as dark as layers may be, until the dose has fallen.
    std::vector<std::uint8_t> bytes(80, 255);
    for (std::size_t n = 0; n < 40; ++n) bytes[n] = 90;
    const auto stepped = solve_graded_column(plan, scale_to(wanted, DoseSide::at_most),
                                             test::column(80, {{0, 79}}), bytes);
    const Summed at_most(plan.model, stepped);
    for (std::size_t n = 0; n < 80; ++n) {
      EXPECT_LE(at_most.middle[n], scale.dose[bytes[n]] * (1 + 1e-9)) << strength << " " << n;
    }
  }
}

TEST(GradedLayers, RandomColumns) {
  std::mt19937 random(23);
  int told = 0, edges = 0;
  for (int round = 0; round < test::rounds(120); ++round) {
    const double ha_um = 100.0 + random() % 250;
    const double strength = round % 3 == 0 ? 0 : 1.0 + 0.1 * (random() % 5);
    const double exchange = round % 3 == 1 ? 0 : kUnknownExchange;
    const double a = std::pow(10.0, -50 / ha_um);
    const double full = 1.2 / a * (2 + random() % 8);
    const int layers = 90;
    const CorrectionPlan plan = plan_of(ha_um, full, strength, layers, exchange);
    const auto runs = test::random_runs(random, 2, layers - 1, 2, 2);
    const auto design = test::column(layers, runs);
    const double most = 1 + full * std::sqrt(a) / (1 - a) * 0.1 * (1 + random() % 9);
    const auto side = static_cast<DoseSide>(random() % 3);
    const DoseScale scale = scale_to(most, side);
    std::vector<std::uint8_t> bytes;
    while (bytes.size() < design.size()) {
      bytes.insert(bytes.end(), 1 + random() % 20, static_cast<std::uint8_t>(random() % 256));
    }
    bytes.resize(design.size());
    const auto levels = solve_graded_column(plan, scale, design, bytes);
    const Summed print(plan.model, levels);
    // All that must hold does, and features gel.
    const PixelCurve curve = pixel_curve(plan.model);
    BandPredictor predictor(plan.model, curve, layers, 1);
    for (int n = layers; n-- > 0;) {
      const auto k = static_cast<std::size_t>(n);
      predictor.add_slice(n, &levels[k], &design[k]);
    }
    const Prediction p = predictor.finish(0, 0, 1);
    if (strength > 0) {
      ASSERT_TRUE(p.joints);
      EXPECT_EQ(p.joints->not_holding_voxels, 0U) << round;
    } else {
      for (const auto& [from, to] : runs) {
        for (int n = from; n <= to; ++n)
          EXPECT_GE(print.node[static_cast<std::size_t>(n)], 1) << round;
      }
    }
    const double step = full / 255;
    for (const auto& [from, to] : runs) {
      const auto u = static_cast<std::size_t>(from);
      // Edges above gaps are no further off than the correction without wanted doses has them.
      if (from > 0) {
        const Summed plain(plan.model, solve_column(plan, design));
        // By at most what light that rises to full may take.
        const double tolerance = strength > 0 && exchange != 0 ? std::pow(10.0, 2 / ha_um) : 1;
        EXPECT_LE(print.node[u], std::max(plain.node[u], 1 + step) * tolerance * (1 + 1e-9))
            << round;
        if (strength == 0 || exchange == 0) {
          EXPECT_GE(print.node[u], std::min(plain.node[u], 1.0) - step) << round;
        }
        ++edges;
        continue;
      }
      for (int n = from; n <= to; ++n) {
        const auto k = static_cast<std::size_t>(n);
        const double wanted = scale.dose[bytes[k]];
        const double least_own = strength > 0 ? strength / a : 0;
        if (side == DoseSide::at_least) {
          EXPECT_TRUE(print.middle[k] >= wanted * (1 - 1e-9) || levels[k] == 255)
              << round << " " << n;
        } else if (side == DoseSide::at_most) {
          const bool lowest = print.own[k] <= least_own + step || levels[k] == 0;
          const bool just_gels = print.node[k] < 1 + step;
          EXPECT_TRUE(print.middle[k] <= wanted * (1 + 1e-9) || lowest || just_gels)
              << round << " " << n << ": " << print.middle[k] << " of " << wanted;
        }
        ++told;
      }
    }
  }
  EXPECT_GT(told, 300);
  EXPECT_GT(edges, 60);
}

TEST(GradedLayers, NothingWantedIsWhatHolds) {
  const CorrectionPlan plan = plan_of(200, 20, 1.2, 60);
  const auto levels =
      solve_graded_column(plan, scale_to(1.5, DoseSide::at_most), test::column(60, {{0, 59}}),
                          std::vector<std::uint8_t>(60, 0));
  const Summed print(plan.model, levels);
  for (std::size_t n = 0; n < 60; ++n) {
    EXPECT_GE(print.own[n] * plan.model.a, 1.2) << n;
    EXPECT_LE(print.own[n] * plan.model.a, 1.2 + 20.0 / 255) << n;
  }
}

}  // namespace
}  // namespace slicecorr
