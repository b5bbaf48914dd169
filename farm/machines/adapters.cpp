// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "machines/adapters.hpp"

#include "slicecorr/error.hpp"

namespace slicecorr::farm {

std::unique_ptr<MachineAdapter> make_adapter(const MachineSpec& machine,
                                             const MachineTimes& times) {
  switch (machine.kind) {
    case MachineKind::sdcp3:
      return detail::make_sdcp3(machine, times);
    case MachineKind::sdcp1:
      return detail::make_sdcp1(machine, times);
    case MachineKind::nanodlp:
      return detail::make_nanodlp(machine, times);
    case MachineKind::odyssey:
      return detail::make_odyssey(machine, times);
    case MachineKind::bridge:
      return detail::make_bridge(machine, times);
    case MachineKind::prusalink:
    case MachineKind::octoprint:
      return detail::make_prusalink(machine, times);
  }
  throw InputError("the machine " + machine.name + " is of no kind that is spoken here");
}

}  // namespace slicecorr::farm
