// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file layer_areas.hpp
/// What each slice of a stack lights, where that changes most, and how hard a layer holds on to the
/// window when it is peeled off it (docs/layerwise.md).
///
/// Plain values; all functions are thread-safe. `lit_areas` throws as the source that it reads, and
/// `Cancelled`.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "slicecorr/layer_heights.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr {

/// Where a slice lights much more or less than the one before it.
struct AreaChange {
  int layer = 0;  ///< the second of the two, from 1 on
  double um = 0;  ///< the height at which it begins
  double from_mm2 = 0, to_mm2 = 0;
  double mm2() const { return to_mm2 > from_mm2 ? to_mm2 - from_mm2 : from_mm2 - to_mm2; }
};
/// The layer that holds on hardest.
struct PeelForce {
  int layer = 0;
  double um = 0;  ///< the height at which it begins
  double mm2 = 0, n = 0;
};

/// The pixels that are not black, slice by slice.
struct LayerAreas {
  double layer_um = 0, pixel_mm2 = 0;       ///< > 0
  std::vector<std::uint64_t> lit_pixels{};  ///< of each slice
  LayerHeights heights{};                   ///< of slices, where they differ
  /// Measured pull per area (`Printer::adhesion_kpa`), and the most that the vat bears, Pa
  /// (`Printer::suction_limit_pa`); 0: not known.
  double adhesion_kpa = 0, limit_pa = 0;
  double mm2(std::size_t layer) const { return static_cast<double>(lit_pixels[layer]) * pixel_mm2; }
  /// The first of the largest; nothing where all slices light alike.
  std::optional<AreaChange> largest_change() const;
  /// Adhesion times area; nothing where the adhesion is not known, or nothing is lit.
  std::optional<PeelForce> largest_force() const;
  /// Both in lines; empty where there is neither.
  std::string in_words() const;
  /// An object: largest_area_change (null where all slices light alike), and with adhesion
  /// largest_peel_force.
  std::string to_json() const;
};

/// Reads all slices once. `printer` has the adhesion; null: not known.
LayerAreas lit_areas(const SliceSource& slices, const Printer* printer,
                     const ExecutionContext& context = {});
/// The pixels of a slice that are not black; null: all are.
inline std::uint64_t count_lit(const std::uint8_t* pixels, std::size_t count) {
  std::uint64_t lit = 0;
  if (pixels == nullptr) return lit;
  // Short stretches, so that compilers count in bytes.
  while (count > 0) {
    const std::size_t some = count < 255 ? count : 255;
    std::uint8_t here = 0;
    for (std::size_t i = 0; i < some; ++i)
      here = static_cast<std::uint8_t>(here + (pixels[i] != 0));
    lit += here;
    pixels += some;
    count -= some;
  }
  return lit;
}
/// Areas of `grid` with nothing counted yet.
LayerAreas areas_of(const Grid& grid, const Printer* printer);

}  // namespace slicecorr
