// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Axes, lens and vial from pins that were found in the light of a tomographic printer.
#include "slicecorr/resins/optics_fit.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <random>

#include "refusal.hpp"
#include "rounds.hpp"
#include "run_program.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/vial.hpp"

namespace slicecorr::resins {
namespace {

using test::refusal;
using testing::HasSubstr;

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr double kN = 1.49969;  // Webber's resin

/// Webber's vial in air before a pinhole, off by what a lab is off by.
Printer webber() {
  Printer p;
  p.name = "webber";
  p.width_px = 1024;
  p.height_px = 768;
  p.pixel_x_um = p.pixel_y_um = 54;
  p.calibration = {{0, 0}, {255, 10}};
  p.vial = Vial{12.5, 11.8, 1.0, 1.48};
  p.optics = Optics{OpticsKind::pinhole, 99.5};
  p.rotation = Rotation{12, TurnDirection::clockwise, 60};
  return p;
}
Printer true_machine() {
  Printer p = webber();
  p.optics->distance_mm = 101.2;
  p.optics->axis_right_px = 3.7;
  p.optics->axis_up_px = -12;
  p.optics->tilt_deg = 0.4;
  return p;
}
constexpr double kPins = 33, kDatum = -9;

/// Two pins with marks at three heights, all around; columns and rows as that machine shows them.
OpticsPoints measured(const Printer& machine, double n, double sigma_px, unsigned seed,
                      bool marks = true) {
  OpticsPoints all{"pins.csv", {}};
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0, 1);
  int line = 1;
  for (const auto& [radius, pin] : {std::pair{4.0, 0.0}, {7.0, 140.0}}) {
    for (int angle = 0; angle < 360; angle += 30) {
      for (const double z : {2.0, 9.0, 16.0}) {
        OpticsPoint p{++line, static_cast<double>(angle), radius, pin};
        if (marks) p.z_mm = z;
        if (!marks) p.row_px = 200 + 25 * z;
        const SeenAt seen = seen_at(machine, n, p, kPins, kDatum);
        p.column_px = seen.column + sigma_px * noise(random);
        if (marks) p.row_px = seen.row + sigma_px * noise(random);
        all.points.push_back(p);
      }
    }
  }
  return all;
}

TEST(OpticsFit, WithoutALensPinsAreSeenWhereTheClosedFormSays) {
  // A bath of the resin's index and parallel light: t = r cos(pin - th).
  Printer p = webber();
  p.vial->n_outside = p.vial->n_wall = 1.5;
  p.optics = Optics{};
  p.optics->axis_right_px = 2;
  const OpticsPoint point{1, 50, 6, 20};
  EXPECT_NEAR(seen_at(p, 1.5, point, 10, 0).column,
              511.5 + 2 + 6 * std::cos(20 * std::numbers::pi / 180) / .054, 1e-7);
  p.rotation->direction = TurnDirection::counterclockwise;
  EXPECT_NEAR(seen_at(p, 1.5, point, 10, 0).column,
              511.5 + 2 + 6 * std::cos(80 * std::numbers::pi / 180) / .054, 1e-7);
  // Webber's pinhole, whose pixel (0, 19 mm) meets the axis 18.190002 mm above the optical axis.
  const OpticsPoint on_axis{1, 0, 0, 0, 18.190002};
  const SeenAt seen = seen_at(webber(), kN, on_axis, 0, 0);
  EXPECT_NEAR(seen.column, 511.5, 1e-6);
  EXPECT_NEAR(seen.row, 383.5 - 19 / .054, 2e-5);
  // (6, 19): a place on the published ray, 10 mm behind where it comes into the resin.
  const double entry[3] = {5.234167, -10.575609, 16.934415},
               along[3] = {-.116704, .985288, .124851};
  const double x = entry[0] + 10 * along[0], y = entry[1] + 10 * along[1],
               z = entry[2] + 10 * along[2];
  const OpticsPoint beside{1, 0, std::hypot(x, y), std::atan2(y, x) * 180 / std::numbers::pi, z};
  const SeenAt there = seen_at(webber(), kN, beside, 0, 0);
  EXPECT_NEAR(there.column, 511.5 + 6 / .054, 1e-4);
  EXPECT_NEAR(there.row, 383.5 - 19 / .054, 1e-4);
}

/// A vial in a tank, whose window is 20 mm before the axis.
TEST(OpticsFit, AWindowIsCountedOrItsAbsenceIsTold) {
  Printer tank = webber();
  tank.vial = Vial{12.5, 11.8, 1.5, 1.5};
  tank.bath = Bath{20, 1.5, 3, 1.52};
  tank.optics->distance_mm = 101.2;
  tank.optics->axis_right_px = 3.7;
  const OpticsPoints points = measured(tank, 1.5, 0.3, 3);
  Printer before = webber();
  before.vial = tank.vial;
  const OpticsFit without = fit_optics(points, before, 1.5);
  EXPECT_FALSE(without.fits);
  EXPECT_GT(without.apart_px, 1);
  ASSERT_FALSE(without.notes.empty());
  EXPECT_THAT(without.notes.back(), HasSubstr("do not fit"));
  EXPECT_THAT(without.notes.back(), HasSubstr("[bath]"));
  before.bath = tank.bath;
  const OpticsFit with = fit_optics(points, before, 1.5);
  EXPECT_TRUE(with.fits);
  // Points are read to 0.3 pixels; of 144, and 7 parameters, the scatter is known to 6 %.
  EXPECT_NEAR(with.apart_px, 0.3, 0.06);
  const OpticsParameter& distance = with.parameter("distance_mm");
  EXPECT_NEAR(distance.value, 101.2, 4 * distance.standard_error);
  EXPECT_LT(distance.standard_error, 2);
}

TEST(OpticsFit, PointsWithoutScatterGiveTheMachine) {
  const OpticsFit fit = fit_optics(measured(true_machine(), kN, 0, 1), webber(), 1.45);
  EXPECT_NEAR(fit.parameter("distance_mm").value, 101.2, 1e-4);
  EXPECT_NEAR(fit.parameter("axis_right_px").value, 3.7, 1e-5);
  EXPECT_NEAR(fit.parameter("axis_up_px").value, -12, 1e-3);
  EXPECT_NEAR(fit.parameter("tilt_deg").value, 0.4, 1e-6);
  EXPECT_NEAR(fit.parameter("n").value, kN, 1e-7);
  EXPECT_NEAR(fit.parameter("pin_deg").value, kPins, 1e-5);
  EXPECT_LT(fit.rms_px, 1e-6);
  EXPECT_FALSE(fit.parameter("inner_mm").fitted);
  EXPECT_EQ(fit.measurements, 144);
  // Radii, too, where they are asked for.
  OpticsFitOptions options;
  options.free = {"inner_mm"};
  Printer start = webber();
  start.vial->inner_mm = 11.6;
  EXPECT_NEAR(fit_optics(measured(true_machine(), kN, 0, 1), start, 1.45, options)
                  .parameter("inner_mm")
                  .value,
              11.8, 1e-5);
}

TEST(OpticsFit, ATableThatWasPastedTwiceIsTold) {
  OpticsPoints points = measured(true_machine(), kN, 0.1, 1);
  const auto repeats = [&] { return fit_optics(points, webber(), 1.45).notes; };
  EXPECT_THAT(repeats(), testing::Not(testing::Contains(testing::HasSubstr("digit for digit"))));
  const std::vector<OpticsPoint> once = points.points;
  points.points.insert(points.points.end(), once.begin(), once.end());
  EXPECT_THAT(repeats(), testing::Contains(testing::HasSubstr(fmt::format(
                             "{} of {} measurements repeat", once.size(), 2 * once.size()))));
}

// 95 % of 8 runs have a standard deviation of 7.7 %: three of them below is 71.9 %.
TEST(OpticsCoverage, IntervalsHoldTheTruthAsOftenAsTheySay) {
  std::map<std::string, int> inside;
  const int runs = test::by_night() ? 150 : 8;
  const std::map<std::string, double> truth = {{"distance_mm", 101.2},
                                               {"axis_right_px", 3.7},
                                               {"axis_up_px", -12},
                                               {"tilt_deg", 0.4},
                                               {"n", kN},
                                               {"pin_deg", kPins}};
  for (int run = 0; run < runs; ++run) {
    const OpticsFit fit = fit_optics(measured(true_machine(), kN, 0.3, 100 + run), webber(), 1.49);
    for (const auto& [name, value] : truth) {
      const OpticsParameter& p = fit.parameter(name);
      inside[name] += p.ci95[0] <= value && value <= p.ci95[1];
    }
  }
  for (const auto& [name, value] : truth) {
    EXPECT_GE(inside[name], 0.95 * runs - 3 * std::sqrt(0.95 * 0.05 * runs)) << name;
    RecordProperty(name, inside[name]);
  }
}

TEST(OpticsFit, AnOutlierIsNamedAndLeftOut) {
  OpticsPoints points = measured(true_machine(), kN, 0.3, 7);
  points.points[20].column_px += 8;
  const OpticsFit fit = fit_optics(points, webber(), 1.49);
  const auto left_out =
      std::count_if(fit.residuals.begin(), fit.residuals.end(),
                    [](const OpticsResidual& r) { return r.column_left_out || r.row_left_out; });
  EXPECT_EQ(left_out, 1);
  EXPECT_TRUE(fit.residuals[20].column_left_out);
  EXPECT_THAT(fit.notes, testing::Contains(HasSubstr("Line 22 does not belong")));
  const OpticsParameter& right = fit.parameter("axis_right_px");
  EXPECT_LE(right.ci95[0], 3.7);
  EXPECT_GE(right.ci95[1], 3.7);
  OpticsFitOptions all;
  all.keep_outliers = true;
  EXPECT_GT(fit_optics(points, webber(), 1.49, all).rms_px, 1.4 * fit.rms_px);
  // More than a fifth of them is no calibration, however little the others scatter.
  points = measured(true_machine(), kN, 0.01, 7);
  for (std::size_t i = 0; i < points.points.size(); ++i) {
    if (i % 3 == 0) points.points[i].column_px += 0.5 * static_cast<double>(1 << (i / 3 % 8));
    if (i % 3 == 0) points.points[i].row_px += 0.5 * static_cast<double>(1 << (i / 3 % 8));
  }
  EXPECT_THAT(refusal([&] { fit_optics(points, webber(), 1.49); }),
              testing::AllOf(HasSubstr("more than a fifth"), HasSubstr("--keep-outliers")));
}

TEST(OpticsFit, TooLittleIsRefusedWithWhatToMeasure) {
  OpticsPoints points = measured(true_machine(), kN, 0.1, 3);
  points.points.resize(3);
  EXPECT_THAT(refusal([&] { fit_optics(points, webber(), 1.49); }),
              testing::AllOf(HasSubstr("6 measured columns and rows for 7 parameters"),
                             HasSubstr("expected at least 8"), HasSubstr("for distance_mm: pins")));
  // Pins on the axis say nothing of the resin.
  OpticsPoints axis{"axis.csv", {}};
  for (int k = 0; k < 12; ++k) {
    OpticsPoint p{k + 2, 30.0 * k, 0, 0};
    p.column_px = 515.2;
    axis.points.push_back(p);
  }
  EXPECT_THAT(refusal([&] { fit_optics(axis, webber(), 1.49); }),
              testing::AllOf(HasSubstr("can't tell"), HasSubstr("n"), HasSubstr("--fix"),
                             HasSubstr("half of the inner radius")));
  // One angle alone.
  OpticsPoints still{"still.csv", {}};
  for (int k = 0; k < 12; ++k) {
    OpticsPoint p{k + 2, 30, 5, 0};
    p.row_px = 384;
    p.column_px = seen_at(true_machine(), kN, p, kPins, 0).column;
    still.points.push_back(p);
  }
  EXPECT_THAT(refusal([&] { fit_optics(still, webber(), 1.49); }), HasSubstr("measure"));
  // In a bath nothing is bent, and parallel light has no distance: what is left is told apart.
  Printer bath = webber();
  bath.vial->n_outside = 1.5;
  bath.optics = Optics{};
  Printer machine = bath;
  machine.optics->axis_right_px = -4.25;
  const OpticsFit fit = fit_optics(measured(machine, 1.5, 0, 1, false), bath, 1.5);
  EXPECT_NEAR(fit.parameter("axis_right_px").value, -4.25, 1e-6);
  EXPECT_FALSE(fit.parameter("n").fitted);
  EXPECT_FALSE(fit.parameter("distance_mm").fitted);
  OpticsFitOptions distance;
  distance.free = {"distance_mm"};
  EXPECT_THAT(
      refusal([&] { fit_optics(measured(machine, 1.5, 0, 1, false), bath, 1.5, distance); }),
      HasSubstr("distance_mm"));
  OpticsFitOptions unknown;
  unknown.free = {"focus"};
  EXPECT_THAT(refusal([&] { fit_optics(axis, webber(), 1.49, unknown); }),
              HasSubstr("'focus' is no parameter"));
  // A pin in the glass.
  OpticsPoints glass = measured(true_machine(), kN, 0.1, 3);
  glass.points[4].radius_mm = 12;
  EXPECT_THAT(refusal([&] { fit_optics(glass, webber(), 1.49); }),
              testing::AllOf(HasSubstr("line 6"), HasSubstr("within 11.8 mm")));
}

TEST(OpticsFit, TheWrongDirectionIsFound) {
  Printer machine = true_machine();
  machine.rotation->direction = TurnDirection::counterclockwise;
  EXPECT_THAT(refusal([&] { fit_optics(measured(machine, kN, 0.3, 5), webber(), 1.49); }),
              testing::AllOf(HasSubstr("the stage turns counterclockwise"),
                             HasSubstr("as the printer file has it, clockwise")));
  // One pin in parallel light through a bath looks the same both ways.
  Printer bath = webber();
  bath.vial->n_outside = 1.5;
  bath.optics = Optics{};
  OpticsPoints one = measured(bath, 1.5, 0.1, 2, false);
  std::erase_if(one.points, [](const OpticsPoint& p) { return p.radius_mm != 4; });
  const OpticsFit fit = fit_optics(one, bath, 1.5);
  EXPECT_THAT(fit.notes, testing::Contains(HasSubstr("can't tell which way")));
}

TEST(OpticsFit, WhatIsLeftByAngleIsTheWobble) {
  Printer machine = true_machine();
  for (int k = 0; k < 12; ++k) {
    machine.rotation->wobble.push_back({30.0 * k, 0.8 * std::cos(2 * k * std::numbers::pi / 6), 0});
  }
  OpticsFit fit = fit_optics(measured(machine, kN, 0, 1), webber(), 1.49);
  EXPECT_GT(fit.rms_px, 0.2);
  const auto path = std::filesystem::temp_directory_path() /
                    fmt::format("slicecorr-optics-wobble-{}.csv", ::getpid());
  std::ofstream(path) << fit.wobble_csv();
  const Printer with = parse_printer(
      fmt::format("[display]\nwidth_px = 1024\nheight_px = 768\npixel_um = 54.0\n[blue]\n"
                  "calibration = [[0, 0.0], [255, 10.0]]\n[vial]\nouter_mm = 12.5\ninner_mm = "
                  "11.8\n[optics]\nkind = \"pinhole\"\ndistance_mm = 99.5\n[rotation]\ndeg_s = "
                  "12\ndirection = \"clockwise\"\nwobble = \"{}\"\n",
                  path.string()),
      "p.toml");
  std::filesystem::remove(path);
  ASSERT_EQ(with.rotation->wobble.size(), 12);
  for (int k = 0; k < 12; ++k) {
    EXPECT_NEAR(with.rotation->wobble[k].right_px, machine.rotation->wobble[k].right_px, 0.1) << k;
  }
  // With it in the printer's file less is left.
  const OpticsFit again = fit_optics(measured(machine, kN, 0, 1), with, 1.49);
  EXPECT_LT(again.rms_px, 0.05);
}

TEST(OpticsFit, TablesAreRefusedByLine) {
  const auto path = std::filesystem::path(::testing::TempDir()) /
                    fmt::format("slicecorr-optics-{}.csv", ::getpid());
  const auto says = [&](const std::string& text) {
    std::ofstream(path) << text;
    return refusal([&] { read_optics_points(path.string()); });
  };
  EXPECT_THAT(says(""), HasSubstr("is empty"));
  EXPECT_THAT(says("angle_deg,radius_mm,colour\n"), HasSubstr("'colour' is not known"));
  EXPECT_THAT(says("angle_deg,angle_deg\n"), HasSubstr("stands twice"));
  EXPECT_THAT(says("angle_deg,column_px\n0,1\n"), HasSubstr("has no column radius_mm"));
  EXPECT_THAT(says("angle_deg,radius_mm,column_px\n"), HasSubstr("has no points"));
  EXPECT_THAT(says("angle_deg,radius_mm,column_px\n0,4\n"),
              testing::AllOf(HasSubstr("line 2"), HasSubstr("2 cells; expected 3")));
  EXPECT_THAT(says("angle_deg,radius_mm,column_px\n0,-4,3\n"), HasSubstr("radius_mm is '-4'"));
  EXPECT_THAT(says("angle_deg,radius_mm,column_px\n0,nan,3\n"), HasSubstr("radius_mm is 'nan'"));
  EXPECT_THAT(says("angle_deg,radius_mm,column_px\n0,4,\n"), HasSubstr("measures nothing"));
  EXPECT_THAT(says("angle_deg,radius_mm,row_px\n0,4,7\n"), HasSubstr("z_mm with row_px"));
  EXPECT_THAT(says("angle_deg,radius_mm,column_px,sigma_px\n0,4,7,0\n"), HasSubstr("sigma_px"));
  std::ofstream(path)
      << "# by hand\nradius_mm,angle_deg,column_px,row_px,z_mm\n4,0,7,,\n4,30,,9,2\n";
  const OpticsPoints points = read_optics_points(path.string());
  ASSERT_EQ(points.points.size(), 2U);
  EXPECT_EQ(points.points[0].line, 3);
  EXPECT_EQ(points.points[0].column_px, 7);
  EXPECT_TRUE(std::isnan(points.points[0].row_px));
  EXPECT_EQ(points.points[1].row_px, 9);
  std::filesystem::remove(path);
}

}  // namespace
}  // namespace slicecorr::resins
