// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file threshold_fit.hpp
/// Times to gel below a threshold of light that never gels: t = E / (i - i0), as oxygen that comes back
/// makes them (Kelly's thesis, figure 4-11). Its inverse is a line, so least squares are linear: what is
/// least is the sum of (t (i - i0) / E - 1)², the error of the rate that is predicted, over that measured.
///
/// Plain values; thread-safe. Errors are `InputError`.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "slicecorr/resins/gel_time_fit.hpp"

namespace slicecorr::resins {

struct ThresholdFit {
  struct Figure {
    double value = 0, stderr_ = 0;  ///< NaN where the error can't be known
    std::array<double, 2> ci95{};
  };
  Figure dose_mj_cm2;       ///< E
  Figure threshold_mw_cm2;  ///< i0 >= 0; at 0 without an error
  bool at_bound = false;    ///< i0 came out at 0 or below
  std::vector<std::string> sources;
  std::vector<TimeToGel> times;
  std::vector<double> predicted_s;        ///< of each; infinite where the fit never gels
  double rms_error = 0, worst_error = 0;  ///< of predicted over measured rate, less 1
  std::vector<std::string> warnings;
  /// In a volume: alpha_a times E and i0, for resins of tomographic printers; per 1/cm of active absorption.
  double gel_dose_mj_cm3(double active_per_cm) const { return active_per_cm * dose_mj_cm2.value; }
  double resupply_mj_cm3_s(double active_per_cm) const {
    return active_per_cm * threshold_mw_cm2.value;
  }
  /// `active_per_cm` 0: not known, and no figures of a volume.
  std::string to_json(double active_per_cm) const;
  std::string to_text(double active_per_cm) const;
};

/// Throws where there are less than two intensities, and where times do not fall with light at all.
ThresholdFit fit_threshold(const TimesToGel& data);

}  // namespace slicecorr::resins
