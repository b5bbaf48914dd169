// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Columns that are corrected together where light spreads, in prints that the plain recursion does not
// describe. What is wrong is counted by sums of the test's own, slice by slice and pixel by pixel.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "gel_time_models.hpp"
#include "memory_slices.hpp"
#include "models.hpp"
#include "slicecorr/light_map.hpp"
#include "slicecorr/pipeline.hpp"
#include "uv_models.hpp"

namespace slicecorr {
namespace {

using test::MemorySlices;

constexpr int kWidth = 30, kHeight = 24, kLayers = 40;
constexpr double kPixelUm = 50, kLayerUm = 50, kHeightE = 600;

/// Walls, an overhang, a channel and a thin wall.
MemorySlices part() {
  MemorySlices t({kWidth, kHeight, kLayers, kPixelUm, kPixelUm, kLayerUm});
  const auto fill = [&](const PixelBox& box, int first, int past, std::uint8_t value) {
    for (int n = first; n < past; ++n) {
      for (int y = box.y0; y < box.y1; ++y) {
        for (int x = box.x0; x < box.x1; ++x) t.at(n, x, y) = value;
      }
    }
  };
  fill({4, 4, 22, 20}, 0, 36, 255);
  fill({16, 4, 22, 20}, 8, 17, 0);
  fill({9, 4, 13, 20}, 18, 28, 0);
  fill({25, 6, 28, 18}, 0, 32, 255);
  return t;
}

slicecorr::Setup setup() {
  slicecorr::Setup s;
  s.printer = test::linear_printer(1, 100);
  s.printer.width_px = kWidth;
  s.printer.height_px = kHeight;
  s.printer.spread = {{{40, 1}}, std::nullopt};
  s.resin = test::resin(230, units::height10_from_e(kHeightE));
  s.process = test::process(1200);
  return s;
}

struct Corrected {
  MemorySlices shown;
  Prediction told;
  std::vector<std::string> words;
};

Corrected corrected(const MemorySlices& target, slicecorr::Setup s, int rounds) {
  s.process.spread_rounds = rounds;
  Corrected c{MemorySlices(target.grid()), {}, {}};
  ExecutionContext context;
  context.notice = [&](const std::string& text) { c.words.push_back(text); };
  const CorrectedSlices slices(target, s, context);
  c.shown = MemorySlices(slices);
  c.told = verify_stack(slices, target, s, context);
  return c;
}

std::uint64_t wrong(const Prediction& p) { return p.cure_through_voxels + p.undercure_voxels; }

double share(int x) {
  const double scale = 40 / kPixelUm * std::sqrt(2.0);
  return (std::erf((x + 0.5) / scale) - std::erf((x - 0.5) / scale)) / 2;
}

/// What is wrong by sums over all slices and pixels: the dose in the middle of a layer is that of its
/// half of its own slice and of all slices behind it in the bath, times what comes back from the platform.
std::uint64_t wrong_by_sums(const MemorySlices& target, const MemorySlices& shown,
                            const slicecorr::Setup& s,
                            const std::function<double(int, int, int)>& factor) {
  const double um_s = s.process.speed_mm_h / 3.6;
  const double m = s.resin.m, height_um = kHeightE / m;
  // The areal gel dose, mJ/cm2, or that of another exponent.
  const double dose = m == 1 ? 230 * kHeightE * 1e-4 : s.resin.critical_dose_prime;
  const int all = shown.grid().layers;
  std::vector<double> light(static_cast<std::size_t>(all * kWidth * kHeight));
  const auto at = [&](int n, int x, int y) -> double& {
    return light[static_cast<std::size_t>((n * kHeight + y) * kWidth + x)];
  };
  std::vector<double> shares;
  for (int x = 0; x < kWidth; ++x) shares.push_back(share(x));
  const auto part = [&](int x) { return shares[static_cast<std::size_t>(std::abs(x))]; };
  std::vector<double> across(kWidth * kHeight);
  for (int n = 0; n < all; ++n) {
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        double sum = 0;
        for (int i = 0; i < kWidth; ++i) {
          sum += part(i - x) * factor(n, i, y) * (1 + 99.0 * shown.at(n, i, y) / 255);
        }
        across[static_cast<std::size_t>(y * kWidth + x)] = sum;
      }
    }
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        double sum = 0;
        for (int j = 0; j < kHeight; ++j) {
          sum += part(j - y) * across[static_cast<std::size_t>(j * kWidth + x)];
        }
        at(n, x, y) = std::pow(sum, m);
      }
    }
  }
  std::vector<double> node_um{0};
  const std::vector<double>& heights = s.process.layer_heights_um;
  for (std::size_t n = 0; n < static_cast<std::size_t>(all); ++n) {
    node_um.push_back(node_um.back() +
                      (heights.empty() ? kLayerUm : heights[std::min(n, heights.size() - 1)]));
  }
  const double end_um = s.printer.resin_depth_um > 0 ? s.printer.resin_depth_um : 1e9;
  std::uint64_t count = 0;
  for (int n = 0; n < all; ++n) {
    const auto layer = static_cast<std::size_t>(n);
    const double z_um = (node_um[layer] + node_um[layer + 1]) / 2;
    const double back =
        std::pow(1 + s.printer.platform_reflectance * std::exp(-2 * z_um / kHeightE), m);
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        double sum = 0;
        for (int k = n; k < all; ++k) {
          // The window is at these distances while slice k is shown.
          const auto slice = static_cast<std::size_t>(k);
          const double from = std::max(0.0, node_um[slice] - z_um),
                       to = std::min(node_um[slice + 1] - z_um, end_um);
          if (to <= from) continue;
          sum +=
              at(k, x, y) * height_um * (std::exp(-from / height_um) - std::exp(-to / height_um));
        }
        const double its_dose = sum * back / um_s / dose;
        const bool meant = n < kLayers && target.at(n, x, y) == 255;
        count += (its_dose >= 1) != meant;
      }
    }
  }
  return count;
}

struct Law {
  const char* name;
  std::function<void(slicecorr::Setup&)> change;
  /// Light of a pixel over that of its level; null: no sums are made.
  std::function<double(int, int, int)> factor;
};

std::vector<Law> laws() {
  const auto one = [](int, int, int) { return 1.0; };
  const auto uneven = std::make_shared<std::vector<std::uint8_t>>();
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      uneven->push_back(static_cast<std::uint8_t>(255 - 2 * x - y));
    }
  }
  return {
      {"plain", [](slicecorr::Setup&) {}, one},
      {"the bath ends", [](slicecorr::Setup& s) { s.printer.resin_depth_um = 1000; }, one},
      {"the platform sends light back",
       [](slicecorr::Setup& s) { s.printer.platform_reflectance = 0.4; }, one},
      {"both",
       [](slicecorr::Setup& s) {
         s.printer.resin_depth_um = 1000;
         s.printer.platform_reflectance = 0.4;
       },
       one},
      {"light is uneven",
       [uneven](slicecorr::Setup& s) {
         s.printer.flat_field = FlatField{kWidth, kHeight, uneven, 255, false};
       },
       [uneven](int, int x, int y) {
         return (*uneven)[static_cast<std::size_t>(y * kWidth + x)] / 255.0;
       }},
      {"light is uneven, and m is not 1",
       [uneven](slicecorr::Setup& s) {
         s.printer.flat_field = FlatField{kWidth, kHeight, uneven, 255, false};
         s.resin.model = CureModelKind::kinetic;
         s.resin.m = 0.85;
         s.resin.critical_dose_prime = 8;
       },
       [uneven](int, int x, int y) {
         return (*uneven)[static_cast<std::size_t>(y * kWidth + x)] / 255.0;
       }},
      {"m is not 1, the bath ends, the platform sends light back",
       [](slicecorr::Setup& s) {
         s.resin.model = CureModelKind::kinetic;
         s.resin.m = 0.85;
         s.resin.critical_dose_prime = 8;
         s.printer.resin_depth_um = 1000;
         s.printer.platform_reflectance = 0.4;
       },
       one},
      {"lamps stay",
       [](slicecorr::Setup& s) {
         s.process.slice_speed_mm_h = std::vector<double>(10, 1000);
         s.process.slice_speed_mm_h.resize(25, 1200);
         s.process.slice_speed_mm_h.push_back(900);
         s.process.slice_lamps = SliceLamps::stay;
       },
       [](int n, int, int) { return n < 10   ? 1.2
                                    : n < 25 ? 1.0
                                             : 1200.0 / 900; }},
      {"slices differ in height",
       [](slicecorr::Setup& s) {
         s.process.layer_heights_um = std::vector<double>(12, 40);
         s.process.layer_heights_um.resize(24, 60);
         s.process.layer_heights_um.push_back(45);
       },
       one},
      {"slices differ in height, and the resin bleaches",
       [](slicecorr::Setup& s) {
         s.process.layer_heights_um = std::vector<double>(12, 40);
         s.process.layer_heights_um.resize(24, 60);
         s.process.layer_heights_um.push_back(45);
         s.resin.bleaching = Bleaching{units::height10_from_e(1500), 30};
       },
       nullptr},
      {"a time to gel",
       [](slicecorr::Setup& s) {
         s.resin = test::bright_resin();
         s.process.speed_mm_h = 150;
       },
       nullptr},
      {"a time to gel, and light is uneven",
       [uneven](slicecorr::Setup& s) {
         s.resin = test::bright_resin();
         s.process.speed_mm_h = 150;
         s.printer.flat_field = FlatField{kWidth, kHeight, uneven, 255, false};
       },
       nullptr},
      {"under UV light, and light is uneven",
       [uneven](slicecorr::Setup& s) {
         const Printer window = s.printer;
         s.printer = test::uv::uv_printer();
         s.printer.width_px = kWidth;
         s.printer.height_px = kHeight;
         s.printer.spread = window.spread;
         s.printer.flat_field = FlatField{kWidth, kHeight, uneven, 255, false};
         s.resin = test::uv::resin_1();
         s.process = test::uv::uv_process(60, 200);
       },
       nullptr},
      {"it scatters, and m is not 1",
       [](slicecorr::Setup& s) {
         s.resin.model = CureModelKind::kinetic;
         s.resin.m = 0.85;
         s.resin.critical_dose_prime = 8;
         s.resin.scatter_um2_per_um = 1;
         s.printer.spread = {{{20, 1}}, std::nullopt};
       },
       nullptr},
      {"it scatters, and the bath ends",
       [](slicecorr::Setup& s) {
         s.printer.resin_depth_um = 1000;
         s.resin.scatter_um2_per_um = 1;
         s.printer.spread = {{{20, 1}}, std::nullopt};
       },
       nullptr},
      {"it scatters, m is not 1, the bath ends, light is uneven",
       [uneven](slicecorr::Setup& s) {
         s.printer.flat_field = FlatField{kWidth, kHeight, uneven, 255, false};
         s.resin.model = CureModelKind::kinetic;
         s.resin.m = 0.85;
         s.resin.critical_dose_prime = 8;
         s.resin.scatter_um2_per_um = 0.5;
         s.printer.resin_depth_um = 1000;
         s.printer.spread = {{{30, 1}}, std::nullopt};
       },
       nullptr},
      {"the resin bleaches",
       [](slicecorr::Setup& s) {
         s.resin.bleaching = Bleaching{units::height10_from_e(1500), 30};
       },
       nullptr},
  };
}

TEST(CoupledLaws, ColumnsTogetherAreBetterThanAlone) {
  const MemorySlices target = part();
  for (const Law& law : laws()) {
    slicecorr::Setup s = setup();
    law.change(s);
    const Corrected alone = corrected(target, s, 0), together = corrected(target, s, 8);
    RecordProperty(std::string("alone: ") + law.name, std::to_string(wrong(alone.told)));
    RecordProperty(std::string("together: ") + law.name, std::to_string(wrong(together.told)));
    for (const std::string& text : together.words) {
      EXPECT_EQ(text.find("each column is corrected alone"), std::string::npos) << text;
    }
    EXPECT_LE(wrong(together.told), wrong(alone.told) / 5) << law.name;
    EXPECT_LE(together.told.lost_features, alone.told.lost_features) << law.name;
    if (!law.factor) continue;
    // Doses within 1e-9 of 1 may be told either way; there are none here.
    EXPECT_EQ(wrong(together.told), wrong_by_sums(target, together.shown, s, law.factor))
        << law.name;
    EXPECT_EQ(wrong(alone.told), wrong_by_sums(target, alone.shown, s, law.factor)) << law.name;
  }
}

TEST(CoupledLaws, RoundsCountWhatIsVerifiedForAnyNumberOfThreads) {
  const MemorySlices target = part();
  for (const Law& law : laws()) {
    slicecorr::Setup s = setup();
    law.change(s);
    s.process.spread_rounds = 3;
    std::uint64_t least = UINT64_MAX;
    std::vector<MemorySlices> shown;
    for (const int threads : {1, 3}) {
      ExecutionContext context;
      context.threads = threads;
      context.notice = [&](const std::string& text) {
        unsigned long through = 0, under = 0;
        int round = 0, of = 0;
        if (std::sscanf(text.c_str(), "round %d of %d: %lu voxels of gaps cure, %lu of features",
                        &round, &of, &through, &under) == 4) {
          least = std::min<std::uint64_t>(least, through + under);
        }
      };
      shown.emplace_back(CorrectedSlices(target, s, context));
    }
    EXPECT_EQ(shown[0], shown[1]) << law.name;
    EXPECT_EQ(wrong(verify_stack(shown[0], target, s)), least) << law.name;
  }
}

}  // namespace
}  // namespace slicecorr
