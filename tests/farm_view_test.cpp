// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What is seen of the farm: table, JSON, live view, page of the morning, metrics.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <regex>
#include <set>
#include <thread>

#include "exposition_reader.hpp"
#include "farm_filled.hpp"
#include "farm_program.hpp"
#include "run_program.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/metrics.hpp"
#include "slicecorr/farm/morning.hpp"
#include "slicecorr/farm/status.hpp"
#include "terminal_screen.hpp"
#include "views/moment_text.hpp"
#include "views/time_axis.hpp"

namespace slicecorr::farm {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using slicecorr::test::check_metrics;
using slicecorr::test::kSlicefarm;
using slicecorr::test::run_program;
using slicecorr::test::RunOptions;
using slicecorr::test::Terminal;
using test::Farm;
using test::fill;
using test::Filled;
using ::testing::HasSubstr;
using ::testing::Not;

// --- words --------------------------------------------------------------------------------------

TEST(Words, Durations) {
  EXPECT_EQ(text::duration(-1), "-");
  EXPECT_EQ(text::duration(std::nan("")), "-");
  EXPECT_EQ(text::duration(0), "0.0 s");
  EXPECT_EQ(text::duration(59.4), "59 s");
  EXPECT_EQ(text::duration(59.6), "1 min 00 s");
  EXPECT_EQ(text::duration(3599.6), "1 h 00 min");
  EXPECT_EQ(text::duration(11400), "3 h 10 min");
  EXPECT_EQ(text::duration(187200), "2 d 04 h");
  EXPECT_EQ(text::duration(1e300).back(), 'h');
}

TEST(Words, BytesAndCounts) {
  EXPECT_EQ(text::bytes(0), "0 B");
  EXPECT_EQ(text::bytes(999), "999 B");
  EXPECT_EQ(text::bytes(999'960), "1.0 MB");
  EXPECT_EQ(text::bytes(31e9), "31.0 GB");
  EXPECT_EQ(text::bytes(-1), "-");
  EXPECT_EQ(text::count(0), "0");
  EXPECT_EQ(text::count(999), "999");
  EXPECT_EQ(text::count(-1234), "-1,234");
  EXPECT_EQ(text::count(100'000), "100,000");
}

/// Of two sizes that are compared it shows which one is larger, however little that is.
TEST(Words, BytesThatAreComparedDiffer) {
  using Two = std::pair<std::string, std::string>;
  EXPECT_EQ(text::bytes_apart(3.1e6, 2e9), Two("3.1 MB", "2.0 GB"));
  EXPECT_EQ(text::bytes_apart(3'140'000, 3'150'000), Two("3.14 MB", "3.15 MB"));
  EXPECT_EQ(text::bytes_apart(999'949, 999'960), Two("999.9 kB", "1.0 MB"));
  EXPECT_EQ(text::bytes_apart(5, 5), Two("5 B", "5 B"));
  EXPECT_EQ(text::bytes_apart(2e6, 2e6), Two("2.0 MB", "2.0 MB"));
  for (const std::int64_t n :
       {0LL, 1LL, 998LL, 999LL, 999'949LL, 1'000'000LL, 31LL << 30, 1LL << 50}) {
    const auto [less, more] = text::bytes_apart(static_cast<double>(n), static_cast<double>(n + 1));
    EXPECT_NE(less, more) << n;
  }
}

TEST(Words, FiguresHaveNoExponents) {
  EXPECT_EQ(text::figure(0), "0");
  EXPECT_EQ(text::figure(4323.6), "4,324");
  EXPECT_EQ(text::figure(1e6), "1,000,000");
  EXPECT_EQ(text::figure(12.345), "12.3");
  EXPECT_EQ(text::figure(12), "12");
  EXPECT_EQ(text::figure(9.999), "10");
  EXPECT_EQ(text::figure(99.96), "100");
  EXPECT_EQ(text::figure(999.4), "999");
  EXPECT_EQ(text::figure(999.5), "1,000");
  EXPECT_EQ(text::figure(0.001234), "0.00123");
  EXPECT_EQ(text::figure(-0.5), "-0.5");
  EXPECT_EQ(text::figure(1e-300), "0");
  EXPECT_EQ(text::figure(std::nan("")), "-");
  for (double v = 1e-12; v < 1e15; v *= 1.7) {
    EXPECT_EQ(text::figure(v).find('e'), std::string::npos) << v;
  }
}

TEST(Words, NothingMovesTheTerminal) {
  EXPECT_EQ(text::printable(test::kTerminalName), "bad?[2J?]0;title\077?name?");
  EXPECT_EQ(text::printable("a\nb\tc"), "a b c");
  EXPECT_EQ(text::printable("日本é"), "日本é");
  // Cut, overlong, surrogate, beyond the last character.
  for (const char* bad : {"\xE6\x97", "\xC0\xAF", "\xED\xA0\x80", "\xF4\x90\x80\x80", "\xFF"}) {
    for (const char c : text::printable(bad)) EXPECT_EQ(c, '?') << bad;
  }
  // Every byte alone and every pair give text without control characters.
  for (int a = 0; a < 256; ++a) {
    for (int b = 0; b < 256; ++b) {
      const std::string text{static_cast<char>(a), static_cast<char>(b)};
      for (const char c : text::printable(text)) {
        ASSERT_FALSE(static_cast<unsigned char>(c) < 0x20 || c == 0x7F) << a << " " << b;
      }
    }
  }
}

TEST(Words, WidthsAreKept) {
  EXPECT_EQ(text::columns_of("日本"), 4);
  EXPECT_EQ(text::columns_of("e\u0301"), 1);
  for (const std::string text : {"benchy", "日本語の部品", "e\u0301e\u0301e\u0301", ""}) {
    for (int width = 0; width < 14; ++width) {
      EXPECT_LE(text::columns_of(text::clipped(text, width)), width) << text;
      EXPECT_EQ(text::columns_of(text::padded(text, width)), width) << text;
      EXPECT_EQ(text::columns_of(text::padded(text, width, true)), width) << text;
    }
  }
  for (int eighth = 0; eighth <= 80; ++eighth) {
    EXPECT_EQ(text::columns_of(text::bar(eighth / 80.0, 10)), 10);
  }
  EXPECT_EQ(text::bar(1, 3), "███");
  EXPECT_EQ(text::bar(0.5, 3), "█▌ ");
  EXPECT_EQ(text::bar(std::nan(""), 2), "  ");
  EXPECT_EQ(text::bar(7, 2), "██");
}

TEST(TimeAxis, RoundTimesInsideTheRange) {
  const std::int64_t start = 1'772'000'000'000;
  for (const std::int64_t span_s : {5, 60, 700, 3600, 11 * 3600, 86400, 7 * 86400, 400 * 86400}) {
    const auto ticks = detail::time_ticks(start, start + span_s * 1000, 10);
    ASSERT_GE(ticks.size(), 1U) << span_s;
    EXPECT_LE(ticks.size(), 11U) << span_s;
    std::set<std::string> labels;
    for (const auto& t : ticks) {
      EXPECT_GE(t.ms, start);
      EXPECT_LE(t.ms, start + span_s * 1000);
      labels.insert(t.label);
    }
    EXPECT_EQ(labels.size(), ticks.size()) << span_s;
  }
}

TEST(Moment, AsPeopleWriteIt) {
  const std::int64_t now = system_clock().wall_ms();
  EXPECT_EQ(moment_of("36h", now, "--since"), now - 36 * 3600'000);
  EXPECT_EQ(moment_of("90min", now, "--since"), now - 90 * 60'000);
  EXPECT_EQ(moment_of("1.5d", now, "--since"), now - 36 * 3600'000);
  for (const char* minute : {"00:00", "07:00", "23:59"}) {
    const std::int64_t then = moment_of(minute, now, "--since");
    EXPECT_LE(then, now);
    // A day of summer time has 25 hours.
    EXPECT_GT(then, now - 25 * 3600'000);
    EXPECT_EQ(local_time_text(then).substr(11, 5), minute);
  }
  EXPECT_EQ(local_time_text(moment_of("2026-03-01 20:00", now, "--since")), "2026-03-01 20:00:00");
  for (const char* bad :
       {"", "yesterday", "25:00", "7:00", "-3h", "3", "3 h", "2026-03-01", "infh"}) {
    EXPECT_THROW(moment_of(bad, now, "--since"), InputError) << bad;
  }
}

// --- status -------------------------------------------------------------------------------------

TEST(Status, EveryStateAndReason) {
  Farm farm;
  const Filled f = fill(farm);
  auto model = farm.model();
  JobFilter filter;
  const StatusPage page = read_status(model, farm.folder, filter, farm.clock);
  const std::string text = status_text(page, farm.folder, 0);
  EXPECT_THAT(text, HasSubstr("1 running, 4 queued (1 wait for the same work), 8 done (1 from the "
                              "cache), 11 failed, 1 cancelled"));
  for (const Reason reason : test::kFinalReasons) {
    EXPECT_THAT(text, HasSubstr(fmt::format("{0}: what happened: {0}", name_of(reason))));
  }
  EXPECT_THAT(text, HasSubstr("correct 60 %, 462 of 770 layers, 4.0 s left"));
  EXPECT_THAT(text, HasSubstr(fmt::format("waits for job {}, the same work", f.running)));
  EXPECT_THAT(text, HasSubstr("again after worker_killed: ended by signal 9"));
  EXPECT_THAT(text, HasSubstr("from the cache, largest height error 3 um"));
  EXPECT_THAT(text, HasSubstr("largest height error 53 um, 17 lost"));
  EXPECT_THAT(text, HasSubstr("service: local on "));
  EXPECT_THAT(text, HasSubstr("benchy-日本"));
  EXPECT_EQ(text.find('\033'), text.npos);
  // What runs comes first, then what waits.
  EXPECT_LT(text.find("elephant-40mm"), text.find("benchy-日本"));
  EXPECT_LT(text.find("benchy-日本"), text.find("fails-bad_input"));
  // Cut for a terminal: no line is wider.
  std::istringstream lines(status_text(page, farm.folder, 60));
  for (std::string line; std::getline(lines, line);) EXPECT_LE(text::columns_of(line), 60) << line;
}

TEST(Status, JsonHasAllOfAJob) {
  Farm farm;
  const Filled f = fill(farm);
  auto model = farm.model();
  JobFilter filter;
  filter.limit = 1000;
  const json j =
      json::parse(status_json(read_status(model, farm.folder, filter, farm.clock), farm.folder));
  EXPECT_EQ(j["dir"], farm.folder.root);
  EXPECT_EQ(j["total"], 25);
  ASSERT_EQ(j["list"].size(), 25U);
  EXPECT_EQ(j["jobs"]["failed"], 11);
  EXPECT_EQ(j["running"].size(), 1U);
  EXPECT_EQ(j["running"][0]["attempt"]["layers_done"], 462);
  EXPECT_NEAR(j["running"][0]["layers_per_s"].get<double>(), 462 / 6.0, 1e-9);
  EXPECT_NEAR(j["running"][0]["eta_s"].get<double>(), 6 * 0.4 / 0.6, 1e-9);
  EXPECT_EQ(j["holds"], "");
  std::set<JobId> ids;
  for (const json& job : j["list"]) {
    ids.insert(job["id"].get<JobId>());
    for (const char* key : {"batch", "name", "state", "reason", "message", "user", "labels",
                            "priority", "ready_by_ms", "parts", "printer", "resin", "format",
                            "output_folder", "attempts", "submitted_ms", "files"}) {
      EXPECT_TRUE(job.contains(key)) << key;
    }
    EXPECT_EQ(job.contains("figures"), job["state"] == "done");
  }
  EXPECT_EQ(ids.size(), 25U);
  EXPECT_TRUE(ids.contains(f.nasty));
}

TEST(Status, Filters) {
  Farm farm;
  const Filled f = fill(farm);
  auto model = farm.model();
  const auto ids = [&](JobFilter filter) {
    std::vector<JobId> list;
    const StatusPage page = read_status(model, farm.folder, filter, farm.clock);
    for (const auto& job : page.jobs) list.push_back(job.id);
    EXPECT_EQ(page.total, static_cast<std::int64_t>(list.size()));
    return list;
  };
  JobFilter filter;
  filter.states = {JobState::failed};
  EXPECT_EQ(ids(filter), f.failed);
  filter = {};
  filter.user = "bert";
  EXPECT_EQ(ids(filter), std::vector{f.queued});
  filter = {};
  filter.label = "rush";
  EXPECT_EQ(ids(filter), std::vector{f.queued});
  filter = {};
  filter.text = "elephant";
  EXPECT_EQ(ids(filter), (std::vector{f.running, f.follower}));
  filter = {};
  filter.label = "nobody";
  EXPECT_TRUE(ids(filter).empty());
  filter = {};
  filter.states = {JobState::done};
  filter.order = JobFilter::Order::worst_height;
  EXPECT_EQ(ids(filter).front(), f.nasty);
}

TEST(Status, WhatHolds) {
  Farm farm;
  farm.submit({farm.job("a")});
  auto model = farm.model();
  const auto holds = [&] { return what_holds(read_overview(model, farm.folder, farm.clock)); };
  EXPECT_EQ(holds(), "");
  farm.set("paused", "yes");
  EXPECT_EQ(holds(), "paused");
  farm.set("draining", "yes");
  EXPECT_EQ(holds(), "draining");
  farm.queue.change_settings({{"paused", "no"}, {"draining", "no"}}, "test");
  const int minute = local_minute(farm.clock.wall_ms());
  farm.set("night", minute_text((minute + 60) % 1440) + "-" + minute_text((minute + 120) % 1440));
  EXPECT_EQ(holds(), "outside the night window");
  farm.set("night", "off");
  farm.set("min-free-mb", "1000000000");
  EXPECT_EQ(holds(), "disk full");
  farm.set("min-free-mb", "1");
  farm.queue.stop_service(farm.service);
  EXPECT_EQ(holds(), "no service is running");
}

TEST(Status, ProgramAndItsErrors) {
  Farm farm;
  fill(farm);
  auto result = run_program(
      {kSlicefarm, "status", "--dir", farm.root, "--state", "failed,cancelled", "--json", "-"});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const json j = json::parse(result.out);
  EXPECT_EQ(j["total"], 12);
  const std::string file = farm.root + "/status.json";
  result = run_program({kSlicefarm, "status", "--dir", farm.root, "--json", file});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("STATE"));
  EXPECT_TRUE(fs::exists(file));
  result = run_program({kSlicefarm, "status", "--dir", farm.root + "/nowhere"});
  EXPECT_EQ(result.exit_code, 2);
  EXPECT_THAT(result.err, HasSubstr("is no farm"));
  EXPECT_FALSE(fs::exists(farm.root + "/nowhere"));
  EXPECT_EQ(
      run_program({kSlicefarm, "status", "--dir", farm.root, "--state", "dreaming"}).exit_code, 2);
  EXPECT_EQ(run_program({kSlicefarm, "status", "--dir", farm.root, "--limit", "-1"}).exit_code, 2);
  // A database that is none.
  test::write_file(farm.root + "/other/farm.sqlite",
                   "this is no database, but long enough to look");
  result = run_program({kSlicefarm, "status", "--dir", farm.root + "/other"});
  EXPECT_EQ(result.exit_code, 2) << result.err;
}

TEST(Logs, OfEveryAttempt) {
  Farm farm;
  const Filled f = fill(farm);
  auto result = run_program({kSlicefarm, "logs", "--dir", farm.root, std::to_string(f.failed[0])});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("last line of fails-bad_input"));
  EXPECT_THAT(result.out, HasSubstr("attempt 1, local on night-owl: bad_input"));
  result = run_program({kSlicefarm, "logs", "--dir", farm.root, std::to_string(f.running)});
  EXPECT_THAT(result.out, HasSubstr("correcting"));
  result = run_program({kSlicefarm, "logs", "--dir", farm.root, std::to_string(f.again)});
  EXPECT_THAT(result.out, HasSubstr("half of a log"));
  EXPECT_THAT(result.out, testing::ContainsRegex("put_back +worker_killed: ended by signal 9"));
  EXPECT_EQ(run_program({kSlicefarm, "logs", "--dir", farm.root, "4711"}).exit_code, 2);
  EXPECT_EQ(run_program({kSlicefarm, "logs", "--dir", farm.root, "--attempt", "7",
                         std::to_string(f.running)})
                .exit_code,
            2);
}

TEST(Logs, OnlyTheFarmsOwnFilesAndTheirEnd) {
  Farm farm;
  const auto id = farm.submit({farm.job("a")})[0];
  const Claim claim = farm.claim();
  const std::string log = farm.folder.log(id, 1);
  Attempt attempt;
  attempt.token = claim.token;
  attempt.job = id;
  attempt.number = 1;
  EXPECT_EQ(log_tail(farm.folder, attempt, 100), "");
  std::string long_log;
  for (int i = 0; i < 1000; ++i) long_log += fmt::format("line {}\n", i);
  test::write_file(log, long_log);
  EXPECT_EQ(log_tail(farm.folder, attempt, 20), "line 998\nline 999\n");
  EXPECT_EQ(log_tail(farm.folder, attempt, 1 << 20), long_log);
  // A line that is longer than what is asked for.
  test::write_file(log, "first\n" + std::string(100, 'x') + "\n");
  EXPECT_EQ(log_tail(farm.folder, attempt, 20), std::string(19, 'x') + "\n");
  // A link leads elsewhere; a path in the record is not asked.
  fs::remove(log);
  fs::create_symlink("/etc/passwd", log);
  attempt.log = "/etc/passwd";
  EXPECT_EQ(log_tail(farm.folder, attempt, 1000), "");
  attempt.token = "../../../../etc";
  EXPECT_EQ(log_tail(farm.folder, attempt, 1000), "");
}

// --- live view ----------------------------------------------------------------------------------

std::string plain(const std::vector<std::string>& lines) {
  std::string text;
  for (const std::string& line : lines) text += line + "\n";
  return text;
}

std::string without_colour(const std::string& text) {
  return std::regex_replace(text, std::regex("\033\\[[0-9;]*m"), "");
}

TEST(Live, FitsEveryWindow) {
  Farm farm;
  fill(farm);
  auto model = farm.model();
  for (const int rows : {1, 2, 5, 8, 12, 24, 60}) {
    const LiveState state = read_live(model, farm.folder, rows, farm.clock);
    for (const int columns : {1, 10, 40, 80, 132, 300}) {
      const auto coloured = live_frame(state, farm.folder, columns, rows, true);
      const auto bare = live_frame(state, farm.folder, columns, rows, false);
      ASSERT_EQ(coloured.size(), static_cast<std::size_t>(rows));
      for (std::size_t i = 0; i < coloured.size(); ++i) {
        EXPECT_LE(text::columns_of(bare[i]), columns) << bare[i];
        EXPECT_EQ(without_colour(coloured[i]), bare[i]);
        EXPECT_EQ(bare[i].find('\033'), std::string::npos);
      }
    }
  }
}

TEST(Live, ShowsWhatRunsWaitsAndHappened) {
  Farm farm;
  const Filled f = fill(farm);
  farm.set("night", "20:00-07:00");
  auto model = farm.model();
  const std::string text =
      plain(live_frame(read_live(model, farm.folder, 40, farm.clock), farm.folder, 140, 40, false));
  EXPECT_THAT(text,
              HasSubstr("1 running · 4 queued (1 wait for the same work) · 8 done · 11 failed · 1 "
                        "cancelled"));
  EXPECT_THAT(text, HasSubstr("462/770 layers"));
  EXPECT_THAT(text, HasSubstr(" 60 %"));
  EXPECT_THAT(text, HasSubstr("77/s"));
  EXPECT_THAT(text, HasSubstr("4.0 s"));
  EXPECT_THAT(text, HasSubstr("night 20:00-07:00"));
  EXPECT_THAT(text, HasSubstr("disk "));
  EXPECT_THAT(text, HasSubstr("priority 5"));
  EXPECT_THAT(text, HasSubstr(fmt::format("waits for {}", f.running)));
  EXPECT_THAT(text, HasSubstr("q quit"));
  // Done and ended by themselves: 20 of 25, and 0.6 of one more: 82 %.
  EXPECT_THAT(text, HasSubstr(" 82 %"));
  // A usual window shows rate and time left, too.
  for (const int columns : {70, 80, 100, 110}) {
    const std::string narrow = plain(
        live_frame(read_live(model, farm.folder, 40, farm.clock), farm.folder, columns, 40, false));
    EXPECT_THAT(narrow, HasSubstr("462/770")) << columns;
    EXPECT_THAT(narrow, HasSubstr("77/s")) << columns;
    EXPECT_THAT(narrow, HasSubstr(" 4.0 s")) << columns;
  }
}

TEST(Live, OnATerminal) {
  Farm farm;
  const Filled f = fill(farm);
  Terminal terminal({kSlicefarm, "watch", "--dir", farm.root, "--interval-s", "0.1"}, 120, 36);
  ASSERT_TRUE(terminal.until([&] {
    return terminal.screen().find("elephant-40mm") != std::string::npos &&
           terminal.screen().find("q quit") != std::string::npos;
  })) << terminal.raw;
  EXPECT_TRUE(terminal.second_screen);
  EXPECT_FALSE(terminal.cursor);
  EXPECT_THAT(terminal.screen(), HasSubstr("benchy-日本"));
  EXPECT_THAT(terminal.screen(), HasSubstr(" 60 %"));
  // Progress shows by itself; only what changed is written.
  const std::size_t before = terminal.raw.size();
  const auto token = farm.model().job(f.running)->token;
  farm.queue.record_progress({{token, "report", "night-owl", 0.9, 693}});
  ASSERT_TRUE(terminal.until([&] {
    return terminal.screen().find("693/770 layers") != std::string::npos;
  })) << terminal.screen();
  EXPECT_THAT(terminal.screen(), Not(HasSubstr("462/770")));
  EXPECT_EQ(terminal.raw.find("\033[2J", before), std::string::npos);
  // Another size: drawn anew, and nothing wider.
  terminal.resize(60, 14);
  ASSERT_TRUE(
      terminal.until([&] { return terminal.raw.find("\033[2J", before) != std::string::npos; }));
  ASSERT_TRUE(
      terminal.until([&] { return terminal.screen().find("q quit") != std::string::npos; }));
  std::istringstream lines(terminal.screen());
  int last = 0, row = 0;
  for (std::string line; std::getline(lines, line);) {
    ++row;
    EXPECT_LE(text::columns_of(line), 60) << line;
    if (!line.empty()) last = row;
  }
  EXPECT_EQ(last, 14);
  terminal.type("q");
  EXPECT_EQ(terminal.end(), 0);
  EXPECT_FALSE(terminal.second_screen);
  EXPECT_TRUE(terminal.cursor);
}

TEST(Live, GivesTheTerminalBackOnCtrlCAndSignals) {
  Farm farm;
  fill(farm);
  for (const bool key : {true, false}) {
    Terminal terminal({kSlicefarm, "watch", "--dir", farm.root, "--interval-s", "0.1"}, 80, 24);
    ASSERT_TRUE(
        terminal.until([&] { return terminal.screen().find("q quit") != std::string::npos; }));
    if (key) {
      terminal.type("\003");
    } else {
      ::kill(terminal.child(), SIGTERM);
    }
    EXPECT_EQ(terminal.end(), 130);
    EXPECT_FALSE(terminal.second_screen);
    EXPECT_TRUE(terminal.cursor);
  }
}

TEST(Live, LinesWithoutATerminal) {
  Farm farm;
  farm.submit({farm.job("one")});
  const Claim claim = farm.claim();
  RunOptions options;
  bool finished = false;
  // The job ends only after the program has begun to tell.
  options.signal = SIGCONT;
  options.signal_when = [&](const std::string& out, const std::string&) {
    if (!finished && out.find("1 running") != std::string::npos) {
      farm.finish(claim, 3, test::figures_with(4));
      finished = true;
    }
    return false;
  };
  const auto result = run_program(
      {kSlicefarm, "watch", "--dir", farm.root, "--until-empty", "--interval-s", "0.05"}, options);
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("one  done  770 layers in 3.0 s"));
  EXPECT_EQ(result.out.find('\033'), std::string::npos);
}

// --- the page of the morning --------------------------------------------------------------------

TEST(Morning, FiguresAreThoseOfTheTime) {
  const std::int64_t start = system_clock().wall_ms() - 10 * 3600'000;
  Farm farm(start);
  // Before the time: not counted.
  farm.submit({farm.job("early")});
  farm.finish(farm.claim(), 100, test::figures_with(5));
  farm.clock.pass(1000);
  MorningOptions options;
  options.from_ms = farm.clock.wall_ms();
  // Two workers side by side for 100 s at 0.95 cores each, then one alone for 50 s.
  farm.submit({farm.job("a"), farm.job("b"), farm.job("c")});
  const Claim a = farm.claim(), b = farm.claim();
  farm.clock.pass(99);
  for (const Claim& claim : {a, b}) {
    farm.finish(claim, claim.token == a.token ? 1 : 0, test::figures_with(7));
  }
  const Claim c = farm.claim();
  farm.give_up(c, 50, Reason::bad_input, "no triangles in it", "one\ntwo\n");
  options.until_ms = farm.clock.wall_ms() + 50'000;
  auto model = farm.model();
  const MorningReport r = read_morning(farm.folder, model, options, farm.clock);
  EXPECT_EQ(r.done, 2);
  EXPECT_EQ(r.failed, 1);
  EXPECT_EQ(r.attempts, 3);
  EXPECT_EQ(r.cores, 2);
  EXPECT_DOUBLE_EQ(r.working_s, 150);
  // cpu_s of the record: 0.95 of 1 s and of 0 s (not measured: one core for its 100 s), 0.5 of 50
  // s.
  EXPECT_NEAR(r.core_s, 0.95 + 100 + 25, 1e-6);
  ASSERT_EQ(r.failures.size(), 1U);
  EXPECT_EQ(r.failures[0].log_lines, (std::vector<std::string>{"one", "two"}));
  ASSERT_EQ(r.lanes.size(), 2U);
  ASSERT_EQ(r.bars.size(), 3U);
  // Slots hold the same sums.
  double done = 0, core_s = 0;
  for (const auto& slot : r.slots) {
    done += slot.done;
    core_s += slot.cores_busy *
              static_cast<double>(std::min(r.slot_ms, r.until_ms - slot.from_ms)) / 1000;
  }
  EXPECT_EQ(done, 2);
  EXPECT_NEAR(core_s, r.core_s, 1e-6);
  EXPECT_EQ(r.delivered_bytes, 2 * (5000 + 49 + 3));
  EXPECT_THROW(read_morning(farm.folder, model, {.from_ms = 2000, .until_ms = 1000}, farm.clock),
               InputError);
}

TEST(Morning, AYoungFarmBeginsWithItsFirstEvent) {
  const std::int64_t start = system_clock().wall_ms() - 3600'000;
  Farm farm(start);
  farm.set("max-attempts", "2");
  farm.submit({farm.job("a"), farm.job("b")});
  farm.finish(farm.claim(), 600, test::figures_with(5));
  // Both tries of the other crash, without a word of where they ran.
  for (int i = 0; i < 2; ++i) {
    farm.clock.pass(60);
    const Claim claim = farm.claim();
    farm.clock.pass(300);
    AttemptEnd end;
    end.reason = Reason::worker_crashed;
    ASSERT_EQ(farm.queue.give_up(claim.token, end), i == 0 ? JobState::queued : JobState::failed);
  }
  auto model = farm.model();
  MorningReport r = read_morning(farm.folder, model, {}, farm.clock);
  EXPECT_LE(r.from_ms, start);
  EXPECT_GT(r.from_ms, start - 60'000);
  // They ran where their service did; the last try is the job's failure.
  EXPECT_THAT(r.lanes,
              ::testing::UnorderedElementsAre("night-owl", farm.model().services()[0].host));
  std::multiset<MorningReport::BarKind> kinds;
  for (const auto& bar : r.bars) kinds.insert(bar.kind);
  using Kind = MorningReport::BarKind;
  EXPECT_EQ(kinds, (std::multiset<Kind>{Kind::done, Kind::again, Kind::failed}));
  EXPECT_DOUBLE_EQ(r.working_s, 1200);
  EXPECT_DOUBLE_EQ(json::parse(morning_json(r))["jobs_per_h"], 3.0);
  EXPECT_EQ(r.cores, 2);
  // An old farm's report is a day long.
  farm.clock.pass(3 * 86'400.0);
  r = read_morning(farm.folder, model, {}, farm.clock);
  EXPECT_EQ(r.until_ms - r.from_ms, 86'400'000);
}

TEST(Morning, ManyJobsAnHourAreANumber) {
  MorningReport r;
  r.done = 432;
  r.working_s = 360;
  EXPECT_THAT(morning_page(r, LinkTo{LinkTo::Kind::files, ""}),
              HasSubstr("<b>4,320</b><span>jobs an hour"));
}

TEST(Morning, LanesNeverOverlapAndHoldEveryAttempt) {
  Farm farm;
  // Many short ones are drawn as few bars; their number is kept.
  std::vector<NewJob> jobs;
  for (int i = 0; i < 120; ++i) jobs.push_back(farm.job(fmt::format("small-{}", i)));
  farm.submit(jobs);
  const std::int64_t from = farm.clock.wall_ms() - 1;
  for (int i = 0; i < 40; ++i) {
    const Claim a = farm.claim(), b = farm.claim(), c = farm.claim();
    farm.finish(a, 1, test::figures_with(1));
    farm.finish(c, 2, test::figures_with(1));
    farm.finish(b, 3, test::figures_with(1));
  }
  auto model = farm.model();
  const MorningReport r = read_morning(farm.folder, model, {.from_ms = from}, farm.clock);
  EXPECT_EQ(r.lanes.size(), 3U);
  std::int64_t attempts = 0;
  for (std::size_t i = 0; i < r.bars.size(); ++i) {
    attempts += r.bars[i].jobs;
    if (i > 0 && r.bars[i].lane == r.bars[i - 1].lane) {
      EXPECT_GE(r.bars[i].start_ms, r.bars[i - 1].end_ms);
    }
  }
  EXPECT_EQ(attempts, 120);
  // The same in a much longer time: merged.
  const MorningReport day =
      read_morning(farm.folder, model, {.from_ms = from - 20 * 86'400'000LL}, farm.clock);
  EXPECT_LT(day.bars.size(), 10U);
  attempts = 0;
  for (const auto& bar : day.bars) attempts += bar.jobs;
  EXPECT_EQ(attempts, 120);
}

TEST(Morning, PageShowsEverythingAndRunsNothing) {
  Farm farm;
  const Filled f = fill(farm);
  auto model = farm.model();
  const MorningReport r = read_morning(farm.folder, model, {}, farm.clock);
  const std::string html = morning_page(r, {LinkTo::Kind::files, farm.root});
  for (const Reason reason : test::kFinalReasons) {
    EXPECT_THAT(html, HasSubstr(fmt::format("<code>{}</code>", name_of(reason))));
    EXPECT_THAT(html, HasSubstr(fmt::format("last line of fails-{}", name_of(reason))));
  }
  // No scripts, nothing from elsewhere; what users wrote is text.
  EXPECT_EQ(html.find("<script"), html.npos);
  EXPECT_EQ(html.find("<img"), html.npos);
  EXPECT_EQ(html.find("onerror=alert(1)>"), html.npos);
  EXPECT_THAT(html, HasSubstr("&lt;img src=x"));
  const std::regex link("(src|href)=\"([^\"]*)\"");
  for (std::sregex_iterator it(html.begin(), html.end(), link), end; it != end; ++it) {
    EXPECT_EQ((*it)[2].str().rfind("./results/", 0), 0U) << (*it)[2];
  }
  // Links lead to files that are there.
  EXPECT_THAT(html, HasSubstr(fmt::format("<a href=\"./results/{}/gyroid-5.html\">gyroid-5</a>",
                                          f.done[5])));
  EXPECT_TRUE(fs::exists(fmt::format("{}/results/{}/gyroid-5.html", farm.root, f.done[5])));
  // The worst come first.
  EXPECT_LT(html.find("999 um"), html.find("53 um"));
  EXPECT_LT(html.find("53 um"), html.find("43 um"));
  // Markup that browsers need not mend.
  for (const char* tag :
       {"table", "tbody", "details", "figure", "svg", "ol", "pre", "main", "div"}) {
    const auto times = [&](const std::string& what) {
      std::size_t n = 0;
      for (std::size_t at = 0; (at = html.find(what, at)) != html.npos; at += what.size()) ++n;
      return n;
    };
    const std::string name = tag;
    EXPECT_EQ(times("<" + name + ">") + times("<" + name + " "), times("</" + name + ">")) << tag;
  }
  const json j = json::parse(morning_json(r));
  EXPECT_EQ(j["failed_reasons"].size(), std::size(test::kFinalReasons));
  EXPECT_EQ(j["failures"].size(), 11U);
  EXPECT_EQ(j["failures"][0]["log_tail"].size(), 3U);
  EXPECT_EQ(j["worst"][0]["id"], f.nasty);
}

TEST(Status, TomographicPrintsHaveFiguresOfTheirOwn) {
  Farm farm;
  const auto done = [&](const std::string& name, const TomoFigures& figures) {
    NewJob j = farm.job(name);
    j.work.kind = "tomo";
    j.priority = 1000;
    const JobId id = farm.queue.submit({j}, "anna", "test").at(0);
    ClaimRequest request;
    request.service = farm.service;
    request.engine = "local";
    request.free_memory_mb = 1000;
    const auto c = farm.queue.claim(request);
    EXPECT_EQ(c->job.id, id);
    EXPECT_TRUE(farm.queue.begin_commit(c->token));
    ResultRecord r;
    r.figures.layers = 40;
    r.figures.tomo = figures;
    r.files = {{"frames", 5, "aa"}, {"json", 7, "cc"}};
    EXPECT_TRUE(farm.queue.finish(c->token, r, {}, false));
    return id;
  };
  const double none = std::numeric_limits<double>::infinity();
  const JobId good = done("good", {1.52, 1.9, 0, 17, 244.8, true});
  const JobId best = done("best", {none, none, 0, 3, 43.2, true});
  const JobId foggy = done("foggy", {0.875, none, 0.0125, 5, 72, false});
  auto model = farm.model();
  const StatusPage page = read_status(model, farm.folder, {}, farm.clock);
  const std::string text = status_text(page, farm.folder, 0);
  EXPECT_THAT(text, HasSubstr("contrast 1.52, VER 0, prints in 4 min 05 s"));
  EXPECT_THAT(text, HasSubstr("contrast without bound, VER 0, prints in 43 s"));
  EXPECT_THAT(text, HasSubstr("contrast 0.875, VER 0.0125, prints in 1 min 12 s; misses: void gels "
                              "before the part does"));
  EXPECT_EQ(text.find("height"), text.npos);
  const json j = json::parse(job_json(*model.job(best)));
  EXPECT_TRUE(j["figures"]["contrast"].is_null());
  EXPECT_EQ(j["figures"]["print_time_s"], 43.2);

  // In the morning: a table of their own, the least contrast first, and no heights.
  const MorningReport r = read_morning(farm.folder, model, {}, farm.clock);
  EXPECT_TRUE(r.worst.empty());
  ASSERT_EQ(r.tomographic.size(), 3U);
  EXPECT_EQ(r.tomographic[0].id, foggy);
  EXPECT_EQ(r.tomographic[1].id, good);
  const std::string html = morning_page(r, {LinkTo::Kind::files, farm.root});
  EXPECT_THAT(html, HasSubstr("Tomographic prints, least contrast first"));
  EXPECT_THAT(html, HasSubstr("<td class=\"bad\">0.875</td>"));
  EXPECT_EQ(html.find("Height errors"), html.npos);
  EXPECT_EQ(html.find("href"), html.npos) << "there is no report of theirs";
  EXPECT_EQ(json::parse(morning_json(r))["tomographic"][0]["name"], "foggy");
}

TEST(Morning, AnEmptyFarmHasAPageToo) {
  Farm farm;
  auto model = farm.model();
  const std::string html = morning_page(read_morning(farm.folder, model, {}, farm.clock), {});
  EXPECT_THAT(html, HasSubstr("no worker ran in this time"));
  EXPECT_THAT(html, Not(HasSubstr("jobs an hour</text>")));  // no axes without data
  EXPECT_EQ(html.find("nan"), html.npos);
  EXPECT_EQ(html.find("inf "), html.npos);
}

TEST(Morning, Program) {
  Farm farm;
  fill(farm);
  auto result = run_program({kSlicefarm, "report", "--dir", farm.root});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_TRUE(fs::exists(farm.root + "/report.html"));
  result = run_program({kSlicefarm, "report", "--dir", farm.root, "--json", "-", "--since", "2d"});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(json::parse(result.out)["done"], 8);
  result = run_program({kSlicefarm, "report", "--dir", farm.root, "--since", "soon"});
  EXPECT_EQ(result.exit_code, 2);
  EXPECT_THAT(result.err, HasSubstr("--since is 'soon', expected"));
}

// --- metrics ------------------------------------------------------------------------------------

TEST(Metrics, FormatAndValues) {
  Farm farm;
  fill(farm);
  auto model = farm.model();
  const std::string text = metrics_text(model, farm.folder, farm.clock);
  check_metrics(text);
  EXPECT_THAT(text, HasSubstr("slicefarm_jobs{state=\"failed\"} 11\n"));
  EXPECT_THAT(text, HasSubstr("slicefarm_jobs{state=\"queued\"} 4\n"));
  EXPECT_THAT(text, HasSubstr("slicefarm_jobs_following 1\n"));
  EXPECT_THAT(text, HasSubstr("slicefarm_jobs_failed{reason=\"hung\"} 1\n"));
  EXPECT_THAT(text, HasSubstr("slicefarm_attempts_total{engine=\"local\",reason=\"ok\"} 7\n"));
  EXPECT_THAT(text,
              HasSubstr("slicefarm_attempts_total{engine=\"local\",reason=\"worker_killed\"} 2\n"));
  EXPECT_THAT(text, HasSubstr("slicefarm_services 1\n"));
  EXPECT_THAT(text, HasSubstr("slicefarm_paused 0\n"));
  EXPECT_TRUE(slicecorr::test::promtool_agrees(text));
}

TEST(Metrics, AnEmptyFarm) {
  Farm farm;
  farm.queue.stop_service(farm.service);
  auto model = farm.model();
  check_metrics(metrics_text(model, farm.folder, farm.clock));
}

}  // namespace
}  // namespace slicecorr::farm
