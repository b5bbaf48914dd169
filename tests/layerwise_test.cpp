// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Layer by layer exposure: closed forms, schedules, the dose against a direct sum, and the solve.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "layerwise_models.hpp"
#include "rounds.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/predict.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr {
namespace {

using test::any_layerwise;
using test::AnyLayerwise;
using test::column;
using test::figure_a_7;
using test::layerwise;
using test::least_exposure_s;
using test::linear_printer;
using test::random_column;

using Bytes = std::vector<std::uint8_t>;

/// W(n) for intensities phi' at the normal exposure.
std::vector<double> far_edges(const CureModel& model, const std::vector<double>& phi) {
  std::vector<double> w(phi.size() + 1, 0.0);
  for (std::size_t n = phi.size(); n-- > 0;) {
    w[n] = (phi[n] * model.ratio(static_cast<int>(n)) + w[n + 1]) * model.a;
  }
  return w;
}

TEST(LayerwiseModel, CheckValuesOfTheDissertation) {
  EXPECT_NEAR(least_exposure_s(), 0.078369, 5e-7);
  const CureModel m = figure_a_7();
  EXPECT_NEAR(m.phi_max() * m.a, 1.0, 1e-12);
  EXPECT_NEAR(m.phi_min(), 0.028480, 5e-7);
  EXPECT_NEAR(m.cut_through_um(), 1.3416, 5e-5);
  EXPECT_NEAR(m.heterogeneity(), 2.848, 5e-4);
  // (A.53) says the same of the least exposure.
  EXPECT_NEAR(m.cut_through_um(), 110 * std::log10(1 + 0.01 * std::pow(10, 50.0 / 110)), 1e-9);
  EXPECT_NEAR(m.critical_intensity_mw_cm2 * m.phi_max(), 100, 1e-9);
  EXPECT_FALSE(m.is_plain());
  EXPECT_EQ(m.slices_to_gel(), 0);
  EXPECT_EQ(slices_with_burst(m, 50, 49), 50);
}

TEST(LayerwiseModel, FurtherTeethGelFromTheirLimitOn) {
  CureModel m = figure_a_7();
  const double limit = (1 - m.a) / (1 + m.a);
  for (const double share : {0.999, 1.001}) {
    m.level_phi.front() = limit * share;
    EXPECT_EQ(m.gels_further_teeth(), share > 1);
    // The dose at the window of the second layer above a far edge of 1.
    EXPECT_EQ((1 + m.phi_min()) * m.a + m.phi_min() >= 1, share > 1);
  }
  m.level_phi.front() = limit / 2 * 1.001;
  EXPECT_FALSE(m.gels_further_teeth());
  EXPECT_TRUE(m.gels_further_teeth(2));
}

TEST(LayerwiseModel, ArealVolumetricAndKineticDosesAgree) {
  Resin areal = test::resin(576, 110);
  areal.model = CureModelKind::kinetic;
  areal.critical_dose_prime = 576 * 110e-4 / units::kLn10;
  const CureModel volumetric = figure_a_7(2),
                  kinetic = make_cure_model(linear_printer(1, 100), areal, layerwise(2), 50);
  EXPECT_NEAR(kinetic.phi_max(), volumetric.phi_max(), 1e-12 * volumetric.phi_max());
  EXPECT_EQ(kinetic.a, volumetric.a);
  // phi' = I^m te / D'c.
  areal.m = 0.7;
  areal.critical_dose_prime = 20;
  const CureModel slow = make_cure_model(linear_printer(1, 100), areal, layerwise(2), 50);
  EXPECT_NEAR(slow.phi_max(), std::pow(100, 0.7) * 2 / 20, 1e-12);
  EXPECT_NEAR(slow.a, std::pow(10, -0.7 * 50 / 110), 1e-15);
}

TEST(LayerwiseModel, ExposureFollowsBottomAndFadeLayers) {
  Process p = layerwise(2);
  p.bottom_exposure_s = 14;
  p.bottom_layers = 2;
  p.fade_layers = 3;
  // Twelve seconds in four equal steps: faded layers have neither end.
  const std::vector<double> expected{14, 14, 11, 8, 5, 2, 2, 2};
  for (int n = 0; n < 8; ++n) {
    EXPECT_DOUBLE_EQ(layer_exposure_s(p, n), expected[static_cast<std::size_t>(n)]) << n;
  }
  const CureModel m = make_cure_model(linear_printer(1, 100), test::resin(576, 110), p, 50);
  for (int n = 0; n < 9; ++n) EXPECT_DOUBLE_EQ(m.ratio(n), layer_exposure_s(p, n) / 2) << n;
  EXPECT_DOUBLE_EQ(m.greatest_ratio(), 7);
  EXPECT_THROW(figure_a_7(0), InputError);
  p.layer_exposure_s = {3, 1, 2};
  EXPECT_EQ(layer_exposure_s(p, 0), 3);
  EXPECT_EQ(layer_exposure_s(p, 1), 1);
  EXPECT_EQ(layer_exposure_s(p, 700), 2);
  EXPECT_DOUBLE_EQ(light_on_s(p, 1, 50, 5), 3 + 1 + 2 + 2 + 2);
}

TEST(LayerwiseModel, ExposuresInWords) {
  Process p = layerwise(8);
  EXPECT_EQ(exposures_in_words(p), "8 s each");
  p.bottom_exposure_s = 20;
  p.bottom_layers = 1;
  EXPECT_EQ(exposures_in_words(p), "8 s each; the first layer 20 s");
  p.bottom_layers = 4;
  p.fade_layers = 3;
  EXPECT_EQ(exposures_in_words(p), "8 s each; the first 4 layers 20 s, then 3 in steps between");
  p.bottom_layers = 0;
  EXPECT_EQ(exposures_in_words(p), "8 s each; the first 3 in steps from 17 s on");
  p.layer_exposure_s = {3, 1, 8};
  EXPECT_EQ(exposures_in_words(p), "1 to 8 s each, 8 s as a rule");
}

/// The message of an infeasible process.
std::string refusal(const Process& p, double black = 1, double dc = 576) {
  const Printer printer = linear_printer(black, 100);
  const CureModel m = make_cure_model(printer, test::resin(dc, 110), p, 50);
  try {
    check_feasible(m, printer, p);
  } catch (const InfeasibleError& e) {
    return e.what();
  }
  return "";
}

TEST(LayerwiseFeasible, FromTheLeastExposureOn) {
  EXPECT_EQ(refusal(layerwise(least_exposure_s())), "");
  const std::string weak = refusal(layerwise(0.05));
  EXPECT_NE(weak.find("at least 0.07837 s"), std::string::npos) << weak;
  EXPECT_NE(weak.find("at least 156.74 mW/cm²"), std::string::npos) << weak;
  // The suggestions work as they are written.
  EXPECT_EQ(refusal(layerwise(0.078370)), "");
}

TEST(LayerwiseFeasible, BlackGelsFromItsLimitOn) {
  // phi'_min = 1 - a: te = (1 - a) D'c / Imin.
  const double a = std::pow(10, -50.0 / 110);
  const double limit = (1 - a) * 576 * 110e-4 / std::log(10.0);
  EXPECT_EQ(refusal(layerwise(limit * 0.9999)), "");
  const std::string black = refusal(layerwise(limit * 2));
  EXPECT_NE(black.find("black"), std::string::npos) << black;
  EXPECT_NE(black.find("less than 1.7855 s"), std::string::npos) << black;
  EXPECT_NE(black.find("below 0.49999 mW/cm²"), std::string::npos) << black;
}

TEST(LayerwiseFeasible, NamesTheLayerThatFails) {
  Process p = layerwise(0.2);
  p.layer_exposure_s = {0.2, 0.2, 0.06, 0.2};
  const std::string weak = refusal(p);
  EXPECT_NE(weak.find("layer 2, exposed for 0.06 s,"), std::string::npos) << weak;
  EXPECT_NE(weak.find("at least 0.07837 s"), std::string::npos) << weak;
  p = layerwise(0.2);
  p.bottom_exposure_s = 2;
  p.bottom_layers = 3;
  const std::string black = refusal(p);
  // Three such layers add up beside the window of the last, two do not.
  EXPECT_NE(black.find("layer 0, exposed for 2 s,"), std::string::npos) << black;
  p.bottom_layers = 2;
  EXPECT_EQ(refusal(p), "");
}

/// The number after "less than" in a message.
double advised_s(const std::string& text) {
  const auto at = text.find("less than ");
  return at == std::string::npos ? -1 : std::stod(text.substr(at + 10));
}

TEST(LayerwiseFeasible, AdviceAgainstBlackGellingHelps) {
  // Advice has five digits and holds as it is written; a little above it fails.
  const double below = 1, above = 1 + 1e-4;
  struct Case {
    int bottom, fade;
    double bottom_s;
  };
  for (const Case& c : {Case{3, 0, 2}, Case{10, 0, 40}, Case{3, 4, 30}, Case{1, 9, 30}}) {
    SCOPED_TRACE(c.bottom_s);
    Process p = layerwise(0.2);
    p.bottom_layers = c.bottom;
    p.fade_layers = c.fade;
    p.bottom_exposure_s = c.bottom_s;
    const std::string text = refusal(p);
    EXPECT_NE(text.find("expose the first layers for less than"), std::string::npos) << text;
    const double most_s = advised_s(text);
    ASSERT_GT(most_s, 0.2) << text;
    p.bottom_exposure_s = most_s * below;
    EXPECT_EQ(refusal(p), "");
    p.bottom_exposure_s = most_s * above;
    EXPECT_NE(refusal(p), "");
  }
  // Too long as a rule: shorter first layers alone don't help.
  Process p = layerwise(10);
  p.bottom_layers = 3;
  p.bottom_exposure_s = 30;
  const std::string rule = refusal(p);
  EXPECT_NE(rule.find("expose all layers for less than 1.7855 s"), std::string::npos) << rule;
  p.exposure_s = p.bottom_exposure_s = 1.7855 * below;
  EXPECT_EQ(refusal(p), "");
  // A list of exposures.
  p = layerwise(0.2);
  p.layer_exposure_s = {0.5, 3, 0.2, 4, 4, 0.1, 0.2};
  const std::string listed = refusal(p);
  EXPECT_NE(listed.find("expose each layer for less than"), std::string::npos) << listed;
  const double most_s = advised_s(listed);
  ASSERT_GT(most_s, 0.2) << listed;
  const std::vector<double> asked = p.layer_exposure_s;
  for (const double factor : {below, above}) {
    for (std::size_t n = 0; n < asked.size(); ++n) {
      p.layer_exposure_s[n] = std::min(asked[n], most_s * factor);
    }
    EXPECT_EQ(refusal(p).empty(), factor == below) << most_s;
  }
  // Darker black helps, too: by as much as it says.
  const auto at = listed.find("with black below ");
  ASSERT_NE(at, std::string::npos) << listed;
  p.layer_exposure_s = asked;
  const double black = std::stod(listed.substr(at + 17));
  EXPECT_EQ(refusal(p, black * below), "");
  EXPECT_NE(refusal(p, black * above), "");
}

TEST(LayerwiseDose, EqualsTheDirectSum) {
  // Every slice with its own exposure and Beer's law: no recursion. All terms are positive, so each
  // step of the recursion adds a few relative roundings: 60 of them, 1e-13 is four times that.
  std::mt19937 random(1);
  for (int trial = 0; trial < test::rounds(200); ++trial) {
    const AnyLayerwise any = any_layerwise(random, 1 + trial % 8);
    const CureModel m = any.model();
    const int layers = 60;
    Bytes pixels;
    for (int n = 0; n < layers; ++n) {
      const int level = static_cast<int>(random() % static_cast<unsigned>(any.printer.levels()));
      pixels.push_back(static_cast<std::uint8_t>(pixel_of_level(level, any.printer.levels())));
    }
    const std::vector<double> intensity = level_intensities(any.printer);
    const double he_um = any.resin.absorbance_height10_um / units::kLn10;
    const double prime = any.resin.critical_dose_prime > 0
                             ? any.resin.critical_dose_prime
                             : any.resin.critical_dose_mj_cm3 * he_um * 1e-4;
    const auto direct = [&](double zeta, int first) {
      double sum = 0;
      for (int n = first; n < layers; ++n) {
        const int level = level_of_pixel(pixels[static_cast<std::size_t>(n)], any.printer.levels());
        const double at = intensity[static_cast<std::size_t>(level)] *
                          std::exp(-(n + 1 - zeta) * any.layer_um / he_um);
        sum += std::pow(at, any.resin.m) * layer_exposure_s(any.process, n) / prime;
      }
      return sum;
    };
    const ColumnDose dose = column_dose(m, pixels);
    for (int n = 0; n < layers; ++n) {
      const auto k = static_cast<std::size_t>(n);
      EXPECT_NEAR(dose.lower[k], direct(n + 1, n), 1e-12 * dose.lower[k]);
      EXPECT_NEAR(dose.middle[k], direct(n + 0.5, n), 1e-12 * dose.middle[k]);
      EXPECT_NEAR(dose.upper[k], direct(n, n), 1e-12 * dose.upper[k]);
    }
    // The crossing is where the direct sum is 1.
    BandDose band(m, 1);
    InsideLayer inside;
    for (int n = layers; n-- > 0;) {
      band.add_slice(n, &pixels[static_cast<std::size_t>(n)]);
      band.inside(0, 0.0, inside);
      EXPECT_EQ(inside.least, *band.upper());
      EXPECT_EQ(inside.crossings.size(), *band.lower() >= 1 && *band.upper() < 1 ? 1U : 0U);
      for (const double d : inside.crossings) EXPECT_NEAR(direct(n + 1 - d, n), 1.0, 1e-12);
    }
  }
}

TEST(LayerwiseSolve, CheckValuesOfTheDissertation) {
  const CureModel m = figure_a_7();
  const CorrectionPlan plan = test::plan_for(m, layerwise(least_exposure_s()), 50);
  EXPECT_EQ(plan.all_layers, 50);
  const auto phi = solve_column_exactly(plan, column(50, {{11, 20}, {40, 49}}));
  EXPECT_NEAR(phi[49], 2.8480, 5e-5);
  for (std::size_t n = 40; n < 49; ++n) EXPECT_NEAR(phi[n], 1.8480, 5e-5) << n;
  for (std::size_t n = 21; n < 40; ++n) EXPECT_EQ(phi[n], m.phi_min()) << n;
  for (std::size_t n = 11; n < 20; ++n) EXPECT_NEAR(phi[n], (1 - m.a) / m.a, 1e-12) << n;
  const auto w = far_edges(m, phi);
  for (std::size_t n = 11; n < 21; ++n) EXPECT_NEAR(w[n], 1, 1e-12) << n;
  // In the dark W falls towards that of black light.
  EXPECT_NEAR(phi[20], 1 / m.a - w[21], 1e-12);
}

TEST(LayerwiseSolve, IdealIsTheLeastDoseThatGelsEveryLayerThrough) {
  // Whatever other intensities gel all full layers up to their far edges, they leave no less dose
  // anywhere: so the cure-through above each feature is the least possible.
  std::mt19937 random(2);
  for (int trial = 0; trial < test::rounds(300); ++trial) {
    const AnyLayerwise any = any_layerwise(random, 8);
    const CureModel m = any.model();
    const Bytes coverage = random_column(random, 30, false);
    const CorrectionPlan plan = test::plan_for(m, any.process, 30);
    const auto ideal = solve_column_exactly(plan, coverage);
    const auto least = far_edges(m, ideal);
    for (int other = 0; other < 20; ++other) {
      std::vector<double> phi(30);
      double w = 0;
      for (std::size_t n = 30; n-- > 0;) {
        const double ratio = m.ratio(static_cast<int>(n));
        const double need = coverage[n] ? (1 / m.a - w) / ratio : m.phi_min();
        const double low = std::clamp(need, m.phi_min(), m.phi_max());
        phi[n] =
            std::uniform_real_distribution(0.0, 1.0)(random) < 0.5
                ? low
                : std::uniform_real_distribution(low, std::nextafter(m.phi_max(), 1e9))(random);
        w = (phi[n] * ratio + w) * m.a;
        ASSERT_GE(w, least[n] - 1e-12);
      }
    }
    // Thin gaps and features, too: each full layer has its far edge at 1, or above it only in
    // black.
    for (std::size_t n = 0; n < 30; ++n) {
      if (!coverage[n]) {
        EXPECT_EQ(ideal[n], m.phi_min());
      } else if (ideal[n] > m.phi_min()) {
        EXPECT_NEAR(least[n], 1, 1e-12);
      } else {
        EXPECT_GE(least[n], 1 - 1e-12);
      }
    }
  }
}

TEST(LayerwiseSolve, LevelsAreTheLowestThatGelAndTheNearestGrey) {
  std::mt19937 random(3);
  for (int bits = 1; bits <= 8; ++bits) {
    for (int trial = 0; trial < 100; ++trial) {
      const AnyLayerwise any = any_layerwise(random, bits);
      const CureModel m = any.model();
      const Bytes coverage = random_column(random, 40, true);
      const CorrectionPlan plan = test::plan_for(m, any.process, 40);
      const Bytes levels = solve_column(plan, coverage);
      double w = 0;
      for (std::size_t n = 40; n-- > 0;) {
        const double ratio = m.ratio(static_cast<int>(n));
        const auto near = [&](int level) { return plan.levels.phi(level) * ratio + w; };
        const int level = levels[n];
        if (coverage[n] == 255) {
          ASSERT_GE(near(level) * m.a, 1.0);
          if (level) {
            ASSERT_LT(near(level - 1) * m.a, 1 + 2e-9);
          }
        } else if (coverage[n] == 0) {
          ASSERT_EQ(level, 0);
        } else {
          const auto off = [&](int l) {
            return std::abs(near(l) * m.root_a - coverage[n] / 255.0);
          };
          if (level) {
            ASSERT_LT(near(level) * m.root_a, 1.0);
          }
          for (const int l : {level - 1, level + 1}) {
            if (l < 0 || l >= plan.levels.size() || near(l) * m.root_a >= 1) continue;
            ASSERT_LE(off(level), off(l) + 1e-12) << bits;
          }
        }
        w = near(level) * m.a;
      }
    }
  }
}

TEST(LayerwiseSolve, BandsEqualColumns) {
  std::mt19937 random(4);
  for (const std::size_t columns : {1U, 31U, 32U, 100U}) {
    for (const bool merge : {false, true}) {
      AnyLayerwise any = any_layerwise(random, 8);
      if (merge) any.process.one_slice_gaps = OneSliceGaps::merge;
      const CorrectionPlan plan = test::plan_for(any.model(), any.process, 50);
      std::vector<Bytes> design;
      for (std::size_t i = 0; i < columns; ++i) {
        design.push_back(i % 3 ? random_column(random, 50, true) : column(50, {{5, 20}}));
      }
      BandCorrector band(plan, columns);
      for (std::size_t n = 0; n < 50; ++n) {
        Bytes row;
        for (const Bytes& c : design) row.push_back(c[n]);
        band.add_layer(row.data());
      }
      std::vector<Bytes> found(columns, Bytes(50));
      int next = 49;
      band.solve([&](int n, const std::uint8_t* levels, const std::uint8_t* coverage, bool dark) {
        ASSERT_EQ(n, next--);
        for (std::size_t i = 0; i < columns; ++i) {
          ASSERT_EQ(coverage[i], design[i][static_cast<std::size_t>(n)]);
          found[i][static_cast<std::size_t>(n)] = levels[i];
          if (dark) {
            ASSERT_EQ(levels[i] + coverage[i], 0);
          }
        }
      });
      EXPECT_EQ(next, -1);
      for (std::size_t i = 0; i < columns; ++i)
        ASSERT_EQ(found[i], solve_column(plan, design[i])) << i;
    }
  }
}

TEST(LayerwiseSolve, OneSliceGapsStayOpenOrAreMerged) {
  const Bytes design = column(20, {{4, 8}, {10, 14}});
  Process p = layerwise(0.16);
  const CureModel m = figure_a_7(0.16);
  const auto open = solve_column_exactly(test::plan_for(m, p, 20), design);
  EXPECT_EQ(open[9], m.phi_min());
  // Both edges beside the gap are right: nothing of the feature above is given up.
  const auto w = far_edges(m, open);
  EXPECT_NEAR(w[8], 1, 1e-12);
  EXPECT_NEAR(w[10], 1, 1e-12);
  EXPECT_LT(w[9], 1);
  p.one_slice_gaps = OneSliceGaps::merge;
  EXPECT_NEAR(far_edges(m, solve_column_exactly(test::plan_for(m, p, 20), design))[9], 1, 1e-12);
}

TEST(Ramps, LampFollowsConstantAcceleration) {
  Process p = test::process(1000);
  const double slice_s = 50 * 3.6 / 1000;
  p.ramp_mm = 1;
  for (const Ramp ramp : {Ramp::none, Ramp::outside}) {
    p.ramp = ramp;
    EXPECT_DOUBLE_EQ(slice_light(p, 1, 50, 0, 100).time_s, slice_s);
    EXPECT_EQ(slice_light(p, 1, 50, 0, 100).share, 1);
  }
  p.ramp = Ramp::lamp_follows;
  // Slice n of 100 has its middle at (n + 1/2) 50 um; twenty slices are a ramp.
  for (int n = 0; n < 100; ++n) {
    const double z = (std::min(n, 99 - n) + 0.5) * 0.05;
    const double speed = std::min(1.0, std::sqrt(z));
    const SliceLight light = slice_light(p, 1, 50, n, 100);
    EXPECT_NEAR(light.time_s, slice_s / speed, 1e-12) << n;
    // Light times time stays: so do all doses. With m the intensity to its power.
    EXPECT_NEAR(light.share * light.time_s, slice_s, 1e-12) << n;
    const SliceLight kinetic = slice_light(p, 0.7, 50, n, 100);
    EXPECT_NEAR(std::pow(kinetic.share, 0.7) * kinetic.time_s, slice_s, 1e-12) << n;
  }
  EXPECT_GT(light_on_s(p, 1, 50, 100), 100 * slice_s);
}

TEST(SliceSpeeds, LightTimesTimeStays) {
  Process p = test::process(1000);
  const double slice_s = 50 * 3.6 / 1000;
  p.slice_speed_mm_h = {1000, 250, 500};
  EXPECT_EQ(slice_speed_mm_h(p, 0), 1000);
  EXPECT_EQ(slice_speed_mm_h(p, 7), 500);
  EXPECT_EQ(speeds_in_words(p), "250 to 1000 mm/h from slice to slice");
  EXPECT_EQ(speeds_in_words(test::process(800)), "800 mm/h");
  for (const double m : {1.0, 0.7}) {
    for (int n = 0; n < 10; ++n) {
      const SliceLight light = slice_light(p, m, 50, n, 10);
      EXPECT_NEAR(light.time_s, 50 * 3.6 / slice_speed_mm_h(p, n), 1e-12) << n;
      EXPECT_NEAR(std::pow(light.share, m) * light.time_s, slice_s, 1e-12) << n;
    }
  }
  EXPECT_NEAR(light_on_s(p, 1, 50, 10), slice_s * (1 + 4 + 8 * 2), 1e-12);
  // On a ramp the slower of the two counts: its first slice passes at sqrt(1/40) of the speed.
  p.ramp = Ramp::lamp_follows;
  p.ramp_mm = 1;
  EXPECT_NEAR(slice_light(p, 1, 50, 0, 100).share, std::sqrt(0.025), 1e-12);
  EXPECT_NEAR(slice_light(p, 1, 50, 1, 100).share, 0.25, 1e-12);
}

}  // namespace
}  // namespace slicecorr
