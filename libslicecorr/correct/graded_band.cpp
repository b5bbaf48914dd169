// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cstring>
#include <memory>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include "base/coded_band.hpp"
#include "base/coded_tiles.hpp"
#include "correct/band_solvers.hpp"
#include "correct/column_walk.hpp"
#include "correct/graded_columns.hpp"
#include "correct/inhibited_plan.hpp"
#include "correct/level_search.hpp"
#include "correct/merged_slits.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::detail {

namespace {

/// Levels of columns of whose features doses are wanted.
///
/// Of each node inside a feature a dose is wanted, between those of the two layers beside it. Light
/// between black and full can't follow all that these may do: the least doses that are nowhere
/// below them, and the greatest that are nowhere above them, are found from the platform on, as far
/// as the edges at the ends of the feature leave room. Then the slices are chosen from the last one
/// on, each from the dose that is there: the walk is that of columns that are not plain, which knows of
/// what is left alone, of resin that ends and of light from the platform (column_walk.hpp).
class GradedRuns final : public GradedColumns {
 public:
  GradedRuns(const CorrectionPlan& plan, const DoseScale& scale)
      : plan_(plan),
        model_(plan.model),
        scale_(scale),
        searches_(plan, false, false),  // doses are wanted: none is given up for shelves
        all_(static_cast<std::size_t>(std::max(plan.all_layers, 0))),
        cover_(all_ + 1),
        least_(all_ + 1),
        most_(all_ + 1),
        aim_most_(all_ + 1),
        scaled_(all_ + 1) {}

  void solve(const GradedColumn& column, std::uint8_t* levels) override;

  // As BrightLevels.
  static constexpr bool kLooks = true;
  void look(int n, const WalkAsk& ask) { want_ = light_at(ask, n); }
  int choose(int n, const WalkAsk& ask, LevelSearch& search, std::uint8_t* levels) {
    return search.choose_near(ask.run, n, ask.below, want_, levels, ask.taken);
  }

 private:
  const ContinuousPlan& plan_of(std::size_t search) const {
    return *searches_.plans().plans[search];
  }
  /// Doses of a search over those of resin, at `zeta` slices from the platform.
  double scale_at(std::size_t search, double zeta) const {
    return searches_.plans().factors[search] / model_.returned(zeta);
  }
  double wanted(std::uint8_t dose) const { return scale_.dose[dose]; }
  /// Sets the doses of the nodes of the feature that was added last, up to its lower end.
  void bound(const ColumnWalk& walk, int lower);
  /// The doses wanted of the node between two layers of a feature: the mean, or, where light can't
  /// follow them, both.
  DoseRange between(std::size_t search, int slice) const;
  LevelSearch::Wanted light_at(const WalkAsk& ask, int n);

  const CorrectionPlan& plan_;
  const CureModel& model_;
  const DoseScale& scale_;
  WalkSearches searches_;
  std::size_t all_;
  const std::uint8_t* doses_ = nullptr;  ///< of the column at hand
  std::vector<std::uint8_t> cover_;
  /// Per node of a feature: nothing below `least_` leads to doses that are enough everywhere above
  /// it, nothing above `most_` to doses that are nowhere too much.
  std::vector<double> least_, most_;
  std::vector<double> aim_most_;  ///< what slices near edges should not pass
  std::vector<double> scaled_;    ///< the same as the search at hand has it
  /// Doses that are never too low, and never too high, as light from here on can reach them.
  double over_ = 0, under_ = 0;
  LevelSearch::Wanted want_{};  ///< of the slice at hand
};

DoseRange GradedRuns::between(std::size_t search, int slice) const {
  const ContinuousPlan& p = plan_of(search);
  const double above = wanted(doses_[slice - 1]) * scale_at(search, slice - 0.5);
  const double below = wanted(doses_[slice]) * scale_at(search, slice + 0.5);
  const double middle = (above + below) / 2;
  const LayerFactors& layer = p.of(slice);
  const double ratio = p.ratio(slice);
  const bool steep =
      above > layer.step(ratio * p.phi_max, below) || above < layer.step(ratio * p.phi_min, below);
  return steep ? DoseRange{std::min(above, below), std::max(above, below)}
               : DoseRange{middle, middle};
}

void GradedRuns::bound(const ColumnWalk& walk, int lower) {
  const int node = walk.last().node;
  const std::size_t search = searches_.plans().at(node);
  const ContinuousPlan& p = plan_of(search);
  const Edges& edges = searches_.of(search).edges;
  const Edge& edge = edges[walk.edge_of(searches_, search)];
  double least_above = 0, most_above = 0;
  for (int k = node; k < lower; ++k) {
    const DoseRange fits = edges.doses(edge, k - node, 0);
    double least = fits.lo, most = fits.hi;
    if (k > node || walk.free_above()) {
      const double own = wanted(doses_[k]) * scale_at(search, k);
      const DoseRange dose = k == node ? DoseRange{own, own} : between(search, k);
      least = dose.hi;
      most = dose.lo;
      if (k > node) {
        const LayerFactors& layer = p.of(k - 1);
        const double ratio = p.ratio(k - 1);
        least = std::max(least, (least_above - ratio * p.climb_max * layer.b) * layer.per_a);
        most = std::min(most, (most_above - ratio * p.phi_min * layer.b) * layer.per_a);
      }
      least = std::clamp(least, fits.lo, std::max(fits.lo, fits.hi));
      most = std::clamp(most, fits.lo, std::max(fits.lo, fits.hi));
    }
    least_above = least;
    most_above = most;
    const auto at = static_cast<std::size_t>(k);
    const double scale = scale_at(search, k);
    least_[at] = least / scale;
    most_[at] = most / scale;
    aim_most_[at] = scale_.side == DoseSide::at_least  ? least_[at]
                    : scale_.side == DoseSide::at_most ? most_[at]
                                                       : (least_[at] + most_[at]) / 2;
  }
}

LevelSearch::Wanted GradedRuns::light_at(const WalkAsk& ask, int n) {
  const std::size_t search = ask.search;
  const ContinuousPlan& p = plan_of(search);
  const double omega = ask.below, taken = ask.taken ? ask.taken[0] : 0.0;
  const double room = scale_.side == DoseSide::at_most ? 0.0 : p.feature_reserve;
  const double ratio = p.ratio(n);
  // Nodes that a search looks at; those of other runs have other factors, and count as this one's.
  const double* most = aim_most_.data();
  if (p.mirrored) {
    for (int k = n; k >= 0 && k > n - LevelSearch::kMost; --k) {
      const auto at = static_cast<std::size_t>(k);
      scaled_[at] = aim_most_[at] * scale_at(search, k);
    }
    most = scaled_.data();
  }
  LevelSearch::Wanted want{ratio * p.phi_max, scale_.side, most, room};
  if (cover_[static_cast<std::size_t>(n)] != kFull) return want;
  const auto at = static_cast<std::size_t>(n);
  if (n + 1 == ask.run.lower) over_ = under_ = omega;
  const LayerFactors& layer = p.of(n);
  const auto reached = [&](double dose, double from) {
    return std::clamp(dose, layer.step(ratio * p.phi_min - taken, from),
                      layer.step(ratio * p.phi_max - taken, from));
  };
  const double least = least_[at] * scale_at(search, n);
  const double most_here = most_[at] * scale_at(search, n);
  over_ = reached(least, over_);
  under_ = reached(most_here, under_);
  // The light with which the middle of the layer has its dose.
  const double aim = wanted(doses_[n]) * scale_at(search, n + 0.5);
  const double middle = (aim - layer.root_a * omega) / (1.0 - layer.root_a);
  const bool inner = n + 1 < ask.run.lower;
  const double below = scale_at(search, n + 1);
  const auto to_node = [&](double dose) { return (dose - layer.a * omega) * layer.per_b; };
  switch (scale_.side) {
    case DoseSide::nearest:
      want.phi = to_node((over_ + under_) / 2);
      break;
    case DoseSide::at_least:
      want.phi = to_node(least);
      if (inner && omega >= least_[at + 1] * below) want.phi = std::max(want.phi, middle);
      break;
    case DoseSide::at_most:
      want.phi = to_node(most_here);
      if (inner && omega <= most_[at + 1] * below) want.phi = std::min(want.phi, middle);
      break;
  }
  want.phi += taken;
  return want;
}

void GradedRuns::solve(const GradedColumn& column, std::uint8_t* levels) {
  if (all_ == 0) return;
  doses_ = column.doses;
  const auto layers = static_cast<int>(std::min(static_cast<std::size_t>(plan_.layers), all_));
  const int all = plan_.all_layers, bath = model_.bath_slices;
  const auto left_alone = [&](int n) {
    return column.left_alone && n < layers ? column.left_alone[n] : std::uint8_t{0};
  };
  const auto level_left = [&](int n) { return level_of_pixel(left_alone(n), plan_.levels.size()); };
  const auto light = [&](int n, int level) { return model_.ratio(n) * plan_.levels.phi(level); };
  ColumnWalk walk;
  const auto end_run = [&](int end) {
    if (!walk.last().left_alone && walk.last().cover == kFull) bound(walk, end);
  };
  std::fill(cover_.begin(), cover_.end(), std::uint8_t{0});
  for (int n = 0; n < all; ++n) {
    const bool left = left_alone(n) != 0;
    const std::uint8_t cover = n < layers && !left ? column.coverage[n] : std::uint8_t{0};
    const bool known = column.heights && n <= plan_.layers;
    const std::uint8_t height = known ? column.heights[n] : std::uint8_t{0};
    cover_[static_cast<std::size_t>(n)] = cover;
    if (n > 0 && walk.begins(cover, left)) end_run(n);
    walk.add(model_, n, cover, height, left, left ? light(n, level_left(n)) : 0.0);
  }
  end_run(all);
  walk.begin(all);
  // What leaves the bath when slice k is shown.
  const auto far = [&](int k) {
    return bath > 0 && k + bath < all ? light(k + bath, levels[k + bath]) : 0.0;
  };
  for (int n = all; n-- > 0;) {
    int level = 0;
    if (walk.left_alone(n)) {
      level = level_left(n);
    } else {
      level = plan_.continuous
                  ->level_of[static_cast<std::size_t>(walk.choose(searches_, n, far, *this))];
    }
    levels[n] = static_cast<std::uint8_t>(level);
    walk.pass(model_, n, light(n, level), far(n));
  }
}

std::unique_ptr<GradedColumns> make_graded_column(const CorrectionPlan& plan,
                                                  const DoseScale& scale) {
  const bool counted = plan.model.adds_up() && !plan.model.inhibited();
  const bool layers = plan.model.mode == ExposureMode::layerwise;
  if (!counted || (!layers && !plan.continuous)) {
    throw Error("doses are wanted of a model that is not one of sums of light");
  }
  if (layers) return make_graded_layers(plan, scale);
  return std::make_unique<GradedRuns>(plan, scale);
}

/// Rows of a band cut into tiles of 64 columns, kept coded.
class TileRows {
 public:
  TileRows(std::size_t columns, int rows)
      : columns_(columns),
        blocks_((columns + kLanes - 1) / kLanes),
        rows_(rows),
        kept_(blocks_ * kLanes * (kTileSlices + std::size_t{1}), 0) {}
  std::size_t blocks() const { return blocks_; }
  /// The next row; null: black.
  void append(const std::uint8_t* row) {
    std::uint8_t* const to = kept_.data() + static_cast<std::size_t>(1 + at_hand_) * stride();
    std::memset(to, 0, stride());
    if (row) std::memcpy(to, row, columns_);
    ++count_;
    if (++at_hand_ == kTileSlices || count_ == rows_) flush();
  }
  int count() const { return count_; }
  /// All rows of 64 columns, one after the other.
  void read(std::size_t block, std::vector<std::uint8_t>& out) const {
    out.assign(static_cast<std::size_t>(rows_) * kLanes, 0);
    for (int first = 0; first < rows_; first += kTileSlices) {
      read(block, first / kTileSlices, &out[static_cast<std::size_t>(first) * kLanes]);
    }
  }
  int rows_of(int tile) const { return std::min(kTileSlices, rows_ - tile * kTileSlices); }

 private:
  std::size_t stride() const { return blocks_ * kLanes; }
  void read(std::size_t block, int tile, std::uint8_t* out) const {
    coded_.read(static_cast<std::size_t>(tile) * blocks_ + block, rows_of(tile), out);
  }
  void flush() {
    LaneMask steady[kTileSlices], changed[kTileSlices];
    for (std::size_t b = 0; b < blocks_; ++b) {
      const std::uint8_t* const head = kept_.data() + stride() + b * kLanes;
      tile_changes(head, stride(), at_hand_, steady, changed);
      coded_.append(head, stride(), at_hand_, changed + 1);
    }
    at_hand_ = 0;
  }

  std::size_t columns_, blocks_;
  int rows_, count_ = 0, at_hand_ = 0;
  std::vector<std::uint8_t> kept_;  ///< a row that is not used, then those at hand
  CodedTiles coded_;
};

/// Solves 64 columns at a time, each from its last slice to its first.
class GradedSolver final : public BandSolver {
 public:
  GradedSolver(const CorrectionPlan& plan, std::size_t columns, BandDoses doses)
      : plan_(plan),
        doses_(std::move(doses)),
        columns_(columns),
        coded_(columns),
        coverage_(columns, plan.layers),
        heights_(columns, plan.layers + 1) {}

  void add_layer(const std::uint8_t* coverage, const std::uint8_t* heights,
                 const std::uint8_t* left_alone) override {
    const bool last = coverage_.count() == plan_.layers;
    if (last && (coverage || heights_.count() > plan_.layers)) {
      throw Error("more layers than the plan has");
    }
    if (!last) {
      coded_.append(coverage);
      coverage_.append(coverage);
      if (left_alone && !left_alone_) {
        left_alone_.emplace(columns_, plan_.layers);
        while (left_alone_->count() + 1 < coverage_.count()) left_alone_->append(nullptr);
      }
      if (left_alone_) left_alone_->append(left_alone);
    }
    heights_.append(heights);
  }
  void solve(const BandCorrector::Sink& sink, const BandCorrector::TileSink&) override;

 private:
  /// What of 64 columns: rows of coverage, heights, doses, what is left alone (or none).
  struct Block {
    std::vector<std::uint8_t> coverage, heights, doses, left_alone;
  };
  void solve_block(GradedColumns& columns, const Block& block, std::vector<std::uint8_t>& levels);

  const CorrectionPlan& plan_;
  BandDoses doses_;
  std::size_t columns_;
  CodedBand coded_;  ///< coverage by layers
  TileRows coverage_, heights_;
  std::optional<TileRows> left_alone_;  ///< nothing: nothing is
};

void GradedSolver::solve_block(GradedColumns& columns, const Block& block,
                               std::vector<std::uint8_t>& levels) {
  const auto layers = static_cast<std::size_t>(plan_.layers);
  const auto all = static_cast<std::size_t>(plan_.all_layers);
  // Coverage, doses, what is left alone and heights of a column, and of the one that was solved last.
  std::vector<std::uint8_t> now(4 * layers + 1), before;
  const std::uint8_t* const row = now.data();
  const GradedColumn column{row, row + 3 * layers, row + layers,
                            block.left_alone.empty() ? nullptr : row + 2 * layers};
  std::vector<std::uint8_t> solved(all, 0);
  const auto gather = [&](const std::vector<std::uint8_t>& from, std::size_t lane, std::size_t rows,
                          std::uint8_t* to) {
    for (std::size_t n = 0; n < rows; ++n) to[n] = from[n * kLanes + lane];
  };
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    gather(block.coverage, lane, layers, now.data());
    gather(block.doses, lane, layers, now.data() + layers);
    if (column.left_alone) gather(block.left_alone, lane, layers, now.data() + 2 * layers);
    gather(block.heights, lane, layers + 1, now.data() + 3 * layers);
    if (now != before) {
      columns.solve(column, solved.data());
      before = now;
    }
    for (std::size_t n = 0; n < all; ++n) levels[n * kLanes + lane] = solved[n];
  }
}

void GradedSolver::solve(const BandCorrector::Sink& sink, const BandCorrector::TileSink&) {
  if (coverage_.count() != plan_.layers) throw Error("the plan has more layers");
  if (plan_.all_layers <= 0) return;
  while (heights_.count() <= plan_.layers) heights_.append(nullptr);
  TileRows wanted(columns_, plan_.layers);
  std::vector<std::uint8_t> row(columns_);
  for (int n = 0; n < plan_.layers; ++n) {
    doses_.read(n, row.data());
    wanted.append(row.data());
  }
  const auto column = make_graded_column(plan_, *doses_.scale);
  const auto all = static_cast<std::size_t>(plan_.all_layers);
  Block block;
  std::vector<std::uint8_t> levels(all * kLanes);
  // Blocks are coded apart: a slice is put together from all of them.
  std::vector<CodedBand> solved;
  for (std::size_t b = 0; b < coverage_.blocks(); ++b) {
    coverage_.read(b, block.coverage);
    if (left_alone_) left_alone_->read(b, block.left_alone);
    CodedBand& coded = solved.emplace_back(kLanes);
    if (all_zero(block.coverage.data(), block.coverage.size()) &&
        all_zero(block.left_alone.data(), block.left_alone.size())) {
      for (std::size_t n = 0; n < all; ++n) coded.append(nullptr);
      continue;
    }
    heights_.read(b, block.heights);
    wanted.read(b, block.doses);
    solve_block(*column, block, levels);
    for (std::size_t n = 0; n < all; ++n) coded.append(&levels[n * kLanes]);
  }
  std::vector<std::uint8_t> out(coverage_.blocks() * kLanes), design(columns_);
  for (int n = plan_.all_layers; n-- > 0;) {
    bool dark = n >= coded_.slices() || coded_.black(n);
    for (std::size_t b = 0; b < solved.size(); ++b) {
      solved[b].read(n, out.data() + b * kLanes);
      dark = dark && solved[b].black(n);
    }
    coded_.read(n, design.data());
    sink(n, out.data(), design.data(), dark);
  }
}

}  // namespace

std::unique_ptr<BandSolver> make_graded_solver(const CorrectionPlan& plan, std::size_t columns,
                                               BandDoses doses) {
  if (plan.model.inhibited() && !plan.inhibited->even) {
    return make_inhibited_solver(plan, columns, std::move(doses));
  }
  if (plan.tried) return make_tried_solver(plan, columns, std::move(doses));
  static_cast<void>(make_graded_column(plan, *doses.scale));
  return std::make_unique<GradedSolver>(plan, columns, std::move(doses));
}

}  // namespace slicecorr::detail

namespace slicecorr {

std::vector<std::uint8_t> solve_graded_column(const CorrectionPlan& plan, const DoseScale& scale,
                                              const std::vector<std::uint8_t>& coverage,
                                              const std::vector<std::uint8_t>& doses,
                                              const std::vector<std::uint8_t>& heights) {
  std::vector<std::uint8_t> levels(static_cast<std::size_t>(std::max(plan.all_layers, 0)), 0);
  std::vector<std::uint8_t> at_nodes = heights;
  at_nodes.resize(static_cast<std::size_t>(plan.layers) + 1, 0);
  const std::vector<std::uint8_t> solved = detail::merged_slits(plan, coverage);
  detail::make_graded_column(plan, scale)
      ->solve({solved.data(), at_nodes.data(), doses.data(), nullptr}, levels.data());
  return levels;
}

}  // namespace slicecorr
