// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Exact ways of traced rays through the voxels of a grid, for judging.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "slicecorr/parallel.hpp"
#include "slicecorr/vial_outline.hpp"
#include "tomo/operators/traced_light.hpp"

namespace slicecorr::tomo::detail {

class TracedWalk {
 public:
  /// Rays to a voxel's side by which light is followed.
  static constexpr int kRaysOfVoxel = 8;

  /// Both outlive it.
  TracedWalk(const TomoGrid& grid, const TracedLight& light, const Vial& vial,
             const ExecutionContext& context);

  /// Share of a column of voxels that resin fills; 0: it is not judged.
  double filled(std::size_t voxel) const { return filled_[voxel]; }

  /// Calls use(voxel, left, way) for each column of voxels on the way of a piece: what light of 1 at its
  /// beginning leaves there, mm of its way over `filled`, and how far away the middle of that way is, seen
  /// from above.
  template <class Use>
  void through(const TracedRay& ray, const TracedPiece& piece, const Use& use) const {
    const double h = grid_.voxel_mm(), alpha = light_.vial.alpha_per_mm() * ray.stretch;
    const auto n = static_cast<double>(grid_.voxels);
    // In voxels, whose sides are whole numbers.
    const double x0 = (piece.from.x_mm + grid_.radius_mm) / h + 0.5,
                 y0 = (piece.from.y_mm + grid_.radius_mm) / h + 0.5;
    const double dx = piece.along.x_mm / h, dy = piece.along.y_mm / h;
    double way = 0;
    while (way < piece.length_mm - 1e-12) {
      const double next =
          std::min({piece.length_mm, next_side(x0, dx, way), next_side(y0, dy, way)});
      const double middle = (way + next) / 2, length = next - way;
      const double vx = std::floor(x0 + dx * middle), vy = std::floor(y0 + dy * middle);
      if (vx >= 0 && vx < n && vy >= 0 && vy < n) {
        const auto v = static_cast<std::size_t>(vy * n + vx);
        if (filled_[v] > 0) {
          const double left = alpha * length > 1e-9
                                  ? std::exp(-alpha * way) * -std::expm1(-alpha * length) / alpha
                                  : std::exp(-alpha * way) * length;
          use(v, ray.stretch * left / filled_[v], middle);
        }
      }
      way = next;
    }
  }

 private:
  static double next_side(double at, double d, double way) {
    if (std::abs(d) < 1e-12) return 1e300;
    const double here = at + d * way;
    const double side = d > 0 ? std::floor(here + 1e-9) + 1 : std::ceil(here - 1e-9) - 1;
    return (side - at) / d;
  }
  double resin_within(const ResinArea& area, int x, int y) const;

  const TomoGrid& grid_;
  const TracedLight& light_;
  std::vector<double> filled_;
};

}  // namespace slicecorr::tomo::detail
