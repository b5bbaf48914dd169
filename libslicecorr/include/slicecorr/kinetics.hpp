// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file kinetics.hpp
/// Stationary exposure of resin at a window, with and without inhibiting UV light (dissertation
/// chapter III, appendix B.3), in closed form.
///
/// z is the distance from the window, heights are base e, doses areal:
///
///     dD'/dt = max(0, Ib e^(-z/hb) - beta Iuv e^(-z/huv))^m,   gelled where D' >= D'c     (3.22)
///
/// Without UV that is zc = (hb/m) ln(Ib^m t / D'c) (3.15), and with m = 1 Jacobs' working curve.
/// All functions are pure and thread-safe. Intensities in mW/cm² at the window, >= 0; times in s;
/// heights in um. Only `make_kinetics` throws.
#pragma once

#include <limits>
#include <optional>

#include "slicecorr/bleaching.hpp"
#include "slicecorr/gel_time.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr {

/// Parameters of the law above.
struct Kinetics {
  double hb_um = 0;                ///< absorbance height of the curing light, base e, > 0
  double m = 1;                    ///< exponent of intensity, > 0
  double critical_dose_prime = 0;  ///< D'c, (mW/cm²)^m·s, > 0
  double beta = 0;                 ///< areal; 0 without inhibition
  double huv_um = 0;               ///< base e, 0 < huv < hb when beta > 0
  /// A and B of a resin with a time to gel (gel_time.hpp), for which m is 1, D'c too, without a unit:
  /// D' is the relative dose. Else both 0.
  GelTime gel_time = {};
  bool has_gel_time() const { return gel_time.A > 0; }
  /// Of a resin that bleaches, in um and mJ/cm²; then m is 1, and nothing is inhibited.
  std::optional<BleachingLaw> bleaching{};
  /// Whether m and D'c alone say when resin gels.
  bool adds_up() const { return !has_gel_time() && !bleaching; }
};

/// What a resin file says, at its gel dose (`aim` false) or at the dose that the correction aims
/// at. `inhibited`: the exponent and dose that hold under UV light. Throws `InputError` when the
/// resin has no dose that fits.
Kinetics make_kinetics(const Resin& resin, bool inhibited, bool aim);

/// Cured height without UV, um; below 0 when nothing gels.
double cured_height_um(const Kinetics& k, double blue_mw_cm2, double exposure_s);
/// Exposure without UV that cures to a height.
double exposure_for_height_s(const Kinetics& k, double blue_mw_cm2, double height_um);
/// D' at a distance from the window.
double dose_prime_at(const Kinetics& k, double blue_mw_cm2, double uv_mw_cm2, double z_um,
                     double exposure_s);
/// Whether a dead zone lasts at the window: beta Iuv > Ib, or there is no curing light. Where beta
/// Iuv is just Ib it gets ever thinner and none is left in the end, though that takes for ever:
/// whoever asks for a dead zone takes that for none.
bool keeps_dead_zone(const Kinetics& k, double blue_mw_cm2, double uv_mw_cm2);
/// Greatest height of resin that never gels (3.25); 0 when no dead zone lasts, infinite when the
/// resin never gels anywhere.
double steady_dead_zone_um(const Kinetics& k, double blue_mw_cm2, double uv_mw_cm2);

/// Where and when the first resin gels (B.11): z0 >= 0, t0; both infinite without blue light.
struct FirstGel {
  double z_um = 0;
  double time_s = 0;
};
FirstGel first_gel(const Kinetics& k, double blue_mw_cm2, double uv_mw_cm2);

/// Both curing fronts: gelled between them. `front_um` is 0 when it has reached the window.
struct CuringFronts {
  double front_um = 0;
  double back_um = 0;
};
/// Nothing before the first gel.
std::optional<CuringFronts> curing_fronts(const Kinetics& k, double blue_mw_cm2, double uv_mw_cm2,
                                          double exposure_s);
/// When the front reaches the window: D'c / (Ib - beta Iuv)^m; infinite while a dead zone lasts,
/// and where beta Iuv is just Ib.
double window_time_s(const Kinetics& k, double blue_mw_cm2, double uv_mw_cm2);

/// D' that a point gains while the window moves away from it for good under constant light: what
/// continuous printing gives the inside of a part,
///
///     (1/s) int_0^inf max(0, Ib e^(-z/hb) - beta Iuv e^(-z/huv))^m dz.
///
/// Without UV it is Ib^m hb / (m s). Over D'c it is phi, and the speed at which that is 1 is the
/// fastest at which anything gels. A resin that bleaches gains `BleachingLaw::steady`(Ib / s). Speed > 0.
double passing_dose_prime(const Kinetics& k, double blue_mw_cm2, double uv_mw_cm2,
                          double speed_mm_h);

}  // namespace slicecorr
