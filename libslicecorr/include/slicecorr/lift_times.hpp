// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file lift_times.hpp
/// How long a print takes layer by layer: the light, and what lies between two exposures
/// (docs/layerwise.md). Archives say it of themselves, printer files in `[stage]`.
///
/// Plain values; all functions are thread-safe and throw nothing.
#pragma once

#include <optional>
#include <string>
#include <vector>

namespace slicecorr {

struct Process;

/// What a printer does after an exposure, with the light off: waits, lifts in up to two stages, waits,
/// comes back in up to two stages to where the next layer begins, waits. All numbers >= 0.
struct LiftMotion {
  double up_mm = 0, up_mm_s = 0;      ///< a stage with a way has a speed above 0
  double up_2_mm = 0, up_2_mm_s = 0;  ///< the second stage
  double back_mm_s = 0;               ///< of the way back but for the second stage's
  double back_2_mm = 0, back_2_mm_s = 0;
  double before_lift_s = 0, after_lift_s = 0, before_light_s = 0;  ///< waits
  double light_off_s = 0;  ///< the light stays off at least so long, moves and waits included
  double tilt_s = 0;       ///< of a vat that tilts instead of a platform that lifts
  double acceleration_mm_s2 = 0;  ///< of all moves; 0: speeds are there at once
  bool operator==(const LiftMotion&) const = default;
};

/// The time between two exposures by its parts, s.
struct DarkTime {
  double lift_s = 0, return_s = 0;
  double waits_s =
      0;  ///< what is left: waits, tilts, and light that stays off longer than moves take
  double all_s() const { return lift_s + return_s + waits_s; }
};
/// `layer_um`: by which the platform comes back less far than it lifts; without a lift it goes so far
/// at the lift's speed.
DarkTime dark_time(const LiftMotion& motion, double layer_um);

/// The motion after each layer.
struct LiftTimes {
  LiftMotion normal;
  LiftMotion bottom;      ///< of the first `bottom_layers`
  int bottom_layers = 0;  ///< >= 0
  /// In place of those two where layers have their own; the last holds for later layers.
  std::vector<LiftMotion> layers{};
  bool by_archive = false;  ///< the archive says it; else the printer file
  const LiftMotion& of(int layer) const;
  bool operator==(const LiftTimes&) const = default;
};

/// The time of a layer by its parts.
struct LayerTime {
  double light_s = 0;
  std::optional<DarkTime> dark{};  ///< nothing: not known
  /// "2.5 s of light, 6 s of lift, 2.32 s of return, 0.5 s of waits: 11.32 s"; "2.5 s of light; lifts not
  /// known".
  std::string in_words() const;
  /// An object with light, lift, return, waits, all, s; what is not known is null.
  std::string to_json() const;
};
/// Of a normal layer, layer by layer.
LayerTime layer_time(const Process& process, const std::optional<LiftTimes>& lifts,
                     double layer_um);

/// How long a print takes.
struct PrintTime {
  double light_s = 0;  ///< in which slices are shown
  /// All that lies between them, after the last layer, too; nothing: not known.
  std::optional<double> dark_s{};
  /// As a stopwatch shows it; nothing: not known.
  std::optional<double> all_s() const;
};
/// Layer by layer with what is known of lifts; continuous prints have none, so that light is all.
PrintTime print_time(const Process& process, const std::optional<LiftTimes>& lifts, double m,
                     double layer_um, int slices);
/// The same of `light_s` in which `slices` layers are shown one by one.
PrintTime print_time_of_layers(const std::optional<LiftTimes>& lifts, double light_s,
                               double layer_um, int slices);
/// "1 h 10 min 12 s, of it 20 min 32 s of light"; "20 min 32 s of light; lifts not known".
std::string print_time_in_words(const PrintTime& time);

}  // namespace slicecorr
