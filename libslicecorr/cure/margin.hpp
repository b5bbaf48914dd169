// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#pragma once

namespace slicecorr::detail {

/// By how much what is wanted of a dose, or offered as a bound, keeps clear of it, so that rounding
/// can't leave it on the other side. The recursion loses at most about two roundings per node, and
/// they fade by a per slice: 2^-52 * Omega / (1 - a) in all, below 1e-10 for layers of 1e-5 absorbance
/// heights.
inline constexpr double kMargin = 1e-9;

}  // namespace slicecorr::detail
