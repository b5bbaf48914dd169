// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// `slicecorr simulate` as its users call it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <sstream>

#include "ladder.hpp"
#include "made_once.hpp"
#include "program_fixture.hpp"

namespace slicecorr::test {
namespace {

using testing::HasSubstr;
using testing::StartsWith;

constexpr const char* kFigure34 = R"(name = "figure-3-4"
[cure]
model = "kinetic"
m = 1.0
absorbance_height_um = 750.0
absorbance_base = "e"
critical_dose_prime = 100.0
dose_factor = 1.0
[inhibition]
beta = 1.0
absorbance_height_um = 100.0
absorbance_base = "e"
)";

std::vector<std::vector<double>> rows_of(const std::string& csv, const std::string& head) {
  std::istringstream lines(csv);
  std::string line;
  std::getline(lines, line);
  EXPECT_EQ(line, head);
  std::vector<std::vector<double>> rows;
  while (std::getline(lines, line)) {
    std::istringstream fields(line);
    rows.emplace_back();
    for (std::string field; std::getline(fields, field, ',');) {
      rows.back().push_back(std::stod(field));
    }
  }
  return rows;
}

constexpr const char* kColumnHead = "time_s,slice,z_window_um,front_um,back_um";
constexpr const char* kDoseHead = "time_s,slice,z_um,dose";
constexpr const char* kFrontsHead = "blue_mw_cm2,uv_mw_cm2,time_s,front_um,back_um";

class SimulateCommand : public ProgramFixture {
 protected:
  SimulateCommand() {
    write_stl(folder_ / "ladder.stl", ladder());
    write("figure-3-4.toml", kFigure34);
  }
  /// Refused, with nothing on stdout.
  void refused(int code, const Command& arguments, const std::string& words) const {
    EXPECT_EQ(bad(code, arguments, {words}).out, "");
  }
  std::string text(const std::string& name) const { return to_text(read_file(folder_ / name)); }
  void slice() const {
    made_once("SimulateCommand", folder_, {"target.uvj"}, [&] {
      good({"slice", "ladder.stl", "-o", "target.uvj", "--layer-um", "50", "--printer",
            "dual-wavelength-dlp"});
    });
  }
  void correct(const Command& more) const {
    good(Command{"correct", "target.uvj", "-o", "part.uvj", "--printer", "dual-wavelength-dlp"} +
         more);
  }
  static Command setup() {
    return {"--printer", "dual-wavelength-dlp", "--resin", "figure-2-2", "--speed-mm-h", "1000"};
  }
};

TEST_F(SimulateCommand, ColumnOfFigure22) {
  slice();
  const RunResult r = good(Command{"simulate", "target.uvj", "--x", "640", "--y", "400", "-o",
                                   "column.svg", "--csv", "-", "--dose-csv", "dose.csv"} +
                           setup());
  EXPECT_THAT(text("column.svg"), StartsWith("<svg"));
  EXPECT_THAT(text("column.svg"), HasSubstr("to slice 49"));
  const auto rows = rows_of(r.out, kColumnHead);
  ASSERT_GT(rows.size(), 300U);
  for (const auto& row : rows) {
    ASSERT_EQ(row.size(), 5U);
    // 1000 mm/h: the window moves 277.78 um a second.
    EXPECT_NEAR(row[2], row[0] * 1e6 / 3600, 1e-6);
    EXPECT_LT(row[4], row[3]);
    EXPECT_LE(row[3], row[2]);
  }
  // One solid piece, as the dissertation has it (physics.md: 1902.1 um).
  EXPECT_NEAR(rows.back()[0], 9, 1e-9);
  EXPECT_EQ(rows.back()[1], 49);
  EXPECT_NEAR(rows.back()[3], 1902.1, 0.05);
  EXPECT_EQ(rows.back()[4], 0);
  // Doses at the end are those of `probe`.
  std::istringstream probe(
      good(Command{"probe", "target.uvj", "--x", "640", "--y", "400"} + setup()).out);
  std::string line;
  std::getline(probe, line);
  const auto doses = rows_of(text("dose.csv"), kDoseHead);
  int compared = 0;
  for (int n = 0; std::getline(probe, line); ++n) {
    double z = 0, dose = 0;
    ASSERT_EQ(std::sscanf(line.c_str(), "%*d,%lf,%*d,%*f,%*f,%lf", &z, &dose), 2);
    for (const auto& row : doses) {
      if (row[1] != 49 || row[2] != z) continue;
      EXPECT_NEAR(row[3], dose, 1e-12 * (1 + dose));
      ++compared;
    }
  }
  EXPECT_EQ(compared, 50);
  // The table alone is the same.
  good(Command{"simulate", "target.uvj", "--x", "640", "--y", "400", "-o", "column.csv"} + setup());
  EXPECT_EQ(text("column.csv"), r.out);
}

TEST_F(SimulateCommand, CorrectedStackNeedsNothingElse) {
  slice();
  correct({"--resin", "figure-2-2", "--speed-mm-h", "1000"});
  const RunResult r = good({"simulate", "part.uvj", "--target", "target.uvj", "--x", "640", "--y",
                            "400", "-o", "column.svg", "--csv", "-", "--substeps", "3"});
  const auto rows = rows_of(r.out, kColumnHead);
  ASSERT_GE(rows.size(), 2U);
  const auto &first = rows[rows.size() - 2], &second = rows.back();
  EXPECT_EQ(first[0], second[0]);
  // Two features, edges to a level step (CureModel::level_step_um): dphi is 6.1875 / 255.
  const double eta = 0.025, a = std::pow(10, -eta);
  const double step_um = 50 * 6.1875 / 255 * (1 - a) / (std::log(10) * eta * 0.9375);
  EXPECT_NEAR(first[4], 550, step_um);
  EXPECT_NEAR(first[3], 1050, step_um);
  EXPECT_NEAR(second[4], 1550, step_um);
  EXPECT_NEAR(second[3], 2050, step_um);
  EXPECT_THAT(text("column.svg"), HasSubstr("design"));
}

TEST_F(SimulateCommand, UvMarksDeadZones) {
  slice();
  write_file(folder_ / "inhibited.toml", to_bytes(R"(name = "custom-1"
[cure]
model = "kinetic"
m = 0.99
absorbance_height_um = 408.0
absorbance_base = "e"
critical_dose_prime = 64.0
dose_factor = 1.0
[inhibition]
beta = 0.73
absorbance_height_um = 37.8
absorbance_base = "e"
)"));
  correct({"--resin", "inhibited.toml", "--speed-mm-h", "1000", "--uv-mw-cm2", "200"});
  const RunResult r = good({"simulate", "part.uvj", "--target", "target.uvj", "--x", "640", "--y",
                            "400", "-o", "column.svg", "--csv", "-"});
  EXPECT_THAT(text("column.svg"), HasSubstr("steady dead zone"));
  for (const auto& row : rows_of(r.out, kColumnHead)) EXPECT_LT(row[3], row[2] - 15.7);
}

TEST_F(SimulateCommand, RowAsPictures) {
  slice();
  const Command row = Command{"simulate", "target.uvj", "--row", "400", "-o", "row.png"} + setup();
  const RunResult r = good(row);
  EXPECT_THAT(r.err, HasSubstr("platform up"));
  EXPECT_THAT(r.err, HasSubstr("5.94, 7.38, 9 s"));
  const Bytes six = read_file(folder_ / "row.png");
  ASSERT_GT(six.size(), 100U);
  EXPECT_EQ(six[1], 'P');
  good(row);
  EXPECT_EQ(read_file(folder_ / "row.png"), six);
  const RunResult two = good(row + Command{"--times-s", "9,3"});
  EXPECT_THAT(two.err, HasSubstr("after 3, 9 s"));
  EXPECT_NE(read_file(folder_ / "row.png"), six);
  // A list does not swallow the stack that follows it.
  good(Command{"simulate", "--times-s", "3,9", "target.uvj", "--row", "400", "-o", "row.png"} +
       setup());
}

TEST_F(SimulateCommand, StationaryFrontsOfFigure34) {
  const RunResult r =
      good({"simulate", "--stationary", "--resin", "figure-3-4.toml", "--blue-mw-cm2", "100,200",
            "--uv-ratio", "2", "--time-s", "10", "-o", "fronts.svg", "--csv", "-"});
  EXPECT_THAT(r.err, HasSubstr("first gel after 1.7502 s at 312.47 um"));
  EXPECT_THAT(r.err, HasSubstr("dead zone 79.979 um"));
  EXPECT_THAT(text("fronts.svg"), StartsWith("<svg"));
  int seen = 0;
  for (const auto& row : rows_of(r.out, kFrontsHead)) {
    EXPECT_EQ(row[1], 2 * row[0]);
    const auto at = [&](double blue, double time_s, double front, double back) {
      if (row[0] != blue || std::abs(row[2] - time_s) > 1e-9) return;
      ++seen;
      EXPECT_NEAR(row[3], front, 5e-3);
      EXPECT_NEAR(row[4], back, 0.05);
    };
    at(100, 3, 139.17, 822.76);
    at(100, 5, 110.39, 1207.0);
    at(100, 10, 93.857, 1726.9);
    at(200, 5, 93.857, 1726.9);  // twice the light, half the time
  }
  EXPECT_EQ(seen, 4);
  const RunResult soon =
      good({"simulate", "--stationary", "--resin", "figure-3-4.toml", "--blue-mw-cm2", "100",
            "--uv-mw-cm2", "200", "--time-s", "1", "-o", "fronts.csv"});
  EXPECT_THAT(soon.err, HasSubstr("nothing gels in 1 s"));
  EXPECT_TRUE(rows_of(text("fronts.csv"), kFrontsHead).empty());
}

TEST_F(SimulateCommand, WrongCombinations) {
  slice();
  const Command stack{"simulate", "target.uvj"}, xy{"--x", "640", "--y", "400"};
  const Command still{"simulate", "--stationary", "--resin", "figure-3-4.toml"};
  const Command light{"--blue-mw-cm2", "100", "--time-s", "5"};
  const auto to = [](const std::string& name) { return Command{"-o", name}; };
  refused(2, stack + setup() + to("a.svg"), "expected --x and --y for a column, or --row");
  refused(2, stack + setup() + to("a.svg") + Command{"--x", "3"}, "expected --x and --y");
  refused(2, stack + setup() + xy + to("a.png"), ".svg or .csv");
  refused(2, stack + setup() + Command{"--row", "400"} + to("a.svg"), ".png");
  refused(2, stack + setup() + xy + Command{"--row", "400"} + to("a.svg"), "one of the two");
  refused(2, stack + setup() + Command{"--row", "400", "--csv", "-"} + to("a.png"), "for a column");
  refused(2, stack + setup() + Command{"--x", "1280", "--y", "0"} + to("a.svg"),
          "outside the image");
  refused(2, stack + setup() + Command{"--row", "800"} + to("a.png"), "outside the image");
  refused(2, stack + setup() + xy + Command{"--times-s", "1,9.5"} + to("a.svg"),
          "expected 0 to 9 s");
  refused(2, stack + setup() + Command{"--row", "400", "--times-s", "9.5"} + to("a.png"),
          "ends after 9 s");
  refused(2, stack + setup() + xy + Command{"--times-s", "1,2,3,4,5,6,7,8,9"} + to("a.svg"),
          "up to 8 dose curves");
  refused(2, stack + xy + to("a.svg"), "--printer");
  refused(2, stack + setup() + xy + light + to("a.svg"), "go with --stationary");
  refused(2, Command{"simulate"} + setup() + xy + to("a.svg"), "expected a STACK");
  refused(2, stack + setup() + xy, "--output");
  refused(2, stack + setup() + xy + Command{"--substeps", "0"} + to("a.svg"), "--substeps");
  refused(2, still + to("a.svg"), "expected --blue-mw-cm2");
  refused(2, still + Command{"--blue-mw-cm2", "100"} + to("a.svg"), "expected --time-s");
  refused(2, still + Command{"--blue-mw-cm2", "-1", "--time-s", "5"} + to("a.svg"),
          "--blue-mw-cm2");
  refused(2, still + light + Command{"--uv-ratio", "2", "--uv-mw-cm2", "200"} + to("a.svg"),
          "one of them");
  refused(2, still + light + Command{"target.uvj"} + to("a.svg"), "needs no stack");
  refused(2, still + light + xy + to("a.svg"), "look into a stack");
  refused(2, still + light + Command{"--speed-mm-h", "800"} + to("a.svg"), "no printer, speed");
  refused(2, still + light + to("a.png"), ".svg or .csv");
  refused(2,
          Command{"simulate", "--stationary", "--resin", "figure-2-2", "--uv-ratio", "2"} + light +
              to("a.svg"),
          "has no [inhibition]");
  // Inputs stay, and outputs do not replace each other.
  const Bytes before = read_file(folder_ / "target.uvj");
  refused(2, stack + setup() + xy + to("a.svg") + Command{"--csv", "target.uvj"}, "is an input");
  refused(2, stack + setup() + xy + to("a.csv") + Command{"--dose-csv", "a.csv"}, "two outputs");
  EXPECT_EQ(read_file(folder_ / "target.uvj"), before);
  // A corrected stack is no design.
  correct({"--resin", "figure-2-2", "--speed-mm-h", "1000"});
  refused(2, Command{"simulate", "part.uvj", "--target", "part.uvj"} + xy + to("a.svg"),
          "is a corrected stack");
  refused(4, Command{"simulate", "part.uvj"} + xy + to("nowhere/a.svg"), "nowhere");
}

TEST_F(SimulateCommand, InterruptedLeavesNothing) {
  slice();
  RunOptions options = options_;
  options.signal = SIGINT;
  options.signal_when = [](const std::string&, const std::string& err) {
    return err.find("read: done") != std::string::npos;
  };
  const auto before = folder_.count();
  // Half a million steps through 50 layers.
  const RunResult r = run_program(
      Command{SLICECORR_BIN_DIR "/slicecorr", "simulate", "target.uvj", "--x", "640", "--y", "400",
              "--substeps", "10000", "-o", "column.csv", "--dose-csv", "dose.csv"} +
          setup(),
      options);
  ASSERT_TRUE(r.signalled);
  EXPECT_EQ(r.exit_code, 130) << r.err;
  EXPECT_EQ(folder_.count(), before);
}

TEST_F(SimulateCommand, HelpSaysWhatItDoes) {
  const RunResult r = good({"simulate", "--help"});
  for (const char* option : {"--stationary", "--row", "--times-s", "--dose-csv", "--uv-ratio"}) {
    EXPECT_THAT(r.out, HasSubstr(option));
  }
  EXPECT_THAT(good({"--help"}).out, HasSubstr("simulate"));
}

}  // namespace
}  // namespace slicecorr::test
