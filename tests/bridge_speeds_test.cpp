// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Slices with speeds of their own: the stage is never faster than its slice, the lamps follow, and
// so each slice gets the light that the stack plans.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "control_bench.hpp"

namespace slicecorr::bridge {
namespace {

using namespace test;
using testing::HasSubstr;

/// Speeds of 40 slices, as shares of the plan's.
std::vector<double> shares_of(const std::string& name) {
  std::vector<double> shares(40, 1);
  for (int n = 0; n < 40; ++n) {
    double& s = shares[static_cast<std::size_t>(n)];
    if (name == "a slow stretch" && n >= 12 && n < 20) s = 0.3;
    if (name == "one slow slice" && n == 21) s = 0.25;
    if (name == "to and fro") s = n % 2 == 0 ? 1 : 0.5;
    if (name == "a stair") s = 1 - 0.015 * n;
    if (name == "slow ends" && (n < 6 || n > 33)) s = 0.4;
    if (name == "slow to fast") s = n < 20 ? 0.2 : 1;
  }
  return shares;
}
const std::vector<std::string> kProfiles{"a slow stretch", "one slow slice", "to and fro",
                                         "a stair",        "slow ends",      "slow to fast"};

PrintPlan plan_with(const Machine& m, bool follow, bool uv, const std::string& name) {
  PrintPlan plan = continuous_plan(m, follow, uv);
  for (const double share : shares_of(name)) {
    plan.slice_speed_um_s.push_back(share * plan.speed_um_s);
  }
  return plan;
}

TEST(BridgeSpeeds, NoSliceIsFasterThanItsOwn) {
  const Machine m = test_machine();
  for (const std::string& name : kProfiles) {
    for (const bool follow : {false, true}) {
      SCOPED_TRACE(fmt::format("{} follow {}", name, follow));
      const PrintPlan plan = plan_with(m, follow, false, name);
      Bench b(m, plan);
      double worst = 0;
      int slow_cycles = 0;
      b.run([&] {
        const Status s = b.model.status();
        const double z = s.stage_um - plan.start_um;
        const int n = static_cast<int>(std::floor(z / plan.layer_um));
        if (b.controller.phase() != Phase::printing || n < 0 || n >= 40) return;
        const double over = *s.stage_speed_um_s - plan.speed_at(n);
        worst = std::max(worst, over);
        if (plan.speed_at(n) < plan.speed_um_s) ++slow_cycles;
      });
      ASSERT_EQ(b.controller.fault(), Fault::none) << b.controller.fault_detail();
      EXPECT_EQ(b.controller.frames_shown(), 40);
      EXPECT_GT(slow_cycles, 10);
      // Registers hold speeds in steps of a thousandth of the fastest.
      EXPECT_LE(worst, 1e-3 * m.stage.max_speed_um_s);
      // Nor is it much slower: it loses the ramps between speeds and the cycles of reaction.
      double least_s = 0;
      int changes = 1;
      for (int n = 0; n < 40; ++n) {
        least_s += plan.layer_um / plan.speed_at(n);
        if (n > 0 && plan.speed_at(n) != plan.speed_at(n - 1)) ++changes;
      }
      const double took_s =
          b.machine_time("blue off", b.records.back().shown_s) - b.records.front().shown_s;
      const double slowest = plan.slowest_um_s() / plan.speed_um_s;
      EXPECT_GE(took_s, 0.98 * least_s);
      const double ramp_s = plan.speed_um_s / plan.acceleration_um_s2;
      EXPECT_LE(took_s, least_s + changes * (6 * m.limits.cycle_s / slowest + ramp_s) +
                            (follow ? 2 * ramp_s : 0) + 0.2);
    }
  }
}

/// Light of a slice: seconds of it at its full share.
double light_s_of(const Bench& b, int n) {
  double light_s = 0;
  for (const auto& showing : b.model.exposures()[static_cast<std::size_t>(n)].showings) {
    if (showing.image != kBlackImage) light_s += showing.light_s;
  }
  return light_s;
}

/// Light of a slice, 1: as planned.
double light_of(const Bench& b, const PrintPlan& plan, int n) {
  return light_s_of(b, n) / (plan.layer_um / plan.speed_um_s);
}

TEST(BridgeSpeeds, EachSliceGetsItsLight) {
  const Machine m = test_machine();
  for (const std::string& name : kProfiles) {
    for (const double exponent : {1.0, 0.7}) {
      SCOPED_TRACE(fmt::format("{} m {}", name, exponent));
      PrintPlan plan = plan_with(m, false, false, name);
      plan.m = exponent;
      Bench b(m, plan);
      b.run();
      ASSERT_EQ(b.controller.fault(), Fault::none) << b.controller.fault_detail();
      const double slice_s = plan.layer_um / plan.speed_um_s;
      ASSERT_GE(b.model.exposures().size(), 40U);
      for (int n = 0; n < 40; ++n) {
        // While the speed changes by a t the lamp holds its share for a cycle and takes settle_s to
        // it: of each change so much of the difference in light is lost or too much, once for where
        // the slice begins and once for where it ends.
        double change = 0;
        for (const int k : {n - 1, n + 1}) {
          change += std::abs(plan.speed_at(k) - plan.speed_at(n)) / plan.speed_um_s;
        }
        const double lag_s = m.limits.cycle_s + m.blue.settle_s;
        EXPECT_NEAR(light_s_of(b, n) / slice_s, 1, 0.006 + change * lag_s / slice_s) << n;
      }
    }
  }
}

TEST(BridgeSpeeds, LampsThatStayGiveEachSliceTheLightOfItsOwnSpeed) {
  const Machine m = test_machine();
  for (const std::string& name : kProfiles) {
    for (const double exponent : {1.0, 0.7}) {
      SCOPED_TRACE(fmt::format("{} m {}", name, exponent));
      PrintPlan plan = plan_with(m, false, false, name);
      plan.m = exponent;
      plan.light_of_slices = true;
      Bench b(m, plan);
      b.run();
      ASSERT_EQ(b.controller.fault(), Fault::none) << b.controller.fault_detail();
      ASSERT_GE(b.model.exposures().size(), 40U);
      for (int n = 0; n < 40; ++n) {
        // As where lamps follow, and once more: where the stage has changed its speed in the faster
        // slice, the slower one begins with a lamp that was dimmed, or the faster with one that was not.
        double change = 0;
        for (const int k : {n - 1, n + 1}) change += std::abs(plan.speed_at(k) - plan.speed_at(n));
        const double lag_s = m.limits.cycle_s + m.blue.settle_s;
        EXPECT_NEAR(light_s_of(b, n) / (plan.layer_um / plan.speed_at(n)), 1,
                    0.006 + 2 * change * lag_s / plan.layer_um)
            << n;
      }
    }
  }
}

TEST(BridgeSpeeds, AnswersThatAreLostWhileTheSpeedChangesCostNoLight) {
  // The machine is told to speed up at slice 20, does so, and is not heard for 120 ms. Without the
  // lamp following what was told it would keep a fifth of its light for two thirds of the slice.
  const Machine m = test_machine();
  const PrintPlan plan = plan_with(m, false, false, "slow to fast");
  Bench b(m, plan, {parse_sim_fault("drop=12@frame:20")});
  b.run();
  ASSERT_EQ(b.controller.fault(), Fault::none) << b.controller.fault_detail();
  const double lag_s = m.limits.cycle_s + m.blue.settle_s;
  for (int n = 0; n < 40; ++n) {
    EXPECT_NEAR(light_of(b, plan, n), 1, 0.006 + 0.8 * lag_s * plan.speed_um_s / plan.layer_um)
        << n;
  }
  EXPECT_EQ(b.controller.light_off().slices, 0);
}

TEST(BridgeSpeeds, LightThatIsOffIsTold) {
  // A lamp that fades by a fifth in a second and may do so.
  Machine m = test_machine();
  m.blue.tolerance = 0.5;
  PrintPlan plan = plan_with(m, false, false, "a slow stretch");
  for (const double exponent : {1.0, 0.7}) {
    SCOPED_TRACE(exponent);
    plan.m = exponent;
    Bench b(m, plan, {parse_sim_fault("lamp-drifts=-0.2@frame:22")});
    b.run();
    ASSERT_EQ(b.controller.fault(), Fault::none) << b.controller.fault_detail();
    // Faded after a second, 5.6 slices: all slices from then on are told, with what they got. Within a
    // cycle, a twentieth of a slice, the lamp fades by 2e-3.
    const LightOff& off = b.controller.light_off();
    EXPECT_NEAR(off.light, std::pow(0.8, exponent), 0.005);
    EXPECT_GE(off.slice, 22);
    int dim = 0, told = 0;
    for (int n = 0; n < 40; ++n) dim += light_of(b, plan, n) < 0.9 ? 1 : 0;
    for (const PrintEvent& e : b.events) {
      if (e.what != "light off") continue;
      ++told;
      EXPECT_THAT(e.detail, HasSubstr("of its light"));
    }
    EXPECT_GE(dim, 12);
    EXPECT_NEAR(off.slices, dim, 1);
    EXPECT_EQ(told, off.slices);
  }
  // A calm print tells nothing.
  Bench calm(m, plan);
  calm.run();
  EXPECT_EQ(calm.controller.light_off().slices, 0);
  EXPECT_EQ(calm.event_time("light off"), -1);
}

TEST(BridgeSpeeds, FramesComeAtTheirPlacesAndUvLightIsEnough) {
  const Machine m = test_machine();
  for (const std::string& name : kProfiles) {
    for (const bool follow : {false, true}) {
      SCOPED_TRACE(fmt::format("{} follow {}", name, follow));
      const PrintPlan plan = plan_with(m, follow, true, name);
      Bench b(m, plan);
      b.run();
      ASSERT_EQ(b.controller.fault(), Fault::none) << b.controller.fault_detail();
      EXPECT_LE(b.uv_short_s, m.blue.settle_s + m.uv.settle_s + 2 * m.limits.cycle_s);
      // A speed that is told when a frame is already planned shifts it by what the stage speeds up
      // in two cycles.
      const double off = 0.05 + 0.5 * plan.acceleration_um_s2 * std::pow(4 * m.limits.cycle_s, 2);
      for (const FrameRecord& r : b.records) {
        EXPECT_NEAR(r.stage_um, r.planned_um, off) << r.frame;
      }
    }
  }
}

TEST(BridgeSpeeds, AStageThatIsStuckIsFoundWhereEverySliceHasAnotherSpeed) {
  const Machine m = test_machine();
  for (const std::string fault : {"stuck-stage@frame:15", "stage-slips=60@frame:15",
                                  "stage-slips=-60@frame:15", "stage-fails@frame:15"}) {
    for (const std::string name : {"to and fro", "a stair"}) {
      SCOPED_TRACE(fault + " " + name);
      Bench b(m, plan_with(m, false, true, name), {parse_sim_fault(fault)});
      b.run();
      EXPECT_NE(b.controller.fault(), Fault::none);
      const double since = b.machine_time(fault.substr(0, fault.find_first_of("=@")));
      ASSERT_GE(since, 0);
      // Within its tolerance, the way of some cycles and what a lamp needs.
      const double borne_s = 2 * m.stage.tolerance_um / (0.4 * 1000 / 3.6) + 10 * m.limits.cycle_s;
      const double found = b.event_time("fault " + std::string(name_of(b.controller.fault())));
      EXPECT_LE(found - since, borne_s);
      expect_order(b, since, false, true, true);
    }
  }
}

TEST(BridgeSpeeds, APauseInASlowStretchLeavesNoMark) {
  Machine m = test_machine();
  m.blue.min_share = m.uv.min_share = 0;
  const PrintPlan plan = plan_with(m, true, false, "slow to fast");
  Bench b(m, plan);
  bool asked = false, resumed = false;
  double fastest = 0;
  b.run([&] {
    if (!asked && b.controller.frame() == 8) {
      const PauseAnswer answer = b.controller.pause();
      EXPECT_TRUE(answer.accepted) << answer.why;
      asked = true;
    }
    if (b.controller.phase() == Phase::paused && !resumed) {
      resumed = b.controller.resume().accepted;
    }
    if (asked && b.controller.frame() < 19 && b.controller.phase() <= Phase::resuming) {
      fastest = std::max(fastest, *b.model.status().stage_speed_um_s);
    }
  });
  EXPECT_TRUE(resumed);
  ASSERT_EQ(b.controller.fault(), Fault::none) << b.controller.fault_detail();
  EXPECT_EQ(b.controller.frames_shown(), 40);
  EXPECT_LE(fastest, plan.speed_at(8) + 1e-3 * m.stage.max_speed_um_s);
}

TEST(BridgeSpeeds, LampsAreToldTheShareOfTheSpeed) {
  PrintPlan plan;
  plan.speed_um_s = 100;
  plan.slice_speed_um_s = {25, 50, 100};
  EXPECT_EQ(plan.speed_at(0), 25);
  EXPECT_EQ(plan.speed_at(-3), 25);
  EXPECT_EQ(plan.speed_at(7), 100);
  EXPECT_EQ(plan.slowest_um_s(), 25);
  EXPECT_DOUBLE_EQ(lamp_share(plan, LampDrive{}, 25, 0), 0.25);
  plan.m = 0.5;
  EXPECT_DOUBLE_EQ(lamp_share(plan, LampDrive{}, 25, 0), 0.0625);
  // Where each slice has light for its own speed the lamps are told how far the stage is from that.
  plan.light_of_slices = true;
  EXPECT_DOUBLE_EQ(lamp_share(plan, LampDrive{}, 25, 0), 1);
  EXPECT_DOUBLE_EQ(lamp_share(plan, LampDrive{}, 25, 1), 0.25);
  EXPECT_DOUBLE_EQ(lamp_share(plan, LampDrive{}, 50, 2), 0.25);
}

}  // namespace
}  // namespace slicecorr::bridge
