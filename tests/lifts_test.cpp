// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Layer by layer with lifts: what each exposure leaves, tables of docs/lifts.md, columns against a print that
// is followed lift by lift.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "models.hpp"
#include "rounds.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/predict.hpp"
#include "slicecorr/simulate.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr {
namespace {

struct Lift {
  double layer_um, ha_um, full, strength = 1.2;
  double exchange = kUnknownExchange, skin = 0.5;
  int levels = 256;
  double black = 0;
  std::vector<double> exposures = {};  ///< `CureModel::exposure_ratio`
};

CureModel model_of(const Lift& l) {
  CureModel m;
  m.mode = ExposureMode::layerwise;
  m.layer_um = l.layer_um;
  m.eta = l.layer_um / l.ha_um;
  m.a = std::pow(10.0, -m.eta);
  m.one_minus_a = 1 - m.a;
  m.root_a = std::sqrt(m.a);
  m.critical_intensity_mw_cm2 = 1;
  for (int v = 0; v < l.levels; ++v) {
    m.level_phi.push_back(l.black + (l.full - l.black) * v / (l.levels - 1));
  }
  m.exposure_ratio = l.exposures;
  LiftModel& lifts = m.lifts.emplace();
  lifts.green_strength = l.strength;
  lifts.skin = l.skin;
  lifts.film = std::pow(m.a, -l.skin);
  if (l.exchange >= 0) lifts.exchange = l.exchange;
  return m;
}

CorrectionPlan plan_of(const Lift& l, int layers) {
  Process p;
  p.mode = ExposureMode::layerwise;
  p.exposure_s = 1;
  p.lifts = Lifts::each;
  return {model_of(l), p, layers, layers};
}

/// How far above node u a print goes, um, below as negative, when each lift exchanges `x` of the liquid:
/// points 1/200 of a layer apart, each followed through all exposures. `phi`: of all layers. From at most
/// `layers` below the node on.
double edge_um(const Lift& l, const std::vector<double>& phi, int u, double x, int layers = 10) {
  const double a = std::pow(10.0, -l.layer_um / l.ha_um);
  constexpr int parts = 200;
  const auto gels = [&](double z) {
    // z in layers from the platform; exposures of layers below it count.
    double dose = 0;
    for (int n = static_cast<int>(std::floor(z + 1e-9)); n < static_cast<int>(phi.size()); ++n) {
      dose = (1 - x) * dose + phi[static_cast<std::size_t>(n)] * std::pow(a, n + 1 - z);
      if (dose >= 1 - 1e-12) return true;
    }
    return false;
  };
  // From within the feature's first layers towards the platform.
  double z = u + layers;
  while (z > 0 && gels(z - 1.0 / parts)) z -= 1.0 / parts;
  return (u - z) * l.layer_um;
}

std::vector<double> first(const std::vector<double>& phi, int u, std::size_t count) {
  return {phi.begin() + u, phi.begin() + u + static_cast<std::ptrdiff_t>(count)};
}

constexpr int kAbove = 60, kLayers = 60;

std::vector<double> exact(const Lift& l) {
  const auto plan = plan_of(l, kAbove + kLayers);
  return solve_column_exactly(plan,
                              test::column(kAbove + kLayers, {{kAbove, kAbove + kLayers - 1}}));
}

TEST(Lifts, HoldingLightWhereTheExchangeIsNotKnown) {
  struct Row {
    Lift lift;
    int below;
    double edges[3], as_sliced[3], at_node;
  };
  const Row rows[] = {
      {{50, 150, 10, 1.0}, 7, {42.7, 0.0, 0.0}, {140.7, 100, 100}, 1.9244},
      {{50, 150, 10, 1.2}, 6, {54.5, 12.0, 12.0}, {140.7, 100, 100}, 2.3093},
      {{50, 400, 10, 1.0}, 22, {242.7, 38.8, 0.0}, {590.8, 388.8, 350}, 4.0446},
      {{25, 200, 6, 1.2}, 17, {138.2, 35.2, 15.9}, {251.0, 150.0, 130.6}, 4.9097},
      {{100, 110, 20, 1.0}, 2, {8.5, 0.0, 0.0}, {49.5, 43, 43}, 1.1894},
  };
  for (const Row& r : rows) {
    const std::vector<double> phi = exact(r.lift);
    const double a = std::pow(10.0, -r.lift.layer_um / r.lift.ha_um);
    int below = 0;
    double node = 0;
    for (int j = 0; j < kLayers; ++j) {
      const double light = phi[static_cast<std::size_t>(kAbove + j)];
      EXPECT_GE(light * a, r.lift.strength) << j;
      below += light < r.lift.full * (1 - 1e-9);
      node += light * std::pow(a, j + 1);
    }
    EXPECT_EQ(below, r.below);
    EXPECT_NEAR(node, r.at_node, 5.1e-5 * r.at_node);
    std::vector<double> sliced(kAbove, 0.0);
    sliced.resize(kAbove + kLayers, r.lift.full);
    const double shares[] = {0, 0.5, 1};
    for (int k = 0; k < 3; ++k) {
      // To a part of 1/200 of a layer, and the digit of the table.
      const double to = r.lift.layer_um / 200 + 0.051;
      EXPECT_NEAR(edge_um(r.lift, phi, kAbove, shares[k]), r.edges[k], to);
      EXPECT_NEAR(edge_um(r.lift, sliced, kAbove, shares[k]), r.as_sliced[k], to + 0.5);
    }
  }
}

TEST(Lifts, LightWhereAllResinStays) {
  struct Row {
    Lift lift;
    int liquid;
    std::vector<double> phi;
  };
  const Row rows[] = {
      {{50, 150, 10, 1.0, 0}, 1, {0, 1.4678, 2.1544, 2.1544, 8.4341, 10, 10}},
      {{50, 150, 10, 1.5, 0}, 1, {0, 1.4678, 3.2317, 3.2317, 3.2317}},
      {{50, 400, 10, 1.0, 0}, 5, {0, 0, 0, 0, 0, 1.1548, 1.3335}},
      {{25, 200, 6, 1.2, 0}, 6, {0, 0, 0, 0, 0, 0, 1.1548, 1.6002}},
      {{100, 110, 20, 1.0, 0}, 0, {5.2989, 20, 20, 20}},
  };
  for (const Row& r : rows) {
    const std::vector<double> phi = exact(r.lift);
    const double a = std::pow(10.0, -r.lift.layer_um / r.lift.ha_um);
    const auto got = first(phi, kAbove, r.phi.size());
    for (std::size_t j = 0; j < got.size(); ++j) EXPECT_NEAR(got[j], r.phi[j], 5.1e-5) << j;
    double node = 0;
    for (int j = 0; j < kLayers; ++j) {
      node += phi[static_cast<std::size_t>(kAbove + j)] * std::pow(a, j + 1);
    }
    EXPECT_NEAR(node, 1, 1e-6);
    EXPECT_NEAR(edge_um(r.lift, phi, kAbove, 0), 0, r.lift.layer_um / 200 + 1e-9);
  }
}

TEST(Lifts, LightWhereAllResinIsExchanged) {
  const Lift l{50, 150, 10, 1.0, 1};
  const std::vector<double> phi = exact(l);
  const double a = std::pow(10.0, -1.0 / 3);
  for (int j = 0; j < 10; ++j) {
    EXPECT_NEAR(phi[static_cast<std::size_t>(kAbove + j)], std::min(10.0, std::pow(a, -(j + 1))),
                1e-6);
  }
  EXPECT_NEAR(edge_um(l, phi, kAbove, 1), 0, 0.26);
}

TEST(Lifts, WhatStandsOnThePlatformKeepsItsLight) {
  const Lift l{25, 157, 40, 1.2};
  const auto plan = plan_of(l, 120);
  const auto levels = solve_column(plan, test::column(120, {{0, 119}}));
  for (const auto level : levels) EXPECT_EQ(level, 255);
}

/// What holds in a column, layer by layer, by a rule of its own: own exposures alone.
struct Held {
  std::uint64_t not_holding = 0, films = 0;
  int liquid = 0;
};
Held held(const Lift& l, const std::vector<double>& phi, const std::vector<std::uint8_t>& design) {
  const double a = std::pow(10.0, -l.layer_um / l.ha_um);
  Held h;
  for (std::size_t n = 0; n < design.size();) {
    if (design[n] != 255) {
      ++n;
      continue;
    }
    std::size_t end = n;
    while (end < design.size() && design[end] == 255) ++end;
    std::size_t solid = n;
    if (n > 0) {
      while (solid < end && phi[solid] < 1) ++solid;
      h.liquid = std::max(h.liquid, static_cast<int>(solid - n));
      if (solid < end) {
        if (phi[solid] >= std::pow(a, -l.skin) - 1e-9) {
          ++h.films;
        } else {
          ++h.not_holding;
        }
        ++solid;
      }
    }
    for (; solid < end; ++solid) h.not_holding += phi[solid] * a < l.strength - 1e-9;
    n = end;
  }
  return h;
}

TEST(Lifts, RandomColumnsHoldAndNoFeatureIsThinner) {
  std::mt19937 random(11);
  int placed = 0;
  for (int round = 0; round < test::rounds(80); ++round) {
    Lift l{25.0 + 25 * (random() % 3), 60.0 + random() % 200, 0, 1.0 + 0.1 * (random() % 6)};
    const double a = std::pow(10.0, -l.layer_um / l.ha_um);
    // Full light holds, by up to ten times.
    l.full = l.strength / a * (1.02 + random() % 9);
    l.levels = round / 4 % 3 == 2 ? 16 : 256;
    l.black = round % 3 == 0 ? l.full / 800 : 0;
    if (round % 5 == 0) l.exposures = {4, 4, 2.5, 1};
    const double shares[] = {kUnknownExchange, 0, 0.4, 1};
    l.exchange = shares[round % 4];
    const auto runs = test::random_runs(random, 4, 109, 2, 8);
    const auto design = test::column(110, runs);
    // Half of the rounds have the edges of a mesh, up to half a layer to either side of their nodes.
    std::vector<std::uint8_t> heights(111, 0);
    for (const auto& [from, to] : runs) {
      if (round % 2)
        heights[static_cast<std::size_t>(from)] = edge_height_byte(0.01 * (random() % 81) - 0.4);
    }
    const auto plan = plan_of(l, 110);
    const auto levels = solve_column(plan, design, heights);
    std::vector<double> phi;
    for (std::size_t n = 0; n < levels.size(); ++n) {
      phi.push_back(plan.model.level_phi[levels[n]] * plan.model.ratio(static_cast<int>(n)));
    }
    const Held by_hand = held(l, phi, design);
    EXPECT_EQ(by_hand.not_holding, 0U) << round;
    // What the prediction says is the same.
    const PixelCurve curve = pixel_curve(plan.model);
    BandPredictor predictor(plan.model, curve, 110, 1);
    for (int n = 110; n-- > 0;) {
      const auto k = static_cast<std::size_t>(n);
      const auto pixel = static_cast<std::uint8_t>(pixel_of_level(levels[k], l.levels));
      predictor.add_slice(n, &pixel, &design[k]);
    }
    const Prediction p = predictor.finish(0, 0, 1);
    ASSERT_TRUE(p.joints);
    EXPECT_EQ(p.joints->not_holding_voxels, by_hand.not_holding);
    EXPECT_EQ(p.joints->films, by_hand.films);
    EXPECT_EQ(p.joints->liquid_layers_max, by_hand.liquid);
    if (l.exchange < 0) {
      EXPECT_EQ(by_hand.liquid, 0);
      EXPECT_EQ(p.undercure_voxels, 0U) << round;
    }
    // No upper edge lies inside its feature, whatever is exchanged: to a part of 1/200 of a layer.
    for (const auto& [from, to] : runs) {
      if (from == 0) continue;
      const auto height = heights[static_cast<std::size_t>(from)];
      const double place_um = height == 0 ? 0.0 : -edge_height_slices(height) * l.layer_um;
      const double part_um = l.layer_um / 200 + 1e-9;
      const int layers = std::min(10, to - from + 1);
      if (l.exchange < 0) {
        for (const double x : {0.0, 0.5, 1.0}) {
          EXPECT_GE(edge_um(l, phi, from, x, layers), place_um - part_um) << round;
        }
        continue;
      }
      // Where the exchange is known edges are where they belong, but where a feature is too thin for
      // that (its last layer alone is solid), or a later one lights it through.
      int liquid = 0;
      while (liquid <= to - from && phi[static_cast<std::size_t>(from + liquid)] < 1) ++liquid;
      if (liquid == to - from || l.black > 0 || l.exchange > 0 || to - from < 9) continue;
      // Nor does more light than all bring them there.
      if (std::all_of(levels.begin() + from + liquid, levels.begin() + to + 1,
                      [&](int level) { return level == l.levels - 1; })) {
        continue;
      }
      // Levels leave less than one step of the layer at the node, and never too much.
      const double step = l.full / (l.levels - 1) * a * plan.model.ratio(from);
      const double edge = edge_um(l, phi, from, l.exchange, 10);
      EXPECT_LE(edge, place_um + part_um) << round;
      const double least = std::pow(a, -place_um / l.layer_um) - step;
      EXPECT_GE(edge, l.ha_um * std::log10(std::max(least, 1e-3)) - part_um) << round;
      ++placed;
    }
    // The band does what the definition does.
    BandCorrector band(plan, 3);
    std::vector<std::uint8_t> row(3);
    std::size_t layer = 0;
    for (const auto c : design) {
      row.assign(3, c);
      row[1] = 0;
      const std::vector<std::uint8_t> nodes(3, heights[layer++]);
      band.add_layer(row.data(), nodes.data());
    }
    band.solve([&](int n, const std::uint8_t* level, const std::uint8_t*, bool) {
      EXPECT_EQ(level[0], levels[static_cast<std::size_t>(n)]) << round << " " << n;
      EXPECT_EQ(level[1], 0);
      EXPECT_EQ(level[2], levels[static_cast<std::size_t>(n)]);
    });
  }
  EXPECT_GT(placed, 10);
}

TEST(Lifts, AColumnLiftByLiftIsCountedAsItsJoints) {
  std::mt19937 random(17);
  int not_holding = 0, films = 0, liquid = 0;
  for (int round = 0; round < test::rounds(200); ++round) {
    Lift l{50, 100.0 + random() % 200, 8, 1.0 + 0.1 * (random() % 6)};
    const CureModel model = model_of(l);
    std::vector<std::uint8_t> design, pixels;
    while (design.size() < 60) {
      const bool solid = random() % 2;
      for (auto run = 1 + random() % 9; run-- > 0;) {
        design.push_back(solid ? 255 : random() % 9 ? 0 : 100);
        // Some layers of a feature get too little, now and then several in turn.
        const bool weak = random() % (pixels.empty() || pixels.back() > 60 ? 8 : 2) == 0;
        pixels.push_back(
            solid ? static_cast<std::uint8_t>(weak ? random() % 60 : 60 + random() % 196) : 0);
      }
    }
    const PixelCurve curve = pixel_curve(model);
    BandPredictor predictor(model, curve, static_cast<int>(design.size()), 1);
    std::vector<double> phi, covered;
    for (std::size_t n = 0; n < design.size(); ++n) {
      phi.push_back(curve[pixels[n]]);
      covered.push_back(design[n] / 255.0);
    }
    for (std::size_t n = design.size(); n-- > 0;) {
      predictor.add_slice(static_cast<int>(n), &pixels[n], &design[n]);
    }
    const Prediction p = predictor.finish(0, 0, 1);
    int count[5] = {}, run = 0, longest = 0;
    double least = std::numeric_limits<double>::infinity();
    for (const LayerAtLift& layer : lifts_of(model, phi, covered)) {
      ++count[static_cast<int>(layer.state)];
      run = layer.state == AtLift::liquid ? run + 1 : 0;
      longest = std::max(longest, run);
      if (layer.state == AtLift::holds) least = std::min(least, layer.joint_dose);
    }
    EXPECT_EQ(p.joints->not_holding_voxels, static_cast<std::uint64_t>(count[4])) << round;
    EXPECT_EQ(p.joints->films, static_cast<std::uint64_t>(count[2])) << round;
    EXPECT_EQ(p.joints->liquid_layers_max, longest) << round;
    // Joints between what does not hold may be weaker still.
    EXPECT_LE(p.joints->least, least);
    if (count[4] == 0 && std::isfinite(least)) {
      EXPECT_NEAR(p.joints->least, least, 1e-12);
    }
    not_holding += count[4];
    films += count[2];
    liquid += count[3];
  }
  EXPECT_GT(not_holding, 100);
  EXPECT_GT(films, 100);
  EXPECT_GT(liquid, 50);
  EXPECT_THROW(lifts_of(CureModel{}, {1.0}, {}), InputError);
}

TEST(Lifts, NothingIsLiquidOnPurposeWhereLightSpreads) {
  Printer printer = test::linear_printer(0, 40);
  printer.pixel_x_um = printer.pixel_y_um = 50;
  Process p;
  p.mode = ExposureMode::layerwise;
  p.exposure_s = 1;
  p.lifts = Lifts::each;
  p.lift_exchange = 0.3;
  const Resin resin = test::resin(100, 300);
  const auto design = test::column(40, {{10, 39}});
  const auto light_of_first = [&] {
    const CureModel model = make_cure_model(printer, resin, p, 50);
    return model.level_phi[solve_column({model, p, 40, 40}, design)[10]] * model.a;
  };
  EXPECT_LT(light_of_first(), 1);
  printer.spread.gaussians = {{25.0, 1.0}};
  EXPECT_GE(light_of_first(), 1.2);
  // Where all resin stays doses add up, and edges come to where they belong.
  p.lift_exchange = 0;
  EXPECT_LT(light_of_first(), 1);
  p.lift_exchange = kUnknownExchange;
  EXPECT_GE(light_of_first(), 1.2);
}

TEST(Lifts, DosesOfExchangedResinAreThoseOfAPrintLiftByLift) {
  std::mt19937 random(3);
  for (int round = 0; round < test::rounds(20); ++round) {
    Lift l{25.0 + 25 * (random() % 3), 60.0 + random() % 300, 8, 1.2};
    const double shares[] = {0.05, 0.3, 0.8, 1};
    l.exchange = shares[round % 4];
    const CureModel model = model_of(l);
    std::vector<std::uint8_t> pixels(60);
    std::vector<double> phi;
    for (auto& p : pixels) {
      p = random() % 3 ? static_cast<std::uint8_t>(random() % 256) : 0;
      phi.push_back(model.level_phi[p]);
    }
    const ColumnDose dose = column_dose(model, pixels);
    for (std::size_t n = 0; n < pixels.size(); ++n) {
      // In the middle of layer n, exposure by exposure.
      double now = 0, most = 0;
      for (std::size_t k = n; k < pixels.size(); ++k) {
        now = (1 - l.exchange) * now + phi[k] * std::pow(model.a, static_cast<double>(k - n) + 0.5);
        most = std::max(most, now);
      }
      EXPECT_NEAR(dose.middle[n], most, 1e-9 * (1 + most)) << round << " " << n;
    }
  }
}

TEST(Lifts, NoFewerLiquidLayersHoldOnShortColumns) {
  // All sequences of five levels of the first five layers, the rest as they are: none with fewer
  // liquid layers holds and ends at the node.
  std::mt19937 random(5);
  for (int round = 0; round < 12; ++round) {
    Lift l{50, 120.0 + random() % 120, 0, 1.0 + 0.2 * (random() % 2), 0};
    l.levels = 5;
    const double a = std::pow(10.0, -l.layer_um / l.ha_um);
    l.full = l.strength / a * 2.1;
    const auto design = test::column(12, {{6, 11}});
    const auto plan = plan_of(l, 12);
    const auto levels = solve_column(plan, design);
    const auto count_liquid = [&](const std::vector<int>& chosen) {
      int liquid = 0;
      while (
          liquid < 6 &&
          plan.model.level_phi[static_cast<std::size_t>(chosen[static_cast<std::size_t>(liquid)])] <
              1)
        ++liquid;
      return liquid;
    };
    const auto fits = [&](const std::vector<int>& chosen) {
      std::vector<double> phi(6, 0.0);
      double node = 0;
      for (std::size_t j = 0; j < 6; ++j) {
        phi.push_back(plan.model.level_phi[static_cast<std::size_t>(chosen[j])]);
        node += phi.back() * std::pow(a, static_cast<double>(j) + 1);
      }
      return held(l, phi, design).not_holding == 0 && node <= 1 + 1e-6;
    };
    std::vector<int> ours(levels.begin() + 6, levels.end());
    int fewest = 99;
    std::vector<int> tried(6);
    for (int code = 0; code < 15625; ++code) {
      int rest = code;
      for (int& t : tried) {
        t = rest % 5;
        rest /= 5;
      }
      if (fits(tried)) fewest = std::min(fewest, count_liquid(tried));
    }
    if (fewest == 99) {
      // None fits: the last layer is a film, and the edge goes too far.
      EXPECT_EQ(count_liquid(ours), 5) << round;
      continue;
    }
    EXPECT_TRUE(fits(ours)) << round;
    EXPECT_EQ(count_liquid(ours), fewest) << round;
  }
}

TEST(Lifts, FeasibleIsWhatHolds) {
  const Printer printer = test::linear_printer(0, 10);
  const auto fails = [&](double exposure_s) -> std::string {
    Process p;
    p.mode = ExposureMode::layerwise;
    p.exposure_s = exposure_s;
    p.lifts = Lifts::each;
    try {
      check_feasible(make_cure_model(printer, test::resin(100, 150), p, 50), printer, p);
    } catch (const InfeasibleError& e) {
      return e.what();
    }
    return {};
  };
  const std::string text = fails(0.01);
  EXPECT_THAT(text, testing::HasSubstr("does not hold when the platform lifts"));
  const auto at = text.find("at least ");
  ASSERT_NE(at, text.npos);
  const double least_s = std::stod(text.substr(at + 9));
  EXPECT_EQ(fails(least_s), "");
  EXPECT_NE(fails(least_s * 0.999), "");
}

// The exchange lies in a range: corrected for its greatest, no feature is thinner than designed for any of
// them. What holds at its lift holds, and what is liquid there gels later on.
TEST(Lifts, NothingIsCutIntoForAnyExchangeThatIsBelieved) {
  std::mt19937 random(23);
  int liquid_ones = 0, placed = 0;
  for (int round = 0; round < test::rounds(60); ++round) {
    Lift l{25.0 + 25 * (random() % 3), 60.0 + random() % 300, 0, 1.0 + 0.1 * (random() % 6)};
    const double a = std::pow(10.0, -l.layer_um / l.ha_um);
    l.full = l.strength / a * (1.02 + random() % 9);
    const int level_counts[] = {256, 16, 64};
    l.levels = level_counts[round % 3];
    if (round % 5 == 0) l.exposures = {4, 4, 2.5, 1};
    l.exchange = 0.05 * (1 + random() % 19);
    const double sd = std::min(l.exchange, 0.01 * (1 + random() % 20));
    const double least = std::max(0.0, l.exchange - 2 * sd);
    const double most = std::min(1.0, l.exchange + 2 * sd);
    const auto runs = test::random_runs(random, 4, 109, 2, 8);
    const auto design = test::column(110, runs);
    std::vector<std::uint8_t> heights(111, 0);
    for (const auto& [from, to] : runs) {
      if (round % 2)
        heights[static_cast<std::size_t>(from)] = edge_height_byte(0.01 * (random() % 81) - 0.4);
    }
    CorrectionPlan plan = plan_of(l, 110);
    plan.most_exchange = most;
    const auto levels = solve_column(plan, design, heights);
    std::vector<double> phi;
    for (std::size_t n = 0; n < levels.size(); ++n) {
      phi.push_back(plan.model.level_phi[levels[n]] * plan.model.ratio(static_cast<int>(n)));
    }
    const Held by_hand = held(l, phi, design);
    EXPECT_EQ(by_hand.not_holding, 0U) << round;
    liquid_ones += by_hand.liquid > 0;
    const double middle = 0.5 * (l.exchange + most);
    for (const auto& [from, to] : runs) {
      if (from == 0) continue;
      const auto height = heights[static_cast<std::size_t>(from)];
      const double place_um = height == 0 ? 0.0 : -edge_height_slices(height) * l.layer_um;
      const double part_um = l.layer_um / 200 + 1e-9;
      double before = std::numeric_limits<double>::infinity();
      for (const double x : {least, l.exchange, middle, most}) {
        // From the window of the feature on: all of it has gelled, not its edge alone.
        const double edge = edge_um(l, phi, from, x, to - from + 1);
        EXPECT_GE(edge, place_um - part_um) << round << " x " << x << " node " << from;
        // Less exchange, further out.
        EXPECT_LE(edge, before + 1e-9) << round << " x " << x;
        before = edge;
      }
      int liquid = 0;
      while (liquid <= to - from && phi[static_cast<std::size_t>(from + liquid)] < 1) ++liquid;
      if (liquid == 0 || to - from < 9 || l.levels < 256) continue;
      // A film that is not raised leaves the edge within a step of its layer for the greatest share.
      placed += before <= place_um + 0.1 * l.layer_um;
    }
    // The band does the same.
    BandCorrector band(plan, 2);
    std::vector<std::uint8_t> row(2);
    for (std::size_t n = 0; n < design.size(); ++n) {
      row.assign(2, design[n]);
      const std::vector<std::uint8_t> nodes(2, heights[n]);
      band.add_layer(row.data(), nodes.data());
    }
    band.solve([&](int n, const std::uint8_t* level, const std::uint8_t*, bool) {
      EXPECT_EQ(level[0], levels[static_cast<std::size_t>(n)]) << round << " " << n;
    });
  }
  EXPECT_GT(liquid_ones, 5);
  EXPECT_GT(placed, 5);
}

// Where all resin stays, and the prediction counts with that, its own edges are the ones that figures tell
// beside those of an exchange.
TEST(Lifts, EdgesWhereAllResinStaysAreToldBesideTheChosenOnes) {
  std::mt19937 random(41);
  for (int round = 0; round < test::rounds(40); ++round) {
    Lift l{50, 100.0 + random() % 300, 8, 1.2};
    l.black = round % 2 ? 0.01 : 0;
    const auto runs = test::random_runs(random, 4, 109, 2, 12);
    const auto design = test::column(110, runs);
    const auto levels = solve_column(plan_of(l, 110), design);
    const double shares[] = {0, 0.4, 1, kUnknownExchange};
    std::vector<Prediction> told;
    for (const double share : shares) {
      l.exchange = share;
      const CureModel model = model_of(l);
      const PixelCurve curve = pixel_curve(model);
      BandPredictor predictor(model, curve, 110, 1);
      for (int n = 110; n-- > 0;) {
        const auto k = static_cast<std::size_t>(n);
        const auto pixel = static_cast<std::uint8_t>(pixel_of_level(levels[k], l.levels));
        predictor.add_slice(n, &pixel, &design[k]);
      }
      told.push_back(predictor.finish(0, 0, 1));
    }
    for (const Prediction& p : told) {
      EXPECT_NEAR(p.joints->staying_error_um.mean(), told[0].height_error_um.mean(), 1e-3) << round;
      EXPECT_NEAR(p.joints->exchanged_error_um.mean(), told[2].height_error_um.mean(), 1e-3)
          << round;
      EXPECT_NEAR(p.joints->staying_max_um, told[0].height_error_um.greatest(), 1e-3) << round;
    }
    EXPECT_GE(told[0].height_error_um.mean(), told[1].height_error_um.mean());
  }
}

}  // namespace
}  // namespace slicecorr
