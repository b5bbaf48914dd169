// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// A part is looked for on coarse cells first, everywhere at once, by the least sum of squares around it:
// correlations through Fourier transforms of the planes of cells. What comes near is followed over
// cells of half the size, down to voxels, and judged there by its surface.

#include "slicecorr/find_part.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <cstddef>
#include <cstdint>
#include <mutex>
#include <numeric>
#include <optional>
#include <utility>

#include "base/coded_band.hpp"
#include "fourier/fft.hpp"
#include "parallel/silent.hpp"
#include "slice/placing.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/plate.hpp"
#include "slicecorr/slice.hpp"

namespace slicecorr {

namespace {

/// Cells of the coarse search along the images' longer side, and along the height.
constexpr int kMostCells = 160, kMostCellLayers = 48;
/// Of each turn so many coarse places are followed, of all only those with this share of the best score.
constexpr std::size_t kMostOfTurn = 64, kMostPlaces = 256;
/// Where nothing scores as a part does that is there, so few places are followed: on coarse cells, in
/// which thin walls do not line up, and on those of a pixel or two.
constexpr double kLikely = 0.7;
constexpr std::size_t kMostUnlikely = 64, kMostUnlikelyFine = 16;
/// Where so many of the best were not it, the rest is not looked at.
constexpr int kMostMisses = 32;
constexpr double kCoarseShare = 0.6, kFineShare = 0.75;
/// A place is followed over at most so many finer cells, so far to all sides.
constexpr std::size_t kMostFineCells = 2'000'000;
constexpr int kReach = 2;
/// The archive is kept on cells of one size where they are no more.
constexpr double kMostCellsKept = 64e6;
/// Agreement is measured on bands of so many rows, all of them where they have no more voxels.
constexpr int kJudgedRows = 8;
constexpr double kMostJudged = 3e8;
/// Places that agree so much alike are told by how natural they are: a ball fits in every turn.
constexpr double kAlike = 0.005;
constexpr std::uint8_t kLit = 128;

constexpr std::size_t size_of(int n) { return static_cast<std::size_t>(n); }
constexpr int floor_div(int a, int b) { return a >= 0 ? a / b : -((-a + b - 1) / b); }
constexpr int ceil_div(int a, int b) { return -floor_div(-a, b); }

PixelBox common_box(const PixelBox& a, const PixelBox& b) {
  return {std::max(a.x0, b.x0), std::max(a.y0, b.y0), std::min(a.x1, b.x1), std::min(a.y1, b.y1)};
}

/// Part or archive as cells see it: rows of a box inside `valid`, of all slices.
struct Voxels {
  PixelBox valid;
  int slices = 0;
  std::function<void(const PixelBox&, const SliceSource::Sink&)> read;
};

/// The cells of a box: `size` pixels wide and high, `high` slices thick.
struct Lattice {
  int x0 = 0, y0 = 0, z0 = 0;  ///< voxels, of cell 0
  int size = 1, high = 1;
  int nx = 0, ny = 0;
  std::vector<int> layers;  ///< of cells, rising
};

/// Mean coverage of cells, 0..255, layer by layer of `Lattice::layers`.
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

/// A cell of the part, and whether it or a neighbour is lit, so that the archive counts there.
struct PartCell {
  std::int16_t part = 0, near = 0;
};

/// What is compared with the archive: cells of the part with one more on all sides, in some layers.
struct Kernel {
  int nx = 0, ny = 0;
  std::vector<int> layers;
  std::vector<std::int16_t> part, near;  ///< near: 1 or 0
  double squares = 0;                    ///< of the part, above 0
};

/// `cells`: the part's, of all layers from -1 to past the last of `layers` that are asked for, each one
/// wider than the part on all sides.
Kernel kernel_of(const std::vector<std::uint8_t>& cells, int nx, int ny,
                 const std::vector<int>& read, const std::vector<int>& wanted) {
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

struct Candidate {
  std::size_t turn = 0;
  int x = 0, y = 0, z = 0;  ///< voxels: the corner of its box at the least x, y and slice
  double score = 0;         ///< 1: the archive is the part, as far as cells tell
};

/// A length that transforms go fast at.
std::size_t fast_length(std::size_t n) {
  for (std::size_t power = 4;; power *= 2) {
    for (const std::size_t length : {power, power + power / 2}) {
      if (length >= n) return length;
    }
  }
}

using Spectrum = std::vector<std::complex<float>>;

/// Planes of numbers as their transforms.
std::vector<Spectrum> transforms(const detail::PlaneFft<float>& fft, std::size_t planes,
                                 const ExecutionContext& context,
                                 const std::function<void(std::size_t, Spectrum&)>& fill) {
  std::vector<Spectrum> all(planes);
  const ExecutionContext quiet = detail::silent(context);
  parallel_for(quiet, "", planes, [&](std::size_t k) {
    all[k].assign(fft.rows() * fft.columns(), {});
    fill(k, all[k]);
    fft.transform(quiet, all[k].data(), detail::Way::forward, detail::Scale::plain);
  });
  return all;
}

/// The archive on coarse cells.
struct Coarse {
  Lattice at;
  int nz = 0;
  std::size_t wide = 0, tall = 0;
  std::unique_ptr<detail::PlaneFft<float>> fft;
  std::vector<Spectrum> light, squares;  ///< from cell -2 on along x and y
};

Coarse coarse_of(const Voxels& archive, const ExecutionContext& context) {
  Coarse c;
  const PixelBox& box = archive.valid;
  c.at.x0 = box.x0;
  c.at.y0 = box.y0;
  const int longest = std::max(box.width(), box.height());
  while (ceil_div(longest, c.at.size) > kMostCells) c.at.size *= 2;
  while (ceil_div(archive.slices, c.at.high) > kMostCellLayers) c.at.high *= 2;
  c.at.nx = ceil_div(box.width(), c.at.size);
  c.at.ny = ceil_div(box.height(), c.at.size);
  c.nz = ceil_div(archive.slices, c.at.high);
  c.at.layers = layers_between(0, c.nz);
  const std::vector<std::uint8_t> cells = mean_of(archive, c.at, context);
  c.wide = fast_length(size_of(c.at.nx) + 4);
  c.tall = fast_length(size_of(c.at.ny) + 4);
  c.fft = std::make_unique<detail::PlaneFft<float>>(c.tall, c.wide);
  const auto fill = [&](bool square) {
    return [&c, &cells, square](std::size_t k, Spectrum& plane) {
      for (std::size_t y = 0; y < size_of(c.at.ny); ++y) {
        for (std::size_t x = 0; x < size_of(c.at.nx); ++x) {
          const float v =
              cells[(k * size_of(c.at.ny) + y) * size_of(c.at.nx) + x] * (1.0F / 255.0F);
          plane[(y + 2) * c.wide + x + 2] = square ? v * v : v;
        }
      }
    };
  };
  c.light = transforms(*c.fft, size_of(c.nz), context, fill(false));
  c.squares = transforms(*c.fft, size_of(c.nz), context, fill(true));
  return c;
}

/// The places at which the archive looks like the part, on coarse cells, the best first.
std::vector<Candidate> coarse_places(const Coarse& c, const Voxels& part, std::size_t turn,
                                     const ExecutionContext& context) {
  const int nx = ceil_div(part.valid.width(), c.at.size),
            ny = ceil_div(part.valid.height(), c.at.size), nz = ceil_div(part.slices, c.at.high);
  // A part may lie across one cell more than it needs.
  const int shifts_x = c.at.nx - nx + 3, shifts_y = c.at.ny - ny + 3, shifts_z = c.nz - nz + 2;
  if (shifts_x < 1 || shifts_y < 1 || shifts_z < 1) return {};
  Lattice lattice{-c.at.size, -c.at.size, 0,      c.at.size,
                  c.at.high,  nx + 2,     ny + 2, layers_between(-1, nz + 1)};
  const std::vector<std::uint8_t> cells = mean_of(part, lattice, context);
  const Kernel kernel = kernel_of(cells, nx + 2, ny + 2, lattice.layers, lattice.layers);
  if (!(kernel.squares > 0)) return {};
  const std::size_t plane = size_of(nx + 2) * size_of(ny + 2);
  const auto fill = [&](bool near) {
    return [&, near](std::size_t k, Spectrum& out) {
      for (std::size_t y = 0; y < size_of(ny + 2); ++y) {
        for (std::size_t x = 0; x < size_of(nx + 2); ++x) {
          const std::size_t i = k * plane + y * size_of(nx + 2) + x;
          out[y * c.wide + x] = near ? kernel.near[i] : kernel.part[i] * (1.0F / 255.0F);
        }
      }
    };
  };
  const std::vector<Spectrum> of_part = transforms(*c.fft, size_of(nz + 2), context, fill(false)),
                              of_near = transforms(*c.fft, size_of(nz + 2), context, fill(true));
  const std::size_t map = size_of(shifts_x) * size_of(shifts_y);
  std::vector<float> scores(map * size_of(shifts_z));
  const ExecutionContext quiet = detail::silent(context);
  const double scale = 255.0 * 255.0 / (kernel.squares * static_cast<double>(c.wide * c.tall));
  parallel_for(quiet, "", size_of(shifts_z), [&](std::size_t s) {
    Spectrum sum(c.wide * c.tall);
    for (int k = 0; k < nz + 2; ++k) {
      const int layer = static_cast<int>(s) - 2 + k;  // of the archive
      if (layer < 0 || layer >= c.nz) continue;
      const Spectrum &p = of_part[size_of(k)], &w = of_near[size_of(k)],
                     &a = c.light[size_of(layer)], &a2 = c.squares[size_of(layer)];
      for (std::size_t i = 0; i < sum.size(); ++i) {
        const float re = 2 * (p[i].real() * a[i].real() + p[i].imag() * a[i].imag()) -
                         (w[i].real() * a2[i].real() + w[i].imag() * a2[i].imag());
        const float im = 2 * (p[i].real() * a[i].imag() - p[i].imag() * a[i].real()) -
                         (w[i].real() * a2[i].imag() - w[i].imag() * a2[i].real());
        sum[i] += std::complex<float>(re, im);
      }
    }
    c.fft->transform(quiet, sum.data(), detail::Way::backward, detail::Scale::plain);
    for (std::size_t y = 0; y < size_of(shifts_y); ++y) {
      for (std::size_t x = 0; x < size_of(shifts_x); ++x) {
        scores[s * map + y * size_of(shifts_x) + x] =
            static_cast<float>(sum[y * c.wide + x].real() * scale);
      }
    }
  });
  const auto at = [&](int x, int y, int z) {
    return scores[size_of(z) * map + size_of(y) * size_of(shifts_x) + size_of(x)];
  };
  const auto is_peak = [&](int x, int y, int z) {
    const float own = at(x, y, z);
    for (int dz = -1; dz <= 1; ++dz) {
      for (int dy = -1; dy <= 1; ++dy) {
        for (int dx = -1; dx <= 1; ++dx) {
          const int u = x + dx, v = y + dy, w = z + dz;
          if (u < 0 || v < 0 || w < 0 || u >= shifts_x || v >= shifts_y || w >= shifts_z) continue;
          const bool before = std::array{dz, dy, dx} < std::array{0, 0, 0};
          if (at(u, v, w) > own || (before && at(u, v, w) == own)) return false;
        }
      }
    }
    return true;
  };
  std::vector<Candidate> places;
  for (int z = 0; z < shifts_z; ++z) {
    for (int y = 0; y < shifts_y; ++y) {
      for (int x = 0; x < shifts_x; ++x) {
        if (!is_peak(x, y, z)) continue;
        places.push_back({turn, c.at.x0 + (x - 1) * c.at.size, c.at.y0 + (y - 1) * c.at.size,
                          (z - 1) * c.at.high, at(x, y, z)});
      }
    }
  }
  std::stable_sort(places.begin(), places.end(),
                   [](const Candidate& a, const Candidate& b) { return a.score > b.score; });
  if (places.size() > kMostOfTurn) places.resize(kMostOfTurn);
  return places;
}

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

/// All of the archive on cells of one size, where these are few; places lie at whole cells of it.
struct AllCells {
  Lattice at;
  int nz = 0;
  std::vector<std::uint8_t> means;  ///< empty: too many
};

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

/// Moves places to where they agree best on cells of `size` x `size` x `high` voxels.
void refine(const Voxels& archive, const AllCells& all, const Voxels& part, int size, int high,
            const std::vector<Candidate*>& places, const ExecutionContext& context) {
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
  const Kernel kernel = kernel_of(mean_of(part, own, context), own.nx, own.ny, own.layers, layers);
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

/// Slices of one band, as 1 where at least half of a pixel is lit.
class LitBand {
 public:
  explicit LitBand(std::size_t columns) : coded_(columns), row_(columns) {}
  void append(const std::uint8_t* rows) {
    if (rows) {
      for (std::size_t i = 0; i < row_.size(); ++i) row_[i] = rows[i] >= kLit;
    }
    coded_.append(rows ? row_.data() : nullptr);
  }
  void read(int slice, std::vector<std::uint8_t>& out) const { coded_.read(slice, out.data()); }

 private:
  detail::CodedBand coded_;
  std::vector<std::uint8_t> row_;
};

struct Faces {
  std::uint64_t all = 0, agree = 0;
};

/// Whether light ends in the archive at a face of the part or at most one voxel before or behind it, along
/// `a`: two voxels before the face, two behind.
bool agrees(const std::array<std::uint8_t, 4>& a, bool lit_first) {
  const std::uint8_t lit = lit_first ? 1 : 0, dark = lit_first ? 0 : 1;
  return (a[0] == lit && a[1] == dark) || (a[1] == lit && a[2] == dark) ||
         (a[2] == lit && a[3] == dark);
}

double agreement_of(const Voxels& archive, const Voxels& part, const Candidate& at,
                    const ExecutionContext& context) {
  // Faces lie between a voxel and the next: the first are before the part.
  const int width = part.valid.width(), height = part.valid.height();
  const auto bands = size_of(ceil_div(height + 1, kJudgedRows));
  const double of_band =
      static_cast<double>(width) * kJudgedRows * static_cast<double>(part.slices);
  const std::size_t step = std::max<std::size_t>(
      1, static_cast<std::size_t>(of_band * static_cast<double>(bands) / kMostJudged));
  std::vector<Faces> of_bands(bands);
  parallel_for(detail::silent(context), "", (bands + step - 1) / step, [&](std::size_t chosen) {
    Faces& faces = of_bands[chosen * step];
    // In the part's own columns and rows, with two more on all sides.
    const int y0 = static_cast<int>(chosen * step) * kJudgedRows - 1,
              y1 = std::min(height, y0 + kJudgedRows);
    const PixelBox box{-2, y0 - 1, width + 2, y1 + 2};
    const auto wide = size_of(box.width());
    const std::size_t columns = wide * size_of(box.height());
    const auto collect = [&](const Voxels& of, int left, int top, int first, LitBand& band) {
      PixelBox there{box.x0 + left, box.y0 + top, box.x1 + left, box.y1 + top};
      const PixelBox inside = common_box(there, of.valid);
      std::vector<std::uint8_t> padded(columns);
      int next = 0;
      if (!inside.empty()) {
        of.read(inside, [&](int n, const std::uint8_t* rows) {
          for (; next < n - first; ++next) band.append(nullptr);
          if (n < first) return;
          ++next;
          if (!rows) return band.append(nullptr);
          for (int y = inside.y0; y < inside.y1; ++y) {
            std::copy_n(
                rows + size_of(y - inside.y0) * size_of(inside.width()), size_of(inside.width()),
                padded.data() + size_of(y - there.y0) * wide + size_of(inside.x0 - there.x0));
          }
          band.append(padded.data());
        });
      }
    };
    LitBand lit(columns), shown(columns);
    collect(part, 0, 0, 0, lit);
    collect(archive, at.x, at.y, at.z - 2, shown);
    std::vector<std::uint8_t> p(columns), next_p(columns);
    std::array<std::vector<std::uint8_t>, 4> a;
    for (auto& slice : a) slice.resize(columns);
    // Slices m - 1 to m + 2 of the archive, as the part counts them.
    for (int m = -1; m <= part.slices; ++m) {
      if (m == -1) {
        for (int k = 0; k < 4; ++k) shown.read(k, a[size_of(k)]);
      } else {
        std::rotate(a.begin(), a.begin() + 1, a.end());
        shown.read(m + 4, a[3]);
      }
      std::swap(p, next_p);
      lit.read(m + 1, next_p);
      // What stands on the platform has no face there.
      const bool at_platform = m + at.z < 0;
      for (int y = 1; y + 2 < box.height(); ++y) {
        const std::size_t row = size_of(y) * wide;
        for (std::size_t x = 1; x + 2 < wide; ++x) {
          const std::size_t i = row + x;
          if (p[i] != p[i + 1]) {
            ++faces.all;
            faces.agree += agrees({a[1][i - 1], a[1][i], a[1][i + 1], a[1][i + 2]}, p[i] != 0);
          }
          if (p[i] != p[i + wide]) {
            ++faces.all;
            faces.agree +=
                agrees({a[1][i - wide], a[1][i], a[1][i + wide], a[1][i + 2 * wide]}, p[i] != 0);
          }
          if (p[i] != next_p[i] && !at_platform) {
            ++faces.all;
            faces.agree += agrees({a[0][i], a[1][i], a[2][i], a[3][i]}, p[i] != 0);
          }
        }
      }
    }
  });
  Faces sum;
  for (const Faces& f : of_bands) {
    sum.all += f.all;
    sum.agree += f.agree;
  }
  return sum.all ? static_cast<double>(sum.agree) / static_cast<double>(sum.all) : 0.0;
}

/// Whether more than half of one box is the other's, too.
bool same_place(const PartPlace& a, const PartPlace& b) {
  const PixelBox both = common_box(a.box, b.box);
  const int high = std::min(a.first_slice + a.slices, b.first_slice + b.slices) -
                   std::max(a.first_slice, b.first_slice);
  if (both.empty() || high <= 0) return false;
  const auto volume = [](const PixelBox& box, int slices) {
    return static_cast<double>(box.width()) * box.height() * slices;
  };
  return 2 * volume(both, high) > std::min(volume(a.box, a.slices), volume(b.box, b.slices));
}

/// Quarter turns counter-clockwise, and whether it is mirrored in x before.
struct TurnWords {
  int quarters = 0;
  bool mirrored = false;
};
TurnWords words_of(const Turn& turn) {
  const Turn quarter = turn_from_plate({true, false, false});
  for (const bool mirrored : {false, true}) {
    Turn t{false, mirrored, false};
    for (int quarters = 0; quarters < 4; ++quarters) {
      if (t == turn) return {quarters, mirrored};
      t = t.then(quarter);
    }
  }
  return {};
}

/// As the part lies on the plate, where that is known, else in the images.
Turn on_plate(const Turn& turn, const ImageFrame& frame) {
  return frame.orientation ? turn.then(turn_from_plate(*frame.orientation).inverse()) : turn;
}

/// Of alike places the one with the least is told.
int unlikely(const Turn& turn, const ImageFrame& frame) {
  const TurnWords words = words_of(on_plate(turn, frame));
  return (words.mirrored ? 4 : 0) + (words.quarters == 0 ? 0 : words.quarters == 2 ? 1 : 2);
}

}  // namespace

std::string in_words(const PartPlace& place, const Grid& grid, const ImageFrame& frame) {
  const PlatePlace middle =
      place_on_plate(grid, frame.orientation.value_or(Orientation{}),
                     0.5 * (place.box.x0 + place.box.x1), 0.5 * (place.box.y0 + place.box.y1));
  const TurnWords turn = words_of(on_plate(place.turn, frame));
  std::string text = fmt::format("x {:.2f}, y {:.2f} mm, ", middle.x_mm, middle.y_mm);
  const double above_mm = std::max(0, place.first_slice) * grid.layer_um * 1e-3;
  text += above_mm > 0 ? fmt::format("from {:.3f} mm above the platform on", above_mm)
                       : std::string("on the platform");
  if (turn.mirrored) text += ", mirrored";
  if (turn.quarters) text += fmt::format(", turned by {} degrees", 90 * turn.quarters);
  return text;
}

struct SoughtPart::Impl {
  Grid grid;
  int slices = 0;
  /// The part as it is, and turned by a quarter; null where it does not fit the images so.
  std::array<std::unique_ptr<const MeshSlices>, 2> sliced;

  const MeshSlices* of(const Turn& turn) const { return sliced[turn.swap_axes ? 1 : 0].get(); }
  /// What the images of the quarter turn are turned by beyond it.
  static Turn flips_of(const Turn& turn) {
    if (!turn.swap_axes) return turn;
    const Turn quarter = turn_from_plate({true, false, false});
    return quarter.inverse().then(turn);
  }
  /// Rows of a box inside the part's own, from the corner of its box on.
  void read(const Turn& turn, const PixelBox& box, const SliceSource::Sink& sink) const {
    const MeshSlices& from = *of(turn);
    const Turn flips = flips_of(turn);
    const PixelBox bounds = from.bounds();
    PixelBox there = turned(box, flips, bounds.width(), bounds.height());
    there = {there.x0 + bounds.x0, there.y0 + bounds.y0, there.x1 + bounds.x0,
             there.y1 + bounds.y0};
    const std::size_t width = size_of(box.width()), height = size_of(box.height());
    std::vector<std::uint8_t> out(width * height);
    from.read_band(there, [&](int n, const std::uint8_t* rows) {
      if (!rows || flips.is_identity()) return sink(n, rows);
      for (std::size_t y = 0; y < height; ++y) {
        const std::uint8_t* row = rows + (flips.flip_y ? height - 1 - y : y) * width;
        if (flips.flip_x) {
          std::reverse_copy(row, row + width, out.data() + y * width);
        } else {
          std::copy_n(row, width, out.data() + y * width);
        }
      }
      sink(n, out.data());
    });
  }
  Voxels voxels(const Turn& turn) const {
    const PixelBox bounds = of(turn)->bounds();
    return {{0, 0, bounds.width(), bounds.height()},
            slices,
            [this, turn](const PixelBox& box, const SliceSource::Sink& sink) {
              read(turn, box, sink);
            }};
  }
};

SoughtPart::SoughtPart(const TriangleMesh& mesh, const Grid& grid,
                       const ExecutionContext& context) {
  auto impl = std::make_unique<Impl>();
  impl->grid = grid;
  Printer images;
  images.name = "the archive";
  images.width_px = grid.width_px;
  images.height_px = grid.height_px;
  images.pixel_x_um = grid.pixel_x_um;
  images.pixel_y_um = grid.pixel_y_um;
  images.travel_mm = 0;
  std::string why;
  for (const int quarters : {0, 1}) {
    ArrangedPart place;
    place.quarters = quarters;
    TriangleMesh turned_mesh = at_place(mesh, place);
    const detail::PartBox box = detail::box_of(turned_mesh, context);
    SliceOptions options;
    options.layer_um = grid.layer_um;
    options.center_mm = {0.5 * box.size(0),
                         grid.height_px * grid.pixel_y_um * 1e-3 - 0.5 * box.size(1)};
    try {
      impl->sliced[size_of(quarters)] = std::make_unique<const MeshSlices>(
          std::move(turned_mesh), images, options, detail::silent(context));
      impl->slices = impl->sliced[size_of(quarters)]->grid().layers;
    } catch (const InputError& e) {
      if (why.empty()) why = e.what();
    }
  }
  if (!impl->sliced[0] && !impl->sliced[1]) throw InputError(why);
  if (impl->slices > grid.layers + 1) {
    throw InputError(
        fmt::format("is {} slices high; the archive has {}", impl->slices, grid.layers));
  }
  impl_ = std::move(impl);
}

SoughtPart::~SoughtPart() = default;
SoughtPart::SoughtPart(SoughtPart&&) noexcept = default;

std::vector<PartPlace> SoughtPart::find(const SliceSource& archive,
                                        const ExecutionContext& context) const {
  const Voxels images{
      archive.bounds(), archive.grid().layers,
      [&](const PixelBox& box, const SliceSource::Sink& sink) { archive.read_band(box, sink); }};
  if (images.valid.empty()) return {};
  std::vector<Turn> turns;
  for (const bool swap : {false, true}) {
    if (!impl_->sliced[swap ? 1 : 0]) continue;
    for (const bool flip_x : {false, true}) {
      for (const bool flip_y : {false, true}) turns.push_back({swap, flip_x, flip_y});
    }
  }
  std::vector<Candidate> places;
  int size = 1, high = 1;
  {
    const Coarse coarse = coarse_of(images, context);
    size = coarse.at.size;
    high = coarse.at.high;
    for (std::size_t t = 0; t < turns.size(); ++t) {
      context.check_cancelled();
      const auto more = coarse_places(coarse, impl_->voxels(turns[t]), t, context);
      places.insert(places.end(), more.begin(), more.end());
    }
  }
  const auto keep = [&](double share) {
    double best = 0;
    for (const Candidate& place : places) best = std::max(best, place.score);
    std::erase_if(places, [&](const Candidate& place) {
      return !(place.score > 0) || place.score < share * best;
    });
    std::stable_sort(places.begin(), places.end(),
                     [](const Candidate& a, const Candidate& b) { return a.score > b.score; });
    std::size_t most = kMostPlaces;
    if (best < kLikely) most = size > 2 ? kMostUnlikely : kMostUnlikelyFine;
    if (places.size() > most) places.resize(most);
  };
  keep(kCoarseShare);
  while (size > 1 || high > 1) {
    size = std::max(1, size / 2);
    high = std::max(1, high / 2);
    const AllCells all = all_cells(images, size, high, context);
    for (std::size_t t = 0; t < turns.size(); ++t) {
      std::vector<Candidate*> its;
      for (Candidate& place : places) {
        if (place.turn == t) its.push_back(&place);
      }
      if (!its.empty()) refine(images, all, impl_->voxels(turns[t]), size, high, its, context);
    }
    keep(kFineShare);
  }
  std::vector<PartPlace> found;
  int misses = 0;
  for (const Candidate& c : places) {
    if (misses > kMostMisses) break;
    context.check_cancelled();
    const Voxels part = impl_->voxels(turns[c.turn]);
    PartPlace place;
    place.turn = turns[c.turn];
    place.box = {c.x, c.y, c.x + part.valid.width(), c.y + part.valid.height()};
    place.first_slice = c.z;
    place.slices = impl_->slices;
    place.agreement = agreement_of(images, part, c, context);
    misses += place.agreement < kLeastAgreement;
    found.push_back(place);
  }
  std::stable_sort(found.begin(), found.end(), [](const PartPlace& a, const PartPlace& b) {
    return a.agreement > b.agreement;
  });
  std::vector<PartPlace> kept;
  const ImageFrame frame = archive.frame();
  for (const PartPlace& place : found) {
    const auto same = std::find_if(kept.begin(), kept.end(),
                                   [&](const PartPlace& k) { return same_place(k, place); });
    if (same == kept.end()) {
      if (kept.empty() || place.agreement >= kLeastAgreement) kept.push_back(place);
    } else if (place.agreement >= same->agreement - kAlike &&
               unlikely(place.turn, frame) < unlikely(same->turn, frame)) {
      *same = place;
    }
  }
  return kept;
}

void SoughtPart::read_band(const PartPlace& place, const PixelBox& band,
                           const SliceSource::Sink& sink) const {
  const PixelBox inside = common_box(band, place.box);
  const std::size_t width = size_of(band.width());
  std::vector<std::uint8_t> out(width * size_of(band.height()));
  if (inside.empty()) {
    for (int n = 0; n < place.slices; ++n) sink(n, nullptr);
    return;
  }
  const PixelBox own{inside.x0 - place.box.x0, inside.y0 - place.box.y0, inside.x1 - place.box.x0,
                     inside.y1 - place.box.y0};
  impl_->read(place.turn, own, [&](int n, const std::uint8_t* rows) {
    if (!rows) return sink(n, nullptr);
    for (int y = inside.y0; y < inside.y1; ++y) {
      std::copy_n(rows + size_of(y - inside.y0) * size_of(inside.width()), size_of(inside.width()),
                  out.data() + size_of(y - band.y0) * width + size_of(inside.x0 - band.x0));
    }
    sink(n, out.data());
  });
}

}  // namespace slicecorr
