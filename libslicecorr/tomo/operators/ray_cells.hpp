// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Rays of a frame in all directions of the resin: where voxels see pixels, which frames are shown
/// meanwhile, and what an insert hides. What both pairs of operators of rays begin with.
#pragma once

#include <cstddef>
#include <vector>

#include "slicecorr/tomo/rays.hpp"
#include "tomo/operators/directions.hpp"
#include "tomo/operators/ray_map.hpp"

namespace slicecorr::tomo::detail {

/// Directions, and in each the rays of an aperture, are numbered as one: k.
class RayCells {
 public:
  /// In a cell of directions light moves by at most so many voxels. `odd`: an odd number of cells to a
  /// step. Throws `InputError` as `make_ray_projector` does.
  struct Cells {
    double most_voxels = 1.5;
    bool odd = false;
    int map_up = 8;  ///< nodes of maps along z, to the vial's radius
  };
  RayCells(const TomoGrid& grid, const LabRays& rays, const Volume* insert, const Cells& cells);

  const TomoGrid& grid() const { return grid_; }
  const Directions& directions() const { return directions_; }
  int per_pixel() const { return per_pixel_; }
  int count() const { return directions_.count() * per_pixel_; }
  const RayMap& map(int k) const { return maps_[static_cast<std::size_t>(k % per_pixel_)]; }
  double angle_rad(int k) const { return directions_.angle_rad(k / per_pixel_); }
  const std::vector<RayMap>& maps() const { return maps_; }

  /// Per slice: the node of the maps below, and how far it lies above that.
  const int* height() const { return height_.data(); }
  const float* above() const { return above_.data(); }

  /// Light of k, of the frames that are shown meanwhile: to[column * stride + row], of dark columns.
  void lines_of(int k, const float* light, float* to, int stride) const;
  /// The transpose, of one column: adds to the light of its frames.
  void back_from(int k, int column, const float* from, float* light) const;

  struct Shaded {
    int x = 0;
    std::vector<int> slices;  ///< that are dark
  };
  /// Dark voxels of a row, by x; null without an insert.
  const std::vector<Shaded>* dark(int k, int y) const;

 private:
  template <class Use>
  void each_frame(int k, int column, const Use& use) const;
  void take_turns(const LabRays& rays);
  void cast(const Volume& insert);

  TomoGrid grid_;
  int per_pixel_;
  std::vector<RayMap> maps_;  ///< per ray of a pixel
  Directions directions_;
  std::vector<int> height_;
  std::vector<float> above_;
  std::vector<float> turn_;    ///< steps, [ray][column][row]
  std::vector<float> across_;  ///< the same from side to side of a pixel, [ray][column]
  std::vector<std::vector<Shaded>> shade_;  ///< [direction and ray][y]; empty: no insert
};

/// Goes through the dark voxels of a row in order of x.
class DarkVoxels {
 public:
  explicit DarkVoxels(const std::vector<RayCells::Shaded>* row) : row_(row) {}
  /// Dark slices at x, which must rise from call to call; null: none.
  const std::vector<int>* at(int x) {
    if (row_ == nullptr) return nullptr;
    while (next_ < row_->size() && (*row_)[next_].x < x) ++next_;
    return next_ < row_->size() && (*row_)[next_].x == x ? &(*row_)[next_].slices : nullptr;
  }

 private:
  const std::vector<RayCells::Shaded>* row_;
  std::size_t next_ = 0;
};

}  // namespace slicecorr::tomo::detail
