// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What prints inside layers under UV light, judged by integration of the rate equation over the
// levels that are shown: pieces, least dose, edges and contrast of features and gaps.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>
#include <random>
#include <string>

#include "rounds.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/inhibited.hpp"
#include "slicecorr/predict.hpp"
#include "slicecorr/target.hpp"
#include "uv_models.hpp"

namespace slicecorr {
namespace {

using namespace test::uv;

/// A process, its resin and its slices.
struct Setting {
  std::string name;
  bool layerwise = false;
  double pace = 0;  ///< s, or mm/h
  double layer_um = 50;
  double m = 0.99, dose_prime = 64;

  Resin resin() const {
    Resin r = resin_1(m);
    r.critical_dose_prime = dose_prime;
    return r;
  }
  Process process() const {
    Process p = uv_process(layerwise ? 0 : pace, 200);
    if (layerwise) {
      p.mode = ExposureMode::layerwise;
      p.exposure_s = pace;
    }
    return p;
  }
  CureModel model() const { return model_of(resin(), process(), layer_um); }
  /// Figure 2.2: rungs from 0.55 to 1.05 mm and from 1.55 to 2.05 mm.
  std::vector<std::uint8_t> ladder() const {
    const int layers = static_cast<int>(std::lround(2500 / layer_um));
    std::vector<std::uint8_t> c(static_cast<std::size_t>(layers), 0);
    for (int n = 0; n < layers; ++n) {
      const double z = (n + 0.5) * layer_um;
      if ((z >= 550 && z < 1050) || (z >= 1550 && z < 2050)) c[static_cast<std::size_t>(n)] = 255;
    }
    return c;
  }
  std::vector<std::uint8_t> rail() const {
    return std::vector<std::uint8_t>(static_cast<std::size_t>(std::lround(2500 / layer_um)), 255);
  }
};

const std::vector<Setting>& settings() {
  static const std::vector<Setting> all{
      {"layer by layer, 100 um, 12 s", true, 12, 100, 0.99, 320},
      {"layer by layer, 50 um, 5 s", true, 5, 50, 0.99, 320},
      {"layer by layer, 200 um, 8 s", true, 8, 200, 0.99, 320},
      // Five times the light: few levels left.
      {"layer by layer, 100 um, strong", true, 12, 100},
      {"layer by layer, 50 um, strong", true, 5, 50},
      {"layer by layer, 200 um, strong", true, 8, 200},
      {"layer by layer, 100 um, 1.2 s", true, 1.2, 100},
      {"layer by layer, 50 um, m 0.7", true, 0.25, 50, 0.7, 25},
      {"layer by layer, 100 um, m 1.29", true, 20, 100, 1.29, 200},
      {"continuous, 50 um", false, 1000, 50},
      {"continuous, 100 um", false, 1000, 100},
      {"continuous, 200 um", false, 900, 200},
      {"continuous, 50 um, m 0.7", false, 1000, 50, 0.7, 25},
      {"continuous, 50 um, m 1.29", false, 1000, 50, 1.29, 200},
  };
  return all;
}

/// One column integrated directly.
class Judge {
 public:
  Judge(const Setting& s, const std::vector<std::uint8_t>& levels)
      : s_(s), kinetics_(make_kinetics(s.resin(), true, true)) {
    const auto intensity = level_intensities(uv_printer());
    for (const std::uint8_t l : levels) blue_.push_back(intensity[l]);
  }

  /// Dose at zeta (in slices): time step by time step, or exposure by exposure. `on_grid`: other
  /// places of the grid lie as far from slices of the same light.
  double dose(double zeta, bool on_grid = false) const {
    const Process process = s_.process();
    double sum = 0;
    for (auto n = static_cast<std::size_t>(std::max(0.0, std::floor(zeta))); n < blue_.size();
         ++n) {
      const double window = static_cast<double>(n) + 1.0;
      if (s_.layerwise) {
        sum += dose_prime_at(kinetics_, blue_[n], 200, (window - zeta) * s_.layer_um,
                             process.exposure_s);
        continue;
      }
      // The midpoint rule errs by step^(1 + m) times the rate's rise at the front of the light: 1
      // um of the window's way keeps 1e-5 of the dose for m of about 1.
      const double begin = std::max(zeta, window - 1.0);
      const std::array<double, 3> way{blue_[n], begin - zeta, window - begin};
      if (const auto known = on_grid ? ways_.find(way) : ways_.end(); known != ways_.end()) {
        sum += known->second;
        continue;
      }
      double of_slice = 0;
      const double step_um = s_.m < 0.9 ? 0.125 : 1.0;
      const int steps = static_cast<int>(std::ceil((window - begin) * s_.layer_um / step_um));
      const double um = (window - begin) * s_.layer_um / std::max(steps, 1);
      for (int i = 0; i < steps; ++i) {
        const double d = (begin - zeta) * s_.layer_um + (i + 0.5) * um;
        of_slice += dose_prime_at(kinetics_, blue_[n], 200, d, um * 3.6 / process.speed_mm_h);
      }
      if (on_grid) ways_.emplace(way, of_slice);
      sum += of_slice;
    }
    return sum / kinetics_.critical_dose_prime;
  }

  /// Samples all layers and seeks turns and crossings between the samples.
  void walk(int layers) {
    // Layer by layer there are kinks; else the dose is smooth.
    const int points = s_.layerwise ? 64 : 16;  // per layer
    std::vector<double> z, d;
    for (int i = 0; i <= layers * points; ++i) {
      z.push_back(static_cast<double>(i) / points);
      d.push_back(dose(z.back(), true));
    }
    for (std::size_t i = 0; i < z.size(); ++i) {
      points_.emplace(z[i], d[i]);
      if (i == 0 || i + 1 == z.size()) continue;
      const bool low = d[i] <= d[i - 1] && d[i] <= d[i + 1];
      const bool high = d[i] >= d[i - 1] && d[i] >= d[i + 1];
      if (!low && !high) continue;
      // A smooth dose is flat where it turns: off by 1e-5 of a slice it is the same to 1e-8.
      double from = z[i - 1], to = z[i + 1];
      for (int step = 0; step < (s_.layerwise ? 40 : 22); ++step) {
        const double x = from + (to - from) / 3, y = to - (to - from) / 3;
        const double at_x = dose(x), at_y = dose(y);
        ((low ? at_x < at_y : at_x > at_y) ? to : from) = (low ? at_x < at_y : at_x > at_y) ? y : x;
      }
      points_.emplace(0.5 * (from + to), dose(0.5 * (from + to)));
    }
    for (auto p = points_.begin(); std::next(p) != points_.end(); ++p) {
      const auto q = std::next(p);
      if ((p->second >= 1) == (q->second >= 1)) continue;
      // To less than the 1e-9 of a slice by which edge_error() looks beside a node.
      double from = p->first, to = q->first;
      for (int step = 0; step < 28; ++step) {
        const double half = 0.5 * (from + to);
        ((dose(half) >= 1) == (p->second >= 1) ? from : to) = half;
      }
      crossings_.push_back(0.5 * (from + to));
    }
    first_ = points_.begin()->second >= 1;
  }

  double least(double from, double to) const {
    double low = 1e300;
    for (auto p = points_.lower_bound(from); p != points_.end() && p->first <= to; ++p) {
      low = std::min(low, p->second);
    }
    return low;
  }
  bool printed(double zeta) const {
    const auto before = std::lower_bound(crossings_.begin(), crossings_.end(), zeta);
    return first_ == ((before - crossings_.begin()) % 2 == 0);
  }
  /// Pieces of [from, to] that lie further apart than by a dose of 1.
  int pieces(double from, double to) const {
    int count = 0;
    double low = 0;
    bool on = false;
    for (auto p = points_.lower_bound(from); p != points_.end() && p->first <= to; ++p) {
      const bool now = p->second >= 1;
      if (now && !on) count += count == 0 || low < 1 - kSameDose;
      if (!now) low = on ? p->second : std::min(low, p->second);
      on = now;
    }
    return count;
  }
  /// The contract's height error, um.
  double edge_error(double node, bool upper, double gap_end, double run_end) const {
    const double out = upper ? -1e-9 : 1e-9;
    const bool over = printed(node + out);
    const double end = over ? gap_end : run_end;
    double place = end;
    for (const double c : crossings_) {
      if (std::min(node, end) <= c && c <= std::max(node, end) &&
          std::abs(c - node) < std::abs(place - node)) {
        place = c;
      }
    }
    return (over ? 1 : -1) * std::abs(place - node) * s_.layer_um;
  }

 private:
  const Setting& s_;
  Kinetics kinetics_;
  std::vector<double> blue_;
  mutable std::map<std::array<double, 3>, double> ways_;  ///< of light, distance and length
  std::map<double, double> points_;
  std::vector<double> crossings_;
  bool first_ = false;
};

struct Predicted {
  Prediction figures;
  std::map<std::pair<int, bool>, double> edges;  ///< node, upper
  std::vector<double> contrasts;
};
Predicted predict(const CureModel& model, const std::vector<std::uint8_t>& levels,
                  const std::vector<std::uint8_t>& coverage) {
  const PixelCurve curve = pixel_curve(model);
  const int all = static_cast<int>(std::max(levels.size(), coverage.size()));
  BandPredictor predictor(model, curve, all, 1);
  Predicted p;
  predictor.tell_edges([&](std::size_t, int node, bool upper, double um) {
    p.edges[{node, upper}] = um;
  });
  const std::uint8_t none = 0;
  for (int n = all; n-- > 0;) {
    const auto i = static_cast<std::size_t>(n);
    predictor.add_slice(n, i < levels.size() ? &levels[i] : nullptr,
                        i < coverage.size() ? &coverage[i] : &none);
  }
  p.figures = predictor.finish(0, 0, 1);
  return p;
}

/// Compares a prediction with the judge's.
void compare(const Setting& s, const std::vector<std::uint8_t>& levels,
             const std::vector<std::uint8_t>& coverage, const std::string& what) {
  SCOPED_TRACE(s.name + ", " + what);
  const CureModel model = s.model();
  const Predicted got = predict(model, levels, coverage);
  Judge judge(s, levels);
  const int layers = static_cast<int>(coverage.size());
  judge.walk(static_cast<int>(std::max(levels.size(), coverage.size())));
  const auto at = [&](int n) {
    return n >= 0 && n < layers ? coverage[static_cast<std::size_t>(n)] : 0;
  };
  std::uint64_t split = 0, merged = 0, lost = 0;
  double least = 1e300, contrast = 1e300;
  for (int n = 0; n < layers;) {
    int end = n;
    while (end < layers && at(end) == at(n)) ++end;
    const bool open = end == layers && at(n) == 0;
    if (at(n) == 255) {
      const int pieces = judge.pieces(n, end);
      split += pieces > 1;
      lost += pieces == 0;
      least = std::min(least, judge.least(n, end));
      const auto edge = [&](int node, bool upper, double gap_end) {
        const auto found = got.edges.find({node, upper});
        ASSERT_NE(found, got.edges.end()) << node;
        EXPECT_NEAR(found->second, judge.edge_error(node, upper, gap_end, upper ? end : n), 0.05)
            << "edge at node " << node;
      };
      int before = n;
      while (before > 0 && at(before - 1) == 0) --before;
      if (n > 0) edge(n, true, before);
      int after = end;
      const int all = static_cast<int>(std::max(levels.size(), coverage.size()));
      while (after < all && at(after) == 0) ++after;
      edge(end, false, after);
    } else if (!open) {
      const double low = judge.least(n, end);
      merged += low >= 1;
      contrast = std::min(contrast, std::max(0.0, 1 - low));
    }
    n = end;
  }
  EXPECT_EQ(got.figures.split_features, split);
  EXPECT_EQ(got.figures.lost_features, lost);
  EXPECT_EQ(got.figures.merged_features, merged);
  // Steps of 1 um leave 1e-5 of the dose of the slices around, about 1, where less is left, too.
  EXPECT_NEAR(got.figures.min_inside_layers, least, 2e-5 * std::max(1.0, least));
  if (contrast < 1e300) {
    EXPECT_NEAR(got.figures.gap_contrast.least(), contrast, 3e-5);
  }
}

TEST(InhibitedLayers, PredictionIsWhatIntegrationSays) {
  // Levels that keep the dose about 1, so that it passes it often, in and beside features.
  std::mt19937 random(23);
  for (const Setting& s : settings()) {
    const CureModel model = s.model();
    int middle = 0;
    while (middle < 255 && model.level_phi[static_cast<std::size_t>(middle)] < 1) ++middle;
    for (int round = 0; round < test::rounds(1); ++round) {
      std::vector<std::uint8_t> levels, coverage;
      int level = middle, cover = 0;
      for (int n = 0; n < 40; ++n) {
        if (random() % 3 != 0) {
          level = static_cast<int>(random() % static_cast<unsigned>(2 * middle + 2));
        }
        if (random() % 4 == 0) cover = 255 - cover;
        levels.push_back(static_cast<std::uint8_t>(std::min(level, 255)));
        coverage.push_back(static_cast<std::uint8_t>(cover));
      }
      compare(s, levels, coverage, "round " + std::to_string(round));
    }
  }
}

// In light that is the same for long, only the layer with the least light from far is looked at: also where the light
// changes inside the gap, and where it grows again towards the feature at its other end.
TEST(InhibitedLayers, LongGapsInFaintLightAreLeastWhereIntegrationSays) {
  for (const Setting& s : settings()) {
    if (!s.layerwise) continue;
    const CureModel model = s.model();
    const auto near = static_cast<std::size_t>(model.inhibited()->near());
    int middle = 0;
    while (middle < 255 && model.level_phi[static_cast<std::size_t>(middle)] < 1) ++middle;
    const auto lit = [&](double share) {
      return static_cast<std::uint8_t>(std::clamp(static_cast<int>(share * middle), 1, 255));
    };
    std::vector<std::uint8_t> levels, coverage;
    const auto add = [&](std::size_t layers, std::uint8_t level, int cover) {
      levels.insert(levels.end(), layers, level);
      coverage.insert(coverage.end(), layers, static_cast<std::uint8_t>(cover));
    };
    add(6, lit(2), 255);
    add(2 * near + 9, lit(0.7), 0);
    add(2 * near + 3, lit(0.4), 0);
    add(near + 2, lit(0.8), 0);
    add(6, lit(2), 255);
    compare(s, levels, coverage, "steps");
    levels.clear();
    coverage.clear();
    add(3 * near, lit(0.6), 0);
    add(6, lit(2), 255);
    compare(s, levels, coverage, "down to the platform");
  }
}

TEST(InhibitedLayers, LadderIsPredictedAsIntegrated) {
  int turn = 0;
  for (const Setting& s : settings()) {
    const CureModel model = s.model();
    // By day one of the two corrected and the other not, in turns.
    ++turn;
    for (const auto& coverage : {s.ladder(), s.rail()}) {
      const bool corrected = ++turn % 2 == 0;
      if (corrected || test::by_night()) {
        const CorrectionPlan plan =
            test::plan_for(model, s.process(), static_cast<int>(coverage.size()));
        compare(s, solve_column(plan, coverage), coverage, "corrected");
      }
      if (!corrected || test::by_night()) compare(s, coverage, coverage, "uncorrected");
    }
  }
}

TEST(InhibitedCorrection, LadderAndRailAreSolid) {
  for (const Setting& s : settings()) {
    SCOPED_TRACE(s.name);
    const CureModel model = s.model();
    for (const auto& coverage : {s.ladder(), s.rail()}) {
      const CorrectionPlan plan =
          test::plan_for(model, s.process(), static_cast<int>(coverage.size()));
      const Predicted p = predict(model, solve_column(plan, coverage), coverage);
      EXPECT_EQ(p.figures.split_features, 0U);
      EXPECT_EQ(p.figures.lost_features, 0U);
      EXPECT_EQ(p.figures.undercure_voxels, 0U);
      EXPECT_EQ(p.figures.merged_features, 0U);
      // Edges of 200 um layers may lie 0.3 um inside the design.
      EXPECT_GT(p.figures.min_inside_layers, 0.998);
    }
  }
}

TEST(InhibitedCorrection, RandomColumnsAreSolid) {
  // Features and gaps of 300 um and more.
  std::mt19937 random(31);
  for (const Setting& s : settings()) {
    SCOPED_TRACE(s.name);
    const CureModel model = s.model();
    std::uint64_t runs = 0, split = 0, lost = 0;
    for (int round = 0; round < 20; ++round) {
      const auto thick = [&] {
        const double um = 300 + static_cast<double>(random() % 900);
        return static_cast<int>(std::ceil(um / s.layer_um));
      };
      std::vector<std::pair<int, int>> features;
      int n = static_cast<int>(random() % 2) * thick();
      for (int i = 0; i < 4; ++i) {
        const int end = n + thick();
        features.emplace_back(n, end - 1);
        n = end + thick();
      }
      const auto coverage = test::column(n, features);
      const CorrectionPlan plan = test::plan_for(model, s.process(), n);
      const Predicted p = predict(model, solve_column(plan, coverage), coverage);
      runs += p.figures.runs;
      split += p.figures.split_features;
      lost += p.figures.lost_features;
    }
    EXPECT_EQ(split, 0U);
    EXPECT_EQ(lost, 0U);
  }
}

TEST(InhibitedCorrection, EdgesComeNearTheirHeights) {
  // Features and gaps of 300 um and more, whose edges are wanted anywhere near their nodes.
  std::mt19937 random(37);
  for (const Setting& s : settings()) {
    // Strong light has few levels: an edge of a slice of 50 um moves by 10 um from one to the next.
    if (s.layer_um > 50 || s.name.ends_with("strong")) continue;
    SCOPED_TRACE(s.name);
    const CureModel model = s.model();
    std::uint64_t wrong = 0, wrong_at_nodes = 0;
    double off = 0, off_at_nodes = 0;
    int edges = 0;
    for (int round = 0; round < 20; ++round) {
      const auto thick = [&] { return 6 + static_cast<int>(random() % 18); };
      std::vector<std::pair<int, int>> features;
      int n = thick();
      for (int i = 0; i < 4; ++i) {
        const int end = n + thick();
        features.emplace_back(n, end - 1);
        n = end + thick();
      }
      const auto coverage = test::column(n, features);
      std::vector<std::uint8_t> heights(coverage.size() + 1, 0);
      for (const auto& [first, last] : features) {
        for (const int node : {first, last + 1}) {
          heights[static_cast<std::size_t>(node)] = static_cast<std::uint8_t>(1 + random() % 255);
        }
      }
      const CorrectionPlan plan = test::plan_for(model, s.process(), n);
      const Predicted got = predict(model, solve_column(plan, coverage, heights), coverage);
      const Predicted at_nodes = predict(model, solve_column(plan, coverage), coverage);
      wrong += got.figures.undercure_voxels + got.figures.cure_through_voxels;
      wrong_at_nodes += at_nodes.figures.undercure_voxels + at_nodes.figures.cure_through_voxels;
      const auto distance = [&](const Predicted& p, const std::pair<int, bool>& edge) {
        const double reach = p.edges.at(edge) / s.layer_um;
        const double below = edge.second ? -reach : reach;
        const double wanted = edge_height_slices(heights[static_cast<std::size_t>(edge.first)]);
        return std::abs(below - wanted);
      };
      for (const auto& [edge, um] : got.edges) {
        const bool at_window = s.layerwise && !edge.second;
        if (at_window) continue;
        off += distance(got, edge);
        off_at_nodes += distance(at_nodes, edge);
        ++edges;
      }
    }
    EXPECT_LE(wrong, wrong_at_nodes);
    // Edges at nodes are off by a quarter of a slice in the mean.
    EXPECT_NEAR(off_at_nodes / edges, 0.25, 0.05);
    EXPECT_LE(off / edges, 0.08);
  }
}

}  // namespace
}  // namespace slicecorr
