// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Derivatives of the dose: against differences of the dose itself, against direct sums, and the
// values of figure 2.2 that were computed apart.
#include "slicecorr/dose_derivatives.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <random>

#include "models.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/inhibited.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr {
namespace {

using test::column;
using test::figure_2_2;
using test::linear_printer;
using test::plan_for;
using test::process;

// Figures are given to so many digits.
void expect_figure(double value, double figure, double last_digit) {
  EXPECT_NEAR(value, figure, 0.51 * last_digit);
}

/// What a dose is computed from.
struct Inputs {
  double ln_ha = 0, ln_dc = 0, ln_light = 0, stray = 0, m = 0, exchange = 0;
};

Process layerwise() {
  Process p;
  p.mode = ExposureMode::layerwise;
  p.exposure_s = 0.2;
  p.bottom_exposure_s = 0.6;
  p.bottom_layers = 4;
  return p;
}

/// The same with lifts that exchange a share of the resin.
Process lifted(double exchange) {
  Process p = layerwise();
  p.lifts = Lifts::each;
  p.lift_exchange = exchange;
  return p;
}

/// A resin by its areal dose. `m` 1: Jacobs; other: D'c, held where the intensity is `reference`.
Resin resin_of(const Inputs& x, double m, double reference) {
  Resin r;
  r.name = "test";
  r.absorbance_height10_um = 900 * std::exp(x.ln_ha);
  r.m = m + x.m;
  const double areal = 50 * std::exp(x.ln_dc) * std::pow(reference, x.m);
  if (m == 1.0 && x.m == 0) {
    r.critical_dose_mj_cm3 =
        units::volumetric_from_areal(areal, units::height_e_from_10(r.absorbance_height10_um));
  } else {
    r.model = CureModelKind::kinetic;
    r.critical_dose_prime = areal;
  }
  return r;
}

CureModel model_of(const Inputs& x, double m, double reference, const Process& process) {
  Printer p = linear_printer(1, 100);
  for (CalibrationPoint& c : p.calibration) {
    c.intensity_mw_cm2 = c.intensity_mw_cm2 * std::exp(x.ln_light) + x.stray;
  }
  Process moved = process;
  moved.lift_exchange += x.exchange;
  return make_cure_model(p, resin_of(x, m, reference), moved, 50);
}

std::vector<std::uint8_t> random_pixels(int slices, unsigned seed) {
  std::mt19937 random(seed);
  std::vector<std::uint8_t> pixels;
  for (int n = 0; n < slices; ++n) pixels.push_back(static_cast<std::uint8_t>(random() % 256));
  return pixels;
}

/// Of the exchange: small, because its third derivative goes with the cube of the number of lifts, and
/// because the lift that decides changes with it.
constexpr double kExchangeStep = 1e-6;

/// Derivative of the column dose by differences. Errors of the third order: step² / 6 of the third
/// derivative, some 1e-8 of the dose; rounding 1e-16 / step.
void expect_differences(double m, double reference, const Process& process) {
  const std::vector<std::uint8_t> pixels = random_pixels(40, 3);
  const CureModel model = model_of({}, m, reference, process);
  BandDerivatives band(model, 1, {true, true, true, reference, false, true});
  const ColumnGradient gradient(model, pixels, reference);
  const auto differences = [&](double Inputs::*of, double step = 1e-4) {
    Inputs more, less;
    more.*of = step;
    less.*of = -step;
    const ColumnDose up = column_dose(model_of(more, m, reference, process), pixels);
    const ColumnDose down = column_dose(model_of(less, m, reference, process), pixels);
    ColumnDose d = up;
    for (std::size_t n = 0; n < pixels.size(); ++n) {
      d.lower[n] = (up.lower[n] - down.lower[n]) / (2 * step);
      d.middle[n] = (up.middle[n] - down.middle[n]) / (2 * step);
      d.upper[n] = (up.upper[n] - down.upper[n]) / (2 * step);
    }
    return d;
  };
  const ColumnDose by_ha = differences(&Inputs::ln_ha), by_dc = differences(&Inputs::ln_dc),
                   by_light = differences(&Inputs::ln_light),
                   by_stray = differences(&Inputs::stray), by_m = differences(&Inputs::m),
                   by_exchange = differences(&Inputs::exchange, kExchangeStep);
  const ColumnDose dose = column_dose(model, pixels);
  for (int n = 39; n >= 0; --n) {
    const auto k = static_cast<std::size_t>(n);
    band.add_slice(n, &pixels[k]);
    const auto check = [&](const DoseGradient& g, std::vector<double> ColumnDose::*where) {
      const double tolerance = 1e-6 * (1 + (dose.*where)[k]);
      EXPECT_NEAR(g.dose, (dose.*where)[k], 1e-12 * (1 + g.dose)) << n;
      EXPECT_NEAR(g.ln_ha, (by_ha.*where)[k], tolerance) << n;
      EXPECT_NEAR(g.ln_dc(), (by_dc.*where)[k], tolerance) << n;
      EXPECT_NEAR(g.ln_light(m), (by_light.*where)[k], tolerance) << n;
      EXPECT_NEAR(g.stray, (by_stray.*where)[k], tolerance) << n;
      EXPECT_NEAR(g.m, (by_m.*where)[k], 10 * tolerance) << n;  // by 1, not by 1 %
      EXPECT_NEAR(g.exchange, (by_exchange.*where)[k], tolerance) << n;
      EXPECT_LE(g.exchange, 0) << n;
      EXPECT_GE(g.ln_ha, 0) << n;
    };
    check(band.at(0, 0.5), &ColumnDose::middle);
    check(band.at(0, 1), &ColumnDose::upper);
    check(gradient.at(n + 0.5), &ColumnDose::middle);
    check(gradient.at_node(n), &ColumnDose::upper);
    if (n < 39) check(band.at(0, 0), &ColumnDose::lower);
    const DoseGradient upper = band.at(0, 1);
    EXPECT_NEAR(band.upper().dose[0], upper.dose, 1e-12);
    EXPECT_NEAR(band.upper().ln_ha[0], upper.ln_ha, 1e-12);
    EXPECT_NEAR(band.upper().stray[0], upper.stray, 1e-12);
    EXPECT_NEAR(band.upper().m[0], upper.m, 1e-12 * (1 + std::abs(upper.m)));
    EXPECT_NEAR(band.upper().variance[0], upper.variance, 1e-12);
    EXPECT_NEAR(band.upper().exchange[0], upper.exchange, 1e-12);
  }
}

TEST(DoseDerivatives, DifferencesOfTheColumnDose) { expect_differences(1, 1, process(1000)); }
TEST(DoseDerivatives, DifferencesOfKineticResins) {
  expect_differences(0.9, 1, process(1000));
  expect_differences(1.2, 30, process(1000));
}
TEST(DoseDerivatives, DifferencesLayerByLayer) {
  expect_differences(1, 1, layerwise());
  expect_differences(1.1, 20, layerwise());
}

TEST(DoseDerivatives, DifferencesWhereLiftsExchangeResin) {
  for (const double exchange : {0.02, 0.3, 0.8}) {
    expect_differences(1, 1, lifted(exchange));
    expect_differences(1.1, 20, lifted(exchange));
  }
}

// At every node the sum of the lift that dosed it most, term by term; all resin exchanged, too.
TEST(DoseDerivatives, ExchangedDosesAreTheDirectSums) {
  std::mt19937 random(7);
  for (const double exchange : {0.01, 0.1, 0.45, 0.9, 1.0}) {
    const CureModel model = model_of({}, 1, 1, lifted(exchange));
    std::vector<double> phi(60);
    for (double& p : phi) p = random() % 4 ? 0.01 * static_cast<double>(random() % 300) : 0;
    const ColumnGradient gradient(model, phi);
    const double fall = model.eta * units::kLn10, y = 1 - exchange;
    const auto power = [&](int n) { return n == 0 ? 1.0 : std::pow(y, n); };
    for (int n = 0; n < 60; ++n) {
      DoseGradient most;
      for (int k = n; k < 60; ++k) {
        DoseGradient sum;
        for (int j = n; j <= k; ++j) {
          const double light = phi[static_cast<std::size_t>(j)] * model.ratio(j);
          const double far = j - n + 1, left = light * std::exp(-fall * far);
          const double counts = left * power(k - j);
          sum.dose += counts;
          sum.ln_ha += fall * far * counts;
          sum.stray +=
              light > 0 ? counts / light * model.ratio(j) / model.critical_intensity_mw_cm2 : 0;
          sum.variance += counts * counts;
          if (k > j) sum.exchange -= (k - j) * left * power(k - j - 1);
        }
        if (sum.dose > most.dose * (1 + 1e-12)) most = sum;
      }
      const DoseGradient& g = gradient.at_node(n);
      const double to = 1e-9 * (1 + most.dose);
      EXPECT_NEAR(g.dose, most.dose, to) << exchange << " " << n;
      EXPECT_NEAR(g.ln_ha, most.ln_ha, 100 * to) << exchange << " " << n;
      EXPECT_NEAR(g.variance, most.variance, to * (1 + most.dose)) << exchange << " " << n;
      EXPECT_NEAR(g.exchange, most.exchange, 100 * to) << exchange << " " << n;
    }
  }
}

// The slope between shares that lie apart: within 0 and 1, where all resin stays at one end.
TEST(DoseDerivatives, TheSlopeBetweenSharesIsThatOfTheDoses) {
  const std::vector<std::uint8_t> pixels = random_pixels(40, 5);
  for (const auto& [exchange, step] :
       {std::pair{0.3, 0.1}, {0.2, 0.2}, {0.9, 0.3}, {1.0, 0.2}, {0.05, 0.3}}) {
    const double from = std::max(0.0, exchange - step), to = std::min(1.0, exchange + step);
    const ColumnDose less = column_dose(model_of({}, 1, 1, lifted(from)), pixels);
    const ColumnDose more = column_dose(model_of({}, 1, 1, lifted(to)), pixels);
    const CureModel model = model_of({}, 1, 1, lifted(exchange));
    BandDerivatives band(model, 1, {false, false, false, 1, false, true, step});
    for (int n = 39; n >= 0; --n) {
      const auto k = static_cast<std::size_t>(n);
      band.add_slice(n, &pixels[k]);
      EXPECT_NEAR(band.at(0, 0).exchange, (more.lower[k] - less.lower[k]) / (to - from), 1e-8) << n;
      EXPECT_NEAR(band.at(0, 0.5).exchange, (more.middle[k] - less.middle[k]) / (to - from), 1e-8);
      EXPECT_NEAR(band.upper().exchange[0], (more.upper[k] - less.upper[k]) / (to - from), 1e-8);
    }
  }
}

TEST(DoseDerivatives, RecursionsAreTheDirectSums) {
  const CureModel model = figure_2_2();
  std::mt19937 random(11);
  std::uniform_real_distribution<double> light(model.phi_min(), model.phi_max());
  std::vector<double> phi(30);
  for (double& p : phi) p = light(random);
  const ColumnGradient gradient(model, phi);
  const double fall = model.eta * units::kLn10;
  for (const double z : {0.0, 0.3, 7.0, 7.9, 21.5, 29.99}) {
    double dose = 0, by_ha = 0, variance = 0;
    for (std::size_t n = 0; n < phi.size(); ++n) {
      const double from = std::max(0.0, static_cast<double>(n) - z);
      const double to = static_cast<double>(n) + 1 - z;
      if (to <= 0) continue;
      const double share = std::exp(-from * fall) - std::exp(-to * fall);
      dose += phi[n] * share;
      by_ha += phi[n] * fall * (from * std::exp(-from * fall) - to * std::exp(-to * fall));
      variance += phi[n] * phi[n] * share * share;
    }
    const DoseGradient g = gradient.at(z);
    EXPECT_NEAR(g.dose, dose, 1e-13);
    EXPECT_NEAR(g.ln_ha_volumetric(), by_ha, 1e-13);
    EXPECT_NEAR(g.variance, variance, 1e-13);
    EXPECT_NEAR(g.stray, -std::expm1(-(30 - z) * fall) / model.critical_intensity_mw_cm2, 1e-13);
  }
}

// Figure 2.2's ladder: features at slices 11-20 and 31-40 of 50, corrected exactly.
struct Ladder {
  explicit Ladder(double cap = 1e300)
      : plan(plan_for(figure_2_2(), process(1000, cap), 50)),
        gradient(plan.model, solve_column_exactly(plan, column(50, {{11, 20}, {31, 40}}))) {}
  CorrectionPlan plan;
  ColumnGradient gradient;
};

TEST(DoseDerivatives, TableOfFigure22) {
  const Ladder f;
  struct Row {
    double z, ha, dc, stray, q, noise;
  };
  for (const Row& r : {Row{11, 68.509, 926.495, -53.034, 0.92606, 3.526},
                       Row{21, -52.850, -165.446, 8.793, 0.68056, 0.7135},
                       Row{31, 375.650, 926.495, -42.499, 0.59455, 4.007},
                       Row{41, -150.383, -165.446, 5.448, 0.091045, 0.9353}}) {
    const DoseGradient g = f.gradient.at(r.z);
    for (const bool above : {true, false}) {
      expect_figure(f.gradient.edge_um(r.z, g.ln_ha_volumetric(), above), r.ha, 1e-3);
      expect_figure(f.gradient.edge_um(r.z, g.ln_dc(), above), r.dc, 1e-3);
      expect_figure(f.gradient.edge_um(r.z, g.stray, above), r.stray, 1e-3);
      const double noise = std::abs(f.gradient.edge_um(r.z, 0.01 * std::sqrt(g.variance), above));
      expect_figure(noise, r.noise, r.noise < 1 ? 1e-4 : 1e-3);
    }
    expect_figure(g.depth(), r.q, r.q < 0.1 ? 1e-6 : 1e-5);
  }
}

TEST(DoseDerivatives, CappedEdgesHaveTwoSlopes) {
  const Ladder f(1.05);
  const auto edge = [&](double z, bool above) {
    return f.gradient.edge_um(z, f.gradient.at(z).ln_ha_volumetric(), above);
  };
  expect_figure(edge(11, true), 173.44, 1e-2);
  expect_figure(edge(11, false), 192.70, 1e-2);
  expect_figure(edge(21, true), -357.44, 1e-2);
  expect_figure(edge(21, false), -60.86, 1e-2);
}

TEST(DoseDerivatives, EdgeOfTheUncorrectedLadder) {
  const CureModel model = figure_2_2();
  const std::vector<std::uint8_t> pixels = column(50, {{11, 20}, {31, 40}});
  const ColumnGradient g(model, pixels);
  const double z = 1902.078 / 50;
  const DoseGradient at = g.at(z);
  EXPECT_NEAR(at.dose, 1, 1e-5);
  EXPECT_NEAR(g.edge_um(z, at.ln_ha_volumetric(), true), -150.614, 2e-3);
  EXPECT_NEAR(g.edge_um(z, at.ln_dc(), true), -165.446, 2e-3);
  EXPECT_NEAR(g.edge_um(z, at.stray, true), 5.145, 1e-3);
}

TEST(DoseDerivatives, AreFoundWhereTheyAreKnownAlone) {
  Printer deep = linear_printer(1, 100);
  deep.resin_depth_um = 1000;
  EXPECT_THROW(check_derivatives(make_cure_model(deep, test::resin(576, 2000), process(1000), 50)),
               InputError);
  Printer bright = linear_printer(1, 100);
  bright.platform_reflectance = 0.3;
  EXPECT_THROW(
      check_derivatives(make_cure_model(bright, test::resin(576, 2000), process(1000), 50)),
      InputError);
  EXPECT_NO_THROW(check_derivatives(figure_2_2()));
}

}  // namespace
}  // namespace slicecorr
