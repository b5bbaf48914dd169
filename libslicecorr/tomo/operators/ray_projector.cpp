// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "parallel/silent.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/tomo/rays.hpp"
#include "tomo/operators/directions.hpp"
#include "tomo/operators/footprint.hpp"
#include "tomo/operators/footprint_kernels.hpp"
#include "tomo/operators/ray_map.hpp"
#include "tomo/operators/shade.hpp"

namespace slicecorr::tomo {

namespace {

using detail::Directions;
using detail::Footprints;
using detail::RayMap;
using slicecorr::detail::silent;

/// Directions whose light is made ready together.
constexpr int kBatch = 16;

class RayProjector final : public Projector {
 public:
  RayProjector(const TomoGrid& grid, const LabRays& rays, const Volume* insert)
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
    double along = 0, up = 0, slope = 0, most_mm = 0;
    for (int a = 0; a < per_pixel_; ++a) {
      maps_.emplace_back(grid, rays, a);
      along = std::max(along, maps_.back().most_along());
      up = std::max(up, maps_.back().most_up());
      slope = std::max(slope, maps_.back().most_slope());
    }
    for (const LabRay& ray : rays.rays) {
      if (ray.half_mm > 0 && ray.power > 0) most_mm = std::max(most_mm, std::abs(ray.t_mm));
    }
    directions_ =
        Directions::of(grid.angles, std::min(most_mm, grid.radius_mm), grid.voxel_mm(), true);
    const double side = grid.voxel_mm(), least = 3 * detail::kLeastBox;
    most_across_ = static_cast<int>(std::ceil(
                       along * (std::sqrt(2.0) * side +
                                grid.radius_mm * directions_.width_rad()) + least)) + 1;
    most_up_ =
        static_cast<int>(std::ceil(up * (grid.slice_height_mm() + slope * side) + least)) + 1;
    most_across_ = std::max(most_across_, 2);
    most_up_ = std::max(most_up_, 2);
    for (int z = 0; z < grid.slices; ++z) {
      const double f = maps_[0].height_of(z);
      const int h = std::clamp(static_cast<int>(f), 0, maps_[0].heights() - 2);
      height_.push_back(h);
      above_.push_back(static_cast<float>(f - h));
    }
    take_turns(rays);
    if (insert != nullptr) cast(*insert);
  }

  Shape shape() const override { return grid_.shape(); }

  void adjoint(std::size_t /*block*/, const float* light, float* field,
               const ExecutionContext& context) const override {
    const ExecutionContext quiet = silent(context);
    std::fill_n(field, grid_.voxels_of_block(), 0.0F);
    Array<float> lines(kBatch * padded_size());
    each_batch([&](int first, int count) {
      parallel_for(quiet, "", static_cast<std::size_t>(count), [&](std::size_t i) {
        lines_of(first + static_cast<int>(i), light, lines.data() + i * padded_size());
      });
      parallel_for(quiet, "", static_cast<std::size_t>(grid_.voxels), [&](std::size_t y) {
        for (int i = 0; i < count; ++i) {
          const float* const from =
              lines.data() + static_cast<std::size_t>(i) * padded_size() + margin();
          each_column(first + i, static_cast<int>(y), [&](int x, const Footprints& f) {
            detail::gather_footprints(f, grid_.slices, stride(), from,
                                      field + grid_.voxel(x, static_cast<int>(y), 0));
          });
        }
      });
    });
  }

  void forward(std::size_t /*block*/, const float* field, float* light,
               const ExecutionContext& context) const override {
    const ExecutionContext quiet = silent(context);
    std::fill_n(light, grid_.light_of_block(), 0.0F);
    Array<float> lines(kBatch * padded_size());
    each_batch([&](int first, int count) {
      parallel_for(quiet, "", static_cast<std::size_t>(count), [&](std::size_t i) {
        float* const to = lines.data() + i * padded_size();
        std::fill_n(to, padded_size(), 0.0F);
        for (int y = 0; y < grid_.voxels; ++y) {
          each_column(first + static_cast<int>(i), y, [&](int x, const Footprints& f) {
            detail::scatter_footprints(f, grid_.slices, stride(), field + grid_.voxel(x, y, 0),
                                       to + margin());
          });
        }
      });
      parallel_for(quiet, "", static_cast<std::size_t>(grid_.pixels), [&](std::size_t c) {
        for (int i = 0; i < count; ++i) {
          const float* const from = lines.data() + static_cast<std::size_t>(i) * padded_size() +
                                    margin() + c * static_cast<std::size_t>(stride());
          each_frame(first + i, static_cast<int>(c), [&](std::size_t at, const float* share) {
            detail::add_shares(share, from, grid_.rows, light + at);
          });
        }
      });
    });
  }

 private:
  struct Shaded {
    int x = 0;
    std::vector<int> slices;  ///< that are dark
  };
  struct Scratch {
    Array<float> parts, at, shares;
    Footprints footprints;
  };
  static Scratch& thread_scratch() {
    static thread_local Scratch scratch;
    return scratch;
  }

  /// Lines are columns of pixels with dark ones all around.
  int stride() const { return grid_.rows + 2 * most_up_; }
  std::size_t padded_size() const {
    return static_cast<std::size_t>(grid_.pixels + 2 * most_across_) *
           static_cast<std::size_t>(stride());
  }
  std::size_t margin() const {
    return static_cast<std::size_t>(most_across_) * static_cast<std::size_t>(stride()) +
           static_cast<std::size_t>(most_up_);
  }
  /// What is numbered: each ray of the aperture in each direction.
  int count() const { return directions_.count() * per_pixel_; }
  template <class Use>
  void each_batch(const Use& use) const {
    for (int first = 0; first < count(); first += kBatch) {
      use(first, std::min(kBatch, count() - first));
    }
  }

  void take_turns(const LabRays& rays) {
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
  void each_frame(int k, int column, const Use& use) const {
    Scratch& scratch = thread_scratch();
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
    detail::frame_shares(scratch.at.data(), rows, one, other, first, frames, scratch.shares.data());
    for (int s = 0; s < frames; ++s) {
      int m = (directions_.frame(direction) + first + s) % grid_.angles;
      if (m < 0) m += grid_.angles;
      use(grid_.pixel(m, column, 0),
          scratch.shares.data() + static_cast<std::size_t>(s) * static_cast<std::size_t>(rows));
    }
  }

  void lines_of(int k, const float* light, float* to) const {
    std::fill_n(to, padded_size(), 0.0F);
    to += margin();
    for (int c = 0; c < grid_.pixels; ++c, to += stride()) {
      each_frame(k, c, [&](std::size_t at, const float* share) {
        detail::add_shares(share, light + at, grid_.rows, to);
      });
    }
  }

  /// Calls use(x, footprints) for the columns of voxels of a row that hold resin.
  template <class Use>
  void each_column(int k, int y, const Use& use) const {
    const TomoGrid::Range in = grid_.inside(y);
    if (in.first >= in.end) return;
    Scratch& scratch = thread_scratch();
    const RayMap& map = maps_[static_cast<std::size_t>(k % per_pixel_)];
    const double th = directions_.angle_rad(k / per_pixel_);
    const double c = std::cos(th), s = std::sin(th), side = grid_.voxel_mm();
    scratch.parts.resize(static_cast<std::size_t>(map.heights()) * detail::RayMapPart::count);
    detail::VoxelColumn voxels;
    voxels.slices = grid_.slices;
    voxels.heights = map.heights();
    voxels.parts = scratch.parts.data();
    voxels.height = height_.data();
    voxels.above = above_.data();
    voxels.one_mm = static_cast<float>(side * std::abs(c));
    voxels.other_mm = static_cast<float>(side * std::abs(s));
    voxels.side_mm = static_cast<float>(side);
    voxels.height_mm = static_cast<float>(grid_.slice_height_mm());
    voxels.columns = grid_.pixels;
    voxels.rows = grid_.rows;
    const std::vector<Shaded>* dark =
        shade_.empty() ? nullptr
                       : &shade_[static_cast<std::size_t>(k) *
                                     static_cast<std::size_t>(grid_.voxels) +
                                 static_cast<std::size_t>(y)];
    std::size_t next = 0;
    for (int x = in.first; x < in.end; ++x) {
      const double px = grid_.voxel_at_mm(x), py = grid_.voxel_at_mm(y);
      const double t = px * c + py * s, u = py * c - px * s;
      map.over(t, u, scratch.parts.data());
      // Each cell's share of its step, and where it lies in the light's units.
      float* const light =
          scratch.parts.data() + static_cast<std::size_t>(detail::RayMapPart::light) *
                                     static_cast<std::size_t>(map.heights());
      float lit = 0;
      for (int h = 0; h < map.heights(); ++h) {
        light[h] /= static_cast<float>(directions_.cells);
        lit = std::max(lit, light[h]);
      }
      if (!(lit > 0)) continue;
      voxels.turn_mm = static_cast<float>(std::abs(u) * directions_.width_rad());
      detail::make_footprints(voxels, most_across_, most_up_, scratch.footprints);
      if (dark != nullptr) {
        while (next < dark->size() && (*dark)[next].x < x) ++next;
        if (next < dark->size() && (*dark)[next].x == x) {
          for (const int z : (*dark)[next].slices) darken(scratch.footprints, z);
        }
      }
      use(x, scratch.footprints);
    }
  }

  void darken(Footprints& f, int z) const {
    for (int tap = 0; tap < f.up; ++tap) {
      f.row_shares[static_cast<std::size_t>(tap) * static_cast<std::size_t>(grid_.slices) +
                   static_cast<std::size_t>(z)] = 0;
    }
  }

  void cast(const Volume& insert) {
    if (!(insert.grid == grid_)) {
      throw InputError("insert", "", "must have the grid of the part");
    }
    const Box<std::uint8_t> box = detail::box_of(insert);
    const detail::RisingShade opaque(box);
    if (!opaque.any()) return;
    const auto n = static_cast<std::size_t>(grid_.voxels);
    shade_.resize(static_cast<std::size_t>(count()) * n);
    parallel_for({}, "", static_cast<std::size_t>(count()), [&](std::size_t k) {
      const RayMap& map = maps_[k % static_cast<std::size_t>(per_pixel_)];
      const double th = directions_.angle_rad(static_cast<int>(k) / per_pixel_);
      const double c = std::cos(th), s = std::sin(th);
      const double slices_per_side = grid_.voxel_mm() / grid_.slice_height_mm();
      std::vector<float> parts(static_cast<std::size_t>(map.heights()) *
                               detail::RayMapPart::count);
      for (int y = 0; y < grid_.voxels; ++y) {
        const TomoGrid::Range in = grid_.inside(y);
        for (int x = in.first; x < in.end; ++x) {
          const double px = grid_.voxel_at_mm(x), py = grid_.voxel_at_mm(y);
          map.over(px * c + py * s, py * c - px * s, parts.data());
          const float* const slope =
              parts.data() + static_cast<std::size_t>(detail::RayMapPart::slope) *
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

  TomoGrid grid_;
  int per_pixel_;
  std::vector<RayMap> maps_;  ///< per ray of a pixel
  Directions directions_;
  int most_across_ = 2, most_up_ = 2;
  std::vector<int> height_;
  std::vector<float> above_;
  std::vector<float> turn_;    ///< steps, [ray][column][row]
  std::vector<float> across_;  ///< the same from side to side of a pixel, [ray][column]
  std::vector<std::vector<Shaded>> shade_;  ///< [direction and ray][y]; empty: no insert
};

}  // namespace

std::unique_ptr<Projector> make_ray_projector(const TomoGrid& grid, const LabRays& rays,
                                              const Volume* insert) {
  return std::make_unique<RayProjector>(grid, rays, insert);
}

}  // namespace slicecorr::tomo
