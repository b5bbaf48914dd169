// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/bridge/control.hpp"

namespace slicecorr::bridge {

std::string_view name_of(Phase phase) {
  switch (phase) {
    case Phase::connecting:
      return "connecting";
    case Phase::warming:
      return "warming";
    case Phase::homing:
      return "homing";
    case Phase::uv_on:
      return "uv_on";
    case Phase::printing:
      return "printing";
    case Phase::pausing:
      return "pausing";
    case Phase::paused:
      return "paused";
    case Phase::resuming:
      return "resuming";
    case Phase::blue_off:
      return "blue_off";
    case Phase::uv_off:
      return "uv_off";
    case Phase::raising:
      return "raising";
    case Phase::done:
      return "done";
    case Phase::lamps_off:
      return "lamps_off";
    case Phase::stopping:
      return "stopping";
    case Phase::blacking:
      return "blacking";
    case Phase::failed:
      return "failed";
  }
  return "unknown";
}

std::string_view name_of(Fault fault) {
  switch (fault) {
    case Fault::none:
      return "none";
    case Fault::underrun:
      return "underrun";
    case Fault::late_frame:
      return "late_frame";
    case Fault::wrong_frame:
      return "wrong_frame";
    case Fault::heartbeat_lost:
      return "heartbeat_lost";
    case Fault::machine_restarted:
      return "machine_restarted";
    case Fault::stage_error:
      return "stage_error";
    case Fault::lamp_mismatch:
      return "lamp_mismatch";
    case Fault::uv_ratio:
      return "uv_ratio";
    case Fault::door_open:
      return "door_open";
    case Fault::stop_pressed:
      return "stop_pressed";
    case Fault::over_temperature:
      return "over_temperature";
    case Fault::lamp_failed:
      return "lamp_failed";
    case Fault::stage_failed:
      return "stage_failed";
    case Fault::watchdog_tripped:
      return "watchdog_tripped";
    case Fault::display_gone:
      return "display_gone";
    case Fault::stopped_by_user:
      return "stopped_by_user";
    case Fault::impossible_measurement:
      return "impossible_measurement";
    case Fault::bridge_stopped:
      return "bridge_stopped";
    case Fault::defect:
      return "defect";
  }
  return "unknown";
}

std::optional<Fault> fault_of(std::string_view name) {
  for (int i = 0; i <= static_cast<int>(Fault::defect); ++i) {
    if (name_of(static_cast<Fault>(i)) == name) return static_cast<Fault>(i);
  }
  return std::nullopt;
}

}  // namespace slicecorr::bridge
