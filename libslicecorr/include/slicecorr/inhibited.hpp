/// @file inhibited.hpp
/// The dose under inhibiting UV light (physics of the dissertation's chapter III carried into those
/// of chapter II).
///
/// A point at distance d above the window gains at the rate max(0, I e^(-d/hb) - beta Iuv
/// e^(-d/huv))^m / D'c. While slice n is shown that is, continuous,
///
///     K_j(I) = 1/(s D'c) * integral of max(0, I e^(-d/hb) - beta Iuv e^(-d/huv))^m dd over the
///              slab of distances j hs .. (j + 1) hs                     j = n - k at node k
///
/// and layer by layer the rate at the distance (n + 1 - zeta) hs times the exposure. The first
/// `near()` slices are taken from tables of these exact values; beyond, where the share of UV has
/// fallen below `tail_share`, each slice further adds a = 10^-eta times the one before: the
/// recursion (A.32) again.
///
/// The kernel is 0 nearer than the dead zone and greatest at z0: a slice hardly acts on its own
/// node. See correct.hpp for what that means for the correction. Immutable; may be shared.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "slicecorr/kinetics.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr {

class InhibitedKernel {
 public:
  /// Share of UV in the rate at full light below which slices are recursed.
  static constexpr double tail_share = 1e-6;
  /// Positions inside a layer at which doses are tabulated: its lower end, middle and upper end.
  enum Place { lower_end = 0, middle = 1, upper_end = 2 };

  /// `level_mw_cm2`: blue intensity of each grey level.
  InhibitedKernel(const Kinetics& kinetics, const Printer& printer, const Process& process,
                  double layer_um, std::vector<double> level_mw_cm2);

  const Kinetics& kinetics() const { return kinetics_; }
  int near() const { return near_; }
  int levels() const { return static_cast<int>(blue_.size()); }
  /// Number of UV settings that have tables of their own: 1 unless the schedule is per slice.
  int settings() const { return static_cast<int>(setting_uv_.size()); }
  int setting_of_slice(int slice) const;
  /// UV intensity that a pixel of a grey level gets in a slice.
  double uv_mw_cm2(int slice, int level) const;

  /// Dose that a slice of `level` adds j layers above its own, j = 0..near() - 1, at a place in
  /// that layer: table[j * levels() + level]. Layer by layer at the normal exposure.
  const double* table(int setting, Place place) const;
  /// What slices further away than `near()` add is this factor per layer times the last entry.
  double a() const { return a_; }
  /// Dose that light of a level adds at a distance (in slices) above the lower end of its layer:
  /// exact, for roots.
  double exact(int setting, int level, double distance_slices) const;

  /// Steady dead zone of a level in a slice, um.
  double dead_zone_um(int slice, int level) const;

 private:
  double rate(double blue, double uv, double z_um) const;

  Kinetics kinetics_;
  ExposureMode mode_;
  double layer_um_ = 0, scale_ = 0, a_ = 1;
  int near_ = 1;
  std::vector<double> blue_, setting_uv_, level_uv_;
  std::vector<std::uint16_t> slice_setting_;
  std::vector<std::vector<double>> tables_;  ///< [setting * 3 + place]
};

}  // namespace slicecorr
