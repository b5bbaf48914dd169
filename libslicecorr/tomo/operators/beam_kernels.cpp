// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/operators/beam_kernels.hpp"

#include <algorithm>
#include <cmath>

#include "tomo/operators/slice_kernels.hpp"

namespace slicecorr::tomo::detail {
namespace {

constexpr int kVoxelPad = 56, kPixelPad = 48;
constexpr int kTile = 16;

SliceWork& thread_work() {
  static thread_local SliceWork work;
  return work;
}

/// Calls use(x, y) for the voxels of the rows [y0, y0 + kTile), tile by tile: one of the two ways of
/// memory is always across.
template <class Use>
void each_voxel(const ParallelBeam& beam, int y0, const Use& use) {
  const int n = beam.grid.voxels;
  for (int x0 = 0; x0 < n; x0 += kTile) {
    for (int y = y0; y < std::min(y0 + kTile, n); ++y) {
      const int xa = std::max(x0, beam.inside[y].first);
      const int xb = std::min(x0 + kTile, beam.inside[y].end);
      for (int x = xa; x < xb; ++x) use(x, y);
    }
  }
}

std::size_t tiles(int n, int rows) { return static_cast<std::size_t>((n + rows - 1) / rows); }

/// Places of voxel (x, y) turned by 90 t degrees: where the light of turn t that was worked out for
/// (x, y) falls.
struct Place {
  int x, y;
};
Place turned(int x, int y, int t, int n) {
  switch (t) {
    case 0:
      return {x, y};
    case 1:
      return {n - 1 - y, x};
    case 2:
      return {n - 1 - x, n - 1 - y};
    default:
      return {y, n - 1 - x};
  }
}

}  // namespace

void Padded::size(std::size_t rows, int count, int pad, float fill) {
  before = pad;
  stride = (count + 2 * static_cast<std::size_t>(pad) + 15) / 16 * 16;
  numbers.assign(rows * stride + 32, fill);
}

void Padded::make(const float* from, std::size_t rows, int count, int pad) {
  size(rows, count, pad, 0);
  for (std::size_t r = 0; r < rows; ++r) std::copy_n(from + r * count, count, row(r));
}

std::shared_ptr<const SliceTables> make_slice_tables(const ParallelBeam& beam) {
  if (beam.grid.lanes() != 1) return nullptr;
  auto tables = std::make_shared<SliceTables>();
  tables->fine = beam.grid.voxel_mm() > beam.grid.pixel_mm * (1 + 1e-9);
  const int n = beam.grid.voxels;
  const std::size_t base = static_cast<std::size_t>(beam.base_angles());
  if (beam.attenuated) {
    tables->ex.make(beam.ex.data(), base, n, kVoxelPad);
    tables->ey.make(beam.ey.data(), base, n, kVoxelPad);
  }
  if (beam.shadow) {
    tables->ux.make(beam.ux.data(), base, n, kVoxelPad);
    tables->uy.make(beam.uy.data(), base, n, kVoxelPad);
  }
  for (std::size_t m = 0; m < base; ++m) {
    const BeamAngle& a = beam.angles[m];
    const bool x_is_flat = std::abs(a.cx) <= std::abs(a.cy);
    for (LaneAngles* way : {&tables->flat, &tables->steep}) {
      const bool along_x = x_is_flat == (way == &tables->flat);
      LaneAngle angle{.c = along_x ? a.cx : a.cy, .cr = along_x ? a.cy : a.cx, .f0 = a.f0};
      if (beam.attenuated) {
        angle.e = (along_x ? tables->ex : tables->ey).row(m);
        angle.e_rows = (along_x ? tables->ey : tables->ex).row(m);
      }
      if (beam.shadow) {
        angle.u = (along_x ? tables->ux : tables->uy).row(m);
        angle.u_rows = (along_x ? tables->uy : tables->ux).row(m);
      }
      way->chosen[along_x].push_back(static_cast<int>(m));
      way->angles[along_x].push_back(angle);
    }
  }
  return tables;
}

void slice_adjoint(const ParallelBeam& beam, const float* hit, const float* light, float* field,
                   const ExecutionContext& context) {
  SliceWork& work = thread_work();
  const int n = beam.grid.voxels, pixels = beam.grid.pixels;
  const std::size_t count = beam.angles.size();
  // Groups reach up to 15 voxels and 7 rows out of the disc.
  const double step = beam.grid.voxel_mm() / beam.grid.pixel_mm;
  const int pad =
      std::max(0, static_cast<int>(0.5 * (n - 1) * step - 0.5 * (pixels - 1))) + 2 * kPixelPad;
  work.light.make(light, count, pixels, pad);
  work.shadow = hit != nullptr;
  if (hit != nullptr) work.hit.make(hit, count, pixels, pad);
  work.stride = (static_cast<std::size_t>(n) + 15) / 16 * 16;
  for (auto& way : work.out) {
    for (int t = 0; t < beam.turns; ++t) way[t].resize(work.stride * n);
  }
  // Two turns at once, two ways.
  const std::size_t rows = tiles(n, kAdjointRows);
  const std::size_t pairs = static_cast<std::size_t>(beam.turns + 1) / 2;
  parallel_for(context, "", 2 * pairs * rows, [&](std::size_t i) {
    slice_adjoint_rows(beam, work, i % 2 == 1, static_cast<int>(i / 2 % pairs) * 2,
                       static_cast<int>(i / 2 / pairs) * kAdjointRows);
  });
  std::fill_n(field, static_cast<std::size_t>(n) * n, 0.0f);
  parallel_for(context, "", tiles(n, kTile), [&](std::size_t i) {
    each_voxel(beam, static_cast<int>(i) * kTile, [&](int x, int y) {
      float sum = 0;
      for (int t = 0; t < beam.turns; ++t) {
        // Turned back, to where it was worked out.
        const Place p = turned(x, y, (4 - t) % 4, n);
        sum += work.out[1][t][p.y * work.stride + p.x] + work.out[0][t][p.x * work.stride + p.y];
      }
      field[static_cast<std::size_t>(y) * n + x] = sum;
    });
  });
}

void slice_forward(const ParallelBeam& beam, const float* hit, const float* field, float* light,
                   const ExecutionContext& context) {
  SliceWork& work = thread_work();
  const int n = beam.grid.voxels;
  work.shadow = hit != nullptr;
  if (hit != nullptr) work.hit.make(hit, beam.angles.size(), beam.grid.pixels, kPixelPad);
  for (auto& way : work.voxels) {
    for (int t = 0; t < beam.turns; ++t) way[t].size(static_cast<std::size_t>(n), n, kVoxelPad, 0);
  }
  parallel_for(context, "", tiles(n, kTile), [&](std::size_t i) {
    each_voxel(beam, static_cast<int>(i) * kTile, [&](int x, int y) {
      const float value = field[static_cast<std::size_t>(y) * n + x];
      for (int t = 0; t < beam.turns; ++t) {
        const Place p = turned(x, y, (4 - t) % 4, n);
        work.voxels[1][t].row(static_cast<std::size_t>(p.y))[p.x] = value;
        work.voxels[0][t].row(static_cast<std::size_t>(p.x))[p.y] = value;
      }
    });
  });
  const LaneAngles& angles = beam.slice->steep;
  const std::size_t along_y = angles.chosen[0].size(), all = along_y + angles.chosen[1].size();
  parallel_for(context, "", tiles(static_cast<int>(all), kForwardAngles), [&](std::size_t piece) {
    for (std::size_t k = piece * kForwardAngles; k < std::min(all, (piece + 1) * kForwardAngles);
         ++k) {
      slice_forward_angle(beam, work, k >= along_y, k < along_y ? k : k - along_y, light);
    }
  });
}

void beam_adjoint(const ParallelBeam& beam, const float* hit, const float* light, float* field,
                  const ExecutionContext& context) {
  beam.slice != nullptr ? slice_adjoint(beam, hit, light, field, context)
                        : lane_adjoint(beam, hit, light, field, context);
}

void beam_forward(const ParallelBeam& beam, const float* hit, const float* field, float* light,
                  const ExecutionContext& context) {
  beam.slice != nullptr ? slice_forward(beam, hit, field, light, context)
                        : lane_forward(beam, hit, field, light, context);
}

}  // namespace slicecorr::tomo::detail
