// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <map>

#include "fit/statistics.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/resins/fit.hpp"

namespace slicecorr::resins {

ExponentFit exponent_from_times(const std::vector<TimeToState>& times,
                                double induction_dose_mj_cm2) {
  struct Sum {
    double n = 0, x = 0, y = 0;
  };
  std::map<double, Sum> sums;
  const auto ln_time = [&](const TimeToState& t) {
    const double rest = t.time_s - induction_dose_mj_cm2 / t.intensity_mw_cm2;
    if (!(t.intensity_mw_cm2 > 0) || !(t.time_s > 0) || !(rest > 0) || !std::isfinite(rest)) {
      throw InputError(
          fmt::format("{:g} s at {:g} mW/cm2 is no time after an induction dose of {:g} mJ/cm2; "
                      "expected numbers above 0 and a longer time",
                      t.time_s, t.intensity_mw_cm2, induction_dose_mj_cm2));
    }
    return std::log(rest);
  };
  for (const TimeToState& t : times) {
    Sum& s = sums[t.state];
    s.n += 1;
    s.x += std::log(t.intensity_mw_cm2);
    s.y += ln_time(t);
  }
  double xx = 0, xy = 0, yy = 0;
  for (const TimeToState& t : times) {
    const Sum& s = sums[t.state];
    const double x = std::log(t.intensity_mw_cm2) - s.x / s.n, y = ln_time(t) - s.y / s.n;
    xx += x * x;
    xy += x * y;
    yy += y * y;
  }
  if (!(xx > 1e-12)) {
    throw InputError(
        "m can't be known from times at one intensity; expected the same state at two or more");
  }
  ExponentFit fit;
  fit.n = static_cast<int>(times.size());
  fit.states = static_cast<int>(sums.size());
  fit.m = -xy / xx;
  const int freedom = fit.n - fit.states - 1;
  const double nothing = std::numeric_limits<double>::quiet_NaN();
  fit.stderr_ = nothing;
  if (freedom > 0) {
    fit.stderr_ = std::sqrt(std::max(0.0, yy - xy * xy / xx) / freedom / xx);
  }
  const double half = freedom > 0 ? student_t_quantile(0.975, freedom) * fit.stderr_ : nothing;
  fit.ci95 = {fit.m - half, fit.m + half};
  return fit;
}

}  // namespace slicecorr::resins
