// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "parallel/silent.hpp"
#include "slicecorr/tomo/rays.hpp"
#include "tomo/operators/footprint.hpp"
#include "tomo/operators/footprint_kernels.hpp"
#include "tomo/operators/ray_cells.hpp"
#include "tomo/operators/ray_map.hpp"

namespace slicecorr::tomo {

namespace {

using detail::Footprints;
using detail::RayMap;
using slicecorr::detail::silent;

/// Directions whose light is made ready together.
constexpr int kBatch = 16;

class RayProjector final : public Projector {
 public:
  RayProjector(const TomoGrid& grid, const LabRays& rays, const Volume* insert)
      : grid_(grid), cells_(grid, rays, insert, {}), across_(rays.across), up_(rays.up) {
    double along = 0, up = 0, slope = 0;
    for (const RayMap& map : cells_.maps()) {
      along = std::max(along, map.most_along());
      up = std::max(up, map.most_up());
      slope = std::max(slope, map.most_slope());
    }
    const double side = grid.voxel_mm(), least = 3 * detail::kLeastBox;
    most_across_ =
        static_cast<int>(std::ceil(
            along * (std::sqrt(2.0) * side + grid.radius_mm * cells_.directions().width_rad()) +
            across_.soft + least)) +
        1;
    most_up_ = static_cast<int>(
                   std::ceil(up * (grid.slice_height_mm() + slope * side) + up_.soft + least)) +
               1;
    most_across_ = std::max(most_across_, 2);
    most_up_ = std::max(most_up_, 2);
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
          cells_.back_from(first + i, static_cast<int>(c), from, light);
        }
      });
    });
  }

 private:
  struct Scratch {
    Array<float> parts;
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
  int count() const { return cells_.count(); }
  template <class Use>
  void each_batch(const Use& use) const {
    for (int first = 0; first < count(); first += kBatch) {
      use(first, std::min(kBatch, count() - first));
    }
  }

  void lines_of(int k, const float* light, float* to) const {
    std::fill_n(to, padded_size(), 0.0F);
    cells_.lines_of(k, light, to + margin(), stride());
  }

  /// Calls use(x, footprints) for the columns of voxels of a row that hold resin.
  template <class Use>
  void each_column(int k, int y, const Use& use) const {
    const TomoGrid::Range in = grid_.inside(y);
    if (in.first >= in.end) return;
    Scratch& scratch = thread_scratch();
    const RayMap& map = cells_.map(k);
    const double th = cells_.angle_rad(k);
    const double c = std::cos(th), s = std::sin(th), side = grid_.voxel_mm();
    scratch.parts.resize(static_cast<std::size_t>(map.heights()) * detail::RayMapPart::count);
    detail::VoxelColumn voxels;
    voxels.slices = grid_.slices;
    voxels.heights = map.heights();
    voxels.parts = scratch.parts.data();
    voxels.height = cells_.height();
    voxels.above = cells_.above();
    voxels.one_mm = static_cast<float>(side * std::abs(c));
    voxels.other_mm = static_cast<float>(side * std::abs(s));
    voxels.side_mm = static_cast<float>(side);
    voxels.height_mm = static_cast<float>(grid_.slice_height_mm());
    voxels.columns = grid_.pixels;
    voxels.rows = grid_.rows;
    voxels.lit_across = static_cast<float>(across_.lit);
    voxels.lit_up = static_cast<float>(up_.lit);
    voxels.soft_across = static_cast<float>(across_.soft);
    voxels.soft_up = static_cast<float>(up_.soft);
    detail::DarkVoxels dark(cells_.dark(k, y));
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
        light[h] /= static_cast<float>(cells_.directions().cells);
        lit = std::max(lit, light[h]);
      }
      if (!(lit > 0)) continue;
      voxels.turn_mm = static_cast<float>(std::abs(u) * cells_.directions().width_rad());
      detail::make_footprints(voxels, most_across_, most_up_, scratch.footprints);
      if (const std::vector<int>* const slices = dark.at(x)) {
        for (const int z : *slices) darken(scratch.footprints, z);
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

  TomoGrid grid_;
  detail::RayCells cells_;
  PixelProfile across_, up_;
  int most_across_ = 2, most_up_ = 2;
};

}  // namespace

std::unique_ptr<Projector> make_ray_projector(const TomoGrid& grid, const LabRays& rays,
                                              const Volume* insert) {
  return std::make_unique<RayProjector>(grid, rays, insert);
}

}  // namespace slicecorr::tomo
