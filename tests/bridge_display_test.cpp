// Displays without a display: how pixels lie in their channels, the order and times of page flips
// on a card that stands in for the kernel's, several displays at once, windows that fail.

#include <gmock/gmock.h>

#include <chrono>
#include <functional>
#include <random>
#include <thread>

#include "database/schema.hpp"
#include "display/drm_sink.hpp"
#include "display/pixels.hpp"
#include "display/window_sink.hpp"
#include "drm_substitute.hpp"
#include "frames/wire.hpp"
#include "models.hpp"
#include "slicecorr/bridge/display.hpp"
#include "slicecorr/error.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::bridge {
namespace {

using namespace slicecorr::test;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr int kWidthPx = 40, kHeightPx = 30;
constexpr double kHz = 60, kPeriodS = 1 / kHz;

Machine machine_of(int width = kWidthPx, int height = kHeightPx) {
  Machine m;
  m.printer = linear_printer(1, 100);
  m.printer.width_px = width;
  m.printer.height_px = height;
  return m;
}

std::shared_ptr<const Frame> noise(int number, bool uv = false, int width = kWidthPx,
                                   int height = kHeightPx) {
  std::mt19937 random(static_cast<unsigned>(number) + 1);
  auto frame = std::make_shared<Frame>();
  frame->number = number;
  frame->width_px = width;
  frame->height_px = height;
  for (int i = 0; i < width * height; ++i) {
    frame->blue.push_back(static_cast<std::uint8_t>(random()));
  }
  for (int i = 0; uv && i < width * height; ++i) {
    frame->uv.push_back(static_cast<std::uint8_t>(random()));
  }
  return frame;
}

template <class Call>
std::string thrown_by(const Call& call) {
  try {
    call();
  } catch (const std::exception& e) {
    return e.what();
  }
  return "";
}

// Pixels.

TEST(Pixels, EveryChannelEverySizeEveryPitch) {
  const auto shift = [](Channel c) { return c == Channel::red ? 16 : c == Channel::green ? 8 : 0; };
  for (const Channel blue : {Channel::red, Channel::green, Channel::blue, Channel::all}) {
    for (const Channel uv : {Channel::red, Channel::green, Channel::blue}) {
      // Widths around those of vector registers.
      for (const int width : {1, 2, 3, 15, 16, 17, 31, 33, 64, 67}) {
        for (const bool patterned : {false, true}) {
          if (patterned && (uv == blue || blue == Channel::all)) continue;
          const auto frame = noise(width, patterned, width, 3);
          const Projector map{blue, uv, ""};
          const std::size_t pitch = static_cast<std::size_t>(width) + 5;
          std::vector<std::uint32_t> out(pitch * 3, 7);
          pack(frame.get(), map, width, 3, out.data(), pitch);
          for (std::size_t y = 0; y < 3; ++y) {
            for (std::size_t x = 0; x < pitch; ++x) {
              std::uint32_t expected = 7;  // beyond the picture nothing is touched
              if (x < static_cast<std::size_t>(width)) {
                const std::size_t i = y * static_cast<std::size_t>(width) + x;
                expected = 0xFF000000U;
                expected |= blue == Channel::all ? frame->blue[i] * 0x010101U
                                                 : std::uint32_t{frame->blue[i]} << shift(blue);
                if (patterned) expected |= std::uint32_t{frame->uv[i]} << shift(uv);
              }
              ASSERT_EQ(out[y * pitch + x], expected) << x << ", " << y;
            }
          }
        }
      }
    }
  }
}

TEST(Pixels, BlackAndWrongFrames) {
  std::vector<std::uint32_t> out(8, 7);
  const Frame black;
  for (const Frame* frame : {static_cast<const Frame*>(nullptr), &black}) {
    std::fill(out.begin(), out.end(), 7);
    pack(frame, {}, 3, 2, out.data(), 4);
    EXPECT_THAT(out, ElementsAre(0xFF000000U, 0xFF000000U, 0xFF000000U, 7U, 0xFF000000U,
                                 0xFF000000U, 0xFF000000U, 7U));
  }
  for (const auto& break_it : std::vector<std::function<void(Frame&)>>{
           [](Frame& f) { std::swap(f.width_px, f.height_px); },
           [](Frame& f) { f.blue.pop_back(); }, [](Frame& f) { f.uv.resize(3); },
           [](Frame& f) { f.blue.clear(); }}) {
    Frame frame = *noise(4, false, 3, 2);
    break_it(frame);
    std::fill(out.begin(), out.end(), 7);
    EXPECT_THROW(pack(&frame, {}, 3, 2, out.data(), 4), Error);
    EXPECT_THAT(out, testing::Each(7U)) << "nothing was written";
  }
}

// [projector].

class ProjectorTable : public testing::Test {
 protected:
  static std::string printer(const std::string& kind, const std::string& table) {
    std::string text =
        read_text_file(std::string(SLICECORR_PRINTERS_DIR) + "/dual-wavelength-dlp.toml");
    const std::string flood = "kind = \"flood\"";
    text.replace(text.find(flood), flood.size(), "kind = \"" + kind + "\"");
    return text + "\n" + table;
  }
  static Projector parsed(const std::string& kind, const std::string& table) {
    return parse_machine(printer(kind, table), "p.toml").projector;
  }
  /// Both readers of printer files complain, about this key.
  static void refused(const std::string& kind, const std::string& table, const std::string& key,
                      const std::string& says) {
    SCOPED_TRACE(kind + ": " + table);
    const std::string text = printer(kind, table);
    const auto line =
        1 + std::count(text.begin(),
                       text.begin() + static_cast<std::ptrdiff_t>(text.rfind("\n" + key)) + 1,
                       '\n');
    const std::string message = thrown_by([&] { parse_machine(text, "p.toml"); });
    EXPECT_THAT(message, HasSubstr(fmt::format("p.toml: line {}: projector.{}", line, key)));
    EXPECT_THAT(message, HasSubstr(says));
    bool told = false;
    for (const auto& f : resins::validate_text(text, "p.toml")) {
      told = told || (!f.warning && f.key == "projector." + key && f.line == line);
    }
    EXPECT_TRUE(told);
  }
};

TEST_F(ProjectorTable, Defaults) {
  for (const std::string table : {"", "[projector]"}) {
    EXPECT_EQ(parsed("flood", table).blue, Channel::all);
    EXPECT_EQ(parsed("patterned", table).blue, Channel::blue);
    EXPECT_EQ(parsed("patterned", table).uv, Channel::red);
    EXPECT_EQ(parsed("flood", table).output, "");
  }
  const Projector p =
      parsed("patterned", "[projector]\nblue = \"red\"\nuv = \"green\"\noutput = \"HDMI-1\"");
  EXPECT_EQ(p.blue, Channel::red);
  EXPECT_EQ(p.uv, Channel::green);
  EXPECT_EQ(p.output, "HDMI-1");
  EXPECT_EQ(parsed("flood", "[projector]\nblue = \"green\"").blue, Channel::green);
  for (const Channel c : {Channel::red, Channel::green, Channel::blue, Channel::all}) {
    EXPECT_EQ(parsed("flood", fmt::format("[projector]\nblue = \"{}\"", name_of(c))).blue, c);
  }
}

TEST_F(ProjectorTable, Complaints) {
  refused("flood", "[projector]\nblue = \"violet\"", "blue", "violet");
  refused("patterned", "[projector]\nuv = \"all\"", "uv", "all");
  refused("flood", "[projector]\nuv = \"red\"", "uv", "patterned");
  refused("patterned", "[projector]\nblue = \"all\"", "blue", "the same channel");
  refused("patterned", "[projector]\nblue = \"red\"", "blue", "the same channel");
  refused("patterned", "[projector]\nuv = \"blue\"", "uv", "the same channel");
  refused("flood", "[projector]\noutpt = \"x\"", "outpt", "output");
  refused("flood", "[projector]\nblue = 3", "blue", "");
}

// The ring's memory.

class SizedFrames final : public FrameSource {
 public:
  explicit SizedFrames(std::size_t bytes) : bytes_(bytes) {}
  int frames() const override { return 2000; }
  std::size_t frame_bytes() const override { return bytes_; }
  std::shared_ptr<const Frame> make(int number) const override {
    auto frame = std::make_shared<Frame>();
    frame->number = number;
    return frame;
  }

 private:
  std::size_t bytes_;
};

TEST(FrameRingMemory, IsBoundedAndStillHoldsThree) {
  const auto capacity = [](std::size_t bytes, int ring) {
    return FrameRing(SizedFrames(bytes), ring, 1).capacity();
  };
  EXPECT_EQ(capacity(1280 * 800, 16), 16);
  EXPECT_EQ(capacity(3840 * 2400, 16), 16);
  EXPECT_EQ(capacity(3840 * 2400, 1024), 29);  // 29 * 9,216,000 <= 256 MiB < 30 * 9,216,000
  EXPECT_EQ(capacity(11520 * 5120, 16), 4);
  EXPECT_EQ(capacity(std::size_t{1} << 30, 16), 3);
  EXPECT_EQ(capacity(0, 1000), 1000);
  EXPECT_EQ(capacity(std::size_t{1} << 30, 2), 2);
  // And it works: all frames come through three places.
  const SizedFrames source(std::size_t{1} << 30);
  FrameRing ring(source, 16, 2);
  for (int n = 0; n < 200; ++n) {
    ring.wait_ready(n, 16);
    ASSERT_EQ(ring.take(n)->number, n);
    ASSERT_LE(ring.ready(), 3);
  }
}

// Page flips.

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

struct SinkLog {
  std::vector<std::string> calls;
  bool gone = false;
  int wrong_by = 0;
};
class LoggedSink final : public FrameSink {
 public:
  LoggedSink(std::string name, SinkLog& log) : name_(std::move(name)), log_(log) {}
  ~LoggedSink() override { log_.calls.push_back(name_ + " ends"); }
  Shown show(const std::shared_ptr<const Frame>& frame, double at_s) override {
    if (log_.gone) throw DeviceError(name_ + " is gone");
    const int number = frame ? frame->number : -1;
    log_.calls.push_back(fmt::format("{} {} {:g}", name_, number, at_s));
    return {number + log_.wrong_by, at_s + 0.5, ++count_, {}};
  }
  void black() noexcept override { log_.calls.push_back(name_ + " black"); }
  void tick(double at_s) override {
    log_.calls.push_back(fmt::format("{} tick {:g}", name_, at_s));
  }
  void check() override {
    if (log_.gone) throw DeviceError(name_ + " is gone");
  }
  std::string describe() const override { return name_; }

 private:
  std::string name_;
  SinkLog& log_;
  std::int64_t count_ = 0;
};

TEST(SeveralSinks, TheFirstCountsAndAllGetTheSame) {
  SinkLog one, two;
  std::vector<std::unique_ptr<FrameSink>> sinks;
  sinks.push_back(std::make_unique<LoggedSink>("one", one));
  sinks.push_back(std::make_unique<LoggedSink>("two", two));
  const auto sink = make_several_sinks(std::move(sinks));
  const Shown shown = sink->show(noise(3), 7);
  EXPECT_EQ(shown.number, 3);
  EXPECT_EQ(shown.at_s, 7.5);
  sink->tick(8);
  sink->show(nullptr, 9);
  sink->black();
  EXPECT_THAT(one.calls, ElementsAre("one 3 7", "one tick 8", "one -1 9", "one black"));
  EXPECT_THAT(two.calls, ElementsAre("two 3 7", "two tick 8", "two -1 9", "two black"));
  EXPECT_EQ(sink->describe(), "one, two");
  // Any that is gone, or shows something else, is all of them; black goes to each.
  for (SinkLog* bad : {&one, &two}) {
    bad->gone = true;
    EXPECT_THROW(sink->show(noise(4), 10), DeviceError);
    EXPECT_THROW(sink->check(), DeviceError);
    bad->gone = false;
    EXPECT_NO_THROW(sink->check());
  }
  two.wrong_by = 1;
  EXPECT_THAT(thrown_by([&] { sink->show(noise(4), 10); }), HasSubstr("two image 5"));
  sink->black();
  EXPECT_EQ(one.calls.back(), "one black");
  EXPECT_EQ(two.calls.back(), "two black");
}

TEST(SeveralSinks, NamesAreCheckedBeforeAnythingIsOpened) {
  const auto clock = make_real_clock();
  WireHello hello;
  const auto open = [&](const std::vector<std::string>& names) {
    return open_sinks(names, machine_of(), hello, *clock);
  };
  for (const std::string name :
       {"", "windows", "window:1:2", "drm:0:HDMI-A-1:2", "unix", "nul", "null:1", "Window"}) {
    // Were the first opened first, it would fail otherwise.
    EXPECT_THAT(thrown_by([&] {
                  open({"unix:/nonexistent/socket", name});
                }),
                HasSubstr("--sink is '" + name + "', expected window"));
  }
  EXPECT_THROW(open({"window", "window:1"}), InputError);
  EXPECT_THROW(open({"unix:/nonexistent/socket"}), DeviceError);
  EXPECT_THAT(thrown_by([&] { open({"drm:/dev/dri/nonexistent"}); }), HasSubstr("nonexistent"));
  EXPECT_THROW(open({"drm:/dev/dri/nonexistent"}), DeviceError);
  hello.lockstep = true;
  EXPECT_THROW(open({"null", "drm"}), InputError);
  EXPECT_EQ(open({})->describe(), "nowhere");
  EXPECT_EQ(open({"null", "null"})->describe(), "nowhere, nowhere");
}

// Windows that are none.

struct WindowLog {
  std::vector<std::string> calls;
  std::string fails;  ///< call that does
  std::string news;   ///< what `watch` says
  std::vector<std::uint32_t> drawn;
};
class LoggedWindow final : public detail::Window {
 public:
  LoggedWindow(const detail::WindowWanted& wanted, WindowLog& log)
      : log_(log), width_(static_cast<std::size_t>(wanted.width_px)) {
    log_.drawn.assign(width_ * static_cast<std::size_t>(wanted.height_px), 7);
  }
  ~LoggedWindow() override { log_.calls.push_back("close"); }
  std::string begin(Pixels& pixels) override {
    pixels = {log_.drawn.data(), width_};
    return told("begin");
  }
  std::string finish() override { return told("finish"); }
  std::string present() override {
    const bool black = std::all_of(log_.drawn.begin(), log_.drawn.end(),
                                   [](std::uint32_t p) { return p == 0xFF000000U; });
    return told(black ? "present black" : "present");
  }
  std::string check() override { return log_.news; }

 private:
  std::string told(const std::string& call) {
    log_.calls.push_back(call);
    return call == log_.fails ? "it fails" : "";
  }
  WindowLog& log_;
  std::size_t width_;
};

class BridgeWindowCalls : public testing::Test {
 protected:
  std::unique_ptr<FrameSink> open() {
    return detail::make_window_sink(
        "", machine_of(), *clock,
        [this](const detail::WindowWanted& wanted, detail::WindowFound& found) {
          found.words = "a window";
          return std::make_unique<LoggedWindow>(wanted, log);
        });
  }
  WindowLog log;
  std::unique_ptr<BridgeClock> clock = make_step_clock();
};

TEST_F(BridgeWindowCalls, BlackComesBeforeTheEnd) {
  auto sink = open();
  const Shown shown = sink->show(noise(1), 5);
  EXPECT_EQ(shown.at_s, 5) << "by the print's clock";
  sink.reset();
  EXPECT_THAT(log.calls, ElementsAre("begin", "finish", "present", "begin", "finish",
                                     "present black", "close"));
}

TEST_F(BridgeWindowCalls, WhatFailsIsADeviceError) {
  for (const std::string call : {"begin", "finish", "present"}) {
    log = {};
    auto sink = open();
    log.fails = call;
    EXPECT_THAT(thrown_by([&] { sink->show(noise(1), 0); }), HasSubstr("a window: it fails"));
    log.fails.clear();
    EXPECT_THROW(sink->show(noise(1), 0), DeviceError) << "once is for good";
    sink->black();
    EXPECT_EQ(log.calls.back(), "present black") << "but black";
  }
}

TEST_F(BridgeWindowCalls, WhatHappensWhileNothingIsShownIsFound) {
  log.news = "something came between";
  auto sink = open();
  const auto until = std::chrono::steady_clock::now() + std::chrono::minutes(1);
  std::string says;
  while (says.empty() && std::chrono::steady_clock::now() < until) {
    says = thrown_by([&] { sink->check(); });
    std::this_thread::yield();
  }
  EXPECT_THAT(says, HasSubstr("something came between"));
  EXPECT_THROW(sink->show(noise(1), 0), DeviceError);
}

TEST(BridgeWindowOpen, ReasonsAgainstItAreErrorsOfTheirKind) {
  const auto clock = make_step_clock();
  for (const bool input : {false, true}) {
    const auto open = [&] {
      detail::make_window_sink("3", machine_of(), *clock,
                               [&](const detail::WindowWanted& wanted, detail::WindowFound& found) {
                                 EXPECT_EQ(wanted.display, "3");
                                 found.wrong = "no";
                                 found.input = input;
                                 return std::unique_ptr<detail::Window>();
                               });
    };
    if (input) {
      EXPECT_THROW(open(), InputError);
    } else {
      EXPECT_THROW(open(), DeviceError);
    }
    EXPECT_THAT(thrown_by(open), HasSubstr("window:3"));
  }
}

}  // namespace
}  // namespace slicecorr::bridge
