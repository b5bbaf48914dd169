// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The part is looked for on coarse cells first, everywhere at once, by the least sum of squares around it:
// correlations through Fourier transforms of the planes of cells.

#include <array>
#include <memory>

#include "parallel/silent.hpp"
#include "slice/find_part_parts.hpp"
#include "slicecorr/parallel.hpp"

namespace slicecorr::detail::find {

namespace {

/// Cells of the coarse search along the images' longer side, and along the height.
constexpr int kMostCells = 160, kMostCellLayers = 48;
/// Of each turn so many coarse places are followed.
constexpr std::size_t kMostOfTurn = 64;

/// A length that transforms go fast at.
std::size_t fast_length(std::size_t n) {
  for (std::size_t power = 4;; power *= 2) {
    for (const std::size_t length : {power, power + power / 2}) {
      if (length >= n) return length;
    }
  }
}

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

}  // namespace

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
  const Kernel kernel = kernel_of(cells, lattice, lattice.layers);
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

}  // namespace slicecorr::detail::find
