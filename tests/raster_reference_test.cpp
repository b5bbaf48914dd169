// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The raster against its plain definition, and in every split into bands.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "reference_raster.hpp"
#include "rounds.hpp"
#include "slice/raster.hpp"

namespace slicecorr {
namespace {

using detail::Raster;
using detail::Segment;
using Bytes = std::vector<std::uint8_t>;
using Random = std::mt19937_64;
using Segments = std::vector<Segment>;

struct Box {
  int x0, y0, x1, y1;
  std::size_t pixels() const {
    return static_cast<std::size_t>(x1 - x0) * static_cast<std::size_t>(y1 - y0);
  }
};

Bytes draw(Raster& raster, const Segments& segments, const Box& box) {
  const std::uint8_t* rows = raster.draw(segments);
  return rows ? Bytes(rows, rows + box.pixels()) : Bytes(box.pixels(), 0);
}

Bytes reference(const Segments& segments, const Box& box, bool antialias) {
  test::ReferenceRaster raster(box.x0, box.y0, box.x1, box.y1, antialias);
  for (const Segment& s : segments) raster.add(s);
  Bytes rows(box.pixels());
  raster.draw(rows.data());
  return rows;
}

double uniform(Random& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}

/// A ring around (x, y), wobbling by `wobble` of its radius; negative radii run the other way.
void add_ring(Segments& segments, double x, double y, double radius, int corners, double wobble,
              Random& random, const Box& box) {
  std::vector<std::array<double, 2>> points;
  for (int k = 0; k < corners; ++k) {
    const double angle = 2 * std::numbers::pi * k / corners, r = std::abs(radius);
    const double at = r * (1 + wobble * uniform(random, -1, 1));
    points.push_back({std::clamp(x + at * std::cos(angle), 1.0 * box.x0, 1.0 * box.x1),
                      y + at * std::sin(angle)});
  }
  if (radius < 0) std::reverse(points.begin(), points.end());
  for (std::size_t k = 0; k < points.size(); ++k) {
    const auto &a = points[k], &b = points[(k + 1) % points.size()];
    segments.push_back({a[0], a[1], b[0], b[1]});
  }
}

/// Rings of all sizes that overlap, touch, nest and run both ways, some of them twice.
Segments rings(Random& random, const Box& box, int count) {
  Segments segments;
  for (int i = 0; i < count; ++i) {
    const double radius = std::exp(uniform(random, -2, 4)) * (random() % 4 ? 1 : -1);
    const std::size_t begin = segments.size();
    add_ring(segments, uniform(random, box.x0, box.x1), uniform(random, box.y0, box.y1), radius,
             3 + static_cast<int>(random() % 60), uniform(random, 0, 0.6), random, box);
    if (random() % 6 == 0) {
      const std::size_t end = segments.size();
      for (std::size_t k = begin; k < end; ++k) segments.push_back(segments[k]);
    }
  }
  std::shuffle(segments.begin(), segments.end(), random);
  return segments;
}

/// Coordinates in 1/`steps` of a pixel: ends on pixel borders, horizontal edges, coinciding ones.
void snap(Segments& segments, double steps) {
  for (Segment& s : segments) {
    for (double* v : {&s.ax, &s.ay, &s.bx, &s.by}) *v = std::round(*v * steps) / steps;
  }
}

/// Levels must be the same. On coordinates that are dyadic, areas can lie exactly between two
/// levels, and then rounding decides, here and there: these may differ by one. Returns how many.
std::size_t differences(const Bytes& a, const Bytes& b) {
  std::size_t count = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (a[i] == b[i]) continue;
    ++count;
    EXPECT_EQ(std::abs(a[i] - b[i]), 1) << "pixel " << i;
  }
  return count;
}

constexpr Box kBoxes[] = {{0, 0, 200, 40}, {17, 5, 81, 37}, {1000, 700, 1300, 708}, {3, 0, 5, 9},
                          {0, 0, 64, 16},  {2, 3, 130, 19}, {4000, 90, 4127, 97}};

TEST(RasterReference, RandomRings) {
  Random random(11);
  for (int i = 0; i < test::rounds(400); ++i) {
    const Box& box = kBoxes[static_cast<std::size_t>(i) % std::size(kBoxes)];
    const Segments segments = rings(random, box, 1 + i % 12);
    for (const bool antialias : {true, false}) {
      Raster raster(box.x0, box.y0, box.x1, box.y1, antialias);
      ASSERT_EQ(draw(raster, segments, box), reference(segments, box, antialias))
          << i << (antialias ? " by area" : " by centres");
    }
  }
}

TEST(RasterReference, OnAGrid) {
  Random random(12);
  std::size_t count = 0, pixels = 0;
  for (int i = 0; i < test::rounds(600); ++i) {
    const Box& box = kBoxes[static_cast<std::size_t>(i) % std::size(kBoxes)];
    Segments segments = rings(random, box, 1 + i % 12);
    snap(segments, 1 << (i / 100));
    Raster centres(box.x0, box.y0, box.x1, box.y1, false);
    ASSERT_EQ(draw(centres, segments, box), reference(segments, box, false)) << i;
    pixels += box.pixels();
    Raster areas(box.x0, box.y0, box.x1, box.y1, true);
    count += differences(draw(areas, segments, box), reference(segments, box, true));
    ASSERT_FALSE(HasFailure()) << i;
  }
  RecordProperty("ties", static_cast<int>(count));
  EXPECT_LE(count, pixels / 1000);
}

TEST(RasterReference, EveryHeightOfBandAndEveryOrder) {
  Random random(13);
  const Box box = {40, 16, 300, 80};
  for (int i = 0; i < 20; ++i) {
    Segments segments = rings(random, box, 12);
    if (i % 2) snap(segments, 4);
    for (const bool antialias : {true, false}) {
      Raster whole(box.x0, box.y0, box.x1, box.y1, antialias);
      const Bytes all = draw(whole, segments, box);
      for (const int rows : {1, 2, 3, 5, 8, 13, 32, 64}) {
        std::shuffle(segments.begin(), segments.end(), random);
        Bytes joined;
        for (int y = box.y0; y < box.y1; y += rows) {
          const Box band = {box.x0, y, box.x1, std::min(y + rows, box.y1)};
          Raster raster(band.x0, band.y0, band.x1, band.y1, antialias);
          const Bytes part = draw(raster, segments, band);
          joined.insert(joined.end(), part.begin(), part.end());
        }
        ASSERT_EQ(joined, all) << i << ", bands of " << rows;
      }
    }
  }
}

// What one slice leaves behind must not show in the next.
TEST(RasterReference, SliceAfterSlice) {
  Random random(14);
  const Box box = kBoxes[0];
  for (const bool antialias : {true, false}) {
    Raster raster(box.x0, box.y0, box.x1, box.y1, antialias);
    for (int i = 0; i < 200; ++i) {
      const Segments segments = i % 7 == 6 ? Segments{} : rings(random, box, 1 + i % 5);
      ASSERT_EQ(draw(raster, segments, box), reference(segments, box, antialias)) << i;
    }
  }
}

}  // namespace
}  // namespace slicecorr
