// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/tomo/volume.hpp"

#include <cmath>
#include <numbers>
#include <string>

#include "slicecorr/error.hpp"

namespace slicecorr::tomo {
namespace {

void check_range(const char* name, double value, double least, double most) {
  if (!(value >= least && value <= most)) {
    throw InputError("tomographic grid", name,
                     "must be in " + std::to_string(least) + ".." + std::to_string(most) + ", is " +
                         std::to_string(value));
  }
}

}  // namespace

void TomoGrid::check() const {
  check_range("voxels", voxels, 2, 16384);
  check_range("slices", slices, 1, 1000000);
  check_range("angles", angles, 3, 100000);
  check_range("pixels", pixels, 2, 65536);
  check_range("radius_mm", radius_mm, 1e-6, 1e6);
  check_range("pixel_mm", pixel_mm, 1e-9, 1e6);
  check_range("rows", rows, 0, 65536);
  check_range("slice_mm", slice_mm, 0, 1e6);
  check_range("lowest_mm", lowest_mm, -1e6, 1e6);
  if (coupled()) check_range("slices", slices, 2, 65536);
}

int TomoGrid::lanes() const {
  if (coupled()) return Shape::all_lanes(slices);
  // A few slices are worked on one by one where a voxel is as wide as one to two pixels: then a
  // register holds the pixels that 16 voxels see.
  const double step = voxel_mm() / pixel_mm;
  if (slices < 8 && step >= 0.95 && step <= 2 + 1e-9) return 1;
  return slices <= 16 ? 16 : 32;
}

double TomoGrid::angle_rad(int m) const { return 2 * std::numbers::pi * m / angles; }

std::size_t TomoGrid::voxels_of_block() const {
  return static_cast<std::size_t>(voxels) * voxels * lanes();
}

std::size_t TomoGrid::light_of_block() const {
  return static_cast<std::size_t>(angles) * pixels * light_lanes();
}

std::size_t TomoGrid::voxel(int x, int y, int slice) const {
  const std::size_t block = slice / lanes();
  return block * voxels_of_block() + (static_cast<std::size_t>(y) * voxels + x) * lanes() +
         slice % lanes();
}

std::size_t TomoGrid::pixel(int angle, int pixel, int row) const {
  const std::size_t numbers = light_lanes();
  return row / numbers * light_of_block() +
         (static_cast<std::size_t>(angle) * pixels + pixel) * numbers + row % numbers;
}

TomoGrid::Range TomoGrid::inside(int y) const {
  // In half voxels from the centre everything is an integer: 2x - (N-1) squared and summed is at
  // most (N-1)^2, exactly.
  const std::int64_t side = voxels - 1;
  const std::int64_t dy = 2 * static_cast<std::int64_t>(y) - side;
  const std::int64_t room = side * side - dy * dy;
  if (room < 0) return {};
  auto reach = static_cast<std::int64_t>(std::sqrt(static_cast<double>(room)));
  while (reach * reach > room) --reach;
  while ((reach + 1) * (reach + 1) <= room) ++reach;
  if ((reach & 1) != (side & 1)) --reach;
  if (reach < 0) return {};
  return {static_cast<int>((side - reach) / 2), static_cast<int>((side + reach) / 2) + 1};
}

TomoGrid square_grid(int voxels, int angles, int slices, double radius_mm) {
  TomoGrid grid{.voxels = voxels,
                .slices = slices,
                .angles = angles,
                .pixels = voxels,
                .radius_mm = radius_mm,
                .pixel_mm = 2 * radius_mm / (voxels - 1)};
  grid.check();
  return grid;
}

Volume::Volume(const TomoGrid& g) : grid(g), coverage(g.blocks() * g.voxels_of_block()) {}

Target::Target(const Volume& part, const Volume* opaque) : grid(part.grid) {
  grid.check();
  kinds.assign(part.coverage.size(), Kind::neither);
  if (opaque != nullptr && !(opaque->grid == grid)) {
    throw InputError("insert", "", "must have the grid of the part");
  }
  for (int z = 0; z < grid.slices; ++z) {
    for (int y = 0; y < grid.voxels; ++y) {
      const TomoGrid::Range row = grid.inside(y);
      for (int x = row.first; x < row.end; ++x) {
        const std::size_t v = grid.voxel(x, y, z);
        const std::uint8_t c = part.coverage[v];
        if (opaque != nullptr && opaque->coverage[v] > 0) {
          if (c == 255) {
            throw InputError("insert", "slice " + std::to_string(z),
                             "voxel " + std::to_string(x) + ", " + std::to_string(y) +
                                 " is part and insert at once; cut the insert out of the part");
          }
          continue;
        }
        if (c == 255) {
          kinds[v] = Kind::gel;
          ++gel;
        } else if (c == 0) {
          kinds[v] = Kind::empty;
          ++empty;
        }
      }
    }
  }
  if (gel == 0) {
    throw InputError("part", "", "no voxel inside the vial is wholly part; use smaller voxels");
  }
  if (empty == 0) throw InputError("part", "", "no voxel inside the vial is wholly empty");
}

}  // namespace slicecorr::tomo
