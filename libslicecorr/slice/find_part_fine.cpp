// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Places are followed over cells of half the size, down to voxels.

#include <array>

#include "parallel/silent.hpp"
#include "slice/find_part_parts.hpp"
#include "slicecorr/parallel.hpp"

namespace slicecorr::detail::find {

namespace {

/// A place is followed over at most so many finer cells, so far to all sides.
constexpr std::size_t kMostFineCells = 2'000'000;
constexpr int kReach = 2;
/// The archive is kept on cells of one size where they are no more.
constexpr double kMostCellsKept = 64e6;

/// Layers of cells in which places are compared: all, or the ends of the part, where alone a prism says
/// how high it lies, and some between.
std::vector<int> compared_layers(int nz, std::size_t most) {
  std::vector<int> layers = layers_between(-1, nz + 1);
  most = std::max<std::size_t>(most, 8);
  if (layers.size() <= most) return layers;
  std::vector<int> some{-1, 0, nz - 1, nz};
  const std::size_t more = most - some.size();
  for (std::size_t i = 0; i < more; ++i) {
    some.push_back(static_cast<int>((2 * i + 1) * size_of(nz) / (2 * more)));
  }
  std::sort(some.begin(), some.end());
  some.erase(std::unique(some.begin(), some.end()), some.end());
  return some;
}

/// A layer and those around it, of all.
std::vector<int> with_neighbours(const std::vector<int>& layers, int reach) {
  std::vector<int> all;
  for (const int layer : layers) {
    for (int k = layer - reach; k <= layer + reach; ++k) all.push_back(k);
  }
  std::sort(all.begin(), all.end());
  all.erase(std::unique(all.begin(), all.end()), all.end());
  return all;
}

/// Cells of a window that lies at whole cells.
std::vector<std::uint8_t> window_of(const AllCells& all, const Lattice& there) {
  const int left = (there.x0 - all.at.x0) / there.size, top = (there.y0 - all.at.y0) / there.size,
            above = there.z0 / there.high;
  std::vector<std::uint8_t> cells(size_of(there.nx) * size_of(there.ny) * there.layers.size());
  const int x0 = std::max(0, -left), x1 = std::min(there.nx, all.at.nx - left);
  if (x0 >= x1) return cells;
  for (std::size_t k = 0; k < there.layers.size(); ++k) {
    const int layer = above + there.layers[k];
    if (layer < 0 || layer >= all.nz) continue;
    for (int y = std::max(0, -top); y < std::min(there.ny, all.at.ny - top); ++y) {
      const std::size_t from =
          (size_of(layer) * size_of(all.at.ny) + size_of(top + y)) * size_of(all.at.nx);
      std::copy_n(
          all.means.data() + from + size_of(left + x0), size_of(x1 - x0),
          cells.data() + (k * size_of(there.ny) + size_of(y)) * size_of(there.nx) + size_of(x0));
    }
  }
  return cells;
}

}  // namespace

AllCells all_cells(const Voxels& archive, int size, int high, const ExecutionContext& context) {
  AllCells all;
  all.at.x0 = archive.valid.x0;
  all.at.y0 = archive.valid.y0;
  all.at.size = size;
  all.at.high = high;
  all.at.nx = ceil_div(archive.valid.width(), size);
  all.at.ny = ceil_div(archive.valid.height(), size);
  all.nz = ceil_div(archive.slices, high);
  if (1.0 * all.at.nx * all.at.ny * all.nz > kMostCellsKept) return all;
  all.at.layers = layers_between(0, all.nz);
  all.means = mean_of(archive, all.at, context);
  return all;
}

void refine(const Voxels& archive, const AllCells& all, const Voxels& part,
            const std::vector<Candidate*>& places, const ExecutionContext& context) {
  const int size = all.at.size, high = all.at.high;
  const int width = ceil_div(part.valid.width(), size), nz = ceil_div(part.slices, high);
  int height = ceil_div(part.valid.height(), size), from = 0;
  // Of a part of many cells the rows that have most of it.
  const std::size_t row_cells = size_of(width + 2) * 8;
  const int most_rows =
      std::max(16, static_cast<int>(std::min(kMostFineCells / row_cells, std::size_t{1} << 20)));
  if (height + 2 > most_rows) {
    Lattice rows{0, 0, 0, size, std::max(1, part.slices), width, height, {0}};
    const std::vector<std::uint8_t> cells = mean_of(part, rows, context);
    std::vector<std::uint64_t> sums(size_of(height) + 1);
    for (int y = 0; y < height; ++y) {
      std::uint64_t sum = 0;
      for (int x = 0; x < width; ++x) sum += cells[size_of(y) * size_of(width) + size_of(x)];
      sums[size_of(y) + 1] = sums[size_of(y)] + sum;
    }
    std::uint64_t most = 0;
    for (int y = 0; y + most_rows <= height; ++y) {
      const std::uint64_t sum = sums[size_of(y + most_rows)] - sums[size_of(y)];
      if (sum <= most) continue;
      most = sum;
      from = y;
    }
    height = std::min(height, most_rows);
  }
  const std::size_t plane = size_of(width + 2) * size_of(height + 2);
  const std::vector<int> layers = compared_layers(nz, kMostFineCells / plane);
  Lattice own{-size, (from - 1) * size, 0,          size,
              high,  width + 2,         height + 2, with_neighbours(layers, 1)};
  const Kernel kernel = kernel_of(mean_of(part, own, context), own, layers);
  if (!(kernel.squares > 0)) return;
  const std::vector<int> read = with_neighbours(layers, kReach);
  constexpr int kShifts = 2 * kReach + 1;
  for (Candidate* place : places) {
    context.check_cancelled();
    Lattice there{place->x - (1 + kReach) * size,
                  place->y + (from - 1 - kReach) * size,
                  place->z,
                  size,
                  high,
                  own.nx + 2 * kReach,
                  own.ny + 2 * kReach,
                  read};
    const std::vector<std::uint8_t> cells =
        all.means.empty() ? mean_of(archive, there, context) : window_of(all, there);
    std::array<double, size_of(kShifts * kShifts * kShifts)> scores{};
    parallel_for(detail::silent(context), "", scores.size(), [&](std::size_t s) {
      const int dx = static_cast<int>(s) % kShifts, dy = static_cast<int>(s) / kShifts % kShifts,
                dz = static_cast<int>(s) / (kShifts * kShifts) - kReach;
      std::int64_t sum = 0;
      for (std::size_t k = 0; k < layers.size(); ++k) {
        const auto layer = std::lower_bound(read.begin(), read.end(), layers[k] + dz);
        const std::size_t a_plane = static_cast<std::size_t>(layer - read.begin());
        for (int y = 0; y < own.ny; ++y) {
          const std::size_t row = (k * size_of(own.ny) + size_of(y)) * size_of(own.nx);
          const std::int16_t *p = kernel.part.data() + row, *w = kernel.near.data() + row;
          const std::uint8_t* a =
              cells.data() + (a_plane * size_of(there.ny) + size_of(y + dy)) * size_of(there.nx) +
              size_of(dx);
          // Rows of up to 16,000 cells do not overflow.
          for (int x0 = 0; x0 < own.nx; x0 += 8192) {
            std::int32_t of_row = 0;
            const int past = std::min(own.nx, x0 + 8192);
            for (int x = x0; x < past; ++x) of_row += a[x] * (2 * p[x] - w[x] * a[x]);
            sum += of_row;
          }
        }
      }
      scores[s] = static_cast<double>(sum) / kernel.squares;
    });
    // The nearest of equal ones.
    std::size_t best = scores.size() / 2;
    for (std::size_t s = 0; s < scores.size(); ++s) {
      if (scores[s] > scores[best]) best = s;
    }
    place->score = scores[best];
    const int b = static_cast<int>(best);
    place->x += (b % kShifts - kReach) * size;
    place->y += (b / kShifts % kShifts - kReach) * size;
    place->z += (b / (kShifts * kShifts) - kReach) * high;
  }
}

}  // namespace slicecorr::detail::find
