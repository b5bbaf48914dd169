// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The pair of operators of level light that is traced: all weights are kept, frame by frame, and both
// operators take the same ones.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <utility>
#include <vector>

#include "parallel/silent.hpp"
#include "slicecorr/error.hpp"
#include "tomo/operators/traced_light.hpp"

namespace slicecorr::tomo::detail {

namespace {

using slicecorr::detail::silent;

/// What light of a pixel a column of voxels gets.
struct Weight {
  std::uint16_t x = 0, pixel = 0;
  float share = 0;
};
/// Of a frame, row of voxels by row of voxels.
struct FrameWeights {
  std::vector<std::uint32_t> first;  ///< of each row, and the end
  std::vector<Weight> all;
};

/// Rows of voxels that one thread takes.
constexpr int kRowsOfThread = 8;

class TracedProjector final : public Projector {
 public:
  TracedProjector(const TomoGrid& grid, const TracedLight& light) : grid_(grid) {
    grid.check();
    auto frames =
        std::make_shared<std::vector<FrameWeights>>(static_cast<std::size_t>(grid.angles));
    const double step = 2 * std::numbers::pi / grid.angles;
    const TracedStrips strips(grid, light, grid.voxel_mm(), step / traced_angles(grid, step));
    parallel_for({}, "", frames->size(), [&](std::size_t m) {
      (*frames)[m] = frame_of(strips, light.bundles.front(), static_cast<int>(m));
    });
    frames_ = std::move(frames);
  }

  Shape shape() const override { return grid_.shape(); }

  std::unique_ptr<Projector> of_slices(const std::vector<int>& slices) const override {
    auto part = std::make_unique<TracedProjector>(*this);
    part->grid_.slices = static_cast<int>(slices.size());
    return part;
  }

  void adjoint(std::size_t /*block*/, const float* light, float* field,
               const ExecutionContext& context) const override {
    std::fill_n(field, grid_.voxels_of_block(), 0.0F);
    const auto pieces =
        static_cast<std::size_t>((grid_.voxels + kRowsOfThread - 1) / kRowsOfThread);
    const std::size_t lanes = this->lanes();
    parallel_for(worth(context), "", pieces, [&](std::size_t piece) {
      const int first = static_cast<int>(piece) * kRowsOfThread,
                end = std::min(grid_.voxels, first + kRowsOfThread);
      for (int m = 0; m < grid_.angles; ++m) {
        const float* const from = light + grid_.pixel(m, 0, 0);
        for (int y = first; y < end; ++y) {
          float* const to = field + grid_.voxel(0, y, 0);
          each(m, y, [&](const Weight& w) {
            const float* const a = from + w.pixel * lanes;
            float* const b = to + w.x * lanes;
            for (std::size_t l = 0; l < lanes; ++l) b[l] += w.share * a[l];
          });
        }
      }
    });
  }

  void forward(std::size_t /*block*/, const float* field, float* light,
               const ExecutionContext& context) const override {
    std::fill_n(light, grid_.light_of_block(), 0.0F);
    const std::size_t lanes = this->lanes();
    parallel_for(worth(context), "", static_cast<std::size_t>(grid_.angles), [&](std::size_t m) {
      float* const to = light + grid_.pixel(static_cast<int>(m), 0, 0);
      for (int y = 0; y < grid_.voxels; ++y) {
        const float* const from = field + grid_.voxel(0, y, 0);
        each(static_cast<int>(m), y, [&](const Weight& w) {
          const float* const a = from + w.x * lanes;
          float* const b = to + w.pixel * lanes;
          for (std::size_t l = 0; l < lanes; ++l) b[l] += w.share * a[l];
        });
      }
    });
  }

 private:
  std::size_t lanes() const { return static_cast<std::size_t>(grid_.lanes()); }
  ExecutionContext worth(const ExecutionContext& context) const {
    ExecutionContext quiet = silent(context);
    const double work = static_cast<double>(grid_.voxels_of_block()) * grid_.angles / 5e6;
    quiet.threads = static_cast<int>(std::clamp(work, 1.0, 1.0 * thread_count(context)));
    return quiet;
  }
  template <class Use>
  void each(int m, int y, const Use& use) const {
    const FrameWeights& frame = (*frames_)[static_cast<std::size_t>(m)];
    const std::uint32_t end = frame.first[static_cast<std::size_t>(y) + 1];
    for (std::uint32_t k = frame.first[static_cast<std::size_t>(y)]; k < end; ++k) {
      use(frame.all[k]);
    }
  }

  /// Weights of a frame.
  FrameWeights frame_of(const TracedStrips& strips, const TracedBundle& bundle, int m) const {
    const std::vector<TracedWeight> found =
        weights_of(strips, grid_, bundle, turns_of_frame(grid_, m));
    FrameWeights frame;
    frame.first.assign(static_cast<std::size_t>(grid_.voxels) + 1, 0);
    frame.all.reserve(found.size());
    for (const TracedWeight& f : found) {
      ++frame.first[std::size_t{f.y} + 1];
      frame.all.push_back({f.x, f.pixel, f.share});
    }
    for (std::size_t y = 1; y < frame.first.size(); ++y) frame.first[y] += frame.first[y - 1];
    return frame;
  }

  TomoGrid grid_;
  std::shared_ptr<const std::vector<FrameWeights>> frames_;  ///< [angle]
};

}  // namespace

double bytes_of_weights(const TomoGrid& grid, const TracedLight& light) {
  // A voxel meets the pixels that its diagonal does, and one more.
  const double per_voxel = std::sqrt(2.0) * grid.voxel_mm() / light.pitch_mm + 1;
  const auto resin = static_cast<double>(std::count(light.resin.begin(), light.resin.end(), true));
  const double bytes = light.rows ? sizeof(TracedWeight) : sizeof(Weight);
  return bytes * static_cast<double>(light.bundles.size()) * per_voxel * grid.angles * resin;
}

std::unique_ptr<Projector> make_traced_projector(const TomoGrid& grid, const TracedLight& light) {
  const double bytes = bytes_of_weights(grid, light);
  if (bytes > kMostTracedBytes) {
    throw InputError(fmt::format(
        "light through this vial is traced, and the weights of {} x {} voxels in {} angles would "
        "take {:.1f} GB; expected larger voxels, or fewer angles",
        grid.voxels, grid.voxels, grid.angles, bytes * 1e-9));
  }
  if (light.rows) return make_rising_projector(grid, light);
  return std::make_unique<TracedProjector>(grid, light);
}

}  // namespace slicecorr::tomo::detail
