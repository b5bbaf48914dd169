// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "parallel/silent.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/tomo/rays.hpp"
#include "tomo/operators/ray_kernels.hpp"

namespace slicecorr::tomo {

namespace {

using detail::RayWalk;
using detail::RowRange;
using detail::WalkRay;
using slicecorr::detail::silent;

/// Slices of a slab, whose dose one thread adds up: a cache line, less where there are few. What
/// crosses between two slabs is looked at twice.
int slab_slices(int slices) { return slices >= 128 ? 16 : 8; }

class RayProjector final : public Projector {
 public:
  RayProjector(const TomoGrid& grid, const LabRays& rays, const Volume* insert) {
    grid.check();
    if (grid.rows != rays.rows || grid.pixels != rays.columns) {
      throw InputError("rays", "",
                       fmt::format("{} columns and {} rows of pixels; expected {} and {}, as the "
                                   "grid has",
                                   rays.columns, rays.rows, grid.pixels, grid.rows));
    }
    if (static_cast<double>(grid.voxels_of_block()) > 0x7fffffff) {
      throw InputError("tomographic grid", "voxels",
                       fmt::format("{} x {} x {} are too many; expected at most 2^31", grid.voxels,
                                   grid.voxels, grid.slices));
    }
    walk_.grid = grid;
    walk_.per_pixel = rays.per_pixel;
    for (int m = 0; m < grid.angles; ++m) {
      walk_.cosine.push_back(std::cos(grid.angle_rad(m)));
      walk_.sine.push_back(std::sin(grid.angle_rad(m)));
    }
    const double side = grid.voxel_mm(), height = grid.slice_height_mm();
    const double density = rays.pixel_area_mm2 / (side * side * height);
    walk_.alpha = static_cast<float>(rays.alpha_per_mm * side);
    walk_.rays.reserve(rays.rays.size());
    for (const LabRay& ray : rays.rays) {
      WalkRay w;
      if (ray.half_mm > 0 && ray.power > 0) {
        const double stretch = std::sqrt(1 + ray.slope * ray.slope);
        w.cos_turn = static_cast<float>(std::cos(ray.turn_rad));
        w.sin_turn = static_cast<float>(std::sin(ray.turn_rad));
        w.t = static_cast<float>(ray.t_mm / side);
        w.half = static_cast<float>(ray.half_mm / side);
        w.entry = static_cast<float>((ray.entry_z_mm - grid.lowest_mm) / height);
        w.rise = static_cast<float>(ray.slope * side / height);
        w.stretch = static_cast<float>(stretch);
        w.share = static_cast<float>(density * ray.power * stretch * side);
      }
      walk_.rays.push_back(w);
    }
    make_slabs();
    if (insert != nullptr) cast_shadows(*insert);
  }

  Shape shape() const override { return walk_.grid.shape(); }

  void forward(std::size_t /*block*/, const float* field, float* light,
               const ExecutionContext& context) const override {
    Array<float> resin;
    if (beyond_resin(field)) {
      resin.assign(field, field + walk_.grid.voxels_of_block());
      for_each_beyond([&](std::size_t v) {
        std::fill_n(resin.data() + v, walk_.grid.slices, 0.0f);
        return false;
      });
      field = resin.data();
    }
    parallel_for(
        silent(context), "", static_cast<std::size_t>(walk_.grid.angles),
        [&](std::size_t m) { detail::walk_forward(walk_, static_cast<int>(m), field, light); });
  }

  void adjoint(std::size_t /*block*/, const float* light, float* field,
               const ExecutionContext& context) const override {
    const TomoGrid& g = walk_.grid;
    parallel_for(silent(context), "", slabs_.size(), [&](std::size_t s) {
      const Slab& slab = slabs_[s];
      const bool last = slab.end == g.slices;
      const std::size_t lanes = g.lanes();
      const std::size_t columns = static_cast<std::size_t>(g.voxels) * g.voxels;
      for (std::size_t i = 0; i < columns; ++i) {
        float* const column = field + i * lanes;
        std::fill(column + slab.first, column + (last ? g.lanes() : slab.end), 0.0f);
      }
      detail::walk_adjoint(walk_, slab.first, slab.end, slab.rows, light, field);
      for_each_beyond([&](std::size_t v) {
        std::fill(field + v + slab.first, field + v + slab.end, 0.0f);
        return false;
      });
    });
  }

 private:
  struct Slab {
    int first = 0, end = 0;
    std::vector<RowRange> rows;  ///< per column
  };

  /// Calls `use` with the lowest voxel of each column beyond R, until it says true; whether it did.
  template <class Use>
  bool for_each_beyond(Use use) const {
    const TomoGrid& g = walk_.grid;
    for (int y = 0; y < g.voxels; ++y) {
      const TomoGrid::Range in = g.inside(y);
      for (int x = 0; x < g.voxels; ++x) {
        if (x == in.first && in.end > in.first) x = in.end;
        if (x < g.voxels && use(g.voxel(x, y, 0))) return true;
      }
    }
    return false;
  }
  /// Whether a field says something of voxels that hold no resin.
  bool beyond_resin(const float* field) const {
    return for_each_beyond([&](std::size_t v) {
      return std::any_of(field + v, field + v + walk_.grid.slices, [](float f) { return f != 0; });
    });
  }

  void cast_shadows(const Volume& insert) {
    if (!(insert.grid == walk_.grid)) {
      throw InputError("insert", "", "must have the grid of the part");
    }
    const std::size_t rays = walk_.rays.size();
    walk_.ends.resize(rays * static_cast<std::size_t>(walk_.grid.angles));
    parallel_for({}, "", static_cast<std::size_t>(walk_.grid.angles), [&](std::size_t m) {
      detail::walk_to_shadow(walk_, static_cast<int>(m), insert.coverage.data(),
                             walk_.ends.data() + m * rays);
    });
  }

  void make_slabs() {
    const TomoGrid& g = walk_.grid;
    const int thick = slab_slices(g.slices), count = std::max(1, g.slices / thick);
    for (int s = 0; s < count; ++s) {
      Slab slab;
      slab.first = s * thick;
      slab.end = s + 1 == count ? g.slices : slab.first + thick;
      for (int c = 0; c < g.pixels; ++c) {
        RowRange range{g.rows, 0};
        for (int r = 0; r < g.rows; ++r) {
          if (!meets(slab, c, r)) continue;
          range.first = std::min(range.first, r);
          range.end = r + 1;
        }
        range.first = std::min(range.first, range.end);
        slab.rows.push_back(range);
      }
      slabs_.push_back(std::move(slab));
    }
  }

  bool meets(const Slab& slab, int column, int row) const {
    for (int k = 0; k < walk_.per_pixel; ++k) {
      const WalkRay& ray =
          walk_.rays[(static_cast<std::size_t>(column) * walk_.grid.rows + row) * walk_.per_pixel +
                     k];
      if (!(ray.half > 0)) continue;
      const float last = ray.entry + ray.rise * 2 * ray.half;
      if (std::max(ray.entry, last) >= static_cast<float>(slab.first - 1) &&
          std::min(ray.entry, last) <= static_cast<float>(slab.end)) {
        return true;
      }
    }
    return false;
  }

  RayWalk walk_;
  std::vector<Slab> slabs_;
};

}  // namespace

std::unique_ptr<Projector> make_ray_projector(const TomoGrid& grid, const LabRays& rays,
                                              const Volume* insert) {
  return std::make_unique<RayProjector>(grid, rays, insert);
}

}  // namespace slicecorr::tomo
