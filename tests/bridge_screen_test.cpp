// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Prints in real time into a window and into printer-sim beside it: every image once, in order,
// pixel by pixel as an onlooker of the display sees it; and what is left when one of those involved
// is killed in the middle. The print's limits are patient: what is asserted does not depend on how
// busy the computer is.

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <atomic>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <set>
#include <thread>

#include "real_files.hpp"
#include "slicecorr/stack.hpp"
#include "xvfb.hpp"

namespace slicecorr {
namespace {

using namespace slicecorr::test;
using testing::HasSubstr;

double utc_s() {
  return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

/// "2026-01-31T23:59:59.123Z".
double utc_s_of(const std::string& text) {
  std::tm t{};
  double seconds = 0;
  int year = 0, month = 0;
  if (std::sscanf(text.c_str(), "%d-%d-%dT%d:%d:%lfZ", &year, &month, &t.tm_mday, &t.tm_hour,
                  &t.tm_min, &seconds) != 6) {
    ADD_FAILURE() << text;
  }
  t.tm_year = year - 1900;
  t.tm_mon = month - 1;
  return static_cast<double>(::timegm(&t)) + seconds;
}

/// A picture of the display, and the times between which it was taken.
struct Grab {
  double begin_s = 0, end_s = 0;
  std::vector<std::uint32_t> pixels;
};

/// A row of frames.csv, as far as it matters here.
struct Row {
  int frame = 0;
  double shown_s = 0, present_s = 0;
};

class BridgeScreen : public BridgePrograms {
 protected:
  void SetUp() override {
    if (!Xvfb::installed()) GTEST_SKIP() << "Xvfb is not installed";
  }
  std::string state(const std::string& file) {
    return folder / ("state/dual-wavelength-dlp/" + file);
  }
  std::vector<Row> rows() {
    std::ifstream csv(state("frames.csv"));
    std::string line;
    std::getline(csv, line);
    const auto cells_of = [](const std::string& text) {
      std::vector<std::string> cells;
      std::istringstream in(text);
      for (std::string cell; std::getline(in, cell, ',');) cells.push_back(cell);
      return cells;
    };
    const auto names = cells_of(line);
    const auto place = [&](const std::string& name) {
      return static_cast<std::size_t>(std::find(names.begin(), names.end(), name) - names.begin());
    };
    std::vector<Row> all;
    while (std::getline(csv, line)) {
      const auto cells = cells_of(line);
      all.push_back({std::stoi(cells.at(place("frame"))), std::stod(cells.at(place("shown_s"))),
                     std::stod(cells.at(place("present_s")))});
    }
    return all;
  }
  /// The print's clock when UTC began. The journal's lines have both; the least difference is that
  /// of the line that was written soonest.
  double clock_began_utc_s() {
    double least = 1e300;
    for (const auto& line : lines_of(state("journal.jsonl"))) {
      least = std::min(least, utc_s_of(line.at("time")) - line.at("at_s").get<double>());
    }
    return least;
  }
  void expect_every_frame_seen(const std::string& mesh, bool all_of_it);
  std::vector<std::string> with_window(std::vector<std::string> command) {
    // The window is the display that counts, before what the fixture names.
    const auto sink = std::find(command.begin(), command.end(), "--sink");
    command.insert(sink, {"--sink", "window"});
    return command;
  }
};

void BridgeScreen::expect_every_frame_seen(const std::string& mesh, bool all_of_it) {
  std::string part = mesh;
  // By day in a sixteenth of the pixels, in half as many images a second.
  const int width_px = all_of_it ? 1280 : 320, height_px = all_of_it ? 800 : 200;
  if (!all_of_it) {
    // Pressed to 2 mm, so that 100 slices come through all of it.
    Bytes stl = read_file(mesh);
    std::uint32_t triangles = 0;
    std::memcpy(&triangles, stl.data() + 80, 4);
    ASSERT_EQ(stl.size(), 84 + std::size_t{50} * triangles);
    float top = 0;
    for (const bool press : {false, true}) {
      for (std::size_t i = 0; i < std::size_t{3} * triangles; ++i) {
        std::uint8_t* const z = stl.data() + 84 + i / 3 * 50 + 12 + i % 3 * 12 + 8;
        float value = 0;
        std::memcpy(&value, z, 4);
        top = std::max(top, value);
        value *= 2 / top;
        if (press) std::memcpy(z, &value, 4);
      }
    }
    part = folder / "pressed.stl";
    write_file(part, stl);
  }
  auto changes = patient();
  changes.push_back({"width_px = 96", fmt::format("width_px = {}", width_px)});
  changes.push_back({"height_px = 64", fmt::format("height_px = {}", height_px)});
  if (all_of_it) {
    changes.push_back({"travel_mm = 6", "travel_mm = 60"});
  } else {
    changes.push_back({"pixel_um = 50.0", "pixel_um = 200.0"});
  }
  const std::string printer = make_printer("wide", changes);
  const std::string target = folder / "target.uvj", stack = folder / "part.uvj";
  RunOptions long_one;
  long_one.timeout = std::chrono::minutes(5);
  ASSERT_EQ(run_program({program("slicecorr"), "slice", part, "-o", target, "--printer", printer,
                         "--layer-um", all_of_it ? "10" : "20", "--quiet"},
                        long_one)
                .exit_code,
            0);
  ASSERT_EQ(run_program({program("slicecorr"), "correct", target, "-o", stack, "--printer", printer,
                         "--resin", "figure-2-2", "--speed-mm-h", "800", "--quiet"},
                        long_one)
                .exit_code,
            0);
  const StackReader sent(stack, folder.path());
  const int slices = sent.grid().layers;
  ASSERT_GE(slices, 99);

  Xvfb server(width_px, height_px);
  Sim sim = start_sim(printer, false);
  Child print(with_window(print_command(stack, printer, sim, false)), folder / "print.err");
  // An onlooker of the display, at times that have nothing to do with the print's.
  std::atomic<bool> ended{false};
  std::vector<Grab> grabs;
  std::thread looks([&] {
    const Onlooker eye;
    constexpr std::size_t most = 40;
    for (int i = 0; !ended && grabs.size() < most; ++i) {
      Grab grab;
      grab.begin_s = utc_s();
      grab.pixels = eye.grab();
      grab.end_s = utc_s();
      grabs.push_back(std::move(grab));
      for (int tenths = 0; tenths < (all_of_it ? 55 : 3) && !ended; ++tenths) {
        std::this_thread::sleep_for(std::chrono::milliseconds(97));
      }
    }
  });
  const int code = print.wait();
  ended = true;
  looks.join();
  ASSERT_EQ(code, 0) << text_of(folder / "print.err");
  EXPECT_EQ(sim.child->end(SIGTERM), 0);

  // Every frame once, in order: by the bridge, and by the simulator.
  const auto log = rows();
  ASSERT_EQ(static_cast<int>(log.size()), slices);
  for (int n = 0; n < slices; ++n) ASSERT_EQ(log[static_cast<std::size_t>(n)].frame, n);
  int next = 0;
  for (const std::string& event : events_of(sim.events)) {
    if (event.starts_with("frame ")) {
      ASSERT_EQ(event, "frame " + std::to_string(next++));
    }
  }
  EXPECT_EQ(next, slices);

  // What was recorded is what was sent.
  const StackReader shown(sim.shown, folder.path());
  ASSERT_EQ(shown.grid().layers, slices);
  const std::size_t pixels =
      static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px);
  const auto slice_of = [&](const StackReader& of, int n) {
    std::vector<std::uint8_t> image(pixels, 0);
    if (n >= 0 && n < slices) of.read_slice(n, image.data());
    return image;
  };
  for (int n = 0; n < slices; ++n) {
    ASSERT_TRUE(slice_of(shown, n) == slice_of(sent, n)) << "slice " << n;
  }

  // What was seen is one of the images that the bridge says were on the display while it was looked
  // at: nearly always there is but one, and never anything else.
  const double zero_s = clock_began_utc_s();
  // Of the journal's milliseconds, and of adding an event to it.
  constexpr double clock_s = 0.01;
  int compared = 0, lit = 0, sure = 0;
  std::set<int> images;
  for (const Grab& grab : grabs) {
    const double from_s = grab.begin_s - zero_s - clock_s, to_s = grab.end_s - zero_s + clock_s;
    std::vector<int> may{-1};
    for (const Row& row : log) {
      if (row.shown_s <= from_s) may.clear();
      if (row.shown_s - row.present_s <= to_s) may.push_back(row.frame);
    }
    // Black comes some cycles after the last frame began.
    if (may.back() == slices - 1) may.push_back(-1);
    int found = -2;
    for (const int n : may) {
      const auto image = slice_of(sent, n);
      bool same = true;
      for (std::size_t i = 0; i < pixels && same; ++i) {
        same = grab.pixels[i] == image[i] * 0x010101U;
      }
      if (same) found = n;
    }
    EXPECT_NE(found, -2) << "at " << grab.begin_s - zero_s << " s something else than image "
                         << testing::PrintToString(may) << " was seen";
    ++compared;
    sure += may.size() == 1 ? 1 : 0;
    if (found >= 0) {
      ++lit;
      images.insert(found);
    }
  }
  RecordProperty("grabs", compared);
  RecordProperty("grabs_of_images", lit);
  RecordProperty("grabs_that_could_only_be_one", sure);
  EXPECT_GE(lit, 10);
  EXPECT_GE(images.size(), 10U);
}

TEST_F(BridgeScreen, EveryFrameIsSeenOnceInOrderAndAsItIs) {
  const std::string mesh = test::real_file("meshes/clean/3DBenchy.stl");
  SLICECORR_NEEDS_FILE(mesh);
  expect_every_frame_seen(mesh, false);
}

/// All of its 4800 slices: 216 s.
class BridgeScreenNight : public BridgeScreen {};

TEST_F(BridgeScreenNight, EveryFrameOfAWholeBenchyIsSeen) {
  const std::string mesh = test::real_file("meshes/clean/3DBenchy.stl");
  SLICECORR_NEEDS_FILE(mesh);
  expect_every_frame_seen(mesh, true);
}

// One of those involved is killed in the middle.

class BridgeScreenKill : public BridgeScreen {
 protected:
  void SetUp() override {
    BridgeScreen::SetUp();
    if (IsSkipped()) return;
    server.emplace(96, 64);
    printer = make_printer("patient", patient());
    stack = make_stack(printer);
    sim = start_sim(printer, false);
    print.emplace(with_window(print_command(stack, printer, sim, false)), folder / "print.err");
    ASSERT_TRUE(wait_until([&] { return happened(sim.events, "frame 5"); }))
        << text_of(folder / "print.err");
    ASSERT_TRUE(has(events_of(sim.events), "blue on"));
  }
  bool is_black() {
    const auto seen = Onlooker().grab();
    return std::all_of(seen.begin(), seen.end(), [](std::uint32_t p) { return p == 0; });
  }

  std::optional<Xvfb> server;
  std::string printer, stack;
  Sim sim;
  std::optional<Child> print;
};

TEST_F(BridgeScreenKill, TheDisplayServer) {
  server->server().end(SIGKILL);
  EXPECT_EQ(print->wait(), 4);
  const std::string says = text_of(folder / "print.err");
  EXPECT_THAT(says, HasSubstr("display_gone"));
  EXPECT_THAT(says, HasSubstr("the display server is gone"));
  // The order of every fault, as the machine saw it.
  const auto events = events_of(sim.events);
  const int stop = place(events, "stop");
  ASSERT_GE(stop, 0);
  EXPECT_LT(last_place(events, "blue off"), stop);
  EXPECT_LT(last_place(events, "blue on"), last_place(events, "blue off"));
  EXPECT_GT(place(events, "black", stop), stop) << "on the displays that there still are";
  EXPECT_EQ(place(events, "watchdog"), -1) << "nobody had to do it for the bridge";
  EXPECT_EQ(status(printer)["latched"], true);
  EXPECT_EQ(status(printer)["fault"], "display_gone");
}

TEST_F(BridgeScreenKill, TheBridge) {
  EXPECT_EQ(print->end(SIGKILL), 128 + SIGKILL);
  // Its window goes with it, and what is behind is black; lamps are the machine's watchdog's.
  EXPECT_TRUE(wait_until([&] { return is_black(); }));
  ASSERT_TRUE(wait_until([&] { return happened(sim.events, "watchdog"); }));
  const auto events = events_of(sim.events);
  EXPECT_GT(last_place(events, "blue off"), last_place(events, "blue on"));
  EXPECT_EQ(status(printer)["latched"], true);
}

TEST_F(BridgeScreenKill, TheSimulator) {
  sim.child->end(SIGKILL);
  EXPECT_EQ(print->wait(), 4) << text_of(folder / "print.err");
  EXPECT_TRUE(is_black());
  EXPECT_EQ(status(printer)["latched"], true);
}

TEST_F(BridgeScreenKill, NobodyButTheUserStopsIt) {
  EXPECT_FALSE(is_black());
  EXPECT_EQ(bridge({"stop"}, printer).exit_code, 0);
  EXPECT_EQ(print->wait(), 130);
  EXPECT_TRUE(is_black());
}

TEST_F(BridgeScreen, AWindowOfAnotherSizeIsRefusedBeforeAnythingMoves) {
  part_cell_mm = 0.6;
  Xvfb server(97, 64);
  const std::string printer = make_printer("plain");
  const std::string stack = make_stack(printer);
  Sim sim = start_sim(printer, true);
  const RunResult r = run_program(with_window(print_command(stack, printer, sim, true)));
  EXPECT_EQ(r.exit_code, 2);
  EXPECT_THAT(r.err, HasSubstr("97 x 64"));
  EXPECT_THAT(r.err, HasSubstr("96 x 64"));
  sim.child->end(SIGTERM);
  const auto events = events_of(sim.events);
  EXPECT_FALSE(has(events, "stage moves"));
  EXPECT_FALSE(has(events, "blue on"));
  EXPECT_EQ(status(printer)["latched"], false);
}

TEST_F(BridgeScreen, PrintsIntoAWindowInLockstep) {
  part_cell_mm = 0.6;
  Xvfb server(96, 64);
  const std::string printer = make_printer("plain");
  const std::string stack = make_stack(printer);
  Sim sim = start_sim(printer, true);
  const RunResult r = run_program(with_window(print_command(stack, printer, sim, true)));
  EXPECT_EQ(r.exit_code, 0) << r.err;
  EXPECT_EQ(sim.child->end(SIGTERM), 0);
  EXPECT_EQ(static_cast<int>(rows().size()), StackReader::read_info(stack).grid.layers);
}

}  // namespace
}  // namespace slicecorr
