// The controller against a model of a printer, in one process and in steps: whole prints, every
// fault of the policy at random moments, pauses. Time is the model's.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <random>
#include <utility>

#include "control/motion.hpp"
#include "slicecorr/bridge/control.hpp"
#include "slicecorr/bridge/model.hpp"

namespace slicecorr::bridge {
namespace {

Machine test_machine() {
  Machine m = load_machine(std::string(SLICECORR_PRINTERS_DIR) + "/dual-wavelength-dlp.toml");
  m.uv.warm_up_s = 0.2;  // prints of some seconds
  return m;
}

/// 40 slices of 50 um at 1000 mm/h, all lit but `dark`.
PrintPlan continuous_plan(const Machine& m, bool follow, bool uv, int first_dark = 0,
                          int end_dark = 0) {
  PrintPlan p;
  p.layer_um = 50;
  p.speed_um_s = 1000 / 3.6;
  p.acceleration_um_s2 = m.stage.acceleration_um_s2;
  p.ramp_um = p.speed_um_s * p.speed_um_s / (2 * p.acceleration_um_s2);
  p.ramp = follow ? Ramp::lamp_follows : Ramp::outside;
  if (follow) {
    p.ramp_um = 400;
    p.acceleration_um_s2 = p.speed_um_s * p.speed_um_s / 800;
  } else {
    p.run_up_um = p.ramp_um + 4 * m.limits.cycle_s * p.speed_um_s;
  }
  p.uv = uv;
  p.uv_max_mw_cm2 = m.printer.uv->max_mw_cm2();
  p.frames.resize(40);
  for (int n = 0; n < 40; ++n) {
    FramePlan& f = p.frames[static_cast<std::size_t>(n)];
    f.lit = n < first_dark || n >= end_dark;
    f.uv_mw_cm2 = uv ? 200 : 0;
    f.least_uv_mw_cm2 = uv && f.lit ? 137 : 0;
  }
  p.start_um = m.stage.home_um + p.run_up_um;
  p.end_um = p.start_um + 40 * p.layer_um;
  p.black_mw_cm2 = 1;
  return p;
}

PrintPlan layerwise_plan(const Machine& m, int layers = 6) {
  PrintPlan p;
  p.mode = ExposureMode::layerwise;
  p.layer_um = 50;
  p.speed_um_s = m.stage.lift_speed_um_s;
  p.acceleration_um_s2 = m.stage.acceleration_um_s2;
  p.uv_max_mw_cm2 = m.printer.uv->max_mw_cm2();
  p.frames.resize(static_cast<std::size_t>(layers));
  for (FramePlan& f : p.frames) f = {true, 0, 0, 1.5};
  p.start_um = m.stage.home_um;
  p.end_um = p.start_um + layers * p.layer_um;
  return p;
}

/// A bridge without threads and wires: what run_print does in lockstep.
class Bench {
 public:
  Bench(const Machine& machine, const PrintPlan& plan, std::vector<SimFault> faults = {},
        bool dry_run = false)
      : machine_(machine),
        plan_(plan),
        model(machine, std::move(faults)),
        controller(plan, machine, dry_run) {
    model.record({plan.layer_um, plan.start_um, plan.m, plan.mode == ExposureMode::layerwise});
  }

  /// Until the print has ended; `each` is called after every cycle.
  void run(const std::function<void()>& each = {}, double limit_s = 600) {
    const double cycle = machine_.limits.cycle_s;
    for (std::int64_t k = 0;; ++k) {
      now_s = static_cast<double>(k) * cycle;
      if (now_s > limit_s) {
        ADD_FAILURE() << "no end; phase " << name_of(controller.phase());
        return;
      }
      model.advance(now_s);
      const Step step = controller.step(answer_, now_s);
      for (const Event& e : step.events) events.push_back(e);
      for (const FrameRecord& r : step.records) records.push_back(r);
      sent.push_back(step.set_points);
      answer_ = exchange(step.set_points);
      check_light();
      if (step.finished) return;
      if (step.show >= -1) due_ = {step.show, step.show_at_s};
      show_due(now_s + cycle);
      if (each) each();
    }
  }

  std::vector<std::string> machine_events(const std::vector<std::string>& of) const {
    std::vector<std::string> found;
    for (const SimEvent& e : model.events()) {
      if (std::find(of.begin(), of.end(), e.what) != of.end()) found.push_back(e.what);
    }
    return found;
  }
  double machine_time(const std::string& what, double after_s = 0) const {
    for (const SimEvent& e : model.events()) {
      if (e.at_s >= after_s && e.what == what) return e.at_s;
    }
    return -1;
  }
  double event_time(const std::string& what) const {
    for (const Event& e : events) {
      if (e.what == what) return e.at_s;
    }
    return -1;
  }

  double now_s = 0;
  double uv_short_s = 0;  ///< longest time with light without the UV that it needs
  bool display_gone = false;
  double early_s = 0;      ///< by which frames appear before their time
  double stage_speed = 1;  ///< share of what it is told at which the stage goes while printing
  std::vector<Event> events;
  std::vector<FrameRecord> records;
  std::vector<SetPoints> sent;

 private:
  const Machine machine_;
  const PrintPlan plan_;

 public:
  PrinterModel model;
  Controller controller;

 private:
  std::optional<Answer> exchange(const SetPoints& out) {
    if (now_s < cut_until_s_) return {};
    const auto fault = model.wire_fault();
    if (fault && fault->what == "disconnect") {
      cut_until_s_ = now_s + std::max(fault->value, machine_.limits.cycle_s);
      return {};
    }
    // As registers have it.
    SetPoints taken = decode_set_points(*machine_.modbus, encode(*machine_.modbus, out));
    if (controller.phase() == Phase::printing) taken.speed_um_s *= stage_speed;
    model.take(taken);
    if (fault) return {};  // late, dropped or wrong: carried out and not known
    return Answer{decode_status(*machine_.modbus, encode(*machine_.modbus, model.status())), now_s};
  }

  void show_due(double until_s) {
    if (!due_ || due_->at_s - early_s >= until_s || display_gone) return;
    const auto due = *std::exchange(due_, {});
    model.advance(std::max(model.now_s(), due.at_s - (due.number > 0 ? early_s : 0)));
    std::shared_ptr<Frame> frame;
    if (due.number >= 0) {
      frame = std::make_shared<Frame>();
      frame->number = due.number;
      frame->width_px = frame->height_px = 1;
      frame->blue = {255};
      frame->crc32 = static_cast<std::uint32_t>(due.number);
    }
    model.show(frame);
    const auto& display = model.display();
    if (display.gone) {
      display_gone = true;
      controller.fail(Fault::display_gone, "no answer");
    } else if (display.later_s) {
      model.advance(*display.later_s);  // as a display that answers when it is done
      controller.shown({display.number, display.since_s, false});
    } else if (display.number != due.number) {
      controller.fail(Fault::wrong_frame, "another image");
    } else {
      controller.shown({display.number, display.since_s, false});
    }
  }

  /// What the window sees: blue light without its UV light, for how long.
  void check_light() {
    const Status s = model.status();
    const int frame = model.display().number;
    const double least =
        frame >= 0 ? plan_.frames[static_cast<std::size_t>(frame)].least_uv_mw_cm2 : 0;
    const bool short_of =
        plan_.uv && s.blue_measured > 0.001 && s.uv_measured.value_or(0) < least * s.blue_measured;
    short_since_s_ = short_of ? (short_since_s_ < 0 ? now_s : short_since_s_) : -1;
    if (short_of) uv_short_s = std::max(uv_short_s, now_s - short_since_s_);
  }

  struct Due {
    int number;
    double at_s;
  };
  std::optional<Due> due_;
  std::optional<Answer> answer_;
  double cut_until_s_ = -1, short_since_s_ = -1;
};

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
      for (const auto& part : slices[static_cast<std::size_t>(n)].parts) {
        (part.image == n ? right : wrong) += part.light_s;
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
    for (const auto& part : slices[static_cast<std::size_t>(n)].parts) {
      if (part.image != n) continue;
      light += part.light_s;
      EXPECT_NEAR(part.from_um, (n + 1) * 50.0, 0.5);
      EXPECT_NEAR(part.speed_um_s, 0, 1e-6);
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

/// Lamps off, then the stage stops, then black, as the machine saw it and as the bridge sent it.
void expect_order(const Bench& b, double since_s, bool machine_acts, bool link_lives,
                  bool display_lives) {
  // What was sent: the first set-points without light come before the first stop.
  std::size_t dark = b.sent.size(), stop = b.sent.size();
  for (std::size_t i = 0; i < b.sent.size(); ++i) {
    const SetPoints& s = b.sent[i];
    if (s.command == Command::stop && stop == b.sent.size()) stop = i;
  }
  ASSERT_LT(stop, b.sent.size()) << "the stage was never told to stop";
  for (std::size_t i = stop; i-- > 0;) {
    if (b.sent[i].blue_share > 0 || b.sent[i].uv_mw_cm2 > 0) break;
    dark = i;
  }
  EXPECT_LT(dark, stop) << "no cycle with lamps off and the stage going on";
  for (std::size_t i = dark; i < b.sent.size(); ++i) {
    EXPECT_EQ(b.sent[i].blue_share, 0);
    EXPECT_EQ(b.sent[i].uv_mw_cm2, 0);
  }
  // What the bridge did.
  const double off = b.event_time("lamps off"), stopped = b.event_time("stage stop"),
               black = b.event_time("black"), failed = b.event_time("phase failed");
  ASSERT_GE(off, 0);
  EXPECT_LT(off, stopped);
  EXPECT_LT(stopped, black);
  EXPECT_LE(black, failed);
  EXPECT_LE(b.event_time("fault " + std::string(name_of(b.controller.fault()))), off);
  // What the machine did.
  if (link_lives) {
    const double told = b.machine_time("stop", since_s);
    EXPECT_GE(told, 0);
    double last_light = -1;
    for (const SimEvent& e : b.model.events()) {
      if (e.what == "blue off" || e.what == "uv off") last_light = e.at_s;
      if (e.what == "blue on" || e.what == "uv on") {
        EXPECT_LT(e.at_s, told);
      }
    }
    EXPECT_LE(last_light, told) << "lamps were on when the stage was told to stop";
    if (display_lives) {
      EXPECT_GE(b.machine_time("black", told), told);
    }
  }
  (void)machine_acts;
  EXPECT_TRUE(b.model.lamps_dark());
  if (display_lives) {
    EXPECT_EQ(b.model.display().number, -1);
  }
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
  EXPECT_NE(b.controller.fault_detail().find("A LAMP STILL SHINES"), std::string::npos);
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
      for (const auto& part : b.model.exposures()[static_cast<std::size_t>(n)].parts) {
        if (part.image >= 0) light += part.light_s;
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
    for (const auto& part : b.model.exposures()[static_cast<std::size_t>(n)].parts) {
      if (part.image >= 0) light += part.light_s;
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
    for (const auto& part : b.model.exposures()[static_cast<std::size_t>(n)].parts) {
      if (part.image >= 0) light += part.light_s;
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
