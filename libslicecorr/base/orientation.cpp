// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/orientation.hpp"

#include <utility>

namespace slicecorr {

std::string in_words(const Orientation& o) {
  std::string text = o.portrait ? "portrait" : "landscape";
  if (o.mirror_x || o.mirror_y) {
    text += o.mirror_x && o.mirror_y ? ", mirrored in x and y"
            : o.mirror_x             ? ", mirrored in x"
                                     : ", mirrored in y";
  }
  return text;
}

Turn turn_from_plate(const Orientation& o) {
  // Portrait is a turn counter-clockwise: the row becomes the column, and the column becomes the
  // row, counted from below.
  return {o.portrait, o.mirror_x, o.mirror_y != o.portrait};
}

Turn turn_between(const Orientation& from, const Orientation& to) {
  return turn_from_plate(from).inverse().then(turn_from_plate(to));
}

Orientation turned(const Orientation& orientation, const Turn& turn) {
  const Turn t = turn_from_plate(orientation).then(turn);
  return {t.swap_axes, t.flip_x, t.flip_y != t.swap_axes};
}

Pixel turned(const Pixel& pixel, const Turn& turn, int width_px, int height_px) {
  Pixel p = pixel;
  if (turn.swap_axes) {
    std::swap(p.x, p.y);
    std::swap(width_px, height_px);
  }
  if (turn.flip_x) p.x = width_px - 1 - p.x;
  if (turn.flip_y) p.y = height_px - 1 - p.y;
  return p;
}

PixelBox turned(const PixelBox& box, const Turn& turn, int width_px, int height_px) {
  if (box.empty()) return {};
  const Pixel a = turned(Pixel{box.x0, box.y0}, turn, width_px, height_px);
  const Pixel b = turned(Pixel{box.x1 - 1, box.y1 - 1}, turn, width_px, height_px);
  return {std::min(a.x, b.x), std::min(a.y, b.y), std::max(a.x, b.x) + 1, std::max(a.y, b.y) + 1};
}

Grid turned(const Grid& grid, const Turn& turn) {
  Grid g = grid;
  if (turn.swap_axes) {
    std::swap(g.width_px, g.height_px);
    std::swap(g.pixel_x_um, g.pixel_y_um);
  }
  return g;
}

PlatePlace place_on_plate(const Grid& grid, const Orientation& orientation, double column,
                          double row) {
  const Turn back = turn_from_plate(orientation).inverse();
  const Grid plate = turned(grid, back);
  if (back.swap_axes) std::swap(column, row);
  if (back.flip_x) column = plate.width_px - column;
  if (back.flip_y) row = plate.height_px - row;
  return {column * plate.pixel_x_um * 1e-3, (plate.height_px - row) * plate.pixel_y_um * 1e-3};
}

ImageFrame turned(const ImageFrame& frame, const Turn& turn) {
  ImageFrame f;
  f.made_for = frame.made_for;
  if (frame.to_display) f.to_display = turn.inverse().then(*frame.to_display);
  f.orientation = std::nullopt;
  if (frame.orientation) f.orientation = turned(*frame.orientation, turn);
  return f;
}

}  // namespace slicecorr
