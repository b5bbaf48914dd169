// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cstring>
#include <memory>
#include <tuple>
#include <utility>
#include <vector>

#include "base/coded_band.hpp"
#include "base/coded_tiles.hpp"
#include "correct/band_solvers.hpp"
#include "correct/graded_columns.hpp"
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
/// on, each from the dose that is there.
class GradedColumn final : public GradedColumns {
 public:
  GradedColumn(const CorrectionPlan& plan, const DoseScale& scale)
      : plan_(plan),
        p_(*plan.continuous),
        scale_(scale),
        edges_(p_, false),  // doses are wanted: none is given up
        search_(edges_),
        all_(static_cast<std::size_t>(std::max(plan.all_layers, 0))),
        cover_(all_ + 1),
        least_(all_ + 1),
        most_(all_ + 1),
        aim_most_(all_ + 1) {}

  void solve(const std::uint8_t* coverage, const std::uint8_t* heights, const std::uint8_t* doses,
             std::uint8_t* levels) override;

 private:
  /// The upper end of a run.
  struct Upper {
    std::int32_t edge, node;
  };
  void find_runs(const std::uint8_t* heights);
  /// Sets the doses of a feature's nodes, from its upper end to its lower one.
  void bound(Upper upper, int lower, const std::uint8_t* doses);
  double wanted(std::uint8_t dose) const { return scale_.dose[dose]; }
  /// The doses wanted of the node between two layers of a feature: the mean, or, where light can't
  /// follow them, both.
  DoseRange between(int slice, double above, double below) const;
  LevelSearch::Wanted light_at(const RunAt& run, int n, double omega, const std::uint8_t* doses);

  const CorrectionPlan& plan_;
  const ContinuousPlan& p_;
  const DoseScale& scale_;
  Edges edges_;
  LevelSearch search_;
  std::size_t all_;
  std::vector<std::uint8_t> cover_;
  /// Per node of a feature: nothing below `least_` leads to doses that are enough everywhere above
  /// it, nothing above `most_` to doses that are nowhere too much.
  std::vector<double> least_, most_;
  std::vector<double> aim_most_;  ///< what slices near edges should not pass
  std::vector<Upper> runs_;
  /// Doses that are never too low, and never too high, as light from here on can reach them.
  double over_ = 0, under_ = 0;
};

void GradedColumn::find_runs(const std::uint8_t* heights) {
  runs_.assign(1, {edges_.platform(cover_[0]), 0});
  for (int n = 1; n < plan_.all_layers; ++n) {
    const auto k = static_cast<std::size_t>(n);
    if (cover_[k] == cover_[k - 1]) continue;
    const std::uint8_t height = heights && n <= plan_.layers ? heights[n] : std::uint8_t{0};
    const Upper above = runs_.back();
    runs_.push_back(
        {edges_.next(above.edge, n - above.node, cover_[k], height != 0 ? height : kEdgeAtNode, n),
         n});
  }
}

DoseRange GradedColumn::between(int slice, double above, double below) const {
  const double middle = (above + below) / 2;
  const LayerFactors& layer = p_.of(slice);
  const bool steep = above > layer.step(p_.phi_max, below) || above < layer.step(p_.phi_min, below);
  return steep ? DoseRange{std::min(above, below), std::max(above, below)}
               : DoseRange{middle, middle};
}

void GradedColumn::bound(Upper upper, int lower, const std::uint8_t* doses) {
  const Edge& edge = edges_[upper.edge];
  for (int k = upper.node; k < lower; ++k) {
    const auto at = static_cast<std::size_t>(k);
    const DoseRange fits = edges_.doses(edge, k - upper.node, 0);
    if (k == upper.node && !edge.platform) {
      least_[at] = fits.lo;
      most_[at] = fits.hi;
    } else {
      const double own = wanted(doses[k]);
      const DoseRange dose =
          k == upper.node ? DoseRange{own, own} : between(k, wanted(doses[k - 1]), own);
      double least = dose.hi, most = dose.lo;
      if (k > upper.node) {
        const LayerFactors& layer = p_.of(k - 1);
        least = std::max(least, (least_[at - 1] - p_.climb_max * layer.b) * layer.per_a);
        most = std::min(most, (most_[at - 1] - p_.phi_min * layer.b) * layer.per_a);
      }
      least_[at] = std::clamp(least, fits.lo, std::max(fits.lo, fits.hi));
      most_[at] = std::clamp(most, fits.lo, std::max(fits.lo, fits.hi));
    }
    aim_most_[at] = scale_.side == DoseSide::at_least  ? least_[at]
                    : scale_.side == DoseSide::at_most ? most_[at]
                                                       : (least_[at] + most_[at]) / 2;
  }
}

LevelSearch::Wanted GradedColumn::light_at(const RunAt& run, int n, double omega,
                                           const std::uint8_t* doses) {
  const double room = scale_.side == DoseSide::at_most ? 0.0 : p_.feature_reserve;
  LevelSearch::Wanted want{p_.phi_max, scale_.side, aim_most_.data(), room};
  if (cover_[static_cast<std::size_t>(n)] != kFull) return want;
  const auto at = static_cast<std::size_t>(n);
  if (n + 1 == run.lower) over_ = under_ = omega;
  const LayerFactors& layer = p_.of(n);
  const auto reached = [&](double dose, double from) {
    return std::clamp(dose, layer.step(p_.phi_min, from), layer.step(p_.phi_max, from));
  };
  over_ = reached(least_[at], over_);
  under_ = reached(most_[at], under_);
  // The light with which the middle of the layer has its dose.
  const double middle = (wanted(doses[n]) - layer.root_a * omega) / (1.0 - layer.root_a);
  const bool inner = n + 1 < run.lower;
  const auto to_node = [&](double dose) { return (dose - layer.a * omega) * layer.per_b; };
  switch (scale_.side) {
    case DoseSide::nearest:
      want.phi = to_node((over_ + under_) / 2);
      break;
    case DoseSide::at_least:
      want.phi = to_node(least_[at]);
      if (inner && omega >= least_[at + 1]) want.phi = std::max(want.phi, middle);
      break;
    case DoseSide::at_most:
      want.phi = to_node(most_[at]);
      if (inner && omega <= most_[at + 1]) want.phi = std::min(want.phi, middle);
      break;
  }
  return want;
}

void GradedColumn::solve(const std::uint8_t* coverage, const std::uint8_t* heights,
                         const std::uint8_t* doses, std::uint8_t* levels) {
  if (all_ == 0) return;
  std::fill(cover_.begin(), cover_.end(), std::uint8_t{0});
  std::copy_n(coverage, std::min(static_cast<std::size_t>(plan_.layers), all_), cover_.begin());
  find_runs(heights);
  for (std::size_t r = 0; r < runs_.size(); ++r) {
    const int lower = r + 1 < runs_.size() ? runs_[r + 1].node : plan_.all_layers;
    if (cover_[static_cast<std::size_t>(runs_[r].node)] == kFull) bound(runs_[r], lower, doses);
  }
  RunAt run{runs_.back().edge, runs_.back().node, plan_.all_layers, 0, false, kEdgeAtNode};
  double omega = 0;
  std::uint8_t chosen[LevelSearch::kMost];
  int left = 0, count = 0;
  for (int n = plan_.all_layers; n-- > 0;) {
    if (n < run.node) {
      run = run_above(edges_, run);
      runs_.pop_back();
      run.edge = runs_.back().edge;
      run.node = runs_.back().node;
    }
    const LevelSearch::Wanted want = light_at(run, n, omega, doses);
    if (left == 0) left = count = search_.choose_near(run, n, omega, want, chosen);
    const std::uint8_t index = chosen[count - left];
    --left;
    levels[n] = p_.level_of[index];
    omega = p_.of(n).step(p_.levels.phi(index), omega);
  }
}

std::unique_ptr<GradedColumns> make_graded_column(const CorrectionPlan& plan,
                                                  const DoseScale& scale) {
  const bool counted = plan.model.adds_up() && !plan.model.inhibited() &&
                       plan.model.bath_slices == 0 && plan.model.mirrored_slices == 0;
  if (counted && plan.model.mode == ExposureMode::layerwise) return make_graded_layers(plan, scale);
  if (!plan.continuous || !counted || !plan.model.exposure_ratio.empty()) {
    throw Error("doses are wanted of a model that is not plain");
  }
  return std::make_unique<GradedColumn>(plan, scale);
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
    if (left_alone) throw Error("doses are wanted where something is left alone");
    const bool last = coverage_.count() == plan_.layers;
    if (last && (coverage || heights_.count() > plan_.layers)) {
      throw Error("more layers than the plan has");
    }
    if (!last) {
      coded_.append(coverage);
      coverage_.append(coverage);
    }
    heights_.append(heights);
  }
  void solve(const BandCorrector::Sink& sink, const BandCorrector::TileSink&) override;

 private:
  void solve_block(GradedColumns& column, const std::vector<std::uint8_t>& coverage,
                   const std::vector<std::uint8_t>& heights, const std::vector<std::uint8_t>& doses,
                   std::vector<std::uint8_t>& levels);

  const CorrectionPlan& plan_;
  BandDoses doses_;
  std::size_t columns_;
  CodedBand coded_;  ///< coverage by layers
  TileRows coverage_, heights_;
};

void GradedSolver::solve_block(GradedColumns& column, const std::vector<std::uint8_t>& coverage,
                               const std::vector<std::uint8_t>& heights,
                               const std::vector<std::uint8_t>& doses,
                               std::vector<std::uint8_t>& levels) {
  const auto layers = static_cast<std::size_t>(plan_.layers);
  const auto all = static_cast<std::size_t>(plan_.all_layers);
  // Coverage, heights and doses of a column, and of the one that was solved last.
  std::vector<std::uint8_t> now(3 * layers + 1), before;
  std::vector<std::uint8_t> solved(all, 0);
  const auto gather = [&](const std::vector<std::uint8_t>& from, std::size_t lane, std::size_t rows,
                          std::uint8_t* to) {
    for (std::size_t n = 0; n < rows; ++n) to[n] = from[n * kLanes + lane];
  };
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    gather(coverage, lane, layers, now.data());
    gather(heights, lane, layers + 1, now.data() + layers);
    gather(doses, lane, layers, now.data() + 2 * layers + 1);
    if (now != before) {
      column.solve(now.data(), now.data() + layers, now.data() + 2 * layers + 1, solved.data());
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
  std::vector<std::uint8_t> coverage, heights, doses, levels(all * kLanes);
  // Blocks are coded apart: a slice is put together from all of them.
  std::vector<CodedBand> solved;
  for (std::size_t b = 0; b < coverage_.blocks(); ++b) {
    coverage_.read(b, coverage);
    CodedBand& coded = solved.emplace_back(kLanes);
    if (all_zero(coverage.data(), coverage.size())) {
      for (std::size_t n = 0; n < all; ++n) coded.append(nullptr);
      continue;
    }
    heights_.read(b, heights);
    wanted.read(b, doses);
    solve_block(*column, coverage, heights, doses, levels);
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
      ->solve(solved.data(), at_nodes.data(), doses.data(), levels.data());
  return levels;
}

}  // namespace slicecorr
