// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Heights of edges within slices: closed forms, then the tests' own rays through pixel centres.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <optional>
#include <random>
#include <span>
#include <vector>

#include "meshes.hpp"
#include "rays.hpp"
#include "real_files.hpp"
#include "rounds.hpp"
#include "slicecorr/slice.hpp"

namespace slicecorr {
namespace {

using namespace test;  // NOLINT: meshes and slices of the tests

/// Half a step of the byte, and what doubles round.
constexpr double kStep = 0.5 / 254 + 1e-9;

/// The byte at a node of a column; 0: no height.
class Heights {
 public:
  explicit Heights(const MeshSlices& slices)
      : width_(slices.grid().width_px), nodes_(read(*slices.edge_heights())) {}
  int at(int node, int x, int y) const {
    return nodes_[static_cast<std::size_t>(node)][static_cast<std::size_t>(y * width_ + x)];
  }
  int nodes() const { return static_cast<int>(nodes_.size()); }
  /// Nodes of a column that have a height.
  std::vector<int> of(int x, int y) const {
    std::vector<int> found;
    for (int n = 0; n < nodes(); ++n) {
      if (at(n, x, y)) found.push_back(n);
    }
    return found;
  }
  /// The heights of a column above the platform, in slices.
  std::vector<double> places(int x, int y) const {
    std::vector<double> found;
    for (const int n : of(x, y)) {
      found.push_back(n + edge_height_slices(static_cast<std::uint8_t>(at(n, x, y))));
    }
    return found;
  }
  bool operator==(const Heights&) const = default;

 private:
  int width_;
  std::vector<Bytes> nodes_;
};

MeshSlices slice(TriangleMesh mesh, double layer_um = 100, int side_px = 40) {
  return {std::move(mesh), printer(side_px, side_px, 100, 100), layer_of(layer_um)};
}

/// A box whose lower and upper sides rise with x and y, mm.
TriangleMesh slab(const Point3& low, const Point3& high, double by_x, double by_y) {
  TriangleMesh mesh = box(low, high);
  for (Point3& v : mesh.vertices) v[2] += by_x * v[0] + by_y * v[1];
  return mesh;
}

// --- Closed forms

TEST(EdgeHeights, OfATiltedPlane) {
  // 3 x 3 mm in the middle of 4 x 4 mm; the least z, at the corner (0, 0), is on the platform.
  const MeshSlices slices = slice(slab({0, 0, 0}, {3, 3, 0.83}, 0.11, 0.07));
  const Heights heights(slices);
  ASSERT_EQ(heights.nodes(), slices.grid().layers + 1);
  for (int y = 5; y < 35; ++y) {
    for (int x = 5; x < 35; ++x) {
      // Row 0 is at the largest y; heights in slices of 0.1 mm.
      const double below = 10 * (0.11 * (x - 4.5) / 10 + 0.07 * (34.5 - y) / 10);
      const std::vector<double> is = heights.places(x, y);
      ASSERT_EQ(is.size(), 2u) << x << ", " << y;
      EXPECT_NEAR(is[0], below, kStep) << x << ", " << y;
      EXPECT_NEAR(is[1], below + 8.3, kStep) << x << ", " << y;
    }
  }
  EXPECT_TRUE(heights.of(4, 20).empty());
  EXPECT_TRUE(heights.of(35, 20).empty());
}

TEST(EdgeHeights, OfABoxThatStandsOnThePlatform) {
  // Walls at pixel borders, then at pixel centres: of the two walls one has the column.
  for (const double shift : {0.0, 0.05}) {
    SliceOptions options = layer_of(100);
    options.center_mm = {2.0 + shift, 2.0 + shift};
    const MeshSlices slices(box({0, 0, 0}, {1, 1, 0.33}), printer(40, 40, 100, 100), options);
    const Heights heights(slices);
    ASSERT_EQ(slices.grid().layers, 3);
    int columns = 0;
    for (int y = 0; y < 40; ++y) {
      for (int x = 0; x < 40; ++x) {
        if (heights.of(x, y).empty()) continue;
        ++columns;
        EXPECT_THAT(heights.of(x, y), testing::ElementsAre(3));
        EXPECT_EQ(heights.at(3, x, y), edge_height_byte(0.3));
      }
    }
    EXPECT_EQ(columns, 100) << shift;
  }
}

TEST(EdgeHeights, OfTheLastLayer) {
  // 3.49 and 3.5 slices make three layers, 3.51 make four.
  for (const auto& [height_mm, layers] : {std::pair{0.349, 3}, {0.35, 3}, {0.351, 4}, {0.4, 4}}) {
    const MeshSlices slices = slice(box({0, 0, 0}, {1, 1, height_mm}));
    ASSERT_EQ(slices.grid().layers, layers);
    const Heights heights(slices);
    EXPECT_THAT(heights.of(20, 20), testing::ElementsAre(layers));
    EXPECT_NEAR(heights.places(20, 20)[0], 10 * height_mm, kStep);
  }
}

TEST(EdgeHeights, OfACone) {
  // Four sides, so that planes meet at the middle: z = 1.2 mm (1 - (|x| + |y|) / 1.5 mm).
  const MeshSlices slices = slice(cone(1.5, 1.2, 4));
  const Heights heights(slices);
  for (int y = 0; y < 40; ++y) {
    for (int x = 0; x < 40; ++x) {
      const double top = 12 * (1 - (std::abs(x + 0.5 - 20) + std::abs(y + 0.5 - 20)) / 15);
      SCOPED_TRACE(testing::Message() << x << ", " << y);
      if (top >= 0.5 + 1e-9) {
        const auto is = heights.places(x, y);
        ASSERT_EQ(is.size(), 1u);
        EXPECT_NEAR(is[0], top, kStep);
      } else if (top < 0.5 - 1e-9) {
        EXPECT_TRUE(heights.of(x, y).empty());  // no middle of a layer is solid
      }
    }
  }
}

TEST(EdgeHeights, OfASphere) {
  constexpr double radius = 1.6;  // mm
  const TriangleMesh mesh = sphere(radius, 5);
  // A triangle of edges up to e lies in a circle of radius e / sqrt(3), below which the sphere is.
  double longest = 0;
  for (const auto& t : mesh.triangles) {
    for (std::size_t k = 0; k < 3; ++k) {
      const Point3 &p = mesh.vertices[t[k]], &q = mesh.vertices[t[(k + 1) % 3]];
      longest = std::max(longest, std::hypot(p[0] - q[0], p[1] - q[1], p[2] - q[2]));
    }
  }
  const double sinks_mm = radius - std::sqrt(radius * radius - longest * longest / 3);
  const MeshSlices slices = slice(mesh);
  const Heights heights(slices);
  int columns = 0;
  for (int y = 0; y < 40; ++y) {
    for (int x = 0; x < 40; ++x) {
      const double off = std::hypot(x + 0.5 - 20, y + 0.5 - 20) / 10;
      if (off > 0.9 * radius) continue;
      const double half = std::sqrt(radius * radius - off * off);
      // The polyhedron lies between the sphere and one that much smaller.
      const double inner = std::sqrt(std::pow(radius - sinks_mm, 2) - off * off);
      const double bound = 10 * (half - inner) + kStep + 10 * sinks_mm;
      const auto is = heights.places(x, y);
      if (is.size() == 1 && 10 * (radius - half) < bound + 0.5 / 254) continue;  // on the platform
      ASSERT_EQ(is.size(), 2u);
      EXPECT_NEAR(is[0], 10 * (radius - half), bound) << x << ", " << y;
      EXPECT_NEAR(is[1], 10 * (radius + half), bound) << x << ", " << y;
      ++columns;
    }
  }
  EXPECT_GT(columns, 500);
}

TEST(EdgeHeights, OfOverlappingBodiesAreThoseOfTheirUnion) {
  const TriangleMesh two = box({0, 0, 0}, {2, 2, 0.72}) + box({0, 0, 0.4}, {2, 2, 1.18});
  const Heights heights(slice(two));
  EXPECT_THAT(heights.of(20, 20), testing::ElementsAre(12));
  EXPECT_NEAR(heights.places(20, 20)[0], 11.8, kStep);
  // Bodies that share a face are one; the same body twice is itself.
  const Heights touching(slice(box({0, 0, 0}, {2, 2, 0.42}) + box({0, 0, 0.42}, {2, 2, 1.18})));
  EXPECT_EQ(touching, heights);
  EXPECT_EQ(Heights(slice(two + two)), heights);
}

TEST(EdgeHeights, OfShellsWithinAndTurnedTriangles) {
  const TriangleMesh outside = box({0, 0, 0}, {2, 2, 2});
  const Heights heights(slice(outside + inverted(box({0.5, 0.5, 0.44}, {1.5, 1.5, 1.53}))));
  EXPECT_THAT(heights.of(20, 20), testing::ElementsAre(4, 15, 20));
  EXPECT_NEAR(heights.places(20, 20)[0], 4.4, kStep);
  EXPECT_NEAR(heights.places(20, 20)[1], 15.3, kStep);
  TriangleMesh faulty = outside;
  std::swap(faulty.triangles[3][0], faulty.triangles[3][1]);
  const MeshSlices turned_slices = slice(faulty);
  EXPECT_EQ(turned_slices.report().turned_triangles, 1u);
  EXPECT_EQ(Heights(turned_slices), Heights(slice(outside)));
  EXPECT_EQ(Heights(slice(inverted(outside))), Heights(slice(outside)));
}

TEST(EdgeHeights, KeepTheSolidLengthBetweenTwoMiddles) {
  // Between the middles of layers 3 and 4, which are 3.5 and 4.5 slices high: solid to 3.7, empty
  // to 3.9, solid to 4.2, so that half a slice and the middle of layer 3 are solid.
  const TriangleMesh part = box({0, 0, 0}, {2, 2, 0.37}) + box({0, 0, 0.39}, {2, 2, 0.42}) +
                            box({0, 0, 0.9}, {2, 2, 1.0});
  const Heights heights(slice(part));
  EXPECT_THAT(heights.of(20, 20), testing::ElementsAre(4, 9, 10));
  EXPECT_NEAR(heights.places(20, 20)[0], 3.5 + 0.2 + 0.3, kStep);
  // The same upside down: the edge above a gap.
  const TriangleMesh hung = box({0, 0, 0}, {2, 2, 0.1}) + box({0, 0, 0.58}, {2, 2, 0.61}) +
                            box({0, 0, 0.63}, {2, 2, 1.0});
  const auto places = Heights(slice(hung)).places(20, 20);
  ASSERT_EQ(places.size(), 3u);
  // Between 5.5 and 6.5: solid from 5.8 to 6.1 and from 6.3 on.
  EXPECT_NEAR(places[1], 6.5 - 0.3 - 0.2, kStep);
}

TEST(EdgeHeights, ThinVoidsAndThinPartsHaveNone) {
  const MeshSlices gap = slice(box({0, 0, 0}, {2, 2, 0.36}) + box({0, 0, 0.44}, {2, 2, 0.8}));
  EXPECT_THAT(Heights(gap).of(20, 20), testing::ElementsAre(8));
  EXPECT_EQ(gap.thin_features().columns, 0u);
  const MeshSlices sheet = slice(box({0, 0, 0}, {2, 2, 0.3}) + box({0.5, 0, 0.66}, {2, 2, 0.74}));
  EXPECT_THAT(Heights(sheet).of(25, 20), testing::ElementsAre(3));
  const ThinFeatures thin = sheet.thin_features();
  EXPECT_EQ(thin.columns, 15u * 20u);
  EXPECT_EQ(thin.of_columns, 20u * 20u);
  EXPECT_NEAR(thin.thickest_um, 80, 1e-6);
  EXPECT_NEAR(thin.z_mm, 0.66, 1e-9);
  EXPECT_NEAR(thin.volume_mm3, 1.5 * 2 * 0.08, 1e-9);
}

// --- Open meshes

TEST(EdgeHeights, ColumnsThroughAHoleHaveNone) {
  TriangleMesh open = box({0, 0, 0}, {2, 2, 0.93});
  const Heights whole(slice(open));
  open.triangles.erase(open.triangles.begin() + 2);  // half of the upper side
  const Heights heights(slice(open));
  int none = 0;
  for (int y = 10; y < 30; ++y) {
    for (int x = 10; x < 30; ++x) {
      none += heights.of(x, y).empty();
      if (heights.of(x, y).empty()) continue;
      EXPECT_EQ(heights.of(x, y), whole.of(x, y));
    }
  }
  // Half of 400 columns; those on the diagonal belong to either half.
  EXPECT_GE(none, 190);
  EXPECT_LE(none, 210);
  // Lines through pixel centres pass walls by, so that holes in them take nothing away.
  TriangleMesh side = box({0, 0, 0}, {2, 2, 0.93});
  side.triangles.erase(side.triangles.begin() + 4);
  EXPECT_EQ(Heights(slice(side)), whole);
}

// --- How they are read

TEST(EdgeHeights, BoxesAndRangesArePartsOfTheWhole) {
  const MeshSlices slices(messy(), printer(110, 121, 50, 50), layer_of(90));
  const SliceSource& source = *slices.edge_heights();
  EXPECT_EQ(source.grid().layers, slices.grid().layers + 1);
  EXPECT_EQ(source.grid().width_px, 110);
  EXPECT_FALSE(source.reads_any_slices());
  const auto all = read(source);
  std::mt19937_64 random(6);
  const auto whole = [&](int low, int high) {
    return std::uniform_int_distribution<int>(low, high)(random);
  };
  int seen = 0;
  for (int i = 0; i < 60; ++i) {
    PixelBox b;
    b.x0 = i % 3 ? 0 : whole(0, 109);
    b.x1 = i % 3 ? 110 : whole(b.x0 + 1, 110);
    b.y0 = whole(0, 120);
    b.y1 = i % 2 ? b.y0 + 1 : whole(b.y0 + 1, 121);
    const int first = whole(0, source.grid().layers - 1);
    const int past = whole(first + 1, source.grid().layers);
    int next = first;
    source.read_slices(b, first, past, [&](int n, const std::uint8_t* rows) {
      ASSERT_EQ(n, next++);
      for (int y = b.y0; y < b.y1; ++y) {
        for (int x = b.x0; x < b.x1; ++x) {
          const int is = rows ? rows[(y - b.y0) * b.width() + x - b.x0] : 0;
          ASSERT_EQ(is, all[static_cast<std::size_t>(n)][static_cast<std::size_t>(y * 110 + x)])
              << n << ": " << x << ", " << y;
          seen += is != 0;
        }
      }
    });
    ASSERT_EQ(next, past);
  }
  EXPECT_GT(seen, 1000);
  source.read_band({3, 3, 3, 3}, [](int, const std::uint8_t* rows) { EXPECT_EQ(rows, nullptr); });
}

TEST(EdgeHeights, ChangeNoSliceAndStayWhenSlicesMove) {
  SliceOptions without = layer_of(90);
  without.edge_heights = false;
  const MeshSlices plain(messy(), printer(110, 121, 50, 50), without);
  ExecutionContext one, many;
  one.threads = 1;
  many.threads = 4;
  const MeshSlices a(messy(), printer(110, 121, 50, 50), layer_of(90), one);
  MeshSlices b(messy(), printer(110, 121, 50, 50), layer_of(90), many);
  EXPECT_EQ(plain.edge_heights(), nullptr);
  EXPECT_EQ(plain.thin_features().columns, 0u);
  EXPECT_EQ(read(plain), read(a));
  const SliceSource* const source = b.edge_heights();
  const MeshSlices moved(std::move(b));
  EXPECT_EQ(moved.edge_heights(), source);
  EXPECT_EQ(Heights(a), Heights(moved));
  EXPECT_EQ(a.thin_features(one).volume_mm3, moved.thin_features(many).volume_mm3);
}

// --- Against rays of the tests' own

/// Columns of a mesh against rays; `step`: one of how many columns each way. Gives the number of
/// edges that were looked at.
int expect_rays(const TriangleMesh& mesh, const MeshSlices& slices, int step) {
  const Grid& g = slices.grid();
  Point3 low = mesh.vertices[mesh.triangles[0][0]], high = low;
  for (const auto& t : mesh.triangles) {
    for (const std::uint32_t v : t) {
      for (std::size_t k = 0; k < 3; ++k) {
        low[k] = std::min(low[k], mesh.vertices[v][k]);
        high[k] = std::max(high[k], mesh.vertices[v][k]);
      }
    }
  }
  const Real px = g.pixel_x_um * 1e-3L, py = g.pixel_y_um * 1e-3L, layer = g.layer_um * 1e-3L;
  const auto x_mm = [&](int x) {
    return (x + 0.5L) * px - g.width_px * px / 2 + (Real{low[0]} + high[0]) / 2;
  };
  const auto y_mm = [&](int y) {
    return (Real{low[1]} + high[1]) / 2 + g.height_px * py / 2 - (y + 0.5L) * py;
  };
  const PixelBox b = slices.bounds();
  int edges = 0;
  for (int y = b.y0 + step / 2; y < b.y1; y += step) {
    // Triangles of the row, and the row's heights, once.
    std::vector<std::uint32_t> near;
    for (std::uint32_t i = 0; i < mesh.triangles.size(); ++i) {
      const auto& t = mesh.triangles[i];
      const auto [y0, y1] =
          std::minmax({mesh.vertices[t[0]][1], mesh.vertices[t[1]][1], mesh.vertices[t[2]][1]});
      if (y0 - 1e-6 <= y_mm(y) && y_mm(y) <= y1 + 1e-6) near.push_back(i);
    }
    std::vector<Bytes> row;
    slices.edge_heights()->read_band({b.x0, y, b.x1, y + 1}, [&](int, const std::uint8_t* rows) {
      const auto width = static_cast<std::size_t>(b.width());
      row.push_back(rows ? Bytes(rows, rows + width) : Bytes(width, 0));
    });
    for (int x = b.x0 + step / 2; x < b.x1; x += step) {
      auto its = crossings(mesh, near, x_mm(x), y_mm(y));
      if (!its) continue;
      int sum = 0;
      for (auto& [z, direction] : *its) z = (z - low[2]) / layer, sum += direction;
      for (int n = 0; n <= g.layers; ++n) {
        const int is = row[static_cast<std::size_t>(n)][static_cast<std::size_t>(x - b.x0)];
        const bool above = n > 0 && solid_at(*its, n - 0.5L);
        const bool below = n < g.layers && solid_at(*its, n + 0.5L);
        // Rounding may put what ends at a middle on either side of it.
        bool doubtful = false;
        for (const auto& [z, _] : *its) doubtful |= std::abs(z - std::floor(z) - 0.5L) < 1e-9L;
        if (doubtful) continue;
        const Real solid = solid_in(*its, n - 0.5L, n + 0.5L);
        const Real place = (above ? solid : 1 - solid) - 0.5L;
        const bool stands = n == 0 && std::abs(place) < kStep;
        if (sum != 0 || above == below || stands) {
          const bool rounded = stands && std::abs(std::abs(place) - 0.5L / 254) < 1e-8L;
          if (is != 0 && !rounded) ADD_FAILURE() << n << ": " << x << ", " << y << " is " << is;
          continue;
        }
        if (is == 0 ||
            std::abs(edge_height_slices(static_cast<std::uint8_t>(is)) - place) > kStep) {
          ADD_FAILURE() << n << ": " << x << ", " << y << " is " << is << ", not "
                        << static_cast<double>(128 + 254 * place);
        }
        ++edges;
      }
      if (testing::Test::HasFailure()) return edges;
    }
  }
  return edges;
}

TEST(EdgeHeights, OfRandomConvexBodiesAreThoseOfRays) {
  std::mt19937_64 random(24);
  std::uniform_real_distribution<double> any(0, 1);
  int compared = 0;
  for (int round = 0; round < rounds(12); ++round) {
    TriangleMesh mesh;
    const int bodies = 1 + round % 3;
    for (int i = 0; i < bodies; ++i) {
      TriangleMesh body = sphere(1.0, static_cast<int>(any(random) * 3));
      const Point3 size{0.3 + any(random), 0.3 + any(random), 0.2 + 0.8 * any(random)};
      const Point3 to{any(random), any(random), 0.5 * any(random)};
      for (Point3& v : body.vertices) {
        for (std::size_t k = 0; k < 3; ++k) v[k] *= size[k];
      }
      body = turned(body, 6 * any(random), 6 * any(random));
      for (Point3& v : body.vertices) {
        for (std::size_t k = 0; k < 3; ++k) v[k] += to[k];
      }
      mesh = mesh.triangles.empty() ? body : mesh + body;
    }
    const double layer_um = 20 + 180 * any(random);
    const MeshSlices slices(mesh, printer(90, 80, 50, 60), layer_of(layer_um));
    compared += expect_rays(mesh, slices, 1);
    if (HasFailure()) FAIL() << "round " << round;
  }
  // Small bodies have few edges within columns: hundreds on the average.
  EXPECT_GT(compared, 500 * rounds(12));
}

TEST(EdgeHeights, OfRealMeshesAreThoseOfRays) {
  for (const char* name :
       {"meshes/clean/3DBenchy.stl", "meshes/dirty/cgal_elephant-with-holes.off"}) {
    SCOPED_TRACE(name);
    const std::string path = real_file(name);
    SLICECORR_NEEDS_FILE(path);
    Placement placement;
    const bool benchy = std::string(name).find("Benchy") != std::string::npos;
    placement.scale = benchy ? 0.5 : 30;
    const TriangleMesh mesh = read_mesh(path, placement);
    const MeshSlices slices(mesh, printer(1000, 1000, 50, 50), layer_of(100));
    ASSERT_EQ(slices.report().turned_triangles, 0u);
    EXPECT_GT(expect_rays(mesh, slices, 7), benchy ? 3000 : 1000);
  }
}

/// Where coverage is full on one side of a node and empty on the other, the surface is in between.
TEST(EdgeHeights, AreThereWhereCoverageGoesFromFullToEmpty) {
  const std::string path = real_file("meshes/clean/3DBenchy.stl");
  SLICECORR_NEEDS_FILE(path);
  Placement placement;
  placement.scale = 0.5;
  const MeshSlices slices(read_mesh(path, placement), printer(1000, 1000, 50, 50), layer_of(100));
  const PixelBox b = slices.bounds();
  std::uint64_t edges = 0, without = 0, elsewhere = 0;
  for (int y = b.y0; y < b.y1; y += 16) {
    const PixelBox band{b.x0, y, b.x1, std::min(y + 4, b.y1)};
    const auto coverage = read(slices, band), heights = read(*slices.edge_heights(), band);
    const std::size_t layers = coverage.size();
    for (std::size_t n = 1; n <= layers; ++n) {
      for (std::size_t k = 0; k < heights[0].size(); ++k) {
        const int above = coverage[n - 1][k], below = n < layers ? coverage[n][k] : 0;
        if (std::abs(above - below) == 255) {
          ++edges;
          without += heights[n][k] == 0;
        } else if (above == below && above % 255 == 0) {
          elsewhere += heights[n][k] != 0;
        }
      }
    }
  }
  EXPECT_GT(edges, 10000u);
  // Full coverage is round(255 A): a slit of less than half a level may pass the centre.
  EXPECT_LE(without, edges / 1000);
  EXPECT_LE(elsewhere, edges / 1000);
}

}  // namespace
}  // namespace slicecorr
