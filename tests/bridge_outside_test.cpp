// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// A machine written in another language from docs/printer-files.md alone (docs_machine.py): prints with
// faults, judged by its own log, and the bench for a controller.

#include <gmock/gmock.h>

#include <filesystem>
#include <thread>

#include "bridge_fixture.hpp"

namespace slicecorr {
namespace {

using namespace slicecorr::test;
using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

const std::string kPython = "/usr/bin/python3";
const std::string kTests = SLICECORR_SOURCE_DIR "/tests/";

/// Lamps off first, in all; docs_machine_faults.py says what that means.
void expect_all_hold(const std::vector<std::string>& options, int least = 20) {
  RunOptions long_one;
  long_one.timeout = std::chrono::minutes(8);
  std::vector<std::string> command{kPython,      kTests + "docs_machine_faults.py",
                                   "--bin",      SLICECORR_BIN_DIR,
                                   "--printers", SLICECORR_PRINTERS_DIR};
  command.insert(command.end(), options.begin(), options.end());
  const RunResult r = run_program(command, long_one);
  std::istringstream lines(r.out);
  int prints = 0;
  json last;
  for (std::string line; std::getline(lines, line);) {
    last = json::parse(line, nullptr, false);
    ASSERT_TRUE(last.is_object()) << line << r.err;
    if (!last.contains("wrong")) continue;
    ++prints;
    EXPECT_TRUE(last["wrong"].empty()) << last.dump(1);
  }
  EXPECT_EQ(r.exit_code, 0) << r.err;
  EXPECT_GE(prints, least);
  EXPECT_GE(last.value("faults_begun", 0), least);
}

bool has_python() { return std::filesystem::exists(kPython); }

TEST(BridgeOutside, LampsGoOffFirstInEveryFault) {
  if (!has_python()) GTEST_SKIP() << "python3 is not installed";
  expect_all_hold({"--part", "0/2"});
}

TEST(BridgeOutside, LampsGoOffFirstInEveryOtherFault) {
  if (!has_python()) GTEST_SKIP() << "python3 is not installed";
  expect_all_hold({"--part", "1/2"});
}

TEST(BridgeOutside, AJobIsShownAtItsAnglesAndFaultsDarkenIt) {
  if (!has_python()) GTEST_SKIP() << "python3 is not installed";
  expect_all_hold({"--turn", "--count", "12"}, 10);
}

TEST(BridgeOutsideNight, AJobIsShownAtItsAnglesAndEveryFaultDarkensIt) {
  if (!has_python()) GTEST_SKIP() << "python3 is not installed";
  expect_all_hold({"--turn", "--count", "112", "--seed", "2"}, 100);
}

TEST(BridgeOutside, AVialThatBrakesACycleLateHasNotSlipped) {
  if (!has_python()) GTEST_SKIP() << "python3 is not installed";
  // One answer is lost, and the machine is a cycle behind from then on.
  expect_all_hold({"--turn", "--only", "late-once"}, 2);
}

class BridgeBench : public BridgePrograms {
 protected:
  static std::vector<std::pair<std::string, std::string>> limits() {
    // Real time on a busy computer; two exchanges of five requests.
    return {{"heartbeat_timeout_s = 0.3", "heartbeat_timeout_s = 1"},
            {"watchdog_s = 0.3", "watchdog_s = 1"},
            {"response_timeout_s = 0.04", "response_timeout_s = 0.1"},
            {"cycle_s = 0.01", "cycle_s = 0.03"},
            {"tolerance_um = 20", "tolerance_um = 50"},
            {"acceleration_mm_s2 = 1.0", "acceleration_mm_s2 = 10"},
            {"travel_mm = 6", "travel_mm = 2"},
            {"lift_mm = 3", "lift_mm = 1"}};
  }
  /// A printer with a stage that turns, as often as the machine's own.
  static std::string turning_text() {
    std::string text =
        text_of(std::string(SLICECORR_PRINTERS_DIR) + "/model-tomography-bench.toml");
    for (const auto& [what, by] : limits()) {
      if (text.find(what) != text.npos) text = replaced(text, what, by);
    }
    return replaced(text, "travel_turns = 1000", "travel_turns = 2");
  }
  RunResult check(const std::string& printer, std::vector<std::string> more = {}) {
    std::vector<std::string> command{program("printer-sim"), "--printer", printer,
                                     "--check-machine"};
    command.insert(command.end(), more.begin(), more.end());
    return run_program(command);
  }
  /// Machines from the docs on a bench, checked at once, because most of it is waiting. Each of
  /// `machines` is a map, or MAP:FAULT.
  std::vector<RunResult> check_outside(const std::vector<std::string>& machines) {
    std::vector<std::string> command{kPython, kTests + "docs_machine.py"};
    command.insert(command.end(), machines.begin(), machines.end());
    Child there(command, folder / "machines.err");
    std::vector<RunResult> results(machines.size());
    std::vector<std::thread> threads;
    for (std::size_t i = 0; i < machines.size(); ++i) {
      const json said = json::parse(there.line(), nullptr, false);
      if (!said.is_object()) {
        ADD_FAILURE() << text_of(folder / "machines.err");
        break;
      }
      const std::string name = "outside" + std::to_string(i);
      const bool turns = machines[i].starts_with("turn") || machines[i].starts_with("blind");
      std::string text = turns ? turning_text() : text_of(make_printer(name, limits()));
      text = text.substr(0, text.find("# Holding registers"));
      const std::string printer = folder / (name + ".toml");
      write_file(printer, to_bytes(text + said.value("toml", "")));
      threads.emplace_back([this, printer, &result = results[i]] { result = check(printer); });
    }
    for (auto& t : threads) t.join();
    return results;
  }
};

TEST_F(BridgeBench, AGoodMachineDoesAllOfIt) {
  const std::string printer = make_printer("bench", limits());
  Sim sim = start_sim(printer, false);
  const RunResult r = check(printer, {"--modbus", address_of(sim.modbus)});
  EXPECT_EQ(r.exit_code, 0) << r.out << r.err;
  EXPECT_THAT(r.out, AllOf(HasSubstr("ok          lamps alone"),
                           HasSubstr("ok          stop alone"), HasSubstr("ok          cable:"),
                           HasSubstr("not tested  lamps by off"), Not(HasSubstr("WRONG"))));
  sim.child->end(SIGTERM);
  const auto events = events_of(sim.events);
  EXPECT_FALSE(has(events, "blue on"));
  EXPECT_FALSE(has(events, "uv on"));
  EXPECT_EQ(std::count(events.begin(), events.end(), "watchdog"), 2);
  EXPECT_TRUE(has(events, "stage moves"));
  EXPECT_THAT(check(printer, {"--lockstep"}).err, HasSubstr("alone"));
}

TEST_F(BridgeBench, TheMachineFromTheDocumentsDoesAllOfIt) {
  if (!has_python()) GTEST_SKIP() << "python3 is not installed";
  const std::vector<std::string> maps{"block", "gaps", "inputs", "line", "turn", "blind"};
  const auto results = check_outside(maps);
  for (std::size_t i = 0; i < maps.size(); ++i) {
    EXPECT_EQ(results[i].exit_code, 0) << maps[i] << "\n" << results[i].out << results[i].err;
  }
}

TEST_F(BridgeBench, WhatIsWronglyBuiltIsFound) {
  if (!has_python()) GTEST_SKIP() << "python3 is not installed";
  const std::vector<std::pair<const char*, const char*>> cases{
      {"no-watchdog", "WRONG       heartbeat:"},
      {"no-stop-alone", "WRONG       stop alone:"},
      {"forgives", "WRONG       heartbeat, stays off:"},
      {"stuck-stage", "WRONG       moves:"},
      {"echo-frozen", "WRONG       sequence:"},
      {"refuse-uv", "WRONG       lamps alone:"},
      {"impossible-stage", "WRONG       measures:"},
      {"door", "WRONG       interlocks:"},
      {"unknown-state", "WRONG       answers:"}};
  std::vector<std::string> machines;
  for (const auto& [fault, line] : cases) machines.push_back(std::string("gaps:") + fault);
  const auto results = check_outside(machines);
  for (std::size_t i = 0; i < cases.size(); ++i) {
    const auto& [fault, line] = cases[i];
    EXPECT_EQ(results[i].exit_code, 4) << fault << "\n" << results[i].out << results[i].err;
    EXPECT_THAT(results[i].out, HasSubstr(line)) << fault;
  }
}

}  // namespace
}  // namespace slicecorr
