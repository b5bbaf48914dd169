// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The checks that come before a print, one by one.
#pragma once

#include <string>

#include "slicecorr/bridge/plan.hpp"
#include "slicecorr/machine_motion.hpp"

namespace slicecorr::bridge {

/// Throws `InputError` when the stack is none of ours, is no corrected one, or was changed.
void check_kind(const StackReader& stack, const std::string& path);
/// Throws `InputError` naming what differs between the printer that the stack was made for and the
/// one at hand. Stage limits may differ: they are checked for what they are.
void check_printer(const StackInfo& info, const std::string& path, const Machine& machine);
/// What the rules that planners and corrections share know of the machine.
MachineMotion motion_of(const Machine& machine);
/// Speed, ramps, travel: fills in how the stage moves. Throws `InfeasibleError`.
void plan_motion(PrintPlan& plan, const StackInfo& info, const Machine& machine);
/// Brightest pixels and UV light of all frames. Throws `InfeasibleError`.
void plan_light(PrintPlan& plan, const StackReader& stack, const Machine& machine,
                const ExecutionContext& context);

}  // namespace slicecorr::bridge
