// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file machine_motion.hpp
/// How a machine that printbridge drives moves, by its printer file, and what of a print it takes:
/// speeds, ramps, travel (docs/bridge.md). One set of rules for who plans, corrects, queues and prints.
///
/// Plain values; all functions are thread-safe. Distances are um, heights those of the platform above
/// the window.
#pragma once

#include <optional>
#include <string>

#include "slicecorr/process.hpp"
#include "slicecorr/settings.hpp"

namespace slicecorr {

/// Control cycles in which a slice must pass at least: its place is predicted from the one before,
/// its image sent in the next, and what became of it is known in the third.
inline constexpr double kCyclesPerSlice = 3;
/// Control cycles from the command to move to knowing of it.
inline constexpr double kReactionCycles = 4;

/// What [stage], [lamps] and [bridge] of a printer file say, and the printer's name for messages.
struct MachineMotion {
  std::string printer;
  double max_speed_um_s = 0;      ///< 0: any
  double travel_um = 0;           ///< 0: any
  double acceleration_um_s2 = 0;  ///< > 0
  double home_um = 0;             ///< where prints begin
  double cycle_s = 0.01;          ///< > 0
  double max_late_um = 5;         ///< > 0: what may stay dark at an end of a ramp
  double least_blue_share = 0;    ///< 0..1: of the lamp's light; below it is dark
  double least_uv_share = 0;      ///< 0..1: the same of its greatest UV light
  double blue_warm_up_s = 0;      ///< 0: gives all its light at once
  double blue_settle_s = 0.05;    ///< until light is what is asked, when warm
  bool operator==(const MachineMotion&) const = default;
};
/// Of the text of a printer file; nothing where it has no [modbus], so that nothing is driven by it, or
/// its stage turns or says no acceleration. Throws `InputError` naming file, line and key.
std::optional<MachineMotion> parse_machine_motion(const std::string& text,
                                                  const std::string& source);
/// The same of a printer by its name or file.
std::optional<MachineMotion> load_machine_motion(const std::string& name_or_path);

/// A print as the stage sees it.
struct MovedPrint {
  const Process& process;
  double m = 1;                              ///< the resin's exponent, > 0
  double absorbance_height10_um = 0;         ///< the resin's, > 0
  double layer_um = 0;                       ///< > 0
  int slices = 0;                            ///< those after the part's end too; >= 0
  ChoiceNames names = ChoiceNames::options;  ///< how messages name settings
};

/// How the stage moves for a print.
struct PrintMotion {
  Ramp ramp = Ramp::outside;
  double ramp_um = 0;               ///< until it has its speed
  double acceleration_um_s2 = 0;    ///< that the print asks for
  double run_up_um = 0;             ///< ramps outside: above the window when the first slice comes
  double start_um = 0, end_um = 0;  ///< of the slices
};
/// Throws `InfeasibleError` saying what would do where the machine does not take the print: stage too
/// slow, slices that pass or are lit too shortly, ramps too short, too long for the lamps or not said, more
/// travel than there is, slices so much slower than others that the lamp goes dark.
PrintMotion print_motion(const MovedPrint& print, const MachineMotion& machine);

/// Sets how lamps and stage get to the speed of a continuous print that says nothing of it: lamps follow,
/// over the way that the stage takes, where the machine would refuse the print otherwise and its lamps can
/// follow. Whether it did.
bool take_ramp(const MachineMotion& machine, double m, double absorbance_height10_um,
               Process& process);

/// The greatest speed of a continuous print, mm/h, and what sets it in words: that at which its slices can
/// be timed and its ramps taken, lamps following or not. The print's own speed and slices do not count.
struct MostSpeed {
  double mm_h = 0;
  std::string words;
};
MostSpeed most_speed(const MovedPrint& print, const MachineMotion& machine);

}  // namespace slicecorr
