// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Light that spreads under UV light: doses and figures against the rate equation of light that is
// blurred here, pixel by pixel, and the correction of columns together.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "memory_slices.hpp"
#include "models.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/inhibited.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/simulate.hpp"
#include "uv_models.hpp"

namespace slicecorr {
namespace {

using test::MemorySlices;
using namespace test::uv;
using testing::HasSubstr;

constexpr double kPitchUm = 50, kHsUm = 50;
/// UV light counts to 0.2 % (`InhibitedKernel::by_front`), which the dose follows with m times the
/// share of UV light in it: less than all of it. Sums here are exact to 1e-4.
constexpr double kDoseError = 2.2e-3;

Setup setup(int width_px, int height_px, double speed_mm_h = 300) {
  Setup s;
  s.printer = uv_printer();
  s.printer.width_px = width_px;
  s.printer.height_px = height_px;
  s.printer.spread = {{{40, 0.8}, {70, 0.2}}, std::nullopt};
  s.resin = resin_1();
  s.process = uv_process(speed_mm_h, 200);
  return s;
}

/// The share of a pixel's light that falls `x` pixels further.
double share(int x, double sigma_um) {
  const double scale = sigma_um / kPitchUm * std::sqrt(2.0);
  return (std::erf((x + 0.5) / scale) - std::erf((x - 0.5) / scale)) / 2;
}

/// What images of `light`, by pixel value, give a pixel of each slice; beyond the display it is dark.
std::vector<double> blurred(const MemorySlices& stack, const std::vector<double>& light,
                            const LightSpread& spread, int x, int y) {
  std::vector<double> at;
  for (int n = 0; n < stack.grid().layers; ++n) {
    double sum = 0;
    for (int j = 0; j < stack.grid().height_px; ++j) {
      for (int i = 0; i < stack.grid().width_px; ++i) {
        double weight = spread.gaussians.empty() && i == x && j == y ? 1 : 0;
        for (const SpreadGaussian& g : spread.gaussians) {
          weight += g.weight * share(i - x, g.sigma_um) * share(j - y, g.sigma_um);
        }
        sum += weight * light[stack.at(n, i, j)];
      }
    }
    at.push_back(sum);
  }
  return at;
}

/// Dose `zeta` slices from the platform, from the rate equation, by the midpoint rule in time.
double integrated(const Setup& s, const std::vector<double>& blue, const std::vector<double>& uv,
                  double zeta) {
  const Kinetics k = make_kinetics(s.resin, true, true);
  const bool moving = s.process.mode == ExposureMode::continuous;
  const double time_s =
      moving ? units::slice_time_s(kHsUm, s.process.speed_mm_h) : layer_exposure_s(s.process, 0);
  const int steps = moving ? 400 : 1;
  double dose = 0;
  for (std::size_t n = 0; n < blue.size(); ++n) {
    for (int i = 0; i < steps; ++i) {
      const double window = static_cast<double>(n) + (moving ? (i + 0.5) / steps : 1.0);
      if (window < zeta) continue;
      dose += dose_prime_at(k, blue[n], uv[n], (window - zeta) * kHsUm, time_s / steps) /
              k.critical_dose_prime;
    }
  }
  return dose;
}

MemorySlices random_stack(int width, int height, int layers, unsigned seed) {
  std::mt19937 random(seed);
  MemorySlices stack({width, height, layers, kPitchUm, kPitchUm, kHsUm});
  for (int n = 0; n < layers; ++n) {
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        // Some runs along columns, some noise.
        const bool lit = (n / 4 + x / 3 + y / 2) % 3 != 0;
        stack.at(n, x, y) = static_cast<std::uint8_t>(
            lit ? (n % 5 ? 90 + 30 * (x % 3) : static_cast<int>(random() % 256)) : 0);
      }
    }
  }
  return stack;
}

TEST(FrontLight, IsThatOfTheGreyLevels) {
  for (const ExposureMode mode : {ExposureMode::continuous, ExposureMode::layerwise}) {
    Process process = uv_process(1000, 200);
    process.mode = mode;
    process.exposure_s = 1;
    const CureModel model = model_of(resin_1(0.7), process, kHsUm);
    const InhibitedKernel& kernel = *model.inhibited();
    const auto by_front = kernel.by_front(1e-5);
    double most = 0;
    for (int i = 1; i < 80; ++i) most = std::max(most, kernel.exact(0, 255, 0.25 * i));
    for (const int level : {0, 1, 20, 139, 255}) {
      const double blue = kernel.level_mw_cm2(level);
      const FrontLight light = by_front->front_light(blue, 200);
      EXPECT_NEAR(by_front->blue_of(light), blue, 1e-6 * blue);
      for (int i = 1; i < 80; ++i) {
        const double x = 0.25 * i;
        EXPECT_NEAR(static_cast<double>(light.amount) * by_front->exact(0, light.front, x),
                    kernel.exact(0, level, x), kDoseError * most)
            << level << " " << x;
      }
      // Far from the window UV light has no share, and the dose is exact.
      const double far = kernel.near();
      EXPECT_NEAR(static_cast<double>(light.amount) * by_front->exact(0, light.front, far),
                  kernel.exact(0, level, far), 3e-6 * kernel.exact(0, level, far));
      EXPECT_NEAR(by_front->setting_dead_zone_um(0, light.front),
                  kernel.setting_dead_zone_um(0, level), 0.1);
    }
    EXPECT_EQ(by_front->front_light(0, 200).amount, 0);
  }
}

TEST(SpreadUnderUv, DosesAreThoseOfTheRateEquationOfBlurredLight) {
  for (const bool layerwise : {false, true}) {
    for (const bool patterned : {false, true}) {
      slicecorr::Setup s = setup(13, 9);
      if (layerwise) {
        s.process.mode = ExposureMode::layerwise;
        s.process.speed_mm_h = 0;
        s.process.exposure_s = 0.6;
      }
      if (patterned) {
        s.printer.uv->patterned = true;
        s.printer.uv->spread = {{{25, 1}}, std::nullopt};
        s.process.uv = {};
        s.process.uv.kind = UvKind::patterned;
        s.process.uv.dead_zone_um = 20;
      }
      const MemorySlices stack = random_stack(13, 9, 20, 5);
      slicecorr::Setup plain = s;
      plain.printer.spread = {};
      plain.printer.uv->spread = {};
      const CureModel model = make_cure_model(plain.printer, plain.resin, plain.process, kHsUm);
      std::vector<double> blue_of, uv_of;
      for (int v = 0; v < 256; ++v) {
        blue_of.push_back(model.inhibited()->level_mw_cm2(v));
        uv_of.push_back(model.inhibited()->setting_uv_mw_cm2(0, v));
      }
      for (const Pixel p : {Pixel{0, 0}, Pixel{6, 4}, Pixel{9, 7}}) {
        const auto rows = probe_stack(stack, nullptr, s, p.x, p.y);
        const auto blue = blurred(stack, blue_of, s.printer.spread, p.x, p.y);
        const auto uv = patterned ? blurred(stack, uv_of, s.printer.uv->spread, p.x, p.y)
                                  : std::vector<double>(20, 200.0);
        for (std::size_t n = 0; n < rows.size(); ++n) {
          // Weights below 1e-6 are cut, and amounts of light are single numbers.
          EXPECT_NEAR(rows[n].intensity_mw_cm2, blue[n], 3e-6 * 100);
          const double zeta = static_cast<double>(n), middle = integrated(s, blue, uv, zeta + 0.5),
                       node = integrated(s, blue, uv, zeta + 1e-9);
          EXPECT_NEAR(rows[n].dose_middle, middle, kDoseError * (1 + middle))
              << layerwise << patterned << " " << p.x << " " << n;
          EXPECT_NEAR(rows[n].dose, node, kDoseError * (1 + node));
        }
      }
    }
  }
}

TEST(SpreadUnderUv, EvenLightIsLightThatDoesNotSpread) {
  // Far from the edges of the display what spreads out comes in.
  const slicecorr::Setup s = setup(41, 41);
  slicecorr::Setup plain = s;
  plain.printer.spread = {};
  MemorySlices stack({41, 41, 30, kPitchUm, kPitchUm, kHsUm});
  for (int n = 0; n < 30; ++n) {
    for (int y = 0; y < 41; ++y) {
      for (int x = 0; x < 41; ++x) stack.at(n, x, y) = static_cast<std::uint8_t>(n < 12 ? 60 : 200);
    }
  }
  const auto with = probe_stack(stack, nullptr, s, 20, 20),
             without = probe_stack(stack, nullptr, plain, 20, 20);
  for (std::size_t n = 0; n < with.size(); ++n) {
    EXPECT_NEAR(with[n].dose, without[n].dose, kDoseError);
    EXPECT_NEAR(with[n].intensity_mw_cm2, without[n].intensity_mw_cm2, 1e-3);
  }
}

TEST(SpreadUnderUv, FiguresSectionsAndTimeAgree) {
  const slicecorr::Setup s = setup(17, 11);
  const MemorySlices stack = random_stack(17, 11, 24, 9);
  MemorySlices target({17, 11, 24, kPitchUm, kPitchUm, kHsUm});
  for (int n = 3; n < 20; ++n) {
    for (int y = 3; y < 8; ++y) {
      for (int x = 4; x < 13; ++x) target.at(n, x, y) = n > 9 && n < 13 ? 0 : 255;
    }
  }
  const Prediction p = verify_stack(stack, target, s);
  std::uint64_t through = 0, under = 0;
  for (int y = 0; y < 11; ++y) {
    const Section section = section_of(stack, target, s, y);
    const SectionHistory in_time =
        simulate_section(stack, &target, s, y, {print_clock(s, stack.grid()).total_s()});
    ASSERT_EQ(section.x0, in_time.x0);
    for (int x = 0; x < 17; ++x) {
      const auto rows = probe_stack(stack, &target, s, x, y);
      for (int n = 0; n < 24; ++n) {
        const double dose = rows[static_cast<std::size_t>(n)].dose_middle;
        const bool full = target.at(n, x, y) == 255;
        through += !full && dose >= 1;
        under += full && dose < 1;
        if (x < section.x0 || x >= section.x0 + section.width) continue;
        const auto at = static_cast<std::size_t>(n * section.width + x - section.x0);
        EXPECT_NEAR(static_cast<double>(section.dose[at]), dose, 1e-6 * (1 + dose));
        EXPECT_EQ(in_time.frames[0].gelled[at] != 0, dose >= 1) << x << " " << y << " " << n;
      }
    }
  }
  EXPECT_GT(through, 0U);
  EXPECT_GT(under, 0U);
  EXPECT_EQ(p.cure_through_voxels, through);
  EXPECT_EQ(p.undercure_voxels, under);
  // Of one column against time: at the end what probe says.
  const ColumnHistory history = simulate_column(stack, &target, s, 8, 5, {});
  const auto rows = probe_stack(stack, &target, s, 8, 5);
  ASSERT_FALSE(history.steps.empty());
  double gelled = 0, above = 0;
  for (const GelledInterval& g : history.steps.back().gelled) gelled += g.front_um - g.back_um;
  for (const ProbeRow& row : rows) above += row.dose_middle >= 1 ? kHsUm : 0;
  // Each end of a gelled piece lies within half a layer of where middles say.
  EXPECT_NEAR(gelled, above, kHsUm * static_cast<double>(history.steps.back().gelled.size()));
}

TEST(SpreadUnderUv, TheDeadZoneIsThatOfTheLightThatComes) {
  // A wide wall: in its middle full light and the least dead zone, at its edges half of both.
  const slicecorr::Setup s = setup(41, 41);
  MemorySlices stack({41, 41, 3, kPitchUm, kPitchUm, kHsUm});
  for (int n = 0; n < 3; ++n) {
    for (int y = 0; y < 41; ++y) {
      for (int x = 0; x < 20; ++x) stack.at(n, x, y) = 255;
    }
  }
  const Prediction p = verify_stack(stack, stack, s);
  ASSERT_TRUE(p.dead_zones);
  const Kinetics k = make_kinetics(s.resin, true, true);
  double edge = 0;
  for (int x = 0; x <= 19; ++x) {
    edge += 0.8 * share(x, 40) + 0.2 * share(x, 70);
  }
  EXPECT_NEAR(p.dead_zones->least(), steady_dead_zone_um(k, 100, 200), 0.1);
  // The corner pixels of the wall at the display's edge get half of half the light.
  const double corner = edge * edge;
  EXPECT_GT(p.dead_zones->greatest(), steady_dead_zone_um(k, 100 * edge, 200));
  EXPECT_LT(p.dead_zones->greatest(), steady_dead_zone_um(k, 80 * corner, 200));
  EXPECT_EQ(p.dead_zones->cured_pixels, 0U);
}

/// Walls, an overhang, a channel and a thin wall.
MemorySlices part() {
  MemorySlices t({44, 36, 60, kPitchUm, kPitchUm, kHsUm});
  const auto fill = [&](const PixelBox& box, int first, int past, std::uint8_t value) {
    for (int n = first; n < past; ++n) {
      for (int y = box.y0; y < box.y1; ++y) {
        for (int x = box.x0; x < box.x1; ++x) t.at(n, x, y) = value;
      }
    }
  };
  fill({6, 5, 36, 31}, 0, 56, 255);
  fill({26, 5, 36, 31}, 10, 24, 0);
  fill({18, 5, 23, 31}, 26, 40, 0);
  fill({38, 8, 41, 28}, 0, 50, 255);
  return t;
}

Prediction corrected(const MemorySlices& target, Setup s, int rounds, MemorySlices* stack = nullptr,
                     int threads = 2, std::vector<std::string>* told = nullptr) {
  s.process.spread_rounds = rounds;
  ExecutionContext context;
  context.threads = threads;
  if (told) context.notice = [&](const std::string& text) { told->push_back(text); };
  const CorrectedSlices slices(target, s, context);
  if (stack) *stack = MemorySlices(slices);
  return verify_stack(slices, target, s, context);
}

TEST(CoupledUnderUv, WallsOverhangsAndChannelsPrint) {
  const MemorySlices target = part();
  for (const bool layerwise : {false, true}) {
    slicecorr::Setup s = setup(44, 36, 100);
    s.printer.spread = {{{40, 1}}, std::nullopt};
    if (layerwise) {
      s.process.mode = ExposureMode::layerwise;
      s.process.speed_mm_h = 0;
      s.process.exposure_s = 4;
    }
    const auto wrong = [](const Prediction& p) {
      return p.cure_through_voxels + p.undercure_voxels;
    };
    const Prediction alone = corrected(target, s, 0), together = corrected(target, s, 3);
    RecordProperty(layerwise ? "layerwise_alone" : "alone", std::to_string(wrong(alone)));
    RecordProperty(layerwise ? "layerwise_together" : "together", std::to_string(wrong(together)));
    // Columns alone lose the pixels of all walls, which get a part of their light.
    EXPECT_GT(wrong(alone), 5000U);
    // Layer by layer each layer's light must reach its own edges, which leaves some voxels wrong.
    EXPECT_LE(wrong(together), layerwise ? wrong(alone) / 10 : 0);
    EXPECT_EQ(together.lost_features, 0U);
    EXPECT_LT(together.plane_error_um.mean(), alone.plane_error_um.mean() / 2);
  }
}

TEST(CoupledUnderUv, RoundsNeverMakeItWorseAndThreadsChangeNothing) {
  const MemorySlices target = part();
  const slicecorr::Setup s = setup(44, 36, 100);
  std::vector<std::string> told;
  MemorySlices one(target.grid()), three(target.grid());
  const Prediction p = corrected(target, s, 4, &one, 1, &told);
  corrected(target, s, 4, &three, 3);
  EXPECT_EQ(one, three);
  std::uint64_t before = UINT64_MAX, last = 0;
  int rounds = 0;
  for (const std::string& text : told) {
    unsigned long through = 0, under = 0;
    int round = 0, of = 0;
    if (std::sscanf(text.c_str(), "round %d of %d: %lu voxels of gaps cure, %lu of features",
                    &round, &of, &through, &under) != 4) {
      continue;
    }
    ++rounds;
    last = through + under;
    before = std::min(before, last);
  }
  EXPECT_GE(rounds, 2);
  // What rounds count is what verify counts, of the best of them.
  EXPECT_EQ(p.cure_through_voxels + p.undercure_voxels, before);
}

TEST(CoupledUnderUv, UnderPatternsEachColumnIsCorrectedAlone) {
  const MemorySlices target = part();
  slicecorr::Setup s = setup(44, 36, 100);
  s.printer.uv->patterned = true;
  s.process.uv = {};
  s.process.uv.kind = UvKind::patterned;
  s.process.uv.dead_zone_um = 20;
  std::vector<std::string> told;
  MemorySlices stack(target.grid()), dry(target.grid());
  corrected(target, s, 2, &stack, 2, &told);
  EXPECT_THAT(told, testing::Contains(HasSubstr("UV light is patterned")));
  EXPECT_THAT(told, testing::Contains(HasSubstr("each column is corrected alone")));
  s.printer.spread = {};
  corrected(target, s, 2, &dry);
  ASSERT_EQ(stack.grid().layers, dry.grid().layers);
  for (int n = 0; n < dry.grid().layers; ++n) {
    for (int x = 0; x < 44; ++x) ASSERT_EQ(stack.at(n, x, 17), dry.at(n, x, 17)) << n << " " << x;
  }
}

TEST(CoupledUnderUv, UvLightOfEachSliceLeavesPixelsThatAreChosenTogetherADeadZone) {
  const MemorySlices target = part();
  slicecorr::Setup s = setup(44, 36, 100);
  s.process.uv = {};
  s.process.uv.kind = UvKind::per_slice;
  s.process.uv.dead_zone_um = 20;
  s.process.spread_rounds = 3;
  s.process = schedule_uv(target, s, {});
  const std::vector<double>& uv = s.process.uv.slice_mw_cm2;
  ASSERT_FALSE(uv.empty());
  MemorySlices shown(target.grid());
  const Prediction together = corrected(target, s, 3, &shown), alone = corrected(target, s, 0);
  EXPECT_LT(together.cure_through_voxels + together.undercure_voxels,
            (alone.cure_through_voxels + alone.undercure_voxels) / 3);
  const Inhibition& inhibition = *s.resin.inhibition;
  const double slope = 1 / units::height_e_from_10(inhibition.absorbance_height10_um) -
                       1 / units::height_e_from_10(s.resin.absorbance_height10_um);
  double least = 1e9, most = 0;
  for (int n = 0; n < shown.grid().layers; ++n) {
    double blue = 0;
    for (int y = 0; y < 36; ++y) {
      for (int x = 0; x < 44; ++x) {
        if (shown.at(n, x, y) > 0) {
          blue = std::max(blue, level_intensities(s.printer)[shown.at(n, x, y)]);
        }
      }
    }
    const double its = uv[std::min(static_cast<std::size_t>(n), uv.size() - 1)];
    EXPECT_GE(its * inhibition.beta * (1 + 1e-9), blue * std::exp(20 * slope)) << n;
    least = std::min(least, its);
    most = std::max(most, its);
  }
  EXPECT_LT(least, 0.9 * most);
}

TEST(CoupledUnderUv, WhatDoesNotAddUpIsRefused) {
  const MemorySlices target = part();
  slicecorr::Setup s = setup(44, 36, 100);
  s.resin.scatter_um2_per_um = 1;
  try {
    verify_stack(target, target, s);
    FAIL();
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr("scatter_um2_per_um, and UV light is on"));
  }
}

}  // namespace
}  // namespace slicecorr
