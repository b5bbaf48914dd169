// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "fit/figure_text.hpp"
#include "fit/statistics.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/resins/threshold_fit.hpp"
#include "support/json/finite.hpp"

namespace slicecorr::resins {

namespace {

using slicecorr::detail::finite_or_null;

constexpr double kNotKnown = std::numeric_limits<double>::quiet_NaN();

/// Sums of t i a - t b = 1, a = 1/E, b = i0/E.
struct RateSums {
  double uu = 0, uv = 0, vv = 0, u = 0, v = 0;
  explicit RateSums(const std::vector<TimeToGel>& times) {
    for (const TimeToGel& t : times) {
      const double p = t.time_s * t.intensity_mw_cm2, q = t.time_s;
      uu += p * p;
      uv += p * q;
      vv += q * q;
      u += p;
      v += q;
    }
  }
  double determinant() const { return uu * vv - uv * uv; }
};

}  // namespace

ThresholdFit fit_threshold(const TimesToGel& data) {
  ThresholdFit fit;
  fit.sources = data.sources;
  fit.times = data.times;
  double low = std::numeric_limits<double>::infinity(), high = 0;
  for (const TimeToGel& t : data.times) {
    low = std::min(low, t.intensity_mw_cm2);
    high = std::max(high, t.intensity_mw_cm2);
  }
  if (!(high > low * (1 + 1e-9))) {
    throw InputError(
        fmt::format("{} times at one intensity; expected two intensities or more, the lowest near "
                    "that at which the resin hardly gels",
                    data.times.size()));
  }
  const RateSums s(data.times);
  const double n = static_cast<double>(data.times.size());
  double a = (s.u * s.vv - s.v * s.uv) / s.determinant(),
         b = (s.u * s.uv - s.v * s.uu) / s.determinant();
  fit.at_bound = !(b > 0);
  if (fit.at_bound) {
    a = s.u / s.uu;
    b = 0;
  }
  if (!(a > 0)) throw InputError("times do not fall with light; expected a resin that light gels");
  double squares = 0;
  for (const TimeToGel& t : data.times) {
    const double rate = t.intensity_mw_cm2 * a - b;
    fit.predicted_s.push_back(rate > 0 ? 1 / rate : std::numeric_limits<double>::infinity());
    const double off = rate * t.time_s - 1;
    squares += off * off;
    fit.worst_error = std::max(fit.worst_error, std::abs(off));
  }
  fit.rms_error = std::sqrt(squares / n);
  const double freedom = n - (fit.at_bound ? 1 : 2);
  const double variance = freedom > 0 ? squares / freedom : kNotKnown;
  const double t = freedom > 0 ? student_t_quantile(0.975, freedom) : kNotKnown;
  const double aa = variance * (fit.at_bound ? 1 / s.uu : s.vv / s.determinant()),
               bb = fit.at_bound ? kNotKnown : variance * s.uu / s.determinant(),
               ab = fit.at_bound ? kNotKnown : variance * s.uv / s.determinant();
  const auto known = [&](ThresholdFit::Figure& f, double value, double square) {
    f.value = value;
    f.stderr_ = std::sqrt(square);
    f.ci95 = {value - t * f.stderr_, value + t * f.stderr_};
  };
  known(fit.dose_mj_cm2, 1 / a, aa / (a * a * a * a));
  // Of the quotient b / a.
  known(fit.threshold_mw_cm2, b / a, (bb - 2 * (b / a) * ab + (b / a) * (b / a) * aa) / (a * a));
  if (fit.at_bound) {
    fit.warnings.emplace_back(
        "the threshold came out at 0: time falls with intensity as in Jacobs' law, which says the "
        "same");
  } else if (std::isfinite(fit.threshold_mw_cm2.stderr_) && fit.threshold_mw_cm2.ci95[0] <= 0) {
    fit.warnings.emplace_back(
        "the threshold may be 0: its interval reaches there; times at lower intensities would tell");
  }
  for (std::size_t k = 0; k < fit.times.size(); ++k) {
    if (std::isfinite(fit.predicted_s[k])) continue;
    fit.warnings.push_back(fmt::format("{:g} mW/cm² gelled, and lies below the threshold",
                                       fit.times[k].intensity_mw_cm2));
  }
  fit.warnings.insert(fit.warnings.end(), data.warnings.begin(), data.warnings.end());
  if (n < 3)
    fit.warnings.emplace_back("with two times nothing is left to see whether the law holds");
  return fit;
}

std::string ThresholdFit::to_json(double active_per_cm) const {
  nlohmann::ordered_json j;
  j["model"] = "threshold";
  const auto add = [&](const char* name, const Figure& f, const char* unit, bool bound) {
    j["parameters"][name] = {{"value", finite_or_null(f.value)},
                             {"stderr", finite_or_null(f.stderr_)},
                             {"ci95", {finite_or_null(f.ci95[0]), finite_or_null(f.ci95[1])}},
                             {"unit", unit},
                             {"at_bound", bound}};
  };
  add("dose_mj_cm2", dose_mj_cm2, "mJ/cm²", false);
  add("threshold_mw_cm2", threshold_mw_cm2, "mW/cm²", at_bound);
  if (active_per_cm > 0) {
    j["resin"] = {{"gel_dose_mj_cm3", gel_dose_mj_cm3(active_per_cm)},
                  {"inhibition_resupply_mj_cm3_s", resupply_mj_cm3_s(active_per_cm)}};
  }
  j["n"] = times.size();
  j["rms_error"] = finite_or_null(rms_error);
  j["worst_error"] = finite_or_null(worst_error);
  j["warnings"] = warnings;
  j["sources"] = sources;
  auto& points = j["points"] = nlohmann::ordered_json::array();
  for (std::size_t k = 0; k < times.size(); ++k) {
    points.push_back({{"intensity_mw_cm2", times[k].intensity_mw_cm2},
                      {"time_s", times[k].time_s},
                      {"predicted_s", finite_or_null(predicted_s[k])},
                      {"source", times[k].origin.source},
                      {"line", times[k].origin.line}});
  }
  return j.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

std::string ThresholdFit::to_text(double active_per_cm) const {
  std::string text = fmt::format("threshold fit of {} times, t = E/(i - i0)\n", times.size());
  const auto line = [&](const char* name, const Figure& f, const char* unit) {
    text += fmt::format("  {:<20} {:>10} {}", name, figure(f.value, f.stderr_), unit);
    if (std::isfinite(f.stderr_)) {
      text += fmt::format("  95 %: {} to {}", figure(f.ci95[0], f.stderr_),
                          figure(f.ci95[1], f.stderr_));
    }
    text += "\n";
  };
  line("dose_mj_cm2", dose_mj_cm2, "mJ/cm²");
  line("threshold_mw_cm2", threshold_mw_cm2, "mW/cm²");
  text += fmt::format("Rates within {:.2g} % ({:.2g} % as a rule).\n", 100 * worst_error,
                      100 * rms_error);
  if (active_per_cm > 0) {
    text += fmt::format(
        "In a resin of {:.4g} /cm active absorption, where this light is that at the resin:\n"
        "  gel_dose_mj_cm3 = {:.4g}\n  inhibition_resupply_mj_cm3_s = {:.4g}\n",
        active_per_cm, gel_dose_mj_cm3(active_per_cm), resupply_mj_cm3_s(active_per_cm));
  }
  for (const std::string& w : warnings) text += "Warning: " + w + "\n";
  text.pop_back();
  return text;
}

}  // namespace slicecorr::resins
