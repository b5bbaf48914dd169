// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/bridge/plan.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "plan/checks.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::bridge {

double lamp_share(const PrintPlan& plan, const LampDrive& lamp, double speed_um_s, int slice) {
  double share = 1;
  if (plan.mode == ExposureMode::continuous) {
    const double ratio = std::max(0.0, speed_um_s) / plan.light_speed_at(slice);
    share = plan.m == 1 ? ratio : std::pow(ratio, 1 / plan.m);
  }
  return share < lamp.min_share ? 0 : std::min(share, lamp.max_share);
}

std::string PrintPlan::place(double stage_um) const {
  if (!turns()) return fmt::format("{:.1f} um", stage_um);
  const double deg = stage_um / um_per_deg;
  return fmt::format("{:.2f}°", deg);
}

PrintPlan plan_print(const StackReader& stack, const std::string& path, const Machine& machine,
                     const ExecutionContext& context) {
  if (machine.stage.turns()) {
    throw InputError(
        path, "",
        fmt::format("is a stack of slices, and printer '{}' turns a vial ([rotation]); "
                    "expected a job of `slicecorr tomo solve`",
                    machine.printer.name));
  }
  check_kind(stack, path);
  const StackInfo& info = stack.info();
  check_printer(info, path, machine);
  PrintPlan plan;
  plan.mode = info.process->mode;
  plan.layer_um = info.grid.layer_um;
  plan.frames.resize(static_cast<std::size_t>(info.grid.layers));
  plan_motion(plan, info, machine);
  plan_light(plan, stack, machine, context);
  return plan;
}

}  // namespace slicecorr::bridge
