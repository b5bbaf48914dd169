// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/print/bands.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "slicecorr/error.hpp"
#include "tomo/projection/packed.hpp"

namespace slicecorr::tomo::detail {

namespace {

/// S A^T and A S, S the roots of weights: transposes as those of `inner` are.
class WeighedProjector final : public Projector {
 public:
  WeighedProjector(std::shared_ptr<const Projector> inner, Array<float> roots)
      : inner_(std::move(inner)), roots_(std::move(roots)) {}

  Shape shape() const override { return inner_->shape(); }
  void forward(std::size_t block, const float* field, float* light,
               const ExecutionContext& context) const override {
    const std::size_t n = shape().field_of_block;
    Array<float> weighed(field, field + n);
    for (std::size_t i = 0; i < n; ++i) weighed[i] *= roots_[block * n + i];
    inner_->forward(block, weighed.data(), light, context);
  }
  void adjoint(std::size_t block, const float* light, float* field,
               const ExecutionContext& context) const override {
    inner_->adjoint(block, light, field, context);
    const std::size_t n = shape().field_of_block;
    for (std::size_t i = 0; i < n; ++i) field[i] *= roots_[block * n + i];
  }
  std::unique_ptr<Projector> of_slices(const std::vector<int>& slices) const override {
    const PackedSlices packed(*inner_, slices);
    Array<float> roots;
    for (std::size_t b = 0; b < packed.blocks(); ++b) {
      const Array<float> some = packed.take(b, roots_);
      roots.insert(roots.end(), some.begin(), some.end());
    }
    return std::make_unique<WeighedProjector>(inner_->of_slices(slices), std::move(roots));
  }

 private:
  std::shared_ptr<const Projector> inner_;
  Array<float> roots_;
};

}  // namespace

void check_wanted(const DoseBands& wanted, const Box<std::uint8_t>& part, const Resin& resin) {
  if (!wanted.any()) return;
  for (const Box<float>* box : {&wanted.least, &wanted.most, &wanted.weight}) {
    if (box->values.empty() || (box->nx == part.nx && box->ny == part.ny && box->nz == part.nz)) {
      continue;
    }
    throw InputError(fmt::format(
        "wanted doses have {} x {} x {} voxels, the part {} x {} x {}; expected the same", box->nx,
        box->ny, box->nz, part.nx, part.ny, part.nz));
  }
  if (resin.inhibition_resupply_mj_cm3_s > 0) {
    throw InputError(
        "doses are wanted in resin whose inhibitor comes back, where they do not grow as light does; expected a "
        "part, or a resin without inhibition_resupply_mj_cm3_s");
  }
}

void check_wanted_in_resin(const DoseBands& wanted, const Box<std::uint8_t>& beside,
                           double voxel_mm) {
  const Box<float>& box = wanted.least;
  const double middle = 0.5 * (box.nx - 1);
  for (std::size_t i = 0; i < box.values.size(); ++i) {
    if (!(box.values[i] > 0) || !(wanted.weight_at(i) > 0)) continue;
    const auto nx = static_cast<std::size_t>(box.nx), ny = static_cast<std::size_t>(box.ny);
    const double x = static_cast<double>(i % nx) - middle,
                 y = static_cast<double>(i / nx % ny) - middle;
    const bool in = x * x + y * y <= middle * middle;
    if (in && (beside.values.empty() || beside.values[i] == 0)) continue;
    throw InputError(fmt::format(
        "a dose is wanted at x = {:.3f}, y = {:.3f} mm from the axis in slice {}, where there is no "
        "resin; expected wanted doses within the resin, or 0 or no weight there",
        x * voxel_mm, y * voxel_mm, i / nx / ny));
  }
}

void add_bands(const DoseBands& wanted, const Box<std::uint8_t>& insert, double gel_dose_mj_cm3,
               Target& target) {
  if (!wanted.any()) return;
  const TomoGrid& grid = target.grid;
  const std::size_t numbers = target.kinds.size();
  target.least.assign(numbers, 0);
  target.most.assign(numbers, std::numeric_limits<float>::infinity());
  if (!wanted.weight.values.empty()) target.weight.assign(numbers, 0);
  for (int z = 0; z < grid.slices; ++z) {
    for (int y = 0; y < grid.voxels; ++y) {
      for (int x = grid.inside(y).first; x < grid.inside(y).end; ++x) {
        const std::size_t from = wanted.least.at(z, y, x), to = grid.voxel(x, y, z);
        const double weight = wanted.weight_at(from);
        if (!(weight > 0) || (!insert.values.empty() && insert.values[from] > 0)) continue;
        target.least[to] = static_cast<float>(wanted.least.values[from] / gel_dose_mj_cm3);
        if (wanted.most.values[from] < kNoMostDose) {
          target.most[to] = static_cast<float>(wanted.most.values[from] / gel_dose_mj_cm3);
        }
        if (!target.weight.empty()) target.weight[to] = static_cast<float>(std::sqrt(weight));
      }
    }
  }
}

Target weighed(Target target) {
  for (std::size_t i = 0; i < target.weight.size(); ++i) {
    if (!(target.weight[i] > 0)) continue;
    target.least[i] *= target.weight[i];
    target.most[i] *= target.weight[i];
  }
  target.weight = {};
  return target;
}

std::shared_ptr<const Projector> weighed(std::shared_ptr<const Projector> projector,
                                         const Target& target) {
  if (target.weight.empty()) return projector;
  return std::make_shared<WeighedProjector>(std::move(projector), target.weight);
}

void without_weights(const ExecutionContext& context, const Projector& projector,
                     const Target& target, Solution& found) {
  if (!target.weight.empty()) {
    found.dose.assign(found.dose.size(), 0);
    slicecorr::tomo::adjoint(projector, context, found.light, found.dose);
  }
  found.metrics = measure(target, found.dose);
  double least = std::numeric_limits<double>::infinity(), most = 0;
  for (std::size_t i = 0; i < target.least.size(); ++i) {
    const double d = found.dose[i];
    if (target.least[i] > 0) least = std::min(least, d / target.least[i]);
    most = std::max(most, d / target.most[i]);
  }
  found.metrics.contrast = most > 0 ? least / most : 0;
}

}  // namespace slicecorr::tomo::detail
