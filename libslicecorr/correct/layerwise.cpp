#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>

#include "base/coded_band.hpp"
#include "base/kernels.hpp"
#include "correct/band_solvers.hpp"
#include "correct/coverage.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/target.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::detail {

namespace {

/// The coverage for which a layer is solved: a gap of one slice that is merged counts as full.
std::uint8_t solved_for(const CorrectionPlan& plan, std::uint8_t above, std::uint8_t here,
                        std::uint8_t below) {
  const bool merged = plan.merge_one_slice_gaps && here == 0 && above == kFull && below == kFull;
  return merged ? kFull : here;
}

/// Light that is left of that at a layer's window where its far edge belongs: at its upper node, or
/// where a gap lies above it, at its edge height from there.
class FarEdges {
 public:
  explicit FarEdges(const CureModel& model) {
    left_.fill(model.a);
    for (std::size_t h = 1; h < left_.size(); ++h) {
      if (h == kAtNode) continue;
      // Nearer to the middle of a layer than this, rounding to levels could pass it.
      constexpr double most = 0.4;
      const double below = edge_height_slices(static_cast<std::uint8_t>(h));
      const double reach = 1.0 - std::clamp(below, -most, most);
      left_[h] = std::exp(-reach * model.eta * units::kLn10);
    }
  }
  /// `above`: coverage of the layer above.
  double left(std::uint8_t above, std::uint8_t height) const {
    return left_[above == 0 ? height : 0];
  }

 private:
  static constexpr std::size_t kAtNode = 128;
  std::array<double, 256> left_;
};

/// The grey level of a layer. `far_edge`: W(n + 1), the dose that later slices leave at its window.
/// For a full layer the lowest level whose dose at the layer's far edge reaches `edge`, `left` of
/// its light being left there; for a grey one the level whose dose in the middle is nearest to the
/// coverage, but below 1. Where no level does so, the one that comes nearest.
int layer_level(const CorrectionPlan& plan, std::uint8_t coverage, double ratio, double far_edge,
                double left, double edge) {
  if (coverage == 0) return 0;
  const LevelTable& levels = plan.levels;
  const CureModel& model = plan.model;
  // Computed just as BandDose does, to the last bit.
  const auto near = [&](int level) { return levels.phi(level) * ratio + far_edge; };
  if (coverage == kFull) {
    const auto reached = [&](int level) { return near(level) * left; };
    if (reached(0) >= edge) return 0;
    int level = levels.at_least((edge / left - far_edge) / ratio);
    // Solving for phi rounds differently from stepping forward: what counts is the dose delivered.
    while (level < levels.highest() && reached(level) < edge) {
      level = levels.at_least(std::nextafter(levels.phi(level), 1e308));
    }
    return level;
  }
  const auto middle = [&](int level) { return near(level) * model.root_a; };
  const double aim = aim_of(coverage);
  const double phi = (aim / model.root_a - far_edge) / ratio;
  int level = levels.at_most(phi);
  const int next = levels.at_least(phi);
  if (next > level && middle(next) < 1.0 && middle(next) - aim < aim - middle(level)) level = next;
  return level;
}

class LayerwiseSolver final : public BandSolver {
 public:
  LayerwiseSolver(const CorrectionPlan& plan, std::size_t columns)
      : plan_(plan), far_edges_(plan.model), coded_(columns), heights_(columns) {
    for (auto& entry : cache_) entry.far_edge = std::numeric_limits<double>::quiet_NaN();
  }
  void add_layer(const std::uint8_t* coverage, const std::uint8_t* heights) override {
    // Windows' sides stay on nodes: the node after the last layer is one.
    if (coded_.slices() == plan_.layers && !coverage) return;
    if (coded_.slices() >= plan_.layers) throw Error("more layers than the plan has");
    coded_.append(coverage);
    heights_.append(heights);
  }
  void solve(const BandCorrector::Sink& sink, const BandCorrector::TileSink& tiles) override;

 private:
  /// Levels that were found, by what they follow from: most columns have the dose of a neighbour.
  struct Entry {
    double far_edge;
    double left = 0;
    int slice = -1;
    std::uint8_t coverage = 0, level = 0;
  };
  int level_of(std::uint8_t coverage, int slice, double ratio, double far_edge, double left) {
    std::uint64_t bits;
    std::memcpy(&bits, &far_edge, sizeof bits);
    Entry& entry = cache_[((bits >> 20) ^ (bits >> 40) ^ bits ^ coverage) % cache_.size()];
    if (entry.far_edge != far_edge || entry.coverage != coverage || entry.slice != slice ||
        entry.left != left) {
      const int level = layer_level(plan_, coverage, ratio, far_edge, left, 1.0 + kMargin);
      entry = {far_edge, left, slice, coverage, static_cast<std::uint8_t>(level)};
    }
    return entry.level;
  }

  const CorrectionPlan& plan_;
  const FarEdges far_edges_;
  CodedBand coded_, heights_;
  std::array<Entry, 256> cache_;
};

/// One layer of black light for a block.
SLICECORR_CLONES
void darken(double* far_edge, double dark, double a) {
  for (std::size_t i = 0; i < kBlock; ++i) far_edge[i] = (dark + far_edge[i]) * a;
}

void LayerwiseSolver::solve(const BandCorrector::Sink& sink, const BandCorrector::TileSink&) {
  if (coded_.slices() != plan_.layers) throw Error("the plan has more layers");
  const std::size_t columns = coded_.columns();
  std::vector<double> far_edge(columns, 0.0);
  std::vector<std::uint8_t> out(columns), below(columns), here(columns), above(columns);
  std::vector<std::uint8_t> heights(columns);
  coded_.read(plan_.all_layers - 1, here.data());
  for (int n = plan_.all_layers; n-- > 0;) {
    coded_.read(n - 1, above.data());
    heights_.read(n, heights.data());
    const double ratio = plan_.model.ratio(n);
    const double dark = plan_.levels.phi(0) * ratio;
    bool all_dark = true;
    for (std::size_t b = 0; b < columns; b += kBlock) {
      const std::size_t end = std::min(b + kBlock, columns);
      const bool gap = all_zero(here.data() + b, end - b);
      if (gap && end - b == kBlock && !plan_.merge_one_slice_gaps) {
        darken(&far_edge[b], dark, plan_.model.a);
        std::memset(out.data() + b, 0, kBlock);
        continue;
      }
      if (!gap) all_dark = false;
      for (std::size_t i = b; i < end; ++i) {
        const std::uint8_t coverage = solved_for(plan_, above[i], here[i], below[i]);
        const double left = far_edges_.left(above[i], heights[i]);
        const int level = coverage == 0 ? 0 : level_of(coverage, n, ratio, far_edge[i], left);
        out[i] = static_cast<std::uint8_t>(level);
        if (level) all_dark = false;
        far_edge[i] = (plan_.levels.phi(level) * ratio + far_edge[i]) * plan_.model.a;
      }
    }
    sink(n, out.data(), here.data(), all_dark);
    below.swap(here);
    here.swap(above);
  }
}

/// Walks one column from the last slice to the first: `choose(n, coverage, ratio, W(n + 1), left)`
/// gives the intensity phi' at the normal exposure.
template <typename Choose>
void walk_column(const CorrectionPlan& plan, const std::vector<std::uint8_t>& coverage,
                 const std::vector<std::uint8_t>& heights, Choose choose) {
  const FarEdges far_edges(plan.model);
  const auto at = [&](int layer) {
    const bool inside = layer >= 0 && layer < plan.layers;
    return inside ? coverage[static_cast<std::size_t>(layer)] : std::uint8_t{0};
  };
  double far_edge = 0;
  for (int n = plan.all_layers; n-- > 0;) {
    const double ratio = plan.model.ratio(n);
    const std::uint8_t c = solved_for(plan, at(n - 1), at(n), at(n + 1));
    const auto k = static_cast<std::size_t>(n);
    const double left =
        far_edges.left(at(n - 1), k < heights.size() ? heights[k] : std::uint8_t{0});
    const double phi = choose(k, c, ratio, far_edge, left);
    far_edge = (phi * ratio + far_edge) * plan.model.a;
  }
}

}  // namespace

std::unique_ptr<BandSolver> make_layerwise_solver(const CorrectionPlan& plan, std::size_t columns) {
  return std::make_unique<LayerwiseSolver>(plan, columns);
}

std::vector<std::uint8_t> solve_layerwise_column(const CorrectionPlan& plan,
                                                 const std::vector<std::uint8_t>& coverage,
                                                 const std::vector<std::uint8_t>& heights) {
  std::vector<std::uint8_t> levels(static_cast<std::size_t>(plan.all_layers));
  walk_column(plan, coverage, heights,
              [&](std::size_t n, std::uint8_t c, double ratio, double far_edge, double left) {
                const int level = layer_level(plan, c, ratio, far_edge, left, 1.0 + kMargin);
                levels[n] = static_cast<std::uint8_t>(level);
                return plan.levels.phi(level);
              });
  return levels;
}

std::vector<double> solve_layerwise_column_exactly(const CorrectionPlan& plan,
                                                   const std::vector<std::uint8_t>& coverage,
                                                   const std::vector<std::uint8_t>& heights) {
  const CureModel& model = plan.model;
  std::vector<double> phi(static_cast<std::size_t>(plan.all_layers));
  walk_column(
      plan, coverage, heights,
      [&](std::size_t n, std::uint8_t c, double ratio, double far_edge, double left) {
        const double at_window = c == 0 ? 0.0 : c == kFull ? 1.0 / left : aim_of(c) / model.root_a;
        phi[n] = std::clamp((at_window - far_edge) / ratio, model.phi_min(), model.phi_max());
        return phi[n];
      });
  return phi;
}

}  // namespace slicecorr::detail
