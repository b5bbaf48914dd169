// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Directions of light in the resin, and the frames that are shown meanwhile.
///
/// Each frame is shown for a whole step of the turn. Light of a pixel that is turned by `turn_rad` on
/// its way in comes in direction th' while the vial stands at th' - turn_rad. So the directions of a
/// turn are cut into cells, several to a step where that counts, and each pixel's light of a cell is
/// that of the frames which are shown while the vial passes it: never of others.
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace slicecorr::tomo::detail {

/// C of the sum of two boxes, of which either may be a point.
inline double two_boxes_below(double x, double one, double other) {
  const double a = std::max({one, other, 1e-12}), b = std::min(one, other);
  const double s = (a + b) / 2, d = (a - b) / 2, y = std::abs(x);
  const double half = y <= d ? y / a : y < s ? 0.5 - (s - y) * (s - y) / (2 * a * b) : 0.5;
  return x < 0 ? 0.5 - half : 0.5 + half;
}

struct FrameShare {
  int shift = 0;  ///< frames ahead of the cell's own
  float share = 0;
};

struct Directions {
  int frames = 0;
  int cells = 1;  ///< of a step

  /// So many that the light of a cell stays within a voxel, at this distance from the axis;
  /// where pixels are not turned cells are parts of frames, and it may move by two and a half.
  static Directions of(int frames, double radius_mm, double voxel_mm, bool turned) {
    const double arc = 2 * std::numbers::pi / frames * radius_mm / voxel_mm;
    const double cells = std::ceil(arc * (turned ? 1.0 : 0.4) - 1e-9);
    return {frames, static_cast<int>(std::clamp(cells, 1.0, 64.0))};
  }

  /// An odd number, so that cells lie at whole parts of steps: so many that light moves by at most so
  /// many voxels in a cell.
  static Directions odd(int frames, double arc_voxels, double most_voxels) {
    const double cells = std::clamp(std::ceil(arc_voxels / most_voxels - 1e-9), 1.0, 63.0);
    return {frames, static_cast<int>(cells) | 1};
  }

  int count() const { return frames * cells; }
  int frame(int k) const { return k / cells; }
  double step_rad() const { return 2 * std::numbers::pi / frames; }
  double width_rad() const { return step_rad() / cells; }
  double angle_rad(int k) const { return step_rad() * ((k + 0.5) / cells - 0.5); }

  /// Frames that are shown while a pixel's light comes in the directions of cell `k`, of those of a
  /// step: the pixel's light is turned by `turn_rad`, from side to side of it by `across_rad` more.
  /// Shares add up to 1.
  void shares(int cell, double turn_rad, double across_rad, std::vector<FrameShare>& out) const {
    out.clear();
    const double at = (cell + 0.5) / cells - 0.5 - turn_rad / step_rad();
    const double one = 1.0 / cells, other = std::abs(across_rad) / step_rad();
    const double reach = (one + other) / 2;
    const auto first = static_cast<int>(std::floor(at - reach + 0.5)),
               last = static_cast<int>(std::ceil(at + reach - 0.5));
    double before = 0;
    for (int s = first; s <= last; ++s) {
      const double up_to = s == last ? 1 : two_boxes_below(s + 0.5 - at, one, other);
      if (up_to - before > 1e-7) out.push_back({s, static_cast<float>(up_to - before)});
      before = std::max(before, up_to);
    }
  }
};

}  // namespace slicecorr::tomo::detail
