// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Layers of different heights, with times and shares of light of their own: doses, corrections and figures
// of random columns against sums over places that share no code with the library.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

#include "models.hpp"
#include "rounds.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/predict.hpp"

namespace slicecorr {
namespace {

constexpr int kOwnLayers = 50;

/// A print and all that its doses follow from.
struct Uneven {
  Printer printer;
  Resin resin;
  Process process;
  double layer_um = 50;
  std::vector<double> nodes_um;  ///< of layers 0 to `kOwnLayers`

  /// What a pixel value of layer n leaves at its window, in critical doses.
  double at_window(int n, int level) const {
    const auto i = static_cast<std::size_t>(n);
    const double full = printer.calibration.back().intensity_mw_cm2;
    const double black = printer.calibration.front().intensity_mw_cm2;
    const double mw_cm2 =
        process.light_share[i] * (black + (full - black) * level / (printer.levels() - 1));
    return std::pow(mw_cm2, resin.m) * process.layer_exposure_s[i] / resin.critical_dose_prime;
  }
  /// Of a dose at one place, what is left `um` further.
  double left(double um) const {
    return std::pow(10.0, -resin.m * um / resin.absorbance_height10_um);
  }
  /// Dose at a place: exposures of layers whose window is below it.
  double dose(double z_um, const std::vector<int>& levels, int first) const {
    double sum = 0;
    for (int n = first; n < static_cast<int>(levels.size()); ++n) {
      sum += at_window(n, levels[static_cast<std::size_t>(n)]) *
             left(nodes_um[static_cast<std::size_t>(n) + 1] - z_um);
    }
    return sum;
  }
};

Uneven random_print(std::mt19937& random, double black_mw_cm2) {
  const auto among = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  Uneven u;
  u.printer.name = "p";
  u.printer.width_px = u.printer.height_px = 8;
  u.printer.pixel_x_um = u.printer.pixel_y_um = 50;
  u.printer.calibration = {{0, black_mw_cm2}, {255, 20}};
  u.resin.name = "r";
  u.resin.model = CureModelKind::kinetic;
  u.resin.m = among(0.5, 1.2);
  u.resin.absorbance_height10_um = among(120, 400);
  u.resin.critical_dose_prime = 10;
  u.process.mode = ExposureMode::layerwise;
  u.nodes_um = {0};
  for (int n = 0; n < kOwnLayers; ++n) {
    u.process.layer_heights_um.push_back(5 * std::round(among(4, 20)));
    u.process.layer_exposure_s.push_back(among(8, 16));
    u.process.light_share.push_back(std::round(among(100, 255)) / 255);
    u.nodes_um.push_back(u.nodes_um.back() + u.process.layer_heights_um.back());
  }
  u.process.exposure_s = u.process.layer_exposure_s.back();
  return u;
}

TEST(OwnHeights, DosesAreSumsOverPlaces) {
  std::mt19937 random(59);
  for (int round = 0; round < test::rounds(20); ++round) {
    const Uneven u = random_print(random, 0.01);
    const CureModel model = make_cure_model(u.printer, u.resin, u.process, u.layer_um);
    std::vector<std::uint8_t> pixels;
    std::vector<int> levels;
    for (int n = 0; n < kOwnLayers; ++n) {
      levels.push_back(static_cast<int>(random() % 256));
      pixels.push_back(static_cast<std::uint8_t>(levels.back()));
    }
    const ColumnDose doses = column_dose(model, pixels);
    for (int n = 0; n < kOwnLayers; ++n) {
      const auto i = static_cast<std::size_t>(n);
      const double upper = u.dose(u.nodes_um[i], levels, n);
      const double lower = u.dose(u.nodes_um[i + 1], levels, n);
      const double middle = u.dose(0.5 * (u.nodes_um[i] + u.nodes_um[i + 1]), levels, n);
      EXPECT_NEAR(doses.upper[i], upper, 1e-9 * upper) << n;
      EXPECT_NEAR(doses.middle[i], middle, 1e-9 * middle) << n;
      EXPECT_NEAR(doses.lower[i], lower, 1e-9 * lower) << n;
      EXPECT_NEAR(model.depth(n) * u.layer_um, u.nodes_um[i], 1e-9) << n;
    }
  }
}

/// Features of random heights over gaps of random heights; black is dark.
std::vector<std::uint8_t> random_column(std::mt19937& random) {
  std::vector<std::uint8_t> column(kOwnLayers, 0);
  int n = random() % 2 ? 0 : static_cast<int>(3 + random() % 5);
  while (n < kOwnLayers) {
    const int end = std::min<int>(kOwnLayers, n + 2 + static_cast<int>(random() % 9));
    std::fill(column.begin() + n, column.begin() + end, std::uint8_t{255});
    n = end + 2 + static_cast<int>(random() % 8);
  }
  return column;
}

/// Edges towards the platform against points 0.1 um apart.
void expect_edges(const Uneven& u, const CureModel& model, const std::vector<std::uint8_t>& column,
                  const std::vector<int>& levels) {
  const PixelCurve curve = pixel_curve(model);
  BandPredictor predictor(model, curve, kOwnLayers, 1);
  std::vector<std::pair<int, double>> told;
  predictor.tell_edges([&](std::size_t, int node, bool upper, double um) {
    if (upper) told.emplace_back(node, um);
  });
  for (int n = kOwnLayers; n-- > 0;) {
    const auto pixel = static_cast<std::uint8_t>(levels[static_cast<std::size_t>(n)]);
    predictor.add_slice(n, &pixel, &column[static_cast<std::size_t>(n)]);
  }
  const Prediction p = predictor.finish([](std::size_t) { return Pixel{0, 0}; });
  std::size_t edges = 0;
  for (const auto& edge : told) {
    const int node = edge.first;
    const double um = edge.second;
    ++edges;
    // From the node on towards the platform, as far as the gap goes.
    int top = node;
    while (top > 0 && column[static_cast<std::size_t>(top) - 1] == 0) --top;
    const double at_um = u.nodes_um[static_cast<std::size_t>(node)];
    const double most_um = at_um - u.nodes_um[static_cast<std::size_t>(top)];
    const auto prints = [&, last = node - 1](double z_um) {
      int n = last;
      while (n > 0 && u.nodes_um[static_cast<std::size_t>(n)] > z_um) --n;
      return u.dose(z_um, levels, n) >= 1;
    };
    constexpr double step = 0.1;
    double reach = 0;
    while (reach + step < most_um && prints(at_um - reach - step)) reach += step;
    if (um >= 0) {
      EXPECT_NEAR(um, reach, 2 * step) << node;
    } else {
      EXPECT_LE(reach, 2 * step) << node;
    }
  }
  EXPECT_EQ(p.height_error_um.count() > 0, true);
  EXPECT_GT(edges, 0u);
}

/// A random column as it is corrected.
struct SolvedColumn {
  SolvedColumn(const Uneven& u, std::mt19937& random) : column(random_column(random)) {
    const CorrectionPlan plan(make_cure_model(u.printer, u.resin, u.process, u.layer_um), u.process,
                              kOwnLayers, kOwnLayers);
    model = plan.model;
    const std::vector<std::uint8_t> made = solve_column(plan, column);
    levels.assign(made.begin(), made.end());
  }
  CureModel model;
  std::vector<std::uint8_t> column;
  std::vector<int> levels;
};

TEST(OwnHeights, LayersOfFeaturesReachTheirFarEdges) {
  std::mt19937 random(7);
  int dimmed = 0;
  for (int round = 0; round < test::rounds(20); ++round) {
    const Uneven u = random_print(random, 0);
    const auto& [model, column, levels] = SolvedColumn(u, random);
    for (int n = 0; n < kOwnLayers; ++n) {
      const auto i = static_cast<std::size_t>(n);
      if (column[i] == 0) {
        EXPECT_EQ(levels[i], 0) << n;
        continue;
      }
      // The least level whose dose comes to the layer's far edge.
      EXPECT_TRUE(u.dose(u.nodes_um[i], levels, n) >= 1 || levels[i] == 255) << n;
      dimmed += levels[i] < 255;
      if (levels[i] == 0) continue;
      std::vector<int> less = levels;
      --less[i];
      EXPECT_LT(u.dose(u.nodes_um[i], less, n), 1 + 1e-6) << n;
    }
    expect_edges(u, model, column, levels);
  }
  EXPECT_GT(dimmed, 100);
}

TEST(OwnHeights, LayersHoldByTheirOwnExposureAtEachLift) {
  std::mt19937 random(11);
  int over_gaps = 0;
  for (int round = 0; round < test::rounds(20); ++round) {
    Uneven u = random_print(random, 0);
    u.process.lifts = Lifts::each;
    const auto& [model, column, levels] = SolvedColumn(u, random);
    for (int n = 0; n < kOwnLayers; ++n) {
      const auto i = static_cast<std::size_t>(n);
      if (column[i] == 0) continue;
      const double holds = u.at_window(n, levels[i]) * u.left(u.nodes_um[i + 1] - u.nodes_um[i]);
      EXPECT_TRUE(holds >= u.process.green_strength || levels[i] == 255) << n << " " << holds;
      over_gaps += n > 0 && column[i - 1] == 0;
    }
    expect_edges(u, model, column, levels);
  }
  EXPECT_GT(over_gaps, 10);
}

TEST(OwnHeights, AlikeTheyAreWhatTheyWere) {
  std::mt19937 random(13);
  Uneven u = random_print(random, 0.01);
  u.process.layer_heights_um.clear();
  const CureModel plain = make_cure_model(u.printer, u.resin, u.process, u.layer_um);
  u.process.layer_heights_um = {u.layer_um};
  const CureModel listed = make_cure_model(u.printer, u.resin, u.process, u.layer_um);
  const std::vector<std::uint8_t> pixels(kOwnLayers, 200);
  const ColumnDose a = column_dose(plain, pixels), b = column_dose(listed, pixels);
  for (std::size_t n = 0; n < pixels.size(); ++n) {
    EXPECT_NEAR(a.upper[n], b.upper[n], 1e-12 * a.upper[n]) << n;
  }
  // A later layer is as high as the last that is listed.
  EXPECT_NEAR(listed.depth(70.25), 70.25, 1e-12);
}

TEST(OwnLight, OneShareForAllIsThatOfTheIntensities) {
  std::mt19937 random(17);
  const Uneven u = random_print(random, 0.05);
  Process half = u.process;
  half.layer_heights_um.clear();
  half.light_share = {0.5};
  Process full = half;
  full.light_share.clear();
  const CureModel dim = make_cure_model(u.printer, u.resin, half, u.layer_um),
                  by_hand = make_cure_model(dimmed(u.printer, 0.5), u.resin, full, u.layer_um);
  ASSERT_EQ(dim.level_phi.size(), by_hand.level_phi.size());
  for (std::size_t l = 0; l < dim.level_phi.size(); ++l) {
    EXPECT_DOUBLE_EQ(dim.level_phi[l], by_hand.level_phi[l]) << l;
  }
  // Continuous, slices of other shares count for the m-th power.
  half.mode = ExposureMode::continuous;
  half.speed_mm_h = 20;
  half.light_share = {1, 0.5};
  const CureModel moving = make_cure_model(u.printer, u.resin, half, u.layer_um);
  EXPECT_NEAR(moving.ratio(0), std::pow(2.0, u.resin.m), 1e-12);
  EXPECT_NEAR(moving.ratio(1), 1, 1e-12);
  EXPECT_NEAR(slice_light(half, u.resin.m, u.layer_um, 1, 9).share, 0.5, 1e-15);
}

}  // namespace
}  // namespace slicecorr
