// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// printbridge and printer-sim as programs, over real sockets. Where time matters it is the
// simulator's (lockstep); where processes are killed or paused it is real, with limits that a busy
// machine does not pass.

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <array>
#include <cmath>
#include <filesystem>

#include "bridge_fixture.hpp"
#include "real_files.hpp"
#include "rounds.hpp"
#include "stack/block_check.hpp"

namespace slicecorr {
namespace {

using namespace slicecorr::test;
using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;

class BridgePrint : public BridgePrograms {
 protected:
  json verify(const std::string& stack, const std::string& target) {
    RunOptions long_one;
    long_one.timeout = std::chrono::minutes(5);
    const RunResult r = run_program(
        {program("slicecorr"), "verify", stack, "--target", target, "--json", "-", "--quiet"},
        long_one);
    EXPECT_EQ(r.exit_code, 0) << r.err;
    return json::parse(r.out, nullptr, false);
  }
  struct Bound {
    double mean_um = 0, most_um = 0;
  };
  /// How far the predicted edges of a recording may be from those of its stack (resin figure-2-2,
  /// 1 to 100 mW/cm², 800 mm/h), by the frame log of the print.
  ///
  /// While frame n is late by q of a slice the one before it stays: the slice's relative intensity
  /// phi changes by q (phi[n - 1] - phi[n]); a lamp that is off by e changes it by e phi[n]. A
  /// slice adds eta ln10 phi[n] to the dose of its layer and less by its absorbance to each one
  /// below. Black with the lamp on after the last slice, two cycles long, adds its share of one
  /// slice. An edge moves by the error of its dose over the slope there, eta ln10 |phi - 1| per
  /// layer, and corrections put dark or full light at edges (docs/recording.md). Largest and mean
  /// over all edges of the target's columns, with the largest error of each column.
  Bound edges_within(const std::string& stack_path, const std::string& target_path,
                     double layer_um) {
    const double critical = 576 * 800 / 36000.0, phi_min = 1 / critical;
    std::ifstream csv(folder / "state/dual-wavelength-dlp/frames.csv");
    std::string line;
    std::getline(csv, line);
    std::vector<double> late, off;  // shares of a slice, of light
    while (std::getline(csv, line)) {
      std::vector<double> row;
      std::istringstream cells(line);
      for (std::string cell; row.size() < 11 && std::getline(cells, cell, ',');) {
        row.push_back(std::stod(cell));
      }
      EXPECT_GE(row.size(), 11U) << line;
      // Half a digit of what the log has.
      late.push_back((std::abs(row.at(5)) + 5e-7) / layer_um);
      off.push_back(std::abs(row.at(9) - 1) + 5e-7);
    }
    const StackReader stack(stack_path, folder.path()), target(target_path, folder.path());
    const int slices = stack.info().grid.layers;
    EXPECT_EQ(static_cast<int>(late.size()), slices);
    const auto pixels = static_cast<std::size_t>(stack.info().grid.width_px) *
                        static_cast<std::size_t>(stack.info().grid.height_px);
    const auto image = [&](const StackReader& of, int n) {
      std::vector<std::uint8_t> levels(pixels, 0);
      if (n >= 0 && n < of.info().grid.layers) of.read_slice(n, levels.data());
      return levels;
    };
    const double slope = layer_um / 2000 * std::log(10.0);
    // Of the slice above, at its upper side: black.
    std::vector<double> error(pixels, 2 * 0.01 * 800 / 3.6 / layer_um * phi_min * slope);
    auto here = image(stack, slices - 1), part = image(target, slices);
    Bound bound;
    int edges = 0;
    for (int n = slices - 1; n >= 0; --n) {
      const auto before = image(stack, n - 1), solid = image(target, n);
      const auto i = static_cast<std::size_t>(n);
      for (std::size_t p = 0; p < pixels; ++p) {
        const auto phi = [&](std::uint8_t v) { return (1 + 99 * v / 255.0) / critical; };
        const double change = std::abs(phi(before[p]) - phi(here[p]));
        const double above = error[p];
        error[p] = above * std::exp(-slope) + slope * (late[i] * change + off[i] * phi(here[p]));
        if ((solid[p] >= 128) == (part[p] >= 128)) continue;
        // The edge lies in one of the two slices.
        const double um = layer_um * std::max(above, error[p]) / (slope * (1 - phi_min));
        bound.most_um = std::max(bound.most_um, um);
        bound.mean_um += um;
        ++edges;
      }
      here = before;
      part = solid;
    }
    bound.mean_um /= std::max(edges, 1);
    return bound;
  }
  /// What both predict is the same within the bound.
  void expect_same_part(const std::string& stack, const std::string& shown,
                        const std::string& target, double layer_um) {
    const json planned = verify(stack, target), printed = verify(shown, target);
    ASSERT_TRUE(planned.is_object() && printed.is_object());
    const Bound bound = edges_within(stack, target, layer_um);
    RecordProperty("mean_within_um", fmt::format("{:.4f}", bound.mean_um));
    RecordProperty("each_within_um", fmt::format("{:.4f}", bound.most_um));
    const json &a = planned["height_error_um"], &b = printed["height_error_um"];
    ASSERT_GT(a["edges"].get<int>(), 100);
    EXPECT_EQ(a["edges"], b["edges"]);
    for (const char* figure : {"mean_abs", "p95_abs", "max_abs"}) {
      const double within = figure == std::string("mean_abs") ? bound.mean_um : bound.most_um;
      EXPECT_NEAR(b[figure].get<double>(), a[figure].get<double>(), within) << figure;
      RecordProperty(figure,
                     fmt::format("planned {} printed {}", a[figure].dump(), b[figure].dump()));
    }
    EXPECT_LT(bound.mean_um, 0.05 * layer_um) << "else it says nothing";
    for (const char* figure : {"lost_features", "merged_features", "target_voxels"}) {
      EXPECT_EQ(printed[figure], planned[figure]) << figure;
    }
    EXPECT_NEAR(printed["iou"].get<double>(), planned["iou"].get<double>(), 1e-3);
  }
  /// No event of the simulator moves its stage or lights a lamp.
  static void expect_untouched(const std::string& events) {
    for (const std::string& e : events_of(events)) {
      EXPECT_FALSE(e == "stage moves" || e == "blue on" || e == "uv on" || e == "run") << e;
    }
  }
  /// Lamps off, then stop, then black: from the first event named `from` on.
  static void expect_order(const std::vector<std::string>& events) {
    const int stop = place(events, "stop");
    ASSERT_GE(stop, 0);
    const int off = last_place(events, "blue off");
    EXPECT_LT(off, stop);
    EXPECT_EQ(place(events, "blue on", stop), -1);
    EXPECT_EQ(place(events, "uv on", stop), -1);
    EXPECT_GT(place(events, "black", stop), stop);
  }
};

TEST_F(BridgePrint, PrintsAStackAndWhatWasShownIsWhatWasPlanned) {
  part_cell_mm = 1;
  const std::string printer = make_printer("plain");
  const std::string stack = make_stack(printer);
  Sim sim = start_sim(printer, true);
  const RunResult r = run_program(print_command(stack, printer, sim, true));
  ASSERT_EQ(r.exit_code, 0) << r.err;
  EXPECT_THAT(r.err, HasSubstr("printed"));
  EXPECT_EQ(sim.child->end(SIGTERM), 0);

  const auto events = events_of(sim.events);
  EXPECT_LT(place(events, "black"), place(events, "blue on"));
  EXPECT_LT(place(events, "blue on"), place(events, "frame 0"));
  EXPECT_EQ(place(events, "fault"), -1);
  // A row per frame, all in time.
  std::ifstream csv(folder / "state/dual-wavelength-dlp/frames.csv");
  std::string line;
  std::getline(csv, line);
  EXPECT_EQ(
      line,
      "frame,planned_z_um,z_um,planned_s,shown_s,late_um,speed_um_s,blue_share,uv_mw_cm2,blue_measured,uv_measured,late,stage_error_um,temperature_c,exposure_s,exposed_s,vblank,missed_vblanks,upload_s,present_s");
  int rows = 0;
  const StackInfo info = StackReader::read_info(stack);
  while (std::getline(csv, line)) ++rows;
  EXPECT_EQ(rows, info.grid.layers);
  // What the part became: as planned.
  const std::string target = folder / "part-target.uvj";
  expect_same_part(stack, sim.shown, target, 50);
  const json s = status(printer);
  EXPECT_EQ(s["phase"], "done");
  EXPECT_EQ(s["latched"], false);
  EXPECT_EQ(s["running"], false);

  // The same again: the record of a print in lockstep is the same, whatever else the machine does.
  Sim again = start_sim(printer, true);
  const auto first_events = text_of(sim.events);
  ASSERT_EQ(run_program(print_command(stack, printer, again, true, {"--threads", "1"})).exit_code,
            0);
  EXPECT_EQ(again.child->end(SIGTERM), 0);
  EXPECT_EQ(text_of(again.events), first_events);
}

TEST_F(BridgePrint, PrintsUnderUvLightAndLayerByLayer) {
  part_cells = 1;
  part_cell_mm = 0.6;
  const std::string printer = make_printer("plain", quick());
  for (const auto& more :
       {std::vector<std::string>{"--resin", "custom-resin-1", "--speed-mm-h", "300", "--uv-mw-cm2",
                                 "200"},
        std::vector<std::string>{"--resin", "custom-resin-1", "--speed-mm-h", "300",
                                 "--dead-zone-um", "10", "--uv-schedule", "per-slice", "--ramp",
                                 "lamp-follows", "--ramp-mm", "0.3"},
        std::vector<std::string>{"--resin", "figure-2-2", "--mode", "layerwise", "--exposure-s",
                                 "0.3", "--ha-um", "110"}}) {
    SCOPED_TRACE(testing::PrintToString(more));
    const std::string stack = make_stack(printer, "part", more);
    Sim sim = start_sim(printer, true);
    const RunResult r = run_program(print_command(stack, printer, sim, true));
    ASSERT_EQ(r.exit_code, 0) << r.err;
    EXPECT_EQ(sim.child->end(SIGTERM), 0);
    const auto events = events_of(sim.events);
    const bool uv = more[1] == "custom-resin-1";
    EXPECT_EQ(place(events, "uv on") >= 0, uv);
    if (uv) {
      EXPECT_LT(place(events, "uv on"), place(events, "blue on"));
      EXPECT_GT(last_place(events, "uv off"), last_place(events, "blue off"));
    }
    const std::string target = folder / "part-target.uvj";
    const json planned = verify(stack, target), printed = verify(sim.shown, target);
    EXPECT_EQ(printed["lost_features"], planned["lost_features"]);
    EXPECT_NEAR(printed["iou"].get<double>(), planned["iou"].get<double>(), 0.01);
  }
}

TEST_F(BridgePrint, DryRunMovesAndShowsWithoutLight) {
  part_cell_mm = 1;
  const std::string printer = make_printer("plain");
  const std::string stack = make_stack(printer);
  Sim sim = start_sim(printer, true);
  const RunResult r = run_program(print_command(stack, printer, sim, true, {"--dry-run"}));
  EXPECT_EQ(r.exit_code, 0) << r.err;
  sim.child->end(SIGTERM);
  const auto events = events_of(sim.events);
  EXPECT_TRUE(has(events, "frame 3"));
  EXPECT_TRUE(has(events, "stage moves"));
  EXPECT_FALSE(has(events, "blue on"));
  EXPECT_FALSE(has(events, "uv on"));
}

TEST_F(BridgePrint, FaultsEndInTheirOrderLatchAndAreReset) {
  part_cell_mm = 1;
  const std::string printer = make_printer("plain");
  const std::string stack = make_stack(printer);
  const std::vector<std::pair<std::string, std::string>> cases{
      {"door@frame:9", "door_open"},
      {"stage-slips=80@frame:12", "stage_error"},
      {"lamp-drifts=0.3@frame:7", "lamp_mismatch"},
      {"freeze-display@frame:8", "wrong_frame"},
      {"late-frame=0.2@frame:11", "late_frame"},
      {"disconnect=1000@frame:6", "heartbeat_lost"},
      {"display-gone@frame:5", "display_gone"}};
  for (const auto& [fault, name] : cases) {
    SCOPED_TRACE(fault);
    state_name = "state-" + name;
    // What is broken stays broken: the simulator that is reset is another one, without the fault.
    Sim sim = start_sim(printer, true, {"--fault", fault});
    const RunResult r = run_program(print_command(stack, printer, sim, true));
    EXPECT_EQ(r.exit_code, 4) << r.err;
    EXPECT_THAT(r.err, HasSubstr(name));
    EXPECT_THAT(r.err, HasSubstr("frame "));
    EXPECT_THAT(r.err, HasSubstr("To do: "));
    sim.child->end(SIGTERM);
    const auto events = events_of(sim.events);
    if (name != "door_open" && name != "heartbeat_lost" && name != "wrong_frame" &&
        name != "display_gone") {
      expect_order(events);
    }
    EXPECT_EQ(place(events, "blue on", last_place(events, "blue off")), -1);
    // Nobody is told that lamps are off who has not heard it from the machine.
    EXPECT_EQ(r.err.find("State: lamps are off") == std::string::npos, name == "heartbeat_lost")
        << r.err;
    const json s = status(printer);
    EXPECT_EQ(s["latched"], true);
    EXPECT_EQ(s["fault"], name);
    // No other print before somebody has looked, whatever it was: by day after the first two.
    if (!by_night() && name != cases[0].second && name != cases[1].second) continue;
    Sim next = start_sim(printer, true);
    const RunResult refused = run_program(print_command(stack, printer, next, true));
    EXPECT_EQ(refused.exit_code, 4);
    EXPECT_THAT(refused.err, HasSubstr("printbridge reset"));
    EXPECT_EQ(bridge({"reset"}, printer, {"--modbus", address_of(next.modbus)}).exit_code, 0);
    EXPECT_EQ(status(printer)["latched"], false);
    next.child->end(SIGTERM);
    expect_untouched(next.events);
  }
  state_name = "state-" + cases[0].second;
  Sim sim = start_sim(printer, true);
  EXPECT_EQ(run_program(print_command(stack, printer, sim, true)).exit_code, 0);
}

TEST_F(BridgePrint, ALampThatStaysOnIsCutByTheMachineWhenTheBridgeHasGone) {
  part_cell_mm = 1;
  const std::string printer = make_printer("plain");
  const std::string stack = make_stack(printer);
  Sim sim = start_sim(printer, true, {"--fault", "lamp-sticks@frame:20"});
  const RunResult r = run_program(print_command(stack, printer, sim, true));
  EXPECT_EQ(r.exit_code, 4) << r.err;
  EXPECT_THAT(r.err, HasSubstr("lamp_mismatch"));
  EXPECT_THAT(r.err, HasSubstr("A LAMP STILL SHINES"));
  ASSERT_TRUE(wait_until([&] { return happened(sim.events, "watchdog"); }));
  const auto events = events_of(sim.events);
  EXPECT_LT(place(events, "stop"), place(events, "watchdog"));
  EXPECT_LT(place(events, "watchdog"), place(events, "blue off", place(events, "frame 20")));
}

TEST_F(BridgePrint, RegistersMayLieApartAndStatusInInputRegisters) {
  part_cell_mm = 1;
  const std::string map =
      make_printer("apart", {{"exchange = \"fc23\"", "exchange = \"fc16+fc4\""},
                             // Four to write and one to read, twice, 0.04 s each.
                             {"heartbeat_timeout_s = 0.3", "heartbeat_timeout_s = 0.4"},
                             {"watchdog_s = 0.3", "watchdog_s = 0.4"},
                             {"blue_share = { address = 10,", "blue_share = { address = 1000,"},
                             {"frame = { address = 14,", "frame = { address = 1010,"}});
  // Input registers 0 to 13 beside the holding registers of the same numbers.
  std::string text = text_of(map);
  const std::string was = "{ address = 1";
  for (auto at = text.find(was, text.find("[modbus.read]")); at != std::string::npos;
       at = text.find(was, at + 1)) {
    text.erase(at + was.size() - 1, text[at + was.size()] == '0' ? 2 : 1);
  }
  write_file(map, to_bytes(text));
  const std::string stack = make_stack(map);
  Sim sim = start_sim(map, true);
  const RunResult r = run_program(print_command(stack, map, sim, true));
  ASSERT_EQ(r.exit_code, 0) << r.err;
  EXPECT_EQ(sim.child->end(SIGTERM), 0);
  const std::string target = folder / "part-target.uvj";
  expect_same_part(stack, sim.shown, target, 50);
}

TEST_F(BridgePrint, ADoorThatIsOpenCantBeReset) {
  part_cell_mm = 1;
  const std::string printer = make_printer("plain");
  const std::string stack = make_stack(printer);
  Sim sim = start_sim(printer, true, {"--fault", "door@frame:9"});
  EXPECT_EQ(run_program(print_command(stack, printer, sim, true)).exit_code, 4);
  const RunResult r = bridge({"reset"}, printer, {"--modbus", address_of(sim.modbus)});
  EXPECT_EQ(r.exit_code, 4);
  EXPECT_THAT(r.err, HasSubstr("door"));
  EXPECT_EQ(status(printer)["latched"], true);
}

TEST_F(BridgePrint, FaultsBeforeAnythingMovedAreNotLatched) {
  part_cell_mm = 1;
  const std::string printer = make_printer("plain");
  const std::string stack = make_stack(printer);
  Sim sim = start_sim(printer, true, {"--fault", "door"});
  const RunResult r = run_program(print_command(stack, printer, sim, true));
  EXPECT_EQ(r.exit_code, 4) << r.err;
  EXPECT_THAT(r.err, HasSubstr("door"));
  EXPECT_EQ(status(printer)["latched"], false);
  sim.child->end(SIGTERM);
  expect_untouched(sim.events);
}

TEST_F(BridgePrint, AWrongStackNeverMovesTheStage) {
  const std::string printer = make_printer("plain");
  const std::string stack = make_stack(printer);
  const std::string target = folder / "part-target.uvj";
  Sim sim = start_sim(printer, true);
  const auto refuse = [&](const std::string& file, const std::string& with, int code,
                          const std::string& why) {
    SCOPED_TRACE(file);
    const RunResult r = run_program(print_command(file, with, sim, true));
    EXPECT_EQ(r.exit_code, code) << r.err;
    EXPECT_THAT(r.err, HasSubstr(why));
  };
  const auto changed = [&](const std::string& name, const auto& change) {
    Entries entries = unzip(stack);
    change(entries);
    make_zip(folder / name, entries);
    return folder / name;
  };

  // Cut short, as a file and inside.
  const Bytes whole = read_file(stack);
  write_file(folder / "cut.uvj",
             Bytes(whole.begin(), whole.begin() + static_cast<long>(whole.size() * 2 / 3)));
  refuse(folder / "cut.uvj", printer, 2, "cut.uvj");
  refuse(changed("missing.uvj",
                 [](Entries& e) {
                   std::erase_if(e,
                                 [](const auto& one) { return one.first == "slice/00000007.png"; });
                 }),
         printer, 2, "00000007");
  // One image is another one.
  refuse(
      changed("swapped.uvj",
              [](Entries& e) { entry(e, "slice/00000004.png") = entry(e, "slice/00000020.png"); }),
      printer, 2, "checksum");
  // No corrected stacks.
  refuse(target, printer, 2, "slicecorr correct");
  // For another printer: its name, its light.
  refuse(stack, make_printer("other", {{"name = \"dual-wavelength-dlp\"", "name = \"other\""}}), 2,
         "another printer");
  refuse(stack, make_printer("brighter", {{"[255, 100.0]", "[255, 110.0]"}}), 2, "calibration");
  refuse(stack, make_printer("larger", {{"width_px = 96", "width_px = 100"}}), 2,
         "another printer");
  // Too fast, too long, for this stage.
  refuse(stack, make_printer("slow", {{"max_speed_mm_h = 2000", "max_speed_mm_h = 700"}}), 3,
         "700 mm/h");
  refuse(
      stack,
      make_printer("short", {{"travel_mm = 6", "travel_mm = 1"}, {"lift_mm = 3", "lift_mm = 1"}}),
      3, "reaches 1 mm");
  refuse(stack, make_printer("lazy", {{"acceleration_mm_s2 = 1.0", "acceleration_mm_s2 = 0.05"}}),
         3, "lamp-follows");
  refuse(stack, make_printer("sluggish", {{"cycle_s = 0.01", "cycle_s = 0.08"}}), 3, "cycle_s");
  // Too little UV light: the stack's own words changed, and its checksum with them, so that its
  // images are as they were.
  const std::string uv = make_stack(
      printer, "uv", {"--resin", "custom-resin-1", "--speed-mm-h", "300", "--uv-mw-cm2", "200"});
  Entries entries = unzip(uv);
  Bytes& config = entry(entries, "config.json");
  std::string text = to_text(config);
  text = replaced(text, "\"uv_mw_cm2\": 200", "\"uv_mw_cm2\": 60");
  config = to_bytes(text);
  make_zip(folder / "edited.uvj", entries);
  refuse(folder / "edited.uvj", printer, 2, "checksum");
  json words = json::parse(text);
  words["slicecorr"][detail::kBlockCrc32Key] = detail::block_crc32(words["slicecorr"]);
  config = to_bytes(words.dump());
  make_zip(folder / "dim.uvj", entries);
  refuse(folder / "dim.uvj", printer, 3, "UV light");
  // The stage goes by even layers.
  words["slicecorr"]["process"]["layer_heights_um"] = {50, 100};
  words["slicecorr"].erase(detail::kBlockCrc32Key);
  words["slicecorr"][detail::kBlockCrc32Key] = detail::block_crc32(words["slicecorr"]);
  config = to_bytes(words.dump());
  make_zip(folder / "heights.uvj", entries);
  refuse(folder / "heights.uvj", printer, 2, "layers of different heights");

  sim.child->end(SIGTERM);
  expect_untouched(sim.events);
  EXPECT_EQ(status(printer)["latched"], false);
}

TEST_F(BridgePrint, TheWatchdogDarkensWhatAKilledBridgeLeft) {
  const std::string printer = make_printer("patient", patient());
  const std::string stack = make_stack(printer);
  Sim sim = start_sim(printer, false);
  Child print(print_command(stack, printer, sim, false), folder / "print.err");
  ASSERT_TRUE(wait_until([&] { return happened(sim.events, "frame 3"); }))
      << text_of(folder / "print.err");
  ASSERT_TRUE(has(events_of(sim.events), "blue on"));
  EXPECT_EQ(print.end(SIGKILL), 128 + SIGKILL);
  ASSERT_TRUE(wait_until([&] { return happened(sim.events, "watchdog"); }));
  const auto events = events_of(sim.events);
  EXPECT_GT(last_place(events, "blue off"), last_place(events, "blue on"));
  EXPECT_EQ(place(events, "stop"), -1) << "nobody told it";

  // The print that was killed latches.
  const json s = status(printer);
  EXPECT_EQ(s["running"], false);
  EXPECT_EQ(s["latched"], true);
  EXPECT_THAT(s["detail"].get<std::string>(), HasSubstr("killed"));
  const RunResult refused = run_program(print_command(stack, printer, sim, false));
  EXPECT_EQ(refused.exit_code, 4);
  EXPECT_THAT(refused.err, HasSubstr("killed"));
  const RunResult reset = bridge({"reset"}, printer, {"--modbus", address_of(sim.modbus)});
  EXPECT_EQ(reset.exit_code, 0) << reset.err;
  EXPECT_EQ(status(printer)["latched"], false);
}

TEST_F(BridgePrint, TwoBridgesAtOnceAndStop) {
  const std::string printer = make_printer("patient", patient());
  const std::string stack = make_stack(printer);
  Sim sim = start_sim(printer, false);
  Child print(print_command(stack, printer, sim, false), folder / "print.err");
  ASSERT_TRUE(wait_until([&] { return happened(sim.events, "frame 2"); }))
      << text_of(folder / "print.err");
  const RunResult second = run_program(print_command(stack, printer, sim, false));
  EXPECT_EQ(second.exit_code, 2);
  EXPECT_THAT(second.err, HasSubstr("another printbridge"));
  EXPECT_EQ(bridge({"reset"}, printer, {"--modbus", address_of(sim.modbus)}).exit_code, 2);
  const json s = status(printer);
  EXPECT_EQ(s["running"], true);
  EXPECT_EQ(s["phase"], "printing");
  // It can't be paused here: slices are lit, and lamps do not follow. It says why.
  const RunResult pause = bridge({"pause"}, printer);
  EXPECT_EQ(pause.exit_code, 3);
  EXPECT_THAT(pause.err, HasSubstr("lamp-follows"));
  EXPECT_EQ(bridge({"stop"}, printer).exit_code, 0);
  EXPECT_EQ(print.wait(), 130);
  expect_order(events_of(sim.events));
  EXPECT_EQ(status(printer)["fault"], "stopped_by_user");
  EXPECT_EQ(bridge({"pause"}, printer).exit_code, 2) << "nothing prints";
}

TEST_F(BridgePrint, ASecondBridgeFromElsewhereLeavesThePrintAlone) {
  const std::string printer = make_printer("patient", patient());
  const std::string stack = make_stack(printer);
  Sim sim = start_sim(printer, false);
  Child print(print_command(stack, printer, sim, false), folder / "print.err");
  ASSERT_TRUE(wait_until([&] { return happened(sim.events, "frame 1"); }));
  // Another folder for the state, as another user or computer has it.
  for (const char* what : {"print", "reset"}) {
    std::vector<std::string> command{program("printbridge"), what};
    if (what == std::string("print")) command.insert(command.end(), {stack, "--sink", "null"});
    command.insert(command.end(), {"--printer", printer, "--dir", folder / "elsewhere", "--modbus",
                                   address_of(sim.modbus)});
    const RunResult r = run_program(command);
    EXPECT_EQ(r.exit_code, 2) << r.err;
    EXPECT_THAT(r.err, HasSubstr("another bridge"));
  }
  EXPECT_EQ(print.wait(), 0) << text_of(folder / "print.err");
  EXPECT_EQ(place(events_of(sim.events), "stop"), -1);
}

TEST_F(BridgePrint, APrintThatIsRecordedIsNotWrittenOver) {
  part_cell_mm = 1;
  const std::string printer = make_printer("plain");
  const std::string stack = make_stack(printer), target = folder / "part-target.uvj";
  Sim sim = start_sim(printer, true);
  for (const std::vector<std::string>& more :
       {std::vector<std::string>{}, {"--dry-run"}, std::vector<std::string>{}}) {
    const RunResult r = run_program(print_command(stack, printer, sim, true, more));
    EXPECT_EQ(r.exit_code, 0) << r.err;
  }
  EXPECT_EQ(sim.child->end(SIGTERM), 0) << text_of(folder / "sim1.err");
  const std::string second = sim.shown.substr(0, sim.shown.size() - 4) + "-2.uvj";
  EXPECT_EQ(verify(sim.shown, target)["iou"], verify(second, target)["iou"]);
  EXPECT_GT(verify(sim.shown, target)["iou"].get<double>(), 0.5);
}

TEST_F(BridgePrint, SignalsDoNotShortenTheOrder) {
  const std::string printer = make_printer("patient", patient());
  const std::string stack = make_stack(printer);
  for (const int signal : {SIGINT, SIGTERM}) {
    Sim sim = start_sim(printer, false);
    Child print(print_command(stack, printer, sim, false), folder / "print.err");
    ASSERT_TRUE(wait_until([&] { return happened(sim.events, "frame 2"); }))
        << text_of(folder / "print.err");
    ::kill(print.pid(), signal);
    ::kill(print.pid(), signal);
    ::kill(print.pid(), SIGHUP);
    EXPECT_EQ(print.end(signal), 130);
    expect_order(events_of(sim.events));
    EXPECT_EQ(bridge({"reset"}, printer, {"--modbus", address_of(sim.modbus)}).exit_code, 0);
  }
}

TEST_F(BridgePrint, PausesAndResumes) {
  auto changes = patient();
  changes.push_back({"min_share = 0.02", "min_share = 0"});
  const std::string printer = make_printer("follows", changes);
  const std::string stack = make_stack(printer, "part",
                                       {"--resin", "figure-2-2", "--speed-mm-h", "800", "--ramp",
                                        "lamp-follows", "--ramp-mm", "0.1"});
  Sim sim = start_sim(printer, false);
  Child print(print_command(stack, printer, sim, false), folder / "print.err");
  ASSERT_TRUE(wait_until([&] { return happened(sim.events, "frame 5"); }))
      << text_of(folder / "print.err");
  EXPECT_EQ(bridge({"resume"}, printer).exit_code, 3) << "it is not paused";
  const RunResult pause = bridge({"pause"}, printer);
  ASSERT_EQ(pause.exit_code, 0) << pause.err;
  // Dark, before the program is asked again and again.
  ASSERT_TRUE(wait_until([&] { return events_of(sim.events).back() == "black"; }));
  ASSERT_TRUE(wait_until([&] { return status(printer)["phase"] == "paused"; }));
  const auto events = events_of(sim.events);
  EXPECT_GT(last_place(events, "blue off"), last_place(events, "blue on"));
  EXPECT_EQ(events.back(), "black");
  EXPECT_EQ(bridge({"resume"}, printer).exit_code, 0);
  EXPECT_EQ(print.wait(), 0) << text_of(folder / "print.err");
  EXPECT_EQ(sim.child->end(SIGTERM), 0);
  EXPECT_EQ(place(events_of(sim.events), "fault"), -1);
}

TEST_F(BridgePrint, SpeaksRtuOverAPairOfTerminals) {
  if (!std::filesystem::exists("/usr/bin/socat")) GTEST_SKIP() << "socat is not installed";
  part_cell_mm = 1;
  const std::string printer = make_printer(
      "rtu", {{"transport = \"tcp\"", "transport = \"rtu\"\ndevice = \"" + (folder / "a") + "\""}});
  const std::string stack = make_stack(printer);
  Child socat({"/usr/bin/socat", "pty,raw,echo=0,link=" + (folder / "a"),
               "pty,raw,echo=0,link=" + (folder / "b")});
  ASSERT_TRUE(wait_until([&] {
    return std::filesystem::exists(folder / "a") && std::filesystem::exists(folder / "b");
  }));
  Sim sim = start_sim(printer, true, {}, folder / "b");
  std::vector<std::string> command = print_command(stack, printer, sim, true);
  for (std::string& word : command) {
    if (word == address_of(sim.modbus)) word = "rtu:" + (folder / "a");
  }
  const RunResult r = run_program(command);
  EXPECT_EQ(r.exit_code, 0) << r.err;
  sim.child->end(SIGTERM);
  EXPECT_TRUE(has(events_of(sim.events), "frame 5"));
}

TEST_F(BridgePrint, DrivesAMachineThatWeDidNotWrite) {
  const std::string python = "/usr/bin/python3";
  Child peer({python, std::string(SLICECORR_SOURCE_DIR) + "/tests/modbus_peer.py"},
             folder / "peer.err");
  const std::string port = peer.line();
  if (port.empty()) {
    const std::string why = text_of(folder / "peer.err");
    if (!std::filesystem::exists(python) || why.find("ImportError") != why.npos ||
        why.find("ModuleNotFoundError") != why.npos) {
      GTEST_SKIP() << "pymodbus is not installed";
    }
    FAIL() << why;
  }
  part_cell_mm = 1;

  // Another map: other addresses and scales, the low word first, one request to write and one to
  // read, other numbers for commands and states, no measured speed, no UV lamp.
  auto changes = patient();
  std::string text = text_of(make_printer("peer", changes));
  text = text.substr(0, text.find("# Holding registers")) + R"(
[modbus]
transport = "tcp"
port = 1
word_order = "little"
exchange = "fc16+fc3"
[modbus.write]
sequence = { address = 300 }
heartbeat = { address = 301 }
command = { address = 302 }
target_um = { address = 303, type = "i32", scale = 0.1 }
speed_um_s = { address = 305, type = "u32", scale = 0.01 }
blue_share = { address = 307, scale = 0.001 }
acceleration_um_s2 = { address = 308 }
[modbus.read]
sequence_echo = { address = 500 }
state = { address = 501 }
stage_um = { address = 502, type = "i32", scale = 0.1 }
blue_measured = { address = 504, scale = 0.001 }
[modbus.commands]
off = 10
run = 20
stop = 30
reset = 40
[modbus.states]
idle = 7
running = 8
stopped = 9
fault = 11
)";
  const auto uv = text.find("[uv]"), stage = text.find("[stage]");
  text.erase(uv, stage - uv);
  const auto lamp = text.find("[lamps.uv]"), limits = text.find("# When printbridge gives up");
  text.erase(lamp, limits - lamp);
  text = replaced(text, "lift_speed_mm_h = 7200", "lift_speed_mm_h = 36000");
  text = replaced(text, "travel_mm = 6", "travel_mm = 4");
  const std::string printer = folder / "peer.toml";
  write_file(printer, to_bytes(text));
  const std::string stack =
      make_stack(printer, "part", {"--resin", "figure-2-2", "--speed-mm-h", "1000"});
  const RunResult r =
      run_program({program("printbridge"), "print", stack, "--printer", printer, "--dir",
                   folder / "state", "--modbus", "tcp:127.0.0.1:" + port, "--sink", "null"});
  EXPECT_EQ(r.exit_code, 0) << r.err;
  peer.close_stdin();
  // What it heard: off, run with light, then run without, off; never a stop.
  std::vector<std::array<int, 2>> heard;
  for (std::string line = peer.line(); !line.empty(); line = peer.line()) {
    const json j = json::parse(line);
    heard.push_back({j[0], j[1]});
  }
  ASSERT_GT(heard.size(), 100U);
  EXPECT_EQ(heard.front()[0], 10);
  EXPECT_EQ(heard.back()[0], 10);
  int lit = 0;
  for (const auto& [command, blue] : heard) {
    EXPECT_NE(command, 30);
    if (command == 10) {
      EXPECT_EQ(blue, 0);
    }
    lit += blue > 900 ? 1 : 0;
  }
  EXPECT_GT(lit, 100);
}

TEST_F(BridgePrint, NobodyThere) {
  part_cell_mm = 1;
  const std::string printer = make_printer("plain");
  const std::string stack = make_stack(printer);
  // A port that was free a moment ago.
  const int s = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in a{};
  a.sin_family = AF_INET;
  a.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  ASSERT_EQ(::bind(s, reinterpret_cast<sockaddr*>(&a), sizeof a), 0);
  socklen_t size = sizeof a;
  ::getsockname(s, reinterpret_cast<sockaddr*>(&a), &size);
  const std::string nobody = fmt::format("tcp:127.0.0.1:{}", ntohs(a.sin_port));
  const auto print = [&](const std::string& modbus, const std::string& sink) {
    return run_program({program("printbridge"), "print", stack, "--printer", printer, "--dir",
                        folder / "state", "--modbus", modbus, "--sink", sink, "--lockstep"});
  };
  const RunResult machine = print(nobody, "null");
  EXPECT_EQ(machine.exit_code, 4) << machine.err;
  EXPECT_THAT(machine.err, AllOf(HasSubstr("does not answer"), HasSubstr(nobody.substr(4)),
                                 HasSubstr("Connection refused")));
  Sim sim = start_sim(printer, true);
  const RunResult display = print(address_of(sim.modbus), nobody);
  EXPECT_EQ(display.exit_code, 4) << display.err;
  EXPECT_THAT(display.err, HasSubstr("no display answers"));
  EXPECT_EQ(print("tcp:nowhere", "null").exit_code, 2);
  EXPECT_EQ(print("rtu:" + (folder / "none"), "null").exit_code, 4);
  EXPECT_EQ(status(printer)["latched"], false) << "nothing was moved";
  EXPECT_EQ(bridge({"reset"}, printer, {"--modbus", nobody}).exit_code, 4);
  ::close(s);
}

TEST_F(BridgePrint, ABenchyIsPrintedAsItWasPlanned) {
  const std::string mesh = test::real_file("meshes/clean/3DBenchy.stl");
  SLICECORR_NEEDS_FILE(mesh);
  // 4 mm high at a twelfth of its size: 400 slices of 10 um. By day half of that.
  const int slices = by_night() ? 400 : 200;
  const std::string printer = make_printer(
      "benchy", {{"width_px = 96", "width_px = 128"}, {"height_px = 64", "height_px = 80"}});
  const std::string target = folder / "benchy-target.uvj", stack = folder / "benchy.uvj";
  ASSERT_EQ(run_program({program("slicecorr"), "slice", mesh, "-o", target, "--printer", printer,
                         "--layer-um", "10", "--antialias", "off", "--scale",
                         fmt::format("{}", slices / 4800.0), "--quiet"})
                .exit_code,
            0);
  ASSERT_EQ(run_program({program("slicecorr"), "correct", target, "-o", stack, "--printer", printer,
                         "--resin", "figure-2-2", "--speed-mm-h", "800", "--quiet"})
                .exit_code,
            0);
  EXPECT_GE(StackReader::read_info(stack).grid.layers, slices);
  Sim sim = start_sim(printer, true);
  RunOptions long_one;
  long_one.timeout = std::chrono::minutes(5);
  const RunResult r = run_program(print_command(stack, printer, sim, true), long_one);
  ASSERT_EQ(r.exit_code, 0) << r.err;
  EXPECT_EQ(sim.child->end(SIGTERM), 0);
  expect_same_part(stack, sim.shown, target, 10);
}

}  // namespace
}  // namespace slicecorr
