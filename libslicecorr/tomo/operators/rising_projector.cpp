// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The pair of operators of traced light that rises or falls on its way. Weights across the axis are kept, bundle
// by bundle; which slices a row of pixels meets there is worked out anew each time, from how far its light has
// risen. Both operators take the same numbers.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "parallel/silent.hpp"
#include "tomo/operators/traced_light.hpp"

namespace slicecorr::tomo::detail {

namespace {

using slicecorr::detail::silent;

/// Weights of a bundle in a frame, row of voxels by row of voxels.
struct BundleWeights {
  std::vector<std::uint32_t> first;  ///< of each row, and the end
  std::vector<TracedWeight> all;
};

/// A row's edge: in slices from the lowest one's foot, and by how much it rises.
struct Edge {
  float at = 0, by_mm = 0;
};

constexpr int kRowsTogether = 8;

class RisingProjector final : public Projector {
 public:
  RisingProjector(const TomoGrid& grid, const TracedLight& light)
      : grid_(grid),
        bundles_(light.bundles),
        lit_(static_cast<float>(light.rows->lit)),
        edges_of_ray_(static_cast<std::size_t>(grid.pixels) *
                      (static_cast<std::size_t>(grid.rows) + 1)) {
    grid.check();
    const TracedRows& rows = *light.rows;
    const double foot_mm = grid.lowest_mm - grid.slice_height_mm() / 2;
    for (int ray = 0; ray < static_cast<int>(rows.points.size()); ++ray) {
      for (int i = 0; i < grid.pixels; ++i) {
        for (int r = 0; r <= grid.rows; ++r) {
          const TracedLine line = rows.line(i, r - 0.5, ray);
          edges_.push_back(
              {static_cast<float>((line.z_mm - foot_mm) / grid.slice_height_mm()),
               static_cast<float>(light.vial.n_outside() * line.kz / grid.slice_height_mm())});
        }
      }
    }
    // All of a pixel's light is that of its row over as many slices as it is high, and of its rays.
    share_ = static_cast<float>(rows.row_mm / grid.slice_height_mm() /
                                static_cast<double>(rows.points.size()));
    auto weights = std::make_shared<std::vector<BundleWeights>>(
        static_cast<std::size_t>(grid.angles) * bundles_.size());
    const double step = grid.angle_rad(1);
    const TracedStrips strips(grid, light, grid.voxel_mm(), step / traced_angles(grid, step));
    parallel_for({}, "", weights->size(), [&](std::size_t k) {
      const std::size_t m = k / bundles_.size();
      (*weights)[k] = of_frame(strips, bundles_[k % bundles_.size()], static_cast<int>(m));
    });
    weights_ = std::move(weights);
  }

  Shape shape() const override { return grid_.shape(); }

  std::unique_ptr<Projector> of_slices(const std::vector<int>& /*slices*/) const override {
    return std::make_unique<RisingProjector>(*this);
  }

  void adjoint(std::size_t /*block*/, const float* light, float* field,
               const ExecutionContext& context) const override {
    std::fill_n(field, grid_.voxels_of_block(), 0.0F);
    const auto pieces =
        static_cast<std::size_t>((grid_.voxels + kRowsTogether - 1) / kRowsTogether);
    parallel_for(silent(context), "", pieces, [&](std::size_t piece) {
      const int first = static_cast<int>(piece) * kRowsTogether,
                end = std::min(grid_.voxels, first + kRowsTogether);
      for (std::size_t k = 0; k < weights_->size(); ++k) {
        const float* const from = light + grid_.pixel(frame_of(k), 0, 0);
        for (int y = first; y < end; ++y) {
          float* const to = field + grid_.voxel(0, y, 0);
          each(k, y, [&](const TracedWeight& w, int r, int z, float share) {
            to[place(w.x, grid_.lanes(), z)] +=
                share * from[place(w.pixel, grid_.light_lanes(), r)];
          });
        }
      }
    });
  }

  void forward(std::size_t /*block*/, const float* field, float* light,
               const ExecutionContext& context) const override {
    std::fill_n(light, grid_.light_of_block(), 0.0F);
    parallel_for(silent(context), "", static_cast<std::size_t>(grid_.angles), [&](std::size_t m) {
      float* const to = light + grid_.pixel(static_cast<int>(m), 0, 0);
      for (std::size_t k = m * bundles_.size(); k < (m + 1) * bundles_.size(); ++k) {
        for (int y = 0; y < grid_.voxels; ++y) {
          const float* const from = field + grid_.voxel(0, y, 0);
          each(k, y, [&](const TracedWeight& w, int r, int z, float share) {
            to[place(w.pixel, grid_.light_lanes(), r)] +=
                share * from[place(w.x, grid_.lanes(), z)];
          });
        }
      }
    });
  }

 private:
  int frame_of(std::size_t k) const { return static_cast<int>(k / bundles_.size()); }
  static std::size_t place(int i, int lanes, int lane) {
    return static_cast<std::size_t>(i) * static_cast<std::size_t>(lanes) +
           static_cast<std::size_t>(lane);
  }

  /// Calls use(weight, row, slice, share) for what a row of voxels gets of a bundle in its frame.
  template <class Use>
  void each(std::size_t k, int y, const Use& use) const {
    const BundleWeights& bundle = (*weights_)[k];
    const TracedBundle& rows = bundles_[k % bundles_.size()];
    const Edge* const of_ray = edges_.data() + static_cast<std::size_t>(rows.ray) * edges_of_ray_;
    const std::uint32_t end = bundle.first[static_cast<std::size_t>(y) + 1];
    const auto slices = static_cast<float>(grid_.slices);
    for (std::uint32_t j = bundle.first[static_cast<std::size_t>(y)]; j < end; ++j) {
      const TracedWeight& w = bundle.all[j];
      const Edge* const edges = of_ray + place(w.pixel, grid_.rows + 1, 0);
      float high = edges[rows.first_row].at + edges[rows.first_row].by_mm * w.rise_mm;
      for (int r = rows.first_row; r < rows.end_row; ++r) {
        const float low = high;
        high = edges[r + 1].at + edges[r + 1].by_mm * w.rise_mm;
        const float gap = 0.5F * (1 - lit_) * (high - low);
        const float a = std::max(low + gap, 0.0F), b = std::min(high - gap, slices);
        if (!(a < b)) continue;
        const float share = share_ * w.share / (lit_ * (high - low));
        const int last = std::min(static_cast<int>(b), grid_.slices - 1);
        for (int z = static_cast<int>(a); z <= last; ++z) {
          const float in =
              std::min(b, static_cast<float>(z + 1)) - std::max(a, static_cast<float>(z));
          use(w, r, z, share * in);
        }
      }
    }
  }

  BundleWeights of_frame(const TracedStrips& strips, const TracedBundle& bundle, int m) const {
    BundleWeights weights;
    weights.all = weights_of(strips, grid_, bundle, turns_of_frame(grid_, m));
    weights.first.assign(static_cast<std::size_t>(grid_.voxels) + 1, 0);
    for (const TracedWeight& w : weights.all) ++weights.first[std::size_t{w.y} + 1];
    for (std::size_t y = 1; y < weights.first.size(); ++y) {
      weights.first[y] += weights.first[y - 1];
    }
    return weights;
  }

  TomoGrid grid_;
  std::vector<TracedBundle> bundles_;
  float lit_ = 1, share_ = 1;
  std::size_t edges_of_ray_ = 0;
  std::vector<Edge> edges_;                                    ///< [ray][pixel][edge]
  std::shared_ptr<const std::vector<BundleWeights>> weights_;  ///< [angle][bundle]
};

}  // namespace

std::unique_ptr<Projector> make_rising_projector(const TomoGrid& grid, const TracedLight& light) {
  return std::make_unique<RisingProjector>(grid, light);
}

}  // namespace slicecorr::tomo::detail
