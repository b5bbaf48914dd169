// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Pictures of fits and resins: what stands where in them, that they are sound XML with finite
// numbers and the same bytes each time, and how they look in a browser.
#include "slicecorr/resins/plots.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <random>
#include <regex>

#include "devtools.hpp"
#include "resins_text.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::resins {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

/// Heights of a kinetic resin at three intensities, three replicates each, with scatter.
Measurements heights(double m, double scatter_um) {
  std::mt19937 random(3);
  std::normal_distribution<double> scatter(0, scatter_um);
  std::string csv = "intensity_mw_cm2,exposure_s,cured_height_um\n";
  for (const double blue : {5.0, 20.0, 80.0}) {
    for (const double time : {8.0, 16.0, 32.0, 64.0}) {
      for (int i = 0; i < 3; ++i) {
        const double z = 240 / m * std::log(std::pow(blue, m) * time / 12) + scatter(random);
        csv += std::to_string(blue) + "," + std::to_string(time) + "," + std::to_string(z) + "\n";
      }
    }
  }
  return parse_measurements(csv, "heights.csv");
}

/// Dead zones of custom Resin 1 in the long run.
Measurements dead_zones(double scatter_um) {
  std::mt19937 random(4);
  std::normal_distribution<double> scatter(0, scatter_um);
  std::string csv = "blue_mw_cm2,uv_mw_cm2,exposure_s,dead_zone_um\n";
  const Kinetics k{408, 0.99, 64, 0.73, 37.8};
  for (const double blue : {50.0, 100.0}) {
    for (const double ratio : {1.8, 2.0, 3.0, 4.0, 5.0}) {
      const double z = curing_fronts(k, blue, ratio * blue, 30)->front_um + scatter(random);
      csv += std::to_string(blue) + "," + std::to_string(ratio * blue) + ",30," +
             std::to_string(z) + "\n";
    }
  }
  return parse_measurements(csv, "zones.csv");
}

FitOptions blue_of_resin_1() {
  FitOptions o;
  o.hb_um = 408;
  o.critical_dose_prime = 64;
  o.m = 0.99;
  return o;
}

/// All matches of the first group.
std::vector<std::string> all(const std::string& text, const std::string& pattern) {
  std::vector<std::string> found;
  const std::regex r(pattern);
  for (std::sregex_iterator i(text.begin(), text.end(), r), end; i != end; ++i) {
    found.push_back((*i)[1]);
  }
  return found;
}

TEST(Plots, WorkingCurveShowsAllMeasurements) {
  const FitResult kinetic = fit(heights(0.7, 20), FitModel::kinetic);
  const std::string svg = working_curve_svg(kinetic, 5, "my-resin");
  test::expect_sound_svg(svg);
  // Twice each measurement (curve and residuals), and once in the legend for each intensity.
  EXPECT_EQ(all(svg, R"re((class="s\d p))re").size(), 2 * kinetic.points.size() + 3);
  EXPECT_THAT(svg, HasSubstr("my-resin: working curve, kinetic fit"));
  for (const char* words : {">5 mW/cm²<", ">20 mW/cm²<", ">80 mW/cm²<", ">fit<", "95 % band",
                            "scatter of replicates", "gel dose ", "aim 5 × gel", "residual, um"}) {
    EXPECT_THAT(svg, HasSubstr(words));
  }
  for (const char* parameter : {">h = ", ">m = ", ">D′c = "}) {
    EXPECT_THAT(svg, HasSubstr(parameter));
  }
  EXPECT_EQ(svg, working_curve_svg(kinetic, 5, "my-resin"));
}

TEST(Plots, MarkersStandWhereTheirDosesAre) {
  // Exact Jacobs data: doses in steps of 2 stand at equal distances, on the straight line.
  std::string csv = "dose_mj_cm2,cured_height_um\n";
  for (int i = 0; i < 6; ++i) {
    csv += std::to_string(10 << i) + "," + std::to_string(200 * std::log((10 << i) / 4.0)) + "\n";
  }
  const FitResult jacobs = fit(parse_measurements(csv, "exact.csv"), FitModel::jacobs);
  const std::string svg = working_curve_svg(jacobs);
  test::expect_sound_svg(svg);
  // A circle's path begins 5 to the left of its centre. The legend's lies at a y below 0; the last
  // six are residuals.
  std::vector<double> x, y;
  const std::regex r(R"re(class="s0 p" d="M([\d.]+) ([\d.]+)A)re");
  for (std::sregex_iterator i(svg.begin(), svg.end(), r), end; i != end; ++i) {
    x.push_back(std::stod((*i)[1]) + 5);
    y.push_back(std::stod((*i)[2]));
  }
  ASSERT_EQ(x.size(), 12U);
  const double dx = x[1] - x[0], dy = y[1] - y[0];
  EXPECT_GT(dx, 20);
  EXPECT_LT(dy, -20);  // upwards
  for (std::size_t i = 0; i < 6; ++i) {
    if (i > 0) {
      EXPECT_NEAR(x[i] - x[i - 1], dx, 0.021);  // two decimals are written
      EXPECT_NEAR(y[i] - y[i - 1], dy, 0.021);
    }
    EXPECT_NEAR(x[i + 6], x[i], 0.011);  // residuals share the axis
    EXPECT_GE(y[i + 6], 0);              // and stay in their panel of 110
    EXPECT_LE(y[i + 6], 110);
  }
  // The gel dose of 4 lies log2(10 / 4) steps before the first one, where the height is zero.
  const auto dot = all(svg, R"re(class="dot" cx="([\d.]+)")re");
  ASSERT_EQ(dot.size(), 1U);
  EXPECT_NEAR(std::stod(dot[0]), x[0] - std::log2(2.5) * dx, 0.1);
  const auto dot_y = all(svg, R"re(class="dot" cx="[\d.]+" cy="([\d.]+)")re");
  EXPECT_NEAR(std::stod(dot_y[0]), y[0] - std::log2(2.5) * dy, 0.1);
}

TEST(Plots, OutliersAreRingedAndNamed) {
  FitResult jacobs = fit(heights(1, 20), FitModel::jacobs);
  jacobs.outliers = {{7, "heights.csv: line 9: far off"}, {7, "the same for another reason"}};
  const std::string svg = working_curve_svg(jacobs);
  test::expect_sound_svg(svg);
  // In the curve, in the residuals, in the legend; a point with two reasons is one.
  EXPECT_EQ(all(svg, R"re((class="ring"))re").size(), 3U);
  EXPECT_EQ(all(svg, "(>line 9<)").size(), 2U);
  jacobs.outliers.clear();
  EXPECT_THAT(working_curve_svg(jacobs), Not(HasSubstr("class=\"ring\"")));
}

TEST(Plots, UnknownIntervalsLeaveOutTheBand) {
  FitResult jacobs = fit(heights(1, 20), FitModel::jacobs);
  for (double& c : jacobs.covariance) c = std::nan("");
  for (Parameter& p : jacobs.parameters) {
    p.stderr_ = std::nan("");
    p.ci95 = {std::nan(""), std::nan("")};
  }
  const std::string svg = working_curve_svg(jacobs);
  test::expect_sound_svg(svg);
  EXPECT_THAT(svg, Not(HasSubstr("95 % band")));
  EXPECT_THAT(svg, HasSubstr("the data do not say how sure"));
}

TEST(Plots, ThousandsOfMeasurementsAreThinned) {
  std::string csv = "dose_mj_cm2,cured_height_um\n";
  for (int i = 0; i < 20000; ++i) {
    const double dose = 10 + i * 0.01;
    csv += std::to_string(dose) + "," + std::to_string(100 * std::log(dose / 5) + i % 7) + "\n";
  }
  const std::string svg =
      working_curve_svg(fit(parse_measurements(csv, "many.csv"), FitModel::jacobs));
  test::expect_sound_svg(svg);
  EXPECT_LT(svg.size(), 3'000'000U);
  EXPECT_THAT(svg, HasSubstr("Every 5th of 20000 measurements is drawn"));
}

TEST(Plots, CollapseDrawsBothDoses) {
  const Measurements data = heights(0.7, 20);
  const FitResult jacobs = fit(data, FitModel::jacobs), kinetic = fit(data, FitModel::kinetic);
  const std::string svg = collapse_svg(jacobs, kinetic);
  test::expect_sound_svg(svg);
  EXPECT_THAT(svg, HasSubstr("dose D, mJ/cm²"));
  EXPECT_THAT(svg, HasSubstr("dose analogue D′"));
  EXPECT_EQ(all(svg, R"re((class="s\d p))re").size(), 2 * kinetic.points.size() + 3);
}

TEST(Plots, DeadZones) {
  const Measurements data = dead_zones(1);
  const FitResult steady = fit(data, FitModel::dead_zone_steady, blue_of_resin_1());
  const std::string svg = dead_zone_svg(steady);
  test::expect_sound_svg(svg);
  EXPECT_THAT(svg, HasSubstr("Dead zone, steady fit"));
  EXPECT_THAT(svg, HasSubstr("β Iuv = Ib at"));
  const FitResult transient = fit(data, FitModel::dead_zone_transient, blue_of_resin_1());
  const std::string other = dead_zone_svg(transient);
  test::expect_sound_svg(other);
  EXPECT_THAT(other, HasSubstr("100 mW/cm², 30 s"));
  // Each picture only of a fit that has what it shows.
  const FitResult jacobs = fit(heights(1, 20), FitModel::jacobs);
  EXPECT_THROW(dead_zone_svg(jacobs), InputError);
  EXPECT_THROW(working_curve_svg(steady), InputError);
  EXPECT_THROW(collapse_svg(jacobs, steady), InputError);
}

TEST(Plots, Fronts) {
  // D figure 3.4.
  const Kinetics k{750, 1, 100, 1, 100};
  const std::string svg = fronts_svg(k, 100, 200);
  test::expect_sound_svg(svg);
  EXPECT_THAT(svg, HasSubstr("z0 = 312.5 um, t0 = 1.75 s"));
  EXPECT_THAT(svg, HasSubstr("zf in the long run: 79.98 um"));
  EXPECT_THAT(svg, HasSubstr(">zb<"));
  // Without UV, with too little of it, and before anything gels.
  test::expect_sound_svg(fronts_svg(k, 100, 0));
  const std::string weak = fronts_svg(k, 100, 90, 20);
  test::expect_sound_svg(weak);
  EXPECT_THAT(weak, HasSubstr("at the window after 10 s"));
  const std::string early = fronts_svg(k, 100, 200, 1);
  test::expect_sound_svg(early);
  EXPECT_THAT(early, HasSubstr("Nothing gels within 1 s"));
  EXPECT_THROW(fronts_svg(k, 0, 200), InputError);
}

ResinRecord record(const std::string& name) {
  ResinRecord r;
  r.name = name;
  r.resin.name = name;
  r.resin.absorbance_height10_um = 2000;
  r.resin.critical_dose_mj_cm3 = 748;
  r.resin.gel_dose_mj_cm3 = 149.6;
  r.resin.dose_factor = 5;
  return r;
}

TEST(Plots, RecordFromItsParameters) {
  ResinRecord r = record("r1");
  std::string svg = record_svg(r);
  test::expect_sound_svg(svg);
  EXPECT_THAT(svg, HasSubstr("gel dose 12.99"));
  EXPECT_THAT(svg, HasSubstr("aim 5 × gel = 64.97"));
  // With inhibition a second panel, without a gel dose a word on that.
  r.resin.inhibition = Inhibition{2, 300, 1, 0};
  EXPECT_THAT(record_svg(r), HasSubstr("steady dead zone, um"));
  r.resin.gel_dose_mj_cm3 = 0;
  r.resin.dose_factor = 1;
  EXPECT_THAT(record_svg(r), HasSubstr("gives no gel dose"));
  r.resin.critical_dose_mj_cm3 = 0;
  EXPECT_THROW(record_svg(r), InputError);
}

TEST(Page, HoldsFiguresFitsAndPictures) {
  ResinRecord r = record("page-resin");
  r.maker = "A & B <resins>";
  r.provenance["dead_zone_fit"] = "none";
  r.text = "name = \"page-resin\"  # </pre><script>alert(1)</script>";
  const Measurements data = heights(0.7, 20);
  FitResult jacobs = fit(data, FitModel::jacobs);
  jacobs.warnings.emplace_back("a <warning> of the fit");
  const std::string html = resin_page(r, {jacobs, fit(data, FitModel::kinetic)},
                                      {{1, "2024-01-01T00:00:00Z", "first", "", false},
                                       {2, "2024-02-01T00:00:00Z", "second \"fit\"", "", true}});
  EXPECT_THAT(html, HasSubstr("A &amp; B &lt;resins&gt;"));
  EXPECT_THAT(html, HasSubstr("a &lt;warning&gt; of the fit"));
  EXPECT_THAT(html, Not(HasSubstr("<script")));
  for (const char* words :
       {"Correction aims at 748 mJ/cm³", "5 times the gel dose", "868.6 um (1/e)", "2000 um (1/10)",
        "12.99 mJ/cm²", "149.6 mJ/cm³", "Jacobs fit", "Kinetic fit", "Do the data collapse",
        "second &quot;fit&quot;", "2 (now)", "dead zone fit"}) {
    EXPECT_THAT(html, HasSubstr(words));
  }
  // Two working curves, the collapse, the fronts.
  EXPECT_EQ(all(html, "(<figure>)").size(), 4U);
  EXPECT_THAT(html, Not(HasSubstr("nan")));
  // Nothing is fetched from anywhere.
  EXPECT_THAT(html, Not(::testing::ContainsRegex("(src|href)=")));
}

TEST(Page, OfARecordWithoutADose) {
  ResinRecord r;
  r.name = "bare";
  const std::string html = resin_page(r, {});
  EXPECT_THAT(html, HasSubstr("no dose that correction could aim at"));
  EXPECT_THAT(html, Not(HasSubstr("<svg")));
  EXPECT_THAT(html, Not(HasSubstr("nan")));
}

/// The page's width as a browser lays it out in a window of 400 px.
TEST(Page, FitsAPhone) {
  if (test::chromium().empty()) GTEST_SKIP() << "chromium is not installed (scripts/setup --all)";
  ResinRecord r = record("a-resin-with-a-name-that-is-quite-long-405nm");
  r.provenance["source"] = "https://example.org/" + std::string(120, 'x');
  const Measurements data = heights(0.7, 20);
  const test::BrowserFolder folder;
  std::ofstream(folder.path / "page.html") << resin_page(r, {fit(data, FitModel::kinetic)});
  test::DrivenPage page;
  page.look_like(400, 800, false);
  page.open("file://" + (folder.path / "page.html").string());
  EXPECT_LE(page.eval("document.documentElement.scrollWidth").get<double>(), 400);
  const double right = page.eval(
                               "Math.max(...[...document.querySelectorAll('svg svg')].map("
                               "e => e.parentNode.ownerSVGElement.getBoundingClientRect().right))")
                           .get<double>();
  EXPECT_LE(right, 400);
  EXPECT_GT(right, 300);
}

}  // namespace
}  // namespace slicecorr::resins
