// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What a platform that sends light back does to the light of an even dead zone (docs/even-dead-zone.md).
#pragma once

#include <cstddef>
#include <vector>

namespace slicecorr {
struct Printer;
struct Process;
struct Resin;
}  // namespace slicecorr

namespace slicecorr::detail {

/// How often the curing light of each slice counts at the front of the dead zone that `process.even_light` is for, with
/// what comes back from the platform, when the window is in the middle of the slice. Slices after them: once.
class EvenBack {
 public:
  EvenBack() = default;
  EvenBack(const Printer& printer, const Resin& resin, const Process& process, double layer_um);
  double times(int slice) const {
    const auto n = static_cast<std::size_t>(slice);
    return slice >= 0 && n < times_.size() ? times_[n] : 1.0;
  }
  std::size_t slices() const { return times_.size(); }

 private:
  std::vector<double> times_;
};

}  // namespace slicecorr::detail
