// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What layer by layer exposure prints: the sawtooth against fine sampling of the dose, by hand, and
// the corrected print.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "layerwise_models.hpp"
#include "rounds.hpp"
#include "slicecorr/baseline.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/predict.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr {
namespace {

using test::any_layerwise;
using test::AnyLayerwise;
using test::column;
using test::figure_a_7;
using test::layerwise;
using test::random_column;

using Bytes = std::vector<std::uint8_t>;

/// Signed errors by node and whether it is the run's edge towards the platform.
using Edges = std::map<std::pair<int, bool>, double>;

struct Predicted {
  Prediction figures;
  Edges edges;
};

/// Several columns at once, first slice first in each.
Predicted predict(const CureModel& model, const std::vector<Bytes>& pixels,
                  const std::vector<Bytes>& coverage, std::size_t edges_of = 0) {
  const PixelCurve curve = pixel_curve(model);
  const int layers = static_cast<int>(coverage[0].size());
  BandPredictor predictor(model, curve, layers, pixels.size());
  Predicted result;
  predictor.tell_edges([&](std::size_t i, int node, bool upper, double um) {
    if (i == edges_of) result.edges[{node, upper}] = um;
  });
  for (int n = layers; n-- > 0;) {
    const auto k = static_cast<std::size_t>(n);
    Bytes shown, cover;
    for (std::size_t i = 0; i < pixels.size(); ++i) {
      shown.push_back(k < pixels[i].size() ? pixels[i][k] : 0);
      cover.push_back(coverage[i][k]);
    }
    predictor.add_slice(n, k < pixels[0].size() ? shown.data() : nullptr, cover.data());
  }
  result.figures = predictor.finish(0, 0, static_cast<int>(pixels.size()));
  return result;
}

/// The definitions of the contract on samples of the dose: kFine + 1 of each layer, ends included,
/// from the upper to the lower one. Inside a layer the dose is monotone, so that only the place of
/// an edge is missed, by one sample.
constexpr int kFine = 200;
struct Sampled {
  Edges edges;
  std::uint64_t through = 0, under = 0, lost = 0, merged = 0, teeth = 0, split = 0;
  double least = 1e300;  ///< inside layers of features
  std::vector<double> contrasts;
};
Sampled sample(const CureModel& m, const Bytes& pixels, const Bytes& coverage) {
  const int layers = static_cast<int>(coverage.size());
  const ColumnDose dose = column_dose(m, pixels);
  std::vector<std::uint8_t> printed;
  std::vector<double> doses;
  for (int n = 0; n < layers; ++n) {
    const auto k = static_cast<std::size_t>(n);
    for (int i = 0; i <= kFine; ++i) {
      const double d = k < pixels.size()
                           ? dose.lower[k] * std::pow(m.a, 1 - static_cast<double>(i) / kFine)
                           : 0.0;
      // Ends as they are.
      doses.push_back(k < pixels.size() && i == 0       ? dose.upper[k]
                      : k < pixels.size() && i == kFine ? dose.lower[k]
                                                        : d);
      printed.push_back(doses.back() >= 1);
    }
  }
  Sampled s;
  const auto at = [&](int layer, int i) {
    return printed[static_cast<std::size_t>(layer * (kFine + 1) + i)] != 0;
  };
  const auto cover = [&](int n) {
    return n >= 0 && n < layers ? coverage[static_cast<std::size_t>(n)] : 0;
  };
  const auto is = [&](int q) { return printed[static_cast<std::size_t>(q)] != 0; };
  const auto length = [&](int count) {  // of a stretch of samples, in um
    return count * m.layer_um / (kFine + 1);
  };
  for (int n = 0; n < layers; ++n) {
    const bool middle = dose.middle.size() > static_cast<std::size_t>(n) &&
                        dose.middle[static_cast<std::size_t>(n)] >= 1;
    s.through += cover(n) == 0 && middle;
    s.under += cover(n) == 255 && !middle;
  }
  bool run_below = false;
  for (int end = layers; end > 0;) {
    int begin = end - 1;
    const auto kind = [](int c) { return c == 0 ? 0 : c == 255 ? 2 : 1; };
    while (begin > 0 && kind(cover(begin - 1)) == kind(cover(end - 1))) --begin;
    const int q0 = begin * (kFine + 1), q1 = end * (kFine + 1);
    if (cover(begin) == 255) {
      bool any = false;
      for (int q = q0; q < q1; ++q) any |= is(q);
      s.lost += !any;
      int pieces = 0;
      for (int q = q0; q < q1; ++q) {
        pieces += is(q) && (q == q0 || !is(q - 1));
        s.least = std::min(s.least, doses[static_cast<std::size_t>(q)]);
      }
      s.split += pieces > 1;
      // Upper edge, gap above.
      if (begin > 0 && cover(begin - 1) == 0) {
        int gap = begin;
        while (gap > 0 && cover(gap - 1) == 0) --gap;
        if (at(begin - 1, kFine)) {
          int q = q0 - 1;
          while (q >= gap * (kFine + 1) && is(q)) --q;
          s.edges[{begin, true}] = length(q0 - 1 - q);
        } else {
          int q = q0;
          while (q < q1 && !is(q)) ++q;
          s.edges[{begin, true}] = -length(q - q0);
        }
      }
      if (cover(end) == 0) {
        int gap = end;
        while (gap < layers && cover(gap) == 0) ++gap;
        if (end < layers && at(end, 0)) {
          int q = q1;
          while (q < gap * (kFine + 1) && is(q)) ++q;
          s.edges[{end, false}] = length(q - q1);
        } else {
          int q = q1;
          while (q > q0 && !is(q - 1)) --q;
          s.edges[{end, false}] = -length(q1 - q);
        }
      }
      run_below = true;
    } else if (cover(begin) == 0) {
      // Printed stretches inside the gap that touch neither end of it.
      for (int q = q0; q < q1; ++q) {
        if (!is(q) || (q > 0 && is(q - 1) && q > q0)) continue;
        int to = q;
        while (to < q1 && is(to)) ++to;
        s.teeth += run_below && q > q0 && to < q1;
      }
    }
    end = begin;
  }
  // Gaps from the last run up: layers of coverage 0 up to the next run or the platform.
  for (int n = layers; n-- > 0;) {
    if (cover(n) != 255 || n == 0 || cover(n - 1) == 255) continue;
    bool zero = false;
    double least = 1e300;
    int k = n - 1;
    for (; k >= 0 && cover(k) != 255; --k) {
      if (cover(k) != 0) continue;
      zero = true;
      for (int i = 0; i <= kFine; ++i) {
        least = std::min(least, doses[static_cast<std::size_t>(k * (kFine + 1) + i)]);
      }
    }
    if (!zero) continue;
    s.contrasts.push_back(std::max(0.0, 1 - least));
    s.merged += least >= 1;
  }
  return s;
}

TEST(LayerwisePredict, EqualsFineSamplingOfTheDose) {
  std::mt19937 random(11);
  std::uint64_t teeth = 0, merged = 0, lost = 0, over = 0, short_of = 0;
  for (int trial = 0; trial < test::rounds(1500); ++trial) {
    AnyLayerwise any = any_layerwise(random, 8);
    // From far too little to far too much light, black included: every case there is.
    const double more = std::exp(std::uniform_real_distribution(-1.5, 1.5)(random));
    any.process.exposure_s *= more;
    any.process.bottom_exposure_s *= more;
    for (double& t : any.process.layer_exposure_s) t *= more;
    if (random() % 2) any.printer.calibration.front().intensity_mw_cm2 *= 8;
    const CureModel m = any.model();
    const int layers = 24;
    const Bytes coverage = random_column(random, layers, trial % 2);
    Bytes pixels;
    for (const std::uint8_t c : coverage) {
      // Shown as it is, but for some noise; sometimes the stack ends early.
      pixels.push_back(random() % 4 ? c : static_cast<std::uint8_t>(random() % 256));
    }
    if (trial % 5 == 0) pixels.resize(18);
    const Sampled s = sample(m, pixels, coverage);
    const Predicted p = predict(m, {pixels}, {coverage});
    const double tolerance = 2 * m.layer_um / kFine;
    ASSERT_EQ(p.edges.size(), s.edges.size());
    for (const auto& [edge, um] : p.edges) {
      ASSERT_TRUE(s.edges.contains(edge)) << edge.first << edge.second;
      ASSERT_NEAR(um, s.edges.at(edge), tolerance) << edge.first << " " << edge.second;
      over += um > 0;
      short_of += um < 0;
    }
    const Prediction& f = p.figures;
    ASSERT_EQ(f.cure_through_voxels, s.through);
    ASSERT_EQ(f.undercure_voxels, s.under);
    ASSERT_EQ(f.lost_features, s.lost);
    ASSERT_EQ(f.split_features, s.split);
    if (s.least < 1e300) {
      ASSERT_EQ(f.min_inside_layers, s.least);
    }
    ASSERT_EQ(f.merged_features, s.merged);
    ASSERT_EQ(f.gap_teeth, s.teeth) << trial;
    ASSERT_EQ(f.gap_contrast.count(), s.contrasts.size());
    for (const double c : s.contrasts) {
      ASSERT_GE(c, f.gap_contrast.least() - 1e-12);
      ASSERT_LE(c, f.gap_contrast.greatest() + 1e-12);
    }
    teeth += s.teeth;
    merged += s.merged;
    lost += s.lost;
  }
  // The random columns did come to all cases.
  EXPECT_GT(teeth, 20U);
  EXPECT_GT(merged, 20U);
  EXPECT_GT(lost, 20U);
  EXPECT_GT(over, 1000U);
  EXPECT_GT(short_of, 500U);
}

TEST(LayerwisePredict, BlocksOfColumnsAddUp) {
  // Whole blocks of the same class are skipped over; 100 columns hold three of them and a rest.
  std::mt19937 random(12);
  for (int trial = 0; trial < 5; ++trial) {
    const AnyLayerwise any = any_layerwise(random, 8);
    const CureModel m = any.model();
    std::vector<Bytes> coverage, pixels;
    for (int i = 0; i < 100; ++i) {
      coverage.push_back(i % 37 ? column(24, {{3, 9}, {14, 20}}) : random_column(random, 24, true));
      pixels.push_back(coverage.back());
      if (i % 41 == 0) pixels.back()[7] = 40;
    }
    const Predicted all = predict(m, pixels, coverage, 37);
    Prediction sum;
    for (std::size_t i = 0; i < pixels.size(); ++i) {
      const Predicted one = predict(m, {pixels[i]}, {coverage[i]});
      sum.merge(one.figures);
      if (i == 37) {
        EXPECT_EQ(one.edges, all.edges);
      }
    }
    const auto json = [](const Prediction& p) {
      auto j = nlohmann::json::parse(p.to_json());
      for (const char* key : {"worst_pixel", "verdict"}) j.erase(key);
      return j;
    };
    EXPECT_EQ(json(all.figures), json(sum));
    EXPECT_EQ(all.figures.gap_teeth, sum.gap_teeth);
  }
}

TEST(LayerwisePredict, LadderOfFigureA7BeforeAndAfter) {
  const double te = test::least_exposure_s();
  const CureModel m = figure_a_7(te);
  const Bytes design = column(50, {{11, 20}, {31, 40}});
  // Shown as it is: W at the upper edge of the second rung is the sum of ten full layers.
  const Predicted before = predict(m, {design}, {design});
  const double full = m.phi_max() * m.a * (1 - std::pow(m.a, 10)) / (1 - m.a);
  const double black = m.phi_min() * m.a * (1 - std::pow(m.a, 9)) / (1 - m.a);
  const double w31 = full + black * std::pow(m.a, 10);
  const double reach = 110 * std::log10(w31 + m.phi_min());
  // 1.54 at the edge: cured 22 um into the gap, in the first layer of it.
  EXPECT_NEAR(w31, 1.541, 5e-4);
  EXPECT_NEAR(before.edges.at({31, true}), reach, 1e-9);
  EXPECT_LT(reach, 50);
  EXPECT_EQ(before.edges.at({21, false}), 0);
  EXPECT_EQ(before.edges.at({41, false}), 0);

  const CorrectionPlan plan = test::plan_for(m, layerwise(te), 50);
  const Bytes levels = solve_column(plan, design);  // 256 of them: pixel values
  const Predicted after = predict(m, {levels}, {design});
  for (const int node : {11, 31}) {
    const double um = after.edges.at({node, true});
    EXPECT_GE(um, m.cut_through_um() - 1e-9);
    EXPECT_LE(um, m.cut_through_um() + m.level_step_um());
  }
  EXPECT_EQ(after.edges.at({21, false}), 0);
  EXPECT_EQ(after.edges.at({41, false}), 0);
  EXPECT_EQ(after.figures.cure_through_voxels + after.figures.undercure_voxels, 0U);
  // The dose in each layer falls from omega to 1, and jumps at its window.
  const ColumnDose dose = column_dose(m, levels);
  for (std::size_t n = 11; n < 21; ++n) {
    EXPECT_NEAR(dose.lower[n] / dose.upper[n], m.heterogeneity(), 1e-12);
    EXPECT_GE(dose.upper[n], 1);
    EXPECT_LT(dose.upper[n], 1 + (m.phi_max() - m.phi_min()) / 255 * m.a);
  }
}

TEST(LayerwisePredict, CorrectedColumnsComeOutAsDesigned) {
  // Thin features and gaps, every number of levels, bottom layers and explicit exposures: all edges
  // towards the window exact, all others within the least possible and one level step.
  std::mt19937 random(13);
  for (int bits = 1; bits <= 8; ++bits) {
    for (int trial = 0; trial < test::rounds(150); ++trial) {
      const AnyLayerwise any = any_layerwise(random, bits);
      const CureModel m = any.model();
      const Bytes coverage = random_column(random, 40, false);
      const CorrectionPlan plan = test::plan_for(m, any.process, 40);
      Bytes pixels;
      for (const std::uint8_t l : solve_column(plan, coverage)) {
        pixels.push_back(static_cast<std::uint8_t>(pixel_of_level(l, plan.levels.size())));
      }
      const Predicted p = predict(m, {pixels}, {coverage});
      ASSERT_EQ(p.figures.undercure_voxels, 0U);
      ASSERT_EQ(p.figures.lost_features, 0U);
      ASSERT_EQ(p.figures.greatest_shortfall_um, 0);
      for (const auto& [edge, um] : p.edges) {
        if (!edge.second) continue;
        const double ratio = m.ratio(edge.first - 1);
        const double least = std::min(m.cut_through_um(ratio), any.layer_um);
        ASSERT_GE(um, least - 1e-9);
        // One level passes the critical dose by as much as a step adds, and where bottom exposures
        // make black light strong also by that; teeth above don't touch the edge.
        if (bits >= 6 && um < any.layer_um) {
          ASSERT_LE(um, m.cut_through_um(ratio) + m.level_step_um() + 1e-9);
        }
      }
      // A gap one slice high stays open where a level step and black light leave room for it.
      const double most = 1 + m.level_step_um() * m.eta * units::kLn10 / m.layer_um +
                          m.phi_min() * m.greatest_ratio();
      if (most * m.a < 1) {
        ASSERT_EQ(p.figures.merged_features, 0U);
      }
    }
  }
}

TEST(LayerwisePredict, TeethAreReportedApartFromTheReach) {
  // Strong black light: phi'_min between (1 - a)/(1 + a) and 1 - a gels the layer after next again.
  CureModel m = figure_a_7(0.3);
  const double low = (1 - m.a) / (1 + m.a);
  m.level_phi.front() = 1.02 * low;
  ASSERT_LT(m.phi_min(), 1 - m.a);
  std::vector<double> phi(20, m.phi_min());
  // By hand: far edge of the feature at exactly 1, then black.
  double w = 1;
  int teeth = 0;
  for (int n = 9; n-- > 0;) {
    teeth += n < 8 && m.phi_min() + w >= 1;
    w = (m.phi_min() + w) * m.a;
  }
  EXPECT_GE(teeth, 1);
  const Bytes design = column(20, {{9, 19}});
  const CorrectionPlan plan = test::plan_for(m, layerwise(0.3), 20);
  const Predicted p = predict(m, {solve_column(plan, design)}, {design});
  EXPECT_GE(p.figures.gap_teeth, static_cast<std::uint64_t>(teeth));
  EXPECT_GE(p.edges.at({9, true}), m.cut_through_um() - 1e-9);
  EXPECT_LT(p.edges.at({9, true}), m.layer_um);
  EXPECT_EQ(p.figures.merged_features, 0U);
}

TEST(LayerwisePredict, FiguresOfLayerByLayerExposure) {
  Process p = layerwise(0.16);
  p.bottom_exposure_s = 0.8;
  p.bottom_layers = 3;
  const CureModel m = make_cure_model(test::linear_printer(1, 100), test::resin(576, 110), p, 50);
  const auto figures = layerwise_figures(m);
  ASSERT_TRUE(figures);
  EXPECT_DOUBLE_EQ(figures->cut_through_um, m.cut_through_um());
  EXPECT_DOUBLE_EQ(figures->max_cut_through_um, 110 * std::log10(1 + 5 * m.phi_min()));
  Prediction prediction;
  EXPECT_FALSE(nlohmann::json::parse(prediction.to_json()).contains("layerwise"));
  prediction.layerwise = figures;
  const auto json = nlohmann::json::parse(prediction.to_json())["layerwise"];
  EXPECT_EQ(json["cut_through_um"], m.cut_through_um());
  EXPECT_EQ(json["heterogeneity"], m.heterogeneity());
  EXPECT_EQ(json["gap_teeth"], 0);
  EXPECT_FALSE(layerwise_figures(test::figure_2_2()));
}

TEST(LayerwisePredict, BlackColumnsAndErase) {
  const CureModel m = figure_a_7(0.16);
  const Prediction p = predict_black_columns(m, 300, 5);
  EXPECT_NEAR(p.max_dose_outside, m.phi_min() / (1 - m.a) * m.root_a, 1e-12);
  // After a long full feature: W = phi a / (1 - a), then black until a window stays below 1.
  const int slices = cure_through_slices(m);
  double w = m.phi_max() * m.a / (1 - m.a);
  int n = 0;
  for (; m.phi_min() + w >= 1; ++n) w = (m.phi_min() + w) * m.a;
  EXPECT_EQ(slices, n);
  EXPECT_GT(n, 0);
}

}  // namespace
}  // namespace slicecorr
