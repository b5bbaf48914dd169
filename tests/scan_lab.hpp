// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file scan_lab.hpp
/// A made-up laboratory: a small part whose mirror image is another one, corrected by what is believed, printed with
/// what is true, and scanned.
#pragma once

#include <cmath>
#include <random>

#include "memory_slices.hpp"
#include "models.hpp"
#include "scan/vectors.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/scan.hpp"
#include "slicecorr/solid.hpp"

namespace slicecorr::test {

/// A foot, a wall on it, and shelves of different heights over gaps of different depths.
inline MemorySlices hook_part() {
  const Grid grid{56, 44, 60, 50, 50, 50};
  MemorySlices part(grid);
  const auto fill = [&](const PixelBox& box, int first, int last) {
    for (int n = first; n <= last; ++n) {
      for (int y = box.y0; y < box.y1; ++y) {
        for (int x = box.x0; x < box.x1; ++x) part.at(n, x, y) = 255;
      }
    }
  };
  fill({6, 6, 50, 38}, 0, 7);
  fill({6, 6, 18, 38}, 8, 59);
  fill({6, 6, 46, 20}, 20, 27);
  fill({6, 24, 38, 38}, 40, 49);
  return part;
}

inline slicecorr::Setup lab_setup() {
  slicecorr::Setup setup{linear_printer(1, 100), resin(576, 600), process(600)};
  setup.printer.width_px = 56;
  setup.printer.height_px = 44;
  return setup;
}

inline PlaceModels models_of(const slicecorr::Setup& setup, const SliceSource& stack) {
  return {setup.printer, setup.resin, setup.process, stack.grid(), stack.frame()};
}

/// Turned by an angle about an axis, any of both.
inline Pose random_pose(std::mt19937& random) {
  std::normal_distribution<double> normal;
  double q[4], size = 0;
  for (double& c : q) {
    c = normal(random);
    size += c * c;
  }
  for (double& c : q) c /= std::sqrt(size);
  const auto [w, x, y, z] = q;
  Pose pose;
  pose.turn = {Point3{1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)},
               Point3{2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)},
               Point3{2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)}};
  for (double& c : pose.shift) c = 20 * normal(random);
  return pose;
}

struct ScanFaults {
  double noise_um = 0;
  bool third_missing = false;
  bool stubs = false;  ///< a twentieth of the points on sticks and as dust beside the part
  bool normals = true;
};

/// A scan of a surface, turned as `pose` says.
inline Scan scanned(const TriangleMesh& surface, const Pose& pose, std::size_t points,
                    const ScanFaults& faults, std::mt19937& random) {
  const SurfaceSamples samples = sample_surface(surface, points);
  const detail::PointBox box(surface.vertices);
  std::normal_distribution<double> noise(0, 1e-3 * faults.noise_um);
  std::uniform_real_distribution<double> even(0, 1);
  Scan scan;
  scan.source = "lab";
  scan.unit = "mm";
  const double from = box.low[0] + (box.high[0] - box.low[0]) * 2 / 3;
  for (std::size_t i = 0; i < samples.points.size(); ++i) {
    if (faults.third_missing && samples.points[i][0] > from) continue;
    Point3 p = samples.points[i];
    for (double& c : p) c += faults.noise_um > 0 ? noise(random) : 0;
    scan.points.push_back(p);
    if (faults.normals) scan.normals.push_back(samples.normals[i]);
  }
  if (faults.stubs) {
    const std::size_t more = scan.points.size() / 20;
    for (std::size_t i = 0; i < more; ++i) {
      // A stick beside the part, and dust about it.
      Point3 p = i % 4
                     ? Point3{box.low[0] - 0.2 * even(random), box.low[1] + 0.1 * even(random),
                              box.low[2] + 3 * even(random)}
                     : Point3{box.low[0] + 4 * even(random) - 1, box.low[1] + 4 * even(random) - 1,
                              box.low[2] + 4 * even(random) - 1};
      scan.points.push_back(p);
      if (faults.normals) scan.normals.push_back({1, 0, 0});
    }
  }
  for (Point3& p : scan.points) p = pose.of(p);
  for (Point3& n : scan.normals) n = pose.turned(n);
  return scan;
}

/// How far the corners of a box lie from where they were, after a pose and the one that was found for it, mm.
inline double pose_error_mm(const Pose& pose, const Pose& found, const TriangleMesh& surface) {
  const detail::PointBox box(surface.vertices);
  double most = 0;
  for (int k = 0; k < 8; ++k) {
    const Point3 corner{k & 1 ? box.high[0] : box.low[0], k & 2 ? box.high[1] : box.low[1],
                        k & 4 ? box.high[2] : box.low[2]};
    most = std::max(most, detail::length(detail::difference(found.of(pose.of(corner)), corner)));
  }
  return most;
}

}  // namespace slicecorr::test
