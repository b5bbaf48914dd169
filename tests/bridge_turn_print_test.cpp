// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// A tomographic job on a machine that turns a vial, with the programs over real sockets.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <functional>

#include "bridge_fixture.hpp"
#include "devtools.hpp"
#include "rounds.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/tomo/npy.hpp"
#include "slicecorr/tomo/print.hpp"
#include "slicecorr/tomo/shown.hpp"

namespace slicecorr::test {
namespace {

using tomo::Box;

class BridgeTurnPrint : public BridgePrograms {
 protected:
  BridgeTurnPrint() { shown_ending = ".csv"; }
  using Changes = std::vector<std::pair<std::string, std::string>>;

  /// The shipped printer with a small display and a smaller vial, brighter and four times as fast.
  std::string make_turning(const std::string& name, const Changes& changes = {}) {
    std::string text =
        text_of(std::string(SLICECORR_PRINTERS_DIR) + "/model-tomography-bench.toml");
    Changes all{{"width_px = 512", "width_px = 64"},
                {"height_px = 512", "height_px = 24"},
                {"pixel_um = 50.0", "pixel_um = 200.0"},
                {"[255, 2.0]", "[255, 20.0]"},
                {"outer_mm = 13.5", "outer_mm = 6"},
                {"inner_mm = 12.5", "inner_mm = 5"},
                {"deg_s = 25", "deg_s = 100"},
                {"acceleration_deg_s2 = 50", "acceleration_deg_s2 = 400"}};
    all.insert(all.end(), changes.begin(), changes.end());
    for (const auto& [what, by] : all) text = replaced(text, what, by);
    const std::string path = folder / (name + ".toml");
    write_file(path, to_bytes(text));
    return path;
  }
  /// A block beside the axis, in voxels of twice a pixel, in 60 frames a turn.
  std::string make_job(const std::string& printer, const std::string& name = "part") {
    static std::map<std::string, Bytes> made;
    const std::string job = folder / (name + ".frames");
    Box<std::uint8_t> part{2, 20, 20, std::vector<std::uint8_t>(2 * 20 * 20)};
    for (int z = 0; z < 2; ++z) {
      for (int y = 8; y < 13; ++y) {
        for (int x = 7; x < 12 - z; ++x) part.values[part.at(z, y, x)] = 255;
      }
    }
    tomo::write_npy(folder / "part.npy", part);
    // Tests that ask for the same get the same bytes. What a printer's file names lies beside it.
    const std::string key = text_of(printer);
    const bool alone = key.find(".png\"") == key.npos && key.find(".csv\"") == key.npos;
    if (const auto before = made.find(key); before != made.end() && alone) {
      write_file(job, before->second);
      return job;
    }
    const RunResult r =
        run_program({program("slicecorr"), "tomo", "solve", "--volume", folder / "part.npy",
                     "--voxel-mm", "0.4", "--printer", printer, "--resin", "model-tomography-resin",
                     "--angles", "60", "-o", job, "--iterations", "20", "--quiet"});
    EXPECT_EQ(r.exit_code, 0) << r.err;
    if (r.exit_code == 0) made[key] = read_file(job);
    return job;
  }
  Sim start_turning(const std::string& printer, std::vector<std::string> more = {}) {
    return start_sim(printer, true, std::move(more));
  }
  nlohmann::json verify(const std::string& job, const std::string& record,
                        const std::string& dose = {}) {
    std::vector<std::string> command{program("slicecorr"), "tomo", "verify", job, "--json", "-"};
    if (!record.empty()) command.insert(command.end(), {"--shown", record});
    if (!dose.empty()) command.insert(command.end(), {"--dose", dose});
    const RunResult r = run_program(command);
    EXPECT_TRUE(r.exit_code == 0 || r.exit_code == 5) << r.err;
    return nlohmann::json::parse(r.out, nullptr, false);
  }
  /// Each frame over its whole step, at its place.
  static std::vector<tomo::Showing> ideal(const tomo::TomoJob& job) {
    std::vector<tomo::Showing> shown;
    for (int n = 0; n < 60 * job.turns; ++n) {
      shown.push_back({n % 60, 6.0 * n - 3, 6.0 * n + 3, 0.06, 1});
    }
    return shown;
  }
  std::string frames_csv() const { return folder / "state/model-tomography-bench/frames.csv"; }
};

double largest_difference(const Box<float>& a, const Box<float>& b) {
  double most = 0, large = 0;
  for (std::size_t i = 0; i < a.values.size(); ++i) {
    most = std::max(most, std::abs(double{a.values[i]} - b.values[i]));
    large = std::max(large, double{b.values[i]});
  }
  return most / large;
}

TEST_F(BridgeTurnPrint, PrintsAJobAndSaysWhatWasShown) {
  const std::string printer = make_turning("bench"), job = make_job(printer);
  const int turns = tomo::read_job(job).turns;
  Sim sim = start_turning(printer);
  const RunResult r = run_program(print_command(job, printer, sim, true));
  EXPECT_EQ(r.exit_code, 0) << r.err;
  EXPECT_NE(r.err.find(std::to_string(turns) + " turns of 60 frames"), std::string::npos) << r.err;
  EXPECT_EQ(sim.child->end(SIGTERM), 0);

  const auto state = status(printer);
  EXPECT_EQ(state["frames_shown"], turns * 60);
  EXPECT_EQ(state["angles"], 60);
  EXPECT_EQ(state["turns"], turns);
  EXPECT_LT(state["worst_late_um"], 0.02 * state["um_per_deg"].get<double>());

  // The machine's own record and the bridge's agree, and both give the dose of frames that were
  // spread over their whole steps, each at its place.
  const tomo::TomoJob made = tomo::read_job(job);
  const Box<float> expected = tomo::dose_of(made, ideal(made));
  for (const std::string& record : {sim.shown, frames_csv()}) {
    SCOPED_TRACE(record);
    const auto figures = verify(job, record, folder / "d.npy");
    EXPECT_EQ(figures["turns"], turns);
    // Thousandths of a degree of a step of six, and what black light adds.
    EXPECT_LT(largest_difference(tomo::read_dose_npy(folder / "d.npy"), expected), 2e-3);
  }
  // Logs have degrees, too: frame 0 begins half a step before a whole turn.
  for (const auto& line : lines_of(sim.events)) {
    if (line["event"] != "frame 0") continue;
    EXPECT_NEAR(std::remainder(line["stage_deg"].get<double>(), 360), -3, 0.02);
    break;
  }
  const auto journal = lines_of(folder / "state/model-tomography-bench/journal.jsonl");
  EXPECT_NEAR(std::remainder(journal.back()["stage_deg"].get<double>(), 360), 0, 0.02);
  // Order: no light before the vial turns, none when it stands.
  const auto events = events_of(sim.events);
  EXPECT_LT(place(events, "stage moves"), place(events, "blue on"));
  EXPECT_LT(place(events, "blue on"), place(events, "frame 0"));
  EXPECT_LT(place(events, "blue off"), last_place(events, "stage stops"));
  EXPECT_LT(last_place(events, "black"), last_place(events, "blue off"));
}

TEST_F(BridgeTurnPrint, AnAxisThatLeansAndWobblesUnderUnevenLight) {
  GreyImage light{8, 4, {}};
  for (int i = 0; i < 32; ++i)
    light.pixels.push_back(static_cast<std::uint8_t>(255 - 12 * (i % 8)));
  write_file(folder / "light.png", encode_png(light));
  std::string wobble = "angle_deg,right_px,up_px\n";
  for (int k = 0; k < 12; ++k) {
    wobble += fmt::format("{},{:.3f},{:.3f}\n", 30 * k, std::sin(k), std::cos(k));
  }
  write_file(folder / "wobble.csv", to_bytes(wobble));
  const Changes uneven{{"bit_depth = 8", "bit_depth = 8\nflat_field = \"light.png\""},
                       {"kind = \"telecentric\"", "kind = \"telecentric\"\ntilt_deg = 2"},
                       {"max_fps = 60", "max_fps = 60\nwobble = \"wobble.csv\""}};
  const std::string printer = make_turning("bench", uneven), job = make_job(printer);
  Sim sim = start_turning(printer);
  const RunResult r = run_program(print_command(job, printer, sim, true));
  EXPECT_EQ(r.exit_code, 0) << r.err;
  EXPECT_EQ(sim.child->end(SIGTERM), 0);
  // What was shown is what a machine without any jitter shows.
  const tomo::TomoJob made = tomo::read_job(job);
  ASSERT_FALSE(made.printer.rotation->wobble.empty());
  const Box<float> expected = tomo::dose_of(made, ideal(made));
  for (const std::string& record : {sim.shown, frames_csv()}) {
    verify(job, record, folder / "d.npy");
    EXPECT_LT(largest_difference(tomo::read_dose_npy(folder / "d.npy"), expected), 2e-3) << record;
  }
  // The same printer as it is without all that takes no such job.
  const RunResult other = run_program(print_command(job, make_turning("plain"), sim, true));
  EXPECT_EQ(other.exit_code, 2);
  EXPECT_NE(other.err.find("leaning by 2°, expected"), std::string::npos) << other.err;
}

TEST_F(BridgeTurnPrint, ADryRunAndHalfAPrintAreSaidToBeThat) {
  const std::string printer = make_turning("bench"), job = make_job(printer);
  Sim sim = start_turning(printer);
  EXPECT_EQ(run_program(print_command(job, printer, sim, true, {"--dry-run"})).exit_code, 0);
  EXPECT_EQ(sim.child->end(SIGTERM), 0);
  const auto judge = [&](const std::string& record) {
    return run_program({program("slicecorr"), "tomo", "verify", job, "--shown", record});
  };
  for (const std::string& record : {sim.shown, frames_csv()}) {
    const RunResult r = judge(record);
    EXPECT_EQ(r.exit_code, 2);
    EXPECT_NE(r.err.find("no light in it, as of a dry run"), std::string::npos) << r.err;
  }
  Sim fails = start_turning(printer, {"--fault", "door@frame:31"});
  EXPECT_EQ(run_program(print_command(job, printer, fails, true)).exit_code, 4);
  const RunResult r = judge(frames_csv());
  EXPECT_EQ(r.exit_code, 5);
  // 31 frames of 60 ms, of 3.6 s a turn.
  EXPECT_NE(r.err.find("a row without an end is left out"), std::string::npos) << r.err;
  EXPECT_NE(r.err.find("1.86 s of light, planned "), std::string::npos) << r.err;
}

TEST_F(BridgeTurnPrint, WobbleIsInTheRecordAndInTheVerdict) {
  // Lamps that don't follow: light is limited to what was calibrated, so a fast half turn gets less.
  const std::string printer = make_turning("bench", {{"tolerance_deg = 1", "tolerance_deg = 5"}});
  const std::string job = make_job(printer);
  Sim sim = start_turning(printer, {"--fault", "stage-wobbles=0.04"});
  const RunResult r = run_program(print_command(job, printer, sim, true));
  EXPECT_EQ(r.exit_code, 0) << r.err;
  EXPECT_EQ(sim.child->end(SIGTERM), 0);
  const auto machine = verify(job, sim.shown), bridge = verify(job, frames_csv()),
             planned = verify(job, "");
  const double lost = machine["dose_mj_cm3"]["min_gel"].get<double>() /
                      planned["dose_mj_cm3"]["min_gel"].get<double>();
  EXPECT_LT(lost, 1);
  EXPECT_GT(lost, 0.9);
  // What the bridge measured says the same as what the machine knows.
  EXPECT_NEAR(bridge["dose_mj_cm3"]["min_gel"].get<double>(),
              machine["dose_mj_cm3"]["min_gel"].get<double>(),
              0.01 * machine["dose_mj_cm3"]["min_gel"].get<double>());
}

TEST_F(BridgeTurnPrint, FaultsEndWithLightOffFirst) {
  const std::string printer = make_turning("bench"), job = make_job(printer);
  int number = 0;
  for (const auto& [fault, name] : {std::pair{"stuck-stage@frame:70", "stage_error"},
                                    {"stage-slips=-9@frame:33", "stage_error"},
                                    {"late-frame=0.05@frame:40", "late_frame"},
                                    {"lamp-fails@frame:50", "lamp_"},
                                    {"drop=100000@frame:20", "heartbeat_lost"}}) {
    SCOPED_TRACE(fault);
    state_name = "state-" + std::to_string(number);
    Sim sim = start_turning(printer, {"--fault", fault});
    const RunResult r = run_program(print_command(job, printer, sim, true, {"--machine-is-clear"}));
    EXPECT_EQ(r.exit_code, 4) << r.err;
    EXPECT_NE(r.err.find(name), std::string::npos) << r.err;
    EXPECT_NE(r.err.find("on from the first"), std::string::npos) << r.err;
    const bool answers = std::string(name) != "heartbeat_lost";
    EXPECT_EQ(sim.child->end(SIGTERM), 0);
    const auto events = events_of(sim.events);
    const int dark = place(events, "blue off", place(events, "frame 19")),
              stands = last_place(events, "stage stops");
    ASSERT_GE(dark, 0);
    if (std::string(fault).starts_with("stuck") || answers) {
      EXPECT_LT(dark, place(events, "stop"));
    }
    EXPECT_LT(dark, stands);
    // It has to be looked at, whatever it was: by day after the first.
    if (number++ > 0 && !by_night()) continue;
    Sim next = start_turning(printer);
    const RunResult again = run_program(print_command(job, printer, next, true));
    EXPECT_EQ(again.exit_code, 4);
    EXPECT_NE(again.err.find("nobody has looked at"), std::string::npos) << again.err;
    const RunResult reset = bridge({"reset"}, printer, {"--modbus", address_of(next.modbus)});
    EXPECT_EQ(reset.exit_code, 0) << reset.err;
    next.child->end(SIGTERM);
  }
}

TEST_F(BridgeTurnPrint, TheLivePageIsInDegrees) {
  if (chromium().empty()) GTEST_SKIP() << "chromium is not installed";
  const std::string printer = make_turning("bench"), job = make_job(printer);
  const std::string turns = std::to_string(tomo::read_job(job).turns);
  Sim sim = start_turning(printer, {"--fault", "stuck-stage@frame:70"});
  EXPECT_EQ(run_program(print_command(job, printer, sim, true)).exit_code, 4);
  Child served({program("printbridge"), "serve", "--printer", printer, "--dir", folder / "state",
                "--listen", "127.0.0.1:0"});
  DrivenPage page;
  page.open(served.line() + "/");
  page.wait_for("document.body.innerHTML.includes('degrees of the turn')");
  const std::string dom = page.dom();
  for (const std::string& what :
       {std::string("stage_error: the stage has stalled at"), "turn 2 of " + turns,
        std::string("°/s, planned 100.00"), std::string(" um at the wall, 3.00° borne"),
        std::string("until the fault, 1.00° borne"), std::string("degrees of the turn")}) {
    EXPECT_NE(dom.find(what), std::string::npos) << what;
  }
  for (const char* never : {"mm/h", "z, mm", "NaN", "undefined"}) {
    EXPECT_EQ(dom.find(never), std::string::npos) << never;
  }
  EXPECT_THAT(page.complaints(), testing::IsEmpty());
  EXPECT_EQ(bridge({"reset"}, printer, {"--modbus", address_of(sim.modbus)}).exit_code, 0);
}

TEST_F(BridgeTurnPrint, TheWatchdogDarkensWhatAKilledBridgeLeft) {
  const std::string printer = make_turning("bench"), job = make_job(printer);
  Sim sim = start_turning(printer);
  Child bridge(print_command(job, printer, sim, true));
  ASSERT_TRUE(wait_until([&] { return happened(sim.events, "frame 30"); }));
  bridge.end(SIGKILL);
  ASSERT_TRUE(wait_until([&] { return happened(sim.events, "watchdog"); }));
  sim.child->end(SIGTERM);
  const auto events = events_of(sim.events);
  EXPECT_LT(place(events, "watchdog"), place(events, "blue off"));
  EXPECT_LT(place(events, "blue off"), last_place(events, "stage stops"));
}

TEST_F(BridgeTurnPrint, WrongJobsNeverMoveTheStage) {
  const std::string printer = make_turning("bench"), job = make_job(printer);
  const std::string other =
      make_turning("other", {{"direction = \"clockwise\"", "direction = \"counterclockwise\""}});
  Sim sim = start_turning(printer);
  const auto refused = [&](const std::string& what, const std::string& where,
                           const std::string& says, int code = 2) {
    const RunResult r = run_program(print_command(what, where, sim, true));
    EXPECT_EQ(r.exit_code, code) << r.err;
    EXPECT_NE(r.err.find(says), std::string::npos) << r.err;
  };
  refused(job, other, "counterclockwise as printer");
  refused(job, make_printer("slices"), "has no [rotation]");
  refused(folder / "part.npy", printer, "part.npy");
  refused(make_stack(make_printer("slices")), printer, "expected a job that tomo solve wrote");
  // Half a job.
  const auto bytes = read_file(job);
  write_file(folder / "half.frames", {bytes.begin(), bytes.begin() + bytes.size() / 2});
  refused(folder / "half.frames", printer, "half.frames");
  // A table is what a vial leaves, and a stack what it does not take.
  const RunResult uvj =
      run_program({program("printer-sim"), "--printer", printer, "--listen", "127.0.0.1:0",
                   "--frames", "unix:" + (folder / "x"), "-o", folder / "shown.uvj"});
  EXPECT_EQ(uvj.exit_code, 2);
  EXPECT_NE(uvj.err.find(".csv"), std::string::npos) << uvj.err;
  EXPECT_EQ(sim.child->end(SIGTERM), 0);
  EXPECT_FALSE(has(events_of(sim.events), "stage moves"));
}

}  // namespace
}  // namespace slicecorr::test
