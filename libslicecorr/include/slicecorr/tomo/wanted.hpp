// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo/wanted.hpp
/// Grey targets: a dose for each voxel, with what it may be off by, in place of part and void. Ours; bands of
/// doses as targets are those of Li, Toombs, Taylor and Wallin (2024).
///
/// Plain values; functions are thread-safe.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "slicecorr/tomo/npy.hpp"

namespace slicecorr::tomo {

/// From here on there is no most.
inline constexpr float kNoMostDose = 1e30F;

/// Doses of the whole print between which each voxel's is to lie, mJ/cm3, on the part's grid.
struct DoseBands {
  /// 0: as little as may be. Of void: 0 to the gel dose.
  Box<float> least, most;
  /// Of squares of what is outside, >= 0; 0: not judged. Empty: 1 everywhere.
  Box<float> weight;
  /// No light whatever has more `WantedFigures::slack`; infinite when nothing was proven.
  double slack_bound = std::numeric_limits<double>::infinity();

  bool any() const { return !least.values.empty(); }
  double weight_at(std::size_t i) const {
    return weight.values.empty() ? 1 : static_cast<double>(weight.values[i]);
  }
};

/// A value is wanted everywhere, and may be off by so much. In the unit of the curve.
struct WantedValues {
  Box<float> wanted;     ///< 0: void, which must not gel
  Box<float> tolerance;  ///< one number, or as many; > 0
  Box<float> weight;     ///< empty, or as many
};
/// What a dose makes of resin, both rising; between its points linear.
struct CurvePoint {
  double dose_mj_cm3 = 0, value = 0;
};
/// The doses that these values need: `curve` empty: values are doses, mJ/cm3. Where the tolerance ends
/// above the curve there is no most. Throws `InputError` for values, tolerances and weights of other
/// sizes or out of range, naming the voxel, and for a curve that does not rise.
DoseBands wanted_doses(const WantedValues& values, const std::vector<CurvePoint>& curve,
                       double gel_dose_mj_cm3);
/// Coverage: 255 where all that is wanted gels, 0 where none does, between: neither.
Box<std::uint8_t> part_of(const DoseBands& wanted, double gel_dose_mj_cm3);

/// How doses keep to what is wanted.
struct WantedFigures {
  std::size_t voxels = 0, within = 0;  ///< judged, and of them within their band
  double share_within = 0;             ///< by weight
  double rms_off_mj_cm3 = 0;           ///< by which doses lie outside of their bands, by weight
  double worst_off_mj_cm3 = 0;         ///< above 0: too much
  std::array<int, 3> worst{};          ///< x, y, z of that voxel
  /// The least of dose / least over the greatest of dose / most: at 1 and above some time of print has
  /// all doses within; bands could be narrower by this factor.
  double slack = 0;
  double slack_bound = std::numeric_limits<double>::infinity();
  /// By which all light would have to be brighter for doses to lie as far from the least as from the most;
  /// where some are outside even so, for the least sum of weighed squares.
  double brighter = 1;
  bool all() const { return within == voxels; }
};
/// Of voxels in the resin, at most half of the grid's width from its middle, and not in `insert` (> 0;
/// may be empty).
WantedFigures judge_wanted(const Box<float>& dose, const DoseBands& wanted,
                           const Box<std::uint8_t>& insert);

}  // namespace slicecorr::tomo
