// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// An even dead zone in slices of different heights, and below a platform that sends light back: doses against a rate
// that is summed in small steps and shares no code with the library, and corrections.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>
#include <vector>

#include "layer_places.hpp"
#include "process/even_back.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/even_light.hpp"
#include "slicecorr/inhibited.hpp"
#include "uv_models.hpp"

// A namespace of its own: tests that are compiled together have names like these, too.
namespace slicecorr::even_surroundings {
namespace {

using Bytes = std::vector<std::uint8_t>;

// Of `resin_1`, and the lights.
constexpr double kHbUm = 408, kHuvUm = 37.8, kBeta = 0.73, kCriticalDose = 64;
constexpr double kFull = 400, kUv = 250, kGapUm = 80, kSpeedUmS = 300 / 3.6, kUsualUm = 50;
constexpr std::uint8_t kLeast = 90, kGreatest = 140;

/// A print, and all that its doses follow from.
struct Lit {
  Printer printer = test::uv::uv_printer(0, kFull);
  Process process = test::process(300);

  explicit Lit(bool heights, double reflectance) {
    process.uv.kind = UvKind::per_slice;
    process.uv.slice_mw_cm2 = {kUv};
    process.even_dead_zone = EvenDeadZone::blue;
    EvenLight light;
    light.columns = 2;
    light.rows = 1;
    light.pitch_um = 1000;
    light.gap_um = kGapUm;
    light.slices = {0};
    light.blue = std::make_shared<const Bytes>(Bytes{kLeast, kGreatest});
    process.even_light = light;
    if (heights) {
      process.layer_heights_um.assign(12, 50);
      process.layer_heights_um.insert(process.layer_heights_um.end(), 20, 30);
      process.layer_heights_um.push_back(60);
    }
    printer.platform_reflectance = reflectance;
  }
  double height_um(int n) const { return test::height_um(process, n, kUsualUm); }
  double node_um(int n) const { return test::node_um(process, n, kUsualUm); }
  double back(double z_um) const {
    return 1 + printer.platform_reflectance * std::exp(-2 * z_um / kHbUm);
  }
  CureModel model() const {
    return make_cure_model(printer, test::uv::resin_1(1.0), process, kUsualUm);
  }
  static double net(double blue, double d_um) {
    return std::max(0.0, blue * std::exp(-d_um / kHbUm) - kBeta * kUv * std::exp(-d_um / kHuvUm));
  }
  /// Midpoints of steps between two distances from the window.
  static double between(double blue, double from_um, double to_um) {
    constexpr int steps = 400;
    const double step = (to_um - from_um) / steps;
    double sum = 0;
    for (int i = 0; i < steps; ++i) sum += net(blue, from_um + (i + 0.5) * step) * step;
    return sum / (kSpeedUmS * kCriticalDose);
  }
  /// How often light of the gap counts: so that even light gels just at the gap.
  static double often(double blue) {
    const double even = std::clamp(blue, kFull * kLeast / 255, kFull * kGreatest / 255);
    return std::clamp(1 / between(even, 0, kGapUm), 0.25, 4.0);
  }
  double dose(double z_um, const Bytes& levels) const {
    double sum = 0, from_um = 0;
    for (std::size_t n = 0; n < levels.size(); ++n) {
      const double to_um = from_um + height_um(static_cast<int>(n));
      const double blue = kFull * levels[n] / 255 * back(z_um);
      const double low = std::max(0.0, from_um - z_um), high = to_um - z_um;
      if (const double end = std::min(high, kGapUm); end > low) {
        sum += often(blue) * between(blue, low, end);
      }
      if (high > std::max(low, kGapUm)) sum += between(blue, std::max(low, kGapUm), high);
      from_um = to_um;
    }
    return sum;
  }
};

struct Kind {
  bool heights;
  double reflectance;
};
class EvenSurroundings : public testing::TestWithParam<Kind> {
 protected:
  Lit lit() const { return Lit(GetParam().heights, GetParam().reflectance); }
};

TEST_P(EvenSurroundings, DosesAreThoseOfTheRateItself) {
  const Lit print = lit();
  const CureModel model = print.model();
  ASSERT_FALSE(model.inhibited()->alike());
  EXPECT_EQ(model.inhibited()->gap_um(), kGapUm);
  std::mt19937 random(3);
  Bytes levels;
  std::uint8_t level = 120;
  for (int n = 0; n < 50; ++n) {
    if (random() % 3 == 0) level = static_cast<std::uint8_t>(random() % 200);
    levels.push_back(level);
  }
  const ColumnDose dose = column_dose(model, levels);
  for (int n = 0; n < 50; n += n < 6 ? 1 : 4) {
    const auto i = static_cast<std::size_t>(n);
    const double at = print.node_um(n), um = print.height_um(n);
    // Midpoints of steps of 80 um / 400 are off by (step / huv)^2 / 24, 1e-6 of a dose, and by a step's share of the
    // rate where it begins at its clamp; tables leave out a share of 1e-6 of UV light.
    const double upper = print.dose(at, levels), middle = print.dose(at + um / 2, levels);
    EXPECT_NEAR(dose.upper[i], upper, 2e-4 * std::max(upper, 0.05)) << n;
    EXPECT_NEAR(dose.middle[i], middle, 2e-4 * std::max(middle, 0.05)) << n;
  }
}

TEST_P(EvenSurroundings, FeaturesGetEvenLightAndKeepTheirEdges) {
  const Lit print = lit();
  const CureModel model = print.model();
  // On the platform up to 40, a gap of 40 slices, then up to 140.
  constexpr int layers = 140;
  Bytes coverage(layers, 255);
  std::fill(coverage.begin() + 40, coverage.begin() + 80, std::uint8_t{0});
  const int all = slices_with_burst(model, layers, layers - 1);
  const CorrectionPlan plan(model, print.process, layers, all);
  BandCorrector corrector(plan, 1);
  for (const std::uint8_t covered : coverage) corrector.add_layer(&covered);
  constexpr std::uint8_t even = 110;
  corrector.keep_light([&](std::size_t, std::uint8_t* levels) { std::fill_n(levels, all, even); });
  Bytes levels(static_cast<std::size_t>(all));
  corrector.solve([&](int n, const std::uint8_t* row, const std::uint8_t*, bool) {
    levels[static_cast<std::size_t>(n)] = *row;
  });
  int as_even = 0, wrong = 0;
  for (int n = 0; n < layers; ++n) {
    const auto i = static_cast<std::size_t>(n);
    EXPECT_LE(levels[i], even) << n;
    if (n >= 80 && n < layers) as_even += static_cast<int>(levels[i] == even);
    const double middle = print.dose(print.node_um(n) + print.height_um(n) / 2, levels);
    wrong += static_cast<int>((middle >= 1) != (coverage[i] != 0));
  }
  EXPECT_EQ(wrong, 0);
  // Light stays even until the edge towards the platform bears no more of it.
  EXPECT_GT(as_even, 30);
  // A level of some 100 is 1 % of the dose.
  EXPECT_NEAR(print.dose(print.node_um(80), levels), 1, 0.03);
  EXPECT_NEAR(print.dose(print.node_um(layers), levels), 1, 0.03);
}

INSTANTIATE_TEST_SUITE_P(Kinds, EvenSurroundings,
                         testing::Values(Kind{true, 0}, Kind{false, 0.3}, Kind{true, 0.3}),
                         [](const auto& kind) {
                           return !kind.param.heights          ? "Platform"
                                  : kind.param.reflectance > 0 ? "Both"
                                                               : "Heights";
                         });

TEST(EvenBack, IsWhatComesBackAtTheFront) {
  const Lit print(true, 0.3);
  const detail::EvenBack back(print.printer, test::uv::resin_1(1.0), print.process, kUsualUm);
  for (const int n : {0, 1, 2, 11, 12, 30, 33}) {
    const double window = print.node_um(n) + print.height_um(n) / 2;
    EXPECT_NEAR(back.times(n), print.back(std::max(0.0, window - kGapUm)), 1e-12) << n;
  }
  EXPECT_DOUBLE_EQ(back.times(0), 1.3);
  EXPECT_EQ(back.times(100000), 1.0);
  Lit without(true, 0);
  EXPECT_EQ(
      detail::EvenBack(without.printer, test::uv::resin_1(1.0), without.process, kUsualUm).slices(),
      0U);
}

}  // namespace
}  // namespace slicecorr::even_surroundings
