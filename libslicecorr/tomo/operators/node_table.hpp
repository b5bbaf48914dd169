// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Light of square pixels on nodes half a voxel apart, so that what is linear between nodes is about
/// what voxels get as boxes: the quick way of looking for light.
///
/// Linear light between nodes d apart is wider by d^2/6 (in variance) than what it has at the nodes,
/// so at the nodes the voxel's boxes are taken narrower by as much. Light of pixels side by side adds
/// up to 1 on all nodes.
#pragma once

#include <cstddef>
#include <vector>

#include "slicecorr/tomo/projection.hpp"
#include "slicecorr/tomo/rays.hpp"

namespace slicecorr::tomo::detail {

/// Pixels and nodes, in pixels: pixel i lies at i.
struct NodeRow {
  int pixels = 0, nodes = 0;
  int taps = 8;                 ///< nodes that a pixel may light; a multiple of 8
  double first = 0, apart = 1;  ///< of nodes
  PixelProfile profile;
  double at(int node) const { return first + node * apart; }
};
/// Nodes half a voxel apart, so many that those of places from `low` to `high` are among them.
/// `widest`: the greatest width of a voxel as it looks from any direction.
struct NodePlaces {
  double low = 0, high = 0, voxel = 1, widest = 1;
};
NodeRow nodes_between(int pixels, const NodePlaces& places, const PixelProfile& profile);

/// Shares of one direction: pixel i lights nodes first[i] to first[i] + taps - 1.
class NodeTable {
 public:
  /// `one` and `other`: sides of a voxel as they look from there, per pixel; all in pixels.
  NodeTable(const NodeRow& row, const std::vector<double>& one, const std::vector<double>& other);

  /// to[node][lane] = sum of shares times from[pixel][lane].
  void spread(int lanes, const float* from, float* to) const;
  /// to[pixel][lane] = sum of shares times from[node][lane].
  void gather(int lanes, const float* from, float* to) const;

 private:
  NodeRow row_;
  std::vector<int> first_;
  Array<float> shares_;  ///< [pixel][tap]
};

/// Tables of all directions; those that see voxels about alike share one.
class DirectionTables {
 public:
  /// `voxel`: a voxel's side per pixel, in pixels.
  DirectionTables(const NodeRow& row, const std::vector<double>& voxel,
                  const std::vector<double>& angles_rad);
  const NodeTable& of(int direction) const {
    return tables_[static_cast<std::size_t>(of_direction_[static_cast<std::size_t>(direction)])];
  }

 private:
  std::vector<NodeTable> tables_;
  std::vector<int> of_direction_;
};

}  // namespace slicecorr::tomo::detail
