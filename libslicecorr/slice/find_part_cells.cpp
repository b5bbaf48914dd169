// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Part and archive on cells: mean coverage of voxels, and what is compared.

#include <numeric>

#include "parallel/silent.hpp"
#include "slice/find_part_parts.hpp"
#include "slicecorr/parallel.hpp"

namespace slicecorr::detail::find {

std::vector<std::uint8_t> mean_of(const Voxels& voxels, const Lattice& at,
                                  const ExecutionContext& context) {
  const std::size_t nx = size_of(at.nx), ny = size_of(at.ny), nz = at.layers.size();
  std::vector<std::uint8_t> means(nx * ny * nz);
  if (means.empty()) return means;
  std::vector<int> place(size_of(at.layers.back() - at.layers.front() + 1), -1);
  for (std::size_t k = 0; k < nz; ++k) {
    place[size_of(at.layers[k] - at.layers.front())] = static_cast<int>(k);
  }
  const auto area = static_cast<std::uint64_t>(at.size) * static_cast<std::uint64_t>(at.size) *
                    static_cast<std::uint64_t>(at.high);
  parallel_for(detail::silent(context), "", ny, [&](std::size_t j) {
    const int y0 = at.y0 + static_cast<int>(j) * at.size;
    const PixelBox rows =
        common_box(voxels.valid, {at.x0, y0, at.x0 + at.nx * at.size, y0 + at.size});
    if (rows.empty()) return;
    std::vector<std::uint64_t> sums(nx * nz);
    const int width = rows.width();
    voxels.read(rows, [&](int n, const std::uint8_t* pixels) {
      if (!pixels) return;
      const int layer = floor_div(n - at.z0, at.high) - at.layers.front();
      if (layer < 0 || size_of(layer) >= place.size() || place[size_of(layer)] < 0) return;
      std::uint64_t* sum = sums.data() + size_of(place[size_of(layer)]) * nx;
      for (int y = 0; y < rows.height(); ++y) {
        const std::uint8_t* row = pixels + size_of(y) * size_of(width);
        int x = rows.x0;
        while (x < rows.x1) {
          const int cell = (x - at.x0) / at.size;
          const int until = std::min(rows.x1, at.x0 + (cell + 1) * at.size);
          std::uint32_t of_cell = 0;
          for (; x < until; ++x) of_cell += row[x - rows.x0];
          sum[cell] += of_cell;
        }
      }
    });
    for (std::size_t k = 0; k < nz; ++k) {
      for (std::size_t i = 0; i < nx; ++i) {
        means[(k * ny + j) * nx + i] =
            static_cast<std::uint8_t>((sums[k * nx + i] + area / 2) / area);
      }
    }
  });
  return means;
}

std::vector<int> layers_between(int first, int past) {
  std::vector<int> all(size_of(std::max(0, past - first)));
  std::iota(all.begin(), all.end(), first);
  return all;
}

Kernel kernel_of(const std::vector<std::uint8_t>& cells, const Lattice& at,
                 const std::vector<int>& wanted) {
  const int nx = at.nx, ny = at.ny;
  const std::vector<int>& read = at.layers;
  Kernel kernel{nx, ny, wanted, {}, {}, 0};
  const std::size_t plane = size_of(nx) * size_of(ny);
  const auto plane_of = [&](int layer) -> const std::uint8_t* {
    const auto found = std::lower_bound(read.begin(), read.end(), layer);
    if (found == read.end() || *found != layer) return nullptr;
    return cells.data() + static_cast<std::size_t>(found - read.begin()) * plane;
  };
  for (const int layer : wanted) {
    std::vector<std::uint8_t> lit(plane);
    for (int k = layer - 1; k <= layer + 1; ++k) {
      if (const std::uint8_t* of = plane_of(k)) {
        for (std::size_t i = 0; i < plane; ++i) lit[i] |= of[i];
      }
    }
    const std::uint8_t* own = plane_of(layer);
    for (int y = 0; y < ny; ++y) {
      for (int x = 0; x < nx; ++x) {
        bool near = false;
        for (int v = std::max(0, y - 1); v <= std::min(ny - 1, y + 1) && !near; ++v) {
          for (int u = std::max(0, x - 1); u <= std::min(nx - 1, x + 1); ++u) {
            near |= lit[size_of(v) * size_of(nx) + size_of(u)] != 0;
          }
        }
        const int value = own ? own[size_of(y) * size_of(nx) + size_of(x)] : 0;
        kernel.part.push_back(static_cast<std::int16_t>(value));
        kernel.near.push_back(near ? std::int16_t{1} : std::int16_t{0});
        kernel.squares += value * value;
      }
    }
  }
  return kernel;
}

}  // namespace slicecorr::detail::find
