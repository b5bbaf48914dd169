/// The operators of rays in double precision, sample by sample, as tomo/rays.hpp defines them.
#pragma once

#include <cmath>
#include <functional>
#include <numbers>
#include <vector>

#include "slicecorr/tomo/rays.hpp"

namespace slicecorr::tomo::test {

class ReferenceRays {
 public:
  ReferenceRays(const TomoGrid& grid, const LabRays& rays, double step_mm = 0)
      : grid_(grid), rays_(rays), step_mm_(step_mm > 0 ? step_mm : grid.voxel_mm()) {}

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
        const double way = 2 * ray.half_mm * std::hypot(1, ray.slope);
        if (!(way > 0)) continue;
        const std::size_t pixel =
            static_cast<std::size_t>(m) * grid_.pixels * grid_.rows + i / rays_.per_pixel;
        const double angle = 2 * std::numbers::pi * m / grid_.angles + ray.turn_rad;
        const int samples = static_cast<int>(std::ceil(way / step_mm_));
        for (int j = 0; j < samples; ++j) {
          const double share = (j + 0.5) / samples, u = (2 * share - 1) * ray.half_mm;
          const double x = ray.t_mm * std::cos(angle) - u * std::sin(angle);
          const double y = ray.t_mm * std::sin(angle) + u * std::cos(angle);
          const double z = ray.entry_z_mm + ray.slope * (u + ray.half_mm);
          const double weight =
              density * ray.power * way / samples * std::exp(-rays_.alpha_per_mm * way * share);
          const double middle = 0.5 * (grid_.voxels - 1);
          spread(middle + x / side, middle + y / side, (z - grid_.lowest_mm) / height,
                 [&](std::size_t v, double w) { use(pixel, v, weight * w); });
        }
      }
    }
  }
  template <class Use>
  void spread(double fx, double fy, double fz, Use use) const {
    const auto near = [](double f, int k) { return std::max(0.0, 1 - std::abs(f - k)); };
    const int x0 = static_cast<int>(std::floor(fx)), y0 = static_cast<int>(std::floor(fy)),
              z0 = static_cast<int>(std::floor(fz));
    for (int z = std::max(z0, 0); z <= std::min(z0 + 1, grid_.slices - 1); ++z) {
      for (int y = std::max(y0, 0); y <= std::min(y0 + 1, grid_.voxels - 1); ++y) {
        const TomoGrid::Range in = grid_.inside(y);
        for (int x = std::max(x0, in.first); x <= std::min(x0 + 1, in.end - 1); ++x) {
          use(voxel(x, y, z), near(fx, x) * near(fy, y) * near(fz, z));
        }
      }
    }
  }

  TomoGrid grid_;
  LabRays rays_;
  double step_mm_;
};

}  // namespace slicecorr::tomo::test
