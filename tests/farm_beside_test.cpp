// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What a service bureau finds beside its results in the morning: the designs by which they are measured, and
// what nobody measured as a warning.

#include <gmock/gmock.h>

#include "farm_fixture.hpp"

namespace slicecorr::farm {
namespace {

using namespace slicecorr::test;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

class FarmBeside : public FarmPrograms {
 protected:
  std::vector<std::string> endings(JobId id) const {
    std::vector<std::string> list;
    for (const ResultFile& f : job(id).files) list.push_back(f.ending);
    return list;
  }
  Job job(JobId id) const { return *ReadModel(database()).job(id); }
};

TEST_F(FarmBeside, ResultsAreMeasuredByTheirDesigns) {
  const std::string part = make_part(1), support = dir / "support.stl";
  // Under the middle of the bridge.
  write_file(support, stl_of({{1, 1.3F, 0.3F, 0.6F, 0, 1.05F}}));
  submit_parts({part}, {"--out", dir / "out", "--leave-alone", support});
  ASSERT_EQ(run_all().exit_code, 0);
  EXPECT_THAT(endings(1), ElementsAre("uvj", "html", "json", "-target.uvj", "-left-alone.uvj"));
  auto direct = process_options();
  direct.insert(direct.begin(),
                {"run", part, "-o", dir / "bridge-1.uvj", "--leave-alone", support});
  const RunResult alone = program("slicecorr", direct);
  ASSERT_EQ(alone.exit_code, 0) << alone.err;
  for (const char* ending : {".uvj", "-target.uvj", "-left-alone.uvj"}) {
    EXPECT_TRUE(text_of_file((dir / "out/bridge-1") + ending) ==
                text_of_file((dir / "bridge-1") + ending))
        << ending;
  }
  const RunResult verified = program("slicecorr", {"verify", dir / "out/bridge-1.uvj"});
  EXPECT_EQ(verified.exit_code, 0) << verified.err;
  EXPECT_THAT(farm("status", {"1"}).out,
              AllOf(HasSubstr((dir / "out/bridge-1-target.uvj") + "\n"),
                    HasSubstr((dir / "out/bridge-1-left-alone.uvj") + "\n")));
  // The next stack of this name leaves nothing alone, and comes with a design of its own; the same comes from
  // the cache as well.
  submit_parts({part}, {"--out", dir / "out"});
  ASSERT_EQ(run_all().exit_code, 0);
  EXPECT_THAT(endings(2), ElementsAre("uvj", "html", "json", "-target.uvj"));
  EXPECT_FALSE(fs::exists(dir / "out/bridge-1-left-alone.uvj"));
  EXPECT_EQ(program("slicecorr", {"verify", dir / "out/bridge-1.uvj"}).exit_code, 0);
  submit_parts({part}, {"--out", dir / "again"});
  EXPECT_TRUE(job(3).from_cache);
  EXPECT_TRUE(text_of_file(dir / "again/bridge-1-target.uvj") ==
              text_of_file(dir / "out/bridge-1-target.uvj"));
}

TEST_F(FarmBeside, WhatNobodyMeasuredIsAWarning) {
  const RunResult submitted =
      farm("submit", {make_part(1), "--printer", "elegoo-mars", "--resin",
                      "liqcreate-strong-x-405nm", "--assume", "typical", "--mode", "layerwise",
                      "--exposure-s", "8", "--layer-um", "50", "--out", dir / "out"});
  ASSERT_EQ(submitted.exit_code, 0) << submitted.err;
  ASSERT_EQ(run_all().exit_code, 0);
  const std::string grey = "printer 'elegoo-mars' is said to show no grey at all",
                    band = "resin 'liqcreate-strong-x-405nm' is from the database, not measured",
                    light = "assumed, not measured: grey levels of printer 'elegoo-mars'";
  const std::string log = farm("logs", {"1"}).out, status = farm("status", {}).out;
  for (const std::string& words : {grey, band, light}) {
    EXPECT_THAT(submitted.err, HasSubstr(words));
    EXPECT_THAT(job(1).message, HasSubstr(words));
    EXPECT_THAT(log, HasSubstr(words));
    EXPECT_THAT(status, HasSubstr(words));
  }
  ASSERT_EQ(farm("report", {"-o", dir / "m.html"}).exit_code, 0);
  EXPECT_THAT(text_of_file(dir / "m.html"),
              HasSubstr("<b>1</b><span>done, but with a warning</span>"));
}

}  // namespace
}  // namespace slicecorr::farm
