// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Where among the pixels the light of a place in the resin comes from, found from the rays of a
/// frame: the map of `LabRays` turned round, on nodes.
///
/// Places are in the frame of the turned vial in which rays run along u.
#pragma once

#include <cstddef>
#include <vector>

#include "slicecorr/tomo/rays.hpp"
#include "slicecorr/tomo/volume.hpp"

namespace slicecorr::tomo::detail {

/// What is known at a node, or between nodes.
struct RayMapPart {
  enum { column, row, light, along, up, slope, count };
  /// Those up to here say where the light of a place comes from.
  static constexpr int kPlaces = light + 1;
};

/// Of one ray of each pixel.
class RayMap {
 public:
  /// `up`: nodes along z to the vial's radius.
  RayMap(const TomoGrid& grid, const LabRays& rays, int ray, int up = 8);

  int heights() const { return heights_; }
  /// Node below a slice, and how far it lies towards the next.
  double height_of(int slice) const;
  /// Parts on all heights over (t, u): [part][height]. `column` and `row` are places among pixels,
  /// `along` columns a mm of t, `up` rows a mm of z, `slope` dz/du, `light` dose for each unit of
  /// light of the pixel and angle, 0 where there is none. `count`: the first parts alone.
  void over(double t_mm, double u_mm, float* parts, int count = RayMapPart::count) const;

  /// Largest `along`, and `up`, of all nodes.
  double most_along() const { return most_along_; }
  double most_up() const { return most_up_; }
  double most_slope() const { return most_slope_; }

 private:
  const float* node(int t, int u) const {
    return nodes_.data() + (static_cast<std::size_t>(t) * kAlong + static_cast<std::size_t>(u)) *
                               static_cast<std::size_t>(heights_) * RayMapPart::count;
  }

  static constexpr int kAcross = 129, kAlong = 17;
  TomoGrid grid_;
  int heights_ = 2;
  double height_mm_ = 1;
  double most_mm_ = 1;  ///< |t| and |u| of the outer nodes
  double most_along_ = 0, most_up_ = 0, most_slope_ = 0;
  std::vector<float> nodes_;  ///< [t][u][part][height]
};

}  // namespace slicecorr::tomo::detail
