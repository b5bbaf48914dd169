// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Doses and correction under inhibiting UV light, against direct integration of the rate equation.

#include "slicecorr/inhibited.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "custom_resin.hpp"
#include "models.hpp"
#include "rounds.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/predict.hpp"
#include "slicecorr/units.hpp"
#include "uv_models.hpp"

namespace slicecorr {
namespace {

using testing::HasSubstr;

using namespace test::uv;

TEST(InhibitedKernel, LongExposureOfResin1) {
  // physics.md §5: 100 mW/cm² blue, 200 mW/cm² UV, 1000 mm/h.
  const CureModel with = model_of(resin_1(), uv_process(1000, 200), 50);
  EXPECT_NEAR(with.phi_max(), 1.9364, 5e-5);
  const CureModel without = model_of(resin_1(), test::process(1000), 50);
  EXPECT_NEAR(without.phi_max(), 2.2138, 5e-5);
  // The height of slices does not matter after a long exposure.
  EXPECT_NEAR(model_of(resin_1(), uv_process(1000, 200), 10).phi_max(), with.phi_max(), 1e-6);
}

TEST(InhibitedKernel, WithoutUvNothingChanges) {
  // A resin with an inhibition and no light that inhibits is a resin without one, bit for bit.
  Resin bare = resin_1();
  bare.inhibition.reset();
  const CureModel a = model_of(resin_1(), test::process(1000), 50);
  const CureModel b = model_of(bare, test::process(1000), 50);
  EXPECT_TRUE(a.is_plain());
  EXPECT_EQ(a.level_phi, b.level_phi);
  EXPECT_EQ(a.a, b.a);
  const auto coverage = test::column(40, {{5, 12}, {20, 30}});
  EXPECT_EQ(solve_column(test::plan_for(a, test::process(1000), 40), coverage),
            solve_column(test::plan_for(b, test::process(1000), 40), coverage));
}

TEST(InhibitedKernel, FaintUvIsTheRecursion) {
  // UV of 1e-9 of the blue: tables and tail against (A.32).
  for (const double m : {0.5, 1.0, 1.29}) {
    const CureModel faint = model_of(resin_1(m), uv_process(1000, 1e-7), 50);
    const CureModel none = model_of(resin_1(m), test::process(1000), 50);
    std::mt19937 random(3);
    std::vector<std::uint8_t> pixels(120);
    for (auto& p : pixels) p = static_cast<std::uint8_t>(random() % 256);
    const ColumnDose a = column_dose(faint, pixels), b = column_dose(none, pixels);
    for (std::size_t n = 0; n < pixels.size(); ++n) {
      // Level 0 (1 mW/cm²) feels the UV most: a share of 7e-8 near the window.
      EXPECT_NEAR(a.upper[n], b.upper[n], 1e-7 * b.upper[n] + 1e-9) << m << " " << n;
      EXPECT_NEAR(a.middle[n], b.middle[n], 1e-7 * b.middle[n] + 1e-9) << m << " " << n;
    }
  }
}

/// Dose at z (in slices) from the rate equation itself, by the midpoint rule in time.
double integrated(const Resin& resin, const Process& process, double layer_um,
                  const std::vector<double>& blue, const std::vector<double>& uv, double zeta,
                  int steps) {
  const Kinetics k = make_kinetics(resin, true, true);
  double dose = 0;
  for (std::size_t n = 0; n < blue.size(); ++n) {
    const bool moving = process.mode == ExposureMode::continuous;
    const double time_s = moving ? units::slice_time_s(layer_um, process.speed_mm_h)
                                 : layer_exposure_s(process, static_cast<int>(n));
    for (int i = 0; i < steps; ++i) {
      const double window =
          static_cast<double>(n) + (moving ? (i + 0.5) / static_cast<double>(steps) : 1.0);
      if (window < zeta) continue;
      dose += dose_prime_at(k, blue[n], uv[n], (window - zeta) * layer_um, time_s / steps) /
              k.critical_dose_prime;
    }
  }
  return dose;
}

TEST(InhibitedDose, EqualsDirectIntegrationOnRandomSchedules) {
  std::mt19937 random(11);
  for (int round = 0; round < 12; ++round) {
    const double m = std::vector<double>{0.5, 0.7, 1.0, 1.29}[static_cast<std::size_t>(round % 4)];
    const double layer_um = round % 3 == 0 ? 10 : 50;
    Process process = uv_process(800, 0);
    if (round % 2) {
      process.mode = ExposureMode::layerwise;
      process.speed_mm_h = 0;
      process.exposure_s = 0.4;
      process.bottom_exposure_s = 1.5;
      process.bottom_layers = 7;
      process.fade_layers = 4;
    }
    // Every third schedule changes its UV from slice to slice.
    const int slices = layer_um == 10 ? 120 : 50;
    std::vector<double> uv(static_cast<std::size_t>(slices), 200.0);
    if (round % 3 == 1) {
      process.uv.kind = UvKind::per_slice;
      for (double& u : uv) u = 40.0 + 20.0 * static_cast<double>(random() % 10);
      process.uv.slice_mw_cm2 = uv;
    } else {
      process.uv.uv_mw_cm2 = 200;
    }
    const Resin resin = resin_1(m);
    const CureModel model = model_of(resin, process, layer_um);
    std::vector<std::uint8_t> pixels;
    std::vector<double> blue;
    const auto intensity = level_intensities(uv_printer());
    std::uint8_t level = 0;
    for (int n = 0; n < slices; ++n) {
      // Stretches of one level and single slices.
      if (random() % 3 == 0) level = static_cast<std::uint8_t>(random() % 256);
      pixels.push_back(level);
      blue.push_back(intensity[level]);
    }
    const ColumnDose dose = column_dose(model, pixels);
    for (int n = 0; n < slices; n += 13) {
      const auto i = static_cast<std::size_t>(n);
      const auto reference = [&](double zeta) {
        return integrated(resin, process, layer_um, blue, uv, zeta, 4000);
      };
      // The midpoint rule with h = hs / 4000 errs by h² / 24 * (sum of |f'|) away from the front
      // and by at most h^(1 + m) f there: 1e-5 of the dose holds both. What the tail leaves out is
      // below 1e-6 of the dose at full light, 1e-4 of what black gives.
      const auto tolerance = [](double d) { return 2e-5 * d + 2e-6; };
      const double upper = reference(n + 1e-12), middle = reference(n + 0.5);
      EXPECT_NEAR(dose.upper[i], upper, tolerance(upper)) << round << " slice " << n;
      EXPECT_NEAR(dose.middle[i], middle, tolerance(middle)) << round << " slice " << n;
    }
  }
}

TEST(InhibitedDose, SharesOfBothLightsAreThoseOfTheRateItself) {
  // Blue light of a share s under constant, scheduled and patterned UV light, of which less comes, too.
  std::mt19937 random(19);
  for (int round = 0; round < 6; ++round) {
    const double layer_um = 50;
    Resin resin = resin_1(std::vector{0.7, 1.0, 1.29}[static_cast<std::size_t>(round % 3)]);
    // What light without UV light counts as is something else.
    resin.m = 0.9;
    Process process = uv_process(800, 200);
    if (round % 2) {
      process.mode = ExposureMode::layerwise;
      process.speed_mm_h = 0;
      process.exposure_s = 0.4;
    }
    Printer printer = uv_printer();
    const bool patterned = round >= 4;
    if (patterned) {
      printer.uv->patterned = true;
      process.uv = {UvKind::patterned, 0, 10, {}};
    }
    constexpr int slices = 40;
    for (int n = 0; n < slices; ++n) {
      process.light_share.push_back(0.5 + 0.05 * static_cast<double>(random() % 11));
      if (round >= 2)
        process.uv_lamp_share.push_back(0.8 + 0.02 * static_cast<double>(random() % 10));
    }
    const CureModel model = make_cure_model(printer, resin, process, layer_um);
    const auto intensity = level_intensities(printer);
    std::vector<std::uint8_t> pixels;
    std::vector<double> blue, uv;
    for (int n = 0; n < slices; ++n) {
      const auto i = static_cast<std::size_t>(n);
      const auto level = static_cast<std::uint8_t>(random() % 256);
      pixels.push_back(level);
      blue.push_back(intensity[level] * process.light_share[i]);
      uv.push_back(200 * (round >= 2 ? process.uv_lamp_share[i] : 1));
      if (patterned) {
        const auto of_level = static_cast<std::size_t>(model.inhibited()->uv_levels()[level]);
        uv.back() = uv_level_intensities(printer)[of_level] * process.uv_lamp_share[i];
        // No pixel of any slice has less than the dead zone that is asked for.
        EXPECT_GE(uv.back(),
                  uv_for_dead_zone(make_kinetics(resin, true, true), blue.back(), 10) * (1 - 1e-9));
      }
    }
    const ColumnDose dose = column_dose(model, pixels);
    for (int n = 0; n < slices; n += 13) {
      const auto i = static_cast<std::size_t>(n);
      // As above.
      const auto tolerance = [](double d) { return 2e-5 * d + 2e-6; };
      const double upper = integrated(resin, process, layer_um, blue, uv, n + 1e-12, 4000);
      const double middle = integrated(resin, process, layer_um, blue, uv, n + 0.5, 4000);
      EXPECT_NEAR(dose.upper[i], upper, tolerance(upper)) << round << " slice " << n;
      EXPECT_NEAR(dose.middle[i], middle, tolerance(middle)) << round << " slice " << n;
    }
  }
}

TEST(InhibitedDose, CrossingIsWhereTheDoseIsOne) {
  const Resin resin = resin_1();
  const Process process = uv_process(1000, 200);
  const CureModel model = model_of(resin, process, 50);
  std::mt19937 random(5);
  int found = 0;
  for (int round = 0; round < 20; ++round) {
    std::vector<std::uint8_t> pixels(60);
    std::vector<double> blue, uv(60, 200.0);
    for (std::size_t n = 0; n < pixels.size(); ++n) {
      pixels[n] =
          n > 8 && n < 50 ? static_cast<std::uint8_t>(100 + random() % 156) : std::uint8_t{0};
      blue.push_back(level_intensities(uv_printer())[pixels[n]]);
    }
    BandDose dose(model, 1);
    InsideLayer inside;
    for (int n = 60; n-- > 0;) {
      dose.add_slice(n, &pixels[static_cast<std::size_t>(n)]);
      dose.inside(0, 1.0, inside);
      for (const double crossing : inside.crossings) {
        ++found;
        // Edges are sought to 0.002 um, where the dose rises by a few 1e-3 per um.
        const double at = integrated(resin, process, 50, blue, uv, n + 1 - crossing, 8000);
        EXPECT_NEAR(at, 1.0, 4e-5) << "round " << round << " slice " << n;
      }
    }
  }
  EXPECT_GT(found, 10);
}

/// Edges of the design and where the print has them, and the wrong voxels of a column.
struct Judged {
  double worst_um = 0;
  std::uint64_t wrong = 0, lost = 0;
  std::vector<std::uint8_t> levels;
};
Judged judge(const CureModel& model, const Process& process,
             const std::vector<std::uint8_t>& coverage) {
  const int layers = static_cast<int>(coverage.size());
  const CorrectionPlan plan = test::plan_for(model, process, layers);
  Judged j;
  j.levels = solve_column(plan, coverage);
  const PixelCurve curve = pixel_curve(model);
  BandPredictor predictor(model, curve, plan.all_layers, 1);
  for (int n = plan.all_layers; n-- > 0;) {
    const std::uint8_t none = 0;
    predictor.add_slice(n, &j.levels[static_cast<std::size_t>(n)],
                        n < layers ? &coverage[static_cast<std::size_t>(n)] : &none);
  }
  const Prediction p = predictor.finish(0, 0, 1);
  j.worst_um = p.height_error_um.count() ? p.height_error_um.greatest() : 0;
  j.wrong = p.cure_through_voxels + p.undercure_voxels;
  j.lost = p.lost_features;
  return j;
}

TEST(InhibitedCorrection, LadderPrintsAsDesigned) {
  for (const double layer_um : {50.0, 10.0}) {
    const int f = static_cast<int>(50 / layer_um);
    for (const double m : {0.7, 0.99, 1.0, 1.29}) {
      Resin resin = resin_1(m);
      if (m < 0.9) resin.critical_dose_prime = 25;
      if (m > 1.1) resin.critical_dose_prime = 200;
      const Process process = uv_process(1000, 200);
      const CureModel model = model_of(resin, process, layer_um);
      const Judged j =
          judge(model, process, test::column(50 * f, {{11 * f, 21 * f - 1}, {31 * f, 41 * f - 1}}));
      EXPECT_EQ(j.wrong, 0U) << layer_um << " " << m;
      // One level step of the last slice that acts on an edge: measured 0.94 um at m = 0.99.
      EXPECT_LT(j.worst_um, 4.0) << layer_um << " " << m;
      // Settled: in the middle of a feature light stays within a few levels, at any slice height.
      int low = 255, high = 0;
      for (int n = 15 * f; n < 17 * f; ++n) {
        low = std::min<int>(low, j.levels[static_cast<std::size_t>(n)]);
        high = std::max<int>(high, j.levels[static_cast<std::size_t>(n)]);
      }
      EXPECT_LE(high - low, 4) << layer_um << " " << m;
      EXPECT_GT(low, 0);
    }
  }
}

TEST(InhibitedCorrection, LightSettlesLayerByLayer) {
  for (const double exposure_s : {2.0, 3.0, 5.0, 8.0}) {
    Process process = uv_process(1000, 200);
    process.mode = ExposureMode::layerwise;
    process.exposure_s = exposure_s;
    const CureModel model = model_of(test::custom_resin_1(5), process, 50);
    const Judged j = judge(model, process, test::column(90, {{11, 40}, {60, 80}}));
    const auto [low, high] = std::minmax_element(j.levels.begin() + 20, j.levels.begin() + 32);
    EXPECT_LE(*high - *low, 4) << exposure_s;
    EXPECT_GT(*low, 0) << exposure_s;
  }
}

TEST(InhibitedCorrection, EachSliceForItsOwnNodeWouldChatter) {
  // Why the rule looks at several nodes: the rule of §2 at the slice's own node swings between the
  // limits of the light (physics.md §5).
  const Process process = uv_process(1000, 200);
  const CureModel model = model_of(resin_1(), process, 50);
  const InhibitedKernel& kernel = *model.inhibited();
  std::vector<int> levels(60, 0);
  const double* table = kernel.table(0, InhibitedKernel::upper_end);
  for (int k = 60; k-- > 0;) {
    double dose = 0;
    for (int j = 1; j < kernel.near() && k + j < 60; ++j) {
      dose += table[j * 256 + levels[static_cast<std::size_t>(k + j)]];
    }
    int level = 0;
    while (level < 255 && dose + table[level] < 1) ++level;
    levels[static_cast<std::size_t>(k)] = level;
  }
  int swings = 0;
  for (std::size_t n = 10; n < 40; ++n) swings += std::abs(levels[n] - levels[n - 1]) > 100;
  EXPECT_GT(swings, 5);
}

TEST(InhibitedCorrection, RandomColumns) {
  // Features and gaps of at least 200 um: twice the distance at which a slice acts most.
  std::mt19937 random(17);
  const Process process = uv_process(1000, 200);
  const CureModel model = model_of(resin_1(), process, 50);
  for (int round = 0; round < test::rounds(200); ++round) {
    std::vector<std::pair<int, int>> runs;
    int n = static_cast<int>(random() % 6);
    if (n > 0) n += 4;
    while (n < 90) {
      const int thick = 4 + static_cast<int>(random() % 20);
      runs.emplace_back(n, n + thick - 1);
      n += thick + 4 + static_cast<int>(random() % 12);
    }
    const Judged j = judge(model, process, test::column(n + 2, runs));
    EXPECT_EQ(j.wrong, 0U) << round;
    EXPECT_LT(j.worst_um, 6.0) << round;
  }
}

TEST(InhibitedCorrection, LayerByLayerHoldsThickFeatures) {
  // The dose ripples between nodes, and bursts outlast the tables: neither may leave a feature
  // below 1 in its middle.
  Resin resin = resin_1(0.7);
  resin.critical_dose_prime = 25;
  for (const double exposure_s : {0.2, 0.25, 0.3}) {
    Process process = uv_process(0, 200);
    process.mode = ExposureMode::layerwise;
    process.exposure_s = exposure_s;
    const CureModel model = model_of(resin, process, 50);
    const Judged j = judge(model, process, test::column(260, {{0, 9}, {40, 239}}));
    EXPECT_EQ(j.wrong, 0U) << exposure_s;
    EXPECT_EQ(j.lost, 0U) << exposure_s;
    // A tenth of a slice; levels are few where light is this strong.
    EXPECT_LT(j.worst_um, 5.0) << exposure_s;
  }
}

TEST(InhibitedCorrection, ThinFeaturesAndGapsLoseNothing) {
  const Process process = uv_process(1000, 200);
  const CureModel model = model_of(resin_1(), process, 50);
  for (int thick = 1; thick <= 4; ++thick) {
    for (int gap = 2; gap <= 5; ++gap) {
      std::vector<std::pair<int, int>> runs;
      for (int i = 0, n = 8; i < 4; ++i, n += thick + gap) runs.emplace_back(n, n + thick - 1);
      const Judged j = judge(model, process, test::column(runs.back().second + 8, runs));
      EXPECT_EQ(j.lost, 0U) << thick << " " << gap;
    }
  }
}

TEST(InhibitedCorrection, InfeasibleIsNamed) {
  Printer printer = uv_printer();
  const auto complaint = [&](const Resin& resin, const Process& process) -> std::string {
    try {
      const CureModel model = make_cure_model(printer, resin, process, 50);
      check_feasible(model, printer, process);
    } catch (const InfeasibleError& e) {
      return e.what();
    }
    return "";
  };
  EXPECT_EQ(complaint(resin_1(), uv_process(1000, 200)), "");
  EXPECT_THAT(complaint(resin_1(), uv_process(2000, 200)), HasSubstr("print slower than 1936"));
  EXPECT_THAT(complaint(resin_1(), uv_process(1000, 60)),
              HasSubstr("the resin would cure to the window"));
  EXPECT_THAT(complaint(resin_1(), uv_process(1000, 300)), HasSubstr("the lamp of printer"));
  Process dead_zone = uv_process(1000, 0);
  EXPECT_EQ(complaint(resin_1(), uv_process(1000, 200)), "");
  dead_zone.uv.kind = UvKind::patterned;
  dead_zone.uv.dead_zone_um = 40;
  printer.uv->patterned = true;
  EXPECT_THAT(complaint(resin_1(), dead_zone), HasSubstr("a dead zone of 40 um"));
  dead_zone.uv.dead_zone_um = 15;
  EXPECT_EQ(complaint(resin_1(), dead_zone), "");
}

TEST(InhibitedKernel, PatternedUvHoldsTheDeadZone) {
  Printer printer = uv_printer();
  printer.uv->patterned = true;
  Process process = uv_process(800, 0);
  process.uv.kind = UvKind::patterned;
  process.uv.dead_zone_um = 12;
  const CureModel model = make_cure_model(printer, resin_1(), process, 50);
  const Kinetics k = make_kinetics(resin_1(), true, true);
  for (int level = 1; level < 256; ++level) {
    const double zone = model.inhibited()->dead_zone_um(0, level);
    EXPECT_GE(zone, 12.0 - 1e-9) << level;
    // At most what one level of the lamp more gives: 275 / 255 mW/cm².
    const double uv = model.inhibited()->uv_mw_cm2(0, level);
    EXPECT_LE(zone, 12.0 + std::log(uv / (uv - 275.0 / 255)) / (1 / k.huv_um - 1 / k.hb_um) + 1e-9)
        << level;
  }
  EXPECT_EQ(model.inhibited()->uv_levels().size(), 256U);
}

}  // namespace
}  // namespace slicecorr
