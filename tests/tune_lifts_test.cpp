// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Tuning of prints that lift, and in light told as a share of the brightest level's.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "models.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/resins/tune.hpp"
#include "slicecorr/same_light.hpp"
#include "slicecorr/tuned_together.hpp"
#include "slicecorr/units.hpp"
#include "tune_combs.hpp"

namespace slicecorr::resins::combs {
namespace {

/// Layer by layer with lifts: 6 gel doses at the window, ha 200 um.
const Resin kLiftedResin =
    test::resin(units::volumetric_from_areal(10, units::height_e_from_10(200)), 200);
Process lifted_process() {
  Process p;
  p.mode = ExposureMode::layerwise;
  p.exposure_s = 0.6;
  p.lifts = Lifts::each;
  return p;
}

/// Teeth behind 20 dark slices, corrected as if lifts exchanged nothing: light that rises from layer to layer
/// shows best what they do exchange.
MeasuredPart lifted_comb(const std::vector<int>& teeth, const std::vector<int>& gaps) {
  MeasuredPart part;
  part.process = lifted_process();
  part.layer_um = 50;
  Runs runs;
  int at = 20;
  for (std::size_t i = 0; i < teeth.size(); ++i) {
    runs.push_back({at, at + teeth[i] - 1});
    part.edges.push_back({"begin", MeasuredKind::upper, at * 50.0});
    part.edges.push_back({"end", MeasuredKind::lower, (at + teeth[i]) * 50.0});
    at += teeth[i] + (i < gaps.size() ? gaps[i] : 0);
  }
  part.process.lift_exchange = 0;
  const CureModel model = make_cure_model(kPrinter, kLiftedResin, part.process, 50);
  const std::vector<double> levels = level_intensities(kPrinter);
  for (const auto level : solve_column({model, part.process, at, at}, test::column(at, runs))) {
    part.intensity_mw_cm2.push_back(levels[level]);
  }
  return part;
}
MeasuredPart lift_comb() { return lifted_comb({1, 2, 4, 8, 16, 32}, {16, 16, 16, 16, 16}); }

/// Prints it lift by lift: where each tooth begins, by halving between a place that gels and one that does
/// not; it ends at a window. Truth as in x, the exchange as it is.
void print_by_lifts(MeasuredPart& part, const TuneVector& truth, double exchange) {
  const double ha_um = 200 * std::exp(truth[0]);
  const auto gels = [&](double z_um) {
    double dose = 0;
    const auto first = static_cast<std::size_t>(z_um / 50);
    for (std::size_t n = first; n < part.intensity_mw_cm2.size(); ++n) {
      const double light = part.intensity_mw_cm2[n] * std::exp(truth[1]) + truth[2];
      const double deep_um = 50.0 * static_cast<double>(n + 1) - z_um;
      dose = (1 - exchange) * dose + light * 0.6 / 10 * std::pow(10, -deep_um / ha_um);
      if (dose >= 1) return true;
    }
    return false;
  };
  for (std::size_t i = 0; i < part.edges.size(); i += 2) {
    MeasuredEdge &begin = part.edges[i], &end = part.edges[i + 1];
    end.measured_um = end.designed_um;
    double solid = end.designed_um - 1e-6;
    if (!gels(solid)) {
      begin.measured_um = end.measured_um = std::numeric_limits<double>::quiet_NaN();
      continue;
    }
    double open = solid;
    while (open > 0 && gels(open)) open -= 0.5;
    solid = open + 0.5;
    for (int k = 0; k < 30; ++k) (gels(0.5 * (solid + open)) ? solid : open) = 0.5 * (solid + open);
    begin.measured_um = solid;
  }
}

TEST(Tune, EdgesLayerByLayerAreThoseOfAPrintLiftByLift) {
  MeasuredPart part = lift_comb();
  for (const TuneVector& x : {TuneVector{}, TuneVector{0.05, 0.03, 0.1, -0.3},
                              TuneVector{-0.04, 0.1, 0, 0.4}, TuneVector{0, 0, 0.2, 0.5}}) {
    print_by_lifts(part, x, 0.5 + x[3]);
    std::vector<TuneVector> by;
    const auto z = predict_edges(part, kPrinter, kLiftedResin, x, &by);
    for (std::size_t i = 0; i < z.size(); ++i) {
      ASSERT_FALSE(std::isnan(part.edges[i].measured_um)) << i;
      EXPECT_NEAR(z[i], part.edges[i].measured_um, 1e-5) << i;
    }
    for (std::size_t k = 0; k < kTuned && x[3] < 0.5; ++k) {
      TuneVector more = x, less = x;
      more[k] += 1e-5;
      less[k] -= 1e-5;
      const auto up = predict_edges(part, kPrinter, kLiftedResin, more);
      const auto down = predict_edges(part, kPrinter, kLiftedResin, less);
      for (std::size_t i = 0; i < up.size(); ++i) {
        EXPECT_NEAR((up[i] - down[i]) / 2e-5, by[i][k], 1e-3 * (1 + std::abs(by[i][k]))) << i << k;
      }
    }
  }
}

// Truths as the prior has them, teeth read to 10 um: the exchange and the absorbance height are within
// what is told of them in 95 % of the fits.
TEST(Tune, TeethOfFewAndOfManyLayersTellTheExchange) {
  std::mt19937 random(13);
  std::normal_distribution<double> normal;
  int right_exchange = 0, right_ha = 0, told = 0;
  double sds = 0;
  constexpr int runs = 60;
  for (int run = 0; run < runs; ++run) {
    const TuneVector truth{0.1 * normal(random), 0.1 * normal(random), 0.2 * normal(random)};
    const double exchange = std::clamp(0.5 + 0.3 * normal(random), 0.05, 0.95);
    MeasuredPart part = lift_comb();
    print_by_lifts(part, truth, exchange);
    for (MeasuredEdge& e : part.edges) e.measured_um += 10 * normal(random);
    const TuneResult r = tune({part}, kPrinter, kLiftedResin, default_prior(), 10);
    const double share = tuned_exchange(kPrinter, r.x), sd = std::sqrt(r.covariance[3][3]);
    right_exchange += std::abs(share - exchange) < 1.96 * sd;
    right_ha += std::abs(r.x[0] - truth[0]) < 1.96 * std::sqrt(r.covariance[0][0]);
    told += r.lift_exchange.has_value();
    sds += sd / runs;
  }
  RecordProperty("exchange", fmt::format("{} of {} right, {} told, sd {:.3f}", right_exchange, runs,
                                         told, sds));
  RecordProperty("ha", fmt::format("{} right", right_ha));
  // Of 60 fits 57 are to be right; four standard deviations, 1.7 each.
  EXPECT_GE(right_exchange, 50);
  EXPECT_GE(right_ha, 50);
  // Where nearly all is exchanged little can be told.
  EXPECT_GE(told, 40);
  EXPECT_LT(sds, 0.14);
}

// What a comb for continuous prints has, teeth of ten layers all of them, does not tell it: neither printed
// continuously nor layer by layer.
TEST(Tune, AnOlderCombDoesNotTellTheExchange) {
  std::mt19937 random(19);
  MeasuredPart continuous = printed(comb(), kPrinter, kResin, false);
  measure(continuous, {0.05, -0.03, 0.1}, random, 10);
  const TuneResult before = tune({continuous}, kPrinter, kResin, default_prior(), 10);
  EXPECT_FALSE(before.lift_exchange);
  EXPECT_EQ(before.x[3], 0);
  EXPECT_NEAR(before.covariance[3][3], 0.09, 1e-9);
  EXPECT_THAT(before.to_text(kPrinter, kResin, default_prior()),
              testing::HasSubstr("can't be told by these parts; a lift-comb"));
  for (const double exchange : {0.2, 0.4, 0.7}) {
    MeasuredPart old = lifted_comb({10, 10, 10}, {16, 16});
    print_by_lifts(old, {0.05, -0.03, 0.1}, exchange);
    const TuneResult r = tune({old}, kPrinter, kLiftedResin, default_prior(), 10);
    EXPECT_FALSE(r.lift_exchange) << exchange;
    EXPECT_EQ(r.used, 6U);
  }
}

// All or nothing exchanged: the fit stays within what can be.
TEST(Tune, TheExchangeIsAShare) {
  for (const double exchange : {0.0, 1.0}) {
    MeasuredPart part = lift_comb();
    print_by_lifts(part, {0.02, 0.02, 0}, exchange);
    const TuneResult r = tune({part, part, part}, kPrinter, kLiftedResin, default_prior(), 5);
    ASSERT_TRUE(r.lift_exchange) << exchange;
    EXPECT_NEAR(*r.lift_exchange, exchange, 0.1);
    EXPECT_GE(*r.lift_exchange, 0);
    EXPECT_LE(*r.lift_exchange, 1);
    EXPECT_NEAR(r.x[0], 0.02, 3 * std::sqrt(r.covariance[0][0]));
  }
}

TEST(Tune, FilesSayTheExchange) {
  const Printer printer = parse_printer(kPrinterFile, "p.toml");
  const Resin resin = parse_resin(kResinFile, "r.toml");
  TuneResult r = found_so({0.05, -0.08, 0.2, -0.2});
  r.covariance[3] = {1e-4, 2e-4, 3e-4, 4e-3};
  for (std::size_t i = 0; i < 3; ++i) r.covariance[i][3] = r.covariance[3][i];
  r.lift_exchange = tuned_exchange(printer, r.x);
  EXPECT_DOUBLE_EQ(*r.lift_exchange, 0.3);
  const std::string printer_file = printer_with_tuning(kPrinterFile, "p.toml", printer, r);
  EXPECT_THAT(printer_file, testing::HasSubstr("[process]"));
  const Printer shines = parse_printer(printer_file, "p.toml");
  EXPECT_NEAR(shines.lift_exchange, 0.3, 1e-6);
  const std::string resin_file = resin_with_tuning(kResinFile, "r.toml", "tuned", printer, r);
  const TunePrior next = prior_of(resin_file, "r.toml", shines);
  EXPECT_THAT(next.text, testing::HasSubstr("tuning before"));
  EXPECT_NEAR(next.covariance[3][3], 4e-3, 1e-9);
  EXPECT_NEAR(next.covariance[2][3], 3e-4 * std::exp(0.08), 1e-9);
  EXPECT_DOUBLE_EQ(exchange_before(shines), shines.lift_exchange);
  EXPECT_THAT(r.to_text(printer, resin, default_prior()),
              testing::HasSubstr("exchanged at a lift, share"));
  // Where it was not told the files say nothing of it.
  r.lift_exchange.reset();
  EXPECT_LT(parse_printer(printer_with_tuning(kPrinterFile, "p.toml", printer, r), "p.toml")
                .lift_exchange,
            0);
  EXPECT_NEAR(
      prior_of(resin_with_tuning(kResinFile, "r.toml", "tuned", printer, r), "r.toml",
               parse_printer(printer_with_tuning(kPrinterFile, "p.toml", printer, r), "p.toml"))
          .covariance[3][3],
      0.09, 1e-9);
}

/// The same light and resin, told in shares of the brightest level and seconds of it.
Printer in_shares(Printer printer) {
  const double full = printer.calibration.back().intensity_mw_cm2;
  for (CalibrationPoint& c : printer.calibration) c.intensity_mw_cm2 /= full;
  printer.unit = LightUnit::brightest;
  return printer;
}
Resin in_seconds(Resin resin, double full) {
  resin.critical_dose_mj_cm3 /= full;
  resin.gel_dose_mj_cm3 = 0;
  resin.unit = LightUnit::brightest;
  return resin;
}

// Who has no power meter finds the same: a comb says nothing of the unit of light.
TEST(Tune, LightInSharesTellsTheSame) {
  const Printer shares = in_shares(kPrinter);
  const Resin seconds = in_seconds(kLiftedResin, 100);
  // Of the 100 mW/cm² of full light a hundredth.
  TunePrior prior = default_prior();
  prior.covariance[2][2] = 1;
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  for (int run = 0; run < 3; ++run) {
    const TuneVector truth{0.1 * normal(random), 0.1 * normal(random), 0.3 * normal(random)};
    MeasuredPart part = lift_comb();
    print_by_lifts(part, truth, 0.3 + 0.2 * run);
    for (MeasuredEdge& e : part.edges) e.measured_um += 5 * normal(random);
    MeasuredPart of_full = part;
    for (double& light : of_full.intensity_mw_cm2) light /= 100;
    const TuneResult r = tune({part}, kPrinter, kLiftedResin, prior, 5);
    const TuneResult s = tune({of_full}, shares, seconds, default_prior(LightUnit::brightest), 5);
    // A hundredth of a standard deviation: the search ends that near.
    for (std::size_t i = 0; i < kTuned; ++i) {
      const double unit = i == 2 ? 100 : 1, sd = std::sqrt(r.covariance[i][i]);
      EXPECT_NEAR(unit * s.x[i], r.x[i], 0.01 * sd) << i;
      EXPECT_NEAR(unit * std::sqrt(s.covariance[i][i]), sd, 0.01 * sd) << i;
    }
    EXPECT_EQ(s.lift_exchange.has_value(), r.lift_exchange.has_value());
    // The unit stays the brightest level, which stray light makes brighter.
    const Printer shines = tuned_printer(kPrinter, 1, r.x),
                  of_shares = tuned_printer(shares, 1, s.x);
    const double full = shines.calibration.back().intensity_mw_cm2;
    EXPECT_EQ(of_shares.calibration.back().intensity_mw_cm2, 1);
    EXPECT_NEAR(of_shares.calibration.front().intensity_mw_cm2 * full,
                shines.calibration.front().intensity_mw_cm2, 0.02);
    EXPECT_NEAR(tuned_resin(seconds, s.x).critical_dose_mj_cm3 * full /
                    tuned_resin(kLiftedResin, r.x).critical_dose_mj_cm3,
                1, 1e-3);
    EXPECT_THAT(s.to_text(shares, seconds, default_prior(LightUnit::brightest)),
                testing::AllOf(testing::HasSubstr("stray light 0.01 of the brightest level's"),
                               testing::Not(testing::HasSubstr("mW/cm²"))));
  }
  EXPECT_THROW(tune({lift_comb()}, shares, kLiftedResin, prior, 5), InputError);
}

TEST(Tune, FilesInSharesStayInThem) {
  const std::string printer_text =
      "name = \"p\"\n[display]\nwidth_px = 100\nheight_px = 100\npixel_um = 50\n[blue]\n"
      "wavelength_nm = 405\nunit = \"of the brightest level\"\ncalibration = [[0, 0.01], [128, "
      "0.4], [255, 1]]\n";
  const std::string resin_text =
      "name = \"r\"\n[cure]\nmodel = \"jacobs\"\nunit = \"of the brightest level\"\n"
      "wavelength_nm = 405\nabsorbance_height_um = 200\nabsorbance_base = 10\ncritical_dose_s = 1.5\n"
      "display = \"p\"\n";
  const Printer printer = parse_printer(printer_text, "p.toml");
  const Resin resin = parse_resin(resin_text, "r.toml");
  TuneResult r = found_so({0.05, -0.08, 0.02, -0.2});
  r.resin_before = "r";
  r.counted = {"0123456789abcdef"};
  Printer renamed = printer;
  renamed.name = "tuned-printer";
  const std::string resin_file = resin_with_tuning(resin_text, "r.toml", "tuned", renamed, r);
  const std::string printer_file = printer_with_tuning(printer_text, "p.toml", renamed, r);
  const Printer shines = parse_printer(printer_file, "p.toml");
  const Resin tuned = parse_resin(resin_file, "r.toml");
  const double stray = 0.02 * std::exp(0.08), full = 1 + stray;
  EXPECT_EQ(shines.unit, LightUnit::brightest);
  EXPECT_NEAR(shines.calibration[0].intensity_mw_cm2, (0.01 + stray) / full, 1e-8);
  EXPECT_NEAR(shines.calibration[1].intensity_mw_cm2, (0.4 + stray) / full, 1e-7);
  EXPECT_EQ(tuned.display, "tuned-printer");
  EXPECT_NEAR(tuned.critical_dose_mj_cm3 / resin.critical_dose_mj_cm3, std::exp(0.08 - 0.05) / full,
              1e-6);
  const TunePrior next = prior_of(resin_file, "r.toml", shines);
  EXPECT_THAT(next.text, testing::HasSubstr("tuning before"));
  EXPECT_NEAR(next.covariance[2][2], r.covariance[2][2] * std::exp(0.16) / (full * full), 1e-9);
  EXPECT_NO_THROW(check_same_light(shines, tuned, false, false, ""));
  EXPECT_THROW(check_same_light(printer, tuned, false, false, ""), InputError);
  // The other way round: the printer that was tuned, with the resin of before. Others are taken.
  EXPECT_NO_THROW(check_tuned_together({printer_file, "p.toml"}, tuned));
  EXPECT_NO_THROW(check_tuned_together({printer_text, "p.toml"}, resin));
  Resin other = resin;
  other.name = "other";
  EXPECT_NO_THROW(check_tuned_together({printer_file, "p.toml"}, other));
  EXPECT_THROW(check_tuned_together({printer_file, "p.toml"}, resin), InputError);
}

TEST(Tune, WhatWasCountedOnceIsNotCountedAgain) {
  MeasuredPart part = lift_comb();
  print_by_lifts(part, {}, 0.4);
  MeasuredPart other = part;
  other.edges.front().measured_um += 1;
  TuneResult r = found_so({0.05, -0.08, 0.2});
  r.counted = {mark_of(part)};
  const Printer printer = parse_printer(kPrinterFile, "p.toml");
  const std::string file = resin_with_tuning(kResinFile, "r.toml", "tuned", printer, r);
  EXPECT_NO_THROW(check_not_counted(kResinFile, "r.toml", {part, other}));
  EXPECT_THROW(check_not_counted(kResinFile, "r.toml", {part, part}), InputError);
  EXPECT_NO_THROW(check_not_counted(file, "r.toml", {other}));
  EXPECT_THROW(check_not_counted(file, "r.toml", {other, part}), InputError);
  r.counted = {mark_of(other)};
  const std::string both = resin_with_tuning(file, "r.toml", "again", printer, r);
  EXPECT_THROW(check_not_counted(both, "r.toml", {part}), InputError);
  EXPECT_THROW(check_not_counted(both, "r.toml", {other}), InputError);
}

}  // namespace
}  // namespace slicecorr::resins::combs
