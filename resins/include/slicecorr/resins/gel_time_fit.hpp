// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file gel_time_fit.hpp
/// A and B of t_gel = A/i + B/sqrt(i) (gel_time.hpp) from measured times to gel, or to a conversion.
///
/// Plain values; all functions are thread-safe and throw `InputError`.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "slicecorr/gel_time.hpp"
#include "slicecorr/resins/measurements.hpp"

namespace slicecorr::resins {

/// A measured time.
struct TimeToGel {
  double intensity_mw_cm2 = 0;  ///< > 0, constant through the time
  double time_s = 0;            ///< > 0
  Origin origin;
};

struct TimesToGel {
  std::vector<std::string> sources;
  std::vector<TimeToGel> times;
  double conversion = 0;  ///< of which they are the times; 0: the files don't say
  std::vector<std::string>
      warnings{};  ///< columns that are passed over, rows that look like copies
};

/// Whether a file is a table of times: its header has `time_s` (and no heights).
bool is_table_of_times(const std::string& path);
/// Reads columns `intensity_mw_cm2` (or `irradiance_mw_cm2`) and `time_s`; of a table with a column
/// `conversion` the rows of this one alone, which must be asked for unless all rows have the same.
/// Column names in any case.
TimesToGel read_times_to_gel(const std::vector<std::string>& paths,
                             std::optional<double> conversion = std::nullopt);

/// Relative least squares: what is least is the sum of ((A/i + B/sqrt(i)) / t - 1)², A and B >= 0.
struct GelTimeFit {
  /// value -+ t(0.975, n - p) stderr; NaN where it can't be known: at 0, or with as many times as
  /// parameters.
  struct Figure {
    double value = 0, stderr_ = 0;
    std::array<double, 2> ci95{};
    bool at_bound = false;  ///< it is 0: the law goes on without it
  };
  Figure a, b;
  double covariance = 0;  ///< of A and B; NaN where either stands at 0
  std::vector<std::string> sources;
  std::vector<TimeToGel> times;
  std::vector<double> predicted_s;  ///< of each
  double conversion = 0;
  double rms_error = 0, worst_error = 0;  ///< of predicted over measured time, less 1
  double exponent = 0;  ///< of the one power of intensity nearest to the times: -d ln t / d ln i
  double exponent_error = 0;  ///< the worst error of that power
  std::vector<std::string> warnings;
  /// Predicted over measured time, less 1, by a fit to all other intensities.
  struct LeftOutTime {
    double error = 0;        ///< of A/i + B/sqrt(i)
    double power_error = 0;  ///< of the one power that is nearest
  };
  /// Of each time; empty where there are less than four intensities, or more than 2000 times.
  std::vector<LeftOutTime> left_out;

  GelTime gel_time() const { return {a.value, b.value}; }
  std::string to_json() const;
  std::string to_text() const;
  /// Times over intensity with the fit, and what is left, as SVG.
  std::string to_svg(const std::string& name) const;
};

/// Throws `InputError` where there are less than two intensities.
GelTimeFit fit_gel_time(const TimesToGel& data);

}  // namespace slicecorr::resins
