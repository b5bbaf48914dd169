// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/layer_column.hpp"

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <tuple>
#include <vector>

#include "correct/layer_level.hpp"
#include "correct/layer_walk.hpp"
#include "correct/lifted_feature.hpp"
#include "correct/wanted_layers.hpp"

namespace slicecorr::detail {

namespace {

/// Levels of single layers, by what they follow from: most columns have the dose of a neighbour.
class KnownLevels {
 public:
  KnownLevels() : entries_(kEntries) {}
  int level(const LayerLight& light, std::uint8_t coverage) {
    const auto bits = std::bit_cast<std::uint64_t>(light.far_edge);
    // Columns come one after the other: those of all slices have room beside each other.
    const std::uint64_t slice = static_cast<std::uint64_t>(light.slice) * 61;
    Entry& entry = entries_[((bits >> 20) ^ (bits >> 40) ^ bits ^ coverage ^ slice) % kEntries];
    if (entry.far_edge != light.far_edge || entry.coverage != coverage ||
        entry.slice != light.slice || entry.height != light.height) {
      const auto level = static_cast<Level>(layer_level(light, coverage));
      entry = {light.far_edge, light.slice, coverage, light.height, level};
    }
    return entry.level;
  }

 private:
  struct Entry {
    double far_edge = std::numeric_limits<double>::quiet_NaN();
    int slice = -1;
    std::uint8_t coverage = 0, height = 0;
    Level level = 0;
  };
  static constexpr std::size_t kEntries = 4096;
  std::vector<Entry> entries_;
};

/// Levels of features that must hold at every lift: what `LiftedFeature` says, found once for those
/// that are alike.
class LiftedLevels {
 public:
  explicit LiftedLevels(const CorrectionPlan& plan)
      : plan_(plan), light_(plan.model, &plan.levels, plan.most_exchange) {}

  const LiftedFeature& light() const { return light_; }
  /// Before the last slice of the next feature.
  void begin() { levels_ = nullptr; }
  /// Of slice n of a feature. `after`: dose that later slices leave at its layer's window.
  int level(const LayerRun& run, int n, double after) {
    const int j = n - run.first, layers = std::min(run.end - run.first, light_.reach());
    // Nothing lies above what stands on the platform.
    if (run.first == 0 || j >= layers) return plan_.levels.highest();
    if (!levels_) levels_ = &find(run, layers, after);
    return (*levels_)[static_cast<std::size_t>(j)];
  }

 private:
  const std::vector<Level>& find(const LayerRun& run, int layers, double after) {
    // Those of a few layers are enough: most columns are like a neighbour.
    if (known_.size() > kMostKnown) known_.clear();
    std::vector<Level>& levels = known_[{run.first, run.height, layers, after}];
    if (levels.empty()) {
      for (const double phi : light_.solve({run.first, layers, after, edge_below(run)}).phi) {
        levels.push_back(static_cast<Level>(plan_.levels.at_least(phi)));
      }
    }
    return levels;
  }

  static constexpr std::size_t kMostKnown = 4096;
  const CorrectionPlan& plan_;
  LiftedFeature light_;
  const std::vector<Level>* levels_ = nullptr;  ///< of the feature at hand
  std::map<std::tuple<int, std::uint8_t, int, double>, std::vector<Level>> known_;
};

class LayerColumn final : public ColumnSolver {
 public:
  LayerColumn(const CorrectionPlan& plan, bool wants_doses)
      : plan_(plan),
        walk_(plan.model),
        levels_(static_cast<std::size_t>(std::max(plan.all_layers, 0))) {
    if (plan.model.lifts) lifted_.emplace(plan);
    if (wants_doses) wanted_.emplace(plan, lifted_ ? &lifted_->light() : nullptr);
  }

  const std::vector<Level>& solve(const std::vector<CoverageRun>& runs,
                                  const ColumnBounds& bounds) override;

 private:
  int level_of(const LayerRun& run, int n);

  const CorrectionPlan& plan_;
  LayerWalk walk_;
  KnownLevels known_;
  std::optional<LiftedLevels> lifted_;
  std::optional<WantedLayers> wanted_;
  std::vector<LayerRun> runs_;
  std::vector<Level> levels_;
};

int LayerColumn::level_of(const LayerRun& run, int n) {
  if (run.left_alone) return run.level;
  if (run.coverage == 0) return 0;
  if (run.is_feature() && wanted_) return wanted_->level(n, walk_);
  if (run.is_feature() && lifted_) return lifted_->level(run, n, walk_.after());
  if (lifted_) {
    return std::min(lifted_->level(run.as_feature(), n, walk_.after()),
                    level_of_pixel(run.coverage, plan_.levels.size()));
  }
  return known_.level(light_of_layer(plan_, run, n, walk_.after()), run.coverage);
}

const std::vector<Level>& LayerColumn::solve(const std::vector<CoverageRun>& runs,
                                             const ColumnBounds& bounds) {
  const CureModel& model = plan_.model;
  const auto light = [&](int n) {
    return plan_.levels.phi(levels_[static_cast<std::size_t>(n)]) * model.ratio(n);
  };
  read_layer_runs(runs, bounds.left_alone, plan_.all_layers, runs_);
  walk_.begin();
  for (std::size_t r = runs_.size(); r-- > 0;) {
    const LayerRun& run = runs_[r];
    if (r == 0 && run.coverage == 0 && !run.left_alone) {
      // Nothing lies above it.
      std::fill(levels_.begin(), levels_.begin() + run.end, Level{0});
      break;
    }
    if (lifted_) lifted_->begin();
    for (int n = run.end; n-- > run.first;) {
      walk_.enter(n, plan_.all_layers, light);
      if (wanted_ && run.is_feature() && n + 1 == run.end) wanted_->begin(run, bounds, walk_);
      levels_[static_cast<std::size_t>(n)] = static_cast<Level>(level_of(run, n));
      walk_.pass(n, light(n));
    }
  }
  return levels_;
}

}  // namespace

std::unique_ptr<ColumnSolver> make_layer_column(const CorrectionPlan& plan, bool wants_doses) {
  return std::make_unique<LayerColumn>(plan, wants_doses);
}

std::vector<double> solve_layers_exactly(const CorrectionPlan& plan,
                                         const std::vector<CoverageRun>& covered) {
  const CureModel& model = plan.model;
  std::vector<double> phi(static_cast<std::size_t>(std::max(plan.all_layers, 0)));
  std::optional<LiftedFeature> lifted;
  if (model.lifts) lifted.emplace(model, nullptr, plan.most_exchange);
  std::vector<LayerRun> runs;
  read_layer_runs(covered, {}, plan.all_layers, runs);
  LayerWalk walk(model);
  std::vector<double> held;  // of the first layers of the feature at hand
  const auto of_lit = [&](const LayerRun& run, int n) {
    const int layers = std::min(run.end - run.first, lifted->reach());
    if (run.first == 0 || n - run.first >= layers) return model.phi_max();
    if (held.empty()) held = lifted->solve({run.first, layers, walk.after(), edge_below(run)}).phi;
    return held[static_cast<std::size_t>(n - run.first)];
  };
  const auto of_lifted = [&](const LayerRun& run, int n) {
    if (run.is_feature()) return of_lit(run, n);
    const int slicers = level_of_pixel(run.coverage, plan.levels.size());
    return std::min(of_lit(run.as_feature(), n), plan.levels.phi(slicers));
  };
  const auto of_layer = [&](const LayerRun& run, int n) {
    const LayerLight light = light_of_layer(plan, run, n, walk.after());
    const double at_window = run.coverage == 0 ? 0.0
                             : run.is_feature()
                                 ? light.wanted()
                                 : aim_of(run.coverage) / model.root_a_of(n) / light.returned(0.5);
    return std::clamp(light.phi(at_window), model.phi_min(), model.phi_max());
  };
  const auto light = [&](int n) { return phi[static_cast<std::size_t>(n)] * model.ratio(n); };
  for (std::size_t r = runs.size(); r-- > 0;) {
    const LayerRun& run = runs[r];
    held.clear();
    for (int n = run.end; n-- > run.first;) {
      walk.enter(n, plan.all_layers, light);
      phi[static_cast<std::size_t>(n)] =
          lifted && run.coverage != 0 ? of_lifted(run, n) : of_layer(run, n);
      walk.pass(n, light(n));
    }
  }
  return phi;
}

}  // namespace slicecorr::detail
