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
    if (setup.goes_sideways()) {
      blurs_.push_back(blurs_along(setup, beam, all[axis], cells.index[axis]));
    }
  }
}

int BeamProjector::place_count(std::size_t beam) const {
  const int axis = beams_[beam].axis;
  return axis == 0 ? nx_ : axis == 1 ? ny_ : nz_;
}

std::size_t BeamProjector::cell_over(std::size_t beam, int place, int column, int row) const {
  const int axis = beams_[beam].axis;
  return axis == 0   ? cell(place, column, row)
         : axis == 1 ? cell(column, place, row)
                     : cell(column, row, place);
}

void BeamProjector::blur(std::size_t beam, std::size_t place, const std::vector<float>& from,
                         std::vector<float>& to) const {
  const auto columns = static_cast<std::size_t>(image_columns(beam));
  const int rows = image_rows(beam), wide = image_columns(beam);
  std::vector<float> along(from.size());
  for (const CellBlur::Gaussian& g : blurs_[beam][place].sum) {
    const int reach = static_cast<int>(g.shares.size()) - 1;
    std::fill(along.begin(), along.end(), 0.0F);
    for (int r = 0; r < rows; ++r) {
      const float* const row = from.data() + static_cast<std::size_t>(r) * columns;
      float* const out = along.data() + static_cast<std::size_t>(r) * columns;
      for (int k = -reach; k <= reach; ++k) {
        const auto share = static_cast<float>(g.shares[static_cast<std::size_t>(std::abs(k))]);
        for (int c = std::max(0, -k); c < std::min(wide, wide - k); ++c) {
          out[c] += share * row[c + k];
        }
      }
    }
    for (int r = 0; r < rows; ++r) {
      for (int k = std::max(-reach, -r); k <= std::min(reach, rows - 1 - r); ++k) {
        const auto share =
            static_cast<float>(g.weight * g.shares[static_cast<std::size_t>(std::abs(k))]);
        add_times(to.data() + static_cast<std::size_t>(r) * columns,
                  along.data() + static_cast<std::size_t>(r + k) * columns, share, columns);
      }
    }
  }
}

void BeamProjector::forward_sideways(const float* field, float* light,
                                     const ExecutionContext& context) const {
  parallel_for(silent(context), "", beams_.size(), [&](std::size_t beam) {
    const int columns = image_columns(beam), rows = image_rows(beam);
    std::vector<float> slice(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows)),
        sum(slice.size());
    for (int place = 0; place < place_count(beam); ++place) {
      const float left = left_[beam][static_cast<std::size_t>(place)];
      std::size_t i = 0;
      for (int r = 0; r < rows; ++r) {
        for (int c = 0; c < columns; ++c) slice[i++] = left * field[cell_over(beam, place, c, r)];
      }
      blur(beam, static_cast<std::size_t>(place), slice, sum);
    }
    std::size_t i = 0;
    for (int r = 0; r < rows; ++r) {
      for (int c = 0; c < columns; ++c) light[pixel(beam, c, r)] = sum[i++];
    }
  });
}

void BeamProjector::adjoint_sideways(const float* light, float* field,
                                     const ExecutionContext& context) const {
  // Beam after beam, so that sums have one order; places along it are cells of their own.
  for (std::size_t beam = 0; beam < beams_.size(); ++beam) {
    const int columns = image_columns(beam), rows = image_rows(beam);
    std::vector<float> image;
    for (int r = 0; r < rows; ++r) {
      for (int c = 0; c < columns; ++c) image.push_back(light[pixel(beam, c, r)]);
    }
    parallel_for(silent(context), "", static_cast<std::size_t>(place_count(beam)),
                 [&](std::size_t place) {
                   std::vector<float> here(image.size());
                   blur(beam, place, image, here);
                   const float left = left_[beam][place];
                   std::size_t i = 0;
                   for (int r = 0; r < rows; ++r) {
                     for (int c = 0; c < columns; ++c) {
                       field[cell_over(beam, static_cast<int>(place), c, r)] += left * here[i++];
                     }
                   }
                 });
  }
}

void BeamProjector::forward(std::size_t /*block*/, const float* field, float* light,
                            const ExecutionContext& context) const {
  std::fill_n(light, shape_.light_of_block, 0.0F);
  if (!blurs_.empty()) return forward_sideways(field, light, context);
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
  if (!blurs_.empty()) return adjoint_sideways(light, field, context);
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
