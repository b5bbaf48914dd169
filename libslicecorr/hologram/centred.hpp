// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Planes with the axis in the middle, and the order in which transforms want them.
#pragma once

#include <cstddef>

namespace slicecorr::detail {

/// Where transforms have what lies at `i` of `n`, when index n/2 is the origin.
inline std::size_t unwound(std::size_t i, std::size_t n) { return (i + n - n / 2) % n; }
/// The same as a distance from the origin.
inline double from_axis(std::size_t i, std::size_t n) {
  const std::size_t middle = n / 2;
  return static_cast<double>(i) - static_cast<double>(middle);
}
/// The mirror image of index `i` about the axis.
inline std::size_t mirrored(std::size_t i, std::size_t n) { return (2 * (n / 2) + n - i) % n; }

}  // namespace slicecorr::detail
