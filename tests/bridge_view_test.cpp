// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What a person sees of a print: its page, the live view, metrics; of whole records and of damaged
// ones. As programs: bridge_watch_test.cpp.

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <cmath>
#include <filesystem>
#include <numeric>
#include <random>
#include <regex>

#include "bridge_fixture.hpp"
#include "exposition_reader.hpp"
#include "slicecorr/bridge/view.hpp"
#include "support/text/display_text.hpp"
#include "view/envelope.hpp"

namespace slicecorr::bridge {
namespace {

using namespace slicecorr::test;
using nlohmann::json;
using testing::HasSubstr;
using testing::Not;
using End = PrintRecord::End;

// ---- what is counted ----

TEST(LatenessCounts, AValueFallsIntoTheFirstBoundNotBelowIt) {
  Lateness l;
  for (const double late : {-3.0, 0.0, 0.05, 0.050001, 200.0, 200.1, 1e9, std::nan("")}) {
    l.add_um(late);
  }
  EXPECT_EQ(l.um[0], 4U) << "early, in time, at the bound; what is no number is not late";
  EXPECT_EQ(l.um[1], 1U);
  EXPECT_EQ(l.um[Lateness::kBoundsUm.size() - 1], 1U);
  EXPECT_EQ(l.um.back(), 2U);
  EXPECT_EQ(l.worst_um, 1e9);
  for (std::size_t i = 0; i < Lateness::kBoundsMs.size(); ++i) {
    Lateness at, above;
    at.add_ms(Lateness::kBoundsMs[i]);
    above.add_ms(std::nextafter(Lateness::kBoundsMs[i], 1e9));
    EXPECT_EQ(at.ms[i], 1U);
    EXPECT_EQ(above.ms[i + 1], 1U);
  }
}

// ---- thinning ----

TEST(Envelope, KeepsWhatSticksOut) {
  std::mt19937 random(7);
  std::normal_distribution<double> noise;
  for (const int n : {0, 1, 2, 100, 2240, 2241, 50'000}) {
    std::vector<chart::Point> points;
    for (int i = 0; i < n; ++i) points.push_back({i * 0.01, noise(random)});
    for (int spike = 0; spike < n / 100; ++spike) {
      points[random() % points.size()].y = (spike % 2 == 0 ? 1 : -1) * (100.0 + spike);
    }
    auto shuffled = points;
    std::shuffle(shuffled.begin(), shuffled.end(), random);
    const auto thin = detail::envelope(shuffled);
    EXPECT_LE(thin.size(), 4U * detail::kEnvelopeColumns);
    EXPECT_EQ(thin.empty(), points.empty());
    // Beside each point, within a piece's width, there is one that is as high, and one as low.
    const double width = n > 1 ? points.back().x / detail::kEnvelopeColumns : 1;
    std::size_t from = 0;
    for (const chart::Point& p : points) {
      while (from < thin.size() && thin[from].x < p.x - 1.001 * width) ++from;
      double low = INFINITY, high = -INFINITY;
      for (std::size_t i = from; i < thin.size() && thin[i].x <= p.x + 1.001 * width; ++i) {
        low = std::min(low, thin[i].y);
        high = std::max(high, thin[i].y);
      }
      ASSERT_LE(low, p.y) << n;
      ASSERT_GE(high, p.y) << n;
    }
    EXPECT_TRUE(std::is_sorted(thin.begin(), thin.end(),
                               [](const auto& a, const auto& b) { return a.x < b.x; }));
  }
  // All at one place, and what is no number.
  std::vector<chart::Point> same(10'000, {1, 2});
  same[5000].y = 7;
  same[5001] = {1, NAN};
  same[5002] = {INFINITY, 1};
  const auto thin = detail::envelope(same);
  EXPECT_LE(thin.size(), 4U);
  EXPECT_TRUE(std::any_of(thin.begin(), thin.end(), [](const auto& p) { return p.y == 7; }));
}

TEST(Envelope, PeaksCountEverything) {
  std::mt19937 random(3);
  for (const int n : {0, 1, 5, 1000}) {
    std::vector<chart::Point> points;
    for (int i = 0; i < n; ++i) {
      points.push_back({static_cast<double>(random() % 1000), static_cast<double>(random() % 50)});
    }
    if (n > 0) points.push_back({NAN, 1});
    int count = 0;
    double highest = 0;
    for (const auto& p : detail::peaks(points)) {
      count += p.count;
      highest = std::max(highest, p.at.y);
      EXPECT_EQ(points[p.index].y, p.at.y);
    }
    EXPECT_EQ(count, n);
    for (const auto& p : points) EXPECT_GE(highest, std::isfinite(p.x) ? p.y : 0);
  }
}

// ---- records on disk ----

const std::string kHeader =
    "frame,planned_z_um,z_um,planned_s,shown_s,late_um,speed_um_s,blue_share,uv_mw_cm2,blue_measured,uv_measured,late,stage_error_um,temperature_c,exposure_s,exposed_s\n";

std::string row(int frame, double late_um = 0.01, bool late = false) {
  const double z = 10.0 * frame, s = 0.045 * frame;
  return fmt::format(
      "{},{:.6f},{:.6f},{:.6f},{:.6f},{:.6f},222.2,1.0,20.0,0.99,19.9,{},0.3,25.0,,\n", frame, z,
      z + late_um, s, s + late_um / 222.2, late_um, late ? 1 : 0);
}

class Record : public testing::Test {
 protected:
  Record() {
    Printer printer;
    printer.name = "p";
    state = StateFolder::of(folder.path(), printer);
  }
  void put(const char* name, const std::string& text) {
    write_file(state.file(name), to_bytes(text));
  }
  /// A line of the journal.
  static std::string event(double at_s, const std::string& what, const std::string& detail = {},
                           int frame = -1, const json& facts = {}) {
    json j{{"time", "2026-01-02T03:04:05.678Z"},
           {"at_s", at_s},
           {"what", what},
           {"detail", detail},
           {"frame", frame},
           {"stage_um", 30 + 10.0 * frame}};
    if (!facts.is_null()) j["facts"] = facts;
    return j.dump() + "\n";
  }
  static json facts(int frames) {
    return {{"printer", "p"},
            {"frames", frames},
            {"mode", "continuous"},
            {"layer_um", 10},
            {"planned_speed_um_s", 222.2},
            {"start_um", 30},
            {"end_um", 30 + 10 * frames},
            {"expected_s", 1.5},
            {"max_late_um", 5},
            {"max_late_frames", 0},
            {"tolerance_um", 20},
            {"cycle_s", 0.01},
            {"ring_frames", 16},
            {"display", "null"},
            {"uv", true},
            {"dry_run", false}};
  }
  std::string begin(const std::string& stack = "/tmp/part.uvj", int frames = 3) {
    return event(0, kJournalBegin, stack, -1, facts(frames)) +
           event(0.01, "threads", "real-time priority 50, memory locked");
  }
  PrintRecord read(bool running = false) { return read_record(state, running); }
  std::string page() { return report_page(read()); }
  /// Markup that browsers need not mend, nothing from elsewhere, no number that is none.
  static void check_page(const std::string& html) {
    for (const char* tag : {"table", "tbody", "thead", "tr", "td", "details", "figure", "svg",
                            "main", "div", "p", "body", "html"}) {
      const auto times = [&](const std::string& what) {
        std::size_t n = 0;
        for (std::size_t at = 0; (at = html.find(what, at)) != html.npos; at += what.size()) ++n;
        return n;
      };
      const std::string name = tag;
      EXPECT_EQ(times("<" + name + ">") + times("<" + name + " "), times("</" + name + ">")) << tag;
    }
    for (const char* never : {"<script", "<img", "url(", "@import", "nan<", ">nan", "nan ", "inf<",
                              ">inf", "inf ", "onerror=alert(1)>"}) {
      EXPECT_EQ(html.find(never), html.npos) << never;
    }
    for (const char* from : {"src=", "href="}) {
      for (std::size_t at = 0; (at = html.find(from, at)) != html.npos; ++at) {
        const std::size_t opened = html.rfind('<', at), closed = html.rfind('>', at);
        EXPECT_LT(opened, closed) << "in a tag: " << html.substr(opened, 100);
      }
    }
  }

  TemporaryFolder folder;
  StateFolder state;
};

TEST_F(Record, NothingThere) {
  PrintRecord r = read();
  EXPECT_EQ(r.end, End::none);
  EXPECT_THAT(page(), HasSubstr("No print is recorded"));
  check_page(page());
  put("journal.jsonl", "");
  put("frames.csv", "");
  put("status.json", "");
  r = read();
  EXPECT_EQ(r.end, End::none);
  check_page(page());
  EXPECT_EQ(read_record(state, false, true).end, End::none);
}

TEST_F(Record, AGoodOneAndItsPage) {
  put("journal.jsonl", begin() + event(0.5, "phase printing") + event(2.0, "phase blue_off") +
                           event(3.0, kJournalEnd, "done"));
  put("frames.csv", kHeader + row(0) + row(1, 0.3) + row(2));
  PrintState last;
  last.phase = Phase::done;
  last.frames_shown = 3;
  last.missed_cycles = 4;
  last.worst_stage_error_um = 1.25;
  PrintFacts f;
  f.stack = "/tmp/part.uvj";
  PrintAround around;
  around.seconds = 3;
  put("status.json", state_json(f, last, around));
  const PrintRecord r = read();
  EXPECT_EQ(r.end, End::done);
  EXPECT_EQ(r.frames.size(), 3U);
  EXPECT_EQ(r.facts.frames, 3);
  EXPECT_EQ(r.facts.stack, "/tmp/part.uvj");
  EXPECT_EQ(r.threads, "real-time priority 50, memory locked");
  EXPECT_TRUE(r.remarks.empty()) << testing::PrintToString(r.remarks);
  ASSERT_TRUE(r.last);
  EXPECT_EQ(r.last->missed_cycles, 4);
  EXPECT_EQ(r.seconds, 3);
  EXPECT_EQ(r.lateness.um[0], 2U);
  EXPECT_EQ(r.lateness.um[3], 1U) << "0.3 um: above 0.2, up to 0.5";
  EXPECT_TRUE(std::isnan(r.frames[0].exposure_s));
  const std::string html = report_page(r);
  check_page(html);
  for (const char* text :
       {"Print of part.uvj: done", "of 3 frames shown", "real-time priority 50, memory locked",
        "1.25 um", "How late frames were", "Lateness of each frame", "Lamps, asked and measured",
        "UV, mW/cm²", "Speed", "Temperature", "1.5 s", "planned 1.5 s"}) {
    EXPECT_THAT(html, HasSubstr(text));
  }
  EXPECT_EQ(html, report_page(read())) << "the same record gives the same bytes";
  // Where nothing happened there is a line, and the charts are folded behind it.
  EXPECT_THAT(html, HasSubstr("<summary>No frame was late: at most 0.3 um off its place, 5 um are "
                              "borne; the stage was at most 1.25 um off, 20 um are borne"));
  // A frame that was nearly late is seen.
  put("frames.csv", kHeader + row(0) + row(1, 4.9) + row(2));
  EXPECT_THAT(page(), testing::Not(HasSubstr("No frame was late")));
}

TEST_F(Record, LampsAreLoggedAsSharesOfWhatWasAsked) {
  put("journal.jsonl", begin("/tmp/part.uvj", 1000) + event(45, kJournalEnd, "done", -1));
  // Blue light falls to 0.8, UV light to 0.7, each with noise that the median does not show; some frames
  // ask for half, one for nothing, and one was read while the lamp was still rising.
  std::string rows = kHeader;
  const auto blue = [](int n) { return 1 - 0.2 * n / 999; };
  const auto uv = [](int n) { return 1 - 0.3 * n / 999; };
  for (int n = 0; n < 1000; ++n) {
    const double asked = n % 7 == 3 ? 0.5 : n == 400 ? 0 : 1;
    const double noise = n == 777 ? 0.1 : 1 + 0.001 * (n % 5 - 2);
    rows += fmt::format("{},0,0,0,0,0,222.2,{},200,{:.6f},{:.6f},0,0.3,25.0,,\n", n, asked,
                        asked * blue(n) * noise, 200 * uv(n) * noise);
  }
  put("frames.csv", rows);
  const LampLog log = lamp_log(read());
  EXPECT_EQ(log.frames_a_row, 5U);
  EXPECT_EQ(log.rows, 200U);
  std::istringstream lines(log.csv);
  std::string line;
  std::getline(lines, line);
  EXPECT_EQ(line, "slice,lamp_share,uv_lamp_share");
  for (int n = 0; std::getline(lines, line); n += 5) {
    int slice = 0;
    double b = 0, u = 0;
    ASSERT_EQ(std::sscanf(line.c_str(), "%d,%lf,%lf", &slice, &b, &u), 3) << line;
    EXPECT_EQ(slice, n);
    // A block's frames differ by 0.001 at most, noise by 0.002.
    EXPECT_NEAR(b, blue(n + 2), 0.003) << n;
    EXPECT_NEAR(u, uv(n + 2), 0.003) << n;
  }
  EXPECT_LE(log.greatest, 1.003);
  // Without UV light there is no column of it; without what was measured there is no table.
  put("frames.csv", "frame,blue_share,blue_measured\n0,1,1.05\n1,1,0.9\n");
  const LampLog bare = lamp_log(read());
  EXPECT_EQ(bare.csv, "slice,lamp_share\n0,1.0000\n1,0.9000\n");
  EXPECT_DOUBLE_EQ(bare.greatest, 1.05);
  put("frames.csv", "frame,blue_share\n0,1\n");
  EXPECT_THROW(lamp_log(read()), InputError);
  put("frames.csv", "");
  EXPECT_THROW(lamp_log(read()), InputError);
}

TEST_F(Record, WithoutAnEndItWasCutOffOrRuns) {
  put("journal.jsonl", begin() + event(0.5, "phase printing", "", 1));
  put("frames.csv", kHeader + row(0) + row(1));
  // It is of the print before: whatever it says does not belong here.
  put("status.json",
      R"({"phase":"done","stack":"/tmp/part.uvj","frames_shown":99,"fault":"door_open"})");
  PrintRecord r = read();
  EXPECT_EQ(r.end, End::cut_off);
  EXPECT_FALSE(r.last);
  EXPECT_EQ(r.fault, Fault::none);
  EXPECT_THAT(page(), HasSubstr("was killed, or the power failed"));
  EXPECT_THAT(page(), HasSubstr("phase printing"));
  check_page(page());
  r = read(true);
  EXPECT_EQ(r.end, End::running);
  EXPECT_THAT(report_page(r), HasSubstr("It prints"));
  // Somebody has looked, and reset it.
  put("journal.jsonl", begin() + event(0.5, "phase printing", "", 1) + "\n" +
                           R"({"what":"print ends","detail":"reset"})" + "\n");
  r = read();
  EXPECT_EQ(r.end, End::cut_off);
  EXPECT_FALSE(r.last);
  check_page(page());
}

TEST_F(Record, TheOrderOfAFaultIsSeen) {
  put("journal.jsonl",
      begin() + event(0.5, "phase printing") + event(1.0, "fault stage_error", "80 um off", 1) +
          event(1.0, "phase lamps_off", "80 um off", 1) + event(1.0, "lamps off", "asked", 1) +
          event(1.01, "phase stopping", "", 1) + event(1.02, "phase blacking", "", 1) +
          event(1.03, "phase failed", "80 um off") + event(1.04, "latched", "stage_error") +
          event(1.05, kJournalEnd, "failed"));
  put("frames.csv", kHeader + row(0) + row(1));
  put("status.json", "{");
  const PrintRecord r = read();
  EXPECT_EQ(r.end, End::failed);
  EXPECT_EQ(r.fault, Fault::stage_error);
  EXPECT_EQ(r.fault_frame, 1);
  EXPECT_DOUBLE_EQ(r.fault_z_um, 10);
  ASSERT_EQ(r.remarks.size(), 1U);
  EXPECT_THAT(r.remarks[0], HasSubstr("status.json"));
  const std::string html = report_page(r);
  EXPECT_THAT(html, testing::Not(HasSubstr("o frame was late")));
  check_page(html);
  EXPECT_THAT(html, HasSubstr("80 um off, at frame 1, z = 0.010 mm"));
  EXPECT_THAT(html, HasSubstr(std::string(what_to_do(Fault::stage_error))));
  // Marked rows, with the time since the fault.
  const std::regex marked(
      R"re(<tr class="fault"><th scope="row">[0-9.]+</th><td>([0-9.]+)</td>)re");
  std::vector<std::string> since;
  for (std::sregex_iterator it(html.begin(), html.end(), marked), end; it != end; ++it) {
    since.push_back((*it)[1]);
  }
  EXPECT_EQ(since, (std::vector<std::string>{"0.0", "0.0", "0.0", "10.0", "20.0", "30.0", "40.0"}));
}

TEST_F(Record, DamagedRowsAreLeftOutAndSaid) {
  const std::vector<std::string> bad{"0,1,2\n",
                                     "x,0,0,0,0,0,0,0,0,0,0,0,0,0,,\n",
                                     "1.5,0,0,0,0,0,0,0,0,0,0,0,0,0,,\n",
                                     "-1,0,0,0,0,0,0,0,0,0,0,0,0,0,,\n",
                                     "1e99,0,0,0,0,0,0,0,0,0,0,0,0,0,,\n",
                                     "5,nan,0,0,0,0,0,0,0,0,0,0,0,0,,\n",
                                     "5,0,inf,0,0,0,0,0,0,0,0,0,0,0,,\n",
                                     "5,0,1e300,0,0,0,0,0,0,0,0,0,0,0,,\n",
                                     "5,0,0,0,0,0,0,0,0,0,0,0,0,0,,,\n",
                                     "\n",
                                     ",,,,,\n",
                                     std::string("5,\0,0\n", 6),
                                     std::string(1 << 20, 'x') + "\n"};
  std::string text = kHeader + row(3);
  for (const std::string& line : bad) text += line;
  text += row(3) + row(2) + row(4);  // again, back in time, and on
  text += row(5).substr(0, 20);      // while it is written
  put("journal.jsonl", begin() + event(1, kJournalEnd, "done"));
  put("frames.csv", text);
  put("status.json", R"({"stack":"/tmp/part.uvj","phase":"done"})");
  const PrintRecord r = read();
  ASSERT_EQ(r.frames.size(), 2U);
  EXPECT_EQ(r.frames[1].frame, 4);
  ASSERT_EQ(r.remarks.size(), 1U) << testing::PrintToString(r.remarks);
  EXPECT_THAT(r.remarks[0], HasSubstr(fmt::format("{} rows", bad.size() + 2)));
  check_page(page());
  EXPECT_THAT(page(), HasSubstr("rows can't be read"));
}

TEST_F(Record, ColumnsAreFoundByTheirNames) {
  put("journal.jsonl", begin() + event(1, kJournalEnd, "done"));
  put("status.json", R"({"stack":"/tmp/part.uvj","phase":"done"})");
  // Of a later version, in another order, with less: what is missing is not known.
  put("frames.csv", "vblank_s,late_um,frame,z_um\n0.1,7.5,0,1\n0.2,,1,11\n");
  const PrintRecord r = read();
  ASSERT_EQ(r.frames.size(), 2U);
  EXPECT_EQ(r.frames[0].late_um, 7.5);
  EXPECT_EQ(r.frames[1].z_um, 11);
  EXPECT_TRUE(std::isnan(r.frames[1].late_um));
  EXPECT_TRUE(std::isnan(r.frames[0].speed_um_s));
  EXPECT_EQ(r.lateness.um[6], 0U);
  EXPECT_EQ(r.lateness.um[7], 1U) << "above 5, up to 10";
  check_page(page());
  for (const char* text : {"z_um,late_um\n1,2\n", "\n", ",,,\n", "\xff\xfe\n", "frame"}) {
    put("frames.csv", text);
    EXPECT_TRUE(read().frames.empty());
    EXPECT_EQ(read().remarks.size(), 1U) << text;
    check_page(page());
  }
}

TEST_F(Record, DamagedJournals) {
  const std::vector<std::string> bad{"{\n",
                                     "[1,2]\n",
                                     "null\n",
                                     "12\n",
                                     "{\"what\":7}\n",
                                     std::string("\0\0\0\n", 4),
                                     "\xff\xfe\n",
                                     R"({"what":)" + std::string(100'000, '[') + "\n"};
  std::string text = begin();
  for (const std::string& line : bad) text += line;
  // Other types than expected are as if nothing was said.
  text += R"({"what":"fault mystery","at_s":"soon","detail":[1],"frame":"x","stage_um":null})"
          "\n";
  text += R"({"what":"x","at_s":1e308,"frame":1e300,"stage_um":-1e308})"
          "\n";
  text += event(1, kJournalEnd, "failed").substr(0, 30);
  put("journal.jsonl", text);
  put("frames.csv", kHeader + row(0));
  const PrintRecord r = read();
  EXPECT_EQ(r.end, End::cut_off);
  EXPECT_EQ(r.fault, Fault::defect) << "of a version that is not known";
  EXPECT_EQ(r.events.size(), 4U);
  ASSERT_EQ(r.remarks.size(), 1U);
  EXPECT_THAT(r.remarks[0], HasSubstr(fmt::format("the journal: {} lines", bad.size())));
  check_page(page());
  // Facts of other types.
  put("journal.jsonl",
      R"({"what":"print begins","detail":7,"facts":{"frames":"many","layer_um":[1],"uv":"yes"}})"
      "\n");
  EXPECT_EQ(read().facts.frames, 0);
  check_page(page());
  // Every cut of a good one is read without complaint but for what is cut.
  const std::string whole = begin() + event(0.5, "phase printing") +
                            event(0.6, "fault door_open", "open", 2) +
                            event(1, kJournalEnd, "failed");
  for (std::size_t size = 0; size <= whole.size(); size += 7) {
    put("journal.jsonl", whole.substr(0, size));
    EXPECT_LE(read().remarks.size(), 1U);  // status.json, at its end
    check_page(page());
  }
}

TEST_F(Record, WhatOthersWroteIsText) {
  const std::string nasty = "<img src=x onerror=alert(1)>\"&'\033[2J\xff";
  // JSON holds UTF-8; what is none is replaced before, as the journal does.
  const std::string stack = "/tmp/<script>alert(2)</script>\"&.uvj";
  put("journal.jsonl", begin(stack) +
                           event(0.1, "<b>what</b>", "<img src=x onerror=alert(1)>\"&'\033[2J") +
                           event(1, "fault defect", "<img src=x onerror=alert(1)>"));
  put("frames.csv", kHeader + row(0));
  const std::string html = page();
  check_page(html);
  EXPECT_EQ(html.find('\033'), html.npos);
  EXPECT_THAT(html, HasSubstr("&lt;img src"));
  EXPECT_THAT(html, HasSubstr("&lt;b&gt;what"));
  // The same on a terminal.
  Seen seen;
  seen.known = seen.running = true;
  seen.printer = nasty;
  seen.facts.stack = nasty;
  seen.state.fault = Fault::defect;
  seen.state.detail = nasty;
  for (const std::string& line : live_frame(seen, 80, 24, false)) {
    EXPECT_EQ(line.find('\033'), line.npos);
    EXPECT_EQ(line.find('\xff'), line.npos);
  }
  EXPECT_EQ(live_line(seen).find('\033'), std::string::npos);
  EXPECT_EQ(event_line(event(1, nasty.substr(0, nasty.size() - 1), "\033]0;x\007")).find('\033'),
            std::string::npos);
  // And in labels of metrics.
  seen.printer = "a\"b\\c\nd";
  check_metrics(metrics_text(seen, {{Fault::defect, 1}}));
}

TEST_F(Record, AHundredThousandFrames) {
  constexpr int frames = 100'000;
  std::mt19937 random(5);
  std::normal_distribution<double> noise(0, 0.2);
  std::set<int> late;
  while (late.size() < 400) late.insert(static_cast<int>(random() % frames));
  std::string text = kHeader;
  int worst = -1;
  for (int i = 0; i < frames; ++i) {
    const bool is_late = late.contains(i);
    if (is_late && worst < 0) worst = i;
    text += row(i, is_late ? (i == worst ? 98.75 : 6 + noise(random)) : noise(random), is_late);
  }
  std::string journal = begin("/tmp/big.uvj", frames);
  for (int i = 0; i < 20'000; ++i) journal += event(i, "no answer", "connection refused", i);
  put("journal.jsonl", journal + event(5000, kJournalEnd, "done"));
  put("frames.csv", text);
  put("status.json", R"({"stack":"/tmp/big.uvj","phase":"done"})");
  const std::string html = page();
  check_page(html);
  EXPECT_LT(html.size(), 2U << 20);
  EXPECT_GT(html.size(), 100'000U);
  // Every late frame is under a mark, the worst by name, in its place of the table, too.
  int marked = 0;
  const std::regex one("<title>frame ([0-9]+): "),
      several("<title>([0-9]+) late frames here; the worst, ([0-9]+): ");
  for (std::sregex_iterator it(html.begin(), html.end(), one), end; it != end; ++it) {
    EXPECT_TRUE(late.contains(std::stoi((*it)[1])));
    ++marked;
  }
  for (std::sregex_iterator it(html.begin(), html.end(), several), end; it != end; ++it) {
    EXPECT_TRUE(late.contains(std::stoi((*it)[2])));
    marked += std::stoi((*it)[1]);
  }
  EXPECT_EQ(marked, 400);
  EXPECT_THAT(html, HasSubstr(fmt::format("{}: 98.75 um", worst)));
  EXPECT_THAT(html, HasSubstr(fmt::format("<tr><th scope=\"row\">{}</th>", worst)));
  EXPECT_THAT(html, HasSubstr("lines are left out"));
  EXPECT_THAT(html, HasSubstr("The worst 300 of 400"));
}

TEST_F(Record, FaultsAreCountedInTheJournal) {
  for (const auto& [fault, count] : count_faults(state)) EXPECT_EQ(count, 0) << name_of(fault);
  put("journal.jsonl", begin() + event(1, "fault door_open", "open") + "{\"what\":\"fault \n" +
                           event(1, "x", "\"fault stage_error\""));
  int all = 0;
  for (const auto& [fault, count] : count_faults(state)) {
    EXPECT_EQ(count, fault == Fault::door_open ? 1 : 0) << name_of(fault);
    EXPECT_NE(fault, Fault::none);
    ++all;
  }
  EXPECT_EQ(all, static_cast<int>(Fault::defect));
}

TEST_F(Record, PagesOfPrintsThatWereKilledAreMadeLater) {
  put("journal.jsonl", begin("/tmp/first.uvj") + event(0.5, "phase printing"));
  put("frames.csv", kHeader + row(0));
  keep_report(state);
  EXPECT_FALSE(std::filesystem::exists(state.file("report.html")));
  EXPECT_THAT(text_of(state.file("report.previous.html")), HasSubstr("first.uvj: cut off"));
  put("journal.jsonl", begin("/tmp/second.uvj") + event(1, kJournalEnd, "done"));
  write_report(state, false);
  EXPECT_THAT(text_of(state.file("report.html")), HasSubstr("second.uvj: done"));
  keep_report(state);
  EXPECT_THAT(text_of(state.file("report.previous.html")), HasSubstr("second.uvj: done"));
  // Where nothing was printed there is nothing to keep.
  std::filesystem::remove_all(state.path);
  std::filesystem::create_directories(state.path);
  keep_report(state);
  EXPECT_TRUE(std::filesystem::is_empty(state.path));
}

// ---- the state, as text and back ----

PrintState some_state() {
  PrintState s;
  s.phase = Phase::printing;
  s.frame = 17;
  s.frames_shown = 18;
  s.late_frames = 2;
  s.missed_cycles = 3;
  s.at_s = 12.5;
  s.phase_since_s = 4.5;
  s.stage_um = 210;
  s.speed_um_s = 222.1;
  s.stage_error_um = -0.25;
  s.worst_late_um = 6.5;
  s.worst_stage_error_um = 1.5;
  s.blue_share = 0.75;
  s.blue_measured = 0.74;
  s.uv_mw_cm2 = 20;
  s.uv_measured = 19.5;
  s.temperature_c = 31.5;
  for (int i = 0; i < 16; ++i) s.lateness.add_um(0.01);
  s.lateness.add_um(0.3);
  s.lateness.add_um(6.5);
  for (int i = 0; i < 18; ++i) s.lateness.add_ms(0.05);
  s.told = 50;
  return s;
}

PrintFacts some_facts() {
  PrintFacts f;
  f.stack = "/tmp/part.uvj";
  f.printer = "p";
  f.frames = 40;
  f.layer_um = 10;
  f.speed_um_s = 222.2;
  f.start_um = 30;
  f.end_um = 430;
  f.expected_s = 1.8;
  f.max_late_um = 5;
  f.tolerance_um = 20;
  f.cycle_s = 0.01;
  f.ring_frames = 16;
  f.uv = true;
  return f;
}

TEST_F(Record, StatusTellsTheStateAndIsReadBack) {
  PrintAround around;
  around.ready_frames = 12;
  around.asked = 4;
  around.threads = "normal priority";
  const std::string status =
      status_text(state, "p", state_json(some_facts(), some_state(), around));
  const json j = json::parse(status);
  // Keys of scripts, which stay.
  for (const char* key : {"printer",
                          "running",
                          "phase",
                          "dry_run",
                          "stack",
                          "frame",
                          "frames",
                          "stage_um",
                          "z_um",
                          "fault",
                          "detail",
                          "late_frames",
                          "worst_late_um",
                          "worst_stage_error_um",
                          "missed_cycles",
                          "ready_frames",
                          "at_s",
                          "latched",
                          "frames_shown",
                          "speed_um_s",
                          "stage_error_um",
                          "blue_share",
                          "blue_measured",
                          "uv_mw_cm2",
                          "uv_measured",
                          "temperature_c",
                          "left_s",
                          "lateness_um",
                          "lateness_ms",
                          "threads",
                          "phase_since_s",
                          "display",
                          "mode",
                          "uv",
                          "layer_um",
                          "planned_speed_um_s",
                          "start_um",
                          "end_um",
                          "expected_s",
                          "max_late_um",
                          "max_late_frames",
                          "tolerance_um",
                          "cycle_s",
                          "ring_frames",
                          "told",
                          "asked"}) {
    EXPECT_TRUE(j.contains(key)) << key;
  }
  EXPECT_EQ(j["z_um"], 180);
  EXPECT_NEAR(j["left_s"].get<double>(), (430 - 210) / 222.2, 1e-9);
  EXPECT_EQ(j["lateness_um"]["counts"].size(), j["lateness_um"]["up_to"].size() + 1);
  const Seen seen = seen_in(status);
  EXPECT_TRUE(seen.running);
  EXPECT_TRUE(seen.known);
  EXPECT_FALSE(seen.latched);
  EXPECT_EQ(state_json(seen.facts, seen.state, around),
            state_json(some_facts(), some_state(), around));
  // Nothing runs and nothing ran; damage; a latch.
  const Seen none = seen_in(status_text(state, "p", {}));
  EXPECT_FALSE(none.running);
  EXPECT_FALSE(none.known);
  for (const char* text : {"", "{", "[]", "7", R"({"phase":3,"frames":"x","lateness_um":7})",
                           R"({"lateness_um":{"counts":[1]},"running":true,"printer":"q"})"}) {
    put("status.json", text);
    const Seen damaged = seen_in(status_text(state, "p", {}));
    EXPECT_FALSE(damaged.running) << text;
    EXPECT_EQ(damaged.printer, "p") << text;
    check_metrics(metrics_text(damaged, count_faults(state)));
    EXPECT_EQ(live_frame(damaged, 80, 24, true).size(), 24U);
  }
  for (const char* text :
       {R"({"fault":5})", R"({"detail":[],"frame":"x","stage_um":{}})", "[]", "x",
        R"({"fault":"door_open","after_fault":{"confirmed":1,"dark":"yes"}})"}) {
    put("latch.json", text);
    const auto latch = read_latch(state, false);
    ASSERT_TRUE(latch) << text;
    EXPECT_NE(latch->fault, Fault::none) << text;
    EXPECT_TRUE(seen_in(status_text(state, "p", {})).latched) << text;
  }
  put("latch.json", "");
  std::filesystem::remove(state.file("latch.json"));
  put("journal.jsonl", R"({"what":7,"frame":"x"})"
                       "\n"
                       "{\"what\":\"" +
                           std::string(kJournalBegin) +
                           R"(","detail":5,"facts":[1],"stage_um":"y"})"
                           "\n[]\n");
  EXPECT_TRUE(read_latch(state, false)) << "it has no end";
  std::filesystem::remove(state.file("journal.jsonl"));
  write_latch(state, {Fault::door_open, "a door is open", "a.uvj", 3, 60});
  const std::string latched = status_text(state, "p", {});
  EXPECT_TRUE(seen_in(latched).latched);
  EXPECT_EQ(json::parse(latched)["to_do"], std::string(what_to_do(Fault::door_open)));
  EXPECT_THAT(live_line(seen_in(latched)), HasSubstr("printbridge reset"));
}

TEST(Left, OfEachPhase) {
  PrintFacts f = some_facts();
  PrintState s = some_state();
  s.phase = Phase::homing;
  EXPECT_EQ(left_s(f, s), 1.8);
  for (const Phase phase : {Phase::printing, Phase::paused}) {
    s.phase = phase;
    EXPECT_NEAR(*left_s(f, s), 220 / 222.2, 1e-12);
  }
  s.stage_um = 1e4;
  EXPECT_EQ(left_s(f, s), 0);
  for (const Phase phase : {Phase::blue_off, Phase::raising, Phase::done, Phase::failed}) {
    s.phase = phase;
    EXPECT_FALSE(left_s(f, s)) << name_of(phase);
  }
  f.layerwise = true;
  s.phase = Phase::printing;
  EXPECT_NEAR(*left_s(f, s), 1.8 * 22 / 40, 1e-12);
  s.fault = Fault::door_open;
  EXPECT_FALSE(left_s(f, s));
}

PrintPlan layers_of(const std::vector<double>& exposures_s, double more_s) {
  PrintPlan plan;
  plan.mode = ExposureMode::layerwise;
  plan.layer_um = 50;
  for (const double s : exposures_s) {
    plan.frames.emplace_back();
    plan.frames.back().exposure_s = s;
    plan.expected_s += s + more_s;
  }
  return plan;
}

TEST(Left, CountsTheTimeOfEachLayer) {
  // Three bottom layers of 10 s, seven of 2 s, each with a second of lift: 33 + 21 s.
  const PrintPlan plan = layers_of({10, 10, 10, 2, 2, 2, 2, 2, 2, 2}, 1);
  const PrintFacts f = facts_of(plan, Machine{});
  PrintState s;
  s.phase = Phase::printing;
  EXPECT_EQ(left_s(f, s), 54);
  s.frames_shown = 2;
  s.newest_at_s = 20;
  s.at_s = 24;
  EXPECT_NEAR(*left_s(f, s), 54 - 11 - 4, 1e-9);
  s.at_s = 40;  // longer than the layer: it stands where the next one would begin
  EXPECT_NEAR(*left_s(f, s), 54 - 22, 1e-9);
  s.frames_shown = 10;
  s.newest_at_s = 51;
  s.at_s = 52.5;
  EXPECT_NEAR(*left_s(f, s), 1.5, 1e-9);
  s.at_s = 99;
  EXPECT_EQ(left_s(f, s), 0);
  // It goes through JSON and back.
  const Seen seen = seen_in(state_json(f, s, {}));
  EXPECT_EQ(seen.facts.begins.size(), f.begins.size());
  EXPECT_EQ(seen.facts.begin_s(3), f.begin_s(3));
}

TEST(Left, CountsTheSpeedOfEachSlice) {
  PrintPlan plan;
  plan.layer_um = 50;
  plan.speed_um_s = 100;
  plan.slice_speed_um_s = {50, 50, 100, 100, 100, 100};
  plan.frames.resize(6);
  plan.end_um = 300;
  plan.expected_s = 4;
  const PrintFacts f = facts_of(plan, Machine{});
  PrintState s;
  s.phase = Phase::printing;
  s.stage_um = 50;
  EXPECT_NEAR(*left_s(f, s), 3, 1e-9);
  s.stage_um = 125;
  EXPECT_NEAR(*left_s(f, s), 1.75, 1e-9);
}

TEST(Left, StraightLinesTellATwoHundredth) {
  std::mt19937 random(7);
  for (int round = 0; round < 50; ++round) {
    std::vector<double> exposures(1 + random() % 2000);
    for (double& s : exposures) s = std::lognormal_distribution<>(0, round * 0.05)(random);
    const PrintPlan plan = layers_of(exposures, 0.5);
    const PrintFacts f = facts_of(plan, Machine{});
    EXPECT_LE(f.begins.size(), 402U);
    double begin_s = 0;
    for (std::size_t n = 0; n <= exposures.size(); ++n) {
      ASSERT_NEAR(f.begin_s(static_cast<double>(n)), begin_s, plan.expected_s / 199) << n;
      if (n < exposures.size()) begin_s += exposures[n] + 0.5;
    }
  }
  // Layers alike need none.
  EXPECT_TRUE(facts_of(layers_of(std::vector<double>(100, 2.5), 1), Machine{}).begins.empty());
}

// ---- live view and metrics ----

Seen some_seen() {
  Seen seen;
  seen.printer = "p";
  seen.running = seen.known = true;
  seen.facts = some_facts();
  seen.state = some_state();
  seen.around.ready_frames = 3;
  seen.left_s = left_s(seen.facts, seen.state);
  return seen;
}

TEST(Live, FitsEveryWindow) {
  Seen seen = some_seen();
  for (const bool failed : {false, true}) {
    if (failed) {
      seen.state.fault = Fault::lamp_mismatch;
      seen.state.detail = std::string(300, 'x');
    }
    for (const bool running : {true, false}) {
      seen.running = running;
      for (const int rows : {1, 2, 5, 12, 24, 60}) {
        for (const int columns : {1, 10, 40, 80, 200}) {
          const auto coloured = live_frame(seen, columns, rows, true);
          const auto bare = live_frame(seen, columns, rows, false);
          ASSERT_EQ(bare.size(), static_cast<std::size_t>(rows));
          for (std::size_t i = 0; i < bare.size(); ++i) {
            EXPECT_LE(text::columns_of(bare[i]), columns) << bare[i];
            EXPECT_EQ(std::regex_replace(coloured[i], std::regex("\033\\[[0-9;]*m"), ""), bare[i]);
          }
        }
      }
    }
  }
}

TEST(Live, ShowsWhatAPersonNeeds) {
  Seen seen = some_seen();
  std::string text = joined(live_frame(seen, 100, 40, false));
  for (const char* what :
       {"printing for 8.0 s", "part.uvj", " 45 %", "13 s elapsed", "1.0 s left", "18 of 40",
        "0.180 of 0.400 mm", "799.6 mm/h, planned 799.9",
        "-0.25 um off now, 1.50 at most, 20 borne", "75.0 % asked, 74.0 % measured",
        "20.00 mW/cm² asked, 19.50 mW/cm² measured", "31.5 °C", "18 of 40 frames", "3 of 16",
        "3 cycles of 10 ms", "2 frames", "6.50 um late", "up to 0.05 um", "up to 10 um"}) {
    EXPECT_THAT(text, HasSubstr(what));
  }
  EXPECT_THAT(text, Not(HasSubstr("to do")));
  seen.state.fault = Fault::stage_error;
  seen.state.detail = "80 um off";
  text = joined(live_frame(seen, 100, 40, false));
  EXPECT_THAT(text, HasSubstr("stage_error: 80 um off"));
  EXPECT_THAT(text, HasSubstr("1.50 um off at most until the fault, 20 borne"));
  EXPECT_THAT(text, Not(HasSubstr("off now")));
  EXPECT_THAT(text, HasSubstr("to do: " + std::string(what_to_do(Fault::stage_error))));
  // The least that a window shows is what is wrong.
  EXPECT_THAT(joined(live_frame(seen, 80, 6, false)), HasSubstr("stage_error"));
  seen.facts.layerwise = true;
  seen.state.fault = Fault::none;
  text = joined(live_frame(seen, 100, 40, false));
  EXPECT_THAT(text, HasSubstr("up to 0.1 ms"));
  EXPECT_THAT(text, Not(HasSubstr("mm/h")));
}

TEST(Metrics, FormatAndValues) {
  Seen seen = some_seen();
  const std::string text = metrics_text(seen, {{Fault::door_open, 1}, {Fault::defect, 0}});
  const auto m = check_metrics(text);
  const auto value = [&](const std::string& name, const std::string& labels = {}) {
    const std::string key = "printbridge_" + name + "{printer=\"p\"" + labels + "}";
    EXPECT_TRUE(m.contains(key)) << key;
    return m.contains(key) ? m.at(key) : NAN;
  };
  EXPECT_EQ(value("up"), 1);
  EXPECT_EQ(value("frames_shown_total"), 18);
  EXPECT_EQ(value("frames_late_total"), 2);
  EXPECT_EQ(value("frame_lateness_um_bucket", ",le=\"0.05\""), 16);
  EXPECT_EQ(value("frame_lateness_um_bucket", ",le=\"0.5\""), 17);
  EXPECT_EQ(value("frame_lateness_um_bucket", ",le=\"10\""), 18);
  EXPECT_EQ(value("frame_lateness_um_bucket", ",le=\"+Inf\""), 18);
  EXPECT_NEAR(value("frame_lateness_um_sum"), 16 * 0.01 + 0.3 + 6.5, 1e-9);
  EXPECT_EQ(value("frame_lateness_seconds_bucket", ",le=\"0.0001\""), 18);
  EXPECT_NEAR(value("frame_lateness_seconds_sum"), 18 * 5e-5, 1e-9);
  EXPECT_EQ(value("frame_lateness_worst_um"), 6.5);
  EXPECT_EQ(value("stage_error_um"), -0.25);
  EXPECT_EQ(value("blue_share", ",of=\"asked\""), 0.75);
  EXPECT_EQ(value("blue_share", ",of=\"measured\""), 0.74);
  EXPECT_EQ(value("uv_mw_cm2", ",of=\"measured\""), 19.5);
  EXPECT_EQ(value("temperature_celsius"), 31.5);
  EXPECT_EQ(value("phase", ",phase=\"printing\""), 1);
  EXPECT_EQ(value("phase", ",phase=\"done\""), 0);
  EXPECT_EQ(value("missed_cycles_total"), 3);
  EXPECT_EQ(value("faults_total", ",reason=\"door_open\""), 1);
  EXPECT_EQ(value("faults_total", ",reason=\"defect\""), 0);
  EXPECT_EQ(value("latched"), 0);
  EXPECT_TRUE(promtool_agrees(text));
  // Nobody prints: nothing is said of a print.
  seen = Seen{};
  seen.printer = "p";
  const std::string none = metrics_text(seen, {});
  EXPECT_EQ(check_metrics(none).at("printbridge_up{printer=\"p\"}"), 0);
  EXPECT_THAT(none, Not(HasSubstr("frames_shown")));
  EXPECT_TRUE(promtool_agrees(none));
}

}  // namespace
}  // namespace slicecorr::bridge
