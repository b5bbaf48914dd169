// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What was wrong with the inputs of a night is in the report of the morning, and does not keep the
// others from being done.

#include <gmock/gmock.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "farm_fixture.hpp"
#include "ladder.hpp"
#include "slicecorr/farm/morning.hpp"
#include "slicecorr/farm/notify.hpp"

namespace slicecorr::farm {
namespace {

using namespace slicecorr::test;
using nlohmann::json;
using testing::HasSubstr;
using testing::Not;

class FarmNightInputs : public FarmPrograms {
 protected:
  void SetUp() override {
    FarmPrograms::SetUp();
    quick_settings();
  }
  Job job(JobId id) { return *ReadModel(database()).job(id); }
  RunResult submit(std::vector<std::string> arguments, const std::vector<std::string>& more) {
    const auto process = process_options();
    arguments.insert(arguments.end(), process.begin(), process.end());
    arguments.insert(arguments.end(), more.begin(), more.end());
    return farm("submit", arguments);
  }
  /// A part without its last triangles.
  std::string open_part(int triangles_away) {
    const std::string path = dir / "open.stl";
    std::string stl = text_of_file(make_part(3));
    std::uint32_t count = 0;
    std::memcpy(&count, stl.data() + 80, 4);
    count -= static_cast<std::uint32_t>(triangles_away);
    std::memcpy(stl.data() + 80, &count, 4);
    stl.resize(84 + std::size_t{50} * count);
    write_file(path, stl);
    return path;
  }
};

TEST_F(FarmNightInputs, OpenEdgesAreInTheReportOfTheMorning) {
  const std::string open = open_part(1), sound = make_part(5);
  submit_parts({open, sound}, {"--out", dir / "out"});
  ASSERT_EQ(run_all().exit_code, 0);
  EXPECT_EQ(job(1).state, JobState::done);
  // In the user's name for the file, with what slicecorr says of it.
  EXPECT_THAT(job(1).message, HasSubstr(open + ": 3 open edges"));
  EXPECT_EQ(job(2).message, "");
  // The same work from the cache knows it, too.
  submit_parts({open}, {"--out", dir / "again"});
  EXPECT_EQ(job(3).state, JobState::done);
  EXPECT_TRUE(job(3).from_cache);
  EXPECT_EQ(job(3).message, job(1).message);

  const RunResult report = farm("report", {"-o", dir / "m.html", "--json", dir / "m.json"});
  ASSERT_EQ(report.exit_code, 0) << report.err;
  const std::string html = text_of_file(dir / "m.html");
  EXPECT_THAT(html, HasSubstr("<b>2</b><span>done, but with a warning</span>"));
  EXPECT_THAT(html, HasSubstr(" But open.stl: 3 open edges"));
  EXPECT_THAT(farm("status", {}).out, HasSubstr("; open.stl: 3 open edges"));
  EXPECT_THAT(html, HasSubstr("All 3 jobs that ended"));
  EXPECT_THAT(html, Not(HasSubstr("<script")));
  const json figures = json::parse(text_of_file(dir / "m.json"));
  EXPECT_EQ(figures["with_defects"], 2);
  ASSERT_EQ(figures["jobs"].size(), 3U);
}

TEST_F(FarmNightInputs, ABodyThatHangsOnNothingIsAWarningEverywhere) {
  const std::string floating = dir / "floating.stl";
  TriangleMesh mesh;
  add_box(mesh, {0, 0, 0}, {3, 3, 1});
  add_box(mesh, {1, 1, 3}, {2, 2, 4});
  write_stl(floating, mesh);
  submit_parts({floating}, {"--out", dir / "out"});
  ASSERT_EQ(run_all().exit_code, 0);
  const std::string told = "1 body hangs on nothing when it begins: from 3000 um on";
  EXPECT_EQ(job(1).state, JobState::done);
  EXPECT_THAT(job(1).message, HasSubstr(told));
  EXPECT_THAT(farm("status", {}).out, HasSubstr("; " + told));
  // Pages show the list's message.
  const json all = json::parse(farm("status", {"--json", "-"}).out);
  EXPECT_THAT(all["list"][0]["message"].get<std::string>(), HasSubstr(told));
  ASSERT_EQ(farm("report", {"-o", dir / "m.html"}).exit_code, 0);
  const std::string html = text_of_file(dir / "m.html");
  EXPECT_THAT(html, HasSubstr("<b>1</b><span>done, but with a warning</span>"));
  EXPECT_THAT(html, HasSubstr(" But " + told));
  ReadModel model(database());
  std::vector<json> batches;
  for (const Notice& n : notices_since(model, "farm", 0).list) {
    if (n.kind == "batch_done") batches.push_back(json::parse(n.json));
  }
  ASSERT_EQ(batches.size(), 1U);
  EXPECT_THAT(
      batches[0]["text"].get<std::string>(),
      AllOf(HasSubstr("1 done, 0 failed, 0 cancelled; 0 to look at before printing, 1 that will "
                      "not hold"),
            HasSubstr("; 1 done with a warning: job 1 floating: ")));
  EXPECT_EQ(batches[0]["with_warnings"], 1);
  EXPECT_EQ(batches[0]["warnings"][0]["job"], 1);
  EXPECT_THAT(batches[0]["warnings"][0]["message"].get<std::string>(), HasSubstr(told));
}

TEST_F(FarmNightInputs, CancelledJobsAreInTheTableAndACancellationThatIsTooLateSaysSo) {
  submit_parts({make_part(1), make_part(2)}, {"--out", dir / "out"});
  ASSERT_EQ(farm("cancel", {"2"}).exit_code, 0);
  ASSERT_EQ(run_all().exit_code, 0);
  const RunResult late = farm("cancel", {"1", "2"});
  EXPECT_EQ(late.exit_code, 0);
  EXPECT_THAT(late.err, HasSubstr("job 1: is done already; nothing was cancelled"));
  EXPECT_THAT(late.err, HasSubstr("job 2: was cancelled already; nothing was cancelled"));
  ASSERT_EQ(farm("report", {"-o", dir / "m.html"}).exit_code, 0);
  EXPECT_THAT(text_of_file(dir / "m.html"), HasSubstr("<b class=\"bad\">cancelled</b>"));
}

TEST_F(FarmNightInputs, BadJobsAreSkippedWhenAskedFor) {
  const std::string sound = make_part(1), broken = dir / "broken.stl";
  write_file(broken, "no mesh at all");
  const std::vector<std::string> all{broken, sound, dir / "absent.stl"};
  const RunResult refused = submit(all, {"--out", dir / "out"});
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_THAT(refused.err, HasSubstr("--skip-bad queues the 1 of 3 jobs that can be done"));
  EXPECT_FALSE(ReadModel(database()).job(1));
  const RunResult skipped = submit(all, {"--out", dir / "out", "--skip-bad"});
  ASSERT_EQ(skipped.exit_code, 0) << skipped.err;
  EXPECT_THAT(skipped.err, HasSubstr("skipped: "));
  EXPECT_THAT(skipped.err, HasSubstr("broken.stl"));
  EXPECT_THAT(skipped.err, HasSubstr("absent.stl"));
  EXPECT_THAT(skipped.err, HasSubstr("job 1 queued"));
  EXPECT_FALSE(ReadModel(database()).job(2));
  // With none left it is refused as ever.
  EXPECT_EQ(submit({broken}, {"--skip-bad"}).exit_code, 2);
}

TEST_F(FarmNightInputs, FitMmIsAScale) {
  const std::string part = make_part(1);
  submit_parts({part}, {"--fit-mm", "3", "--out", dir / "out"});
  ASSERT_EQ(run_all().exit_code, 0);
  const std::string name = fs::path(part).stem().string();
  const RunResult r = program("slicecorr", {"run", part, "-o", dir / "fitted.uvj", "--fit-mm", "3",
                                            "--layer-um", "50", "--printer", dir / "small.toml",
                                            "--resin", dir / "clear.toml", "--speed-mm-h", "700"});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  EXPECT_EQ(text_of_file(dir / ("out/" + name + ".uvj")), text_of_file(dir / "fitted.uvj"));
}

}  // namespace
}  // namespace slicecorr::farm
