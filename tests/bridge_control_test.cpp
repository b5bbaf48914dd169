// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The controller against a model of a printer, in one process and in steps: the motion that is
// expected, and whole prints.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "control/motion.hpp"
#include "control_bench.hpp"

namespace slicecorr::bridge {
namespace {

using namespace test;

// ---- the motion that is expected ----

TEST(CommandedMotion, IsTheTrapezoid) {
  CommandedMotion m;
  m.place(100, 0);
  m.move(1100, 200, 400, 1);  // 0.5 s and 50 um up to speed, 900 um in 4.5 s, 50 um down
  EXPECT_DOUBLE_EQ(m.at(1).position_um(), 100);
  EXPECT_NEAR(m.at(1.25).position_um(), 100 + 0.5 * 400 * 0.0625, 1e-9);
  EXPECT_NEAR(m.at(1.5).position_um(), 150, 1e-9);
  EXPECT_NEAR(m.at(3.5).position_um(), 550, 1e-9);
  EXPECT_NEAR(m.at(6.25).position_um(), 1100 - 12.5, 1e-9);
  EXPECT_DOUBLE_EQ(m.at(6.6).position_um(), 1100);
  EXPECT_TRUE(m.at(6.6).arrived());
  // Step by step it is the same.
  CommandedMotion steps = m;
  for (int i = 0; i <= 560; ++i) steps.advance(1 + 0.01 * i);
  EXPECT_NEAR(steps.position_um(), m.at(6.6).position_um(), 1e-9);
  // Too short for the speed: a triangle, peak sqrt(400 * 25) = 100 um/s.
  m.move(125, 200, 400, 1);
  EXPECT_NEAR(m.at(1.25).speed_um_s(), 100, 1e-9);
  EXPECT_NEAR(m.at(1.25).position_um(), 112.5, 1e-9);
  EXPECT_DOUBLE_EQ(m.at(1.5).position_um(), 125);
}

TEST(CommandedMotion, TurnsRound) {
  CommandedMotion m;
  m.place(0, 0);
  m.move(1000, 100, 100, 0);
  m.advance(3);  // 50 um ramp, 200 um
  m.move(0, 100, 100, 3);
  // 50 um further until it stands, after 1 s; then 300 um back: 1 s, 200 um in 2 s, 1 s.
  EXPECT_NEAR(m.at(4).position_um(), 300, 1e-9);
  EXPECT_NEAR(m.at(4).speed_um_s(), 0, 1e-9);
  EXPECT_NEAR(m.at(5).position_um(), 250, 1e-9);
  EXPECT_DOUBLE_EQ(m.at(8.001).position_um(), 0);
}

TEST(StageEstimate, FollowsAStageThatIsSlower) {
  StageEstimate e;
  e.start(0, 0);
  e.command(1e6, 100, 1e6, 0);
  for (int i = 1; i <= 1000; ++i) {
    const double t = 0.01 * i;
    const double speed = 99;  // 1 % less than told
    e.measure(99 * t, i % 2 ? &speed : nullptr, t);
  }
  // Frames: right within what a cycle brings, though the commanded motion is 10 um ahead by now.
  EXPECT_NEAR(e.position_um(10.02), 99 * 10.02, 0.05);
  EXPECT_NEAR(e.speed_um_s(10), 99, 0.1);
  // The steady part is forgotten: 1 um/s over 2 s.
  EXPECT_NEAR(e.error_um(), -2, 0.1);
}

// ---- whole prints ----

TEST(BridgeControl, PrintsContinuously) {
  const Machine m = test_machine();
  for (const bool follow : {false, true}) {
    for (const bool uv : {false, true}) {
      SCOPED_TRACE(fmt::format("lamps follow {}, UV {}", follow, uv));
      const PrintPlan plan = continuous_plan(m, follow, uv);
      Bench b(m, plan);
      b.run();
      ASSERT_EQ(b.controller.fault(), Fault::none) << b.controller.fault_detail();
      EXPECT_EQ(b.controller.phase(), Phase::done);
      EXPECT_EQ(b.controller.frames_shown(), 40);
      EXPECT_TRUE(b.model.lamps_dark());
      EXPECT_EQ(b.model.display().number, -1);
      // Black, 40 frames in order, black.
      int next = 0;
      for (const SimEvent& e : b.model.events()) {
        if (e.what.starts_with("frame ")) {
          EXPECT_EQ(e.what, fmt::format("frame {}", next++));
        }
      }
      EXPECT_EQ(next, 40);
      // Frames appear where they belong: registers hold hundredths of a um, and what a cycle can't
      // know of a ramp is a cycle squared of its acceleration.
      for (const FrameRecord& r : b.records) {
        const double ramp = 0.5 * plan.acceleration_um_s2 * std::pow(2 * m.limits.cycle_s, 2);
        EXPECT_NEAR(r.stage_um, r.planned_um, 0.05 + ramp) << r.frame;
      }
      EXPECT_EQ(b.uv_short_s, 0);
      if (uv) {
        EXPECT_LT(b.machine_time("uv on"), b.machine_time("blue on"));
        const auto order = b.machine_events({"blue off", "uv off"});
        ASSERT_GE(order.size(), 2U);
        EXPECT_EQ(order.front(), "blue off");
        EXPECT_EQ(order.back(), "uv off");
      } else {
        EXPECT_LT(b.machine_time("uv on"), 0);
      }
    }
  }
}

TEST(BridgeControl, DosesAreThoseOfTheStack) {
  // Light that each slice got, as time at full light over the time in which it passes: 1, whatever
  // the stage's ramps. What is off is the lamp's lag behind a ramp and a frame's place.
  const Machine m = test_machine();
  for (const bool follow : {false, true}) {
    SCOPED_TRACE(follow);
    const PrintPlan plan = continuous_plan(m, follow, false);
    Bench b(m, plan);
    b.run();
    ASSERT_EQ(b.controller.fault(), Fault::none) << b.controller.fault_detail();
    const double slice_s = plan.layer_um / plan.speed_um_s;
    const auto& slices = b.model.exposures();
    ASSERT_GE(slices.size(), 40U);
    for (int n = 0; n < 40; ++n) {
      double right = 0, wrong = 0;
      for (const auto& showing : slices[static_cast<std::size_t>(n)].showings) {
        (showing.image == n ? right : wrong) += showing.light_s;
      }
      // A ramp of 400 um: the lamp holds its share for a cycle and takes settle_s to it, while the
      // speed changes by up to a * t.
      const double lag =
          follow ? plan.acceleration_um_s2 * (m.limits.cycle_s + m.blue.settle_s) / plan.speed_um_s
                 : 0;
      const bool ramp = follow && (n < 9 || n > 30);
      // At both ends the lamp is dark below its least share.
      const double dark =
          follow && (n == 0 || n == 39) ? plan.ramp_um * std::pow(m.blue.min_share, 2) / 50 : 0;
      EXPECT_NEAR(right / slice_s, 1, 0.004 + dark + (ramp ? lag * slice_s : 0)) << n;
      if (n > 0) {
        EXPECT_LT(wrong / slice_s, 0.004) << n;
      }
    }
  }
}

TEST(BridgeControl, PrintsLayerByLayer) {
  const Machine m = test_machine();
  const PrintPlan plan = layerwise_plan(m);
  Bench b(m, plan);
  b.run();
  ASSERT_EQ(b.controller.fault(), Fault::none) << b.controller.fault_detail();
  EXPECT_EQ(b.controller.frames_shown(), 6);
  const auto& slices = b.model.exposures();
  ASSERT_GE(slices.size(), 6U);
  for (int n = 0; n < 6; ++n) {
    double light = 0;
    for (const auto& showing : slices[static_cast<std::size_t>(n)].showings) {
      if (showing.image != n) continue;
      light += showing.light_s;
      EXPECT_NEAR(showing.from_um, (n + 1) * 50.0, 0.5);
      EXPECT_NEAR(showing.speed_um_s, 0, 1e-6);
    }
    EXPECT_NEAR(light, 1.5, 1.5 * 0.011) << n;  // the lamp is within 1 % when it is called settled
  }
}

TEST(BridgeControl, DryRunHasNoLight) {
  const Machine m = test_machine();
  Bench b(m, continuous_plan(m, false, true), {}, true);
  b.run();
  EXPECT_EQ(b.controller.phase(), Phase::done) << b.controller.fault_detail();
  EXPECT_EQ(b.controller.frames_shown(), 40);
  EXPECT_LT(b.machine_time("blue on"), 0);
  EXPECT_LT(b.machine_time("uv on"), 0);
}

TEST(BridgeControl, UnderrunAndWrongFrames) {
  const Machine m = test_machine();
  const PrintPlan plan = continuous_plan(m, false, false);
  for (const bool missing : {true, false}) {
    Bench b(m, plan);
    bool told = false;
    b.run([&] {
      if (told || b.controller.frame() != 7) return;
      told = true;
      b.controller.shown({missing ? 8 : 25, b.now_s, missing});
    });
    EXPECT_EQ(b.controller.fault(), missing ? Fault::underrun : Fault::wrong_frame);
    EXPECT_EQ(b.controller.phase(), Phase::failed);
    expect_order(b, 0, false, true, true);
  }
}

TEST(BridgeControl, LateFramesAreBorneWhereTheMachineSaysSo) {
  Machine m = test_machine();
  // 0.03 s late are 8.3 um.
  const std::vector<SimFault> once{parse_sim_fault("late-frame=0.03@frame:10")};
  const PrintPlan plan = continuous_plan(m, false, false);
  Bench strict(m, plan, once);
  strict.run();
  EXPECT_EQ(strict.controller.fault(), Fault::late_frame);
  EXPECT_NE(strict.controller.fault_detail().find("frame 10"), std::string::npos);
  m.limits.max_late_frames = 1;
  Bench lenient(m, plan, once);
  lenient.run();
  EXPECT_EQ(lenient.controller.fault(), Fault::none) << lenient.controller.fault_detail();
  EXPECT_EQ(lenient.controller.late_frames(), 1);
  EXPECT_NEAR(lenient.controller.worst_late_um(), 0.03 * plan.speed_um_s, 0.1);
  // Two are too many, and so is one of more than ten times the limit.
  Bench twice(m, plan, {once[0], parse_sim_fault("late-frame=0.03@frame:20")});
  twice.run();
  EXPECT_EQ(twice.controller.fault(), Fault::late_frame);
  Bench far(m, plan, {parse_sim_fault("late-frame=0.25@frame:10")});
  far.run();
  EXPECT_EQ(far.controller.fault(), Fault::late_frame);
}

// Where answers are lost on a bad line, images come late: it is the line that has to be seen to.
TEST(BridgeControl, ABadLineIsNamedAndNotTheImages) {
  const Machine m = test_machine();
  for (const bool bad : {false, true}) {
    Bench b(m, continuous_plan(m, false, false), {parse_sim_fault("late-frame=0.25@frame:20")});
    std::mt19937 random(3);
    if (bad) b.noise = [&] { return random() % 10 < 4; };
    b.run();
    EXPECT_EQ(b.controller.fault(), bad ? Fault::heartbeat_lost : Fault::late_frame)
        << b.controller.fault_detail();
    EXPECT_EQ(b.controller.fault_detail().find("of requests were not answered rightly") !=
                  std::string::npos,
              bad)
        << b.controller.fault_detail();
  }
}

TEST(BridgeControl, AFrameThatComesTooEarlyIsAsWrongAsALateOne) {
  Machine m = test_machine();
  m.limits.max_late_um = 1;
  const PrintPlan plan = continuous_plan(m, false, false);
  Bench b(m, plan);
  // A frame is known two cycles ahead, so that it can't come much earlier; this is 2.8 um.
  b.early_s = m.limits.cycle_s;
  b.run();
  EXPECT_EQ(b.controller.fault(), Fault::late_frame);
  EXPECT_NE(b.controller.fault_detail().find("early"), std::string::npos)
      << b.controller.fault_detail();
}

TEST(BridgeControl, AStageThatIsAFewPerCentSlowerIsFollowed) {
  // Dose and heights stay right where frames and lamps follow what is measured; only a stage that
  // is further off than that has failed.
  const Machine m = test_machine();
  const PrintPlan plan = continuous_plan(m, false, false);
  const double forget_s = std::max(2.0, 3 * m.stage.tolerance_um / plan.speed_um_s);
  const auto printed_at = [&](double share) {
    Bench b(m, plan);
    b.stage_speed = share;
    b.run();
    EXPECT_EQ(b.controller.frames_shown() == 40, b.controller.fault() == Fault::none);
    for (const FrameRecord& r : b.records) {
      if (b.controller.fault() == Fault::none) {
        EXPECT_LE(std::abs(r.stage_um - r.planned_um), m.limits.max_late_um);
        // m is 1; before the first slice the lamp waits at full light.
        if (r.frame > 0) {
          EXPECT_NEAR(r.blue_share, share, 0.01) << r.frame;
        }
      }
    }
    return b.controller.fault();
  };
  EXPECT_EQ(printed_at(0.98), Fault::none);
  // What it is behind grows by this share of its way until as much is forgotten as comes.
  const double too_slow = 1 - 2 * m.stage.tolerance_um / (plan.speed_um_s * forget_s);
  ASSERT_GT(too_slow, 0);
  EXPECT_EQ(printed_at(too_slow), Fault::stage_error);
}

TEST(BridgeControl, AMachineInAFaultIsNotStarted) {
  const Machine m = test_machine();
  Bench b(m, continuous_plan(m, false, false), {parse_sim_fault("door=0.01")});
  b.run();
  EXPECT_EQ(b.controller.phase(), Phase::failed);
  EXPECT_FALSE(b.controller.begun());
  EXPECT_LT(b.machine_time("run"), 0);
}

TEST(BridgeControl, SequenceNumbersGoRound) {
  // 65536 cycles are 655 s: a print of 700 s.
  const Machine m = test_machine();
  PrintPlan plan = continuous_plan(m, false, false);
  plan.speed_um_s = 2;
  plan.ramp_um = plan.speed_um_s * plan.speed_um_s / (2 * plan.acceleration_um_s2);
  plan.frames.resize(28);
  plan.end_um = plan.start_um + 28 * plan.layer_um;
  Bench b(m, plan);
  b.run({}, 2000);
  EXPECT_EQ(b.controller.fault(), Fault::none) << b.controller.fault_detail();
  EXPECT_GT(b.now_s, 656);
}

}  // namespace
}  // namespace slicecorr::bridge
