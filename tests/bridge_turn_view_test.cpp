// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What a person sees of a vial that turns: degrees and turns, in the terminal, metrics, status and on
// the page.

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "bridge_fixture.hpp"
#include "exposition_reader.hpp"
#include "slicecorr/bridge/view.hpp"

namespace slicecorr::bridge {
namespace {

using namespace slicecorr::test;
using nlohmann::json;
using testing::HasSubstr;
using testing::Not;

// 200 um to a degree: 25 °/s of 5000 um/s, frames of 6 degrees. The first frame begins 3 degrees
// before the first whole turn.
constexpr double kUmPerDeg = 200;
constexpr int kSeenAngles = 60, kSeenTurns = 10;

PrintFacts turning_facts() {
  PrintFacts f;
  f.stack = "/tmp/wheel.frames";
  f.printer = "p";
  f.display = "null";
  f.frames = kSeenAngles * kSeenTurns;
  f.layer_um = 6 * kUmPerDeg;
  f.speed_um_s = 25 * kUmPerDeg;
  f.start_um = 357 * kUmPerDeg;
  f.end_um = f.start_um + kSeenTurns * 360 * kUmPerDeg;
  f.expected_s = 144;
  f.max_late_um = 3 * kUmPerDeg;
  f.tolerance_um = 1 * kUmPerDeg;
  f.cycle_s = 0.01;
  f.ring_frames = 16;
  f.angles = kSeenAngles;
  f.um_per_deg = kUmPerDeg;
  return f;
}

/// In the third turn, at 30.2 degrees: of frame 125, which belongs to 30 degrees.
PrintState turning_state() {
  PrintState s;
  s.phase = Phase::printing;
  s.frame = 125;
  s.frames_shown = 126;
  s.at_s = 50;
  s.phase_since_s = 10;
  s.stage_um = (3 * 360 + 30.2) * kUmPerDeg;
  s.speed_um_s = 24.9 * kUmPerDeg;
  s.stage_error_um = -0.25 * kUmPerDeg;
  s.worst_stage_error_um = 0.5 * kUmPerDeg;
  s.worst_late_um = 0.125 * kUmPerDeg;
  s.blue_share = s.blue_measured = 1;
  for (int i = 0; i < 125; ++i) s.lateness.add_um(0.3), s.lateness.add_deg(0.3 / kUmPerDeg);
  s.lateness.add_um(0.125 * kUmPerDeg), s.lateness.add_deg(0.125);
  for (int i = 0; i < 126; ++i) s.lateness.add_ms(0.05);
  return s;
}

Seen turning_seen() {
  Seen seen;
  seen.printer = "p";
  seen.running = seen.known = true;
  seen.facts = turning_facts();
  seen.state = turning_state();
  seen.around.ready_frames = 16;
  seen.left_s = left_s(seen.facts, seen.state);
  return seen;
}

/// Nothing of slices.
void expect_degrees_only(const std::string& text) {
  for (const char* never : {"mm/h", "z, mm", "slices", "z = "}) {
    EXPECT_THAT(text, Not(HasSubstr(never)));
  }
}

TEST(TurnsSeen, TurnsAndAnglesAreCounted) {
  const PrintFacts f = turning_facts();
  PrintState s = turning_state();
  const auto turn_after = [&](int shown) {
    s.frames_shown = shown;
    return turn_of(f, s);
  };
  EXPECT_EQ(turn_after(0), 0);
  EXPECT_EQ(turn_in_words(f, s), "before the first of 10 turns");
  EXPECT_EQ(turn_after(1), 1);
  EXPECT_EQ(turn_after(kSeenAngles), 1);
  EXPECT_EQ(turn_after(kSeenAngles + 1), 2);
  EXPECT_EQ(turn_after(kSeenAngles * kSeenTurns), kSeenTurns);
  EXPECT_EQ(turn_in_words(f, s), "turn 10 of 10");
  const auto at = [&](double deg) {
    s.stage_um = deg * kUmPerDeg;
    return angle_in_turn_deg(f, s);
  };
  EXPECT_DOUBLE_EQ(at(0), 0);
  EXPECT_DOUBLE_EQ(at(1110.2), 30.2);
  EXPECT_DOUBLE_EQ(at(359.994), 359.99);
  EXPECT_DOUBLE_EQ(at(359.996), 0);  // what would be written as 360.00
  EXPECT_DOUBLE_EQ(at(-0.001), 0);
  EXPECT_DOUBLE_EQ(at(-1), 359);
  EXPECT_EQ(way_in_words(25, kUmPerDeg), "0.125° (25.00 um at the wall)");
  EXPECT_EQ(way_in_words(25, 0), "25.00 um");
}

TEST(TurnsSeen, OnATerminal) {
  Seen seen = turning_seen();
  std::string text = joined(live_frame(seen, 100, 40, false));
  for (const char* what :
       {"wheel.frames", "126 of 600", "30.20°, turn 3 of 10", "24.90 °/s, planned 25.00",
        "-0.250° off now, 0.500 at most, 1 borne", "0.125° (25.00 um at the wall) late, 0.05 ms",
        "up to 0.005 °", "up to 0.2 °"}) {
    EXPECT_THAT(text, HasSubstr(what));
  }
  expect_degrees_only(text);
  text = live_line(seen);
  for (const char* what : {"turn 3 of 10, 30.20°", "24.90 °/s", "worst 0.125° (25.00 um at"}) {
    EXPECT_THAT(text, HasSubstr(what));
  }
  // In spin-up.
  seen.state = PrintState{};
  seen.state.stage_um = 90 * kUmPerDeg;
  EXPECT_THAT(joined(live_frame(seen, 100, 40, false)),
              HasSubstr("90.00°, before the first of 10 turns"));
}

TEST(TurnsSeen, InMetrics) {
  const std::string text = metrics_text(turning_seen(), {});
  const auto m = check_metrics(text);
  const auto value = [&](const std::string& name, const std::string& labels = {}) {
    const std::string key = "printbridge_" + name + "{printer=\"p\"" + labels + "}";
    EXPECT_TRUE(m.contains(key)) << key;
    return m.contains(key) ? m.at(key) : NAN;
  };
  EXPECT_EQ(value("turn"), 3);
  EXPECT_EQ(value("turns"), 10);
  EXPECT_NEAR(value("angle_degrees"), 30.2, 1e-9);
  EXPECT_NEAR(value("speed_degrees_per_second"), 24.9, 1e-9);
  EXPECT_NEAR(value("stage_error_degrees"), -0.25, 1e-9);
  EXPECT_NEAR(value("stage_error_worst_degrees"), 0.5, 1e-9);
  EXPECT_NEAR(value("frame_lateness_worst_degrees"), 0.125, 1e-9);
  EXPECT_NEAR(value("frame_lateness_worst_um"), 25, 1e-9);
  EXPECT_EQ(value("frame_lateness_degrees_bucket", ",le=\"0.005\""), 125);
  EXPECT_EQ(value("frame_lateness_degrees_bucket", ",le=\"0.2\""), 126);
  EXPECT_NEAR(value("frame_lateness_degrees_sum"), 125 * 0.0015 + 0.125, 1e-9);
  for (const char* never : {"z_um", "speed_um_per_second", "stage_error_um"}) {
    EXPECT_THAT(text, Not(HasSubstr(never)));
  }
  EXPECT_TRUE(promtool_agrees(text));
}

TEST(TurnsSeen, InTheStatusAndReadBack) {
  const PrintFacts f = turning_facts();
  const PrintState s = turning_state();
  const json j = json::parse(state_json(f, s, {}));
  EXPECT_EQ(j["turn"], 3);
  EXPECT_EQ(j["turns"], 10);
  EXPECT_EQ(j["turn_in_words"], "turn 3 of 10");
  EXPECT_EQ(j["job_frame"], 5);
  EXPECT_NEAR(j["angle_deg"].get<double>(), 1110.2, 1e-9);
  EXPECT_NEAR(j["angle_in_turn_deg"].get<double>(), 30.2, 1e-9);
  EXPECT_NEAR(j["planned_speed_deg_s"].get<double>(), 25, 1e-9);
  EXPECT_NEAR(j["max_late_deg"].get<double>(), 3, 1e-9);
  EXPECT_NEAR(j["tolerance_deg"].get<double>(), 1, 1e-9);
  EXPECT_NEAR(j["stage_error_deg"].get<double>(), -0.25, 1e-9);
  EXPECT_NEAR(j["worst_stage_error_deg"].get<double>(), 0.5, 1e-9);
  EXPECT_NEAR(j["worst_late_deg"].get<double>(), 0.125, 1e-9);
  EXPECT_NEAR(j["lateness_deg"]["worst"].get<double>(), 0.125, 1e-9);
  const Seen seen = seen_in(j.dump());
  EXPECT_TRUE(seen.facts.turns());
  EXPECT_EQ(json::parse(state_json(seen.facts, seen.state, {}))["lateness_deg"], j["lateness_deg"]);
  // Damage: angles without a scale, a scale without angles.
  for (const char* text : {R"({"phase":"printing","angles":60,"frames":600})",
                           R"({"phase":"printing","um_per_deg":200,"frames":600})",
                           R"({"phase":"printing","angles":60,"um_per_deg":-1,"frames":600})",
                           R"({"phase":"printing","angles":2000000000,"um_per_deg":1e-300,)"
                           R"("frames":2000000000,"frames_shown":2000000000,"stage_um":1e300})"}) {
    const Seen damaged = seen_in(text);
    check_metrics(metrics_text(damaged, {}));
    EXPECT_EQ(live_frame(damaged, 80, 24, true).size(), 24U) << text;
  }
}

const std::string kTurnHeader =
    "frame,planned_z_um,z_um,planned_s,shown_s,late_um,speed_um_s,blue_share,uv_mw_cm2,blue_measured,uv_measured,late,stage_error_um,temperature_c,exposure_s,exposed_s,vblank,missed_vblanks,upload_s,present_s,job_frame,from_deg,to_deg\n";

class TurnRecord : public testing::Test {
 protected:
  TurnRecord() {
    Printer printer;
    printer.name = "p";
    state = StateFolder::of(folder.path(), printer);
  }
  void put(const char* name, const std::string& text) {
    write_file(state.file(name), to_bytes(text));
  }
  static std::string event(double at_s, const std::string& what, const std::string& detail,
                           double deg, int frame = -1) {
    return json{{"time", "2026-01-02T03:04:05.678Z"},
                {"at_s", at_s},
                {"what", what},
                {"detail", detail},
                {"frame", frame},
                {"stage_um", deg * kUmPerDeg}}
               .dump() +
           "\n";
  }
  static std::string begin() {
    json line = json::parse(event(0, kJournalBegin, "/tmp/wheel.frames", 0));
    line["facts"] = json::parse(facts_json(turning_facts()));
    return line.dump() + "\n";
  }
  /// Frame n, late by so much.
  static std::string row(int n, double late_deg, bool late = false) {
    const double deg = 6.0 * n, s = deg / 25;
    return fmt::format("{},{},{},{},{},{},{},1,0,1,0,{},{},25,,0.24,,0,0,0,{},{},{}\n", n,
                       deg * kUmPerDeg, (deg + late_deg) * kUmPerDeg, s, s + late_deg / 25,
                       late_deg * kUmPerDeg, 25 * kUmPerDeg, late ? 1 : 0, 0.25 * kUmPerDeg,
                       n % kSeenAngles, 357 + deg + late_deg, 363 + deg);
  }
  TemporaryFolder folder;
  StateFolder state;
};

TEST_F(TurnRecord, OfAPrintThatWasKilledTheLastFramesAngleIsKnown) {
  put("journal.jsonl", begin() + event(1, "phase printing", "", 0));
  put("frames.csv", kTurnHeader + row(0, 0.05) + row(1, 0.05) + row(62, 0.05));
  const auto latch = read_latch(state, true);
  ASSERT_TRUE(latch && latch->left && latch->left->stage_deg);
  EXPECT_EQ(latch->frame, 62);
  EXPECT_NEAR(*latch->left->stage_deg, 357 + 62 * 6 + 0.05, 1e-9);
  EXPECT_NEAR(latch->stage_um, (357 + 62 * 6 + 0.05) * kUmPerDeg, 1e-6);
  EXPECT_THAT(in_words(*latch->left), HasSubstr("stage at 729.05°"));
  // Facts of other types are as if there were none.
  put("journal.jsonl", R"({"what":"print begins","facts":{"start_um":"x","um_per_deg":[1]}})"
                       "\n");
  EXPECT_FALSE(read_latch(state, true)->left->stage_deg);
}

TEST_F(TurnRecord, ThePageIsInDegrees) {
  put("journal.jsonl", begin() + event(1, "phase printing", "", 0) +
                           event(20, "fault late_frame", "frame 62 began 4 ° late", 361, 62) +
                           event(20, "phase lamps_off", "", 361.5, 62) +
                           event(20.1, kJournalEnd, "failed", 364));
  std::string frames = kTurnHeader;
  for (int n = 0; n < 62; ++n) frames += row(n, 0.05);
  frames += row(62, 4, true);
  put("frames.csv", frames);
  const PrintRecord r = read_record(state, false);
  EXPECT_EQ(r.frames.size(), 63U);
  // 0.05 ends a bin, and the text of a double may lie on either side of it.
  EXPECT_EQ(r.lateness.deg[3] + r.lateness.deg[4], 62U);
  EXPECT_EQ(r.lateness.deg[9], 1U) << "4°: above 2, up to 5";
  EXPECT_NEAR(r.lateness.worst_deg, 4, 1e-9);
  const std::string html = report_page(r);
  for (const char* what :
       {"10 turns of 60 frames at 25 °/s; a degree is 200.0 um", "frames 3° late",
        "the stage 1° off", "<b>4.000°</b><span>the latest frame, 800.00 um at the wall",
        "<b>0.250°</b><span>largest error of the stage, 50.00 um at the wall; 1° borne",
        "at frame 62, 4.0° on from the first", "degrees of the turn", "late, °", "error, °",
        ">turns<", ">°/s<", "frame 62: 4.000 °",
        // The late frame: its turn, its place, how late in degrees, at the wall, in time.
        "<th scope=\"row\">62</th><td>2</td><td>376.00</td><td>4.000</td><td>800.00</td><td>160.00"
        "</td>",
        "<th scope=\"col\">° on from the first</th>", "<td>-357.00</td>",
        "<th scope=\"row\">up to, °</th>"}) {
    EXPECT_THAT(html, HasSubstr(what));
  }
  expect_degrees_only(html);
  EXPECT_THAT(html, Not(HasSubstr("late, um")));
}

}  // namespace
}  // namespace slicecorr::bridge
