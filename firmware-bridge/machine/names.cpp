// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "machine/names.hpp"

#include <algorithm>

namespace slicecorr::bridge {

namespace detail {

namespace {

constexpr auto kNames = std::to_array<SignalName>({
    {Signal::sequence, "sequence", true},
    {Signal::heartbeat, "heartbeat", true},
    {Signal::command, "command", true},
    {Signal::watchdog_s, "watchdog_s", true},
    {Signal::target_um, "target_um", true},
    {Signal::speed_um_s, "speed_um_s", true},
    {Signal::acceleration_um_s2, "acceleration_um_s2", true},
    {Signal::blue_share, "blue_share", true},
    {Signal::uv_mw_cm2, "uv_mw_cm2", true},
    {Signal::frame, "frame", true},
    {Signal::job, "job", true},
    {Signal::sequence_echo, "sequence_echo", false},
    {Signal::state, "state", false},
    {Signal::stage_um, "stage_um", false},
    {Signal::stage_speed_um_s, "stage_speed_um_s", false},
    {Signal::blue_measured, "blue_measured", false},
    {Signal::uv_measured, "uv_measured", false},
    {Signal::temperature_c, "temperature_c", false},
    {Signal::door_open, "door_open", false},
    {Signal::stop_pressed, "stop_pressed", false},
    {Signal::lamp_failed, "lamp_failed", false},
    {Signal::stage_failed, "stage_failed", false},
    {Signal::over_temperature, "over_temperature", false},
    {Signal::watchdog_tripped, "watchdog_tripped", false},
    {Signal::latched, "latched", false},
    {Signal::job_kept, "job_kept", false},
    {Signal::machine_time_s, "machine_time_s", false},
});

}  // namespace

std::span<const SignalName> signal_names() { return kNames; }

double least_raw(const Register& reg) {
  switch (reg.type) {
    case RegisterType::i16:
      return -32768;
    case RegisterType::i32:
      return -2147483648.0;
    default:
      return 0;
  }
}

double greatest_raw(const Register& reg) {
  switch (reg.type) {
    case RegisterType::u16:
      return 65535;
    case RegisterType::i16:
      return 32767;
    case RegisterType::u32:
      return 4294967295.0;
    case RegisterType::i32:
      return 2147483647.0;
    case RegisterType::bit:
      return 1;
  }
  return 0;
}

}  // namespace detail

std::string_view name_of(Signal signal, bool turns) {
  if (turns) {
    switch (signal) {
      case Signal::target_um:
        return "target_deg";
      case Signal::speed_um_s:
        return "speed_deg_s";
      case Signal::acceleration_um_s2:
        return "acceleration_deg_s2";
      case Signal::stage_um:
        return "stage_deg";
      case Signal::stage_speed_um_s:
        return "stage_speed_deg_s";
      default:
        break;
    }
  }
  const auto all = detail::signal_names();
  return std::find_if(all.begin(), all.end(), [&](const auto& n) { return n.signal == signal; })
      ->name;
}

}  // namespace slicecorr::bridge
