// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "scan/coarse.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <random>

#include "scan/vectors.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::detail {

namespace {

constexpr std::size_t kSurfaceSamples = 8000, kSurfaceFeatures = 600, kScanPairs = 240;
constexpr std::size_t kMatches = 160;  ///< looked at for each pair of the scan, at most
constexpr std::size_t kKept = 10;      ///< candidates for the close search
constexpr double kLeastApart = 0.3;    ///< of two points of a pair, in diagonals
constexpr double kDistanceSteps = 40, kCosineSteps = 6;
constexpr std::size_t kNeighbours = 20;

/// Of the plane through the neighbours of a point, either way.
Point3 plane_normal(const std::vector<Point3>& points, const std::vector<std::size_t>& near) {
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (const std::size_t i : near) middle += Eigen::Map<const Eigen::Vector3d>(points[i].data());
  middle /= static_cast<double>(near.size());
  Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
  for (const std::size_t i : near) {
    const Eigen::Vector3d d = Eigen::Map<const Eigen::Vector3d>(points[i].data()) - middle;
    spread += d * d.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(spread);
  const Eigen::Vector3d n = solver.eigenvectors().col(0);
  return {n[0], n[1], n[2]};
}

using Frame = std::array<Point3, 3>;

/// Axes from a normal and the way to the other point; false where these are along each other.
bool frame_of(const Point3& normal, const Point3& way, Frame& frame) {
  const Point3 across = sum(way, normal, -product(way, normal));
  const double size = length(across);
  if (!(size > 0.2 * length(way))) return false;
  frame[0] = normal;
  frame[1] = scaled(across, 1 / size);
  frame[2] = crossed(frame[0], frame[1]);
  return true;
}

/// The pose that brings axes onto others, and a point onto a point.
Pose between(const Frame& from, const Frame& to, const Point3& from_point, const Point3& to_point) {
  Pose pose;
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < 3; ++j) {
      pose.turn[i][j] = to[0][i] * from[0][j] + to[1][i] * from[1][j] + to[2][i] * from[2][j];
    }
  }
  pose.shift = difference(to_point, pose.turned(from_point));
  return pose;
}

std::vector<Point3> every_nth(const std::vector<Point3>& points, std::size_t count) {
  std::vector<Point3> out;
  const std::size_t all = points.size(), taken = std::min(count, all);
  for (std::size_t i = 0; i < taken; ++i) out.push_back(points[i * all / taken]);
  return out;
}

/// Whether poses turn much alike and bring `middle` to much the same place.
bool alike(const Pose& a, const Pose& b, const Point3& middle, double diagonal) {
  double most = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < 3; ++j)
      most = std::max(most, std::abs(a.turn[i][j] - b.turn[i][j]));
  }
  return most < 0.1 && length(difference(a.of(middle), b.of(middle))) < 0.05 * diagonal;
}

}  // namespace

OrientedPoints oriented(const std::vector<Point3>& points, const std::vector<Point3>& sides,
                        std::size_t count) {
  // Neighbours among so many points, all over the surface: noise of single points counts less.
  const std::size_t all = points.size(), dense = std::min<std::size_t>(all, 12'000);
  std::vector<Point3> near_points, near_sides;
  for (std::size_t i = 0; i < dense; ++i) {
    near_points.push_back(points[i * all / dense]);
    if (!sides.empty()) near_sides.push_back(sides[i * all / dense]);
  }
  const PointTree tree(near_points);
  OrientedPoints out;
  out.sided = !sides.empty();
  std::vector<std::size_t> near;
  const std::size_t taken = std::min(count, dense);
  for (std::size_t i = 0; i < taken; ++i) {
    const Point3& p = near_points[i * dense / taken];
    tree.nearest(p, kNeighbours, near);
    Point3 normal = plane_normal(near_points, near);
    if (out.sided) {
      Point3 side{};
      for (const std::size_t j : near) side = sum(side, near_sides[j]);
      if (product(side, normal) < 0) normal = scaled(normal, -1);
    }
    out.points.push_back(p);
    out.normals.push_back(normal);
  }
  return out;
}

InertiaAxes inertia_axes(const std::vector<Point3>& points) {
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (const Point3& p : points) middle += Eigen::Map<const Eigen::Vector3d>(p.data());
  middle /= static_cast<double>(points.size());
  Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
  for (const Point3& p : points) {
    const Eigen::Vector3d d = Eigen::Map<const Eigen::Vector3d>(p.data()) - middle;
    spread += d * d.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(spread);
  InertiaAxes found;
  found.middle = {middle[0], middle[1], middle[2]};
  for (std::size_t k = 0; k < 2; ++k) {
    const Eigen::Vector3d v = solver.eigenvectors().col(static_cast<Eigen::Index>(k));
    found.axes[k] = {v[0], v[1], v[2]};
  }
  found.axes[2] = crossed(found.axes[0], found.axes[1]);
  return found;
}

CoarseTarget::CoarseTarget(const TriangleMesh& surface)
    : samples_(sample_surface(surface, kSurfaceSamples)),
      tree_(samples_.points),
      diagonal_(PointBox(samples_.points).diagonal()),
      own_(oriented(samples_.points, samples_.normals, kSurfaceFeatures)) {
  for (std::size_t i = 0; i < own_.points.size(); ++i) {
    for (std::size_t j = 0; j < own_.points.size(); ++j) {
      const Point3 way = difference(own_.points[j], own_.points[i]);
      if (i == j || length(way) < kLeastApart * diagonal_) continue;
      pairs_.push_back({key(own_.points[i], own_.normals[i], own_.points[j], own_.normals[j]),
                        static_cast<std::uint32_t>(i), static_cast<std::uint32_t>(j)});
    }
  }
  std::stable_sort(pairs_.begin(), pairs_.end(),
                   [](const Pair& a, const Pair& b) { return a.key < b.key; });
}

std::uint32_t CoarseTarget::key(const Point3& a, const Point3& na, const Point3& b,
                                const Point3& nb) const {
  const Point3 way = difference(b, a);
  const double apart = length(way);
  const auto step = [](double value, double steps) {
    return static_cast<std::uint32_t>(std::clamp(std::floor(value * steps), 0.0, steps - 1));
  };
  // Without signs: the normals of points alone have none.
  const double first = std::abs(product(na, way)) / apart,
               second = std::abs(product(nb, way)) / apart;
  std::uint32_t made = step(apart / diagonal_, kDistanceSteps);
  for (const double cosine : {first, second, std::abs(product(na, nb))}) {
    made = made * static_cast<std::uint32_t>(kCosineSteps) + step(cosine, kCosineSteps);
  }
  return made;
}

double CoarseTarget::rating(const Pose& pose, const std::vector<Point3>& points,
                            double within_mm) const {
  const double most = within_mm * within_mm;
  double total = 0;
  for (const Point3& p : points) total += std::min(tree_.nearest(pose.of(p)).square, most);
  return total / (most * static_cast<double>(points.size()));
}

RatedPose CoarseTarget::by_pair(const OrientedPoints& scan, std::size_t from, std::size_t to,
                                const std::vector<Point3>& probes) const {
  RatedPose best;
  const Point3 &a = scan.points[from], &b = scan.points[to];
  const Pair wanted{key(a, scan.normals[from], b, scan.normals[to]), 0, 0};
  const auto [begin, end] =
      std::equal_range(pairs_.begin(), pairs_.end(), wanted,
                       [](const Pair& x, const Pair& y) { return x.key < y.key; });
  const auto all = static_cast<std::size_t>(end - begin), looked = std::min(all, kMatches);
  const std::vector<Point3> few = every_nth(probes, 16);
  const double within = 0.04 * diagonal_;
  for (std::size_t i = 0; i < looked; ++i) {
    const Pair& match = *(begin + static_cast<std::ptrdiff_t>(i * all / looked));
    Frame there;
    if (!frame_of(own_.normals[match.from],
                  difference(own_.points[match.to], own_.points[match.from]), there)) {
      continue;
    }
    for (const double side : {1.0, -1.0}) {
      if (side < 0 && scan.sided) break;
      Frame here;
      if (!frame_of(scaled(scan.normals[from], side), difference(b, a), here)) break;
      const Pose pose = between(here, there, a, own_.points[match.from]);
      if (rating(pose, few, within) > std::min(0.6, best.rating + 0.15)) continue;
      const double rated = rating(pose, probes, within);
      if (rated < best.rating) best = {pose, rated};
    }
  }
  return best;
}

std::vector<RatedPose> CoarseTarget::candidates(const OrientedPoints& scan,
                                                const ExecutionContext& context) const {
  const std::vector<Point3> probes = every_nth(scan.points, 120);
  std::vector<RatedPose> found;
  // Axes onto axes, in all ways that turn and do not mirror.
  const InertiaAxes here = inertia_axes(scan.points), there = inertia_axes(samples_.points);
  for (int order = 0; order < 6; ++order) {
    std::array<std::size_t, 3> axis{0, 1, 2};
    for (int i = 0; i < order; ++i) std::next_permutation(axis.begin(), axis.end());
    for (int signs = 0; signs < 4; ++signs) {
      Frame from;
      from[0] = scaled(here.axes[axis[0]], (signs & 1) ? -1 : 1);
      from[1] = scaled(here.axes[axis[1]], (signs & 2) ? -1 : 1);
      from[2] = crossed(from[0], from[1]);
      const Pose pose = between(from, there.axes, here.middle, there.middle);
      found.push_back({pose, rating(pose, probes, 0.04 * diagonal_)});
    }
  }
  // Pairs of the scan, the same ones every time.
  std::mt19937_64 random(20261129);
  std::vector<std::array<std::size_t, 2>> pairs;
  for (std::size_t tried = 0; tried < 40 * kScanPairs && pairs.size() < kScanPairs; ++tried) {
    const std::size_t i = random() % scan.points.size(), j = random() % scan.points.size();
    const double apart = length(difference(scan.points[i], scan.points[j]));
    if (apart >= kLeastApart * diagonal_ && apart <= diagonal_) pairs.push_back({i, j});
  }
  std::vector<RatedPose> by_pairs(pairs.size());
  parallel_for(context, "registration", pairs.size(), [&](std::size_t i) {
    by_pairs[i] = by_pair(scan, pairs[i][0], pairs[i][1], probes);
  });
  found.insert(found.end(), by_pairs.begin(), by_pairs.end());
  std::stable_sort(found.begin(), found.end(),
                   [](const RatedPose& a, const RatedPose& b) { return a.rating < b.rating; });
  std::vector<RatedPose> kept;
  for (const RatedPose& pose : found) {
    const bool seen = std::any_of(kept.begin(), kept.end(), [&](const RatedPose& k) {
      return alike(k.pose, pose.pose, here.middle, diagonal_);
    });
    if (!seen) kept.push_back(pose);
    if (kept.size() == kKept) break;
  }
  return kept;
}

}  // namespace slicecorr::detail
