// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Parts of five kinds through the programs: printed in a made-up laboratory, scanned with all faults of scans, and
/// printed again with what the scan told. Several prints in one fit.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "hook.hpp"
#include "ladder.hpp"
#include "lattice.hpp"
#include "program_fixture.hpp"
#include "real_files.hpp"
#include "rounds.hpp"
#include "scan_lab.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;
using testing::HasSubstr;

/// Teeth of different lengths over gaps of different heights.
TriangleMesh comb() {
  TriangleMesh mesh = box({0, 0, 0}, {3, 1.6, 0.3}) + box({0, 0, 0.3}, {0.6, 1.6, 3.5});
  const double gaps_mm[] = {0.2, 0.4, 0.6, 0.8};
  double z = 0.3;
  for (int k = 0; k < 4; ++k) {
    z += gaps_mm[k];
    mesh = mesh + box({0.6, 0, z}, {3 - 0.2 * k, 1.6 - 0.2 * k, z + 0.3});
    z += 0.3;
  }
  return mesh;
}

/// A block with channels that lie across it, open at both sides.
TriangleMesh channels() {
  TriangleMesh mesh = box({0, 0, 0}, {3, 1.8, 0.5});
  const double heights_mm[] = {0.3, 0.5, 0.8};
  double z = 0.5;
  for (int k = 0; k < 3; ++k) {
    const double h = heights_mm[k], wide = 1.1 + 0.2 * k;
    mesh = mesh + box({0, 0, z}, {0.5, 1.8, z + h}) + box({0.5 + wide, 0, z}, {3, 1.8, z + h}) +
           box({0, 0, z + h}, {3, 1.8 - 0.3 * k, z + h + 0.4});
    z += h + 0.4;
  }
  return mesh;
}

struct PartKind {
  const char* name;
  TriangleMesh mesh;  ///< empty: `file`
  std::string file;
  double fit_mm = 0;
};

std::vector<PartKind> kinds() {
  return {{"comb", comb(), "", 0},
          {"channels", channels(), "", 0},
          {"lattice", lattice(2, 1, 2, 1.6, 0.25), "", 0},
          {"elephant", {}, real_file("meshes/dirty/cgal_elephant-with-holes.off"), 5},
          {"3DBenchy", {}, real_file("meshes/clean/3DBenchy.stl"), 6}};
}

class ScanPrints : public ProgramFixture {
 protected:
  ScanPrints() {
    // Seconds of work; at night other tests run beside it.
    options_.timeout = std::chrono::minutes(5);
    write("small.toml", kSmallPrinter);
    write("believed.toml", resin_text("believed", 600, 576));
    // 6 % higher absorbance height at a light that counts 4 % less; it shrinks, and its first layers stand out.
    write("real.toml",
          resin_text("real", 636, 576 * 1.04 / 1.06,
                     "[shrinkage]\nplane = 0.6\nz = 0.4\n[first_layers]\ngrowth_um = 60\n"));
  }
  static Command how() { return {"--layer-um", "50", "--printer", "small.toml"}; }
  void run(const std::string& mesh, const std::string& stack, const char* speed_mm_h,
           const char* resin = "believed.toml") const {
    good(Command{"run", mesh, "-o", stack, "--resin", resin, "--speed-mm-h", speed_mm_h} + how());
  }
  /// The scan of what the laboratory prints of a stack: turned, noisy, a third missing, with stubs and dust.
  void scan(const std::string& stack, const std::string& file, std::mt19937& random,
            const ScanFaults& faults) const {
    good({"solid", stack, "-o", "printed.ply", "--resin", "real.toml"});
    const Scan points =
        scanned(read_mesh(folder_ / "printed.ply"), random_pose(random), 12'000, faults, random);
    std::string text = fmt::format(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\nend_header\n",
        points.points.size());
    for (const Point3& p : points.points) text += fmt::format("{} {} {}\n", p[0], p[1], p[2]);
    write(file, text);
  }
  /// The mean error of edges along z, when the laboratory prints a stack.
  double off_um(const std::string& stack, const std::string& target) const {
    return figures(stack, target,
                   {"--printer", "small.toml", "--resin", "real.toml", "--speed-mm-h",
                    "600"})["height_error_um"]["mean_abs"]
        .get<double>();
  }
  /// How far the laboratory's print lies off the design in the mean.
  double surface_off_um(const std::string& stack, const std::string& mesh) const {
    good({"solid", stack, "-o", "truth.ply", "--resin", "real.toml"});
    const json j =
        json::parse(good(Command{"scan", "compare", "truth.ply", "--stack", stack, "--resin",
                                 "real.toml", "--design", mesh, "--json", "-"})
                        .out);
    return j["deviations"][0]["mean_abs_um"].get<double>();
  }

  /// Printed, scanned, tuned by that, printed again.
  void print_twice(const PartKind& part) {
    std::string mesh = part.file;
    if (mesh.empty()) {
      mesh = "part.stl";
      write_stl(folder_ / mesh, part.mesh);
    } else {
      if (const std::string why = lacks(mesh); !why.empty()) GTEST_SKIP() << why;
      // --next slices a mesh as its file has it.
      Placement small;
      small.scale = fit_scale({mesh}, {}, part.fit_mm);
      write_stl(folder_ / "part.stl", read_mesh(mesh, small));
      mesh = "part.stl";
    }
    std::mt19937 random(7);
    run(mesh, "first.uvj", "600");
    scan("first.uvj", "scan.ply", random, {10, true, true, false});
    const RunResult r =
        good({"tune", "--scan", "scan.ply", "--stack", "first.uvj", "--printer", "small.toml",
              "--resin", "believed.toml", "-o", "tuned.toml", "--printer-out", "tuned-printer.toml",
              "--next", "second.uvj", "--target", mesh});
    good(Command{"slice", mesh, "-o", "second-target.uvj", "--resin", "tuned.toml"} + how());
    const double first_um = off_um("first.uvj", "first-target.uvj"),
                 second_um = off_um("second.uvj", "second-target.uvj");
    const double first_all_um = surface_off_um("first.uvj", mesh),
                 second_all_um = surface_off_um("second.uvj", mesh);
    // What is left when all is known: walls lie at pixels, edges at levels.
    run(mesh, "perfect.uvj", "600", "real.toml");
    const double perfect_um = off_um("perfect.uvj", "perfect-target.uvj"),
                 perfect_all_um = surface_off_um("perfect.uvj", mesh);
    if (by_night()) {
      std::puts(
          fmt::format(
              "{}: edges along z {:.2f} -> {:.2f} um, {:.2f} when all is known; all surfaces {:.2f} -> {:.2f} um, "
              "{:.2f} when all is known\n{}",
              part.name, first_um, second_um, perfect_um, first_all_um, second_all_um,
              perfect_all_um, r.out)
              .c_str());
    }
    EXPECT_GT(first_um, 2);
    EXPECT_LT(second_um, 0.25 * first_um) << r.out;
    // What pixels and slices leave, nothing that a scan tells makes less.
    EXPECT_LT(second_all_um - perfect_all_um, 0.25 * first_all_um) << r.out;
    EXPECT_LT(second_all_um, first_all_um) << r.out;
  }
};

class FivePartsNight : public ScanPrints, public testing::WithParamInterface<int> {};

TEST_P(FivePartsNight, TheSecondPrintIsOffByAQuarterAtMost) {
  print_twice(kinds()[static_cast<std::size_t>(GetParam())]);
}
INSTANTIATE_TEST_SUITE_P(ScanPrints, FivePartsNight, testing::Range(0, 5), [](const auto& info) {
  return std::string(kinds()[static_cast<std::size_t>(info.param)].name);
});

// Two parts that were printed at two speeds tell more together than either.
class SeveralPrintsNight : public ScanPrints {};

/// The width of the height's interval, from "absorbance height, um  636.1  634.0 to 638.2".
double width(const std::string& text) {
  const std::string line = text.substr(text.rfind("absorbance height, um"));
  double found = 0, low = 0, high = 0;
  EXPECT_EQ(std::sscanf(line.c_str(), "absorbance height, um %lf %lf to %lf", &found, &low, &high),
            3)
      << text;
  EXPECT_NEAR(found, 636, high - low) << text;
  return high - low;
}

TEST_F(SeveralPrintsNight, AreOneFit) {
  write_stl(folder_ / "hook.stl", hook());
  write_stl(folder_ / "channels.stl", channels());
  std::mt19937 random(8);
  run("hook.stl", "hook.uvj", "600");
  run("channels.stl", "channels.uvj", "800");
  scan("hook.uvj", "hook.ply", random, {10, false, false, false});
  scan("channels.uvj", "channels.ply", random, {10, false, false, false});
  const auto tuned = [&](const Command& what) {
    return good(Command{"tune"} + what +
                Command{"--printer", "small.toml", "--resin", "believed.toml", "-o", "tuned.toml"})
        .out;
  };
  const double alone = width(tuned({"--scan", "hook.ply", "--stack", "hook.uvj"}));
  const std::string both =
      tuned({"--scan", "hook.ply", "channels.ply", "--stack", "hook.uvj", "channels.uvj"});
  EXPECT_THAT(both, HasSubstr("of 2 scans"));
  EXPECT_LT(width(both), alone);
  bad(2,
      {"tune", "--scan", "hook.ply", "channels.ply", "--stack", "hook.uvj", "hook.uvj", "hook.uvj",
       "--printer", "small.toml", "--resin", "believed.toml"},
      {"3 stacks for 2 scans"});
}

// Heights in a table are of what shrank, which the scan tells: at 3 % they alone would say 617 um in place of 636.
TEST_F(SeveralPrintsNight, TablesAreOfWhatShrank) {
  constexpr double height_um = 636, dose_mj_cm3 = 576 * 1.04 / 1.06;
  write("real.toml", resin_text("real", height_um, dose_mj_cm3, "[shrinkage]\nz = 3\n"));
  const Command belief{"--printer", "small.toml", "--resin", "believed.toml"};
  good(Command{"testpart", "wedge", "-o", "wedge.uvj"} + belief);
  std::string filled;
  const Bytes form = read_file(folder_ / "wedge.csv");
  std::istringstream table(std::string(form.begin(), form.end()));
  std::mt19937 random(9);
  std::normal_distribution<double> noise_um(0, 5);
  for (std::string line; std::getline(table, line);) {
    double intensity = 0, seconds = 0;
    const std::string numbers = line.substr(std::min(line.size(), line.find(',')));
    if (std::sscanf(numbers.c_str(), ",%lf,%lf", &intensity, &seconds) == 2) {
      // Jacobs' law, by the dose at the window that just gels.
      const double gel_mj_cm2 = dose_mj_cm3 * height_um * 1e-4 / std::log(10.0);
      line +=
          fmt::format("{:.1f}", 0.97 * height_um * std::log10(intensity * seconds / gel_mj_cm2) +
                                    noise_um(random));
    }
    filled += line + "\n";
  }
  write("wedge.csv", filled);
  write_stl(folder_ / "hook.stl", hook());
  run("hook.stl", "hook.uvj", "600");
  scan("hook.uvj", "hook.ply", random, {10, true, true, false});
  const Command scanned{"--scan", "hook.ply", "--stack", "hook.uvj"};
  const double alone = width(good(Command{"tune"} + scanned + belief).out);
  const Command both = Command{"tune", "wedge.csv", "-o", "tuned.toml"} + scanned;
  EXPECT_LT(width(good(both + belief).out), alone);
  // Neither counts again.
  const Command after{"--printer", "tuned-printer.toml", "--resin", "tuned.toml"};
  bad(2, Command{"tune"} + scanned + after, {"hook.ply", "was counted before"});
  bad(2, Command{"tune", "wedge.csv"} + after, {"wedge.csv", "was counted before"});
}

}  // namespace
}  // namespace slicecorr::test
