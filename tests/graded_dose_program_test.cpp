// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Wanted doses through the real program: regions, stacks of doses, what is told, what is refused.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <sstream>

#include "ladder.hpp"
#include "run_program.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;
using testing::HasSubstr;

/// The ladder, and its left half as a region of its own.
class GradedDoseProgram : public ::testing::Test {
 protected:
  GradedDoseProgram() {
    options_.folder = folder_.path();
    options_.environment = {
        {"SLICECORR_DB", SLICECORR_DB_DIR}, {"HOME", folder_.path()}, {"XDG_CONFIG_HOME", ""}};
    write_stl(folder_ / "ladder.stl", ladder());
    TriangleMesh left, foot;
    add_box(left, {-2, -1, 0}, {0, 1, 2.5});
    add_box(foot, {-2, -1, -0.3}, {2, 1, 0.5});
    write_stl(folder_ / "left.stl", left);
    write_stl(folder_ / "foot.stl", foot);
    write_file(folder_ / "small.toml", printer("blue"));
  }
  static std::vector<std::uint8_t> printer(const std::string& more) {
    return to_bytes(
        "name = \"small\"\n[display]\nwidth_px = 160\nheight_px = 120\npixel_um = 50.0\n"
        "[blue]\ncalibration = [[0, 1.0], [255, 100.0]]\n" +
        (more == "blue" ? std::string() : more + "\n"));
  }
  RunResult call(int code, const Command& arguments) const {
    Command all = arguments;
    all.insert(all.begin(), SLICECORR_BIN_DIR "/slicecorr");
    RunResult r = run_program(all, options_);
    EXPECT_EQ(r.exit_code, code) << testing::PrintToString(all) << r.err;
    return r;
  }
  static Command joined(Command a, const Command& b) {
    a.insert(a.end(), b.begin(), b.end());
    return a;
  }
  Command how(const std::string& printer = "small.toml") const {
    return {"--printer", printer, "--resin", "figure-2-2", "--speed-mm-h", "1000"};
  }
  RunResult run(const std::string& out, const Command& more, int code = 0) const {
    return call(code,
                joined(joined({"run", "ladder.stl", "-o", out, "--layer-um", "50"}, how()), more));
  }
  RunResult correct(const std::string& out, const Command& more, int code = 0) const {
    return call(code, joined(joined({"correct", "target.uvj", "-o", out}, how()), more));
  }
  void slice(const std::string& part, const std::string& out, const Command& more = {}) const {
    call(0,
         joined({"slice", part, "-o", out, "--layer-um", "50", "--printer", "small.toml"}, more));
  }
  std::vector<std::uint8_t> bytes(const std::string& file) const {
    return read_file(folder_ / file);
  }
  json figures(const std::string& file) const { return json::parse(text(file)); }
  std::string text(const std::string& file) const {
    const auto all = bytes(file);
    return {all.begin(), all.end()};
  }
  TemporaryFolder folder_;
  RunOptions options_;
};

TEST_F(GradedDoseProgram, RegionsGetTheirDoses) {
  const RunResult r = run("out.uvj", {"--region", "left.stl=2"});
  EXPECT_THAT(r.err, HasSubstr("left.stl"));
  const json j = figures("out.json");
  EXPECT_EQ(j["undercure_voxels"], 0);
  EXPECT_EQ(j["cure_through_voxels"], 0);
  EXPECT_LT(j["height_error_um"]["max_abs"].get<double>(), 1.0);
  ASSERT_EQ(j["regions"].size(), 2U);
  const json &outside = j["regions"][0], &left = j["regions"][1];
  EXPECT_EQ(outside["name"], "outside of all regions");
  EXPECT_EQ(left["name"], "left.stl");
  // Half of the ladder: a rail of 20 x 40 pixels and 50 layers, half of two rungs of 20 layers.
  EXPECT_EQ(left["voxels"], 20 * 40 * 50 + 20 * 40 * 20);
  EXPECT_EQ(outside["voxels"], left["voxels"]);
  EXPECT_EQ(left["wanted"]["min"], 2);
  EXPECT_NEAR(left["dose"]["max"].get<double>(), 2, 0.01);
  EXPECT_GE(left["dose"]["min"].get<double>(), 1);
  EXPECT_LT(outside["dose"]["max"].get<double>(), 1.1);
  EXPECT_FALSE(j["uncorrected"].contains("regions"));
  // The rail gets it from the platform to a few slices before its end.
  std::istringstream rows(call(0, {"probe", "out.uvj", "--x", "50", "--y", "60"}).out);
  std::string row;
  std::getline(rows, row);
  for (int n = 0; n < 40 && std::getline(rows, row); ++n) {
    EXPECT_NEAR(std::stod(row.substr(row.rfind(',') + 1)), 2, 0.002) << row;
  }
  const std::string page = text("out.html");
  EXPECT_THAT(page, HasSubstr("Doses wanted, and those that print"));
  EXPECT_THAT(page, HasSubstr("The doses that are wanted"));
}

TEST_F(GradedDoseProgram, LayerByLayerLayersHoldAndHaveTheirDoses) {
  const std::string resin =
      "name = \"plain\"\n[cure]\nabsorbance_height_um = 150\nabsorbance_base = 10\n"
      "gel_dose_mj_cm2 = 10\n";
  write_file(folder_ / "plain.toml", {resin.begin(), resin.end()});
  const Command how{"--region",  "left.stl=9", "--layer-um",   "50",
                    "--printer", "small.toml", "--resin",      "plain.toml",
                    "--mode",    "layerwise",  "--exposure-s", "1.5"};
  call(0, joined({"run", "ladder.stl", "-o", "out.uvj"}, how));
  const json j = figures("out.json");
  EXPECT_EQ(j["undercure_voxels"], 0);
  EXPECT_EQ(j["joints"]["not_holding_voxels"], 0);
  ASSERT_EQ(j["regions"].size(), 2U);
  const json &outside = j["regions"][0], &left = j["regions"][1];
  EXPECT_EQ(left["wanted"]["min"], 9);
  // Elsewhere no layer gets more than what holds: 1.2 / (sqrt(a) (1 - a)), a the third root of 0.1.
  const double a = std::pow(0.1, 1.0 / 3), held = 1.2 / std::sqrt(a) / (1 - a);
  EXPECT_NEAR(outside["dose"]["max"].get<double>(), held, 0.05 * held);
  EXPECT_LT(left["dose"]["max"].get<double>(), 9.1);
  std::istringstream rows(call(0, {"probe", "out.uvj", "--x", "50", "--y", "60"}).out);
  std::string row;
  std::getline(rows, row);
  int close = 0;
  for (int n = 0; n < 40 && std::getline(rows, row); ++n) {
    // At nodes, from inside their layer: sqrt(a) of the middle's.
    close += std::abs(std::stod(row.substr(row.rfind(',') + 1)) / (9 * std::sqrt(a)) - 1) < 0.01;
  }
  EXPECT_GT(close, 35);
  EXPECT_THAT(call(3, joined({"run", "ladder.stl", "-o", "x.uvj"},
                             joined(how, {"--region", "left.stl=90"})))
                  .err,
              HasSubstr("expose for more than"));
}

TEST_F(GradedDoseProgram, LaterRegionsWin) {
  run("out.uvj", {"--region", "left.stl=2", "--region", "foot.stl=1.5"});
  const json regions = figures("out.json")["regions"];
  ASSERT_EQ(regions.size(), 3U);
  // The foot begins below the platform: its ten layers of both rails count.
  EXPECT_EQ(regions[2]["voxels"], 2 * 20 * 40 * 10);
  EXPECT_EQ(regions[1]["voxels"], 20 * 40 * 40 + 20 * 40 * 20);
  EXPECT_NEAR(regions[2]["dose"]["max"].get<double>(), 1.5, 0.6);
}

TEST_F(GradedDoseProgram, AStackSaysTheSame) {
  slice("ladder.stl", "target.uvj");
  slice("left.stl", "left.uvj", {"--center-mm", "3,3", "--antialias", "off"});
  correct("region.uvj", {"--region", "left.stl=2", "--design", "ladder.stl"});
  correct("stack.uvj", {"--dose-target", "left.uvj", "--dose-target-max", "2"});
  EXPECT_EQ(bytes("region.uvj"), bytes("stack.uvj"));
  // A region takes one word: what follows is the stack.
  call(0, joined({"correct", "--design", "ladder.stl", "--region", "left.stl=2", "target.uvj", "-o",
                  "before.uvj"},
                 how()));
  EXPECT_EQ(bytes("region.uvj"), bytes("before.uvj"));
  // On the plate without the design: the region's own place is taken.
  TriangleMesh placed;
  add_box(placed, {2, 2, 0}, {4, 4, 2.5});
  write_stl(folder_ / "placed.stl", placed);
  correct("placed.uvj", {"--region", "placed.stl=2"});
  EXPECT_EQ(bytes("region.uvj"), bytes("placed.uvj"));
  // verify tells of the doses what correct did, where it is told them.
  const Command verify{"verify", "region.uvj", "--target", "target.uvj", "--json", "-", "--quiet"};
  const json told = json::parse(call(0, joined(verify, {"--region", "placed.stl=2"})).out);
  run("run.uvj", {"--region", "left.stl=2"});
  json made = figures("run.json")["regions"];
  made[1]["name"] = "placed.stl";
  EXPECT_EQ(told["regions"], made);
  EXPECT_FALSE(json::parse(call(0, verify).out).contains("regions"));
  // And so it is by any number of threads.
  correct("one.uvj", {"--region", "placed.stl=2", "--threads", "1"});
  EXPECT_EQ(bytes("region.uvj"), bytes("one.uvj"));
}

TEST_F(GradedDoseProgram, NothingMoreThanOneIsTheOrdinaryCorrection) {
  slice("ladder.stl", "target.uvj");
  slice("left.stl", "left.uvj", {"--center-mm", "3,3"});
  correct("plain.uvj", {});
  correct("region.uvj", {"--region", "left.stl=1", "--design", "ladder.stl"});
  correct("stack.uvj", {"--dose-target", "left.uvj", "--dose-target-max", "1"});
  EXPECT_EQ(bytes("plain.uvj"), bytes("region.uvj"));
  EXPECT_EQ(bytes("plain.uvj"), bytes("stack.uvj"));
}

TEST_F(GradedDoseProgram, RefusesWhatDoesNotGo) {
  slice("ladder.stl", "target.uvj");
  slice("left.stl", "left.uvj", {"--center-mm", "3,3"});
  slice("foot.stl", "short.uvj");
  write_file(folder_ / "spread.toml", printer("spread = [[40.0, 1.0]]"));
  write_file(
      folder_ / "wide.toml",
      to_bytes("name = \"wide\"\n[display]\nwidth_px = 200\nheight_px = 120\npixel_um = 50.0\n"
               "[blue]\ncalibration = [[0, 1.0], [255, 100.0]]\n"));
  call(0, {"slice", "left.stl", "-o", "wide.uvj", "--layer-um", "50", "--printer", "wide.toml"});
  correct("corrected.uvj", {});
  const Command stack{"--dose-target", "left.uvj", "--dose-target-max", "2"};
  const Command region{"--region", "left.stl=2", "--design", "ladder.stl"};
  struct Case {
    Command more;
    const char* says;
  };
  const std::vector<Case> cases{
      {{"--region", "left.stl"}, "MESH=VALUE"},
      {{"--region", "=2"}, "MESH=VALUE"},
      {{"--region", "left.stl=two"}, "MESH=VALUE"},
      {{"--region", "left.stl=nan"}, "MESH=VALUE"},
      {{"--region", "left.stl=0.9"}, "1 or more"},
      {{"--region", "none.stl=2"}, "none.stl"},
      {joined(region, stack), "expected one of them"},
      {{"--dose-target", "left.uvj"}, "--dose-target-max"},
      {{"--dose-target", "left.uvj", "--dose-target-max", "0.5"}, "--dose-target-max"},
      {{"--dose-target-max", "2"}, "--dose-target or --region"},
      {{"--dose-side", "at-least"}, "--dose-target or --region"},
      {joined(region, {"--dose-side", "above"}), "--dose-side"},
      {{"--dose-target", "short.uvj", "--dose-target-max", "2"}, "images of"},
      {{"--dose-target", "wide.uvj", "--dose-target-max", "2"}, "images of"},
      {{"--dose-target", "corrected.uvj", "--dose-target-max", "2"}, "corrected stack"},
      {{"--dose-target", "none.uvj", "--dose-target-max", "2"}, "none.uvj"},
  };
  for (const Case& c : cases) EXPECT_THAT(correct("out.uvj", c.more, 2).err, HasSubstr(c.says));
  const auto refused = [&](const Command& process, const char* says) {
    const Command all = joined({"correct", "target.uvj", "-o", "out.uvj", "--region", "left.stl=2",
                                "--design", "ladder.stl", "--resin", "figure-2-2"},
                               process);
    EXPECT_THAT(call(2, all).err, HasSubstr(says));
  };
  refused({"--printer", "small.toml", "--mode", "layerwise", "--exposure-s", "40",
           "--lift-exchange", "0.5"},
          "lifts exchange resin");
  // More than full light ever gives.
  const RunResult r = correct("out.uvj", {"--region", "left.stl=7", "--design", "ladder.stl"}, 3);
  EXPECT_THAT(r.err, HasSubstr("6.25"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "out.uvj"));
}

}  // namespace
}  // namespace slicecorr::test
