// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "plan/search.hpp"

#include <algorithm>
#include <cmath>

namespace slicecorr::detail {

namespace {

/// From a pace that keeps upwards to the last one before one that fails.
double upwards(double good, double bad, double most, const std::function<bool(double)>& keeps) {
  for (;;) {
    while (bad / good > kPaceStep) {
      const double middle = std::min(std::max(std::sqrt(good * bad), good * kPaceStep), most);
      if (middle >= bad || middle <= good) break;
      (keeps(middle) ? good : bad) = middle;
    }
    // Where ranges have holes a pace beyond one that fails may keep.
    const double next = good * kPaceStep;
    if (next > most || !keeps(next)) return good;
    good = next;
    bad = most * kPaceStep;
    for (const double factor : {1.02, 1.05, 1.1, 1.2, 1.5, 2.0, 4.0, 10.0}) {
      const double further = std::min(good * factor, most);
      if (further <= good) return good;
      if (!keeps(further)) {
        bad = further;
        break;
      }
      good = further;
    }
  }
}

}  // namespace

std::optional<double> fastest_pace(const std::vector<PaceRange>& ranges, double most,
                                   const std::function<bool(double)>& keeps) {
  double failed = most * kPaceStep;
  for (auto range = ranges.rbegin(); range != ranges.rend(); ++range) {
    const double top = std::min(range->greatest, most);
    if (top < range->least) continue;
    for (const double factor : {1.0, 0.995, 0.98, 0.95, 0.9, 0.85, 0.8, 0.75, 0.7, 0.6, 0.5, 0.4,
                                0.3, 0.2, 0.1, 0.05, 0.02, 0.01}) {
      const double pace = top * factor;
      if (pace <= range->least) break;
      if (keeps(pace)) return upwards(pace, failed, most, keeps);
      failed = pace;
    }
    if (range->least < failed) {
      if (keeps(range->least)) return upwards(range->least, failed, most, keeps);
      failed = range->least;
    }
  }
  return std::nullopt;
}

}  // namespace slicecorr::detail
