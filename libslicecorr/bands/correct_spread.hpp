// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The correction where light spreads from column to column.
#pragma once

#include <string>
#include <vector>

#include "bands/place_plans.hpp"
#include "correct/coupled.hpp"
#include "cure/spread_band.hpp"
#include "slicecorr/light_spreads.hpp"
#include "slicecorr/setup.hpp"

namespace slicecorr::detail {

inline bool spreads(const Setup& setup) {
  return light_spreads(setup.printer, setup.resin, setup.process);
}

/// The slices of a target whose columns are corrected together.
class TogetherCorrected {
 public:
  /// `plans` and `target` must outlive this. `rounds` 0: columns alone.
  /// `scratch_folder` as `CoupledOptions`. Throws as `correct_stack`.
  TogetherCorrected(const SliceSource& target, const PlacePlans& plans, int rounds,
                    const std::string& scratch_folder, const ExecutionContext& context);
  /// As `SliceSource::read_band`.
  void read_band(const PixelBox& band, const SliceSource::Sink& sink) const;

 private:
  const PlacePlans& plans_;
  const SpreadLight light_;
  CoupledCorrection coupled_;
};

}  // namespace slicecorr::detail
