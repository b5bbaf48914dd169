// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <tuple>

#include "base/coded_band.hpp"
#include "base/kernels.hpp"
#include "correct/band_solvers.hpp"
#include "correct/coverage.hpp"
#include "correct/layer_level.hpp"
#include "correct/lifted_feature.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/target.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::detail {

namespace {

/// Levels of the features of a band that must hold at every lift: what `LiftedFeature` says, found once
/// for those that are alike.
class LiftedFeatures {
 public:
  LiftedFeatures(const CorrectionPlan& plan, std::size_t columns)
      : plan_(plan),
        light_(plan.model, &plan.levels, plan.most_exchange),
        begun_(columns, {-1, 0}),
        before_(columns, 0),
        at_(columns) {}

  /// The layers from the platform on.
  void add_layer(int layer, const std::uint8_t* coverage, const std::uint8_t* heights,
                 const std::uint8_t* left_alone) {
    for (std::size_t i = 0; i < begun_.size(); ++i) {
      const bool full = coverage && coverage[i] == kFull && !(left_alone && left_alone[i]);
      if (full && begun_[i].node < 0) {
        const bool gap = before_[i] == 0;
        begun_[i] = {layer, gap && heights ? heights[i] : std::uint8_t{0}};
      } else if (!full && begun_[i].node >= 0) {
        end(i, layer);
      }
      before_[i] = coverage ? coverage[i] : std::uint8_t{0};
    }
  }
  /// After the last.
  void end_all(int layers) {
    for (std::size_t i = 0; i < begun_.size(); ++i) {
      if (begun_[i].node >= 0) end(i, layers);
    }
  }
  /// The slices from the last on: features that begin with slice n, seen from the window.
  void begin_slice(int n) {
    for (; !features_.empty() && features_.back().end == n + 1; features_.pop_back()) {
      const Feature& f = features_.back();
      at_[f.column] = {f.begun, f.end, nullptr};
    }
  }
  /// The level of a column's slice. `after`: dose that later slices leave at its layer's window.
  int level(std::size_t column, int n, double after) {
    Now& now = at_[column];
    const int top = plan_.levels.highest();
    // Nothing lies above what stands on the platform.
    if (now.begun.node == 0) return top;
    const int j = n - now.begun.node, layers = std::min(now.end - now.begun.node, light_.reach());
    if (j >= layers) return top;
    if (!now.levels) now.levels = find(now.begun, layers, after);
    return (*now.levels)[static_cast<std::size_t>(j)];
  }

 private:
  struct Begun {
    std::int32_t node;
    std::uint8_t height;
  };
  struct Feature {
    std::uint32_t column;
    std::int32_t end;
    Begun begun;
  };
  using Levels = std::shared_ptr<const std::vector<std::uint8_t>>;
  struct Now {
    Begun begun{0, 0};
    std::int32_t end = 0;
    Levels levels;
  };
  void end(std::size_t column, int layer) {
    features_.push_back({static_cast<std::uint32_t>(column), layer, begun_[column]});
    begun_[column].node = -1;
  }
  Levels find(const Begun& begun, int layers, double after) {
    Levels& known = known_[{begun.node, begun.height, layers, after}];
    if (known) return known;
    // Those of a few layers are enough: most columns are like a neighbour.
    if (known_.size() > kMostKnown) known_.clear();
    const double below = begun.height == 0 ? 0.0 : edge_height_slices(begun.height);
    const auto light = light_.solve({begun.node, layers, after, below});
    auto levels = std::make_shared<std::vector<std::uint8_t>>();
    for (const double phi : light.phi) {
      levels->push_back(static_cast<std::uint8_t>(plan_.levels.at_least(phi)));
    }
    return known_[{begun.node, begun.height, layers, after}] = std::move(levels);
  }

  static constexpr std::size_t kMostKnown = 4096;
  const CorrectionPlan& plan_;
  LiftedFeature light_;
  std::vector<Begun> begun_;          ///< of each column, node -1: not in a feature
  std::vector<std::uint8_t> before_;  ///< coverage of the layer before
  std::vector<Feature> features_;     ///< by their ends
  std::vector<Now> at_;
  std::map<std::tuple<int, std::uint8_t, int, double>, Levels> known_;
};

class LayerwiseSolver final : public BandSolver {
 public:
  LayerwiseSolver(const CorrectionPlan& plan, std::size_t columns)
      : plan_(plan), coded_(columns), heights_(columns), left_alone_(columns) {
    if (plan.model.lifts) lifted_ = std::make_unique<LiftedFeatures>(plan, columns);
    for (auto& entry : cache_) entry.far_edge = std::numeric_limits<double>::quiet_NaN();
  }
  void add_layer(const std::uint8_t* coverage, const std::uint8_t* heights,
                 const std::uint8_t* left_alone) override {
    // Windows' sides stay on nodes: the node after the last layer is one.
    if (coded_.slices() == plan_.layers && !coverage) return;
    if (coded_.slices() >= plan_.layers) throw Error("more layers than the plan has");
    if (lifted_) lifted_->add_layer(coded_.slices(), coverage, heights, left_alone);
    coded_.append(coverage);
    heights_.append(heights);
    left_alone_.append(left_alone);
  }
  void solve(const BandCorrector::Sink& sink, const BandCorrector::TileSink& tiles) override;

 private:
  /// Levels that were found, by what they follow from: most columns have the dose of a neighbour.
  struct Entry {
    double far_edge;
    int slice = -1;
    std::uint8_t coverage = 0, height = 0, level = 0;
  };
  int level_of(const LayerLight& light, std::uint8_t coverage, int slice) {
    std::uint64_t bits;
    std::memcpy(&bits, &light.far_edge, sizeof bits);
    Entry& entry = cache_[((bits >> 20) ^ (bits >> 40) ^ bits ^ coverage) % cache_.size()];
    if (entry.far_edge != light.far_edge || entry.coverage != coverage || entry.slice != slice ||
        entry.height != light.height) {
      LayerLight here = light;
      here.slice = slice;
      const int level = layer_level(here, coverage);
      entry = {light.far_edge, slice, coverage, light.height, static_cast<std::uint8_t>(level)};
    }
    return entry.level;
  }

  const CorrectionPlan& plan_;
  CodedBand coded_, heights_, left_alone_;
  std::unique_ptr<LiftedFeatures> lifted_;
  std::array<Entry, 256> cache_;
};

/// One layer of black light for a block.
SLICECORR_CLONES
void darken(double* far_edge, double dark, double a) {
  for (std::size_t i = 0; i < kBlock; ++i) far_edge[i] = (dark + far_edge[i]) * a;
}

/// What later slices leave at the far edge of a layer whose slice has this light. Where lifts exchange
/// resin it is no less than the brightest of them, which is taken: no feature gets thinner by it.
double left_by(const CureModel& model, int slice, double light, double after) {
  const bool exchanged = model.lifts && model.lifts->exchange.value_or(0) > 0;
  // In resin that ends the brightest may have left it.
  if (exchanged && model.bath_slices > 0) return light * model.a_of(slice);
  return (exchanged ? std::max(light, after) : light + after) * model.a_of(slice);
}

void LayerwiseSolver::solve(const BandCorrector::Sink& sink, const BandCorrector::TileSink&) {
  if (coded_.slices() != plan_.layers) throw Error("the plan has more layers");
  if (lifted_) lifted_->end_all(plan_.layers);
  const bool exchanged = plan_.model.lifts && plan_.model.lifts->exchange.value_or(0) > 0;
  const std::size_t columns = coded_.columns();
  std::vector<double> far_edge(columns, 0.0);
  std::vector<std::uint8_t> out(columns), here(columns), above(columns);
  std::vector<std::uint8_t> heights(columns), left(columns, 0);
  // Levels of the slices that are still in the bath, by slice modulo its depth.
  const auto bath = static_cast<std::size_t>(plan_.model.bath_slices);
  std::vector<std::uint8_t> held(bath * columns, 0);
  coded_.read(plan_.all_layers - 1, here.data());
  for (int n = plan_.all_layers; n-- > 0;) {
    coded_.read(n - 1, above.data());
    heights_.read(n, heights.data());
    if (lifted_) lifted_->begin_slice(n);
    const double ratio = plan_.model.ratio(n);
    const double dark = plan_.levels.phi(0) * ratio;
    const double dark_above = dark_window(plan_, n - 1);
    const bool leaves_alone = n < left_alone_.slices() && !left_alone_.black(n);
    if (leaves_alone) left_alone_.read(n, left.data());
    bool all_dark = true;
    std::uint8_t* const leaves =
        bath > 0 ? held.data() + static_cast<std::size_t>(n) % bath * columns : nullptr;
    if (leaves && !exchanged && n + plan_.model.bath_slices < plan_.all_layers) {
      const double far_ratio = plan_.model.ratio(n + plan_.model.bath_slices);
      for (std::size_t i = 0; i < columns; ++i) {
        far_edge[i] -= plan_.model.beyond * (plan_.levels.phi(leaves[i]) * far_ratio);
      }
    }
    for (std::size_t b = 0; b < columns; b += kBlock) {
      const std::size_t end = std::min(b + kBlock, columns);
      const bool gap = all_zero(here.data() + b, end - b) &&
                       (!leaves_alone || all_zero(left.data() + b, end - b));
      if (gap && end - b == kBlock) {
        if (exchanged) {
          for (std::size_t i = b; i < end; ++i)
            far_edge[i] = left_by(plan_.model, n, dark, far_edge[i]);
        } else {
          darken(&far_edge[b], dark, plan_.model.a_of(n));
        }
        std::memset(out.data() + b, 0, kBlock);
        continue;
      }
      if (!gap) all_dark = false;
      const auto show = [&](std::size_t i, int level) {
        out[i] = static_cast<std::uint8_t>(level);
        if (level) all_dark = false;
        far_edge[i] = left_by(plan_.model, n, plan_.levels.phi(level) * ratio, far_edge[i]);
      };
      const auto solve_voxel = [&](std::size_t i) {
        const LayerLight light{
            plan_, ratio, far_edge[i], dark_above, above[i] == 0 ? heights[i] : std::uint8_t{0}, 0};
        show(i, here[i] == 0                  ? 0
                : lifted_ && here[i] == kFull ? lifted_->level(i, n, far_edge[i])
                                              : level_of(light, here[i], n));
      };
      if (!leaves_alone) {
        for (std::size_t i = b; i < end; ++i) solve_voxel(i);
        continue;
      }
      for (std::size_t i = b; i < end; ++i) {
        if (left[i]) {
          show(i, level_of_pixel(left[i], plan_.levels.size()));
        } else {
          solve_voxel(i);
        }
      }
    }
    if (leaves) std::copy(out.begin(), out.end(), leaves);
    sink(n, out.data(), here.data(), all_dark);
    here.swap(above);
  }
}

/// The same of one column, whose slices are asked from the last to the first.
class LiftedColumn {
 public:
  LiftedColumn(const CorrectionPlan& plan, const LevelTable* levels,
               const std::vector<std::uint8_t>& coverage, const std::vector<std::uint8_t>& heights)
      : plan_(plan),
        light_(plan.model, levels, plan.most_exchange),
        coverage_(coverage),
        heights_(heights) {}
  /// phi of the slice of a full layer.
  double phi(int n, double after) {
    if (n < node_ || node_ < 0) {
      int end = n + 1;
      for (node_ = n; node_ > 0 && full(node_ - 1);) --node_;
      while (full(end)) ++end;
      layers_ = std::min(end - node_, light_.reach());
      phi_.clear();
    }
    if (node_ == 0 || n - node_ >= layers_) return plan_.model.phi_max();
    if (phi_.empty()) {
      const auto k = static_cast<std::size_t>(node_);
      const bool gap = coverage_[k - 1] == 0 && k < heights_.size() && heights_[k] != 0;
      phi_ = light_.solve({node_, layers_, after, gap ? edge_height_slices(heights_[k]) : 0.0}).phi;
    }
    return phi_[static_cast<std::size_t>(n - node_)];
  }

 private:
  bool full(int n) const {
    return n < plan_.layers && coverage_[static_cast<std::size_t>(n)] == kFull;
  }
  const CorrectionPlan& plan_;
  LiftedFeature light_;
  const std::vector<std::uint8_t>&coverage_, &heights_;
  int node_ = -1, layers_ = 0;  ///< of the feature at hand
  std::vector<double> phi_;
};

/// Walks one column from the last slice to the first: `choose(n, coverage, light)` gives the
/// intensity phi' at the normal exposure.
template <typename Choose>
void walk_column(const CorrectionPlan& plan, const std::vector<std::uint8_t>& coverage,
                 const std::vector<std::uint8_t>& heights, Choose choose) {
  const auto at = [&](int layer) {
    const bool inside = layer >= 0 && layer < plan.layers;
    return inside ? coverage[static_cast<std::size_t>(layer)] : std::uint8_t{0};
  };
  double far_edge = 0;
  const int bath = plan.model.bath_slices;
  std::vector<double> shown(bath > 0 ? static_cast<std::size_t>(plan.all_layers) : 0);
  for (int n = plan.all_layers; n-- > 0;) {
    const double ratio = plan.model.ratio(n);
    if (bath > 0 && n + bath < plan.all_layers) {
      far_edge -= plan.model.beyond *
                  (shown[static_cast<std::size_t>(n + bath)] * plan.model.ratio(n + bath));
    }
    const std::uint8_t c = at(n);
    const auto k = static_cast<std::size_t>(n);
    const bool gap_above = at(n - 1) == 0;
    const std::uint8_t height = gap_above && k < heights.size() ? heights[k] : std::uint8_t{0};
    const double phi =
        choose(k, c, LayerLight{plan, ratio, far_edge, dark_window(plan, n - 1), height, n});
    far_edge = left_by(plan.model, n, phi * ratio, far_edge);
    if (bath > 0) shown[k] = phi;
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
  std::optional<LiftedColumn> lifted;
  if (plan.model.lifts) lifted.emplace(plan, &plan.levels, coverage, heights);
  walk_column(plan, coverage, heights, [&](std::size_t n, std::uint8_t c, const LayerLight& light) {
    const bool holds = lifted && c == kFull;
    const int level = holds ? plan.levels.at_least(lifted->phi(static_cast<int>(n), light.far_edge))
                            : layer_level(light, c);
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
  std::optional<LiftedColumn> lifted;
  if (model.lifts) lifted.emplace(plan, nullptr, coverage, heights);
  walk_column(plan, coverage, heights, [&](std::size_t n, std::uint8_t c, const LayerLight& light) {
    if (lifted && c == kFull) return phi[n] = lifted->phi(static_cast<int>(n), light.far_edge);
    const double at_window =
        c == 0       ? 0.0
        : c == kFull ? light.wanted()
                     : aim_of(c) / model.root_a_of(static_cast<int>(n)) / light.returned(0.5);
    phi[n] = std::clamp(light.phi(at_window), model.phi_min(), model.phi_max());
    return phi[n];
  });
  return phi;
}

}  // namespace slicecorr::detail
