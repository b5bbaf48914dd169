// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>

#include "plan/checks.hpp"
#include "slicecorr/kinetics.hpp"
#include "slicecorr/machine_motion.hpp"

namespace slicecorr::bridge {
namespace {

constexpr double kMmHFromUmS = 3.6;

double height_um(const PrintPlan& plan) {
  return static_cast<double>(plan.frames.size()) * plan.layer_um;
}

void plan_layers(PrintPlan& plan, const Process& process, const Machine& machine) {
  const Stage& stage = machine.stage;
  plan.speed_um_s = stage.lift_speed_um_s;
  const double up = stage.lift_speed_um_s, back = stage.return_speed_um_s;
  const double lift_s = stage.lift_um > 0 ? stage.lift_um / up + stage.lift_um / back +
                                                (up + back) / stage.acceleration_um_s2
                                          : 0;
  for (std::size_t n = 0; n < plan.frames.size(); ++n) {
    plan.frames[n].exposure_s = layer_exposure_s(process, static_cast<int>(n));
    plan.expected_s += plan.frames[n].exposure_s + stage.settle_s + (n > 0 ? lift_s : 0);
  }
}

void plan_slice_speeds(PrintPlan& plan, const Process& process) {
  if (process.slice_speed_mm_h.empty()) return;
  for (std::size_t n = 0; n < plan.frames.size(); ++n) {
    plan.slice_speed_um_s.push_back(slice_speed_mm_h(process, static_cast<int>(n)) / kMmHFromUmS);
  }
  plan.light_of_slices = slices_differ(process);
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

}  // namespace

MachineMotion motion_of(const Machine& machine) {
  const Stage& stage = machine.stage;
  MachineMotion m;
  m.printer = machine.printer.name;
  m.max_speed_um_s = stage.max_speed_um_s;
  m.travel_um = stage.travel_um;
  m.acceleration_um_s2 = stage.acceleration_um_s2;
  m.home_um = stage.home_um;
  m.cycle_s = machine.limits.cycle_s;
  m.max_late_um = machine.limits.max_late_um;
  m.least_blue_share = machine.blue.min_share;
  m.blue_warm_up_s = machine.blue.warm_up_s;
  m.blue_settle_s = machine.blue.settle_s;
  if (const auto& uv = machine.printer.uv) {
    m.least_uv_share = std::max(machine.uv.min_share, uv->min_mw_cm2() / uv->max_mw_cm2());
  }
  return m;
}

void plan_motion(PrintPlan& plan, const StackInfo& info, const Machine& machine) {
  const Process& process = *info.process;
  plan.m = make_kinetics(*info.resin, process.uv.kind != UvKind::off, true).m;
  const auto slices = static_cast<int>(plan.frames.size());
  const PrintMotion motion =
      print_motion({process, plan.m, info.resin->absorbance_height10_um, plan.layer_um, slices},
                   motion_of(machine));
  plan.start_um = motion.start_um;
  plan.end_um = motion.end_um;
  if (plan.mode == ExposureMode::layerwise) {
    plan.acceleration_um_s2 = machine.stage.acceleration_um_s2;
    return plan_layers(plan, process, machine);
  }
  plan.speed_um_s = process.speed_mm_h / kMmHFromUmS;
  plan_slice_speeds(plan, process);
  plan.ramp = motion.ramp;
  plan.ramp_um = motion.ramp_um;
  plan.acceleration_um_s2 = motion.acceleration_um_s2;
  plan.run_up_um = motion.run_up_um;
  if (!plan.slice_speed_um_s.empty()) {
    plan.expected_s = passing_s(plan, plan.lamps_follow());
  } else {
    plan.expected_s = plan.lamps_follow() ? light_on_s(process, plan.m, plan.layer_um, slices)
                                          : height_um(plan) / plan.speed_um_s;
  }
}

}  // namespace slicecorr::bridge
