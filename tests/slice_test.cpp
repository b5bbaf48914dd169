// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/slice.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "meshes.hpp"
#include "real_files.hpp"
#include "refusal.hpp"
#include "slice/bridges.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr {
namespace {

using test::refusal;

namespace fs = std::filesystem;
using Real = long double;
using std::numbers::pi;
using namespace test;  // NOLINT: meshes and slices of the tests

/// Area in pixels.
double covered(const Bytes& slice) {
  double sum = 0;
  for (const std::uint8_t v : slice) sum += v;
  return sum / 255;
}

/// A level is wrong by half a level at most, and only in pixels that a contour touches.
double rounding_bound(double touched_pixels) { return touched_pixels * 0.5 / 255 + 1e-6; }

/// Most pixels that a convex outline in a box of w x h pixels touches: it crosses each of the at
/// most w + 1 and h + 1 lines of the grid twice, and enters a pixel with every crossing.
double convex_touches(double w, double h) { return 2 * (w + 1) + 2 * (h + 1); }

struct Flat {
  Real x, y;
};

/// Corners of the cut of a convex mesh at a height: its edges' meeting points, by angle.
std::vector<Flat> convex_cut(const TriangleMesh& mesh, double z) {
  std::vector<Flat> points;
  Flat middle{0, 0};
  for (const auto& t : mesh.triangles) {
    for (std::size_t k = 0; k < 3; ++k) {
      const Point3 &a = mesh.vertices[t[k]], &b = mesh.vertices[t[(k + 1) % 3]];
      if (!(a[2] < z && b[2] >= z)) continue;  // every edge is met once this way round
      const Real s = (Real{z} - a[2]) / (Real{b[2]} - a[2]);
      points.push_back({a[0] + s * (Real{b[0]} - a[0]), a[1] + s * (Real{b[1]} - a[1])});
      middle.x += points.back().x;
      middle.y += points.back().y;
    }
  }
  middle.x /= static_cast<Real>(points.size());
  middle.y /= static_cast<Real>(points.size());
  std::sort(points.begin(), points.end(), [&](const Flat& p, const Flat& q) {
    return std::atan2(p.y - middle.y, p.x - middle.x) < std::atan2(q.y - middle.y, q.x - middle.x);
  });
  return points;
}

double polygon_area(const std::vector<Flat>& p) {
  Real twice = 0;
  for (std::size_t i = 0; i < p.size(); ++i) {
    const Flat &a = p[i], &b = p[(i + 1) % p.size()];
    twice += a.x * b.y - a.y * b.x;
  }
  return static_cast<double>(twice / 2);
}

/// The areas of all slices, in pixels, against those that `area_mm2` gives for a height above the
/// platform, for meshes whose cuts are convex.
void expect_convex_areas(const MeshSlices& slices,
                         const std::function<double(double z)>& area_mm2) {
  const Grid& g = slices.grid();
  const double pixel_mm2 = g.pixel_x_um * g.pixel_y_um * 1e-6;
  const PixelBox b = slices.bounds();
  const auto all = read(slices);
  for (std::size_t n = 0; n < all.size(); ++n) {
    const double z = (static_cast<double>(n) + 0.5) * g.layer_um * 1e-3;
    EXPECT_NEAR(covered(all[n]), area_mm2(z) / pixel_mm2,
                rounding_bound(convex_touches(b.width(), b.height())))
        << "slice " << n;
  }
}

// --- Areas of known shapes

TEST(MeshSlices, SphereCutsHaveTheAreaOfThePolyhedronAndNearlyOfTheDisc) {
  const double radius = 3;
  const TriangleMesh mesh = sphere(radius, 4);
  const MeshSlices slices(mesh, printer(160, 150, 50, 50), layer_of(50));
  ASSERT_EQ(slices.grid().layers, 120);
  double low = 0;
  for (const Point3& v : mesh.vertices) low = std::min(low, v[2]);
  expect_convex_areas(slices, [&](double z) { return polygon_area(convex_cut(mesh, z + low)); });

  // The polyhedron lies between its sphere and the one that its faces touch at the nearest.
  double inner = radius;
  for (const auto& [a, b, c] : mesh.triangles) {
    const Point3 &p = mesh.vertices[a], &q = mesh.vertices[b], &r = mesh.vertices[c];
    const double u[3] = {q[0] - p[0], q[1] - p[1], q[2] - p[2]};
    const double v[3] = {r[0] - p[0], r[1] - p[1], r[2] - p[2]};
    const double n[3] = {u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2],
                         u[0] * v[1] - u[1] * v[0]};
    inner =
        std::min(inner, (n[0] * p[0] + n[1] * p[1] + n[2] * p[2]) / std::hypot(n[0], n[1], n[2]));
  }
  ASSERT_GT(inner, 0.99 * radius);
  const auto all = read(slices);
  for (std::size_t n = 0; n < all.size(); ++n) {
    const double z = (static_cast<double>(n) + 0.5) * 0.05 + low;
    const double most = pi * (radius * radius - z * z) / 0.0025;
    const double least = pi * std::max(0.0, inner * inner - z * z) / 0.0025;
    const double rounding = rounding_bound(convex_touches(120, 120));
    EXPECT_LE(covered(all[n]), most + rounding) << n;
    EXPECT_GE(covered(all[n]), least - rounding) << n;
  }
  EXPECT_EQ(slices.report().bridges, 0u);
  EXPECT_EQ(slices.report().turned_triangles, 0u);
}

TEST(MeshSlices, ConeCuts) {
  const double radius = 2.5, height = 4;
  const int corners = 37;
  const MeshSlices slices(cone(radius, height, corners), printer(128, 128, 50, 50), layer_of(40));
  EXPECT_EQ(slices.grid().layers, 100);
  expect_convex_areas(slices, [&](double z) {
    const double r = radius * (1 - z / height);
    return corners / 2.0 * r * r * std::sin(2 * pi / corners);
  });
}

TEST(MeshSlices, CubeTurnedAboutZ) {
  for (const double degrees : {0.0, 5.0, 30.0, 45.0}) {
    const MeshSlices slices(turned(box({-1.3, -1.3, 0}, {1.3, 1.3, 1}), 0, degrees * pi / 180),
                            printer(90, 100, 50, 50), layer_of(100));
    expect_convex_areas(slices, [](double) { return 2.6 * 2.6; });
  }
}

TEST(MeshSlices, CubeOnAnEdgeTurnedAboutZ) {
  const double a = 2.2;
  for (const double degrees : {0.0, 20.0}) {
    const MeshSlices slices(turned(box({0, 0, 0}, {a, a, a}), pi / 4, degrees * pi / 180),
                            printer(100, 100, 50, 50), layer_of(50));
    expect_convex_areas(slices, [&](double z) {
      return a * 2 * std::max(0.0, std::min(z, a * std::sqrt(2.0) - z));
    });
  }
}

TEST(MeshSlices, PixelsNeedNotBeSquare) {
  const MeshSlices slices(cone(2.5, 4, 24), printer(130, 60, 40, 100), layer_of(100));
  expect_convex_areas(slices, [](double z) {
    const double r = 2.5 * (1 - z / 4);
    return 12 * r * r * std::sin(2 * pi / 24);
  });
  // The box of 125.2 x 50 pixels fills columns 2.4 to 127.6 and rows 5 to 55.
  const MeshSlices plain(box({0, 0, 0}, {5.008, 5, 0.1}), printer(130, 60, 40, 100), layer_of(100));
  const Bytes slice = read(plain)[0];
  for (int y = 0; y < 60; ++y) {
    for (int x = 0; x < 130; ++x) {
      int expected = x == 2 || x == 127 ? 153 : 255;  // 0.6 * 255 = 153
      if (y < 5 || y >= 55 || x < 2 || x > 127) expected = 0;
      ASSERT_EQ(slice[static_cast<std::size_t>(y * 130 + x)], expected) << x << ", " << y;
    }
  }
}

// --- Placing

TEST(MeshSlices, LayerCounts) {
  const auto layers = [](double heights_in_layers, double layer_um) {
    const double h = heights_in_layers * layer_um * 1e-3;
    return MeshSlices(box({0, 0, 0}, {1, 1, h}), printer(30, 30, 50, 50), layer_of(layer_um))
        .grid()
        .layers;
  };
  for (const double um : {10.0, 33.3, 50.0, 100.0}) {
    EXPECT_EQ(layers(0.501, um), 1);
    EXPECT_EQ(layers(1, um), 1);
    EXPECT_EQ(layers(1.499, um), 1);
    EXPECT_EQ(layers(1.5, um), 1);  // nothing lies below the cut of a second slice
    EXPECT_EQ(layers(1.501, um), 2);
    EXPECT_EQ(layers(2, um), 2);
    EXPECT_EQ(layers(7.5, um), 7);
    EXPECT_EQ(layers(7.51, um), 8);
    EXPECT_EQ(layers(8.49, um), 8);
    EXPECT_EQ(layers(100, um), 100);
  }
  // What rounding adds does not add a slice: 0.3 mm of 0.1 mm layers at a height of its own.
  const MeshSlices shifted(box({0, 0, 0.1}, {1, 1, 0.1 + 0.25}), printer(30, 30, 50, 50),
                           layer_of(100));
  EXPECT_EQ(shifted.grid().layers, 2);
}

TEST(MeshSlices, EverySliceOfABoxIsFull) {
  for (const double in_layers : {0.6, 1.0, 2.4, 2.5, 2.6, 3.0}) {
    const MeshSlices slices(box({0, 0, 0}, {1, 1, in_layers * 0.05}), printer(20, 20, 50, 50),
                            layer_of(50));
    for (const Bytes& s : read(slices)) EXPECT_EQ(s, Bytes(400, 255)) << in_layers;
  }
}

TEST(MeshSlices, TheLeastZIsPutOnThePlatform) {
  const TriangleMesh part = cone(1, 2, 12);
  const MeshSlices at_zero(part, printer(50, 50, 50, 50), layer_of(50));
  for (const double z : {-7.25, 12.5}) {
    TriangleMesh moved = part;
    for (Point3& v : moved.vertices) v[2] += z;  // exact: multiples of 1/4
    const MeshSlices slices(moved, printer(50, 50, 50, 50), layer_of(50));
    EXPECT_EQ(read(slices), read(at_zero));
  }
  // A vertex that belongs to no triangle places nothing.
  TriangleMesh stray = part;
  stray.vertices.push_back({100, -100, -50});
  EXPECT_EQ(read(MeshSlices(stray, printer(50, 50, 50, 50), layer_of(50))), read(at_zero));
}

TEST(MeshSlices, Row0IsAtTheLargestYAndColumn0AtTheSmallestX) {
  // On a display of 8 x 6 pixels of 1 mm: at the far left two layers, at the near right one.
  const TriangleMesh mesh = box({0, 3, 0}, {1, 4, 2}) + box({3, 0, 0}, {4, 1, 1});
  const MeshSlices slices(mesh, printer(8, 6, 1000, 1000), layer_of(1000));
  std::vector<Bytes> expected(2, Bytes(48, 0));
  expected[0][1 * 8 + 2] = expected[1][1 * 8 + 2] = 255;
  expected[0][4 * 8 + 5] = 255;
  EXPECT_EQ(read(slices), expected);
  const PixelBox b = slices.bounds();
  EXPECT_EQ(b.x0, 2);
  EXPECT_EQ(b.y0, 1);
  EXPECT_EQ(b.x1, 6);
  EXPECT_EQ(b.y1, 5);
}

TEST(MeshSlices, Center) {
  SliceOptions options = layer_of(1000);
  options.center_mm = {{1.5, 1}};
  const TriangleMesh mesh = box({10, 10, 0}, {11, 12, 1});
  Bytes expected(48, 0);  // 8 x 6 pixels of 1 mm; x 1..2, y 0..2: the two lowest rows
  expected[4 * 8 + 1] = expected[5 * 8 + 1] = 255;
  EXPECT_EQ(read(MeshSlices(mesh, printer(8, 6, 1000, 1000), options))[0], expected);
  // Partly covered pixels, too: x 1.25..2.25, y 0.5..2.5.
  options.center_mm = {{1.75, 1.5}};
  const Bytes slice = read(MeshSlices(mesh, printer(8, 6, 1000, 1000), options))[0];
  expected.assign(48, 0);
  expected[3 * 8 + 1] = expected[5 * 8 + 1] = 96;  // 0.75 * 0.5 * 255 = 95.6
  expected[4 * 8 + 1] = 191;                       // 0.75 * 255 = 191.25
  expected[3 * 8 + 2] = expected[5 * 8 + 2] = 32;  // 0.25 * 0.5 * 255 = 31.9
  expected[4 * 8 + 2] = 64;                        // 0.25 * 255 = 63.75
  EXPECT_EQ(slice, expected);
}

TEST(MeshSlices, NothingIsLitOutsideTheBounds) {
  const MeshSlices slices(sphere(1.01, 2), printer(60, 70, 50, 50), layer_of(100));
  const PixelBox b = slices.bounds();
  for (const Bytes& s : read(slices)) {
    for (int y = 0; y < 70; ++y) {
      for (int x = 0; x < 60; ++x) {
        if (s[static_cast<std::size_t>(y * 60 + x)] == 0) continue;
        ASSERT_TRUE(x >= b.x0 && x < b.x1 && y >= b.y0 && y < b.y1) << x << ", " << y;
      }
    }
  }
}

// --- What counts as inside

double share(double a, double b, int p) {
  return std::max(0.0, std::min(b, p + 1.0) - std::max(a, 1.0 * p));
}

struct Rectangle {
  double x0, y0, x1, y1;  // mm from the plate's corner, y upwards
  double in(int column, int row, int rows) const {
    const int y = rows - 1 - row;
    return share(x0, x1, column) * share(y0, y1, y);
  }
  TriangleMesh solid(double height) const { return box({x0, y0, 0}, {x1, y1, height}); }
  Rectangle with(const Rectangle& o) const {
    const Rectangle r = {std::max(x0, o.x0), std::max(y0, o.y0), std::min(x1, o.x1),
                         std::min(y1, o.y1)};
    return r;
  }
};

/// One slice of a mesh on 20 x 16 pixels of 1 mm, the mesh where its coordinates say.
Bytes slice_of(const TriangleMesh& mesh, SliceReport* report = nullptr) {
  const MeshReport r = inspect(mesh);
  SliceOptions options = layer_of(1000);
  options.center_mm = {{(r.lower[0] + r.upper[0]) / 2, (r.lower[1] + r.upper[1]) / 2}};
  const MeshSlices slices(mesh, printer(20, 16, 1000, 1000), options);
  if (report) *report = slices.report();
  return read(slices)[0];
}

/// 255 times the area, where rounding of coordinates can't decide to which level.
void expect_areas(const Bytes& slice, const std::function<double(int x, int y)>& area) {
  for (int y = 0; y < 16; ++y) {
    for (int x = 0; x < 20; ++x) {
      const double value = 255 * area(x, y);
      const int level = slice[static_cast<std::size_t>(y * 20 + x)];
      ASSERT_GE(level, std::floor(value - 1e-9 + 0.5)) << x << ", " << y;
      ASSERT_LE(level, std::floor(value + 1e-9 + 0.5)) << x << ", " << y;
    }
  }
}

TEST(MeshSlices, OverlappingBodiesUnite) {
  std::mt19937_64 random(1);
  const auto rectangle = [&] {
    std::uniform_real_distribution<double> x(0, 20), y(0, 16);
    const double a = x(random), b = x(random), c = y(random), d = y(random);
    return Rectangle{std::min(a, b), std::min(c, d), std::max(a, b), std::max(c, d)};
  };
  for (int i = 0; i < 100 && !testing::Test::HasFatalFailure(); ++i) {
    const Rectangle a = rectangle(), b = rectangle(), both = a.with(b);
    const auto unite = [&](int x, int y) {
      return a.in(x, y, 16) + b.in(x, y, 16) - both.in(x, y, 16);
    };
    expect_areas(slice_of(a.solid(1) + b.solid(1)), unite);
    // Winding -1 is as solid as 1: a body that is inside out as a whole.
    expect_areas(slice_of(inverted(a.solid(1))), [&](int x, int y) { return a.in(x, y, 16); });
    // The same body twice.
    expect_areas(slice_of(a.solid(1) + a.solid(1)), [&](int x, int y) { return a.in(x, y, 16); });
  }
}

TEST(MeshSlices, AnInvertedShellInsideIsACavityAndAnOutwardBodyIsSolid) {
  const Rectangle outer = {1.3, 2.2, 17.7, 13.9}, inner = {4.4, 5.1, 11.25, 9.8};
  const TriangleMesh shell = outer.solid(3);
  TriangleMesh core = box({inner.x0, inner.y0, 1}, {inner.x1, inner.y1, 2});
  SliceOptions options = layer_of(1000);
  options.center_mm = {{9.5, 8.05}};
  const auto all = [&](const TriangleMesh& mesh) {
    return read(MeshSlices(mesh, printer(20, 16, 1000, 1000), options));
  };
  const auto solid = [&](int x, int y) { return outer.in(x, y, 16); };
  const auto hollow = [&](int x, int y) { return outer.in(x, y, 16) - inner.in(x, y, 16); };
  const auto with_cavity = all(shell + inverted(core));
  expect_areas(with_cavity[0], solid);
  expect_areas(with_cavity[1], hollow);
  expect_areas(with_cavity[2], solid);
  const auto nested = all(shell + core);
  for (const Bytes& s : nested) expect_areas(s, solid);
  // A body within the cavity.
  TriangleMesh filling = box({5, 6, 1.2}, {9, 9, 1.8});
  expect_areas(all(shell + inverted(core) + filling)[1], [&](int x, int y) {
    return hollow(x, y) + Rectangle{5, 6, 9, 9}.in(x, y, 16);
  });
}

TEST(MeshSlices, TurnsTrianglesThatFaceTheOtherWay) {
  const TriangleMesh right = box({1.3, 2.2, 0}, {17.7, 13.9, 1});
  for (std::size_t i = 0; i < right.triangles.size(); ++i) {
    TriangleMesh mesh = right;
    std::swap(mesh.triangles[i][0], mesh.triangles[i][1]);
    SliceReport report;
    EXPECT_EQ(slice_of(mesh, &report), slice_of(right)) << i;
    EXPECT_EQ(report.turned_triangles, 1u);
    EXPECT_EQ(report.bridges, 0u);
  }
  SliceReport report;
  slice_of(inverted(right), &report);
  EXPECT_EQ(report.turned_triangles, 0u);
}

// --- Open meshes

TEST(MeshSlices, BridgesAMissingSideTriangle) {
  const TriangleMesh whole = box({1.3, 2.2, 0}, {17.7, 13.9, 4});
  const Rectangle full = {1.3, 2.2, 17.7, 13.9};
  SliceOptions options = layer_of(500);
  options.center_mm = {{9.5, 8.05}};
  for (std::size_t i = 4; i < whole.triangles.size(); ++i) {
    TriangleMesh mesh = whole;
    mesh.triangles.erase(mesh.triangles.begin() + static_cast<std::ptrdiff_t>(i));
    const MeshSlices slices(mesh, printer(20, 16, 1000, 1000), options);
    // The bridge is the very line that is missing.
    for (const Bytes& s : read(slices)) {
      expect_areas(s, [&](int x, int y) { return full.in(x, y, 16); });
    }
    // The lost triangle is widest in the lowest or the highest slice, 1/16 of the height from its
    // side.
    const double side = i < 8 ? 16.4 : 11.7;
    EXPECT_EQ(slices.report().bridges, 8u);
    EXPECT_EQ(slices.report().bridged_slices, 8u);
    EXPECT_NEAR(slices.report().longest_bridge_mm, side * 15 / 16, 1e-9);
    // Bridges are 1/16, 3/16, ... of the side; the sum of the squares is 680 / 256.
    EXPECT_NEAR(slices.report().bridged_volume_mm3,
                std::numbers::pi / 8 * side * side * 680 / 256 * 0.5, 1e-9);
    EXPECT_NEAR(slices.report().volume_mm3, 16.4 * 11.7 * 4, 1e-9);
  }
}

TEST(MeshSlices, BridgesAMissingSide) {
  const TriangleMesh whole = box({1.3, 2.2, 0}, {17.7, 13.9, 4});
  const Rectangle full = {1.3, 2.2, 17.7, 13.9};
  SliceOptions options = layer_of(500);
  options.center_mm = {{9.5, 8.05}};
  for (std::size_t side = 0; side < 6; ++side) {
    TriangleMesh mesh = whole;
    const auto at = mesh.triangles.begin() + static_cast<std::ptrdiff_t>(2 * side);
    mesh.triangles.erase(at, at + 2);
    std::vector<std::string> notices;
    ExecutionContext context;
    context.notice = [&](const std::string& text) { notices.push_back(text); };
    const MeshSlices slices(mesh, printer(20, 16, 1000, 1000), options, context);
    for (const Bytes& s : read(slices)) {
      expect_areas(s, [&](int x, int y) { return full.in(x, y, 16); });
    }
    const SliceReport& r = slices.report();
    if (side < 2) {  // no cut runs along the top or the bottom
      EXPECT_EQ(r.bridges, 0u);
      EXPECT_TRUE(notices.empty());
    } else {
      EXPECT_EQ(r.bridges, 8u);
      EXPECT_EQ(r.bridged_slices, 8u);
      const double width = side < 4 ? 16.4 : 11.7;
      EXPECT_NEAR(r.longest_bridge_mm, width, 1e-9);
      EXPECT_NEAR(r.bridged_volume_mm3, std::numbers::pi / 8 * width * width * 4, 1e-9);
      EXPECT_NEAR(r.volume_mm3, 16.4 * 11.7 * 4, 1e-9);
      ASSERT_EQ(notices.size(), 1u);
      // pi/8 of the square of one side over the product of both: 55 and 28 %.
      EXPECT_NE(
          notices[0].find(side < 4 ? "up to 55 % of the volume depends on them: close the mesh"
                                   : "up to 28 % of the volume depends on them: close the mesh"),
          std::string::npos)
          << notices[0];
      EXPECT_NE(notices[0].find("open contours in 8 slices"), std::string::npos) << notices[0];
    }
  }
}

TEST(MeshSlices, ASphereWithoutSomeOfItsTriangles) {
  const TriangleMesh whole = sphere(2, 4);
  // No edge is longer than this, so no lost cut either. Lost triangles with centres more than 4
  // edges apart are more than 2 edges apart, so the nearest partner of every loose end is that of
  // its own gap, and the bridge is the very line that is missing.
  double edge = 0;
  std::vector<Point3> centres;
  const auto distance = [](const Point3& a, const Point3& b) {
    return std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
  };
  for (const auto& t : whole.triangles) {
    const Point3 &a = whole.vertices[t[0]], &b = whole.vertices[t[1]], &c = whole.vertices[t[2]];
    edge = std::max({edge, distance(a, b), distance(b, c), distance(c, a)});
    centres.push_back(
        {(a[0] + b[0] + c[0]) / 3, (a[1] + b[1] + c[1]) / 3, (a[2] + b[2] + c[2]) / 3});
  }
  TriangleMesh mesh;
  mesh.vertices = whole.vertices;
  std::vector<Point3> lost;
  for (std::size_t i = 0; i < centres.size(); ++i) {
    const bool near = std::any_of(lost.begin(), lost.end(), [&](const Point3& p) {
      return distance(p, centres[i]) <= 4 * edge;
    });
    if (near) {
      mesh.triangles.push_back(whole.triangles[i]);
    } else {
      lost.push_back(centres[i]);
    }
  }
  ASSERT_GT(lost.size(), 20u);
  const auto all = read(MeshSlices(whole, printer(100, 100, 50, 50), layer_of(50)));
  const MeshSlices open(mesh, printer(100, 100, 50, 50), layer_of(50));
  EXPECT_GT(open.report().bridges, 20u);
  EXPECT_LE(open.report().longest_bridge_mm, edge);
  const auto bridged = read(open);
  ASSERT_EQ(all.size(), bridged.size());
  for (std::size_t n = 0; n < all.size(); ++n) {
    for (std::size_t i = 0; i < all[n].size(); ++i) {
      // Sums in another order may round to the other side of a tie.
      ASSERT_NEAR(all[n][i], bridged[n][i], 1) << "slice " << n;
    }
  }
}

TEST(MeshSlices, ASoupOfLooseTrianglesIsSlicedAllTheSame) {
  // Vertices that are not merged: every triangle's cut is open, and its neighbours' ends are at the
  // same place, so every bridge has no length.
  const TriangleMesh whole = sphere(2, 3);
  TriangleMesh soup;
  for (const auto& t : whole.triangles) {
    const auto n = static_cast<std::uint32_t>(soup.vertices.size());
    for (const std::uint32_t v : t) soup.vertices.push_back(whole.vertices[v]);
    soup.triangles.push_back({n, n + 1, n + 2});
  }
  const MeshSlices a(whole, printer(100, 100, 50, 50), layer_of(50));
  const MeshSlices b(soup, printer(100, 100, 50, 50), layer_of(50));
  const auto in_a = read(a), in_b = read(b);
  for (std::size_t n = 0; n < in_a.size(); ++n) {
    EXPECT_NEAR(covered(in_a[n]), covered(in_b[n]), 2 * rounding_bound(convex_touches(80, 80)))
        << n;
  }
  EXPECT_LT(b.report().longest_bridge_mm, 1e-9);
}

// --- The pixel-centre rule

TEST(MeshSlices, WithoutAntialiasingPixelsAreLitByTheirCentre) {
  const TriangleMesh mesh = sphere(1.5, 3);
  const Printer p = printer(80, 70, 50, 50);
  const MeshSlices slices(mesh, p, layer_of(100, false));
  double low[3] = {9, 9, 9}, high[3] = {-9, -9, -9};
  for (const Point3& v : mesh.vertices) {
    for (std::size_t k = 0; k < 3; ++k) {
      low[k] = std::min(low[k], v[k]);
      high[k] = std::max(high[k], v[k]);
    }
  }
  const auto all = read(slices);
  for (std::size_t n = 0; n < all.size(); ++n) {
    const auto cut = convex_cut(mesh, (static_cast<double>(n) + 0.5) * 0.1 + low[2]);
    std::vector<Real> lengths;
    for (std::size_t i = 0; i < cut.size(); ++i) {
      const Flat &a = cut[i], &b = cut[(i + 1) % cut.size()];
      lengths.push_back(std::hypot(b.x - a.x, b.y - a.y));
    }
    for (int y = 0; y < 70; ++y) {
      for (int x = 0; x < 80; ++x) {
        const Real cx = (x + 0.5L) * 0.05L - 2 + (low[0] + high[0]) / 2;
        const Real cy = 1.75L - (y + 0.5L) * 0.05L + (low[1] + high[1]) / 2;
        Real nearest = 1e9L;  // negative outside
        for (std::size_t i = 0; i < cut.size(); ++i) {
          const Flat &a = cut[i], &b = cut[(i + 1) % cut.size()];
          const Real length = lengths[i];
          if (length < 1e-9L) continue;
          nearest =
              std::min(nearest, ((b.x - a.x) * (cy - a.y) - (b.y - a.y) * (cx - a.x)) / length);
        }
        const int level = all[n][static_cast<std::size_t>(y * 80 + x)];
        if (std::abs(nearest) < 1e-9L) continue;  // on the outline
        ASSERT_EQ(level, nearest > 0 ? 255 : 0) << n << ": " << x << ", " << y;
      }
    }
  }
}

// --- Reading bands

TEST(MeshSlices, BytesDoNotDependOnBandsOrCrops) {
  std::mt19937_64 random(6);
  const auto whole = [&](int low, int high) {
    return std::uniform_int_distribution<int>(low, high)(random);
  };
  for (const bool antialias : {true, false}) {
    const MeshSlices slices(messy(), printer(110, 121, 50, 50), layer_of(90, antialias));
    ASSERT_GT(slices.report().bridges, 0u);
    const auto all = read(slices);
    for (int i = 0; i < 60; ++i) {
      PixelBox b;
      b.x0 = i % 3 ? 0 : whole(0, 109);
      b.x1 = i % 3 ? 110 : whole(b.x0 + 1, 110);
      b.y0 = whole(0, 120);
      b.y1 = i % 2 ? b.y0 + 1 : whole(b.y0 + 1, 121);
      if (i == 0) b = slices.bounds();
      if (i == 1) b = {0, 0, 3, 3};  // where nothing is
      const auto part = read(slices, b);
      for (std::size_t n = 0; n < all.size(); ++n) {
        for (int y = b.y0; y < b.y1; ++y) {
          for (int x = b.x0; x < b.x1; ++x) {
            ASSERT_EQ(part[n][static_cast<std::size_t>((y - b.y0) * b.width() + x - b.x0)],
                      all[n][static_cast<std::size_t>(y * 110 + x)])
                << "slice " << n << " at " << x << ", " << y;
          }
        }
      }
    }
  }
}

TEST(MeshSlices, BytesDoNotDependOnThreadsOrMoves) {
  ExecutionContext one, many;
  one.threads = 1;
  many.threads = 4;
  const MeshSlices a(messy(), printer(110, 121, 50, 50), layer_of(90), one);
  MeshSlices b(messy(), printer(110, 121, 50, 50), layer_of(90), many);
  EXPECT_EQ(a.report().bridges, b.report().bridges);
  EXPECT_EQ(a.report().longest_bridge_mm, b.report().longest_bridge_mm);
  const MeshSlices moved(std::move(b));
  EXPECT_EQ(read(a), read(moved));
}

TEST(MeshSlices, SliceRangesAreThoseOfTheBand) {
  for (const bool antialias : {true, false}) {
    const MeshSlices slices(messy(), printer(110, 121, 50, 50), layer_of(90, antialias));
    const int layers = slices.grid().layers;
    const PixelBox band{0, 24, 110, 56};
    const auto all = read(slices, band);
    for (const int size : {1, 5, layers - 1, layers}) {
      int next = 0;
      for (int first = 0; first < layers; first += size) {
        const int past = std::min(first + size, layers);
        slices.read_slices(band, first, past, [&](int n, const std::uint8_t* rows) {
          ASSERT_EQ(n, next++);
          const Bytes& expected = all[static_cast<std::size_t>(n)];
          const Bytes black(expected.size(), 0);
          const std::uint8_t* const is = rows ? rows : black.data();
          ASSERT_TRUE(std::equal(expected.begin(), expected.end(), is)) << "slice " << n;
        });
        ASSERT_EQ(next, past);
      }
    }
  }
}

TEST(MeshSlices, EdgeDefectsThatAreKnownChangeNothing) {
  TriangleMesh mesh = messy();
  std::swap(mesh.triangles[3][0], mesh.triangles[3][1]);
  EdgeDefects edge_defects;
  inspect(mesh, {}, &edge_defects);
  ASSERT_FALSE(edge_defects.flipped.empty());
  ASSERT_FALSE(edge_defects.open.empty());
  const MeshSlices a(mesh, printer(110, 121, 50, 50), layer_of(90));
  const MeshSlices b(mesh, printer(110, 121, 50, 50), layer_of(90), {}, &edge_defects);
  EXPECT_EQ(a.report().turned_triangles, b.report().turned_triangles);
  EXPECT_EQ(a.report().bridges, b.report().bridges);
  EXPECT_EQ(read(a), read(b));
}

// --- What is refused

TEST(MeshSlices, TooLargeNamesTheExcess) {
  const Printer p = printer(100, 80, 50, 50);  // 5 x 4 mm
  const auto refused = [&](const TriangleMesh& mesh, const SliceOptions& options) {
    return refusal([&] { MeshSlices(mesh, p, options); });
  };
  const auto has = [](const std::string& text, const char* part) {
    EXPECT_NE(text.find(part), std::string::npos) << text;
  };
  std::string text = refused(box({0, 0, 0}, {5.5, 3, 1}), layer_of(50));
  has(text, " 0.250 mm in x beyond");
  has(text, "tester");
  EXPECT_EQ(text.find("in y"), std::string::npos) << text;
  text = refused(box({0, 0, 0}, {6, 4.5, 1}), layer_of(50));
  has(text, "0.500 mm in x and 0.250 mm in y");
  SliceOptions options = layer_of(50);
  options.center_mm = {{2.5, 0.5}};
  text = refused(box({0, 0, 0}, {1, 2, 1}), options);
  has(text, "0.500 mm in y");
  EXPECT_EQ(text.find("in x"), std::string::npos) << text;
  // A part as large as the display fits, also when rounding makes it a little larger.
  for (const double more : {0.0, 1e-9, 1e-6}) {
    const MeshSlices slices(box({0, 0, 0}, {5 + more, 4 + more, 0.05}), p, layer_of(50));
    EXPECT_EQ(read(slices)[0], Bytes(8000, 255));
  }
}

TEST(MeshSlices, TooThin) {
  const Printer p = printer(100, 80, 50, 50);
  for (const double height : {0.0, 0.01, 0.0249, 0.025}) {
    const std::string text = refusal([&] {
      MeshSlices(box({0, 0, 0}, {1, 1, height}), p, layer_of(50));
    });
    EXPECT_NE(text.find("thinner than half a layer of 50 um"), std::string::npos) << text;
  }
  EXPECT_NO_THROW(MeshSlices(box({0, 0, 0}, {1, 1, 0.0251}), p, layer_of(50)));
}

TEST(MeshSlices, HigherThanTheStageTravels) {
  Printer p = printer(100, 80, 50, 50);
  p.travel_mm = 2;
  EXPECT_NO_THROW(MeshSlices(box({0, 0, 0.1}, {1, 1, 2.1}), p, layer_of(50)));
  const std::string text = refusal([&] {
    MeshSlices(box({0, 0, 0}, {1, 1, 2.25}), p, layer_of(50));
  });
  EXPECT_NE(text.find("0.250 mm more than the stage"), std::string::npos) << text;
  p.travel_mm = 0;  // not given
  EXPECT_NO_THROW(MeshSlices(box({0, 0, 0}, {1, 1, 2.25}), p, layer_of(50)));
}

TEST(MeshSlices, RefusesWhatIsNoMeshOrNoLayer) {
  const Printer p = printer(100, 80, 50, 50);
  refusal([&] { MeshSlices(TriangleMesh{}, p, layer_of(50)); });
  TriangleMesh beyond = box({0, 0, 0}, {1, 1, 1});
  beyond.triangles[3][1] = 8;
  refusal([&] { MeshSlices(beyond, p, layer_of(50)); });
  for (const double bad :
       {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    for (std::size_t v : {0u, 5u}) {
      for (std::size_t k = 0; k < 3; ++k) {
        TriangleMesh mesh = box({0, 0, 0}, {1, 1, 1});
        mesh.vertices[v][k] = bad;
        refusal([&] { MeshSlices(mesh, p, layer_of(50)); });
      }
    }
    SliceOptions options = layer_of(50);
    options.center_mm = {{bad, 1}};
    refusal([&] { MeshSlices(box({0, 0, 0}, {1, 1, 1}), p, options); });
  }
  for (const double um : {0.0, -50.0, 0.99, 1000.1, std::nan("")}) {
    refusal([&] { MeshSlices(box({0, 0, 0}, {1, 1, 1}), p, layer_of(um)); });
  }
}

TEST(MeshSlices, CanBeCancelled) {
  const std::atomic<bool> cancel = true;
  ExecutionContext context;
  context.cancel = &cancel;
  EXPECT_THROW(MeshSlices(messy(), printer(110, 121, 50, 50), layer_of(90), context), Cancelled);
}

// --- Real meshes

fs::path real_mesh(const std::string& name) { return test::real_file("meshes/" + name); }

/// Signed area of a mesh's cut, straight from its triangles, and the number of pixels the cut
/// touches; `z` in mm of the mesh. Without overlaps that is the covered area.
struct Cut {
  Real area_mm2 = 0;
  std::size_t touched = 0;
};

class Cutter {
 public:
  Cutter(const TriangleMesh& mesh, const MeshReport& report, const Grid& grid)
      : mesh_(mesh), low_(report.lower[2]), grid_(grid) {
    origin_[0] = (report.lower[0] + report.upper[0]) / 2 - grid.width_px * px() / 2;
    origin_[1] = (report.lower[1] + report.upper[1]) / 2 + grid.height_px * py() / 2;
    marks_.resize(static_cast<std::size_t>(grid.width_px) *
                  static_cast<std::size_t>(grid.height_px));
    triangles_of_.resize(static_cast<std::size_t>(grid.layers));
    for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
      const auto& t = mesh.triangles[i];
      const auto [a, b] =
          std::minmax({mesh.vertices[t[0]][2], mesh.vertices[t[1]][2], mesh.vertices[t[2]][2]});
      const double layer = grid.layer_um * 1e-3;
      const int first = std::max(0, static_cast<int>((a - low_) / layer - 0.5) - 1);
      const int last = std::min(grid.layers - 1, static_cast<int>((b - low_) / layer - 0.5) + 1);
      for (int n = first; n <= last; ++n) triangles_of_[static_cast<std::size_t>(n)].push_back(i);
    }
  }
  Cut at(int slice) {
    const Real z = low_ + (slice + 0.5L) * grid_.layer_um * 1e-3L;
    std::fill(marks_.begin(), marks_.end(), std::uint8_t{0});
    Cut cut;
    for (const std::size_t i : triangles_of_[static_cast<std::size_t>(slice)]) {
      const auto& t = mesh_.triangles[i];
      Flat rise{}, fall{};
      int crossings = 0;
      for (std::size_t k = 0; k < 3; ++k) {
        const Point3 &p = mesh_.vertices[t[k]], &q = mesh_.vertices[t[(k + 1) % 3]];
        if ((p[2] >= z) == (q[2] >= z)) continue;
        const Real s = (z - p[2]) / (Real{q[2]} - p[2]);
        const Flat at = {p[0] + s * (Real{q[0]} - p[0]), p[1] + s * (Real{q[1]} - p[1])};
        (q[2] >= z ? rise : fall) = at;
        ++crossings;
      }
      if (crossings != 2) continue;
      // Seen from above, the solid lies to the left of the cut from where the triangle falls to
      // where it rises.
      cut.area_mm2 += (fall.x - Real{origin_[0]}) * (rise.y - Real{origin_[1]}) / 2 -
                      (fall.y - Real{origin_[1]}) * (rise.x - Real{origin_[0]}) / 2;
      mark(fall, rise);
    }
    cut.touched = static_cast<std::size_t>(std::count(marks_.begin(), marks_.end(), 1));
    return cut;
  }

 private:
  double px() const { return grid_.pixel_x_um * 1e-3; }
  double py() const { return grid_.pixel_y_um * 1e-3; }
  void mark(const Flat& a, const Flat& b) {
    constexpr Real near = 1e-6L;
    Real ax = (a.x - origin_[0]) / px(), ay = (origin_[1] - a.y) / py();
    Real bx = (b.x - origin_[0]) / px(), by = (origin_[1] - b.y) / py();
    if (ay > by) {
      std::swap(ax, bx);
      std::swap(ay, by);
    }
    const int first = std::max(0, static_cast<int>(std::floor(ay - near)));
    const int last = std::min(grid_.height_px - 1, static_cast<int>(std::floor(by + near)));
    for (int row = first; row <= last; ++row) {
      const Real from = std::clamp(Real(row), ay, by), to = std::clamp(Real(row + 1), ay, by);
      const Real slope = by > ay ? (bx - ax) / (by - ay) : 0;
      const Real xa = by > ay ? ax + (from - ay) * slope : ax;
      const Real xb = by > ay ? ax + (to - ay) * slope : bx;
      const int left = std::max(0, static_cast<int>(std::floor(std::min(xa, xb) - near)));
      const int right =
          std::min(grid_.width_px - 1, static_cast<int>(std::floor(std::max(xa, xb) + near)));
      for (int x = left; x <= right; ++x) {
        marks_[static_cast<std::size_t>(row) * static_cast<std::size_t>(grid_.width_px) +
               static_cast<std::size_t>(x)] = 1;
      }
    }
  }

  const TriangleMesh& mesh_;
  double low_;
  Grid grid_;
  Real origin_[2];
  Bytes marks_;
  std::vector<std::vector<std::size_t>> triangles_of_;
};

TEST(MeshSlices, TheCutterOfTheTestsItself) {
  const TriangleMesh mesh = cone(2.5, 4, 24);
  const Grid grid = {130, 130, 40, 50, 50, 100};
  Cutter cutter(mesh, inspect(mesh), grid);
  for (const int n : {0, 17, 39}) {
    const double r = 2.5 * (1 - (n + 0.5) * 0.1 / 4);
    EXPECT_NEAR(static_cast<double>(cutter.at(n).area_mm2), 12 * r * r * std::sin(2 * pi / 24),
                1e-12);
    EXPECT_LE(static_cast<double>(cutter.at(n).touched),
              convex_touches(2 * r / 0.05, 2 * r / 0.05));
  }
}

void scale_to(TriangleMesh& mesh, double largest_side_mm) {
  const MeshReport r = inspect(mesh);
  double side = 0;
  for (std::size_t k = 0; k < 3; ++k) side = std::max(side, r.upper[k] - r.lower[k]);
  if (!(side > 0)) return;
  for (Point3& v : mesh.vertices) {
    for (double& c : v) c *= largest_side_mm / side;
  }
}

/// Area of the shadows of all triangles on the platform.
double shadow(const TriangleMesh& mesh) {
  double sum = 0;
  for (const auto& [a, b, c] : mesh.triangles) {
    const Point3 &p = mesh.vertices[a], &q = mesh.vertices[b], &r = mesh.vertices[c];
    sum += std::abs((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])) / 2;
  }
  return sum;
}

std::string test_name(const testing::TestParamInfo<std::string>& info) {
  return test::name_of(info.param);
}

class CleanMesh : public testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Data, CleanMesh,
                         testing::Values("3DBenchy.3mf", "3DBenchy.stl", "UVtools_demo_file.3mf",
                                         "UVtools_demo_file.stl", "benchy_plate_x5_1.1M.ply.gz",
                                         "cgal_femur.off", "cgal_turbine.off", "ksr_fdmtest_v4.stl",
                                         "photonic3d_lenscap-36mm.stl",
                                         "stanford_bunny_7k_closed.off", "tpms_diamond_51.stl"),
                         test_name);

TEST_P(CleanMesh, HasTheVolumeOfItsSlices) {
  const fs::path file = real_mesh("clean/" + GetParam());
  SLICECORR_NEEDS_FILE(file.string());
  TriangleMesh mesh = read_mesh(file.string());
  scale_to(mesh, 20);
  const double layer_mm = 0.1, pixel_mm2 = 0.0025;
  const MeshSlices slices(mesh, printer(410, 410, 50, 50), layer_of(100));
  EXPECT_EQ(slices.report().bridges, 0u);
  EXPECT_EQ(slices.report().turned_triangles, 0u);
  const MeshReport report = inspect(mesh);
  Cutter cutter(mesh, report, slices.grid());
  double volume = 0, rounding = 0;
  slices.read_band({0, 0, 410, 410}, [&](int n, const std::uint8_t* rows) {
    const double area = rows ? covered(Bytes(rows, rows + 410 * 410)) : 0;
    volume += area * pixel_mm2 * layer_mm;
    const Cut cut = cutter.at(n);
    const double bound = rounding_bound(static_cast<double>(cut.touched));
    rounding += bound * pixel_mm2 * layer_mm;
    // None of these meshes has bodies that overlap: they would count twice here.
    EXPECT_NEAR(area, static_cast<double>(cut.area_mm2) / pixel_mm2, bound) << "slice " << n;
  });
  // The area at a height and at mid-layer differ by the shadow of the surface between them at most,
  // and a piece of surface lies between mid-layer and the heights of half its layer: together
  // that is half a layer times the shadow of all. What the slices leave out above the last one,
  // less than half a layer, has its shadow there, too.
  const double bound = 0.5 * layer_mm * shadow(mesh) + rounding;
  EXPECT_NEAR(volume, report.volume, bound);
}

/// What becomes of a damaged mesh: a reason to refuse it, or how many gaps of outlines are bridged
/// and how many triangles turned.
struct Dirty {
  const char* file;
  const char* refused;
  std::uint64_t bridges, turned;
};
void PrintTo(const Dirty& d, std::ostream* out) { *out << d.file; }

class DirtyMesh : public testing::TestWithParam<Dirty> {};
INSTANTIATE_TEST_SUITE_P(
    Data, DirtyMesh,
    testing::Values(Dirty{"admesh_block_fill-holes-bad.stl", nullptr, 0, 0},
                    Dirty{"admesh_block_normal-directions-bad.stl", nullptr, 0, 1},
                    Dirty{"admesh_hourglass_normal-directions-bad.stl", nullptr, 0, 0},
                    Dirty{"assimp_3DSMaxExport.STL", nullptr, 8, 0},
                    Dirty{"assimp_malformed.obj", "vertex index", 0, 0},
                    Dirty{"assimp_sphereWithHole.stl", nullptr, 16, 0},
                    Dirty{"assimp_triangle_with_two_solids.stl", "thinner than half a layer", 0, 0},
                    Dirty{"cgal_blobby-shuffled.off", nullptr, 0, 2017},
                    Dirty{"cgal_elephant-with-holes.off", nullptr, 1471, 0},
                    Dirty{"draco_bunny_open_base.stl", nullptr, 40, 0},
                    Dirty{"manifold_self_intersectA.obj", nullptr, 0, 0},
                    Dirty{"prusa_20mmbox-CR.stl", nullptr, 0, 0},
                    Dirty{"prusa_20mmbox-CRLF.stl", nullptr, 0, 0},
                    Dirty{"pymfcad_microfluidic_void_channels.stl", nullptr, 0, 0},
                    Dirty{"trimesh_cycloidal_touching_bodies.ply", nullptr, 0, 0},
                    Dirty{"trimesh_multibody.stl", nullptr, 0, 6},
                    Dirty{"trimesh_soup.stl", nullptr, 9948, 0},
                    Dirty{"trimesh_stl_empty_ascii.stl", "holds no triangles", 0, 0},
                    Dirty{"trimesh_stl_empty_bin.stl", "holds no triangles", 0, 0},
                    Dirty{"trimesh_wallhole.obj", nullptr, 0, 0}),
    [](const auto& info) { return test::name_of(info.param.file); });

TEST_P(DirtyMesh, IsSlicedOrRefusedWithAReason) {
  const Dirty& d = GetParam();
  const std::string path = real_mesh(std::string("dirty/") + d.file).string();
  SLICECORR_NEEDS_FILE(path);
  if (d.refused) {
    try {
      TriangleMesh mesh = read_mesh(path);
      scale_to(mesh, 20);
      const MeshSlices slices(mesh, printer(410, 410, 50, 50), layer_of(100));
      ADD_FAILURE() << "was sliced";
    } catch (const InputError& e) {
      EXPECT_THAT(e.what(), testing::HasSubstr(d.refused));
    }
    return;
  }
  TriangleMesh mesh = read_mesh(path);
  scale_to(mesh, 20);
  const MeshSlices slices(mesh, printer(410, 410, 50, 50), layer_of(100));
  EXPECT_EQ(slices.report().bridges, d.bridges);
  EXPECT_EQ(slices.report().turned_triangles, d.turned);
  // Nothing is lit beyond the mesh's box; and where no outline had to be closed, every slice that the
  // surface goes through in more than a few pixels shows something.
  const PixelBox b = slices.bounds();
  const MeshReport report = inspect(mesh);
  Cutter cutter(mesh, report, slices.grid());
  slices.read_band({0, 0, 410, 410}, [&](int n, const std::uint8_t* rows) {
    const double lit = rows ? covered(Bytes(rows, rows + 410 * 410)) : 0;
    EXPECT_LE(lit, b.width() * b.height());
    if (d.bridges == 0 && cutter.at(n).touched > 100) {
      EXPECT_GT(lit, 0) << "slice " << n;
    }
    if (rows) {
      for (int i = 0; i < 410 * 410; ++i) {
        const int x = i % 410, y = i / 410;
        if (x < b.x0 || x >= b.x1 || y < b.y0 || y >= b.y1) {
          ASSERT_EQ(rows[i], 0) << "slice " << n << " at " << x << ", " << y;
        }
      }
    }
  });
}

// A cube that lacks one of its triangles, one whose triangles face both ways and plain ones.
TEST(MeshSlices, RealBoxesAreFull) {
  for (const char* name :
       {"admesh_block_fill-holes-bad.stl", "admesh_block_normal-directions-bad.stl",
        "prusa_20mmbox-CR.stl", "prusa_20mmbox-CRLF.stl"}) {
    const fs::path file = real_mesh(std::string("dirty/") + name);
    SLICECORR_NEEDS_FILE(file.string());
    TriangleMesh mesh = read_mesh(file.string());
    scale_to(mesh, 20);
    const MeshReport r = inspect(mesh);
    const double area = (r.upper[0] - r.lower[0]) * (r.upper[1] - r.lower[1]) / 0.0025;
    const MeshSlices slices(mesh, printer(410, 410, 50, 50), layer_of(100));
    const auto all = read(slices);
    for (std::size_t n = 0; n < all.size(); ++n) {
      ASSERT_NEAR(covered(all[n]), area, rounding_bound(convex_touches(400, 400)))
          << name << " slice " << n;
    }
  }
}

TEST(MeshSlices, DemoFileHasItsArea) {
  const fs::path file = real_mesh("clean/UVtools_demo_file.stl");
  SLICECORR_NEEDS_FILE(file.string());
  const TriangleMesh mesh = read_mesh(file.string());
  const MeshSlices slices(mesh, printer(2560, 1620, 50, 50), layer_of(100));
  ASSERT_EQ(slices.grid().layers, 10);
  Cutter cutter(mesh, inspect(mesh), slices.grid());
  const auto all = read(slices);
  for (const int n : {0, 9}) {
    // 1390.655 mm² is given to 0.0005.
    const double bound =
        0.0005 + 0.0025 * rounding_bound(static_cast<double>(cutter.at(n).touched));
    EXPECT_NEAR(covered(all[static_cast<std::size_t>(n)]) * 0.0025, 1390.655, bound) << n;
    EXPECT_LT(bound, 0.2);
  }
}

/// Triangles that lie on each other leave as many loose ends in two places: joined at once, and not
/// by a look at all pairs, which takes hours for so many: the test would not end in time.
TEST(Bridges, OfManyCoincidentTrianglesAreMadeAtOnce) {
  detail::LooseEnds loose;
  constexpr std::size_t many = 600000;
  loose.ends.assign(many, {1, 1});
  loose.beginnings.assign(many - 2, {4, 5});
  // The nearest come first, whatever their number: two of the ends go where it is nearer.
  loose.beginnings.insert(loose.beginnings.begin() + 7, 2, {1, 2});
  double longest_mm = 0;
  const auto joints = detail::bridge(loose, 0.5, 1, longest_mm);
  ASSERT_EQ(joints.size(), many);
  const auto to = [&](double x, double y) {
    return std::count_if(joints.begin(), joints.end(),
                         [&](const auto& j) { return j.bx == x && j.by == y; });
  };
  EXPECT_EQ(to(1, 2), 2);
  EXPECT_EQ(to(4, 5), static_cast<std::ptrdiff_t>(many) - 2);
  EXPECT_DOUBLE_EQ(longest_mm, std::hypot(1.5, 4));
}

}  // namespace
}  // namespace slicecorr
