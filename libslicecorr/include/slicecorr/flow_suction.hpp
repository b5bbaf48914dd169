// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file flow_suction.hpp
/// How fast a part can be pulled: suction under its slices and under the platform, the dose that its
/// resin brings to the front and the dead zone that follows, and whether the vat bears it.
///
/// Plain values; all functions are thread-safe and give the same figures for any number of threads.
/// `InputError` for what does not fit, `InfeasibleError` for what physics forbids, `Cancelled`.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "slicecorr/flow_part.hpp"
#include "slicecorr/flow_section.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr {

/// The gap under a part where nobody says it and no UV light holds it, um.
inline constexpr double kDefaultGapUm = 80;
/// Where lights and speed would leave a thicker one, um: a void more than a gap.
inline constexpr double kThickestGapUm = 300;

/// The even gap whose resin takes its gel dose in the mean over the section, um: what is produced in
/// it leaves through the front, so (1/S) int_0^h a dz = D'c, whatever the section and the diffusion.
/// At most `kThickestGapUm`, also where the light is too weak for any gap. For m other than 1
/// inhibitor counts as dose does, with the power m. Throws `InfeasibleError` where no dead zone lasts.
double even_gap_um(const Kinetics& kinetics, double blue_mw_cm2, double uv_mw_cm2,
                   double speed_mm_h);

/// The gap that suction is judged with, and where it comes from, in words.
struct PrintGap {
  double gap_um = 0;
  std::string words;
};
/// `given_um` where it is > 0; else the dead zone that the UV light is to hold; else `even_gap_um` of
/// full light under constant UV light; else `kDefaultGapUm`.
PrintGap print_gap(const Printer& printer, const Resin& resin, const Process& process,
                   double given_um);

/// The slowest slice of a print; where slices have speeds of their own, the one that comes nearest to the
/// speed that it bears.
struct PrintSuction {
  int slice = 0;
  double speed_mm_h = 0;                ///< at which it is printed
  double z_mm = 0, x_mm = 0, y_mm = 0;  ///< its middle, from the platform; where on the plate
  double suction_pa = 0, force_n = 0;   ///< at `speed_mm_h`
  double speed_limit_mm_h = 0;          ///< at which suction is `limit_pa`
  double limit_pa = 0;                  ///< the printer's, or 1 bar
  bool limit_given = false;             ///< by the printer
  PrintGap gap;
};
/// What pulling a target continuously does. Nothing where the resin says no viscosity, the print is
/// layer by layer, or the part is too small for the flow's cells, which no vat feels.
std::optional<PrintSuction> print_suction(const SliceSource& target, const Printer& printer,
                                          const Resin& resin, const Process& process,
                                          double given_gap_um,
                                          const ExecutionContext& context = {});
/// The speed that each slice of a target bears, mm/h, at the printer's limit or 1 bar; infinite where
/// nothing is lit. One more than the target has slices: the last holds for those after it. Nothing where
/// `print_suction` has nothing to say.
std::vector<double> slice_speed_limits(const SliceSource& target, const Printer& printer,
                                       const Resin& resin, const Process& process,
                                       double given_gap_um, const ExecutionContext& context = {});
/// One line: how much suction and force, where, and the speed that works.
std::string suction_in_words(const PrintSuction& suction, double speed_mm_h);
/// Throws `InfeasibleError`, naming slice, place and the speed that works, when the printer says what
/// it bears and the print draws more.
void check_suction(const PrintSuction& suction, const Printer& printer, double speed_mm_h);

// ------------------------------------------------------------------------- slice by slice

struct FlowLight {
  double blue_mw_cm2 = 0, uv_mw_cm2 = 0;  ///< at the window, even
};

/// How a part is pulled.
struct FlowPull {
  double viscosity_pa_s = 0, speed_mm_h = 0, gap_um = 0;  ///< > 0
  double limit_pa = kCavitationPa;                        ///< > 0
  int every = 1;                     ///< slices 0, every, 2 every, ... and the last
  std::optional<FlowLight> light{};  ///< nothing: no dose
  std::optional<FlowResin> resin{};  ///< with `light`
  bool dead_zone = true;             ///< with `light`: find it, too
};

/// What happens under one slice.
struct SliceFlow {
  int slice = 0;
  std::size_t mask = 0;
  double x_mm = 0, y_mm = 0;  ///< where suction is greatest
  double suction_pa = 0, force_n = 0, speed_limit_mm_h = 0;
  bool bound = false;       ///< `MaskPhi::bound`
  double width_um = 0;      ///< of the widest place: twice the greatest distance from an outline
  double near_outline = 0;  ///< share of the part nearer than the gap to an outline
  double area_mm2 = 0;
  std::optional<DoseSummary> dose;
  double dead_zone_min_um = 0, dead_zone_max_um = 0;  ///< with `dose`
  bool zone_at_rest = false;                          ///< `DeadZoneRange::at_rest`
  double zone_window = 0;  ///< with it: the window's greatest dose under that dead zone
};

/// What the resin between platform and window does in the first slices, where beside the part the
/// gap is n hs + h.
struct PlatformFlow {
  struct Slice {
    int slice = 0;
    double suction_pa = 0, force_n = 0, speed_limit_mm_h = 0;  ///< of platform and part
  };
  double width_mm = 0, height_mm = 0;
  /// Gap under the platform at which its force is that of the part in the first slice.
  double changeover_um = 0;
  int changeover_slice = 0;   ///< the first slice with such a gap
  std::vector<Slice> slices;  ///< some, from slice 0 to the changeover
};

/// Slices without a cell of part are left out. Masks that slices share are solved once.
std::vector<SliceFlow> part_flow(const FlowPart& part, const FlowPull& pull,
                                 const ExecutionContext& context = {});
/// A platform of this size about the middle of the image.
PlatformFlow platform_flow(const FlowPart& part, const FlowPull& pull, double width_mm,
                           double height_mm, const ExecutionContext& context = {});

/// Least and greatest gap of the dead zone under even light, um, where every cell's front has just its
/// gel dose (the fixed point); cells nearer than `start_um` to an outline, and those whose front does
/// not come to rest, do not count where there are others, nor do a fiftieth of them at either end. At most `kThickestGapUm`. Found on cells of
/// which at most 64 lie along the section: the dead zone changes as slowly as the section is wide.
struct DeadZoneRange {
  double min_um = 0, max_um = 0;
  int rounds = 0;
  /// Fronts came to rest. Else, as where much of a section would be void, gaps are those of the first
  /// step: from the even gap to where the dose is 1 at the rate that holds at its front.
  bool at_rest = true;
  double max_window = 0;  ///< greatest relative dose at the window under these gaps, where at rest
};
DeadZoneRange dead_zone_under(const FlowSection& section, const FlowResin& resin, double speed_mm_h,
                              double start_um, const FlowLight& light,
                              const ExecutionContext& context = {});

}  // namespace slicecorr
