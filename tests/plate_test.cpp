// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Parts on one plate: distances of outlines edge by edge, and overlaps voxel by voxel, by the tests' own
// sums.
#include "slicecorr/plate.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>

#include "ladder.hpp"
#include "rounds.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr {
namespace {

using test::add_box;
using testing::HasSubstr;
using Point2 = std::array<double, 2>;
using Outline = std::vector<Point2>;

/// A prism over a star of `corners` corners about (x, y).
struct Prism {
  Outline outline;
  TriangleMesh mesh;
};

Prism star(std::mt19937& random, int corners, double least, double most, double height) {
  Prism p;
  std::uniform_real_distribution<double> radius(least, most), place(-30, 30);
  const double x = place(random), y = place(random), z = place(random);
  for (int i = 0; i < corners; ++i) {
    const double angle = 2 * 3.14159265358979 * i / corners, r = radius(random);
    p.outline.push_back({x + r * std::cos(angle), y + r * std::sin(angle)});
  }
  const auto n = static_cast<std::uint32_t>(corners);
  for (const double at : {z, z + height}) {
    for (const Point2& q : p.outline) p.mesh.vertices.push_back({q[0], q[1], at});
  }
  p.mesh.vertices.push_back({x, y, z});
  p.mesh.vertices.push_back({x, y, z + height});
  for (std::uint32_t i = 0; i < n; ++i) {
    const std::uint32_t k = (i + 1) % n;
    p.mesh.triangles.push_back({2 * n, k, i});
    p.mesh.triangles.push_back({2 * n + 1, n + i, n + k});
    p.mesh.triangles.push_back({i, k, n + k});
    p.mesh.triangles.push_back({i, n + k, n + i});
  }
  return p;
}

double distance(const Point2& p, const Point2& a, const Point2& b) {
  const double dx = b[0] - a[0], dy = b[1] - a[1];
  const double t =
      std::clamp(((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / (dx * dx + dy * dy), 0.0, 1.0);
  return std::hypot(p[0] - a[0] - t * dx, p[1] - a[1] - t * dy);
}
bool crosses(const Point2& a, const Point2& b, const Point2& c, const Point2& d) {
  const auto side = [](const Point2& p, const Point2& q, const Point2& r) {
    return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
  };
  return side(a, b, c) * side(a, b, d) < 0 && side(c, d, a) * side(c, d, b) < 0;
}
bool inside(const Point2& p, const Outline& o) {
  bool in = false;
  for (std::size_t i = 0; i < o.size(); ++i) {
    const Point2 &a = o[i], &b = o[(i + 1) % o.size()];
    if ((a[1] > p[1]) != (b[1] > p[1]) &&
        p[0] < a[0] + (b[0] - a[0]) * (p[1] - a[1]) / (b[1] - a[1])) {
      in = !in;
    }
  }
  return in;
}
/// 0 where they overlap.
double distance(const Outline& a, const Outline& b) {
  if (inside(a[0], b) || inside(b[0], a)) return 0;
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (std::size_t k = 0; k < b.size(); ++k) {
      const Point2 &p = a[i], &q = a[(i + 1) % a.size()], &r = b[k], &s = b[(k + 1) % b.size()];
      if (crosses(p, q, r, s)) return 0;
      least = std::min(
          {least, distance(p, r, s), distance(q, r, s), distance(r, p, q), distance(s, p, q)});
    }
  }
  return least;
}

Outline outline_of(const TriangleMesh& mesh, std::size_t corners) {
  Outline o;
  for (std::size_t i = 0; i < corners; ++i) o.push_back({mesh.vertices[i][0], mesh.vertices[i][1]});
  return o;
}

std::string numbered(std::size_t i) { return "part " + std::to_string(i); }

TEST(Arrange, PartsKeepTheirDistanceAndStandOnThePlatform) {
  std::mt19937 random(4);
  for (int round = 0; round < test::rounds(12); ++round) {
    std::vector<TriangleMesh> parts;
    std::vector<std::size_t> corners;
    const std::size_t count = 6 + random() % 20;
    while (parts.size() < count) {
      const auto n = static_cast<int>(3 + random() % 6);
      const Prism p = star(random, n, 2, 9, 4);
      // Some twice, as copies are.
      for (std::size_t k = 0; k <= random() % 3; ++k) {
        parts.push_back(p.mesh);
        corners.push_back(static_cast<std::size_t>(n));
      }
    }
    ArrangeOptions options{120, 68, 0.5 * (random() % 5), random() % 2 == 0};
    const auto places = arrange(parts, options, numbered);
    ASSERT_EQ(places.size(), parts.size());
    std::vector<Outline> placed;
    int plates = 0;
    for (std::size_t i = 0; i < parts.size(); ++i) {
      const TriangleMesh mesh = at_place(parts[i], places[i]);
      plates = std::max(plates, places[i].plate + 1);
      double low = 1e9;
      for (const Point3& v : mesh.vertices) {
        low = std::min(low, v[2]);
        EXPECT_GE(v[0], -1e-9);
        EXPECT_LE(v[0], 120 + 1e-9);
        EXPECT_GE(v[1], -1e-9);
        EXPECT_LE(v[1], 68 + 1e-9);
      }
      EXPECT_NEAR(low, 0, 1e-9);
      EXPECT_TRUE(options.turn || places[i].quarters == 0);
      placed.push_back(outline_of(mesh, corners[i]));
    }
    for (std::size_t i = 0; i < parts.size(); ++i) {
      for (std::size_t k = i + 1; k < parts.size(); ++k) {
        if (places[i].plate != places[k].plate) continue;
        EXPECT_GE(distance(placed[i], placed[k]), options.spacing_mm - 1e-9)
            << round << " " << i << " " << k;
        EXPECT_GT(distance(placed[i], placed[k]), 0);
      }
    }
    // Boxes of 18 mm by 18 mm: at least 6 x 3 of them fit beside each other, whatever is in them.
    EXPECT_LE(plates, static_cast<int>(parts.size() + 17) / 18 + 1);
    // The same again.
    const auto again = arrange(parts, options, numbered);
    for (std::size_t i = 0; i < parts.size(); ++i) EXPECT_EQ(again[i].move_mm, places[i].move_mm);
  }
}

TEST(Arrange, BoxesFillTheDisplayAndTurnWhereTheyMust) {
  TriangleMesh box;
  add_box(box, {0, 0, 0}, {9.5, 19, 1});
  // 12 columns of 3: 81 and 160 cells of 0.12 mm with what is kept clear.
  const std::vector<TriangleMesh> many(37, box);
  const auto places = arrange(many, {120, 60, 0.1, false}, numbered);
  EXPECT_EQ(std::count_if(places.begin(), places.end(), [](const auto& p) { return p.plate == 0; }),
            36);
  TriangleMesh tall;
  add_box(tall, {0, 0, 0}, {10, 80, 1});
  try {
    arrange({tall}, {120, 60, 1, false}, numbered);
    ADD_FAILURE() << "it does not fit";
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr("part 0 is 10 x 80 mm from above"));
  }
  EXPECT_EQ(arrange({tall}, {120, 60, 1, true}, numbered)[0].quarters % 2, 1);
  // As large as the display, off its corner and as rounding leaves it.
  TriangleMesh whole;
  add_box(whole, {0.1, 0.1, 0}, {0.1 + 120, 0.1 + 60, 1});
  EXPECT_EQ(arrange({whole}, {120, 60, 1, false}, numbered)[0].plate, 0);
  EXPECT_THROW(arrange({tall}, {0, 60, 1, true}, numbered), InputError);
  EXPECT_TRUE(arrange({}, {120, 60, 1, true}, numbered).empty());
}

Printer display() {
  Printer printer;
  printer.name = "plate";
  printer.width_px = 160;
  printer.height_px = 120;
  printer.pixel_x_um = printer.pixel_y_um = 50;
  return printer;
}

TEST(Overlap, IsWhatBothPartsPrint) {
  std::mt19937 random(9);
  int overlapping = 0, apart = 0;
  for (int round = 0; round < test::rounds(40); ++round) {
    // Corners on a grid that holds middles and borders of pixels, so that parts often just touch.
    std::vector<TriangleMesh> parts;
    std::vector<std::array<double, 6>> boxes;
    for (int i = 0; i < 3; ++i) {
      std::array<double, 6> b;
      for (std::size_t k = 0; k < 3; ++k) {
        b[k] = 0.025 * (random() % (k == 2 ? 40 : 80));
        b[k + 3] = b[k] + 0.025 * (1 + random() % 60);
      }
      b[5] = std::max(b[5], b[2] + 0.1);
      boxes.push_back(b);
      add_box(parts.emplace_back(), {b[0], b[1], b[2]}, {b[3], b[4], b[5]});
    }
    const auto found = find_overlap(parts, display(), {});
    double most = 0, most_voxels = 0;
    for (int i = 0; i < 3; ++i) {
      for (int k = i + 1; k < 3; ++k) {
        double volume = 1, voxels = 1;
        for (std::size_t d = 0; d < 3; ++d) {
          const auto &a = boxes[static_cast<std::size_t>(i)],
                     &b = boxes[static_cast<std::size_t>(k)];
          const double side = std::min(a[d + 3], b[d + 3]) - std::max(a[d], b[d]);
          volume *= std::max(0.0, side);
          voxels *= std::max(0.0, side + 0.0501);
        }
        most = std::max(most, volume);
        most_voxels = std::max(most_voxels, voxels);
      }
    }
    // By sides of the voxels' size: 0.05 mm each way, by at most a voxel along each side.
    if (most < 1e-9) {
      EXPECT_FALSE(found) << round;
      ++apart;
      continue;
    }
    if (!found) {
      // No middle of a voxel is in both: thinner than one.
      EXPECT_LT(most, 0.0501 * 1.6 * 1.6) << round;
      continue;
    }
    ++overlapping;
    EXPECT_LE(found->volume_mm3, most_voxels) << round;
    EXPECT_LT(found->first, found->second);
    EXPECT_GE(found->x_mm, 0);
    EXPECT_LE(found->x_mm, 8);
  }
  EXPECT_GT(overlapping, 10);
  EXPECT_GT(apart, 5);
}

TEST(Overlap, TouchingOnMiddlesOfPixelsIsNone) {
  TriangleMesh left, right, above;
  add_box(left, {0, 0, 0}, {1.025, 2, 1.025});
  add_box(right, {1.025, 0, 0}, {2, 2, 1});
  add_box(above, {0, 0, 1.025}, {2, 2, 2});
  EXPECT_FALSE(find_overlap({left, right, above}, display(), {}));
  TriangleMesh inside;
  add_box(inside, {0.2, 0.4, 0.5}, {0.6, 0.8, 0.7});
  const auto found = find_overlap({left, right, inside}, display(), {});
  ASSERT_TRUE(found);
  EXPECT_EQ(found->first, 0U);
  EXPECT_EQ(found->second, 2U);
  EXPECT_NEAR(found->volume_mm3, 0.4 * 0.4 * 0.2, 0.4 * 0.4 * 0.05);
  EXPECT_NEAR(found->z_mm, 0.5, 0.051);
  // All lie in the middle of 8 x 6 mm; of the lowest slice the first pixel at the largest y is told.
  EXPECT_NEAR(found->x_mm, 3.225, 0.051);
  EXPECT_NEAR(found->y_mm, 2.775, 0.051);
  // One that prints nothing by itself is no obstacle.
  TriangleMesh thin;
  add_box(thin, {0, 0, 0.3}, {2, 2, 0.301});
  EXPECT_FALSE(find_overlap({left, thin}, display(), {}));
}

}  // namespace
}  // namespace slicecorr
