// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// UV images on a display of their own: shown together with the blue ones, each judged by itself,
// and dark after blue light is off.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <random>

#include "control_bench.hpp"
#include "frames/wire.hpp"
#include "slicecorr/bridge/display.hpp"
#include "slicecorr/bridge/frames.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::bridge {
namespace {

using namespace test;
using testing::AllOf;
using testing::HasSubstr;

std::string file_text(const std::string& path) {
  std::ifstream in(path);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// The shipped printer's file with patterned UV light and `more`.
std::string patterned_text(const std::string& more) {
  std::string text = file_text(std::string(SLICECORR_PRINTERS_DIR) + "/dual-wavelength-dlp.toml");
  const auto kind = text.find("kind = \"flood\"");
  EXPECT_NE(kind, std::string::npos);
  text.replace(kind, 14, "kind = \"patterned\"");
  return text + "\n" + more;
}
Machine patterned(const std::string& more) { return parse_machine(patterned_text(more), "m.toml"); }
std::string refusal_of(const std::string& text) {
  try {
    parse_machine(text, "m.toml");
  } catch (const InputError& e) {
    return e.what();
  }
  return "";
}

Machine two_displays(double uv_latency_s = 0, double latency_s = 0) {
  Machine m = test_machine();
  m.limits.display_latency_s = latency_s;
  m.uv_display =
      UvDisplay{m.printer.width_px, m.printer.height_px, {}, uv_latency_s, Channel::all, ""};
  return m;
}

TEST(UvDisplay, IsAsTheBlueOneWhereTheFileDoesNotSay) {
  const Machine m = patterned("[uv_display]\n");
  ASSERT_TRUE(m.uv_display);
  EXPECT_EQ(m.uv_display->width_px, 1280);
  EXPECT_EQ(m.uv_display->height_px, 800);
  EXPECT_EQ(m.uv_display->orientation, m.printer.orientation.value_or(Orientation{}));
  EXPECT_EQ(m.uv_display->latency_s, m.limits.display_latency_s);
  EXPECT_EQ(m.uv_display->channel, Channel::all);
  // Blue images have a display for themselves.
  EXPECT_EQ(m.projector.blue, Channel::all);
  EXPECT_FALSE(patterned("").uv_display);
  EXPECT_EQ(patterned("").projector.blue, Channel::blue);

  const Machine other = patterned(
      "[uv_display]\nwidth_px = 800\nheight_px = 1280\norientation = \"portrait\"\nmirror = "
      "\"y\"\nlatency_s = 0.02\nchannel = \"red\"\noutput = \"HDMI-A-2\"\n");
  EXPECT_EQ(other.uv_display->width_px, 800);
  EXPECT_TRUE(other.uv_display->orientation.portrait);
  EXPECT_TRUE(other.uv_display->orientation.mirror_y);
  EXPECT_FALSE(other.uv_display->orientation.mirror_x);
  // Portrait alone says the size, too.
  EXPECT_EQ(patterned("[uv_display]\norientation = \"portrait\"\n").uv_display->height_px, 1280);
  const Machine as_seen = uv_display_machine(other);
  EXPECT_EQ(as_seen.printer.width_px, 800);
  EXPECT_EQ(as_seen.printer.height_px, 1280);
  EXPECT_EQ(as_seen.projector.blue, Channel::red);
  EXPECT_EQ(as_seen.projector.output, "HDMI-A-2");
  EXPECT_EQ(as_seen.limits.display_latency_s, 0.02);
  EXPECT_FALSE(as_seen.printer.uv);
}

TEST(UvDisplay, WhatMakesNoSenseIsRefusedByItsKey) {
  const auto refused = [](const std::string& keys, const std::string& a, const std::string& b) {
    SCOPED_TRACE(keys);
    EXPECT_THAT(refusal_of(patterned_text("[uv_display]\n" + keys)),
                AllOf(HasSubstr("m.toml"), HasSubstr(a), HasSubstr(b)));
  };
  refused("width_px = 1024", "width_px", "expected 1280 x 800");
  refused("height_px = 0", "height_px", "0");
  refused("orientation = \"portrait\"\nwidth_px = 1280", "width_px", "expected 800 x 1280");
  refused("orientation = \"upright\"", "orientation", "landscape");
  refused("mirror = \"z\"", "mirror", "\"xy\"");
  refused("latency_s = -1", "latency_s", "-1");
  refused("latency_s = 2", "latency_s", "2");
  refused("channel = \"uv\"", "channel", "uv");
  refused("pixel_um = 50", "pixel_um", "unknown key");
  refused("[projector]\nuv = \"red\"", "uv", "[uv_display]");
  // Light that floods the window is on no display.
  EXPECT_THAT(
      refusal_of(file_text(std::string(SLICECORR_PRINTERS_DIR) + "/dual-wavelength-dlp.toml") +
                 "\n[uv_display]\n"),
      AllOf(HasSubstr("uv_display"), HasSubstr("patterned")));
  EXPECT_THROW(uv_display_like_blue(test_machine()), InputError);
  EXPECT_THROW(uv_display_like_blue(load_machine(std::string(SLICECORR_PRINTERS_DIR) +
                                                 "/model-tomography-bench.toml")),
               InputError);
}

TEST(UvDisplay, SinksAreLookedAtTogether) {
  EXPECT_NO_THROW(check_sinks({"window", "drm:card1", "unix:/tmp/a", "null", "null"}, false));
  EXPECT_THROW(check_sinks({"window:0", "window:1"}, false), InputError);
  EXPECT_THROW(check_sinks({"unix:/tmp/a", "unix:/tmp/a"}, false), InputError);
  EXPECT_THROW(check_sinks({"unix:/tmp/a", "lp0"}, false), InputError);
  EXPECT_THROW(check_sinks({"drm"}, true), InputError);
}

/// Event names of the model that are of displays and lamps, in order.
std::vector<std::string> seen(const Bench& b) {
  std::vector<std::string> found;
  for (const SimEvent& e : b.model.events()) {
    if (e.what.find("frame ") != std::string::npos || e.what.ends_with("black") ||
        e.what.starts_with("blue") || e.what.starts_with("uv o")) {
      found.push_back(e.what);
    }
  }
  return found;
}

TEST(UvDisplay, BothShowEachFrameAtItsMoment) {
  for (const double uv_latency_s : {0.0, 0.03}) {
    for (const double latency_s : {0.0, 0.015}) {
      for (const bool follow : {false, true}) {
        SCOPED_TRACE(fmt::format("latencies {} {} follow {}", latency_s, uv_latency_s, follow));
        const Machine m = two_displays(uv_latency_s, latency_s);
        const PrintPlan plan = continuous_plan(m, follow, true);
        Bench b(m, plan);
        b.run();
        ASSERT_EQ(b.controller.fault(), Fault::none) << b.controller.fault_detail();
        ASSERT_EQ(b.records.size(), 40U);
        const double ramp = 0.5 * plan.acceleration_um_s2 * std::pow(4 * m.limits.cycle_s, 2);
        for (const FrameRecord& r : b.records) {
          ASSERT_TRUE(r.uv_shown_s && r.uv_stage_um) << r.frame;
          EXPECT_NEAR(r.stage_um, r.planned_um, 0.05 + ramp) << r.frame;
          EXPECT_NEAR(*r.uv_stage_um, r.planned_um, 0.05 + ramp) << r.frame;
          // Light of both begins at the same moment.
          EXPECT_NEAR(r.shown_s, *r.uv_shown_s, 1e-9) << r.frame;
        }
        // Black first on both, UV images to the end: blue light is off before UV, and that before
        // the UV display goes dark.
        int next = 0, next_uv = 0;
        for (const std::string& what : seen(b)) {
          if (what.starts_with("frame ")) {
            EXPECT_EQ(what, fmt::format("frame {}", next++));
          }
          if (what.starts_with("uv frame ")) {
            EXPECT_EQ(what, fmt::format("uv frame {}", next_uv++));
          }
        }
        EXPECT_EQ(next, 40);
        EXPECT_EQ(next_uv, 40);
        EXPECT_LT(b.machine_time("uv black"), b.machine_time("uv on"));
        const double last = b.machine_time("uv frame 39");
        const double blue_off = b.machine_time("blue off", last);
        EXPECT_GT(blue_off, 0);
        EXPECT_LE(blue_off, b.machine_time("uv off", last));
        EXPECT_LE(b.machine_time("uv off", last), b.machine_time("uv black", last));
        EXPECT_EQ(b.model.uv_display().number, kBlackFrame);
      }
    }
  }
}

TEST(UvDisplay, LayerByLayerItStaysUntilBlueLightIsOff) {
  const Machine m = two_displays(0.02);
  PrintPlan plan = layerwise_plan(m);
  plan.uv = true;
  for (FramePlan& f : plan.frames) f.uv_mw_cm2 = 200;
  Bench b(m, plan);
  b.run();
  ASSERT_EQ(b.controller.fault(), Fault::none) << b.controller.fault_detail();
  ASSERT_EQ(b.records.size(), 6U);
  for (const FrameRecord& r : b.records) {
    EXPECT_TRUE(r.uv_shown_s) << r.frame;
    EXPECT_NEAR(*r.exposed_s, 1.5, 0.02) << r.frame;
  }
  // Each exposure ends with black on the blue display alone.
  std::string text;
  for (const std::string& what : seen(b)) text += what + ",";
  EXPECT_THAT(text, HasSubstr("uv frame 0,frame 0,blue on,black,blue off,"));
  EXPECT_THAT(text, HasSubstr("blue off,uv off,uv black,"));
  const auto count = [&](const std::string& what) { return b.machine_events({what}).size(); };
  EXPECT_EQ(count("uv black"), 2U);  // at the beginning and at the end
  EXPECT_EQ(count("black"), 7U);
}

TEST(UvDisplay, PausesDarkensBothAndGoesOnWithBoth) {
  const Machine m = two_displays(0.01);
  const PrintPlan plan = layerwise_plan(m);
  Bench b(m, plan);
  bool asked = false, resumed = false;
  b.run([&] {
    if (!asked && b.controller.frame() == 2) asked = b.controller.pause().accepted;
    if (!resumed && b.controller.phase() == Phase::paused) {
      EXPECT_EQ(b.model.display().number, kBlackFrame);
      EXPECT_EQ(b.model.uv_display().number, kBlackFrame);
      resumed = b.controller.resume().accepted;
    }
  });
  EXPECT_TRUE(resumed);
  EXPECT_EQ(b.controller.fault(), Fault::none) << b.controller.fault_detail();
  EXPECT_EQ(b.controller.frames_shown(), 6);
}

struct UvFault {
  const char* text;
  Fault fault;
  const char* words;
  bool uv_lives;
};

TEST(UvDisplay, ItsFaultsAreItsOwnAndEndInTheOrder) {
  std::mt19937 random(7);
  for (const UvFault& c : {UvFault{"late-uv-frame=0.2", Fault::late_frame, "UV frame", true},
                           UvFault{"freeze-uv-display", Fault::wrong_frame, "UV display", false},
                           UvFault{"uv-display-gone", Fault::display_gone, "UV display", false}}) {
    for (int i = 0; i < 12; ++i) {
      const int at = std::uniform_int_distribution<>(1, 35)(random);
      const bool follow = i % 2 == 0;
      const std::string text = fmt::format("{}@frame:{}", c.text, at);
      SCOPED_TRACE(fmt::format("{} follow {}", text, follow));
      const Machine m = two_displays();
      Bench b(m, continuous_plan(m, follow, true), {parse_sim_fault(text)});
      b.run();
      EXPECT_EQ(b.controller.fault(), c.fault) << b.controller.fault_detail();
      EXPECT_THAT(b.controller.fault_detail(), HasSubstr(c.words));
      const std::string what = c.text;
      const double since = b.machine_time(what.substr(0, what.find('=')));
      ASSERT_GE(since, 0);
      // The blue image of that frame came in time.
      EXPECT_GE(b.machine_time(fmt::format("frame {}", at)), 0);
      expect_order(b, since, false, true, true);
      EXPECT_LE(b.uv_short_s, m.blue.settle_s + m.uv.settle_s + 5 * m.limits.cycle_s);
      // Blue is dark before the UV display is told to be.
      EXPECT_LE(b.event_time("black"), b.event_time("UV black"));
      EXPECT_LE(b.event_time("UV black"), b.event_time("phase failed"));
      if (!c.uv_lives) continue;
      const double stop = b.machine_time("stop", since);
      EXPECT_LE(b.machine_time("black", stop), b.machine_time("uv black", stop));
      EXPECT_EQ(b.model.uv_display().number, kBlackFrame);
    }
  }
}

TEST(UvDisplay, FaultsOfTheBlueDisplayDarkenBoth) {
  for (const std::string what : {"late-frame=0.2", "door", "stage-fails", "lamp-fails"}) {
    SCOPED_TRACE(what);
    const Machine m = two_displays();
    Bench b(m, continuous_plan(m, false, true), {parse_sim_fault(what + "@frame:11")});
    b.run();
    EXPECT_NE(b.controller.fault(), Fault::none);
    EXPECT_EQ(b.controller.fault_detail().find("UV"), std::string::npos)
        << b.controller.fault_detail();
    EXPECT_EQ(b.model.display().number, kBlackFrame);
    EXPECT_EQ(b.model.uv_display().number, kBlackFrame);
    EXPECT_LE(b.event_time("black"), b.event_time("UV black"));
  }
}

TEST(UvDisplay, LateFramesThatAreBorneAreRecordedForEachDisplay) {
  Machine m = two_displays();
  m.limits.max_late_frames = 3;
  m.limits.max_late_um = 5;
  Bench b(m, continuous_plan(m, false, true), {parse_sim_fault("late-uv-frame=0.05@frame:9")});
  b.run();
  EXPECT_EQ(b.controller.fault(), Fault::none) << b.controller.fault_detail();
  EXPECT_EQ(b.controller.late_frames(), 1);
  const FrameRecord& r = b.records.at(9);
  EXPECT_NEAR(r.stage_um, r.planned_um, 0.5);
  // 50 ms at 1000 mm/h.
  EXPECT_NEAR(*r.uv_stage_um - r.planned_um, 0.05 * 1000 / 3.6, 0.5);
  const auto late = std::find_if(b.events.begin(), b.events.end(),
                                 [](const PrintEvent& e) { return e.what == "late UV frame"; });
  EXPECT_NE(late, b.events.end());
}

TEST(UvDisplay, TheModelTellsWhatBothShowed) {
  Machine m = two_displays();
  PrinterModel model(m, {}, 50, 1);
  std::vector<std::pair<int, int>> lit;
  model.tell_images([&](int, const std::shared_ptr<const Frame>& f) {
    lit.emplace_back(f->number, f->on_uv_display ? f->on_uv_display->number : kBlackFrame);
  });
  SetPoints on;
  on.command = Command::run;
  on.blue_share = 1;
  on.uv_mw_cm2 = 100;
  const auto frame = [](int n) {
    auto f = std::make_shared<Frame>();
    f->number = n;
    f->width_px = f->height_px = 1;
    f->blue = {7};
    f->crc32 = static_cast<std::uint32_t>(n);
    return f;
  };
  const auto feed = [&](double until_s) {
    ++on.sequence;
    ++on.heartbeat;
    model.take(on);
    model.advance(until_s);
  };
  feed(0.1);
  model.show(frame(0));
  model.show_uv(frame(0));
  feed(0.2);
  model.show(frame(1));
  feed(0.21);  // the UV image comes 10 ms later
  model.show_uv(frame(1));
  feed(0.3);
  model.show_uv(frame(1));  // the same again is no new one
  feed(0.4);
  EXPECT_EQ(lit, (std::vector<std::pair<int, int>>{{0, 0}, {1, 0}, {1, 1}}));
}

TEST(UvDisplay, HelloSaysOfWhichDisplayItIs) {
  WireHello hello;
  hello.setup.printer = test_machine().printer;
  hello.setup.resin = load_resin(std::string(SLICECORR_DB_DIR) + "/custom-resin-1.toml");
  hello.setup.process.speed_mm_h = 300;
  hello.layer_um = 50;
  hello.slices = 3;
  EXPECT_FALSE(hello_of(message_of(hello)).uv_display);
  hello.uv_display = true;
  EXPECT_TRUE(hello_of(message_of(hello)).uv_display);
}

}  // namespace
}  // namespace slicecorr::bridge
