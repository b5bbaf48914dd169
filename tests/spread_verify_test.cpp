// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What prints where light spreads: figures of whole stacks against closed forms and against sums of
// their own over the pixels.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "cure/light_spread.hpp"
#include "memory_slices.hpp"
#include "models.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/place_models.hpp"
#include "slicecorr/simulate.hpp"
#include "slicecorr/solid.hpp"

namespace slicecorr {
namespace {

using test::MemorySlices;

constexpr double kPixelUm = 50, kLayerUm = 50, kHaUm = 1000, kSpeedMmH = 300;

double normal(double x) { return std::erfc(-x / std::sqrt(2.0)) / 2; }
/// The x of normal(x) = share.
double probit(double share) {
  double low = -40, high = 40;
  for (int i = 0; i < 200; ++i) {
    const double x = (low + high) / 2;
    (normal(x) < share ? low : high) = x;
  }
  return low;
}

/// Light of `full` beside `black`, relative to the intensity that gels in the end.
Setup setup(double full, double black, int width_px, int height_px) {
  Setup s;
  s.printer = test::linear_printer(1, 2);
  s.printer.width_px = width_px;
  s.printer.height_px = height_px;
  s.resin = test::resin(20, kHaUm);
  s.process = test::process(kSpeedMmH);
  const double critical =
      make_cure_model(s.printer, s.resin, s.process, kLayerUm).critical_intensity_mw_cm2;
  s.printer.calibration = {{0, black * critical}, {255, full * critical}};
  return s;
}

MemorySlices block(int width_px, int height_px, int layers, const PixelBox& lit) {
  MemorySlices slices({width_px, height_px, layers, kPixelUm, kPixelUm, kLayerUm});
  for (int n = 0; n < layers; ++n) {
    for (int y = lit.y0; y < lit.y1; ++y) {
      for (int x = lit.x0; x < lit.x1; ++x) slices.at(n, x, y) = 255;
    }
  }
  return slices;
}

/// So many slices that what the part's end lacks doesn't count: 10^(-150 * 50 / 1000) = 3e-8.
constexpr int kSlices = 150;

TEST(SpreadVerify, StraightEdgesPrintFurtherOut) {
  // 6.25 beside 0.0625: 1.0300 sigma outwards (page 5). Between the middles of pixels the outline is
  // exact; corners are not, so the block is long and a few of its edges differ.
  for (const double sigma_um : {15.0, 40.0, 75.0}) {
    slicecorr::Setup s = setup(6.25, 0.0625, 40, 40);
    s.printer.spread.gaussians = {{sigma_um, 1}};
    const MemorySlices slices = block(40, 40, kSlices, {0, 0, 20, 40});
    // The first layer alone is designed: what the part's end lacks is far from it.
    const MemorySlices design = block(40, 40, 1, {0, 0, 20, 40});
    const Prediction p = verify_stack(slices, design, s, ExecutionContext{});
    const double expected_um = sigma_um * probit(1 - (1 - 0.0625) / (6.25 - 0.0625));
    // 40 rows; near the display's upper and lower ends light is lost.
    EXPECT_EQ(p.plane_error_um.count(), 40U);
    EXPECT_NEAR(expected_um / sigma_um, 1.0300, 5e-5);
    EXPECT_NEAR(p.plane_overreach_um, expected_um, 2e-3 * sigma_um) << sigma_um;
    EXPECT_EQ(p.plane_closed, 0U);
    EXPECT_EQ(p.plane_lost, 0U);
  }
}

/// Doses in the middle of each layer by convolving the pixels' light directly, with weights from
/// normal integrals that are neither cut nor scaled.
std::vector<double> direct_doses(const MemorySlices& shown, const Setup& s, double sigma_um) {
  const Grid& g = shown.grid();
  const CureModel model = make_cure_model(s.printer, s.resin, s.process, g.layer_um);
  const PixelCurve curve = pixel_curve(model);
  const auto area = static_cast<std::size_t>(g.width_px) * static_cast<std::size_t>(g.height_px);
  const auto weight = [&](int k, double pixel_um) {
    return normal((k + 0.5) * pixel_um / sigma_um) - normal((k - 0.5) * pixel_um / sigma_um);
  };
  std::vector<double> below(area, 0.0), doses(area * static_cast<std::size_t>(g.layers));
  for (int n = g.layers; n-- > 0;) {
    for (int y = 0; y < g.height_px; ++y) {
      for (int x = 0; x < g.width_px; ++x) {
        double phi = 0;
        for (int v = 0; v < g.height_px; ++v) {
          double row = 0;
          for (int u = 0; u < g.width_px; ++u) {
            row += weight(u - x, g.pixel_x_um) * curve[shown.at(n, u, v)];
          }
          phi += weight(v - y, g.pixel_y_um) * row;
        }
        const std::size_t i = static_cast<std::size_t>(y * g.width_px + x);
        doses[static_cast<std::size_t>(n) * area + i] = model.middle(phi, below[i]);
        below[i] = model.step(phi, below[i]);
      }
    }
  }
  return doses;
}

TEST(SpreadVerify, VoxelsAreThoseOfADirectConvolution) {
  std::mt19937 random(27);
  for (const double sigma_um : {15.0, 40.0, 75.0}) {
    slicecorr::Setup s = setup(3, 0.02, 24, 22);
    s.printer.spread.gaussians = {{sigma_um, 1}};
    const Grid grid{24, 22, 30, 50, 40, kLayerUm};
    s.printer.pixel_y_um = 40;
    MemorySlices design(grid), shown(grid);
    for (int n = 0; n < grid.layers; ++n) {
      for (int y = 6; y < 18; ++y) {
        for (int x = 7; x < 19; ++x) {
          design.at(n, x, y) = (x / 3 + y / 4 + n / 5) % 2 ? 255 : 0;
          shown.at(n, x, y) = static_cast<std::uint8_t>(random() % 256);
        }
      }
    }
    const std::vector<double> doses = direct_doses(shown, s, sigma_um);
    std::uint64_t through = 0, under = 0, unsure = 0;
    std::size_t i = 0;
    for (int n = 0; n < grid.layers; ++n) {
      for (int y = 0; y < grid.height_px; ++y) {
        for (int x = 0; x < grid.width_px; ++x, ++i) {
          // Weights of ours are cut at 1e-6 per axis, of light up to 3.
          if (std::abs(doses[i] - 1) < 1e-5) ++unsure;
          through += design.at(n, x, y) == 0 && doses[i] >= 1;
          under += design.at(n, x, y) == 255 && doses[i] < 1;
        }
      }
    }
    ASSERT_LE(unsure, 3U);
    const Prediction p = verify_stack(shown, design, s, ExecutionContext{});
    EXPECT_NEAR(static_cast<double>(p.cure_through_voxels), static_cast<double>(through),
                static_cast<double>(unsure));
    EXPECT_NEAR(static_cast<double>(p.undercure_voxels), static_cast<double>(under),
                static_cast<double>(unsure));
    EXPECT_GT(through + under, 100U);
    for (const Pixel pixel : {Pixel{7, 6}, Pixel{12, 12}, Pixel{3, 20}, Pixel{0, 0}}) {
      const auto rows = probe_stack(shown, &design, s, pixel.x, pixel.y);
      ASSERT_EQ(rows.size(), static_cast<std::size_t>(grid.layers));
      for (int n = 0; n < grid.layers; ++n) {
        const double direct =
            doses[(static_cast<std::size_t>(n) * 22 + static_cast<std::size_t>(pixel.y)) * 24 +
                  static_cast<std::size_t>(pixel.x)];
        EXPECT_NEAR(rows[static_cast<std::size_t>(n)].dose_middle, direct, 1e-5);
      }
    }
    const Section section = section_of(shown, design, s, 12);
    for (int n = 0; n < section.layers; ++n) {
      for (int x = 0; x < section.width; ++x) {
        const double direct = doses[(static_cast<std::size_t>(n) * 22 + 12) * 24 +
                                    static_cast<std::size_t>(section.x0 + x)];
        // The section's doses are floats.
        EXPECT_NEAR(section.dose[static_cast<std::size_t>(n * section.width + x)], direct, 1e-5);
      }
    }
  }
}

TEST(SpreadVerify, SolidHasItsOutlineBetweenPixels) {
  constexpr double kSigmaUm = 40, kFull = 6.25, kBlack = 0.0625;
  slicecorr::Setup s = setup(kFull, kBlack, 40, 40);
  s.printer.spread.gaussians = {{kSigmaUm, 1}};
  const MemorySlices slices = block(40, 40, kSlices, {10, 10, 30, 30});
  const PlaceModels models(s.printer, s.resin, s.process, slices.grid(), {});
  const TriangleMesh mesh = solid_mesh(slices, models, {}, ExecutionContext{});
  double low = 1e9, high = -1e9;
  for (const auto& v : mesh.vertices) {
    low = std::min(low, static_cast<double>(v[0]));
    high = std::max(high, static_cast<double>(v[0]));
  }
  // Dose in the middles of the first two pixels beside a long wall, and on a straight line between.
  const auto dose = [&](double x_um) {
    return kBlack + (kFull - kBlack) * normal(-x_um / kSigmaUm);
  };
  const double beside_um = 25 + 50 * (dose(25) - 1) / (dose(25) - dose(75));
  EXPECT_NEAR(beside_um, 49, 1);
  // Corners in mm, as floats.
  EXPECT_NEAR(low * 1e3, 500 - beside_um, 0.01);
  EXPECT_NEAR(high * 1e3, 1500 + beside_um, 0.01);
}

TEST(SpreadVerify, ClosedGapsAndLostLinesAreListed) {
  // A gap of a pixel at full light closes, a line of a pixel that full light is too weak for is
  // lost: in its middle there is 0.468 of it.
  slicecorr::Setup s = setup(2, 0.02, 40, 40);
  s.printer.spread.gaussians = {{40, 1}};
  MemorySlices design = block(40, 40, kSlices, {4, 10, 20, 30});
  for (int n = 0; n < kSlices; ++n) {
    for (int y = 10; y < 30; ++y) {
      design.at(n, 12, y) = 0;
      design.at(n, 28, y) = 255;
    }
  }
  const Prediction p = verify_stack(design, design, s, ExecutionContext{});
  EXPECT_GT(p.plane_closed, 0U);
  EXPECT_GT(p.plane_lost, 0U);
  bool closed = false, lost = false;
  for (const FeatureExample& e : p.plane_closed_examples.sorted()) {
    closed = closed || ((e.x == 11 || e.x == 13) && e.y == 20 && e.first == 0);
  }
  for (const FeatureExample& e : p.plane_lost_examples.sorted()) {
    lost = lost || (e.x == 28 && e.y == 20 && e.first == 0 && e.last == kSlices - 1);
  }
  EXPECT_TRUE(closed);
  EXPECT_TRUE(lost);
  ASSERT_TRUE(p.finest.has_value());
  // 1.33313 sigma (page 5).
  EXPECT_NEAR(p.finest->line_um, 1.33313 * 40, 1e-3);
}

TEST(SpreadVerify, NoSpreadLeavesFiguresAndGivesNone) {
  slicecorr::Setup s = setup(3, 0.02, 24, 24);
  const MemorySlices design = block(24, 24, 20, {5, 5, 15, 15});
  const Prediction without = verify_stack(design, design, s, ExecutionContext{});
  s.printer.spread.gaussians = {{0, 1}};
  const Prediction none = verify_stack(design, design, s, ExecutionContext{});
  EXPECT_EQ(without.to_json(), none.to_json());
  EXPECT_EQ(without.plane_error_um.count(), 0U);
  // So narrow that nothing leaves its pixel: the same figures by the way of light that spreads.
  s.printer.spread.gaussians = {{1, 1}};
  const Prediction narrow = verify_stack(design, design, s, ExecutionContext{});
  EXPECT_EQ(narrow.cure_through_voxels, without.cure_through_voxels);
  EXPECT_EQ(narrow.undercure_voxels, without.undercure_voxels);
  EXPECT_EQ(narrow.runs, without.runs);
  EXPECT_NEAR(narrow.height_error_um.mean(), without.height_error_um.mean(), 1e-3);
}

TEST(SpreadVerify, AnyNumberOfThreadsAndAnyPlaceOnTheDisplay) {
  slicecorr::Setup s = setup(3, 0.02, 70, 300);
  s.printer.spread.gaussians = {{60, 0.7}, {20, 0.3}};
  s.resin.scatter_um2_per_um = 0.4;
  std::mt19937 random(5);
  MemorySlices design({70, 300, 24, 50, 50, 50}), shown({70, 300, 24, 50, 50, 50});
  for (int n = 0; n < 24; ++n) {
    for (int y = 20; y < 280; ++y) {
      for (int x = 10; x < 60; ++x) {
        design.at(n, x, y) = (x / 6 + y / 7 + n / 5) % 3 ? 255 : 0;
        shown.at(n, x, y) = static_cast<std::uint8_t>(random() % 256);
      }
    }
  }
  ExecutionContext one, three;
  one.threads = 1;
  three.threads = 3;
  EXPECT_EQ(verify_stack(shown, design, s, one).to_json(),
            verify_stack(shown, design, s, three).to_json());
}

TEST(SpreadVerify, SimulationEndsWithTheSamePrint) {
  slicecorr::Setup s = setup(6.25, 0.0625, 40, 40);
  s.printer.spread.gaussians = {{40, 1}};
  const MemorySlices stack = block(40, 40, 30, {10, 10, 30, 30});
  const PrintClock clock(s.process, 1, kLayerUm, 30);
  const ExecutionContext context;
  const SectionHistory h =
      simulate_section(stack, nullptr, s, 20, {clock.total_s() / 3, clock.total_s()}, context);
  const Section end = section_of(stack, stack, s, 20);
  ASSERT_EQ(h.width, end.width);
  ASSERT_EQ(h.x0, end.x0);
  std::size_t gelled = 0;
  for (std::size_t i = 0; i < end.dose.size(); ++i) {
    EXPECT_EQ(h.frames.back().gelled[i] != 0, end.dose[i] >= 1) << i;
    gelled += end.dose[i] >= 1 ? 1U : 0U;
  }
  // More than what is lit, by what spreads.
  EXPECT_GT(gelled, 20U * 29U);
  // Beside the block, where nothing is shown: the dose at the end of the print.
  const ColumnHistory column = simulate_column(stack, nullptr, s, 9, 20, {}, context);
  double printed_um = 0;
  for (const GelledInterval& g : column.steps.back().gelled) printed_um += g.front_um - g.back_um;
  int printed = 0;
  for (const ProbeRow& row : probe_stack(stack, nullptr, s, 9, 20)) printed += row.dose_middle >= 1;
  EXPECT_GT(printed, 10);
  EXPECT_NEAR(printed_um, printed * kLayerUm, kLayerUm);
}

TEST(SpreadVerify, Refusals) {
  const MemorySlices design = block(24, 24, 4, {5, 5, 15, 15});
  const auto why = [&](const slicecorr::Setup& s) -> std::string {
    try {
      verify_stack(design, design, s, ExecutionContext{});
    } catch (const InputError& e) {
      return e.what();
    }
    return "";
  };
  slicecorr::Setup s = setup(3, 0.02, 24, 24);
  s.printer.spread.gaussians = {{1000, 1}};
  EXPECT_NE(why(s).find("are sigmas in um?"), std::string::npos) << why(s);
  s = setup(3, 0.02, 24, 24);
  s.resin.scatter_um2_per_um = 0.1;
  s.printer.platform_reflectance = 0.2;
  EXPECT_NE(why(s).find("scatters on a longer way"), std::string::npos) << why(s);
  s.printer.platform_reflectance = 0;
  s.process.layer_heights_um = {40, 50};
  EXPECT_NE(why(s).find("layers differ in height"), std::string::npos) << why(s);
  s.process.layer_heights_um.clear();
  s.process.mode = ExposureMode::layerwise;
  s.process.exposure_s = 3;
  s.process.lifts = Lifts::each;
  s.process.lift_exchange = 0.5;
  s.printer.resin_depth_um = 3000;
  EXPECT_NE(why(s).find("lifts exchange resin"), std::string::npos) << why(s);
}

}  // namespace
}  // namespace slicecorr
