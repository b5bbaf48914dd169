// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// UV images on a display of their own, speeds of slices and suction limits, with the programs: what
// both displays showed is compared with the stack bit for bit and in time, every fault ends in its
// order, and what does not fit is refused before anything moves.

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <cmath>
#include <map>

#include "bridge_fixture.hpp"
#include "ladder.hpp"
#include "meshes.hpp"
#include "rounds.hpp"
#include "slicecorr/bridge/frames.hpp"
#include "slicecorr/recording.hpp"

namespace slicecorr {
namespace {

using namespace slicecorr::test;
using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;

class BridgeTwoDisplays : public BridgePrograms {
 protected:
  /// A small printer whose UV light is patterned. `table`: of its UV display.
  std::string patterned_printer(const std::string& name, const std::string& table = "") {
    return make_printer(name, {{"kind = \"flood\"", "kind = \"patterned\""},
                               {"\n[modbus]\n", "\n" + table + "\n[modbus]\n"}});
  }
  std::string uv_stack(const std::string& printer, const std::string& name = "part") {
    return make_stack(printer, name,
                      {"--resin", "custom-resin-1", "--speed-mm-h", "300", "--dead-zone-um", "5"});
  }
  struct Displays {
    Sim sim;
    std::string uv;
  };
  Displays start(const std::string& printer, std::vector<std::string> more = {}) {
    const std::string uv = "unix:" + (folder / ("uv" + std::to_string(++count_)));
    more.insert(more.end(), {"--uv-frames", uv});
    return {start_sim(printer, true, more), uv};
  }
  RunResult print(const std::string& stack, const std::string& printer, const Displays& d,
                  std::vector<std::string> more = {}) {
    more.insert(more.end(), {"--uv-sink", d.uv});
    return run_program(print_command(stack, printer, d.sim, true, more));
  }
  /// When the machine saw each event first.
  static std::map<std::string, double> times_of(const std::string& path) {
    std::map<std::string, double> times;
    for (const json& line : lines_of(path)) {
      times.emplace(line.at("event").get<std::string>(), line.at("at_s").get<double>());
    }
    return times;
  }
  json verify(const std::string& stack, const std::string& target,
              const std::vector<std::string>& more = {}) {
    std::vector<std::string> command{
        program("slicecorr"), "verify", stack, "--target", target, "--json", "-", "--quiet"};
    command.insert(command.end(), more.begin(), more.end());
    const RunResult r = run_program(command);
    EXPECT_EQ(r.exit_code, 0) << r.err;
    return json::parse(r.out, nullptr, false);
  }
  /// The table of frames, by column.
  std::map<std::string, std::vector<double>> frame_log() const {
    std::ifstream csv(folder / "state/dual-wavelength-dlp/frames.csv");
    std::string line;
    std::getline(csv, line);
    std::vector<std::string> names;
    std::istringstream head(line);
    for (std::string name; std::getline(head, name, ',');) names.push_back(name);
    std::map<std::string, std::vector<double>> columns;
    while (std::getline(csv, line)) {
      std::istringstream cells(line);
      std::size_t at = 0;
      for (std::string cell; std::getline(cells, cell, ',') && at < names.size(); ++at) {
        columns[names[at]].push_back(cell.empty() ? NAN : std::stod(cell));
      }
    }
    return columns;
  }
  /// UV images come so much ahead of those of blue light, by the simulator's clock, which is exact in
  /// lockstep.
  static void expect_uv_ahead(const std::string& events, int slices, double seconds) {
    const auto times = times_of(events);
    for (int n = 0; n < slices; ++n) {
      const auto blue = times.find(fmt::format("frame {}", n)),
                 uv_at = times.find(fmt::format("uv frame {}", n));
      ASSERT_TRUE(blue != times.end() && uv_at != times.end()) << n;
      EXPECT_NEAR(blue->second - uv_at->second, seconds, 1e-6) << n;
    }
  }
  /// Nothing has moved or shone.
  static void expect_untouched(const std::string& events) {
    for (const std::string& e : events_of(events)) {
      EXPECT_FALSE(e == "stage moves" || e == "blue on" || e == "uv on" || e == "run") << e;
    }
  }
  int count_ = 0;
};

TEST_F(BridgeTwoDisplays, BothShowWhatTheStackHasEachAtItsMoment) {
  part_cell_mm = 1;
  const std::string printer =
      patterned_printer("two", "[uv_display]\norientation = \"portrait\"\nmirror = \"x\"\n");
  const std::string stack_path = uv_stack(printer);
  const Displays d = start(printer);
  const RunResult r = print(stack_path, printer, d);
  ASSERT_EQ(r.exit_code, 0) << r.err;
  EXPECT_EQ(d.sim.child->end(SIGTERM), 0);

  const StackReader stack(stack_path, folder.path()), shown(d.sim.shown, folder.path());
  const Grid grid = stack.grid();
  const auto pixels =
      static_cast<std::size_t>(grid.width_px) * static_cast<std::size_t>(grid.height_px);
  ASSERT_TRUE(stack.has_uv_images() && shown.has_uv_images());
  ASSERT_TRUE(shown.info().recording);
  const Recording& recording = *shown.info().recording;
  EXPECT_EQ(recording.other_uv_images, std::vector<int>{});
  // The image that gave each slice its light is that of the stack, of blue and of UV light.
  std::vector<std::uint8_t> want(pixels), have(pixels);
  int lit = 0, with_uv = 0;
  for (int n = 0; n < grid.layers; ++n) {
    const auto parts = recording.of(n);
    const auto most = std::max_element(
        parts.begin(), parts.end(), [](const auto& a, const auto& b) { return a.light < b.light; });
    ASSERT_NE(most, parts.end()) << n;
    ASSERT_GE(most->image, 0) << n;
    EXPECT_NEAR(most->light, 1, 0.01) << n;
    stack.read_slice(n, want.data());
    shown.read_slice(most->image, have.data());
    ASSERT_EQ(have, want) << n;
    lit += std::any_of(want.begin(), want.end(), [](auto v) { return v > 0; }) ? 1 : 0;
    stack.read_uv_slice(n, want.data());
    shown.read_uv_slice(most->image, have.data());
    ASSERT_EQ(have, want) << n;
    with_uv += std::any_of(want.begin(), want.end(), [](auto v) { return v > 0; }) ? 1 : 0;
  }
  EXPECT_GT(lit, 20);
  EXPECT_GT(with_uv, 20);

  // What went to the UV display was turned as its table says: x of the plate up, y to the left,
  // then left and right swapped. By hand, because the recorder turns it back.
  const bridge::Machine machine = bridge::load_machine(printer);
  const auto frames = bridge::make_frame_source(stack, machine, true);
  const auto frame = frames->make(grid.layers / 2);
  ASSERT_TRUE(frame->on_uv_display);
  EXPECT_TRUE(frame->uv.empty());
  const bridge::Frame& uv = *frame->on_uv_display;
  EXPECT_EQ(uv.width_px, grid.height_px);
  EXPECT_EQ(uv.height_px, grid.width_px);
  stack.read_uv_slice(grid.layers / 2, want.data());
  const auto w = static_cast<std::size_t>(grid.width_px), h = pixels / w;
  for (std::size_t y = 0; y < h; ++y) {
    for (std::size_t x = 0; x < w; ++x) {
      ASSERT_EQ(uv.blue[(w - 1 - x) * h + (h - 1 - y)], want[y * w + x]) << x << ", " << y;
    }
  }
  stack.read_slice(grid.layers / 2, want.data());
  EXPECT_EQ(frame->blue, want);

  expect_uv_ahead(d.sim.events, grid.layers, 0);
  const auto log = frame_log();
  ASSERT_EQ(log.at("uv_late_um").size(), static_cast<std::size_t>(grid.layers));
  for (std::size_t n = 0; n < log.at("uv_late_um").size(); ++n) {
    EXPECT_NEAR(log.at("uv_late_um")[n], 0, 0.5) << n;
    EXPECT_NEAR(log.at("uv_shown_s")[n], log.at("shown_s")[n], 1e-5) << n;
  }
  // Black first, UV on before blue and off after it, the UV display dark at the end.
  const auto events = events_of(d.sim.events);
  EXPECT_LT(place(events, "uv black"), place(events, "uv on"));
  EXPECT_LT(place(events, "black"), place(events, "blue on"));
  EXPECT_LT(place(events, "uv on"), place(events, "blue on"));
  EXPECT_LT(last_place(events, "blue off"), last_place(events, "uv off"));
  EXPECT_LT(last_place(events, "uv off"), last_place(events, "uv black"));
  // The part became what the stack says.
  const std::string target = folder / "part-target.uvj";
  const json planned = verify(stack_path, target), printed = verify(d.sim.shown, target);
  EXPECT_EQ(printed["lost_features"], planned["lost_features"]);
  EXPECT_NEAR(printed["iou"].get<double>(), planned["iou"].get<double>(), 0.01);
  const json s = status(printer);
  EXPECT_EQ(s["phase"], "done");
  EXPECT_EQ(s["uv_display"], d.uv);
}

TEST_F(BridgeTwoDisplays, AUvDisplayThatTakesLongerIsToldEarlier) {
  part_cell_mm = 0.6;
  // 20 ms from image to light. The simulator's displays show what they get at once, so its record has
  // the UV images so much too early; what is judged is when they were told.
  const std::string printer = patterned_printer("late", "[uv_display]\nlatency_s = 0.02\n");
  const std::string stack_path = uv_stack(printer);
  const Displays d = start(printer);
  const RunResult r = print(stack_path, printer, d);
  ASSERT_EQ(r.exit_code, 0) << r.err;
  EXPECT_EQ(d.sim.child->end(SIGTERM), 0);
  expect_uv_ahead(d.sim.events, StackReader(stack_path, folder.path()).grid().layers, 0.02);
}

TEST_F(BridgeTwoDisplays, WithoutATableItIsAsTheBlueDisplayAndWithoutUvLightDark) {
  part_cell_mm = 0.6;
  const std::string printer = patterned_printer("plain");
  // --uv-sink alone makes a second display.
  const Displays d = start(printer);
  const RunResult r = print(uv_stack(printer), printer, d, {"--dry-run"});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  EXPECT_EQ(d.sim.child->end(SIGTERM), 0);
  EXPECT_GE(place(events_of(d.sim.events), "uv frame 5"), 0);
  // In a channel of one display where there is no second.
  Sim one = start_sim(printer, true);
  EXPECT_EQ(
      run_program(print_command(folder / "part.uvj", printer, one, true, {"--dry-run"})).exit_code,
      0);
  EXPECT_EQ(one.child->end(SIGTERM), 0);
  EXPECT_EQ(place(events_of(one.events), "uv frame 5"), -1);
  // A stack without UV light: the UV display shows its frames, dark.
  const std::string dark = make_stack(printer, "dark");
  const Displays other = start(printer);
  const RunResult printed = print(dark, printer, other);
  ASSERT_EQ(printed.exit_code, 0) << printed.err;
  EXPECT_EQ(other.sim.child->end(SIGTERM), 0);
  const auto events = events_of(other.sim.events);
  EXPECT_GE(place(events, "uv frame 5"), 0);
  EXPECT_EQ(place(events, "uv on"), -1);
}

TEST_F(BridgeTwoDisplays, FaultsOfTheUvDisplayEndInTheirOrder) {
  part_cell_mm = 1;
  const std::string printer = patterned_printer("two", "[uv_display]\nmirror = \"y\"\n");
  const std::string stack = uv_stack(printer);
  bool first = true;
  for (const auto& [fault, name] : std::vector<std::pair<std::string, std::string>>{
           {"late-uv-frame=0.2@frame:11", "late_frame"},
           {"freeze-uv-display@frame:8", "wrong_frame"},
           {"uv-display-gone@frame:5", "display_gone"},
           {"door@frame:7", "door_open"}}) {
    SCOPED_TRACE(fault);
    state_name = "state-" + name;
    const Displays d = start(printer, {"--fault", fault});
    const RunResult r = print(stack, printer, d);
    EXPECT_EQ(r.exit_code, 4) << r.err;
    EXPECT_THAT(r.err, HasSubstr(name));
    if (name != "door_open") {
      EXPECT_THAT(r.err, HasSubstr("UV "));
    }
    d.sim.child->end(SIGTERM);
    const auto events = events_of(d.sim.events);
    const int stop = place(events, "stop");
    ASSERT_GE(stop, 0);
    EXPECT_LT(last_place(events, "blue off"), stop);
    EXPECT_LT(last_place(events, "uv off"), stop);
    EXPECT_EQ(place(events, "blue on", stop), -1);
    const int black = place(events, "black", stop);
    EXPECT_GT(black, stop);
    // The UV display goes dark after the blue one.
    if (name == "late_frame" || name == "door_open") {
      EXPECT_GT(place(events, "uv black", stop), black);
      EXPECT_EQ(place(events, "uv black", place(events, "uv frame 0")),
                place(events, "uv black", stop));
    }
    const json s = status(printer);
    EXPECT_EQ(s["latched"], true);
    EXPECT_EQ(s["fault"], name);
    // A reset, whatever it was: by day after the first.
    if (!first && !by_night()) continue;
    first = false;
    Sim calm = start_sim(printer, true, {"--uv-frames", "unix:" + (folder / "calm-" + name)});
    EXPECT_EQ(bridge({"reset"}, printer, {"--modbus", address_of(calm.modbus)}).exit_code, 0);
  }
}

TEST_F(BridgeTwoDisplays, WhatDoesNotFitIsRefusedBeforeAnythingMoves) {
  part_cell_mm = 1;
  const std::string printer =
      patterned_printer("two", "[uv_display]\norientation = \"portrait\"\n");
  const std::string stack = uv_stack(printer);
  const Displays d = start(printer);
  const auto refuse = [&](const std::vector<std::string>& command, int code,
                          const std::string& why) {
    const RunResult r = run_program(command);
    EXPECT_EQ(r.exit_code, code) << r.err;
    EXPECT_THAT(r.err, HasSubstr(why));
  };
  // The table asks for a display.
  refuse(print_command(stack, printer, d.sim, true), 2, "expected --uv-sink");
  refuse(print_command(stack, printer, d.sim, true, {"--uv-sink", "lp0"}), 2, "window[:DISPLAY]");
  refuse(print_command(stack, printer, d.sim, true, {"--uv-sink", d.sim.frames}), 2, "twice");
  // A lamp that floods the window has none.
  refuse(print_command(stack, make_printer("flood"), d.sim, true, {"--uv-sink", d.uv}), 2,
         "patterned");
  // UV images that are damaged, missing or others.
  const auto changed = [&](const std::string& name, const auto& change) {
    Entries entries = unzip(stack);
    change(entries);
    make_zip(folder / name, entries);
    return print_command(folder / name, printer, d.sim, true, {"--uv-sink", d.uv});
  };
  refuse(changed("missing.uvj",
                 [](Entries& e) {
                   std::erase_if(e, [](const auto& one) { return one.first == "uv/00000007.png"; });
                 }),
         2, "00000007");
  refuse(changed("swapped.uvj",
                 [](Entries& e) { entry(e, "uv/00000004.png") = entry(e, "uv/00000000.png"); }),
         2, "checksum");
  refuse(changed("spoilt.uvj", [](Entries& e) { entry(e, "uv/00000004.png").resize(40); }), 2,
         "00000004");
  d.sim.child->end(SIGTERM);
  expect_untouched(d.sim.events);
  EXPECT_EQ(status(printer)["latched"], false);
  // A display that was given the other's images.
  const Displays swapped = start(printer);
  Displays wrong = start(printer);
  refuse({program("printbridge"), "print", stack, "--printer", printer, "--dir", folder / "state",
          "--modbus", address_of(swapped.sim.modbus), "--sink", swapped.uv, "--uv-sink",
          swapped.sim.frames, "--lockstep"},
         4, "gone");
  swapped.sim.child->end(SIGTERM);
  expect_untouched(swapped.sim.events);
  // The simulator's own options.
  refuse({program("printer-sim"), "--printer", printer, "--uv-frames", "unix:" + (folder / "x")}, 2,
         "--frames");
  refuse({program("printer-sim"), "--printer", printer, "--frames", "unix:" + (folder / "x")}, 2,
         "--uv-frames");
  refuse({program("printer-sim"), "--printer", make_printer("flood"), "--frames",
          "unix:" + (folder / "x"), "--uv-frames", "unix:" + (folder / "y")},
         2, "patterned");
}

TEST_F(BridgeTwoDisplays, AProfileOfSpeedsIsFollowedAndTheDoseStays) {
  const std::string printer = make_printer("plain");
  const std::string csv = folder / "speeds.csv";
  write_file(csv, to_bytes("slice,speed_mm_h\n0,300\n6,800\n15,200\n18,500\n"));
  const std::string even = make_stack(printer, "even");
  const std::string stack = make_stack(
      printer, "part", {"--resin", "figure-2-2", "--speed-mm-h", "800", "--slice-speed-mm-h", csv});
  // The light of slices is as without: images are the same, what differs is the time.
  const StackInfo info = StackReader::read_info(stack), plain = StackReader::read_info(even);
  ASSERT_EQ(info.process->slice_speed_mm_h.size(), 19U);
  EXPECT_EQ(unzip(stack).size(), unzip(even).size());
  {
    Entries a = unzip(stack), b = unzip(even);
    for (const char* name : {"slice/00000003.png", "slice/00000016.png", "slice/00000030.png"}) {
      EXPECT_EQ(entry(a, name), entry(b, name)) << name;
    }
    EXPECT_THAT(to_text(entry(a, "config.json")), HasSubstr("\"format\": 8"));
  }
  Sim sim = start_sim(printer, true);
  const RunResult r = run_program(print_command(stack, printer, sim, true));
  ASSERT_EQ(r.exit_code, 0) << r.err;
  EXPECT_THAT(r.err, HasSubstr("slices from 200 mm/h on"));
  EXPECT_EQ(sim.child->end(SIGTERM), 0);
  const StackInfo shown = StackReader::read_info(sim.shown);
  ASSERT_TRUE(shown.recording);
  double least = 1;
  for (int n = 0; n < plain.grid.layers; ++n) {
    double light = 0, fastest = 0;
    for (const auto& part : shown.recording->of(n)) {
      // The lamp is on behind black before the first slice and after the last one.
      if (part.image >= 0) light += part.light;
      fastest = std::max(fastest, part.speed_um_s);
    }
    // None faster than its own speed; the steps of the register on top.
    EXPECT_LE(fastest, slice_speed_mm_h(*info.process, n) / 3.6 + 0.01) << n;
    // Where speeds change the lamp is behind by its time and a cycle.
    const double change =
        (std::abs(slice_speed_mm_h(*info.process, n) - slice_speed_mm_h(*info.process, n + 1)) +
         std::abs(slice_speed_mm_h(*info.process, n) - slice_speed_mm_h(*info.process, n - 1))) /
        800;
    EXPECT_NEAR(light, 1, 0.006 + change * 0.015 / (50 * 3.6 / 800)) << n;
    least = std::min(least, light);
  }
  const std::string target = folder / "part-target.uvj";
  const json planned = verify(stack, target), printed = verify(sim.shown, target);
  EXPECT_EQ(planned["height_error_um"],
            verify(even, folder / "even-target.uvj")["height_error_um"]);
  EXPECT_EQ(planned["lost_features"], 0);
  // The correction gives features of one slice their dose and no more: those are lost that one slice
  // leaves short, at most as many as if all slices had as little light as the dimmest.
  const double dose_mj_cm3 = info.resin->critical_dose_mj_cm3;
  const json dim = verify(stack, target, {"--dc-mj-cm3", fmt::format("{}", dose_mj_cm3 / least)});
  EXPECT_LE(printed["lost_features"], dim["lost_features"]);
  EXPECT_NEAR(printed["iou"].get<double>(), planned["iou"].get<double>(), 0.01);
  EXPECT_NEAR(printed["height_error_um"]["mean_abs"].get<double>(),
              planned["height_error_um"]["mean_abs"].get<double>(), 1);

  // A lamp that is dark at a quarter of its light, a machine that can't go as fast.
  const auto refuse = [&](const std::string& with, const std::string& why) {
    Sim other = start_sim(with, true);
    const RunResult refused = run_program(print_command(stack, with, other, true));
    EXPECT_EQ(refused.exit_code, 3) << refused.err;
    EXPECT_THAT(refused.err, HasSubstr(why));
    other.child->end(SIGTERM);
    expect_untouched(other.events);
  };
  refuse(make_printer("dim", {{"min_share = 0.02", "min_share = 0.3"}}),
         "slice 15 goes at 200 mm/h");
  refuse(make_printer("slow", {{"max_speed_mm_h = 2000", "max_speed_mm_h = 700"}}), "700 mm/h");

  // Tables that make no sense, before anything is corrected.
  const auto bad = [&](const std::string& text, const std::string& why) {
    write_file(csv, to_bytes(text));
    const RunResult refused = run_program(
        {program("slicecorr"), "correct", target, "-o", folder / "no.uvj", "--printer", printer,
         "--resin", "figure-2-2", "--speed-mm-h", "800", "--slice-speed-mm-h", csv, "--quiet"});
    EXPECT_EQ(refused.exit_code, 2) << text << refused.err;
    EXPECT_THAT(refused.err, HasSubstr(why)) << text;
  };
  bad("slice,speed_mm_h\n0,900\n", "at most the 800 mm/h");
  bad("slice,speed_mm_h\n1,300\n", "slice 0");
  bad("slice,speed_mm_h\n0,300\n4,200\n4,100\n", "above 4");
  bad("slice,speed_mm_h\n0,0\n", "above 0");
  bad("slice,speed_mm_h\n0,-3\n", "above 0");
  bad("slice,speed_mm_h\n0,fast\n", "no number");
  bad("slice,speed_mm_h\n0,nan\n", "no number");
  bad("slice,speed\n0,300\n", "head slice,speed_mm_h");
  bad("slice,speed_mm_h\n0,300,4\n", "two columns");
  bad("", "has no rows");
  write_file(csv, to_bytes("slice,speed_mm_h\n0,300\n"));
  const RunResult layerwise =
      run_program({program("slicecorr"), "correct", target, "-o", folder / "no.uvj", "--printer",
                   printer, "--resin", "figure-2-2", "--mode", "layerwise", "--exposure-s", "2",
                   "--slice-speed-mm-h", csv, "--quiet"});
  EXPECT_EQ(layerwise.exit_code, 2);
  EXPECT_THAT(layerwise.err, HasSubstr("continuous"));
}

TEST_F(BridgeTwoDisplays, AnEvenDeadZoneIsPrintedWithBothLightsByPlace) {
  // Much light at the outline, where resin stays for a moment only, and nowhere more than what UV light holds off the
  // window: before the flow is steady it would stick.
  const std::string printer = make_printer("even", {{"kind = \"flood\"", "kind = \"patterned\""},
                                                    {"calibration = [[0, 1.0], [255, 100.0]]",
                                                     "calibration = [[0, 0.0], [255, 200.0]]"}});
  const std::string resin = folder / "resin.toml";
  write_file(resin, to_bytes("name = \"r2\"\nviscosity_pa_s = 0.3\ndose_diffusion_m2_s = 1e-10\n"
                             "[cure]\nmodel = \"jacobs\"\nabsorbance_height_um = 408\n"
                             "absorbance_base = \"e\"\ncritical_dose_mj_cm3 = 1600\n"
                             "[inhibition]\nbeta = 0.799895\nabsorbance_height_um = 38\n"
                             "absorbance_base = \"e\"\n"));
  const std::string target = folder / "target.uvj", stack_path = folder / "part.uvj";
  write_stl(folder / "box.stl", box({0, 0, 0}, {4, 2.8, 0.5}));
  for (const std::vector<std::string>& command :
       {std::vector<std::string>{"slice", folder / "box.stl", "-o", target, "--layer-um", "50"},
        {"correct", target, "-o", stack_path, "--resin", resin, "--speed-mm-h", "300", "--ramp",
         "outside", "--even-dead-zone", "both", "--gap-um", "100"}}) {
    std::vector<std::string> whole{program("slicecorr")};
    whole.insert(whole.end(), command.begin(), command.end());
    whole.insert(whole.end(), {"--printer", printer, "--quiet"});
    const RunResult made = run_program(whole);
    ASSERT_EQ(made.exit_code, 0) << made.err;
  }
  const StackReader stack(stack_path, folder.path());
  const auto pixels = static_cast<std::size_t>(96 * 64);
  std::vector<std::uint8_t> blue(pixels), uv(pixels);
  int outweighed = 0;
  for (int n = 0; n < stack.grid().layers; ++n) {
    stack.read_slice(n, blue.data());
    stack.read_uv_slice(n, uv.data());
    for (std::size_t i = 0; i < pixels; ++i) {
      outweighed += blue[i] * 200.0 > 0.799895 * uv[i] * 275.0 ? 1 : 0;
    }
  }
  ASSERT_EQ(outweighed, 0);
  shown_ending = "";  // such prints can't be recorded
  const Displays d = start(printer);
  const RunResult r = print(stack_path, printer, d);
  EXPECT_EQ(r.exit_code, 0) << r.err;
  EXPECT_EQ(d.sim.child->end(SIGTERM), 0);
}

TEST_F(BridgeTwoDisplays, AStackForAVatThatBearsMoreIsRefused) {
  part_cell_mm = 0.6;
  const auto vat = [&](const std::string& name, double limit_pa) {
    if (limit_pa == 0) return make_printer(name);
    return make_printer(
        name, {{"name = \"dual-wavelength-dlp\"",
                fmt::format("name = \"dual-wavelength-dlp\"\nsuction_limit_pa = {}", limit_pa)}});
  };
  const std::string made = vat("made", 20000), stack = make_stack(made);
  const std::string unlimited = make_stack(vat("none", 0), "unlimited");
  Sim sim = start_sim(made, true);
  const auto print_on = [&](const std::string& file, const std::string& printer) {
    return run_program(print_command(file, printer, sim, true, {"--dry-run"}));
  };
  const RunResult less = print_on(stack, vat("less", 15000));
  EXPECT_EQ(less.exit_code, 2);
  EXPECT_THAT(less.err, AllOf(HasSubstr("20000 Pa"), HasSubstr("15000 Pa"),
                              HasSubstr("another printer"), HasSubstr("suction_limit_pa")));
  const RunResult never = print_on(unlimited, vat("less", 15000));
  EXPECT_EQ(never.exit_code, 2);
  EXPECT_THAT(never.err, AllOf(HasSubstr("not limited"), HasSubstr("15000 Pa")));
  sim.child->end(SIGTERM);
  expect_untouched(sim.events);
  // The same limit, a vat that bears more, and one of which nothing is said.
  for (const auto& [name, limit_pa] : std::vector<std::pair<std::string, double>>{
           {"same", 20000}, {"more", 30000}, {"unsaid", 0}}) {
    SCOPED_TRACE(name);
    sim = start_sim(made, true);
    EXPECT_EQ(print_on(stack, vat(name, limit_pa)).exit_code, 0);
    sim.child->end(SIGTERM);
  }
}

}  // namespace
}  // namespace slicecorr
