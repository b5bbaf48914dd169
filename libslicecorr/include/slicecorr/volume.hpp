// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file volume.hpp
/// What prints, reduced to at most a given number of cells along each side, before and after.
///
/// A cell stands for a box of voxels. It forgets how many of them are wrong, never that one is.
/// Each column of cells has a pixel that stands for it: the one with the most wrong voxels of the
/// stack, then of the target shown as it is, then the one nearest the middle. Its slices are kept
/// exactly.
///
/// Plain values; all functions are thread-safe.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "slicecorr/pipeline.hpp"

namespace slicecorr {

/// Flags of a cell.
enum CellFlag : std::uint8_t {
  kCellCureThrough = 1,  ///< some voxel of coverage 0 prints
  kCellUndercure = 2,    ///< some voxel of coverage 1 stays liquid
  kCellPrinted = 4,      ///< half of its voxels print, or more
  kCellDesigned = 8,     ///< half of its voxels have a coverage of a half or more
  kCellGrey = 16,        ///< some voxel has a coverage between 0 and 1
};

/// One of the two prints: the target shown as it is, or the stack.
struct ReducedPrint {
  std::vector<std::uint8_t> state;  ///< flags of CellFlag
  /// `dose_code` of the pixel that stands for the column, at mid-layer in the cell's middle slice.
  std::vector<std::uint8_t> dose;
  std::vector<std::uint8_t> grey;   ///< pixel value there, 0..255
  std::vector<std::uint8_t> error;  ///< `error_code` of the greatest height error in the cell
  bool operator==(const ReducedPrint&) const = default;
};

struct ReducedVolume {
  PixelBox box;                            ///< pixels covered
  int layers = 0;                          ///< slices covered, at most kMostLayers
  int step_x = 1, step_y = 1, step_z = 1;  ///< voxels of a cell along each axis, >= 1
  int nx = 0, ny = 0, nz = 0;              ///< cells along each axis
  ReducedPrint before, after;              ///< cell (i, j, k) is element (k * ny + j) * nx + i

  /// A value (0..255) and for how many slices it holds. Small, because parts with many edges have
  /// millions of them.
  struct Run {
    std::uint32_t value : 8;
    std::uint32_t slices : 24;
    bool operator==(const Run&) const = default;
  };
  static constexpr int kMostLayers = (1 << 24) - 1;
  using Runs = std::vector<Run>;  ///< from slice 0 on
  /// The light of a column where it spreads, and for how many slices it holds: relative intensity
  /// least_light * (greatest_light / least_light)^((code - 1) / (kLightCodes - 1)), code 0: none.
  struct LightRun {
    std::uint32_t code : 14;
    std::uint32_t slices : 18;
    bool operator==(const LightRun&) const = default;
  };
  static constexpr std::uint32_t kLightCodes = (1U << 14) - 1, kMostLightSlices = (1U << 18) - 1;
  using LightRuns = std::vector<LightRun>;     ///< from slice 0 on
  double least_light = 0, greatest_light = 0;  ///< 0: light does not spread, or under UV light
  bool under_uv =
      false;  ///< and light spreads or UV light is uneven: doses don't follow from levels
  /// The pixel that stands for a column of cells.
  struct Column {
    int x = -1, y = -1;  ///< column and row in the image
    double light = 1;    ///< share of the calibration's light that the pixel gets
    Runs coverage;       ///< of the target
    Runs levels;         ///< grey levels of the stack; ends where the stack ends
    /// Of the target shown as it is and of the stack, where light spreads; empty where it doesn't.
    LightRuns light_before, light_after;
    bool operator==(const Column&) const = default;
  };
  std::vector<Column> columns;  ///< j * nx + i

  std::size_t cells() const {
    return static_cast<std::size_t>(nx) * static_cast<std::size_t>(ny) *
           static_cast<std::size_t>(nz);
  }
  bool operator==(const ReducedVolume& o) const {
    const auto size = [](const ReducedVolume& v) {
      return std::array{v.box.x0, v.box.y0, v.box.x1, v.box.y1, v.layers, v.step_x,
                        v.step_y, v.step_z, v.nx,     v.ny,     v.nz};
    };
    return size(*this) == size(o) && least_light == o.least_light &&
           greatest_light == o.greatest_light && before == o.before && after == o.after &&
           columns == o.columns;
  }
};

/// A relative dose >= 0 in a byte: 128 and more is gelled.
inline std::uint8_t dose_code(double dose) {
  return static_cast<std::uint8_t>(
      dose / (1.0 + dose) * 256.0 < 255.0 ? std::floor(dose / (1.0 + dose) * 256.0) : 255.0);
}

/// A height error in a byte, in logarithmic steps: 128 is no error, above it the print reaches too
/// far, below it not far enough. The cells' 0 stands for no edge at all.
inline std::uint8_t error_code(double um) {
  const double size = std::round(7.0 * std::log2(1.0 + 4.0 * std::abs(um)));
  const int steps = size < 127.0 ? static_cast<int>(size) : 127;
  return static_cast<std::uint8_t>(um < 0 ? 128 - steps : 128 + steps);
}

/// Reads `stack` and `target` once. The same for any number of threads. Throws `InputError` when
/// the two differ in size.
ReducedVolume reduce_volume(const SliceSource& stack, const SliceSource& target, const Setup& setup,
                            int most_cells, const ExecutionContext& context = {});

/// Every two cells along each side joined into one.
ReducedVolume coarser(const ReducedVolume& fine);

}  // namespace slicecorr
