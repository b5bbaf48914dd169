// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Displays without a display: how pixels lie in their channels, what printer files say of projectors,
// several displays at once, windows that fail.

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <chrono>
#include <functional>
#include <random>
#include <thread>

#include "bridge_displays.hpp"
#include "database/schema.hpp"
#include "display/pixels.hpp"
#include "display/window_sink.hpp"
#include "frames/wire.hpp"
#include "slicecorr/error.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::bridge {
namespace {

using namespace slicecorr::test;
using testing::ElementsAre;
using testing::HasSubstr;

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
  std::string fails;                   ///< call that does
  std::string news;                    ///< what `check` says
  std::chrono::milliseconds takes{0};  ///< each of them
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
  std::string check() override {
    std::this_thread::sleep_for(log_.takes);
    return log_.news;
  }

 private:
  std::string told(const std::string& call) {
    std::this_thread::sleep_for(log_.takes);
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

// Whatever the window's thread does when it is asked.
TEST_F(BridgeWindowCalls, WhatIsShownWasPresentedAndWhatIsClosedIsGone) {
  log.takes = std::chrono::milliseconds(5);
  auto sink = open();
  const std::vector<std::string> image = {"begin", "finish", "present"};
  std::vector<std::string> expected;
  for (int n = 1; n <= 16; ++n) {
    // It looks after its window every 10 ms.
    std::this_thread::sleep_for(std::chrono::milliseconds(n));
    sink->show(noise(n), 0);
    expected.insert(expected.end(), image.begin(), image.end());
    ASSERT_EQ(log.calls, expected) << n;
  }
  sink.reset();
  EXPECT_EQ(log.calls.back(), "close");
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
