// Rays that spread, rise and bend: the pair of operators against a reference in double precision, closed forms of
// uniform light, and rays marched at random by Snell's law.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "models.hpp"
#include "ray_reference.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/tomo/rays.hpp"
#include "slicecorr/vial.hpp"

namespace slicecorr::tomo {
namespace {

constexpr double kPi = std::numbers::pi;

std::vector<double> random_numbers(std::size_t count, unsigned seed) {
  std::mt19937 random(seed);
  std::vector<double> numbers(count);
  // Multiples of 2^-16 are the same in single precision.
  for (double& x : numbers) x = (random() >> 16) / 65536.0;
  return numbers;
}

/// Webber's vial, dry, before a projector of these optics.
Printer vial_printer(OpticsKind kind, double pixel_mm, int width, int height) {
  Printer p;
  p.name = "bench";
  p.width_px = width;
  p.height_px = height;
  p.pixel_x_um = p.pixel_y_um = pixel_mm * 1e3;
  p.vial = Vial{12.5, 11.8, 1.0, 1.48};
  p.optics = Optics{kind, kind == OpticsKind::pinhole ? 99.5 : 0};
  p.rotation = Rotation{25};
  return p;
}
constexpr double kResin = 1.49969;

struct Case {
  const char* name;
  Printer printer;
  double alpha_per_mm;
};
std::vector<Case> cases() {
  std::vector<Case> all;
  all.push_back({"telecentric", vial_printer(OpticsKind::telecentric, 1, 20, 14), 0});
  all.push_back({"pinhole", vial_printer(OpticsKind::pinhole, 1, 20, 14), 0.08});
  Case wide{"aperture", vial_printer(OpticsKind::pinhole, 1, 20, 14), 0.04};
  wide.printer.optics->half_angle_deg = 6;
  wide.printer.optics->rays_per_pixel = 13;
  all.push_back(wide);
  Case high{"far above the axis", vial_printer(OpticsKind::pinhole, 1, 20, 14), 0.04};
  high.printer.optics->axis_up_px = -15;
  all.push_back(high);
  return all;
}

TomoGrid grid_of(const LabRays& rays, int voxels, int slices, int angles, double slice_mm) {
  TomoGrid g;
  g.voxels = voxels;
  g.slices = slices;
  g.angles = angles;
  g.pixels = rays.columns;
  g.rows = rays.rows;
  g.pixel_mm = 1;
  g.radius_mm = 11.5;
  g.slice_mm = slice_mm;
  g.lowest_mm = -0.5 * slice_mm * (slices - 1);
  return g;
}

TEST(TomoRays, FastPairIsTheReferenceWhichIsATransposedPair) {
  for (const Case& c : cases()) {
    SCOPED_TRACE(c.name);
    const LabRays rays = lab_rays(c.printer, kResin, c.alpha_per_mm, {0, 0, 20, 14, 1});
    for (const auto& [slices, slice_mm] : {std::pair{19, 0.7}, {5, 1.0}, {40, 0.45}}) {
      TomoGrid g = grid_of(rays, 23, slices, 12, slice_mm);
      if (c.printer.optics->axis_up_px != 0) g.lowest_mm = 15 - 3;
      const test::ReferenceRays reference(g, rays);
      const auto x = random_numbers(reference.voxels(), 1);
      const auto b = random_numbers(reference.pixels(), 2);
      const auto ax = reference.forward(x), atb = reference.adjoint(b);
      double left = 0, right = 0;
      for (std::size_t i = 0; i < b.size(); ++i) left += ax[i] * b[i];
      for (std::size_t i = 0; i < x.size(); ++i) right += x[i] * atb[i];
      EXPECT_NEAR(left / right, 1, 1e-12);
      ASSERT_GT(left, 0);

      Field field(g);
      Light light(g);
      for (int z = 0; z < g.slices; ++z) {
        for (int y = 0; y < g.voxels; ++y) {
          for (int k = 0; k < g.voxels; ++k) {
            field.values[g.voxel(k, y, z)] = static_cast<float>(x[reference.voxel(k, y, z)]);
          }
        }
      }
      std::size_t i = 0;
      for (int m = 0; m < g.angles; ++m) {
        for (int column = 0; column < g.pixels; ++column) {
          for (int r = 0; r < g.rows; ++r) {
            light.values[g.pixel(m, column, r)] = static_cast<float>(b[i++]);
          }
        }
      }
      const auto projector = make_ray_projector(g, rays);
      const Light got_ax = forward(*projector, {}, field);
      const Field got_atb = adjoint(*projector, {}, light);
      // Places are wrong by up to 4 2^-24 of 23 voxels, weights by six times that at most (two planes
      // along three axes), values by ten roundings, sums of n terms by n 2^-24.
      double most = 0, off = 0, terms = 23 * 4 * rays.per_pixel;
      i = 0;
      for (int m = 0; m < g.angles; ++m) {
        for (int column = 0; column < g.pixels; ++column) {
          for (int r = 0; r < g.rows; ++r, ++i) {
            most = std::max(most, ax[i]);
            off = std::max(off, std::abs(ax[i] - got_ax.values[g.pixel(m, column, r)]));
          }
        }
      }
      EXPECT_LE(off, most * (24 * 23 + 10 + terms) * 0x1p-24) << slices;
      most = off = 0;
      terms = 4.0 * g.angles * rays.per_pixel;
      for (int z = 0; z < g.slices; ++z) {
        for (int y = 0; y < g.voxels; ++y) {
          for (int k = 0; k < g.voxels; ++k) {
            const double want = atb[reference.voxel(k, y, z)];
            most = std::max(most, want);
            off = std::max(off, std::abs(want - got_atb.values[g.voxel(k, y, z)]));
          }
        }
      }
      EXPECT_LE(off, most * (24 * 23 + 10 + terms) * 0x1p-24) << slices;
      // Lanes without a slice or a row stay 0.
      for (std::size_t v = 0; v < got_atb.values.size(); ++v) {
        if (static_cast<int>(v % g.lanes()) >= g.slices) {
          ASSERT_EQ(got_atb.values[v], 0);
        }
      }
    }
  }
}

TEST(TomoRays, SameBytesForAnyNumberOfThreads) {
  const Case c = cases()[2];
  const LabRays rays = lab_rays(c.printer, kResin, c.alpha_per_mm, {0, 0, 20, 14, 1});
  const TomoGrid g = grid_of(rays, 23, 40, 12, 0.4);
  Light light(g);
  const auto numbers = random_numbers(light.values.size(), 3);
  for (std::size_t i = 0; i < numbers.size(); ++i) light.values[i] = static_cast<float>(numbers[i]);
  ExecutionContext one, three;
  one.threads = 1;
  three.threads = 3;
  const auto single = make_ray_projector(g, rays, one);
  const auto triple = make_ray_projector(g, rays, three);
  const Field a = adjoint(*single, one, light), b = adjoint(*triple, three, light);
  EXPECT_EQ(a.values, b.values);
  EXPECT_EQ(forward(*single, one, a).values, forward(*triple, three, a).values);
}

}  // namespace
}  // namespace slicecorr::tomo
