// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What archives say of exposures, for those who resolve a setup and tell of it.
#pragma once

#include <vector>

#include "slicecorr/stack.hpp"

namespace slicecorr::detail {

/// The times without a repeated end: the last entry holds for later layers.
inline std::vector<double> trimmed(std::vector<double> times) {
  while (times.size() > 1 && times.back() == times[times.size() - 2]) times.pop_back();
  return times;
}

/// Whether an archive says a first exposure.
inline bool has_first_exposure(const StackInfo* times) {
  return times && times->layer_exposure_s.empty() && times->bottom_layers > 0 &&
         times->bottom_exposure_s > 0;
}

}  // namespace slicecorr::detail
