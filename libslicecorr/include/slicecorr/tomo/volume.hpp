// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo/volume.hpp
/// What tomographic printing is computed on: the grid of voxels, angles and
/// pixels, the part as coverage, doses per voxel, and light per angle and pixel.
///
/// Frame: z is the axis of rotation. At angle th a point (x, y) lies at
///   t = x cos th + y sin th,  u = -x sin th + y cos th,
/// light travels towards +u, and th_m = 2 pi m / angles. Light stays in its slice, so slices are
/// independent and share all indices and weights: they are worked on in blocks, with the slices of
/// a block innermost in memory, one per vector lane.
///
/// Rays that rise or spread couple slices (`rows` > 0): then all slices are one block, and pixels
/// have rows of their own, which are innermost in light as slices are in fields.
///
/// Plain values; const functions are thread-safe.
#pragma once

#include <cstddef>
#include <cstdint>
#include <utility>

#include "slicecorr/tomo/projection.hpp"

namespace slicecorr::tomo {

/// Voxels, angles and pixels of a problem.
struct TomoGrid {
  int voxels = 0;        ///< N, voxels along x and along y, 2..16384
  int slices = 1;        ///< slices along z, 1..1000000
  int angles = 0;        ///< M, frames of one turn, 3..100000
  int pixels = 0;        ///< P, detector pixels along t, 2..65536
  double radius_mm = 1;  ///< R, of the resin: only voxels with r <= R count; > 0
  /// Distance of pixels along t, in the resin; > 0. Pixel i lies at t = (i - (P-1)/2) pixel_mm.
  double pixel_mm = 0;
  /// Rows of the detector where slices share light, 0..65536, the lowest first; 0: a slice has its
  /// own light, and row z is slice z.
  int rows = 0;
  double slice_mm = 0;   ///< distance of slices; 0: that of voxels along x
  double lowest_mm = 0;  ///< z of the middle of slice 0

  /// Throws `InputError` naming the value that is out of range.
  void check() const;

  /// Distance of voxels along x and y: their centres are N points from -R to R.
  double voxel_mm() const { return 2 * radius_mm / (voxels - 1); }
  double voxel_at_mm(int i) const { return -radius_mm + voxel_mm() * i; }
  double pixel_at_mm(int i) const { return (i - 0.5 * (pixels - 1)) * pixel_mm; }
  double angle_rad(int m) const;
  double slice_height_mm() const { return slice_mm > 0 ? slice_mm : voxel_mm(); }

  /// Whether slices share light.
  bool coupled() const { return rows > 0; }
  /// Rows of light: the slices', or the detector's.
  int light_rows() const { return coupled() ? rows : slices; }

  /// Slices per block, and so the number of lanes; the last block may hold fewer slices, its other
  /// lanes are 0 and stay 0. It depends on the number of slices, and of a few on the widths of
  /// voxels and pixels.
  int lanes() const;
  /// Numbers of light per angle and pixel of a block.
  int light_lanes() const { return rows > 0 ? (rows + 15) / 16 * 16 : lanes(); }
  std::size_t voxels_of_block() const;  ///< numbers in a block of a field
  std::size_t light_of_block() const;   ///< numbers in a block of light
  /// What solvers need to know of it.
  Shape shape() const { return {slices, lanes(), coupled(), voxels_of_block(), light_of_block()}; }
  std::size_t blocks() const { return shape().blocks(); }
  int lanes_used(std::size_t block) const { return shape().lanes_used(block); }
  /// Place of a voxel in a field: [block][y][x][lane].
  std::size_t voxel(int x, int y, int slice) const;
  /// Place of a pixel in light: [block][angle][pixel][lane].
  std::size_t pixel(int angle, int pixel, int row) const;

  /// Half-open range of x with r <= R in row y; by symmetry also the range of y in column x.
  struct Range {
    int first = 0, end = 0;
  };
  Range inside(int y) const;

  bool operator==(const TomoGrid&) const = default;
};

/// A grid with as many pixels as voxels along a side, at the same distance.
TomoGrid square_grid(int voxels, int angles, int slices = 1, double radius_mm = 1);

/// The part: coverage of voxels, laid out as a field. 255 is part, 0 is empty; between them a voxel
/// is grey and judged as neither. Voxels with r > R are ignored.
struct Volume {
  TomoGrid grid;
  Array<std::uint8_t> coverage;

  explicit Volume(const TomoGrid& g);
};

/// Voxels outside of R and in unused lanes are `neither`.
struct Target : CellKinds {
  TomoGrid grid;

  /// `opaque` (an insert, coverage > 0), when given, has the grid of `part`; its voxels are neither.
  /// Throws `InputError` when there is no gel voxel, no void voxel, or a gel voxel in the insert.
  explicit Target(const Volume& part, const Volume* opaque = nullptr);
};

/// A number per voxel, dose above all: [block][y][x][lane]. 0 outside of R.
struct Field {
  TomoGrid grid;
  Array<float> values;

  explicit Field(const TomoGrid& g) : grid(g), values(g.blocks() * g.voxels_of_block()) {}
};

/// A number per angle and pixel, what the projector shows: [block][angle][pixel][lane].
struct Light {
  TomoGrid grid;
  Array<float> values;

  explicit Light(const TomoGrid& g) : Light(g, Array<float>(g.blocks() * g.light_of_block())) {}
  Light(const TomoGrid& g, Array<float> v) : grid(g), values(std::move(v)) {}
  float* block(std::size_t b) { return values.data() + b * grid.light_of_block(); }
  const float* block(std::size_t b) const { return values.data() + b * grid.light_of_block(); }
};

}  // namespace slicecorr::tomo
