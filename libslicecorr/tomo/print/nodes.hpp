// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Light that is as fine as the voxels, where the projector's pixels are finer.
///
/// Doses are asked for at the middles of voxels alone. Light of finer pixels can meet them there and
/// be anything in between. So it is given at nodes, about a voxel apart, and linear between them.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "slicecorr/tomo/bench.hpp"
#include "slicecorr/tomo/projector.hpp"

namespace slicecorr::tomo::detail {

struct Nodes {
  /// Between which two nodes a pixel lies: share of the second.
  struct Between {
    int node = 0;
    float share = 0;
  };
  TomoGrid grid;   ///< of the bench, with nodes as pixels
  RayTables rays;  ///< of the nodes
  std::vector<Between> pixels;
};

/// Nothing where pixels are about as large as voxels, or larger.
std::optional<Nodes> nodes_of(const Printer& printer, const Resin& resin, const Bench& bench);

/// The operators of light at nodes, from those of pixels: exact transposes as these are.
std::unique_ptr<Projector> make_node_projector(std::shared_ptr<const Nodes> nodes,
                                               std::shared_ptr<const Projector> of_pixels);

/// What the pixels of a bench show.
Light light_of_pixels(const Nodes& nodes, const TomoGrid& grid, const Light& light);

}  // namespace slicecorr::tomo::detail
