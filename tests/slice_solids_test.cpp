// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What of a mesh is solid: bodies in one another, triangles that face the wrong way, surface that is missing.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "cuts.hpp"
#include "meshes.hpp"
#include "slice/bridges.hpp"
#include "slicecorr/slice.hpp"

namespace slicecorr {
namespace {

using std::numbers::pi;
using namespace test;  // NOLINT: meshes and slices of the tests

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
