// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file bleaching.hpp
/// Resins that bleach: light uses up what absorbs it, so the more has passed the further it goes
/// (docs/bleaching.md).
///
/// Absorption falls with the dose E of light that a place has had, by Dill's law for resists (Dill
/// et al., IEEE Trans. Electron Devices 22, 445, 1975), and G is what it takes from light in all:
///
///     alpha(E) = alpha1 + (alpha0 - alpha1) e^(-E/Eb)
///     G(E) = int_0^E alpha dE = alpha1 E + (alpha0 - alpha1) Eb (1 - e^(-E/Eb))
///
/// From dI/dz = -alpha(E) I and dE/dt = I follows d²E/dz dt = -dG/dt: whatever the order of the light
/// in time, the dose falls with the distance from the window by
///
///     dE/dz = -G(E)                      layer by layer: of all light that came in
///     dE/dz = i/v - G(E)                 continuous: towards the platform, where light i was shown at
///                                        the place and the stage moved at v
///
/// A gelled place is one of a dose E >= Dc, as without bleaching (alpha1 = alpha0: Beer's law, A.32).
#pragma once

namespace slicecorr {

/// In units of its user: lengths, and doses. Immutable; functions are pure and thread-safe.
class BleachingLaw {
 public:
  /// `fresh`, `bleached`: alpha0 and alpha1 over a unit of length (base e), alpha0 >= alpha1 > 0.
  /// `dose`: Eb > 0.
  BleachingLaw(double fresh, double bleached, double dose)
      : fresh_(fresh), bleached_(bleached), dose_(dose) {}

  double fresh() const { return fresh_; }
  double bleached() const { return bleached_; }
  double dose() const { return dose_; }
  /// G(E).
  double absorbed(double dose) const;
  /// The dose E at which `gain` = G(E): where many slices of i/v = `gain` bring it.
  double steady(double gain) const;
  /// The dose that is E at first and then follows dE/ds = gain - G(E) over `length`; where that is
  /// below 0, back towards the light. To 1e-11 of it.
  double after(double dose, double length, double gain) const;
  /// The length over which a dose falls from `high` to `low`, 0 < low; below 0 where high < low.
  double length(double high, double low) const;

 private:
  double fresh_, bleached_, dose_;
};

}  // namespace slicecorr
