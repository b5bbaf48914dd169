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
    const int angles = traced_angles(grid, step);
    const TracedStrips strips(grid, light, grid.voxel_mm(), step / angles);
    parallel_for({}, "", frames->size(), [&](std::size_t m) {
      const double th = step * static_cast<double>(m);
      std::vector<double> turns;
      turns.reserve(static_cast<std::size_t>(angles));
      for (int k = 0; k < angles; ++k) turns.push_back(th + step * ((k + 0.5) / angles - 0.5));
      (*frames)[m] = frame_of(strips, turns);
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

  /// Weights of a frame: the mean over these angles.
  FrameWeights frame_of(const TracedStrips& strips, const std::vector<double>& turns) const {
    const auto n = static_cast<std::size_t>(grid_.voxels);
    std::vector<float> sums(n * n);
    std::vector<std::size_t> met;
    struct Found {
      std::uint16_t x, y, pixel;
      float share;
    };
    std::vector<Found> found;
    for (int i = 0; i < grid_.pixels; ++i) {
      met.clear();
      for (const double th : turns) {
        strips.of_pixel(th, i, [&](const TracedShare& s) {
          const std::size_t at = static_cast<std::size_t>(s.y) * n + static_cast<std::size_t>(s.x);
          if (sums[at] == 0) met.push_back(at);
          sums[at] += static_cast<float>(s.share / static_cast<double>(turns.size()));
        });
      }
      for (const std::size_t at : met) {
        found.push_back({static_cast<std::uint16_t>(at % n), static_cast<std::uint16_t>(at / n),
                         static_cast<std::uint16_t>(i), sums[at]});
        sums[at] = 0;
      }
    }
    std::stable_sort(found.begin(), found.end(), [](const Found& a, const Found& b) {
      return std::pair(a.y, a.x) < std::pair(b.y, b.x);
    });
    FrameWeights frame;
    frame.first.assign(n + 1, 0);
    frame.all.reserve(found.size());
    for (const Found& f : found) {
      ++frame.first[std::size_t{f.y} + 1];
      frame.all.push_back({f.x, f.pixel, f.share});
    }
    for (std::size_t y = 0; y < n; ++y) frame.first[y + 1] += frame.first[y];
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
  return sizeof(Weight) * per_voxel * grid.angles * resin;
}

std::unique_ptr<Projector> make_traced_projector(const TomoGrid& grid, const TracedLight& light) {
  const double bytes = bytes_of_weights(grid, light);
  if (bytes > kMostTracedBytes) {
    throw InputError(fmt::format(
        "light through this vial is traced, and the weights of {} x {} voxels in {} angles would "
        "take {:.1f} GB; expected larger voxels, or fewer angles",
        grid.voxels, grid.voxels, grid.angles, bytes * 1e-9));
  }
  return std::make_unique<TracedProjector>(grid, light);
}

}  // namespace slicecorr::tomo::detail
