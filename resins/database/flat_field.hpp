// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// How even a display's light is, as an image.
#pragma once

#include <string>

#include "slicecorr/stack.hpp"

namespace slicecorr::resins {

/// Relative intensity over the display: white is the brightest place.
struct FlatField {
  GreyImage image;
  double least = 0, mean = 0;  ///< over the greatest value of the image
};

/// Throws `InputError` when the image is black or has no pixel.
FlatField flat_field_of(GreyImage image, const std::string& source);
/// Of a PNG file; colour is averaged.
FlatField flat_field_of_png(const std::string& path);

}  // namespace slicecorr::resins
