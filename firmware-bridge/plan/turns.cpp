// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// A tomographic job on a stage that turns.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "plan/checks.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/vial.hpp"
#include "slicecorr/vial_outline.hpp"

namespace slicecorr::bridge {
namespace {

/// Before light the stage must have gone steadily for so long, s.
constexpr double kSteadyS = 0.5;
/// The lamp comes on so many settling times before the first frame, and s.
constexpr double kSettlings = 5, kSpareS = 0.2;

std::string in_words(const Rotation& r) {
  return fmt::format("{:g} °/s {}", r.deg_s,
                     r.direction == TurnDirection::clockwise ? "clockwise" : "counterclockwise");
}

std::string in_words(const Optics& o) {
  std::string text = o.kind == OpticsKind::telecentric
                         ? "telecentric"
                         : fmt::format("from a pinhole at {:g} mm", o.distance_mm);
  if (o.half_angle_deg > 0) {
    text += fmt::format(" in cones of {:g}° ({} rays)", o.half_angle_deg, o.rays_per_pixel);
  }
  return text + fmt::format(", its axis {:g} pixels right, {:g} up and leaning by {:g}°",
                            o.axis_right_px, o.axis_up_px, o.tilt_deg);
}

void check_job(const tomo::TomoJob& job, const std::string& path, const Machine& machine) {
  const Printer &made = job.printer, &here = machine.printer;
  if (!machine.stage.turns()) {
    throw InputError(path, "",
                     fmt::format("is a job for a vial that turns, and printer '{}' has no "
                                 "[rotation]; expected a stack of `slicecorr correct`",
                                 here.name));
  }
  const auto differs = [&](const std::string& what, const std::string& was, const std::string& is) {
    throw InputError(path, "",
                     fmt::format("was made for another printer: {} {}, expected {} as printer '{}' "
                                 "has; solve the part for this printer",
                                 what, was, is, here.name));
  };
  if (made.name != here.name) differs("its name is", "'" + made.name + "'", "'" + here.name + "'");
  // The direction first: a part that turns the other way comes out mirrored.
  if (made.rotation->deg_s != here.rotation->deg_s ||
      made.rotation->direction != here.rotation->direction) {
    differs("its vial turns", in_words(*made.rotation), in_words(*here.rotation));
  }
  const auto size = [](const Printer& p) {
    return fmt::format("{} x {} pixels of {:g} x {:g} um, {} bits", p.width_px, p.height_px,
                       p.pixel_x_um, p.pixel_y_um, p.bit_depth);
  };
  if (size(made) != size(here) || made.pixel_x_um != here.pixel_x_um ||
      made.pixel_y_um != here.pixel_y_um) {
    differs("its display has", size(made), size(here));
  }
  if (made.calibration != here.calibration) {
    differs("its calibration ends at",
            fmt::format("{:g} mW/cm² ({} points)", made.calibration.back().intensity_mw_cm2,
                        made.calibration.size()),
            fmt::format("{:g} mW/cm² ({} points, all alike)",
                        here.calibration.back().intensity_mw_cm2, here.calibration.size()));
  }
  if (made.vial != here.vial) {
    const auto vial = [](const Printer& p) {
      std::string text = fmt::format("{:g} to {:g} mm, indices {:g} and {:g}", p.vial->inner_mm,
                                     p.vial->outer_mm, p.vial->n_outside, p.vial->n_wall);
      if (p.vial->jacket_outer_mm > 0) {
        text += fmt::format(", a second wall of {:g} to {:g} mm, indices {:g} and {:g}",
                            p.vial->jacket_inner_mm, p.vial->jacket_outer_mm, p.vial->n_between,
                            p.vial->n_jacket);
      }
      if (p.vial->traced()) {
        text += fmt::format(", shape {}, {} rods", name_of(p.vial->shape), p.vial->rods.size());
      }
      return text;
    };
    differs("its vial has", vial(made), vial(here));
  }
  if (made.optics != here.optics) {
    differs("its light is", in_words(*made.optics), in_words(*here.optics));
  }
  if (made.flat_field != here.flat_field) {
    differs("its light is", made.flat_field ? "uneven in another way" : "even",
            here.flat_field ? "uneven" : "even");
  }
  if (made.rotation->wobble != here.rotation->wobble) {
    const auto axis = [](const Rotation& r) {
      return r.wobble.empty() ? std::string("keeps to its place")
                              : fmt::format("wobbles by up to {:g} pixels ({} angles)",
                                            most_wobble_px(r), r.wobble.size());
    };
    differs("its axis", axis(*made.rotation), "that it " + axis(*here.rotation));
  }
  if (!made.rotation->wobble.empty() && !machine.has_encoder()) {
    throw InputError(path, "",
                     fmt::format("follows the wobble of the axis, and printer '{}' has no encoder "
                                 "(stage_deg): its angles count from where the vial happens to "
                                 "stand; expected one, or a job without wobble",
                                 here.name));
  }
  if (made.orientation.value_or(Orientation{}) != here.orientation.value_or(Orientation{})) {
    differs("its display lies", in_words(made.orientation.value_or(Orientation{})),
            in_words(here.orientation.value_or(Orientation{})));
  }
  if (here.orientation && here.orientation->portrait) {
    throw InputError(machine.path, "display",
                     "its images lie in portrait; expected a projector whose columns run along the "
                     "vial");
  }
}

}  // namespace

PrintPlan plan_turns(const tomo::TomoJob& job, const std::string& path, const Machine& machine) {
  check_job(job, path, machine);
  const Stage& stage = machine.stage;
  const MachineLimits& limits = machine.limits;
  const double turn_um = stage.turn_um(), v = job.printer.rotation->deg_s * stage.um_per_deg;
  PrintPlan plan;
  plan.angles = job.sampling.angles;
  plan.um_per_deg = stage.um_per_deg;
  plan.layer_um = turn_um / plan.angles;
  plan.speed_um_s = v;
  plan.ramp = Ramp::outside;
  plan.acceleration_um_s2 = stage.acceleration_um_s2;
  plan.ramp_um = v * v / (2 * stage.acceleration_um_s2);
  plan.black_mw_cm2 = level_intensities(machine.printer).front();
  const double step_s = plan.layer_um / v;
  if (step_s < kCyclesPerSlice * limits.cycle_s) {
    throw InfeasibleError(fmt::format(
        "a frame is shown for {:.3g} ms, with exchanges every {:g} ms (cycle_s) it must be {:g} ms; "
        "solve the part with --angles {} or fewer",
        step_s * 1e3, limits.cycle_s * 1e3, kCyclesPerSlice * limits.cycle_s * 1e3,
        static_cast<int>(turn_um / v / (kCyclesPerSlice * limits.cycle_s))));
  }
  plan.lamp_lead_um = v * (machine.blue.warm_up_s + kSettlings * machine.blue.settle_s + kSpareS +
                           kReactionCycles * limits.cycle_s);
  const double least_um = plan.ramp_um + v * (kSteadyS + kReactionCycles * limits.cycle_s) +
                          plan.lamp_lead_um + plan.layer_um / 2;
  const double index_um = std::ceil(least_um / turn_um) * turn_um;
  plan.start_um = index_um - plan.layer_um / 2;
  plan.run_up_um = plan.start_um;
  plan.end_um = plan.start_um + job.turns * turn_um;
  // A start may be put off by some turns, and the stage comes to rest at a whole one.
  const double most_um = plan.end_um + (kMostPutOff + 1) * turn_um + plan.ramp_um;
  const double most_frames = 1e9;
  if (most_um > stage.travel_um || 1.0 * job.turns * plan.angles > most_frames) {
    throw InfeasibleError(fmt::format(
        "the job has {} turns, with spin-up and its end up to {:.0f}; the stage of printer '{}' "
        "counts {:.0f} (travel_turns)",
        job.turns, std::ceil(most_um / turn_um), machine.printer.name, stage.travel_um / turn_um));
  }
  plan.frames.assign(static_cast<std::size_t>(job.turns) * static_cast<std::size_t>(plan.angles),
                     FramePlan{.lit = true});
  plan.expected_s = job.turns * turn_um / v;
  return plan;
}

}  // namespace slicecorr::bridge
