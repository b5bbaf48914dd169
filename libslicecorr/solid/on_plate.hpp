// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Where what a stack shows lies on the plate.
#pragma once

#include <algorithm>
#include <array>
#include <utility>

#include "slicecorr/stack.hpp"
#include "solid/level_surface.hpp"

namespace slicecorr::detail {

/// From images (mm, x to the right, y up from the lower left corner) to the plate.
class OnPlate {
 public:
  explicit OnPlate(const SliceSource& stack) {
    const Orientation o = stack.frame().orientation.value_or(Orientation{});
    back_ = turn_from_plate(o).inverse();
    const Grid& g = stack.grid();
    height_mm_ = g.height_px * g.pixel_y_um * 1e-3;
    const Grid plate = turned(g, back_);
    plate_x_mm_ = plate.width_px * plate.pixel_x_um * 1e-3;
    plate_y_mm_ = plate.height_px * plate.pixel_y_um * 1e-3;
  }
  template <typename Number>
  void place(Number& x, Number& y) const {
    if (back_.is_identity()) return;
    double across = static_cast<double>(x), down = height_mm_ - static_cast<double>(y);
    if (back_.swap_axes) std::swap(across, down);
    if (back_.flip_x) across = plate_x_mm_ - across;
    if (back_.flip_y) down = plate_y_mm_ - down;
    x = static_cast<Number>(across);
    y = static_cast<Number>(plate_y_mm_ - down);
  }
  /// Back from the plate to images.
  void take_off(double& x, double& y) const {
    if (back_.is_identity()) return;
    double across = x, down = plate_y_mm_ - y;
    if (back_.flip_x) across = plate_x_mm_ - across;
    if (back_.flip_y) down = plate_y_mm_ - down;
    if (back_.swap_axes) std::swap(across, down);
    x = across;
    y = height_mm_ - down;
  }
  void place(Triangle& t) const {
    for (auto& corner : t) place(corner[0], corner[1]);
    // A mirror image would show its inside.
    if (back_.mirrors()) std::swap(t[1], t[2]);
  }

 private:
  Turn back_;
  double height_mm_, plate_x_mm_, plate_y_mm_;
};

/// Lower and upper ends of what a stack shows, in mm of the plate and from the platform.
inline std::array<Point3, 2> shown_box(const SliceSource& stack, double height_mm) {
  const Grid& g = stack.grid();
  const PixelBox lit = stack.bounds();
  const OnPlate plate(stack);
  double x0 = lit.x0 * g.pixel_x_um * 1e-3, x1 = lit.x1 * g.pixel_x_um * 1e-3;
  double y0 = (g.height_px - lit.y1) * g.pixel_y_um * 1e-3;
  double y1 = (g.height_px - lit.y0) * g.pixel_y_um * 1e-3;
  plate.place(x0, y0);
  plate.place(x1, y1);
  return {
      {{std::min(x0, x1), std::min(y0, y1), 0}, {std::max(x0, x1), std::max(y0, y1), height_mm}}};
}

}  // namespace slicecorr::detail
