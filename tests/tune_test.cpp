// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Tuning: gains of figure 2.2's process that were computed apart, and printers with hidden
// parameters that are found by what they print.
#include "slicecorr/resins/tune.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "models.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/same_light.hpp"
#include "slicecorr/tuned_together.hpp"
#include "slicecorr/units.hpp"
#include "tune_combs.hpp"

namespace slicecorr::resins::combs {
namespace {

/// Plugs at doses over Dc.
MeasuredPart plugs(const std::vector<double>& doses) {
  MeasuredPart part;
  const double areal = units::areal_from_volumetric(576, units::height_e_from_10(2000));
  for (const double dose : doses) {
    part.edges.push_back({"plug", MeasuredKind::plug, 0, dose * areal / 100, 100});
  }
  return part;
}
std::vector<double> staircase() {
  std::vector<double> doses;
  for (int i = 0; i < 6; ++i) doses.push_back(1.5 * std::pow(6, i / 5.0));
  return doses;
}

std::vector<TuneVector> derivatives(const MeasuredPart& part, const TuneVector& x = {}) {
  std::vector<TuneVector> by;
  predict_edges(part, kPrinter, kResin, x, &by);
  return by;
}

/// Figures are given to three digits.
void expect_gain(const std::vector<TuneVector>& by, double nat, double ha, double kappa) {
  const TuneGain gain = gain_of(default_prior().covariance, by, 10);
  EXPECT_NEAR(gain.nat, nat, 0.0015);
  EXPECT_NEAR(100 * std::sqrt(gain.covariance[0][0]), ha, 0.0051);
  EXPECT_NEAR(100 * std::sqrt(gain.covariance[1][1]), kappa, 0.0051);
}

/// The figures take the light of plugs as measured with all that is stray: 0.3 of 100 mW/cm² more
/// would be a column of 8.7 um per mW/cm².
std::vector<TuneVector> without_stray(std::vector<TuneVector> by) {
  for (TuneVector& row : by) row[2] = 0;
  return by;
}

TEST(Tune, GainsOfPlugs) {
  const auto of = [](const std::vector<double>& doses) {
    return without_stray(derivatives(plugs(doses)));
  };
  expect_gain(of({1.5}), 2.243, 9.28, 3.88);
  expect_gain(of({9}), 3.044, 4.16, 9.10);
  expect_gain(of(staircase()), 5.633, 0.76, 1.10);
  expect_gain(of({1.5, 1.5, 1.5, 9, 9, 9}), 6.010, 0.52, 0.83);
}

TEST(Tune, GainsOfAFeature) {
  const auto feature = derivatives(printed({{20, 39}}, kPrinter, kResin, true));
  expect_gain({feature[0]}, 2.607, 6.94, 7.30);
  expect_gain({feature[1]}, 0.662, 9.97, 5.22);
}

// The comb of the figures ends with its last gap, 24 dark slices: stray light adds up there, too, so
// that kappa is told less well than ha. Edges of corrections lie on nodes, where lower ones have two
// slopes if their burst is a single slice; the figures have those of edges that recede.
constexpr int kLastGap = 24;
constexpr TuneVector kALittleLess = {0, -1e-8, 0};

std::vector<TuneVector> upper_ones(const std::vector<TuneVector>& by) {
  std::vector<TuneVector> upper;
  for (std::size_t i = 0; i < by.size(); i += 2) upper.push_back(by[i]);
  return upper;
}

TEST(Tune, GainsOfTheComb) {
  const MeasuredPart part = printed(comb(), kPrinter, kResin, true, kLastGap);
  const auto by = derivatives(part, kALittleLess);
  expect_gain(by, 4.690, 2.19, 2.53);
  expect_gain(upper_ones(by), 4.615, 2.32, 2.64);
  auto all = without_stray(derivatives(plugs(staircase())));
  all.insert(all.end(), by.begin(), by.end());
  expect_gain(all, 7.199, 0.71, 1.01);
  // With the other slopes, and without dark slices at the end: sums of a program of its own.
  expect_gain(derivatives(part), 4.703, 2.18, 2.53);
  const MeasuredPart short_one = printed(comb(), kPrinter, kResin, true);
  expect_gain(derivatives(short_one), 4.740, 2.53, 2.09);
  expect_gain(derivatives(short_one, kALittleLess), 4.727, 2.53, 2.09);
  expect_gain(upper_ones(derivatives(short_one)), 4.649, 2.65, 2.22);
}

// Where stray light is on plugs, too, as in tune, the same with its column; with the same program.
TEST(Tune, GainsWithStrayLightOnPlugs) {
  expect_gain(derivatives(plugs({1.5})), 2.244, 9.28, 3.89);
  expect_gain(derivatives(plugs(staircase())), 5.634, 0.76, 1.13);
  auto all = derivatives(plugs(staircase()));
  const auto by = derivatives(printed(comb(), kPrinter, kResin, true, kLastGap), kALittleLess);
  all.insert(all.end(), by.begin(), by.end());
  expect_gain(all, 7.048, 0.71, 1.07);
}

// 40 dark slices, 20 lit ones, as they are: the upper edge is where light from them has cured to.
TEST(Tune, GainOfAnUncorrectedBlock) {
  MeasuredPart part;
  part.process = kProcess;
  part.layer_um = 50;
  part.edges = {{"begin", MeasuredKind::upper, 700}};
  part.intensity_mw_cm2.assign(40, 1);
  part.intensity_mw_cm2.resize(60, 100);
  std::vector<TuneVector> by;
  const auto z = predict_edges(part, kPrinter, kResin, {}, &by);
  EXPECT_NEAR(z[0], 695.2, 0.1);
  expect_gain(by, 2.996, 4.73, 8.86);
}

// Black light after a plug counts: as much dose, as high a plug.
TEST(Tune, BlackLightAfterAPlugCounts) {
  MeasuredPart part = plugs({3});
  MeasuredEdge& e = part.edges[0];
  const double before = predict_edges(part, kPrinter, kResin, {})[0];
  e.dark_s = 20 * e.exposure_s;
  e.dark_mw_cm2 = 1;
  e.exposure_s *= 0.8;  // 20 times 1 mW/cm² is a fifth of 100
  EXPECT_NEAR(predict_edges(part, kPrinter, kResin, {})[0], before, 1e-9 * before);
  // Stray light is on it for all of the time.
  std::vector<TuneVector> by;
  predict_edges(part, kPrinter, kResin, {}, &by);
  EXPECT_NEAR(by[0][2], 868.589 * 20.8 / 100, 0.01);
  EXPECT_NEAR(by[0][1], 868.589, 0.01);
}

// Derivatives against differences of the edges themselves.
TEST(Tune, DerivativesAreThoseOfTheEdges) {
  MeasuredPart dark = plugs({1.5, 4});
  dark.edges[0].dark_s = 30;
  dark.edges[0].dark_mw_cm2 = 1;
  for (const MeasuredPart& part : {printed(comb(), kPrinter, kResin, false), dark}) {
    const TuneVector x = {0.01, 0.02, 0.1};
    std::vector<TuneVector> by;
    predict_edges(part, kPrinter, kResin, x, &by);
    for (std::size_t k = 0; k < kTuned; ++k) {
      TuneVector more = x, less = x;
      more[k] += 1e-5;
      less[k] -= 1e-5;
      const auto up = predict_edges(part, kPrinter, kResin, more);
      const auto down = predict_edges(part, kPrinter, kResin, less);
      for (std::size_t i = 0; i < up.size(); ++i) {
        EXPECT_NEAR((up[i] - down[i]) / 2e-5, by[i][k], 1e-3 * (1 + std::abs(by[i][k]))) << i << k;
      }
    }
  }
}

// A resin of another laboratory, 1.8 times as transparent and 3 times as slow as its file says: one staircase
// finds both where what laboratories differ by is known before, and not where 10 % are believed.
TEST(Tune, OneStaircaseSaysMoreThanOtherLaboratories) {
  const double he = 1.8 * 2000 / std::log(10), slower = 3;
  MeasuredPart part = plugs({4, 6, 9, 14, 20, 30});
  const double areal = units::areal_from_volumetric(576, units::height_e_from_10(2000));
  const double read_off[] = {8, -12, 5, -3, 9, -7};
  for (std::size_t i = 0; i < part.edges.size(); ++i) {
    // Jacobs: he ln(I t/Dc).
    const double dose = 100 * part.edges[i].exposure_s;
    part.edges[i].measured_um = he * std::log(dose / (slower * areal)) + read_off[i];
  }
  const TuneResult wide = tune({part}, kPrinter, kResin, foreign_prior(0.5, 1.1), 10);
  // Figures are sure to about a hundredth: 10 um of 800 to 3600.
  EXPECT_NEAR(std::exp(wide.x[0]), 1.8, 0.03);
  EXPECT_NEAR(std::exp(wide.x[1]), 1 / slower, 0.02);
  EXPECT_LT(std::sqrt(wide.covariance[0][0]), 0.02);
  EXPECT_LT(std::sqrt(wide.covariance[1][1]), 0.03);
  EXPECT_THAT(foreign_prior(0.5, 1.1).text,
              testing::HasSubstr("a factor of 2.7, light over dose to one of 8.6"));
  // One plug alone leaves most open, and less than before.
  MeasuredPart one = part;
  one.edges.resize(1);
  const TuneResult little = tune({one}, kPrinter, kResin, foreign_prior(0.5, 1.1), 10);
  EXPECT_LT(std::sqrt(little.covariance[1][1]), 1.0);
  EXPECT_GT(std::sqrt(little.covariance[1][1]), 0.1);
}

/// Rms of figure 2.2's edges, corrected by what is believed; infinite where one is lost.
double error_of(const TuneVector& believed, const TuneVector& truth) {
  const MeasuredPart part = printed({{11, 20}, {31, 40}}, tuned_printer(kPrinter, 1, believed),
                                    tuned_resin(kResin, believed), false);
  // What the tuned printer's file says has the stray light that was found in it already.
  MeasuredPart shown = part;
  for (double& light : shown.intensity_mw_cm2) light -= believed[2] * std::exp(-believed[1]);
  const auto z = predict_edges(shown, kPrinter, kResin, truth);
  double squares = 0;
  for (std::size_t i = 0; i < z.size(); ++i) {
    if (std::isnan(z[i])) return std::numeric_limits<double>::infinity();
    squares += std::pow(z[i] - part.edges[i].designed_um, 2);
  }
  return std::sqrt(squares / static_cast<double>(z.size()));
}

/// Medians after rounds of `combs` combs, and before the first 18 plugs (or none).
std::vector<double> medians(int combs, bool staircases) {
  std::vector<std::vector<double>> errors(3);
  const std::vector<TuneVector> truths = {
      {0.1, 0.1, 0.1}, {0.1, -0.1, -0.1}, {-0.1, 0.1, 0.1}, {-0.1, -0.1, 0.1}};
  for (const TuneVector& truth : truths) {
    for (unsigned seed = 0; seed < 8; ++seed) {
      std::mt19937 random(seed);
      std::vector<MeasuredPart> parts;
      TuneVector x{};
      errors[0].push_back(error_of(x, truth));
      for (std::size_t round = 1; round < 3; ++round) {
        MeasuredPart corrected =
            printed(comb(), tuned_printer(kPrinter, 1, x), tuned_resin(kResin, x), false);
        for (double& light : corrected.intensity_mw_cm2) light -= x[2] * std::exp(-x[1]);
        for (int n = 0; n < combs; ++n) {
          parts.push_back(corrected);
          measure(parts.back(), truth, random, 10);
        }
        for (int n = 0; staircases && round == 1 && n < 3; ++n) {
          parts.push_back(plugs(staircase()));
          measure(parts.back(), truth, random, 10);
        }
        x = tune(parts, kPrinter, kResin, default_prior(), 10).x;
        errors[round].push_back(error_of(x, truth));
      }
    }
  }
  std::vector<double> found;
  for (auto& e : errors) {
    std::sort(e.begin(), e.end());
    found.push_back(e[e.size() / 2]);
  }
  return found;
}

// Where half of the runs end: bounds above what was seen with other truths and seeds.
TEST(Tune, AClosedLoopFindsThePrinter) {
  const auto comb_alone = medians(1, false), with_plugs = medians(1, true),
             ten = medians(10, false);
  for (const auto& [what, m] :
       {std::pair{"a comb", &comb_alone}, std::pair{"with plugs", &with_plugs},
        std::pair{"ten combs", &ten}}) {
    RecordProperty(what, fmt::format("{:.2f} {:.2f} {:.2f} um", (*m)[0], (*m)[1], (*m)[2]));
  }
  EXPECT_GT(comb_alone[0], 20);
  EXPECT_LT(comb_alone[2], 5);
  EXPECT_LT(with_plugs[2], 3);
  EXPECT_LT(ten[2], 2);
}

std::string refusal(const std::vector<MeasuredPart>& parts, double sigma = 10) {
  try {
    tune(parts, kPrinter, kResin, default_prior(), sigma);
  } catch (const InputError& e) {
    return e.what();
  }
  return "";
}

TEST(Tune, WhatCantBeIsRefused) {
  std::mt19937 random(1);
  MeasuredPart part = printed(comb(), kPrinter, kResin, false);
  measure(part, {}, random, 10);
  MeasuredPart swapped = part, metres = part, none = part;
  std::swap(swapped.edges[2].measured_um, swapped.edges[3].measured_um);
  for (auto& e : metres.edges) e.measured_um *= 1e-3;
  for (auto& e : none.edges) e.measured_um = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(refusal({swapped}), testing::HasSubstr("swapped"));
  EXPECT_THAT(refusal({metres}),
              testing::AllOf(testing::HasSubstr("measured_um"),
                             testing::HasSubstr("lengths in um: are these mm?")));
  EXPECT_THAT(refusal({none}), testing::HasSubstr("nothing was measured"));
  EXPECT_THAT(refusal({part}, 0), testing::HasSubstr("more than 0"));
  MeasuredPart stairs = plugs(staircase());
  measure(stairs, {}, random, 10);
  // By the name of the column that was filled in.
  MeasuredPart in_mm = stairs;
  for (auto& e : in_mm.edges) e.measured_um *= 1e-3;
  EXPECT_THAT(refusal({in_mm}), testing::HasSubstr("cured_height_um: is 0.001"));
  std::swap(stairs.edges[1].measured_um, stairs.edges[4].measured_um);
  EXPECT_THAT(refusal({stairs}), testing::HasSubstr("swapped"));
  TunePrior prior = default_prior();
  prior.covariance[0][1] = prior.covariance[1][0] = 0.02;
  EXPECT_THROW(check_prior(prior), InputError);
}

TEST(Tune, OutliersAndFarResultsAreTold) {
  std::mt19937 random(2);
  MeasuredPart part = printed(comb(), kPrinter, kResin, false);
  measure(part, {0.02, 0.02, 0}, random, 5);
  part.edges[5].measured_um += 150;
  const TuneResult off = tune({part}, kPrinter, kResin, default_prior(), 10);
  ASSERT_EQ(off.outliers.size(), 1u);
  EXPECT_EQ(off.used, 11u);
  MeasuredPart far = plugs(staircase());
  measure(far, {0, 0.5, 0}, random, 5);
  EXPECT_EQ(tune({far}, kPrinter, kResin, default_prior(), 10).remarks.size(), 1u);
}

// The files say together what was found, and the next round begins with what the last one knew.
TEST(Tune, FilesSayWhatWasFound) {
  const Printer printer = parse_printer(kPrinterFile, "p.toml");
  const Resin resin = parse_resin(kResinFile, "r.toml");
  const TuneResult r = found_so({0.05, -0.08, 0.2});
  const std::string resin_file = resin_with_tuning(kResinFile, "r.toml", "tuned", printer, r);
  const std::string printer_file = printer_with_tuning(kPrinterFile, "p.toml", printer, r);
  const Resin tuned = parse_resin(resin_file, "r.toml");
  EXPECT_EQ(tuned.name, "tuned");
  EXPECT_EQ(name_in_file("a/my-resin.toml", "r"), "my-resin");
  EXPECT_EQ(name_in_file("a/My Resin.toml", "r"), "r");
  const Printer shines = parse_printer(printer_file, "p.toml");
  EXPECT_NEAR(tuned.absorbance_height10_um, 2000 * std::exp(0.05), 1e-3);
  EXPECT_NEAR(tuned.critical_dose_mj_cm3, 576 * std::exp(0.08 - 0.05), 1e-3);
  EXPECT_NEAR(shines.calibration[0].intensity_mw_cm2, 1 + 0.2 * std::exp(0.08), 1e-6);
  EXPECT_NEAR(shines.calibration[1].intensity_mw_cm2, 100 + 0.2 * std::exp(0.08),
              5.1e-5);  // seven digits
  // A part prints by the new files as it does by the old ones and x.
  const MeasuredPart part = printed(comb(), printer, resin, false);
  MeasuredPart again = part;
  for (double& light : again.intensity_mw_cm2) light += 0.2 * std::exp(0.08);
  const auto before = predict_edges(part, printer, resin, r.x);
  const auto after = predict_edges(again, shines, tuned, {});
  for (std::size_t i = 0; i < before.size(); ++i) EXPECT_NEAR(before[i], after[i], 0.01) << i;

  const TunePrior next = prior_of(resin_file, "r.toml", shines);
  EXPECT_THAT(next.text, testing::HasSubstr("tuning before"));
  const double stray = std::exp(0.08);
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < 3; ++j) {
      const double unit = (i == 2 ? stray : 1) * (j == 2 ? stray : 1);
      EXPECT_NEAR(next.covariance[i][j], unit * r.covariance[i][j], 1e-7 * unit) << i << j;
    }
  }
  // With another printer, or before its file was changed, only what a fit would know.
  const TunePrior other = prior_of(resin_file, "r.toml", printer);
  EXPECT_THAT(other.text, testing::HasSubstr("another printer or calibration"));
  EXPECT_NEAR(other.covariance[0][0], 1e-4, 1e-8);
  EXPECT_NEAR(other.covariance[1][1], 2e-4 + 9e-4, 1e-8);
}

// Two rounds, one after the other by files, know as much as both together.
TEST(Tune, RoundsAddUp) {
  const Printer printer = parse_printer(kPrinterFile, "p.toml");
  const Resin resin = parse_resin(kResinFile, "r.toml");
  std::mt19937 random(3);
  std::vector<MeasuredPart> parts;
  for (int n = 0; n < 2; ++n) {
    parts.push_back(printed(comb(), printer, resin, false));
    measure(parts.back(), {0.02, -0.03, 0.05}, random, 10);
  }
  const TuneResult both = tune(parts, printer, resin, default_prior(), 10);
  const TuneResult first = tune({parts[0]}, printer, resin, default_prior(), 10);
  const std::string file = resin_with_tuning(kResinFile, "r.toml", "tuned", printer, first);
  const Printer shines =
      parse_printer(printer_with_tuning(kPrinterFile, "p.toml", printer, first), "p.toml");
  MeasuredPart second = parts[1];
  for (double& light : second.intensity_mw_cm2) light += first.x[2] * std::exp(-first.x[1]);
  const TuneResult then =
      tune({second}, shines, parse_resin(file, "r.toml"), prior_of(file, "r.toml", shines), 10);
  // The model is not quite linear: a twentieth of a standard deviation.
  for (std::size_t i = 0; i < 2; ++i) {
    const double sd = std::sqrt(both.covariance[i][i]);
    EXPECT_NEAR(first.x[i] + then.x[i], both.x[i], 0.05 * sd) << i;
    EXPECT_NEAR(std::sqrt(then.covariance[i][i]), sd, 0.02 * sd) << i;
  }
}

TEST(Tune, CovariancesThatAreNoneAreRefused) {
  const Printer printer = parse_printer(kPrinterFile, "p.toml");
  const std::string begin =
      std::string(kResinFile) +
      "[provenance]\ntuning = \"p, 1 to 100 mW/cm2: ha, light, stray_mw_cm2: ";
  const auto says = [&](const std::string& matrix) {
    try {
      prior_of(begin + matrix + "\"\n", "r.toml", printer);
    } catch (const InputError& e) {
      return std::string(e.what());
    }
    return std::string();
  };
  EXPECT_EQ(says("[[1e-4, 0, 0], [0, 1e-4, 0], [0, 0, 1e-2]]"), "");
  EXPECT_THAT(says("[[1e-4, 2e-4, 0], [2e-4, 1e-4, 0], [0, 0, 1e-2]]"),
              testing::AllOf(testing::HasSubstr("r.toml"), testing::HasSubstr("light and ha")));
  EXPECT_THAT(says("[[-1e-4, 0, 0], [0, 1e-4, 0], [0, 0, 1e-2]]"), testing::HasSubstr("ha and ha"));
  EXPECT_THAT(says("[[1e-4, 1e-5, 0], [0, 1e-4, 0], [0, 0, 1e-2]]"),
              testing::HasSubstr("symmetric"));
  EXPECT_THAT(says("[[1e-4, 0], [0, 1e-4]]"), testing::HasSubstr("3 x 3"));
  EXPECT_THAT(says("[[1e-4, 0, x], [0, 1e-4, 0], [0, 0, 1e-2]]"), testing::HasSubstr("3 x 3"));
}

// What each kind of part would tell; of ha and light as much as the derivatives of its places say.
TEST(Tune, NextParts) {
  Printer printer = test::linear_printer(1, 100);
  printer.width_px = 1280;
  printer.height_px = 800;
  TuneResult nothing;
  nothing.covariance = default_prior().covariance;
  const auto next = next_parts(printer, kResin, nothing, kProcess, 50, 10);
  ASSERT_EQ(next.size(), 7U);
  EXPECT_TRUE(std::is_sorted(next.begin(), next.begin() + 4,
                             [](const auto& a, const auto& b) { return a.nat > b.nat; }));
  const auto of = [&](const std::string& part) {
    return *std::find_if(next.begin(), next.end(), [&](const auto& n) { return n.part == part; });
  };
  // With levels, so that edges lie where these put them.
  EXPECT_NEAR(of("comb").nat, 4.74, 0.1);
  // Three staircases at once tell more than one (5.63), less than three independent halves.
  EXPECT_GT(of("staircase").nat, 6.2);
  EXPECT_LT(of("staircase").nat, 8.5);
  EXPECT_GT(of("wedge").nat, 5);
  EXPECT_FALSE(of("flat-field").tuned);
  // 5 % before, 10 um of 868.6 um: per place half of ln(1 + 4.34²); 8 x 5 places.
  EXPECT_NEAR(of("flat-field").nat, 40 * 0.5 * std::log1p(std::pow(0.05 * 86.8589, 2)), 0.01);
  EXPECT_GT(of("spread").nat, 1);
  EXPECT_THAT(of("dead-zone").text, testing::HasSubstr("no [inhibition]"));
  // The more is known, the less a part tells.
  TuneResult known = nothing;
  known.covariance = gain_of(nothing.covariance, derivatives(plugs(staircase())), 10).covariance;
  const auto later = next_parts(printer, kResin, known, kProcess, 50, 10);
  EXPECT_LT(later[0].nat, next[0].nat);
}

}  // namespace
}  // namespace slicecorr::resins::combs
