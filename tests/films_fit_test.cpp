// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Films that were measured: what they tell of a printer and a resin, and tables that tell nothing.
#include "slicecorr/resins/films_fit.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <set>

#include "films_lab.hpp"
#include "refusal.hpp"
#include "rounds.hpp"
#include "slicecorr/films_part.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/measuring_form.hpp"
#include "slicecorr/uncertainty.hpp"
#include "slicecorr/units.hpp"
#include "slicecorr/unmeasured_light.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::resins {
namespace {

using test::refusal;
using testing::AllOf;
using testing::Contains;
using testing::HasSubstr;
using testing::Not;

Printer dark() { return parse_display(test::kUnlitPrinter, "dark.toml"); }

FilmReadings films(const std::vector<std::array<double, 3>>& rows) {
  FilmReadings all;
  all.source = "films.csv";
  int line = 1;
  for (const auto& [level, s, um] : rows) {
    all.films.push_back({++line, static_cast<int>(level), s, um});
  }
  return all;
}

/// Check values: ha 150 um, t_c 0.8 s, level 128 with 0.2176 of the light.
FilmReadings known_films() {
  return films(
      {{255, 2, 59.69}, {255, 4, 104.85}, {255, 8, 150}, {255, 16, 195.15}, {128, 16, 95.80}});
}

// ---- fits -------------------------------------------------------------------------------------

TEST(FilmsFit, KnownFilmsGiveBackWhatTheyAreMadeOf) {
  const FilmsFit fit = fit_films(known_films(), dark());
  // Two decimals of a film: half of the last is 0.005 um, and ha is their slope over 0.9 decades.
  EXPECT_NEAR(fit.absorbance_height_um.value, 150, 0.02);
  EXPECT_NEAR(fit.gel_s.value, 0.8, 2e-4);
  ASSERT_EQ(fit.light.size(), 2u);
  EXPECT_EQ(fit.light[0].level, 128);
  EXPECT_NEAR(fit.light[0].share.value, 0.2176, 5e-5);
  EXPECT_EQ(fit.light[1].level, 255);
  EXPECT_EQ(fit.light[1].share.value, 1);
  EXPECT_EQ(fit.light[1].share.ci95, (std::array<double, 2>{1, 1}));
  for (const FilmFigure& f : {fit.absorbance_height_um, fit.gel_s, fit.light[0].share}) {
    EXPECT_LE(f.ci95[0], f.value);
    EXPECT_GE(f.ci95[1], f.value);
    EXPECT_LT(f.ci95[1] - f.ci95[0], 1e-3 * f.value);
  }
  EXPECT_THAT(fit.measure_next, Contains(HasSubstr("level 128 at a second time")));
  EXPECT_EQ(fit.used, 5);
  EXPECT_EQ(fit.freedom, 2);
}

/// The least sum of squares by trying all ways in which neighbours are as bright as each other, each by
/// normal equations: what is convex has one minimum.
struct Brute {
  double cost = std::numeric_limits<double>::infinity(), ha = 0, gel_s = 0;
  std::map<int, double> share;
};

std::vector<double> solved(std::vector<std::vector<double>> m) {
  const std::size_t n = m.size();
  for (std::size_t i = 0; i < n; ++i) {
    std::size_t best = i;
    for (std::size_t k = i; k < n; ++k) {
      if (std::abs(m[k][i]) > std::abs(m[best][i])) best = k;
    }
    std::swap(m[i], m[best]);
    for (std::size_t k = 0; k < n; ++k) {
      if (k == i) continue;
      const double by = m[k][i] / m[i][i];
      for (std::size_t c = i; c <= n; ++c) m[k][c] -= by * m[i][c];
    }
  }
  std::vector<double> x;
  for (std::size_t i = 0; i < n; ++i) x.push_back(m[i][n] / m[i][i]);
  return x;
}

Brute by_trying(const FilmReadings& r) {
  std::set<int> measured;
  for (const FilmReading& f : r.films) measured.insert(f.level);
  const std::vector<int> levels(measured.rbegin(), measured.rend());
  Brute best;
  for (unsigned ties = 0; ties < 1u << (levels.size() - 1); ++ties) {
    // Group of each level: it is as bright as the one above where its bit is set.
    std::map<int, std::size_t> group;
    std::size_t groups = 0;
    for (std::size_t k = 0; k < levels.size(); ++k) {
      if (k > 0 && !(ties >> (k - 1) & 1u)) ++groups;
      group[levels[k]] = groups;
    }
    const std::size_t n = groups + 2;
    std::vector<std::vector<double>> m(n, std::vector<double>(n + 1, 0.0));
    const auto row = [&](const FilmReading& f) {
      std::vector<double> x(n, 0.0);
      x[0] = std::log10(f.exposure_s);
      x[1 + group[f.level]] = 1;
      return x;
    };
    for (const FilmReading& f : r.films) {
      const auto x = row(f);
      for (std::size_t i = 0; i < n; ++i) {
        for (std::size_t k = 0; k < n; ++k) m[i][k] += x[i] * x[k];
        m[i][n] += x[i] * f.thickness_um;
      }
    }
    const std::vector<double> x = solved(m);
    bool falls = false;
    for (std::size_t g = 1; g <= groups; ++g) falls = falls || x[1 + g] > x[g];
    double cost = 0;
    for (const FilmReading& f : r.films) {
      double left = f.thickness_um;
      const auto a = row(f);
      for (std::size_t i = 0; i < n; ++i) left -= a[i] * x[i];
      cost += left * left;
    }
    if (falls || cost >= best.cost) continue;
    best.cost = cost;
    best.ha = x[0];
    best.gel_s = std::pow(10, -x[1] / x[0]);
    best.share.clear();
    for (const int level : levels) {
      best.share[level] = std::pow(10, (x[1 + group[level]] - x[1]) / x[0]);
    }
  }
  return best;
}

// Whatever calipers read, the fit is the least sum of squares among all curves that never fall.
TEST(FilmsFit, RandomFilmsHaveTheLeastSumOfSquares) {
  std::mt19937 random(11);
  int joined = 0;
  for (int round = 0; round < test::rounds(60); ++round) {
    SCOPED_TRACE(round);
    const auto hidden = test::HiddenPrinter::random(random);
    FilmReadings r;
    r.source = "films.csv";
    int line = 1;
    for (const int level : {255, 240, 225, 210, 190}) {
      for (const double s : {4.0, 16.0, 40.0}) {
        const double um =
            hidden.film_um(level, s) + std::uniform_real_distribution(-15., 15.)(random);
        if (um > 5) r.films.push_back({++line, level, s, um});
      }
    }
    const FilmsFit fit = fit_films(r, dark());
    FilmReadings kept = r;
    kept.films.clear();
    for (const FilmResidual& f : fit.residuals) {
      if (!f.left_out) kept.films.push_back(f.film);
    }
    const Brute brute = by_trying(kept);
    EXPECT_NEAR(fit.absorbance_height_um.value, brute.ha, 1e-6 * brute.ha);
    EXPECT_NEAR(fit.gel_s.value, brute.gel_s, 1e-5 * brute.gel_s);
    for (const FilmLevel& l : fit.light) {
      EXPECT_NEAR(l.share.value, brute.share.at(l.level), 1e-5);
      joined += l.joined;
    }
    EXPECT_NEAR(fit.rms_um * fit.rms_um * fit.used, brute.cost, 1e-6 * brute.cost);
  }
  EXPECT_GT(joined, 5);
}

// 95 % intervals hold the truth in about 95 % of labs whose scatter is normal; by the number of labs the
// share that is seen scatters by sqrt(0.95 * 0.05 / labs), of which four are taken.
TEST(FilmsFit, IntervalsHoldTheTruth) {
  std::mt19937 random(5);
  const int labs = test::rounds(150);
  int ha = 0, gel = 0, share = 0, shares = 0;
  for (int lab = 0; lab < labs; ++lab) {
    test::HiddenPrinter hidden = test::HiddenPrinter::random(random);
    FilmReadings r;
    r.source = "films.csv";
    int line = 1;
    // Levels far apart, so that none is joined with its neighbour: there intervals are one-sided.
    for (const int level : {255, 180, 120}) {
      for (const double s : {4.0, 8.0, 16.0, 32.0, 64.0}) {
        const double um = hidden.film_um(level, s);
        if (um > 20) {
          r.films.push_back({++line, level, s, um + std::normal_distribution(0., 4.)(random)});
        }
      }
    }
    const FilmsFit fit = fit_films(r, dark());
    const auto holds = [](const FilmFigure& f, double truth) {
      return truth >= f.ci95[0] && truth <= f.ci95[1];
    };
    ha += holds(fit.absorbance_height_um, hidden.ha_um);
    gel += holds(fit.gel_s, hidden.gel_s);
    for (const FilmLevel& l : fit.light) {
      if (l.level == 255) continue;
      ++shares;
      share += holds(l.share, hidden.share[static_cast<std::size_t>(l.level)]);
    }
  }
  const auto least = [](int n) { return 0.95 - 4 * std::sqrt(0.95 * 0.05 / n); };
  EXPECT_GT(ha, least(labs) * labs);
  EXPECT_GT(gel, least(labs) * labs);
  EXPECT_GT(share, least(labs) * shares);
  EXPECT_LT(ha, labs);
}

TEST(FilmsFit, OutliersAreNamedAndLeftOut) {
  FilmReadings r = known_films();
  for (const double s : {2.0, 4.0, 8.0, 16.0}) {
    r.films.push_back({100 + static_cast<int>(s), 255, s, 150 * std::log10(s / 0.8) + 0.3});
  }
  // Squares that were mixed up.
  r.films[1].thickness_um = 195;
  const FilmsFit fit = fit_films(r, dark());
  EXPECT_NEAR(fit.absorbance_height_um.value, 150, 1);
  EXPECT_THAT(fit.warnings,
              Contains(AllOf(HasSubstr("line 3"), HasSubstr("195 um"), HasSubstr("left out"))));
  EXPECT_EQ(fit.used, 8);
}

// Two that were mixed up hide each other: none is an outlier, and the whole is told not to go together.
TEST(FilmsFit, FilmsThatContradictEachOtherAreTold) {
  std::vector<std::array<double, 3>> rows;
  for (const double s : {2.0, 4.0, 8.0, 16.0, 32.0, 32.0, 32.0, 32.0}) {
    rows.push_back({255, s, 150 * std::log10(s / 0.8)});
  }
  EXPECT_THAT(fit_films(films(rows), dark()).warnings,
              testing::Not(Contains(HasSubstr("contradict"))));
  std::swap(rows[1][2], rows[3][2]);
  EXPECT_THAT(fit_films(films(rows), dark()).warnings,
              Contains(AllOf(HasSubstr("contradict each other"), HasSubstr("level 255"))));
}

TEST(FilmsFit, SaysWhatToMeasureNext) {
  const auto next = [](const std::vector<std::array<double, 3>>& rows) {
    return fit_films(films(rows), dark()).measure_next;
  };
  EXPECT_THAT(next({{255, 2, 60}, {255, 16, 195}}),
              AllOf(Contains(HasSubstr("any squares again")), Contains(HasSubstr("grey levels"))));
  EXPECT_THAT(next({{255, 8, 150}, {255, 16, 195}, {128, 8, 50}, {128, 16, 96}}),
              AllOf(Contains(HasSubstr("factor of 4")), Contains(HasSubstr("level 191"))));
  EXPECT_THAT(next({{255, 16, 195}, {128, 8, 50}, {128, 16, 96}, {128, 32, 141}}),
              Contains(HasSubstr("at a second time, 4 s, say")));
  EXPECT_THAT(next({{255, 2, 60}, {255, 8, 130}, {255, 16, 215}, {220, 8, 130}, {220, 16, 150}}),
              Contains(HasSubstr("level 220 again")));
}

TEST(FilmsFit, WhatLeavesSomethingOpenIsRefused) {
  const auto refused = [](const std::vector<std::array<double, 3>>& rows) {
    return refusal([&] { fit_films(films(rows), dark()); });
  };
  EXPECT_THAT(refused({}), HasSubstr("no thickness was measured"));
  EXPECT_THAT(refused({{255, 2, 60}}),
              AllOf(HasSubstr("films.csv: line 2"), HasSubstr("only film")));
  EXPECT_THAT(refused({{255, 8, 150}, {255, 8, 151}, {128, 8, 50}}),
              AllOf(HasSubstr("no level has films of two times"), HasSubstr("2 s and 8 s")));
  EXPECT_THAT(refused({{128, 8, 50}, {128, 16, 96}}), HasSubstr("brightest level, 255"));
  EXPECT_THAT(refused({{255, 2, 195}, {255, 4, 150}, {255, 8, 105}, {255, 16, 60}}),
              HasSubstr("do not grow"));
  EXPECT_THAT(refused({{255, 2, 120}, {255, 4, 120}, {255, 8, 120}, {255, 16, 120}}),
              HasSubstr("do not grow"));
}

// ---- tables -----------------------------------------------------------------------------------

class FilmTables : public testing::Test {
 protected:
  std::string refused(const std::string& text) const {
    test::write_file(folder_ / "films.csv", test::to_bytes(text));
    return refusal([&] { fit_films(read_films(folder_ / "films.csv", dark()), dark()); });
  }
  FilmReadings read(const std::string& text) const {
    test::write_file(folder_ / "films.csv", test::to_bytes(text));
    return read_films(folder_ / "films.csv", dark());
  }
  test::TemporaryFolder folder_;
};

TEST_F(FilmTables, AreReadInAnyOrderOfColumns) {
  const FilmReadings r = read(
      "# by hand\nthickness_um,level,square,exposure_s\n60,255,1,2\n,255,2,4\n# lost\n195,255,3,16\n");
  ASSERT_EQ(r.films.size(), 2u);
  EXPECT_EQ(r.films[1].line, 6);
  EXPECT_EQ(r.films[1].thickness_um, 195);
  EXPECT_EQ(r.not_measured, 1);
  EXPECT_THAT(fit_films(r, dark()).warnings, Contains(HasSubstr("1 square was not measured")));
}

TEST_F(FilmTables, BadOnesAreRefusedByFileAndLine) {
  const std::string head = "level,exposure_s,thickness_um\n";
  const auto line_3 = [&](const std::string& row) {
    const std::string words = refused(head + "255,2,60\n" + row + "\n255,16,195\n");
    EXPECT_THAT(words, AllOf(HasSubstr("films.csv"), HasSubstr("line 3"))) << row;
    return words;
  };
  EXPECT_THAT(refused(""), HasSubstr("empty"));
  EXPECT_THAT(refused("# nothing\n"), HasSubstr("empty"));
  EXPECT_THAT(refused(head), HasSubstr("no films"));
  EXPECT_THAT(refused(head + "255,2,60\n"), HasSubstr("line 2"));
  EXPECT_THAT(refused(head + "255,2,\n255,16,\n"), HasSubstr("no thickness was measured of 2"));
  EXPECT_THAT(refused("level,exposure_s\n255,2\n"),
              AllOf(HasSubstr("line 1"), HasSubstr("no column thickness_um")));
  EXPECT_THAT(refused("level,exposure_s,thickness_mm\n255,2,0.06\n"), HasSubstr("thickness_mm"));
  // In thousandths of an inch.
  EXPECT_THAT(refused(head + "255,2,2.4\n255,4,4.1\n255,16,7.7\n"),
              AllOf(HasSubstr("line 4"), HasSubstr("7.7 um thick"), HasSubstr("30 um")));
  EXPECT_THAT(refused("255,2,60\n255,16,195\n"), HasSubstr("line 1"));
  EXPECT_THAT(line_3("255,4,0"), HasSubstr("thickness_um is '0'"));
  EXPECT_THAT(line_3("255,4,-105"), HasSubstr("thickness_um is '-105'"));
  // Millimetres.
  EXPECT_THAT(line_3("255,4,0.105"), HasSubstr("from 1 to 5000"));
  EXPECT_THAT(line_3("255,4,thick"), HasSubstr("'thick'"));
  EXPECT_THAT(line_3("255,4,nan"), HasSubstr("'nan'"));
  EXPECT_THAT(line_3("255,0,105"), HasSubstr("exposure_s is '0'"));
  EXPECT_THAT(line_3("255,,105"), HasSubstr("exposure_s is ''"));
  EXPECT_THAT(line_3("256,4,105"), HasSubstr("from 0 to 255"));
  EXPECT_THAT(line_3("-1,4,105"), HasSubstr("from 0 to 255"));
  EXPECT_THAT(line_3("127.5,4,105"), HasSubstr("whole number"));
  line_3("255,4");
  line_3("255,4,105,9");
}

TEST_F(FilmTables, OfMoreRowsThanAVatHoldsAreRefusedWhileTheyAreRead) {
  {
    std::ofstream out(folder_ / "films.csv");
    out << "level,exposure_s,thickness_um\n";
    for (int i = 0; i < 100002; ++i) out << "255,2,60\n";
  }
  EXPECT_THAT(refusal([&] { read_films(folder_ / "films.csv", dark()); }),
              AllOf(HasSubstr("line 100002"), HasSubstr("at most 100000")));
}

TEST_F(FilmTables, FormsAreOfThisPrinter) {
  FileGreys greys;
  for (std::size_t i = 0; i < greys.size(); ++i) greys[i] = static_cast<std::uint8_t>(i);
  const FilmsPart part(dark(), greys, {});
  MeasuringForm form = part.form();
  for (std::size_t i = 0; i < form.rows.size(); ++i) {
    const double um = 150 * std::log10(std::pow(part.squares()[i].level / 255.0, 2.2) *
                                       part.exposure_s(part.squares()[i]) / 0.8);
    if (um > 20) form.rows[i].push_back(fmt::format("{:.0f}", um));
  }
  const std::string text = form_text(form);
  const FilmReadings r = read(text);
  EXPECT_GT(r.films.size(), 15u);
  const FilmsFit fit = fit_films(r, dark());
  EXPECT_NEAR(fit.absorbance_height_um.value, 150, 1.5);
  EXPECT_EQ(fit.light.back().level, 255);
  Printer other = dark();
  other.width_px = 800;
  EXPECT_THAT(refusal([&] { read_films(folder_ / "films.csv", other); }),
              AllOf(HasSubstr("width_px"), HasSubstr("1600"), HasSubstr("800")));
  std::string moved = text;
  moved.replace(moved.find("\n2,229,"), 7, "\n2,228,");
  EXPECT_THAT(refused(moved), HasSubstr("hash"));
  form.part = "comb";
  EXPECT_THAT(refused(form_text(form)), HasSubstr("slicecorr tune"));
}

// ---- files ------------------------------------------------------------------------------------

TEST(FilmsFiles, SayTheUnitAndAreReadBack) {
  const FilmsFit fit = fit_films(known_films(), dark());
  const std::string text = printer_with_films(test::kUnlitPrinter, "dark.toml", "mine", fit, 0);
  EXPECT_THAT(text,
              AllOf(HasSubstr("unit = \"of the brightest level\""), HasSubstr("name = \"mine\""),
                    HasSubstr("travel_mm = 100"), Not(HasSubstr("to be measured"))));
  const Printer printer = parse_printer(text, "mine.toml");
  EXPECT_EQ(printer.unit, LightUnit::brightest);
  ASSERT_EQ(printer.calibration.size(), 3u);
  EXPECT_EQ(printer.calibration[0], (CalibrationPoint{0, 0}));
  EXPECT_NEAR(printer.calibration[1].intensity_mw_cm2, 0.2176, 5e-5);
  EXPECT_EQ(printer.calibration[2], (CalibrationPoint{255, 1}));
  const Resin resin = parse_resin(resin_of_films("r", dark(), fit, 0), "r.toml");
  EXPECT_EQ(resin.unit, LightUnit::brightest);
  EXPECT_NEAR(critical_dose_s(resin), 0.8, 2e-4);
  EXPECT_NEAR(resin.absorbance_height10_um, 150, 0.02);
  EXPECT_EQ(resin.wavelength_nm, 405);
  EXPECT_EQ(resin.dose_factor, 1);
}

// How sure a print is follows from the films: what other films of the same lab say of height and seconds
// scatters as the file's covariance says, together, too. A variance of n labs is known to sqrt(2 / n) of
// itself, a covariance not better; of each four times that is taken, and a tenth more because ln t_c is
// linear only near by.
TEST(FilmsFiles, TheCovarianceIsThatOfManyLabs) {
  std::mt19937 random(6);
  const int labs = test::rounds(400);
  double hh = 0, hs = 0, ss = 0, said_hh = 0, said_hs = 0, said_ss = 0;
  for (int lab = 0; lab < labs; ++lab) {
    FilmReadings r;
    int line = 1;
    for (const double s : {2., 4., 8., 16., 32., 2., 4., 8., 16., 32.}) {
      r.films.push_back(
          {++line, 255, s, 150 * std::log10(s / 0.8) + std::normal_distribution(0., 3.)(random)});
    }
    const FilmsFit fit = fit_films(r, dark());
    const Resin resin = parse_resin(resin_of_films("r", dark(), fit, 0), "r.toml");
    const Uncertainty u = parse_uncertainty("fit", ExposureMode::layerwise, 1,
                                            {resin_of_films("r", dark(), fit, 0), "r.toml"});
    using enum UncertainInput;
    const double h = resin.absorbance_height10_um / 150 - 1, s = critical_dose_s(resin) / 0.8 - 1;
    hh += h * h;
    hs += h * s;
    ss += s * s;
    said_hh += u.variance(ha, ha);
    said_hs += u.variance(ha, dc);
    said_ss += u.variance(dc, dc);
  }
  const double to = 4 * std::sqrt(2.0 / labs) + 0.1;
  EXPECT_NEAR(hh / said_hh, 1, to);
  EXPECT_NEAR(hs / said_hs, 1, to);
  EXPECT_NEAR(ss / said_ss, 1, to);
}

TEST(FilmsFiles, AReadingOfFullLightFixesTheUnit) {
  const FilmsFit fit = fit_films(known_films(), dark());
  const Printer printer = parse_printer(
      printer_with_films(test::kUnlitPrinter, "dark.toml", "mine", fit, 4.5), "mine.toml");
  EXPECT_EQ(printer.unit, LightUnit::mw_cm2);
  EXPECT_NEAR(printer.calibration[1].intensity_mw_cm2, 4.5 * 0.2176, 3e-4);
  EXPECT_EQ(printer.calibration[2].intensity_mw_cm2, 4.5);
  const Resin resin = parse_resin(resin_of_films("r", dark(), fit, 4.5), "r.toml");
  EXPECT_EQ(resin.unit, LightUnit::mw_cm2);
  EXPECT_NEAR(units::areal_from_volumetric(resin.critical_dose_mj_cm3, dose_height_e_um(resin)),
              4.5 * 0.8, 1e-3);
}

TEST(FilmsFiles, WithoutGreyTheDisplayIsOneOfBlackAndWhite) {
  const FilmsFit fit = fit_films(films({{255, 2, 60}, {255, 16, 195}}), dark());
  EXPECT_TRUE(std::isnan(fit.gel_s.ci95[0]));
  EXPECT_THAT(fit.to_json(), HasSubstr("\"ci95\": null"));
  const Printer printer = parse_printer(
      printer_with_films(test::kUnlitPrinter, "dark.toml", "mine", fit, 0), "mine.toml");
  EXPECT_EQ(printer.bit_depth, 1);
  EXPECT_EQ(printer.calibration, (std::vector<CalibrationPoint>{{0, 0}, {1, 1}}));
}

}  // namespace
}  // namespace slicecorr::resins
