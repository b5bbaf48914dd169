// Layer by layer exposure: closed forms, the solve against the ideal one and a direct sum, bad
// schedules.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "models.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/predict.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr {
namespace {

using test::column;
using test::linear_printer;

Process layerwise(double exposure_s) {
  Process p;
  p.mode = ExposureMode::layerwise;
  p.exposure_s = exposure_s;
  return p;
}

/// Dissertation figure A.7: Dc 576 mJ/cm³, hs 50 um, ha 110 um, 1 to 100 mW/cm²; the least
/// exposure.
constexpr double kLeastExposure = 0.07836944;
CureModel figure_a_7(double exposure_s = kLeastExposure * (1 + 1e-6)) {
  return make_cure_model(linear_printer(1, 100), test::resin(576, 110), layerwise(exposure_s), 50);
}

std::vector<std::uint8_t> pixels_of(const std::vector<std::uint8_t>& levels, int count) {
  std::vector<std::uint8_t> pixels;
  for (const std::uint8_t l : levels) {
    pixels.push_back(static_cast<std::uint8_t>(pixel_of_level(l, count)));
  }
  return pixels;
}

TEST(LayerwiseModel, CheckValuesOfTheDissertation) {
  // te = Dc ha 10^(hs/ha) / (Imax ln10), (A.52).
  const double te = 576 * 110e-4 * std::pow(10, 50.0 / 110) / (100 * units::ln10);
  EXPECT_NEAR(te, 0.078369, 5e-7);
  const CureModel m = figure_a_7(te);
  EXPECT_NEAR(m.phi_max() * m.a, 1.0, 1e-12);
  EXPECT_NEAR(m.phi_min(), 0.028480, 5e-7);
  EXPECT_NEAR(m.cut_through_um(), 1.3416, 5e-5);
  EXPECT_NEAR(m.heterogeneity(), 2.848, 5e-4);
  // (A.53) of the same.
  EXPECT_NEAR(m.cut_through_um(), 110 * std::log10(1 + 0.01 * std::pow(10, 50.0 / 110)), 1e-9);
  EXPECT_NEAR(m.critical_intensity_mw_cm2 * m.phi_max(), 100, 1e-9);
  EXPECT_FALSE(m.gels_further_teeth());
  EXPECT_FALSE(m.is_plain());
  EXPECT_EQ(m.slices_to_gel(), 0);
}

TEST(LayerwiseModel, ExposureFollowsBottomAndFadeLayers) {
  Process p = layerwise(2);
  p.bottom_exposure_s = 14;
  p.bottom_layers = 2;
  p.fade_layers = 3;
  // Twelve seconds in four equal steps, as faded layers have neither end.
  const std::vector<double> expected{14, 14, 11, 8, 5, 2, 2, 2};
  for (int n = 0; n < 8; ++n) {
    EXPECT_DOUBLE_EQ(layer_exposure_s(p, n), expected[static_cast<std::size_t>(n)]) << n;
  }
  const CureModel m = make_cure_model(linear_printer(1, 100), test::resin(576, 110), p, 50);
  for (int n = 0; n < 9; ++n) EXPECT_DOUBLE_EQ(m.ratio(n), layer_exposure_s(p, n) / 2) << n;
  EXPECT_DOUBLE_EQ(m.greatest_ratio(), 7);
  p.layer_exposure_s = {3, 1, 2};
  EXPECT_EQ(layer_exposure_s(p, 0), 3);
  EXPECT_EQ(layer_exposure_s(p, 1), 1);
  EXPECT_EQ(layer_exposure_s(p, 700), 2);
  EXPECT_DOUBLE_EQ(light_on_s(p, 1, 50, 5), 3 + 1 + 2 + 2 + 2);
}

}  // namespace
}  // namespace slicecorr
