// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file inhibited.hpp
/// The dose under inhibiting UV light (the dissertation's chapter III carried into chapter II).
///
/// A point at distance d above the window gains dose at the rate max(0, I e^(-d/hb) - beta Iuv
/// e^(-d/huv))^m / D'c. With x the distance, in slices, at which the window stands when slice n
/// ends (x = n + 1 - zeta), slice n adds
///
///     continuous       1/(s D'c) * integral of the m-th power over d from max(0, x - 1) hs to x hs
///     layer by layer   the rate at d = x hs, times the exposure te
///
/// The nearest `near()` slices are taken from tables of these values; beyond, where the share of UV
/// has fallen below `kTailShare`, each slice further adds a = 10^-eta times the one before, which
/// is the recursion without UV (A.32).
///
/// Where the resin ends above the window (`Printer::resin_depth_um`), light goes no further: the tables
/// reach beyond its end, where what slices add is 0.
///
/// Light of a share s (`Process::light_share`) is as usual light under Iuv / s, times s^m: slices with other shares
/// have a setting of that UV light, and count s^m times (`CureModel::exposure_ratio`). Intensities of settings are
/// those over usual blue light.
///
/// The kernel is 0 nearer than the dead zone and greatest at z0: a slice hardly acts on its own
/// layer. See correct.hpp for what that means for the correction.
///
/// Grey by pulses is full light for a part of the time and black light for the rest, each with the UV light that
/// stays on: what a slice of a level adds is what both add, in these parts. Black pixels are black all the time.
///
/// Where layers differ in height (`Process::layer_heights_um`) distances are those of the places: slice n stands
/// between nodes n and n + 1. A platform that sends back the share rho of the blue light that reaches it
/// (`Printer::platform_reflectance`) makes of blue light, at z above the platform and under any slice,
///
///     Ib (1 + rho e^(-2z/hb)) e^(-d/hb)
///
/// while UV light is used up on its way. That moves the front by ln(1 + rho e^(-2z/hb)) / (1/huv - 1/hb) towards the
/// window. In both cases what a slice adds j layers above itself depends on which slice it is: each with neighbours
/// of its own has a setting of its own (`alike`).
///
/// Where light makes the dead zone even although resin flows (`Process::even_light`, continuous), the
/// part of these values nearer than the gap h counts Omega_f / Omega_still times: that resin was
/// elsewhere meanwhile. Omega_still = 1/(s D'c) * integral from 0 to h; Omega_f, the dose of resin
/// that flows, is 1 where light is even light. See docs/even-dead-zone.md.
///
/// Immutable and thread-safe once made. Only the constructor throws.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

#include "slicecorr/kinetics.hpp"
#include "slicecorr/layer_heights.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr {

namespace detail {
class FrontProfile;
}
struct FrontLight;

class InhibitedKernel {
 public:
  /// Share of UV in the rate at full light below which slices are recursed: the dose is right to
  /// this share.
  static constexpr double kTailShare = 1e-6;
  /// Where in a layer a dose is asked for: x = j + position / 4 for the slice j layers below.
  enum LayerPosition { lower_end = 0, quarter = 1, middle = 2, three_quarters = 3, upper_end = 4 };
  static constexpr int kPlaces = 5;
  /// Samples of a layer for what happens inside it.
  static constexpr int kSamples = 16;

  /// `kinetics` with the dose to aim at, `gel` with that of gelation (for the window);
  /// `level_mw_cm2`: blue intensity of each grey level; `brightest_mw_cm2`: at the brightest place
  /// of the window, for which UV light is set; empty: the same. Throws `InputError` when the
  /// printer has no UV lamp, `InfeasibleError` when the lamp can't give what the schedule asks for.
  InhibitedKernel(const Kinetics& kinetics, const Kinetics& gel, const Printer& printer,
                  const Process& process, double layer_um, std::vector<double> level_mw_cm2,
                  const std::vector<double>& brightest_mw_cm2 = {});

  /// A kernel for light that is no grey level's, as where it spreads: its "levels" are
  /// `kFronts` fronts, evenly spaced, and what it says holds for an amount of light of 1; one UV
  /// setting. Far from the window such light is exact, UV light counts for it to 0.2 %. `least_blue`
  /// > 0: dimmer light has the front of that.
  std::shared_ptr<const InhibitedKernel> by_front(double least_blue_mw_cm2) const;
  static constexpr int kFronts = 8192;
  /// The light of two intensities for a kernel by fronts.
  FrontLight front_light(double blue_mw_cm2, double uv_mw_cm2) const;
  /// The blue intensity of such light, mW/cm².
  double blue_of(const FrontLight& light) const;

  const Kinetics& kinetics() const { return kinetics_; }
  /// Slices whose doses come from the tables.
  int near() const { return near_; }
  int levels() const { return static_cast<int>(blue_.size()); }
  /// Blue intensity of a grey level.
  double level_mw_cm2(int level) const { return blue_[static_cast<std::size_t>(level)]; }
  /// UV settings that have tables of their own: 1 unless the lamp changes from slice to slice.
  int settings() const { return static_cast<int>(setting_uv_.size()); }
  /// 0..settings() - 1; the last slice's for slices after it.
  int setting_of_slice(int slice) const;
  /// UV intensity over a pixel of a grey level in a slice.
  double uv_mw_cm2(int slice, int level) const { return uv_of(setting_of_slice(slice), level); }
  double setting_uv_mw_cm2(int setting, int level) const { return uv_of(setting, level); }
  /// What a slice has of the usual blue light, and that over the share of UV light that comes of what is asked.
  struct BlueShare {
    double blue = 1, over_uv = 1;
  };
  /// Share of the usual blue light in the first slice of a setting: what the intensities of the setting, blue and
  /// UV, are to be multiplied by to be those of that slice.
  double blue_share(int setting) const {
    return blue_share_.empty() ? 1.0 : blue_share_[static_cast<std::size_t>(setting)];
  }
  /// UV grey level that goes with each blue one where UV is patterned; empty else.
  const std::vector<int>& uv_levels() const { return uv_levels_; }

  /// What a slice of a level adds j layers above its own: table[j * levels() + level], j = 0 ..
  /// near() - 1; layer by layer at the normal exposure.
  const double* table(int setting, LayerPosition place) const {
    return tables_[static_cast<std::size_t>(setting * kPlaces + place)].data();
  }
  /// The same at x = j + (i + 1) / kSamples: fine[(level * near() + j) * kSamples + i]; made
  /// when it is first asked for.
  const float* fine(int setting) const;
  /// Memory of all tables together, bytes.
  double table_bytes() const {
    return (8.0 * kPlaces + 4.0 * kSamples) * near() * levels() * settings();
  }
  /// Whether layers are of one height, below a platform that takes up all light. Else slices have settings by what
  /// lies above them, `table` has the places `lower_end`, `middle` and `upper_end` of these alone, and doses from
  /// slices `near()` and more away go on from layer to layer as `fade` says, times `returned`.
  bool alike() const { return heights_.alike() && reflectance_ == 0; }
  /// Where a place is, um from the platform; `zeta` counts layers as they are.
  double place_um(double zeta) const { return heights_.place_um(zeta, layer_um_); }
  double height_um(int layer) const { return heights_.of(layer, layer_um_); }
  /// Of layers, where they differ.
  const LayerHeights& heights() const { return heights_; }
  /// What is left of a dose, without UV light, so much further from the window.
  double fade(double um) const;
  /// By how much light from the platform multiplies a dose without UV light.
  double returned(double place_um) const;
  /// What a slice of a level adds to the layer near() - 1 further up, without the light that the platform sends back:
  /// [level].
  const double* last_row(int setting, LayerPosition place) const;
  /// What blue light over the window counts for at the front of a dead zone so wide, for slice n: what comes back
  /// from the platform with it.
  double blue_at_front(int slice, double front_um) const;
  /// `steady_dose` where all layers are so high, so far from the platform, at this part of a layer from its lower end.
  struct Place {
    double height_um, place_um, part = 1;
  };
  double steady_dose_at(int setting, int level, const Place& place) const;
  /// The slice that a setting of its own belongs to, or one of those that have the same layers above them; -1: slices
  /// of a setting are alike.
  int slice_of(int setting) const {
    return slice_of_setting_.empty() ? -1 : slice_of_setting_[static_cast<std::size_t>(setting)];
  }
  /// `exact` of slice n of a level, at a place that counts layers as they are (`place_um`).
  double added(int slice, int level, double zeta, double share = 1.0) const;
  /// A slice j >= near() layers away adds a() times what it adds one layer nearer.
  double a() const { return a_; }
  /// The same at any distance x > 0 slices, from the integral itself. `share`: what of the slice
  /// has been shown so far, 0..1.
  double exact(int setting, int level, double x, double share = 1.0) const;
  /// `front_um`: height above the window of the cured front that a level would leave in the long
  /// run. `amount`: the factor of detail::FrontProfile that turns its light into relative dose: per
  /// exposure layer by layer, else per um that the window moves.
  struct Source {
    double amount = 0, front_um = 0;
  };
  const Source& source(int setting, int level) const {
    return sources_[static_cast<std::size_t>(setting * levels() + level)];
  }
  const detail::FrontProfile& profile() const { return *profile_; }
  /// What light from the platform does to light from the window: it moves the front nearer to the window, and the
  /// light that counts is `times` as much.
  struct Back {
    double nearer_um = 0, times = 1;
    double blue = 1;  ///< how often blue light counts
  };
  Back back(double place_um) const;
  /// Continuous: what light of a level gives, relative dose, to what is `d_um` and more away from the
  /// window, over `source().amount`: differences of it are what slices add.
  double rest(int setting, int level, double d_um) const { return rest(setting, level, d_um, {}); }
  double rest(int setting, int level, double d_um, const Back& back) const;
  /// Layer by layer: what an exposure of a level gives at `d_um` from the window, over
  /// `source().amount`.
  double rate(int setting, int level, double d_um) const { return rate(setting, level, d_um, {}); }
  double rate(int setting, int level, double d_um, const Back& back) const;
  /// The blue intensity that decides about a level's dead zone: of grey by pulses that of full light.
  double brightest_of(int level) const {
    return level_mw_cm2(pulses_.empty() || level == 0 ? level : levels() - 1);
  }
  /// Whether the resin ends where light still counts.
  bool ends() const { return depth_um_ > 0; }
  /// Dead zone that even light is for, um; 0 without even light.
  double gap_um() const { return gap_um_; }
  /// Omega_f / Omega_still of a level; 1 without even light.
  double flow_factor(int setting, int level) const {
    return flow_factor_.empty()
               ? 1.0
               : flow_factor_[static_cast<std::size_t>(setting * levels() + level)];
  }
  /// The level of the dimmest even light; 0 without even light.
  int least_even_level() const { return least_even_level_; }
  /// Bounds of `flow_factor`: beyond them the flow is nothing that still resin could stand for.
  static constexpr double kMostFlowFactor = 4;
  double layer_um() const { return layer_um_; }
  bool layer_by_layer() const { return mode_ == ExposureMode::layerwise; }
  /// Dose after a long run of slices of this level: the phi of the model without UV.
  double steady_dose(int setting, int level) const { return steady_at(upper_end, setting, level); }
  /// The same in the middle of a layer.
  double steady_middle_dose(int setting, int level) const {
    return steady_at(middle, setting, level);
  }

  /// Steady dead zone at a pixel of a level, um; of even light the gap that it is for: 0 when the resin cures to the window, infinite
  /// when the pixel never gels anything.
  double dead_zone_um(int slice, int level) const {
    return setting_dead_zone_um(setting_of_slice(slice), level);
  }
  double setting_dead_zone_um(int setting, int level) const;
  /// Whether a dead zone lasts over such a pixel (kinetics.hpp). Where light is even, that is decided
  /// when the light is found, with the dose that flowing resin has at the window.
  bool level_keeps_dead_zone(int setting, int level) const;
  /// Where over such a pixel resin gels first, um above the window.
  double first_gel_um(int slice, int level) const;
  /// Whether any level in any setting leaves no dead zone in the long run.
  bool any_level_cures_to_window() const;
  /// Gel dose that one slice of this level gives at the window itself; 1 cures to the window when
  /// it comes from slices that follow each other.
  double window_dose(int slice, int level) const {
    return setting_window_dose(setting_of_slice(slice), level);
  }
  double setting_window_dose(int setting, int level) const;
  /// Highest level that a correction may use in a setting: keeps the dead zone that the schedule
  /// asks for, or any at all; the highest of all where the process allows curing to the window. 0
  /// when there is none but black.
  int highest_usable_level(int setting) const;
  /// The setting with the most UV light.
  int strongest_setting() const;
  /// Lowest blue intensity whose steady dose is 1 in a setting, between levels; infinite when full
  /// light does not reach it.
  double critical_intensity_mw_cm2(int setting) const;

 private:
  double steady_at(LayerPosition place, int setting, int level) const;
  InhibitedKernel(const InhibitedKernel& of, double first_um, double last_um);
  double uv_of(int setting, int level) const {
    return level_uv_.empty() ? setting_uv_[static_cast<std::size_t>(setting)]
                             : level_uv_[static_cast<std::size_t>(level)] *
                                   setting_share_[static_cast<std::size_t>(setting)];
  }
  void take_settings(const std::vector<double>& asked_mw_cm2, const std::vector<BlueShare>& shares);
  void take_sources(bool pulsed);
  void make_tables();
  void tabulate(int setting);
  void count_flow(const EvenLight& light, double full_mw_cm2);
  double flow_factor_with(int setting, int level, double back) const;
  bool is_even(int setting, int level) const;
  void end_resin(double depth_um);
  /// `rest` of resin without end.
  double rest_beyond(int setting, int level, double d_um, const Back& back) const;
  void surround(const Printer& printer, const Process& process);
  void tabulate_around(int setting);
  double added_by(int setting, int slice, int level, double zeta, double share) const;
  double returned_blue(double place_um) const;
  double front_blue(int slice, double blue_mw_cm2, double uv_mw_cm2) const;
  double window_blue(int setting, double blue_mw_cm2) const;

  Kinetics kinetics_, gel_;
  ExposureMode mode_;
  bool allow_window_cure_ = false;
  double wanted_um_ = 0;  ///< dead zone that the schedule asks for; 0: none
  double layer_um_ = 0;
  double scale_ = 0;      ///< from the integral over um, or the rate, to relative dose
  double gel_scale_ = 0;  ///< from the rate at the window to relative gel dose in one slice
  double a_ = 1;
  int near_ = 1;
  std::vector<double> blue_, setting_uv_, level_uv_;
  double fronts_per_um_ = 0;           ///< of a kernel by fronts; else 0
  std::vector<double> setting_share_;  ///< patterned: of what the lamp's calibration says
  std::vector<int> uv_levels_;
  std::vector<std::uint16_t> slice_setting_;
  std::vector<std::vector<double>> tables_;  ///< [setting * kPlaces + position]
  std::shared_ptr<const detail::FrontProfile> profile_;
  std::vector<Source> sources_;  ///< [setting * levels + level]
  /// Grey by pulses: full and black light of a level, over the amount of its source. Else empty.
  struct Pulses {
    Source full, black;
  };
  std::vector<Pulses> pulses_;  ///< [setting * levels + level]
  double gap_um_ = 0;           ///< 0: resin stands still
  int least_even_level_ = 0;
  double least_even_mw_cm2_ = 0, greatest_even_mw_cm2_ = 0;  ///< even light, of the usual light
  std::vector<double> flow_factor_;  ///< [setting * levels + level]; empty: all 1
  std::vector<double>
      rest_at_gap_;      ///< the same: of its light, what comes beyond the gap of the even light
  double depth_um_ = 0;  ///< of the resin; 0: without end
  std::vector<double> blue_share_;  ///< by setting; empty: all 1
  LayerHeights heights_{};          ///< alike: all are layer_um_
  double reflectance_ = 0;          ///< of the platform; 0: what comes back is nothing
  /// By setting: a slice with the layers above it that the setting has; -1: any, they are alike. Empty: all -1.
  std::vector<int> slice_of_setting_;
  std::vector<std::vector<double>>
      last_rows_;  ///< [setting * kPlaces + position]; of settings of their own
  mutable std::vector<std::vector<float>> fine_;
  std::unique_ptr<std::once_flag[]> fine_made_;
};

/// UV intensity, mW/cm², that holds a steady dead zone over blue light:
/// Iuv = Ib / beta e^(zf (1/huv - 1/hb)).
double uv_for_dead_zone(const Kinetics& kinetics, double blue_mw_cm2, double dead_zone_um);

}  // namespace slicecorr
