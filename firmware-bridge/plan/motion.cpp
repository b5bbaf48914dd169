// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "plan/checks.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/kinetics.hpp"
#include "slicecorr/limit.hpp"

namespace slicecorr::bridge {
namespace {

constexpr double kMmHFromUmS = 3.6;
/// Where nobody asked for ramps outside, the platform may be this share of the absorbance height
/// (base 10) above the window when the first slice comes: the dose there is 11 % less.
constexpr double kUnaskedRunUp = 0.05;

double height_um(const PrintPlan& plan) {
  return static_cast<double>(plan.frames.size()) * plan.layer_um;
}

void check_travel(const PrintPlan& plan, const Machine& machine, double top_um) {
  const double travel = machine.stage.travel_um;
  if (travel > 0 && top_um > travel) {
    const int less = static_cast<int>(std::ceil((top_um - travel) / plan.layer_um));
    throw InfeasibleError(fmt::format(
        "the print ends {:.3f} mm above the window with its ramps, the stage of printer '{}' "
        "reaches {:g} mm; {}",
        top_um * 1e-3, machine.printer.name, travel * 1e-3,
        less < static_cast<int>(plan.frames.size())
            ? fmt::format("{} slices of {:g} um less would do", less, plan.layer_um)
            : fmt::format("it begins at {:g} mm (home_mm), which leaves no room",
                          machine.stage.home_um * 1e-3)));
  }
}

void plan_layers(PrintPlan& plan, const Process& process, const Machine& machine) {
  const Stage& stage = machine.stage;
  const MachineLimits& limits = machine.limits;
  plan.speed_um_s = stage.lift_speed_um_s;
  plan.end_um = plan.start_um + height_um(plan);
  check_travel(plan, machine, plan.end_um);
  const double up = stage.lift_speed_um_s, back = stage.return_speed_um_s;
  const double lift_s = stage.lift_um > 0 ? stage.lift_um / up + stage.lift_um / back +
                                                (up + back) / stage.acceleration_um_s2
                                          : 0;
  for (std::size_t n = 0; n < plan.frames.size(); ++n) {
    const double exposure_s = layer_exposure_s(process, static_cast<int>(n));
    if (exposure_s < kCyclesPerSlice * limits.cycle_s) {
      throw InfeasibleError(
          fmt::format("layer {} is exposed for {:g} s, with exchanges every {:g} s at least {:g} "
                      "s can be timed",
                      n, exposure_s, limits.cycle_s, kCyclesPerSlice * limits.cycle_s));
    }
    plan.frames[n].exposure_s = exposure_s;
    plan.expected_s += exposure_s + stage.settle_s + (n > 0 ? lift_s : 0);
  }
}

/// Where each slice has light for its own speed: whether the blue lamp can follow the stage while it
/// changes its speed, which it does in the faster slice.
void check_changes(const PrintPlan& plan, const Machine& machine) {
  for (int n = 0; n < static_cast<int>(plan.frames.size()); ++n) {
    const double least = std::min(plan.speed_at(n - 1), plan.speed_at(n + 1));
    if (least >= plan.speed_at(n) || lamp_share(plan, machine.blue, least, n) > 0) continue;
    throw InfeasibleError(fmt::format(
        "the stage changes its speed between {:.4g} and {:.4g} mm/h in slice {}, and the blue lamp of "
        "printer '{}' is dark below {:g} % of its light (min_share); correct the part for speeds that "
        "change less from slice to slice",
        least * kMmHFromUmS, plan.speed_at(n) * kMmHFromUmS, n, machine.printer.name,
        100 * machine.blue.min_share));
  }
}

/// Speeds of slices, and whether the blue lamp can follow them.
void plan_slice_speeds(PrintPlan& plan, const Process& process, const Machine& machine) {
  if (process.slice_speed_mm_h.empty()) return;
  for (std::size_t n = 0; n < plan.frames.size(); ++n) {
    plan.slice_speed_um_s.push_back(slice_speed_mm_h(process, static_cast<int>(n)) / kMmHFromUmS);
  }
  plan.light_of_slices = slices_differ(process);
  if (plan.light_of_slices) return check_changes(plan, machine);
  const auto slowest = std::min_element(plan.slice_speed_um_s.begin(), plan.slice_speed_um_s.end());
  if (lamp_share(plan, machine.blue, *slowest, 0) > 0) return;
  throw InfeasibleError(fmt::format(
      "slice {} goes at {:.4g} mm/h, {:.3g} % of the {:g} mm/h that the light is for, and the blue "
      "lamp of printer '{}' is dark below {:g} % of its light (min_share); correct the part for at "
      "least {} mm/h there, or for a lower speed",
      slowest - plan.slice_speed_um_s.begin(), *slowest * kMmHFromUmS,
      100 * *slowest / plan.speed_um_s, process.speed_mm_h, machine.printer.name,
      100 * machine.blue.min_share,
      at_least(process.speed_mm_h * std::pow(machine.blue.min_share, plan.m))));
}

/// Time from the first slice to the last: the stage changes its speed so that none is faster than
/// its own. `rests`: it begins and ends at rest.
double passing_s(const PrintPlan& plan, bool rests) {
  const auto slices = static_cast<int>(plan.frames.size());
  const double h = plan.layer_um, a = plan.acceleration_um_s2;
  // The greatest speed with which each slice can begin, from what comes before and after.
  std::vector<double> from(static_cast<std::size_t>(slices) + 1);
  const auto at = [&](int n) -> double& { return from[static_cast<std::size_t>(n)]; };
  at(0) = rests ? 0 : plan.speed_at(0);
  at(slices) = rests ? 0 : plan.speed_at(slices - 1);
  for (int n = 1; n < slices; ++n) at(n) = std::min(plan.speed_at(n - 1), plan.speed_at(n));
  for (int n = 0; n < slices; ++n) {
    at(n + 1) = std::min(at(n + 1), std::sqrt(at(n) * at(n) + 2 * a * h));
  }
  for (int n = slices - 1; n >= 0; --n) {
    at(n) = std::min(at(n), std::sqrt(at(n + 1) * at(n + 1) + 2 * a * h));
  }
  double time_s = 0;
  for (int n = 0; n < slices; ++n) {
    const double u = at(n), w = at(n + 1);
    const double peak = std::min(plan.speed_at(n), std::sqrt((u * u + w * w) / 2 + a * h));
    const double changing_um = (2 * peak * peak - u * u - w * w) / (2 * a);
    time_s += (2 * peak - u - w) / a + std::max(0.0, h - changing_um) / peak;
  }
  return time_s;
}

/// Whether the stage and the exchanges with the machine can keep up.
void check_speed(const PrintPlan& plan, const Machine& machine) {
  const Stage& stage = machine.stage;
  const MachineLimits& limits = machine.limits;
  const double v = plan.slice_speed_um_s.empty() ? plan.speed_um_s
                                                 : *std::max_element(plan.slice_speed_um_s.begin(),
                                                                     plan.slice_speed_um_s.end());
  if (stage.max_speed_um_s > 0 && v > stage.max_speed_um_s * (1 + 1e-9)) {
    throw InfeasibleError(fmt::format(
        "the stack is printed at {:g} mm/h, the stage of printer '{}' reaches {:g} mm/h; correct "
        "the part for at most that speed",
        v * kMmHFromUmS, machine.printer.name, stage.max_speed_um_s * kMmHFromUmS));
  }
  const double slice_s = plan.layer_um / v;
  if (slice_s < kCyclesPerSlice * limits.cycle_s) {
    throw InfeasibleError(
        fmt::format("a slice of {:g} um passes in {:.3g} ms at {:g} mm/h, with exchanges every "
                    "{:g} ms (cycle_s) it must take {:g} ms; print at {} mm/h or slower, or "
                    "with higher slices",
                    plan.layer_um, slice_s * 1e3, v * kMmHFromUmS, limits.cycle_s * 1e3,
                    kCyclesPerSlice * limits.cycle_s * 1e3,
                    at_most(plan.layer_um / (kCyclesPerSlice * limits.cycle_s) * kMmHFromUmS)));
  }
}

void plan_ramps(PrintPlan& plan, const Process& process, const Machine& machine) {
  const Stage& stage = machine.stage;
  const double v = plan.speed_um_s;
  plan.ramp_um = v * v / (2 * stage.acceleration_um_s2);
  const double asked_um = process.ramp_mm * 1e3;
  if (process.ramp_mm > 0 && asked_um < plan.ramp_um * (1 - 1e-9)) {
    throw InfeasibleError(fmt::format(
        "the stack's ramps are {:g} mm long, the stage of printer '{}' takes {:.4g} mm to {:g} "
        "mm/h; correct the part with --ramp-mm {} or more",
        process.ramp_mm, machine.printer.name, plan.ramp_um * 1e-3, process.speed_mm_h,
        at_least(plan.ramp_um * 1e-3)));
  }
  plan.ramp = process.ramp == Ramp::lamp_follows ? Ramp::lamp_follows : Ramp::outside;
  if (process.ramp_mm > 0) {
    plan.ramp_um = asked_um;
    plan.acceleration_um_s2 = v * v / (2 * asked_um);
  }
}

}  // namespace

void plan_motion(PrintPlan& plan, const StackInfo& info, const Machine& machine) {
  const Process& process = *info.process;
  plan.m = make_kinetics(*info.resin, process.uv.kind != UvKind::off, true).m;
  plan.acceleration_um_s2 = machine.stage.acceleration_um_s2;
  plan.start_um = machine.stage.home_um;
  if (plan.mode == ExposureMode::layerwise) return plan_layers(plan, process, machine);

  plan.speed_um_s = process.speed_mm_h / kMmHFromUmS;
  plan_slice_speeds(plan, process, machine);
  check_speed(plan, machine);
  plan_ramps(plan, process, machine);
  plan.expected_s = height_um(plan) / plan.speed_um_s;
  if (plan.lamps_follow()) {
    plan.end_um = plan.start_um + height_um(plan);
    check_travel(plan, machine, plan.end_um);
    plan.expected_s =
        light_on_s(process, plan.m, plan.layer_um, static_cast<int>(plan.frames.size()));
    if (!plan.slice_speed_um_s.empty()) plan.expected_s = passing_s(plan, true);
    return;
  }
  const double begin_um_s = plan.speed_at(0);
  double ramp_um = plan.ramp_um;
  if (!plan.slice_speed_um_s.empty()) {
    plan.expected_s = passing_s(plan, false);
    ramp_um *= begin_um_s * begin_um_s / (plan.speed_um_s * plan.speed_um_s);
  }
  plan.run_up_um = ramp_um + kReactionCycles * machine.limits.cycle_s * begin_um_s;
  if (process.ramp == Ramp::none &&
      plan.run_up_um > kUnaskedRunUp * info.resin->absorbance_height10_um) {
    throw InfeasibleError(fmt::format(
        "the stage of printer '{}' takes {:.0f} um to reach {:g} mm/h, and the stack does not say "
        "what happens meanwhile; correct the part with --ramp lamp-follows --ramp-mm {}, or "
        "with --ramp outside, which leaves a gap of that height above the first slice",
        machine.printer.name, plan.run_up_um, process.speed_mm_h, at_least(plan.ramp_um * 1e-3)));
  }
  plan.start_um += plan.run_up_um;
  plan.end_um = plan.start_um + height_um(plan);
  check_travel(plan, machine, plan.end_um + plan.ramp_um);
}

}  // namespace slicecorr::bridge
