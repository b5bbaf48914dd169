// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file time_scale.hpp
/// One number from times to gel that were measured where somebody prints: by what factor a resin gels later
/// than its file says. How times stand to each other carries over from one experiment to the next, their
/// size does not (docs/measured.md).
///
/// Plain values; pure and thread-safe. Throws `InputError`.
#pragma once

#include <string>
#include <vector>

#include "slicecorr/process.hpp"
#include "slicecorr/resins/gel_time_fit.hpp"

namespace slicecorr::resins {

struct TimeScale {
  double scale = 1;            ///< measured over told times: their geometric mean
  double stderr_ln = 0;        ///< of ln(scale), from the scatter of the times; NaN of a single one
  std::vector<double> told_s;  ///< of each time, by the resin's file at the window
  double rms_error = 0;        ///< of scaled over measured time, less 1
  double worst_error = 0;
  int intensities = 0;  ///< that differ
  std::string to_text(const Resin& resin) const;
};

/// One time is enough. Throws `InputError` where the resin's file says no dose of gel, or bleaches, and where
/// no change of doses makes times and law one: a factor beyond 100, or errors of more than 100 % rms.
TimeScale scale_by_times(const Resin& resin, const TimesToGel& times);

}  // namespace slicecorr::resins
