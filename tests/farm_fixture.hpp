// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file farm_fixture.hpp
/// A farm of its own for each test: a folder, a clock that tests set, jobs without inputs, and
/// small parts that take milliseconds.
#pragma once

#include <gtest/gtest.h>
#include <poll.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "eventually.hpp"
#include "farm_jobs.hpp"
#include "farm_program.hpp"
#include "run_program.hpp"
#include "slicecorr/farm/clock.hpp"
#include "slicecorr/farm/folder.hpp"
#include "slicecorr/farm/queue.hpp"
#include "slicecorr/farm/read_model.hpp"
#include "slicecorr/farm/store.hpp"

namespace slicecorr::test {

namespace fs = std::filesystem;

/// A folder that goes with the test.
class FarmFolderOfTest {
 public:
  FarmFolderOfTest() {
    // In memory where that is possible: thousands of synced transactions are not what is tested.
    const char* memory = "/dev/shm";
    const bool usable = ::access(memory, W_OK) == 0 && !std::getenv("TMPDIR");
    std::string name =
        ((usable ? fs::path(memory) : fs::temp_directory_path()) / "slicecorr-farm-XXXXXX")
            .string();
    if (!::mkdtemp(name.data())) throw std::runtime_error("no folder");
    path_ = name;
  }
  ~FarmFolderOfTest() {
    std::error_code error;
    fs::remove_all(path_, error);
  }
  FarmFolderOfTest(const FarmFolderOfTest&) = delete;
  FarmFolderOfTest& operator=(const FarmFolderOfTest&) = delete;
  std::string operator/(const std::string& name) const { return path_ + "/" + name; }
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

/// Stands still until it is set.
class TestClock final : public farm::FarmClock {
 public:
  std::int64_t wall_ms() const override { return wall; }
  std::int64_t steady_ms() const override { return steady; }
  std::string boot_id() const override { return boot; }
  std::atomic<std::int64_t> wall{1'800'000'000'000}, steady{5'000'000};
  std::string boot = farm::system_clock().boot_id();
};

inline farm::ClaimRequest any_job(const std::string& service) {
  farm::ClaimRequest r;
  r.service = service;
  r.engine = "local";
  r.free_memory_mb = 1000;
  return r;
}

inline farm::ResultRecord some_result() {
  farm::ResultRecord r;
  r.figures.layers = 10;
  r.figures.height_max_um = 3;
  r.files = {{"uvj", 5, "aa"}, {"html", 6, "bb"}, {"json", 7, "cc"}};
  r.program = "slicecorr test";
  r.wall_s = 1;
  return r;
}

inline farm::AttemptEnd ended(farm::Reason reason, const std::string& message = "why") {
  farm::AttemptEnd e;
  e.reason = reason;
  e.message = message;
  e.wall_s = 1;
  return e;
}

/// What can be read of a file: of a process under /proc nothing, once it has ended.
inline std::string text_of_file(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

inline void write_file(const std::string& path, const std::string& text) {
  std::ofstream file(path, std::ios::binary);
  file << text;
}

/// A binary STL of boxes {x0, x1, y0, y1, z0, z1} in mm.
using BoxMm = std::array<float, 6>;
inline std::string stl_of(const std::vector<BoxMm>& boxes) {
  std::string text(80, ' ');
  const auto put = [&](const auto& value) {
    text.append(reinterpret_cast<const char*>(&value), sizeof value);
  };
  put(static_cast<std::uint32_t>(boxes.size() * 12));
  for (const BoxMm& b : boxes) {
    // Corner c: bit 0 x, bit 1 y, bit 2 z.
    constexpr int sides[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4},
                                 {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
    for (const auto& q : sides) {
      for (const auto& corners : {std::array{q[0], q[1], q[2]}, std::array{q[0], q[2], q[3]}}) {
        for (int i = 0; i < 3; ++i) put(0.0F);
        for (const int c : corners) {
          put(b[c & 1 ? 1 : 0]);
          put(b[c & 2 ? 3 : 2]);
          put(b[c & 4 ? 5 : 4]);
        }
        put(std::uint16_t{0});
      }
    }
  }
  return text;
}

/// A bridge on two legs: its gap cures through unless it is corrected. `n` makes it another part.
inline std::string bridge_stl(int n) {
  const float high = 1.0F + 0.05F * static_cast<float>(n % 20);
  const float wide = 2.0F + 0.1F * static_cast<float>(n / 20);
  return stl_of({{0, 0.6F, 0, 1, 0, high},
                 {wide, wide + 0.6F, 0, 1, 0, high},
                 {0, wide + 0.6F, 0, 1, high, high + 0.5F}});
}

constexpr const char* kSmallPrinterToml = R"(
name = "small"
[display]
width_px = 96
height_px = 64
pixel_um = 50.0
bit_depth = 8
[blue]
wavelength_nm = 460
calibration = [[0, 1.0], [255, 100.0]]
[stage]
max_speed_mm_h = 2000
travel_mm = 100
)";

constexpr const char* kSmallResinToml = R"(
name = "clear"
[cure]
model = "jacobs"
m = 1.0
absorbance_height_um = 1500.0
absorbance_base = 10
critical_dose_mj_cm3 = 230.0
)";

/// A service in the background, as long as this object lives.
class RunningService {
 public:
  RunningService(const std::string& dir, std::vector<std::string> more = {},
                 const std::map<std::string, std::string>& environment = {}) {
    std::vector<std::string> arguments = {slicefarm_for(environment), "run", "--quiet", "--dir",
                                          dir};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const TextList argv(arguments), envp(environment_with(environment));
    child_ = ::vfork();
    if (child_ == 0) {
      ::execve(argv.data()[0], argv.data(), envp.data());
      ::_exit(127);
    }
  }
  ~RunningService() {
    if (child_ > 0) end(SIGKILL);
  }
  pid_t pid() const { return child_; }
  /// Sends the signal and waits; gives the exit code, or 128 + signal. SIGTERM is sent when the
  /// service is up: before it handles the signal, there is nothing to end in good order.
  int end(int signal) {
    while (signal == SIGTERM && !handles(signal) && running()) ::poll(nullptr, 0, 2);
    ::kill(child_, signal);
    return wait();
  }
  int wait() {
    int status = 0;
    ::waitpid(child_, &status, 0);
    child_ = 0;
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  }

 private:
  /// A line of /proc/PID/status, after its name; empty when the process is gone.
  std::string status(const std::string& name) const {
    std::ifstream file("/proc/" + std::to_string(child_) + "/status");
    for (std::string line; std::getline(file, line);) {
      if (line.starts_with(name + ":\t")) return line.substr(name.size() + 2);
    }
    return {};
  }
  bool handles(int signal) const {
    const std::string caught = status("SigCgt");
    return !caught.empty() && (std::stoull(caught, nullptr, 16) >> (signal - 1) & 1) != 0;
  }
  bool running() const {
    const std::string state = status("State");
    return !state.empty() && !state.starts_with('Z');
  }

  pid_t child_ = 0;
};

/// Waits for what must come; fails the test when it does not come for far too long.
template <typename Condition>
bool comes(Condition condition) {
  return eventually(condition, std::chrono::seconds(60));
}

/// Programs on a farm of the test's own, as people run them.
class FarmPrograms : public testing::Test {
 protected:
  void SetUp() override {
    write_file(dir / "small.toml", kSmallPrinterToml);
    write_file(dir / "clear.toml", kSmallResinToml);
  }

  std::vector<std::string> process_options() const {
    return {"--printer", dir / "small.toml", "--resin", dir / "clear.toml", "--layer-um",
            "50",        "--speed-mm-h",     "700"};
  }
  std::string farm_dir() const { return dir / "farm"; }
  std::string database() const { return farm_dir() + "/farm.sqlite"; }

  RunResult program(const std::string& name, std::vector<std::string> arguments,
                    const RunOptions& options = {}) const {
    arguments.insert(arguments.begin(), std::string(SLICECORR_BIN_DIR) + "/" + name);
    return run_program(arguments, options);
  }
  /// `slicefarm COMMAND --dir DIR ARGUMENTS`.
  RunResult farm(const std::string& command, std::vector<std::string> arguments = {},
                 RunOptions options = {}) const {
    arguments.insert(arguments.begin(), {command, "--dir", farm_dir()});
    if (!options.environment.contains("USER")) options.environment["USER"] = "anna";
    arguments.insert(arguments.begin(), slicefarm_for(options.environment));
    return run_program(arguments, options);
  }
  RunResult submit_parts(const std::vector<std::string>& parts,
                         const std::vector<std::string>& more = {}) const {
    std::vector<std::string> arguments = parts;
    const auto process = process_options();
    arguments.insert(arguments.end(), process.begin(), process.end());
    arguments.insert(arguments.end(), more.begin(), more.end());
    const RunResult r = farm("submit", arguments);
    EXPECT_EQ(r.exit_code, 0) << r.err;
    return r;
  }
  /// Works until all is done; short delays, and room on any disk.
  RunResult run_all(const std::map<std::string, std::string>& environment = {},
                    std::vector<std::string> more = {}) const {
    RunOptions o;
    o.environment = environment;
    o.timeout = std::chrono::minutes(5);
    more.insert(more.begin(), "--until-empty");
    return farm("run", more, o);
  }
  /// As `slicefarm set` does it, without a program.
  void change_settings(const std::vector<std::pair<std::string, std::string>>& changes) const {
    farm::Queue(farm::open_folder(farm_dir()).database()).change_settings(changes, "anna");
  }
  void quick_settings() const { change_settings({{"min-free-mb", "0"}, {"retry-delay-s", "0"}}); }
  std::string make_part(int n) const {
    const std::string path = dir / ("bridge-" + std::to_string(n) + ".stl");
    write_file(path, bridge_stl(n));
    return path;
  }
  /// What `slicecorr run` makes of the part, as PATH.uvj, .html and .json. Parts are the same in
  /// many tests: each is done once for all that this process runs.
  std::string reference(const std::string& part) const {
    static const FarmFolderOfTest all;
    static std::map<std::pair<std::string, std::string>, std::string> known;
    const std::string name = fs::path(part).stem().string();
    std::string& base = known[{name, text_of_file(part)}];
    if (!base.empty()) return base;
    const std::string folder = all / std::to_string(known.size());
    fs::create_directory(folder);
    base = folder + "/" + name;
    std::vector<std::string> arguments = {"run", part, "-o", base + ".uvj"};
    const auto process = process_options();
    arguments.insert(arguments.end(), process.begin(), process.end());
    const RunResult r = program("slicecorr", arguments);
    EXPECT_EQ(r.exit_code, 0) << r.err;
    return base;
  }
  void expect_same_files(const std::string& a, const std::string& b) const {
    for (const char* ending : {".uvj", ".html", ".json", "-target.uvj"}) {
      ASSERT_TRUE(fs::exists(a + ending)) << a << ending;
      EXPECT_TRUE(text_of_file(a + ending) == text_of_file(b + ending)) << a << ending;
    }
  }
  /// Files that only stand there while something is being made.
  std::vector<std::string> leftovers(const std::string& folder) const {
    std::vector<std::string> list;
    if (!fs::exists(folder)) return list;
    for (const auto& entry : fs::recursive_directory_iterator(folder)) {
      const std::string name = entry.path().filename().string();
      if (name.starts_with(".") || name.ends_with(".part")) list.push_back(entry.path().string());
    }
    return list;
  }

  FarmFolderOfTest dir;
};

}  // namespace slicecorr::test
