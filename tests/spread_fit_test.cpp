// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Spread and scatter of light from printed widths.
#include "slicecorr/resins/spread_fit.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <numbers>

#include "refusal.hpp"
#include "rounds.hpp"
#include "spread/model.hpp"
#include "spread_lab.hpp"

namespace slicecorr::resins {
namespace {

using test::Lab;
using test::measured;
using test::normal;
using test::printer_of_lab;
using test::refusal;
using test::scan;
using test::scans;
using test::with;
using testing::HasSubstr;

TEST(SpreadModel, WidthsAreThoseOfTheClosedForms) {
  SpreadState s{40, 0, 0, 0, 6.25, 0.01};
  Exposure line, gap;
  gap.gap = true;
  const double lines[][2] = {{17.32, 40}, {25.05, 80}, {44.17, 120}, {78.10, 160}};
  for (const auto& [lit, printed] : lines) {
    // A hundredth of lit width is up to 0.14 um of printed width for the narrowest.
    EXPECT_NEAR(printed_width_um(s, line, lit), printed, 0.15) << lit;
  }
  const double gaps[][2] = {{128.62, 40}, {162.81, 80}, {202.41, 120}, {242.40, 160}};
  for (const auto& [dark, printed] : gaps) {
    EXPECT_NEAR(printed_width_um(s, gap, dark), printed, 0.06) << dark;
  }
  // A long edge moves by 1.0300 s outwards, by 0.01266 s for 2 beside 0.02.
  EXPECT_NEAR(printed_width_um(s, line, 2000), 2000 + 2 * 1.0300 * 40, 0.004);
  EXPECT_NEAR(printed_width_um(s, gap, 2000), 2000 - 2 * 1.0300 * 40, 0.004);
  s.dose = 2;
  EXPECT_NEAR(printed_width_um(s, line, 2000), 2000 + 2 * 0.01266 * 40, 0.001);
  // The narrowest light that gels at all: 1.33313 s, and 0.38210 s.
  EXPECT_GT(printed_width_um(s, line, 1.3332 * 40), 0);
  EXPECT_LT(printed_width_um(s, line, 1.3331 * 40), 0);
  s.dose = 6.25;
  EXPECT_GT(printed_width_um(s, line, 0.38211 * 40), 0);
  EXPECT_LT(printed_width_um(s, line, 0.38209 * 40), 0);
  // Light that does not spread prints what is shown.
  s.sigma_um = 0;
  EXPECT_NEAR(printed_width_um(s, line, 150), 150, 1e-9);
  EXPECT_NEAR(printed_width_um(s, gap, 150), 150, 1e-9);
  // Where black prints, too, nothing has an edge.
  s.dark = 0.2;
  EXPECT_TRUE(std::isnan(printed_width_um(s, line, 150)));
}

TEST(SpreadModel, APrintThatMovesIsTheSumOfThinSlices) {
  Lab lab;
  lab.moving = true;
  lab.height_e_um = 400;
  lab.scatter = 4;
  for (const double m : {1.0, 0.8}) {
    lab.m = m;
    for (const double depth : {300.0, 900.0, 1e9}) {
      const SpreadState s{40, 0, 0, 4, 6.25, 0.01};
      for (const WidthKind kind : {WidthKind::line, WidthKind::gap}) {
        const Exposure e{kind == WidthKind::gap, 1, m, 400, depth, true};
        // Slices of 0.002 heights take their light from their middle: less than 1e-6 of it off.
        EXPECT_NEAR(printed_width_um(s, e, 250), lab.width(kind, 250, depth), 1e-3)
            << m << " " << depth;
      }
    }
  }
}

TEST(SpreadModel, EdgesAreAveragedOverTheCamerasPixels) {
  const SpreadState s{3, 0, 0, 0, 1, 0};
  for (const double box : {0.01, 1.0, 7.0}) {
    for (const double other : {0.0, 0.5, 4.0}) {
      for (const double x : {-6.0, 0.4, 2.5}) {
        double sum = 0;
        constexpr int n = 400;
        for (int i = 0; i < n; ++i) {
          for (int k = 0; k < n; ++k) {
            sum += normal((x + box * ((i + 0.5) / n - 0.5) + other * ((k + 0.5) / n - 0.5)) / 3);
          }
        }
        EXPECT_NEAR(edge_share(s, 0, x, box, other, 0), sum / (n * n), 2e-6) << box << other << x;
      }
    }
  }
}

TEST(SpreadFit, ExactWidthsGiveExactParameters) {
  const Printer printer = printer_of_lab();
  for (const double dose : {2.0, 6.25, 20.0}) {
    Lab lab;
    lab.dose = dose;
    const SpreadFit fit = fit_spread(measured(lab, 0, 1), with(printer));
    EXPECT_NEAR(fit.parameter("sigma_um").value, 40, 40e-6) << dose;
    EXPECT_NEAR(fit.parameter("dose").value, dose, dose * 1e-6);
    EXPECT_EQ(fit.parameter("dark").value, 0.01);
    EXPECT_FALSE(fit.parameter("scatter_um2_per_um").fitted);
    EXPECT_LT(fit.rms, 1e-6);
  }
  // At three heights, with an exponent.
  Resin resin = test::resin(100, 2000);
  resin.m = 0.85;
  SpreadFitOptions o = with(printer);
  o.resin = &resin;
  Lab lab;
  lab.scatter = 3.5;
  lab.m = 0.85;
  lab.height_e_um = 2000 / std::numbers::ln10;
  const SpreadFit deep = fit_spread(measured(lab, 0, 1, 1, {0, 400, 800}), o);
  EXPECT_NEAR(deep.parameter("sigma_um").value, 40, 40e-6);
  EXPECT_NEAR(deep.parameter("scatter_um2_per_um").value, 3.5, 3.5e-6);
  EXPECT_NEAR(deep.parameter("dose").value, 6.25, 6.25e-6);
  // Two Gaussians.
  Lab halo;
  halo.spread = {{30, 0.85}, {140, 0.15}};
  SpreadFitOptions two = with(printer);
  two.gaussians = 2;
  const SpreadFit found = fit_spread(measured(halo, 0, 1), two);
  EXPECT_NEAR(found.parameter("sigma_um").value, 30, 30e-6);
  EXPECT_NEAR(found.parameter("sigma2_um").value, 140, 140e-6);
  EXPECT_NEAR(found.parameter("weight2").value, 0.15, 1e-6);
  // One of them is not enough, and that is told.
  EXPECT_THAT(fit_spread(measured(halo, 0, 1),
                         [&] {
                           SpreadFitOptions all = with(printer);
                           all.keep_outliers = true;
                           return all;
                         }())
                  .notes,
              testing::Contains(HasSubstr("try --gaussians 2")));
}

// Rows that are there twice are two measurements; a table that was pasted once more is told.
TEST(SpreadFit, ATableThatWasPastedTwiceIsTold) {
  const Printer printer = printer_of_lab();
  SpreadMeasurements widths = measured(Lab(), 1, 1);
  const auto repeats = [&] { return fit_spread(widths, with(printer)).notes; };
  EXPECT_THAT(repeats(), testing::Not(testing::Contains(HasSubstr("digit for digit"))));
  const std::size_t once = widths.widths.size();
  widths.widths.insert(widths.widths.end(), widths.widths.begin(),
                       widths.widths.begin() + static_cast<std::ptrdiff_t>(once));
  EXPECT_THAT(repeats(), testing::Contains(HasSubstr(fmt::format(
                             "{} of {} measurements repeat earlier ones", once, 2 * once))));
}

TEST(SpreadFit, WidthsOfAPrintThatMoved) {
  const Printer printer = printer_of_lab();
  const Resin resin = test::resin(100, 1000);
  Lab lab;
  lab.moving = true;
  lab.scatter = 5;
  lab.height_e_um = 1000 / std::numbers::ln10;
  SpreadFitOptions o = with(printer);
  o.resin = &resin;
  o.moving = true;
  SpreadMeasurements m = measured(lab, 0, 1, 1, {250, 1500});
  const SpreadFit fit = fit_spread(m, o);
  // Thin slices are good to 1e-6 of the light.
  EXPECT_NEAR(fit.parameter("sigma_um").value, 40, 1e-3);
  EXPECT_NEAR(fit.parameter("scatter_um2_per_um").value, 5, 1e-3);
  EXPECT_NEAR(fit.parameter("dose").value, 6.25, 1e-4);
}

TEST(SpreadFit, WhatTheScheduleSaysIsHeld) {
  const Printer printer = printer_of_lab();
  SpreadFitOptions o = with(printer);
  o.dose = 6.25;
  // Wide lines alone tell sigma then: their edges move by 1.03 of it.
  SpreadMeasurements m = measured(Lab(), 0, 1);
  std::erase_if(m.widths, [](const PrintedWidth& w) { return w.designed_um < 400; });
  EXPECT_NEAR(fit_spread(m, o).parameter("sigma_um").value, 40, 4e-4);
  // Without it they don't: an edge that moves a little is a little spread or a little light.
  EXPECT_THAT(refusal([&] { fit_spread(m, with(printer)); }),
              testing::AllOf(HasSubstr("can't tell sigma_um, dose from each other"),
                             HasSubstr("of one to four pixels"), HasSubstr("--exposure-s")));
  // Less light in some lines, by level.
  Lab lab;
  SpreadMeasurements dim = measured(lab, 0, 1);
  for (PrintedWidth& w : dim.widths) {
    if (w.line % 2) continue;
    w.level = 128;
    w.printed_um = lab.width(w.kind, w.designed_um, 0, (1 + 99 * 128.0 / 255) / 100);
  }
  const SpreadFit fit = fit_spread(dim, with(printer));
  EXPECT_NEAR(fit.parameter("sigma_um").value, 40, 40e-6);
  EXPECT_NEAR(fit.parameter("dose").value, 6.25, 6.25e-6);
  SpreadFitOptions none;
  EXPECT_THAT(refusal([&] { fit_spread(dim, none); }),
              testing::AllOf(HasSubstr("line 2"), HasSubstr("expected --printer")));
}

// 95 % of 60 runs have a standard deviation of 2.8 %: three of them below is 86.5 %.
TEST(SpreadCoverage, IntervalsOfWidthsHoldTheTruthAsOftenAsTheySay) {
  const Printer printer = printer_of_lab();
  const Resin resin = test::resin(100, 2000);
  SpreadFitOptions o = with(printer);
  o.resin = &resin;
  Lab lab;
  lab.scatter = 3;
  lab.height_e_um = 2000 / std::numbers::ln10;
  const std::map<std::string, double> truth = {
      {"sigma_um", 40}, {"scatter_um2_per_um", 3}, {"dose", 6.25}};
  std::map<std::string, int> inside;
  const int runs = test::by_night() ? 200 : 10;
  for (int run = 0; run < runs; ++run) {
    const SpreadFit fit =
        fit_spread(measured(lab, 3, 100 + static_cast<unsigned>(run), 1, {0, 500}), o);
    for (const auto& [name, value] : truth) {
      const SpreadParameter& p = fit.parameter(name);
      inside[name] += p.ci95[0] <= value && value <= p.ci95[1];
    }
  }
  for (const auto& [name, value] : truth) {
    EXPECT_GE(inside[name], 0.95 * runs - 3 * std::sqrt(0.95 * 0.05 * runs)) << name;
    RecordProperty(name, inside[name]);
  }
}

TEST(SpreadFit, AnOutlierIsNamedAndLeftOut) {
  const Printer printer = printer_of_lab();
  SpreadMeasurements m = measured(Lab(), 2, 5, 2);
  m.widths[9].printed_um += 25;
  const SpreadFit fit = fit_spread(m, with(printer));
  EXPECT_TRUE(fit.residuals[9].left_out);
  EXPECT_EQ(std::count_if(fit.residuals.begin(), fit.residuals.end(),
                          [](const SpreadResidual& r) { return r.left_out && r.measured > 0; }),
            1);
  EXPECT_THAT(fit.notes,
              testing::Contains(HasSubstr("Line 11, a line of 250 um, does not belong")));
  SpreadFitOptions all = with(printer);
  all.keep_outliers = true;
  EXPECT_GT(fit_spread(m, all).rms, 1.5 * fit.rms);
  // One that was mistyped must not lead the search astray.
  m = measured(Lab(), 2, 5);
  m.widths[2].printed_um *= 10;
  const SpreadFit typed = fit_spread(m, with(printer));
  EXPECT_THAT(typed.notes, testing::Contains(HasSubstr("Line 4, a line of 150 um, does not")));
  EXPECT_NEAR(typed.parameter("sigma_um").value, 40, 6);
  // More than a fifth is no measurement.
  m = measured(Lab(), 0.01, 5, 2);
  int spoilt = 0;
  for (PrintedWidth& w : m.widths) {
    if (w.designed_um < 300 || spoilt == 12) continue;
    w.printed_um += (spoilt % 2 ? 3 : -3) * static_cast<double>(1 << (spoilt % 6));
    ++spoilt;
  }
  EXPECT_THAT(refusal([&] { fit_spread(m, with(printer)); }),
              testing::AllOf(HasSubstr("more than a fifth"), HasSubstr("--keep-outliers")));
  // A speck on the edge.
  KnifeEdge e = scan(40, 0.005, 3);
  e.samples[44].intensity += 6;
  const SpreadFit edge = fit_spread(scans({e}));
  EXPECT_THAT(edge.notes, testing::Contains(HasSubstr("Line 46 does not belong")));
  EXPECT_NEAR(edge.parameter("sigma_um").value, 40, 1);
  // A gap that was closed though it should not have been is told.
  m = measured(Lab(), 1, 5);
  m.widths[12 + 6].printed_um = 0;
  EXPECT_THAT(fit_spread(m, with(printer)).notes,
              testing::Contains(HasSubstr("a gap of 350 um, left nothing, though by the fit")));
}

TEST(SpreadFit, WhatCanNotBeIsRefused) {
  const Printer printer = printer_of_lab();
  const SpreadFitOptions o = with(printer);
  SpreadMeasurements m = measured(Lab(), 1, 2);
  const auto says = [&](const std::function<void(SpreadMeasurements&)>& spoil,
                        const SpreadFitOptions& options) {
    SpreadMeasurements spoilt = m;
    spoil(spoilt);
    return refusal([&] { fit_spread(spoilt, options); });
  };
  EXPECT_THAT(says([](auto& x) { x.widths.resize(2); }, o),
              testing::AllOf(HasSubstr("2 printed widths for 2 parameters (sigma_um, dose)"),
                             HasSubstr("expected at least 3")));
  EXPECT_THAT(says([](auto& x) { x.widths.clear(); }, o), HasSubstr("either widths or edges"));
  EXPECT_THAT(says(
                  [](auto& x) {
                    for (auto& w : x.widths) {
                      w.designed_um /= 1000;
                      w.printed_um /= 1000;
                    }
                  },
                  o),
              HasSubstr("look like millimetres"));
  EXPECT_THAT(says([](auto& x) { x.widths[4].printed_um /= 1000; }, o),
              testing::AllOf(HasSubstr("line 6"), HasSubstr("micrometres in both columns")));
  EXPECT_THAT(says([](auto& x) { x.widths[4].designed_um = 3; }, o),
              testing::AllOf(HasSubstr("line 6"), HasSubstr("a fifth of the printer's pixel")));
  EXPECT_THAT(says([](auto& x) { x.widths[4].printed_um = -3; }, o), HasSubstr("line 6"));
  EXPECT_THAT(says([](auto& x) { x.widths[4].printed_um = NAN; }, o), HasSubstr("line 6"));
  // Lines and gaps that both are wider than designed.
  EXPECT_THAT(says(
                  [](auto& x) {
                    for (auto& w : x.widths) w.printed_um = w.designed_um + 20 + 0.1 * w.line;
                  },
                  o),
              HasSubstr("moves one way only"));
  // Depths without a resin; light that spreads less where it has gone further.
  EXPECT_THAT(says([](auto& x) { x.widths[4].depth_um = 300; }, o), HasSubstr("expected --resin"));
  const Resin resin = test::resin(100, 2000);
  SpreadFitOptions deep = o;
  deep.resin = &resin;
  Lab lab;
  lab.height_e_um = 2000 / std::numbers::ln10;
  lab.scatter = 3;
  m = measured(lab, 1, 2, 1, {0, 400});
  EXPECT_THAT(says(
                  [&](auto& x) {
                    // The dose is known where it was, so that only the spread is of elsewhere.
                    Lab less = lab;
                    less.spread = {{60, 1}};
                    less.scatter = -5;
                    x = measured(less, 1, 2, 1, {0, 400});
                  },
                  deep),
              HasSubstr("spreads less the further it has gone"));
  // Names and values that are none.
  SpreadFitOptions bad = o;
  bad.free = {"focus"};
  m = measured(Lab(), 1, 2);
  EXPECT_THAT(says([](auto&) {}, bad), HasSubstr("'focus' is no parameter"));
  for (const auto& [name, value] : {std::pair{"sigma_um", -3.0},
                                    {"dose", 0.0},
                                    {"dark", 1.5},
                                    {"scatter_um2_per_um", -1.0},
                                    {"sigma_um", double(NAN)}}) {
    bad = o;
    bad.fixed = {{name, value}};
    EXPECT_THAT(says([](auto&) {}, bad), HasSubstr("makes no spread")) << name;
  }
  bad = o;
  bad.fixed = {{"weight2", 0.1}};
  EXPECT_THAT(says([](auto&) {}, bad), HasSubstr("expected --gaussians 2"));
  bad = o;
  bad.fixed = {{"sigma_um", 40}, {"dose", 6}};
  EXPECT_THAT(says([](auto&) {}, bad), HasSubstr("nothing to fit"));
  bad = {};
  bad.free = {"dose"};
  EXPECT_THAT(refusal([&] { fit_spread(scans({scan(40, 0, 1)}), bad); }),
              HasSubstr("no parameter of edges"));
}

TEST(SpreadTables, AreRefusedByLine) {
  const auto path = std::filesystem::path(::testing::TempDir()) /
                    fmt::format("slicecorr-spread-{}.csv", ::getpid());
  const auto says = [&](const std::string& text) {
    std::ofstream(path) << text;
    return refusal([&] { read_spread_table(path.string()); });
  };
  EXPECT_THAT(says("a,b\n"), HasSubstr("is no table of light that spreads"));
  EXPECT_THAT(says(""), HasSubstr("is no table of light that spreads"));
  EXPECT_THAT(says("kind,designed_um\nline,50\n"), HasSubstr("has no column printed_um"));
  EXPECT_THAT(
      says("kind,designed_um,printed_um\nslit,50,40\n"),
      testing::AllOf(HasSubstr("line 2"), HasSubstr("kind is 'slit'; expected line or gap")));
  EXPECT_THAT(says("kind,designed_um,printed_um\nline,-50,40\n"),
              HasSubstr("designed_um is '-50'"));
  EXPECT_THAT(says("kind,designed_um,printed_um\nline,50,nan\n"), HasSubstr("printed_um is 'nan'"));
  EXPECT_THAT(says("kind,designed_um,printed_um\nline,50,-1\n"), HasSubstr("printed_um is '-1'"));
  EXPECT_THAT(says("kind,designed_um,printed_um\nline,50,\n"), HasSubstr("has no printed_um"));
  EXPECT_THAT(says("kind,designed_um,printed_um,level,light\nline,50,40,255,1\n"),
              HasSubstr("a level and a light"));
  EXPECT_THAT(says("position_um,intensity\n0,x\n"), HasSubstr("intensity is 'x'"));
  EXPECT_THAT(says("position_um,intensity\n"), HasSubstr("has no places"));
  std::ofstream(path)
      << "# microscope 3\ndesigned_um,kind,printed_um\n50,line,43.5\n50,gap,\n100,gap,80\n";
  const SpreadMeasurements widths = read_spread_table(path.string());
  ASSERT_EQ(widths.widths.size(), 2U);
  EXPECT_EQ(widths.widths[1].line, 5);
  EXPECT_EQ(widths.widths[1].kind, WidthKind::gap);
  EXPECT_TRUE(std::isnan(widths.widths[1].depth_um));
  std::ofstream(path) << "intensity,position_um,depth_um\n5,20,0\n1,0,0\n3,10,0\n2,0,500\n";
  const SpreadMeasurements edges = read_spread_table(path.string(), 3);
  ASSERT_EQ(edges.edges.size(), 2U);
  EXPECT_EQ(edges.edges[0].samples[1].at_um, 10);
  EXPECT_EQ(edges.edges[0].box_um[0], 3);
  EXPECT_EQ(edges.edges[1].depth_um, 500);
  std::filesystem::remove(path);
}

}  // namespace
}  // namespace slicecorr::resins
