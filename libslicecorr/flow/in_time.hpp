// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file in_time.hpp
/// What prints that are followed have in common. Private to the module.
#pragma once

#include <vector>

#include "flow/growth.hpp"
#include "slicecorr/flow_in_time.hpp"

namespace slicecorr::detail {

void check_in_time(const InTime& how);
/// Dead zone and doses of the growth as it is; `distance_um`: of cells from outlines, 0 or less where a
/// cell is no part.
SliceInTime look_at(const GapGrowth& growth, const std::vector<double>& distance_um, double top_um);
void find_steady(PrintInTime& print);

/// Tells when slices leave everything as it was, so that the next ones need not be followed.
class AtRest {
 public:
  /// After a slice; `same`: it was lit like the one before.
  void add(const GapGrowth& growth, double top_um, bool same);
  bool holds() const { return still_ >= kStillSlices; }

 private:
  static constexpr int kStillSlices = 3;
  std::vector<double> gap_um_, window_;
  int still_ = 0;
};

}  // namespace slicecorr::detail
