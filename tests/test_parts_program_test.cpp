// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Test parts through the programs, as a lab goes: make the part, print it on a made up printer whose
/// truth is hidden from the programs, fill in the table, fit. Heights and edges are summed up here,
/// from the written images and the tables alone; no dose of ours is used.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <sstream>

#include "program_fixture.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;
using testing::HasSubstr;

/// The printer as it is: a file says less light, and none of it stray.
struct Truth {
  double ha_um = 2000 * 1.06;  ///< base 10; the file says 2000
  double gel_areal = 50;       ///< mJ/cm²; the file says 50
  double light = 0.95;         ///< times what the printer file says
  double stray_mw_cm2 = 0.15;
  double he_um() const { return ha_um / std::log(10); }
  double mw_cm2(double file_says) const { return light * file_says + stray_mw_cm2; }
};

constexpr double kGel = 50, kHaUm = 2000;

class TestPartsProgram : public ProgramFixture {
 protected:
  TestPartsProgram() {
    write("p.toml", kSmallPrinter);
    write("r.toml", resin_text());
  }
  static std::string resin_text() {
    return fmt::format(
        "name = \"r\"\n[cure]\nmodel = \"jacobs\"\nm = 1.0\nabsorbance_height_um = {}\n"
        "absorbance_base = 10\ngel_dose_mj_cm2 = {}\ndose_factor = 1.0\n",
        kHaUm, kGel);
  }
  RunResult resinctl(const Command& arguments) const {
    return run_program(Command{SLICECORR_BIN_DIR "/resinctl"} + arguments, options_);
  }
  json fitted(const Command& arguments) const {
    const RunResult r = resinctl(arguments + Command{"--json", "-"});
    EXPECT_EQ(r.exit_code, 0) << r.err;
    return json::parse(r.out);
  }
  std::string text_of(const std::string& name) const {
    std::ifstream in(folder_ / name, std::ios::binary);
    std::stringstream text;
    text << in.rdbuf();
    return text.str();
  }
  using Row = std::map<std::string, std::string>;
  /// Fills in the last column of a form with what `measured` says of a row; NaN leaves it empty.
  void fill(const std::string& form, const std::string& column,
            const std::function<double(const Row&)>& measured, const std::string& to = "") const {
    std::istringstream lines(text_of(form));
    std::string text, line;
    std::vector<std::string> header;
    std::size_t count = 0;
    while (std::getline(lines, line)) {
      if (line.starts_with("#")) {
        text += line + "\n";
        continue;
      }
      std::vector<std::string> cells;
      std::istringstream all(line + ",");
      for (std::string cell; std::getline(all, cell, ',');) cells.push_back(cell);
      if (header.empty()) {
        header = cells;
      } else {
        Row row;
        for (std::size_t i = 0; i < header.size(); ++i)
          row[header[i]] = i < cells.size() ? cells[i] : "";
        const double value = measured(row);
        for (std::size_t i = 0; i < header.size(); ++i) {
          if (header[i] == column && !std::isnan(value)) cells[i] = fmt::format("{:.2f}", value);
        }
        ++count;
      }
      for (std::size_t i = 0; i < header.size(); ++i) {
        text += (i ? "," : "") + (i < cells.size() ? cells[i] : std::string());
      }
      text += "\n";
    }
    EXPECT_GT(count, 0U) << form;
    write(to.empty() ? form : to, text);
  }
  static double number(const Row& row, const std::string& column) {
    return std::stod(row.at(column));
  }
  /// Jacobs' law for the light and the dark after it.
  static double plug_um(const Row& row, const Truth& t) {
    const double dose = t.mw_cm2(number(row, "intensity_mw_cm2")) * number(row, "shown_s") +
                        t.mw_cm2(number(row, "dark_mw_cm2")) * number(row, "dark_s");
    return t.he_um() * std::log(dose / t.gel_areal);
  }
  /// Edges of a printed column, from the platform on: where the dose, summed over slices, is gel's.
  std::vector<double> edges_um(const std::string& stack, int x, int y, const Truth& t,
                               double speed_mm_h) const {
    return edges_um(images(stack), kSmallWidth, {x, y}, t, speed_mm_h);
  }
  static std::vector<double> edges_um(const std::vector<Bytes>& all, int width,
                                      const std::pair<int, int>& place, const Truth& t,
                                      double speed_mm_h) {
    const double a = std::pow(10, -50 / t.ha_um), s = speed_mm_h / 36000;
    std::vector<double> phi;
    for (const Bytes& image : all) {
      const int level = image[static_cast<std::size_t>(place.second * width + place.first)];
      // Areal dose that passes while the window moves by one e-fold: light over speed times height.
      const double areal = t.mw_cm2(1 + 99 * level / 255.0) * t.he_um() * 1e-4 / s;
      phi.push_back(areal / t.gel_areal);
    }
    std::vector<double> dose(phi.size() + 1, 0.0);
    for (std::size_t k = phi.size(); k-- > 0;) dose[k] = phi[k] * (1 - a) + a * dose[k + 1];
    std::vector<double> found;
    for (std::size_t k = 0; k < phi.size(); ++k) {
      if ((dose[k] >= 1) == (dose[k + 1] >= 1)) continue;
      // dose = phi + (dose below - phi) 10^(-d / ha), d up from the lower node.
      const double d = -t.ha_um * std::log10((1 - phi[k]) / (dose[k + 1] - phi[k]));
      found.push_back(50.0 * static_cast<double>(k + 1) - d);
    }
    return found;
  }
};

// Several intensities on one plate: kinetic finds the law, tune the light, too.
TEST_F(TestPartsProgram, StaircaseGivesTheParametersBack) {
  good({"testpart", "staircase", "--printer", "p.toml", "--resin", "r.toml", "-o", "stairs.uvj"});
  EXPECT_THAT(text_of("stairs.html"), HasSubstr("stairs.csv"));
  Truth t;
  t.light = 1;
  t.stray_mw_cm2 = 0;
  fill(
      "stairs.csv", "cured_height_um", [&](const Row& r) { return plug_um(r, t); }, "exact.csv");
  const json fit = fitted({"fit", "exact.csv", "--model", "kinetic"});
  // Heights are rounded to 0.01 um.
  EXPECT_NEAR(fit["parameters"]["h_um"]["value"], t.he_um(), 0.1);
  EXPECT_NEAR(fit["parameters"]["critical_dose_prime"]["value"], 50, 0.02);
  EXPECT_NEAR(fit["parameters"]["m"]["value"], 1, 1e-3);
  EXPECT_EQ(fit["n"], 18);

  // A plug that came off stays empty, and is told.
  const Truth hidden;
  fill("stairs.csv", "cured_height_um", [&](const Row& r) {
    return r.at("name") == "plug 2-3" ? std::nan("") : plug_um(r, hidden);
  });
  const RunResult told = resinctl({"fit", "stairs.csv", "--model", "kinetic"});
  EXPECT_THAT(told.out + told.err,
              HasSubstr("1 rows of 18, the first in line 12, were not measured"));
  const RunResult tuned = good({"tune", "stairs.csv", "--printer", "p.toml", "--resin", "r.toml",
                                "--sigma-um", "1", "-o", "tuned.toml"});
  EXPECT_THAT(tuned.out, HasSubstr("missing: stairs.csv: plug 2-3"));
  EXPECT_THAT(tuned.out, HasSubstr("17 edges and plugs"));
  const std::string file = text_of("tuned.toml"), key = "absorbance_height_um = ";
  ASSERT_NE(file.find(key), std::string::npos);
  EXPECT_NEAR(std::stod(file.substr(file.find(key) + key.size())), hidden.ha_um, 21);
  EXPECT_THAT(text_of("tuned-printer.toml"), HasSubstr("stray light"));
  // Not over what was measured.
  bad(2, {"testpart", "staircase", "--printer", "p.toml", "--resin", "r.toml", "-o", "stairs.uvj"},
      {"stairs.csv", "not written over"});
}

TEST_F(TestPartsProgram, WedgeGivesTheParametersBack) {
  good({"testpart", "wedge", "--printer", "p.toml", "--resin", "r.toml", "-o", "wedge.uvj"});
  Truth t;
  t.light = 1;
  t.stray_mw_cm2 = 0;
  fill("wedge.csv", "cured_height_um", [&](const Row& r) { return plug_um(r, t); });
  const json fit = fitted({"fit", "wedge.csv", "--model", "jacobs"});
  EXPECT_NEAR(fit["parameters"]["h_um"]["value"], t.he_um(), 0.1);
  EXPECT_NEAR(fit["parameters"]["dc_mj_cm2"]["value"], 50, 0.02);
  const RunResult tuned =
      good({"tune", "wedge.csv", "--printer", "p.toml", "--resin", "r.toml", "--sigma-um", "1"});
  EXPECT_THAT(tuned.out, HasSubstr("12 edges and plugs"));
}

TEST_F(TestPartsProgram, DeadZonesGiveTheParametersBack) {
  good({"testpart", "dead-zone", "--printer", "p.toml", "--uv-mw-cm2", "200", "-o", "zones.uvj"});
  constexpr double hb = 408, beta = 0.8, huv = 40;
  fill("zones.csv", "dead_zone_um", [&](const Row& r) {
    return std::log(beta * number(r, "uv_mw_cm2") / number(r, "blue_mw_cm2")) / (1 / huv - 1 / hb);
  });
  const json fit =
      fitted({"fit", "zones.csv", "--model", "deadzone-steady", "--resin", "custom-resin-1"});
  EXPECT_NEAR(fit["parameters"]["beta"]["value"], beta, 1e-3);
  EXPECT_NEAR(fit["parameters"]["huv_um"]["value"], huv, 0.02);
}

TEST_F(TestPartsProgram, LinesAndGapsGiveTheSpreadBack) {
  write("big.toml",
        "name = \"big\"\n[display]\nwidth_px = 1280\nheight_px = 800\npixel_um = 50.0\n[blue]\n"
        "calibration = [[0, 1.0], [255, 100.0]]\n");
  good({"testpart", "spread", "--printer", "big.toml", "-o", "spread.uvj", "--height-um", "50"});
  constexpr double sigma = 40, dose = 6.25, dark = 0.01;
  const auto integral = [](double x) { return 0.5 * std::erfc(-x / std::sqrt(2.0)); };
  fill("spread.csv", "printed_um", [&](const Row& r) {
    const double half = number(r, "designed_um") / 2;
    const bool gap = r.at("kind") == "gap";
    const auto light = [&](double x) {
      const double b = integral((x + half) / sigma) - integral((x - half) / sigma);
      return dose * (dark + (1 - dark) * (gap ? 1 - b : b));
    };
    // Prints inside of lines and outside of gaps.
    if (gap ? light(0) >= 1 : light(0) < 1) return 0.0;
    double in = 0, out = 2000;
    for (int k = 0; k < 60; ++k) {
      const double middle = (in + out) / 2;
      ((light(middle) >= 1) != gap ? in : out) = middle;
    }
    return 2 * in;
  });
  const json fit = fitted({"fit-spread", "spread.csv", "--printer", "big.toml"});
  EXPECT_NEAR(fit["parameters"]["sigma_um"]["value"], sigma, 0.02);
  EXPECT_NEAR(fit["parameters"]["dose"]["value"], dose, 0.01);
}

// Light that falls by 30 % from left to right.
TEST_F(TestPartsProgram, FlatFieldGridGivesTheLightBack) {
  good({"testpart", "flat-field", "--printer", "p.toml", "--resin", "r.toml", "-o", "grid.uvj"});
  const auto light = [](double x_px) { return 1 - 0.3 * x_px / kSmallWidth; };
  const double hb = kHaUm / std::log(10);
  fill("grid.csv", "cured_height_um", [&](const Row& r) {
    if (r.at("name") == "row 2 column 2") return std::nan("");
    return hb * std::log(light(number(r, "x_px")) * number(r, "intensity_mw_cm2") *
                         number(r, "exposure_s") / kGel);
  });
  const RunResult made = resinctl(
      {"import", "grid.csv", "--printer", "p.toml", "--name", "evened", "-o", folder_.path()});
  ASSERT_EQ(made.exit_code, 0) << made.err;
  EXPECT_THAT(made.out + made.err, HasSubstr("1 plugs that were not measured"));
  const std::string file = text_of("evened.toml");
  EXPECT_THAT(file, HasSubstr("flat_field_frame = \"plate\""));
  const std::string png = text_of("evened-flat-field.png");
  const Bytes pixels = grey_of_png({png.begin(), png.end()});
  ASSERT_EQ(pixels.size(), 9U);
  for (std::size_t i = 0; i < 9; ++i) {
    const double x = (static_cast<double>(i % 3) + 0.5) / 3 * kSmallWidth;
    const double first = 0.5 / 3 * kSmallWidth;
    // Half of a level, half of a pixel, and the mean of neighbours where one was not measured.
    EXPECT_NEAR(pixels[i] / 255.0, light(x) / light(first), 0.01) << i;
  }
  // Everything goes on with it.
  good({"testpart", "comb", "--printer", "evened.toml", "-o", "comb.uvj"});
}

// A comb, printed as it was corrected, tells what was hidden; what is written prints right.
TEST_F(TestPartsProgram, CombGivesThePrinterBack) {
  good({"testpart", "comb", "--printer", "p.toml", "-o", "comb.uvj"});
  good({"testpart", "staircase", "--printer", "p.toml", "--resin", "r.toml", "-o", "stairs.uvj"});
  const std::string form = text_of("comb.csv");
  const auto fact = [&](const std::string& name) {
    const auto at = form.find("," + name + ",");
    return std::stoi(form.substr(at + name.size() + 2));
  };
  const int x = fact("x_px"), y = fact("y_px");
  const Truth t;
  const auto print = [&](const std::string& stack, const std::string& to) {
    const std::vector<double> edges = edges_um(stack, x, y, t, 1000);
    EXPECT_EQ(edges.size(), 12U) << stack;
    std::size_t at = 0;
    fill(
        "comb.csv", "measured_um",
        [&](const Row&) { return at < edges.size() ? edges[at++] : std::nan(""); }, to);
    double squares = 0;
    std::size_t row = 0;
    fill(
        "comb.csv", "measured_um",
        [&](const Row& r) {
          squares +=
              std::pow(edges[std::min(row++, edges.size() - 1)] - number(r, "designed_um"), 2);
          return std::nan("");
        },
        "unused.csv");
    return std::sqrt(squares / 12);
  };
  const auto correct = [&](const std::string& printer, const std::string& resin,
                           const std::string& to) {
    good({"correct", "comb.uvj", "-o", to, "--printer", printer, "--resin", resin, "--speed-mm-h",
          "1000"});
  };
  correct("p.toml", "r.toml", "print.uvj");
  const double before = print("print.uvj", "measured.csv");
  fill("stairs.csv", "cured_height_um", [&](const Row& r) { return plug_um(r, t); });
  const RunResult r = good({"tune", "measured.csv", "stairs.csv", "--printed", "print.uvj",
                            "--printer", "p.toml", "--resin", "r.toml", "--sigma-um", "1", "-o",
                            "tuned.toml", "--printer-output", "tuned-p.toml"});
  // Same answer by the other name.
  const RunResult other = resinctl({"tune", "measured.csv", "stairs.csv", "--printed", "print.uvj",
                                    "--printer", "p.toml", "--resin", "r.toml", "--sigma-um", "1"});
  EXPECT_EQ(other.out, r.out);
  EXPECT_THAT(r.out, HasSubstr("to measure next"));
  for (const char* kind : {"staircase", "wedge", "comb", "spread", "flat-field", "dead-zone"}) {
    EXPECT_THAT(r.out, HasSubstr(fmt::format("\n  {:10}", kind)));
  }
  correct("tuned-p.toml", "tuned.toml", "again.uvj");
  const double after = print("again.uvj", "measured-2.csv");
  // Levels leave about 1 um (rms of edges), and the prior pulls by a little.
  EXPECT_LT(after, 4) << r.out;
  EXPECT_LT(after, before / 3);
  // The next round starts with the last one's covariance.
  const RunResult next = good({"tune", "measured-2.csv", "--printed", "again.uvj", "--printer",
                               "tuned-p.toml", "--resin", "tuned.toml"});
  EXPECT_THAT(next.out, HasSubstr("known before: what was found by the tuning before"));
  // A table twice says no more than once, whatever it is called.
  std::filesystem::copy_file(folder_ / "stairs.csv", folder_ / "copy.csv");
  bad(2, {"tune", "stairs.csv", "copy.csv", "--printer", "p.toml", "--resin", "r.toml"},
      {"copy.csv: holds the same measurements as stairs.csv"});
  std::string renamed = to_text(read_file(folder_ / "stairs.csv"));
  renamed.replace(renamed.find("cured_height_um\n"), 15, "height");
  std::ofstream(folder_ / "renamed.csv") << renamed;
  bad(2, {"tune", "renamed.csv", "--printer", "p.toml", "--resin", "r.toml"},
      {"renamed.csv: cured_height_um: is no column"});
  // What was counted is not counted again, and files of one tuning go together.
  bad(2, {"tune", "stairs.csv", "--printer", "tuned-p.toml", "--resin", "tuned.toml"},
      {"slicecorr: stairs.csv: was counted before", "tuned.toml"});
  bad(2,
      {"correct", "comb.uvj", "-o", "half.uvj", "--printer", "tuned-p.toml", "--resin", "r.toml",
       "--speed-mm-h", "1000"},
      {"tuned-p.toml", "tuned_from_resin", "the file from before"});
}

TEST_F(TestPartsProgram, NothingMeasuredTellsWhatToMeasureFirst) {
  const RunResult r = good({"tune", "--printer", "p.toml", "--resin", "r.toml"});
  EXPECT_THAT(r.out, HasSubstr("to measure next"));
  bad(2, {"tune", "--printer", "p.toml", "--resin", "r.toml", "-o", "t.toml"},
      {"nothing was measured"});
}

TEST_F(TestPartsProgram, WhatDoesNotBelongIsRefused) {
  good({"testpart", "staircase", "--printer", "p.toml", "--resin", "r.toml", "-o", "stairs.uvj"});
  good({"testpart", "comb", "--printer", "p.toml", "-o", "comb.uvj"});
  good({"testpart", "dead-zone", "--printer", "p.toml", "--uv-mw-cm2", "200", "-o", "zones.uvj"});
  const Truth t;
  const Command with = {"--printer", "p.toml", "--resin", "r.toml"};
  // Not filled in, of another part, of another kind.
  bad(2, Command{"tune", "stairs.csv"} + with, {"nothing was measured"});
  bad(2, Command{"tune", "comb.csv"} + with, {"comb.csv", "--printed"});
  bad(2, Command{"tune", "comb.csv", "--printed", "comb.uvj"} + with, {"no corrected stack"});
  bad(2, Command{"tune", "zones.csv"} + with, {"'dead-zone'", "resinctl fit"});
  std::string text = text_of("stairs.csv");
  text.replace(text.find("plug 1-1,100"), 12, "plug 1-1,110");
  write("moved.csv", text);
  bad(2, Command{"tune", "moved.csv"} + with, {"moved.csv", "another part"});
  write("own.csv", "intensity_mw_cm2,exposure_s,cured_height_um\n100,2,900\n");
  bad(2, Command{"tune", "own.csv"} + with, {"own.csv", "slicecorr testpart"});
  // Other programs say whose table it is.
  EXPECT_THAT(resinctl({"fit", "comb.csv", "--model", "jacobs"}).err, HasSubstr("slicecorr tune"));
  EXPECT_THAT(resinctl({"fit-spread", "stairs.csv", "--printer", "p.toml"}).err,
              HasSubstr("slicecorr tune or resinctl fit"));
  EXPECT_THAT(resinctl({"import", "zones.csv", "--format", "flat-field", "--printer", "p.toml",
                        "--dry-run"})
                  .err,
              HasSubstr("deadzone-steady"));
  // In mm; two swapped.
  fill(
      "stairs.csv", "cured_height_um", [&](const Row& r) { return 1e-3 * plug_um(r, t); },
      "mm.csv");
  bad(2, Command{"tune", "mm.csv"} + with, {"mm.csv", "lengths in um"});
  int row = 0;
  fill(
      "stairs.csv", "cured_height_um",
      [&](const Row& r) {
        ++row;
        Row other = r;
        if (row == 2) other["shown_s"] = fmt::format("{}", 3 * number(r, "shown_s"));
        return plug_um(other, t);
      },
      "swapped.csv");
  bad(2, Command{"tune", "swapped.csv"} + with, {"plug 1-2", "swapped"});
  // Far from what was known.
  Truth far;
  far.light = 0.7;
  fill(
      "stairs.csv", "cured_height_um", [&](const Row& r) { return plug_um(r, far); }, "far.csv");
  EXPECT_THAT(good(Command{"tune", "far.csv"} + with).out,
              HasSubstr("standard deviations from what was known"));
  // Whoever can't reach resinctl is told.
  bad(2, Command{"tune", "far.csv", "-o", "r.toml"} + with, {"r.toml"});
  EXPECT_THAT(call({"tune", "--help"}).out, HasSubstr("--printer-output"));
  EXPECT_THAT(call({"--help"}).out, HasSubstr("tune"));
  // Options may come before the command, too.
  EXPECT_EQ(call(Command{"--quiet", "tune", "far.csv", "-o", "t.toml"} + with).err, "");
}

// Combs that are corrected for several critical doses, printed on a resin that gels at another dose than its file
// says, by sums of our own: the dose with which edges print as designed comes back, and goes into the resin's file.
TEST_F(TestPartsProgram, DoseCombsTellTheDoseToAimAt) {
  constexpr int wide = 620;
  write("wide.toml",
        fmt::format(
            "name = \"wide\"\n[display]\nwidth_px = {}\nheight_px = 120\npixel_um = 50\n[blue]\n"
            "calibration = [[0, 1.0], [255, 100.0]]\n[stage]\nmax_speed_mm_h = 2000\n",
            wide));
  const RunResult made = good({"testpart", "dose-combs", "--printer", "wide.toml", "--resin",
                               "r.toml", "--speed-mm-h", "400", "-o", "combs.uvj"});
  EXPECT_THAT(made.err + made.out, HasSubstr("8 combs for 1 to 8 times the gel dose"));
  EXPECT_THAT(text_of("combs.html"), HasSubstr("400 mm/h"));
  EXPECT_THAT(text_of("combs.html"), HasSubstr("slicecorr tune combs.csv"));
  std::map<std::string, Bytes> sorted;
  for (const auto& [name, data] : unzip(folder_ / "combs.uvj")) {
    if (name.starts_with("slice/")) sorted[name] = grey_of_png(data);
  }
  std::vector<Bytes> all;
  for (const auto& [name, pixels] : sorted) all.push_back(pixels);
  ASSERT_GT(all.size(), 108U);
  ASSERT_EQ(all.front().size(), wide * 120U);
  // Columns of a tooth in each comb: from the left in the upper row, then in the lower one. Combs are 90 pixels wide and
  // 40 high, their teeth the right two thirds.
  std::vector<std::pair<int, int>> columns;
  const Bytes& tooth = all[25];
  for (int y = 0; y < 120; ++y) {
    for (int x = 0; x < wide; ++x) {
      const auto lit = [&](int u, int v) {
        return u >= 0 && v >= 0 && tooth[static_cast<std::size_t>(v * wide + u)] > 0;
      };
      if (lit(x, y) && !lit(x - 1, y) && !lit(x, y - 1)) columns.emplace_back(x + 70, y + 20);
    }
  }
  ASSERT_EQ(columns.size(), 8U);
  const std::vector<double> factors = {1, 1.5, 2, 3, 4, 5, 6.5, 8};
  const auto print = [&](const Truth& t, const std::string& to) {
    std::vector<std::vector<double>> edges;
    for (const auto& column : columns) edges.push_back(edges_um(all, wide, column, t, 400));
    fill(
        "combs.csv", "measured_um",
        [&](const Row& r) {
          const auto comb = std::find(factors.begin(), factors.end(), number(r, "dose_factor"));
          EXPECT_NE(comb, factors.end());
          // Teeth begin and end in turn, and are known by where they are to be: gaps are 600 um and more.
          const auto& found = edges.at(static_cast<std::size_t>(comb - factors.begin()));
          const double designed = number(r, "designed_um");
          double best = NAN;
          for (std::size_t k = r.at("kind") == "upper" ? 0 : 1; k < found.size(); k += 2) {
            const double off = std::abs(found[k] - designed);
            if (off < 450 && !(off > std::abs(best - designed))) best = found[k];
          }
          return best;
        },
        to);
  };
  // Between the combs of 2 and 3 times the growth of teeth is nearly straight in the logarithm: an eighth of that step.
  const double near = std::log(3.0 / 2) / 8;
  Truth t;
  t.ha_um = kHaUm;
  t.stray_mw_cm2 = 0;
  t.light = 1;
  t.gel_areal = 2.6 * kGel;
  print(t, "first.csv");
  const RunResult r =
      good({"tune", "first.csv", "--printer", "wide.toml", "--resin", "r.toml", "-o", "new.toml"});
  EXPECT_THAT(r.out, HasSubstr("edges print as designed at "));
  const auto dose_factor = [&](const std::string& file) {
    const std::string text = text_of(file);
    return std::stod(text.substr(text.find("dose_factor = ") + 14));
  };
  EXPECT_NEAR(std::log(dose_factor("new.toml")), std::log(2.6), near) << r.out;
  EXPECT_THAT(r.out, HasSubstr("the line between two combs adds up to 5.1 %"));
  // The same places from another zero.
  fill(
      "first.csv", "measured_um",
      [](const Row& row) {
        return row.at("measured_um").empty() ? NAN : number(row, "measured_um") + 300;
      },
      "off.csv");
  const RunResult off =
      call({"tune", "off.csv", "--printer", "wide.toml", "--resin", "r.toml", "-o", "no.toml"});
  EXPECT_EQ(off.exit_code, 2);
  EXPECT_THAT(off.err, HasSubstr("um later than designed in the mean"));
  // Less light than the printer's file says is the same as a resin that needs more.
  t.light = 0.8;
  print(t, "second.csv");
  good({"tune", "second.csv", "--printer", "wide.toml", "--resin", "r.toml", "-o", "other.toml"});
  EXPECT_NEAR(std::log(dose_factor("other.toml")), std::log(2.6 / 0.8), near);
  // A resin that gels sooner than all combs think: said, with the side on which it lies.
  t.gel_areal = 0.97 * 0.8 * kGel;
  print(t, "third.csv");
  const RunResult less =
      call({"tune", "third.csv", "--printer", "wide.toml", "--resin", "r.toml", "-o", "no.toml"});
  EXPECT_EQ(less.exit_code, 2);
  EXPECT_THAT(less.err, HasSubstr("below it"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "no.toml"));
  // The empty table, and what combs need.
  EXPECT_THAT(call({"tune", "combs.csv", "--printer", "wide.toml", "--resin", "r.toml"}).err,
              HasSubstr("0 combs"));
  EXPECT_THAT(call({"tune", "nothing.csv", "--printer", "wide.toml", "--resin", "r.toml"}).err,
              HasSubstr("nothing.csv: is not there"));
  const RunResult no_speed = call(
      {"testpart", "dose-combs", "--printer", "wide.toml", "--resin", "r.toml", "-o", "x.uvj"});
  EXPECT_EQ(no_speed.exit_code, 2);
  EXPECT_THAT(no_speed.err, HasSubstr("--speed-mm-h"));
  const RunResult fast = call({"testpart", "dose-combs", "--printer", "wide.toml", "--resin",
                               "r.toml", "--speed-mm-h", "2000", "-o", "fast.uvj"});
  EXPECT_EQ(fast.exit_code, 0) << fast.err;
  EXPECT_THAT(fast.err, HasSubstr("no comb for 4 times the gel dose"));
}

// Teeth of few and of many layers, printed lift by lift by sums of our own: the share of resin that each
// lift exchanges comes back, and goes into the printer's file.
TEST_F(TestPartsProgram, LiftCombTellsTheExchange) {
  write("thin.toml",
        "name = \"thin\"\n[cure]\nabsorbance_height_um = 200\nabsorbance_base = 10\n"
        "gel_dose_mj_cm2 = 10\n");
  good({"testpart", "lift-comb", "--printer", "p.toml", "-o", "lifts.uvj"});
  EXPECT_THAT(text_of("lifts.html"), HasSubstr("layer by layer"));
  const std::string form = text_of("lifts.csv");
  const auto fact = [&](const std::string& name) {
    const auto at = form.find("," + name + ",");
    return std::stoi(form.substr(at + name.size() + 2));
  };
  const int x = fact("x_px"), y = fact("y_px");
  good({"correct", "lifts.uvj", "-o", "print.uvj", "--printer", "p.toml", "--resin", "thin.toml",
        "--mode", "layerwise", "--exposure-s", "0.6", "--lift-exchange", "0"});
  constexpr double exchange = 0.3, ha_um = 200 * 1.04;
  std::vector<double> phi;
  for (const Bytes& image : images("print.uvj")) {
    const int level = image[static_cast<std::size_t>(y * kSmallWidth + x)];
    phi.push_back((1 + 99 * level / 255.0) * 0.6 / 10);
  }
  const auto gels = [&](double z_um) {
    double dose = 0;
    for (auto n = static_cast<std::size_t>(z_um / 50); n < phi.size(); ++n) {
      const double deep_um = 50.0 * static_cast<double>(n + 1) - z_um;
      dose = (1 - exchange) * dose + phi[n] * std::pow(10, -deep_um / ha_um);
      if (dose >= 1) return true;
    }
    return false;
  };
  double end_um = 0;
  fill(
      "lifts.csv", "measured_um",
      [&](const Row& r) {
        const double designed_um = number(r, "designed_um");
        if (r.at("kind") == "lower") return designed_um;
        // From just above the next end towards the platform; teeth are 1, 2, 4 ... layers high.
        const int tooth = std::stoi(r.at("name").substr(6));
        end_um = designed_um + 50.0 * (1 << (tooth - 1));
        double z = end_um - 0.01;
        while (z > 0 && gels(z)) z -= 0.01;
        return z;
      },
      "measured.csv");
  const RunResult r = good({"tune", "measured.csv", "--printed", "print.uvj", "--printer", "p.toml",
                            "--resin", "thin.toml", "--sigma-um", "2", "-o", "tuned.toml"});
  EXPECT_THAT(r.out, HasSubstr("exchanged at a lift, share"));
  EXPECT_THAT(r.out, HasSubstr(fmt::format("\n  {:10}", "lift-comb")));
  const std::string printer = text_of("tuned-printer.toml");
  const auto at = printer.find("lift_exchange = ");
  ASSERT_NE(at, printer.npos) << printer;
  EXPECT_NEAR(std::stod(printer.substr(at + 16)), exchange, 0.03) << r.out;
  const std::string resin = text_of("tuned.toml");
  EXPECT_NEAR(std::stod(resin.substr(resin.find("absorbance_height_um = ") + 23)), ha_um, 4)
      << r.out;
  // The next round corrects for what was found.
  good({"correct", "lifts.uvj", "-o", "again.uvj", "--printer", "tuned-printer.toml", "--resin",
        "tuned.toml", "--mode", "layerwise", "--exposure-s", "0.6"});
  bad(2, {"tune", "measured.csv", "--printer", "p.toml", "--resin", "thin.toml"}, {"--printed"});
}

}  // namespace
}  // namespace slicecorr::test
