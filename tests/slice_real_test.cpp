// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Real meshes in slices, clean and dirty, against a cutter of the tests.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <numbers>
#include <string>
#include <vector>

#include "cuts.hpp"
#include "meshes.hpp"
#include "real_files.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/slice.hpp"

namespace slicecorr {
namespace {

namespace fs = std::filesystem;
using std::numbers::pi;
using namespace test;  // NOLINT: meshes and slices of the tests

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

}  // namespace
}  // namespace slicecorr
