// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// `slicecorr flow --in-time` as people run it.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "ladder.hpp"
#include "lattice.hpp"
#include "meshes.hpp"
#include "run_program.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;
using testing::HasSubstr;

class FlowInTimeProgram : public ::testing::Test {
 protected:
  FlowInTimeProgram() {
    options_.folder = folder_.path();
    options_.environment = {
        {"SLICECORR_DB", ""}, {"HOME", folder_.path()}, {"XDG_CONFIG_HOME", ""}};
    std::ofstream(folder_ / "printer.toml")
        << "name = \"vat\"\n[display]\nwidth_px = 60\nheight_px = 60\npixel_um = 50\n"
           "[blue]\ncalibration = [[0, 0.0], [255, 200.0]]\n"
           "[uv]\nkind = \"flood\"\ncalibration = [[0, 0.0], [255, 275.0]]\n"
           "[stage]\nmax_speed_mm_h = 5000\n";
    // Resin 1 of the dissertation's table 4.1, areal.
    std::ofstream(folder_ / "resin.toml")
        << "name = \"r1\"\nviscosity_pa_s = 0.3\ndose_diffusion_m2_s = 1e-10\n"
           "[cure]\nmodel = \"jacobs\"\nabsorbance_height_um = 600\nabsorbance_base = \"e\"\n"
           "critical_dose_mj_cm3 = 1500\n"
           "[inhibition]\nbeta = 0.9096\nabsorbance_height_um = 50\nabsorbance_base = \"e\"\n";
    TriangleMesh mesh;
    add_strut(mesh, {0, 0, 0}, {0, 0, 1.2}, 1, 96);
    write_stl(folder_ / "disc.stl", mesh);
  }
  RunResult call(const Command& arguments) const {
    return run_program(Command{SLICECORR_BIN_DIR "/slicecorr", "flow"} + arguments, options_);
  }
  const Command kHow{"--printer", "printer.toml", "--resin", "resin.toml",    "--speed-mm-h",
                     "300",       "--uv-mw-cm2",  "130",     "--blue-mw-cm2", "100"};
  const Command kDisc = Command{"--in-time", "--disc-radius-mm", "1"} + kHow;
  TemporaryFolder folder_;
  RunOptions options_;
};

TEST_F(FlowInTimeProgram, TheBaseCaseOfChapterIvPrints) {
  const RunResult r =
      call(kDisc + Command{"--json", "j.json", "--profile", "p.csv", "-o", "d.html"});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  EXPECT_THAT(r.out, HasSubstr("prints; from slice"));
  EXPECT_THAT(r.out, HasSubstr("window: taken as rigid"));
  const json j = json::parse(std::ifstream(folder_ / "j.json"));
  EXPECT_TRUE(j["prints"].get<bool>());
  EXPECT_TRUE(j["sticks"].is_null());
  ASSERT_EQ(j["slices"].size(), 60U);
  const json& last = j["slices"].back();
  EXPECT_NEAR(last["dead_zone_um"]["middle"].get<double>(), 60, 0.7 * 12.5);
  EXPECT_NEAR(last["dead_zone_um"]["min"].get<double>(), 50, 0.7 * 12.5);
  EXPECT_EQ(last["along"]["gap_um"].size(), 40U);
  std::ifstream csv(folder_ / "p.csv");
  std::string line;
  int lines = 0;
  while (std::getline(csv, line)) ++lines;
  EXPECT_EQ(lines, 61);
  std::stringstream page;
  page << std::ifstream(folder_ / "d.html").rdbuf();
  EXPECT_THAT(page.str(), HasSubstr("front over the window"));
}

TEST_F(FlowInTimeProgram, WithoutTimeItSaysTheSameWhereThePrintIs) {
  const Command part{"disc.stl", "--layer-um", "50"};
  const RunResult steady = call(part + kHow + Command{"--every", "24", "--json", "s.json"});
  ASSERT_EQ(steady.exit_code, 0) << steady.err;
  EXPECT_THAT(steady.err, testing::Not(HasSubstr("sticks")));
  EXPECT_THAT(steady.out, HasSubstr("taken as steady"));
  const json s = json::parse(std::ifstream(folder_ / "s.json"))["slices"][0];
  EXPECT_TRUE(s["dead_zone_at_rest"].get<bool>());
  // 50 um in time; cells of 150 um, the gap, against rings of 25 um: 10 um.
  EXPECT_NEAR(s["dead_zone_um"]["min"].get<double>(), 50, 10);
  EXPECT_LT(s["window_dose_at_rest"].get<double>(), 0.7);
  // And the part in time, on cells.
  const RunResult r =
      call(Command{"--in-time"} + part + kHow + Command{"--pitch-um", "100", "--json", "t.json"});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  const json t = json::parse(std::ifstream(folder_ / "t.json"));
  EXPECT_TRUE(t["prints"].get<bool>());
  EXPECT_EQ(t["slices"].size(), 24U);
  EXPECT_NEAR(t["slices"].back()["dead_zone_um"]["min"].get<double>(), 50, 10);
}

TEST_F(FlowInTimeProgram, WhatSticksIsToldWithPlaceAndTime) {
  Command bright = kDisc;
  *(std::find(bright.begin(), bright.end(), "--blue-mw-cm2") + 1) = "118.2";
  const RunResult r = call(bright);
  EXPECT_EQ(r.exit_code, 0) << r.err;
  EXPECT_THAT(r.out, HasSubstr("sticks to the window in slice"));
}

TEST_F(FlowInTimeProgram, SuctionBeyondWhatThereCanBeIsToldAndIsNoPrint) {
  const Command few = kDisc + Command{"--slices", "20"};
  ASSERT_EQ(call(few + Command{"--json", "all.json"}).exit_code, 0);
  const json all = json::parse(std::ifstream(folder_ / "all.json"));
  EXPECT_EQ(all["limit_pa"], 1e5);
  EXPECT_FALSE(all["limit_given"].get<bool>());
  EXPECT_TRUE(all["beyond_limit"].is_null());
  EXPECT_TRUE(all["prints"].get<bool>());
  // A limit between two slices' suction: the first slice above it is told.
  const auto suction = [&all](std::size_t n) {
    return all["slices"][n]["suction_pa"].get<double>();
  };
  std::size_t most = 0;
  for (std::size_t n = 0; n < 20; ++n) most = suction(n) > suction(most) ? n : most;
  const double limit = 0.97 * suction(most);
  std::size_t first = 0;
  while (suction(first) <= limit) ++first;
  std::stringstream printer;
  printer << std::ifstream(folder_ / "printer.toml").rdbuf();
  // Before the first table.
  std::ofstream(folder_ / "printer.toml")
      << fmt::format("suction_limit_pa = {:.6f}\n", limit) << printer.str();
  const RunResult r = call(few + Command{"--json", "limit.json"});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  EXPECT_THAT(r.out, HasSubstr("more than the printer's limit of"));
  EXPECT_THAT(r.out, HasSubstr(fmt::format(" Pa in slice {}, ", first)));
  const json told = json::parse(std::ifstream(folder_ / "limit.json"));
  EXPECT_FALSE(told["prints"].get<bool>());
  EXPECT_TRUE(told["sticks"].is_null());
  EXPECT_EQ(told["beyond_limit"]["slice"], first);
  EXPECT_EQ(told["beyond_limit"]["suction_pa"], all["slices"][first]["suction_pa"]);
  EXPECT_EQ(told["slices"], all["slices"]);
}

TEST_F(FlowInTimeProgram, AWindowOfThePrintersFileIsTold) {
  {
    std::ofstream file(folder_ / "printer.toml", std::ios::app);
    file << "[window]\nfilm_n_m = 300\nfilm_radius_mm = 50\n";
  }
  const Command few = kDisc + Command{"--slices", "12"};
  const RunResult r = call(few + Command{"--json", "w.json"});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  EXPECT_THAT(r.out, HasSubstr("a film of 300 N/m, free over a radius of 50 mm"));
  const json w = json::parse(std::ifstream(folder_ / "w.json"));
  for (const json& s : w["slices"]) {
    // Beside the disc the film hangs by its force, F ln(Rs/R)/(2 pi T), however suction is spread; within it
    // it is domed by less than the greatest suction everywhere would, s R²/(4 T).
    const double rim_um = s["force_n"].get<double>() / (2 * M_PI * 300) * std::log(50.0) * 1e6;
    EXPECT_NEAR(s["window"]["rim_um"].get<double>(), rim_um, 1e-3 * rim_um);
    const double dome_um =
        s["window"]["middle_um"].get<double>() - s["window"]["rim_um"].get<double>();
    EXPECT_GT(dome_um, 0);
    EXPECT_LT(dome_um, s["suction_pa"].get<double>() * 1e-6 / (4 * 300) * 1e6);
    EXPECT_GT(s["window"]["change_s"].get<double>(), 0);
  }
  // Fronts follow the window: they are those over a rigid one, which options can't say, but another film.
  const RunResult other =
      call(few + Command{"--film-n-m", "600", "--film-radius-mm", "50", "--json", "o.json"});
  ASSERT_EQ(other.exit_code, 0) << other.err;
  const json o = json::parse(std::ifstream(folder_ / "o.json"));
  for (std::size_t n = 0; n < 12; ++n) {
    EXPECT_EQ(o["slices"][n]["dead_zone_um"], w["slices"][n]["dead_zone_um"]);
    EXPECT_NEAR(o["slices"][n]["window"]["middle_um"].get<double>(),
                0.5 * w["slices"][n]["window"]["middle_um"].get<double>(), 1e-6);
  }
  // The same key counts without time.
  const RunResult steady = call(Command{"disc.stl", "--layer-um", "50", "--every", "24"} + kHow);
  ASSERT_EQ(steady.exit_code, 0) << steady.err;
  EXPECT_THAT(steady.out, HasSubstr("window: a film of 300 N/m"));
  const RunResult strip = call(Command{"--in-time", "--strip-half-width-mm", "1", "--film-n-m",
                                       "300", "--film-radius-mm", "50"} +
                               kHow);
  EXPECT_EQ(strip.exit_code, 2);
  for (const char* bad : {"film_n_m = 300", "film_n_m = 300\nfilm_radius_mm = 50\num_per_kpa = 1",
                          "rubber_mm = 2", "film_n_m = -1\nfilm_radius_mm = 50", "arms = 2\n"}) {
    std::ofstream(folder_ / "bad.toml")
        << "name = \"vat\"\n[display]\nwidth_px = 60\nheight_px = 60\npixel_um = 50\n"
           "[blue]\ncalibration = [[0, 0.0], [255, 200.0]]\n[window]\n"
        << bad << "\n";
    const RunResult refused =
        run_program({SLICECORR_BIN_DIR "/slicecorr", "flow", "disc.stl", "--layer-um", "50",
                     "--printer", "bad.toml", "--resin", "resin.toml", "--speed-mm-h", "300"},
                    options_);
    EXPECT_EQ(refused.exit_code, 2) << bad;
    EXPECT_THAT(refused.err, HasSubstr("window")) << bad;
  }
}

TEST_F(FlowInTimeProgram, RefusesWhatDoesNotGoWithIt) {
  const auto bad = [&](const Command& arguments, const char* word) {
    const RunResult r = call(arguments);
    EXPECT_EQ(r.exit_code, 2) << r.err;
    EXPECT_THAT(r.err, HasSubstr(word));
  };
  bad(kDisc + Command{"--gap-um", "80"}, "--gap-um");
  bad(kDisc + Command{"--every", "2"}, "--every");
  bad(kDisc + Command{"--platform-mm", "50,50"}, "--platform-mm");
  bad(kDisc + Command{"--strip-half-width-mm", "1"}, "expected one of PART");
  bad(kDisc + Command{"-o", "x.png"}, ".svg or .html");
  bad(Command{"disc.stl", "--layer-um", "50", "--slices", "3"} + kHow, "--slices");
  bad(kHow, "PART");
  Command dark = kDisc;
  dark.erase(std::find(dark.begin(), dark.end(), "--uv-mw-cm2"),
             std::find(dark.begin(), dark.end(), "--uv-mw-cm2") + 2);
  bad(dark, "--uv-mw-cm2");
}

}  // namespace
}  // namespace slicecorr::test
