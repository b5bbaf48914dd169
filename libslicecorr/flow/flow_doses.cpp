// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/flow_doses.hpp"

namespace slicecorr {

namespace {

template <class Share>
double mean_by_area(const std::vector<FlowDoses::Slice>& slices, const Share& share) {
  double sum = 0, area = 0;
  for (const FlowDoses::Slice& s : slices) {
    sum += s.area_mm2 * share(s);
    area += s.area_mm2;
  }
  return area > 0 ? sum / area : 0;
}

}  // namespace

double FlowDoses::within_10() const {
  return mean_by_area(slices, [](const Slice& s) { return s.even.within_10; });
}
double FlowDoses::within_10_without() const {
  return mean_by_area(slices, [](const Slice& s) { return s.without.within_10; });
}

}  // namespace slicecorr
