// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The page of a tomographic print: what it says is what the library computes.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "run_program.hpp"
#include "slicecorr/tomo/report.hpp"
#include "stack_fixture.hpp"
#include "tomo_jobs.hpp"

namespace slicecorr::tomo {
namespace {

using testing::HasSubstr;

/// A row of voxels along x with these doses; the gel dose is 20, the print takes 72 s.
Printed row(const std::vector<float>& doses, const std::vector<std::uint8_t>& part) {
  Printed p;
  p.job.printer = bench_printer();
  p.job.resin = bench_resin();
  p.job.sampling = {0.25, 1, 90};
  p.job.turns = 5;
  p.job.part = {1, 33, 33, std::vector<std::uint8_t>(33 * 33)};
  p.dose = {1, 33, 33, std::vector<float>(33 * 33)};
  for (std::size_t i = 0; i < doses.size(); ++i) {
    const std::size_t k = p.job.part.at(0, 16, 10 + static_cast<int>(i));
    p.job.part.values[k] = part[i];
    p.dose.values[k] = doses[i];
  }
  p.figures.gel_dose_mj_cm3 = 20;
  p.figures.print_time_s = 72;
  p.figures.turns = 5;
  return p;
}

TEST(TomoReport, VoxelsGelWhenTheirShareOfTheDoseIsIn) {
  // 20/80 and so on of the time; at the very end; 20/19.9 and 20/13.4 of it; never.
  const Printed p =
      row({80, 40, 30, 20, 19.9F, 13.4F, 13.3F, 0}, {255, 255, 128, 255, 255, 0, 0, 255});
  const GelTimes g = gel_times(p, 1);
  EXPECT_EQ(g.nx, 8);
  EXPECT_EQ(g.ny, 1);
  EXPECT_EQ(g.nz, 1);
  EXPECT_EQ(g.time, (std::vector<std::uint8_t>{25, 50, 67, 100, 101, 150, 0, 0}));
  const auto kind = [](Kept k) { return static_cast<std::uint8_t>(k); };
  EXPECT_EQ(g.kind, (std::vector<std::uint8_t>{
                        kind(Kept::part), kind(Kept::part), kind(Kept::neither), kind(Kept::part),
                        kind(Kept::part), kind(Kept::empty), kind(Kept::empty), kind(Kept::part)}));
}

TEST(TomoReport, CoarseCellsShowAWrongVoxelWhereThereIsOne) {
  Printed p = row({80, 80, 80, 80, 10, 80, 25, 0, 0}, {255, 255, 255, 255, 255, 255, 0, 0, 255});
  for (const int y : {17, 18}) {
    for (int x = 10; x < 19; ++x) {
      const std::size_t from = p.job.part.at(0, 16, x), to = p.job.part.at(0, y, x);
      p.job.part.values[to] = p.job.part.values[from];
      p.dose.values[to] = p.dose.values[from];
    }
  }
  const GelTimes g = gel_times(p, 3);
  EXPECT_EQ(g.nx, 3);
  EXPECT_EQ(g.cell_mm, 0.75);
  // All right; one missing; one gelled that should not.
  EXPECT_EQ(g.time[0], 25);
  EXPECT_EQ(g.time[1], 0);
  EXPECT_EQ(g.kind[1], static_cast<std::uint8_t>(Kept::part));
  EXPECT_EQ(g.time[2], 80);
  EXPECT_EQ(g.kind[2], static_cast<std::uint8_t>(Kept::empty));
}

TEST(TomoReport, InsertsAreShownAndNotJudged) {
  Printed p = row({80, 30, 15}, {255, 0, 0});
  p.job.insert = {1, 33, 33, std::vector<std::uint8_t>(33 * 33)};
  p.job.insert.values[p.job.insert.at(0, 16, 11)] = 1;
  const GelTimes g = gel_times(p, 1);
  EXPECT_EQ(g.kind[1], static_cast<std::uint8_t>(Kept::insert));
  EXPECT_EQ(g.time[1], 0);
  const auto slices = contrast_of_slices(p);
  ASSERT_EQ(slices.size(), 1U);
  EXPECT_EQ(slices[0].max_void, 15);
  EXPECT_EQ(slices[0].min_gel, 80);
  EXPECT_DOUBLE_EQ(slices[0].contrast, 80.0 / 15);
}

TEST(TomoReport, SlicesWithoutPartHaveNoContrast) {
  Printed p = row({80, 30, 15}, {0, 0, 0});
  const auto slices = contrast_of_slices(p);
  EXPECT_TRUE(std::isnan(slices[0].min_gel));
  EXPECT_TRUE(std::isnan(slices[0].contrast));
  EXPECT_EQ(slices[0].max_void, 80);
}

TEST(TomoReport, ThePageHasAllOfIt) {
  TomoJob job = random_job(dry_printer(), 5, 24);
  job.printer.name = "bench <b>";
  job.contrast_bound = 1.25;
  for (int i = 0; i < 40; ++i) {
    job.history.push_back({.rung = i < 20 ? 0.98 : 0.9,
                           .step = i % 20,
                           .loss = i == 19 ? 0 : std::exp(-i),
                           .contrast = 0.5 + 0.01 * i});
  }
  const Printed p = printed(job);
  const std::string html = report_page(p, "a & b");
  for (const char* words :
       {"a &amp; b", "bench &lt;b&gt;", "Bound of C", "VER", "Dose against target",
        "Doses of part and void", "Contrast over the height", "Sinogram", "frame 21, 315.0°",
        "How the solve went", "loss", "What has gelled when", "not as designed"}) {
    EXPECT_THAT(html, HasSubstr(words));
  }
  EXPECT_EQ(html.find("http://"), html.find("http://www.w3.org/"));  // names of formats alone
  EXPECT_EQ(html.find("https://"), std::string::npos);
  EXPECT_EQ(report_page(p, "a & b"), html);
  job.history.clear();
  EXPECT_THAT(report_page(printed(job), "x"), HasSubstr("does not say how its light was found"));
}

TEST(TomoReport, DarkJobsHaveAPageToo) {
  TomoJob job = random_job(bench_printer(), 1, 24);
  std::fill(job.levels.begin(), job.levels.end(), std::uint16_t{0});
  EXPECT_THAT(report_page(printed(job), "dark"), HasSubstr("not as designed"));
}

class TomoReportProgram : public ::testing::Test {
 protected:
  std::string path(const std::string& name) const { return folder_ / name; }
  test::RunResult call(std::vector<std::string> words) const {
    test::RunOptions options;
    options.folder = folder_.path();
    words.insert(words.begin(), {SLICECORR_BIN_DIR "/slicecorr", "tomo", "report"});
    return test::run_program(words, options);
  }
  test::TemporaryFolder folder_;
};

TEST_F(TomoReportProgram, WritesThePageOrSaysWhyNot) {
  write_job(path("a.frames"), random_job(bench_printer(), 3, 24));
  ASSERT_EQ(call({"a.frames", "-o", "a.html"}).exit_code, 0);
  ASSERT_EQ(call({"a.frames", "-o", "b.html", "--threads", "1"}).exit_code, 0);
  EXPECT_EQ(test::read_file(path("a.html")), test::read_file(path("b.html")));
  EXPECT_THAT(call({"a.frames", "-o", "a.pdf"}).err, HasSubstr(".html"));
  EXPECT_EQ(call({"none.frames", "-o", "c.html"}).exit_code, 2);
  EXPECT_EQ(call({"a.frames", "-o", "none/c.html"}).exit_code, 4);
}

}  // namespace
}  // namespace slicecorr::tomo
