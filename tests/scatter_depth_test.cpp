// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Light that scatters, of any exponent m and in a bath that ends. Doses are held against sums over all pixels and
// depths of the test's own.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <random>
#include <vector>

#include "cure/distance_sums.hpp"
#include "memory_slices.hpp"
#include "models.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr {
namespace {

using detail::DistanceBlur;
using detail::DistanceSums;
using detail::kNoEnd;
using detail::ScatterWay;
using test::MemorySlices;

constexpr int kWidth = 26, kHeight = 20, kLayers = 24;
constexpr double kPixelUm = 50, kLayerUm = 50, kHeightE = 300, kDosePrime = 8;

/// A wall that ends, a channel in it, a thin wall, a pin.
MemorySlices part(std::uint8_t grey) {
  MemorySlices t({kWidth, kHeight, kLayers, kPixelUm, kPixelUm, kLayerUm});
  const auto fill = [&](const PixelBox& box, int first, int past, std::uint8_t value) {
    for (int n = first; n < past; ++n) {
      for (int y = box.y0; y < box.y1; ++y) {
        for (int x = box.x0; x < box.x1; ++x) t.at(n, x, y) = value;
      }
    }
  };
  fill({4, 3, 12, 17}, 0, 20, 255);
  fill({6, 3, 9, 17}, 7, 13, 0);
  fill({15, 3, 17, 17}, 2, 24, grey);
  fill({20, 9, 21, 10}, 0, 24, 255);
  return t;
}

struct Case {
  double scatter, m, bath_um, sigma_um;
  ExposureMode mode = ExposureMode::continuous;
};

slicecorr::Setup setup_of(const Case& c) {
  slicecorr::Setup s;
  s.printer = test::linear_printer(1, 100);
  s.printer.width_px = kWidth;
  s.printer.height_px = kHeight;
  s.printer.resin_depth_um = c.bath_um;
  if (c.sigma_um > 0) s.printer.spread = {{{c.sigma_um, 1}}, std::nullopt};
  s.resin = test::resin(230, units::height10_from_e(kHeightE));
  s.resin.scatter_um2_per_um = c.scatter;
  if (c.m != 1) {
    s.resin.model = CureModelKind::kinetic;
    s.resin.m = c.m;
    s.resin.critical_dose_prime = kDosePrime;
  }
  s.process = test::process(600);
  if (c.mode == ExposureMode::layerwise) {
    s.process.mode = c.mode;
    s.process.exposure_s = 2;
  }
  return s;
}

/// Weights of a Gaussian over pixels.
std::vector<double> weights(double variance_um2) {
  std::vector<double> out;
  for (int k = 0; k < std::max(kWidth, kHeight); ++k) {
    if (!(variance_um2 > 0)) {
      out.push_back(k == 0);
      continue;
    }
    const double scale = std::sqrt(2 * variance_um2) / kPixelUm;
    out.push_back((std::erf((k + 0.5) / scale) - std::erf((k - 0.5) / scale)) / 2);
  }
  return out;
}

/// The dose of row `y` in the middle of layer `layer`, step by step of the window's way.
std::vector<double> by_depths(const MemorySlices& shown, const Case& c, int layer, int y) {
  constexpr int kSteps = 8;
  const bool layerwise = c.mode == ExposureMode::layerwise;
  const double seconds_per_um = 3.6 / 600;
  const double dose = c.m == 1 ? 230 * kHeightE * 1e-4 : kDosePrime;
  const double end_um = c.bath_um > 0 ? c.bath_um : 1e9;
  std::vector<double> sum(kWidth, 0.0);
  const auto add = [&](int n, double d_um, double seconds) {
    const std::vector<double> w = weights(c.sigma_um * c.sigma_um + c.scatter * d_um);
    std::vector<double> down(kWidth, 0.0);
    for (int x = 0; x < kWidth; ++x) {
      for (int j = 0; j < kHeight; ++j) {
        down[static_cast<std::size_t>(x)] +=
            w[static_cast<std::size_t>(std::abs(j - y))] * (1 + 99.0 * shown.at(n, x, j) / 255);
      }
    }
    for (int x = 0; x < kWidth; ++x) {
      double light = 0;
      for (int i = 0; i < kWidth; ++i) {
        light += w[static_cast<std::size_t>(std::abs(i - x))] * down[static_cast<std::size_t>(i)];
      }
      sum[static_cast<std::size_t>(x)] +=
          std::pow(light * std::exp(-d_um / kHeightE), c.m) * seconds / dose;
    }
  };
  const double z_um = (layer + 0.5) * kLayerUm;
  for (int n = layer; n < shown.grid().layers; ++n) {
    if (layerwise) {
      const double d_um = (n + 1) * kLayerUm - z_um;
      if (d_um < end_um) add(n, d_um, 2);
      continue;
    }
    const double from = std::max(0.0, n * kLayerUm - z_um),
                 to = std::min((n + 1) * kLayerUm - z_um, end_um);
    if (to <= from) continue;
    const double step = (to - from) / kSteps;
    for (int k = 0; k < kSteps; ++k) add(n, from + (k + 0.5) * step, step * seconds_per_um);
  }
  return sum;
}

/// The greatest difference over the greatest dose, of what is told of `c` to the sums for `by`.
double greatest_difference(const MemorySlices& shown, const Case& c, const Case& by) {
  const slicecorr::Setup s = setup_of(c);
  double most = 0, dose = 0;
  for (const int y : {3, 9}) {
    const Section section = section_of(shown, shown, s, y);
    for (int n = 0; n < kLayers; ++n) {
      const std::vector<double> true_dose = by_depths(shown, by, n, y);
      for (int x = 0; x < section.width; ++x) {
        const double told =
            static_cast<double>(section.dose[static_cast<std::size_t>(n * section.width + x)]);
        const double is = true_dose[static_cast<std::size_t>(x + section.x0)];
        dose = std::max(dose, is);
        most = std::max(most, std::abs(told - is));
      }
    }
  }
  return most / dose;
}

// Distances that share a kernel are off by 2e-3 of a dose at the most where light ends beside a straight edge among
// them (distance_blurs), a thin wall by twice that, a pin, which is thin along both axes, by four times; light that
// goes on spreads alike. What scatters in half a slice is taken for what scatters in all of it: layer by layer that
// is the light of all slices. The middle of a pin of one pixel has w² of its light, w = erf(p / (sqrt(8) sigma)): of
// pixels and slices of 50 um, 1 um² per um and an absorbance height of 300 um, with sigma² of 25 um² less in the
// middle of each layer, the sum of a^j (1 - a) (w(j 50 + 25)² - w(j 50 + 50)²) is 0.019 of the dose.
constexpr double kOff = 8e-3, kOffLayerwise = 2e-2;

TEST(ScatterDepth, DosesAreThoseOfTheDepths) {
  const std::vector<Case> cases = {{1, 1, 0, 0},
                                   {1, 0.85, 0, 0},
                                   {1, 0.85, 0, 40},
                                   {0.5, 1.3, 0, 25},
                                   {1, 1, 600, 0},
                                   {2, 1, 350, 40},
                                   {1, 0.85, 600, 20},
                                   {1, 0.85, 50, 0},
                                   {1, 0.85, 0, 0, ExposureMode::layerwise},
                                   {1, 1, 400, 30, ExposureMode::layerwise}};
  for (const Case& c : cases) {
    const bool layerwise = c.mode == ExposureMode::layerwise;
    const std::string name = fmt::format("{} {} {} {} {}", c.scatter, c.m, c.bath_um, c.sigma_um,
                                         layerwise ? "layer by layer" : "");
    const double most = greatest_difference(part(180), c, c);
    RecordProperty(name, std::to_string(most));
    EXPECT_LE(most, layerwise ? kOffLayerwise : kOff) << name;
  }
}

// So exactly they tell apart what is not the same: less scatter, another exponent, a deeper bath.
TEST(ScatterDepth, OtherDepthsAreOthers) {
  const Case c{1, 0.85, 600, 20};
  for (const Case& other :
       {Case{0.7, 0.85, 600, 20}, Case{1, 0.87, 600, 20}, Case{1, 0.85, 700, 20}}) {
    EXPECT_GT(greatest_difference(part(180), c, other), kOff);
  }
}

TEST(ScatterDepth, AnyNumberOfThreads) {
  slicecorr::Setup s = setup_of({1, 0.85, 600, 20});
  s.process.spread_rounds = 2;
  const MemorySlices target = part(255);
  std::vector<MemorySlices> shown;
  std::vector<std::string> told;
  for (const int threads : {1, 3}) {
    ExecutionContext context;
    context.threads = threads;
    const CorrectedSlices slices(target, s, context);
    shown.emplace_back(slices);
    told.push_back(verify_stack(slices, target, s, context).to_json());
  }
  EXPECT_EQ(shown[0], shown[1]);
  EXPECT_EQ(told[0], told[1]);
}

// What does not scatter, or all but not, is as it is without.
TEST(ScatterDepth, OfNoScatterDosesAreThoseOfTheSlices) {
  for (const Case& c :
       {Case{1e-7, 0.85, 0, 40}, Case{1e-7, 1, 600, 40}, Case{1e-7, 0.85, 600, 0}}) {
    const MemorySlices shown = part(255);
    const slicecorr::Setup s = setup_of(c);
    slicecorr::Setup without = s;
    without.resin.scatter_um2_per_um = 0;
    const Section a = section_of(shown, shown, s, 9), b = section_of(shown, shown, without, 9);
    for (int n = 0; n < kLayers; ++n) {
      for (int x = std::max(a.x0, b.x0); x < std::min(a.x0 + a.width, b.x0 + b.width); ++x) {
        const auto at = [&](const Section& of) {
          return of.dose[static_cast<std::size_t>(n * of.width + x - of.x0)];
        };
        EXPECT_NEAR(at(a), at(b), 1e-5 * std::max(1.0F, at(b))) << n << " " << x;
      }
    }
  }
}

class Sums {
 public:
  Sums(const std::vector<DistanceBlur>& blurs, const PixelBox& window, double m)
      : sums_(blurs, {window, kAll, kAll, kA, m, 1 - kA,
                      [](const DistanceSums::Image* image, const PixelBox& box, double* light) {
                        for (int y = box.y0; y < box.y1; ++y) {
                          for (int x = box.x0; x < box.x1; ++x) {
                            *light++ = image ? shine((*image)[index(x, y)]) : shine(0);
                          }
                        }
                      }}) {}
  static double shine(int value) { return 0.02 + value / 100.0; }
  static std::size_t index(int x, int y) { return static_cast<std::size_t>(y * kSide + x); }
  DistanceSums& operator*() { return sums_; }
  static constexpr int kSide = 12;
  static constexpr PixelBox kAll{0, 0, kSide, kSide};
  static constexpr double kA = 0.8;

 private:
  DistanceSums sums_;
};

/// A black image with a square of any values.
std::shared_ptr<const DistanceSums::Image> any_image(std::mt19937& random) {
  DistanceSums::Image image(Sums::kSide * Sums::kSide);
  const int x0 = static_cast<int>(random() % 8), y0 = static_cast<int>(random() % 8);
  for (int y = y0; y < y0 + 4; ++y) {
    for (int x = x0; x < x0 + 4; ++x) {
      image[Sums::index(x, y)] = static_cast<std::uint8_t>(random() % 256);
    }
  }
  return std::make_shared<const DistanceSums::Image>(std::move(image));
}

/// What slices, the last one first, give the node after the last of them, by sums over all of them.
std::vector<double> over_all(const std::vector<DistanceBlur>& blurs, double m,
                             const std::vector<std::vector<DistanceSums::Lit>>& shown) {
  std::vector<double> sum(Sums::kSide * Sums::kSide, 0.0), in(sum.size()), out(sum.size());
  const auto slices = static_cast<int>(shown.size());
  for (const DistanceBlur& d : blurs) {
    for (int j = std::max(1, d.from); j < std::min(d.to, slices + 1); ++j) {
      for (const DistanceSums::Lit& lit : shown[static_cast<std::size_t>(slices - j)]) {
        for (std::size_t i = 0; i < in.size(); ++i) {
          in[i] = Sums::shine(lit.image ? (*lit.image)[i] : 0);
        }
        d.blur.apply(in.data(), Sums::kAll, out.data(), Sums::kAll);
        for (std::size_t i = 0; i < in.size(); ++i) {
          sum[i] += (1 - Sums::kA) * std::pow(Sums::kA, j - 1) * lit.weight * std::pow(out[i], m);
        }
      }
    }
  }
  return sum;
}

void expect_sums_go_on(const std::vector<DistanceBlur>& blurs, double m, std::mt19937& random) {
  const PixelBox part{3, 2, 9, 7};
  Sums whole(blurs, Sums::kAll, m), some(blurs, part, m);
  std::vector<std::vector<DistanceSums::Lit>> shown;
  for (int k = 0; k < 30; ++k) {
    const std::vector<double> told = (*whole).next(), of_part = (*some).next(),
                              by_sum = over_all(blurs, m, shown);
    for (std::size_t i = 0; i < told.size(); ++i) EXPECT_NEAR(told[i], by_sum[i], 1e-13);
    std::size_t at = 0;
    for (int y = part.y0; y < part.y1; ++y) {
      for (int x = part.x0; x < part.x1; ++x) {
        EXPECT_EQ(of_part[at++], told[Sums::index(x, y)]);
      }
    }
    if (k == 0 || random() % 3 == 0) {
      shown.push_back({{any_image(random), 0.7}});
      if (random() % 4 == 0) shown.back().push_back({any_image(random), 0.2});
    } else if (random() % 4 == 0) {
      shown.push_back({{nullptr, 0.7}});
    } else {
      shown.push_back(random() % 8 == 0 ? std::vector<DistanceSums::Lit>{} : shown.back());
    }
    for (Sums* sums : {&whole, &some}) (**sums).add(shown.back());
  }
}

// The sums that go on from node to node are those over all slices, whatever the window; images come again, some
// are black, some slices show two, or none.
TEST(ScatterDepth, SumsGoOnFromNodeToNode) {
  std::mt19937 random(7);
  for (const int bath : {0, 1, 5, 20}) {
    for (const double scatter : {4.0, 0.2}) {
      const ScatterWay way{scatter, -kLayerUm / std::log(Sums::kA), kLayerUm, false, 50, 40};
      const auto blurs = detail::distance_blurs({}, way, bath);
      for (const double m : {0.85, 1.0}) expect_sums_go_on(blurs, m, random);
    }
  }
}

TEST(ScatterDepth, DistancesFollowEachOtherToTheEnd) {
  for (const int bath : {0, 1, 7, 40}) {
    for (const bool layerwise : {false, true}) {
      for (const double slice_um : {20.0, 50.0}) {
        const auto all = detail::distance_blurs({{{20, 0.7}, {60, 0.3}}, std::nullopt},
                                                {1.5, 400, slice_um, layerwise, 50, 50}, bath);
        ASSERT_FALSE(all.empty());
        EXPECT_EQ(all.front().from, 0);
        EXPECT_EQ(all.front().to, 1);
        EXPECT_EQ(all.back().to, bath > 0 ? bath : kNoEnd);
        EXPECT_LT(all.size(), 32U);
        for (std::size_t k = 1; k < all.size(); ++k) EXPECT_EQ(all[k].from, all[k - 1].to);
        // No light is lost or made.
        for (const DistanceBlur& d : all) {
          const PixelBox box{-40, -40, 41, 41};
          std::vector<double> out(81 * 81);
          const double one = 1;
          d.blur.apply(&one, {0, 0, 1, 1}, out.data(), box);
          double sum = 0;
          for (const double v : out) sum += v;
          EXPECT_NEAR(sum, 1, 1e-5);
        }
      }
    }
  }
  EXPECT_TRUE(detail::distance_blurs({}, {0, 400, 50, false, 50, 50}, 0).empty());
}

}  // namespace
}  // namespace slicecorr
