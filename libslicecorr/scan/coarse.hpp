// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Poses that may bring points onto a surface, wherever they lie.
#pragma once

#include <vector>

#include "scan/point_tree.hpp"
#include "slicecorr/scan.hpp"

namespace slicecorr::detail {

/// Points with smoothed normals, from which features are made.
struct OrientedPoints {
  std::vector<Point3> points, normals;
  bool sided = false;  ///< normals point outwards; else either way
};
/// Every Nth of `points`, at most `count`, with the normal of the plane through its neighbours. `sides`: rough
/// normals that say which side is outside; may be empty.
OrientedPoints oriented(const std::vector<Point3>& points, const std::vector<Point3>& sides,
                        std::size_t count);

/// A pose, and how far it leaves points off: the mean of squares over the square of the bound that they have, 0..1.
struct RatedPose {
  Pose pose;
  double rating = 1;
};

/// The surface to which scans are brought.
class CoarseTarget {
 public:
  explicit CoarseTarget(const TriangleMesh& surface);

  double diagonal() const { return diagonal_; }
  /// `within_mm`: the bound.
  double rating(const Pose& pose, const std::vector<Point3>& points, double within_mm) const;
  /// The best ones, which differ from each other, best first.
  std::vector<RatedPose> candidates(const OrientedPoints& scan,
                                    const ExecutionContext& context) const;

 private:
  struct Pair {
    std::uint32_t key, from, to;
  };
  RatedPose by_pair(const OrientedPoints& scan, std::size_t from, std::size_t to,
                    const std::vector<Point3>& probes) const;
  std::uint32_t key(const Point3& a, const Point3& na, const Point3& b, const Point3& nb) const;

  SurfaceSamples samples_;
  PointTree tree_;
  double diagonal_ = 0;
  OrientedPoints own_;
  std::vector<Pair> pairs_;
};

/// The mean of points, and the axes of inertia about it as rows of a rotation.
struct InertiaAxes {
  Point3 middle{};
  std::array<Point3, 3> axes{};
};
InertiaAxes inertia_axes(const std::vector<Point3>& points);

}  // namespace slicecorr::detail
