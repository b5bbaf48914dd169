// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Light on its way into the vial of a tomographic printer: closed forms against printed figures, and against a march
// of rays by Snell's law in vectors.
#include "slicecorr/vial.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>
#include <string>

#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/kinetics.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/units.hpp"
#include "snell.hpp"

namespace slicecorr {
namespace {

using test::add;
using test::dot;
using test::march;
using test::Marched;
using test::Vector;

using std::numbers::pi;
constexpr double kDegrees = 180 / pi;

/// A dry vial of 25 mm, 0.7 mm of glass, and its resin.
const Vial kDry{12.5, 11.8, 1.0, 1.48};
constexpr double kResin = 1.49969;

/// As many digits as a figure is printed with are right.
#define EXPECT_DIGITS(value, printed, digits) \
  EXPECT_NEAR(value, printed, 0.5 * std::pow(10.0, -(digits)) * (1 + 1e-6)) << #value

Printer printer_with(const Vial& vial, OpticsKind kind, double distance_mm, int width_px = 1024) {
  Printer p;
  p.name = "bench";
  p.width_px = width_px;
  p.height_px = 768;
  p.pixel_x_um = p.pixel_y_um = 54;
  p.calibration = {{0, 0}, {255, 10}};
  p.vial = vial;
  p.optics = Optics{kind, distance_mm};
  return p;
}

// --- Printed figures

TEST(Vial, RaysInThePlane) {
  struct Row {
    double q, q3, delta_deg, chord, power;
  };
  for (const Row& r : {Row{3, 2.000413, 4.685270, 23.258405, .962440},
                       Row{6, 4.000827, 10.035718, 22.202107, .961284},
                       Row{10, 6.668045, 20.933405, 19.470714, .938461},
                       Row{12, 8.001654, 34.007345, 17.345148, .775363}}) {
    for (const double side : {1.0, -1.0}) {
      EXPECT_DIGITS(side * q_in_resin_mm(kDry, kResin, side * r.q, 0), r.q3, 6);
      EXPECT_DIGITS(side * turned_rad(kDry, kResin, side * r.q, 0) * kDegrees, r.delta_deg, 6);
      EXPECT_DIGITS(chord_mm(kDry, kResin, side * r.q, 0), r.chord, 6);
      EXPECT_DIGITS(transmittance(kDry, kResin, side * r.q, 0), r.power, 6);
    }
  }
  EXPECT_DIGITS(transmittance(kDry, kResin, 0, 0), .962497, 6);
  // One face from air to resin: a wall of the resin's index reflects nothing.
  const Vial bare{12.5, 11.8, 1.0, kResin};
  EXPECT_DIGITS(1 - transmittance(bare, kResin, 0, 0), .039960, 6);
  EXPECT_NEAR(1 - transmittance(bare, kResin, 0, 0), std::pow((kResin - 1) / (kResin + 1), 2),
              1e-15);
}

TEST(Vial, Reach) {
  const Printer wide = printer_with(kDry, OpticsKind::telecentric, 0);
  EXPECT_DIGITS(reach_mm(wide, kResin), 8.33506, 5);
  EXPECT_DIGITS(reach_mm(printer_with({4, 3.3, 1, 1.48}, OpticsKind::telecentric, 0), kResin),
                2.66722, 5);
  // In a bath light comes from everywhere; so it does where the resin bends light less than what is around it.
  EXPECT_DOUBLE_EQ(reach_mm(printer_with({12.5, 11.8, 1.5, 1.5}, OpticsKind::telecentric, 0), 1.5),
                   11.8);
  EXPECT_DOUBLE_EQ(reach_mm(printer_with({12.5, 11.8, 1.6, 1.5}, OpticsKind::telecentric, 0), 1.4),
                   11.8);
  // Light that the wall does not take in: from a bath of 1.6 into a wall of 1.1.
  EXPECT_DOUBLE_EQ(reach_mm(printer_with({12.5, 11.8, 1.6, 1.1}, OpticsKind::telecentric, 0), 1.6),
                   1.1 * 11.8 / 1.6);
}

TEST(Vial, ReachIsBoundedByTheImage) {
  const Vial bath{12.5, 11.8, 1.5, 1.5};
  // 201 columns: the outermost pixels lie at 5.4 mm.
  Printer narrow = printer_with(bath, OpticsKind::telecentric, 0, 201);
  EXPECT_NEAR(reach_mm(narrow, 1.5), 5.4, 1e-12);
  // A pinhole brings them nearer to the axis.
  const Printer cone = printer_with(bath, OpticsKind::pinhole, 50, 201);
  EXPECT_NEAR(reach_mm(cone, 1.5), 5.4 * std::cos(std::atan(5.4 / 50)), 1e-12);
  // The nearer side of an image that is off counts; one beside the axis has no reach.
  narrow.optics->axis_right_px = -40;
  EXPECT_NEAR(reach_mm(narrow, 1.5), 60 * .054, 1e-12);
  narrow.optics->axis_right_px = 100.5;
  EXPECT_EQ(reach_mm(narrow, 1.5), 0);
}

TEST(Vial, PinholeOutOfThePlane) {
  const auto line = [](double x, double z) { return LightLine{x, z, x / 99.5, z / 99.5}; };
  const auto middle = ray_in_resin(kDry, kResin, line(0, 19));
  ASSERT_TRUE(middle);
  const double elevation = std::asin(middle->kz);
  EXPECT_DIGITS(elevation * kDegrees, 7.184779, 6);
  EXPECT_DIGITS(middle->entry_z_mm, 16.702500, 6);
  EXPECT_DIGITS(middle->entry_z_mm + 11.8 * std::tan(elevation), 18.190002, 6);
  EXPECT_DIGITS(middle->climb_mm(), 2.975004, 6);
  EXPECT_EQ(middle->t_mm, 0);
  EXPECT_EQ(middle->turn_rad, 0);

  const auto side = ray_in_resin(kDry, kResin, line(6, 19));
  ASSERT_TRUE(side);
  // Of the plane: direction and foot, turned back from where the ray is parallel to u.
  const double s = std::sin(-side->turn_rad), c = std::cos(-side->turn_rad);
  const double back = std::sqrt(11.8 * 11.8 - side->t_mm * side->t_mm);
  EXPECT_DIGITS(side->t_mm * c - back * s, 5.234167, 6);
  EXPECT_DIGITS(-side->t_mm * s - back * c, -10.575609, 6);
  EXPECT_DIGITS(side->entry_z_mm, 16.934415, 6);
  const double flat = std::sqrt(1 - side->kz * side->kz);
  EXPECT_DIGITS(flat * s, -.116704, 6);
  EXPECT_DIGITS(flat * c, .985288, 6);
  EXPECT_DIGITS(side->kz, .124851, 6);
  EXPECT_DIGITS(side->chord_mm, 22.411076, 6);
  EXPECT_DIGITS(side->transmittance, .960920, 6);
}

TEST(Vial, HeightOnTheAxis) {
  const Printer pinhole = printer_with(kDry, OpticsKind::pinhole, 99.5);
  const double mu = height_on_axis(pinhole, kResin);
  EXPECT_DIGITS(mu, .958204, 6);
  // How much brighter a uniform frame is on the axis than without the vial.
  EXPECT_DIGITS(transmittance(kDry, kResin, 0, 0) * kResin / mu, 1.50641, 5);
  EXPECT_EQ(height_on_axis(printer_with(kDry, OpticsKind::telecentric, 0), kResin), 1);
  // It is the limit of rays near the optical axis.
  const auto ray = ray_in_resin(kDry, kResin, {0, 1e-4, 0, 1e-4 / 99.5});
  EXPECT_NEAR((ray->entry_z_mm + ray->climb_mm() / 2) / 1e-4, mu, 1e-9);
}

TEST(Vial, UniformLightAddsUpAsPrinted) {
  // Dose of a turn at radius r over that without a vial: in the resin, rays of all directions th' pass at
  // t' = r cos th', each from q = n3 t' / n1, with n3 / n1 times the light.
  const auto dose = [](double r, double alpha_per_mm) {
    constexpr int kSteps = 20000;
    double sum = 0;
    for (int i = 0; i < kSteps; ++i) {
      const double angle = 2 * pi * (i + 0.5) / kSteps;
      const double t = r * std::cos(angle), u = r * std::sin(angle);
      const double q = kResin * t;
      if (misses(kDry, kResin, q, 0)) continue;
      const double way = std::sqrt(11.8 * 11.8 - t * t) + u;
      sum += kResin * transmittance(kDry, kResin, q, 0) * std::exp(-alpha_per_mm * way);
    }
    return sum / kSteps;
  };
  const std::array<double, 4> radii{0, 4, 8, 10};
  const std::array<double, 4> clear{1.44345, 1.44281, 1.38306, .86985};
  const std::array<double, 4> dim{.53102, .56231, .64389, .45208};
  for (std::size_t i = 0; i < radii.size(); ++i) {
    EXPECT_DIGITS(dose(radii[i], 0), clear[i], 5);
    // These come from a deposit of rays, whose last digit may be off by one.
    EXPECT_NEAR(dose(radii[i], 1 / 11.8), dim[i], 1e-5);
  }
  EXPECT_NEAR(dose(0, 1 / 11.8), kResin * transmittance(kDry, kResin, 0, 0) * std::exp(-1.0),
              1e-12);
}

TEST(Vial, LightThatComesOnlyInPart) {
  EXPECT_FALSE(misses(kDry, kResin, 12.499, 0));
  EXPECT_TRUE(misses(kDry, kResin, 12.5, 0));
  EXPECT_TRUE(misses(kDry, kResin, -12.5, 0));
  EXPECT_TRUE(misses(kDry, kResin, std::nan(""), 0));
  // Reflected as a whole: at the resin, at the inner face of the wall.
  const Vial dense{12.5, 11.8, 1.6, 1.6};
  EXPECT_FALSE(misses(dense, 1.3, 1.3 / 1.6 * 11.8 - 1e-9, 0));
  EXPECT_TRUE(misses(dense, 1.3, 1.3 / 1.6 * 11.8 + 1e-9, 0));
  EXPECT_TRUE(std::isnan(chord_mm(kDry, kResin, 13, 0)));
  EXPECT_TRUE(std::isnan(turned_rad(kDry, kResin, 13, 0)));
  EXPECT_TRUE(std::isnan(transmittance(kDry, kResin, 13, 0)));
  EXPECT_FALSE(ray_in_resin(kDry, kResin, {13, 0, 0, 0}));
  // Grazing light is lost at the face.
  EXPECT_LT(transmittance(kDry, kResin, 12.5 * (1 - 1e-9), 0), 1e-3);
}

// --- The same by a march through two cylinders

void expect_march_to_agree(bool double_walled) {
  std::mt19937 random(25);
  const auto within = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  int rays = 0;
  while (rays < 20000) {
    Vial vial;
    vial.outer_mm = within(2, 40);
    vial.inner_mm = vial.outer_mm * within(.6, .99);
    vial.n_outside = within(1, 1.7);
    vial.n_wall = within(1.1, 1.9);
    if (double_walled) {
      vial.jacket_inner_mm = vial.outer_mm * within(1, 1.3);
      vial.jacket_outer_mm = vial.jacket_inner_mm * within(1.01, 1.2);
      vial.n_between = within(1, 1.6);
      vial.n_jacket = within(1.1, 1.9);
    }
    const double n_resin = within(1.1, 1.9);
    const LightLine line{vial.outside_mm() * within(-1, 1), within(-30, 30), within(-.4, .4),
                         within(-.4, .4)};
    const auto ray = ray_in_resin(vial, n_resin, line);
    // Near grazing, the march loses digits: cosines near 0 are roots of small differences.
    const double q = line.q_mm();
    if (misses(vial, n_resin, q * 1.02, line.kz())) continue;
    ASSERT_TRUE(ray);
    ++rays;
    const Marched m = march(vial, n_resin, line);
    const double s = std::sin(-ray->turn_rad), c = std::cos(-ray->turn_rad);
    const double flat = std::sqrt(1 - ray->kz * ray->kz);
    const double back = std::sqrt(vial.inner_mm * vial.inner_mm - ray->t_mm * ray->t_mm);
    ASSERT_NEAR(m.direction[0], flat * s, 1e-10);
    ASSERT_NEAR(m.direction[1], flat * c, 1e-10);
    ASSERT_NEAR(m.direction[2], ray->kz, 1e-10);
    ASSERT_NEAR(m.entry[0], ray->t_mm * c - back * s, 1e-10);
    ASSERT_NEAR(m.entry[1], -ray->t_mm * s - back * c, 1e-10);
    ASSERT_NEAR(m.entry[2], ray->entry_z_mm, 1e-10);
    const Vector way = add(m.exit, m.entry, -1);
    ASSERT_NEAR(std::sqrt(dot(way, way)), ray->chord_mm, 1e-10);
    ASSERT_NEAR(m.exit[2] - m.entry[2], ray->climb_mm(), 1e-10);
    ASSERT_NEAR(m.power, ray->transmittance, 1e-10);
    // The small functions say the same.
    ASSERT_EQ(q_in_resin_mm(vial, n_resin, q, line.kz()), ray->t_mm);
    ASSERT_EQ(turned_rad(vial, n_resin, q, line.kz()) - line.angle_rad(), ray->turn_rad);
  }
}

TEST(Vial, MarchThroughTwoCylindersAgrees) { expect_march_to_agree(false); }
TEST(Vial, MarchThroughFourCylindersAgrees) { expect_march_to_agree(true); }

/// A wall between two of the same index is none; between the walls of one index light goes as through one
/// thick wall. How far light comes is a minimum over all faces.
TEST(Vial, ASecondWallOfNothingIsNone) {
  const Vial one{5, 4, 1.2, 1.5};
  Vial two = one;
  two.jacket_outer_mm = 7;
  two.jacket_inner_mm = 6;
  two.n_between = two.n_jacket = 1.2;
  Vial thick{7, 4, 1.2, 1.5}, filled = two;
  filled.n_between = filled.n_jacket = 1.5;
  for (const double q : {-4.0, -1.0, 0.5, 3.0}) {
    const LightLine line{q, 2, 0.1, 0.2};
    for (const auto& [a, b] : {std::pair(one, two), std::pair(thick, filled)}) {
      const auto ray = ray_in_resin(a, 1.4, line), same = ray_in_resin(b, 1.4, line);
      ASSERT_TRUE(ray && same);
      EXPECT_NEAR(ray->turn_rad, same->turn_rad, 1e-14);
      EXPECT_NEAR(ray->entry_z_mm, same->entry_z_mm, 1e-13);
      EXPECT_NEAR(ray->transmittance, same->transmittance, 1e-14);
    }
  }
  // Air between the walls holds light back where neither wall does.
  Vial air = two;
  air.n_between = 1;
  EXPECT_NEAR(most_in_resin_mm(air, 1.5, 100), 5.0 / 1.5, 1e-14);
  EXPECT_NEAR(most_in_resin_mm(two, 1.5, 100), 4, 1e-14);
}

// --- Pixels

TEST(Vial, PixelsAsSeenFromTheProjector) {
  Printer p = printer_with(kDry, OpticsKind::telecentric, 0);
  // Middles of the middle four.
  EXPECT_DOUBLE_EQ(pixel_x_mm(p, 512), .027);
  EXPECT_DOUBLE_EQ(pixel_x_mm(p, 511), -.027);
  EXPECT_DOUBLE_EQ(pixel_z_mm(p, 383), .027);
  EXPECT_DOUBLE_EQ(pixel_z_mm(p, 384), -.027);
  p.optics->axis_right_px = 10.5;
  p.optics->axis_up_px = -20.5;
  EXPECT_DOUBLE_EQ(pixel_x_mm(p, 522), 0);
  EXPECT_DOUBLE_EQ(pixel_z_mm(p, 404), 0);
  EXPECT_EQ(chief_ray(p, 522, 0).slope_z, 0);
  // 1024 x .054 mm, throw ratio 1.8.
  p = printer_with(kDry, OpticsKind::pinhole, 99.5);
  EXPECT_DIGITS(p.width_px * p.pixel_x_um * 1e-3, 55.28, 1);
  EXPECT_DIGITS(99.5 / (1.8 * 1024), .054, 4);
  const LightLine line = chief_ray(p, 511.5 + 6 / .054, 383.5 - 19 / .054);
  EXPECT_NEAR(line.x_mm, 6, 1e-12);
  EXPECT_NEAR(line.z_mm, 19, 1e-12);
  EXPECT_NEAR(line.slope_x, 6 / 99.5, 1e-15);
  EXPECT_NEAR(line.slope_z, 19 / 99.5, 1e-15);
  EXPECT_NEAR(line.kz(), 19 / std::sqrt(99.5 * 99.5 + 36 + 361), 1e-15);
}

TEST(Vial, FramesOfATurn) {
  // 3 to 25 degrees a second at 25 images a second.
  EXPECT_EQ(most_frames_per_turn({3, TurnDirection::clockwise, 25}), 3000);
  EXPECT_EQ(most_frames_per_turn({25, TurnDirection::clockwise, 25}), 360);
  EXPECT_DOUBLE_EQ((Rotation{3}.turn_s()), 120);
  EXPECT_DOUBLE_EQ((Rotation{25}.turn_s()), 14.4);
  // 500 angles at 25 degrees a second need 34.7.
  EXPECT_EQ(most_frames_per_turn({25, TurnDirection::clockwise, 34.7}), 499);
  EXPECT_EQ(most_frames_per_turn({25, TurnDirection::clockwise, 34.73}), 500);
  EXPECT_EQ(most_frames_per_turn({25}), 0);
}

}  // namespace
}  // namespace slicecorr
