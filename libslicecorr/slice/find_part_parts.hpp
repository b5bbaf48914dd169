// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// How a part is found among the images of an archive (find_part.cpp): what its cells, the coarse and the
/// fine search and the judgement of a place share.
#pragma once

#include <algorithm>
#include <complex>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "fourier/fft.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr::detail::find {

constexpr std::size_t size_of(int n) { return static_cast<std::size_t>(n); }
constexpr int floor_div(int a, int b) { return a >= 0 ? a / b : -((-a + b - 1) / b); }
constexpr int ceil_div(int a, int b) { return -floor_div(-a, b); }

inline PixelBox common_box(const PixelBox& a, const PixelBox& b) {
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
                                  const ExecutionContext& context);

/// Layers from `first` to before `past`.
std::vector<int> layers_between(int first, int past);

/// What is compared with the archive: cells of the part with one more on all sides, in some layers.
struct Kernel {
  int nx = 0, ny = 0;
  std::vector<int> layers;
  std::vector<std::int16_t> part, near;  ///< near: 1 or 0
  double squares = 0;                    ///< of the part, above 0
};

/// `cells`: the part's on `at`, one wider than the part on all sides, of all layers from one before to one
/// past each of those `wanted`.
Kernel kernel_of(const std::vector<std::uint8_t>& cells, const Lattice& at,
                 const std::vector<int>& wanted);

struct Candidate {
  std::size_t turn = 0;
  int x = 0, y = 0, z = 0;  ///< voxels: the corner of its box at the least x, y and slice
  double score = 0;         ///< 1: the archive is the part, as far as cells tell
};

using Spectrum = std::vector<std::complex<float>>;

/// The archive on coarse cells.
struct Coarse {
  Lattice at;
  int nz = 0;
  std::size_t wide = 0, tall = 0;
  std::unique_ptr<detail::PlaneFft<float>> fft;
  std::vector<Spectrum> light, squares;  ///< from cell -2 on along x and y
};

Coarse coarse_of(const Voxels& archive, const ExecutionContext& context);

/// The places at which the archive looks like the part, on coarse cells, the best first.
std::vector<Candidate> coarse_places(const Coarse& c, const Voxels& part, std::size_t turn,
                                     const ExecutionContext& context);

/// All of the archive on cells of one size, where these are few; places lie at whole cells of it.
struct AllCells {
  Lattice at;
  int nz = 0;
  std::vector<std::uint8_t> means;  ///< empty: too many
};

/// Of cells of `size` x `size` x `high` voxels.
AllCells all_cells(const Voxels& archive, int size, int high, const ExecutionContext& context);

/// Moves places to where they agree best on the cells of `all`.
void refine(const Voxels& archive, const AllCells& all, const Voxels& part,
            const std::vector<Candidate*>& places, const ExecutionContext& context);

/// The share of the part's surface at which the archive goes from light to dark, too, at most one voxel away.
double agreement_of(const Voxels& archive, const Voxels& part, const Candidate& at,
                    const ExecutionContext& context);

}  // namespace slicecorr::detail::find
