// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What stands for doing the same again under UV light: columns that are alike, tables of the rule,
// blocks of pixels that show one level.

#include "correct/solved_columns.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "correct/column_band.hpp"
#include "correct/inhibited_column.hpp"
#include "correct/inhibited_judge.hpp"
#include "correct/inhibited_polish.hpp"
#include "correct/inhibited_rule.hpp"
#include "cure/inhibited_layer.hpp"
#include "cure/layer_floor.hpp"
#include "slicecorr/dose.hpp"
#include "uv_models.hpp"

namespace slicecorr::detail {
namespace {

using namespace test::uv;

TEST(SolvedColumns, ForgetWhatWasNotAskedForAndNeverMistake) {
  std::mt19937 random(1);
  // Room for some hundred of two thousand keys.
  SolvedColumns solved(100 * 200);
  const auto value_of = [](int i) { return "value " + std::to_string(i * 7); };
  int known = 0;
  for (int i = 0; i < 2000; ++i) {
    const std::string key = std::to_string(i);
    solved.keep(key, value_of(i));
    std::string value;
    // The last one is there always: nothing else asked for its room since.
    ASSERT_TRUE(solved.find(key, value));
    EXPECT_EQ(value, value_of(i));
    const int other = static_cast<int>(random() % 2000U);
    if (solved.find(std::to_string(other), value)) {
      EXPECT_EQ(value, value_of(other));
      EXPECT_LE(other, i);
      ++known;
    }
  }
  EXPECT_GT(known, 0);
  std::string value;
  int kept = 0;
  for (int i = 0; i < 2000; ++i) kept += solved.find(std::to_string(i), value) ? 1 : 0;
  EXPECT_GT(kept, 20);
  EXPECT_LT(kept, 200);
}

/// Runs of covered layers, some of them grey, with and without edge heights.
std::vector<CoverageRun> random_runs(std::mt19937& random, int layers) {
  const auto below = [&](int most) {
    return static_cast<int>(random() % static_cast<unsigned>(most));
  };
  std::vector<CoverageRun> runs;
  for (int at = below(8); at < layers;) {
    CoverageRun run;
    run.first = at;
    run.end = std::min(layers, at + 1 + below(below(3) == 0 ? 60 : 12));
    run.coverage = below(5) == 0 ? static_cast<std::uint8_t>(1 + below(254)) : std::uint8_t{255};
    runs.push_back(run);
    at = run.end + (below(6) == 0 ? 0 : 1 + below(20));
  }
  return runs;
}

Process layerwise_process() {
  Process p = uv_process(0, 200);
  p.mode = ExposureMode::layerwise;
  p.exposure_s = 5;
  return p;
}

TEST(LevelRule, ByTablesIsTheRule) {
  // A column whose highest levels are given, and are those of the plan, goes without tables.
  std::mt19937 random(2);
  constexpr int layers = 150;
  for (const Process& process :
       {uv_process(200, 200), uv_process(1000, 200), layerwise_process()}) {
    const CureModel model = model_of(resin_1(), process, 50);
    const InhibitedPlan plan(model, false, layers, slices_with_burst(model, layers, layers - 1));
    ColumnDesign design(plan);
    ColumnDoses doses(plan);
    const std::vector<Level> caps(static_cast<std::size_t>(plan.all_layers),
                                  static_cast<Level>(plan.cap_of(0)));
    LevelRule by_tables(plan, design, doses), plain(plan, design, doses, caps);
    ASSERT_TRUE(plan.promises.hold(plan.reach, plan.lags.front()));
    int lit = 0;
    for (int round = 0; round < 60; ++round) {
      design.read(random_runs(random, layers));
      for (ColumnDesign::Feature& f : design.features)
        f.lag = plan.lags[random() % plan.lags.size()];
      by_tables.choose();
      const std::vector<Level> first = doses.levels();
      const bool again = by_tables.choose_again();
      const std::vector<Level> second = doses.levels();
      plain.choose();
      EXPECT_EQ(doses.levels(), first);
      EXPECT_EQ(plain.choose_again(), again);
      EXPECT_EQ(doses.levels(), second);
      // Another try of the column: the tables' rule takes over what no difference reaches.
      for (int next = 0; next < 4 && !design.features.empty(); ++next) {
        ColumnDesign::Feature& f = design.features[random() % design.features.size()];
        if (next % 2 == 0) f.lag = plan.lags[random() % plan.lags.size()];
        design.demand[static_cast<std::size_t>(next < 2 ? f.upper : f.lower)] +=
            0.01 * static_cast<double>(random() % 3U);
        by_tables.choose();
        const std::vector<Level> tried = doses.levels();
        const double dose = doses.node(f.upper);
        const bool more = next == 1 && by_tables.choose_again();
        const std::vector<Level> tried_again = doses.levels();
        plain.choose();
        EXPECT_EQ(doses.levels(), tried);
        EXPECT_EQ(doses.node(f.upper), dose);
        if (next == 1) {
          EXPECT_EQ(plain.choose_again(), more);
        }
        EXPECT_EQ(doses.levels(), tried_again);
      }
      lit += static_cast<int>(
          std::count_if(first.begin(), first.end(), [](Level l) { return l > 0; }));
    }
    EXPECT_GT(lit, 1000);
  }
}

TEST(InhibitedJudge, WhatIsKnownToGelChangesNoScore) {
  std::mt19937 random(6);
  constexpr int layers = 150;
  for (const Process& process : {uv_process(200, 200), layerwise_process()}) {
    const CureModel model = model_of(resin_1(), process, 50);
    const InhibitedPlan plan(model, false, layers, slices_with_burst(model, layers, layers - 1));
    ColumnDesign design(plan);
    ColumnDoses doses(plan);
    LevelRule rule(plan, design, doses);
    ColumnJudge knowing(plan, design, doses);
    std::size_t dips = 0;
    for (int round = 0; round < 150; ++round) {
      design.read(random_runs(random, layers));
      rule.choose();
      // Dimmer for some slices: features come apart, some by little.
      std::vector<Level> levels = doses.levels();
      for (Level& level : levels) {
        if (random() % 12U == 0) level = static_cast<Level>(level * (random() % 10U) / 10U);
      }
      if (round % 3 != 0) doses.take(levels, false);
      const ColumnJudge::Score known = knowing.score(1e300);
      ColumnJudge fresh(plan, design, doses);
      const ColumnJudge::Score score = fresh.score(1e300);
      EXPECT_EQ(known.um, score.um);
      EXPECT_EQ(known.perfect, score.perfect);
      ASSERT_EQ(knowing.dips().size(), fresh.dips().size());
      for (std::size_t i = 0; i < fresh.dips().size(); ++i) {
        EXPECT_EQ(knowing.dips()[i].layer, fresh.dips()[i].layer);
        EXPECT_EQ(knowing.dips()[i].least, fresh.dips()[i].least);
      }
      dips += fresh.dips().size();
    }
    EXPECT_GT(dips, 20U);
  }
}

/// The descent of ColumnPolish with all costs of each trial, on a copy of the doses.
class PlainDescent {
 public:
  PlainDescent(const InhibitedPlan& plan, const ColumnDesign& design, ColumnDoses& doses,
               double weight)
      : plan_(plan), design_(design), doses_(doses), weight_(weight) {}
  void descend() {
    const InhibitedTuning& t = plan_.tuning;
    const int farthest = design_.last_node + plan_.reach + plan_.end_lag + t.spare_slices;
    for (int sweep = 0; sweep < t.polish_sweeps; ++sweep) {
      bool moved = false;
      for (int n = std::min(farthest + 1, plan_.all_layers); n-- > 0;) moved = improve(n) || moved;
      doses_.rebuild();
      if (!moved) break;
    }
  }

 private:
  bool improve(int n) {
    const InhibitedTuning& t = plan_.tuning;
    const int now = doses_.level(n), before = n > 0 ? doses_.level(n - 1) : 0;
    double least = cost(doses_, n);
    if (least < t.polish_enough) return false;
    least -= t.polish_least_gain;
    int best = now, best_before = before;
    const auto attempt = [&](int level, int previous) {
      if (std::min(level, previous) < 0 || level > plan_.cap_of(n)) return;
      if (previous != before && previous > plan_.cap_of(n - 1)) return;
      ColumnDoses tried = doses_;
      tried.change(n, level);
      if (previous != before) tried.change(n - 1, previous);
      const double costs = cost(tried, n);
      if (costs >= least) return;
      least = costs;
      best = level;
      best_before = previous;
    };
    for (const int step : t.polish_steps) {
      attempt(now + step, before);
      attempt(now - step, before);
    }
    attempt(0, before);
    for (const int step : t.polish_moves) {
      if (n == 0) break;
      attempt(now + step, before - step);
      attempt(now - step, before + step);
    }
    if (best == now && best_before == before) return false;
    doses_.change(n, best);
    if (best_before != before) doses_.change(n - 1, best_before);
    return true;
  }
  double cost(const ColumnDoses& doses, int n) const {
    const InhibitedTuning& t = plan_.tuning;
    const auto weighed = [](double weight, double x) { return x > 0 ? weight * x * x : 0.0; };
    double sum = 0;
    for (const ColumnDesign::Edge& edge : design_.edges) {
      if (edge.node <= n - plan_.near || edge.node > n) continue;
      const double d = doses.beside(edge.node, edge.aim) - 1.0;
      sum += t.edge_weight * d * d;
    }
    for (int k = std::max(0, n - plan_.near + 1); k <= n; ++k) {
      const double dose = doses.middle(k);
      if (doses.sampled() && design_.full(k)) {
        sum += weighed(weight_, t.dip_dose - doses.least_sampled(k));
      }
      if (design_.full(k)) {
        sum += weighed(t.core_weight, t.core_dose - dose) +
               weighed(t.excess_weight, dose - t.excess_dose);
      } else if (design_.coverage(k) == 0) {
        sum += weighed(t.gap_weight, dose - t.gap_dose);
      }
    }
    return sum;
  }

  const InhibitedPlan& plan_;
  const ColumnDesign& design_;
  ColumnDoses& doses_;
  double weight_;
};

TEST(ColumnPolish, GoesWhereADescentWithAllCostsGoes) {
  std::mt19937 random(8);
  constexpr int layers = 60;
  int moved = 0;
  for (const Process& process : {uv_process(200, 200), layerwise_process()}) {
    const CureModel model = model_of(resin_1(), process, 50);
    const InhibitedPlan plan(model, false, layers, slices_with_burst(model, layers, layers - 1));
    ColumnDesign design(plan);
    ColumnDoses doses(plan), plain_doses(plan);
    LevelRule rule(plan, design, doses);
    for (int round = 0; round < 12; ++round) {
      design.read(random_runs(random, layers));
      rule.choose();
      std::vector<Level> levels = doses.levels();
      for (Level& level : levels) {
        if (random() % 8U == 0) level = static_cast<Level>(level * (random() % 10U) / 10U);
      }
      const bool sampled = process.mode == ExposureMode::layerwise && round % 2 == 0;
      const double weight = plan.tuning.dip_weights[static_cast<std::size_t>(round % 4) / 2];
      doses.take(levels, sampled);
      ColumnPolish(plan, design, doses).descend(weight);
      plain_doses.take(levels, sampled);
      PlainDescent(plan, design, plain_doses, weight).descend();
      ASSERT_EQ(doses.levels(), plain_doses.levels()) << round;
      moved += doses.levels() != levels ? 1 : 0;
    }
  }
  EXPECT_GT(moved, 12);
}

/// Light around a layer: the levels of the slices that the tables know, of which some follow each other, and far light.
struct LitLayer {
  std::vector<int> levels;
  double far;
  LitLayer(std::mt19937& random, const InhibitedKernel& kernel, int usual)
      : far(0.3 * static_cast<double>(random() % 1000U) / 1000) {
    int level = usual;
    for (int j = 0; j < kernel.near(); ++j) {
      if (random() % 4U == 0) {
        const auto most = static_cast<unsigned>(kernel.levels());
        const unsigned kind = random() % 4U;
        level = kind == 0   ? 0
                : kind == 1 ? static_cast<int>(random() % most)
                            : std::min(static_cast<int>(most) - 1,
                                       usual * (90 + static_cast<int>(random() % 40U)) / 100);
      }
      levels.push_back(level);
    }
  }
  void shine(InhibitedLayer& layer) const {
    layer.begin(far);
    for (std::size_t j = 0; j < levels.size(); ++j) {
      layer.add(static_cast<int>(j), 0, levels[j], 1.0);
    }
  }
};

Process layerwise_of(double exposure_s) {
  Process p = layerwise_process();
  p.exposure_s = exposure_s;
  return p;
}

TEST(InhibitedLayer, WhatIsSureWithoutALookIsWhatALookFinds) {
  // Heights of layers and exponents; exposures that leave the steady dose of some level near 1.
  struct Case {
    double layer_um, m, exposure_s;
  };
  std::mt19937 random(7);
  for (const Case& c :
       {Case{50, 0.99, 1}, Case{100, 0.99, 2.4}, Case{50, 0.7, 5}, Case{20, 1, 0.4}}) {
    const CureModel model = model_of(resin_1(c.m), layerwise_of(c.exposure_s), c.layer_um);
    const InhibitedKernel& kernel = *model.inhibited();
    ASSERT_TRUE(LayerFloor(kernel).exists());
    int usual = 1;
    while (usual + 1 < kernel.levels() && kernel.steady_dose(0, usual) < 1.004) ++usual;
    ASSERT_GE(kernel.steady_dose(0, usual), 1.004);
    InhibitedLayer layer(kernel);
    int sure = 0, sure_below = 0, parted = 0;
    for (int round = 0; round < 2000; ++round) {
      const LitLayer lit(random, kernel, usual);
      lit.shine(layer);
      const LayerFloor::Doses doses{layer.at(0), layer.at(0.5), layer.at(1)};
      LayerFloor floor(kernel);
      for (std::size_t j = 0; j < lit.levels.size(); ++j) {
        const int at = static_cast<int>(j);
        floor.add(at, at, 0, lit.levels[j], 1.0);
      }
      const double low = floor.least(doses), high = floor.most(doses);
      for (int i = 0; i <= 100; ++i) {
        const double dose = layer.at(0.01 * i);
        ASSERT_GE(dose, low - 1e-7) << round << ' ' << i;
        ASSERT_LE(dose, high * (1 + 1e-7)) << round << ' ' << i;
      }
      const double known = round % 3 == 0 ? 1.0 : round % 3 == 1 ? 1.003 : 0.5;
      const bool stays = layer.stays(doses, known);
      InsideLayer found;
      layer.sample(doses.lower, doses.middle, doses.upper);
      layer.find(known, found);
      parted += found.crossings.empty() ? 0 : 1;
      if (!stays) continue;
      ASSERT_TRUE(found.crossings.empty()) << round;
      ASSERT_GE(found.least, std::min(known, doses.least()) - 1e-6) << round;
      ++(doses.least() >= 1 ? sure : sure_below);
    }
    EXPECT_GT(sure, 100);
    EXPECT_GT(sure_below, 100);
    EXPECT_GT(parted, 20);
  }
}

TEST(InhibitedLayer, NothingIsSureWhereTheBoundDoesNotHold) {
  // An exponent above 1 bends upwards at the front, and layers higher than light is concave do so above it.
  const auto exists = [](double layer_um, double m, bool layerwise) {
    const CureModel model =
        model_of(resin_1(m), layerwise ? layerwise_of(8) : uv_process(200, 200), layer_um);
    return LayerFloor(*model.inhibited()).exists();
  };
  EXPECT_TRUE(exists(100, 0.99, true));
  EXPECT_FALSE(exists(100, 1.29, true));
  EXPECT_FALSE(exists(100, 0.99, false));
  // With m = 1 light is concave as far as ln(1 + (1/huv^2 - 1/hb^2) hb^2) / (1/huv - 1/hb) from its front.
  const double a = 1.0 / 408, u = 1.0 / 37.8;
  const double concave_um = std::log(1 + (u * u - a * a) / (a * a)) / (u - a);
  EXPECT_TRUE(exists(concave_um - 0.1, 1, true));
  EXPECT_FALSE(exists(concave_um + 0.1, 1, true));
}

TEST(InhibitedDoses, OfBlocksAreThoseOfTheirColumns) {
  // Three blocks and a part of one: alike, alike for a while, and never.
  constexpr std::size_t columns = 110;
  constexpr int slices = 120;
  std::mt19937 random(3);
  for (const Process& process : {uv_process(200, 200), layerwise_process()}) {
    const CureModel model = model_of(resin_1(), process, 50);
    std::vector<std::vector<std::uint8_t>> shown(columns, std::vector<std::uint8_t>(slices, 0));
    for (std::size_t i = 0; i < columns; ++i) {
      std::mt19937 own(i < 32 ? 0U : static_cast<unsigned>(i));
      std::mt19937& its = i < 64 ? own : random;
      std::mt19937 alike(99);
      std::uint8_t level = 0;
      for (int n = slices; n-- > 0;) {
        // Blocks are alike but in the middle third, in which the second one is not.
        std::mt19937& next = i < 64 && n % 60 < 40 ? alike : its;
        if (next() % 25U == 0) level = static_cast<std::uint8_t>(next() % 256U);
        if (i < 32) {
          alike.seed(static_cast<unsigned>(n / 30));
          level = static_cast<std::uint8_t>(alike() % 256U);
        }
        shown[i][static_cast<std::size_t>(n)] = level;
      }
    }
    BandDose band(model, columns);
    std::vector<ColumnDose> alone;
    alone.reserve(columns);
    for (const auto& column : shown) alone.push_back(column_dose(model, column));
    std::vector<std::uint8_t> row(columns);
    for (int n = slices; n-- > 0;) {
      const auto at = static_cast<std::size_t>(n);
      for (std::size_t i = 0; i < columns; ++i) row[i] = shown[i][at];
      band.add_slice(n, row.data());
      for (std::size_t i = 0; i < columns; ++i) {
        ASSERT_EQ(band.lower()[i], alone[i].lower[at]) << i << ' ' << n;
        ASSERT_EQ(band.middle()[i], alone[i].middle[at]) << i << ' ' << n;
        ASSERT_EQ(band.upper()[i], alone[i].upper[at]) << i << ' ' << n;
      }
    }
  }
}

TEST(ColumnBand, ColumnsAreTheSameAtAnyHeight) {
  std::mt19937 random(5);
  constexpr int layers = 700, part = 120;
  for (const Process& process :
       {uv_process(200, 200), uv_process(1000, 200), layerwise_process()}) {
    const CureModel model = model_of(resin_1(), process, 50);
    const InhibitedPlan plan(model, false, layers, slices_with_burst(model, layers, layers - 1));
    const ColumnFacts facts = plan.facts();
    ASSERT_GT(facts.begin_at, 0);
    InhibitedColumn column(plan);
    int moved = 0;
    for (int round = 0; round < 12; ++round) {
      const int by = facts.begin_at + 1 + static_cast<int>(random() % 200U);
      std::vector<CoverageRun> runs = random_runs(random, part);
      for (CoverageRun& run : runs) {
        run.first += by;
        run.end += by;
      }
      const std::vector<Level> own = column.solve(runs);
      std::vector<CoverageRun> there = runs;
      const int back = move_to_begin(facts, there);
      ASSERT_EQ(there.front().first + back, runs.front().first);
      EXPECT_EQ(there.front().first, facts.begin_at);
      const std::vector<Level>& levels = column.solve(there);
      for (std::size_t n = 0; n < own.size(); ++n) {
        const auto shift = static_cast<std::size_t>(back);
        ASSERT_EQ(own[n], n < shift ? 0 : levels[n - shift]) << round << ' ' << n;
      }
      ++moved;
    }
    EXPECT_EQ(moved, 12);
    // Near to the last slice black slices give less, and near to the platform prints have no room.
    std::vector<CoverageRun> end{{layers - 20, layers, 255}}, begin{{2, 9, 255}};
    EXPECT_EQ(move_to_begin(facts, end), 0);
    EXPECT_EQ(move_to_begin(facts, begin), 0);
  }
}

TEST(ColumnBand, LevelsAreThoseWithoutWhatWasKept) {
  // Two bands of one plan: what the first has solved stands in the second.
  std::mt19937 random(4);
  constexpr int layers = 80;
  constexpr std::size_t columns = 40;
  const CureModel model = model_of(resin_1(), uv_process(200, 200), 50);
  const InhibitedPlan plan(model, false, layers, slices_with_burst(model, layers, layers - 1));
  std::vector<std::vector<std::uint8_t>> coverage(columns, std::vector<std::uint8_t>(layers, 0));
  for (std::size_t i = 0; i < columns; ++i) {
    if (i % 3 == 2) {
      coverage[i] = coverage[i / 3];
      continue;
    }
    for (const CoverageRun& run : random_runs(random, layers)) {
      std::fill(coverage[i].begin() + run.first, coverage[i].begin() + run.end, run.coverage);
    }
  }
  const auto solved = [&](bool kept) {
    ColumnFacts facts = plan.facts();
    if (!kept) facts.solved.reset();
    ColumnBand band(std::make_unique<InhibitedColumn>(plan), facts, columns);
    std::vector<std::uint8_t> row(columns);
    for (std::size_t n = 0; n < layers; ++n) {
      for (std::size_t i = 0; i < columns; ++i) row[i] = coverage[i][n];
      band.add_layer(row.data(), nullptr, nullptr);
    }
    std::vector<std::uint8_t> levels;
    band.solve([&](int, const std::uint8_t* pixels, const std::uint8_t*,
                   bool) { levels.insert(levels.end(), pixels, pixels + columns); },
               {});
    return levels;
  };
  const std::vector<std::uint8_t> alone = solved(false);
  EXPECT_EQ(solved(true), alone);
  EXPECT_EQ(solved(true), alone);
  for (std::size_t i = 0; i < columns; ++i) {
    InhibitedColumn column(plan);
    const std::vector<std::uint8_t> own = solve_alone(column, plan.facts(), coverage[i], {});
    for (std::size_t n = 0; n < own.size(); ++n) {
      ASSERT_EQ(alone[(own.size() - 1 - n) * columns + i], own[n]) << i << ' ' << n;
    }
  }
}

}  // namespace
}  // namespace slicecorr::detail
