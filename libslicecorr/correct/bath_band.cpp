#include <algorithm>
#include <memory>
#include <tuple>
#include <utility>
#include <vector>

#include "base/coded_band.hpp"
#include "correct/band_solvers.hpp"
#include "correct/in_bath.hpp"
#include "correct/level_search.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::detail {

namespace {

/// Solves slice by slice, all columns of a slice after each other: the levels of the slices that are
/// still in the bath stay at hand.
class BathSolver final : public BandSolver {
 public:
  BathSolver(const CorrectionPlan& plan, std::size_t columns)
      : plan_(plan),
        shared_(*plan.continuous),
        edges_(shared_),
        search_(edges_),
        coded_(columns),
        heights_(columns),
        columns_(columns) {}

  void add_layer(const std::uint8_t* coverage, const std::uint8_t* heights) override {
    if (coded_.slices() == plan_.layers && !coverage) {
      if (heights_.slices() == plan_.layers) heights_.append(heights);
      return;
    }
    if (coded_.slices() >= plan_.layers) throw Error("more layers than the plan has");
    coded_.append(coverage);
    heights_.append(heights);
  }
  void solve(const BandCorrector::Sink& sink, const BandCorrector::TileSink&) override;

 private:
  struct Column {
    RunAt run;
    std::uint8_t cover = 0;  ///< of the slice that was passed last
    std::uint8_t left = 0, count = 0;
    std::uint8_t levels[LevelSearch::kMost] =
        {};  ///< that are chosen, the first of `left` of them next
    double omega = 0;
    /// Upper ends of the runs that were passed.
    std::vector<std::pair<std::int32_t, std::int32_t>> passed;
  };
  void find_runs();
  std::uint8_t solve_slice(Column& column, std::size_t at, int n);
  std::uint8_t& held(std::size_t column, int slice) {
    const auto k = static_cast<std::size_t>(slice % plan_.model.bath_slices);
    return held_[k * columns_ + column];
  }

  const CorrectionPlan& plan_;
  const ContinuousPlan& shared_;
  Edges edges_;
  LevelSearch search_;
  CodedBand coded_, heights_;
  std::size_t columns_;
  std::vector<Column> each_;
  /// Levels of the slices in the bath, by slice modulo its depth and column.
  std::vector<std::uint8_t> held_;
};

void BathSolver::find_runs() {
  const int all = plan_.all_layers;
  std::vector<std::uint8_t> above(columns_, 0), here(columns_), below(columns_), heights(columns_);
  coded_.read(0, here.data());
  for (int n = 0; n < all; ++n) {
    coded_.read(n + 1, below.data());
    heights_.read(n, heights.data());
    for (std::size_t i = 0; i < columns_; ++i) {
      const bool merged =
          shared_.merge && here[i] == 0 && above[i] == kFull && below[i] == kFull && n > 0;
      const std::uint8_t cover = merged ? kFull : here[i];
      Column& column = each_[i];
      if (n == 0) {
        column.run.edge = edges_.platform(cover);
        column.run.lower = all;
      } else if (cover != column.cover) {
        column.passed.emplace_back(column.run.edge, column.run.node);
        const bool told = heights[i] != 0 && opposite(edges_[column.run.edge].below, cover);
        column.run.edge = edges_.next(column.run.edge, n - column.run.node, cover,
                                      told ? heights[i] : kEdgeAtNode);
        column.run.node = n;
      }
      column.cover = cover;
    }
    above.swap(here);
    here.swap(below);
  }
}

std::uint8_t BathSolver::solve_slice(Column& column, std::size_t at, int n) {
  const auto far = [&](int k) {
    const bool shown = k + plan_.model.bath_slices < plan_.all_layers;
    return shown ? plan_.levels.phi(held(at, k)) : 0.0;
  };
  if (n < column.run.node) {
    column.run = run_above(edges_, column.run);
    std::tie(column.run.edge, column.run.node) = column.passed.back();
    column.passed.pop_back();
  }
  if (column.left == 0) {
    const InBath bath(plan_, column.run, n, column.omega, far);
    const int chosen = search_.choose(column.run, n, bath.below, column.levels);
    column.left = column.count = static_cast<std::uint8_t>(std::min(bath.slices, chosen));
  }
  const std::uint8_t index = column.levels[column.count - column.left];
  --column.left;
  const double phi = plan_.model.in_bath(shared_.levels.phi(index), far(n));
  column.omega = plan_.model.step(phi, column.omega);
  return held(at, n) = shared_.level_of[index];
}

void BathSolver::solve(const BandCorrector::Sink& sink, const BandCorrector::TileSink&) {
  if (coded_.slices() != plan_.layers) throw Error("the plan has more layers");
  if (plan_.all_layers <= 0) return;
  each_.assign(columns_, Column{});
  held_.assign(static_cast<std::size_t>(plan_.model.bath_slices) * columns_, 0);
  find_runs();
  std::vector<std::uint8_t> out(columns_), coverage(columns_);
  for (int n = plan_.all_layers; n-- > 0;) {
    coded_.read(n, coverage.data());
    for (std::size_t i = 0; i < columns_; ++i) out[i] = solve_slice(each_[i], i, n);
    sink(n, out.data(), coverage.data(), all_zero(out.data(), columns_));
  }
}

}  // namespace

std::unique_ptr<BandSolver> make_bath_solver(const CorrectionPlan& plan, std::size_t columns) {
  return std::make_unique<BathSolver>(plan, columns);
}

}  // namespace slicecorr::detail
