// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Windows on a real display server (Xvfb): what an onlooker sees there, pixel by pixel, and what
// happens to windows that are closed, moved, covered, and to servers that die.

#include <gmock/gmock.h>
#include <signal.h>

#include <atomic>
#include <random>
#include <thread>

#include "display/window_sink.hpp"
#include "models.hpp"
#include "rounds.hpp"
#include "slicecorr/bridge/display.hpp"
#include "slicecorr/error.hpp"
#include "xvfb.hpp"

namespace slicecorr::bridge {
namespace {

using namespace slicecorr::test;
using testing::HasSubstr;

constexpr int kWidthPx = 200, kHeightPx = 120;

Machine machine_of(int width, int height) {
  Machine m;
  m.printer = linear_printer(1, 100);
  m.printer.width_px = width;
  m.printer.height_px = height;
  return m;
}

/// Noise: no two pixels of a row or column tell the same.
std::shared_ptr<const Frame> noise(int number, bool uv = false) {
  std::mt19937 random(static_cast<unsigned>(number) + 1);
  auto frame = std::make_shared<Frame>();
  frame->number = number;
  frame->width_px = kWidthPx;
  frame->height_px = kHeightPx;
  const auto fill = [&](std::vector<std::uint8_t>& image) {
    for (int i = 0; i < kWidthPx * kHeightPx; ++i) {
      image.push_back(static_cast<std::uint8_t>(random()));
    }
  };
  fill(frame->blue);
  if (uv) fill(frame->uv);
  return frame;
}

std::vector<std::uint32_t> grey(const Frame& frame) {
  std::vector<std::uint32_t> pixels;
  for (const std::uint8_t g : frame.blue) pixels.push_back(g * 0x010101U);
  return pixels;
}

const std::vector<std::uint32_t>& all_black() {
  static const std::vector<std::uint32_t> pixels(kWidthPx * kHeightPx, 0);
  return pixels;
}

class BridgeWindow : public testing::Test {
 protected:
  /// One server for all tests of a suite: starting it takes longer than most of them.
  static void SetUpTestSuite() {
    if (Xvfb::installed()) server = new Xvfb(kWidthPx, kHeightPx);
  }
  /// Where a process ends in a test its server does not: what libraries then do meets it as it is.
  static void TearDownTestSuite() {
    delete server;
    server = nullptr;
  }
  void SetUp() override {
    if (!Xvfb::installed()) GTEST_SKIP() << "Xvfb is not installed";
    ::setenv("DISPLAY", server->name().c_str(), 1);
  }
  std::unique_ptr<FrameSink> open(const std::string& display = "") {
    return make_window_sink(display, machine, *clock);
  }
  /// What `show` then says.
  static std::string trouble_of(FrameSink& sink) {
    std::string text;
    // Events take their way: what is wrong now is told with a later image at the latest.
    wait_until([&] {
      try {
        sink.check();
        return false;
      } catch (const DeviceError& e) {
        text = e.what();
        return true;
      }
    });
    EXPECT_THROW(sink.show(noise(0), 0), DeviceError);
    return text;
  }

  inline static Xvfb* server = nullptr;
  Machine machine = machine_of(kWidthPx, kHeightPx);
  std::unique_ptr<BridgeClock> clock = make_real_clock();
};

TEST_F(BridgeWindow, ShowsEveryPixelAsItIs) {
  Onlooker eye;
  const auto sink = open();
  EXPECT_EQ(eye.grab(), all_black()) << "black before the first image";
  for (int n = 0; n < 5; ++n) {
    const double at_s = clock->now_s() + 0.01;
    const auto frame = noise(n);
    const Shown shown = sink->show(frame, at_s);
    EXPECT_EQ(shown.number, n);
    EXPECT_EQ(shown.count, n + 1);
    EXPECT_GE(shown.at_s, at_s);
    EXPECT_LE(shown.at_s, clock->now_s());
    EXPECT_GT(shown.times.upload_s, 0);
    EXPECT_GT(shown.times.present_s, 0);
    EXPECT_EQ(shown.times.vblank, -1) << "SDL tells of none";
    EXPECT_EQ(eye.grab(), grey(*frame)) << n;
  }
  EXPECT_EQ(sink->show(nullptr, 0).number, -1);
  EXPECT_EQ(eye.grab(), all_black());
  sink->show(noise(7), 0);
  sink->black();
  EXPECT_EQ(eye.grab(), all_black());
  EXPECT_THAT(sink->describe(), HasSubstr("x11"));
}

TEST_F(BridgeWindow, PutsBlueAndUvIntoTheirChannels) {
  Onlooker eye;
  machine.projector.blue = Channel::green;
  machine.projector.uv = Channel::blue;
  const auto sink = open();
  const auto frame = noise(3, true);
  sink->show(frame, 0);
  std::vector<std::uint32_t> expected;
  for (std::size_t i = 0; i < frame->blue.size(); ++i) {
    expected.push_back(static_cast<std::uint32_t>(frame->blue[i]) << 8 | frame->uv[i]);
  }
  EXPECT_EQ(eye.grab(), expected);
}

TEST_F(BridgeWindow, NothingElseIsSeenWhenItIsClosed) {
  Onlooker eye;
  // What is behind the window is white: its black is its own. That black comes before it goes is
  // seen in bridge_display_test, where time does not matter.
  eye.paint_root(0xFFFFFF);
  auto sink = open();
  sink->show(noise(1), 0);
  std::atomic<bool> done{false};
  std::thread closes([&] {
    sink.reset();
    done = true;
  });
  const auto white = std::vector<std::uint32_t>(kWidthPx * kHeightPx, 0xFFFFFF);
  const auto image = grey(*noise(1));
  while (!done) {
    const auto seen = eye.grab();
    EXPECT_TRUE(seen == all_black() || seen == image || seen == white);
  }
  closes.join();
  EXPECT_EQ(eye.grab(), white);
  EXPECT_EQ(eye.image_window(), 0U);
  eye.paint_root(0);
}

TEST_F(BridgeWindow, AFrameOfAnotherSizeIsNeverShown) {
  Onlooker eye;
  const auto sink = open();
  auto frame = std::make_shared<Frame>(*noise(1));
  frame->width_px = kHeightPx;
  frame->height_px = kWidthPx;
  EXPECT_THROW(sink->show(frame, 0), Error);
  EXPECT_EQ(eye.grab(), all_black());
}

TEST_F(BridgeWindow, RefusesADisplayOfAnotherSize) {
  for (const auto& [w, h] :
       {std::pair{kWidthPx + 1, kHeightPx}, std::pair{kWidthPx, kHeightPx - 1},
        std::pair{kHeightPx, kWidthPx}, std::pair{2 * kWidthPx, 2 * kHeightPx}}) {
    machine = machine_of(w, h);
    try {
      open();
      FAIL() << w << " x " << h;
    } catch (const InputError& e) {
      EXPECT_THAT(e.what(), HasSubstr("200 x 120"));
      EXPECT_THAT(e.what(), HasSubstr(std::to_string(w) + " x " + std::to_string(h)));
    }
  }
  Onlooker eye;
  EXPECT_EQ(eye.image_window(), 0U);
}

TEST_F(BridgeWindow, FindsDisplaysByNumberAndName) {
  EXPECT_NO_THROW(open("0"));
  EXPECT_NO_THROW(open("screen")) << "the output's name in Xvfb";
  machine.projector.output = "HDMI-9";
  EXPECT_NO_THROW(open("0")) << "the command line counts";
  for (const std::string name : {"", "1", "screens"}) {
    try {
      open(name);
      FAIL() << name;
    } catch (const InputError& e) {
      EXPECT_THAT(e.what(), HasSubstr(name.empty() ? "HDMI-9" : name));
      EXPECT_THAT(e.what(), HasSubstr("there are 0 '"));
    }
  }
}

TEST_F(BridgeWindow, NoServer) {
  ::setenv("DISPLAY", ":987654", 1);
  EXPECT_THROW(open(), DeviceError);
  ::setenv("SDL_VIDEODRIVER", "nonsense", 1);
  EXPECT_THROW(open(), DeviceError);
  ::unsetenv("SDL_VIDEODRIVER");
}

TEST_F(BridgeWindow, HidesThePointerAndKeepsTheDisplayAwake) {
  Onlooker eye;
  eye.put_pointer(kWidthPx / 2, kHeightPx / 2);
  ASSERT_TRUE(eye.pointer_is_seen());
  const bool can_save = eye.saves_power().has_value();
  if (can_save) eye.save_power();
  {
    const auto sink = open();
    sink->show(noise(1), 0);
    EXPECT_FALSE(eye.pointer_is_seen());
    if (can_save) {
      EXPECT_FALSE(*eye.saves_power());
    }
  }
  EXPECT_TRUE(eye.pointer_is_seen());
  if (can_save) {
    EXPECT_TRUE(*eye.saves_power()) << "as it was";
  }
  RecordProperty("power_saving", can_save ? "yes" : "this server has none");
}

TEST_F(BridgeWindow, ACoveredWindowIsNoDisplay) {
  Onlooker eye;
  const auto sink = open();
  sink->show(noise(1), 0);
  // A single pixel is enough.
  const auto above = eye.cover(50, 50, 1, 1);
  EXPECT_THAT(trouble_of(*sink), HasSubstr("covers"));
  eye.destroy(above);
  EXPECT_THROW(sink->show(noise(2), 0), DeviceError) << "nobody knows what was seen meanwhile";
  sink->black();
  EXPECT_EQ(eye.grab(), all_black()) << "black comes through all the same";
}

TEST_F(BridgeWindow, AWindowThatIsMovedOrClosedIsNoDisplay) {
  Onlooker eye;
  const auto meddle = [&](const auto& with, const std::string& says) {
    SCOPED_TRACE(says);
    const auto sink = open();
    sink->show(noise(1), 0);
    const auto window = eye.image_window();
    ASSERT_NE(window, 0U);
    with(window);
    EXPECT_THAT(trouble_of(*sink), HasSubstr(says));
  };
  meddle([&](auto w) { eye.move(w, 3, 0); }, "moved to 3, 0");
  meddle([&](auto w) { eye.resize(w, 100, 100); }, "100 x 100");
  meddle([&](auto w) { eye.close(w); }, "closed");
}

TEST_F(BridgeWindow, OneWindowToAProcess) {
  const auto sink = open();
  EXPECT_THROW(open(), DeviceError);
  EXPECT_EQ(sink->show(noise(1), 0).count, 1);
}

TEST_F(BridgeWindow, LeavesSignalsAlone) {
  struct sigaction before {
  }, now{};
  for (const int signal : {SIGINT, SIGTERM}) {
    ::sigaction(signal, nullptr, &before);
    const auto sink = open();
    ::sigaction(signal, nullptr, &now);
    EXPECT_EQ(reinterpret_cast<void*>(now.sa_handler), reinterpret_cast<void*>(before.sa_handler));
  }
}

// What becomes of a process whose display server is killed or hangs, in processes of their own.
using BridgeWindowDeath = BridgeWindow;

/// Shows until that fails; what it says.
std::string show_until_it_fails(FrameSink& sink) {
  try {
    for (int n = 0;; ++n) sink.show(noise(n), 0);
  } catch (const DeviceError& e) {
    return e.what();
  }
}

TEST_F(BridgeWindowDeath, TheProcessOutlivesItsServer) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  const auto lives = [&](bool while_showing, const char* renderer) {
    if (renderer != nullptr) ::setenv("SDL_RENDER_DRIVER", renderer, 1);
    auto sink = open();
    sink->show(noise(0), 0);
    const pid_t pid = server->server().pid();
    std::string says;
    if (while_showing) {
      std::thread shows([&] { says = show_until_it_fails(*sink); });
      ::kill(pid, SIGKILL);
      shows.join();
    } else {
      ::kill(pid, SIGKILL);
      says = trouble_of(*sink);
    }
    sink->black();
    sink.reset();
    std::string again;
    try {
      open();
    } catch (const DeviceError& e) {
      again = e.what();
    }
    const bool well = says.find("gone") != std::string::npos && !again.empty();
    std::fprintf(stderr, "%s; %s\n", says.c_str(), again.c_str());
    // Not _exit: what libraries do at the end must not hang or crash either.
    std::exit(well ? 7 : 8);
  };
  EXPECT_EXIT(lives(true, nullptr), testing::ExitedWithCode(7), "gone");
  // OpenGL has threads, locks and destructors of its own.
  EXPECT_EXIT(lives(false, "opengl"), testing::ExitedWithCode(7), "gone");
  if (!by_night()) return;
  EXPECT_EXIT(lives(false, nullptr), testing::ExitedWithCode(7), "gone");
  EXPECT_EXIT(lives(true, "opengl"), testing::ExitedWithCode(7), "gone");
}

TEST_F(BridgeWindowDeath, AWindowThatOthersTakeAwayIsNoDisplay) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  const auto without = [&](const auto& take) {
    Onlooker eye;
    auto sink = open();
    sink->show(noise(1), 0);
    take(eye, eye.image_window());
    const std::string says = trouble_of(*sink);
    sink->black();
    sink.reset();
    std::fprintf(stderr, "%s\n", says.c_str());
    std::exit(7);
  };
  EXPECT_EXIT(without([](Onlooker& eye, auto w) { eye.unmap(w); }), testing::ExitedWithCode(7),
              "hidden");
  EXPECT_EXIT(without([](Onlooker& eye, auto w) { eye.destroy(w); }), testing::ExitedWithCode(7),
              "window was");
  EXPECT_EXIT(without([](Onlooker& eye, auto w) { eye.kill_client(w); }),
              testing::ExitedWithCode(7), "gone");
}

TEST_F(BridgeWindowDeath, AServerThatHangsIsGivenUp) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  const auto gives_up = [&](const char* renderer) {
    if (renderer != nullptr) ::setenv("SDL_RENDER_DRIVER", renderer, 1);
    auto sink = open();
    sink->show(noise(0), 0);
    const pid_t pid = server->server().pid();
    ::kill(pid, SIGSTOP);
    const std::string says = show_until_it_fails(*sink);
    sink->black();
    sink.reset();
    std::fprintf(stderr, "%s\n", says.c_str());
    // The server still hangs.
    std::exit(says.find("has not answered") != std::string::npos ? 7 : 8);
  };
  EXPECT_EXIT(gives_up(nullptr), testing::ExitedWithCode(7), "not answered");
  EXPECT_EXIT(gives_up("opengl"), testing::ExitedWithCode(7), "not answered");
}

}  // namespace
}  // namespace slicecorr::bridge
