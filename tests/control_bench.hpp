// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// A bridge without threads and wires against a model of a printer, in steps; time is the model's.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "slicecorr/bridge/control.hpp"
#include "slicecorr/bridge/model.hpp"

namespace slicecorr::bridge::test {

inline Machine test_machine() {
  Machine m = load_machine(std::string(SLICECORR_PRINTERS_DIR) + "/dual-wavelength-dlp.toml");
  m.uv.warm_up_s = 0.2;  // prints of some seconds
  return m;
}

/// 40 slices of 50 um at 1000 mm/h, all lit but `dark`.
inline PrintPlan continuous_plan(const Machine& m, bool follow, bool uv, int first_dark = 0,
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

inline PrintPlan layerwise_plan(const Machine& m, int layers = 6) {
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
      const ControlStep step = controller.step(answer_, now_s);
      for (const PrintEvent& e : step.events) events.push_back(e);
      for (const FrameRecord& r : step.records) records.push_back(r);
      sent.push_back(step.set_points);
      answer_ = exchange(step.set_points);
      if (noise && noise()) answer_.reset();
      check_light();
      if (step.finished) return;
      if (step.show) due_ = {*step.show, step.show_at_s};
      if (step.show_uv) uv_due_ = {*step.show_uv, step.show_uv_at_s};
      // In the order of their times; blue first where they are the same.
      const bool uv_first = uv_due_ && due_ && uv_due_->at_s < due_->at_s - early_s;
      if (uv_first) show_uv_due(now_s + cycle);
      show_due(now_s + cycle);
      show_uv_due(now_s + cycle);
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
    for (const PrintEvent& e : events) {
      if (e.what == what) return e.at_s;
    }
    return -1;
  }

  double now_s = 0;
  double uv_short_s = 0;  ///< longest time with light without the UV that it needs
  bool display_gone = false;
  std::function<bool()> noise;  ///< whether the answer of this cycle can't be read
  double early_s = 0;           ///< by which frames appear before their time
  double stage_speed = 1;       ///< share of what it is told at which the stage goes while printing
  std::vector<PrintEvent> events;
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

  void show_uv_due(double until_s) {
    if (!uv_due_ || uv_due_->at_s >= until_s) return;
    const auto due = *std::exchange(uv_due_, {});
    model.advance(std::max(model.now_s(), due.at_s));
    std::shared_ptr<Frame> frame;
    if (due.number >= 0) {
      frame = std::make_shared<Frame>();
      frame->number = due.number;
      frame->width_px = frame->height_px = 1;
      frame->blue = {200};
      frame->crc32 = static_cast<std::uint32_t>(due.number);
    }
    model.show_uv(frame);
    const auto& display = model.uv_display();
    if (display.gone) return controller.fail(Fault::display_gone, "the UV display: no answer");
    if (display.later_s) model.advance(*display.later_s);
    if (display.number != due.number) {
      return controller.fail(Fault::wrong_frame, "the UV display: another image");
    }
    FrameReport report{display.number, display.since_s, false};
    report.on_uv_display = true;
    controller.shown(report);
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
  std::optional<Due> due_, uv_due_;
  std::optional<Answer> answer_;
  double cut_until_s_ = -1, short_since_s_ = -1;
};

/// Lamps off, then the stage stops, then black, as the machine saw it and as the bridge sent it.
inline void expect_order(const Bench& b, double since_s, bool machine_acts, bool link_lives,
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

}  // namespace slicecorr::bridge::test
