/// @file sim_fixture.hpp
/// A small machine for tests of printer-sim, and the program as a child process.
#pragma once

#include <fcntl.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "slicecorr/bridge/machine.hpp"

namespace slicecorr::test {

/// 16 x 8 pixels; round figures: 1000 um/s² reach 200 um/s in 0.2 s and 20 um.
inline const std::string small_machine = R"(name = "small"
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

inline std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const auto at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  if (at != std::string::npos) text.replace(at, from.size(), to);
  return text;
}

/// A folder that goes with the test.
class TestFolder {
 public:
  TestFolder() {
    std::string name = (std::filesystem::temp_directory_path() / "slicecorr-sim-XXXXXX").string();
    if (!::mkdtemp(name.data())) throw std::runtime_error("no folder");
    path_ = name;
  }
  ~TestFolder() {
    std::error_code error;
    std::filesystem::remove_all(path_, error);
  }
  TestFolder(const TestFolder&) = delete;
  TestFolder& operator=(const TestFolder&) = delete;
  std::string operator/(const std::string& name) const { return path_ + "/" + name; }

 private:
  std::string path_;
};

inline void write_file(const std::string& path, const std::string& text) {
  std::ofstream(path) << text;
}
inline std::string text_of(const std::string& path) {
  std::ifstream in(path);
  std::stringstream text;
  text << in.rdbuf();
  return text.str();
}

/// A program that runs until it is told to end. Its stderr goes to the test's.
class Child {
 public:
  explicit Child(const std::vector<std::string>& command) {
    std::vector<char*> argv;
    for (const std::string& s : command) argv.push_back(const_cast<char*>(s.c_str()));
    argv.push_back(nullptr);
    int out[2];
    if (::pipe2(out, O_CLOEXEC) != 0) throw std::runtime_error("no pipe");
    pid_ = ::fork();
    if (pid_ == 0) {
      ::dup2(out[1], STDOUT_FILENO);
      ::execvp(argv[0], argv.data());
      ::_exit(127);
    }
    ::close(out[1]);
    out_ = out[0];
  }
  ~Child() {
    if (pid_ > 0) {
      ::kill(pid_, SIGKILL);
      end(0);
    }
    ::close(out_);
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  pid_t pid() const { return pid_; }
  /// The next line of stdout; empty when it ends.
  std::string line() {
    std::string text;
    char c = 0;
    while (::read(out_, &c, 1) == 1 && c != '\n') text += c;
    return text;
  }
  bool runs() const { return ::kill(pid_, 0) == 0 && ::waitpid(pid_, nullptr, WNOHANG) == 0; }
  /// Sends a signal (0: none) and waits; exit code, or 128 + the signal that ended it.
  int end(int signal = SIGTERM) {
    if (signal != 0) ::kill(pid_, signal);
    int status = 0;
    ::waitpid(pid_, &status, 0);
    pid_ = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  }

 private:
  pid_t pid_ = -1;
  int out_ = -1;
};

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
  std::string modbus, frames;
  int port = 0;

 private:
  static std::vector<std::string> command(const std::string& printer,
                                          std::vector<std::string> more) {
    std::vector<std::string> all{SLICECORR_BIN_DIR "/printer-sim", "--printer", printer, "--quiet"};
    bool listens = false;
    for (const std::string& m : more) listens = listens || m == "--listen";
    if (!listens) all.insert(all.end(), {"--listen", "127.0.0.1:0"});
    all.insert(all.end(), more.begin(), more.end());
    return all;
  }
};

}  // namespace slicecorr::test
