// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The flow under a section against closed forms, streamlines, and figures of chapter IV in the limit
// of a thin gap. h 80 um, 0.3 Pa s and 300 mm/h unless said.
#include "slicecorr/flow_section.hpp"

#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <cmath>
#include <numbers>
#include <numeric>
#include <random>

#include "flow/net.hpp"
#include "flow_shapes.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr {
namespace {

using namespace test;

constexpr double kGap = 80, kViscosity = 0.3, kSpeed = 300;
using std::numbers::pi;

double pa(double phi_um2) { return suction_pa(phi_um2, kViscosity, kSpeed, kGap); }
double newtons(double integral_um4) {
  return suction_force_n(integral_um4, kViscosity, kSpeed, kGap);
}

/// Dose along one line of the flow, which came in at F = `share_in`: dt = h dq/(S F).
double streamline_dose(const FlowResin& r, double blue, double uv, double share_in) {
  const Kinetics& k = r.kinetics;
  const double from = flow_share_inverse(share_in), per_s = kGap / (kSpeed / 3.6);
  const int steps = 20000;
  double y = 0;
  for (int i = 0; i < steps; ++i) {
    const double q = from + (1 - from) * (i + 0.5) / steps, dt = per_s * (1 - from) / steps;
    const double a =
        blue * std::exp(-kGap * q / k.hb_um) - k.beta * uv * std::exp(-kGap * q / k.huv_um);
    const double t = dt / flow_share(q);
    if (y < 0 || (y == 0 && a < 0)) {
      y = r.inhibitor_life_s > 0 ? (y + a * t) / (1 + t / r.inhibitor_life_s) : 0;
      if (k.m != 1 && y > 0) y = 0;
    } else {
      y += std::copysign(std::pow(std::abs(a), k.m), a) * t;
      if (r.inhibitor_life_s == 0) y = std::max(y, 0.0);
    }
  }
  return y / k.critical_dose_prime;
}

// ------------------------------------------------------------------------------------ pressure

TEST(FlowShapes, Figures) {
  using namespace flow_shapes;
  // Five digits are given.
  EXPECT_NEAR(pa(disc_phi_um2(10e3, 0)), 14648, 0.5);
  EXPECT_NEAR(newtons(disc_integral_um4(10e3)), 2.3010, 5e-5);
  EXPECT_NEAR(pa(rectangle_max_phi_um2(10e3, 20e3)), 6672.2, 0.05);
  EXPECT_NEAR(pa(rectangle_max_phi_um2(20e3, 10e3)), 6672.2, 0.05);
  EXPECT_NEAR(pa(rectangle_mean_phi_um2(10e3, 20e3)), 3349.8, 0.05);
  EXPECT_NEAR(pa(rectangle_max_phi_um2(8e3, 8e3)), 2762.7, 0.05);
  EXPECT_NEAR(pa(ellipse_phi_um2(9e3, 4.5e3, 0, 0)), 4746.1, 0.05);
  EXPECT_NEAR(newtons(ellipse_integral_um4(9e3, 4.5e3)), 0.30193, 5e-6);
  EXPECT_NEAR(ring_peak_um(3e3, 9e3), 5724, 0.5);
  EXPECT_NEAR(pa(ring_phi_um2(3e3, 9e3, ring_peak_um(3e3, 9e3))), 2721.2, 0.05);
  EXPECT_NEAR(pa(disc_phi_um2(9e3, 3e3)), 10547, 0.5);
  EXPECT_NEAR(strip_phi_um2(5e3, 0) / rectangle_max_phi_um2(10e3, 1e6), 1, 1e-12);
  EXPECT_NEAR(strip_integral_um3(5e3) / (rectangle_mean_phi_um2(10e3, 1e7) * 10e3), 1, 1e-3);
  EXPECT_NEAR(platform_changeover_um(25e3, 10e3, 252), 855, 0.5);
}

TEST(FlowShapes, SpeedLimits) {
  const double disc = flow_shapes::disc_phi_um2(10e3, 0);
  EXPECT_NEAR(suction_speed_limit_mm_h(disc, kViscosity, kGap, 0.2e5), 409.6, 0.05);
  EXPECT_NEAR(suction_speed_limit_mm_h(disc, kViscosity, kGap, 0.5e5), 1024, 0.5);
  EXPECT_NEAR(suction_speed_limit_mm_h(flow_shapes::disc_phi_um2(25e3, 0), kViscosity, 100, 0.5e5),
              320.0, 0.05);
}

// A grid of n cells across meets smooth outlines to the second order: with 64, 0.3 percent at most.
TEST(GapPressure, RoundSections) {
  const FlowSection disc = disc_section(10e3, 64);
  const GapPressure p = solve_pressure(disc);
  EXPECT_NEAR(pa(p.max_phi_um2) / 14648, 1, 3e-3);
  EXPECT_NEAR(newtons(p.integral_um4) / 2.3010, 1, 3e-3);
  EXPECT_NEAR(p.max_x, disc.width / 2 - 0.5, 0.6);
  EXPECT_NEAR(p.max_y, disc.height / 2 - 0.5, 0.6);
  const FlowSection ellipse = section_where(
      9e3, 4.5e3, 18e3 / 64, [](double x, double y) { return x * x / 81e6 + y * y / 20.25e6 < 1; });
  const GapPressure e = solve_pressure(ellipse);
  EXPECT_NEAR(pa(e.max_phi_um2) / 4746.1, 1, 5e-3);  // 32 cells across its shorter axis
  EXPECT_NEAR(newtons(e.integral_um4) / 0.30193, 1, 5e-3);
}

TEST(GapPressure, Rectangles) {
  // Fewer cells than the sides have thirds of; the outline lies a quarter into the outermost ones.
  const double pitch = 10e3 / 40.5;
  const FlowSection s = section_where(
      5e3, 10e3, pitch, [](double x, double y) { return std::abs(x) < 5e3 && std::abs(y) < 10e3; });
  const GapPressure p = solve_pressure(s);
  EXPECT_NEAR(pa(p.max_phi_um2) / 6672.2, 1, 3e-3);
  EXPECT_NEAR(newtons(p.integral_um4) / (3349.8 * 200e-6), 1, 5e-3);
  const GapPressure square = solve_pressure(full_section(64, 64, 125));
  EXPECT_NEAR(pa(square.max_phi_um2) / 2762.7, 1, 1e-3);
}

TEST(GapPressure, RingsOpenAndBlind) {
  EXPECT_NEAR(pa(solve_pressure(ring_section(18e3 / 96)).max_phi_um2) / 2721.2, 1, 3e-3);
  const FlowSection s = ring_section(18e3 / 96, FlowCell::blind);
  const GapPressure p = solve_pressure(s);
  // The hole's edge is a staircase, half a cell off at most and less on average.
  EXPECT_NEAR(pa(p.max_phi_um2) / 10547, 1, 5e-3);
  EXPECT_EQ(p.phi_um2[s.index(s.width / 2, s.height / 2)], p.max_phi_um2);
  EXPECT_EQ(p.phi_um2[s.index(s.width / 2 + 5, s.height / 2)], p.max_phi_um2);
  // With even light the dose outside of the hole is that of the full disc.
  const SectionDose dose = even_dose(sweep_of(s, chapter_iv_resin2()), 164, 275);
  EXPECT_NEAR(value_at(s, dose.front, 0.7 * 9e3, 0), 0.8743, 0.01);
  EXPECT_EQ(dose.front[s.index(s.width / 2, s.height / 2)], 0);
}

TEST(GapPressure, VoidsThatAreOneSharePressure) {
  FlowSection s = full_section(40, 20, 250);
  const std::size_t left = s.index(8, 10), right = s.index(28, 12);
  s.cells[left] = s.cells[right] = FlowCell::blind;
  const GapPressure apart = solve_pressure(s);
  EXPECT_NE(apart.phi_um2[left], apart.phi_um2[right]);
  s.voids.assign(s.size(), 0);
  const GapPressure one = solve_pressure(s);
  EXPECT_EQ(one.phi_um2[left], one.phi_um2[right]);
}

TEST(GapPressure, GapsThatVary) {
  const FlowSection disc = disc_section(10e3, 64);
  const GapPressure even = solve_pressure(disc);
  std::vector<double> gap(disc.size(), 80.0);
  const GapPressure same = solve_pressure(disc, gap, 160);
  EXPECT_NEAR(same.max_phi_um2 / (8 * even.max_phi_um2), 1, 1e-9);
  // Part within platform: Q = -S r/2 whatever the gap, so dp/dr = 6 mu S r/h³ on either side.
  for (int y = 0; y < disc.height; ++y) {
    for (int x = 0; x < disc.width; ++x) {
      const double r =
          disc.pitch_x_um * std::hypot(x - disc.width / 2 + 0.5, y - disc.height / 2 + 0.5);
      gap[disc.index(x, y)] = r < 5e3 ? 80 : 120;
    }
  }
  const GapPressure stepped = solve_pressure(disc, gap, 80);
  const double expected = 3 * 25e6 + 3 * 75e6 * std::pow(80.0 / 120, 3);
  // The step is a staircase.
  EXPECT_NEAR(stepped.max_phi_um2 / expected, 1, 0.01);
}

TEST(GapPressure, WhatFlowsInIsWhatIsDrawnIn) {
  FlowSection s = ring_section(18e3 / 48);
  s.cells[s.index(s.width / 2, 6)] = FlowCell::blind;
  const GapPressure p = solve_pressure(s);
  const detail::FlowPath path(s, p, {});
  double in = 0, drawn = 0;
  for (std::size_t n = 0; n < path.net.parts(); ++n) {
    for (const detail::FlowFace& face : path.net.faces[n]) {
      if (face.node < 0) {
        in += face.conductance * p.phi_um2[path.net.cell_of[n]] / (12 * s.cell_um2());
      }
    }
  }
  for (const double area : path.net.area) drawn += area;
  // Conjugate gradients stop at 1e-12.
  EXPECT_NEAR(in / drawn, 1, 1e-10);
  // D's first instant: 25 um under a plate of 25 mm; through the rim 0.1636 cm³/s at 41.7 mm/s.
  const FlowSection plate = disc_section(25e3, 64);
  const detail::FlowPath rim(plate, solve_pressure(plate), {});
  const double cm3_s =
      static_cast<double>(rim.net.parts()) * plate.cell_um2() * (kSpeed / 3.6) * 1e-12;
  EXPECT_NEAR(cm3_s, 0.1636, 0.001);
  EXPECT_NEAR(cm3_s / (2 * pi * 2.5 * 25e-4) * 10, 41.7, 0.3);
}

TEST(GapPressure, DistancesAndFeltGaps) {
  const FlowSection s = full_section(11, 7, 100);
  const std::vector<double> d = outline_distance_um(s);
  EXPECT_NEAR(d[s.index(5, 3)], 350, 1e-9);
  EXPECT_NEAR(d[s.index(0, 3)], 50, 1e-9);
  EXPECT_NEAR(d[s.index(2, 3)], 250, 1e-9);
  std::vector<double> gap(s.size(), 400.0);
  gap[s.index(5, 3)] = 50;
  const std::vector<double> felt = felt_gap_um(s, gap);
  EXPECT_NEAR(felt[s.index(7, 3)], 50 + 0.7 * 200, 1e-9);
  EXPECT_NEAR(felt[s.index(6, 4)], 50 + 70 * std::sqrt(2), 1e-9);
  EXPECT_NEAR(felt[s.index(0, 3)], 400, 1e-9);
}

// ---------------------------------------------------------------------------------------- dose

TEST(SectionSweep, WhereResinCameFrom) {
  const FlowSection disc = disc_section(10e3, 64);
  const auto of_disc = around(disc, share_in(disc, solve_pressure(disc)), 10e3);
  for (std::size_t k = 1; k < kRadii.size(); ++k) {
    EXPECT_NEAR(of_disc[k] / (kRadii[k] * kRadii[k]), 1, 3e-3) << kRadii[k];
  }
  // Creases along the diagonals of a square.
  const FlowSection square = full_section(64, 64, 125);
  const std::vector<double> share = share_in(square, solve_pressure(square));
  EXPECT_NEAR(value_at(square, share, 1e3, 0), 0.08314, 5e-4);
  EXPECT_NEAR(value_at(square, share, 2e3, 0), 0.31174, 1e-3);
  EXPECT_NEAR(value_at(square, share, 3e3, 0), 0.63547, 1e-3);
}

TEST(SectionSweep, StreamlinesWithoutDiffusion) {
  const FlowSection disc = disc_section(10e3, 64);
  struct Case {
    double life_s, m;
  };
  for (const Case& c : {Case{INFINITY, 1}, {0, 1}, {3, 1}, {INFINITY, 0.9}}) {
    FlowResin resin = chapter_iv_resin2();
    resin.diffusion_m2_s = 0;
    resin.inhibitor_life_s = c.life_s;
    resin.kinetics.m = c.m;
    const auto dose = around(disc, even_dose(sweep_of(disc, resin), 164, 275).front, 10e3);
    // 0.1 is three cells from the middle; the others lie within what 64 cells and 48 levels leave.
    for (std::size_t k = 1; k < kRadii.size(); ++k) {
      EXPECT_NEAR(dose[k] / streamline_dose(resin, 164, 275, kRadii[k] * kRadii[k]), 1, 0.005)
          << kRadii[k] << " life " << c.life_s << " m " << c.m;
    }
  }
}

TEST(SectionSweep, StreamlinesOfTheTest) {
  FlowResin resin = chapter_iv_resin2();
  resin.diffusion_m2_s = 0;
  const std::array<double, 5> signed_dose{0.5151, 1.6047, 1.2730, 0.8813, 0.4495};
  for (std::size_t k = 0; k < kRadii.size(); ++k) {
    EXPECT_NEAR(streamline_dose(resin, 164, 275, kRadii[k] * kRadii[k]), signed_dose[k], 2e-4);
  }
  resin.inhibitor_life_s = 0;
  EXPECT_NEAR(streamline_dose(resin, 164, 275, 0.01), 1.6311, 2e-4);
  for (const auto& [life, dose] : {std::pair{1.0, 1.525}, {3.0, 1.228}, {10.0, 0.841}}) {
    resin.inhibitor_life_s = life;
    EXPECT_NEAR(streamline_dose(resin, 164, 275, 0.01), dose, 5e-3) << life;
  }
}

TEST(SectionSweep, TheMiddleWithoutDiffusion) {
  // Near the middle a coarse grid mixes what differs most, so cells are fine here.
  const FlowSection disc = disc_section(10e3, 160);
  FlowResin resin = chapter_iv_resin2();
  resin.diffusion_m2_s = 0;
  for (const auto& [life, dose] :
       {std::pair<double, double>{INFINITY, 0.5151}, {0, 1.6311}, {1, 1.525}, {10, 0.841}}) {
    resin.inhibitor_life_s = life;
    const auto doses = around(disc, even_dose(sweep_of(disc, resin), 164, 275).front, 10e3);
    EXPECT_NEAR(doses[0], dose, 0.05) << life;
  }
}

TEST(SectionSweep, WithDiffusion) {
  const FlowSection disc = disc_section(10e3, 64);
  const auto r2 =
      around(disc, even_dose(sweep_of(disc, chapter_iv_resin2()), 164, 275).front, 10e3);
  // A march of the second order in tau and q at 480 levels; 1.011, 1.380, 1.237, 0.8735, 0.4417 are
  // those of one of the first order at 240, which is 0.02 off at 0.1.
  const std::array<double, 5> expected{0.9932, 1.3807, 1.2397, 0.8743, 0.4428};
  for (std::size_t k = 0; k < kRadii.size(); ++k) {
    EXPECT_NEAR(r2[k], expected[k], 0.004) << kRadii[k];
  }
  const auto r1 =
      around(disc, even_dose(sweep_of(disc, chapter_iv_resin1(), 150), 100, 130).front, 10e3);
  const std::array<double, 5> of_r1{2.905, 2.028, 1.409, 0.896, 0.425};
  for (std::size_t k = 0; k < kRadii.size(); ++k) {
    EXPECT_NEAR(r1[k] / of_r1[k], 1, k == 0 ? 0.03 : 0.01) << kRadii[k];
  }
}

TEST(SectionSweep, Strips) {
  // A rectangle five times as long as wide; in its middle the ends are not felt (e^-2.5pi).
  const FlowSection s = full_section(40, 200, 250);
  FlowResin resin = chapter_iv_resin2();
  const auto across = [&](double diffusion) {
    resin.diffusion_m2_s = diffusion;
    const SectionDose dose = even_dose(sweep_of(s, resin), 164, 275);
    std::array<double, 5> at{};
    for (std::size_t k = 0; k < 5; ++k) at[k] = value_at(s, dose.front, kRadii[k] * 5e3, 0);
    return at;
  };
  const auto still = across(0), spread = across(1e-10);
  const std::array<double, 5> of_still{1.5869, 1.1805, 0.8672, 0.5985, 0.3110};
  const std::array<double, 5> of_spread{1.382, 1.157, 0.858, 0.590, 0.301};
  for (std::size_t k = 0; k < 5; ++k) {
    // Two cells from the middle and from the outline, where dose goes like a root, lines between
    // middles of cells are 2 percent off.
    const double allow = k == 0 || k == 4 ? 0.025 : 0.007;
    EXPECT_NEAR(still[k] / of_still[k], 1, allow) << kRadii[k];
    EXPECT_NEAR(spread[k] / of_spread[k], 1, allow) << kRadii[k];
  }
}

TEST(SectionSweep, Squares) {
  const FlowSection s = full_section(64, 64, 125);
  const SectionDose dose = even_dose(sweep_of(s, chapter_iv_resin2()), 164, 275);
  EXPECT_NEAR(value_at(s, dose.front, 1e3, 0), 1.376, 0.006);
  EXPECT_NEAR(value_at(s, dose.front, 2e3, 0), 1.141, 0.004);
  EXPECT_NEAR(value_at(s, dose.front, 3e3, 0), 0.677, 0.004);
  EXPECT_NEAR(summarise(s, dose).within_10, 0.15, 0.01);
  // The section's symmetries.
  for (int y = 0; y < 64; ++y) {
    for (int x = 0; x < 64; ++x) {
      const double d = dose.front[s.index(x, y)];
      EXPECT_NEAR(dose.front[s.index(63 - x, y)], d, 1e-7);
      EXPECT_NEAR(dose.front[s.index(y, x)], d, 1e-7);
    }
  }
}

TEST(SectionSweep, LightAndSpeedTwiceTheSameDose) {
  const FlowSection s = disc_section(6e3, 24);
  FlowResin resin = chapter_iv_resin2();
  resin.diffusion_m2_s = 0;
  for (const double life : {double{INFINITY}, 0.0}) {
    resin.inhibitor_life_s = life;
    const SectionDose once = even_dose(sweep_of(s, resin), 164, 275);
    const SectionDose twice = even_dose(sweep_of(s, resin, kGap, 48, 600), 328, 550);
    for (std::size_t i = 0; i < s.size(); ++i) {
      EXPECT_NEAR(once.front[i], twice.front[i], 1e-12 * (1 + std::abs(once.front[i])));
    }
  }
}

TEST(SectionSweep, AllDoseThatIsGivenLeavesWithTheGel) {
  // Outlines along cells: what enters brings nothing, so it holds to the last bits.
  const FlowSection s = full_section(24, 17, 250);
  const SectionSweep sweep = sweep_of(s, chapter_iv_resin2());
  const SectionDose dose = even_dose(sweep, 164, 275);
  const Kinetics k = chapter_iv_resin2().kinetics;
  const double given = (164 * k.hb_um * -std::expm1(-kGap / k.hb_um) -
                        k.beta * 275 * k.huv_um * -std::expm1(-kGap / k.huv_um)) /
                       (kSpeed / 3.6) / k.critical_dose_prime;
  const double gelled = std::accumulate(dose.front.begin(), dose.front.end(), 0.0);
  EXPECT_NEAR(gelled / (given * static_cast<double>(s.size())), 1, 1e-9);
  // Of that, resin that does not move would get this much.
  EXPECT_NEAR(given, 0.84065, 5e-6);
}

struct Random {
  std::mt19937 engine{5};
  std::vector<double> light(std::size_t n, double most) {
    std::uniform_real_distribution<double> of(0, most);
    std::vector<double> v(n);
    for (double& x : v) x = of(engine);
    return v;
  }
};

double product(const std::vector<double>& a, const std::vector<double>& b) {
  return std::inner_product(a.begin(), a.end(), b.begin(), 0.0);
}

TEST(SectionSweep, LinearInBothLights) {
  const FlowSection s = odd_section();
  const SectionSweep sweep = sweep_of(s, chapter_iv_resin2());
  ASSERT_TRUE(sweep.linear());
  Random random;
  const auto b1 = random.light(s.size(), 200), u1 = random.light(s.size(), 300);
  const auto b2 = random.light(s.size(), 200), u2 = random.light(s.size(), 300);
  auto b = b1, u = u1;
  for (std::size_t i = 0; i < s.size(); ++i) b[i] += 3 * b2[i], u[i] += 3 * u2[i];
  const SectionDose one = sweep.dose(b1, u1), two = sweep.dose(b2, u2), sum = sweep.dose(b, u);
  for (std::size_t i = 0; i < s.size(); ++i) {
    EXPECT_NEAR(sum.front[i], one.front[i] + 3 * two.front[i], 1e-11);
    EXPECT_NEAR(sum.window[i], one.window[i] + 3 * two.window[i], 1e-11);
  }
}

TEST(SectionSweep, Adjoint) {
  const FlowSection s = odd_section();
  for (const double diffusion : {0.0, 1e-10}) {
    FlowResin resin = chapter_iv_resin2();
    resin.diffusion_m2_s = diffusion;
    std::vector<double> gap(s.size(), 80.0);
    for (std::size_t i = 0; i < s.size(); ++i) gap[i] += static_cast<double>(i % 7);
    const SectionSweep sweep(s, solve_pressure(s, gap, 80), resin, kSpeed, gap);
    Random random;
    const auto b = random.light(s.size(), 200), u = random.light(s.size(), 300);
    auto front = random.light(s.size(), 1), window = random.light(s.size(), 1);
    const SectionDose dose = sweep.dose(b, u);
    const SectionGradient back = sweep.adjoint(front, window);
    const double there = product(dose.front, front) + product(dose.window, window);
    const double here = product(b, back.blue) + product(u, back.uv);
    // Both are small differences of these.
    const double size = product(b, back.blue);
    EXPECT_NEAR(there / size, here / size, 1e-12) << diffusion;
  }
}

TEST(SectionSweep, GradientsOfEveryLaw) {
  const FlowSection s = odd_section();
  struct Law {
    double life_s, m, diffusion;
  };
  for (const Law& law : {Law{INFINITY, 1, 1e-10}, {2, 1, 1e-10}, {0, 1, 0}, {INFINITY, 0.9, 0}}) {
    FlowResin resin = chapter_iv_resin2();
    resin.diffusion_m2_s = law.diffusion;
    resin.inhibitor_life_s = law.life_s;
    resin.kinetics.m = law.m;
    const SectionSweep sweep = sweep_of(s, resin);
    Random random;
    const auto front = random.light(s.size(), 1);
    const std::vector<double> window(s.size(), 0.0);
    std::vector<double> b(s.size(), 160.0), u(s.size(), 270.0);
    const SectionGradient g = sweep.gradient(b, u, front, window);
    for (const auto& [x, y] : {std::pair{8, 12}, {17, 17}, {30, 20}}) {
      const std::size_t i = s.index(x, y);
      for (const bool uv : {false, true}) {
        const double step = 1e-3;
        auto moved_b = b, moved_u = u;
        (uv ? moved_u : moved_b)[i] += step;
        const double more = product(sweep.dose(moved_b, moved_u).front, front);
        (uv ? moved_u : moved_b)[i] -= 2 * step;
        const double less = product(sweep.dose(moved_b, moved_u).front, front);
        const double expected = (more - less) / (2 * step);
        EXPECT_NEAR((uv ? g.uv : g.blue)[i], expected, 1e-3 * std::abs(expected) + 1e-10)
            << law.life_s << " " << law.m << " at " << x << ", " << y;
      }
    }
  }
}

TEST(SectionSweep, CountsWhereDoseWasUndone) {
  const FlowSection s = full_section(30, 30, 250);
  FlowResin resin = chapter_iv_resin2();
  resin.diffusion_m2_s = 0;
  const SectionSweep sweep = sweep_of(s, resin);
  // Even light that keeps a dead zone and no diffusion: inhibitor first, dose above it.
  EXPECT_EQ(even_dose(sweep, 164, 275).undone_cells, 0U);
  // Bright outside, UV alone inside.
  std::vector<double> blue(s.size(), 164.0), uv(s.size(), 0.0);
  for (int y = 10; y < 20; ++y) {
    for (int x = 10; x < 20; ++x) blue[s.index(x, y)] = 0, uv[s.index(x, y)] = 275;
  }
  const SectionDose dose = sweep.dose(blue, uv);
  EXPECT_EQ(dose.undone_cells, 100U);
}

TEST(SectionSweep, ProfilesRunFromTheWindowToTheFront) {
  const FlowSection s = full_section(20, 20, 250);
  const SectionSweep sweep = sweep_of(s, chapter_iv_resin2());
  const double blue = 164, uv = 275;
  const std::vector<double> q = sweep.level_q();
  const std::vector<double> y = sweep.profile({&blue, 1}, {&uv, 1}, 7, 9);
  const SectionDose dose = even_dose(sweep, blue, uv);
  ASSERT_EQ(q.size(), y.size());
  EXPECT_TRUE(std::is_sorted(q.begin(), q.end()));
  EXPECT_GT(q.front(), 0);
  EXPECT_LT(q.back(), 1);
  EXPECT_LT(y.front(), 0);
  // The front is half a level on, where dose rises by what two levels differ by, or less.
  const double rise = y.back() - y[y.size() - 2];
  EXPECT_NEAR(dose.front[s.index(7, 9)] - y.back(), 0.5 * rise, 0.05 * rise);
  EXPECT_NEAR(y.front(), dose.window[s.index(7, 9)], 0.01);
  EXPECT_THROW(sweep.profile({&blue, 1}, {&uv, 1}, -1, 0), InputError);
}

}  // namespace
}  // namespace slicecorr
