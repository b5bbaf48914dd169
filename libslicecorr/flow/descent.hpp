// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file descent.hpp
/// The least of a smooth function of numbers up to 1: projected L-BFGS.
#pragma once

#include <functional>
#include <vector>

namespace slicecorr::detail {

struct Descent {
  std::vector<double> x;
  double value = 0;
  int iterations = 0;
};

/// Value at `x`, and its gradient.
using Slope = std::function<double(const std::vector<double>& x, std::vector<double>& gradient)>;

/// Goes downhill from `x` until the value falls by less than 0.03 % in ten steps, or `iterations` are
/// over. No number falls below that of `least`, 0..1.
Descent descend(std::vector<double> x, const std::vector<double>& least, const Slope& slope,
                int iterations);

}  // namespace slicecorr::detail
