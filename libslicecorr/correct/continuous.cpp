#include <algorithm>
#include <bit>
#include <cstring>
#include <limits>
#include <span>
#include <type_traits>

#include "base/record_log.hpp"
#include "base/tile_tape.hpp"
#include "correct/band_solvers.hpp"
#include "correct/choose_level.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::detail {

namespace {

/// Rows of a tile's coverage that lie before its first slice: a node looks at three.
constexpr int kBefore = 3;
constexpr int kRows = kBefore + kTileSlices;

/// Kinds of voxels: without coverage, full under a full one, full under another, and grey.
enum Kind { kBlack, kInside, kTop, kGrey };

/// What the solve needs besides the plan, as plain numbers.
struct Numbers {
  explicit Numbers(const CorrectionPlan& plan);
  double dark, bright;  ///< what a slice of black or of full light adds to the node above it
  double edge = 1.0 + kMargin;
  std::uint8_t highest;
  int reach;
  std::vector<double> fall;  ///< capped
  /// From this distance to its upper edge on a feature may get full light for as long as it likes.
  int always_bright = std::numeric_limits<int>::max();
  bool platform_bright;
  /// A dose less than this below the falling curve falls along it with black light, down to the
  /// distance `always_falls`; from `capped` on the curve is not the cap of a feature.
  double close;
  int always_falls = std::numeric_limits<int>::max(), capped = 0;
};

Numbers::Numbers(const CorrectionPlan& plan)
    : dark(plan.model.phi_min() * plan.model.one_minus_a),
      bright(plan.model.phi_max() * plan.model.one_minus_a),
      highest(static_cast<std::uint8_t>(plan.levels.highest())),
      reach(static_cast<int>(plan.reach.size())),
      fall(plan.fall) {
  for (double& f : fall) f = std::min(f, plan.omega_max);
  // No dose gets above phi_max by more than rounding.
  const double most = plan.model.phi_max() * (1.0 + kMargin);
  const bool climbs = plan.model.phi_max() >= edge * (1.0 + kMargin);
  platform_bright = climbs && plan.platform_omega_max >= most;
  const int count = static_cast<int>(fall.size());
  const auto at = [&](int j) { return fall[static_cast<std::size_t>(j)]; };
  if (climbs && at(count - 1) >= most) {
    always_bright = count - 1;
    while (always_bright > 0 && at(always_bright - 1) >= most) --always_bright;
  }
  const double low = plan.model.phi_min();
  int next = 0;
  while (next + 1 < plan.levels.size() && plan.levels.phi(next) <= low) ++next;
  close = 0.99 * (plan.levels.phi(next) - low) * plan.model.one_minus_a;
  while (capped < count && plan.fall[static_cast<std::size_t>(capped)] <= plan.omega_max) ++capped;
  for (int j = 1; j < count; ++j) {
    // Light that is a level step short still leaves 1 here.
    if (at(j) - close < edge * (1.0 + kMargin)) continue;
    always_falls = j;
    break;
  }
}

/// Continuous exposure without UV light. Both passes go tile by tile. Most lanes of a tile are
/// quiet: they get the same light until their coverage changes or a known slice is reached, and are
/// stepped together; the others are decided one by one.
class ContinuousSolver final : public BandSolver {
 public:
  ContinuousSolver(const CorrectionPlan& plan, std::size_t columns)
      : plan_(plan),
        columns_(columns),
        blocks_((columns + kLanes - 1) / kLanes),
        // Rows whose distance is a multiple of a page would fall on the same lines of the cache.
        stride_((blocks_ | 1) * kLanes),
        rows_(stride_ * kRows, 0),
        demand_(stride_) {}

  void add_layer(const std::uint8_t* coverage) override;
  void solve(const BandCorrector::Sink& sink, const BandCorrector::TileSink& tiles) override;
  bool has_tiles() const override { return true; }

 private:
  /// A demand that a node replaced, to be put back when the solve has passed the node.
  struct Change {
    std::uint8_t row, lane;
    Demand was;
  };
  struct Lanes;
  /// Columns of a tile all of whose first `rows` rows are alike.
  struct Even {
    std::uint8_t level, cover;
    int rows;
    bool operator==(const Even&) const = default;
  };

  std::uint8_t* row(int k) { return rows_.data() + static_cast<std::size_t>(k) * stride_; }
  /// First pass over the `count` rows at hand.
  void forward(int count);
  void solve_tile(const Numbers& x, Lanes& lanes, int first_slice, int count,
                  const std::uint8_t* rows, std::uint8_t* out, std::span<const Change> changes);
  /// A tile whose coverage is all `cover`, in which no demand changes, if nothing else does: true,
  /// and its lanes are stepped; all of them get black light, or all full light.
  bool solve_still(const Numbers& x, Lanes& lanes, int first_slice, int count, std::uint8_t cover);

  const CorrectionPlan& plan_;
  std::size_t columns_, blocks_, stride_;
  int layers_ = 0, rows_at_hand_ = 0;
  std::vector<std::uint8_t> rows_;  ///< the last `kBefore` rows of the tiles before, then these
  std::vector<Demand> demand_;      ///< per column, as of the node reached
  TileTape tape_;                   ///< `kBefore` rows before each tile belong to it
  RecordLog<Change> changes_;       ///< a record per tile
};

/// 64 columns of the solve.
struct ContinuousSolver::Lanes {
  alignas(64) double omega[kLanes] = {};
  Demand demand[kLanes];
  /// Quiet lanes: their light is certain down to this slice. Of others any number above the slice
  /// that the solve has come to, or one that costs no more than a look.
  std::int32_t until[kLanes] = {};
  LaneMask quiet = 0, bright = 0;
  std::int32_t wake =
      std::numeric_limits<std::int32_t>::min();  ///< no quiet lane's `until` is above
  bool begun = false;
  std::uint8_t below2[kLanes] = {};  ///< coverage of the slice after the tile's last
};

void ContinuousSolver::add_layer(const std::uint8_t* coverage) {
  if (layers_ >= plan_.layers) throw Error("more layers than the plan has");
  ++layers_;
  std::uint8_t* const to = row(kBefore + rows_at_hand_);
  if (coverage) {
    std::memcpy(to, coverage, columns_);
  } else {
    std::memset(to, 0, columns_);
  }
  if (++rows_at_hand_ == kTileSlices) forward(kTileSlices);
}

void ContinuousSolver::forward(int count) {
  const int first = static_cast<int>(tape_.tiles() / blocks_) * kTileSlices;
  LaneMask steady[kRows], changed[kRows];
  for (std::size_t block = 0; block < blocks_; ++block) {
    const std::uint8_t* const head = rows_.data() + block * kLanes;
    // Of the rows after the first.
    tile_changes(head + stride_, stride_, kBefore + count - 1, steady, changed);
    tape_.append(head, stride_, kBefore + count, changed);
    Demand* const demand = &demand_[block * kLanes];
    for (int k = 0; k < count; ++k) {
      // In the middle of a feature or a gap nothing changes.
      LaneMask lanes = ~steady[kBefore - 1 + k];
      const std::uint8_t* const below = head + static_cast<std::size_t>(kBefore + k) * stride_;
      for (; lanes; lanes &= lanes - 1) {
        const int i = std::countr_zero(lanes);
        const Around c{0, below[i - 2 * static_cast<std::ptrdiff_t>(stride_)],
                       below[i - static_cast<std::ptrdiff_t>(stride_)], below[i], 0};
        const Demand next = next_demand(plan_, first + k, c, demand[i]);
        if (next == demand[i]) continue;
        changes_.push({static_cast<std::uint8_t>(k), static_cast<std::uint8_t>(i), demand[i]});
        demand[i] = next;
      }
    }
    changes_.end_record();
  }
  for (int k = 0; k < kBefore; ++k) std::memcpy(row(k), row(count + k), stride_);
  rows_at_hand_ = 0;
}

void ContinuousSolver::solve(const BandCorrector::Sink& sink,
                             const BandCorrector::TileSink& tiles) {
  const int all = plan_.all_layers;
  if (layers_ != plan_.layers) throw Error("the plan has more layers");
  if (all <= 0) return;
  for (int n = layers_; n < all; ++n) {
    std::memset(row(kBefore + rows_at_hand_), 0, stride_);
    if (++rows_at_hand_ == kTileSlices) forward(kTileSlices);
  }
  if (rows_at_hand_ > 0) forward(rows_at_hand_);
  rows_.clear();
  rows_.shrink_to_fit();

  const Numbers x(plan_);
  std::vector<Lanes> lanes(blocks_);
  for (std::size_t b = 0; b < blocks_; ++b) {
    std::copy_n(&demand_[b * kLanes], kLanes, lanes[b].demand);
  }
  std::vector<std::uint8_t> levels(stride_ * kTileSlices), covers(tiles ? 0 : levels.size());
  // What a tile's columns of `levels` and `covers` hold already, where they are even.
  std::vector<Even> held(blocks_, Even{0, 0, kTileSlices});
  constexpr std::size_t size = kTileSlices * kLanes;
  alignas(64) std::uint8_t tile_rows[kRows * kLanes], out[size];
  const std::vector<std::uint8_t> black(size, 0), full(size, kFull), bright(size, x.highest);
  for (int first = (all - 1) / kTileSlices * kTileSlices; first >= 0; first -= kTileSlices) {
    const int count = std::min(kTileSlices, all - first);
    std::uint64_t lit = 0;  // rows
    for (std::size_t b = 0; b < blocks_; ++b) {
      const std::size_t tile = static_cast<std::size_t>(first / kTileSlices) * blocks_ + b;
      const std::span<const Change> changes = changes_[tile];
      const TileTape::Even even = tape_.even(tile);
      const std::uint8_t* shown = out;
      const std::uint8_t* rows = tile_rows + kBefore * kLanes;
      if ((even.black || even.full) && changes.empty() &&
          solve_still(x, lanes[b], first, count, even.full ? kFull : 0)) {
        shown = lanes[b].bright ? bright.data() : black.data();
        rows = even.full ? full.data() : black.data();
        if (even.full || lanes[b].bright) lit = ~std::uint64_t{0};
        const Even holds{shown[0], rows[0], count};
        if (held[b] != holds) {
          for (int k = 0; k < count; ++k) {
            const std::size_t to = static_cast<std::size_t>(k) * stride_ + b * kLanes;
            std::memset(levels.data() + to, shown[0], kLanes);
            if (!tiles) std::memset(covers.data() + to, rows[0], kLanes);
          }
          held[b] = holds;
        }
      } else {
        if (!tape_.read(tile, kBefore + count, tile_rows)) {
          std::memset(tile_rows, 0, static_cast<std::size_t>(kBefore + count) * kLanes);
        }
        solve_tile(x, lanes[b], first, count, rows, out, changes);
        held[b].rows = 0;
        for (int k = 0; k < count; ++k) {
          const std::size_t at = static_cast<std::size_t>(k) * kLanes;
          const std::size_t to = static_cast<std::size_t>(k) * stride_ + b * kLanes;
          std::uint64_t any = 0;
          for (std::size_t i = 0; i < kLanes; i += 8) {
            std::uint64_t light, design;
            std::memcpy(&light, out + at + i, 8);
            std::memcpy(&design, rows + at + i, 8);
            any |= light | design;
          }
          lit |= static_cast<std::uint64_t>(any != 0) << k;
          std::memcpy(levels.data() + to, out + at, kLanes);
          if (!tiles) std::memcpy(covers.data() + to, rows + at, kLanes);
        }
      }
      if (tiles) {
        tiles({b * kLanes, std::min(kLanes, columns_ - b * kLanes), first, count, shown, rows});
      }
    }
    // What the sinks keep of these slices takes the place of what is known of them.
    tape_.drop_from(static_cast<std::size_t>(first / kTileSlices) * blocks_);
    changes_.drop_from(tape_.tiles());
    for (int k = count; k-- > 0;) {
      const std::size_t at = static_cast<std::size_t>(k) * stride_;
      sink(first + k, levels.data() + at, tiles ? nullptr : covers.data() + at, !(lit >> k & 1));
    }
  }
}

void ContinuousSolver::solve_tile(const Numbers& x, Lanes& lanes, int first_slice, int count,
                                  const std::uint8_t* rows, std::uint8_t* out,
                                  std::span<const Change> changes) {
  const CureModel& model = plan_.model;
  const double a = model.a;
  LaneMask steady[kTileSlices], changed[kTileSlices];
  tile_changes(rows, kLanes, count, steady, changed);
  LaneMask before_steady, before_changed;
  tile_changes(rows - kLanes, kLanes, 1, &before_steady, &before_changed);
  LaneMask zero[kTileSlices], full[kTileSlices], before_zero, before_full;
  tile_classes(rows, kLanes, count, zero, full);
  tile_classes(rows - kLanes, kLanes, 1, &before_zero, &before_full);
  const auto row = [&](int k) { return rows + static_cast<std::ptrdiff_t>(k) * kLanes; };

  alignas(64) double omega[2][kLanes];
  alignas(64) double add[kLanes];
  alignas(64) std::uint8_t light[kLanes];
  copy_lanes(lanes.omega, omega[0]);
  std::fill_n(add, kLanes, x.dark);
  std::memset(light, 0, kLanes);
  for (LaneMask m = lanes.bright; m; m &= m - 1) {
    const int i = std::countr_zero(m);
    add[i] = x.bright;
    light[i] = x.highest;
  }
  LaneMask quiet = lanes.quiet;
  int now = 0;
  // The last slice that needs a look at `until`: not above the greatest of quiet lanes.
  int wake = lanes.wake;

  // What is certain of a lane from slice n = first_slice + k upwards, `w` being its dose below.
  const auto settle = [&](int i, int k, double w) {
    const LaneMask bit = LaneMask{1} << i;
    const std::uint8_t below = row(k)[i], above = row(k - 1)[i];
    quiet &= ~bit;
    if (below != above) return;
    const int n = first_slice + k;
    const int node = lanes.demand[i].node;
    bool shine = false;
    int until;
    if (below == 0) {
      until = node + x.reach;
    } else if (below == kFull && w >= x.edge) {
      if (node == 0) {
        if (!x.platform_bright) return;
        until = std::numeric_limits<int>::min();
        shine = true;
      } else if (n - node >= x.always_bright) {
        until = node + x.always_bright;
        shine = true;
      } else if (n - node >= x.always_falls && n - node < x.capped) {
        const double darkest = x.dark + a * w;
        if (!(darkest >= x.edge &&
              x.fall[static_cast<std::size_t>(n - node)] - darkest < x.close)) {
          return;
        }
        until = node + x.always_falls;
      } else {
        return;
      }
    } else {
      return;
    }
    if (n < until) return;
    quiet |= bit;
    lanes.until[i] = until;
    wake = std::max(wake, until);
    add[i] = shine ? x.bright : x.dark;
    light[i] = shine ? x.highest : 0;
    lanes.bright = shine ? lanes.bright | bit : lanes.bright & ~bit;
  };
  if (!lanes.begun) {
    lanes.begun = true;
    for (int i = 0; i < static_cast<int>(kLanes); ++i) settle(i, count - 1, 0.0);
  }

  std::size_t left = changes.size();
  for (int k = count; k-- > 0;) {
    const int n = first_slice + k;
    if (n < wake) quiet &= ~later_lanes(lanes.until, n, &wake);
    std::uint8_t* const shown = out + static_cast<std::size_t>(k) * kLanes;
    std::memcpy(shown, light, kLanes);
    LaneMask active = ~quiet | ~steady[k];
    if (active == 0) {
      int more = 0;
      while (k > 0 && n - more - 1 >= wake && steady[k - 1] == ~LaneMask{0}) {
        ++more;
        --k;
        std::memcpy(out + static_cast<std::size_t>(k) * kLanes, light, kLanes);
      }
      step_lanes(add, a, omega[now], 1 + more);
      continue;
    }
    const double* const from = omega[now];
    double* const to = omega[1 - now];
    step_lanes(add, a, from, to);
    now = 1 - now;
    const std::uint8_t* const below2 = k + 1 < count ? row(k + 1) : lanes.below2;
    // Kinds of voxels one after the other: each has its own way through goal_at(), which the
    // processor then foresees.
    const auto decide = [&](LaneMask m, auto kind) {
      for (; m; m &= m - 1) {
        const int i = std::countr_zero(m);
        const double w = from[i];
        const Demand demand = lanes.demand[i];
        Around c{row(k - 3)[i], row(k - 2)[i], row(k - 1)[i], row(k)[i], below2[i]};
        if constexpr (kind.value != kGrey) c.below = kind.value == kBlack ? 0 : kFull;
        if constexpr (kind.value == kInside) c.above = kFull;
        // The commonest cases of goal_at(), decided without it.
        if (kind.value == kBlack && c.above != kFull && demand.node + x.reach <= n &&
            (c.above == 0 || demand.node != n)) {
          shown[i] = 0;
          to[i] = x.dark + a * w;
          continue;
        }
        if ((kind.value == kInside || kind.value == kTop) && c.above != 0 && w >= x.edge) {
          const double aim = demand.node == 0 ? plan_.platform_omega_max
                                              : x.fall[static_cast<std::size_t>(n - demand.node)];
          const double brightest = x.bright + a * w;
          if (aim >= brightest) {
            shown[i] = x.highest;
            to[i] = brightest;
            continue;
          }
          const double darkest = x.dark + a * w;
          if (aim <= darkest && darkest >= x.edge) {
            shown[i] = 0;
            to[i] = darkest;
            continue;
          }
        }
        const int level = choose_level(plan_, goal_at(plan_, n, c, demand, w, x.edge), w);
        shown[i] = static_cast<std::uint8_t>(level);
        to[i] = model.step(plan_.levels.phi(level), w);
      }
    };
    const LaneMask above_full = k > 0 ? full[k - 1] : before_full;
    decide(active & zero[k], std::integral_constant<int, kBlack>());
    decide(active & full[k] & above_full, std::integral_constant<int, kInside>());
    decide(active & full[k] & ~above_full, std::integral_constant<int, kTop>());
    decide(active & ~zero[k] & ~full[k], std::integral_constant<int, kGrey>());
    for (; left > 0 && changes[left - 1].row == k; --left) {
      lanes.demand[changes[left - 1].lane] = changes[left - 1].was;
    }
    // Only of lanes whose next slice is like the one above it anything is certain.
    const int next = k - 1;
    quiet &= ~active;
    for (LaneMask m = active & (k > 0 ? steady[k - 1] : before_steady); m; m &= m - 1) {
      const int i = std::countr_zero(m);
      settle(i, next, to[i]);
    }
  }
  copy_lanes(omega[now], lanes.omega);
  std::memcpy(lanes.below2, row(0), kLanes);
  lanes.quiet = quiet;
  lanes.wake = wake;
}

bool ContinuousSolver::solve_still(const Numbers& x, Lanes& lanes, int first_slice, int count,
                                   std::uint8_t cover) {
  if (lanes.quiet != ~LaneMask{0} || lanes.wake > first_slice) return false;
  if (lanes.bright != 0 && lanes.bright != ~LaneMask{0}) return false;
  // The slice after the tile's last was solved before: its coverage may be another.
  if (std::any_of(lanes.below2, lanes.below2 + kLanes, [&](auto c) { return c != cover; })) {
    return false;
  }
  alignas(64) double add[kLanes];
  std::fill_n(add, kLanes, lanes.bright ? x.bright : x.dark);
  step_lanes(add, plan_.model.a, lanes.omega, count);
  return true;
}

}  // namespace

std::unique_ptr<BandSolver> make_continuous_solver(const CorrectionPlan& plan,
                                                   std::size_t columns) {
  return std::make_unique<ContinuousSolver>(plan, columns);
}

}  // namespace slicecorr::detail
