// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/slice.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "cuts.hpp"
#include "meshes.hpp"
#include "refusal.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr {
namespace {

using test::refusal;

using std::numbers::pi;
using namespace test;  // NOLINT: meshes and slices of the tests

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

}  // namespace
}  // namespace slicecorr
