// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file sim_fixture.hpp
/// A small machine for tests of printer-sim, and the program as a child process.
#pragma once

#include <sys/wait.h>

#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "bridge_fixture.hpp"
#include "slicecorr/bridge/machine.hpp"

namespace slicecorr::test {

/// 16 x 8 pixels; round figures: 1000 um/s² reach 200 um/s in 0.2 s and 20 um.
inline const std::string kSmallMachine = R"(name = "small"
[display]
width_px = 16
height_px = 8
pixel_um = 50.0
[blue]
calibration = [[0, 1.0], [255, 100.0]]
[uv]
kind = "flood"
calibration = [[0, 0.0], [255, 200.0]]
[stage]
max_speed_mm_h = 3600
travel_mm = 20
acceleration_mm_s2 = 1
tolerance_um = 20
home_mm = 1
[lamps.blue]
min_share = 0.02
max_share = 2
tolerance = 0.05
settle_s = 0
[lamps.uv]
settle_s = 0
[bridge]
cycle_s = 0.01
response_timeout_s = 0.04
heartbeat_timeout_s = 0.3
watchdog_s = 0.3
max_temperature_c = 60
[modbus]
transport = "tcp"
port = 0
unit = 1
word_order = "big"
exchange = "fc23"
[modbus.write]
sequence = { address = 0 }
heartbeat = { address = 1 }
command = { address = 2 }
watchdog_s = { address = 3, scale = 0.001 }
target_um = { address = 4, type = "i32", scale = 0.01 }
speed_um_s = { address = 6, type = "u32", scale = 0.001 }
acceleration_um_s2 = { address = 8, type = "u32", scale = 0.1 }
blue_share = { address = 10, type = "u32", scale = 1e-6 }
uv_mw_cm2 = { address = 12, type = "u32", scale = 0.001 }
frame = { address = 14, type = "i32" }
[modbus.read]
sequence_echo = { address = 100 }
state = { address = 101 }
stage_um = { address = 102, type = "i32", scale = 0.01 }
stage_speed_um_s = { address = 104, type = "i32", scale = 0.001 }
blue_measured = { address = 106, type = "u32", scale = 1e-6 }
uv_measured = { address = 108, type = "u32", scale = 0.001 }
temperature_c = { address = 110, type = "i16", scale = 0.1 }
door_open = { address = 111, bit = 0 }
stop_pressed = { address = 111, bit = 1 }
lamp_failed = { address = 111, bit = 2 }
stage_failed = { address = 111, bit = 3 }
over_temperature = { address = 111, bit = 4 }
watchdog_tripped = { address = 111, bit = 5 }
machine_time_s = { address = 112, type = "u32", scale = 0.001 }
)";

inline bridge::Machine machine_of(const std::string& text) {
  return bridge::parse_machine(text, "small.toml");
}

inline bool runs(const Child& child) { return ::waitpid(child.pid(), nullptr, WNOHANG) == 0; }

/// printer-sim, ready.
class Sim : public Child {
 public:
  /// `more`: further options; listens on a free TCP port where they don't say otherwise.
  Sim(const std::string& printer, std::vector<std::string> more = {})
      : Child(command(printer, std::move(more))) {
    const std::string ready = line();
    const auto json = nlohmann::json::parse(ready, nullptr, false);
    if (json.is_discarded()) throw std::runtime_error("printer-sim did not start");
    modbus = json.at("modbus").get<std::string>();
    frames = json.value("frames", "");
    if (const auto colon = modbus.rfind(':'); colon != std::string::npos) {
      port = std::stoi(modbus.substr(colon + 1));
    }
  }
  int end(int signal = SIGTERM) { return Child::end(signal); }
  std::string modbus, frames;
  int port = 0;

 private:
  static std::vector<std::string> command(const std::string& printer,
                                          std::vector<std::string> more) {
    std::vector<std::string> all{program("printer-sim"), "--printer", printer, "--quiet"};
    bool listens = false;
    for (const std::string& m : more) listens = listens || m == "--listen";
    if (!listens) all.insert(all.end(), {"--listen", "127.0.0.1:0"});
    all.insert(all.end(), more.begin(), more.end());
    return all;
  }
};

}  // namespace slicecorr::test
