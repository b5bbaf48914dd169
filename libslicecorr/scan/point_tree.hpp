// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Neighbours of points, by nanoflann.
#pragma once

#include <memory>
#include <nanoflann.hpp>
#include <span>
#include <vector>

#include "slicecorr/mesh.hpp"

namespace slicecorr::detail {

/// Holds no copy of the points, which must stay. Thread-safe once made; there must be a point.
class PointTree {
 public:
  explicit PointTree(std::span<const Point3> points)
      : cloud_{points}, tree_(3, cloud_, nanoflann::KDTreeSingleIndexAdaptorParams(16)) {
    tree_.buildIndex();
  }
  PointTree(const PointTree&) = delete;
  PointTree& operator=(const PointTree&) = delete;

  struct Found {
    std::size_t index = 0;
    double square = 0;  ///< of the distance
  };
  Found nearest(const Point3& p) const {
    Found found;
    tree_.knnSearch(p.data(), 1, &found.index, &found.square);
    return found;
  }
  /// The nearest ones, at most `count`.
  void nearest(const Point3& p, std::size_t count, std::vector<std::size_t>& indices) const {
    indices.resize(count);
    std::vector<double> squares(count);
    indices.resize(tree_.knnSearch(p.data(), count, indices.data(), squares.data()));
  }

 private:
  struct Cloud {
    std::span<const Point3> points;
    std::size_t kdtree_get_point_count() const { return points.size(); }
    double kdtree_get_pt(std::size_t i, std::size_t axis) const { return points[i][axis]; }
    template <class Box>
    bool kdtree_get_bbox(Box&) const {
      return false;
    }
  };
  using Tree = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<double, Cloud>,
                                                   Cloud, 3, std::size_t>;
  Cloud cloud_;
  Tree tree_;
};

}  // namespace slicecorr::detail
