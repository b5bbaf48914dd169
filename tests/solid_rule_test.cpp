// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Volumes that are taken away from solids, or within which these are kept, against their definition.
#include "slice/solid_rule.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "mesh/clip_to_box.hpp"
#include "meshes.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr::solid_rule_tests {
namespace {

using test::Bytes;

constexpr double kPixelMm = 0.1, kLayerMm = 0.1;
constexpr int kWidth = 60, kHeight = 50;

Printer plate_of_rule() {
  Printer p;
  p.name = "rule";
  p.width_px = kWidth;
  p.height_px = kHeight;
  p.pixel_x_um = p.pixel_y_um = kPixelMm * 1e3;
  p.bit_depth = 8;
  return p;
}

/// A convex body: what lies below all its planes.
struct Body {
  TriangleMesh mesh;
  std::uint32_t solid = 0;
  SolidRole role = SolidRole::added;
  bool holds(const Point3& p) const {
    for (const auto& t : mesh.triangles) {
      const Point3 &a = mesh.vertices[t[0]], &b = mesh.vertices[t[1]], &c = mesh.vertices[t[2]];
      Point3 u, v, w;
      for (std::size_t k = 0; k < 3; ++k)
        u[k] = b[k] - a[k], v[k] = c[k] - a[k], w[k] = p[k] - a[k];
      const double side = w[0] * (u[1] * v[2] - u[2] * v[1]) + w[1] * (u[2] * v[0] - u[0] * v[2]) +
                          w[2] * (u[0] * v[1] - u[1] * v[0]);
      if (side > 0) return false;
    }
    return true;
  }
};

struct Scene {
  std::vector<Body> bodies;
  TriangleMesh mesh() const {
    TriangleMesh all;
    std::vector<TriangleMesh::Share> shares;
    for (const Body& body : bodies) {
      shares.push_back({static_cast<std::uint32_t>(all.triangles.size()), body.solid, body.role});
      append(all, body.mesh);
    }
    all.shares = shares;
    return all;
  }
  bool solid(const Point3& p) const {
    for (std::uint32_t s = 0; s < 8; ++s) {
      bool added = false, taken = false, keeps = false, kept = false;
      for (const Body& body : bodies) {
        if (body.solid != s) continue;
        const bool in = body.holds(p);
        added |= in && body.role == SolidRole::added;
        taken |= in && body.role == SolidRole::taken_away;
        keeps |= body.role == SolidRole::kept_within;
        kept |= in && body.role == SolidRole::kept_within;
      }
      if (added && !taken && (!keeps || kept)) return true;
    }
    return false;
  }
  /// Of what is added.
  std::array<Point3, 2> box() const {
    Point3 low, high;
    low.fill(1e9);
    high.fill(-1e9);
    for (const Body& body : bodies) {
      if (body.role != SolidRole::added) continue;
      for (const Point3& v : body.mesh.vertices) {
        for (std::size_t k = 0; k < 3; ++k) {
          low[k] = std::min(low[k], v[k]);
          high[k] = std::max(high[k], v[k]);
        }
      }
    }
    return {low, high};
  }
};

/// All slices, in bands of `rows` rows.
std::vector<Bytes> sliced(const SliceSource& slices, int layers, int rows) {
  std::vector<Bytes> all(static_cast<std::size_t>(layers), Bytes(kWidth * kHeight, 0));
  for (int y0 = 0; y0 < kHeight; y0 += rows) {
    const PixelBox band{0, y0, kWidth, std::min(kHeight, y0 + rows)};
    slices.read_band(band, [&](int n, const std::uint8_t* values) {
      if (values) std::copy_n(values, kWidth * band.height(), all[n].data() + kWidth * y0);
    });
  }
  return all;
}

MeshSlices slices_of(const Scene& scene, bool antialias = true) {
  SliceOptions options;
  options.layer_um = kLayerMm * 1e3;
  options.antialias = antialias;
  options.edge_heights = true;
  return MeshSlices(scene.mesh(), plate_of_rule(), options);
}

/// Where a pixel's place on the plate is in the scene.
struct PlaceInScene {
  explicit PlaceInScene(const Scene& scene) {
    const auto [low, high] = scene.box();
    for (std::size_t k = 0; k < 2; ++k) middle[k] = 0.5 * (low[k] + high[k]);
    bottom = low[2];
  }
  Point3 at(double column, double row, double layer) const {
    return {middle[0] + (column - 0.5 * kWidth) * kPixelMm,
            middle[1] - (row - 0.5 * kHeight) * kPixelMm, bottom + layer * kLayerMm};
  }
  double middle[2]{}, bottom = 0;
};

Scene random_boxes(std::mt19937& random) {
  const auto at = [&](double from, double to) {
    return std::uniform_real_distribution(from, to)(random);
  };
  Scene scene;
  const int bodies = std::uniform_int_distribution(2, 7)(random);
  for (int i = 0; i < bodies; ++i) {
    Point3 low, high;
    for (std::size_t k = 0; k < 3; ++k) {
      low[k] = at(0, 3);
      high[k] = low[k] + at(0.05, 2);
    }
    Body body{test::box(low, high), std::uniform_int_distribution(0U, 2U)(random)};
    const int role = std::uniform_int_distribution(0, 4)(random);
    if (i > 0 && role == 1) body.role = SolidRole::kept_within;
    if (i > 0 && role > 2) body.role = SolidRole::taken_away;
    if (body.role != SolidRole::added) {
      // Some reach far beyond the part.
      if (role == 4) {
        for (Point3& v : body.mesh.vertices) {
          for (double& x : v) x = 1.7 + (x - 1.7) * 6;
        }
      }
    }
    scene.bodies.push_back(body);
  }
  return scene;
}

/// The exact area of a pixel in a slice that boxes cover: sums of the rectangles that all their sides
/// cut it into.
double area_of_boxes(const Scene& scene, const PlaceInScene& place, int x, int y, double layer) {
  const Point3 a = place.at(x, y + 1, layer), b = place.at(x + 1, y, layer);
  std::vector<double> xs{a[0], b[0]}, ys{a[1], b[1]};
  for (const Body& body : scene.bodies) {
    for (const Point3& v : body.mesh.vertices) {
      if (v[0] > a[0] && v[0] < b[0]) xs.push_back(v[0]);
      if (v[1] > a[1] && v[1] < b[1]) ys.push_back(v[1]);
    }
  }
  std::sort(xs.begin(), xs.end());
  std::sort(ys.begin(), ys.end());
  double area = 0;
  for (std::size_t i = 0; i + 1 < xs.size(); ++i) {
    for (std::size_t k = 0; k + 1 < ys.size(); ++k) {
      const Point3 middle{0.5 * (xs[i] + xs[i + 1]), 0.5 * (ys[k] + ys[k + 1]), a[2]};
      if (scene.solid(middle)) area += (xs[i + 1] - xs[i]) * (ys[k + 1] - ys[k]);
    }
  }
  return area / (kPixelMm * kPixelMm);
}

/// A scene of boxes as it lies, and its slices.
struct SlicedBoxes {
  explicit SlicedBoxes(std::mt19937& random, bool antialias = true)
      : scene(random_boxes(random)), place(scene), slices(slices_of(scene, antialias)) {}
  Scene scene;
  PlaceInScene place;
  MeshSlices slices;
};

TEST(SolidRule, CoverageOfBoxesIsTheirArea) {
  std::mt19937 random(7);
  std::uint64_t lit = 0;
  for (int round = 0; round < 60; ++round) {
    const auto [scene, place, slices] = SlicedBoxes(random);
    const std::vector<Bytes> all = sliced(slices, slices.grid().layers, 7);
    EXPECT_EQ(all, sliced(slices, slices.grid().layers, kHeight)) << round;
    const int step = std::max(1, slices.grid().layers / 6);
    for (int n = 0; n < slices.grid().layers; n += step) {
      for (int i = 0; i < kWidth * kHeight; ++i) {
        const double level = 255 * area_of_boxes(scene, place, i % kWidth, i / kWidth, n + 0.5);
        // Rounding of coordinates moves a level only where it is between two.
        const double off =
            std::abs(all[static_cast<std::size_t>(n)][static_cast<std::size_t>(i)] - level);
        ASSERT_LE(off, 0.5 + 1e-6) << round << " slice " << n << " pixel " << i;
        lit += level > 0;
      }
    }
  }
  EXPECT_GT(lit, 20000u);
}

TEST(SolidRule, CentresOfBoxesAreInside) {
  std::mt19937 random(8);
  for (int round = 0; round < 20; ++round) {
    const auto [scene, place, slices] = SlicedBoxes(random, false);
    const std::vector<Bytes> all = sliced(slices, slices.grid().layers, 7);
    EXPECT_EQ(all, sliced(slices, slices.grid().layers, kHeight));
    for (int n = 0; n < slices.grid().layers; ++n) {
      for (int i = 0; i < kWidth * kHeight; ++i) {
        const bool inside = scene.solid(place.at(i % kWidth + 0.5, i / kWidth + 0.5, n + 0.5));
        ASSERT_EQ(all[static_cast<std::size_t>(n)][static_cast<std::size_t>(i)], inside ? 255 : 0)
            << round << " slice " << n << " pixel " << i;
      }
    }
  }
}

/// Of a tetrahedron in random place, counter-clockwise seen from outside.
TriangleMesh tetrahedron(std::mt19937& random, double size) {
  std::uniform_real_distribution<double> at(0, size);
  for (;;) {
    TriangleMesh mesh;
    for (int i = 0; i < 4; ++i) mesh.vertices.push_back({at(random), at(random), at(random)});
    mesh.triangles = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
    const double volume = inspect(mesh).volume;
    if (std::abs(volume) < 0.02 * size * size * size) continue;
    if (volume < 0) {
      for (auto& t : mesh.triangles) std::swap(t[1], t[2]);
    }
    return mesh;
  }
}

TEST(SolidRule, CoverageOfSlopesIsThatOfSamples) {
  std::mt19937 random(9);
  constexpr int kSamples = 16;
  for (int round = 0; round < 3; ++round) {
    Scene scene;
    for (int i = 0; i < 5; ++i) {
      Body body{tetrahedron(random, 4), static_cast<std::uint32_t>(i % 2)};
      if (i > 1)
        body.role = i == 4 && round % 3 == 0 ? SolidRole::kept_within : SolidRole::taken_away;
      if (i == 2) {
        for (Point3& v : body.mesh.vertices) v[0] = 2 + 5 * (v[0] - 2);
      }
      scene.bodies.push_back(body);
    }
    const PlaceInScene place(scene);
    const MeshSlices slices = slices_of(scene);
    const std::vector<Bytes> all = sliced(slices, slices.grid().layers, 16);
    EXPECT_EQ(all, sliced(slices, slices.grid().layers, 5));
    for (int n = 1; n < slices.grid().layers; n += 5) {
      for (int i = 0; i < kWidth * kHeight; ++i) {
        int hits = 0;
        for (int s = 0; s < kSamples * kSamples; ++s) {
          hits += scene.solid(place.at(i % kWidth + (s % kSamples + 0.5) / kSamples,
                                       i / kWidth + (s / kSamples + 0.5) / kSamples, n + 0.5));
        }
        const double share = static_cast<double>(hits) / (kSamples * kSamples);
        const double drawn = all[static_cast<std::size_t>(n)][static_cast<std::size_t>(i)] / 255.0;
        // An edge across a pixel passes at most 2 k of its k² samples; half of these may be wrong, each
        // by its area. No more than six edges meet in a pixel here.
        ASSERT_NEAR(drawn, share, 6.0 / kSamples) << round << " slice " << n << " pixel " << i;
        if (hits == 0 || hits == kSamples * kSamples) {
          ASSERT_NEAR(drawn, share, 3.0 / kSamples);
        }
      }
    }
    // All together errors cancel: the volume is that of the samples to a part in a thousand of a layer's
    // pixels.
    double drawn = 0, sampled = 0;
    for (int n = 0; n < slices.grid().layers; ++n) {
      for (const std::uint8_t value : all[static_cast<std::size_t>(n)]) drawn += value / 255.0;
      for (int i = 0; i < 4 * kWidth * kHeight; ++i) {
        sampled += 0.25 * scene.solid(place.at((i % (2 * kWidth) + 0.5) / 2,
                                               (i / (2 * kWidth) + 0.5) / 2, n + 0.5));
      }
    }
    EXPECT_NEAR(drawn, sampled, 0.01 * sampled + 30) << round;
  }
}

TEST(SolidRule, EdgeHeightsKeepTheSolidLength) {
  std::mt19937 random(10);
  std::uint64_t edges = 0;
  for (int round = 0; round < 25; ++round) {
    const SlicedBoxes boxes(random);
    const Scene& scene = boxes.scene;
    const PlaceInScene& place = boxes.place;
    const MeshSlices& slices = boxes.slices;
    const int layers = slices.grid().layers;
    const std::vector<Bytes> found = sliced(*slices.edge_heights(), layers + 1, 7);
    std::vector<double> sides;
    for (const Body& body : scene.bodies) {
      for (const Point3& v : body.mesh.vertices) {
        sides.push_back((v[2] - place.bottom) / kLayerMm);
      }
    }
    std::sort(sides.begin(), sides.end());
    for (int i = 0; i < kWidth * kHeight; ++i) {
      const auto solid = [&](double layer) {
        return layer > 0 && scene.solid(place.at(i % kWidth + 0.5, i / kWidth + 0.5, layer));
      };
      for (int node = 0; node <= layers; ++node) {
        const double low = node - 0.5, high = node + 0.5;
        const bool before = solid(low), after = node < layers && solid(high);
        int expected = 0;
        if (before != after) {
          double length = 0, from = low;
          std::vector<double> cuts{0.0};
          for (const double side : sides) cuts.push_back(side);
          cuts.push_back(high);
          std::sort(cuts.begin(), cuts.end());
          for (const double cut : cuts) {
            if (cut <= low || cut > high) continue;
            if (solid(0.5 * (from + cut))) length += cut - from;
            from = cut;
          }
          const double edge = before ? length : 1 - length;
          expected = edge_height_byte(edge - 0.5);
          if (node == 0 && expected == edge_height_byte(0)) expected = 0;
        }
        const int got = found[static_cast<std::size_t>(node)][static_cast<std::size_t>(i)];
        // Heights that keep eleven bits for tags are rounded far below a step of the byte.
        ASSERT_LE(std::abs(got - expected), expected == 0 ? 0 : 1)
            << round << " node " << node << " pixel " << i;
        edges += expected != 0;
      }
    }
  }
  EXPECT_GT(edges, 5000u);
}

TEST(SolidRule, ResultsAreThoseOfAnyThreadsAndOrder) {
  std::mt19937 random(11);
  for (int round = 0; round < 10; ++round) {
    Scene scene = random_boxes(random);
    SliceOptions options;
    options.layer_um = kLayerMm * 1e3;
    ExecutionContext one;
    one.threads = 1;
    const MeshSlices a(scene.mesh(), plate_of_rule(), options, one);
    const MeshSlices b(scene.mesh(), plate_of_rule(), options);
    EXPECT_EQ(sliced(a, a.grid().layers, 9), sliced(b, b.grid().layers, 16));
    std::reverse(scene.bodies.begin(), scene.bodies.end());
    const MeshSlices c(scene.mesh(), plate_of_rule(), options);
    EXPECT_EQ(sliced(a, a.grid().layers, 9), sliced(c, c.grid().layers, 9));
  }
}

TEST(SolidRule, WithoutAnythingTakenAwayNothingChanges) {
  // Shares that only add are drawn as one mesh, bit for bit.
  std::mt19937 random(12);
  int compared = 0;
  for (int round = 0; round < 30; ++round) {
    Scene scene = random_boxes(random);
    for (Body& body : scene.bodies) body.role = SolidRole::added;
    TriangleMesh mesh = scene.mesh();
    SliceOptions options;
    options.layer_um = kLayerMm * 1e3;
    options.edge_heights = true;
    const auto [low, high] = scene.box();
    if (high[0] - low[0] > 5 || high[1] - low[1] > 5) continue;  // beyond the display
    ++compared;
    const MeshSlices with(mesh, plate_of_rule(), options);
    mesh.shares.clear();
    const MeshSlices without(mesh, plate_of_rule(), options);
    const int layers = with.grid().layers;
    EXPECT_EQ(sliced(with, layers, 16), sliced(without, layers, 16));
    EXPECT_EQ(sliced(*with.edge_heights(), layers + 1, 16),
              sliced(*without.edge_heights(), layers + 1, 16));
  }
  EXPECT_GT(compared, 5);
}

TEST(SolidRule, BodiesCutAtABoxAreClosedAndWithinIt) {
  std::mt19937 random(13);
  int cut = 0;
  for (int round = 0; round < 200; ++round) {
    Body whole{tetrahedron(random, 4)};
    std::uniform_real_distribution<double> at(-0.5, 4.5);
    Point3 low, high;
    for (std::size_t k = 0; k < 3; ++k) {
      low[k] = at(random);
      high[k] = at(random);
      if (low[k] > high[k]) std::swap(low[k], high[k]);
    }
    TriangleMesh mesh = whole.mesh;
    detail::keep_in_box(mesh.vertices, mesh.triangles, low, high);
    if (mesh.triangles.empty()) continue;
    const MeshReport r = inspect(mesh);
    EXPECT_EQ(r.defects.open_edges + r.defects.misoriented_edges + r.defects.degenerate_triangles,
              0u)
        << round << " " << describe(r.defects);
    const Body kept{mesh};
    int inside = 0;
    for (int i = 0; i < 500; ++i) {
      Point3 p;
      bool near = false, in_box = true;
      for (std::size_t k = 0; k < 3; ++k) {
        p[k] = at(random);
        near |= std::abs(p[k] - low[k]) < 1e-6 || std::abs(p[k] - high[k]) < 1e-6;
        in_box &= p[k] > low[k] && p[k] < high[k];
      }
      if (near) continue;
      const bool expected = in_box && whole.holds(p);
      inside += expected;
      // What is cut from a convex body is convex.
      ASSERT_EQ(kept.holds(p), expected) << round;
    }
    for (std::size_t k = 0; k < 3; ++k) {
      EXPECT_GE(r.lower[k], low[k]);
      EXPECT_LE(r.upper[k], high[k]);
    }
    cut += inside > 0;
  }
  EXPECT_GT(cut, 40);
}

TEST(SolidRule, RefusesWhatHasNoInside) {
  Scene scene;
  scene.bodies.push_back({test::box({0, 0, 0}, {3, 3, 3}), 1, SolidRole::added});
  scene.bodies.push_back({test::box({1, 1, 1}, {2, 2, 4}), 1, SolidRole::taken_away});
  scene.bodies[1].mesh.triangles.pop_back();
  SliceOptions options;
  options.layer_um = 100;
  EXPECT_THROW(
      {
        try {
          MeshSlices(scene.mesh(), plate_of_rule(), options);
        } catch (const InputError& e) {
          EXPECT_NE(std::string(e.what()).find("open edges"), std::string::npos) << e.what();
          throw;
        }
      },
      InputError);
  scene.bodies.erase(scene.bodies.begin());
  EXPECT_THROW(MeshSlices(scene.mesh(), plate_of_rule(), options), InputError);
}

TEST(SolidRule, OpenPartsCloseByThemselves) {
  // The part's lid is missing at one side; what is taken away from it is whole.
  Scene scene;
  scene.bodies.push_back({test::box({0, 0, 0}, {3, 3, 3}), 1, SolidRole::added});
  scene.bodies.push_back({test::box({1, 1, -1}, {2, 2, 4}), 1, SolidRole::taken_away});
  const auto volume = [&] {
    const MeshSlices slices = slices_of(scene);
    double sum = 0;
    for (const Bytes& slice : sliced(slices, slices.grid().layers, 16)) {
      for (const std::uint8_t value : slice) sum += value / 255.0;
    }
    return sum * kPixelMm * kPixelMm * kLayerMm;
  };
  EXPECT_NEAR(volume(), 24, 1e-9);
  scene.bodies[0].mesh.triangles.erase(scene.bodies[0].mesh.triangles.begin() + 4);
  EXPECT_NEAR(volume(), 24, 0.1);
}

TEST(SolidRule, AppendedMeshesKeepTheirSolids) {
  Scene scene;
  scene.bodies.push_back({test::box({0, 0, 0}, {2, 2, 1}), 0, SolidRole::added});
  scene.bodies.push_back({test::box({1, 0, 0}, {2, 2, 1}), 0, SolidRole::taken_away});
  TriangleMesh all = scene.mesh();
  // A block where the other one is taken away.
  append(all, test::box({1, 0, 0}, {2, 2, 1}));
  SliceOptions options;
  options.layer_um = 100;
  const MeshSlices slices(all, plate_of_rule(), options);
  double sum = 0;
  for (const Bytes& slice : sliced(slices, slices.grid().layers, 16)) {
    for (const std::uint8_t value : slice) sum += value / 255.0;
  }
  EXPECT_NEAR(sum * kPixelMm * kPixelMm * kLayerMm, 4, 1e-9);
  EXPECT_TRUE(all.adds(0));
  EXPECT_FALSE(all.adds(12));
  EXPECT_FALSE(all.adds(23));
  EXPECT_TRUE(all.adds(24));
}

}  // namespace
}  // namespace slicecorr::solid_rule_tests
