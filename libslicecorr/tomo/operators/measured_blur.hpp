// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// A measured spread of light on whole pixels.
#pragma once

#include <utility>
#include <vector>

#include "slicecorr/process.hpp"

namespace slicecorr::tomo::detail {

/// Variance of a box one pixel wide.
inline constexpr double kBox = 1.0 / 12;

/// A sum of products of numbers along columns, to the right, and rows, upwards: an odd number each, of light that
/// goes from so far to one side to as far to the other.
struct MeasuredBlur {
  std::vector<std::pair<std::vector<float>, std::vector<float>>> products;
  /// Variances that are not in them, pixels squared: those of a picture so narrow that numbers at whole pixels
  /// say nothing of it.
  double columns_left = 0, rows_left = 0;
};
/// `column_mm`, `row_mm`: pixels, or groups of them. Numbers have the variance of the picture: light that falls into a
/// pixel is taken as even in it, which is taken off. Products with less than 1e-4 of the largest are left out.
MeasuredBlur measured_blur(const SpreadPicture& picture, double column_mm, double row_mm);

/// The same numbers, blurred by an even blur: its middle number and those to each side.
std::vector<float> widened(const std::vector<float>& numbers, const std::vector<float>& even);

}  // namespace slicecorr::tomo::detail
