// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

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
#include "support/numbers/release.hpp"

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
        upper_(stride_, Upper{edges_.platform(0), 0}) {}

  void add_layer(const std::uint8_t* coverage, const std::uint8_t* heights,
                 const std::uint8_t*) override;
  void solve(const BandCorrector::Sink& sink, const BandCorrector::TileSink& tiles) override;
  bool has_tiles() const override { return true; }

 private:
  /// An edge that the first pass met in a lane, before row `row` of the tile. `was`: the upper end
  /// of the run above the edge, to which the lane returns when the solve has passed the edge.
  struct Change {
    std::uint8_t row, lane;
    std::uint8_t height;  ///< of the edge; 0: it has none of its own
    Upper was;
  };
  struct Lanes;
  class SliceRows;
  /// Light that is certain of a lane's run from slice `from` of the run upwards.
  struct Certain {
    int from = Edge::kNever;
    bool shine = false;  ///< full light, else black
  };

  std::uint8_t* row(int k) { return rows_.data() + static_cast<std::size_t>(k) * stride_; }
  /// First pass over the `count` rows that are kept.
  void forward(int count);
  void solve_tile(Lanes& lanes, int first_slice, int count, std::uint8_t* out,
                  std::span<const Change> changes);
  /// What is certain at slice `n`, `dose` being the one below it.
  Certain certain_light(const RunAt& run, int n, double dose) const;
  /// Level of a lane that is not quiet; `dose`: below slice `n`.
  std::uint8_t next_level(Lanes& lanes, int lane, int n, double dose);
  /// Lanes whose run ends at `row` or above it go on in the run above; takes their changes off.
  void pass_upper_ends(Lanes& lanes, int row, std::span<const Change>& changes);
  /// A tile in which no lane's run ends, if nothing else changes: true, and its lanes are stepped;
  /// all of them get black light, or all full light.
  bool solve_still(Lanes& lanes, int first_slice, int count);

  const CorrectionPlan& plan_;
  const ContinuousPlan& shared_;
  Edges edges_;
  LevelSearch search_;
  std::size_t columns_, blocks_, stride_;
  /// Takes up a layer; null: empty, and without edge heights.
  void append(const std::uint8_t* coverage, const std::uint8_t* heights);
  /// Writes the edge heights of a tile's slices into rows; false: there are none.
  static bool read_heights(std::span<const Change> changes, int count, std::uint8_t* out);

  int layers_ = 0, rows_at_hand_ = 0;
  std::vector<std::uint8_t> rows_;
  std::vector<std::uint8_t> heights_;  ///< rows of edge heights of the kept rows; empty: none yet
  LaneMask with_heights_ = 0;          ///< which of the kept rows have some
  std::vector<std::uint8_t> last_heights_;  ///< of the node after the last layer; empty: none
  std::vector<Upper> upper_;                ///< per column, of the run that the pass has come to
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

/// The slices of a row of tiles, as the sinks take them: tile beside tile.
class ContinuousSolver::SliceRows {
 public:
  SliceRows(std::size_t blocks, std::size_t stride, bool with_covers)
      : stride_(stride),
        levels_(stride * kTileSlices),
        covers_(with_covers ? levels_.size() : 0),
        held_(blocks, Even{0, 0, kTileSlices}) {}

  void begin() { lit_ = 0; }
  /// A tile all of whose rows have one level and one coverage.
  void put_even(std::size_t block, std::uint8_t level, std::uint8_t cover, int count) {
    if (level != 0 || cover != 0) lit_ = ~std::uint64_t{0};
    const Even holds{level, cover, count};
    if (held_[block] == holds) return;
    for (int k = 0; k < count; ++k) {
      const std::size_t to = static_cast<std::size_t>(k) * stride_ + block * kLanes;
      std::memset(levels_.data() + to, level, kLanes);
      if (!covers_.empty()) std::memset(covers_.data() + to, cover, kLanes);
    }
    held_[block] = holds;
  }
  void put(std::size_t block, const std::uint8_t* levels, const std::uint8_t* covers, int count) {
    held_[block].rows = 0;
    for (int k = 0; k < count; ++k) {
      const std::size_t at = static_cast<std::size_t>(k) * kLanes;
      const std::size_t to = static_cast<std::size_t>(k) * stride_ + block * kLanes;
      std::uint64_t any = 0;
      for (std::size_t i = 0; i < kLanes; i += 8) {
        std::uint64_t light, design;
        std::memcpy(&light, levels + at + i, 8);
        std::memcpy(&design, covers + at + i, 8);
        any |= light | design;
      }
      lit_ |= static_cast<std::uint64_t>(any != 0) << k;
      std::memcpy(levels_.data() + to, levels + at, kLanes);
      if (!covers_.empty()) std::memcpy(covers_.data() + to, covers + at, kLanes);
    }
  }
  /// Gives the slices from `first` on to the sink, the last one first.
  void give(const BandCorrector::Sink& sink, int first, int count) const {
    for (int k = count; k-- > 0;) {
      const std::size_t at = static_cast<std::size_t>(k) * stride_;
      sink(first + k, levels_.data() + at, covers_.empty() ? nullptr : covers_.data() + at,
           !(lit_ >> k & 1));
    }
  }

 private:
  /// Columns of a tile all of whose first `rows` rows are alike.
  struct Even {
    std::uint8_t level, cover;
    int rows;
    bool operator==(const Even&) const = default;
  };
  std::size_t stride_;
  std::vector<std::uint8_t> levels_, covers_;  ///< no covers where tiles have been given
  std::vector<Even> held_;                     ///< per tile: what is there already
  std::uint64_t lit_ = 0;                      ///< rows with light or design
};

void ContinuousSolver::add_layer(const std::uint8_t* coverage, const std::uint8_t* heights,
                                 const std::uint8_t*) {
  if (layers_ == plan_.layers && !coverage && last_heights_.empty()) {
    if (heights) last_heights_.assign(heights, heights + columns_);
    return;
  }
  if (layers_ >= plan_.layers) throw Error("more layers than the plan has");
  ++layers_;
  append(coverage, heights);
}

void ContinuousSolver::append(const std::uint8_t* coverage, const std::uint8_t* heights) {
  std::uint8_t* const to = row(1 + rows_at_hand_);
  if (coverage) {
    std::memcpy(to, coverage, columns_);
  } else {
    std::memset(to, 0, columns_);
  }
  if (heights) {
    if (heights_.empty()) heights_.resize(stride_ * kTileSlices, 0);
    std::memcpy(&heights_[static_cast<std::size_t>(rows_at_hand_) * stride_], heights, columns_);
    with_heights_ |= LaneMask{1} << rows_at_hand_;
  }
  if (++rows_at_hand_ == kTileSlices) forward(kTileSlices);
}

bool ContinuousSolver::read_heights(std::span<const Change> changes, int count, std::uint8_t* out) {
  bool any = false;
  for (const Change& change : changes) {
    if (change.height == 0) continue;
    if (!any) std::memset(out, 0, static_cast<std::size_t>(count) * kLanes);
    any = true;
    out[static_cast<std::size_t>(change.row) * kLanes + change.lane] = change.height;
  }
  return any;
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
        std::uint8_t height = 0;
        if (with_heights_ >> k & 1) {
          const std::size_t column = block * kLanes + static_cast<std::size_t>(i);
          const std::uint8_t told = heights_[static_cast<std::size_t>(k) * stride_ + column];
          if (told != 0 && opposite(edges_[was.edge].below, below[i])) height = told;
        }
        upper = {
            edges_.next(was.edge, n - was.node, below[i], height != 0 ? height : kEdgeAtNode, n),
            n};
        changes_.push({static_cast<std::uint8_t>(k), static_cast<std::uint8_t>(i), height, was});
      }
    }
    changes_.end_record();
  }
  std::memcpy(row(0), row(count), stride_);
  rows_at_hand_ = 0;
  with_heights_ = 0;
}

void ContinuousSolver::solve(const BandCorrector::Sink& sink,
                             const BandCorrector::TileSink& tiles) {
  const int all = plan_.all_layers;
  if (layers_ != plan_.layers) throw Error("the plan has more layers");
  if (all <= 0) return;
  for (int n = layers_; n < all; ++n) {
    append(nullptr, n == layers_ && !last_heights_.empty() ? last_heights_.data() : nullptr);
  }
  if (rows_at_hand_ > 0) forward(rows_at_hand_);
  release(rows_);
  release(heights_);

  std::vector<Lanes> lanes(blocks_);
  for (std::size_t b = 0; b < blocks_; ++b) {
    for (std::size_t i = 0; i < kLanes; ++i) {
      const Upper upper = upper_[b * kLanes + i];
      lanes[b].run[i] = {upper.edge, upper.node, all, 0, false, kEdgeAtNode};
    }
  }
  const std::uint8_t highest = shared_.level_of.back();
  SliceRows slices(blocks_, stride_, !tiles);
  constexpr std::size_t size = kTileSlices * kLanes;
  alignas(64) std::uint8_t tile_rows[size], out[size], tile_heights[size];
  const std::vector<std::uint8_t> black(size, 0), full(size, kFull), bright(size, highest);
  for (int first = (all - 1) / kTileSlices * kTileSlices; first >= 0; first -= kTileSlices) {
    const int count = std::min(kTileSlices, all - first);
    slices.begin();
    for (std::size_t b = 0; b < blocks_; ++b) {
      const std::size_t tile = static_cast<std::size_t>(first / kTileSlices) * blocks_ + b;
      const std::span<const Change> changes = changes_[tile];
      const CodedTiles::Even even = coded_.even(tile);
      const std::uint8_t* shown = out;
      const std::uint8_t* rows = tile_rows;
      if ((even.black || even.full) && changes.empty() && solve_still(lanes[b], first, count)) {
        shown = lanes[b].bright ? bright.data() : black.data();
        rows = even.full ? full.data() : black.data();
        slices.put_even(b, shown[0], rows[0], count);
      } else {
        if (!coded_.read(tile, count, tile_rows)) {
          std::memset(tile_rows, 0, static_cast<std::size_t>(count) * kLanes);
        }
        solve_tile(lanes[b], first, count, out, changes);
        slices.put(b, out, tile_rows, count);
      }
      if (tiles) {
        const bool has_heights = read_heights(changes, count, tile_heights);
        tiles({b * kLanes, std::min(kLanes, columns_ - b * kLanes), first, count, shown, rows,
               has_heights ? tile_heights : nullptr});
      }
    }
    // What the sinks keep of these slices takes the place of what is known of them.
    coded_.drop_from(static_cast<std::size_t>(first / kTileSlices) * blocks_);
    changes_.drop_from(coded_.tiles());
    slices.give(sink, first, count);
  }
}

ContinuousSolver::Certain ContinuousSolver::certain_light(const RunAt& run, int n,
                                                          double dose) const {
  const ContinuousPlan& p = shared_;
  const Edge& edge = edges_[run.edge];
  const int j = n - run.node;
  if (n + 1 == run.lower && run.ends_inside()) return {};
  if (edge.below == 0) return {edge.dark_from, false};
  if (edge.below != kFull) return {};
  if (edge.platform) return edge.cap < p.most ? Certain{} : Certain{0, true};
  if (j >= edge.bright_from) return {edge.bright_from, true};
  if (j >= edge.falls_from && j < edge.capped_from && n != run.lower - 1) {
    const double darkest = p.phi_min * p.b + p.a * dose;
    const double room = edges_.doses(edge, j, 0).hi - darkest;
    if (darkest >= p.prints && room >= 0 && room < p.close) {
      // Above a shelf the curve falls from a greater dose.
      return {j > edge.shelf ? std::max(edge.falls_from, edge.shelf + 1) : edge.falls_from, false};
    }
  }
  return {};
}

std::uint8_t ContinuousSolver::next_level(Lanes& lanes, int lane, int n, double dose) {
  const LaneMask bit = LaneMask{1} << lane;
  if (!(lanes.chosen & bit)) {
    const int together = search_.choose(lanes.run[lane], n, dose, lanes.levels[lane]);
    lanes.left[lane] = lanes.count[lane] = static_cast<std::uint8_t>(together);
    lanes.chosen |= bit;
  }
  const std::uint8_t level = lanes.levels[lane][lanes.count[lane] - lanes.left[lane]];
  if (--lanes.left[lane] == 0) lanes.chosen &= ~bit;
  return level;
}

void ContinuousSolver::pass_upper_ends(Lanes& lanes, int row, std::span<const Change>& changes) {
  for (; !changes.empty() && changes.back().row >= row;
       changes = changes.first(changes.size() - 1)) {
    RunAt& run = lanes.run[changes.back().lane];
    const Upper was = changes.back().was;
    run = run_above(edges_, run);
    run.edge = was.edge;
    run.node = was.node;
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

  // Makes lane i quiet where its light is certain at slice n, `w` being its dose below.
  const auto settle = [&](int i, int n, double w) {
    const RunAt& run = lanes.run[i];
    const auto [from, shine] = certain_light(run, n, w);
    if (n - run.node < from) return;
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
      const std::uint8_t level = next_level(lanes, i, n, from[i]);
      shown[i] = p.level_of[level];
      to[i] = p.step(p.levels.phi(level), from[i]);
    }
    // At upper ends of merged gaps lanes may have been quiet.
    pass_upper_ends(lanes, k, changes);
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
