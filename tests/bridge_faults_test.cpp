// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Every fault of the policy at random moments, and pauses: the controller against a model of a
// printer, in one process and in steps.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <random>
#include <string>
#include <tuple>
#include <vector>

#include "control_bench.hpp"

namespace slicecorr::bridge {
namespace {

using namespace test;

// ---- faults ----

struct FaultCase {
  const char* text;             ///< of the simulator
  std::vector<Fault> expected;  ///< what the bridge may call it
  bool machine_acts = false;    ///< it switches itself off, too
};
const std::vector<FaultCase>& fault_cases() {
  static const std::vector<FaultCase> cases{
      {"late-reply=0.5", {}},
      {"wrong-reply=3", {}},
      {"drop=5", {}},
      {"drop=100", {Fault::heartbeat_lost, Fault::machine_restarted}},
      {"disconnect=0.1", {}},
      {"disconnect=5", {Fault::heartbeat_lost, Fault::watchdog_tripped}, true},
      {"stuck-stage", {Fault::stage_error, Fault::lamp_mismatch}},
      {"stage-slips=60", {Fault::stage_error, Fault::late_frame}},
      {"stage-slips=-60", {Fault::stage_error}},
      {"stage-fails", {Fault::stage_failed}},
      {"lamp-fails", {Fault::lamp_failed, Fault::lamp_mismatch}},
      {"lamp-drifts=0.3", {Fault::lamp_mismatch}},
      {"lamp-drifts=-0.3", {Fault::lamp_mismatch}},
      {"uv-fails", {Fault::lamp_mismatch, Fault::uv_ratio}},
      {"door", {Fault::door_open}, true},
      {"stop-button", {Fault::stop_pressed}, true},
      {"hot=75", {Fault::over_temperature}, true},
      {"restart", {Fault::machine_restarted, Fault::lamp_mismatch, Fault::stage_error}, true},
      {"freeze-display", {Fault::wrong_frame, Fault::late_frame}},
      {"late-frame=0.2", {Fault::late_frame}},
      {"display-gone", {Fault::display_gone, Fault::late_frame}},
  };
  return cases;
}

TEST(BridgeFaults, EveryFaultAtRandomMomentsEndsInItsOrder) {
  const Machine m = test_machine();
  std::mt19937 random(20240817);
  int runs = 0, failed = 0;
  for (const FaultCase& c : fault_cases()) {
    for (int i = 0; i < 24; ++i) {
      const bool follow = random() % 2 == 0,
                 uv = random() % 2 == 0 || std::string(c.text) == "uv-fails";
      const PrintPlan plan = continuous_plan(m, follow, uv);
      // Between the first frame and some time before the last.
      const double duration_s = 40 * plan.layer_um / plan.speed_um_s;
      Bench calm(m, plan);
      static std::map<std::pair<bool, bool>, double> begins;
      double& begin_s = begins[{follow, uv}];
      if (begin_s == 0) {
        calm.run();
        begin_s = calm.records.front().shown_s;
      }
      const double moment =
          begin_s + duration_s * (0.05 + 0.7 * std::uniform_real_distribution<>(0, 1)(random));
      const std::string text = fmt::format("{}@{:.4f}s", c.text, moment);
      SCOPED_TRACE(fmt::format("{} follow {} uv {}", text, follow, uv));
      Bench b(m, plan, {parse_sim_fault(text)});
      b.run();
      ++runs;
      // Light without its UV light: never longer than lamps settle and two cycles, the order not
      // counted.
      EXPECT_LE(b.uv_short_s, m.blue.settle_s + m.uv.settle_s + 5 * m.limits.cycle_s);
      if (c.expected.empty()) {
        EXPECT_EQ(b.controller.fault(), Fault::none) << b.controller.fault_detail();
        EXPECT_EQ(b.controller.frames_shown(), 40);
        continue;
      }
      ++failed;
      EXPECT_NE(std::find(c.expected.begin(), c.expected.end(), b.controller.fault()),
                c.expected.end())
          << name_of(b.controller.fault()) << ": " << b.controller.fault_detail();
      EXPECT_EQ(b.controller.phase(), Phase::failed);
      EXPECT_TRUE(b.controller.begun());
      const std::string what = c.text;
      const bool link_lives = !what.starts_with("disconnect") && !what.starts_with("drop=100");
      const bool display_lives = what != "freeze-display" && what != "display-gone";
      expect_order(b, moment, c.machine_acts, link_lives, display_lives);
      if (::testing::Test::HasFailure()) return;  // one is enough to read
    }
  }
  RecordProperty("runs", runs);
  EXPECT_GE(runs, 400);
  EXPECT_GE(failed, 300);
}

TEST(BridgeFaults, AStageThatIsStuckOrSlipsIsFoundWithinItsTolerance) {
  const Machine m = test_machine();
  const PrintPlan plan = continuous_plan(m, false, false);
  const double cycle = m.limits.cycle_s;
  const double allowed = m.stage.tolerance_um + 2 * cycle * plan.speed_um_s;
  // The way in which a stage that stands is as far off, and the answer that tells it. The measured
  // speed is 0 at once, but what is commanded goes on.
  Bench stuck(m, plan, {parse_sim_fault("stuck-stage@frame:10")});
  stuck.run();
  EXPECT_EQ(stuck.controller.fault(), Fault::stage_error) << stuck.controller.fault_detail();
  const double late_s = stuck.event_time("fault stage_error") - stuck.machine_time("stuck-stage");
  EXPECT_LE(late_s, allowed / plan.speed_um_s + 3 * cycle);
  EXPECT_LE(stuck.controller.worst_stage_error_um(), allowed + 2 * cycle * plan.speed_um_s);
  // Forwards and backwards; less than the tolerance is borne.
  for (const double um : {27.0, -27.0}) {
    Bench slips(m, plan, {parse_sim_fault(fmt::format("stage-slips={}@frame:10", um))});
    slips.run();
    EXPECT_EQ(slips.controller.fault(), Fault::stage_error) << slips.controller.fault_detail();
    EXPECT_LE(slips.event_time("fault stage_error") - slips.machine_time("stage-slips"), 2 * cycle);
  }
  Bench bears(m, plan, {parse_sim_fault("stage-slips=4@frame:10")});
  bears.run();
  EXPECT_EQ(bears.controller.fault(), Fault::none) << bears.controller.fault_detail();
}

TEST(BridgeFaults, ALagWithinTheToleranceIsNoFault) {
  // From then on the stage is behind by half the tolerance, in every kind of print, and comes to
  // rest that far from where it should.
  const Machine m = test_machine();
  ASSERT_GE(m.stage.tolerance_um, 20);
  const std::string lag = fmt::format("stuck-stage={}@frame:3", 10 * 3.6 / 1000);
  for (const auto& [name, plan, slips] :
       {std::tuple{"outside", continuous_plan(m, false, true),
                   std::vector<std::string>{lag, "stage-slips=4@frame:3"}},
        std::tuple{"lamps follow", continuous_plan(m, true, true),
                   std::vector<std::string>{lag, "stage-slips=4@frame:9"}},
        std::tuple{
            "layers", layerwise_plan(m),
            std::vector<std::string>{"stage-slips=10@frame:3", "stage-slips=-10@frame:3"}}}) {
    for (const std::string& slip : slips) {
      SCOPED_TRACE(fmt::format("{} {}", name, slip));
      Bench b(m, plan, {parse_sim_fault(slip)});
      b.run();
      EXPECT_EQ(b.controller.fault(), Fault::none) << b.controller.fault_detail();
      EXPECT_EQ(b.controller.phase(), Phase::done);
    }
  }
}

TEST(BridgeFaults, LampsGoOffSoonWhereTheStageDoesNotArrive) {
  // It sticks near the end, by more than is borne.
  const Machine m = test_machine();
  const PrintPlan plan = continuous_plan(m, true, true);
  Bench b(m, plan, {parse_sim_fault("stage-slips=-30@frame:39")});
  b.run();
  EXPECT_EQ(b.controller.fault(), Fault::stage_error) << b.controller.fault_detail();
  const double shown = b.machine_time("frame 39"), dark = b.machine_time("uv off", shown);
  ASSERT_GT(dark, shown);
  // The rest of the way, two seconds, and the cycles of the order.
  const double ramp_s = 2 * plan.ramp_um / plan.speed_um_s;
  EXPECT_LT(dark - shown, ramp_s + 2 + 10 * m.limits.cycle_s);
}

TEST(BridgeFaults, UvLightThatIsTooLittleForTheFrameIsFoundByItself) {
  // A lamp whose tolerance is so wide that nothing else finds it.
  Machine m = test_machine();
  m.uv.tolerance = 0.9;
  PrintPlan plan = continuous_plan(m, false, true);
  Bench fails(m, plan, {parse_sim_fault("uv-fails@frame:10")});
  fails.run();
  EXPECT_EQ(fails.controller.fault(), Fault::uv_ratio) << fails.controller.fault_detail();
  expect_order(fails, 0, false, true, true);
  // Where nothing is asked of UV light, nothing is missed.
  for (FramePlan& f : plan.frames) f.least_uv_mw_cm2 = 0;
  Bench idle(m, plan, {parse_sim_fault("uv-fails@frame:10")});
  idle.run();
  EXPECT_EQ(idle.controller.fault(), Fault::none) << idle.controller.fault_detail();
}

TEST(BridgeFaults, ALampThatDoesNotGoOffIsSaid) {
  const Machine m = test_machine();
  const PrintPlan plan = continuous_plan(m, false, false);
  Bench b(m, plan, {parse_sim_fault("lamp-sticks@frame:10")});
  bool stopped = false;
  b.run([&] {
    if (!stopped && b.controller.frame() == 20) {
      stopped = true;
      b.controller.fail(Fault::stopped_by_user, "enough");
    }
  });
  EXPECT_EQ(b.controller.fault(), Fault::stopped_by_user);
  EXPECT_NE(in_words(b.controller.left()).find("A LAMP STILL SHINES"), std::string::npos);
}

// ---- pauses ----

/// Pauses when frame `at` is shown, resumes when paused; what was answered.
PauseAnswer pause_at(Bench& b, int at, bool resume = true) {
  PauseAnswer answer;
  bool asked = false;
  b.run([&] {
    if (!asked && b.controller.frame() == at) {
      asked = true;
      answer = b.controller.pause();
    }
    if (b.controller.phase() == Phase::paused && resume) {
      EXPECT_TRUE(b.model.lamps_dark());
      EXPECT_EQ(b.model.display().number, -1);
      EXPECT_TRUE(b.model.at_rest());
      EXPECT_TRUE(b.controller.resume().accepted);
    }
  });
  EXPECT_TRUE(asked);
  return answer;
}

TEST(BridgePause, LampsThatFollowLeaveNoMark) {
  Machine m = test_machine();
  m.blue.min_share = m.uv.min_share = 0;
  for (const bool uv : {false, true}) {
    const PrintPlan plan = continuous_plan(m, true, uv);
    Bench b(m, plan);
    const PauseAnswer answer = pause_at(b, 15);
    EXPECT_TRUE(answer.accepted) << answer.why;
    ASSERT_EQ(b.controller.fault(), Fault::none) << b.controller.fault_detail();
    EXPECT_GE(b.event_time("phase paused"), 0);
    EXPECT_EQ(b.controller.frames_shown(), 40);
    EXPECT_EQ(b.uv_short_s, 0);
    // The dose of every slice is as it would be without a pause, within what a lamp lags.
    const double slice_s = plan.layer_um / plan.speed_um_s;
    const double lag =
        plan.acceleration_um_s2 * (m.limits.cycle_s + m.blue.settle_s) / plan.speed_um_s * slice_s;
    for (int n = 0; n < 40; ++n) {
      double light = 0;
      for (const auto& showing : b.model.exposures()[static_cast<std::size_t>(n)].showings) {
        if (showing.image >= 0) light += showing.light_s;
      }
      EXPECT_NEAR(light / slice_s, 1, 0.004 + 2 * lag) << n;
    }
  }
}

TEST(BridgePause, IsRefusedWhereItWouldLeaveAMark) {
  Machine m = test_machine();
  {
    Bench b(m, continuous_plan(m, false, false));
    const PauseAnswer answer = pause_at(b, 15);
    EXPECT_FALSE(answer.accepted);
    EXPECT_NE(answer.why.find("lit"), std::string::npos) << answer.why;
    EXPECT_EQ(b.controller.frames_shown(), 40) << "and the print goes on";
    EXPECT_EQ(b.controller.fault(), Fault::none);
  }
  {
    m.blue.min_share = 0.05;
    Bench b(m, continuous_plan(m, true, false));
    const PauseAnswer answer = pause_at(b, 15);
    EXPECT_FALSE(answer.accepted);
    EXPECT_NE(answer.why.find("dark below 5 %"), std::string::npos) << answer.why;
  }
  {
    m.blue.min_share = 0;
    m.uv.min_share = 0.1;
    Bench b(m, continuous_plan(m, true, true));
    EXPECT_NE(pause_at(b, 15).why.find("UV"), std::string::npos);
  }
  {
    // At the end there is no way left to stop on.
    m.uv.min_share = 0;
    Bench b(m, continuous_plan(m, true, false));
    const PauseAnswer answer = pause_at(b, 36);
    EXPECT_FALSE(answer.accepted);
    EXPECT_NE(answer.why.find("the print ends"), std::string::npos) << answer.why;
  }
}

TEST(BridgePause, InDarkSlices) {
  const Machine m = test_machine();
  const PrintPlan plan = continuous_plan(m, false, false, 18, 24);
  {
    Bench b(m, plan);
    const PauseAnswer answer = pause_at(b, 10);
    EXPECT_FALSE(answer.accepted);
    EXPECT_NE(answer.why.find("dark slices from 18 on, at z = 0.900 mm"), std::string::npos)
        << answer.why;
  }
  Bench b(m, plan);
  const PauseAnswer answer = pause_at(b, 18);
  EXPECT_TRUE(answer.accepted) << answer.why;
  ASSERT_EQ(b.controller.fault(), Fault::none) << b.controller.fault_detail();
  EXPECT_GE(b.event_time("phase paused"), 0);
  EXPECT_EQ(b.controller.frames_shown(), 40);
  // Lit slices got their light as if nothing had been.
  const double slice_s = plan.layer_um / plan.speed_um_s;
  for (int n = 0; n < 40; ++n) {
    double light = 0;
    for (const auto& showing : b.model.exposures()[static_cast<std::size_t>(n)].showings) {
      if (showing.image >= 0) light += showing.light_s;
    }
    if (plan.frames[static_cast<std::size_t>(n)].lit) {
      EXPECT_NEAR(light / slice_s, 1, 0.004) << n;
    }
  }
}

TEST(BridgePause, BetweenLayers) {
  const Machine m = test_machine();
  const PrintPlan plan = layerwise_plan(m);
  Bench b(m, plan);
  const PauseAnswer answer = pause_at(b, 2);
  EXPECT_TRUE(answer.accepted) << answer.why;
  ASSERT_EQ(b.controller.fault(), Fault::none) << b.controller.fault_detail();
  EXPECT_GE(b.event_time("phase paused"), 0);
  for (int n = 0; n < 6; ++n) {
    double light = 0;
    for (const auto& showing : b.model.exposures()[static_cast<std::size_t>(n)].showings) {
      if (showing.image >= 0) light += showing.light_s;
    }
    EXPECT_NEAR(light, 1.5, 1.5 * 0.011) << n;
  }
}

TEST(BridgePause, FaultsInAPauseEndInTheirOrder) {
  Machine m = test_machine();
  m.blue.min_share = 0;
  for (const char* fault : {"door@frame:16", "disconnect=9@frame:16", "stage-slips=60@frame:16"}) {
    SCOPED_TRACE(fault);
    Bench b(m, continuous_plan(m, true, false), {parse_sim_fault(fault)});
    bool asked = false;
    b.run([&] {
      if (!asked && b.controller.frame() == 15) {
        asked = true;
        EXPECT_TRUE(b.controller.pause().accepted);
      }
    });
    EXPECT_TRUE(asked);
    EXPECT_GE(b.event_time("phase pausing"), 0);
    EXPECT_EQ(b.controller.phase(), Phase::failed);
    EXPECT_TRUE(b.model.lamps_dark());
  }
}

}  // namespace
}  // namespace slicecorr::bridge
