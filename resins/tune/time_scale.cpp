// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/resins/time_scale.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "slicecorr/error.hpp"
#include "slicecorr/kinetics.hpp"
#include "slicecorr/supports.hpp"

namespace slicecorr::resins {

namespace {

/// When resin at the window gels: (3.22) there, or A/i + B/sqrt(i).
double window_gel_time_s(const Kinetics& k, const Resin& resin, double intensity_mw_cm2) {
  if (k.has_gel_time()) return gel_time_s(k.gel_time, intensity_mw_cm2);
  return k.critical_dose_prime / std::pow(intensity_mw_cm2, resin.m);
}

/// Throws where no change of doses makes times and law one.
void check_times(const TimeScale& s) {
  constexpr double most_scale = 100, most_rms = 1;
  if (s.scale > most_scale || s.scale < 1 / most_scale) {
    const bool ms = s.scale > 300 && s.scale < 3000;
    throw InputError(fmt::format(
        "the times are {:.4g} times those of the file; expected s and mW/cm², and a resin of this kind{}",
        s.scale, ms ? ": were these ms?" : ""));
  }
  if (s.rms_error > most_rms) {
    throw InputError(fmt::format(
        "times do not stand to each other as the file says ({:.2g} % rms); expected a law that was fitted "
        "to them (resinctl fit)",
        100 * s.rms_error));
  }
}

}  // namespace

TimeScale scale_by_times(const Resin& resin, const TimesToGel& times) {
  refuse_law(resin, LawUse::gel_times);
  if (!resin.has_gel_time() && resin.dose_factor == 1 && resin.gel_dose_mj_cm3 == 0) {
    throw InputError(
        resin.name, "cure.dose_factor",
        "the file gives the dose aimed at alone; expected the dose of gel, which times to "
        "gel are held against");
  }
  if (times.times.empty()) throw InputError("no times to gel; expected one or more");
  const Kinetics k = make_kinetics(resin, false, false);
  TimeScale s;
  double sum = 0;
  std::vector<double> intensities;
  for (const TimeToGel& t : times.times) {
    s.told_s.push_back(window_gel_time_s(k, resin, t.intensity_mw_cm2));
    sum += std::log(t.time_s / s.told_s.back());
    intensities.push_back(t.intensity_mw_cm2);
  }
  const auto n = static_cast<double>(times.times.size());
  s.scale = std::exp(sum / n);
  double squares = 0, scatter = 0;
  for (std::size_t i = 0; i < times.times.size(); ++i) {
    const double off = s.scale * s.told_s[i] / times.times[i].time_s - 1;
    squares += off * off / n;
    scatter += std::pow(std::log(times.times[i].time_s / s.told_s[i]) - sum / n, 2);
    s.worst_error = std::max(s.worst_error, std::abs(off));
  }
  s.rms_error = std::sqrt(squares);
  check_times(s);
  s.stderr_ln = n > 1 ? std::sqrt(scatter / (n - 1) / n) : std::numeric_limits<double>::quiet_NaN();
  std::sort(intensities.begin(), intensities.end());
  s.intensities =
      static_cast<int>(std::unique(intensities.begin(), intensities.end()) - intensities.begin());
  return s;
}

std::string TimeScale::to_text(const Resin& resin) const {
  std::string text =
      fmt::format("resin '{}' gels in {:.4g} times the time that its file says, by {} {} at {} {}",
                  resin.name, scale, told_s.size(), told_s.size() == 1 ? "time" : "times",
                  intensities, intensities == 1 ? "intensity" : "intensities");
  if (std::isfinite(stderr_ln)) text += fmt::format(" (standard error {:.2g} %)", 100 * stderr_ln);
  text += fmt::format(
      "; all its doses are multiplied by that\nwhat is left: {:.2g} % rms, {:.2g} % at most\n",
      100 * rms_error, 100 * worst_error);
  if (intensities == 1) {
    text +=
        "one intensity does not tell whether the law holds: a time at a tenth of the light would\n";
  } else if (worst_error > 0.2) {
    text += "times do not stand to each other as the file says: fit its law anew (resinctl fit)\n";
  }
  return text;
}

}  // namespace slicecorr::resins
