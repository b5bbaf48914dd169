// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/projection/certificate.hpp"

#include <algorithm>
#include <limits>

#include "tomo/projection/packed.hpp"

namespace slicecorr::tomo::detail {
namespace {

constexpr double kWithoutEnd = std::numeric_limits<double>::infinity();
/// For the projector's single precision.
constexpr double kMargin = 1e-4;
/// Rounds in which `high` is raised where rays miss something, and by how much of that.
constexpr int kRounds = 12;
constexpr float kRaise = 10;

/// Of each slice of a block.
std::vector<double> bounds_of_block(const Projector& projector, std::size_t block,
                                    const Kind* kinds, const float* dose, double rung,
                                    const ExecutionContext& context) {
  const Shape shape = projector.shape();
  const auto lanes = static_cast<std::size_t>(shape.problem_lanes());
  const std::size_t voxels = shape.field_of_block, pixels = shape.light_of_block;
  Array<float> low(voxels), high(voxels), empty(voxels), seen(voxels), raise(voxels);
  Array<float> a_low(pixels), a_high(pixels), a_empty(pixels), ray(pixels);
  for (std::size_t i = 0; i < voxels; ++i) {
    if (kinds[i] == Kind::gel) {
      low[i] = std::max(0.0f, 1.0f - dose[i]);
    } else if (kinds[i] == Kind::empty) {
      high[i] = std::max(0.0f, dose[i] - static_cast<float>(rung));
      empty[i] = 1;
    }
  }
  projector.forward(block, low.data(), a_low.data(), context);
  projector.forward(block, empty.data(), a_empty.data(), context);
  // What gel lacks on rays that meet no void is nobody's.
  bool alone = false;
  for (std::size_t i = 0; i < pixels; ++i) {
    ray[i] = a_low[i] > 0 && !(a_empty[i] > 0) ? 1.0f : 0.0f;
    alone = alone || ray[i] > 0;
  }
  if (alone) {
    projector.adjoint(block, ray.data(), raise.data(), context);
    for (std::size_t i = 0; i < voxels; ++i) low[i] = raise[i] > 0 ? 0.0f : low[i];
    projector.forward(block, low.data(), a_low.data(), context);
  }
  std::fill(ray.begin(), ray.end(), 1.0f);
  projector.adjoint(block, ray.data(), seen.data(), context);
  std::vector<double> sum_low(lanes), count(lanes), bounds(lanes, kWithoutEnd);
  for (std::size_t i = 0; i < voxels; ++i) {
    sum_low[i % lanes] += low[i];
    count[i % lanes] += empty[i];
  }
  for (int round = 0;; ++round) {
    projector.forward(block, high.data(), a_high.data(), context);
    std::vector<double> sum_high(lanes), delta(lanes);
    for (std::size_t i = 0; i < voxels; ++i) sum_high[i % lanes] += high[i];
    for (std::size_t i = 0; i < pixels; ++i) {
      const double missing = a_low[i] * (1 + kMargin) - a_high[i] * (1 - kMargin);
      ray[i] = 0;
      if (missing <= 0) continue;
      double& most = delta[i % lanes];
      if (!(a_empty[i] > 0)) {
        most = kWithoutEnd;
        continue;
      }
      const double share = missing / (a_empty[i] * (1 - kMargin));
      most = std::max(most, share);
      ray[i] = static_cast<float>(share);
    }
    for (std::size_t l = 0; l < lanes; ++l) {
      if (sum_low[l] > 0 && delta[l] < kWithoutEnd) {
        bounds[l] = std::min(bounds[l], (sum_high[l] + delta[l] * count[l]) / sum_low[l]);
      }
    }
    if (round == kRounds) break;
    // Void on rays that miss something gets the mean of what they miss, and more.
    projector.adjoint(block, ray.data(), raise.data(), context);
    for (std::size_t i = 0; i < voxels; ++i) {
      if (empty[i] > 0 && seen[i] > 0) high[i] += kRaise * raise[i] / seen[i];
    }
  }
  bounds.resize(static_cast<std::size_t>(shape.problems_of(block)));
  return bounds;
}

}  // namespace

std::vector<double> contrast_bounds(const ExecutionContext& context, const Projector& projector,
                                    const CellKinds& cells, const Array<float>& dose, double rung,
                                    const std::vector<int>& slices) {
  const Shape shape = projector.shape();
  if (shape.coupled) {
    return bounds_of_block(projector, 0, cells.kinds.data(), dose.data(), rung, context);
  }
  std::vector<double> bounds(static_cast<std::size_t>(shape.slices), kWithoutEnd);
  const PackedSlices packed(projector, slices);
  const ExecutionContext inside = inside_block(context, packed.blocks());
  parallel_for(context, "proving", packed.blocks(), [&](std::size_t b) {
    const std::vector<int> lanes = packed.of_block(b);
    const Array<Kind> kinds = packed.take(b, cells.kinds);
    const Array<float> doses = packed.take(b, dose);
    const std::vector<double> found =
        bounds_of_block(packed.projector(), b, kinds.data(), doses.data(), rung, inside);
    for (std::size_t l = 0; l < lanes.size(); ++l) bounds[lanes[l]] = found[l];
  });
  return bounds;
}

}  // namespace slicecorr::tomo::detail
