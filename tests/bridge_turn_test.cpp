// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// A vial that turns: the controller against a model of a printer, in one process and in steps.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "control_bench.hpp"
#include "refusal.hpp"
#include "slicecorr/error.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::bridge {
namespace {

using namespace test;

using Changes = std::vector<std::pair<std::string, std::string>>;

/// The shipped printer, four times as fast: prints of seconds.
Machine turning_machine(const Changes& changes = {}) {
  const std::string path = std::string(SLICECORR_PRINTERS_DIR) + "/model-tomography-bench.toml";
  std::string text = slicecorr::test::to_text(slicecorr::test::read_file(path));
  Changes all{{"deg_s = 25", "deg_s = 100"},
              {"acceleration_deg_s2 = 50", "acceleration_deg_s2 = 400"}};
  all.insert(all.end(), changes.begin(), changes.end());
  for (const auto& [what, by] : all) {
    const auto at = text.find(what);
    EXPECT_NE(at, std::string::npos) << what;
    text.replace(at, what.size(), by);
  }
  return parse_machine(text, path);
}
const Changes& without_encoder() {
  static const Changes changes{
      {"stage_deg = { address = 102, type = \"i32\", scale = 0.001 }\n", ""}};
  return changes;
}

constexpr int kAngles = 60, kTurns = 3;

tomo::TomoJob turning_job(const Printer& printer, int turns = kTurns, int angles = kAngles) {
  tomo::TomoJob job;
  job.printer = printer;
  job.sampling.angles = angles;
  job.turns = turns;
  return job;
}
PrintPlan turning_plan(const Machine& m) {
  return plan_turns(turning_job(m.printer), "part.frames", m);
}

TEST(BridgeTurn, EveryFrameIsShownAboutItsAngle) {
  for (const bool encoder : {true, false}) {
    const Machine m = turning_machine(encoder ? Changes{} : without_encoder());
    ASSERT_EQ(m.has_encoder(), encoder);
    const PrintPlan plan = turning_plan(m);
    Bench b(m, plan);
    b.run();
    ASSERT_EQ(b.controller.fault(), Fault::none) << b.controller.fault_detail();
    EXPECT_EQ(b.controller.phase(), Phase::done);
    ASSERT_EQ(b.records.size(), static_cast<std::size_t>(kTurns * kAngles));
    // The first whole turn after the spin-up is the index, and frames lie half a step about theirs.
    const double step = 360.0 / kAngles,
                 index = 360 * std::round(plan.start_um / m.stage.turn_um());
    // Registers have thousandths of a degree; without an encoder the command's moment is known to a
    // cycle.
    const double borne = encoder ? 0.02 : 100 * m.limits.cycle_s;
    for (std::size_t n = 0; n < b.records.size(); ++n) {
      const FrameRecord& r = b.records[n];
      EXPECT_EQ(r.job_frame, static_cast<int>(n) % kAngles);
      ASSERT_TRUE(r.from_deg && r.to_deg && r.exposed_s);
      EXPECT_NEAR(*r.from_deg, index + (static_cast<double>(n) - 0.5) * step, borne);
      EXPECT_NEAR(*r.to_deg - *r.from_deg, step, 0.04);
      EXPECT_NEAR(*r.exposed_s, step / 100, 1e-3);
    }
    // The machine's own account: which image was lit between which angles.
    int images = 0;
    for (const SliceExposure& slice : b.model.exposures()) {
      for (const SliceExposure::Showing& s : slice.showings) {
        if (s.image < 0) continue;
        images = std::max(images, s.image + 1);
        const double from = (s.from_um - s.image * plan.layer_um) / m.stage.um_per_deg,
                     to = (s.to_um - s.image * plan.layer_um) / m.stage.um_per_deg;
        EXPECT_GE(from, -borne - 0.02) << s.image;
        EXPECT_LE(to, step + borne + 0.02) << s.image;
      }
    }
    EXPECT_EQ(images, kTurns * kAngles);
    // Dark while it spins up and comes to rest; at rest at a whole turn.
    const double on = b.machine_time("blue on"), off = b.machine_time("blue off"),
                 moves = b.machine_time("stage moves"), first = b.machine_time("frame 0"),
                 rests = b.machine_time("stage stops", off);
    EXPECT_LT(moves + 0.5, on);
    EXPECT_LT(on, first);
    EXPECT_LT(first - on, 0.5);
    EXPECT_LT(off, rests);
    EXPECT_NEAR(std::remainder(b.model.status().stage_um, m.stage.turn_um()), 0,
                m.stage.um_per_deg * 0.002);
  }
}

TEST(BridgeTurn, ASecondPrintBeginsAtTheIndexAgain) {
  const Machine m = turning_machine();
  const Status after = [&] {
    Bench b(m, turning_plan(m));
    b.run();
    return b.model.status();
  }();
  EXPECT_GT(after.stage_um, m.stage.turn_um());
  EXPECT_EQ(against_start(m, after, false), "");
  Status stopped = after;
  stopped.stage_um += 100 * m.stage.um_per_deg;
  stopped.latched.reset();
  stopped.job_kept.reset();
  EXPECT_NE(against_start(m, stopped, false).find("not at a whole turn"), std::string::npos);
  EXPECT_EQ(against_start(m, stopped, true), "");
}

TEST(BridgeTurn, WobblesAreFollowedByFramesAndLight) {
  // 1 % of speed once a turn: up to 0.57 degrees off the commanded angle, within the tolerance of 1.
  const Machine m = turning_machine();
  const PrintPlan plan = turning_plan(m);
  Bench b(m, plan, {parse_sim_fault("stage-wobbles=0.01")});
  b.run();
  ASSERT_EQ(b.controller.fault(), Fault::none) << b.controller.fault_detail();
  const double step = 360.0 / kAngles, index = 360 * std::round(plan.start_um / m.stage.turn_um());
  double slowest = 1, fastest = 0;
  for (std::size_t n = 0; n < b.records.size(); ++n) {
    const FrameRecord& r = b.records[n];
    // A cycle's way is 1 degree, a hundredth of it unknown, and the estimate follows in some cycles.
    EXPECT_NEAR(*r.from_deg, index + (static_cast<double>(n) - 0.5) * step, 0.1);
    slowest = std::min(slowest, *r.exposed_s * 100 / step);
    fastest = std::max(fastest, *r.exposed_s * 100 / step);
  }
  EXPECT_LT(slowest, 0.995);
  EXPECT_GT(fastest, 1.005);
  // Brighter where it goes faster: light over angle stays within what a full lamp can do.
  for (const SliceExposure& slice : b.model.exposures()) {
    for (const SliceExposure::Showing& s : slice.showings) {
      if (s.image < 0 || s.to_um - s.from_um < plan.layer_um / 2) continue;
      const double dose = s.light_s * plan.speed_um_s / (s.to_um - s.from_um);
      EXPECT_NEAR(dose, 1, 0.013);
    }
  }
}

TEST(BridgeTurn, AVialThatNeverTurnsSteadilyGetsNoLight) {
  const Machine m = turning_machine({{"tolerance_deg = 1", "tolerance_deg = 20"}});
  Bench b(m, turning_plan(m), {parse_sim_fault("stage-wobbles=0.2")});
  b.run();
  EXPECT_EQ(b.controller.fault(), Fault::stage_error);
  EXPECT_NE(b.controller.fault_detail().find("does not turn steadily"), std::string::npos);
  EXPECT_LT(b.machine_time("blue on"), 0);
  EXPECT_EQ(std::count_if(b.events.begin(), b.events.end(),
                          [](const PrintEvent& e) { return e.what == "put off"; }),
            kMostPutOff);
}

TEST(BridgeTurn, AVialThatIsUnsteadyAtFirstBeginsATurnLater) {
  const Machine m = turning_machine({{"tolerance_deg = 1", "tolerance_deg = 30"}});
  // Stands for a moment before the lamp comes on, and catches up no more.
  const PrintPlan plan = turning_plan(m);
  Bench calm(m, plan);
  calm.run();
  const double on_s = calm.machine_time("blue on");
  Bench b(m, plan, {parse_sim_fault(fmt::format("stuck-stage=0.1@{:.3f}s", on_s - 0.2))});
  b.run();
  ASSERT_EQ(b.controller.fault(), Fault::none) << b.controller.fault_detail();
  ASSERT_EQ(b.records.size(), static_cast<std::size_t>(kTurns * kAngles));
  const double index = 360 * std::round(plan.start_um / m.stage.turn_um());
  EXPECT_NEAR(*b.records.front().from_deg, index + 360 - 180.0 / kAngles, 0.3);
}

struct FaultCase {
  const char* text;
  std::vector<Fault> expected;
  bool machine_acts = false;
  bool needs_encoder = false;
};

TEST(BridgeTurn, EveryFaultAtRandomMomentsEndsInItsOrder) {
  const std::vector<FaultCase> cases{
      {"drop=5", {}},
      {"disconnect=0.1", {}},
      {"drop=100", {Fault::heartbeat_lost, Fault::machine_restarted}},
      {"disconnect=5", {Fault::heartbeat_lost, Fault::watchdog_tripped}, true},
      {"stuck-stage", {Fault::stage_error, Fault::lamp_mismatch}},
      {"stage-slips=10", {Fault::stage_error, Fault::late_frame}, false, true},
      {"stage-slips=-10", {Fault::stage_error}, false, true},
      {"stage-wobbles=0.3", {Fault::stage_error, Fault::lamp_mismatch, Fault::late_frame}},
      {"stage-fails", {Fault::stage_failed}},
      {"lamp-fails", {Fault::lamp_failed, Fault::lamp_mismatch}},
      {"lamp-drifts=0.3", {Fault::lamp_mismatch}},
      {"lamp-drifts=-0.3", {Fault::lamp_mismatch}},
      {"door", {Fault::door_open}, true},
      {"stop-button", {Fault::stop_pressed}, true},
      {"hot=75", {Fault::over_temperature}, true},
      {"restart", {Fault::machine_restarted, Fault::lamp_mismatch, Fault::stage_error}, true},
      {"freeze-display", {Fault::wrong_frame, Fault::late_frame}},
      {"late-frame=0.05", {Fault::late_frame}},
      {"display-gone", {Fault::display_gone, Fault::late_frame}},
  };
  std::mt19937 random(26);
  int failed = 0;
  for (const bool encoder : {true, false}) {
    const Machine m = turning_machine(encoder ? Changes{} : without_encoder());
    const PrintPlan plan = turning_plan(m);
    Bench calm(m, plan);
    calm.run();
    const double begin_s = calm.records.front().shown_s;
    for (const FaultCase& c : cases) {
      if (c.needs_encoder && !encoder) continue;
      for (int i = 0; i < 6; ++i) {
        const double moment =
            begin_s + plan.expected_s * std::uniform_real_distribution<>(0.03, 0.75)(random);
        const std::string text = fmt::format("{}@{:.4f}s", c.text, moment);
        SCOPED_TRACE(fmt::format("{} encoder {}", text, encoder));
        Bench b(m, plan, {parse_sim_fault(text)});
        b.run();
        if (c.expected.empty()) {
          EXPECT_EQ(b.controller.fault(), Fault::none) << b.controller.fault_detail();
          EXPECT_EQ(b.controller.frames_shown(), kTurns * kAngles);
          continue;
        }
        ++failed;
        EXPECT_NE(std::find(c.expected.begin(), c.expected.end(), b.controller.fault()),
                  c.expected.end())
            << name_of(b.controller.fault()) << ": " << b.controller.fault_detail();
        EXPECT_EQ(b.controller.phase(), Phase::failed);
        const std::string what = c.text;
        const bool link_lives = !what.starts_with("drop") && !what.starts_with("disconnect");
        const bool display_lives = !what.starts_with("freeze") && !what.starts_with("display-gone");
        expect_order(b, moment, c.machine_acts, link_lives, display_lives);
        EXPECT_TRUE(b.model.lamps_dark());
      }
    }
  }
  EXPECT_EQ(failed, 6 * (17 + 15));
}

TEST(BridgeTurn, AStallAndASlipAreCalledSo) {
  const Machine m = turning_machine();
  const PrintPlan plan = turning_plan(m);
  Bench stalls(m, plan, {parse_sim_fault("stuck-stage@frame:20")});
  stalls.run();
  EXPECT_NE(stalls.controller.fault_detail().find("has stalled at"), std::string::npos)
      << stalls.controller.fault_detail();
  // The tolerance of a degree, and the way of some cycles.
  EXPECT_LE(stalls.event_time("fault stage_error") - stalls.machine_time("stuck-stage"),
            0.01 + 5 * m.limits.cycle_s);
  Bench slips(m, plan, {parse_sim_fault("stage-slips=-8@frame:20")});
  slips.run();
  EXPECT_EQ(slips.controller.fault(), Fault::stage_error);
  EXPECT_NE(slips.controller.fault_detail().find("°, expected "), std::string::npos)
      << slips.controller.fault_detail();
  EXPECT_LE(slips.event_time("fault stage_error") - slips.machine_time("stage-slips"),
            2 * m.limits.cycle_s);
  // The row of what was on has no end, which nobody knows.
  ASSERT_FALSE(slips.records.empty());
  EXPECT_FALSE(slips.records.back().to_deg.has_value());
  // It is said of where that was found, not of where the vial came to rest.
  const double found_um = slips.controller.fault_stage_um();
  EXPECT_LT(found_um, slips.model.status().stage_um - 5 * m.stage.um_per_deg);
  EXPECT_NEAR(found_um, plan.frame_um(20) - 8 * m.stage.um_per_deg, 3 * m.stage.um_per_deg);
  // What is said to be left is said of a vial that has come to rest.
  for (const bool encoder : {true, false}) {
    const Machine braking = turning_machine(encoder ? Changes{} : without_encoder());
    Bench fails(braking, turning_plan(braking), {parse_sim_fault("lamp-fails@frame:20")});
    fails.run();
    ASSERT_EQ(fails.controller.phase(), Phase::failed);
    const Left left = fails.controller.left();
    EXPECT_TRUE(left.confirmed());
    EXPECT_LE(std::abs(fails.model.status().stage_speed_um_s.value_or(1e9)), 1e-6);
    ASSERT_EQ(left.stage_deg.has_value(), encoder);
    if (encoder) {
      EXPECT_NEAR(*left.stage_deg, fails.model.status().stage_um / braking.stage.um_per_deg, 0.01);
    } else {
      EXPECT_EQ(in_words(left).find("stage at"), std::string::npos) << in_words(left);
    }
  }
}

TEST(BridgeTurn, LateFramesAreRecordedAndSomeAreBorne) {
  // A step of 6 degrees takes 60 ms: half of it is 30 ms. The bench lets time pass while it waits for
  // the display, unknown to the controller, up to 4 degrees: the next frame comes up to a degree
  // early.
  const Machine strict = turning_machine(),
                patient = turning_machine({{"max_late_frames = 0", "max_late_frames = 2"},
                                           {"tolerance_deg = 1", "tolerance_deg = 6"}});
  const auto run = [&](const Machine& m, const char* fault) {
    auto b = std::make_unique<Bench>(m, turning_plan(m), std::vector{parse_sim_fault(fault)});
    b->run();
    return b;
  };
  EXPECT_EQ(run(strict, "late-frame=0.02@frame:30")->controller.fault(), Fault::none);
  const auto late = run(strict, "late-frame=0.04@frame:30");
  EXPECT_EQ(late->controller.fault(), Fault::late_frame);
  EXPECT_NE(late->controller.fault_detail().find("° late, 3 ° is borne"), std::string::npos)
      << late->controller.fault_detail();
  const auto borne = run(patient, "late-frame=0.04@frame:30");
  ASSERT_EQ(borne->controller.fault(), Fault::none) << borne->controller.fault_detail();
  EXPECT_EQ(borne->controller.late_frames(), 1);
  const FrameRecord& r = borne->records.at(30);
  EXPECT_TRUE(r.late);
  EXPECT_NEAR(*r.to_deg - *r.from_deg, 6 - 4, 1);
  EXPECT_NEAR(*borne->records.at(29).to_deg - *borne->records.at(29).from_deg, 6 + 4, 0.1);
  // Another measure from the printer file.
  const Machine fine = turning_machine({{"max_late_frames = 0", "max_late_deg = 1"}});
  EXPECT_EQ(run(fine, "late-frame=0.02@frame:30")->controller.fault(), Fault::late_frame);
}

TEST(BridgeTurn, PausesAreRefused) {
  const Machine m = turning_machine();
  Bench b(m, turning_plan(m));
  bool asked = false;
  b.run([&] {
    if (asked || b.controller.frame() < 5) return;
    asked = true;
    const PauseAnswer answer = b.controller.pause();
    EXPECT_FALSE(answer.accepted);
    EXPECT_NE(answer.why.find("whole turns"), std::string::npos);
  });
  EXPECT_TRUE(asked);
  EXPECT_EQ(b.controller.fault(), Fault::none);
}

TEST(BridgeTurn, JobsOfOtherMachinesAreRefused) {
  const Machine m = turning_machine();
  const auto says = [&](const std::function<void(Printer&)>& change) {
    tomo::TomoJob job = turning_job(m.printer);
    change(job.printer);
    return slicecorr::test::refusal([&] { plan_turns(job, "part.frames", m); });
  };
  const auto expect = [&](const char* what, const std::function<void(Printer&)>& change) {
    const std::string text = says(change);
    EXPECT_NE(text.find(what), std::string::npos) << text;
    EXPECT_NE(text.find("part.frames"), std::string::npos) << text;
  };
  expect("its name is", [](Printer& p) { p.name = "other"; });
  expect("100 °/s counterclockwise, expected 100 °/s clockwise",
         [](Printer& p) { p.rotation->direction = TurnDirection::counterclockwise; });
  expect("25 °/s", [](Printer& p) { p.rotation->deg_s = 25; });
  expect("its vial has", [](Printer& p) { p.vial->inner_mm = 11; });
  expect("its axis 1 pixels right, 0 up and leaning by 0°, expected telecentric, its axis 0",
         [](Printer& p) { p.optics->axis_right_px = 1; });
  expect("leaning by 2°", [](Printer& p) { p.optics->tilt_deg = 2; });
  expect("its light is uneven in another way, expected even", [](Printer& p) {
    p.flat_field = FlatField{1, 1, std::make_shared<const std::vector<std::uint8_t>>(1, 200)};
  });
  expect("its axis wobbles by up to 1.5 pixels (2 angles), expected that it keeps to its place",
         [](Printer& p) {
           p.rotation->wobble = {{0, 1.5, 0}, {180, -1, 0}};
         });
  expect("its display has", [](Printer& p) { p.width_px = 500; });
  expect("its calibration", [](Printer& p) { p.calibration.back().intensity_mw_cm2 = 3; });
  // A printer of slices, and too many frames or turns for this one.
  EXPECT_NE(slicecorr::test::refusal([&] {
              plan_turns(turning_job(m.printer), "part.frames", test_machine());
            }).find("no [rotation]"),
            std::string::npos);
  EXPECT_THROW(plan_turns(turning_job(m.printer, 3, 130), "part.frames", m), InfeasibleError);
  EXPECT_THROW(plan_turns(turning_job(m.printer, 997, 60), "part.frames", m), InfeasibleError);
  EXPECT_NO_THROW(plan_turns(turning_job(m.printer, 990, 120), "part.frames", m));
}

TEST(BridgeTurn, WobblesOfTheAxisNeedAnEncoder) {
  // Frames are shifted for where the axis is at the stage's own angles.
  const auto astray = [](Machine m) {
    m.printer.rotation->wobble = {{0, 1.5, 0}, {180, -1, 0}};
    m.printer.flat_field =
        FlatField{1, 1, std::make_shared<const std::vector<std::uint8_t>>(1, 200)};
    return m;
  };
  EXPECT_NO_THROW(turning_plan(astray(turning_machine())));
  const Machine blind = astray(turning_machine(without_encoder()));
  const std::string text = slicecorr::test::refusal([&] { turning_plan(blind); });
  EXPECT_NE(text.find("has no encoder (stage_deg)"), std::string::npos) << text;
}

TEST(BridgeTurn, PrinterFilesSayDegrees) {
  const Machine m = turning_machine();
  EXPECT_NEAR(m.stage.um_per_deg, 12500 * 3.14159265358979 / 180, 1e-9);
  EXPECT_NEAR(m.stage.turn_um(), 2 * 3.14159265358979 * 12500, 1e-6);
  // What goes over the wire is degrees.
  SetPoints s;
  s.target_um = 1234.5 * m.stage.um_per_deg;
  s.speed_um_s = 100 * m.stage.um_per_deg;
  const auto registers = encode(*m.modbus, s);
  EXPECT_EQ(registers[4] << 16 | registers[5], 1234500);
  EXPECT_EQ(registers[6] << 16 | registers[7], 1000000);
  const auto says = [](const Changes& changes) {
    return slicecorr::test::refusal([&] { turning_machine(changes); });
  };
  const auto expect = [](const std::string& text, const char* what) {
    EXPECT_NE(text.find(what), std::string::npos) << text;
  };
  expect(says({{"max_deg_s = 180", "max_deg_s = 50"}}),
         "max_deg_s: is 50; expected at least the 100");
  expect(says({{"acceleration_deg_s2 = 400", "acceleration_mm_s2 = 1"}}), "acceleration_mm_s2");
  expect(says({{"target_deg = { address = 4, type = \"i32\", scale = 0.001 }",
                "target_um = { address = 4, type = \"i32\", scale = 0.001 }"}}),
         "target_deg");
  expect(says({{"target_deg = { address = 4, type = \"i32\", scale = 0.001 }",
                "target_deg = { address = 4, type = \"i16\", scale = 0.001 }"}}),
         "needs 0 to 360000");
  expect(says({{"stage_deg = { address = 102, type = \"i32\", scale = 0.001 }\n", ""},
               {"stage_speed_deg_s = { address = 104, type = \"i32\", scale = 0.0001 }\n", ""}}),
         "stage_deg: missing");
  expect(says({{"[vial]", "[vail]"}}), "vial");
}

}  // namespace
}  // namespace slicecorr::bridge
