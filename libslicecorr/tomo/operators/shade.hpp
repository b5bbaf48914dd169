// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What an insert hides, found by following each ray from a voxel's middle against the light.
#pragma once

#include <cstdint>
#include <limits>
#include <vector>

#include "slicecorr/tomo/npy.hpp"
#include "slicecorr/tomo/volume.hpp"

namespace slicecorr::tomo::detail {

/// The same, slice by slice.
Box<std::uint8_t> box_of(const Volume& volume);

/// Of level light, for all slices at once. Lengths are in voxels; x and y count them.
class LevelShade {
 public:
  LevelShade(const Box<std::uint8_t>& insert, int slices);

  bool any() const { return x0_ <= x1_; }
  std::size_t words() const { return words_; }
  /// Sets the bits of the slices in which something opaque lies at (x, y) or from there on along
  /// (dx, dy), a unit vector. Whether there are any.
  bool hides(int x, int y, double dx, double dy, std::vector<std::uint64_t>& slices) const;

 private:
  std::size_t at(int x, int y) const;
  bool add(int x, int y, std::vector<std::uint64_t>& slices) const;

  int n_;
  std::size_t words_;
  std::vector<std::uint64_t> opaque_;  ///< [y][x], bits of slices
  int x0_ = std::numeric_limits<int>::max(), x1_ = -1, y0_ = x0_, y1_ = -1;
};

/// Of rays that rise, by quarters of a voxel.
class RisingShade {
 public:
  /// `insert` must outlive this.
  explicit RisingShade(const Box<std::uint8_t>& insert);

  bool any() const { return radius_ > 0; }
  /// Whether the ray that comes to voxel (x, y, z) at th, rising by so many slices for a voxel's side
  /// along u, has met something opaque.
  bool hides(int x, int y, int z, double th, double slope) const;

 private:
  const Box<std::uint8_t>& insert_;
  double radius_ = 0;  ///< voxels; 0: no insert
};

}  // namespace slicecorr::tomo::detail
