// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Layers of different heights, by what a process says of them.
#pragma once

#include <algorithm>
#include <cstddef>

#include "slicecorr/process.hpp"

namespace slicecorr::test {

/// How high layer n is, and how far from the platform it begins.
inline double height_um(const Process& process, int n, double usual_um) {
  const auto& um = process.layer_heights_um;
  return um.empty() ? usual_um : um[std::min(static_cast<std::size_t>(n), um.size() - 1)];
}
inline double node_um(const Process& process, int n, double usual_um) {
  double sum = 0;
  for (int k = 0; k < n; ++k) sum += height_um(process, k, usual_um);
  return sum;
}

}  // namespace slicecorr::test
