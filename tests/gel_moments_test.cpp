// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// When layers of long columns gel, against sums of light that are added up from the window's way.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "models.hpp"
#include "predict/gel_step.hpp"
#include "rounds.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/predict.hpp"
#include "slicecorr/setup.hpp"

namespace slicecorr::test {
namespace {

constexpr int kLayers = 400, kLongest = 255;
constexpr std::size_t kColumns = 130;  // more than two blocks of lanes

/// Runs of greys: short and long ones, dark and bright.
std::vector<std::uint8_t> random_column(std::mt19937& random) {
  std::vector<std::uint8_t> column;
  while (column.size() < kLayers) {
    const std::size_t length = random() % 3 == 0 ? 1 + random() % 4 : 1 + random() % 90;
    const std::uint8_t grey = random() % 3 == 0   ? 0
                              : random() % 2 == 0 ? 255
                                                  : static_cast<std::uint8_t>(random() % 256);
    column.insert(column.end(), length, grey);
  }
  column.resize(kLayers);
  return column;
}

/// What slice n adds in the middle of layer m.
double added(const CureModel& model, double light, int m, int n) {
  const double far = std::pow(10.0, -model.eta * (n - m + 0.5));
  const double near = std::pow(10.0, -model.eta * std::max(0.0, n - m - 0.5));
  return light * (model.mode == ExposureMode::continuous ? near - far : far);
}

TEST(GelMoments, AreThoseOfSumsOfLight) {
  std::mt19937 random(7);
  const double layer_um = 50;
  std::uint64_t told_later = 0, at_once = 0, judged = 0;
  for (int round = 0; round < rounds(4); ++round) {
    for (const double speed_mm_h : {300.0, 1000.0, 0.0}) {
      // Light that reaches a few slices, or many.
      slicecorr::Setup setup{linear_printer(1, 100), resin(round % 2 == 0 ? 150 : 600, 2000),
                             process(std::max(speed_mm_h, 1.0))};
      if (speed_mm_h == 0) {
        setup.process.mode = ExposureMode::layerwise;
        setup.process.exposure_s = 0.4;
        setup.resin = resin(100, 40);
        if (round % 2 == 1) {  // first layers
          setup.process.bottom_layers = 20;
          setup.process.bottom_exposure_s = 1.1;
        }
      }
      const CureModel model =
          make_cure_model(setup.printer, setup.resin, setup.process, layer_um, {});
      const PixelCurve curve = pixel_curve(model);
      const int step = detail::gel_step(model);
      EXPECT_TRUE(step == 1 || std::pow(10.0, -model.eta * step) >= std::sqrt(0.5));
      EXPECT_TRUE(!model.is_plain() || std::pow(10.0, -2 * model.eta * step) < std::sqrt(0.5));
      std::vector<std::vector<std::uint8_t>> columns;
      for (std::size_t c = 0; c < kColumns; ++c) columns.push_back(random_column(random));

      std::vector<std::vector<int>> delays(kColumns, std::vector<int>(kLayers, 0));
      std::vector<int> told(kColumns, 0), from(kColumns, kLayers);
      const auto fill = [&](std::size_t c, int down_to) {
        for (int m = down_to; m < from[c]; ++m) delays[c][static_cast<std::size_t>(m)] = told[c];
        from[c] = down_to;
      };
      BandPredictor predictor(model, curve, kLayers, kColumns);
      ASSERT_TRUE(predictor.tell_delays(
          [&](std::size_t c, int slice, int delay) {
            fill(c, slice + 1);
            told[c] = delay;
            return true;
          },
          kLongest));
      std::vector<std::uint8_t> pixels(kColumns);
      for (int n = kLayers; n-- > 0;) {
        for (std::size_t c = 0; c < kColumns; ++c)
          pixels[c] = columns[c][static_cast<std::size_t>(n)];
        predictor.add_slice(n, pixels.data(), pixels.data());
      }
      for (std::size_t c = 0; c < kColumns; ++c) {
        SCOPED_TRACE(testing::Message() << round << " " << speed_mm_h << " column " << c);
        fill(c, 0);
        for (int m = 0; m < kLayers; ++m) {
          double sum = 0;
          int gelled = -1;
          bool close = false;  // rounding decides
          for (int n = m; n < kLayers && gelled < 0; ++n) {
            const double light = model.ratio(n) * curve[columns[c][static_cast<std::size_t>(n)]];
            sum += added(model, light, m, n);
            close |= std::abs(sum - 1) < 2e-6;
            if (sum >= 1) gelled = n - m;
          }
          if (close || gelled < 0) continue;
          // What gels at once is told by the last slice of a step.
          const int is = delays[c][static_cast<std::size_t>(m)];
          ASSERT_EQ(is, is < 0 ? -1 - ((m + gelled) / step * step + step - 1) : gelled)
              << "layer " << m;
          told_later += gelled > 0;
          at_once += is < 0;
          ++judged;
        }
      }
    }
  }
  EXPECT_GT(judged, 100000U);
  EXPECT_GT(told_later, 10000U);
  EXPECT_GT(at_once, 5000U);
}

}  // namespace
}  // namespace slicecorr::test
