// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Wanted doses layer by layer. A slice adds to its own layer alone what later slices do not bring, and
// the dose falls by a to the next layer up: y_n = phi_n + a y_(n+1) at the window of layer n, sqrt(a) y_n
// in its middle, where a dose is wanted.

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include "correct/coverage.hpp"
#include "correct/graded_columns.hpp"
#include "correct/layer_level.hpp"
#include "correct/lifted_feature.hpp"
#include "cure/margin.hpp"

namespace slicecorr::detail {

namespace {

constexpr double kUnbounded = std::numeric_limits<double>::infinity();

class GradedLayers final : public GradedColumns {
 public:
  GradedLayers(const CorrectionPlan& plan, const DoseScale& scale)
      : plan_(plan),
        scale_(scale),
        all_(static_cast<std::size_t>(std::max(plan.all_layers, 0))),
        cover_(all_),
        least_(all_),
        most_(all_),
        cap_(all_, kUnbounded) {
    if (plan.model.lifts) lifted_.emplace(plan.model, &plan.levels, plan.most_exchange);
  }

  void solve(const std::uint8_t* coverage, const std::uint8_t* heights, const std::uint8_t* doses,
             std::uint8_t* levels) override;

 private:
  /// A feature: layers [first, end).
  struct Run {
    int first, end;
    std::uint8_t height;  ///< edge height of its upper node, where a gap lies above it; else 0
    bool above_is_gap;
  };
  /// Levels of the layers that make an edge above a gap, with lifts, and whether they may be lower.
  struct EdgeLevels {
    std::vector<std::uint8_t> highest, lowest;
  };

  double phi(int level) const { return plan_.levels.phi(level); }
  double ratio(int n) const { return plan_.model.ratio(n); }
  LayerLight light_of(const Run& run, int n) const {
    const bool first = n == run.first;
    const double dark = first && n > 0 ? phi(0) * ratio(n - 1) : 0.0;
    return {plan_, ratio(n), after_, dark, first ? run.height : std::uint8_t{0}, n};
  }
  /// The least light of a layer that holds at its lift, at its own exposure; without lifts black.
  double held(int n) const {
    if (!lifted_) return phi(0);
    const LiftModel& lifts = *plan_.model.lifts;
    return phi(
        plan_.levels.at_least(lifts.green_strength * (1 + kMargin) / plan_.model.a / ratio(n)));
  }
  void bound(const Run& run, const std::uint8_t* doses);
  EdgeLevels edge_levels(const Run& run) const;
  int level_inside(const Run& run, int n, int lowest, int highest);

  const CorrectionPlan& plan_;
  const DoseScale& scale_;
  std::optional<LiftedFeature> lifted_;
  std::size_t all_;
  std::vector<std::uint8_t> cover_;
  /// Doses at windows: below `least_` some layer above gets too little, above `most_` too much.
  std::vector<double> least_, most_;
  std::vector<double> cap_;      ///< without lifts: beyond it the edge above is passed
  double after_ = 0;             ///< what later slices leave at the window of the layer at hand
  double over_ = 0, under_ = 0;  ///< the same of doses that are never too low, and never too high
};

/// From the upper end of a feature to its lower one.
void GradedLayers::bound(const Run& run, const std::uint8_t* doses) {
  const double a = plan_.model.a;
  const double sum = 1 / plan_.model.one_minus_a;
  // Without lifts the dose ends at the edge: what it may be at windows further away.
  double cap = kUnbounded;
  for (int n = run.first; n < run.end; ++n) {
    const auto at = static_cast<std::size_t>(n);
    const double wanted = scale_.dose[doses[n]] / plan_.model.root_a;
    least_[at] = most_[at] = wanted;
    if (n == run.first) {
      if (!lifted_ && run.first > 0) {
        cap = run.above_is_gap ? light_of(run, n).wanted() : (1.0 + kMargin) / a;
      }
    } else {
      // What can't be had above, more than all light or less than what holds, is not asked of this layer.
      const double full = phi(plan_.levels.highest()) * ratio(n - 1),
                   held_above = held(n - 1) * ratio(n - 1);
      least_[at] = std::max(wanted, (std::min(least_[at - 1], full * sum) - full) / a);
      most_[at] = std::min(wanted, (std::max(most_[at - 1], held_above * sum) - held_above) / a);
      cap = (cap - phi(0) * ratio(n - 1)) / a;
    }
    cap_[at] = cap;
    // The far end of each layer gels.
    const double gels = std::min(cap, (1.0 + kMargin) / a);
    least_[at] = std::clamp(least_[at], gels, cap);
    most_[at] = std::clamp(most_[at], gels, cap);
  }
}

/// With lifts and a gap above: the first layers are as their edge needs them. Where it is put to its
/// place they stay so; where every layer holds they may have less, down to what holds.
GradedLayers::EdgeLevels GradedLayers::edge_levels(const Run& run) const {
  const int layers = std::min(run.end - run.first, lifted_->reach());
  const double below = run.height == 0 ? 0.0 : edge_height_slices(run.height);
  const bool whole = layers == run.end - run.first;
  const double full = phi(plan_.levels.highest()) * ratio(run.first + layers - 1);
  const double after = whole ? after_ : full * plan_.model.a / plan_.model.one_minus_a;
  const LiftedFeature::Light light = lifted_->solve({run.first, layers, after, below});
  EdgeLevels edge;
  for (const double p : light.phi) {
    edge.highest.push_back(static_cast<std::uint8_t>(plan_.levels.at_least(p)));
  }
  // From the last layer that the edge holds back on, light may be as doses want it; a film is the edge's.
  const std::size_t least = light.liquid > 0 ? static_cast<std::size_t>(light.liquid) + 1 : 0;
  while (edge.highest.size() > least && edge.highest.back() >= plan_.levels.highest()) {
    edge.highest.pop_back();
  }
  return edge;
}

int GradedLayers::level_inside(const Run& run, int n, int lowest, int highest) {
  const auto at = static_cast<std::size_t>(n);
  const double a = plan_.model.a, r = ratio(n);
  const double low = phi(lowest) * r, high = phi(highest) * r;
  if (n + 1 == run.end) over_ = under_ = after_ / a;
  over_ = std::clamp(least_[at], a * over_ + low, std::max(a * over_ + low, a * over_ + high));
  under_ = std::clamp(most_[at], a * under_ + low, std::max(a * under_ + low, a * under_ + high));
  const auto light = [&](double dose) { return (dose - after_) / r; };
  int level = 0;
  switch (scale_.side) {
    case DoseSide::nearest: {
      const double wanted = light((over_ + under_) / 2);
      const auto around = plan_.levels.around(wanted);
      level = phi(around.at_least) - wanted < wanted - phi(around.at_most) ? around.at_least
                                                                           : around.at_most;
      break;
    }
    case DoseSide::at_least:
      level = plan_.levels.at_least(light(least_[at]) * (1 - 1e-12));
      break;
    case DoseSide::at_most:
      level = plan_.levels.at_most(light(most_[at]) * (1 + 1e-12));
      break;
  }
  return std::clamp(level, lowest, std::max(lowest, highest));
}

void GradedLayers::solve(const std::uint8_t* coverage, const std::uint8_t* heights,
                         const std::uint8_t* doses, std::uint8_t* levels) {
  std::fill(cover_.begin(), cover_.end(), std::uint8_t{0});
  std::copy_n(coverage, std::min(static_cast<std::size_t>(plan_.layers), all_), cover_.begin());
  const double a = plan_.model.a;
  const int top = plan_.levels.highest();
  after_ = over_ = under_ = 0;
  std::optional<Run> run;
  EdgeLevels edge;
  for (int n = plan_.all_layers; n-- > 0;) {
    const auto at = static_cast<std::size_t>(n);
    int level = 0;
    if (cover_[at] != kFull) {
      run.reset();
      const std::uint8_t above = n > 0 ? cover_[at - 1] : std::uint8_t{1};
      const std::uint8_t height = heights && above == 0 ? heights[n] : std::uint8_t{0};
      const double dark = n > 0 ? phi(0) * ratio(n - 1) : 0.0;
      level = layer_level({plan_, ratio(n), after_, dark, height, n}, cover_[at]);
    } else {
      if (!run) {
        int first = n;
        while (first > 0 && cover_[static_cast<std::size_t>(first) - 1] == kFull) --first;
        const bool gap = first > 0 && cover_[static_cast<std::size_t>(first) - 1] == 0;
        run = Run{first, n + 1, gap && heights ? heights[first] : std::uint8_t{0}, gap};
        edge = lifted_ && first > 0 ? edge_levels(*run) : EdgeLevels{};
        bound(*run, doses);
      }
      const auto j = static_cast<std::size_t>(n - run->first);
      if (!lifted_) {
        const LayerLight light = light_of(*run, n);
        const int gels = level_to_node(light, 1.0 + kMargin);
        const bool free = !(cap_[at] < kUnbounded);
        const int most = free ? top : plan_.levels.at_most((cap_[at] - after_) / ratio(n));
        level = n == run->first && n > 0 ? layer_level(light, kFull)
                                         : level_inside(*run, n, gels, std::max(gels, most));
      } else {
        const int holds = plan_.levels.at_least(held(n));
        if (j + 1 == edge.highest.size()) {
          // With the dose that comes from below now.
          const double below = run->height == 0 ? 0.0 : edge_height_slices(run->height);
          const LiftedFeature::Ask ask{run->first, n - run->first + 1, after_, below};
          const auto light = lifted_->solve(ask);
          const auto least = lifted_->least_light(ask);
          edge.lowest.clear();
          for (std::size_t k = 0; k < light.phi.size(); ++k) {
            edge.highest[k] = static_cast<std::uint8_t>(plan_.levels.at_least(light.phi[k]));
            edge.lowest.push_back(least.empty()
                                      ? edge.highest[k]
                                      : static_cast<std::uint8_t>(plan_.levels.at_least(least[k])));
          }
        }
        level = j < edge.highest.size() ? level_inside(*run, n, edge.lowest[j], edge.highest[j])
                                        : level_inside(*run, n, holds, top);
      }
    }
    levels[n] = static_cast<std::uint8_t>(level);
    after_ = (phi(level) * ratio(n) + after_) * a;
  }
}

}  // namespace

std::unique_ptr<GradedColumns> make_graded_layers(const CorrectionPlan& plan,
                                                  const DoseScale& scale) {
  return std::make_unique<GradedLayers>(plan, scale);
}

}  // namespace slicecorr::detail
