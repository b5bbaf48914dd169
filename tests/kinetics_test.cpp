// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Stationary exposure with and without UV light: the dissertation's figures, numerical integration
// of the law itself, limits, and the units that doses and heights come in.
#include "slicecorr/kinetics.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "models.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// The reference values have five significant digits; each is good to half a unit of the last one.
void expect_printed(double value, double printed) {
  const double last = std::pow(10.0, std::floor(std::log10(std::abs(printed))) - 4);
  EXPECT_NEAR(value, printed, 0.5001 * last);
}

/// D figure 3.4, in all plots but for the parameter that varies.
Kinetics figure_3_4() { return {750, 1, 100, 1, 100}; }
/// Custom Resin 1 and 2 (D figure 3.7).
Kinetics resin_1() { return {408, 0.99, 64, 0.73, 37.8}; }
Kinetics resin_2() { return {1631, 1.29, 238, 4.84, 100}; }

TEST(Kinetics, Figure34) {
  const Kinetics k = figure_3_4();
  expect_printed(steady_dead_zone_um(k, 100, 200), 79.979);
  const FirstGel first = first_gel(k, 100, 200);
  expect_printed(first.z_um, 312.47);
  expect_printed(first.time_s, 1.7502);
  const double expected[][3] = {{3, 139.17, 822.76}, {5, 110.39, 1207.0}, {10, 93.857, 1726.9}};
  for (const auto& [time, front, back] : expected) {
    const auto fronts = curing_fronts(k, 100, 200, time);
    ASSERT_TRUE(fronts) << time;
    expect_printed(fronts->front_um, front);
    expect_printed(fronts->back_um, back);
  }
  EXPECT_EQ(window_time_s(k, 100, 200), kInfinity);
}

TEST(Kinetics, CustomResins) {
  const Kinetics one = resin_1();
  expect_printed(steady_dead_zone_um(one, 100, 200), 15.766);
  expect_printed(first_gel(one, 100, 200).z_um, 114.87);
  expect_printed(first_gel(one, 100, 200).time_s, 0.97507);
  const auto fronts = curing_fronts(one, 100, 200, 30);
  ASSERT_TRUE(fronts);
  expect_printed(fronts->front_um, 16.709);
  expect_printed(fronts->back_um, 1566.7);

  const Kinetics two = resin_2();
  expect_printed(steady_dead_zone_um(two, 100, 100), 167.99);
  expect_printed(first_gel(two, 100, 100).z_um, 465.40);
  expect_printed(first_gel(two, 100, 100).time_s, 0.98150);
  expect_printed(curing_fronts(two, 100, 100, 15)->front_um, 178.64);
}

TEST(Kinetics, CuredHeightsOfBlueAlone) {
  expect_printed(cured_height_um(resin_1(), 100, 10), 1113.9);
  Kinetics two = resin_2();
  two.m = 1.03;  // that of blue alone
  expect_printed(cured_height_um(two, 100, 10), 2491.9);
  // (2.1), in base 10 and with a volumetric dose: 150 mJ/cm², gel dose 13 mJ/cm², ha 2000 um.
  const double he = units::height_e_from_10(2000);
  expect_printed(cured_height_um({he, 1, 13, 0, 0}, 15, 10), 2124.3);
  const double gel_v = units::volumetric_from_areal(13, he);
  EXPECT_NEAR(cured_height_um({he, 1, 13, 0, 0}, 15, 10),
              2000 * std::log10(150 * units::kLn10 / (gel_v * 2000e-4)), 1e-9);
}

/// Where D' has reached D'c, found by walking through z: uses the rate alone.
struct Walked {
  double first_z = -1, first_time = kInfinity, front = -1, back = -1;
};
Walked walk(const Kinetics& k, double blue, double uv, double time, double step_um) {
  Walked w;
  for (double z = 0; z < 12000; z += step_um) {
    const double net =
        blue * std::exp(-z / k.hb_um) - (uv > 0 ? k.beta * uv * std::exp(-z / k.huv_um) : 0.0);
    const double rate = net > 0 ? std::pow(net, k.m) : 0.0;
    // Forward in time in steps of 1/1000: dD'/dt does not depend on D', so Euler's rule is exact
    // but for rounding.
    double dose = 0;
    for (int i = 0; i < 1000; ++i) dose += rate * time / 1000;
    if (rate > 0 && k.critical_dose_prime / rate < w.first_time) {
      w.first_time = k.critical_dose_prime / rate;
      w.first_z = z;
    }
    if (dose >= k.critical_dose_prime) {
      if (w.front < 0) w.front = z;
      w.back = z;
    }
  }
  return w;
}

TEST(Kinetics, AgreesWithNumericalIntegrationOfTheLaw) {
  struct Case {
    Kinetics k;
    double blue, uv, time;
  };
  const double step = 0.5;
  for (const Case& c :
       {Case{figure_3_4(), 100, 200, 4}, Case{resin_1(), 100, 200, 30},
        Case{resin_2(), 100, 100, 15}, Case{resin_2(), 20, 90, 12},
        Case{{300, 0.5, 20, 2, 40}, 30, 20, 9}, Case{{300, 2, 900, 1, 40}, 50, 30, 2},
        Case{resin_1(), 60, 0, 20}, Case{resin_1(), 100, 120, 8}}) {
    SCOPED_TRACE(::testing::Message() << "m " << c.k.m << ", " << c.blue << "/" << c.uv);
    const Walked w = walk(c.k, c.blue, c.uv, c.time, step);
    const FirstGel first = first_gel(c.k, c.blue, c.uv);
    // The first gel is the flat top of the rate: its time is exact to second order of the step.
    EXPECT_NEAR(first.z_um, w.first_z, step);
    EXPECT_NEAR(first.time_s, w.first_time, 1e-3 * w.first_time);
    EXPECT_LE(first.time_s, w.first_time * (1 + 1e-12));
    const auto fronts = curing_fronts(c.k, c.blue, c.uv, c.time);
    ASSERT_TRUE(fronts);
    // The first and last gelled point of a walk lie up to a step inside the fronts.
    EXPECT_LE(fronts->front_um, w.front + 1e-9);
    EXPECT_GE(fronts->front_um, w.front - step);
    EXPECT_GE(fronts->back_um, w.back - 1e-9);
    EXPECT_LE(fronts->back_um, w.back + step);
    // At a front the dose is D'c; at the window it is at least that.
    EXPECT_NEAR(dose_prime_at(c.k, c.blue, c.uv, fronts->back_um, c.time), c.k.critical_dose_prime,
                1e-9 * c.k.critical_dose_prime);
    const double at_front = dose_prime_at(c.k, c.blue, c.uv, fronts->front_um, c.time);
    if (fronts->front_um > 0) {
      EXPECT_NEAR(at_front, c.k.critical_dose_prime, 1e-9 * c.k.critical_dose_prime);
    } else {
      EXPECT_GE(at_front, c.k.critical_dose_prime);
    }
  }
}

TEST(Kinetics, WithoutUvTheFrontsAreTheWindowAndTheCuredHeight) {
  for (const Kinetics& k : {figure_3_4(), resin_1(), resin_2(), Kinetics{200, 0.76, 9, 0, 0}}) {
    EXPECT_EQ(steady_dead_zone_um(k, 50, 0), 0);
    EXPECT_EQ(first_gel(k, 50, 0).z_um, 0);
    const double start = first_gel(k, 50, 0).time_s;
    EXPECT_NEAR(start, window_time_s(k, 50, 0), 1e-12 * start);
    EXPECT_NEAR(start, k.critical_dose_prime / std::pow(50, k.m), 1e-12 * start);
    EXPECT_FALSE(curing_fronts(k, 50, 0, start * (1 - 1e-9)));
    for (const double t : {start * 1.01, start * 10, start * 1e6}) {
      const auto fronts = curing_fronts(k, 50, 0, t);
      ASSERT_TRUE(fronts);
      EXPECT_EQ(fronts->front_um, 0);
      EXPECT_NEAR(fronts->back_um, cured_height_um(k, 50, t), 1e-9);
      EXPECT_NEAR(exposure_for_height_s(k, 50, fronts->back_um), t, 1e-12 * t);
    }
    EXPECT_LT(cured_height_um(k, 50, start * 0.5), 0);
  }
}

TEST(Kinetics, WeakUvCuresToTheWindow) {
  // Just above, at and just below beta Iuv = Ib.
  const Kinetics k = figure_3_4();
  EXPECT_GT(steady_dead_zone_um(k, 100, 100.001), 0);
  EXPECT_EQ(steady_dead_zone_um(k, 100, 100), 0);
  EXPECT_EQ(window_time_s(k, 100, 100), kInfinity);  // in the limit, but never
  EXPECT_EQ(steady_dead_zone_um(k, 100, 90), 0);
  EXPECT_NEAR(window_time_s(k, 100, 90), 10, 1e-12);
  const Kinetics two = resin_2();
  EXPECT_NEAR(window_time_s(two, 100, 10), 238 / std::pow(100 - 48.4, 1.29), 1e-12);
  // Before that time a dead zone lasts, after it none.
  const double t = window_time_s(two, 100, 10);
  EXPECT_GT(curing_fronts(two, 100, 10, t * 0.999)->front_um, 0);
  EXPECT_EQ(curing_fronts(two, 100, 10, t * 1.001)->front_um, 0);
  // So weak that the first gel is at the window: beta Iuv hb <= Ib huv.
  EXPECT_EQ(first_gel(k, 100, 13).z_um, 0);
  EXPECT_NEAR(first_gel(k, 100, 13).time_s, 100.0 / 87, 1e-12);
  EXPECT_GT(first_gel(k, 100, 14).z_um, 0);
}

TEST(Kinetics, FrontsMeetAtTheFirstGel) {
  std::mt19937 random(4);
  std::uniform_real_distribution<double> share(0, 1);
  for (int round = 0; round < 2000; ++round) {
    Kinetics k;
    k.hb_um = 50 * std::pow(100, share(random));
    k.huv_um = k.hb_um * (0.02 + 0.9 * share(random));
    k.m = 0.5 + share(random);
    k.beta = 0.2 + 5 * share(random);
    k.critical_dose_prime = 1 + 300 * share(random);
    const double blue = 1 + 200 * share(random), uv = 300 * share(random);
    const FirstGel first = first_gel(k, blue, uv);
    EXPECT_FALSE(curing_fronts(k, blue, uv, first.time_s * (1 - 1e-6)));
    const auto fronts = curing_fronts(k, blue, uv, first.time_s);
    ASSERT_TRUE(fronts);
    // The rate's top is flat: rounding of 1e-15 moves both roots by sqrt of it, in heights.
    EXPECT_NEAR(fronts->front_um, first.z_um, 1e-5 * k.hb_um);
    EXPECT_NEAR(fronts->back_um, first.z_um, 1e-5 * k.hb_um);
    // Later the front only comes nearer to the window, not past the steady dead zone.
    double front = fronts->front_um, back = fronts->back_um;
    for (const double factor : {1.1, 2.0, 10.0, 1e4}) {
      const auto later = curing_fronts(k, blue, uv, first.time_s * factor);
      ASSERT_TRUE(later);
      ASSERT_LE(later->front_um, front + 1e-9);
      ASSERT_GE(later->back_um, back - 1e-9);
      ASSERT_GE(later->front_um, steady_dead_zone_um(k, blue, uv) - 1e-9);
      front = later->front_um;
      back = later->back_um;
    }
  }
}

TEST(Kinetics, NoBlueLightNeverGels) {
  const Kinetics k = figure_3_4();
  EXPECT_EQ(steady_dead_zone_um(k, 0, 50), kInfinity);
  EXPECT_EQ(first_gel(k, 0, 50).time_s, kInfinity);
  EXPECT_FALSE(curing_fronts(k, 0, 50, 100));
  EXPECT_FALSE(curing_fronts(k, 100, 200, 0));
  EXPECT_EQ(window_time_s(k, 0, 50), kInfinity);
  EXPECT_EQ(cured_height_um(k, 0, 10), -kInfinity);
  EXPECT_EQ(passing_dose_prime(k, 0, 50, 1000), 0);
}

TEST(Kinetics, ExponentsOtherThanOneBreakReciprocity) {
  // The same dose at ten times the intensity: (h / m)(m - 1) ln 10 higher or lower.
  for (const double m : {0.76, 1.0, 1.29}) {
    const Kinetics k{200, m, 20, 0, 0};
    EXPECT_NEAR(cured_height_um(k, 100, 1) - cured_height_um(k, 10, 10),
                200 / m * (m - 1) * units::kLn10, 1e-9);
  }
}

/// The integral of passing_dose_prime by Simpson's rule, from the dead zone on.
double passing_by_sum(const Kinetics& k, double blue, double uv, double speed) {
  const double start = steady_dead_zone_um(k, blue, uv);
  const double length = 45 * k.hb_um / k.m;
  // In w = sqrt of the distance: the rate's power m at its root is smooth enough then.
  const int n = 40000;
  double sum = 0;
  const double end = std::sqrt(length);
  for (int i = 0; i <= n; ++i) {
    const double w = end * i / n;
    const double f = dose_prime_at(k, blue, uv, start + w * w, 1) * 2 * w;
    sum += f * (i == 0 || i == n ? 1 : i % 2 ? 4 : 2);
  }
  return sum * end / n / 3 * 1e-4 / units::cm_s_from_mm_h(speed);
}

TEST(Kinetics, PassingDoseOfContinuousPrinting) {
  const Kinetics one = resin_1();
  // Custom Resin 1 at 100/200 mW/cm² and 1000 mm/h: phi of a long exposure.
  expect_printed(passing_dose_prime(one, 100, 0, 1000) / one.critical_dose_prime, 2.2138);
  expect_printed(passing_dose_prime(one, 100, 200, 1000) / one.critical_dose_prime, 1.9364);
  // m = 1 in closed form: Ib hb e^(-zf/hb) (1 - huv/hb) / s.
  const Kinetics k = figure_3_4();
  const double zf = steady_dead_zone_um(k, 100, 200);
  EXPECT_NEAR(passing_dose_prime(k, 100, 200, 360),
              100 * 750e-4 * std::exp(-zf / 750) * (1 - 100.0 / 750) / 0.01, 1e-9);
  for (const double m : {0.5, 0.76, 0.99, 1.0, 1.29, 2.0}) {
    for (const double uv : {0.0, 1.0, 30.0, 60.0, 65.5, 65.9, 66.0, 67.0, 200.0, 5000.0}) {
      Kinetics q = one;
      q.m = m;
      q.beta = 1.5;  // beta Iuv = Ib at 66
      const double expected = passing_by_sum(q, 99, uv, 700);
      EXPECT_NEAR(passing_dose_prime(q, 99, uv, 700), expected, 1e-7 * expected)
          << "m " << m << ", uv " << uv;
    }
  }
}

Resin bare_resin() {
  Resin r;
  r.name = "a resin";
  r.absorbance_height10_um = units::height10_from_e(200);
  return r;
}

TEST(Kinetics, GelDoseAndAimOfAResin) {
  Resin r = bare_resin();
  // A working curve's gel dose of 10 mJ/cm², the aim 5 times that.
  r.gel_dose_mj_cm3 = units::volumetric_from_areal(10, 200);
  r.critical_dose_mj_cm3 = 5 * r.gel_dose_mj_cm3;
  r.dose_factor = 5;
  EXPECT_NEAR(make_kinetics(r, false, false).critical_dose_prime, 10, 1e-12);
  EXPECT_NEAR(make_kinetics(r, false, true).critical_dose_prime, 50, 1e-12);
  EXPECT_NEAR(make_kinetics(r, false, false).hb_um, 200, 1e-12);
  // A kinetic fit: D'c aimed at is that of gel times the factor.
  r = bare_resin();
  r.model = CureModelKind::kinetic;
  r.m = 0.9;
  r.critical_dose_prime = 100;
  r.dose_factor = 5;
  EXPECT_NEAR(make_kinetics(r, false, false).critical_dose_prime, 20, 1e-12);
  EXPECT_NEAR(make_kinetics(r, false, true).critical_dose_prime, 100, 1e-12);
  EXPECT_EQ(make_kinetics(r, false, true).m, 0.9);
  // Under UV the exponent and the dose may be others.
  r.inhibition = Inhibition{2, units::height10_from_e(40), 1.2, 33};
  const Kinetics gel = make_kinetics(r, true, false);
  EXPECT_EQ(gel.m, 1.2);
  EXPECT_EQ(gel.beta, 2);
  EXPECT_NEAR(gel.huv_um, 40, 1e-12);
  EXPECT_NEAR(gel.critical_dose_prime, 33, 1e-12);
  EXPECT_NEAR(make_kinetics(r, true, true).critical_dose_prime, 165, 1e-11);
  // Blue alone does not ask for it.
  EXPECT_EQ(make_kinetics(r, false, false).beta, 0);
}

TEST(Kinetics, ResinsWithoutADoseOrInhibitionAreRefused) {
  EXPECT_THROW(make_kinetics(bare_resin(), false, true), InputError);
  EXPECT_THROW(make_kinetics(bare_resin(), false, false), InputError);
  Resin r = bare_resin();
  r.critical_dose_mj_cm3 = 500;
  EXPECT_NO_THROW(make_kinetics(r, false, true));
  EXPECT_THROW(make_kinetics(r, true, true), InputError);
  r.absorbance_height10_um = 0;
  EXPECT_THROW(make_kinetics(r, false, true), InputError);
}

TEST(KineticUnits, ArealAndVolumetricLawsAreTheSame) {
  // dD'/dt = (Ib e^(-z/hb) / hb - betaV Iuv e^(-z/huv) / huv)^m in volumetric form (B.7): with
  // D'V,c = D'A,c / hb^m and betaV = betaA huv / hb it gels at the same places and times.
  for (const Kinetics& k : {figure_3_4(), resin_1(), resin_2()}) {
    const double hb_cm = k.hb_um * 1e-4, huv_cm = k.huv_um * 1e-4;
    const double beta_v = units::volumetric_beta_from_areal(k.beta, k.hb_um, k.huv_um);
    const double dose_v = units::volumetric_prime_from_areal(k.critical_dose_prime, k.hb_um, k.m);
    for (const double z : {150.0, 300.0, 700.0}) {
      const double rate_v = std::pow(
          100 * std::exp(-z / k.hb_um) / hb_cm - beta_v * 200 * std::exp(-z / k.huv_um) / huv_cm,
          k.m);
      const double rate_a = dose_prime_at(k, 100, 200, z, 1);
      if (!(rate_a > 0)) continue;  // below the dead zone
      EXPECT_NEAR(dose_v / rate_v, k.critical_dose_prime / rate_a,
                  1e-12 * k.critical_dose_prime / rate_a);
    }
    EXPECT_NEAR(units::areal_prime_from_volumetric(dose_v, k.hb_um, k.m), k.critical_dose_prime,
                1e-12 * k.critical_dose_prime);
    EXPECT_NEAR(units::areal_beta_from_volumetric(beta_v, k.hb_um, k.huv_um), k.beta, 1e-14);
  }
  // Resin 1: the printed 0.73 as a volumetric constant.
  expect_printed(units::volumetric_beta_from_areal(0.73, 408, 37.8), 0.067632);
}

TEST(KineticUnits, DosesAndHeightsAgreeAcrossBases) {
  // m = 1: D' is the dose, whichever way one goes.
  EXPECT_NEAR(units::volumetric_prime_from_areal(50, 868, 1), units::volumetric_from_areal(50, 868),
              1e-12);
  // Dc,V = Dc,A ln10 / ha10 = Dc,A / he.
  EXPECT_NEAR(units::volumetric_from_areal(65, units::height_e_from_10(2000)),
              65 * units::kLn10 / 2000e-4, 1e-10);
  // Light at one height: 1/e in base e, 1/10 in base 10.
  const double he = 123;
  EXPECT_NEAR(std::exp(-50 / he), std::pow(10, -50 / units::height10_from_e(he)), 1e-15);
  // A film of 93 um with absorbance 0.404 lets through 10^-0.404.
  const double film = units::height_e_from_absorbance(93, 0.404);
  EXPECT_NEAR(std::exp(-93 / film), std::pow(10, -0.404), 1e-15);
}

TEST(KineticUnits, TheModelOfContinuousPrintingIsTheSameLaw) {
  // phi of make_cure_model is the D' that passing light leaves, over D'c.
  Resin r = bare_resin();
  r.model = CureModelKind::kinetic;
  for (const double m : {0.8, 1.0, 1.3}) {
    r.m = m;
    r.critical_dose_prime = 40;
    const CureModel model = make_cure_model(test::linear_printer(1, 80), r, test::process(900), 50);
    const Kinetics k = make_kinetics(r, false, true);
    EXPECT_NEAR(model.phi_max(), passing_dose_prime(k, 80, 0, 900) / 40, 1e-12 * model.phi_max());
  }
}

}  // namespace
}  // namespace slicecorr
