#include <algorithm>
#include <bit>
#include <cstring>
#include <limits>
#include <span>

#include "base/coded_tiles.hpp"
#include "base/record_log.hpp"
#include "correct/band_solvers.hpp"
#include "correct/level_search.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::detail {

namespace {

/// Rows that are kept at once: those of a tile, and the one before them.
constexpr int kRows = 1 + kTileSlices;

/// The upper end of a column's run: its edge in Edges, and its node.
struct Upper {
  std::int32_t edge = 0, node = 0;
  bool operator==(const Upper&) const = default;
};

/// Continuous exposure without UV light. Both passes go tile by tile. Most lanes of a tile are
/// quiet: they get the same light until a known slice is reached, and are stepped together; the
/// others are decided one by one.
class ContinuousSolver final : public BandSolver {
 public:
  ContinuousSolver(const CorrectionPlan& plan, std::size_t columns)
      : plan_(plan),
        shared_(*plan.continuous),
        edges_(shared_),
        search_(edges_),
        columns_(columns),
        blocks_((columns + kLanes - 1) / kLanes),
        // An odd number of blocks: rows whose distance is a multiple of a page would compete for
        // the same lines of the cache.
        stride_((blocks_ | 1) * kLanes),
        rows_(stride_ * kRows, 0),
        upper_(stride_, Upper{edges_.platform(0), 0}),
        before_(shared_.merge ? stride_ : 0) {}

  void add_layer(const std::uint8_t* coverage) override;
  void solve(const BandCorrector::Sink& sink, const BandCorrector::TileSink& tiles) override;
  bool has_tiles() const override { return true; }

 private:
  /// An edge that the first pass met in a lane, before row `row` of the tile. `was`: the upper end
  /// of the run above the edge, to which the lane returns when the solve has passed the edge.
  struct Change {
    std::uint8_t row, lane;
    Upper was;
  };
  struct Lanes;
  /// What the first `rows` rows of a block hold, where all of their bytes are the same.
  struct Even {
    std::uint8_t level, cover;
    int rows;
    bool operator==(const Even&) const = default;
  };

  std::uint8_t* row(int k) { return rows_.data() + static_cast<std::size_t>(k) * stride_; }
  /// First pass over the `count` rows that are kept.
  void forward(int count);
  void solve_tile(Lanes& lanes, int first_slice, int count, std::uint8_t* out,
                  std::span<const Change> changes);
  /// Steps a whole tile at once if no lane needs a decision in it and all of them get black light,
  /// or all of them full light. False: nothing was done.
  bool solve_still(Lanes& lanes, int first_slice, int count);

  const CorrectionPlan& plan_;
  const ContinuousPlan& shared_;
  Edges edges_;
  LevelSearch search_;
  std::size_t columns_, blocks_, stride_;
  int layers_ = 0, rows_at_hand_ = 0;
  std::vector<std::uint8_t> rows_;
  std::vector<Upper> upper_;   ///< per column, of the run that the pass has come to
  std::vector<Upper> before_;  ///< the same of the run above it; only where gaps may be merged
  CodedTiles coded_;
  RecordLog<Change> changes_;  ///< a record per tile
};

/// 64 columns of the solve.
struct ContinuousSolver::Lanes {
  alignas(64) double omega[kLanes] = {};
  RunAt run[kLanes];
  /// Of quiet lanes: the lowest slice whose light is certain. Of other lanes it has no meaning.
  std::int32_t until[kLanes] = {};
  LaneMask quiet = 0, bright = 0;
  /// Lanes for which levels of the next slices are chosen already: `count` were chosen, `left` of
  /// them are still to be used. `levels` holds them by index of the plan's levels.
  LaneMask chosen = 0;
  std::uint8_t left[kLanes] = {}, count[kLanes] = {};
  std::uint8_t levels[kLanes][LevelSearch::kMost];
  std::int32_t wake =
      std::numeric_limits<std::int32_t>::min();  ///< at least the greatest `until` of quiet lanes
  bool begun = false;
};

void ContinuousSolver::add_layer(const std::uint8_t* coverage) {
  if (layers_ >= plan_.layers) throw Error("more layers than the plan has");
  ++layers_;
  std::uint8_t* const to = row(1 + rows_at_hand_);
  if (coverage) {
    std::memcpy(to, coverage, columns_);
  } else {
    std::memset(to, 0, columns_);
  }
  if (++rows_at_hand_ == kTileSlices) forward(kTileSlices);
}

void ContinuousSolver::forward(int count) {
  const int first = static_cast<int>(coded_.tiles() / blocks_) * kTileSlices;
  LaneMask steady[kTileSlices], changed[kTileSlices];
  for (std::size_t block = 0; block < blocks_; ++block) {
    const std::uint8_t* const head = rows_.data() + stride_ + block * kLanes;
    tile_changes(head, stride_, count, steady, changed);
    coded_.append(head, stride_, count, changed + 1);
    for (int k = 0; k < count; ++k) {
      const int n = first + k;
      const std::uint8_t* const below = head + static_cast<std::size_t>(k) * stride_;
      for (LaneMask lanes = changed[k]; lanes; lanes &= lanes - 1) {
        const int i = std::countr_zero(lanes);
        Upper& upper = upper_[block * kLanes + static_cast<std::size_t>(i)];
        if (n == 0) {
          upper.edge = edges_.platform(below[i]);
          continue;
        }
        const Upper was = upper;
        if (shared_.merge) {
          const Edge& edge = edges_[was.edge];
          Upper& before = before_[block * kLanes + static_cast<std::size_t>(i)];
          if (below[i] == kFull && was.node == n - 1 && edge.below == 0 &&
              edge.above_cover == kFull) {
            // A gap that is merged: the feature above it goes on. What was noted at the gap's upper
            // end leads to the same run.
            upper = before;
            continue;
          }
          before = was;
        }
        upper = {edges_.next(was.edge, n - was.node, below[i]), n};
        changes_.push({static_cast<std::uint8_t>(k), static_cast<std::uint8_t>(i), was});
      }
    }
    changes_.end_record();
  }
  std::memcpy(row(0), row(count), stride_);
  rows_at_hand_ = 0;
}

void ContinuousSolver::solve(const BandCorrector::Sink& sink,
                             const BandCorrector::TileSink& tiles) {
  const int all = plan_.all_layers;
  if (layers_ != plan_.layers) throw Error("the plan has more layers");
  if (all <= 0) return;
  for (int n = layers_; n < all; ++n) {
    std::memset(row(1 + rows_at_hand_), 0, stride_);
    if (++rows_at_hand_ == kTileSlices) forward(kTileSlices);
  }
  if (rows_at_hand_ > 0) forward(rows_at_hand_);
  rows_.clear();
  rows_.shrink_to_fit();

  std::vector<Lanes> lanes(blocks_);
  for (std::size_t b = 0; b < blocks_; ++b) {
    for (std::size_t i = 0; i < kLanes; ++i) {
      const Upper upper = upper_[b * kLanes + i];
      lanes[b].run[i] = {upper.edge, upper.node, all, 0, false};
    }
  }
  const std::uint8_t highest = shared_.level_of.back();
  std::vector<std::uint8_t> levels(stride_ * kTileSlices), covers(tiles ? 0 : levels.size());
  // What a tile's columns of `levels` and `covers` hold already, where they are even.
  std::vector<Even> held(blocks_, Even{0, 0, kTileSlices});
  constexpr std::size_t size = kTileSlices * kLanes;
  alignas(64) std::uint8_t tile_rows[size], out[size];
  const std::vector<std::uint8_t> black(size, 0), full(size, kFull), bright(size, highest);
  for (int first = (all - 1) / kTileSlices * kTileSlices; first >= 0; first -= kTileSlices) {
    const int count = std::min(kTileSlices, all - first);
    std::uint64_t lit = 0;  // rows
    for (std::size_t b = 0; b < blocks_; ++b) {
      const std::size_t tile = static_cast<std::size_t>(first / kTileSlices) * blocks_ + b;
      const std::span<const Change> changes = changes_[tile];
      const CodedTiles::Even even = coded_.even(tile);
      const std::uint8_t* shown = out;
      const std::uint8_t* rows = tile_rows;
      if ((even.black || even.full) && changes.empty() && solve_still(lanes[b], first, count)) {
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
        if (!coded_.read(tile, count, tile_rows)) {
          std::memset(tile_rows, 0, static_cast<std::size_t>(count) * kLanes);
        }
        solve_tile(lanes[b], first, count, out, changes);
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
    coded_.drop_from(static_cast<std::size_t>(first / kTileSlices) * blocks_);
    changes_.drop_from(coded_.tiles());
    for (int k = count; k-- > 0;) {
      const std::size_t at = static_cast<std::size_t>(k) * stride_;
      sink(first + k, levels.data() + at, tiles ? nullptr : covers.data() + at, !(lit >> k & 1));
    }
  }
}

void ContinuousSolver::solve_tile(Lanes& lanes, int first_slice, int count, std::uint8_t* out,
                                  std::span<const Change> changes) {
  const ContinuousPlan& p = shared_;
  const double dark = p.phi_min * p.b, bright = p.phi_max * p.b;
  const std::uint8_t highest = p.level_of.back();

  alignas(64) double omega[2][kLanes];
  alignas(64) double add[kLanes];
  alignas(64) std::uint8_t light[kLanes];
  copy_lanes(lanes.omega, omega[0]);
  std::fill_n(add, kLanes, dark);
  std::memset(light, 0, kLanes);
  for (LaneMask m = lanes.bright; m; m &= m - 1) {
    const int i = std::countr_zero(m);
    add[i] = bright;
    light[i] = highest;
  }
  LaneMask quiet = lanes.quiet;
  int now = 0;
  // In slices below this one some quiet lane may end: only then `until` is looked at.
  int wake = lanes.wake;

  // Makes lane i quiet if its light is certain from slice n on. `w`: its dose at the lower node.
  const auto settle = [&](int i, int n, double w) {
    const RunAt& run = lanes.run[i];
    const Edge& edge = edges_[run.edge];
    const int j = n - run.node;
    bool shine = false;
    int from = Edge::kNever;
    if (edge.below == 0) {
      from = edge.dark_from;
    } else if (edge.below == kFull) {
      if (edge.platform) {
        if (edge.cap < p.most) return;
        from = 0;
        shine = true;
      } else if (j >= edge.bright_from) {
        from = edge.bright_from;
        shine = true;
      } else if (j >= edge.falls_from && j < edge.capped_from && n != run.lower - 1) {
        const double darkest = dark + p.a * w;
        const double room = edges_.doses(edge, j, 0).hi - darkest;
        if (darkest >= p.prints && room >= 0 && room < p.close) {
          from = edge.falls_from;
        }
      }
    }
    if (j < from) return;
    const LaneMask bit = LaneMask{1} << i;
    quiet |= bit;
    lanes.until[i] = run.node + from;
    wake = std::max(wake, lanes.until[i]);
    add[i] = shine ? bright : dark;
    light[i] = shine ? highest : 0;
    lanes.bright = shine ? lanes.bright | bit : lanes.bright & ~bit;
  };
  if (!lanes.begun) {
    lanes.begun = true;
    for (int i = 0; i < static_cast<int>(kLanes); ++i) settle(i, first_slice + count - 1, 0.0);
  }

  std::size_t left = changes.size();
  for (int k = count; k-- > 0;) {
    const int n = first_slice + k;
    if (n < wake) quiet &= ~later_lanes(lanes.until, n, &wake);
    std::uint8_t* const shown = out + static_cast<std::size_t>(k) * kLanes;
    std::memcpy(shown, light, kLanes);
    const LaneMask active = ~quiet;
    if (active == 0) {
      int more = 0;
      while (k > 0 && n - more - 1 >= wake) {
        ++more;
        --k;
        std::memcpy(out + static_cast<std::size_t>(k) * kLanes, light, kLanes);
      }
      step_lanes(add, p.a, omega[now], 1 + more);
      continue;
    }
    const double* const from = omega[now];
    double* const to = omega[1 - now];
    step_lanes(add, p.a, from, to);
    now = 1 - now;
    for (LaneMask m = active; m; m &= m - 1) {
      const int i = std::countr_zero(m);
      const LaneMask bit = LaneMask{1} << i;
      if (!(lanes.chosen & bit)) {
        const int together = search_.choose(lanes.run[i], n, from[i], lanes.levels[i]);
        lanes.left[i] = lanes.count[i] = static_cast<std::uint8_t>(together);
        lanes.chosen |= bit;
      }
      const std::uint8_t level = lanes.levels[i][lanes.count[i] - lanes.left[i]];
      if (--lanes.left[i] == 0) lanes.chosen &= ~bit;
      shown[i] = p.level_of[level];
      to[i] = p.step(p.levels.phi(level), from[i]);
    }
    // At upper ends of merged gaps lanes may have been quiet.
    for (; left > 0 && changes[left - 1].row >= k; --left) {
      RunAt& run = lanes.run[changes[left - 1].lane];
      const Upper was = changes[left - 1].was;
      if (was.node == run.node) continue;  // a gap that was merged
      run = run_above(edges_, run);
      run.edge = was.edge;
      run.node = was.node;
    }
    if (k == 0 && first_slice == 0) break;
    for (LaneMask m = active & ~lanes.chosen; m; m &= m - 1) {
      const int i = std::countr_zero(m);
      settle(i, n - 1, to[i]);
    }
  }
  copy_lanes(omega[now], lanes.omega);
  lanes.quiet = quiet;
  lanes.wake = wake;
}

bool ContinuousSolver::solve_still(Lanes& lanes, int first_slice, int count) {
  if (lanes.quiet != ~LaneMask{0} || lanes.wake > first_slice) return false;
  if (lanes.bright != 0 && lanes.bright != ~LaneMask{0}) return false;
  alignas(64) double add[kLanes];
  std::fill_n(add, kLanes, (lanes.bright ? shared_.phi_max : shared_.phi_min) * shared_.b);
  step_lanes(add, shared_.a, lanes.omega, count);
  return true;
}

}  // namespace

std::unique_ptr<BandSolver> make_continuous_solver(const CorrectionPlan& plan,
                                                   std::size_t columns) {
  return std::make_unique<ContinuousSolver>(plan, columns);
}

}  // namespace slicecorr::detail
