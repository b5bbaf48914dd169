// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/gel_time_column.hpp"

#include <algorithm>
#include <cmath>

#include "correct/band_solvers.hpp"
#include "correct/column_band.hpp"
#include "correct/coverage.hpp"
#include "slicecorr/target.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::detail {

namespace {

/// Doses of nodes inside features: between nodes the dose may dip by a little where light changes, the
/// more the further it falls in a slice.
constexpr double kInside = 1.003;
/// Edges are aimed at no further from their nodes, in slices: beyond, the middle of a layer would give
/// way.
constexpr double kFarthest = 0.43;
/// Edges that are off by less, um, are right.
constexpr double kRightUm = 0.05;
/// With so many levels or more the last three slices before an edge place it; with fewer, more.
constexpr int kMany = 128;
/// By how many levels slices before an edge are moved to either side to place it.
constexpr int kMoves = 3;

}  // namespace

GelTimePlan::GelTimePlan(const CureModel& model, const Process& process, int target_layers,
                         int all_slices)
    : kernel(std::get<WithGelTime>(model.law).kernel),
      cut(*kernel),
      layers(target_layers),
      all_layers(all_slices),
      shortfall(std::min(process.gap_shortfall, kFarthest)) {
  if (!model.exposure_ratio.empty()) {
    for (int n = 0; n < all_layers; ++n) ratio.push_back(model.ratio(n));
  }
  highest = kernel->levels() - 1;
  while (highest > 0 && kernel->light(highest - 1).x == kernel->light(highest).x) --highest;
  burst = model.slices_to_gel() + 2;
  together = kernel->levels() >= kMany ? 3 : 5;
  // At the upper edge of a feature black light takes the dose down by about half of what light falls.
  const double slope = 0.5 * model.eta * units::kLn10 / model.layer_um;
  edge_dose = std::max(kRightUm, process.edge_aim_um) * slope;
}

ColumnFacts GelTimePlan::facts() const {
  // Edges are placed to a part of this.
  constexpr double height_steps = 64;
  return {layers, all_layers, kernel->layer_by_layer(), height_steps};
}

GelTimeColumn::GelTimeColumn(const GelTimePlan& plan) : plan_(plan) {
  const auto count = static_cast<std::size_t>(std::max(plan.all_layers, 0));
  levels_.resize(count);
  cover_.resize(static_cast<std::size_t>(std::max(plan.layers, 0)));
  below_.resize(static_cast<std::size_t>(std::max(plan.layers, plan.all_layers)) + 2);
  above_.resize(count);
  state_.resize(count + 1);
  light_.resize(count + 1);
}

void GelTimeColumn::read(const std::vector<CoverageRun>& runs) {
  std::fill(cover_.begin(), cover_.end(), std::uint8_t{0});
  std::fill(below_.begin(), below_.end(), 0.0);
  const auto farthest = [](std::uint8_t height) {
    return height != 0 ? std::clamp(edge_height_slices(height), -kFarthest, kFarthest) : 0.0;
  };
  for (const CoverageRun& run : runs) {
    std::fill(cover_.begin() + run.first, cover_.begin() + run.end, run.coverage);
    below_[static_cast<std::size_t>(run.first)] = farthest(run.upper_height);
    below_[static_cast<std::size_t>(run.end)] = farthest(run.lower_height);
  }
  int last = -1;
  for (int n = 0; n < plan_.all_layers; ++n) {
    if (cover(n) != 0) last = n;
    above_[static_cast<std::size_t>(n)] = last;
  }
}

void GelTimeColumn::set(int n, int level) {
  const auto at = static_cast<std::size_t>(n);
  levels_[at] = static_cast<Level>(level);
  light_[at] = plan_.light(n, level);
  state_[at] = plan_.cut.step(light_[at], state_[at + 1]);
}

double GelTimeColumn::dose(int layer, double up) const {
  return plan_.cut.dose(light_[static_cast<std::size_t>(layer)], plan_.kernel->fade(up),
                        Below{*this, layer}, hint_);
}
double GelTimeColumn::upper(int layer) const {
  return plan_.cut.dose(light_[static_cast<std::size_t>(layer)], plan_.cut.node(),
                        Below{*this, layer}, hint_);
}
double GelTimeColumn::middle(int layer) const {
  return plan_.cut.dose(light_[static_cast<std::size_t>(layer)], plan_.cut.middle(),
                        Below{*this, layer}, hint_);
}

double GelTimeColumn::at_upper_edge(int n) {
  const double below = edge_below(n);
  if (below >= 0) return dose(n, 1.0 - below);
  // In the layer above, a gap's, which gets black light.
  set(n - 1, 0);
  return dose(n - 1, -below);
}

double GelTimeColumn::lower_edge_up(int n) const {
  if (cover(n + 1) != 0) return 0.0;
  const double below = edge_below(n + 1);
  // A gap of one slice keeps dark, and the feature above it gives way.
  const bool slit = cover(n + 2) == kFull;
  return std::clamp(slit ? plan_.shortfall - below : -below, 0.0, kFarthest);
}

bool GelTimeColumn::prints(int n) const {
  if (middle(n) < 1.0 + kMargin) return false;
  const double up = lower_edge_up(n);
  if (up > 0 && dose(n, up) < 1.0 + kMargin) return false;
  if (edge_above(n)) return true;
  return upper(n) >= (cover(n - 1) == kFull ? kInside : 1.0 + kMargin);
}

template <typename Enough>
int GelTimeColumn::least_level(int n, int least, int guess, Enough enough) {
  int low = least, high = plan_.highest;
  const auto holds = [&](int level) {
    set(n, level);
    return enough();
  };
  // Levels settle: most often it is the one of the slice before, or one beside it.
  int at = std::clamp(guess, low, high), step = 1;
  if (low < high) {
    if (holds(at)) {
      high = at;
      while (high > low) {
        at = std::max(low, high - step);
        step *= 2;
        if (!holds(at)) {
          low = at + 1;
          break;
        }
        high = at;
      }
    } else {
      low = std::min(high, at + 1);
      while (low < high) {
        at = std::min(high, low + step - 1);
        step *= 2;
        if (holds(at)) {
          high = at;
          break;
        }
        low = std::min(high, at + 1);
      }
    }
  }
  while (low < high) {
    const int half = (low + high) / 2;
    if (holds(half)) {
      high = half;
    } else {
      low = half + 1;
    }
  }
  set(n, low);
  return low;
}

int GelTimeColumn::level_to_edge(int n, int least, int guess) {
  return least_level(n, least, guess, [&] { return at_upper_edge(n) >= 1.0 + kMargin; });
}

int GelTimeColumn::full_level(int n) {
  const int printing = least_level(n, 0, before_, [&] { return prints(n); });
  return edge_above(n) ? level_to_edge(n, printing, printing) : printing;
}

void GelTimeColumn::find_asks(int n) {
  asks_.clear();
  int u = above_[static_cast<std::size_t>(n)];
  for (bool grey = false; u >= 0 && cover(u) != 0; --u) {
    if (cover(u) == kFull) {
      const double inside = grey ? 0.5 : lower_edge_up(u);
      const double below = grey || inside > 0 ? 0.0 : std::max(0.0, edge_below(u + 1));
      const bool slit = !grey && cover(u + 2) == kFull;
      if (below > 0 && !slit) {
        asks_.push_back({u + 1, 1.0 - below, 1.0 + kMargin});
      } else {
        asks_.push_back({u, inside, 1.0 + kMargin});
      }
      return;
    }
    grey = true;
    asks_.push_back({u, 0.5, aim_of(static_cast<std::uint8_t>(cover(u)))});
  }
}

bool GelTimeColumn::can_do(int n) {
  int lit = n;
  for (const Ask& ask : asks_) {
    while (lit > ask.layer) set(--lit, plan_.highest);
    if (dose(ask.layer, ask.up) < ask.dose) return false;
  }
  return true;
}

int GelTimeColumn::gap_level(int n) {
  // What is further away can wait.
  const bool waits = asks_.empty() || n - asks_.front().layer > plan_.burst;
  const int level = waits ? 0 : least_level(n, 0, 0, [&] { return can_do(n); });
  set(n, level);
  return level;
}

int GelTimeColumn::grey_level(int n) {
  const double aim = aim_of(static_cast<std::uint8_t>(cover(n)));
  int level = least_level(n, 0, before_, [&] { return middle(n) >= aim; });
  const double over = middle(n);
  if (level > 0) {
    set(n, level - 1);
    if (over >= 1.0 || aim - middle(n) < over - aim) --level;
  }
  // The layers above it come first.
  asks_.clear();
  if (n > 0 && cover(n - 1) != 0) {
    find_asks(n - 1);
    if (asks_.front().layer == n - 1) asks_.front().up = std::max(asks_.front().up, 0.5);
  }
  if (!asks_.empty()) level = least_level(n, level, level, [&] { return can_do(n); });
  set(n, level);
  return level;
}

int GelTimeColumn::layerwise_level(int n) {
  const int c = cover(n);
  if (c == 0) return 0;
  if (c != kFull) {
    const double aim = aim_of(static_cast<std::uint8_t>(c));
    const int level = least_level(n, 0, before_, [&] { return middle(n) >= aim; });
    const double over = middle(n);
    if (level == 0) return level;
    set(n, level - 1);
    return over >= 1.0 || aim - middle(n) < over - aim ? level - 1 : level;
  }
  if (!edge_above(n) || edge_below(n) == 0) {
    return least_level(n, 0, before_, [&] { return upper(n) >= 1.0 + kMargin; });
  }
  const int printing = least_level(n, 0, before_, [&] { return middle(n) >= 1.0 + kMargin; });
  return level_to_edge(n, printing, printing);
}

int GelTimeColumn::level_of(int n) {
  if (plan_.kernel->layer_by_layer()) return layerwise_level(n);
  switch (cover(n)) {
    case 0:
      find_asks(n);
      return gap_level(n);
    case kFull:
      return full_level(n);
    default:
      return grey_level(n);
  }
}

/// Moves the levels of slices before the upper edge of layer n by a few, so that its dose comes
/// nearer to 1 than the last slice alone brings it.
void GelTimeColumn::place_edge(int n) {
  if (plan_.kernel->layer_by_layer() || cover(n) != kFull || !edge_above(n)) return;
  double least = at_upper_edge(n) - 1.0;
  if (least <= plan_.edge_dose) return;
  int last = n;
  while (last + 1 < n + plan_.together && cover(last + 1) == kFull) ++last;
  if (last == n) return;
  std::vector<Level> best(levels_.begin() + n, levels_.begin() + last + 1);
  const std::vector<Level> first = best;
  // From the second slice after the edge on: the nearer, the more it moves.
  const auto move = [&](auto&& self, int slice) -> bool {
    if (slice == n) {
      const int printing = least_level(n, 0, best.front(), [&] { return prints(n); });
      const int level = level_to_edge(n, printing, best.front());
      const double off = at_upper_edge(n) - 1.0;
      if (off >= 0 && off < least) {
        least = off;
        std::copy(levels_.begin() + n, levels_.begin() + last + 1, best.begin());
        best.front() = static_cast<Level>(level);
      }
      return least <= plan_.edge_dose;
    }
    const int at = first[static_cast<std::size_t>(slice - n)];
    for (int k = 0; k <= 2 * kMoves; ++k) {
      const int level = at + (k % 2 ? (k + 1) / 2 : -k / 2);
      if (level < 0 || level > plan_.highest) continue;
      set(slice, level);
      const bool fits = middle(slice) >= 1.0 + kMargin && upper(slice) >= 1.0 + kMargin;
      if (fits && self(self, slice - 1)) return true;
    }
    return false;
  };
  move(move, last);
  for (int slice = last; slice >= n; --slice) {
    set(slice, best[static_cast<std::size_t>(slice - n)]);
  }
}

const std::vector<Level>& GelTimeColumn::solve(const std::vector<CoverageRun>& runs,
                                               const ColumnBounds&) {
  read(runs);
  state_.back() = {};
  before_ = 0;
  for (int n = plan_.all_layers; n-- > 0;) {
    const int level = level_of(n);
    set(n, level);
    place_edge(n);
    before_ = levels_[static_cast<std::size_t>(n)];
  }
  return levels_;
}

std::unique_ptr<BandSolver> make_gel_time_solver(const CorrectionPlan& plan, std::size_t columns) {
  const GelTimePlan& p = *plan.gel_time;
  return std::make_unique<ColumnBand>(std::make_unique<GelTimeColumn>(p), p.facts(), columns);
}

std::vector<std::uint8_t> solve_gel_time_column(const CorrectionPlan& plan,
                                                const std::vector<std::uint8_t>& coverage,
                                                const std::vector<std::uint8_t>& heights) {
  GelTimeColumn column(*plan.gel_time);
  return solve_alone(column, plan.gel_time->facts(), coverage, heights);
}

}  // namespace slicecorr::detail
