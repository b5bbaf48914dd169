// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Samples per second of rays that spread and rise, on one thread: out (light to dose) and in.
#include <benchmark/benchmark.h>

#include <cmath>

#include "slicecorr/tomo/rays.hpp"

namespace slicecorr::tomo {
namespace {

/// A pinhole before a dry vial, n x n pixels and n^3 voxels, 16 angles.
struct Problem {
  ExecutionContext one;
  TomoGrid grid;
  std::unique_ptr<Projector> projector;
  double samples = 0;

  explicit Problem(int n) {
    Printer p;
    p.width_px = p.height_px = n;
    p.pixel_x_um = p.pixel_y_um = 23600.0 / n;
    p.vial = Vial{12.5, 11.8, 1, 1.48};
    p.optics = Optics{OpticsKind::pinhole, 99.5};
    p.rotation = Rotation{25};
    const LabRays rays = lab_rays(p, 1.49969, 0.04, {0, 0, n, n, 1, 1});
    grid.voxels = grid.slices = grid.pixels = grid.rows = n;
    grid.angles = 16;
    grid.pixel_mm = 23.6 / n;
    grid.radius_mm = 11.7;
    grid.lowest_mm = -11.7;
    one.threads = 1;
    projector = make_ray_projector(grid, rays);
    for (const LabRay& ray : rays.rays) {
      samples += grid.angles * std::ceil(2 * ray.half_mm / grid.voxel_mm());
    }
  }
};

void Adjoint(benchmark::State& state) {
  const Problem p(static_cast<int>(state.range(0)));
  Light light(p.grid);
  std::fill(light.values.begin(), light.values.end(), 1.0f);
  Field field(p.grid);
  for (auto _ : state) {
    p.projector->adjoint(0, light.values.data(), field.values.data(), p.one);
  }
  state.SetItemsProcessed(
      static_cast<std::int64_t>(static_cast<double>(state.iterations()) * p.samples));
}
BENCHMARK(Adjoint)->Arg(128)->Arg(256)->Unit(benchmark::kMillisecond);

void Forward(benchmark::State& state) {
  const Problem p(static_cast<int>(state.range(0)));
  Light light(p.grid);
  Field field(p.grid);
  for (auto _ : state) {
    p.projector->forward(0, field.values.data(), light.values.data(), p.one);
  }
  state.SetItemsProcessed(
      static_cast<std::int64_t>(static_cast<double>(state.iterations()) * p.samples));
}
BENCHMARK(Forward)->Arg(128)->Arg(256)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace slicecorr::tomo
