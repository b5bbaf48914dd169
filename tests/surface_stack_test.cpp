// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Whole parts corrected to their mesh: the dose of the images that were written, against the tests'
// own rays through the mesh.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

#include "meshes.hpp"
#include "models.hpp"
#include "rays.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/slice.hpp"
#include "stack_fixture.hpp"

namespace slicecorr {
namespace {

using namespace test;  // NOLINT: meshes, models and rays of the tests

constexpr int kSide = 60;

/// Distances of the edges of a stack from the mesh, um, and columns whose edges are not as many.
struct Judged {
  enum Side { under, over };
  std::vector<double> um[2];  ///< of undersides, of upper sides
  int columns = 0, odd = 0;
  double mean(Side side) const {
    const auto& all = um[side];
    return std::accumulate(all.begin(), all.end(), 0.0) / static_cast<double>(all.size());
  }
  double mean() const {
    const auto count = static_cast<double>(um[under].size());
    const auto other = static_cast<double>(um[over].size());
    return (mean(under) * count + mean(over) * other) / (count + other);
  }
};

class SurfaceOfStacks : public ::testing::Test {
 protected:
  slicecorr::Setup setup(int bit_depth, ExposureMode mode = ExposureMode::continuous) const {
    slicecorr::Setup s;
    s.printer = linear_printer(1, 100, bit_depth);
    s.printer.width_px = s.printer.height_px = kSide;
    s.process = process(1000);
    s.resin = resin(576, mode == ExposureMode::layerwise ? 110 : 2000);
    if (mode == ExposureMode::layerwise) {
      s.process = {};
      s.process.mode = mode;
      s.process.exposure_s = 2.5 * 576 * 110e-4 * std::pow(10, 50.0 / 110) / (100 * std::log(10.0));
    }
    s.process.surface = Surface::mesh;
    return s;
  }

  /// Corrects the mesh's slices and samples what the written images dose along the columns whose
  /// neighbourhood is gentle; the mesh lies as the slicer places it.
  Judged judge(const TriangleMesh& mesh, double layer_um, const slicecorr::Setup& s, bool to_mesh) {
    SliceOptions options = layer_of(layer_um);
    options.edge_heights = to_mesh;
    const MeshSlices slices(mesh, s.printer, options);
    const std::string path = folder_ / "part.uvj";
    last_ = correct_stack(slices, s, path, {}).after;
    const StackReader stack(path, folder_.path());
    const CureModel model = make_cure_model(s.printer, s.resin, s.process, layer_um);
    const int all = stack.grid().layers;
    std::vector<Bytes> images(static_cast<std::size_t>(all), Bytes(kSide * kSide));
    for (int n = 0; n < all; ++n) {
      stack.read_slice(n, images[static_cast<std::size_t>(n)].data());
    }
    Point3 low = mesh.vertices[0], high = low;
    for (const Point3& v : mesh.vertices) {
      for (std::size_t k = 0; k < 3; ++k) {
        low[k] = std::min(low[k], v[k]);
        high[k] = std::max(high[k], v[k]);
      }
    }
    std::vector<std::uint32_t> triangles(mesh.triangles.size());
    std::iota(triangles.begin(), triangles.end(), 0U);
    Judged judged;
    const double pixel_mm = 0.05, middle = kSide * pixel_mm / 2;
    for (int y = 0; y < kSide; ++y) {
      for (int x = 0; x < kSide; ++x) {
        const double at_x = (x + 0.5) * pixel_mm - middle + 0.5 * (low[0] + high[0]);
        const double at_y = middle - (y + 0.5) * pixel_mm + 0.5 * (low[1] + high[1]);
        // Away from vertical sides, whose pixels are grey from end to end.
        const double clear = 1.01 * pixel_mm;
        if (at_x < low[0] + clear || at_x > high[0] - clear || at_y < low[1] + clear ||
            at_y > high[1] - clear) {
          continue;
        }
        const auto rays = crossings(mesh, triangles, at_x, at_y);
        if (!rays) continue;
        std::vector<double> wanted;
        for (const auto& [z, direction] : *rays) {
          const auto slices_up = static_cast<double>((z - low[2]) / (layer_um * 1e-3));
          if (slices_up > 0.01) wanted.push_back(slices_up);
        }
        // What lies less than half a slice above the platform has no layer of gap below it.
        if (!wanted.empty() && wanted.front() < 0.6) continue;
        const std::vector<double> printed = edges_of(model, s, images, y * kSide + x);
        ++judged.columns;
        if (printed.size() != wanted.size()) {
          ++judged.odd;
          continue;
        }
        for (std::size_t k = 0; k < wanted.size(); ++k) {
          judged.um[k % 2].push_back(std::abs(printed[k] - wanted[k]) * layer_um);
        }
      }
    }
    return judged;
  }

  /// Where the dose of a column passes 1, in slices from the platform; by samples that are 1/64 of
  /// a slice apart, and a straight line between them.
  static std::vector<double> edges_of(const CureModel& model, const slicecorr::Setup& s,
                                      const std::vector<Bytes>& images, int pixel) {
    const int all = static_cast<int>(images.size());
    const bool layerwise = s.process.mode == ExposureMode::layerwise;
    constexpr int samples = 64;
    std::vector<double> dose(static_cast<std::size_t>(all) * samples);
    double left[samples];
    for (int k = 0; k < samples; ++k) {
      left[k] = std::pow(model.a, 1 - (k + 0.5) / samples);  // from the lower node
    }
    double later = 0;
    for (int n = all; n-- > 0;) {
      const auto value = images[static_cast<std::size_t>(n)][static_cast<std::size_t>(pixel)];
      const double phi =
          model.level_phi[static_cast<std::size_t>(level_of_pixel(value, s.printer.levels()))];
      for (int k = 0; k < samples; ++k) {
        dose[static_cast<std::size_t>(n * samples + k)] =
            layerwise ? (phi + later) * left[k] : phi + (later - phi) * left[k];
      }
      later = layerwise ? (phi + later) * model.a : phi + (later - phi) * model.a;
    }
    std::vector<double> edges;
    for (std::size_t i = 1; i < dose.size(); ++i) {
      if ((dose[i - 1] >= 1) == (dose[i] >= 1)) continue;
      const double t = (1 - dose[i - 1]) / (dose[i] - dose[i - 1]);
      edges.push_back((static_cast<double>(i) - 0.5 + t) / samples);
    }
    if (dose.back() >= 1) edges.push_back(all);
    return edges;
  }

  TemporaryFolder folder_;
  Prediction last_;
};

/// A plate whose two sides rise with x; its lower side begins at the platform.
TriangleMesh sloping_plate(double degrees, double wide_mm = 2.5) {
  TriangleMesh mesh = box({0, 0, 0}, {2.5, wide_mm, 0.9});
  for (Point3& v : mesh.vertices) v[2] += std::tan(degrees * std::numbers::pi / 180) * v[0];
  return mesh;
}

TEST_F(SurfaceOfStacks, ShallowUndersidesLieOnTheMesh) {
  for (const double degrees : {5.0, 20.0, 45.0}) {
    for (const double layer_um : {25.0, 50.0, 100.0, 200.0}) {
      const TriangleMesh mesh = sloping_plate(degrees, 0.5);
      const Judged on_mesh = judge(mesh, layer_um, setup(8), true);
      EXPECT_LE(on_mesh.odd * 50, on_mesh.columns) << degrees << " " << layer_um;
      // A step of edge heights is layer_um / 254; a level moves an edge by more than a um at 50 um.
      EXPECT_LE(on_mesh.mean(), 2.0) << degrees << " " << layer_um;
      EXPECT_EQ(last_.cure_through_voxels + last_.undercure_voxels, 0U);
      // Of layers in which an edge lies, the part beyond it is not inside.
      EXPECT_GE(last_.min_inside_layers, 0.999);
      EXPECT_NEAR(last_.surface_error_um.mean(), on_mesh.mean(), 0.5) << degrees << " " << layer_um;
      // Stairs are off by up to half a slice, evenly spread: by a quarter in the mean.
      if (degrees == 5) {
        const Judged on_slices = judge(mesh, layer_um, setup(8), false);
        EXPECT_NEAR(on_slices.mean(), layer_um / 4, layer_um / 20) << layer_um;
      }
    }
  }
}

TEST_F(SurfaceOfStacks, SixteenLevelsComeNear) {
  const Judged on_mesh = judge(sloping_plate(5), 50, setup(4), true);
  const Judged on_slices = judge(sloping_plate(5), 50, setup(4), false);
  EXPECT_LE(on_mesh.mean(), on_slices.mean() / 4);
}

TEST_F(SurfaceOfStacks, SpheresAreRound) {
  const Judged ball = judge(sphere(1.2, 4), 100, setup(8), true);
  EXPECT_LE(ball.mean(), 2.0);
}

TEST_F(SurfaceOfStacks, LayerByLayerUndersidesLieOnTheMeshAndUpperSidesAtTheWindow) {
  for (const double degrees : {5.0, 20.0}) {
    const slicecorr::Setup s = setup(8, ExposureMode::layerwise);
    const TriangleMesh mesh = sloping_plate(degrees, 0.5);
    const Judged on_mesh = judge(mesh, 50, s, true);
    EXPECT_EQ(on_mesh.odd, 0) << degrees;
    EXPECT_EQ(last_.cure_through_voxels + last_.undercure_voxels, 0U);
    EXPECT_LE(on_mesh.mean(Judged::under), 2.0) << degrees;
    // Height errors are those that light decides: of upper sides, from the window.
    EXPECT_LE(last_.height_error_um.mean(), 2.0) << degrees;
    // Where the window was: at the nearest node, evenly spread over half a slice to either side.
    EXPECT_NEAR(on_mesh.mean(Judged::over), 12.5, 1.0) << degrees;
    const Judged on_slices = judge(mesh, 50, s, false);
    EXPECT_GT(on_slices.mean(Judged::under), 10.0) << degrees;
  }
}

TEST_F(SurfaceOfStacks, MapsShowTheStairs) {
  const TriangleMesh mesh = sloping_plate(5);
  for (const bool to_mesh : {true, false}) {
    SliceOptions options = layer_of(100);
    options.edge_heights = true;
    slicecorr::Setup s = setup(8);
    s.process.surface = to_mesh ? Surface::mesh : Surface::slices;
    const MeshSlices slices(mesh, s.printer, options);
    const std::string path = folder_ / "part.uvj";
    const Prediction made = correct_stack(slices, s, path, {.before = true}).after;
    const StackReader stack(path, folder_.path());
    const Prediction p = verify_stack(stack, slices, s);
    ASSERT_TRUE(p.maps);
    const SurfaceMaps& maps = *p.maps;
    EXPECT_EQ(maps.pixels_per_cell, 1);
    ASSERT_EQ(maps.below_um.size(), static_cast<std::size_t>(maps.width * maps.height));
    const int row = maps.height / 2;
    double largest = 0;
    int rises = 0, seen = 0;
    float before = 0;
    for (int x = 0; x < maps.width; ++x) {
      const float um = maps.below_um[static_cast<std::size_t>(row * maps.width + x)];
      if (std::isnan(um)) continue;
      largest = std::max(largest, std::abs(static_cast<double>(um)));
      rises += seen > 0 && std::abs(um - before) > 50;
      before = um;
      ++seen;
    }
    // What begins less than half a slice above the platform lies on it.
    EXPECT_GT(seen, 30);
    if (to_mesh) {
      EXPECT_LE(largest, 5.0);
      // What the correction itself says, where it had the heights, too.
      ASSERT_TRUE(made.maps);
      for (std::size_t k = 0; k < maps.above_um.size(); ++k) {
        if (std::isnan(maps.above_um[k])) continue;
        EXPECT_EQ(made.maps->above_um[k], maps.above_um[k]);
      }
    } else {
      // 2.5 mm at 5 degrees rise over more than two slices, of which the print takes the second and
      // the third in steps.
      EXPECT_GT(largest, 40.0);
      EXPECT_GE(rises, 1);
    }
  }
}

TEST_F(SurfaceOfStacks, UnevenLightAndOtherExponentsAreNoDifferent) {
  const TriangleMesh mesh = sloping_plate(5);
  for (const double m : {0.7, 1.0}) {
    slicecorr::Setup s = setup(8);
    s.resin.m = m;
    // About the dose of as much light at each.
    if (m != 1.0) s.resin.critical_dose_prime = 20;
    FlatField field;
    field.width_px = kSide;
    field.height_px = 1;
    std::vector<std::uint8_t> values;
    for (int x = 0; x < kSide; ++x) values.push_back(static_cast<std::uint8_t>(255 - x));
    field.values = std::make_shared<const std::vector<std::uint8_t>>(std::move(values));
    s.printer.flat_field = field;
    SliceOptions options = layer_of(50);
    options.edge_heights = true;
    const MeshSlices slices(mesh, s.printer, options);
    const std::string path = folder_ / "part.uvj";
    const Prediction made = correct_stack(slices, s, path, {}).after;
    const Prediction p = verify_stack(StackReader(path, folder_.path()), slices, s);
    EXPECT_EQ(p.surface_error_um.count(), made.surface_error_um.count());
    EXPECT_EQ(p.surface_error_um.mean(), made.surface_error_um.mean());
    EXPECT_GT(p.surface_error_um.count(), 3000U);
    EXPECT_LE(p.surface_error_um.mean(), 2.0) << m;
    EXPECT_EQ(p.cure_through_voxels + p.undercure_voxels, 0U) << m;
  }
}

}  // namespace
}  // namespace slicecorr
