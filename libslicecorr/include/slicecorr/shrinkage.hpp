// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file shrinkage.hpp
/// What becomes of a part after light has made it: it shrinks, and its first layers stand out.
///
/// Both belong to the resin ([shrinkage] and [first_layers] of its file, docs/scan.md). Meshes are made larger by as much
/// before they are sliced, and the outlines of the first layers smaller; predicted surfaces (solid.hpp) shrink and stand
/// out. Dose and edges along z in the images know nothing of it: they are of the part before it shrinks.
///
/// Plain values; all functions are pure and thread-safe.
#pragma once

#include <algorithm>
#include <cstddef>
#include <string>

namespace slicecorr {

struct Shrinkage {
  static constexpr double kLeast = -5, kMost = 20;  ///< per cent
  static constexpr double kMostGrowthUm = 1000, kMostHeightUm = 1e4, kDefaultHeightUm = 500;
  double plane_per_cent = 0;  ///< along x and y, of lengths; above 0: the part gets shorter
  double z_per_cent = 0;      ///< the same along z
  double growth_um = 0;       ///< by how much walls stand out at the platform, 0..`kMostGrowthUm`
  /// Where they stand out no more; growth falls linearly up to there, above 0 and at most `kMostHeightUm`.
  double height_um = kDefaultHeightUm;

  bool shrinks() const { return plane_per_cent != 0 || z_per_cent != 0; }
  bool grows() const { return growth_um > 0; }
  bool any() const { return shrinks() || grows(); }
  /// A length after over before along axis 0, 1 or 2.
  double left(std::size_t axis) const {
    return 1 - 0.01 * (axis < 2 ? plane_per_cent : z_per_cent);
  }
  /// By how much walls stand out at this height, um.
  double growth_at_um(double z_um) const {
    return growth_um * std::clamp(1 - z_um / height_um, 0.0, 1.0);
  }
  /// {"plane_per_cent": ..., "z_per_cent": ..., "first_layers_growth_um": ..., "first_layers_height_um": ...}
  std::string to_json() const;
  bool operator==(const Shrinkage&) const = default;
};

/// "0.5 % in the plane and 0.3 % along z; first layers stand out by 60 um, up to 500 um"; empty where there is nothing.
std::string shrinkage_in_words(const Shrinkage& shrinkage);

}  // namespace slicecorr
