// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The printer model against closed forms: motion, lamps, watchdog, interlocks, light per slice.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "sim/motion.hpp"
#include "sim_fixture.hpp"
#include "slicecorr/bridge/model.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::bridge {
namespace {

using slicecorr::test::kSmallMachine;
using slicecorr::test::machine_of;
using slicecorr::test::replaced;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr double kHome = 1000;  // of the small machine, um
// Closed forms and sums of a few hundred pieces in double precision.
constexpr double kExact = 1e-9;

Machine small() { return machine_of(kSmallMachine); }

Machine with_lamp(const std::string& settle, const std::string& warm_up) {
  return machine_of(replaced(kSmallMachine, "settle_s = 0\n[lamps.uv]",
                             "settle_s = " + settle + "\nwarm_up_s = " + warm_up + "\n[lamps.uv]"));
}

std::shared_ptr<const Frame> frame_of(int number) {
  auto frame = std::make_shared<Frame>();
  frame->number = number;
  frame->width_px = 16;
  frame->height_px = 8;
  frame->blue.assign(128, static_cast<std::uint8_t>(number));
  frame->crc32 = static_cast<std::uint32_t>(number);
  return frame;
}

SetPoints run_to(double target_um, double speed_um_s, double blue = 0, double uv = 0) {
  SetPoints s;
  s.command = Command::run;
  s.target_um = target_um;
  s.speed_um_s = speed_um_s;
  s.blue_share = blue;
  s.uv_mw_cm2 = uv;
  return s;
}

/// A controller that keeps the watchdog fed while time passes.
class Driver {
 public:
  explicit Driver(PrinterModel& model) : model_(model) {}
  SetPoints set_points;
  void send() {
    ++set_points.sequence;
    ++set_points.heartbeat;
    model_.take(set_points);
  }
  void until(double time_s, double cycle_s = 0.01) {
    while (model_.now_s() + cycle_s < time_s - 1e-12) {
      model_.advance(model_.now_s() + cycle_s);
      send();
    }
    model_.advance(time_s);
    send();
  }

 private:
  PrinterModel& model_;
};

std::vector<std::string> words(const PrinterModel& model) {
  std::vector<std::string> all;
  for (const SimEvent& e : model.events()) all.push_back(e.what);
  return all;
}
double time_of(const PrinterModel& model, const std::string& what) {
  for (const SimEvent& e : model.events()) {
    if (e.what == what) return e.at_s;
  }
  return -1;
}
double light_of(const SliceExposure& slice) {
  double sum = 0;
  for (const auto& showing : slice.showings) sum += showing.light_s;
  return sum;
}

// --- Motion

TEST(Motion, IsATrapezoid) {
  // 1000 um at 200 um/s and 1000 um/s²: 0.2 s and 20 um up, 4.8 s and 960 um, 0.2 s and 20 um down.
  PrinterModel model(small(), {});
  Driver driver(model);
  driver.set_points = run_to(kHome + 1000, 200);
  driver.send();
  const auto at = [&](double time_s) {
    driver.until(time_s);
    return model.status().stage_um - kHome;
  };
  EXPECT_NEAR(at(0.1), 5, kExact);
  EXPECT_NEAR(*model.status().stage_speed_um_s, 100, kExact);
  EXPECT_NEAR(at(0.2), 20, kExact);
  EXPECT_NEAR(at(1), 180, kExact);
  EXPECT_NEAR(*model.status().stage_speed_um_s, 200, kExact);
  EXPECT_NEAR(at(5), 980, kExact);
  EXPECT_NEAR(at(5.1), 995, kExact);
  EXPECT_FALSE(model.at_rest());
  EXPECT_EQ(at(5.3), 1000);
  EXPECT_EQ(*model.status().stage_speed_um_s, 0);
  EXPECT_TRUE(model.at_rest());
  EXPECT_NEAR(time_of(model, "stage stops"), 5.2, kExact);
}

TEST(Motion, IsATriangleWhereThereIsNoRoom) {
  // 10 um: up to 100 um/s in 0.1 s and down again.
  PrinterModel model(small(), {});
  Driver driver(model);
  driver.set_points = run_to(kHome + 10, 200);
  driver.send();
  driver.until(0.1);
  EXPECT_NEAR(*model.status().stage_speed_um_s, 100, 1e-6);
  driver.until(1);
  EXPECT_EQ(model.status().stage_um, kHome + 10);
  EXPECT_NEAR(time_of(model, "stage stops"), 0.2, kExact);
}

TEST(Motion, TurnsRoundForATargetBehind) {
  PrinterModel model(small(), {});
  Driver driver(model);
  driver.set_points = run_to(kHome + 1000, 200);
  driver.send();
  driver.until(1);  // at 180 um with 200 um/s: stops 20 um further
  driver.set_points.target_um = kHome + 190;
  driver.send();
  driver.until(1.2);
  EXPECT_NEAR(model.status().stage_um, kHome + 200, 1e-6);
  driver.until(2);
  EXPECT_EQ(model.status().stage_um, kHome + 190);
}

TEST(Motion, SlowsDownToALowerSpeedAndKeepsToItsLimits) {
  PrinterModel model(small(), {});
  Driver driver(model);
  driver.set_points = run_to(1e9, 1e9);
  driver.set_points.acceleration_um_s2 = 1e9;
  driver.send();
  driver.until(2);  // 1000 um/s is reached after 1 s and 500 um
  EXPECT_NEAR(model.status().stage_um, kHome + 1500, 1e-6);
  driver.set_points.speed_um_s = 100;
  driver.send();
  driver.until(2.9);
  EXPECT_NEAR(*model.status().stage_speed_um_s, 100, 1e-6);
  driver.until(400, 0.1);
  EXPECT_EQ(model.status().stage_um, 20000);  // its travel
}

TEST(Motion, PiecesJoin) {
  // Random courses: pieces join in place and speed, and never exceed speed and acceleration.
  std::mt19937 random(11);
  const auto in = [&](double least, double greatest) {
    return std::uniform_real_distribution<>(least, greatest)(random);
  };
  for (int i = 0; i < 2000; ++i) {
    const detail::Course course{i % 5 != 0, in(-500, 500), in(0.1, 300), in(10, 5000)};
    detail::Motion m{in(-500, 500), in(-300, 300)};
    for (int k = 0; k < 12; ++k) {
      const auto piece = next_piece(m, course);
      if (!std::isfinite(piece.duration_s)) break;
      ASSERT_GE(piece.duration_s, 0);
      ASSERT_LE(std::abs(piece.acceleration_um_s2), course.acceleration_um_s2 * (1 + 1e-12));
      const double t = piece.duration_s * (1 - 1e-9);
      const auto before = within(m, piece, t);
      ASSERT_NEAR(before.at_um, piece.end.at_um, 1e-5);
      ASSERT_NEAR(before.speed_um_s, piece.end.speed_um_s, 1e-4);
      m = piece.end;
    }
    EXPECT_EQ(m.speed_um_s, 0);
    if (course.moving) {
      EXPECT_EQ(m.at_um, course.target_um);
    }
  }
}

TEST(Motion, DoesNotDependOnHowOftenItIsAsked) {
  const auto place = [](unsigned seed) {
    PrinterModel model(small(), {}, 10);
    std::mt19937 random(seed);
    SetPoints s = run_to(kHome + 700, 300, 1);
    for (int cycle = 1; cycle <= 200; ++cycle) {
      const double end = cycle * 0.02;
      while (model.now_s() < end) {
        const double step = std::uniform_real_distribution<>(1e-4, 0.02)(random);
        model.advance(std::min(end, model.now_s() + step));
      }
      ++s.heartbeat;
      if (cycle == 100) s.target_um = kHome + 100;
      model.take(s);
    }
    double light = 0;
    for (const auto& slice : model.exposures()) light += light_of(slice);
    return std::pair(model.status().stage_um, light);
  };
  const auto one = place(1), other = place(2);
  EXPECT_NEAR(one.first, other.first, kExact);
  EXPECT_NEAR(one.second, other.second, kExact);
}

// --- Lamps

TEST(Lamp, FollowsWithinItsTime) {
  PrinterModel model(with_lamp("0.1", "0"), {});
  Driver driver(model);
  driver.set_points = run_to(kHome, 0, 0.5);
  driver.send();
  const double tau = 0.1 / std::log(100.0);
  for (const double t : {0.01, 0.02, 0.05, 0.1}) {
    driver.until(t);
    EXPECT_NEAR(model.status().blue_measured, 0.5 * (1 - std::exp(-t / tau)), kExact) << t;
  }
  EXPECT_NEAR(model.status().blue_measured, 0.5 * 0.99, kExact);
  driver.until(1);
  EXPECT_EQ(model.status().blue_measured, 0.5);
  // Dimmed likewise, but off is off at once.
  driver.set_points.blue_share = 0.1;
  driver.send();
  driver.until(1.1);
  EXPECT_NEAR(model.status().blue_measured, 0.1 + 0.4 * 0.01, kExact);
  driver.set_points.blue_share = 0;
  driver.send();
  EXPECT_EQ(model.status().blue_measured, 0);
}

TEST(Lamp, WarmsUp) {
  PrinterModel model(with_lamp("0", "2"), {});
  Driver driver(model);
  driver.set_points = run_to(kHome, 0, 1);
  driver.send();
  EXPECT_NEAR(model.status().blue_measured, 0.8, kExact);
  driver.until(1);
  EXPECT_NEAR(model.status().blue_measured, 0.9, kExact);
  driver.until(3);
  EXPECT_EQ(model.status().blue_measured, 1);
  // It cools as fast.
  driver.set_points.blue_share = 0;
  driver.send();
  driver.until(4);
  driver.set_points.blue_share = 1;
  driver.send();
  EXPECT_NEAR(model.status().blue_measured, 0.9, 1e-6);
}

TEST(Lamp, IsDarkBelowItsLeastShareAndHeldToItsGreatest) {
  PrinterModel model(small(), {});
  model.take(run_to(kHome, 0, 0.019, 500));
  EXPECT_EQ(model.status().blue_measured, 0);
  EXPECT_EQ(*model.status().uv_measured, 200);
  model.take(run_to(kHome, 0, 5));
  EXPECT_EQ(model.status().blue_measured, 2);
}

TEST(Lamp, LightOfAStandingStageHasAClosedForm) {
  // Switched on at 0 for 0.25 s, the first-order response integrated: m = 1 and m = 2.
  const double tau = 0.1 / std::log(100.0), t = 0.25, e = std::exp(-t / tau);
  const double once = t - tau * (1 - e);
  const double squared = t - 2 * tau * (1 - e) + tau / 2 * (1 - e * e);
  for (const double m : {1.0, 2.0}) {
    PrinterModel model(with_lamp("0.1", "0"), {}, 100, m);
    model.take(run_to(kHome, 0, 0.5));
    model.advance(t);
    ASSERT_EQ(model.exposures().size(), 1);
    EXPECT_NEAR(light_of(model.exposures()[0]), m == 1 ? 0.5 * once : 0.25 * squared, 1e-10);
  }
  // Warming up without delay: linear from 0.8 on, squared a cubic.
  PrinterModel model(with_lamp("0", "1"), {}, 100, 2);
  model.take(run_to(kHome, 0, 1));
  model.advance(t);
  EXPECT_NEAR(light_of(model.exposures()[0]),
              (std::pow(0.8 + 0.2 * t, 3) - std::pow(0.8, 3)) / (3 * 0.2), 1e-12);
}

// --- Light per slice

TEST(Light, OfAConstantSpeedIsTheSameInEverySlice) {
  PrinterModel model(small(), {}, 10);
  Driver driver(model);
  driver.set_points = run_to(kHome + 1000, 200, 1, 150);
  driver.send();
  model.show(frame_of(0));
  driver.until(3);
  // The ramp takes the first two slices; at 3 s the stage is at 580 um.
  ASSERT_GE(model.exposures().size(), 58);
  for (std::size_t n = 2; n < 58; ++n) {
    const auto& slice = model.exposures()[n];
    ASSERT_EQ(slice.showings.size(), 1) << n;
    EXPECT_NEAR(slice.showings[0].light_s, 10.0 / 200, kExact);
    EXPECT_NEAR(slice.showings[0].uv_mw_cm2, 150, kExact);
    EXPECT_NEAR(slice.showings[0].speed_um_s, 200, 1e-6);
    EXPECT_NEAR(slice.showings[0].from_um, 10.0 * static_cast<double>(n), 1e-6);
    EXPECT_NEAR(slice.showings[0].to_um, 10.0 * static_cast<double>(n + 1), 1e-6);
  }
}

TEST(Light, OfAnUncompensatedRampIsTooMuch) {
  // From rest x = a t²/2: slice n takes sqrt(2 L / a) (sqrt(n + 1) - sqrt(n)).
  PrinterModel model(small(), {}, 5);
  Driver driver(model);
  driver.set_points = run_to(kHome + 1000, 200, 1);
  driver.send();
  driver.until(1);
  for (std::size_t n = 0; n < 4; ++n) {
    const double k = static_cast<double>(n);
    EXPECT_NEAR(light_of(model.exposures()[n]),
                std::sqrt(2 * 5.0 / 1000) * (std::sqrt(k + 1) - std::sqrt(k)), kExact);
  }
  EXPECT_GT(light_of(model.exposures()[0]), 3.9 * 5.0 / 200);
}

TEST(Light, OfALampThatFollowsTheRampIsThatOfTheSpeed) {
  // Each cycle the share is the mean speed of the cycle to come over the speed of the print: over
  // whole cycles the light is exact. Where an edge lies within a cycle, what is missing or too much
  // is at most a c² / 8 of way on either side.
  constexpr double a = 1000, v = 200, c = 0.01, layer = 5;
  for (const double m : {1.0, 0.8}) {
    PrinterModel model(machine_of(replaced(kSmallMachine, "min_share = 0.02", "min_share = 0")), {},
                       layer, m);
    SetPoints s = run_to(kHome + 1000, v);
    for (int i = 0; i < 100; ++i) {
      const double speed = std::min(v, a * (i + 0.5) * c);
      s.blue_share = std::pow(speed / v, 1 / m);
      ++s.heartbeat;
      model.take(s);
      model.advance((i + 1) * c);
    }
    for (std::size_t n = 0; n < 20; ++n) {
      EXPECT_NEAR(light_of(model.exposures()[n]) * v, layer, 2 * a * c * c / 8 + 1e-9) << n;
    }
    for (std::size_t n = 5; n < 20; ++n) {
      EXPECT_NEAR(light_of(model.exposures()[n]) * v, layer, 1e-6) << n;
    }
  }
}

TEST(Light, LayerByLayerBelongsToTheLayerThatTheStageStandsFor) {
  PrinterModel model(small(), {});
  model.record({50, kHome, 1, true});
  Driver driver(model);
  for (int n = 0; n < 4; ++n) {
    // The stage misses its place by nearly half a layer.
    driver.set_points = run_to(kHome + 50 * (n + 1) + (n % 2 ? 24 : -24), 1000);
    driver.send();
    driver.until(model.now_s() + 5, 0.05);
    ASSERT_TRUE(model.at_rest());
    model.show(frame_of(n));
    driver.set_points.blue_share = 1;
    driver.send();
    driver.until(model.now_s() + 0.5 + 0.1 * n);
    driver.set_points.blue_share = 0;
    driver.send();
    model.show(nullptr);
    // Lifted and lowered again, dark.
    driver.set_points.target_um = kHome + 3000;
    driver.send();
    driver.until(model.now_s() + 5, 0.05);
  }
  ASSERT_EQ(model.exposures().size(), 4);
  for (std::size_t n = 0; n < 4; ++n) {
    ASSERT_EQ(model.exposures()[n].showings.size(), 1);
    EXPECT_EQ(model.exposures()[n].showings[0].image, static_cast<int>(n));
    EXPECT_NEAR(light_of(model.exposures()[n]), 0.5 + 0.1 * static_cast<double>(n), 1e-9);
  }
}

TEST(Light, KnowsWhichImageWasLitAndTellsEachOnce) {
  PrinterModel model(small(), {}, 100);
  std::vector<int> told;
  model.tell_images([&](int image, const std::shared_ptr<const Frame>& frame) {
    told.push_back(image * 1000 + frame->number);
  });
  Driver driver(model);
  driver.set_points = run_to(kHome, 0);
  driver.send();
  model.show(frame_of(5));  // never lit
  driver.until(0.1);
  model.show(frame_of(7));
  driver.set_points.blue_share = 1;
  driver.send();
  driver.until(0.2);
  model.show(frame_of(7));  // the same again
  driver.until(0.3);
  model.show(nullptr);  // black shines, too
  driver.until(0.4);
  model.show(frame_of(8));
  driver.until(0.5);
  EXPECT_THAT(told, ElementsAre(7, 1008));
  const auto& parts = model.exposures()[0].showings;
  ASSERT_EQ(parts.size(), 3);
  EXPECT_EQ(parts[0].image, 0);
  EXPECT_NEAR(parts[0].light_s, 0.2, kExact);
  EXPECT_EQ(parts[1].image, -1);
  EXPECT_NEAR(parts[1].light_s, 0.1, kExact);
  EXPECT_EQ(parts[2].image, 1);
  EXPECT_NEAR(parts[2].light_s, 0.1, kExact);
}

// --- Watchdog

TEST(Watchdog, ActsWhenTheHeartbeatStandsStillWhateverElseComes) {
  PrinterModel model(small(), {}, 10);
  SetPoints s = run_to(kHome + 1000, 200, 1, 100);
  s.heartbeat = 5;
  model.take(s);
  for (int i = 1; i < 30; ++i) {
    model.advance(i * 0.01);
    ++s.sequence;                    // set-points keep coming, the heartbeat does not change
    s.watchdog_s = i % 2 ? 100 : 0;  // and nobody talks it out of its own limit
    model.take(s);
  }
  EXPECT_EQ(model.status().state, MachineState::running);
  EXPECT_NEAR(*model.watchdog_at_s(), 0.3, kExact);
  model.advance(0.3);
  EXPECT_TRUE(model.lamps_dark());
  EXPECT_EQ(model.status().state, MachineState::fault);
  EXPECT_TRUE(model.status().watchdog_tripped);
  model.advance(2);
  EXPECT_TRUE(model.at_rest());
  EXPECT_THAT(words(model), ElementsAre("run", "uv on", "blue on", "stage moves", "watchdog",
                                        "blue off", "uv off", "fault", "stage stops"));
  EXPECT_NEAR(time_of(model, "watchdog"), 0.3, kExact);
  EXPECT_NEAR(time_of(model, "stage stops"), 0.5, kExact);
  // Nothing was lit after it.
  double light = 0;
  for (const auto& slice : model.exposures()) light += light_of(slice);
  EXPECT_NEAR(light, 0.3, kExact);
}

TEST(Watchdog, IsSoonerWhenTold) {
  PrinterModel model(small(), {});
  SetPoints s = run_to(kHome, 0, 1);
  s.watchdog_s = 0.1;
  model.take(s);
  model.advance(0.0999);
  EXPECT_FALSE(model.lamps_dark());
  model.advance(0.1);
  EXPECT_TRUE(model.lamps_dark());
}

TEST(Watchdog, SleepsWhileNothingRuns) {
  PrinterModel model(small(), {});
  SetPoints s;
  model.take(s);
  model.advance(100);
  EXPECT_EQ(model.status().state, MachineState::idle);
  EXPECT_FALSE(model.watchdog_at_s());
}

TEST(Watchdog, IsAwakeWhileALampShinesThatShouldNot) {
  PrinterModel model(small(), {parse_sim_fault("lamp-sticks@0.1s")});
  SetPoints s = run_to(kHome, 0, 1);
  model.take(s);
  model.advance(0.2);
  s.command = Command::stop;
  for (int i = 0; i < 100; ++i) {
    ++s.heartbeat;
    model.take(s);
    model.advance(0.2 + i * 0.01);
    EXPECT_EQ(model.status().state, MachineState::stopped);
    EXPECT_EQ(model.status().blue_measured, 1);
  }
  // Whoever watched it has gone, last heard of at 1.18 s.
  model.advance(1.18 + 0.2999);
  EXPECT_FALSE(model.lamps_dark());
  model.advance(1.18 + 0.3001);
  EXPECT_TRUE(model.lamps_dark());
  EXPECT_EQ(model.status().state, MachineState::fault);
}

TEST(Watchdog, KeepsTheFaultUntilReset) {
  PrinterModel model(small(), {});
  model.take(run_to(kHome, 0, 1));
  model.advance(1);
  SetPoints s = run_to(kHome + 100, 100, 1);
  s.heartbeat = 9;
  model.take(s);
  EXPECT_EQ(model.status().state, MachineState::fault);
  EXPECT_TRUE(model.lamps_dark());
  s.command = Command::off;
  model.take(s);
  EXPECT_EQ(model.status().state, MachineState::fault);
  s.command = Command::reset;
  model.take(s);
  EXPECT_EQ(model.status().state, MachineState::idle);
  EXPECT_FALSE(model.status().watchdog_tripped);
  s.command = Command::run;
  model.take(s);
  EXPECT_EQ(model.status().state, MachineState::running);
}

// --- Commands

TEST(Commands, TurnLampsOffBeforeAnythingStops) {
  for (const Command command : {Command::off, Command::stop}) {
    PrinterModel model(small(), {});
    SetPoints s = run_to(kHome + 1000, 200, 1, 100);
    model.take(s);
    model.advance(0.25);
    s.command = command;
    model.take(s);
    EXPECT_TRUE(model.lamps_dark());
    model.advance(1);
    EXPECT_TRUE(model.at_rest());
    EXPECT_EQ(model.status().state,
              command == Command::off ? MachineState::idle : MachineState::stopped);
    const std::string word = command == Command::off ? "off" : "stop";
    EXPECT_THAT(words(model), ElementsAre("run", "uv on", "blue on", "stage moves", word,
                                          "blue off", "uv off", "stage stops"));
  }
}

TEST(Commands, AreIdempotent) {
  PrinterModel model(small(), {});
  const SetPoints s = run_to(kHome + 1000, 200, 1, 100);
  model.take(s);
  const auto before = words(model);
  model.take(s);
  EXPECT_EQ(words(model), before);
  EXPECT_EQ(model.status().sequence_echo, s.sequence);
}

// --- Faults

std::vector<SimFault> faults(const std::string& text) { return {parse_sim_fault(text)}; }

TEST(Fault, IsReadAsItIsWritten) {
  const SimFault a = parse_sim_fault("stage-slips=-30.5@2.5s");
  EXPECT_EQ(a.what, "stage-slips");
  EXPECT_EQ(a.value, -30.5);
  EXPECT_EQ(a.at_s, 2.5);
  EXPECT_FALSE(a.at_frame);
  const SimFault b = parse_sim_fault("drop@frame:17");
  EXPECT_EQ(b.value, 1);
  EXPECT_EQ(b.at_frame, 17);
  EXPECT_EQ(parse_sim_fault("door").at_s, std::nullopt);
  const auto refusal = [](const std::string& text) -> std::string {
    try {
      parse_sim_fault(text);
    } catch (const InputError& e) {
      return e.what();
    }
    return "";
  };
  EXPECT_THAT(refusal("dor"), HasSubstr("did you mean 'door'?"));
  EXPECT_THAT(refusal("qwertz"), HasSubstr("expected one of late-reply, wrong-reply, drop"));
  EXPECT_THAT(refusal("drop=x"), HasSubstr("'x' is no number"));
  EXPECT_THAT(refusal("drop=-1"), HasSubstr("no number of exchanges"));
  EXPECT_THAT(refusal("wrong-reply=1.5"), HasSubstr("no number of exchanges"));
  EXPECT_THAT(refusal("stuck-stage=-1"), HasSubstr("below 0"));
  EXPECT_THAT(refusal("drop=nan"), HasSubstr("is no number"));
  EXPECT_THAT(refusal("restart=1"), HasSubstr("takes no value"));
  EXPECT_THAT(refusal("drop@"), HasSubstr("expected a moment"));
  EXPECT_THAT(refusal("drop@5"), HasSubstr("expected TIMEs or frame:N"));
  EXPECT_THAT(refusal("drop@-1s"), HasSubstr("before the beginning"));
  EXPECT_THAT(refusal("drop@frame:1.5"), HasSubstr("is no frame"));
}

TEST(Fault, AllAreInTheDocuments) {
  const std::string document =
      slicecorr::test::text_of(SLICECORR_SOURCE_DIR "/docs/printer-sim.md");
  for (const SimFaultKind& kind : sim_fault_kinds()) {
    EXPECT_THAT(document, HasSubstr("| `" + std::string(kind.name) + "` |"));
  }
}

struct Printing {
  explicit Printing(const std::string& fault) : model(small(), faults(fault), 10), driver(model) {
    driver.set_points = run_to(kHome + 1000, 200, 1, 100);
    driver.send();
    model.show(frame_of(0));
  }
  PrinterModel model;
  Driver driver;
};

TEST(Fault, StageSticks) {
  Printing p("stuck-stage=0.5@1.02s");
  p.driver.until(1.4);
  EXPECT_NEAR(p.model.status().stage_um, kHome + 184, kExact);
  EXPECT_EQ(*p.model.status().stage_speed_um_s, 0);
  EXPECT_EQ(p.model.status().state, MachineState::running);  // nothing says so
  EXPECT_FALSE(p.model.status().stage_failed);
  p.driver.until(2);
  EXPECT_NEAR(p.model.status().stage_um, kHome + 184 + 0.48 * 200, 1e-6);
  // The light of that time is where the stage stood.
  EXPECT_NEAR(light_of(p.model.exposures()[18]), 0.5 + 10.0 / 200, 1e-6);
}

TEST(Fault, StageSlips) {
  Printing p("stage-slips=-75@1s");
  p.driver.until(1);
  EXPECT_NEAR(p.model.status().stage_um, kHome + 105, 1e-6);
  p.driver.until(2);
  EXPECT_NEAR(p.model.status().stage_um, kHome + 305, 1e-6);
  EXPECT_EQ(p.model.exposures()[12].showings.size(), 2);  // passed twice
}

TEST(Fault, StageFails) {
  Printing p("stage-fails@1s");
  p.driver.until(2);
  EXPECT_NEAR(p.model.status().stage_um, kHome + 180, kExact);
  EXPECT_TRUE(p.model.status().stage_failed);
  EXPECT_FALSE(p.model.lamps_dark());  // that is the bridge's to see
}

TEST(Fault, LampFailsDriftsSticks) {
  Printing fails("lamp-fails@1s");
  fails.driver.until(1.5);
  EXPECT_EQ(fails.model.status().blue_measured, 0);
  EXPECT_TRUE(fails.model.status().lamp_failed);
  EXPECT_NEAR(*fails.model.status().uv_measured, 100, kExact);

  Printing drifts("lamp-drifts=-0.3@1s");
  drifts.driver.until(1.5);
  EXPECT_NEAR(drifts.model.status().blue_measured, 0.85, kExact);
  drifts.driver.until(3);
  EXPECT_NEAR(drifts.model.status().blue_measured, 0.7, kExact);

  Printing sticks("lamp-sticks@1s");
  sticks.driver.until(1.5);
  sticks.driver.set_points.command = Command::off;
  sticks.driver.send();
  EXPECT_EQ(sticks.model.status().blue_measured, 1);
  // Only the relay gets it off.
  sticks.model.advance(3);
  EXPECT_EQ(sticks.model.status().blue_measured, 0);
  EXPECT_TRUE(sticks.model.status().watchdog_tripped);
}

TEST(Fault, UvFails) {
  Printing p("uv-fails@1s");
  p.driver.until(1.5);
  EXPECT_EQ(*p.model.status().uv_measured, 0);
  EXPECT_EQ(p.model.status().blue_measured, 1);
  EXPECT_FALSE(p.model.status().lamp_failed);
}

TEST(Fault, InterlocksActByThemselves) {
  for (const char* fault : {"door", "stop-button", "hot=70"}) {
    Printing p(std::string(fault) + "@1s");
    p.driver.until(0.999);
    EXPECT_FALSE(p.model.lamps_dark());
    p.driver.until(2);
    EXPECT_TRUE(p.model.lamps_dark());
    EXPECT_TRUE(p.model.at_rest());
    EXPECT_EQ(p.model.status().state, MachineState::fault);
    const Status s = p.model.status();
    EXPECT_EQ(s.door_open, std::string(fault) == "door");
    EXPECT_EQ(s.stop_pressed, std::string(fault) == "stop-button");
    EXPECT_EQ(s.over_temperature, std::string(fault) == "hot=70");
    const std::string name = std::string(fault).substr(0, std::string(fault).find('='));
    EXPECT_THAT(words(p.model), ElementsAre("run", "uv on", "blue on", "stage moves", "frame 0",
                                            name, "blue off", "uv off", "fault", "stage stops"));
    // While the cause is there, nothing resets it.
    p.driver.set_points.command = Command::reset;
    p.driver.send();
    EXPECT_EQ(p.model.status().state, MachineState::fault);
  }
  Printing p("door=0.5@1s");
  p.driver.until(2);
  EXPECT_FALSE(p.model.status().door_open);
  EXPECT_EQ(p.model.status().state, MachineState::fault);
  p.driver.set_points.command = Command::reset;
  p.driver.send();
  EXPECT_EQ(p.model.status().state, MachineState::idle);
}

TEST(Fault, Restart) {
  Printing p("restart@1s");
  p.driver.until(1);
  p.driver.until(2);
  const Status s = p.model.status();
  EXPECT_EQ(s.state, MachineState::idle);  // runs only after it was told not to
  EXPECT_NEAR(*s.machine_time_s, 1, kExact);
  EXPECT_TRUE(p.model.lamps_dark());
  p.driver.set_points.command = Command::off;
  p.driver.send();
  p.driver.set_points.command = Command::run;
  p.driver.send();
  EXPECT_EQ(p.model.status().state, MachineState::running);
}

TEST(Fault, AtAFrameComesWithIt) {
  Printing p("door@frame:3");
  p.driver.until(0.5);
  p.model.show(frame_of(2));
  EXPECT_FALSE(p.model.status().door_open);
  p.model.show(frame_of(3));
  EXPECT_TRUE(p.model.status().door_open);
}

TEST(Fault, DisplayFreezes) {
  Printing p("freeze-display@frame:3");
  p.driver.until(0.5);
  p.model.show(frame_of(2));
  p.model.show(frame_of(3));
  EXPECT_EQ(p.model.display().number, 2);
  EXPECT_EQ(p.model.display().count, 2);
  p.model.show(nullptr);
  EXPECT_EQ(p.model.display().number, 2);
}

TEST(Fault, FrameIsLate) {
  Printing p("late-frame=0.05@frame:3");
  p.driver.until(0.5);
  p.model.show(frame_of(3));
  EXPECT_EQ(p.model.display().number, 0);
  ASSERT_TRUE(p.model.display().later_s);
  EXPECT_NEAR(*p.model.display().later_s, 0.55, kExact);
  p.driver.until(0.6);
  EXPECT_EQ(p.model.display().number, 3);
  EXPECT_NEAR(p.model.display().since_s, 0.55, kExact);
  p.model.show(frame_of(4));  // only one was late
  EXPECT_EQ(p.model.display().number, 4);
}

TEST(Fault, WireFaultsAreAskedForOncePerExchange) {
  Printing p("drop=3@1s");
  p.driver.until(0.99);
  EXPECT_FALSE(p.model.wire_fault());
  p.driver.until(1);
  for (int i = 0; i < 3; ++i) {
    const auto fault = p.model.wire_fault();
    ASSERT_TRUE(fault);
    EXPECT_EQ(fault->what, "drop");
  }
  EXPECT_FALSE(p.model.wire_fault());
  EXPECT_THAT(words(p.model), Contains("drop").Times(3));
  EXPECT_FALSE(p.model.lamps_dark());
}

}  // namespace
}  // namespace slicecorr::bridge
