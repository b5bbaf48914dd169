// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// `slicecorr flow` and the suction that other programs refuse, as people run them.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

#include "ladder.hpp"
#include "lattice.hpp"
#include "meshes.hpp"
#include "real_files.hpp"
#include "rounds.hpp"
#include "run_program.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;
using testing::HasSubstr;

/// The command with other values of options, or more of them.
Command with(Command command, const Command& options) {
  for (std::size_t i = 0; i + 1 < options.size(); i += 2) {
    const auto at = std::find(command.begin(), command.end(), options[i]);
    if (at != command.end()) {
      at[1] = options[i + 1];
    } else {
      command = command + Command{options[i], options[i + 1]};
    }
  }
  return command;
}

/// A cylinder about the z axis, of so many sides.
TriangleMesh cylinder(double radius_mm, double height_mm, int sides) {
  TriangleMesh mesh;
  add_strut(mesh, {0, 0, 0}, {0, 0, height_mm}, radius_mm, sides);
  return mesh;
}

/// A box with a hole through all of it.
TriangleMesh tube(double outer_mm, double inner_mm, double height_mm) {
  TriangleMesh hole;
  add_strut(hole, {0, 0, -1}, {0, 0, height_mm + 1}, inner_mm, 96);
  // A hole is a body that faces inwards; its ends stick out, where nothing is to be taken away.
  for (Point3& v : hole.vertices) v[2] = std::clamp(v[2], 0.0, height_mm);
  TriangleMesh both = cylinder(outer_mm, height_mm, 96);
  append(both, inverted(hole));
  return both;
}

class FlowProgram : public ::testing::Test {
 protected:
  FlowProgram() {
    options_.folder = folder_.path();
    options_.timeout = std::chrono::minutes(3);
    options_.environment = {
        {"SLICECORR_DB", ""}, {"HOME", folder_.path()}, {"XDG_CONFIG_HOME", ""}};
    printer("printer.toml", "");
    // Resin 2 of the dissertation's table 4.1, areal.
    resin("resin.toml", "viscosity_pa_s = 0.3\ndose_diffusion_m2_s = 1e-10\n");
    write_stl(folder_ / "disc.stl", cylinder(10, 0.5, 360));
  }

  void printer(const std::string& name, const std::string& more) const {
    std::ofstream(folder_ / name)
        << "name = \"vat\"\n"
        << more
        << "[display]\nwidth_px = 500\nheight_px = 500\npixel_um = 50\n"
           "[blue]\ncalibration = [[0, 0.0], [255, 200.0]]\n"
           "[uv]\nkind = \"flood\"\ncalibration = [[0, 0.0], [255, 275.0]]\n"
           "[stage]\nmax_speed_mm_h = 5000\n";
  }
  void resin(const std::string& name, const std::string& more) const {
    std::ofstream(folder_ / name)
        << "name = \"r2\"\n"
        << more
        << "[cure]\nmodel = \"jacobs\"\nabsorbance_height_um = 408\nabsorbance_base = \"e\"\n"
           "critical_dose_mj_cm3 = 1600\n"
           "[inhibition]\nbeta = 0.799895\nabsorbance_height_um = 38\nabsorbance_base = \"e\"\n";
  }

  RunResult call(const Command& arguments) const {
    return run_program(Command{SLICECORR_BIN_DIR "/slicecorr"} + arguments, options_);
  }
  json flow(const Command& arguments) const {
    const RunResult r = call(Command{"flow"} + arguments + Command{"--json", "-", "--quiet"});
    EXPECT_EQ(r.exit_code, 0) << r.err;
    return r.exit_code == 0 ? json::parse(r.out) : json();
  }
  void bad(int code, const Command& arguments, const std::vector<std::string>& words) const {
    const RunResult r = call(arguments);
    EXPECT_EQ(r.exit_code, code) << ::testing::PrintToString(arguments) << r.err;
    for (const std::string& word : words) EXPECT_THAT(r.err, HasSubstr(word));
  }

  const Command kDisc{"disc.stl", "--layer-um", "50",           "--printer", "printer.toml",
                      "--resin",  "resin.toml", "--speed-mm-h", "300"};
  TemporaryFolder folder_;
  RunOptions options_;
};

TEST_F(FlowProgram, ADiscHasTheClosedForm) {
  printer("weak.toml", "suction_limit_pa = 20000\n");
  const json j = flow(with(kDisc, {"--gap-um", "80", "--printer", "weak.toml"}));
  ASSERT_EQ(j["slices"].size(), 10U);
  for (const json& s : j["slices"]) {
    // §8 of the flow's check values: disc of 10 mm at 0.2 bar; 1 % for 64 cells.
    EXPECT_NEAR(s["speed_limit_mm_h"].get<double>(), 409.6, 4.1);
    EXPECT_NEAR(s["suction_pa"].get<double>(), 14648, 146);
    EXPECT_NEAR(s["force_n"].get<double>(), 2.3010, 0.046);
    EXPECT_NEAR(s["x_mm"].get<double>(), 12.5, 0.3);
    EXPECT_NEAR(s["y_mm"].get<double>(), 12.5, 0.3);
    EXPECT_TRUE(s["dose"].is_null());
    EXPECT_TRUE(s["within_10_percent"].is_null());
    EXPECT_TRUE(s["dead_zone_um"].is_null());
  }
  EXPECT_EQ(j["masks"], 1);
  EXPECT_THAT(j["no_dose"].get<std::string>(), HasSubstr("UV"));
  EXPECT_EQ(j["gap_um"], 80);
  EXPECT_TRUE(j["limit_given"].get<bool>());
}

TEST_F(FlowProgram, UvLightBringsDoseAndDeadZone) {
  const json j = flow(with(
      kDisc, {"--gap-um", "80", "--uv-mw-cm2", "275", "--blue-mw-cm2", "164", "--every", "5"}));
  ASSERT_EQ(j["slices"].size(), 3U);
  const json& s = j["slices"][1];
  // Still resin of 80 um has 0.84065 of its dose, and so has the mean of every section.
  EXPECT_NEAR(s["dose"]["mean"].get<double>(), 0.84065, 0.02);
  // 1.380 is the most of the printed table (r 0.3).
  EXPECT_NEAR(s["dose"]["max"].get<double>(), 1.38, 0.05);
  EXPECT_GE(s["dose"]["min"].get<double>(), 0);
  // 16.5 to 22.5 % with the optimum for it, of the radius or of the area.
  EXPECT_GT(s["within_10_percent"].get<double>(), 0.05);
  EXPECT_LT(s["within_10_percent"].get<double>(), 0.4);
  EXPECT_LT(s["dead_zone_um"]["min"].get<double>(), s["dead_zone_um"]["max"].get<double>());
  // Without a gap it is that of the mean dose: where the mean is 1.
  const json even = flow(with(kDisc, {"--uv-mw-cm2", "275", "--blue-mw-cm2", "164"}));
  EXPECT_GT(even["gap_um"].get<double>(), 80);
  EXPECT_NEAR(even["slices"][3]["dose"]["mean"].get<double>(), 1, 0.02);
}

TEST_F(FlowProgram, StacksAreReadLikeMeshes) {
  ASSERT_EQ(call({"slice", "disc.stl", "-o", "disc.uvj", "--printer", "printer.toml", "--layer-um",
                  "50", "--quiet"})
                .exit_code,
            0);
  const json mesh = flow(kDisc);
  const json stack = flow(
      {"disc.uvj", "--printer", "printer.toml", "--resin", "resin.toml", "--speed-mm-h", "300"});
  ASSERT_EQ(mesh["slices"].size(), stack["slices"].size());
  // Cells begin where the part does, which a mesh knows finer than a stack: 1 % as for the disc.
  for (std::size_t i = 0; i < mesh["slices"].size(); ++i) {
    const double limit = mesh["slices"][i]["speed_limit_mm_h"];
    EXPECT_NEAR(limit, stack["slices"][i]["speed_limit_mm_h"].get<double>(), 0.01 * limit);
  }
  EXPECT_EQ(mesh["gap_um"], 80);  // assumed
}

TEST_F(FlowProgram, SameBytesForAnyNumberOfThreads) {
  const Command command =
      with(Command{"flow"} + kDisc,
           {"--uv-mw-cm2", "275", "--blue-mw-cm2", "164", "--pitch-um", "600", "--json", "-"});
  const RunResult one = call(command + Command{"--threads", "1"});
  const RunResult two = call(command + Command{"--threads", "2"});
  EXPECT_EQ(one.exit_code, 0) << one.err;
  EXPECT_EQ(one.out, two.out);
}

TEST_F(FlowProgram, BlindHolesAreNamed) {
  write_stl(folder_ / "tube.stl", tube(9, 3, 1));
  const Command tube{"tube.stl",     "--layer-um", "50",         "--printer",
                     "printer.toml", "--resin",    "resin.toml", "--speed-mm-h",
                     "300",          "--gap-um",   "80"};
  const json j = flow(tube);
  ASSERT_EQ(j["blind"].size(), 1U);
  const json& v = j["blind"][0];
  EXPECT_EQ(v["first_slice"], 0);
  EXPECT_EQ(v["last_slice"], 19);
  EXPECT_TRUE(v["from_platform"].get<bool>());
  // Cells of 300 um at a hole of 3 mm: a tenth.
  EXPECT_NEAR(v["volume_mm3"].get<double>(), M_PI * 9, 0.1 * M_PI * 9);
  EXPECT_NEAR(v["x_mm"].get<double>(), 12.5, 0.3);
  // §8: 10,547 Pa in the blind hole of a ring of 3..9 mm.
  EXPECT_NEAR(j["slices"][10]["suction_pa"].get<double>(), 10547, 0.04 * 10547);
  const RunResult r = call(Command{"flow"} + tube);
  EXPECT_THAT(r.err, HasSubstr("blind"));
  EXPECT_THAT(r.out, HasSubstr("from the platform on"));
}

TEST_F(FlowProgram, PicturesAndTables) {
  for (const std::string name : {"flow.svg", "flow.png", "flow.html"}) {
    const RunResult r =
        call(with(Command{"flow"} + kDisc,
                  {"-o", name, "--uv-mw-cm2", "275", "--blue-mw-cm2", "164", "--profile",
                   "speeds.csv", "--every", "4", "--pitch-um", "1000"}));
    ASSERT_EQ(r.exit_code, 0) << r.err;
    // The disc is one section, which is told once: what lies between the heads and what follows.
    EXPECT_THAT(r.out, HasSubstr("4 looked at, 1 section among them"));
    EXPECT_THAT(r.out, HasSubstr("window: taken as rigid"));
    const std::size_t heads = r.out.find("dead zone um\n"), after = r.out.find("slowest: slice");
    ASSERT_LT(heads, after);
    ASSERT_NE(after, std::string::npos);
    EXPECT_EQ(std::count(r.out.begin() + static_cast<std::ptrdiff_t>(heads),
                         r.out.begin() + static_cast<std::ptrdiff_t>(after), '\n'),
              2)
        << r.out;
    EXPECT_GT(std::filesystem::file_size(folder_ / name), 2000U);
  }
  EXPECT_THAT(to_text(read_file(folder_ / "flow.html")), HasSubstr("<svg"));
  const std::string speeds = to_text(read_file(folder_ / "speeds.csv"));
  EXPECT_EQ(speeds.substr(0, speeds.find('\n')), "slice,z_um,speed_limit_mm_h,looked_at");
  EXPECT_EQ(std::count(speeds.begin(), speeds.end(), '\n'), 1 + flow(kDisc)["layers"].get<int>());
}

TEST_F(FlowProgram, WarnsOfWhatIsBeyondTheModel) {
  // A pin of 0.6 mm, and resin whose dose stays where it is.
  write_stl(folder_ / "pin.stl", cylinder(0.3, 0.5, 24));
  resin("still.toml", "viscosity_pa_s = 0.3\n");
  const RunResult r = call({"flow", "pin.stl", "--layer-um", "50", "--printer", "printer.toml",
                            "--resin", "still.toml", "--speed-mm-h", "300", "--gap-um", "150",
                            "--uv-mw-cm2", "275", "--blue-mw-cm2", "164"});
  EXPECT_EQ(r.exit_code, 0) << r.err;
  EXPECT_THAT(r.err, HasSubstr("more than a fifth"));
  EXPECT_THAT(r.err, HasSubstr("nearer to an outline"));
  EXPECT_THAT(r.err, HasSubstr("Péclet number S h/c is infinite"));
  // Faster than the disc bears.
  const RunResult fast = call(with(Command{"flow"} + kDisc, {"--speed-mm-h", "3000"}));
  EXPECT_EQ(fast.exit_code, 0);
  EXPECT_THAT(fast.err, HasSubstr("too fast"));
}

TEST_F(FlowProgram, RefusesWrongInput) {
  resin("thin.toml", "");
  bad(2, with(Command{"flow"} + kDisc, {"--resin", "thin.toml"}), {"thin.toml: viscosity_pa_s"});
  // By day each option and each value, by night all pairs.
  int turn = 0;
  const auto chosen = [&](int option) { return by_night() || turn % 3 == option; };
  for (const char* value : {"0", "-1", "nan", "inf", "x"}) {
    ++turn;
    if (chosen(0)) {
      bad(2, with(Command{"flow"} + kDisc, {"--pitch-um", value}), {"--pitch-um"});
    }
    if (chosen(1)) {
      bad(2, with(Command{"flow"} + kDisc, {"--gap-um", value}),
          {std::string("--gap-um: is ") + value +
           ", expected a number above 0 and at most 1000\n"});
    }
    if (!chosen(2)) continue;
    bad(2,
        {"flow", "disc.stl", "--layer-um", "50", "--printer", "printer.toml", "--resin",
         "resin.toml", "--speed-mm-h", value},
        {"--speed-mm-h"});
  }
  bad(2, with(Command{"flow"} + kDisc, {"--uv-mw-cm2", "-1"}), {"--uv-mw-cm2"});
  bad(2, with(Command{"flow"} + kDisc, {"--gap-um", "2000"}), {"--gap-um: is 2000"});
  bad(2, with(Command{"flow"} + kDisc, {"--pitch-um", "9000"}), {"third"});
  bad(2, with(Command{"flow"} + kDisc, {"--pitch-um", "10"}), {"pixels"});
  bad(2, with(Command{"flow"} + kDisc, {"--every", "0"}), {"--every"});
  bad(2, with(Command{"flow"} + kDisc, {"-o", "flow.jpg"}), {".svg"});
  bad(2, with(Command{"flow"} + kDisc, {"-o", "disc.stl"}), {"disc.stl"});
  bad(2,
      {"flow", "disc.stl", "--printer", "printer.toml", "--resin", "resin.toml", "--speed-mm-h",
       "300"},
      {"--layer-um"});
  bad(2, {"flow", "disc.stl", "--layer-um", "50", "--resin", "resin.toml", "--speed-mm-h", "300"},
      {"--printer"});
  bad(2,
      {"flow", "nothing.stl", "--layer-um", "50", "--printer", "printer.toml", "--resin",
       "resin.toml", "--speed-mm-h", "300"},
      {"nothing.stl"});
  std::ofstream(folder_ / "resin-bad.toml")
      << "name = \"b\"\nviscosity_pa_s = -1\n[cure]\nabsorbance_height_um = 408\nabsorbance_base = \"e\"\n"
         "critical_dose_mj_cm3 = 1\n";
  bad(2, with(Command{"flow"} + kDisc, {"--resin", "resin-bad.toml"}),
      {"resin-bad.toml", "viscosity_pa_s"});
}

TEST_F(FlowProgram, RefusesLightWithoutADeadZone) {
  bad(3, with(Command{"flow"} + kDisc, {"--uv-mw-cm2", "0"}), {"dead zone"});
  bad(3, with(Command{"flow"} + kDisc, {"--blue-mw-cm2", "100"}), {"dead zone"});
  bad(3, with(Command{"flow"} + kDisc, {"--uv-mw-cm2", "100", "--blue-mw-cm2", "164"}),
      {"sticks", "205.0"});
  bad(3, with(Command{"flow"} + kDisc, {"--uv-mw-cm2", "400"}), {"275"});
  std::ofstream(folder_ / "plain.toml")
      << "name = \"plain\"\nviscosity_pa_s = 0.3\n[cure]\nabsorbance_height_um = 408\nabsorbance_base = \"e\"\n"
         "critical_dose_mj_cm3 = 1600\n";
  bad(3, with(Command{"flow"} + kDisc, {"--resin", "plain.toml", "--uv-mw-cm2", "100"}),
      {"[inhibition]"});
}

// ---- what others refuse ---------------------------------------------------------------------------

class SuctionGate : public FlowProgram {
 protected:
  SuctionGate() {
    // A resin that a print of this printer cures: 100 mW/cm² over 1500 um at 1000 mm/h.
    const std::map<std::string, std::string> keys{{"thick.toml", "viscosity_pa_s = 0.3\n"},
                                                  {"unknown.toml", ""}};
    for (const auto& [name, key] : keys) {
      std::ofstream(folder_ / name) << "name = \"clear\"\n"
                                    << key
                                    << "[cure]\nabsorbance_height_um = 1500\nabsorbance_base = 10\n"
                                       "critical_dose_mj_cm3 = 230\n";
    }
    printer("weak.toml", "suction_limit_pa = 20000\n");
    write_stl(folder_ / "disc.stl", cylinder(10, 0.5, 360));
  }
  Command run(const std::string& printer, const std::string& resin, const std::string& speed,
              const std::string& output = "out.uvj") const {
    return {"run",       "disc.stl", "-o",      output, "--layer-um",   "50",
            "--printer", printer,    "--resin", resin,  "--speed-mm-h", speed};
  }
};

TEST_F(SuctionGate, RunAndCorrectRefuseWhatTheVatDoesNotBear) {
  bad(3, run("weak.toml", "thick.toml", "1000"),
      {"slice", "x 12.", "suction_limit_pa", "80 um", "at most 4"});
  EXPECT_FALSE(std::filesystem::exists(folder_ / "out.uvj"));
  // The speed that is named works, and a thicker gap does.
  const RunResult slow = call(run("weak.toml", "thick.toml", "400"));
  EXPECT_EQ(slow.exit_code, 0) << slow.err;
  EXPECT_THAT(slow.err, HasSubstr("suction under the part"));
  EXPECT_THAT(to_text(read_file(folder_ / "out.html")), HasSubstr("Greatest suction"));
  const RunResult wide = call(run("weak.toml", "thick.toml", "1000") + Command{"--gap-um", "120"});
  EXPECT_EQ(wide.exit_code, 0) << wide.err;

  ASSERT_EQ(
      call({"slice", "disc.stl", "-o", "disc.uvj", "--printer", "weak.toml", "--layer-um", "50"})
          .exit_code,
      0);
  const Command correct{"correct",   "disc.uvj", "-o",         "made.uvj",    "--printer",
                        "weak.toml", "--resin",  "thick.toml", "--speed-mm-h"};
  bad(3, correct + Command{"1000"}, {"slice", "suction_limit_pa", "at most 4"});
  EXPECT_FALSE(std::filesystem::exists(folder_ / "made.uvj"));
  EXPECT_EQ(call(correct + Command{"400"}).exit_code, 0);
}

TEST_F(SuctionGate, WithoutALimitItIsTold) {
  const RunResult r = call(run("printer.toml", "thick.toml", "1000"));
  EXPECT_EQ(r.exit_code, 0) << r.err;
  EXPECT_THAT(r.err, HasSubstr("suction under the part"));
  EXPECT_THAT(r.err, HasSubstr("1 bar"));
  // A limit without a viscosity can't be judged.
  const RunResult unknown = call(run("weak.toml", "unknown.toml", "1000"));
  EXPECT_EQ(unknown.exit_code, 0) << unknown.err;
  EXPECT_THAT(unknown.err, HasSubstr("viscosity_pa_s"));
}

TEST_F(SuctionGate, WithoutTheKeysNothingChanges) {
  const RunResult r = call(run("printer.toml", "unknown.toml", "1000", "plain.uvj"));
  EXPECT_EQ(r.exit_code, 0) << r.err;
  EXPECT_THAT(r.err, testing::Not(HasSubstr("suction")));
  EXPECT_THAT(to_text(read_file(folder_ / "plain.html")), testing::Not(HasSubstr("suction")));
}

TEST_F(SuctionGate, TheFarmRefusesToo) {
  const RunResult r = run_program(
      {SLICECORR_BIN_DIR "/slicefarm", "submit", "disc.stl", "--printer", "weak.toml", "--resin",
       "thick.toml", "--layer-um", "50", "--speed-mm-h", "1000", "--out", "done", "--dir", "farm"},
      options_);
  EXPECT_EQ(r.exit_code, 3) << r.err;
  EXPECT_THAT(r.err + r.out, HasSubstr("suction_limit_pa"));
}

TEST_F(SuctionGate, ThePluginRefusesToo) {
  ASSERT_EQ(
      call({"slice", "disc.stl", "-o", "disc.uvj", "--printer", "weak.toml", "--layer-um", "50"})
          .exit_code,
      0);
  const Bytes before = read_file(folder_ / "disc.uvj");
  const RunResult r = run_program({SLICECORR_BIN_DIR "/slicecorr-post", "--printer", "weak.toml",
                                   "--resin", "thick.toml", "--speed-mm-h", "1000", "disc.uvj"},
                                  options_);
  EXPECT_EQ(r.exit_code, 3) << r.err;
  EXPECT_THAT(r.err, HasSubstr("suction_limit_pa"));
  EXPECT_EQ(read_file(folder_ / "disc.uvj"), before);
}

// ---- real parts -----------------------------------------------------------------------------------

class FlowRealParts : public FlowProgram, public ::testing::WithParamInterface<const char*> {};

TEST_P(FlowRealParts, AreSolved) {
  const std::string mesh = real_file(GetParam());
  SLICECORR_NEEDS_FILE(mesh);
  std::ofstream(folder_ / "large.toml")
      << "name = \"large\"\nsuction_limit_pa = 50000\n"
         "[display]\nwidth_px = 1280\nheight_px = 800\npixel_um = 100\n"
         "[blue]\ncalibration = [[0, 0.0], [255, 200.0]]\n"
         "[uv]\nkind = \"flood\"\ncalibration = [[0, 0.0], [255, 275.0]]\n";
  // The lattice is a unit cube.
  const std::string scale = mesh.find("tpms") != std::string::npos ? "20" : "1";
  const json j =
      flow({mesh, "--scale", scale, "--layer-um", "100", "--printer", "large.toml", "--resin",
            "resin.toml", "--speed-mm-h", "300", "--gap-um", "80", "--every", "40"});
  ASSERT_FALSE(j.is_null());
  ASSERT_GE(j["slices"].size(), 4U);
  double least = 1e300;
  for (const json& s : j["slices"]) {
    EXPECT_GT(s["suction_pa"].get<double>(), 0);
    EXPECT_GT(s["force_n"].get<double>(), 0);
    // Suction at the speed, and the speed at the limit, are one number.
    EXPECT_NEAR(s["suction_pa"].get<double>() * s["speed_limit_mm_h"].get<double>(), 300 * 50000,
                1e-6 * 300 * 50000);
    least = std::min(least, s["speed_limit_mm_h"].get<double>());
  }
  EXPECT_EQ(j["slowest"]["speed_limit_mm_h"], least);
}

INSTANTIATE_TEST_SUITE_P(Meshes, FlowRealParts,
                         ::testing::Values("meshes/clean/3DBenchy.stl",
                                           "meshes/clean/tpms_diamond_51.stl"));

}  // namespace
}  // namespace slicecorr::test
