// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The operators of rays in double precision, crossing by crossing, as tomo/rays.hpp defines them.
#pragma once

#include <cmath>
#include <functional>
#include <numbers>
#include <vector>

#include "slicecorr/tomo/rays.hpp"

namespace slicecorr::test {

using tomo::LabRay;
using tomo::LabRays;
using tomo::TomoGrid;

class ReferenceRays {
 public:
  ReferenceRays(const TomoGrid& grid, const LabRays& rays) : grid_(grid), rays_(rays) {}

  /// [angle][column][row] of a field [z][y][x].
  std::vector<double> forward(const std::vector<double>& field) const {
    std::vector<double> light(pixels());
    walk([&](std::size_t pixel, std::size_t voxel, double weight) {
      light[pixel] += weight * field[voxel];
    });
    return light;
  }
  std::vector<double> adjoint(const std::vector<double>& light) const {
    std::vector<double> field(voxels());
    walk([&](std::size_t pixel, std::size_t voxel, double weight) {
      field[voxel] += weight * light[pixel];
    });
    return field;
  }
  std::size_t pixels() const {
    return static_cast<std::size_t>(grid_.angles) * grid_.pixels * grid_.rows;
  }
  std::size_t voxels() const {
    return static_cast<std::size_t>(grid_.slices) * grid_.voxels * grid_.voxels;
  }
  std::size_t voxel(int x, int y, int z) const {
    return (static_cast<std::size_t>(z) * grid_.voxels + y) * grid_.voxels + x;
  }

 private:
  void walk(const std::function<void(std::size_t, std::size_t, double)>& use) const {
    const double side = grid_.voxel_mm(), height = grid_.slice_height_mm();
    const double density = rays_.pixel_area_mm2 / (side * side * height);
    for (int m = 0; m < grid_.angles; ++m) {
      for (std::size_t i = 0; i < rays_.rays.size(); ++i) {
        const LabRay& ray = rays_.rays[i];
        if (!(ray.half_mm > 0)) continue;
        const std::size_t pixel =
            static_cast<std::size_t>(m) * grid_.pixels * grid_.rows + i / rays_.per_pixel;
        const double angle = 2 * std::numbers::pi * m / grid_.angles + ray.turn_rad;
        const double c = std::cos(angle), s = std::sin(angle), middle = 0.5 * (grid_.voxels - 1);
        const double stretch = std::hypot(1, ray.slope);
        const bool along_y = std::abs(c) >= std::abs(s);
        for (int k = 0; k < grid_.voxels; ++k) {
          // x = t c - u s and y = t s + u c.
          const double at = (k - middle) * side;
          const double u = along_y ? (at - ray.t_mm * s) / c : (ray.t_mm * c - at) / s;
          if (std::abs(u) > ray.half_mm) continue;
          const double way = (u + ray.half_mm) * stretch;
          const double dl = side / std::max(std::abs(c), std::abs(s)) * stretch;
          const double weight = density * ray.power * dl * std::exp(-rays_.alpha_per_mm * way);
          const double z = ray.entry_z_mm + ray.slope * (u + ray.half_mm);
          const double other = along_y ? ray.t_mm * c - u * s : ray.t_mm * s + u * c;
          const double f = middle + other / side, fz = (z - grid_.lowest_mm) / height;
          const auto near = [](double p, int q) { return std::max(0.0, 1 - std::abs(p - q)); };
          const int f0 = static_cast<int>(std::floor(f)), z0 = static_cast<int>(std::floor(fz));
          for (int j = f0; j <= f0 + 1; ++j) {
            const int x = along_y ? j : k, y = along_y ? k : j;
            if (y < 0 || y >= grid_.voxels) continue;
            const TomoGrid::Range in = grid_.inside(y);
            if (x < in.first || x >= in.end) continue;
            for (int slice = std::max(z0, 0); slice <= std::min(z0 + 1, grid_.slices - 1);
                 ++slice) {
              use(pixel, voxel(x, y, slice), weight * near(f, j) * near(fz, slice));
            }
          }
        }
      }
    }
  }

  TomoGrid grid_;
  LabRays rays_;
};

}  // namespace slicecorr::test
