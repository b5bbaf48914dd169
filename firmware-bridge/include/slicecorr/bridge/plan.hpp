// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file plan.hpp
/// What is to be shown where, how bright, and whether this machine can do it: settled before
/// anything moves. Plain values; all functions are thread-safe. Only `plan_print` and
/// `plan_turns` throw.
#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "slicecorr/bridge/machine.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/tomo/job.hpp"

namespace slicecorr::bridge {

/// A print that turns is put off by so many turns at most, until its stage goes steadily.
inline constexpr int kMostPutOff = 3;

/// One slice of the stack as it is printed.
struct FramePlan {
  bool lit = false;      ///< some pixel is above black
  double uv_mw_cm2 = 0;  ///< asked of the UV lamp, >= 0; patterned: of its full light
  /// Least UV light that keeps resin at the window from curing under this frame's brightest pixel,
  /// at full blue light; of an even dead zone, what the stack has less the lamp's tolerance;
  /// patterned: of the lamp's full light. 0: nothing is asked.
  double least_uv_mw_cm2 = 0;
  double exposure_s = 0;  ///< layer by layer, > 0; else 0
};

/// A print: slices as a stage moves along a line, or the frames of a tomographic job, turn after
/// turn, as a stage turns its vial (`turns()`). Then a "slice" is a frame's step of angle, as an arc
/// (`Stage`): it begins half a step before the frame's own angle.
struct PrintPlan {
  ExposureMode mode = ExposureMode::continuous;
  double layer_um = 0, speed_um_s = 0;  ///< slice height, > 0; print speed, 0 layer by layer
  double m = 1;                         ///< exponent of intensity in the resin's cure law
  /// Continuous: speed at each slice where some go slower than `speed_um_s`, for which the light is;
  /// the lamps follow. Empty: `speed_um_s` throughout.
  std::vector<double> slice_speed_um_s;
  /// Whether the light of each slice is for its own speed: then lamps only follow while the stage
  /// changes its speed.
  bool light_of_slices = false;
  Ramp ramp = Ramp::none;
  double acceleration_um_s2 = 0;  ///< of the ramps: at most the stage's
  double ramp_um = 0;             ///< distance in which the stage reaches its speed
  /// Where ramps lie outside: way before the first slice, in which the stage reaches its speed and
  /// is seen to do so.
  double run_up_um = 0;
  bool uv = false, uv_patterned = false;  ///< UV light is on; it has an image per slice
  std::vector<FramePlan> frames;
  double start_um = 0, end_um = 0;  ///< stage positions of the first slice's begin, the last's end
  double expected_s = 0;            ///< time that it takes from start to end
  double black_mw_cm2 = 0;          ///< what the projector gives with the lamp on and black shown
  double uv_max_mw_cm2 = 0;         ///< of the UV lamp at full share
  /// Layer by layer: what black gives while the lamp shines before and after the exposures, in all,
  /// as a share of the dose that gels. It is in no stack.
  double black_excess = 0;
  int angles = 0;         ///< of a job: frames of a turn; 0: a stack
  double um_per_deg = 0;  ///< of a job: as in `Stage`
  /// Of a job: before the first frame, where the lamp comes on behind black; the stage must go
  /// steadily by then.
  double lamp_lead_um = 0;
  bool turns() const { return angles > 0; }
  /// The job's frame that frame `n` of the print shows; of stacks `n` itself, and of black, too.
  int shown_frame(int n) const { return turns() && n >= 0 ? n % angles : n; }
  /// A place as people read it: um of a line; of a job degrees from the index on.
  std::string place(double stage_um) const;
  /// Speed at slice `n`, 0..frames - 1; before and after them that of the nearest.
  double speed_at(int n) const {
    if (slice_speed_um_s.empty()) return speed_um_s;
    const int last = static_cast<int>(slice_speed_um_s.size()) - 1;
    return slice_speed_um_s[static_cast<std::size_t>(std::clamp(n, 0, last))];
  }
  /// The speed that the light of slice `n` is for.
  double light_speed_at(int n) const { return light_of_slices ? speed_at(n) : speed_um_s; }
  double slowest_um_s() const {
    return slice_speed_um_s.empty()
               ? speed_um_s
               : *std::min_element(slice_speed_um_s.begin(), slice_speed_um_s.end());
  }
  /// What is borne of lateness along the way.
  double max_late_um(const MachineLimits& limits) const {
    return limits.max_late_um > 0 ? limits.max_late_um : layer_um / 2;
  }
  /// Whether the lamps follow the stage's speed on its ramps.
  bool lamps_follow() const {
    return mode == ExposureMode::continuous && ramp == Ramp::lamp_follows;
  }
  /// Stage position where slice n begins; layer by layer where the stage stands for it.
  double frame_um(int n) const {
    return start_um + (mode == ExposureMode::layerwise ? n + 1 : n) * layer_um;
  }
};

/// Share of the lamp at a speed in slice `slice`: (v / v_n)^(1/m), v_n what its light is for, which leaves
/// I^m / s as it is; 0 below min_share.
double lamp_share(const PrintPlan& plan, const LampDrive& lamp, double speed_um_s, int slice);

/// Throws `InputError` (exit 2) when the stack is damaged (checksums of images, entries, sizes), is
/// no corrected stack, or was made for another printer (name, display, calibration, more suction
/// than its vat bears now); and
/// `InfeasibleError` (exit 3) when it is too fast or too long for the stage, asks for more light
/// than the lamps give, has frames with too little UV light for their blue light, or ramps that
/// the lamps can't follow: the message says what would do. Reads all images once. `path` names the
/// stack in messages.
PrintPlan plan_print(const StackReader& stack, const std::string& path, const Machine& machine,
                     const ExecutionContext& context = {});

/// The same of a tomographic job, of `read_job`. Throws `InputError` when it was made for another
/// printer (name, display, calibration, vial, optics, how it turns), or this one does not turn, and
/// `InfeasibleError` when it has more turns or frames in a second than the machine can do.
PrintPlan plan_turns(const tomo::TomoJob& job, const std::string& path, const Machine& machine);

}  // namespace slicecorr::bridge
