// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The order and times of page flips on a card that stands in for the kernel's.

#include <gmock/gmock.h>

#include <functional>

#include "bridge_displays.hpp"
#include "display/drm_sink.hpp"
#include "display/pixels.hpp"
#include "drm_substitute.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::bridge {
namespace {

using namespace slicecorr::test;
using testing::ElementsAre;
using testing::HasSubstr;

class BridgeDrm : public testing::Test {
 protected:
  BridgeDrm() {
    DrmConnector none, hdmi, dp;
    none.id = 70;
    none.name = "VGA-1";
    hdmi.id = 71;
    hdmi.name = "HDMI-A-1";
    hdmi.connected = true;
    hdmi.modes = {drm_mode(1920, 1080, 60), drm_mode(kWidthPx, kHeightPx, 50),
                  drm_mode(kWidthPx, kHeightPx, kHz), drm_mode(kWidthPx, kHeightPx, 30),
                  drm_mode(kWidthPx, kHeightPx, 120, true)};
    hdmi.crtcs = {40, 41};
    dp.id = 72;
    dp.name = "DP-1";
    dp.connected = true;
    dp.modes = {drm_mode(800, 600, 60)};
    dp.crtcs = {40, 41};
    card.connectors = {none, hdmi, dp};
    // The console, as it was.
    card.crtcs[40] = {true, 900, 0, 0, drm_mode(1920, 1080, 60), {71}};
    card.crtcs[41] = {true, 901, 0, 0, drm_mode(800, 600, 60), {72}};
  }
  std::unique_ptr<FrameSink> open(const std::string& connector = "") {
    return detail::make_drm_sink(std::make_unique<SubstituteDrm>(card), connector, machine, clock);
  }
  std::vector<std::string> take_calls() { return std::exchange(card.calls, {}); }
  /// What is scanned out, without the ends of its rows.
  std::vector<std::uint32_t> seen() const {
    std::vector<std::uint32_t> pixels;
    const auto& all = card.seen();
    for (std::size_t y = 0; y < kHeightPx; ++y) {
      const auto row = all.begin() + static_cast<std::ptrdiff_t>(y * (kWidthPx + 16));
      pixels.insert(pixels.end(), row, row + kWidthPx);
    }
    return pixels;
  }
  std::vector<std::uint32_t> picture_of(const Frame* frame) const {
    std::vector<std::uint32_t> pixels(kWidthPx * kHeightPx);
    pack(frame, machine.projector, kWidthPx, kHeightPx, pixels.data(), kWidthPx);
    return pixels;
  }

  DrmCard card;
  Machine machine = machine_of();
  CardClock clock{card};
};

TEST_F(BridgeDrm, TheWholeOrderOfCalls) {
  card.gamma = {{0, 5, 65535}, {0, 5, 65535}, {0, 5, 65535}};
  card.properties = {
      {1, "DPMS", 3, {{"On", 0}, {"Off", 3}}},
      {2, "Broadcast RGB", 0, {{"Automatic", 0}, {"Full", 1}, {"Limited 16:235", 2}}},
      {3, "scaling mode", 0, {{"None", 0}, {"Full", 1}}},
      {4, "Colorspace", 2, {{"Default", 0}}}};
  const DrmGamma gamma = card.gamma;
  auto sink = open();
  EXPECT_THAT(take_calls(),
              ElementsAre("master", "make A", "make B", "make C", "crtc 40 buffer C 40x30 60 Hz",
                          "gamma", "DPMS = 0", "Broadcast RGB = 1"));
  EXPECT_EQ(seen(), picture_of(nullptr)) << "black first";
  EXPECT_THAT(card.gamma.red, ElementsAre(0, 32768, 65535));
  EXPECT_EQ(card.gamma.green, card.gamma.red);
  EXPECT_EQ(card.gamma.blue, card.gamma.red);
  EXPECT_THAT(sink->describe(), HasSubstr("HDMI-A-1"));

  for (int n = 0; n < 3; ++n) {
    const auto frame = noise(n);
    sink->show(frame, 0);
    EXPECT_EQ(seen(), picture_of(frame.get()));
  }
  EXPECT_THAT(take_calls(), ElementsAre("flip 40 A", "flip 40 B", "flip 40 A"));
  sink.reset();
  EXPECT_THAT(take_calls(), ElementsAre("flip 40 C", "crtc 40 buffer 900 1920x1080 60 Hz", "gamma",
                                        "Broadcast RGB = 0", "free A", "free B", "free C",
                                        "drop master", "close"));
  EXPECT_EQ(card.gamma.red, gamma.red);
}

TEST_F(BridgeDrm, TimesAreThoseOfTheVerticalBlank) {
  const auto sink = open();
  std::int64_t last = -1;
  for (int n = 0; n < 200; ++n) {
    // Every phase against the blanks, one image in three periods.
    const double at_s = clock.now_s() + (2.5 + n / 200.0) * kPeriodS;
    const Shown shown = sink->show(noise(n), at_s);
    const double blank = (shown.at_s + 1000 - card.vblank0_s) / kPeriodS;
    EXPECT_NEAR(blank, std::round(blank), 1e-6) << "on a blank";
    EXPECT_NEAR(shown.times.vblank, 5000 + std::llround(blank), 0);
    // The nearest one.
    EXPECT_LE(std::abs(shown.at_s - at_s), kPeriodS / 2 + 1e-9);
    EXPECT_EQ(shown.times.missed_vblanks, 0);
    EXPECT_GT(shown.times.vblank, last);
    EXPECT_GE(shown.times.present_s, 0);
    EXPECT_LE(shown.times.present_s, kPeriodS + 1e-9);
    EXPECT_EQ(shown.count, n + 1);
    last = shown.times.vblank;
  }
}

TEST_F(BridgeDrm, AtFullRateNoBlankIsMissed) {
  const auto sink = open();
  std::int64_t last = sink->show(noise(0), 0).times.vblank;
  for (int n = 1; n < 100; ++n) {
    const Shown shown = sink->show(noise(n), 0);
    EXPECT_EQ(shown.times.vblank, last + 1);
    EXPECT_EQ(shown.times.missed_vblanks, 0);
    last = shown.times.vblank;
  }
}

TEST_F(BridgeDrm, LateFlipsAreCounted) {
  const auto sink = open();
  std::int64_t last = sink->show(noise(0), 0).times.vblank;
  for (const int skipped : {1, 0, 3, 2, 0}) {
    card.skipped = {skipped};
    const Shown shown = sink->show(noise(1), 0);
    EXPECT_EQ(shown.times.missed_vblanks, skipped);
    EXPECT_EQ(shown.times.vblank, last + 1 + skipped);
    last = shown.times.vblank;
  }
  // Waiting until a time is no miss.
  EXPECT_EQ(sink->show(noise(1), clock.now_s() + 10 * kPeriodS).times.missed_vblanks, 0);
}

TEST_F(BridgeDrm, SequenceNumbersWrap) {
  card.sequence0 = 0xFFFFFFFAU - 6;  // six blanks before the first image
  const auto sink = open();
  std::int64_t last = sink->show(noise(0), 0).times.vblank;
  EXPECT_GT(last, 0xFFFFFF00LL);
  for (int n = 1; n < 20; ++n) {
    const std::int64_t now = sink->show(noise(n), 0).times.vblank;
    EXPECT_EQ(now, last + 1);
    last = now;
  }
  EXPECT_GT(last, 0xFFFFFFFFLL);
}

TEST_F(BridgeDrm, DriversWithoutTimesGetOurs) {
  card.timed = false;
  const auto sink = open();
  const Shown shown = sink->show(noise(0), 0);
  EXPECT_EQ(shown.times.vblank, -1);
  EXPECT_DOUBLE_EQ(shown.at_s, clock.now_s());
}

TEST_F(BridgeDrm, AFlipThatNeverComesHasADeadline) {
  auto sink = open();
  sink->show(noise(0), 0);
  card.skipped = {-1};
  const double before_s = card.now_s;
  EXPECT_THROW(sink->show(noise(1), 0), DeviceError);
  EXPECT_LE(card.now_s - before_s, 0.3);
  take_calls();
  // Black needs no flip to end.
  sink->black();
  EXPECT_THAT(take_calls(), ElementsAre("crtc 40 buffer C 40x30 60 Hz"));
  EXPECT_EQ(seen(), picture_of(nullptr));
}

TEST_F(BridgeDrm, BusyKernelsAreAskedAgainAndNotForEver) {
  const auto sink = open();
  sink->show(noise(0), 0);
  card.flip_errors = {EBUSY, EBUSY};
  EXPECT_EQ(sink->show(noise(1), 0).number, 1);
  EXPECT_EQ(seen(), picture_of(noise(1).get()));
  card.flip_errors = std::deque<int>(100000, EBUSY);
  const double before_s = card.now_s;
  EXPECT_THROW(sink->show(noise(2), 0), DeviceError);
  EXPECT_LE(card.now_s - before_s, 0.3);
}

TEST_F(BridgeDrm, WhoTakesTheDisplayIsTold) {
  for (const int code : {EACCES, EPERM, ENODEV, EINVAL}) {
    const auto sink = open();
    sink->show(noise(0), 0);
    card.flip_errors = {code};
    const std::string says = thrown_by([&] { sink->show(noise(1), 0); });
    EXPECT_THAT(says, HasSubstr("HDMI-A-1"));
    if (code == EACCES || code == EPERM) {
      EXPECT_THAT(says, HasSubstr("another program"));
    }
    take_calls();
    sink->black();
    EXPECT_EQ(take_calls().front(), "flip 40 C") << "all the same";
  }
}

TEST_F(BridgeDrm, BlackIsShownOnEveryWayOut) {
  // By itself, when the sink goes, after an image that failed, and where flips and modes fail, too:
  // then nothing is thrown.
  for (const int way : {0, 1, 2, 3}) {
    SCOPED_TRACE(way);
    auto sink = open();
    sink->show(noise(0), 0);
    EXPECT_NE(seen(), picture_of(nullptr));
    if (way == 1) sink->show(nullptr, 0);
    if (way == 2) {
      card.flip_errors = {EINVAL, EINVAL};
      EXPECT_THROW(sink->show(noise(1), 0), DeviceError);
    }
    if (way == 3) {
      card.flip_errors = {EACCES};
      card.crtc_error = EACCES;
      EXPECT_NO_THROW(sink->black());
      card.crtc_error = 0;
    }
    if (way != 1) sink->black();
    EXPECT_EQ(seen(), picture_of(nullptr));
    take_calls();
    sink.reset();
    const auto calls = take_calls();
    EXPECT_EQ(calls.front(), "flip 40 C") << "and again before the console comes back";
    EXPECT_EQ(calls[1], "crtc 40 buffer 900 1920x1080 60 Hz");
  }
}

TEST_F(BridgeDrm, ADisplayThatWasOffIsOffAgain) {
  card.crtcs[40] = {};
  open().reset();
  EXPECT_THAT(take_calls(), testing::Contains("crtc 40 off"));
}

TEST_F(BridgeDrm, DoesNotTakeAScanOutFromAnotherDisplay) {
  card.crtcs[40].connectors = {72};
  card.crtcs[41].connectors = {};
  card.crtcs[41].on = false;
  open().reset();
  EXPECT_THAT(take_calls(), testing::Contains("crtc 41 buffer C 40x30 60 Hz"));
  card.crtcs[41] = {true, 901, 0, 0, drm_mode(800, 600, 60), {72}};
  EXPECT_THROW(open(), DeviceError);
}

TEST_F(BridgeDrm, RefusesWhatIsNotThePrintersSize) {
  machine = machine_of(kWidthPx + 1, kHeightPx);
  std::string says = thrown_by([&] { open(); });
  EXPECT_THAT(says, HasSubstr("41 x 30"));
  EXPECT_THAT(says, HasSubstr("1920 x 1080, 40 x 30"));
  EXPECT_THROW(open(), InputError);
  // Interlaced alone is none.
  machine = machine_of();
  card.connectors[1].modes = {drm_mode(kWidthPx, kHeightPx, 60, true)};
  EXPECT_THROW(open(), InputError);
  card.connectors[1].modes = {};
  EXPECT_THROW(open(), InputError);
  for (const std::string& call : take_calls()) {
    EXPECT_TRUE(call == "master" || call == "drop master" || call == "close") << call;
  }
}

TEST_F(BridgeDrm, FindsConnectorsByName) {
  EXPECT_THROW(open("DP-1"), InputError) << "it has no such mode";
  std::string says = thrown_by([&] { open("HDMI-A-2"); });
  EXPECT_THAT(says, HasSubstr("VGA-1 (disconnected), HDMI-A-1, DP-1"));
  EXPECT_THROW(open("HDMI-A-2"), InputError);
  EXPECT_THROW(open("VGA-1"), DeviceError) << "it is disconnected";
  EXPECT_NO_THROW(open("HDMI-A-1"));
  machine.projector.output = "DP-1";
  EXPECT_THROW(open(), InputError) << "the printer file counts";
  EXPECT_NO_THROW(open("HDMI-A-1")) << "but less than the command line";
  machine.projector.output.clear();
  card.connectors.clear();
  says = thrown_by([&] { open(); });
  EXPECT_THAT(says, HasSubstr("no display is connected"));
}

TEST_F(BridgeDrm, WhatFailsAtTheStartLeavesAllAsItWas) {
  card.gamma = {{0, 65535}, {0, 65535}, {0, 65535}};
  const auto fails = [&](int& error, int code, const std::string& says) {
    error = code;
    EXPECT_THAT(thrown_by([&] { open(); }), HasSubstr(says));
    error = 0;
    EXPECT_TRUE(card.buffers.empty());
    EXPECT_EQ(take_calls().back(), "close");
  };
  fails(card.master_error, EBUSY, "another program has the display");
  EXPECT_EQ(card.crtcs[40].buffer, 900U);
  fails(card.buffer_error, ENOMEM, "a buffer");
  EXPECT_EQ(card.crtcs[40].buffer, 900U);
  fails(card.crtc_error, EACCES, "another program has taken the display");
  EXPECT_EQ(card.crtcs[40].buffer, 900U);
  fails(card.gamma_error, EINVAL, "gamma");
  EXPECT_EQ(card.crtcs[40].buffer, 900U) << "restored";
  card.dumb_buffers = false;
  EXPECT_THROW(open(), DeviceError);
  card.dumb_buffers = true;
  card.monotonic_times = false;
  EXPECT_THROW(open(), DeviceError);
}

TEST_F(BridgeDrm, APulledCableIsFound) {
  const auto sink = open();
  sink->show(noise(0), 0);
  EXPECT_NO_THROW(sink->check());
  card.connectors[1].connected = false;
  EXPECT_THROW(sink->check(), DeviceError);
  EXPECT_THAT(thrown_by([&] { sink->show(noise(1), 0); }), HasSubstr("disconnected"));
}

TEST_F(BridgeDrm, AFrameOfAnotherSizeIsNeverShown) {
  const auto sink = open();
  take_calls();
  EXPECT_THROW(sink->show(noise(1, false, kHeightPx, kWidthPx), 0), Error);
  EXPECT_TRUE(take_calls().empty());
}

// Several displays.

}  // namespace
}  // namespace slicecorr::bridge
