// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/bridge/beam_plan.hpp"

#include <fmt/format.h>

#include "plan/checks.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/recording.hpp"

namespace slicecorr::bridge {
namespace {

constexpr double kUmPerMm = 1000;
/// The lamp shines behind black for about so many cycles around an exposure.
constexpr double kBlackCycles = 2;

void check_job(const tomo::BeamJob& job, const std::string& path, const Machine& machine,
               const std::optional<BeamVat>& vat) {
  const Printer &made = job.printer, &here = machine.printer;
  if (machine.stage.turns()) {
    throw InputError(
        path, "",
        fmt::format("is a print with beams, and printer '{}' turns a vial ([rotation]); "
                    "expected a job of `slicecorr tomo solve`",
                    here.name));
  }
  const auto differs = [&](const std::string& what) {
    throw InputError(path, "",
                     fmt::format("was made for another printer: {} than printer '{}' has; find the "
                                 "beams for this printer",
                                 what, here.name));
  };
  if (made.name != here.name) differs(fmt::format("its name is '{}', other", made.name));
  if (!vat) {
    throw InputError(machine.path, "beams",
                     "missing; expected the vat and the displays that shine into it");
  }
  if (made.width_px != here.width_px || made.height_px != here.height_px ||
      made.bit_depth != here.bit_depth || made.pixel_x_um != here.pixel_x_um ||
      made.pixel_y_um != here.pixel_y_um) {
    differs(fmt::format("displays of {} x {} pixels of {:g} x {:g} um, {} bits, other",
                        made.width_px, made.height_px, made.pixel_x_um, made.pixel_y_um,
                        made.bit_depth));
  }
  if (made.calibration != here.calibration) {
    differs(fmt::format("a calibration that ends at {:g} mW/cm², other",
                        made.calibration.back().intensity_mw_cm2));
  }
  if (made.flat_field != here.flat_field) differs("light that is uneven in another way");
  if (made.orientation.value_or(Orientation{}) != here.orientation.value_or(Orientation{})) {
    differs("displays that lie otherwise");
  }
  if (here.orientation && here.orientation->portrait) {
    throw InputError(machine.path, "display", "its images lie in portrait; expected landscape");
  }
  if (job.vat.ways != vat->ways) differs("beams on other displays or places ([beams])");
  if (job.vat.phase != vat->phase) differs("other displays of phase ([beams])");
  if (job.vat.inside_mm != vat->inside_mm) {
    differs(fmt::format("a vat of {:g} x {:g} x {:g} mm, other", job.vat.inside_mm[0],
                        job.vat.inside_mm[1], job.vat.inside_mm[2]));
  }
}

}  // namespace

Process process_of(const tomo::BeamJob& job) {
  Process process;
  process.mode = ExposureMode::layerwise;
  process.exposure_s = job.exposure_s;
  return process;
}

PrintPlan plan_beams(const tomo::BeamJob& job, const std::string& path, const Machine& machine,
                     const std::optional<BeamVat>& vat) {
  check_job(job, path, machine, vat);
  const Stage& stage = machine.stage;
  const MachineLimits& limits = machine.limits;
  if (job.exposure_s < kCyclesPerSlice * limits.cycle_s) {
    throw InfeasibleError(fmt::format(
        "the exposure takes {:g} s, with exchanges every {:g} s at least {:g} s can be timed; find "
        "the beams for less light (--intensity-mw-cm2)",
        job.exposure_s, limits.cycle_s, kCyclesPerSlice * limits.cycle_s));
  }
  PrintPlan plan;
  plan.mode = ExposureMode::layerwise;
  plan.layer_um = job.vat.inside_mm[2] * kUmPerMm;
  plan.m = light_exponent(job.resin, process_of(job));
  plan.speed_um_s = stage.lift_speed_um_s;
  plan.acceleration_um_s2 = stage.acceleration_um_s2;
  // The stage stands at home for its one slice.
  plan.end_um = stage.home_um;
  plan.start_um = plan.end_um - plan.layer_um;
  plan.black_mw_cm2 = level_intensities(machine.printer).front();
  plan.frames.push_back({.lit = true, .exposure_s = job.exposure_s});
  plan.expected_s = job.exposure_s + stage.settle_s;
  plan.black_excess =
      plan.black_mw_cm2 / job.brightest_mw_cm2 * kBlackCycles * limits.cycle_s / job.exposure_s;
  return plan;
}

}  // namespace slicecorr::bridge
