// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Masks of parts for resin flow: what is part, blind and bath; suction slice by slice; the limits of
// a print.
#include "slicecorr/flow_part.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <random>

#include "chapter_iv_resins.hpp"
#include "memory_slices.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/flow_suction.hpp"
#include "slicecorr/pipeline.hpp"

namespace slicecorr {
namespace {

using test::MemorySlices;

constexpr double kPixelUm = 100, kLayerUm = 50;

/// Slices of `size` x `size` pixels, lit where `inside` says (columns, rows and slices).
MemorySlices drawn(int size, int layers, const std::function<bool(int, int, int)>& inside) {
  MemorySlices slices({size, size, layers, kPixelUm, kPixelUm, kLayerUm});
  for (int n = 0; n < layers; ++n) {
    for (int y = 0; y < size; ++y) {
      for (int x = 0; x < size; ++x) slices.at(n, x, y) = inside(x, y, n) ? 255 : 0;
    }
  }
  return slices;
}

bool in_box(int x, int y, int low, int past) {
  return x >= low && x < past && y >= low && y < past;
}

/// Cells as wide as pixels.
FlowPart pixelwise(const SliceSource& slices) { return {slices, {.pitch_um = kPixelUm}}; }

/// The cell of a pixel.
FlowCell cell_at(const FlowPart& part, int slice, int x, int y) {
  const int mask = part.mask_of(slice);
  if (mask < 0) return FlowCell::bath;
  const FlowSection s = part.section(static_cast<std::size_t>(mask));
  const FlowGrid& g = part.grid();
  const int cx = static_cast<int>(std::floor(((x + 0.5) * kPixelUm - g.left_um) / g.pitch_um));
  const int cy = static_cast<int>(std::floor(((y + 0.5) * kPixelUm - g.top_um) / g.pitch_um));
  if (cx < 0 || cy < 0 || cx >= s.width || cy >= s.height) return FlowCell::bath;
  return s.cells[s.index(cx, cy)];
}

TEST(FlowPart, ABlockIsOneMask) {
  const MemorySlices block = drawn(20, 10, [](int x, int y, int) { return in_box(x, y, 4, 16); });
  const FlowPart part = pixelwise(block);
  EXPECT_EQ(part.slices(), 10);
  ASSERT_EQ(part.masks(), 1U);
  for (int n = 0; n < 10; ++n) EXPECT_EQ(part.mask_of(n), 0) << n;
  // 12 cells of part with a ring of bath.
  EXPECT_EQ(part.grid().columns, 14);
  EXPECT_EQ(part.grid().rows, 14);
  EXPECT_EQ(cell_at(part, 3, 4, 4), FlowCell::part);
  EXPECT_EQ(cell_at(part, 3, 3, 4), FlowCell::bath);
  EXPECT_TRUE(part.blind().empty());
  // The image's lower left corner is the plate's: pixel 4 of row 4 lies 15.5 pixels up.
  const auto place = part.grid().place_mm(static_cast<std::size_t>(part.grid().columns) + 1);
  EXPECT_NEAR(place[0], 0.45, 1e-12);
  EXPECT_NEAR(place[1], 1.55, 1e-12);
}

TEST(FlowPart, CoverageAddsUpOverCells) {
  // Three pixels a cell, of which the left column is dark: two thirds are covered.
  const MemorySlices block = drawn(30, 4, [](int x, int y, int) {
    return in_box(x, y, 3, 27) && !(x == 3 && y >= 12 && y < 18);
  });
  const FlowPart part(block, {.pitch_um = 3 * kPixelUm});
  const FlowSection s = part.section(0);
  EXPECT_EQ(s.width, 10);
  EXPECT_NEAR(s.coverage[s.index(1, 4)], 2.0 / 3, 1.0 / 255);
  EXPECT_EQ(s.cells[s.index(1, 4)], FlowCell::part);
  EXPECT_EQ(s.coverage[s.index(2, 4)], 1.0F);
  EXPECT_EQ(s.coverage[s.index(0, 4)], 0.0F);
}

TEST(FlowPart, LevelsCountAboveBlack) {
  MemorySlices dim = drawn(12, 3, [](int x, int y, int) { return in_box(x, y, 2, 10); });
  for (int n = 0; n < 3; ++n) {
    for (int y = 2; y < 10; ++y) {
      for (int x = 2; x < 10; ++x) dim.at(n, x, y) = 1;
    }
  }
  EXPECT_EQ(pixelwise(dim).masks(), 0U);
  const FlowPart light(dim, {.pitch_um = kPixelUm, .pixels = FlowPixels::light});
  EXPECT_EQ(light.masks(), 1U);
}

TEST(FlowPart, AHoleThatRunsToThePlatformIsBlind) {
  const MemorySlices ring =
      drawn(20, 8, [](int x, int y, int) { return in_box(x, y, 2, 18) && !in_box(x, y, 7, 13); });
  const FlowPart part = pixelwise(ring);
  for (const int n : {0, 1, 7}) EXPECT_EQ(cell_at(part, n, 10, 10), FlowCell::blind) << n;
  ASSERT_EQ(part.blind().size(), 1U);
  const BlindVoid& v = part.blind().front();
  EXPECT_EQ(v.first, 0);
  EXPECT_EQ(v.last, 7);
  EXPECT_TRUE(v.from_platform);
  EXPECT_FALSE(v.vented);
  EXPECT_NEAR(v.area_mm2, 36 * 0.01, 1e-12);
  EXPECT_NEAR(v.volume_mm3, 36 * 0.01 * 8 * 0.05, 1e-12);
  EXPECT_NEAR(v.x_mm, 1.0, 1e-12);
  EXPECT_NEAR(v.y_mm, 1.0, 1e-12);
}

TEST(FlowPart, ACupIsBlindUntilAWindowOpensIt) {
  // A cup that opens downwards from slice 3 on, with a slot to the side in slices 8 and 9.
  const MemorySlices cup = drawn(20, 14, [](int x, int y, int n) {
    if (!in_box(x, y, 2, 18)) return false;
    if (n < 3) return true;
    if (in_box(x, y, 7, 13)) return false;
    return !(n >= 8 && n < 10 && y >= 9 && y < 11 && x >= 13);
  });
  const FlowPart part = pixelwise(cup);
  EXPECT_EQ(cell_at(part, 2, 10, 10), FlowCell::part);
  for (const int n : {3, 4, 7}) EXPECT_EQ(cell_at(part, n, 10, 10), FlowCell::blind) << n;
  for (const int n : {8, 9, 10, 13}) EXPECT_EQ(cell_at(part, n, 10, 10), FlowCell::bath) << n;
  ASSERT_EQ(part.blind().size(), 1U);
  EXPECT_EQ(part.blind()[0].first, 3);
  EXPECT_EQ(part.blind()[0].last, 7);
  EXPECT_TRUE(part.blind()[0].vented);
  EXPECT_FALSE(part.blind()[0].from_platform);
  // What closes the slot again has nothing gelled above.
  EXPECT_EQ(cell_at(part, 10, 15, 10), FlowCell::bath);
  EXPECT_EQ(cell_at(part, 11, 15, 10), FlowCell::part);
}

TEST(FlowPart, AHoleUnderTheBathIsVented) {
  // A ring that hangs on a wall beside it: its hole comes from the bath.
  const MemorySlices torus = drawn(24, 10, [](int x, int y, int n) {
    if (x < 3) return y >= 4 && y < 20;
    return n >= 5 && in_box(x, y, 3, 21) && !in_box(x, y, 9, 15);
  });
  const FlowPart part = pixelwise(torus);
  for (const int n : {5, 6, 9}) EXPECT_EQ(cell_at(part, n, 12, 12), FlowCell::bath) << n;
  EXPECT_TRUE(part.blind().empty());
  // The ring's first slice is an overhang.
  EXPECT_EQ(cell_at(part, 5, 6, 6), FlowCell::bath);
  EXPECT_EQ(cell_at(part, 5, 1, 12), FlowCell::part);
  EXPECT_EQ(cell_at(part, 6, 6, 6), FlowCell::part);
}

TEST(FlowPart, ABridgeIsOpenInItsFirstSlice) {
  const MemorySlices bridge = drawn(24, 9, [](int x, int y, int n) {
    if (y < 6 || y >= 18) return false;
    return n >= 6 || x < 5 || x >= 19;
  });
  const FlowPart part = pixelwise(bridge);
  EXPECT_EQ(cell_at(part, 6, 12, 12), FlowCell::bath);
  EXPECT_EQ(cell_at(part, 6, 2, 12), FlowCell::part);
  EXPECT_EQ(cell_at(part, 7, 12, 12), FlowCell::part);
  // Two pillars, their overhang's first slice, the whole: the first two are alike.
  EXPECT_EQ(part.mask_of(5), part.mask_of(6));
  EXPECT_NE(part.mask_of(6), part.mask_of(7));
  EXPECT_TRUE(part.blind().empty());
}

TEST(FlowPart, TheFirstSliceThatClosesABlindVoidBelongsToIt) {
  const MemorySlices hollow = drawn(20, 12, [](int x, int y, int n) {
    return in_box(x, y, 2, 18) && !(n >= 4 && n < 8 && in_box(x, y, 7, 13));
  });
  const FlowPart part = pixelwise(hollow);
  EXPECT_EQ(cell_at(part, 8, 10, 10), FlowCell::blind);
  EXPECT_EQ(cell_at(part, 9, 10, 10), FlowCell::part);
  ASSERT_EQ(part.blind().size(), 1U);
  EXPECT_EQ(part.blind()[0].last, 7);
  EXPECT_FALSE(part.blind()[0].vented);
}

TEST(FlowPart, VoidsThatJoinAreOne) {
  // Two holes from the platform, joined inside in slice 5, and both there from the start.
  const MemorySlices part_of_two = drawn(30, 9, [](int x, int y, int n) {
    if (!in_box(x, y, 2, 28)) return false;
    const bool row = y >= 12 && y < 18;
    if (row && ((x >= 6 && x < 11) || (x >= 19 && x < 24))) return false;
    return !(row && n == 5 && x >= 11 && x < 19);
  });
  const FlowPart part = pixelwise(part_of_two);
  ASSERT_EQ(part.blind().size(), 1U);
  EXPECT_NEAR(part.blind()[0].volume_mm3, (2 * 30 * 9 + 48) * 0.01 * 0.05, 1e-12);
  const FlowSection before = part.section(static_cast<std::size_t>(part.mask_of(4)));
  const FlowSection after = part.section(static_cast<std::size_t>(part.mask_of(7)));
  std::vector<std::int32_t> names_before, names_after;
  for (std::size_t k = 0; k < before.size(); ++k) {
    if (before.cells[k] == FlowCell::blind) names_before.push_back(before.voids[k]);
    if (after.cells[k] == FlowCell::blind) names_after.push_back(after.voids[k]);
  }
  EXPECT_THAT(names_before, testing::Contains(1));
  EXPECT_THAT(names_after, testing::Each(0));
}

TEST(FlowPart, SeveralPartsAreOnePlate) {
  const MemorySlices two = drawn(40, 4, [](int x, int y, int) {
    return in_box(x, y, 2, 14) || (x >= 20 && x < 38 && y >= 20 && y < 38);
  });
  const FlowPart part = pixelwise(two);
  // The wider of the two is the slowest.
  const SlowestSlice slowest = slowest_slice(part);
  const auto place = part.grid().place_mm(slowest.phi.cell);
  EXPECT_NEAR(place[0], 2.9, 0.1);
  EXPECT_NEAR(place[1], 1.1, 0.1);
  // 12 [1/8 - ...] of a square: 0.88406 of its side squared (Timoshenko and Goodier).
  EXPECT_NEAR(slowest.phi.max_phi_um2, 0.88406 * 1800 * 1800, 0.01 * 0.88406 * 1800 * 1800);
}

TEST(FlowPart, DiscsFollowTheClosedForm) {
  for (const double radius_px : {20.0, 33.3}) {
    MemorySlices disc({80, 80, 3, kPixelUm, kPixelUm, kLayerUm});
    // Coverage by 8 x 8 points a pixel.
    for (int y = 0; y < 80; ++y) {
      for (int x = 0; x < 80; ++x) {
        int inside = 0;
        for (int k = 0; k < 64; ++k) {
          const double dx = x + (k % 8 + 0.5) / 8 - 40, dy = y + (k / 8 + 0.5) / 8 - 40;
          inside += dx * dx + dy * dy < radius_px * radius_px ? 1 : 0;
        }
        for (int n = 0; n < 3; ++n) disc.at(n, x, y) = static_cast<std::uint8_t>(255 * inside / 64);
      }
    }
    const FlowPart part(disc, {.pitch_um = 2 * kPixelUm});
    const double radius_um = radius_px * kPixelUm, exact = 3 * radius_um * radius_um;
    const SlowestSlice slowest = slowest_slice(part);
    // Outlines are met to the second order: (pitch/R)² with the factor 1.
    const double share = std::pow(2 * kPixelUm / radius_um, 2);
    EXPECT_NEAR(slowest.phi.max_phi_um2, exact, share * exact) << radius_px;
    EXPECT_NEAR(slowest.phi.integral_um4, flow_shapes::disc_integral_um4(radius_um),
                2 * share * flow_shapes::disc_integral_um4(radius_um));
    FlowPull pull{.viscosity_pa_s = 0.3, .speed_mm_h = 300, .gap_um = 80, .limit_pa = 0.2e5};
    const std::vector<SliceFlow> flow = part_flow(part, pull);
    ASSERT_EQ(flow.size(), 3U);
    // S_max = p h³/(mu 3 R²), in mm/h.
    const double limit_mm_h =
        0.2e5 * std::pow(80e-6, 3) / (0.3 * 3 * std::pow(radius_um * 1e-6, 2)) * 3.6e6;
    EXPECT_NEAR(flow[1].speed_limit_mm_h, limit_mm_h, share * limit_mm_h);
    EXPECT_NEAR(flow[1].x_mm, 4, 0.2);
  }
}

TEST(FlowPart, ABlindHolePullsLikeAFullPart) {
  // §2: a ring with a blind hole has the suction of a full disc outside of the hole.
  const auto disc = [](int x, int y) { return std::hypot(x - 29.5, y - 29.5); };
  const auto max_phi = [&](bool open) {
    const MemorySlices ring = drawn(60, 6, [&](int x, int y, int n) {
      return !(open && n == 0) && disc(x, y) < 27 && disc(x, y) > 9;
    });
    const FlowPart part = pixelwise(ring);
    return mask_phi(part, static_cast<std::size_t>(part.mask_of(5))).max_phi_um2;
  };
  const double a = 900, b = 2700;
  // Outlines of whole pixels: half a pixel off on either side, 2/27 of Phi.
  EXPECT_NEAR(max_phi(false), 3 * (b * b - a * a), 0.08 * 3 * b * b);
  const double open = flow_shapes::ring_phi_um2(a, b, flow_shapes::ring_peak_um(a, b));
  EXPECT_NEAR(max_phi(true), open, 0.12 * open);
}

/// Blobs that grow and shrink at random.
MemorySlices blobs(unsigned seed, int layers = 24) {
  std::mt19937 random(seed);
  struct Blob {
    double x, y, z, r;
  };
  std::vector<Blob> all;
  const auto draw = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(random()) / 4294967295.0;
  };
  for (int i = 0; i < 6; ++i) {
    all.push_back({draw(14, 34), draw(14, 34), draw(0, layers), draw(5, 12)});
  }
  return drawn(48, layers, [all](int x, int y, int n) {
    for (const Blob& b : all) {
      const double d = std::hypot(std::hypot(x - b.x, y - b.y), 0.7 * (n - b.z));
      if (d < b.r && d > 0.45 * b.r) return true;
    }
    return false;
  });
}

TEST(FlowPart, BoundsHold) {
  for (unsigned seed = 1; seed <= 6; ++seed) {
    const MemorySlices slices = blobs(seed);
    const FlowPart part = pixelwise(slices);
    double most = 0;
    int slice = -1;
    for (std::size_t m = 0; m < part.masks(); ++m) {
      const double phi = mask_phi(part, m).max_phi_um2;
      // Cells miss the exact solution by a few percent where pieces are some cells wide.
      EXPECT_LE(phi, 1.05 * phi_bound_um2(part.section(m))) << seed << " " << m;
      if (phi > most) {
        most = phi;
        slice = part.first_slice_of(m);
      }
    }
    const SlowestSlice slowest = slowest_slice(part);
    EXPECT_EQ(slowest.phi.max_phi_um2, most) << seed;
    EXPECT_EQ(slowest.slice, slice) << seed;
    EXPECT_LE(slowest.solved, part.masks());
  }
}

TEST(FlowPart, VoidsAreThoseOfAFloodFromOutside) {
  // What the bath reaches through slices 0..n is what a flood of all dark voxels of these slices
  // reaches from outside, where the platform closes the top.
  for (unsigned seed = 11; seed <= 14; ++seed) {
    const MemorySlices slices = blobs(seed, 16);
    const FlowPart part = pixelwise(slices);
    const int size = 48;
    for (const int n : {3, 9, 15}) {
      std::vector<bool> wet(static_cast<std::size_t>(size * size * (n + 1)), false);
      const auto at = [&](int x, int y, int z) {
        return static_cast<std::size_t>((z * size + y) * size + x);
      };
      std::vector<std::array<int, 3>> open;
      const auto reach = [&](int x, int y, int z) {
        if (x < 0 || y < 0 || z < 0 || x >= size || y >= size || z > n) return;
        if (wet[at(x, y, z)] || slices.at(z, x, y)) return;
        wet[at(x, y, z)] = true;
        open.push_back({x, y, z});
      };
      for (int z = 0; z <= n; ++z) reach(0, 0, z);
      while (!open.empty()) {
        const auto [x, y, z] = open.back();
        open.pop_back();
        for (const int d : {-1, 1}) {
          reach(x + d, y, z);
          reach(x, y + d, z);
          reach(x, y, z + d);
        }
      }
      for (int y = 0; y < size; ++y) {
        for (int x = 0; x < size; ++x) {
          if (slices.at(n, x, y)) continue;
          const bool blind = part.mask_of(n) >= 0 && cell_at(part, n, x, y) == FlowCell::blind;
          if (part.mask_of(n) >= 0) {
            EXPECT_EQ(blind, !wet[at(x, y, n)]) << seed << " " << n << " " << x << " " << y;
          }
        }
      }
    }
  }
}

TEST(FlowPart, ThreadsChangeNothing) {
  const MemorySlices slices = blobs(3, 8);
  const FlowPull pull{.viscosity_pa_s = 0.3,
                      .speed_mm_h = 300,
                      .gap_um = 80,
                      .every = 4,
                      .light = FlowLight{164, 275},
                      .resin = test::chapter_iv_resin2()};
  std::vector<SliceFlow> before;
  for (const int threads : {1, 3}) {
    ExecutionContext context;
    context.threads = threads;
    const FlowPart part(slices, {.pitch_um = 2 * kPixelUm}, context);
    const std::vector<SliceFlow> flow = part_flow(part, pull, context);
    ASSERT_EQ(flow.size(), 3U);
    for (std::size_t i = 0; i < before.size(); ++i) {
      EXPECT_EQ(flow[i].suction_pa, before[i].suction_pa);
      EXPECT_EQ(flow[i].force_n, before[i].force_n);
      ASSERT_EQ(flow[i].dose.has_value(), before[i].dose.has_value());
      if (!flow[i].dose) continue;
      EXPECT_EQ(flow[i].dose->mean, before[i].dose->mean);
      EXPECT_EQ(flow[i].dead_zone_min_um, before[i].dead_zone_min_um);
      EXPECT_EQ(flow[i].dead_zone_max_um, before[i].dead_zone_max_um);
    }
    before = flow;
  }
}

TEST(FlowPart, EveryNthSliceIsThatSlice) {
  const MemorySlices slices = blobs(5);
  const FlowPart part = pixelwise(slices);
  FlowPull pull{.viscosity_pa_s = 0.3, .speed_mm_h = 300, .gap_um = 80};
  const std::vector<SliceFlow> all = part_flow(part, pull);
  pull.every = 7;
  const std::vector<SliceFlow> some = part_flow(part, pull);
  ASSERT_EQ(some.size(), 5U);  // 0, 7, 14, 21 and the last
  for (const SliceFlow& s : some) {
    EXPECT_EQ(s.suction_pa, all[static_cast<std::size_t>(s.slice)].suction_pa);
  }
  EXPECT_EQ(some.back().slice, 23);
}

TEST(FlowPart, RefusesWhatDoesNotFit) {
  const MemorySlices block = drawn(20, 3, [](int x, int y, int) { return in_box(x, y, 4, 16); });
  EXPECT_THROW(FlowPart(block, {.pitch_um = 500}), InputError);
  EXPECT_THROW(FlowPart(block, {.pitch_um = 50}), InputError);
  EXPECT_NO_THROW(FlowPart(block, {.pitch_um = 400}));
  const MemorySlices dark = drawn(8, 2, [](int, int, int) { return false; });
  EXPECT_THROW(FlowPart(dark, {}), InputError);
}

TEST(FlowPart, CellsFollowGapAndPart) {
  const MemorySlices block =
      drawn(100, 2, [](int x, int y, int) { return x < 100 && y >= 20 && y < 70; });
  // 10 mm: 1/64 is 156 um, two pixels.
  EXPECT_EQ(FlowPart(block, {}).grid().pitch_um, 200);
  EXPECT_EQ(FlowPart(block, {.gap_um = 230}).grid().pitch_um, 300);
  EXPECT_EQ(FlowPart(block, {.most_pitch_um = 100, .gap_um = 230}).grid().pitch_um, 100);
}

// ---- the platform ---------------------------------------------------------------------------------

TEST(FlowPlatform, FirstSliceIsThePlatformAlone) {
  const MemorySlices block = drawn(100, 60, [](int x, int y, int) { return in_box(x, y, 40, 60); });
  const FlowPart part(block, {});
  const FlowPull pull{.viscosity_pa_s = 0.3, .speed_mm_h = 300, .gap_um = 80};
  const PlatformFlow flow = platform_flow(part, pull, 20, 10);
  ASSERT_GE(flow.slices.size(), 3U);
  EXPECT_EQ(flow.slices.front().slice, 0);
  // §8: 10 x 20 mm at h 80, 300 mm/h: 6,672.2 Pa; mean 3,349.8 Pa, and so 0.66996 N. 1 % for cells.
  EXPECT_NEAR(flow.slices.front().suction_pa, 6672.2, 67);
  EXPECT_NEAR(flow.slices.front().force_n, 0.66996, 0.0067);
  // It falls from slice to slice, to what the part alone draws and more.
  const double alone = part_flow(part, pull).back().suction_pa;
  double before = std::numeric_limits<double>::infinity();
  for (const PlatformFlow::Slice& s : flow.slices) {
    EXPECT_LT(s.suction_pa, before);
    EXPECT_GT(s.suction_pa, alone);
    before = s.suction_pa;
  }
}

TEST(FlowPlatform, ChangeoverIsThatOfForces) {
  // A square of 2 mm under one of 10 mm: forces go with the fourth power of sides, so the platform's
  // gap is (10/2)^(4/3) of the part's.
  const MemorySlices block =
      drawn(100, 100, [](int x, int y, int) { return in_box(x, y, 40, 60); });
  const FlowPart part = pixelwise(block);
  const FlowPull pull{.viscosity_pa_s = 0.3, .speed_mm_h = 300, .gap_um = 80};
  const PlatformFlow flow = platform_flow(part, pull, 10, 10);
  EXPECT_NEAR(flow.changeover_um, 80 * std::pow(5, 4.0 / 3), 0.01 * 80 * std::pow(5, 4.0 / 3));
  EXPECT_EQ(flow.changeover_slice,
            static_cast<int>(std::ceil((flow.changeover_um - 80) / kLayerUm)));
}

// ---- gap and dead zone ----------------------------------------------------------------------------

TEST(FlowGap, MeanDoseIsThatOfStillResin) {
  Kinetics k = test::chapter_iv_resin2().kinetics;
  // §8: in 80 um still resin has 0.84065 of its dose (signed), so a resin that needs just that has its
  // even gap there; five digits are given.
  k.critical_dose_prime *= 0.84065;
  EXPECT_NEAR(even_gap_um(k, 164, 275, 300), 80, 0.01);
  // The same by Simpson's rule, whose steps of h/512 are far finer than that.
  k.m = 1 + 1e-9;
  EXPECT_NEAR(even_gap_um(k, 164, 275, 300), 80, 0.01);
}

TEST(FlowGap, SectionsAgreeInTheMean) {
  // What is produced leaves through the front, so the mean over any section of whole cells is 1.
  const FlowResin resin = test::chapter_iv_resin2();
  const double gap = even_gap_um(resin.kinetics, 164, 275, 300), blue = 164, uv = 275;
  for (const int rows : {40, 16}) {
    FlowSection s;
    s.width = 42;
    s.height = rows + 2;
    s.pitch_x_um = s.pitch_y_um = 250;
    s.cells.assign(s.size(), FlowCell::bath);
    for (int y = 1; y <= rows; ++y) {
      for (int x = 1; x <= 40; ++x) s.cells[s.index(x, y)] = FlowCell::part;
    }
    const SectionSweep sweep(s, solve_pressure(s), resin, 300, {&gap, 1});
    EXPECT_NEAR(summarise(s, sweep.dose({&blue, 1}, {&uv, 1})).mean, 1, 1e-9) << rows;
  }
}

TEST(FlowGap, RefusesLightsThatLeaveNone) {
  const Kinetics k = test::chapter_iv_resin2().kinetics;
  EXPECT_THROW(even_gap_um(k, 164, 0, 300), InfeasibleError);
  EXPECT_THROW(even_gap_um(k, 164, 164 / k.beta * 0.999, 300), InfeasibleError);
  EXPECT_NO_THROW(even_gap_um(k, 164, 164 / k.beta * 1.001, 300));
  Kinetics without = k;
  without.beta = 0;
  EXPECT_THROW(even_gap_um(without, 164, 275, 300), InfeasibleError);
  EXPECT_EQ(even_gap_um(k, 1, 275, 300), kThickestGapUm);
}

TEST(FlowGap, DeadZoneOfADiscIsTheFixedPoint) {
  // The disc's own march, gaps cut at 300 um: 72, 58, 41, 48 um at r 0.1, 0.25, 0.5, 0.75
  // (docs/flow-chapter-iv.md). Cells of 425 um smear a gap that falls from 300 um to a fifth within
  // some of them.
  const int size = 50;
  std::vector<float> coverage(static_cast<std::size_t>(size * size));
  for (int k = 0; k < size * size * 64; ++k) {
    const int cell = k / 64, in = k % 64;
    const double x = cell % size + (in % 8 + 0.5) / 8 - size / 2.0;
    const double y = cell / size + (in / 8 + 0.5) / 8 - size / 2.0;
    if (std::hypot(x, y) * 425 < 10000) coverage[static_cast<std::size_t>(cell)] += 1.0F / 64;
  }
  const FlowSection s = section_of_coverage(size, size, 425, 425, coverage);
  const DeadZoneRange zone = dead_zone_under(s, test::chapter_iv_resin2(), 300, 80, {164, 275});
  // Least 41 where fronts rest; else the first step, which stops short of it.
  EXPECT_NEAR(zone.min_um, zone.at_rest ? 41 : 57, 8);
  EXPECT_GT(zone.max_um, 72);
}

// ---- prints ---------------------------------------------------------------------------------------

struct PrintCase {
  MemorySlices block = drawn(60, 6, [](int x, int y, int) { return in_box(x, y, 10, 50); });
  Printer printer;
  Resin resin;
  Process process;
  PrintCase() {
    printer.name = "vat";
    printer.calibration = {{0, 0}, {255, 100}};
    resin = parse_resin(
        "name = \"r\"\nviscosity_pa_s = 0.3\n[cure]\nabsorbance_height_um = 408\n"
        "absorbance_base = \"e\"\ncritical_dose_mj_cm3 = 100\n",
        "r.toml");
    process.speed_mm_h = 300;
  }
  std::optional<PrintSuction> suction(double gap_um = 0) const {
    return print_suction(block, printer, resin, process, gap_um);
  }
};

TEST(PrintSuction, AFileWithoutTheKeysHasNone) {
  PrintCase c;
  c.resin.viscosity_pa_s = 0;
  EXPECT_FALSE(c.suction());
  c.resin.viscosity_pa_s = 0.3;
  EXPECT_TRUE(c.suction());
  c.process.mode = ExposureMode::layerwise;
  EXPECT_FALSE(c.suction());
}

TEST(PrintSuction, TellsForceAndWhereResinCavitates) {
  const PrintCase c;
  const auto s = c.suction();
  ASSERT_TRUE(s);
  EXPECT_FALSE(s->limit_given);
  // A square of 4 mm at the default gap: 0.88406 side² (Timoshenko and Goodier).
  const double phi_m2 = 0.88406 * 16e-6, speed_m_s = 300 / 3.6e6;
  const double pa = 0.3 * speed_m_s / std::pow(kDefaultGapUm * 1e-6, 3) * phi_m2;
  EXPECT_NEAR(s->suction_pa, pa, 0.01 * pa);
  EXPECT_NEAR(s->speed_limit_mm_h, 300 * 1e5 / pa, 0.01 * 300 * 1e5 / pa);
  EXPECT_NEAR(s->x_mm, 3, 0.11);
  EXPECT_NEAR(s->y_mm, 3, 0.11);
  EXPECT_NO_THROW(check_suction(*s, c.printer, 1e9));
  EXPECT_THAT(suction_in_words(*s, 300), testing::HasSubstr("1 bar"));
}

TEST(PrintSuction, RefusesWithTheSpeedThatWorks) {
  PrintCase c;
  c.printer.suction_limit_pa = 500;
  c.process.speed_mm_h = 1000;
  const auto s = c.suction();
  ASSERT_TRUE(s);
  EXPECT_LT(s->speed_limit_mm_h, 1000);
  try {
    check_suction(*s, c.printer, 1000);
    FAIL() << "too fast";
  } catch (const InfeasibleError& e) {
    const std::string text = e.what();
    EXPECT_THAT(text, testing::HasSubstr("slice"));
    EXPECT_THAT(text, testing::HasSubstr("vat"));
    const std::string words = "at most ";
    const double works = std::stod(text.substr(text.find(words) + words.size()));
    c.process.speed_mm_h = works;
    EXPECT_NO_THROW(check_suction(*c.suction(), c.printer, works)) << text;
    c.process.speed_mm_h = works * 1.001;
    EXPECT_THROW(check_suction(*c.suction(), c.printer, c.process.speed_mm_h), InfeasibleError);
  }
  // With the third power of the gap, as far as cells agree, which grow with it: the outline of a part
  // of 60 cells and more is met to the second order.
  EXPECT_NEAR(c.suction(160)->speed_limit_mm_h, 8 * c.suction(80)->speed_limit_mm_h,
              0.005 * 8 * c.suction(80)->speed_limit_mm_h);
}

TEST(PrintSuction, GapComesFromWhatIsSaid) {
  PrintCase c;
  EXPECT_EQ(print_gap(c.printer, c.resin, c.process, 0).gap_um, kDefaultGapUm);
  c.process.uv.kind = UvKind::per_slice;
  c.process.uv.dead_zone_um = 50;
  EXPECT_EQ(print_gap(c.printer, c.resin, c.process, 0).gap_um, 50);
  EXPECT_EQ(print_gap(c.printer, c.resin, c.process, 33).gap_um, 33);
}

}  // namespace
}  // namespace slicecorr
