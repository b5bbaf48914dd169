// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Robust corrections where light spreads: what is lost and filled in the cases is found by sums over all
// slices and pixels by the test's own.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "memory_slices.hpp"
#include "models.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/uncertain_print.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::robust_spread {
namespace {

using test::MemorySlices;
using testing::HasSubstr;

constexpr int kWidth = 24, kHeight = 18, kLayers = 48;
constexpr double kPixelUm = 50, kLayerUm = 50, kSigmaUm = 30;

/// Blocks beside each other, of runs and gaps of 2 to 7 layers.
MemorySlices part() {
  MemorySlices t({kWidth, kHeight, kLayers, kPixelUm, kPixelUm, kLayerUm});
  std::mt19937 random(11);
  const auto length = [&] { return 2 + static_cast<int>(random() % 6); };
  for (int y0 = 2; y0 + 6 < kHeight; y0 += 7) {
    for (int x0 = 2; x0 + 6 < kWidth; x0 += 7) {
      int n = static_cast<int>(random() % 4);
      for (bool full = true; n < kLayers - 8; full = !full) {
        const int past = n + length();
        for (; n < past; ++n) {
          for (int y = y0; full && y < y0 + 6; ++y) {
            for (int x = x0; x < x0 + 6; ++x) t.at(n, x, y) = 255;
          }
        }
      }
    }
  }
  return t;
}

slicecorr::Setup setup(bool robust, double share = 0.04) {
  slicecorr::Setup s;
  s.printer = test::linear_printer(1, 100);
  s.printer.width_px = kWidth;
  s.printer.height_px = kHeight;
  s.printer.spread = {{{kSigmaUm, 1}}, std::nullopt};
  s.resin = test::resin(576, 2000);
  s.process = test::process(1000);
  s.process.spread_rounds = 8;
  const std::string text = std::to_string(100 * share);
  s.uncertainty =
      parse_uncertainty("ha=" + text + "%,dc=" + text + "%", ExposureMode::continuous, 100, {});
  s.uncertainty->robust = robust;
  return s;
}

struct Failures {
  std::uint64_t lost = 0, filled = 0;
  std::uint64_t sum() const { return lost + filled; }
};

/// Doses at the nodes of each pixel's column: each slice's light, spread, times what is left of it there.
std::vector<double> node_doses(const MemorySlices& shown, double share) {
  const double height_um = 2000 / std::log(10.0) * std::exp(share);
  const double areal = 576 * 2000 / std::log(10.0) * 1e-4 * std::exp(-share);
  const double um_s = 1000 / 3.6;
  const int all = shown.grid().layers;
  const auto weight = [](int x) {
    const double scale = kSigmaUm / kPixelUm * std::sqrt(2.0);
    return (std::erf((x + 0.5) / scale) - std::erf((x - 0.5) / scale)) / 2;
  };
  std::vector<double> weights;
  for (int x = 0; x < kWidth; ++x) weights.push_back(weight(x));
  const auto w = [&](int x) { return weights[static_cast<std::size_t>(std::abs(x))]; };
  constexpr std::size_t size = kWidth * kHeight;
  std::vector<double> doses(size * static_cast<std::size_t>(all + 1), 0.0);
  const double left = std::exp(-kLayerUm / height_um);
  for (int n = all; n-- > 0;) {
    std::vector<double> across(size);
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        double sum = 0;
        for (int i = 0; i < kWidth; ++i) sum += w(i - x) * (1 + 99.0 * shown.at(n, i, y) / 255);
        across[static_cast<std::size_t>(y * kWidth + x)] = sum;
      }
    }
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        double sum = 0;
        for (int j = 0; j < kHeight; ++j) {
          sum += w(j - y) * across[static_cast<std::size_t>(j * kWidth + x)];
        }
        const auto at = static_cast<std::size_t>(y * kWidth + x);
        const auto here = static_cast<std::size_t>(n) * size + at;
        doses[here] = sum * height_um * (1 - left) / um_s / areal + left * doses[here + size];
      }
    }
  }
  return doses;
}

Failures failures(const MemorySlices& target, const MemorySlices& shown, double share) {
  const std::vector<double> weak = node_doses(shown, -share), strong = node_doses(shown, share);
  Failures f;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const auto at = [&](const std::vector<double>& doses, int node) {
        return doses[static_cast<std::size_t>((node * kHeight + y) * kWidth + x)];
      };
      for (int from = 0, to = 0; from < kLayers; from = to) {
        const bool full = target.at(from, x, y) == 255;
        double most = 0, least = 1e9;
        for (to = from; to < kLayers && (target.at(to, x, y) == 255) == full;) ++to;
        for (int node = from; node <= to; ++node) {
          most = std::max(most, at(weak, node));
          least = std::min(least, at(strong, node));
        }
        if (full) f.lost += most < 1;
        if (!full && to < kLayers) f.filled += least >= 1;
      }
    }
  }
  return f;
}

TEST(RobustSpread, FewerAreLostAndFilledAndThatIsTold) {
  const MemorySlices target = part();
  const test::TemporaryFolder folder;
  const auto corrected = [&](bool robust) {
    return MemorySlices(CorrectedSlices(target, setup(robust), {}, folder.path()));
  };
  const Failures plain = failures(target, corrected(false), 0.04);
  const Correction c = correct_stack(target, setup(true), folder / "s.uvj", {}, ExecutionContext{});
  const Failures robust =
      failures(target, MemorySlices(StackReader(folder / "s.uvj", folder.path())), 0.04);
  RecordProperty("plain", std::to_string(plain.lost) + " lost, " + std::to_string(plain.filled));
  RecordProperty("robust", std::to_string(robust.lost) + " lost, " + std::to_string(robust.filled));
  EXPECT_GT(plain.sum(), 100U);
  EXPECT_LE(robust.sum(), plain.sum() / 4);
  ASSERT_TRUE(c.after.uncertain && c.after.uncertain->robust);
  const RobustFigures& told = *c.after.uncertain->robust;
  EXPECT_EQ(told.lost, robust.lost);
  EXPECT_EQ(told.filled, robust.filled);
  EXPECT_GT(told.moved_edges, 0U);
  EXPECT_NEAR(told.mean_abs_um, c.after.height_error_um.mean(), 1e-9);
  // With inputs as said it prints what it printed without.
  EXPECT_EQ(c.after.lost_features, 0U);
  EXPECT_EQ(c.after.merged_features, 0U);
}

TEST(RobustSpread, AnyNumberOfThreads) {
  const MemorySlices target = part();
  std::vector<MemorySlices> shown;
  for (const int threads : {1, 3}) {
    ExecutionContext context;
    context.threads = threads;
    shown.emplace_back(CorrectedSlices(target, setup(true), context));
  }
  EXPECT_EQ(shown[0], shown[1]);
}

TEST(RobustSpread, WhatCannotBeIsRefused) {
  const MemorySlices target = part();
  const auto refusal = [&](const slicecorr::Setup& s) -> std::string {
    try {
      CorrectedSlices(target, s, {});
    } catch (const InputError& e) {
      return e.what();
    }
    return "";
  };
  slicecorr::Setup s = setup(true);
  s.uncertainty->from_fit = true;
  EXPECT_THAT(refusal(s), HasSubstr("covariance of a fit"));
  s = setup(true);
  s.process.spread_rounds = 0;
  EXPECT_THAT(refusal(s), HasSubstr("corrected alone; expected rounds"));
}

}  // namespace
}  // namespace slicecorr::robust_spread
