// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file disc_levels.hpp
/// The levels of the march between window and part, and what light does in each. Private to the
/// module.
#pragma once

#include <vector>

#include "slicecorr/flow.hpp"

namespace slicecorr::disc {

/// um/s of mm/h and um^2/s of m^2/s: the units of the march are um, s, mW/cm^2.
inline double um_s(double speed_mm_h) { return speed_mm_h / 3.6; }
inline double um2_s(double diffusion_m2_s) { return diffusion_m2_s * 1e12; }
/// c in um^2/s. None with the clamp: the still layer at the window would fill up with dose.
inline double diffusion_um2_s(const FlowResin& resin) {
  return resin.inhibitor_life_s > 0 ? um2_s(resin.diffusion_m2_s) : 0;
}

/// Levels j = 0 (at the window) to n - 1, thinner at both ends: Y is steep at the window, where resin
/// hardly moves, and bends over a share c/(S h) of the gap below the part.
struct Levels {
  std::vector<double> q;       ///< n + 1 bounds, 0..1
  std::vector<double> share;   ///< F at the bounds
  std::vector<double> middle;  ///< of each level
  int count() const { return static_cast<int>(middle.size()); }
};
Levels make_levels(int count);

/// a(z), signed, mW/cm^2.
double rate_at(const Kinetics& k, double blue, double uv, double z_um);
/// sign(a) |a|^m, at which dose grows.
double dose_rate(const Kinetics& k, double rate);
/// The integral of a over z0..z1, um mW/cm^2, in closed form.
double rate_integral(const Kinetics& k, double blue, double uv, double z0_um, double z1_um);
/// The same of max(0, a).
double clamped_integral(const Kinetics& k, double blue, double uv, double z0_um, double z1_um);
/// The integral of sign(a) |a|^m: in closed form for m = 1, else by Gauss' rule, right for z1 - z0 thin
/// against both heights.
double dose_integral(const Kinetics& k, double blue, double uv, double z0_um, double z1_um);
/// Of max(0, a)^m.
double clamped_dose_integral(const Kinetics& k, double blue, double uv, double z0_um, double z1_um);

/// Means over a level of what feeds Y.
struct LevelRates {
  std::vector<double> store;  ///< of a: what empties or fills the store of inhibitor
  std::vector<double> dose;   ///< of sign(a) |a|^m, or clamped of max(0, a)^m
};
void level_rates(const Kinetics& k, const Levels& levels, double gap_um, double blue, double uv,
                 bool clamped, LevelRates& out);

}  // namespace slicecorr::disc
