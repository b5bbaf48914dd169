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

/// The exposures of a print whose usual one is `exposure_s`, where the archive lists those of its layers and they begin
/// with longer ones that never rise until they are the usual one: as far on the way from the first of them as they
/// are in the archive. Empty where it has none, or none that is longer than `exposure_s`.
inline std::vector<double> listed_first_exposures(const StackInfo* times, double exposure_s) {
  if (!times) return {};
  std::vector<double> list = trimmed(times->layer_exposure_s);
  if (list.size() < 2 || !(list.front() > list.back()) || !(list.front() > exposure_s)) return {};
  const double first_s = list.front(), usual_s = list.back();
  for (std::size_t n = 1; n < list.size(); ++n) {
    if (list[n] > list[n - 1]) return {};
  }
  for (double& s : list) s = first_s + (exposure_s - first_s) * (first_s - s) / (first_s - usual_s);
  list.back() = exposure_s;
  return list;
}

}  // namespace slicecorr::detail
