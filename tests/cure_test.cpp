// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The dose model against closed forms and the published values of the dissertation.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "models.hpp"
#include "rounds.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr {
namespace {

using test::figure_2_2;
using test::linear_printer;

/// The printed values have five significant digits.
#define EXPECT_PRINTED(value, printed) EXPECT_NEAR(value, printed, std::abs(printed) * 5e-5)

TEST(Cure, Figure22CriticalIntensityAndSpeeds) {
  const CureModel m = figure_2_2();
  EXPECT_PRINTED(m.critical_intensity_mw_cm2, 16.000);
  EXPECT_PRINTED(m.phi_max(), 6.2500);
  EXPECT_PRINTED(m.phi_min(), 0.062500);
  const Printer printer = linear_printer(1, 100);
  // Feasible strictly between 62.5 and 6250 mm/h.
  for (const double speed : {62.6, 6249.0}) {
    EXPECT_NO_THROW(check_feasible(figure_2_2(speed), printer, test::process(speed))) << speed;
  }
  for (const double speed : {6250.0, 6251.0, 62.5, 62.4}) {
    try {
      check_feasible(figure_2_2(speed), printer, test::process(speed));
      FAIL() << speed << " mm/h must be infeasible";
    } catch (const InfeasibleError& e) {
      // Just inside of 6250 and 62.5.
      for (const char* limit : {"slower than 6249.9 mm/h", "faster than 62.501 mm/h"}) {
        EXPECT_NE(std::string(e.what()).find(limit), std::string::npos) << e.what();
      }
    }
  }
}

// Lamps that stay: the slowest slice has most of black's light, the fastest least of full light, and the
// bound of all speeds is none of a slice. What is named can be typed back.
TEST(Cure, LimitsOfSlicesWithSpeedsOfTheirOwn) {
  const Printer printer = linear_printer(1, 100);
  const auto complaint = [&](std::vector<double> speeds, double bound) -> std::string {
    Process p = test::process(bound);
    p.slice_speed_mm_h = std::move(speeds);
    p.slice_lamps = SliceLamps::stay;
    try {
      check_feasible(make_cure_model(printer, test::resin(576, 2000), p, 50), printer, p);
    } catch (const InfeasibleError& e) {
      return e.what();
    }
    return "";
  };
  const auto expect = [](const std::string& words, const char* part) {
    EXPECT_NE(words.find(part), std::string::npos) << words;
  };
  for (const double bound : {400.0, 5000.0}) {
    const std::string black = complaint({400, 50, 300}, bound);
    expect(black, "in slice 1, at 50 mm/h, the light of black (1 mW/cm², phi 1.25)");
    expect(black, "give each slice at least 62.501 mm/h and at most 6249.9 mm/h");
    EXPECT_EQ(complaint({400, 62.501, 300}, bound), "");
    EXPECT_NE(complaint({400, 62.499, 300}, bound), "");
  }
  const std::string weak = complaint({400, 8000, 300}, 8000);
  expect(weak, "in slice 1, at 8000 mm/h, even full light (100 mW/cm², phi 0.7812)");
  expect(weak, "give each slice at most 6249.9 mm/h and at least 62.501 mm/h");
  EXPECT_EQ(complaint({400, 6249.9, 300}, 8000), "");
}

TEST(Cure, MinimumDoseOfBlack) {
  // Black of 1 mW/cm² at 1000 mm/h leaves 36 mJ/cm³ under a long dark run (A.34).
  const CureModel m = figure_2_2();
  EXPECT_PRINTED(m.phi_min() * 576, 36.0);
  const auto dose = node_doses(m, std::vector<double>(4000, m.phi_min()));
  EXPECT_NEAR(dose[0], m.phi_min(), 1e-12);
}

TEST(Cure, Figure22UncorrectedDoses) {
  const CureModel m = figure_2_2();
  std::vector<double> phi;
  for (const std::uint8_t c : test::column(50, {{11, 20}, {31, 40}})) {
    phi.push_back(c ? m.phi_max() : m.phi_min());
  }
  const auto dose = node_doses(m, phi);
  EXPECT_PRINTED(dose[0], 1.9512);
  EXPECT_PRINTED(dose[11], 3.6202);
  EXPECT_PRINTED(dose[21], 1.5736);
  EXPECT_PRINTED(dose[31], 2.7496);
  EXPECT_PRINTED(dose[38], 1.0125);
  EXPECT_PRINTED(dose[41], 0.025271);
  const double edge = 39 - m.crossing(phi[38], dose[39]);
  EXPECT_PRINTED(edge, 38.042);
  EXPECT_PRINTED(edge * 50, 1902.1);
}

TEST(Cure, ThreeSlicesByHand) {
  // phi = (2, 0.5, 3), eta 0.1.
  CureModel m =
      make_cure_model(linear_printer(0, 100), test::resin(576, 500), test::process(1000), 50);
  const auto dose = node_doses(m, {2, 0.5, 3});
  EXPECT_PRINTED(dose[0], 0.88234);
  EXPECT_PRINTED(dose[1], 0.59295);
  EXPECT_PRINTED(dose[2], 0.61702);
  // Quarter of the way down in layer 1, by (A.35).
  EXPECT_PRINTED(0.5 + (dose[2] - 0.5) * std::pow(10, -0.75 * m.eta), 0.59846);
}

TEST(Cure, RecursionEqualsTheDirectSum) {
  std::mt19937 random(1);
  const int rounds = test::by_night() ? 300 : 75;
  for (int round = 0; round < rounds; ++round) {
    std::uniform_real_distribution<double> eta(0.001, 0.8), light(0, 20);
    const CureModel m = make_cure_model(linear_printer(1, 100), test::resin(576, 50 / eta(random)),
                                        test::process(1000), 50);
    std::vector<double> phi(
        static_cast<std::size_t>(std::uniform_int_distribution(1, 120)(random)));
    for (double& p : phi) p = light(random);
    const auto dose = node_doses(m, phi);
    for (std::size_t k = 0; k < phi.size(); ++k) {
      long double sum = 0;  // (A.20): slice n at node k
      for (std::size_t n = k; n < phi.size(); ++n) {
        sum += static_cast<long double>(phi[n]) *
               (std::pow(10.0L, -static_cast<long double>(n - k) * m.eta) -
                std::pow(10.0L, -static_cast<long double>(n + 1 - k) * m.eta));
      }
      ASSERT_NEAR(dose[k], static_cast<double>(sum), 1e-12 * std::max(1.0, dose[k]));
    }
  }
}

TEST(Cure, CrossingIsWhereTheDoseIsOne) {
  std::mt19937 random(2);
  std::uniform_real_distribution<double> any(0, 3);
  const CureModel m = figure_2_2();
  int crossings = 0;
  for (int round = 0; round < 20000; ++round) {
    const double phi = any(random) * 2, below = 1 + (any(random) - 1.5) * 0.1;
    const double above = m.step(phi, below);
    if ((above >= 1) == (below >= 1)) continue;
    ++crossings;
    const double d = m.crossing(phi, below);
    const double dose = phi + (below - phi) * std::pow(10, -d * m.eta);
    ASSERT_NEAR(dose, 1.0, 1e-13 * std::max(1.0, phi));
  }
  EXPECT_GT(crossings, 1000);
  EXPECT_EQ(m.crossing(5.0, 1.0), 0.0);  // at the lower node itself
}

TEST(Cure, HighestDoseOfAFeature) {
  const CureModel m = figure_2_2();
  EXPECT_PRINTED(m.highest_dose(10), 1.5538);
  EXPECT_PRINTED(m.highest_dose(20), 2.2955);
  EXPECT_PRINTED(m.highest_dose(40), 4.0288);
}

TEST(Cure, SlicesToGel) {
  EXPECT_EQ(figure_2_2().slices_to_gel(), 4);
  // Figure A.5: Dc 748, 750 mm/h, 75 mW/cm², ha 2000: 202.31 um exposed to reach Dc.
  const CureModel m =
      make_cure_model(linear_printer(1, 75), test::resin(748, 2000), test::process(750), 50);
  EXPECT_PRINTED(m.phi_max(), 4.8128);
  EXPECT_PRINTED(std::log10(m.phi_max() / (m.phi_max() - 1)) * 2000, 202.31);
  EXPECT_EQ(m.slices_to_gel(), 5);
}

TEST(Cure, KineticResinWithoutExponentEqualsJacobs) {
  Resin kinetic = test::resin(0, 2000);
  kinetic.model = CureModelKind::kinetic;
  kinetic.critical_dose_prime = 50;
  const Resin jacobs =
      test::resin(units::volumetric_from_areal(50, units::height_e_from_10(2000)), 2000);
  const CureModel a = make_cure_model(linear_printer(1, 100), kinetic, test::process(900), 50);
  const CureModel b = make_cure_model(linear_printer(1, 100), jacobs, test::process(900), 50);
  EXPECT_NEAR(a.critical_intensity_mw_cm2, b.critical_intensity_mw_cm2,
              1e-14 * b.critical_intensity_mw_cm2);
  EXPECT_EQ(a.eta, b.eta);
  EXPECT_EQ(a.a, b.a);
}

TEST(Cure, KineticExponentAgainstTheIntegral) {
  // (1/s) * integral of (I e^(-d/hb))^m over a slice, over D'c.
  Resin r = test::resin(0, units::height10_from_e(1631));
  r.model = CureModelKind::kinetic;
  r.m = 1.29;
  r.critical_dose_prime = 238;
  const CureModel m = make_cure_model(linear_printer(1, 100), r, test::process(1000), 50);
  const double hb = 1631e-4, s = units::cm_s_from_mm_h(1000), I = 70;
  double sum = 0;
  const int steps = 20000;
  for (int i = 0; i < steps; ++i) {
    const double d = (i + 0.5) / steps * 50e-4;
    sum += std::pow(I * std::exp(-d / hb), 1.29) * 50e-4 / steps;
  }
  EXPECT_NEAR(m.step(m.phi(I), 0), sum / s / 238, 1e-9);
}

TEST(Units, ConversionsOfTheDissertation) {
  const double he2000 = units::height_e_from_10(2000);
  EXPECT_PRINTED(units::volumetric_from_areal(50, he2000), 575.65);
  EXPECT_PRINTED(units::volumetric_from_areal(15, he2000), 172.69);
  EXPECT_PRINTED(units::volumetric_from_areal(65, he2000), 748.34);
  EXPECT_PRINTED(units::volumetric_from_areal(15, units::height_e_from_10(1500)), 230.26);
  EXPECT_NEAR(units::areal_from_volumetric(units::volumetric_from_areal(7, 123), 123), 7, 1e-14);
  EXPECT_NEAR(units::height_e_from_10(units::height10_from_e(38)), 38, 1e-13);
  EXPECT_NEAR(units::mm_h_from_cm_s(units::cm_s_from_mm_h(750)), 750, 1e-12);
  EXPECT_NEAR(units::slice_time_s(50, 1000), 0.18, 1e-15);
}

TEST(LevelTable, FindsLevelsLikeASearchThroughAll) {
  std::mt19937 random(3);
  for (const double gamma : {0.4, 1.0, 3.0}) {
    for (const int bits : {1, 2, 4, 8}) {
      Printer p = test::gamma_printer(1, 100, gamma, bits);
      if (bits == 8) {  // two plateaus
        for (std::size_t i = 100; i < 110; ++i)
          p.calibration[i].intensity_mw_cm2 = p.calibration[100].intensity_mw_cm2;
        for (std::size_t i = 0; i < 5; ++i)
          p.calibration[i].intensity_mw_cm2 = p.calibration[0].intensity_mw_cm2;
      }
      const auto phi = level_intensities(p);
      const LevelTable table(phi);
      std::uniform_real_distribution<double> any(-5, 110);
      for (int round = 0; round < 4000; ++round) {
        const double x =
            round % 3 ? any(random) : phi[static_cast<std::size_t>(round) % phi.size()];
        int least = static_cast<int>(phi.size()) - 1, most = 0;
        for (int l = static_cast<int>(phi.size()) - 1; l >= 0; --l) {
          if (phi[static_cast<std::size_t>(l)] >= x) least = l;
        }
        while (least > 0 &&
               phi[static_cast<std::size_t>(least)] == phi[static_cast<std::size_t>(least) - 1])
          --least;
        for (int l = 0; l < static_cast<int>(phi.size()); ++l) {
          const auto k = static_cast<std::size_t>(l);
          if (phi[k] <= x && phi[k] > phi[static_cast<std::size_t>(most)]) most = l;
        }
        ASSERT_EQ(table.at_least(x), least) << x << " gamma " << gamma << " bits " << bits;
        ASSERT_EQ(table.at_most(x), most) << x << " gamma " << gamma << " bits " << bits;
      }
    }
  }
}

TEST(Levels, LinearBetweenThePointsOfTheCalibration) {
  Printer p = linear_printer(1, 100);
  p.calibration = {{0, 1.0}, {128, 31.0}, {255, 100.0}};
  const auto i = level_intensities(p);
  EXPECT_EQ(i[0], 1.0);
  EXPECT_NEAR(i[64], 16.0, 1e-14);
  EXPECT_EQ(i[128], 31.0);
  EXPECT_NEAR(i[129], 31.0 + 69.0 / 127, 1e-13);
  EXPECT_EQ(i[255], 100.0);
}

}  // namespace
}  // namespace slicecorr
