// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/beams/beam_projector.hpp"

#include <algorithm>

#include "base/kernels.hpp"
#include "parallel/silent.hpp"

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
    : beams_(setup.beams),
      nx_(cells.size(0)),
      ny_(cells.size(1)),
      nz_(cells.size(2)),
      side_(static_cast<std::size_t>(std::max(nx_, ny_))),
      rows_((std::max<std::size_t>(side_, nz_) + 15) / 16 * 16) {
  const int lanes = Shape::all_lanes(nz_);
  shape_ = {nz_, lanes, true, side_ * ny_ * lanes, beams_.size() * side_ * rows_};
  const int all[3] = {part.nx, part.ny, part.nz};
  for (const Beam& beam : beams_) {
    const auto axis = static_cast<std::size_t>(beam.axis);
    const std::vector<double> left = light_left(setup, beam, all[axis], cells.index[axis]);
    Array<float> padded(std::max(left.size(), static_cast<std::size_t>(shape_.lanes)));
    std::transform(left.begin(), left.end(), padded.begin(),
                   [](double share) { return static_cast<float>(share); });
    left_.push_back(std::move(padded));
  }
}

void BeamProjector::forward(std::size_t /*block*/, const float* field, float* light,
                            const ExecutionContext& context) const {
  std::fill_n(light, shape_.light_of_block, 0.0F);
  const auto lanes = static_cast<std::size_t>(shape_.lanes);
  const std::size_t rows = std::min(lanes, rows_);
  const ExecutionContext worth =
      silent(context, shape_.field_of_block * beams_.size(), kProductsAThread);
  // Each pixel is one item's alone: those of beams along x and z lie in one y, those of beams along y
  // in one x.
  parallel_for(worth, "", static_cast<std::size_t>(ny_), [&](std::size_t row) {
    const int y = static_cast<int>(row);
    for (int x = 0; x < nx_; ++x) {
      const float* const column = field + cell(x, y, 0);
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
        add_times(light + pixel(k, x, y, 0), field + cell(x, y, 0),
                  left_[k][static_cast<std::size_t>(y)], rows);
      }
    }
  });
}

void BeamProjector::adjoint(std::size_t /*block*/, const float* light, float* field,
                            const ExecutionContext& context) const {
  std::fill_n(field, shape_.field_of_block, 0.0F);
  const auto lanes = static_cast<std::size_t>(shape_.lanes);
  const std::size_t rows = std::min(lanes, rows_);
  const ExecutionContext worth =
      silent(context, shape_.field_of_block * beams_.size(), kProductsAThread);
  parallel_for(worth, "", static_cast<std::size_t>(ny_), [&](std::size_t row) {
    const int y = static_cast<int>(row);
    for (int x = 0; x < nx_; ++x) {
      float* const column = field + cell(x, y, 0);
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

}  // namespace slicecorr::tomo::detail
