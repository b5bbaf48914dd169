// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/tried_column.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "correct/coverage.hpp"
#include "correct/tried_doses.hpp"
#include "cure/own_exposure.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr::detail {

namespace {

/// Doses of nodes inside features: between nodes the dose may dip by a little where light changes, the
/// more the further it falls in a slice.
constexpr double kInside = 1.003;
/// The same between the eighths of a layer: a dip between these is a sixty-fourth of one between nodes.
constexpr double kBetween = 1.0005;
/// By how many levels slices before an edge are moved to either side to place it.
constexpr int kMoves = 3;

/// One column after the other; `Doses`: of the law.
template <typename Doses>
class TriedColumn final : public ColumnSolver {
 public:
  explicit TriedColumn(const TriedPlan& plan);
  const std::vector<Level>& solve(const std::vector<CoverageRun>& runs,
                                  const ColumnBounds& bounds) override;

 private:
  /// A place that is to have at least `dose`, the distance from the lower node of its layer in slices.
  struct Ask {
    int layer;
    double up, dose;
  };

  void read(const std::vector<CoverageRun>& runs, const std::vector<LeftAloneRun>& left_alone);
  /// The doses that nodes inside features are to have, layer by layer middles of layers.
  void read_wanted();
  void want(int first, int end);
  /// The dose beyond which black light alone leaves more than `dose` so many slices further up.
  double falls_to(double dose, double slices) const;
  double wanted(int n) const {
    return wanted_.empty() ? 0.0 : wanted_[static_cast<std::size_t>(n)];
  }
  int cover(int n) const {
    return n >= 0 && n < plan_.layers ? cover_[static_cast<std::size_t>(n)] : 0;
  }
  /// The level of a slice that is left alone; -1: it may be chosen.
  int given(int n) const {
    return n >= 0 && n < plan_.all_layers ? given_[static_cast<std::size_t>(n)] : -1;
  }
  bool left_alone(int n) const { return given(n) >= 0; }
  bool is_gap(int n) const { return cover(n) == 0 && !left_alone(n); }
  /// How far below its node an edge belongs, slices, no further than levels can bring it.
  double edge_below(int node) const { return below_[static_cast<std::size_t>(node)]; }
  /// What the layers above slice n ask of it: those of the next feature, and of greys before it.
  void find_asks(int n);

  void set(int n, int level);
  int floor(int n) const {
    return bounds_->floors.empty() ? 0 : bounds_->floors[static_cast<std::size_t>(n)];
  }
  int cap(int n) const {
    return bounds_->caps.empty()
               ? plan_.highest
               : std::min<int>(bounds_->caps[static_cast<std::size_t>(n)], plan_.highest);
  }
  double dose(int layer, double up) const { return doses_.dose(layer, up); }
  double upper(int layer) const { return doses_.upper(layer); }
  double middle(int layer) const { return doses_.middle(layer); }
  /// The dose where the upper edge of the feature belongs that begins with layer n.
  double at_upper_edge(int n);

  int level_of(int n);
  int full_level(int n);
  int gap_level(int n);
  /// At least `level`: what features give those beyond what is left alone, which leaves them too little.
  int level_through(int n, int level);
  int grey_level(int n);
  int layerwise_level(int n);
  /// With lifts: the least level of a slice whose own exposure holds its layer (docs/lifts.md).
  void find_holding();
  /// The same of a layer of a feature at hand, as far as it may shine; 0 without lifts. What stands on the
  /// platform keeps full light, where that stays in its column.
  int holding(int n) const {
    if (holding_.empty()) return 0;
    return n < stands_end_ && !plan_.careful ? cap(n) : least_holding(n);
  }
  int least_holding(int n) const {
    return std::min<int>(holding_[static_cast<std::size_t>(n)], cap(n));
  }
  /// With lifts: what a feature would get there, but no more than the slicer gave.
  int lifted_grey(int n) const {
    const bool stands = n < lit_from_platform_ && !plan_.careful;
    const int feature = stands ? cap(n) : least_holding(n);
    return std::max(
        floor(n),
        std::min(feature, level_of_pixel(static_cast<std::uint8_t>(cover(n)),
                                         static_cast<int>(plan_.model.level_phi.size()))));
  }
  /// Whether full light from slice n - 1 on can still do what is asked.
  bool can_do(int n);
  /// Whether the present slice has its layer of a feature printed.
  bool prints(int n) const;
  /// Whether the dose stays enough between the middle and the nodes of a layer, up to its edges.
  bool holds_between(int n) const;
  bool edge_above(int n) const { return n > 0 && is_gap(n - 1); }
  /// The least level from `least` on for which `enough`, which holds for all brighter ones; the highest
  /// where none does. `guess`: where to look first. Leaves that level set.
  template <typename Enough>
  int least_level(int n, int least, int guess, Enough enough);
  /// The least level from `least` on with which the upper edge of layer n does not lie inside the
  /// feature: there the dose is flat, and a little less of it would move the edge far.
  int level_to_edge(int n, int least, int guess);
  /// How far above its lower end the layer of a feature must print, slices; 0: where it begins.
  double lower_edge_up(int n) const;
  void place_edge(int n);

  const TriedPlan& plan_;
  const ColumnBounds* bounds_ = nullptr;  ///< of the column at hand
  Doses doses_;
  std::vector<Level> levels_;
  std::vector<std::uint8_t> cover_;
  std::vector<double> below_;
  std::vector<std::int16_t> given_;
  bool any_given_ = false;
  std::vector<double> wanted_;  ///< by layer; empty: just enough
  std::vector<Level> holding_;  ///< by slice; empty: nothing is lifted
  int stands_end_ = 0;          ///< layers of the feature that stands on the platform
  int lit_from_platform_ = 0;   ///< layers of what is lit without a gap from the platform on
  std::vector<int> above_;      ///< per slice: the last layer up to it that is not empty; -1: none
  std::vector<Ask> asks_;
  int before_ = 0;  ///< level of the slice that was solved last
};

template <typename Doses>
TriedColumn<Doses>::TriedColumn(const TriedPlan& plan) : plan_(plan), doses_(plan) {
  const auto count = static_cast<std::size_t>(std::max(plan.all_layers, 0));
  levels_.resize(count);
  cover_.resize(static_cast<std::size_t>(std::max(plan.layers, 0)));
  below_.resize(static_cast<std::size_t>(std::max(plan.layers, plan.all_layers)) + 2);
  above_.resize(count);
  given_.resize(count);
  if (plan.layerwise && plan.model.lifts) find_holding();
}

template <typename Doses>
void TriedColumn<Doses>::find_holding() {
  const CureModel& model = plan_.model;
  const double least = model.lifts->green_strength * (1 + plan_.margin());
  const GelTimeKernel* const kernel = model.gel_time();
  for (int n = 0; n < plan_.all_layers; ++n) {
    // Slices that get the same light and time are alike, but beside a platform that sends light back.
    const bool alike = n > model.mirrored_slices && model.ratio(n) == model.ratio(n - 1) &&
                       model.height(n) == model.height(n - 1) &&
                       (!kernel || kernel->root_share(n) == kernel->root_share(n - 1));
    if (alike) {
      holding_.push_back(holding_.back());
      continue;
    }
    int low = 0, high = plan_.highest;
    while (low < high) {
      const int level = (low + high) / 2;
      const double phi = model.level_phi[static_cast<std::size_t>(level)];
      if (own_exposure(model, n, phi).far >= least) {
        high = level;
      } else {
        low = level + 1;
      }
    }
    holding_.push_back(static_cast<Level>(low));
  }
}

template <typename Doses>
void TriedColumn<Doses>::read(const std::vector<CoverageRun>& runs,
                              const std::vector<LeftAloneRun>& left_alone) {
  std::fill(cover_.begin(), cover_.end(), std::uint8_t{0});
  std::fill(below_.begin(), below_.end(), 0.0);
  const auto farthest = [&](std::uint8_t height) {
    return height != 0 ? std::clamp(edge_height_slices(height), -plan_.farthest(), plan_.farthest())
                       : 0.0;
  };
  stands_end_ = lit_from_platform_ = 0;
  for (const CoverageRun& run : runs) {
    if (run.first == 0 && run.coverage == kFull) stands_end_ = run.end;
    if (run.first == lit_from_platform_) lit_from_platform_ = run.end;
    std::fill(cover_.begin() + run.first, cover_.begin() + run.end, run.coverage);
    below_[static_cast<std::size_t>(run.first)] = farthest(run.upper_height);
    below_[static_cast<std::size_t>(run.end)] = farthest(run.lower_height);
  }
  any_given_ = !left_alone.empty();
  std::fill(given_.begin(), given_.end(), std::int16_t{-1});
  for (const LeftAloneRun& run : left_alone) {
    std::fill(given_.begin() + run.first, given_.begin() + run.end, run.level);
  }
  int last = -1;
  for (int n = 0; n < plan_.all_layers; ++n) {
    if (cover(n) != 0) last = n;
    above_[static_cast<std::size_t>(n)] = last;
  }
}

template <typename Doses>
double TriedColumn<Doses>::falls_to(double dose, double slices) const {
  const CureModel& model = plan_.model;
  const double black = model.phi_min();
  // Layer by layer a black exposure comes after each layer.
  const double exposures = plan_.layerwise ? black * slices : 0.0;
  if (const BleachingLaw* const law = model.bleaching()) {
    const double gain = plan_.layerwise ? 0.0 : black * law->absorbed(1.0);
    return std::max(1.0, law->after(dose, -slices, gain) - exposures);
  }
  // No dose of a time to gel falls by less than the root of light.
  const double left = model.gel_time()->fade(slices).y;
  const double lit = plan_.layerwise ? 0.0 : black * (1 - left);
  return std::max(1.0, (dose - lit) / left - exposures);
}

template <typename Doses>
void TriedColumn<Doses>::read_wanted() {
  wanted_.clear();
  if (bounds_->wanted.empty()) return;
  wanted_.assign(cover_.size(), 0.0);
  for (int n = 0; n < plan_.layers; ++n) {
    if (cover(n) != kFull) continue;
    int end = n + 1;
    while (cover(end) == kFull) ++end;
    want(n, end);
    n = end;
  }
}

/// Of the feature of layers first .. end - 1, from the platform's side on.
template <typename Doses>
void TriedColumn<Doses>::want(int first, int end) {
  const auto layer = [&](int n) { return bounds_->wanted[static_cast<std::size_t>(n)]; };
  const CureModel& model = plan_.model;
  const bool free_above = first == 0 || left_alone(first - 1);
  double least_cap = std::numeric_limits<double>::infinity(), most = least_cap;
  for (int n = first; n < end; ++n) {
    // Continuous: of node n, between two layers.
    const bool beside = !plan_.layerwise && n > first;
    const double high = beside ? std::max(layer(n - 1), layer(n)) : layer(n),
                 low = beside ? std::min(layer(n - 1), layer(n)) : layer(n);
    if (!free_above) {
      // The upper edge comes first: what is further down leaves it no more than 1.
      const double half = plan_.layerwise ? 0.5 * model.height(n) : 0.0;
      least_cap = n == first ? 1.0 : falls_to(1.0, model.depth(n) - model.depth(first) + half);
    }
    if (n > first) {
      const double far =
          plan_.layerwise ? 0.5 * (model.height(n - 1) + model.height(n)) : model.height(n - 1);
      most = falls_to(most, far);
    }
    most = n == first ? low : std::min(low, most);
    const double at_least = std::min(high, least_cap), at_most = std::min(most, least_cap);
    wanted_[static_cast<std::size_t>(n)] = bounds_->side == DoseSide::at_least ? at_least
                                           : bounds_->side == DoseSide::at_most
                                               ? at_most
                                               : (at_least + at_most) / 2;
  }
}

template <typename Doses>
void TriedColumn<Doses>::set(int n, int level) {
  levels_[static_cast<std::size_t>(n)] = static_cast<Level>(level);
  doses_.set(n, level);
}

template <typename Doses>
double TriedColumn<Doses>::at_upper_edge(int n) {
  const double below = edge_below(n);
  if (below >= 0) return dose(n, 1.0 - below);
  // In the layer above, a gap's, which gets black light.
  set(n - 1, floor(n - 1));
  return dose(n - 1, -below);
}

template <typename Doses>
double TriedColumn<Doses>::lower_edge_up(int n) const {
  if (!is_gap(n + 1)) return 0.0;
  const double below = edge_below(n + 1);
  // A gap of one slice keeps dark, and the feature above it gives way.
  const bool slit = cover(n + 2) == kFull;
  return std::clamp(slit ? plan_.shortfall - below : -below, 0.0, plan_.farthest());
}

template <typename Doses>
bool TriedColumn<Doses>::holds_between(int n) const {
  // Without a time to gel the dose of a layer goes one way.
  if (plan_.layerwise || !plan_.model.gel_time()) return true;
  const double low = lower_edge_up(n);
  const bool edge = edge_above(n);
  const double high = edge ? 1.0 - std::max(0.0, edge_below(n)) : 1.0;
  const double enough = std::max(1.0 + plan_.margin(), edge ? 1.0 : kBetween);
  return std::ranges::all_of(std::array{0.125, 0.25, 0.375, 0.625, 0.75, 0.875}, [&](double up) {
    return up <= low || up >= high || dose(n, up) >= enough;
  });
}

template <typename Doses>
bool TriedColumn<Doses>::prints(int n) const {
  if (middle(n) < 1.0 + plan_.margin()) return false;
  const double up = lower_edge_up(n);
  if (up > 0 && dose(n, up) < 1.0 + plan_.margin()) return false;
  if (edge_above(n)) return holds_between(n);
  const double enough = std::max(1.0 + plan_.margin(), wanted(n));
  return upper(n) >= (cover(n - 1) == kFull ? std::max(kInside, enough) : enough) &&
         holds_between(n);
}

template <typename Doses>
template <typename Enough>
int TriedColumn<Doses>::least_level(int n, int least, int guess, Enough enough) {
  const int high_most = cap(n);
  int low = std::clamp(least, floor(n), high_most), high = high_most;
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

template <typename Doses>
int TriedColumn<Doses>::level_to_edge(int n, int least, int guess) {
  return least_level(n, least, guess, [&] { return at_upper_edge(n) >= 1.0 + plan_.margin(); });
}

template <typename Doses>
int TriedColumn<Doses>::full_level(int n) {
  const int printing = least_level(n, 0, before_, [&] { return prints(n); });
  return edge_above(n) ? level_to_edge(n, printing, printing) : printing;
}

template <typename Doses>
void TriedColumn<Doses>::find_asks(int n) {
  asks_.clear();
  int u = above_[static_cast<std::size_t>(n)];
  // To what is left alone below it a feature has no edge: its last layer is to print.
  const bool beside = u < n && left_alone(u + 1);
  for (bool grey = false; u >= 0 && cover(u) != 0; --u) {
    if (cover(u) == kFull) {
      const double inside = grey || beside ? 0.5 : lower_edge_up(u);
      const double below = inside > 0 ? 0.0 : std::max(0.0, edge_below(u + 1));
      const bool slit = !grey && cover(u + 2) == kFull;
      if (below > 0 && !slit) {
        asks_.push_back({u + 1, 1.0 - below, 1.0 + plan_.margin()});
      } else {
        asks_.push_back({u, inside, 1.0 + plan_.margin()});
      }
      return;
    }
    grey = true;
    asks_.push_back({u, 0.5, aim_of(static_cast<std::uint8_t>(cover(u)))});
  }
}

template <typename Doses>
bool TriedColumn<Doses>::can_do(int n) {
  int lit = n;
  for (const Ask& ask : asks_) {
    while (lit > ask.layer) {
      --lit;
      set(lit, left_alone(lit) ? given(lit) : cap(lit));
    }
    if (dose(ask.layer, ask.up) < ask.dose) return false;
  }
  return true;
}

template <typename Doses>
int TriedColumn<Doses>::gap_level(int n) {
  // What is further away can wait.
  const bool waits = asks_.empty() || n - asks_.front().layer > plan_.burst;
  int level = waits ? floor(n) : least_level(n, 0, 0, [&] { return can_do(n); });
  // What stands between may leave too little to come: then light here would only fill the gap.
  const bool between = !waits && std::any_of(given_.begin() + asks_.front().layer,
                                             given_.begin() + n, [](int at) { return at >= 0; });
  if (between && level == cap(n) && !can_do(n)) level = floor(n);
  set(n, level);
  return level;
}

template <typename Doses>
int TriedColumn<Doses>::level_through(int n, int level) {
  int first = n;
  while (first > 0 && n - first <= plan_.burst && cover(first - 1) == kFull) --first;
  if (!left_alone(first - 1)) return level;
  find_asks(first - 1);
  if (asks_.empty() || n - asks_.front().layer > plan_.burst) return level;
  const int more = least_level(n, level, level, [&] { return can_do(n); });
  return more == plan_.highest && !can_do(n) ? level : more;
}

template <typename Doses>
int TriedColumn<Doses>::grey_level(int n) {
  const double aim = aim_of(static_cast<std::uint8_t>(cover(n)));
  int level = least_level(n, 0, before_, [&] { return middle(n) >= aim; });
  const double over = middle(n);
  if (level > floor(n)) {
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

template <typename Doses>
int TriedColumn<Doses>::layerwise_level(int n) {
  const int c = cover(n);
  if (c == 0) return floor(n);
  if (c != kFull && !holding_.empty()) return lifted_grey(n);
  if (c != kFull) {
    const double aim = aim_of(static_cast<std::uint8_t>(c));
    const int level = least_level(n, 0, before_, [&] { return middle(n) >= aim; });
    const double over = middle(n);
    if (level == floor(n)) return level;
    set(n, level - 1);
    return over >= 1.0 || aim - middle(n) < over - aim ? level - 1 : level;
  }
  const int holds = holding(n);
  if (!edge_above(n) || edge_below(n) == 0) {
    // The dose of the first layer is its edge's.
    const double enough = edge_above(n) ? 0.0 : wanted(n);
    return least_level(n, holds, before_, [&] {
      return upper(n) >= 1.0 + plan_.margin() && (enough <= 1.0 || middle(n) >= enough);
    });
  }
  const int printing =
      least_level(n, holds, before_, [&] { return middle(n) >= 1.0 + plan_.margin(); });
  return level_to_edge(n, printing, printing);
}

template <typename Doses>
int TriedColumn<Doses>::level_of(int n) {
  if (plan_.layerwise) return layerwise_level(n);
  switch (cover(n)) {
    case 0:
      find_asks(n);
      return gap_level(n);
    case kFull:
      return any_given_ ? level_through(n, full_level(n)) : full_level(n);
    default:
      return grey_level(n);
  }
}

/// Moves the levels of slices before the upper edge of layer n by a few, so that its dose comes
/// nearer to 1 than the last slice alone brings it.
template <typename Doses>
void TriedColumn<Doses>::place_edge(int n) {
  if (plan_.layerwise || cover(n) != kFull || !edge_above(n)) return;
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
      if (level < floor(slice) || level > cap(slice)) continue;
      set(slice, level);
      const bool fits = middle(slice) >= 1.0 + plan_.margin() &&
                        upper(slice) >= 1.0 + plan_.margin() && holds_between(slice);
      if (fits && self(self, slice - 1)) return true;
    }
    return false;
  };
  move(move, last);
  for (int slice = last; slice >= n; --slice) {
    set(slice, best[static_cast<std::size_t>(slice - n)]);
  }
}

template <typename Doses>
const std::vector<Level>& TriedColumn<Doses>::solve(const std::vector<CoverageRun>& runs,
                                                    const ColumnBounds& bounds) {
  bounds_ = &bounds;
  read(runs, bounds.left_alone);
  read_wanted();
  doses_.clear();
  before_ = 0;
  for (int n = plan_.all_layers; n-- > 0;) {
    const int level = left_alone(n) ? given(n) : level_of(n);
    set(n, level);
    place_edge(n);
    before_ = levels_[static_cast<std::size_t>(n)];
  }
  return levels_;
}

}  // namespace

std::unique_ptr<ColumnSolver> make_tried_column(const TriedPlan& plan) {
  if (plan.model.bleaching()) {
    return std::make_unique<TriedColumn<SteppedDoses<BleachingSteps>>>(plan);
  }
  return std::make_unique<TriedColumn<GelTimeDoses>>(plan);
}

}  // namespace slicecorr::detail
