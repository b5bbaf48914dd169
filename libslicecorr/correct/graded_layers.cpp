// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Wanted doses layer by layer. A slice adds to its own layer alone what later slices do not bring, and
// the dose falls by a to the next layer up: y_n = phi_n + a y_(n+1) at the window of layer n, sqrt(a) y_n
// in its middle, where a dose is wanted. Layers of different heights have an a of their own each: that of
// the layer which light passes.

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
    const auto count = static_cast<int>(all_);
    // As if the last slice went on.
    brightest_.assign(all_ + 1, full(count) / one_minus_a(count));
    darkest_.assign(all_ + 1, held(count) * ratio(count) / one_minus_a(count));
    for (int n = count; n-- > 0;) {
      const auto at = static_cast<std::size_t>(n);
      brightest_[at] = full(n) + a(n + 1) * brightest_[at + 1];
      darkest_[at] = held(n) * ratio(n) + a(n + 1) * darkest_[at + 1];
    }
  }

  void solve(const GradedColumn& column, std::uint8_t* levels) override;

 private:
  /// A feature: layers [first, end).
  struct Run {
    int first, end;
    std::uint8_t height;  ///< edge height of its upper node, where a gap lies above it; else 0
    bool above_is_gap;
    bool free_above;  ///< what lies above it asks nothing: the platform, or what is left alone
  };
  /// Levels of the layers that make an edge above a gap, with lifts, and whether they may be lower.
  struct EdgeLevels {
    std::vector<std::uint8_t> highest, lowest;
  };

  double phi(int level) const { return plan_.levels.phi(level); }
  double ratio(int n) const { return plan_.model.ratio(n); }
  double a(int n) const { return plan_.model.a_of(n); }
  double one_minus_a(int n) const { return plan_.model.one_minus_a_of(n); }
  /// What full light counts for at least, where the bath ends.
  double full(int n) const { return plan_.model.steady(phi(plan_.levels.highest())) * ratio(n); }
  /// By how much light from the platform multiplies doses at `zeta` layers from it.
  double returned(double zeta) const { return plan_.model.returned(zeta); }
  /// Dose at the window of a layer whose far end gels.
  double gels_through(int n) const { return (1.0 + kMargin) / a(n) / returned(n); }
  LayerLight light_of(const Run& run, int n) const {
    const bool first = n == run.first;
    const double dark = first && n > 0 ? phi(0) * ratio(n - 1) : 0.0;
    return {plan_, ratio(n), after_, dark, first ? run.height : std::uint8_t{0}, n};
  }
  /// The least light of a layer that holds at its lift, at its own exposure; without lifts black.
  double held(int n) const {
    if (!lifted_) return phi(0);
    const LiftModel& lifts = *plan_.model.lifts;
    return phi(plan_.levels.at_least(lifts.green_strength * (1 + kMargin) / a(n) / ratio(n) /
                                     returned(n)));
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
  std::vector<double> cap_;  ///< without lifts: beyond it the edge above is passed
  /// Dose at a window where it and all slices after it show full light, or the least that holds.
  std::vector<double> brightest_, darkest_;
  double after_ = 0;             ///< what later slices leave at the window of the layer at hand
  double taken_ = 0;             ///< what was taken from it because it leaves the bath
  double over_ = 0, under_ = 0;  ///< the same of doses that are never too low, and never too high
};

/// From the upper end of a feature to its lower one.
void GradedLayers::bound(const Run& run, const std::uint8_t* doses) {
  // Without lifts the dose ends at the edge: what it may be at windows further away.
  double cap = kUnbounded;
  for (int n = run.first; n < run.end; ++n) {
    const auto at = static_cast<std::size_t>(n);
    const double wanted = scale_.dose[doses[n]] / plan_.model.root_a_of(n) / returned(n + 0.5);
    least_[at] = most_[at] = wanted;
    if (n == run.first) {
      if (!lifted_ && !run.free_above) {
        cap = run.above_is_gap ? light_of(run, n).wanted() : gels_through(n);
      }
    } else {
      // What can't be had above, more than all light or less than what holds, is not asked of this layer.
      const double held_above = held(n - 1) * ratio(n - 1);
      least_[at] =
          std::max(wanted, (std::min(least_[at - 1], brightest_[at - 1]) - full(n - 1)) / a(n));
      most_[at] = std::min(wanted, (std::max(most_[at - 1], darkest_[at - 1]) - held_above) / a(n));
      cap = (cap - phi(0) * ratio(n - 1)) / a(n);
    }
    cap_[at] = cap;
    // The far end of each layer gels.
    const double gels = std::min(cap, gels_through(n));
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
  const int past = run.first + layers;
  const double after = whole ? after_ : a(past) * brightest_[static_cast<std::size_t>(past)];
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
  const double left = a(n + 1), r = ratio(n);
  const double low = phi(lowest) * r - taken_, high = phi(highest) * r - taken_;
  if (n + 1 == run.end) over_ = under_ = after_ / left;
  const auto reached = [&](double dose, double below) {
    return std::clamp(dose, left * below + low, left * below + std::max(low, high));
  };
  over_ = reached(least_[at], over_);
  under_ = reached(most_[at], under_);
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

void GradedLayers::solve(const GradedColumn& column, std::uint8_t* levels) {
  const std::uint8_t* const heights = column.heights;
  std::fill(cover_.begin(), cover_.end(), std::uint8_t{0});
  const std::size_t layers = std::min(static_cast<std::size_t>(plan_.layers), all_);
  std::copy_n(column.coverage, layers, cover_.begin());
  const auto left_alone = [&](int n) {
    const bool is = column.left_alone && static_cast<std::size_t>(n) < layers;
    return is ? column.left_alone[n] : std::uint8_t{0};
  };
  for (std::size_t n = 0; n < layers; ++n) {
    if (left_alone(static_cast<int>(n)) != 0) cover_[n] = 0;
  }
  const int top = plan_.levels.highest();
  after_ = over_ = under_ = 0;
  std::optional<Run> run;
  EdgeLevels edge;
  for (int n = plan_.all_layers; n-- > 0;) {
    const auto at = static_cast<std::size_t>(n);
    const int beyond = n + plan_.model.bath_slices;
    const bool leaves = beyond > n && beyond < plan_.all_layers;
    taken_ = leaves ? plan_.model.beyond * phi(levels[beyond]) * ratio(beyond) : 0.0;
    after_ -= taken_;
    int level = 0;
    if (const std::uint8_t pixel = left_alone(n); pixel != 0) {
      run.reset();
      level = level_of_pixel(pixel, plan_.levels.size());
    } else if (cover_[at] != kFull) {
      run.reset();
      const std::uint8_t above = n > 0 ? cover_[at - 1] : std::uint8_t{1};
      const std::uint8_t height = heights && above == 0 ? heights[n] : std::uint8_t{0};
      const double dark = n > 0 ? phi(0) * ratio(n - 1) : 0.0;
      level = layer_level({plan_, ratio(n), after_, dark, height, n}, cover_[at]);
    } else {
      if (!run) {
        int first = n;
        const auto full = [&](int k) { return cover_[static_cast<std::size_t>(k)] == kFull; };
        while (first > 0 && full(first - 1)) --first;
        const bool free = first == 0 || left_alone(first - 1) != 0;
        const bool gap = !free && cover_[static_cast<std::size_t>(first) - 1] == 0;
        run = Run{first, n + 1, gap && heights ? heights[first] : std::uint8_t{0}, gap, free};
        edge = lifted_ && !free ? edge_levels(*run) : EdgeLevels{};
        bound(*run, column.doses);
      }
      const auto j = static_cast<std::size_t>(n - run->first);
      if (!lifted_) {
        const LayerLight light = light_of(*run, n);
        const int gels = level_to_node(light, 1.0 + kMargin);
        const bool free = !(cap_[at] < kUnbounded);
        const int most = free ? top : plan_.levels.at_most((cap_[at] - after_) / ratio(n));
        level = n == run->first && !run->free_above
                    ? layer_level(light, kFull)
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
    after_ = (phi(level) * ratio(n) + after_) * a(n);
  }
}

}  // namespace

std::unique_ptr<GradedColumns> make_graded_layers(const CorrectionPlan& plan,
                                                  const DoseScale& scale) {
  return std::make_unique<GradedLayers>(plan, scale);
}

}  // namespace slicecorr::detail
