// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Under UV light in layers of different heights, and below a platform that sends light back: doses, what happens
// inside layers, and corrections, against a rate that is summed in small steps and shares no code with the library.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "correct/inhibited_plan.hpp"
#include "layer_places.hpp"
#include "refusal.hpp"
#include "rounds.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/inhibited.hpp"
#include "slicecorr/predict.hpp"
#include "uv_models.hpp"

// A namespace of its own: tests that are compiled together have names like these, too.
namespace slicecorr::own_layers {
namespace {

using namespace test::uv;
using testing::HasSubstr;

constexpr double kUsualUm = 50;
// Of `resin_1`, and its lights.
constexpr double kHbUm = 408, kHuvUm = 37.8, kBeta = 0.73, kCriticalDose = 64;

/// A print, and all that its doses follow from.
struct Lit {
  Printer printer = uv_printer();
  Resin resin = resin_1();
  Process process = uv_process(800, 200);

  bool layerwise() const { return process.mode == ExposureMode::layerwise; }
  double height_um(int n) const { return test::height_um(process, n, kUsualUm); }
  double node_um(int n) const { return test::node_um(process, n, kUsualUm); }
  double uv_mw_cm2(std::size_t n) const {
    const auto& of = process.uv.slice_mw_cm2;
    return of.empty() ? process.uv.uv_mw_cm2 : of[std::min(n, of.size() - 1)];
  }
  CureModel model() const { return make_cure_model(printer, resin, process, kUsualUm); }

  double rate(double blue, double uv, double z_um, double d_um) const {
    const double back = 1 + printer.platform_reflectance * std::exp(-2 * z_um / kHbUm);
    const double net =
        blue * back * std::exp(-d_um / kHbUm) - kBeta * uv * std::exp(-d_um / kHuvUm);
    return net > 0 ? std::pow(net, resin.inhibition->m) : 0.0;
  }
  /// Dose at a place from the rate, by midpoints of `steps` steps of each slice.
  double dose(double z_um, const std::vector<std::uint8_t>& pixels, int steps) const {
    double sum = 0, from_um = 0;
    for (std::size_t n = 0; n < pixels.size(); ++n) {
      const double to_um = from_um + height_um(static_cast<int>(n));
      const double blue = 1 + 99.0 * pixels[n] / 255, uv = uv_mw_cm2(n);
      if (layerwise()) {
        if (to_um >= z_um) sum += rate(blue, uv, z_um, to_um - z_um) * process.exposure_s;
      } else if (to_um > z_um) {
        const double begin = std::max(from_um, z_um), step = (to_um - begin) / steps;
        const double s_per_um = 3.6 / process.speed_mm_h;
        for (int i = 0; i < steps; ++i) {
          sum += rate(blue, uv, z_um, begin + (i + 0.5) * step - z_um) * step * s_per_um;
        }
      }
      from_um = to_um;
    }
    return sum / kCriticalDose;
  }
};

enum Kind { heights, platform, both };

Lit random_lit(std::mt19937& random, Kind kind, bool layerwise) {
  Lit lit;
  if (kind != platform) {
    for (int n = 0; n < 60;) {
      const double um = std::vector<double>{20, 35, 50, 60, 80}[random() % 5];
      for (const int end = n + 1 + static_cast<int>(random() % 12); n < end; ++n) {
        lit.process.layer_heights_um.push_back(um);
      }
    }
  }
  if (kind != heights) {
    lit.printer.platform_reflectance = 0.1 + 0.05 * static_cast<double>(random() % 13);
  }
  if (layerwise) {
    lit.process.mode = ExposureMode::layerwise;
    lit.process.speed_mm_h = 0;
    lit.process.exposure_s = 0.4;
  }
  if (random() % 2) {
    lit.process.uv.kind = UvKind::per_slice;
    for (int n = 0; n < 60; ++n) {
      lit.process.uv.slice_mw_cm2.push_back(120 + 40 * static_cast<double>(random() % 3));
    }
  }
  return lit;
}

std::vector<std::uint8_t> random_pixels(std::mt19937& random, int slices) {
  std::vector<std::uint8_t> pixels;
  std::uint8_t level = 0;
  for (int n = 0; n < slices; ++n) {
    if (random() % 3 == 0) level = static_cast<std::uint8_t>(random() % 256);
    pixels.push_back(level);
  }
  return pixels;
}

class UvSurroundings : public testing::TestWithParam<Kind> {};

TEST_P(UvSurroundings, DosesAreThoseOfTheRateItself) {
  std::mt19937 random(5);
  for (int round = 0; round < test::rounds(2); ++round) {
    const Lit lit = random_lit(random, GetParam(), round % 2 == 1);
    const CureModel model = lit.model();
    ASSERT_FALSE(model.inhibited()->alike());
    const auto pixels = random_pixels(random, 60);
    const ColumnDose dose = column_dose(model, pixels);
    for (int n = round % 3; n < 60; n += n < 8 ? 1 : 7) {
      const auto i = static_cast<std::size_t>(n);
      const double at = lit.node_um(n), um = lit.height_um(n);
      // Layer by layer the slice before a node does not count in the layer below it.
      constexpr int steps = 300;
      const double upper = lit.dose(at + 1e-6, pixels, steps),
                   middle = lit.dose(at + um / 2, pixels, steps),
                   lower = lit.dose(at + um, pixels, steps);
      // Midpoints of steps of 80 um / 300 are off by (step / huv)^2 / 24, 2e-6 of a dose, and by a step's share of
      // the rate where it begins.
      const auto tolerance = [](double d) { return 4e-5 * d + 4e-6; };
      EXPECT_NEAR(dose.upper[i], upper, tolerance(upper)) << round << " " << n;
      EXPECT_NEAR(dose.middle[i], middle, tolerance(middle)) << round << " " << n;
      if (!lit.layerwise()) {
        EXPECT_NEAR(dose.lower[i], lower, tolerance(lower)) << round << " " << n;
      }
    }
  }
}

TEST_P(UvSurroundings, WhatHappensInsideLayersIsThatOfTheRateItself) {
  std::mt19937 random(6);
  int crossings = 0;
  for (int round = 0; round < test::rounds(2); ++round) {
    const Lit lit = random_lit(random, GetParam(), round % 2 == 1);
    const CureModel model = lit.model();
    const auto pixels = random_pixels(random, 60);
    BandDose band(model, 1);
    for (int n = 60; n-- > 0;) {
      band.add_slice(n, &pixels[static_cast<std::size_t>(n)]);
      if (n > 8 && n % 9) continue;
      InsideLayer inside;
      band.inside(0, 1e9, inside);
      for (const double t : inside.crossings) {
        ++crossings;
        const double z = lit.node_um(n) + (1 - t) * lit.height_um(n);
        // Found to 0.002 um (or 1e-3 of a layer), over which doses change by their fall at most, and at a front by
        // the light that begins there.
        EXPECT_NEAR(lit.dose(z, pixels, 100), 1, 2e-3) << round << " " << n << " " << t;
      }
      double least = 1e9;
      for (int s = 0; s <= 16; ++s) {
        const double z = lit.node_um(n) + (s + (s == 0 ? 1e-6 : 0)) / 16.0 * lit.height_um(n);
        least = std::min(least, lit.dose(z, pixels, 30));
      }
      EXPECT_LT(inside.least, least * (1 + 1e-3)) << round << " " << n;
    }
  }
  EXPECT_GT(crossings, 0);
}

/// How many layers of a column don't print as designed.
int wrong_layers(const Lit& lit, const std::vector<std::uint8_t>& column,
                 const std::vector<std::uint8_t>& levels) {
  int wrong = 0;
  for (std::size_t n = 0; n < column.size(); ++n) {
    const int k = static_cast<int>(n);
    const double dose = lit.dose(lit.node_um(k) + 0.5 * lit.height_um(k), levels, 24);
    if (std::abs(dose - 1) > 1e-3) wrong += (dose >= 1) != (column[n] != 0);
  }
  return wrong;
}

std::vector<std::uint8_t> levels_for(const Lit& lit, const std::vector<std::uint8_t>& column) {
  const CureModel model = lit.model();
  const auto layers = static_cast<int>(column.size());
  return solve_column(test::plan_for(model, lit.process, layers), column);
}

TEST_P(UvSurroundings, CorrectedColumnsPrint) {
  std::mt19937 random(7);
  int wrong = 0, without = 0, layers = 0;
  for (int round = 0; round < test::rounds(2); ++round) {
    Lit lit = random_lit(random, GetParam(), round % 2 == 1);
    lit.process.uv = uv_process(800, 200).uv;
    lit.process.speed_mm_h = round % 2 ? 0 : 450;
    // Few heights, so that tables are few.
    if (!lit.process.layer_heights_um.empty()) {
      lit.process.layer_heights_um.assign(8, kUsualUm);
      lit.process.layer_heights_um.push_back(30);
    }
    std::vector<std::uint8_t> column(26, 0);
    for (std::size_t n = random() % 2 ? 0 : 4; n + 8 < column.size();) {
      const std::size_t thick = 7 + random() % 8;
      std::fill_n(column.begin() + static_cast<std::ptrdiff_t>(n),
                  std::min(thick, column.size() - n), 255);
      n += thick + 6 + random() % 6;
    }
    layers += 26;
    wrong += wrong_layers(lit, column, levels_for(lit, column));
    // Corrected as if layers were alike.
    Lit alike = lit;
    alike.process.layer_heights_um.clear();
    alike.printer.platform_reflectance = 0;
    without += wrong_layers(lit, column, levels_for(alike, column));
  }
  RecordProperty("wrong", wrong);
  RecordProperty("without", without);
  RecordProperty("layers", layers);
  EXPECT_LE(wrong, 1 + layers / 100);
  // What comes back moves edges by some micrometres, and voxels only where they are near.
  EXPECT_LE(wrong, without);
  if (GetParam() != platform) {
    EXPECT_GT(without, 0);
  }
}

TEST_P(UvSurroundings, FarLightOfManySlicesIsThatOfEach) {
  std::mt19937 random(11);
  for (int round = 0; round < 2; ++round) {
    Lit lit = random_lit(random, GetParam(), round % 2 == 1);
    if (GetParam() != platform) lit.process.layer_heights_um.assign({20, 20, 20, 50, 50, 80, 35});
    constexpr int slices = 90;
    const detail::InhibitedPlan plan(lit.model(), false, slices, slices);
    const InhibitedKernel& kernel = *plan.kernel;
    const auto each = [&](const detail::FarLight::Slices& of, const auto& level) {
      double sum = 0;
      for (int n = of.first; n < of.end; ++n) {
        const double um = kernel.place_um(n - plan.near + 1) - kernel.place_um(of.k);
        sum += plan.ratio_of(n) * plan.node_light.last(kernel.setting_of_slice(n), level(n)) *
               std::exp(-kernel.kinetics().m * um / kernel.kinetics().hb_um) *
               kernel.returned(kernel.place_um(of.k));
      }
      return sum;
    };
    for (int look = 0; look < 200; ++look) {
      const int k = static_cast<int>(random() % (slices - plan.near - 1));
      detail::FarLight::Slices of{k, k + plan.near, slices};
      of.first += static_cast<int>(random() % static_cast<unsigned>(slices - of.first + 1));
      of.end -= static_cast<int>(random() % static_cast<unsigned>(slices - of.first + 1));
      const int level = static_cast<int>(random() % 256);
      const auto full = [&](int n) { return plan.cap_of(n); };
      const auto steady = [&](int n) { return std::min(plan.steady_of(n), plan.cap_of(n)); };
      // Sums and differences of some hundred numbers below 10, each rounded to 1e-16.
      constexpr double rounded = 1e-12;
      EXPECT_NEAR(plan.far_light.of_level(level, of), each(of, [&](int) { return level; }),
                  rounded);
      EXPECT_NEAR(plan.far_light.of_caps(of), each(of, full), rounded);
      EXPECT_NEAR(plan.far_light.of_steady(of), each(of, steady), rounded);
      if (of.first < slices) {
        const int j = of.first - k;
        EXPECT_NEAR(plan.ratio_of(of.first) * plan.light_of(of.first, level, j),
                    each({k, of.first, of.first + 1}, [&](int) { return level; }), rounded);
      }
    }
  }
}

TEST(UvOwnLayers, SlicesAfterTheEndAreAsManyAsTheThinnestLayersTake) {
  Lit lit;
  constexpr int layers = 60;
  const int alike = slices_with_burst(lit.model(), layers, layers - 1) - layers;
  ASSERT_GT(alike, 3);
  for (int n = 0; n < layers; ++n) lit.process.layer_heights_um.push_back(n % 2 ? 25 : 40);
  const int own = slices_with_burst(lit.model(), layers, layers - 1) - layers;
  EXPECT_GE(own, alike);
  // Twice as many of half the height, each of two lengths rounded up.
  EXPECT_LE(own, 2 * alike + 2);
}

TEST(UvOwnLayers, FarLightOfHighPrintsNeitherEndsNorOverflows) {
  Lit lit;
  // 800 slices of 2 mm: e^-3900 from one end to the other is 0.
  lit.process.layer_heights_um = {50, 50, 2000};
  const CureModel model = lit.model();
  const InhibitedKernel& kernel = *model.inhibited();
  const detail::NodePowers powers(kernel, 800);
  for (const int from : {2, 3, 40, 799, 800}) {
    for (const int to : {from, from - 1, std::max(0, from - 9)}) {
      const double um = kernel.place_um(from) - kernel.place_um(to);
      const double left = std::exp(-kernel.kinetics().m * um / kernel.kinetics().hb_um);
      // Exponents of up to 5,700 are right to 1e-12 of a half.
      EXPECT_NEAR(powers.fade(from, to), left, 2e-12 * left) << from << " " << to;
    }
  }
  EXPECT_EQ(powers.fade(800, 0), 0.0);
}

std::string name_of_kind(const testing::TestParamInfo<Kind>& kind) {
  return kind.param == heights ? "Heights" : kind.param == platform ? "Platform" : "Both";
}

INSTANTIATE_TEST_SUITE_P(Kinds, UvSurroundings, testing::Values(heights, platform, both),
                         name_of_kind);

TEST(UvOwnLayers, ASliceInPartsOfTheSameLightIsTheSame) {
  // In continuous exposure: 40 slices of 50 um, of which some are cut in two or five.
  std::mt19937 random(8);
  const auto pixels = random_pixels(random, 40);
  Lit whole, cut;
  std::vector<std::uint8_t> of_cut;
  std::vector<std::size_t> node;
  for (std::size_t n = 0; n < pixels.size(); ++n) {
    const int parts = std::vector{1, 2, 5}[random() % 3];
    node.push_back(of_cut.size());
    for (int p = 0; p < parts; ++p) {
      cut.process.layer_heights_um.push_back(kUsualUm / parts);
      of_cut.push_back(pixels[n]);
    }
  }
  const ColumnDose a = column_dose(whole.model(), pixels), b = column_dose(cut.model(), of_cut);
  for (std::size_t n = 0; n < pixels.size(); ++n) {
    // Tables and what goes on from them are right to the share of UV light that is left out.
    EXPECT_NEAR(a.upper[n], b.upper[node[n]], 2e-6 * a.upper[n]) << n;
  }
}

TEST(UvOwnLayers, HeightsThatAreAllAlikeAreNone) {
  Lit lit;
  lit.process.layer_heights_um = {kUsualUm, kUsualUm};
  EXPECT_TRUE(lit.model().inhibited()->alike());
  EXPECT_EQ(lit.model().inhibited()->settings(), 1);
}

TEST(UvOwnLayers, TheDeadZoneIsThinnerNearThePlatform) {
  Lit lit;
  lit.printer.platform_reflectance = 0.3;
  const CureModel model = lit.model();
  const InhibitedKernel& kernel = *model.inhibited();
  const double far = kernel.dead_zone_um(500, 200), near = kernel.dead_zone_um(0, 200);
  const double slope = 1 / kHuvUm - 1 / kHbUm;
  EXPECT_NEAR(far, std::log(kBeta * 200 / (1 + 99.0 * 200 / 255)) / slope, 1e-9);
  // Where slice 0 begins the front lies at the platform itself.
  EXPECT_NEAR(near, far - std::log(1.3) / slope, 1e-9);
  for (int n = 0; n < 40; ++n) {
    EXPECT_LE(kernel.dead_zone_um(n, 200), kernel.dead_zone_um(n + 1, 200) + 1e-12) << n;
  }
}

TEST(UvOwnLayers, UvLightOfSlicesAndPatternsKeepTheirDeadZone) {
  Lit lit;
  lit.printer.platform_reflectance = 0.3;
  lit.printer.uv->patterned = true;
  lit.process.uv = {UvKind::patterned, 0, 15, {}};
  const CureModel model = lit.model();
  for (const int n : {0, 1, 5, 30}) {
    for (int level = 1; level < 256; level += 50) {
      EXPECT_GE(model.inhibited()->dead_zone_um(n, level), 15 - 1e-6) << n << " " << level;
    }
    EXPECT_EQ(model.inhibited()->highest_usable_level(model.inhibited()->setting_of_slice(n)), 255);
  }
}

TEST(UvOwnLayers, WhatTablesDoNotHoldIsRefused) {
  Lit lit;
  std::mt19937 random(9);
  for (int n = 0; n < 8000; ++n) {
    lit.process.layer_heights_um.push_back(20 + static_cast<double>(random() % 60));
  }
  try {
    lit.model();
    FAIL() << "tables of 8,000 slices";
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr("MiB"));
    EXPECT_THAT(e.what(), HasSubstr("expected heights that change less often"));
  }
  for (const Kind kind : {heights, platform}) {
    const Lit own = random_lit(random, kind, false);
    try {
      static_cast<void>(own.model().inhibited()->by_front(0.1));
      FAIL() << "fronts of light that spreads";
    } catch (const InputError& e) {
      EXPECT_THAT(e.what(), HasSubstr("light spreads under UV light"));
      EXPECT_THAT(e.what(), HasSubstr("expected light that stays in its pixel"));
    }
  }
}

}  // namespace
}  // namespace slicecorr::own_layers
