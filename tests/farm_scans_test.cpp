// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Scans of a farm's prints, through the programs: measured, kept, charted, and the next print corrected by them.
#include "farm_scans.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "slicecorr/error.hpp"

namespace slicecorr::test {
namespace {

using farm::KeptScan;
using farm::PrintsOverTime;
using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

TEST_F(FarmScans, AScanIsMeasuredAsByTheProgramAndKept) {
  print_and_scan();
  const RunResult r = farm("scan", {"1", dir / "printed.ply"});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  EXPECT_THAT(r.out, HasSubstr("kept as scan 1 of job 1: off by "));
  ASSERT_EQ(kept().size(), 1U);
  const KeptScan s = kept()[0];
  EXPECT_EQ(s.file, "printed.ply");
  EXPECT_EQ(s.user, "anna");
  EXPECT_EQ(s.unit, "mm");
  EXPECT_EQ(s.resin, "believed");
  EXPECT_TRUE(s.with_design);
  const std::string at = farm_dir() + "/scans/" + s.folder;
  EXPECT_EQ(text_of_file(at + "/file/printed.ply"), text_of_file(dir / "printed.ply"));
  // The same figures as by the program, with the design as it was sliced.
  const RunResult direct =
      program("slicecorr", {"scan", "compare", dir / "printed.ply", "--stack", stack(1), "--design",
                            dir / "hook.stl", "--json", "-"});
  ASSERT_EQ(direct.exit_code, 0) << direct.err;
  const json here = json::parse(text_of_file(at + "/comparison.json")),
             there = json::parse(direct.out);
  EXPECT_EQ(here["deviations"], there["deviations"]);
  EXPECT_EQ(s.mean_abs_um, there["deviations"][1]["mean_abs_um"]);
  EXPECT_EQ(s.worst_um, there["deviations"][1]["max_abs_um"]);
  // Who reads it knows names, not folders of the farm.
  EXPECT_THAT(text_of_file(at + "/comparison.json"), Not(HasSubstr(dir.path())));
  EXPECT_THAT(text_of_file(at + "/comparison.html"),
              AllOf(HasSubstr("RoundView"), Not(HasSubstr(dir.path()))));

  KeptScan again = s;
  again.folder = "of-the-test";
  EXPECT_EQ(farm::Queue(database()).add_scan(again), 2);
  const json all = json::parse(farm("scans", {"--json", "-"}).out)["prints"];
  ASSERT_EQ(all.size(), 1U);
  EXPECT_EQ(all[0]["scans"][1]["number"], 2);
  EXPECT_TRUE(all[0]["drift"].is_null());
  EXPECT_THAT(farm("scans", {"--html", dir / "d.html"}).err, HasSubstr("3 or more"));
  EXPECT_TRUE(farm::Queue(database()).knows_scan(s.folder));
  ASSERT_EQ(farm("scans", {"--job", "1", "--remove", "1"}).exit_code, 0);
  EXPECT_FALSE(fs::exists(at));
  EXPECT_FALSE(farm::Queue(database()).knows_scan(s.folder));
  ASSERT_EQ(kept().size(), 1U);
  EXPECT_EQ(kept()[0].number, 2);
  EXPECT_EQ(farm("scans", {"--job", "1", "--remove", "1"}).exit_code, 2);
  // What was left of a scan that nobody knows goes after a day.
  const std::string folders = farm_dir() + "/scans/";
  for (const char* name : {"of-the-test", "stray", "new"}) fs::create_directory(folders + name);
  for (const char* name : {"of-the-test", "stray"}) {
    fs::last_write_time(folders + name, fs::file_time_type::clock::now() - std::chrono::hours(25));
  }
  ASSERT_EQ(farm("gc").exit_code, 0);
  EXPECT_TRUE(fs::exists(folders + "of-the-test"));
  EXPECT_FALSE(fs::exists(folders + "stray"));
  EXPECT_TRUE(fs::exists(folders + "new"));
}

/// Refused in words that have all of these, and nothing is left of it.
class FarmScansRefused : public FarmScans {
 protected:
  void refused(int code, const std::vector<std::string>& arguments,
               const std::vector<std::string>& words) const {
    const RunResult r = farm("scan", arguments);
    EXPECT_EQ(r.exit_code, code) << r.err;
    for (const std::string& word : words) EXPECT_THAT(r.err, HasSubstr(word));
    EXPECT_TRUE(kept().empty());
    EXPECT_TRUE(!fs::exists(farm_dir() + "/scans") || fs::is_empty(farm_dir() + "/scans"));
  }
};

TEST_F(FarmScansRefused, WhatIsNoScanOfThatPrintIsRefused) {
  refused(2, {"1", dir / "hook.stl"}, {"job 1 is queued, expected one that is done"});
  print_and_scan();
  write_stl(dir / "ball.stl", sphere(1.9, 4));
  // With what is left between it and the part.
  refused(2, {"1", dir / "ball.stl"}, {"ball.stl", "another part", "um"});
  refused(2, {"7", dir / "ball.stl"}, {"7: no such job"});
  write_file(dir / "empty.ply", "");
  refused(2, {"1", dir / "empty.ply"}, {"empty.ply"});
  refused(2, {"1", dir.path()}, {"is actually a directory"});
  refused(2, {"1", dir / "printed.ply", "--unit", "m"}, {"another part"});
  fs::resize_file(stack(1), 100);
  refused(2, {"1", dir / "printed.ply"}, {"moved or changed"});
  const RunResult next = farm("next", {"1"});
  EXPECT_EQ(next.exit_code, 2);
  EXPECT_THAT(next.err, HasSubstr("has no scan"));
}

TEST_F(FarmScans, TheNextPrintIsRight) {
  print_and_scan();
  ASSERT_EQ(farm("scan", {"1", dir / "printed.ply"}).exit_code, 0);
  const RunResult r = farm("next", {"1", "--out", dir.path()});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  EXPECT_THAT(r.out, AllOf(HasSubstr("absorbance height"), HasSubstr("job 2 is queued")));
  EXPECT_TRUE(fs::exists(dir / "believed-job-1.toml"));
  ASSERT_EQ(run_all().exit_code, 0);
  farm::ReadModel model(database());
  const auto second = model.job(2);
  EXPECT_EQ(second->name, "hook-next");
  EXPECT_EQ(second->resin, "believed-job-1");
  EXPECT_EQ(second->parts, model.job(1)->parts);
  const auto next = model.next_of(2);
  ASSERT_TRUE(next);
  EXPECT_EQ(next->of, 1);
  EXPECT_FALSE(model.next_of(1));
  // Judged by what is true, which nobody told the farm.
  ASSERT_EQ(program("slicecorr", {"slice", dir / "hook.stl", "-o", dir / "target.uvj", "--layer-um",
                                  "50", "--printer", dir / "small.toml"})
                .exit_code,
            0);
  const double first = off(stack(1));
  EXPECT_GT(first, 3);
  EXPECT_LT(off(stack(2)), 0.25 * first) << r.out;
  // What was expected of both is what they are, to what is left of the first.
  EXPECT_NEAR(next->before_mean_um, first, 0.25 * first);
  EXPECT_LT(second->figures->height_mean_um, 0.25 * first);
}

/// A record with scans of so many means, all of one job.
std::vector<PrintsOverTime> prints_of(const FarmFolderOfTest& dir,
                                      const std::vector<double>& means) {
  const std::string path = dir / "farm.sqlite";
  fs::remove(path);
  farm::Queue queue(path);
  const farm::JobId job = queue.submit({job_with_key("k")}, "anna", "test").at(0);
  for (const double mean : means) {
    KeptScan s;
    s.job = job;
    s.folder = std::to_string(mean);
    s.file = "scan.ply";
    s.mean_um = mean;
    s.mean_abs_um = 5;
    EXPECT_GT(queue.add_scan(s), 0);
  }
  farm::ReadModel model(path);
  return farm::prints_over_time(model);
}

TEST(PrintsOverTime, WhatLiesBeyondIsToldOfTheLastPrintOnly) {
  const FarmFolderOfTest dir;
  // Eight settled prints of +-1: middle 0, ranges of 2, sd 2 sqrt(pi) / 2: 3 of them are 5.317 um.
  std::vector<double> means = {1, -1, 1, -1, 1, -1, 1, -1};
  EXPECT_EQ(farm::beyond_in_words(prints_of(dir, means)[0]), "");
  means.push_back(5.31);
  EXPECT_EQ(farm::beyond_in_words(prints_of(dir, means)[0]), "");
  means.back() = 5.32;
  const std::vector<PrintsOverTime> all = prints_of(dir, means);
  EXPECT_THAT(farm::beyond_in_words(all[0]),
              AllOf(HasSubstr("job 1 part, scan 9 on printer with resin lies beyond its band"),
                    HasSubstr("mean deviation +5.32 um, expected -5.32 to +5.32 um"),
                    Not(HasSubstr("absolute"))));
  EXPECT_EQ(json::parse(farm::prints_over_time_json(all))["prints"][0]["drift"]["settled"], 8);
  // Seven before it are too few to be sure; a print that comes back is within again.
  EXPECT_EQ(farm::beyond_in_words(prints_of(dir, {1, -1, 1, -1, 1, -1, 1, 50})[0]), "");
  means.push_back(0);
  EXPECT_EQ(farm::beyond_in_words(prints_of(dir, means)[0]), "");
  EXPECT_FALSE(prints_of(dir, {1, 2})[0].drift);
}

TEST(PrintsOverTime, InputsOfJobsWithScansStay) {
  const FarmFolderOfTest dir;
  TestClock clock;
  farm::Queue queue(dir / "farm.sqlite", clock);
  farm::NewJob j = job_with_key("k");
  j.work.input_files = {"part.stl"};
  const farm::JobId job = queue.submit({j}, "anna", "test", {{"part.stl", 5}}).at(0);
  const auto claim = queue.claim(any_job(queue.start_service("local", 1, 1000)));
  ASSERT_TRUE(queue.begin_commit(claim->token));
  ASSERT_TRUE(queue.finish(claim->token, some_result(), ended(farm::Reason::none), false));
  clock.wall += std::int64_t{2} * 24 * 3600 * 1000;
  EXPECT_EQ(queue.unneeded_inputs(), std::vector<std::string>{"part.stl"});
  KeptScan s;
  s.job = job;
  queue.add_scan(s);
  EXPECT_TRUE(queue.unneeded_inputs().empty());
  queue.remove_scan(job, 1, "anna");
  EXPECT_EQ(queue.unneeded_inputs(), std::vector<std::string>{"part.stl"});
}

TEST(PrintsOverTime, AJobHasABoundedNumberOfScans) {
  const FarmFolderOfTest dir;
  farm::Queue queue(dir / "farm.sqlite");
  KeptScan s;
  s.job = queue.submit({job_with_key("k")}, "anna", "test").at(0);
  for (int i = 1; i <= farm::kMostScansOfJob; ++i) EXPECT_EQ(queue.add_scan(s), i);
  EXPECT_THROW(queue.add_scan(s), InputError);
  EXPECT_TRUE(queue.remove_scan(s.job, 3, "anna"));
  EXPECT_FALSE(queue.remove_scan(s.job, 3, "anna"));
  EXPECT_EQ(queue.add_scan(s), farm::kMostScansOfJob + 1);
}

}  // namespace
}  // namespace slicecorr::test
