// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo/limits.hpp
/// How fine a tomographic printer can print, what limits it, and how much initiator its resin wants: closed
/// forms of what printer and resin files say (Webber 2023, section 4; "ours" what a voxel leaves to an
/// aperture).
///
/// Thread-safe. Errors are `InputError`.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "slicecorr/process.hpp"

namespace slicecorr::tomo {

struct LimitsAsked {
  double radius_mm = 0;  ///< of the part, as far as the reach; 0: the reach
  double voxel_mm = 0;   ///< that are wanted; 0: the height of a row
  int angles = 0;        ///< 0: as many as the projector shows, else as resolve the voxels
  /// Of the initiator: decadic molar absorption, 1/(M cm), and grams a mol; 0: no recipe.
  double epsilon_per_m_cm = 0, molar_mass_g = 0;
  double density_g_cm3 = 1.1;  ///< of the resin
  double without_per_cm = 0;   ///< absorption of the resin without initiator, base e
};

/// A width that nothing finer than it can be printed with.
struct Limit {
  std::string_view name;  ///< "voxel", "pixel", "row", "turn", "aperture", "wave"
  double mm = 0;
};

/// What light of all the image reaches, of a vial that is not round or has rods, turned by an angle.
struct LitAt {
  double turned_deg = 0;
  double lit = 1;           ///< share of the resin's area
  double dark_from_mm = 0;  ///< where resin without light is nearest to the axis; 0: nowhere
  double reflected =
      0;  ///< share of the light that meets the vial which its walls send back as a whole
};

struct Limits {
  double radius_mm = 0;
  int angles = 0;
  /// The widest first: the voxel; a pixel's width and height in the resin; the way of the part's rim while a
  /// frame is shown; the width of the cone of light at the part's rim, of one that is in focus on the axis;
  /// and half a wave over the numerical aperture. The last two where light has an aperture.
  std::vector<Limit> widths;
  double half_angle_deg = 0;  ///< of the aperture, in the resin
  double numerical_aperture = 0;
  /// Half angle in air with which pixel and cone are as wide as a voxel at the part's rim; 0: none is, as
  /// pixels are wider. And the light that this aperture lets through, over what the printer's does.
  double most_half_angle_deg = 0, light_share = 0;
  double alpha_r = 0;                 ///< absorption times the resin's radius
  double best_absorption_per_cm = 0;  ///< alpha R = 1: the shortest print at the axis
  /// Of initiator for that, g for a kg of resin; negative where the resin absorbs more without any; 0 where
  /// there is no recipe. `grams_now`: for the absorption that the resin's file says.
  double grams_per_kg = 0, grams_now = 0;
  /// Every 5 degrees of a turn; empty for round vials without rods, of which the reach says it.
  std::vector<LitAt> turned{};
  std::string to_json() const;
};

/// Throws for printers that are not tomographic, and numbers out of range.
Limits limits_of(const Printer& printer, const Resin& resin, const LimitsAsked& asked = {});

}  // namespace slicecorr::tomo
