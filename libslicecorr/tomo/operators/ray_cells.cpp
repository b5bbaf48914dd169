// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/operators/ray_cells.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "parallel/silent.hpp"
#include "slicecorr/error.hpp"
#include "tomo/operators/footprint_kernels.hpp"
#include "tomo/operators/shade.hpp"

namespace slicecorr::tomo::detail {

namespace {

struct FrameScratch {
  Array<float> at, shares;
};
FrameScratch& thread_scratch_of_frames() {
  static thread_local FrameScratch scratch;
  return scratch;
}

}  // namespace

RayCells::RayCells(const TomoGrid& grid, const LabRays& rays, const Volume* insert,
                   const Cells& cells)
    : grid_(grid), per_pixel_(rays.per_pixel) {
  grid.check();
  if (grid.rows != rays.rows || grid.pixels != rays.columns) {
    throw InputError("rays", "",
                     fmt::format("{} columns and {} rows of pixels; expected {} and {}, as the "
                                 "grid has",
                                 rays.columns, rays.rows, grid.pixels, grid.rows));
  }
  if (rays.rows < 2) throw InputError("rays", "", "have 1 row of pixels; expected 2 or more");
  if (static_cast<double>(grid.voxels_of_block()) > 0x7fffffff) {
    throw InputError("tomographic grid", "voxels",
                     fmt::format("{} x {} x {} are too many; expected at most 2^31", grid.voxels,
                                 grid.voxels, grid.slices));
  }
  double most_mm = 0;
  for (int a = 0; a < per_pixel_; ++a) maps_.emplace_back(grid, rays, a, cells.map_up);
  for (const LabRay& ray : rays.rays) {
    if (ray.half_mm > 0 && ray.power > 0) most_mm = std::max(most_mm, std::abs(ray.t_mm));
  }
  most_mm = std::min(most_mm, grid.radius_mm);
  if (cells.odd) {
    const double arc = 2 * std::numbers::pi / grid.angles * most_mm / grid.voxel_mm();
    directions_ = Directions::odd(grid.angles, arc, cells.most_voxels);
  } else {
    directions_ = Directions::of(grid.angles, most_mm / cells.most_voxels, grid.voxel_mm(), true);
  }
  for (int z = 0; z < grid.slices; ++z) {
    const double f = maps_[0].height_of(z);
    const int h = std::clamp(static_cast<int>(f), 0, maps_[0].heights() - 2);
    height_.push_back(h);
    above_.push_back(static_cast<float>(f - h));
  }
  take_turns(rays);
  if (insert != nullptr) cast(*insert);
}

void RayCells::take_turns(const LabRays& rays) {
  const auto at = [&](int c, int r, int a) -> const LabRay& {
    return rays.rays[(static_cast<std::size_t>(c) * static_cast<std::size_t>(rays.rows) +
                      static_cast<std::size_t>(r)) *
                         static_cast<std::size_t>(per_pixel_) +
                     static_cast<std::size_t>(a)];
  };
  const double step = directions_.step_rad();
  for (int a = 0; a < per_pixel_; ++a) {
    for (int c = 0; c < grid_.pixels; ++c) {
      double across = 0;
      for (int r = 0; r < grid_.rows; ++r) {
        turn_.push_back(static_cast<float>(at(c, r, a).turn_rad / step));
        const auto lit = [&](int i) {
          return i >= 0 && i < grid_.pixels && at(i, r, a).half_mm > 0;
        };
        if (!lit(c)) continue;
        const int left = lit(c - 1) ? c - 1 : c, right = lit(c + 1) ? c + 1 : c;
        if (right == left) continue;
        const double wide = (at(right, r, a).turn_rad - at(left, r, a).turn_rad) / (right - left);
        across = std::max(across, std::abs(wide) / step);
      }
      across_.push_back(static_cast<float>(across));
    }
  }
}

/// Calls use(place of column in light, shares of its rows) for each frame that is shown in a
/// direction.
template <class Use>
void RayCells::each_frame(int k, int column, const Use& use) const {
  FrameScratch& scratch = thread_scratch_of_frames();
  const int direction = k / per_pixel_, rows = grid_.rows;
  const auto ray = static_cast<std::size_t>(k % per_pixel_);
  const std::size_t of_column =
      ray * static_cast<std::size_t>(grid_.pixels) + static_cast<std::size_t>(column);
  const float* const turn = turn_.data() + of_column * static_cast<std::size_t>(rows);
  const float one = 1.0F / static_cast<float>(directions_.cells), other = across_[of_column];
  const float cell = (static_cast<float>(direction % directions_.cells) + 0.5F) * one - 0.5F;
  scratch.at.resize(static_cast<std::size_t>(rows));
  float least = cell - turn[0], most = least;
  for (int r = 0; r < rows; ++r) {
    const float at = cell - turn[r];
    scratch.at[static_cast<std::size_t>(r)] = at;
    least = std::min(least, at);
    most = std::max(most, at);
  }
  const float reach = (one + other) / 2;
  const auto first = static_cast<int>(std::floor(least - reach + 0.5F)),
             last = static_cast<int>(std::ceil(most + reach - 0.5F));
  const int frames = std::max(1, last - first + 1);
  scratch.shares.resize(static_cast<std::size_t>(frames) * static_cast<std::size_t>(rows));
  frame_shares(scratch.at.data(), rows, one, other, first, frames, scratch.shares.data());
  for (int s = 0; s < frames; ++s) {
    int m = (directions_.frame(direction) + first + s) % grid_.angles;
    if (m < 0) m += grid_.angles;
    use(grid_.pixel(m, column, 0),
        scratch.shares.data() + static_cast<std::size_t>(s) * static_cast<std::size_t>(rows));
  }
}

void RayCells::lines_of(int k, const float* light, float* to, int stride) const {
  for (int c = 0; c < grid_.pixels; ++c, to += stride) {
    each_frame(k, c, [&](std::size_t at, const float* share) {
      add_shares(share, light + at, grid_.rows, to);
    });
  }
}

void RayCells::back_from(int k, int column, const float* from, float* light) const {
  each_frame(k, column, [&](std::size_t at, const float* share) {
    add_shares(share, from, grid_.rows, light + at);
  });
}

const std::vector<RayCells::Shaded>* RayCells::dark(int k, int y) const {
  return shade_.empty()
             ? nullptr
             : &shade_[static_cast<std::size_t>(k) * static_cast<std::size_t>(grid_.voxels) +
                       static_cast<std::size_t>(y)];
}

void RayCells::cast(const Volume& insert) {
  if (!(insert.grid == grid_)) {
    throw InputError("insert", "", "must have the grid of the part");
  }
  const Box<std::uint8_t> box = box_of(insert);
  const RisingShade opaque(box);
  if (!opaque.any()) return;
  const auto n = static_cast<std::size_t>(grid_.voxels);
  shade_.resize(static_cast<std::size_t>(count()) * n);
  parallel_for({}, "", static_cast<std::size_t>(count()), [&](std::size_t k) {
    const RayMap& map = maps_[k % static_cast<std::size_t>(per_pixel_)];
    const double th = directions_.angle_rad(static_cast<int>(k) / per_pixel_);
    const double c = std::cos(th), s = std::sin(th);
    const double slices_per_side = grid_.voxel_mm() / grid_.slice_height_mm();
    std::vector<float> parts(static_cast<std::size_t>(map.heights()) * RayMapPart::count);
    for (int y = 0; y < grid_.voxels; ++y) {
      const TomoGrid::Range in = grid_.inside(y);
      for (int x = in.first; x < in.end; ++x) {
        const double px = grid_.voxel_at_mm(x), py = grid_.voxel_at_mm(y);
        map.over(px * c + py * s, py * c - px * s, parts.data());
        const float* const slope = parts.data() + static_cast<std::size_t>(RayMapPart::slope) *
                                                      static_cast<std::size_t>(map.heights());
        Shaded shaded{x, {}};
        for (int z = 0; z < grid_.slices; ++z) {
          const auto at = static_cast<std::size_t>(z);
          const float* const low = slope + height_[at];
          const double rises = low[0] + above_[at] * (low[1] - low[0]);
          if (opaque.hides(x, y, z, th, rises * slices_per_side)) shaded.slices.push_back(z);
        }
        if (!shaded.slices.empty()) shade_[k * n + static_cast<std::size_t>(y)].push_back(shaded);
      }
    }
  });
}

}  // namespace slicecorr::tomo::detail
