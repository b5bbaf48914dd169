// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Programs of the bridge as they are used: a small printer, a small part, a simulator beside.
#pragma once

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <fstream>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "lattice.hpp"
#include "run_program.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::test {

inline std::string program(const std::string& name) {
  return std::string(SLICECORR_BIN_DIR) + "/" + name;
}

inline std::string text_of(const std::string& path) { return to_text(read_file(path)); }

inline std::string joined(const std::vector<std::string>& lines) {
  std::string text;
  for (const std::string& line : lines) text += line + "\n";
  return text;
}

/// Replaces what must be there.
inline std::string replaced(std::string text, const std::string& what, const std::string& by) {
  const auto at = text.find(what);
  if (at == std::string::npos) {
    ADD_FAILURE() << "no '" << what << "'";
    return text;
  }
  return text.replace(at, what.size(), by);
}

/// A program in the background, whose stdout is read line by line and whose stdin is open until
/// `close_stdin`.
class Child {
 public:
  explicit Child(std::vector<std::string> command, const std::string& err_path = "/dev/null") {
    std::vector<char*> argv;
    for (std::string& a : command) argv.push_back(a.data());
    argv.push_back(nullptr);
    int out[2], in[2];
    if (::pipe2(out, O_CLOEXEC) != 0 || ::pipe2(in, O_CLOEXEC) != 0) {
      throw std::runtime_error("no pipe");
    }
    const int err = ::open(err_path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
    child_ = ::vfork();
    if (child_ == 0) {
      ::dup2(in[0], STDIN_FILENO);
      ::dup2(out[1], STDOUT_FILENO);
      ::dup2(err, STDERR_FILENO);
      // A test that crashes leaves nobody behind.
      ::prctl(PR_SET_PDEATHSIG, SIGKILL);
      ::execv(argv[0], argv.data());
      ::_exit(127);
    }
    ::close(out[1]);
    ::close(in[0]);
    ::close(err);
    out_ = out[0];
    in_ = in[1];
  }
  ~Child() {
    if (child_ > 0) end(SIGKILL);
    ::close(out_);
    close_stdin();
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;
  pid_t pid() const { return child_; }
  /// Empty at the end.
  std::string line() {
    std::string text;
    char c = 0;
    while (::read(out_, &c, 1) == 1 && c != '\n') text += c;
    return text;
  }
  void close_stdin() {
    if (in_ >= 0) ::close(in_);
    in_ = -1;
  }
  /// Sends the signal and waits; the exit code, or 128 + signal.
  int end(int signal) {
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
  pid_t child_ = 0;
  int out_ = -1, in_ = -1;
};

/// Waits for what must come; false when it does not come for far too long.
inline bool wait_until(const std::function<bool()>& there, double limit_s = 60) {
  const auto until = std::chrono::steady_clock::now() + std::chrono::duration<double>(limit_s);
  while (!there()) {
    if (std::chrono::steady_clock::now() > until) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  return true;
}

class BridgePrograms : public testing::Test {
 protected:
  /// The shipped printer with a display of 96 x 64 pixels and limits that bear a machine on which
  /// other programs run: real time is not what these tests are about. `changes`: of the file's
  /// text.
  std::string make_printer(const std::string& name,
                           const std::vector<std::pair<std::string, std::string>>& changes = {}) {
    std::string text = text_of(std::string(SLICECORR_PRINTERS_DIR) + "/dual-wavelength-dlp.toml");
    text = replaced(text, "width_px = 1280", "width_px = 96");
    text = replaced(text, "height_px = 800", "height_px = 64");
    text = replaced(text, "travel_mm = 100", "travel_mm = 6");
    text = replaced(text, "\nwarm_up_s = 2\n", "\nwarm_up_s = 0.1\n");
    for (const auto& [what, by] : changes) text = replaced(text, what, by);
    const std::string path = folder / (name + ".toml");
    write_file(path, to_bytes(text));
    return path;
  }
  static std::vector<std::pair<std::string, std::string>> patient() {
    return {{"heartbeat_timeout_s = 0.3", "heartbeat_timeout_s = 3"},
            {"watchdog_s = 0.3", "watchdog_s = 3"},
            {"response_timeout_s = 0.04", "response_timeout_s = 0.7"},
            {"max_late_um = 5", "max_late_um = 500"},
            {"tolerance_um = 20", "tolerance_um = 400"}};
  }

  /// A stage that lifts less and gathers speed sooner.
  static std::vector<std::pair<std::string, std::string>> quick() {
    return {{"lift_mm = 3", "lift_mm = 1"},
            {"acceleration_mm_s2 = 1.0", "acceleration_mm_s2 = 10"}};
  }

  std::string make_part() {
    const std::string path = folder / "lattice.stl";
    const TriangleMesh mesh = lattice(part_cells, 1, 1, part_cell_mm, part_cell_mm * (0.25 / 1.6));
    std::ofstream out(path);
    out << "solid lattice\n";
    for (const auto& t : mesh.triangles) {
      out << "facet normal 0 0 0\nouter loop\n";
      for (const auto v : t) {
        const auto& p = mesh.vertices[v];
        out << "vertex " << p[0] << " " << p[1] << " " << p[2] << "\n";
      }
      out << "endloop\nendfacet\n";
    }
    out << "endsolid lattice\n";
    return path;
  }

  /// A corrected stack of the lattice and, beside it, its target. Tests that ask for the same get
  /// the same bytes: two programs make them once.
  std::string make_stack(const std::string& printer, const std::string& name = "part",
                         std::vector<std::string> more = {"--resin", "figure-2-2", "--speed-mm-h",
                                                          "800"}) {
    const std::string target = folder / (name + "-target.uvj"), stack = folder / (name + ".uvj");
    static std::map<std::string, std::pair<Bytes, Bytes>> made;
    std::string key = text_of(printer) + std::to_string(part_cells) + " cells of " +
                      std::to_string(part_cell_mm) + " mm, " + name;
    bool by_files = false;
    for (const std::string& word : more) {
      key += "\n" + word;
      by_files = by_files || word.starts_with(folder.path());
    }
    if (const auto before = made.find(key); before != made.end() && !by_files) {
      write_file(target, before->second.first);
      write_file(stack, before->second.second);
      return stack;
    }
    const RunResult sliced =
        run_program({program("slicecorr"), "slice", make_part(), "-o", target, "--printer", printer,
                     "--layer-um", "50", "--antialias", "off", "--quiet"});
    EXPECT_EQ(sliced.exit_code, 0) << sliced.err;
    std::vector<std::string> command{program("slicecorr"), "correct", target,   "-o", stack,
                                     "--printer",          printer,   "--quiet"};
    command.insert(command.end(), more.begin(), more.end());
    const RunResult corrected = run_program(command);
    EXPECT_EQ(corrected.exit_code, 0) << corrected.err;
    if (corrected.exit_code == 0) made[key] = {read_file(target), read_file(stack)};
    return stack;
  }

  struct Sim {
    std::unique_ptr<Child> child;
    std::string modbus, frames, events, shown;
  };
  Sim start_sim(const std::string& printer, bool lockstep, std::vector<std::string> more = {},
                const std::string& listen = "127.0.0.1:0") {
    Sim sim;
    const std::string n = std::to_string(++sims_);
    sim.events = folder / ("events" + n + ".jsonl");
    sim.shown = folder / ("shown" + n + shown_ending);
    std::vector<std::string> command{program("printer-sim"),
                                     "--printer",
                                     printer,
                                     "--listen",
                                     listen,
                                     "--frames",
                                     "unix:" + (folder / ("f" + n)),
                                     "--record-events",
                                     sim.events};
    if (!shown_ending.empty()) command.insert(command.end(), {"-o", sim.shown});
    if (lockstep) command.push_back("--lockstep");
    command.insert(command.end(), more.begin(), more.end());
    sim.child = std::make_unique<Child>(command, folder / ("sim" + n + ".err"));
    const std::string line = sim.child->line();
    const auto ready = nlohmann::json::parse(line, nullptr, false);
    if (!ready.is_object()) {
      ADD_FAILURE() << "printer-sim says '" << line << "' "
                    << text_of(folder / ("sim" + n + ".err"));
      return sim;
    }
    sim.modbus = ready.value("modbus", "");
    sim.frames = ready.value("frames", "");
    return sim;
  }

  std::vector<std::string> print_command(const std::string& stack, const std::string& printer,
                                         const Sim& sim, bool lockstep,
                                         std::vector<std::string> more = {}) {
    std::vector<std::string> command{program("printbridge"),
                                     "print",
                                     stack,
                                     "--printer",
                                     printer,
                                     "--dir",
                                     folder / state_name,
                                     "--modbus",
                                     address_of(sim.modbus),
                                     "--sink",
                                     sim.frames};
    if (lockstep) command.push_back("--lockstep");
    command.insert(command.end(), more.begin(), more.end());
    return command;
  }
  RunResult bridge(const std::vector<std::string>& words, const std::string& printer,
                   std::vector<std::string> more = {}) {
    std::vector<std::string> command{program("printbridge")};
    command.insert(command.end(), words.begin(), words.end());
    for (const std::string& s :
         {std::string("--printer"), printer, std::string("--dir"), folder / state_name}) {
      command.push_back(s);
    }
    command.insert(command.end(), more.begin(), more.end());
    return run_program(command);
  }
  nlohmann::json status(const std::string& printer) {
    const RunResult r = bridge({"status", "--json", "-"}, printer);
    EXPECT_EQ(r.exit_code, 0) << r.err;
    const auto json = nlohmann::json::parse(r.out, nullptr, false);
    EXPECT_TRUE(json.is_object()) << r.out;
    return json.is_object() ? json : nlohmann::json::object();
  }

  /// "tcp:HOST:PORT" or "rtu:DEVICE" of what printer-sim says that it listens on.
  static std::string address_of(const std::string& listen) {
    if (listen.starts_with("tcp:") || listen.starts_with("rtu:")) return listen;
    return (listen.starts_with("/") ? "rtu:" : "tcp:") + listen;
  }

  static std::vector<nlohmann::json> lines_of(const std::string& path) {
    std::vector<nlohmann::json> lines;
    std::ifstream in(path);
    std::string line;
    while (std::getline(in, line)) {
      auto json = nlohmann::json::parse(line, nullptr, false);
      if (json.is_object()) lines.push_back(std::move(json));
    }
    return lines;
  }
  static std::vector<std::string> events_of(const std::string& path) {
    std::vector<std::string> events;
    for (const auto& line : lines_of(path)) events.push_back(line.value("event", ""));
    return events;
  }
  /// Whether a simulator has written an event; cheaper than to read all of them.
  static bool happened(const std::string& path, const std::string& event) {
    return text_of(path).find("\"event\":\"" + event + "\"") != std::string::npos;
  }
  static bool has(const std::vector<std::string>& list, const std::string& what) {
    return std::find(list.begin(), list.end(), what) != list.end();
  }
  /// Place in the list; -1 when it is not there.
  static int place(const std::vector<std::string>& list, const std::string& what, int from = 0) {
    for (std::size_t i = static_cast<std::size_t>(from); i < list.size(); ++i) {
      if (list[i] == what) return static_cast<int>(i);
    }
    return -1;
  }
  static int last_place(const std::vector<std::string>& list, const std::string& what) {
    for (std::size_t i = list.size(); i-- > 0;) {
      if (list[i] == what) return static_cast<int>(i);
    }
    return -1;
  }

  TemporaryFolder folder;
  int part_cells = 2;                 ///< of the lattice, side by side
  double part_cell_mm = 1.6;          ///< as high as the part nearly is
  std::string state_name = "state";   ///< folder of the bridge's state
  std::string shown_ending = ".uvj";  ///< of what simulators record; empty: nothing

 private:
  int sims_ = 0;
};

}  // namespace slicecorr::test
