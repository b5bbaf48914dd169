// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Tomographic prints through the farm's programs: the bytes that `slicecorr tomo solve` writes,
// figures, ends of all kinds.

#include "farm_tomo.hpp"

#include <gmock/gmock.h>

#include <chrono>
#include <nlohmann/json.hpp>

#include "slicecorr/farm/service.hpp"

namespace slicecorr::farm {
namespace {

using namespace slicecorr::test;
using nlohmann::json;
using testing::HasSubstr;
using testing::IsEmpty;

class FarmTomo : public FarmTomography {
 protected:
  void SetUp() override {
    FarmTomography::SetUp();
    quick_settings();
    fs::create_directories(dir / "reference");
  }
  Job job(JobId id) { return *ReadModel(database()).job(id); }
  std::vector<Attempt> attempts(JobId id) { return ReadModel(database()).attempts(id); }
  RunResult submit_tomo(std::vector<std::string> what, const std::vector<std::string>& more = {}) {
    const auto options = tomo_options();
    what.insert(what.end(), options.begin(), options.end());
    what.insert(what.end(), {"--mode", "tomography"});
    what.insert(what.end(), more.begin(), more.end());
    return farm("submit", what);
  }
  /// `tomo_options` after what is solved.
  std::vector<std::string> solved(std::vector<std::string> what) const {
    const auto options = tomo_options();
    what.insert(what.end(), options.begin(), options.end());
    return what;
  }
};

TEST_F(FarmTomo, ResultsAreThoseOfSlicecorrBesideAnOrdinaryJob) {
  make_part(1);
  make_part(2);
  make_volume("bars.npy", 10);
  write_file(dir / "core.stl", stl_of({{1, 1.5F, 0.2F, 0.7F, 0, 0.5F}}));
  const std::string jobs = R"([defaults]
printer = "vial.toml"
resin = "gel.toml"
mode = "tomography"
voxel_mm = 0.25
method = "osmo"
iterations = 3
out = "out"

[[job]]
part = "bridge-1.stl"
insert = "core.stl"

[[job]]
part = "bars.npy"
angles = 90

[[job]]
part = "bridge-2.stl"
mode = "continuous"
printer = "small.toml"
resin = "clear.toml"
layer_um = 50
speed_mm_h = 700
)";
  write_file(dir / "jobs.toml", jobs);
  ASSERT_EQ(farm("submit", {dir / "jobs.toml"}).exit_code, 0);
  const RunResult r = run_all();
  ASSERT_EQ(r.exit_code, 0) << r.err;
  tomo_reference(dir / "reference/bridge-1",
                 solved({dir / "bridge-1.stl", "--insert", dir / "core.stl"}));
  tomo_reference(dir / "reference/bars", solved({"--volume", dir / "bars.npy", "--angles", "90"}));
  expect_same_print(dir / "out/bridge-1", dir / "reference/bridge-1");
  expect_same_print(dir / "out/bars", dir / "reference/bars");
  expect_same_files(dir / "out/bridge-2", reference(dir / "bridge-2.stl"));
  EXPECT_THAT(leftovers(dir / "out"), IsEmpty());

  const json told = json::parse(farm("status", {"--json", "-"}).out)["list"];
  // The record has the figures of the JSON beside, and what it took fits what was promised.
  for (JobId id = 1; id <= 2; ++id) {
    const Job j = job(id);
    const json figures = json::parse(text_of_file(j.output("json")));
    ASSERT_TRUE(j.figures && j.figures->tomo);
    EXPECT_EQ(j.figures->tomo->contrast, figures["contrast"].get<double>());
    EXPECT_EQ(j.figures->tomo->ver, figures["ver"].get<double>());
    EXPECT_EQ(j.figures->tomo->turns, figures["turns"].get<int>());
    EXPECT_EQ(j.figures->tomo->print_time_s, figures["print_time_s"].get<double>());
    EXPECT_EQ(j.figures->tomo->feasible, figures["feasible"].get<bool>());
    // Sanitizers take memory of their own.
    if (!SLICECORR_SANITIZED) {
      EXPECT_LE(attempts(id).at(0).peak_mb, attempts(id)[0].memory_mb);
    }
    for (const json& one : told) {
      if (one["id"] != id) continue;
      EXPECT_EQ(one["figures"]["contrast"], figures["contrast"]);
      EXPECT_FALSE(one["figures"].contains("height_error_um"));
    }
  }
  EXPECT_FALSE(job(3).figures->tomo);
  EXPECT_THAT(farm("status").out, HasSubstr("contrast "));

  // The same again: from the cache, at once.
  write_file(dir / "again.toml", jobs + "name = \"again\"\n");
  fs::remove_all(dir / "out");
  const RunResult again = farm("submit", {dir / "again.toml"});
  EXPECT_THAT(again.err, HasSubstr("3 of them done from the cache"));
  expect_same_print(dir / "out/bridge-1", dir / "reference/bridge-1");
  expect_same_print(dir / "out/bars", dir / "reference/bars");
}

TEST_F(FarmTomo, InfeasibleFailsAndMissedIsDoneAndToldSo) {
  // Light of a resin this dark does not reach the axis: no pattern prints a bar there alone.
  std::string dark = kVialResinToml;
  dark.replace(dark.find("absorption_per_cm = 2.0"), 23, "absorption_per_cm = 30.0");
  write_file(dir / "dark.toml", dark);
  tomo::Box<std::uint8_t> bar{1, 9, 9, std::vector<std::uint8_t>(81, 0)};
  for (int y = 3; y < 6; ++y) {
    for (int x = 3; x < 6; ++x) bar.values[bar.at(0, y, x)] = 255;
  }
  tomo::write_npy(dir / "bar.npy", bar);
  std::vector<std::string> hopeless = {
      dir / "bar.npy", "--printer", dir / "vial.toml", "--resin", dir / "dark.toml", "--voxel-mm",
      "0.25",          "--mode",    "tomography",      "--out",   dir / "out"};
  ASSERT_EQ(farm("submit", hopeless).exit_code, 0);
  // Back projection alone leaves a fog between single voxels, where it is dim on the axis.
  std::string dim = kVialResinToml;
  dim.replace(dim.find("absorption_per_cm = 2.0"), 23, "absorption_per_cm = 8.0");
  write_file(dir / "dim.toml", dim);
  tomo::Box<std::uint8_t> board{3, 13, 13, {}};
  for (int z = 0; z < 3; ++z) {
    for (int y = 0; y < 13; ++y) {
      for (int x = 0; x < 13; ++x) board.values.push_back((x + y) % 2 == 0 ? 255 : 0);
    }
  }
  const std::string volume = dir / "board.npy";
  tomo::write_npy(volume, board);
  std::vector<std::string> rough = {volume,    "--printer",      dir / "vial.toml",
                                    "--resin", dir / "dim.toml", "--voxel-mm",
                                    "0.25",    "--method",       "fbp"};
  std::vector<std::string> rough_job = rough;
  rough_job.insert(rough_job.end(), {"--mode", "tomography", "--out", dir / "out"});
  ASSERT_EQ(farm("submit", rough_job).exit_code, 0);
  EXPECT_EQ(run_all().exit_code, 5) << "a job failed";

  EXPECT_EQ(job(1).state, JobState::failed);
  EXPECT_EQ(job(1).reason, Reason::infeasible);
  EXPECT_EQ(attempts(1).at(0).exit_code, 3);
  EXPECT_EQ(attempts(1).size(), 1U) << "is not tried again";
  EXPECT_THAT(job(1).message, HasSubstr("no light prints this part"));
  EXPECT_FALSE(fs::exists(dir / "out/bar.frames"));

  rough.front() = "--volume";
  rough.insert(rough.begin() + 1, volume);
  EXPECT_EQ(tomo_reference(dir / "reference/board", rough), 5);
  EXPECT_EQ(job(2).state, JobState::done);
  EXPECT_EQ(attempts(2).at(0).exit_code, 5);
  expect_same_print(dir / "out/board", dir / "reference/board");
  EXPECT_FALSE(job(2).figures->tomo->feasible);
  EXPECT_THAT(farm("status").out, HasSubstr("misses: void gels before the part does"));
}

TEST_F(FarmTomo, AKilledWorkerIsTriedAgainToTheSameBytes) {
  const std::string part = make_volume("bars.npy", 1);
  tomo_reference(dir / "reference/bars", solved({"--volume", part, "--angles", "60"}));
  for (const char* fault : {"solve:kill:1", "judge:crash:1", "check:exit=1:1"}) {
    SCOPED_TRACE(fault);
    // A new farm each time: nothing is in its cache.
    fs::remove_all(farm_dir());
    fs::remove_all(dir / "out");
    quick_settings();
    ASSERT_EQ(submit_tomo({part}, {"--angles", "60", "--out", dir / "out"}).exit_code, 0);
    const RunResult r = run_all({{"SLICEFARM_TEST_FAULT", fault}});
    ASSERT_EQ(r.exit_code, 0) << r.err;
    EXPECT_EQ(attempts(1).size(), 2U);
    expect_same_print(dir / "out/bars", dir / "reference/bars");
  }
}

TEST_F(FarmTomo, ASolveIsSeenAndCancelledWithinTwoSeconds) {
  // A solve of a minute or so.
  const std::string volume = make_volume("long.npy", 20);
  ASSERT_EQ(farm("submit", {volume, "--mode", "tomography", "--printer", dir / "vial.toml",
                            "--resin", dir / "gel.toml", "--voxel-mm", "0.125", "--angles", "800",
                            "--iterations", "2000", "--method", "osmo", "--out", dir / "out"})
                .exit_code,
            0);
  RunningService service(farm_dir());
  ASSERT_TRUE(comes([&] {
    const auto tries = attempts(1);
    return !tries.empty() && tries[0].stage == "solve" && tries[0].fraction > 0.01;
  }));
  EXPECT_THAT(farm("status").out, HasSubstr("solve "));
  const auto begin = std::chrono::steady_clock::now();
  ASSERT_EQ(farm("cancel", {"1"}).exit_code, 0);
  ASSERT_TRUE(comes([&] { return job(1).state == JobState::cancelled; }));
  const double seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  RecordProperty("cancelled_ms", static_cast<int>(1000 * seconds));
  EXPECT_LT(seconds, 2 + 3) << "two, and what a busy machine adds";
  EXPECT_EQ(service.end(SIGTERM), 130);
  EXPECT_FALSE(fs::exists(dir / "out/long.frames"));
}

}  // namespace
}  // namespace slicecorr::farm
