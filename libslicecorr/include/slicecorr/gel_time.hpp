// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file gel_time.hpp
/// Resins of which the time to gel is known: t_gel(i) = A/i + B/sqrt(i).
///
/// A is the dose that oxygen, or another inhibitor, takes before anything gels, B what radicals that
/// end in pairs leave of the rest (thesis of 2018, chapter 2, well mixed; docs/gel-time.md). B = 0 is
/// Jacobs' law with Dc = A, A = 0 the kinetic one with m = 1/2 and D'c = B: such resins are made as
/// those (`Resin`), and what is here is for A and B above 0.
///
/// Where light changes, a point first loses its inhibitor, by dose, then gels by sqrt(i):
///
///     inhibitor is gone at t*:  integral of i from 0 to t* = A
///     gelled at t:              integral of sqrt(i) from t* to t = B
///
/// Its relative dose is the factor by which all exposures could be shorter for it to just gel. With
/// X(c) and Y(c) the two integrals, over A and B, before and after a cut c of its light in time,
///
///     Omega = max over c of min(X(c), Y(c)),
///
/// at the one cut where both are the same, as X rises with c and Y falls. So Omega >= 1 is gelled, a
/// constant light gives t / t_gel(i), and all doses are inversely proportional to the speed. Unlike
/// other doses it is no sum over slices: the same light in another order gives another dose.
///
/// The light of a slice falls by e^(-1) over the absorbance height, sqrt(i) over twice of that: X
/// and Y of the slices from n on follow recursions as (A.32), and the cut lies in one slice, where
/// it is the root of a quadratic equation (continuous exposure) or a linear one (layer by layer).
///
/// All functions are pure and thread-safe; `GelTimeKernel` is immutable once made. Intensities in
/// mW/cm², > 0 unless said; times in s; heights base e, um. What throws says so.
#pragma once

#include <vector>

#include "slicecorr/chemistry.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr {

/// The dose of a point while the window moves away from it for good under a constant intensity: what
/// continuous printing gives the inside of a part. The intensity at which it is 1 is A s/h + (B s/(2
/// h))², s the speed and h the height.
double passing_dose(const GelTime& g, double mw_cm2, double height_e_um, double speed_mm_h);

/// Intensities of a range at which laws are compared.
inline constexpr int kPointsOfRange = 41;

/// The law of one exponent that is nearest to a time to gel over a range of intensities.
struct NearestLaw {
  double m = 1;
  double critical_dose_prime = 0;  ///< (mW/cm²)^m·s
  double worst_error = 0;          ///< greatest factor between its times and t_gel, less 1
  /// The dose that it gives the inside of a part that is printed continuously, in light of the
  /// greatest intensity, at the speed at which that just gels: 1 where it is right.
  double continuous_dose = 1;
};
/// Kinetic: least squares of ln t over ln i at `points` intensities from `from` to `to`, spaced evenly
/// in ln i. Throws `InputError` unless 0 < from < to, both finite, and points >= 2.
NearestLaw nearest_kinetic(const GelTime& g, double from_mw_cm2, double to_mw_cm2,
                           int points = kPointsOfRange);
/// Jacobs: the same with m = 1 held.
NearestLaw nearest_jacobs(const GelTime& g, double from_mw_cm2, double to_mw_cm2,
                          int points = kPointsOfRange);

/// What a slice of a light would add to X and Y of a point at its window, over A and B: continuous
/// if the window went on for ever, layer by layer in the normal exposure.
struct CutLight {
  double x = 0, y = 0;
  bool operator==(const CutLight&) const = default;
};

/// The two recursions of a printer, a resin and an exposure.
class GelTimeKernel {
 public:
  /// `g`: at the dose that is aimed at; both of A and B above 0. `level_mw_cm2`: of each grey level, in
  /// the mean. `grey`: pulses are full light for a part of the time and black for the rest, the roots of
  /// which count in these shares.
  GelTimeKernel(const GelTime& g, double height_e_um, const Process& process, double layer_um,
                std::vector<double> level_mw_cm2, GreyLight grey = GreyLight::steady);

  /// The same with every level's light multiplied.
  GelTimeKernel with_light(double factor) const;

  const GelTime& gel_time() const { return gel_time_; }
  bool layer_by_layer() const { return layerwise_; }
  int levels() const { return static_cast<int>(light_.size()); }
  const CutLight& light(int level) const { return light_[static_cast<std::size_t>(level)]; }
  double level_mw_cm2(int level) const { return level_mw_cm2_[static_cast<std::size_t>(level)]; }
  /// What light comes to in a slice that counts for `ratio` of a normal one (`CureModel::ratio`): of slices
  /// that get a share of the light, roots are shared by its root.
  CutLight in_slice(int slice, const CutLight& light, double ratio) const {
    return {ratio * light.x, ratio * light.y / root_share(slice)};
  }
  /// The root of a slice's share of what light slices get as a rule.
  double root_share(int slice) const {
    if (root_share_.empty()) return 1;
    const auto n = static_cast<std::size_t>(slice);
    return n < root_share_.size() ? root_share_[n] : root_share_.back();
  }
  /// The least share of a slice from `first` on, and of all.
  double least_share(int first) const;
  CutLight light_of(double mw_cm2) const;  ///< steady light, mw_cm2 >= 0
  /// The light that has this phi, >= 0: of pulses that of the nearest level.
  CutLight light_of_phi(double phi) const;

  /// What is left of the intensity, and of its root, so many slices further away.
  double a() const { return fade_.x; }
  double root_a() const { return fade_.y; }
  CutLight fade(double slices) const;

  /// Slices beyond a point in which its cut is looked for: what lies further away changes no dose by
  /// more than `kLeftOut`.
  int reach() const { return reach_; }
  static constexpr double kLeftOut = 1e-7;

  /// The dose after a long run of slices of an intensity >= 0 (continuous), or that of one exposure at
  /// the window (layer by layer): the phi of this model.
  double phi(double mw_cm2) const { return phi_of(light_of(mw_cm2)); }
  double phi_of(const CutLight& light) const;
  /// The intensity that has this phi, >= 0.
  double intensity_mw_cm2(double phi) const;
  /// Continuous: the dose that `slices` of an intensity give the last node of a part.
  double dose_at_end(double mw_cm2, double slices) const;
  /// Continuous: how many slices lift it to 1; infinite when none are enough.
  double slices_to_gel(double mw_cm2) const;
  /// Layer by layer: the dose of the exposure of a layer, for `ratio` of a normal one, through it; `height`:
  /// of the layer, in usual ones.
  double dose_through_layer(double mw_cm2, double ratio, int layer = 0, double height = 1) const;

 private:
  void take_light();

  GelTime gel_time_;
  bool layerwise_, pulsed_;
  double longest_ = 1;  ///< of a process's exposures, over the normal one
  double slope_;        ///< of ln i in a slice, > 0
  CutLight fade_;
  CutLight per_light_;  ///< of an intensity of 1, and of its root
  int reach_ = 1;
  std::vector<double> level_mw_cm2_;
  std::vector<CutLight> light_;
  std::vector<double> root_share_;  ///< by slice, the last holds for later ones; empty: all 1
};

}  // namespace slicecorr
