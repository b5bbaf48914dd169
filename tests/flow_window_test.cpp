// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// A window that gives way: closed forms, and check values on which two programs agreed that share no code
// with this one (finite volumes with backward differences; Chebyshev collocation with Radau).
#include "slicecorr/flow_window.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>

#include "flow/peel.hpp"
#include "ladder.hpp"
#include "lattice.hpp"
#include "program_fixture.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::test {
namespace {

using detail::peel;
using detail::Softness;
using nlohmann::json;
using testing::HasSubstr;
using testing::Not;

/// A disc over a rigid window: 3 mu S R²/h³ in the middle, half of it in the mean.
PulledSection pulled_disc(double radius_mm, double gap_um, double viscosity_pa_s,
                          double speed_mm_h) {
  PulledSection s;
  s.area_mm2 = M_PI * radius_mm * radius_mm;
  s.gap_um = gap_um;
  s.speed_mm_h = speed_mm_h;
  s.viscosity_pa_s = viscosity_pa_s;
  s.suction_pa = 3 * viscosity_pa_s * speed_mm_h / 3.6e6 * std::pow(radius_mm * 1e-3, 2) /
                 std::pow(gap_um * 1e-6, 3);
  s.force_n = s.suction_pa / 2 * s.area_mm2 * 1e-6;
  return s;
}

TEST(FlowWindow, ForcesOfSoftWindowsAreTheCheckValues) {
  struct Check {
    Softness softness;
    double share;
  };
  // The values have four digits, films at 1e4 are of grids alone: half a per cent for all.
  const Check all[] = {{{.arm = 0.01}, 0.9233},
                       {{.arm = 0.1}, 0.7317},
                       {{.arm = 1}, 0.4395},
                       {{.arm = 10}, 0.2038},
                       {{.arm = 1000}, 0.02817},
                       {{.springs = 0.01}, 0.9314},
                       {{.springs = 0.1}, 0.7277},
                       {{.springs = 1}, 0.3816},
                       {{.springs = 10}, 0.1280},
                       {{.springs = 1000}, 0.006738},
                       {{.film = 0.1}, 0.7928},
                       {{.film = 1}, 0.4961},
                       {{.film = 10}, 0.2185},
                       {{.film = 100}, 0.06980},
                       {{.film = 1e4}, 0.003825},
                       {{.film = 10, .span_ratio = 2}, 0.2530},
                       {{.film = 10, .stretch = 1}, 0.2216},
                       {{.film = 100, .stretch = 1}, 0.08032},
                       {{.film = 100, .stretch = 100}, 0.2090},
                       {{.rubber = 10, .thickness = 0.2}, 0.7207},
                       {{.rubber = 100, .thickness = 0.2}, 0.3598},
                       {{.rubber = 1000, .thickness = 0.2}, 0.1112}};
  for (const Check& c : all) EXPECT_NEAR(peel(c.softness).share / c.share, 1, 0.005) << c.share;
  EXPECT_EQ(peel({}).share, 1);
  // When the force is greatest; it is flat there.
  EXPECT_NEAR(peel({.springs = 1}).tau, 0.4899, 0.01);
  EXPECT_NEAR(peel({.springs = 10}).tau, 1.307, 0.02);
  EXPECT_NEAR(peel({.film = 1}).tau, 0.4891, 0.01);
  EXPECT_NEAR(peel({.film = 100}).tau, 4.754, 0.05);
}

TEST(FlowWindow, AnArmFollowsItsEquation) {
  // H + Pi H'/H³ = 1 + tau, by Runge and Kutta; the force is H'/H³.
  for (const double group : {0.3, 3.0, 300.0}) {
    const auto rate = [&](double tau, double h) { return (1 + tau - h) * h * h * h / group; };
    double h = 1, most = 0;
    const double step = 1e-4 * std::sqrt(group);
    for (double tau = 0; tau < 4 * std::sqrt(group) + 2; tau += step) {
      const double a = rate(tau, h), b = rate(tau + step / 2, h + step / 2 * a),
                   c = rate(tau + step / 2, h + step / 2 * b), d = rate(tau + step, h + step * c);
      h += step / 6 * (a + 2 * b + 2 * c + d);
      most = std::max(most, (1 + tau + step - h) / group);
    }
    EXPECT_NEAR(peel({.arm = group}).share / most, 1, 0.003) << group;
  }
}

TEST(FlowWindow, SoftWindowsGoTowardsTheirPowers) {
  // Springs come to 1.467 Pi^-3/4 from below, slowly.
  const auto over_power = [](double group) {
    return peel({.springs = group}).share * std::pow(group, 0.75);
  };
  EXPECT_LT(over_power(1e3), over_power(1e4));
  EXPECT_LT(over_power(1e4), 1.467);
  // Springs and an arm together yield more than either.
  const double both = peel({.springs = 1, .arm = 1}).share;
  EXPECT_LT(both, peel({.springs = 1}).share);
  EXPECT_LT(both, peel({.arm = 1}).share);
}

TEST(FlowWindow, PullingOffADiscOfTenMillimetres) {
  // 10 mm, 50 um, 0.3 Pa·s, 1 mm/s: F_r 113.1 N.
  const PulledSection s = pulled_disc(10, 50, 0.3, 3600);
  EXPECT_NEAR(s.force_n, 113.1, 0.05);
  FlowWindow film;
  film.film_n_m = 300;
  film.film_radius_mm = 50;
  const WindowPull of_film = window_pull(film, s);
  EXPECT_NEAR(of_film.force_n, 0.702, 0.004);
  EXPECT_NEAR(of_film.travel_um, 920, 10);
  FlowWindow arm;
  arm.arm_n_mm = 100;
  const WindowPull of_arm = window_pull(arm, s);
  EXPECT_NEAR(of_arm.force_n, 16.77, 0.08);
  EXPECT_NEAR(of_arm.travel_um, 212, 3);
  EXPECT_EQ(window_pull({}, s).share, 1);
  EXPECT_EQ(window_pull({}, s).exponent, 1);
}

TEST(FlowWindow, ExponentsOfSpeedAreTheCheckValues) {
  PulledSection s = pulled_disc(10, 50, 0.3, 3600);
  FlowWindow springs;
  for (const auto& [group, exponent] : {std::pair{0.01, 0.948}, {1.0, 0.616}, {10.0, 0.448}}) {
    springs.springs_um_per_kpa = group * s.gap_um / s.suction_pa * 1e3;
    // To three digits, and differences over a factor of 1.2.
    EXPECT_NEAR(window_pull(springs, s).exponent, exponent, 0.003) << group;
  }
  FlowWindow arm;
  arm.arm_n_mm = s.force_n / (s.gap_um * 1e-3);
  EXPECT_NEAR(window_pull(arm, s).exponent, 0.717, 0.003);
}

TEST(FlowWindow, AtRestTheFrontIsADome) {
  // 10 mm, 80 um, 0.3 Pa·s, 300 mm/h; film of 300 N/m over 50 mm.
  const PulledSection s = pulled_disc(10, 80, 0.3, 300);
  FlowWindow film;
  film.film_n_m = 300;
  film.film_radius_mm = 50;
  const WindowRest rest = window_rest(film, s);
  EXPECT_NEAR(rest.middle_um, 2880, 1);
  EXPECT_NEAR(rest.rim_um, 1965, 1);
  EXPECT_NEAR(rest.time_s, 30.35, 0.02);
  // kappa of Rs/R 2: t = kappa 3 mu R⁴/(T h³).
  film.film_radius_mm = 20;
  EXPECT_NEAR(window_rest(film, s).time_s, 0.2899 * 3 * 0.3 * 1e-8 / (300 * std::pow(80e-6, 3)),
              0.003);

  FlowWindow springs;
  springs.springs_um_per_kpa = 1;  // 1e-9 m/Pa
  const WindowRest of_springs = window_rest(springs, s);
  EXPECT_NEAR(of_springs.middle_um, 14.648, 0.002);
  EXPECT_EQ(of_springs.rim_um, 0);
  EXPECT_NEAR(of_springs.time_s, 0.6917 * 3 * 0.3 * 1e-9 * 1e-4 / std::pow(80e-6, 3), 1e-4);
  EXPECT_NEAR(*window_snap_mm_h(springs, s), 409.6, 0.1);
  EXPECT_FALSE(window_snap_mm_h(film, s));

  FlowWindow arm;
  arm.arm_n_mm = 10;
  EXPECT_NEAR(window_rest(arm, s).middle_um, 230.1, 0.1);
  EXPECT_EQ(window_rest(arm, s).middle_um, window_rest(arm, s).rim_um);
}

TEST(FlowWindow, RubberRisesInTheMiddleBySinkingAtItsOutline) {
  // 10 mm, 80 um, 0.3 Pa·s, 300 mm/h; 2 mm of 2 MPa.
  const PulledSection s = pulled_disc(10, 80, 0.3, 300);
  FlowWindow rubber;
  rubber.rubber_mm = 2;
  rubber.rubber_mpa = 2;
  const WindowRest rest = window_rest(rubber, s);
  EXPECT_NEAR(rest.middle_um, 1.947, 0.002);
  EXPECT_NEAR(rest.rim_um, -1.00, 0.006);
  // No part of a change lives longer than 12 mu L/(h³ k²), which is greatest at k = 0: L t³ k²/E there.
  EXPECT_TRUE(rest.at_most);
  EXPECT_NEAR(rest.time_s, 12 * 0.3 * 8e-9 / (2e6 * std::pow(80e-6, 3)), 1e-9);
  double before = rest.time_s;
  for (double x = 0.05; x < 10; x += 0.05) {  // k t
    const double k = x / 2e-3, modulus = 2e6 / 3;
    const double sinks =
        (std::sinh(2 * x) - 2 * x) / (2 * k * modulus * (std::cosh(2 * x) + 1 + 2 * x * x));
    const double lives = 12 * 0.3 * sinks / (std::pow(80e-6, 3) * k * k);
    EXPECT_LT(lives, before);
    before = lives;
  }
  EXPECT_FALSE(window_rest({.springs_um_per_kpa = 1}, s).at_most);
  // In units: w G/(s0 R) at t/R 0.1.
  rubber.rubber_mm = 1;
  const double unit_um = s.suction_pa * 10e-3 / (2e6 / 3) * 1e6;
  EXPECT_NEAR(window_rest(rubber, s).middle_um / unit_um, 0.001320, 2e-6);
  EXPECT_NEAR(window_rest(rubber, s).rim_um / unit_um, -0.00165, 5e-6);
}

TEST(FlowWindow, AFilmThatStretchesCarriesItsOwnTension) {
  // T from its own rise, by sums: mean over the span of half of the slope's square.
  const PulledSection s = pulled_disc(10, 80, 0.3, 300);
  FlowWindow film;
  film.film_n_m = 300;
  film.film_radius_mm = 30;
  film.film_stretch_n_m = 5e5;
  const double soft_um = [&] {
    FlowWindow plain = film;
    plain.film_stretch_n_m = 0;
    return window_rest(plain, s).middle_um;
  }();
  const double tension = film.film_n_m * soft_um / window_rest(film, s).middle_um;
  double squares = 0;
  constexpr int steps = 20000;
  for (int k = 0; k < steps; ++k) {
    const double r = 30e-3 * (k + 0.5) / steps, x = r / 10e-3;
    const double inside = s.suction_pa * 10e-3 * (x / 2 - x * x * x / 4),
                 beside = s.suction_pa * 1e-4 / (4 * r);
    const double slope = (x < 1 ? inside : beside) / tension;
    squares += slope * slope / 2 * 2 * r / (30e-3 * 30e-3) * (30e-3 / steps);
  }
  // Midpoint sums of 20,000 steps.
  EXPECT_NEAR(tension, film.film_n_m + film.film_stretch_n_m * squares, 1e-5 * tension);
  EXPECT_GT(tension, 2 * film.film_n_m);
}

TEST(FlowWindow, WhatDoesNotFitIsRefused) {
  const PulledSection s = pulled_disc(10, 80, 0.3, 300);
  const auto refused = [&](const FlowWindow& w) {
    try {
      window_rest(w, s);
    } catch (const InputError& e) {
      return std::string(e.what());
    }
    return std::string("nothing");
  };
  EXPECT_THAT(refused({.springs_um_per_kpa = 1, .film_n_m = 1, .film_radius_mm = 50}),
              HasSubstr("one of them"));
  EXPECT_THAT(refused({.film_n_m = 1}), HasSubstr("the radius over which it is free"));
  EXPECT_THAT(refused({.film_radius_mm = 1}), HasSubstr("its tension"));
  EXPECT_THAT(refused({.film_n_m = 1, .film_radius_mm = 9}),
              HasSubstr("expected a film that reaches beyond the part"));
  EXPECT_THAT(refused({.film_stretch_n_m = 1}), HasSubstr("what stretches is a film"));
  EXPECT_THAT(refused({.springs_um_per_kpa = -1}), HasSubstr("expected a number above 0"));
  EXPECT_THAT(refused({.rubber_mm = 1}), HasSubstr("its thickness and its modulus"));
  EXPECT_THAT(refused({.arm_n_mm = std::nan("")}), HasSubstr("expected a number above 0"));
}

class FlowWindowProgram : public ProgramFixture {};

TEST_F(FlowWindowProgram, TellsDomesAndForcesOfEachSlice) {
  std::ofstream(folder_ / "small.toml") << kSmallPrinter;
  std::ofstream(folder_ / "r.toml")
      << "name = \"r\"\nviscosity_pa_s = 0.3\n[cure]\nmodel = \"jacobs\"\nabsorbance_height_um = 100\n"
         "absorbance_base = \"e\"\ngel_dose_mj_cm2 = 10\n";
  TriangleMesh mesh;
  add_strut(mesh, {0, 0, 0}, {0, 0, 0.2}, 2.5, 180);
  write_stl(folder_ / "disc.stl", mesh);
  const Command rigid{"flow",         "disc.stl", "--layer-um", "50",       "--printer",
                      "small.toml",   "--resin",  "r.toml",     "--gap-um", "50",
                      "--speed-mm-h", "3600",     "--json",     "-"};
  const json plain = json::parse(good(rigid).out);
  EXPECT_FALSE(plain.contains("window"));
  EXPECT_FALSE(plain["slices"][0].contains("window"));

  const json film = json::parse(
      good(rigid + Command{"--film-n-m", "20", "--film-radius-mm", "12.5", "-o", "flow.html"}).out);
  EXPECT_EQ(film["window"]["film_n_m"], 20);
  EXPECT_TRUE(film["window"]["springs_um_per_kpa"].is_null());
  const json& s = film["slices"][1];
  // What rises without a pause feels the same suction. Cells of 100 um under 5 mm: 1 %.
  EXPECT_EQ(s["suction_pa"], plain["slices"][1]["suction_pa"]);
  const double suction = 3 * 0.3 * 1e-3 * 6.25e-6 / 1.25e-13;
  EXPECT_NEAR(s["suction_pa"].get<double>(), suction, 0.02 * suction);
  const double load_um = suction * 6.25e-6 / 20 * 1e6;
  EXPECT_NEAR(s["window"]["middle_um"].get<double>(), load_um * (3.0 / 16 + std::log(5) / 4),
              0.02 * load_um);
  EXPECT_NEAR(s["window"]["rim_um"].get<double>(), load_um * std::log(5) / 4, 0.02 * load_um);
  // s0 R²/(T h0) is 281; the check values of 100 and 10,000 enclose it.
  EXPECT_LT(s["window"]["pull_share"].get<double>(), 0.0698);
  EXPECT_GT(s["window"]["pull_share"].get<double>(), 0.0038);
  EXPECT_NEAR(s["window"]["pull_n"].get<double>(),
              s["force_n"].get<double>() * s["window"]["pull_share"].get<double>(), 1e-9);
  std::ifstream page(folder_ / "flow.html");
  const std::string html{std::istreambuf_iterator<char>(page), {}};
  EXPECT_THAT(html, HasSubstr("window: a film of 20 N/m, free over a radius of 12.5 mm"));
  EXPECT_THAT(html, HasSubstr("pulled off at 3600 mm/h from 50 um"));
  // It leans too far for what is told.
  EXPECT_THAT(film["warnings"].dump(), HasSubstr("the window leans by"));

  bad(2, rigid + Command{"--film-n-m", "20"}, {"the radius over which it is free"});
  bad(2, rigid + Command{"--film-n-m", "20", "--film-radius-mm", "2"}, {"reaches beyond the part"});
  bad(2, rigid + Command{"--rubber-mm", "0"}, {"--rubber-mm"});
}

TEST_F(FlowWindowProgram, ResinsOfTheDatabaseCarryTheBandOfLaboratories) {
  std::ofstream(folder_ / "small.toml") << kSmallPrinter;
  TriangleMesh mesh;
  add_strut(mesh, {0, 0, 0}, {0, 0, 0.2}, 2, 12);
  write_stl(folder_ / "disc.stl", mesh);
  // It says no viscosity, so that nothing is reckoned.
  const Command flow{"flow",       "disc.stl", "--layer-um",     "50",           "--printer",
                     "small.toml", "--resin",  "custom-resin-1", "--speed-mm-h", "300"};
  // The folder that the user names is the user's own.
  EXPECT_THAT(call(flow).err, Not(HasSubstr("not measured on this printer")));
  options_.environment["SLICECORR_DB"] = "";
  const std::string told = call(flow).err;
  EXPECT_THAT(
      told, HasSubstr("resin 'custom-resin-1' is from the database, not measured on this printer"));
  EXPECT_THAT(told, HasSubstr("7 times apart in absorbance height and 70 times in dose"));
  EXPECT_THAT(call(flow + Command{"--quiet"}).err, Not(HasSubstr("not measured")));
}

}  // namespace
}  // namespace slicecorr::test
