// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/beams/beam_projector.hpp"

#include <algorithm>

#include "base/kernels.hpp"
#include "parallel/silent.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::tomo::detail {
namespace {

using slicecorr::detail::silent;
constexpr std::size_t kLanes = 16;
/// Products that make a thread worth while.
constexpr std::size_t kProductsAThread = 100000;

/// to += by * from
SLICECORR_CLONES void add_times(float* to, const float* from, float by, std::size_t lanes) {
  for (std::size_t i = 0; i < lanes; ++i) to[i] += by * from[i];
}

/// to += weight * by
SLICECORR_CLONES void add_weights(float* to, const float* weight, float by, std::size_t lanes) {
  for (std::size_t i = 0; i < lanes; ++i) to[i] += weight[i] * by;
}

/// Sum of weight * from, by lanes first, so that vectors of any width add up alike.
SLICECORR_CLONES float weighted_sum(const float* weight, const float* from, std::size_t lanes) {
  float sums[kLanes] = {};
  for (std::size_t i = 0; i < lanes; i += kLanes) {
    for (std::size_t l = 0; l < kLanes; ++l) sums[l] += weight[i + l] * from[i + l];
  }
  float sum = 0;
  for (const float s : sums) sum += s;
  return sum;
}

}  // namespace

BeamProjector::BeamProjector(const Box<std::uint8_t>& part, const DecidingCells& cells,
                             const BeamSetup& setup)
    : beams_(setup.beams), nx_(cells.size(0)), ny_(cells.size(1)), nz_(cells.size(2)) {
  // Slices that share light are two or more, angles three.
  grid_.voxels = std::max({nx_, ny_, 3});
  grid_.slices = std::max(2, nz_);
  grid_.angles = std::max<int>(3, static_cast<int>(beams_.size()));
  grid_.pixels = grid_.voxels;
  grid_.rows = std::max(grid_.slices, grid_.voxels);
  grid_.radius_mm = 0.5 * (grid_.voxels - 1) * setup.cell_mm;
  grid_.pixel_mm = setup.cell_mm;
  grid_.check();
  const int all[3] = {part.nx, part.ny, part.nz};
  for (const Beam& beam : beams_) {
    const auto axis = static_cast<std::size_t>(beam.axis);
    const std::vector<double> left = light_left(setup, beam, all[axis], cells.index[axis]);
    Array<float> padded(std::max(left.size(), static_cast<std::size_t>(grid_.lanes())));
    std::transform(left.begin(), left.end(), padded.begin(),
                   [](double share) { return static_cast<float>(share); });
    left_.push_back(std::move(padded));
  }
}

void BeamProjector::forward(std::size_t /*block*/, const float* field, float* light,
                            const ExecutionContext& context) const {
  std::fill_n(light, grid_.light_of_block(), 0.0F);
  const auto lanes = static_cast<std::size_t>(grid_.lanes());
  const std::size_t rows = std::min(lanes, static_cast<std::size_t>(grid_.light_lanes()));
  const ExecutionContext worth =
      silent(context, grid_.voxels_of_block() * beams_.size(), kProductsAThread);
  // Each pixel is one item's alone: those of beams along x and z lie in one y, those of beams along y
  // in one x.
  parallel_for(worth, "", static_cast<std::size_t>(ny_), [&](std::size_t row) {
    const int y = static_cast<int>(row);
    for (int x = 0; x < nx_; ++x) {
      const float* const column = field + grid_.voxel(x, y, 0);
      for (std::size_t k = 0; k < beams_.size(); ++k) {
        if (beams_[k].axis == 0) {
          add_times(light + pixel(k, x, y, 0), column, left_[k][static_cast<std::size_t>(x)], rows);
        } else if (beams_[k].axis == 2) {
          light[pixel(k, x, y, 0)] = weighted_sum(left_[k].data(), column, lanes);
        }
      }
    }
  });
  parallel_for(worth, "", static_cast<std::size_t>(nx_), [&](std::size_t column) {
    const int x = static_cast<int>(column);
    for (std::size_t k = 0; k < beams_.size(); ++k) {
      if (beams_[k].axis != 1) continue;
      for (int y = 0; y < ny_; ++y) {
        add_times(light + pixel(k, x, y, 0), field + grid_.voxel(x, y, 0),
                  left_[k][static_cast<std::size_t>(y)], rows);
      }
    }
  });
}

void BeamProjector::adjoint(std::size_t /*block*/, const float* light, float* field,
                            const ExecutionContext& context) const {
  std::fill_n(field, grid_.voxels_of_block(), 0.0F);
  const auto lanes = static_cast<std::size_t>(grid_.lanes());
  const std::size_t rows = std::min(lanes, static_cast<std::size_t>(grid_.light_lanes()));
  const ExecutionContext worth =
      silent(context, grid_.voxels_of_block() * beams_.size(), kProductsAThread);
  parallel_for(worth, "", static_cast<std::size_t>(ny_), [&](std::size_t row) {
    const int y = static_cast<int>(row);
    for (int x = 0; x < nx_; ++x) {
      float* const column = field + grid_.voxel(x, y, 0);
      for (std::size_t k = 0; k < beams_.size(); ++k) {
        const float* const here = light + pixel(k, x, y, 0);
        if (beams_[k].axis == 2) {
          add_weights(column, left_[k].data(), *here, lanes);
        } else {
          const int at = beams_[k].axis == 0 ? x : y;
          add_times(column, here, left_[k][static_cast<std::size_t>(at)], rows);
        }
      }
      // Rows of light that lie beyond the last cell.
      std::fill(column + nz_, column + lanes, 0.0F);
    }
  });
}

std::unique_ptr<Projector> BeamProjector::of_slices(const std::vector<int>& /*slices*/) const {
  throw InputError("slices", "", "share their light");
}

}  // namespace slicecorr::tomo::detail
