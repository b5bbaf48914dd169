// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file orientation.hpp
/// How the plate lies in images: the eight ways to turn and mirror an image, and what they do to
/// pixels, boxes and positions.
///
/// Plate: x to the right, y up, the corner 00 at the least of both. The *plate's image*, as `slice`
/// makes it, has column 0 at the smallest x and row 0 at the largest y. Everything here is exact in
/// whole pixels, pure and thread-safe, and throws nothing.
#pragma once

#include <optional>
#include <string>

#include "slicecorr/grid.hpp"
#include "slicecorr/shrinkage.hpp"

namespace slicecorr {

/// How the plate lies in the images of an archive. The images of `slice` have row 0 at the largest
/// y and column 0 at the smallest x. `portrait` turns them counter-clockwise by 90 degrees: x of
/// the plate runs up, y to the left. Then `mirror_x` swaps left and right of the image, `mirror_y`
/// top and bottom.
struct Orientation {
  bool portrait = false, mirror_x = false, mirror_y = false;
  bool operator==(const Orientation&) const = default;
};

/// "portrait, mirrored in x".
std::string in_words(const Orientation& orientation);

/// One of the eight ways to turn an image: first `swap_axes` exchanges columns and rows, then
/// `flip_x` swaps left and right, `flip_y` top and bottom.
struct Turn {
  bool swap_axes = false, flip_x = false, flip_y = false;
  bool operator==(const Turn&) const = default;
  bool is_identity() const { return !swap_axes && !flip_x && !flip_y; }
  /// Whether left and right hand change places: the turn is no rotation.
  bool mirrors() const { return swap_axes != (flip_x != flip_y); }
  Turn inverse() const { return swap_axes ? Turn{true, flip_y, flip_x} : *this; }
  /// This turn, then `next`.
  Turn then(const Turn& next) const {
    return {swap_axes != next.swap_axes, (next.swap_axes ? flip_y : flip_x) != next.flip_x,
            (next.swap_axes ? flip_x : flip_y) != next.flip_y};
  }
};

/// From the plate's image to one in which the plate lies like this.
Turn turn_from_plate(const Orientation& orientation);
/// From images in which the plate lies like `from` to such with `to`.
Turn turn_between(const Orientation& from, const Orientation& to);
/// How the plate lies after a turn of images in which it lies like `orientation`.
Orientation turned(const Orientation& orientation, const Turn& turn);

struct Pixel {
  int x = 0, y = 0;  ///< column and row, from 0
  bool operator==(const Pixel&) const = default;
};
/// Where a pixel of an image of `width_px` x `height_px` comes to lie. Pixels outside stay outside.
Pixel turned(const Pixel& pixel, const Turn& turn, int width_px, int height_px);
/// The same of a box of pixels.
PixelBox turned(const PixelBox& box, const Turn& turn, int width_px, int height_px);
/// Size and scale of turned images.
Grid turned(const Grid& grid, const Turn& turn);

/// A place on the plate, mm from its corner 00.
struct PlatePlace {
  double x_mm = 0, y_mm = 0;
};
/// The place under (`column`, `row`) of an image in which the plate lies like `orientation`; in
/// pixels from the image's upper left corner, so that pixel 0 has its middle at 0.5.
PlatePlace place_on_plate(const Grid& grid, const Orientation& orientation, double column,
                          double row);

/// How images lie: on the plate, and on the display that shows them.
struct ImageFrame {
  /// The turn from these images to those that the display shows. Identity for archives made for a
  /// printer: its display shows them as they are. Nothing: the printer's own orientation says it.
  std::optional<Turn> to_display;
  /// How the plate lies in the images; nothing where an archive does not say.
  std::optional<Orientation> orientation = Orientation{};
  /// What the shapes in them were made for: larger by what shrinks, their first outlines smaller by what grows.
  Shrinkage made_for{};
  bool operator==(const ImageFrame&) const = default;
};
/// The frame of images after a turn.
ImageFrame turned(const ImageFrame& frame, const Turn& turn);

}  // namespace slicecorr
