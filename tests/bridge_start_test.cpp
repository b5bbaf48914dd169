// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What a machine says against a print on it, what can't be true of it, and what is known of lamps
// and stage after a fault: by the controller and by the programs.

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <filesystem>
#include <fstream>

#include "bridge_fixture.hpp"
#include "control_bench.hpp"
#include "few_files.hpp"
#include "slicecorr/bridge/link.hpp"
#include "slicecorr/bridge/record.hpp"
#include "slicecorr/bridge/run.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::bridge {
namespace {

using namespace slicecorr::test;
using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

Status well() {
  Status s;
  s.stage_speed_um_s = 0;
  s.temperature_c = 25;
  s.uv_measured = 0;
  return s;
}

// ---- before anything is sent ----

TEST(BridgeStart, WhatCantBeIsNotBelieved) {
  const Machine m = test::test_machine();  // 100 mm of travel, 7200 mm/h, 275 mW/cm²
  EXPECT_EQ(impossible(m, well()), "");
  const auto with = [&](const auto& change) {
    Status s = well();
    change(s);
    return impossible(m, s);
  };
  EXPECT_THAT(with([](Status& s) { s.stage_um = 161500; }), HasSubstr("161.500 mm"));
  EXPECT_THAT(with([](Status& s) { s.stage_um = -500; }), HasSubstr("-0.500 mm"));
  EXPECT_THAT(with([](Status& s) { s.temperature_c = -3276.8; }), HasSubstr("-3276.8 °C"));
  EXPECT_THAT(with([](Status& s) { s.temperature_c = 3276.7; }), HasSubstr("3276.7 °C"));
  EXPECT_THAT(with([](Status& s) { s.stage_speed_um_s = 1e6; }), HasSubstr("mm/h"));
  EXPECT_THAT(with([](Status& s) { s.blue_measured = 4294; }), HasSubstr("blue lamp"));
  EXPECT_THAT(with([](Status& s) { s.uv_measured = 6553; }), HasSubstr("UV lamp"));
  EXPECT_THAT(with([](Status& s) { s.stage_um = std::nan(""); }), HasSubstr("stage is at nan"));
  // What may be: a little beyond its ends, a hot machine, a lamp that is too bright.
  EXPECT_EQ(with([](Status& s) {
              s.stage_um = 100020;
              s.temperature_c = 95;
              s.blue_measured = 1.4;
            }),
            "");
}

TEST(BridgeStart, TheMachineItselfSpeaksAgainstAStart) {
  const Machine m = test::test_machine();
  EXPECT_EQ(against_start(m, well(), false), "");
  const auto with = [&](const auto& change, bool clear = true) {
    Status s = well();
    change(s);
    return against_start(m, s, clear);
  };
  const auto reset = HasSubstr("printbridge reset");
  EXPECT_THAT(with([](Status& s) { s.state = MachineState::stopped; }),
              AllOf(HasSubstr("is stopped"), reset));
  EXPECT_THAT(with([](Status& s) { s.state = MachineState::fault; }),
              AllOf(HasSubstr("a fault of its own"), reset));
  EXPECT_THAT(with([](Status& s) { s.state = MachineState::running; }),
              AllOf(HasSubstr("nobody drives it"), reset));
  EXPECT_THAT(with([](Status& s) { s.watchdog_tripped = true; }),
              AllOf(HasSubstr("watchdog"), reset));
  EXPECT_THAT(with([](Status& s) { s.latched = true; }), AllOf(HasSubstr("has failed"), reset));
  EXPECT_THAT(with([](Status& s) { s.job_kept = true; }), AllOf(HasSubstr("not ended"), reset));
  EXPECT_THAT(with([](Status& s) { s.blue_measured = 1; }),
              AllOf(HasSubstr("blue lamp shines (100.0 %"), reset));
  EXPECT_THAT(with([](Status& s) { s.door_open = true; }), AllOf(HasSubstr("door"), Not(reset)));
  EXPECT_THAT(with([](Status& s) { s.stage_um = 161500; }), HasSubstr("161.500 mm"));
  // A part may hang where no print that ended well leaves the stage.
  for (const double um : {-5.0, 0.0, 15.0, 99985.0, 100000.0}) {
    EXPECT_EQ(with([&](Status& s) { s.stage_um = um; }, false), "") << um;
  }
  for (const double um : {30.0, 5000.0, 99000.0}) {
    EXPECT_THAT(
        with([&](Status& s) { s.stage_um = um; }, false),
        AllOf(HasSubstr(fmt::format("{:.3f} mm", um / 1000)), HasSubstr("--machine-is-clear")));
    EXPECT_EQ(with([&](Status& s) { s.stage_um = um; }, true), "") << um;
    // A machine that remembers knows better than its stage's height.
    EXPECT_EQ(with(
                  [&](Status& s) {
                    s.stage_um = um;
                    s.latched = false;
                  },
                  false),
              "")
        << um;
  }
}

class BridgeClear : public BridgePrograms {
 protected:
  RunResult print_from(const std::string& dir, const std::string& stack, const std::string& printer,
                       const Sim& sim, bool lockstep, std::vector<std::string> more = {}) {
    auto command = print_command(stack, printer, sim, lockstep, std::move(more));
    for (std::size_t i = 0; i + 1 < command.size(); ++i) {
      if (command[i] == "--dir") command[i + 1] = folder / dir;
    }
    return run_program(command);
  }
  RunResult reset_from(const std::string& dir, const std::string& printer, const Sim& sim) {
    return run_program({program("printbridge"), "reset", "--printer", printer, "--dir",
                        folder / dir, "--modbus", address_of(sim.modbus)});
  }
};

TEST_F(BridgeClear, AnotherUserDoesNotStartOnAStoppedMachine) {
  const std::string printer = make_printer("plain");
  const std::string stack = make_stack(printer);
  Sim sim = start_sim(printer, true, {"--fault", "late-frame=0.2@frame:12"});
  EXPECT_EQ(print_from("state", stack, printer, sim, true).exit_code, 4);
  // In its own time, once the bridge has gone.
  ASSERT_TRUE(wait_until([&] {
    const auto events = events_of(sim.events);
    return place(events, "stage stops", std::max(0, place(events, "stop"))) > 0;
  }));
  const auto before = events_of(sim.events);
  const RunResult other =
      print_from("elsewhere", stack, printer, sim, true, {"--machine-is-clear"});
  EXPECT_EQ(other.exit_code, 4);
  EXPECT_THAT(other.err, AllOf(HasSubstr("nothing was sent"), HasSubstr("the machine is stopped"),
                               HasSubstr("printbridge reset")));
  EXPECT_EQ(events_of(sim.events), before);
  // Whoever resets it has seen it; a part may still be on it.
  const RunResult reset = reset_from("elsewhere", printer, sim);
  EXPECT_EQ(reset.exit_code, 0) << reset.err;
  EXPECT_THAT(reset.err, HasSubstr("--machine-is-clear"));
  const RunResult part = print_from("elsewhere", stack, printer, sim, true);
  EXPECT_EQ(part.exit_code, 4);
  EXPECT_THAT(part.err, HasSubstr("--machine-is-clear"));
  const RunResult clear =
      print_from("elsewhere", stack, printer, sim, true, {"--machine-is-clear"});
  EXPECT_EQ(clear.exit_code, 0) << clear.err;
}

TEST_F(BridgeClear, AMachineThatRemembersRefusesOverARestart) {
  const std::string printer = make_printer("remembers");
  std::string text = text_of(printer);
  text = replaced(text, "frame = { address = 14, type = \"i32\" }\n",
                  "frame = { address = 14, type = \"i32\" }\njob = { address = 16 }\n");
  text = replaced(text, "[modbus.commands]",
                  "latched = { address = 111, bit = 9 }\njob_kept = { address = 114 }\n"
                  "[modbus.commands]");
  write_file(printer, to_bytes(text));
  const std::string stack = make_stack(printer);
  // Its controller starts anew and is idle: nothing but its memory is left of the print.
  Sim sim = start_sim(printer, true, {"--fault", "restart@frame:9"});
  EXPECT_EQ(print_from("state", stack, printer, sim, true).exit_code, 4);
  const RunResult other =
      print_from("elsewhere", stack, printer, sim, true, {"--machine-is-clear"});
  EXPECT_EQ(other.exit_code, 4);
  EXPECT_THAT(other.err, AllOf(HasSubstr("not ended (job)"), HasSubstr("printbridge reset")));
  EXPECT_EQ(reset_from("elsewhere", printer, sim).exit_code, 0);
  const RunResult then = print_from("elsewhere", stack, printer, sim, true);
  EXPECT_EQ(then.exit_code, 0) << then.err;
  // One without the other says nothing.
  write_file(printer, to_bytes(replaced(text, "job_kept = { address = 114 }\n", "")));
  const RunResult half = print_from("third", stack, printer, sim, true);
  EXPECT_EQ(half.exit_code, 2);
  EXPECT_THAT(half.err, HasSubstr("job_kept; expected both or none"));
}

// ---- what is known after a fault ----

TEST_F(BridgeClear, LampsThatAreNotConfirmedStandOnTop) {
  const std::string printer = make_printer("plain");
  const std::string stack = make_stack(printer);
  Sim sim = start_sim(printer, true, {"--fault", "disconnect=1000@frame:6"});
  const RunResult r = print_from("state", stack, printer, sim, true);
  EXPECT_EQ(r.exit_code, 4);
  const std::string sentence = "NOT CONFIRMED that lamps are off";
  EXPECT_THAT(r.err, AllOf(HasSubstr(sentence), HasSubstr("blue light 100.0 %")));
  EXPECT_THAT(r.err, HasSubstr("printbridge: " + sentence));
  // The text of status: right after the printer's name.
  const RunResult text = bridge({"status"}, printer);
  EXPECT_THAT(text.out, StartsWith("printer   dual-wavelength-dlp\n" + sentence));
  EXPECT_THAT(text.out, HasSubstr("last measured "));
  const json s = status(printer)["after_fault"];
  EXPECT_EQ(s["confirmed"], false);
  EXPECT_EQ(s["heard"], false);
  EXPECT_THAT(s["text"].get<std::string>(), StartsWith(sentence));
  EXPECT_NEAR(s["blue_measured"].get<double>(), 1, 0.01);
  // The last good answer, and the time without one until it was given up.
  EXPECT_GT(s["measured_s_ago"].get<double>(), 0.3);
  EXPECT_THAT(s["time"].get<std::string>(), StartsWith("20"));
  // The first thing in the latch, on the page, in the live view.
  const std::string latch = text_of(folder / "state/dual-wavelength-dlp/latch.json");
  EXPECT_LT(latch.find(sentence), latch.find("\"fault\""));
  const std::string page = text_of(folder / "state/dual-wavelength-dlp/report.html");
  ASSERT_NE(page.find(sentence), std::string::npos);
  EXPECT_LT(page.find(sentence), page.find("class=\"tiles\""));
  const RunResult live = bridge({"watch", "--once"}, printer);
  EXPECT_LT(live.out.find(sentence), live.out.find("no print runs")) << live.out;
  EXPECT_THAT(live.out, HasSubstr("0.0 % asked, not measured"))
      << "what was measured before is stale";
}

TEST_F(BridgeClear, LampsThatAreOffAreSaidToBeOff) {
  const std::string printer = make_printer("plain");
  const std::string stack = make_stack(printer);
  Sim sim = start_sim(printer, true, {"--fault", "late-frame=0.2@frame:12"});
  EXPECT_EQ(print_from("state", stack, printer, sim, true).exit_code, 4);
  const json s = status(printer)["after_fault"];
  EXPECT_EQ(s["confirmed"], true);
  EXPECT_EQ(s["blue_measured"], 0) << "measured since, not before";
  EXPECT_EQ(s["uv_measured"], 0);
  EXPECT_THAT(bridge({"status"}, printer).out, Not(HasSubstr("NOT CONFIRMED")));
  EXPECT_THAT(text_of(folder / "state/dual-wavelength-dlp/report.html"),
              HasSubstr("lamps are off; the stage has stopped"));
}

TEST(BridgeLeft, IsSaidInWords) {
  Left left;
  EXPECT_TRUE(left.confirmed());
  EXPECT_EQ(in_words(left), "nothing was moved or lit");
  left.touched = true;
  EXPECT_FALSE(left.confirmed());
  EXPECT_THAT(in_words(left),
              AllOf(HasSubstr("did not answer"), HasSubstr("nothing was measured")));
  left.lamps_taken = true;
  EXPECT_THAT(in_words(left), HasSubstr("took the order to put lamps off and has said nothing"));
  left.heard = left.stands = left.measured = true;
  left.blue_measured = 0.5;
  left.stage_um = 1234.5;
  left.measured_s_ago = 0.25;
  left.time = "2026-01-02T03:04:05.678Z";
  EXPECT_FALSE(left.confirmed());
  EXPECT_THAT(in_words(left),
              AllOf(HasSubstr("A LAMP STILL SHINES"),
                    HasSubstr("0.25 s before 2026-01-02T03:04:05.678Z: blue light 50.0 %"),
                    HasSubstr("stage at 1.234 mm")));
  left.dark = true;
  EXPECT_TRUE(left.confirmed());
}

// ---- reset ----

/// A machine in the same process, whose blue lamp may stick.
class StickingLink final : public Link {
 public:
  StickingLink(PrinterModel& model, const Machine& machine, BridgeClock& clock)
      : model_(model), machine_(machine), clock_(clock) {}
  std::optional<Status> exchange(const SetPoints& out) override {
    model_.advance(clock_.now_s());
    model_.take(decode_set_points(*machine_.modbus, encode(*machine_.modbus, out)));
    return look();
  }
  bool write_alone(const SetPoints&, Alone) override { return false; }
  std::optional<Status> look() override {
    return decode_status(*machine_.modbus, encode(*machine_.modbus, model_.status()));
  }
  std::string last_error() const override { return "answers"; }

 private:
  PrinterModel& model_;
  const Machine& machine_;
  BridgeClock& clock_;
};

TEST(BridgeReset, IsRefusedWhileALampShinesThatIsToldOff) {
  const Machine m = test::test_machine();
  for (const bool sticks : {false, true}) {
    std::vector<SimFault> faults;
    if (sticks) faults.push_back(parse_sim_fault("lamp-sticks@0.1s"));
    PrinterModel model(m, faults);
    const auto clock = make_step_clock();
    StickingLink link(model, m, *clock);
    SetPoints lit;
    lit.command = Command::run;
    lit.blue_share = 1;
    for (std::uint16_t n = 1; n < 20; ++n) {
      lit.sequence = lit.heartbeat = n;
      link.exchange(lit);
      clock->sleep_until(clock->now_s() + m.limits.cycle_s);
    }
    ASSERT_FALSE(model.lamps_dark());
    if (!sticks) {
      EXPECT_EQ(reset_machine(link, *clock, m).state, MachineState::idle);
      continue;
    }
    try {
      reset_machine(link, *clock, m);
      ADD_FAILURE() << "reset, and the lamp shines";
    } catch (const DeviceError& e) {
      EXPECT_THAT(e.what(), AllOf(HasSubstr("the blue lamp shines (100.0 %"),
                                  HasSubstr("told to be off: switch the machine off")));
    }
  }
}

// ---- while it prints ----

/// A controller and a model, told by hand.
struct Hand {
  explicit Hand(PrintPlan p = test::continuous_plan(test::test_machine(), false, false))
      : machine(test::test_machine()), model(machine, {}), controller(p, machine, false) {}
  /// A cycle; the answer may be changed, delayed, or not come.
  void cycle(const std::function<void(Answer&)>& change = {}, bool answered = true,
             double early_s = 0, double late_s = 0) {
    step = controller.step(answer, now_s);
    SetPoints taken = decode_set_points(*machine.modbus, encode(*machine.modbus, step.set_points));
    model.advance(now_s + early_s);
    model.take(taken);
    Answer a{model.status(), now_s + (early_s + late_s) / 2, (early_s + late_s) / 2, false};
    if (change) change(a);
    answer = answered ? std::optional(a) : std::nullopt;
    now_s += std::max(machine.limits.cycle_s, early_s + late_s);
    model.advance(now_s);
    if (step.show) {
      if (*step.show != kBlackFrame) ++shown;
      controller.shown(
          {*step.show, std::max(step.show_at_s, now_s - machine.limits.cycle_s), false});
    }
  }
  Machine machine;
  PrinterModel model;
  Controller controller;
  ControlStep step;
  std::optional<Answer> answer;
  double now_s = 0;
  int shown = 0;
};

TEST(BridgeMeasured, WhatCantBeIsAFaultWhilePrintingAndNoLatchBefore) {
  Hand early;
  early.cycle();
  early.cycle([](Answer& a) { a.status.stage_um = 161500; });
  early.cycle();
  EXPECT_EQ(early.controller.fault(), Fault::impossible_measurement);
  EXPECT_FALSE(early.controller.begun());
  Hand hand;
  while (hand.shown < 3) hand.cycle();
  ASSERT_EQ(hand.controller.fault(), Fault::none) << hand.controller.fault_detail();
  hand.cycle([](Answer& a) { a.status.temperature_c = -3276.8; });
  hand.cycle();
  EXPECT_EQ(hand.controller.fault(), Fault::impossible_measurement);
  EXPECT_THAT(hand.controller.fault_detail(), HasSubstr("-3276.8 °C"));
  EXPECT_EQ(hand.step.set_points.blue_share, 0);
  EXPECT_EQ(hand.controller.phase(), Phase::lamps_off);
}

TEST(BridgeMeasured, OneLateAnswerWhileTheStageGoesFastIsNoFault) {
  // Carried out at once and answered late, taken late and answered at once, or not answered; as
  // long as a response timeout of 0.1 s allows, which is 170 um of way where 60 um are borne; at
  // any moment of homing from a height of 3 mm at up to 1.7 mm/s.
  constexpr double late_s = 0.1;
  for (const auto& [taken_late, lost] :
       {std::pair{false, false}, std::pair{true, false}, std::pair{false, true}}) {
    for (int at = 5; at < 220; at += 3) {
      PrintPlan plan = test::continuous_plan(test::test_machine(), false, false);
      Hand hand(plan);
      // Where a stage stands after a print.
      hand.machine.stage.home_um = 0;
      SetPoints up;
      up.command = Command::run;
      up.target_um = 3000;
      up.speed_um_s = 2000;
      up.heartbeat = 1;
      hand.model.take(up);
      for (int k = 1; k < 500; ++k) {
        hand.model.advance(0.01 * k);
        ++up.heartbeat;
        hand.model.take(up);
      }
      hand.now_s = 5;
      SetPoints off;
      hand.model.take(off);
      for (int k = 0; k < 260 && hand.controller.fault() == Fault::none; ++k) {
        const double delay_s = k == at ? late_s : 0;
        hand.cycle({}, k != at || !lost, taken_late ? delay_s : 0, taken_late ? 0 : delay_s);
      }
      ASSERT_EQ(hand.controller.fault(), Fault::none)
          << at << " " << taken_late << " " << lost << " " << hand.controller.fault_detail();
    }
  }
}

TEST(BridgeMeasured, AHeartbeatChangesOnlyAfterAGoodAnswer) {
  Hand hand;
  while (hand.shown < 3) hand.cycle();
  const std::uint16_t before = hand.step.set_points.heartbeat;
  hand.cycle({}, false);
  EXPECT_NE(hand.step.set_points.heartbeat, before);
  const std::uint16_t last = hand.step.set_points.heartbeat;
  const std::uint16_t sequence = hand.step.set_points.sequence;
  for (int i = 0; i < 5; ++i) {
    hand.cycle({}, false);
    EXPECT_EQ(hand.step.set_points.heartbeat, last);
  }
  EXPECT_EQ(hand.step.set_points.sequence, sequence + 5);
  hand.cycle();
  EXPECT_EQ(hand.step.set_points.heartbeat, last);
  hand.cycle();
  EXPECT_NE(hand.step.set_points.heartbeat, last);
}

TEST(BridgeMeasured, LampsAreAskedAloneUntilTheyAreTaken) {
  Hand hand;
  while (hand.shown < 3) hand.cycle();
  EXPECT_FALSE(hand.step.lamps_alone);
  hand.controller.fail(Fault::stopped_by_user, "enough");
  // Nothing answers: the stage is not stopped before the machine's watchdog had its time.
  int asked = 0;
  double stop_s = -1;
  const double fault_s = hand.now_s;
  while (stop_s < 0) {
    hand.cycle({}, false);
    EXPECT_TRUE(hand.step.lamps_alone);
    ++asked;
    if (hand.step.set_points.command == Command::stop) stop_s = hand.now_s;
    ASSERT_LT(asked, 1000);
  }
  EXPECT_GE(stop_s - fault_s, hand.machine.limits.watchdog_s);
  // They go on being asked, until the machine has answered.
  hand.cycle({}, false);
  EXPECT_TRUE(hand.step.lamps_alone);
  EXPECT_TRUE(hand.step.command_alone);
  hand.controller.written_alone(true, true);
  hand.cycle({}, false);
  EXPECT_FALSE(hand.step.lamps_alone);
  EXPECT_FALSE(hand.step.command_alone);
}

TEST(BridgeMeasured, ABridgeThatWasStoppedDoesNotBlameTheMachine) {
  Hand hand;
  while (hand.shown < 3) hand.cycle();
  hand.now_s += 5;
  hand.model.advance(hand.now_s);
  hand.cycle();
  EXPECT_EQ(hand.controller.fault(), Fault::bridge_stopped);
  EXPECT_THAT(hand.controller.fault_detail(),
              HasSubstr("the bridge itself did not run for 5010 ms"));
}

TEST(BridgeMeasured, AMachineThatAnswersButTakesNothingIsNotSilent) {
  Hand hand;
  for (int k = 0; k < 600 && hand.controller.fault() == Fault::none; ++k) {
    hand.cycle([](Answer& a) { a.status.sequence_echo = 40000; });
  }
  EXPECT_EQ(hand.controller.fault(), Fault::machine_restarted);
  EXPECT_THAT(hand.controller.fault_detail(),
              AllOf(HasSubstr("answers, but does not take set-points over"), HasSubstr("40000")));
}

TEST(BridgeMeasured, FiguresThatDifferAreSaidWithTheirDifference) {
  Machine m = test::test_machine();
  m.uv.tolerance = 0.9;
  PrintPlan plan = test::continuous_plan(m, false, true);
  // Less than needed by a hair.
  for (FramePlan& f : plan.frames) f.least_uv_mw_cm2 = 200.1;
  test::Bench bench(m, plan);
  bench.run();
  ASSERT_EQ(bench.controller.fault(), Fault::uv_ratio);
  EXPECT_THAT(bench.controller.fault_detail(), HasSubstr("200 mW/cm²"));
  EXPECT_THAT(bench.controller.fault_detail(), HasSubstr("needs 200.1"));
}

// How a print ended that stands in no latch is known by the journal alone.
TEST(BridgeStart, AJournalThatCantBeReadIsNotTakenForNone) {
  const TemporaryFolder folder;
  Printer printer;
  printer.name = "one";
  const StateFolder state = StateFolder::of(folder.path(), printer);
  EXPECT_FALSE(read_latch(state, true).has_value());
  std::ofstream(state.file("journal.jsonl")) << R"({"what": "print begins"})"
                                             << "\n";
  EXPECT_TRUE(read_latch(state, true).has_value());
  const NoMoreFiles none;
  EXPECT_THROW(read_latch(state, true), DeviceError);
}

}  // namespace
}  // namespace slicecorr::bridge
