// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Resin that shrinks, and first layers that stand out: keys, slices, predicted surfaces.
#include "slicecorr/shrinkage.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <string>

#include "memory_slices.hpp"
#include "meshes.hpp"
#include "refusal.hpp"
#include "rounds.hpp"
#include "scan_lab.hpp"
#include "slice/inset.hpp"
#include "slicecorr/setup.hpp"
#include "slicecorr/slice.hpp"

namespace slicecorr::test {
namespace {

using detail::half_plane_share;
using detail::Inset;

constexpr const char* kResin =
    "name = \"r\"\n[cure]\nabsorbance_height_um = 600\nabsorbance_base = 10\ncritical_dose_mj_cm3 = 576\n";

/// Refused, with all of these words.
void expect_refusal(const std::function<void()>& f, const std::vector<std::string>& words) {
  const std::string text = test::refusal(f);
  for (const std::string& word : words) EXPECT_THAT(text, testing::HasSubstr(word));
}

Resin resin_with(const std::string& more) { return parse_resin(kResin + more, "r.toml"); }

TEST(Shrinkage, IsReadFromAResinsFileAndKept) {
  EXPECT_FALSE(resin_with("").shrinkage.any());
  const Resin r = resin_with(
      "[shrinkage]\nplane = 0.5\nz = -0.25\n[first_layers]\ngrowth_um = 60\nheight_um = 400\n");
  const Shrinkage wanted{0.5, -0.25, 60, 400};
  EXPECT_EQ(r.shrinkage, wanted);
  EXPECT_DOUBLE_EQ(r.shrinkage.left(0), 0.995);
  EXPECT_DOUBLE_EQ(r.shrinkage.left(2), 1.0025);
  EXPECT_DOUBLE_EQ(r.shrinkage.growth_at_um(0), 60);
  EXPECT_DOUBLE_EQ(r.shrinkage.growth_at_um(100), 45);
  EXPECT_DOUBLE_EQ(r.shrinkage.growth_at_um(500), 0);
  const auto [printer, again] =
      parse_definitions_json(definitions_json(linear_printer(1, 100), r), "a setup");
  EXPECT_EQ(again, r);
  // What grows nowhere has no height.
  EXPECT_FALSE(resin_with("[first_layers]\nheight_um = 400\n").shrinkage.any());
  EXPECT_EQ(resin_with("[first_layers]\nheight_um = 400\n").shrinkage, Shrinkage{});
}

TEST(Shrinkage, WhatSlicesWereMadeForIsTold) {
  slicecorr::Setup setup = lab_setup();
  const auto told = [&](const StackInfo& info) {
    std::string all;
    for (const std::string& text : setup_notices(setup, &info, ChoiceNames::options)) all += text;
    return all;
  };
  StackInfo foreign, target;
  foreign.kind = StackKind::foreign;
  target.kind = StackKind::target;
  EXPECT_THAT(told(foreign), testing::Not(testing::HasSubstr("shrink")));
  EXPECT_THAT(told(target), testing::Not(testing::HasSubstr("shrink")));
  setup.resin.shrinkage = {0.5, 0.3, 60, 500};
  EXPECT_THAT(told(foreign), testing::HasSubstr("elephant's foot should be off"));
  EXPECT_THAT(told(target), testing::HasSubstr("does not shrink; prints are off by as much"));
  target.made_for = setup.resin.shrinkage;
  EXPECT_THAT(told(target), testing::Not(testing::HasSubstr("shrink")));
}

TEST(Shrinkage, BadKeysAreNamed) {
  for (const char* text : {"plane = 21", "plane = -6", "z = \"much\""}) {
    expect_refusal([&] { resin_with("[shrinkage]\n" + std::string(text) + "\n"); },
                   {"r.toml", "shrinkage."});
  }
  for (const char* text : {"growth_um = -1", "growth_um = 2000", "height_um = 0"}) {
    expect_refusal([&] { resin_with("[first_layers]\n" + std::string(text) + "\n"); },
                   {"r.toml", "first_layers."});
  }
}

// A half plane's share of a pixel, against the count of a fine raster's points.
TEST(Inset, ShareOfAHalfPlane) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> even(-1, 1);
  constexpr int kPoints = 400;
  for (int round = 0; round < rounds(20); ++round) {
    const double angle = std::numbers::pi * even(random);
    const Inset pixel{1, 40, 60};
    const double nx = std::cos(angle), ny = std::sin(angle), inside_um = 60 * even(random);
    long in = 0;
    for (int j = 0; j < kPoints; ++j) {
      for (int i = 0; i < kPoints; ++i) {
        const double x = ((i + 0.5) / kPoints - 0.5) * 40, y = ((j + 0.5) / kPoints - 0.5) * 60;
        in += x * nx + y * ny + inside_um > 0;
      }
    }
    // A line passes by at most twice as many points of a side.
    EXPECT_NEAR(half_plane_share(nx, ny, pixel, inside_um),
                static_cast<double>(in) / kPoints / kPoints, 2.0 / kPoints);
  }
}

/// Coverage of a disc or its rest, by 16 x 16 points of each pixel.
std::vector<std::uint8_t> disc(int pixels, double radius_px, bool hole) {
  std::vector<std::uint8_t> out;
  for (int y = 0; y < pixels; ++y) {
    for (int x = 0; x < pixels; ++x) {
      int in = 0;
      for (int k = 0; k < 256; ++k) {
        const double u = x + (k % 16 + 0.5) / 16 - 0.5 * pixels,
                     v = y + (k / 16 + 0.5) / 16 - 0.5 * pixels;
        in += (std::hypot(u, v) < radius_px) != hole;
      }
      out.push_back(static_cast<std::uint8_t>(std::lround(in * 255 / 256.0)));
    }
  }
  return out;
}
double sum_of(const std::vector<std::uint8_t>& pixels) {
  double sum = 0;
  for (const std::uint8_t p : pixels) sum += p / 255.0;
  return sum;
}

TEST(Inset, DiscsGetSmallerAndHolesLarger) {
  // A piece's direction is known to some three degrees, a twentieth of a pixel over one, and two over two pixels.
  for (const double by_px : {0.3, 1.0, 2.6}) {
    const Inset how{50 * by_px, 50, 50};
    const double radius = 14.3, left = radius - by_px;
    EXPECT_NEAR(sum_of(detail::inset(disc(40, radius, false).data(), 40, 40, how)),
                std::numbers::pi * left * left, 0.1 * 2 * std::numbers::pi * left)
        << by_px;
    const double grown = radius + by_px, side = 40 - 2 * by_px;
    EXPECT_NEAR(sum_of(detail::inset(disc(40, radius, true).data(), 40, 40, how)),
                side * side - std::numbers::pi * grown * grown, 0.1 * 2 * std::numbers::pi * grown)
        << by_px;
  }
}

TEST(Inset, StraightWallsAreExact) {
  // A wall of 3.5 pixels, from 4 to 7.5, and one of half a pixel.
  std::vector<std::uint8_t> rows(20 * 12, 0);
  for (int y = 0; y < 12; ++y) {
    for (int x = 4; x < 7; ++x) rows[static_cast<std::size_t>(y * 20 + x)] = 255;
    rows[static_cast<std::size_t>(y * 20 + 7)] = 128;
  }
  const auto left = detail::inset(rows.data(), 20, 12, {60, 50, 50});  // 1.2 pixels
  const auto* middle = left.data() + 6 * 20;
  // From 5.2 to 6.3.
  EXPECT_EQ(middle[4], 0);
  EXPECT_NEAR(middle[5], 0.8 * 255, 1);
  EXPECT_NEAR(middle[6], 0.3 * 255, 2);
  EXPECT_EQ(middle[7], 0);
  // More than half of it: nothing is left.
  EXPECT_EQ(sum_of(detail::inset(rows.data(), 20, 12, {90, 50, 50})), 0);
}

TEST(Inset, SlicesOfAMeshLoseTheirFirstOutlines) {
  Printer printer = linear_printer(1, 100);
  printer.width_px = printer.height_px = 80;
  printer.pixel_x_um = printer.pixel_y_um = 50;
  SliceOptions options;
  options.layer_um = 50;
  options.shrinkage.growth_um = 100;
  options.shrinkage.height_um = 400;
  const MeshSlices slices(box({0, 0, 0}, {2.03, 1.51, 1}), printer, options);
  EXPECT_EQ(slices.frame().made_for, options.shrinkage);
  const MemorySlices all(slices);
  for (int n = 0; n < slices.grid().layers; ++n) {
    double area = 0;
    for (int y = 0; y < 80; ++y) {
      for (int x = 0; x < 80; ++x) area += all.at(n, x, y) / 255.0 * 0.05 * 0.05;
    }
    const double by = 2e-3 * options.shrinkage.growth_at_um((n + 0.5) * 50);
    // Half a level of each of the outline's pixels, and a corner's pixel of each corner.
    EXPECT_NEAR(area, (2.03 - by) * (1.51 - by), 160 * 0.0025 / 510 + 4 * 0.25 * 0.0025) << n;
  }
  // Bands know what lies beside them: in parts it is the same.
  MemorySlices parts(slices.grid());
  for (int y = 0; y < 80; y += 7) {
    const PixelBox band{3, y, 71, std::min(80, y + 7)};
    slices.read_band(band, [&](int n, const std::uint8_t* rows) {
      for (int v = band.y0; rows && v < band.y1; ++v) {
        for (int u = band.x0; u < band.x1; ++u) parts.at(n, u, v) = *rows++;
      }
    });
  }
  EXPECT_EQ(parts, all);
}

/// A block of 2 x 1.5 x 1 mm that full light prints.
MemorySlices block() {
  MemorySlices slices(Grid{60, 50, 20, 50, 50, 50});
  for (int n = 0; n < 20; ++n) {
    for (int y = 10; y < 40; ++y) {
      for (int x = 10; x < 50; ++x) slices.at(n, x, y) = 255;
    }
  }
  return slices;
}

PlaceModels models_with(const Shrinkage& shrinkage, const SliceSource& stack) {
  slicecorr::Setup setup = lab_setup();
  setup.printer.width_px = 60;
  setup.printer.height_px = 50;
  setup.resin.shrinkage = shrinkage;
  return models_of(setup, stack);
}

TEST(Shrinkage, SurfacesShrinkAboutTheirMiddle) {
  const MemorySlices stack = block();
  const SolidReport before = measure_solid(stack, models_with({}, stack));
  const SolidReport after = measure_solid(stack, models_with({1, 2, 0, 500}, stack));
  EXPECT_EQ(after.triangles, before.triangles);
  // Corners are floats: 3 mm to 0.25 nm, and volumes to as much of their area.
  EXPECT_NEAR(after.volume_mm3, before.volume_mm3 * 0.99 * 0.99 * 0.98, 1e-5);
  for (std::size_t k = 0; k < 3; ++k) {
    const double left = k < 2 ? 0.99 : 0.98;
    EXPECT_NEAR(after.upper[k] - after.lower[k], (before.upper[k] - before.lower[k]) * left, 1e-6);
  }
  EXPECT_NEAR(after.lower[0] + after.upper[0], before.lower[0] + before.upper[0], 1e-6);
  EXPECT_EQ(after.lower[2], 0);
}

TEST(Shrinkage, WallsOfFirstLayersStandOut) {
  const MemorySlices stack = block();
  const TriangleMesh plain = solid_mesh(stack, models_with({}, stack));
  const Shrinkage growth{0, 0, 80, 400};
  const TriangleMesh grown = solid_mesh(stack, models_with(growth, stack));
  // Measured from the surface that does not grow, away from its upright edges.
  const MeshDistance distance(plain);
  const detail::PointBox box(plain.vertices);
  int walls = 0;
  double most = 0;
  for (const Point3& p : grown.vertices) {
    const bool along_x = p[0] > box.low[0] + 0.2 && p[0] < box.high[0] - 0.2;
    const bool along_y = p[1] > box.low[1] + 0.2 && p[1] < box.high[1] - 0.2;
    if (along_x == along_y || p[2] > box.high[2] - 0.1 || p[2] < 0.001) continue;
    const double off_um = 1e3 * distance.nearest(p, 1)->signed_mm;
    // Walls lean a little, by less than one in five: the dose inside grows over the first slices.
    const double wanted = growth.growth_at_um(1e3 * p[2]);
    EXPECT_NEAR(off_um, wanted, 0.02 * wanted + 0.01) << p[2];
    most = std::max(most, off_um);
    ++walls;
  }
  EXPECT_GT(walls, 500);
  EXPECT_GT(most, 60);
  // It stays closed: another one with the same triangles.
  const MeshReport report = inspect(grown);
  EXPECT_FALSE(report.defects.open_edges > 0);
  EXPECT_EQ(grown.triangles.size(), plain.triangles.size());
  // Written to a file or measured alone it is the same.
  EXPECT_NEAR(measure_solid(stack, models_with(growth, stack)).upper[0], 1.5 + 1 + 0.08, 0.06);
}

TEST(Shrinkage, IsRefusedWhereItIsNotCounted) {
  Resin r = resin_with("[shrinkage]\nplane = 0.5\n");
  expect_refusal([&] { refuse_shrinkage(r, "tomographic printing"); },
                 {"r", "shrinkage", "tomographic printing"});
  r.shrinkage = {0, 0, 10, 500};
  expect_refusal([&] { refuse_shrinkage(r, "printing by beams"); }, {"first_layers"});
  r.shrinkage = {};
  EXPECT_NO_THROW(refuse_shrinkage(r, "anything"));
}

}  // namespace
}  // namespace slicecorr::test
