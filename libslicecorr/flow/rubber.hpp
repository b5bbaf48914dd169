// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file rubber.hpp
/// How rubber on glass rises under rings of suction.
///
/// A layer that keeps its volume (nu 1/2), the thickness t on a rigid ground: ring by ring by Hankel's
/// transform of
///
///     w = L s,  L = (sinh 2x - 2x) / (2 k G (cosh 2x + 1 + 2x²)),  x = k t.
///
/// For large k that is a half-space, 1/(2kG), whose rings have closed forms (elliptic integrals; Johnson,
/// Contact Mechanics, 3.4); the rest falls as e^(-2x) and is summed. Pure function.
#pragma once

#include <Eigen/Core>
#include <vector>

namespace slicecorr::detail {

/// Rise w G/(s R) at the places `at` (r/R, in 0..1) of suction s in each ring between two of `edges`
/// (r/R, rising from 0); `thickness` is t/R.
Eigen::MatrixXd rubber_rise(const std::vector<double>& edges, const std::vector<double>& at,
                            double thickness);

}  // namespace slicecorr::detail
