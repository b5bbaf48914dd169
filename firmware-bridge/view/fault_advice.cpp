// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/bridge/print_state.hpp"

namespace slicecorr::bridge {

std::string_view what_to_do(Fault fault) {
  switch (fault) {
    case Fault::underrun:
      return "use more --threads, or leave the computer to this print";
    case Fault::late_frame:
    case Fault::wrong_frame:
    case Fault::display_gone:
      return "look at the display and at what else the computer does";
    case Fault::heartbeat_lost:
    case Fault::machine_restarted:
    case Fault::watchdog_tripped:
      return "look at the machine's power and connection";
    case Fault::stage_error:
    case Fault::stage_failed:
      return "see whether the stage is free and the part is not stuck";
    case Fault::lamp_mismatch:
    case Fault::lamp_failed:
    case Fault::uv_ratio:
      return "look at the lamps before any other print";
    case Fault::door_open:
      return "close it";
    case Fault::stop_pressed:
      return "release it when all is well";
    case Fault::impossible_measurement:
      return "look at the machine's sensors, and whether [modbus.read] has the right registers";
    case Fault::bridge_stopped:
      return "leave the computer to this print: it must not sleep, nor the program be stopped";
    case Fault::over_temperature:
      return "let it cool, look at its fans";
    default:
      return "look at the machine and its part";
  }
}

}  // namespace slicecorr::bridge
