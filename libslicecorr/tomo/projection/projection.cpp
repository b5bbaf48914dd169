// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/tomo/projection.hpp"

#include <algorithm>

#include "slicecorr/error.hpp"

namespace slicecorr::tomo {

int Shape::lanes_used(std::size_t block) const {
  const std::size_t first = block * static_cast<std::size_t>(lanes);
  return static_cast<int>(std::min<std::size_t>(slices - first, lanes));
}

std::unique_ptr<Projector> Projector::of_slices(const std::vector<int>& /*slices*/) const {
  throw InputError("slices", "", "share their light");
}

ExecutionContext inside_block(const ExecutionContext& context, std::size_t blocks) {
  ExecutionContext inside;
  inside.cancel = context.cancel;
  const auto threads = static_cast<std::size_t>(thread_count(context));
  inside.threads = static_cast<int>(
      std::max<std::size_t>(1, (threads + blocks - 1) / std::max<std::size_t>(1, blocks)));
  return inside;
}

void forward(const Projector& projector, const ExecutionContext& context, const Array<float>& field,
             Array<float>& light) {
  const Shape shape = projector.shape();
  const ExecutionContext inside = inside_block(context, shape.blocks());
  parallel_for(context, "projecting", shape.blocks(), [&](std::size_t b) {
    projector.forward(b, field.data() + b * shape.field_of_block,
                      light.data() + b * shape.light_of_block, inside);
  });
}

void adjoint(const Projector& projector, const ExecutionContext& context, const Array<float>& light,
             Array<float>& field) {
  const Shape shape = projector.shape();
  const ExecutionContext inside = inside_block(context, shape.blocks());
  parallel_for(context, "adding up light", shape.blocks(), [&](std::size_t b) {
    projector.adjoint(b, light.data() + b * shape.light_of_block,
                      field.data() + b * shape.field_of_block, inside);
  });
}

}  // namespace slicecorr::tomo
