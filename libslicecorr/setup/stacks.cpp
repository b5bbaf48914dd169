// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Which setups and uses stacks allow that know how they were made.
#include "setup/stacks.hpp"

#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr {

namespace detail {

void check_recorded(const Setup& setup, const StackInfo& info) {
  Process process = *info.process;
  process.allow_window_cure = setup.process.allow_window_cure;
  // Lifts and adhesion change no dose, and older recordings do not know them.
  Printer printer = *info.printer;
  printer.lift_motion = setup.printer.lift_motion;
  printer.adhesion_kpa = setup.printer.adhesion_kpa;
  if (setup.printer == printer && setup.process == process &&
      light_exponent(setup.resin, setup.process) == light_exponent(*info.resin, process)) {
    return;
  }
  throw InputError(
      "the stack is a recording of a print: its printer, speed, exposure and UV light are those of "
      "that print; expected no others, and no resin with another exponent m");
}

}  // namespace detail

void check_design(const StackInfo& info, const std::string& path) {
  if (info.kind == StackKind::recorded) {
    throw InputError(path, "", "is a recording of a print; expected the target of that print");
  }
  if (info.kind == StackKind::corrected) {
    throw InputError(path, "", "is a corrected stack; expected the target that it was made from");
  }
}

}  // namespace slicecorr
