// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file adapters.hpp
/// One protocol each.
#pragma once

#include <memory>

#include "slicecorr/farm/machines.hpp"

namespace slicecorr::farm::detail {

std::unique_ptr<MachineAdapter> make_sdcp1(const MachineSpec& machine, const MachineTimes& times);
std::unique_ptr<MachineAdapter> make_sdcp3(const MachineSpec& machine, const MachineTimes& times);
std::unique_ptr<MachineAdapter> make_bridge(const MachineSpec& machine, const MachineTimes& times);
std::unique_ptr<MachineAdapter> make_nanodlp(const MachineSpec& machine, const MachineTimes& times);
std::unique_ptr<MachineAdapter> make_odyssey(const MachineSpec& machine, const MachineTimes& times);
std::unique_ptr<MachineAdapter> make_prusalink(const MachineSpec& machine,
                                               const MachineTimes& times);

}  // namespace slicecorr::farm::detail
