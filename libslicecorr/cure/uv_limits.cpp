// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What UV light a print may have instead of what it has.
#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>

#include "cure/limits.hpp"
#include "slicecorr/inhibited.hpp"
#include "slicecorr/limit.hpp"
#include "support/numbers/bracket.hpp"

namespace slicecorr {

namespace {

// Tables end where the share of UV light is 1e-6; far inside that is nothing.
constexpr double kTables = 1e-5;
/// Factor on the dose that is needed for a print's end, which is cured by what full light gives
/// beyond black.
constexpr double kEnds = 1.001;

/// The intensity rounded to as few digits as leave it within the lamp's range and working.
std::optional<double> typed_uv(double holds, bool up, const UvLamp& lamp,
                               const std::function<bool(double)>& works) {
  for (int digits = kLimitDigits; digits <= 15; digits += 2) {
    const double typed = up ? rounded_up(holds, digits) : rounded_down(holds, digits);
    if (typed >= lamp.min_mw_cm2() && typed <= lamp.max_mw_cm2() && works(typed)) return typed;
  }
  return std::nullopt;
}

}  // namespace

std::optional<double> detail::working_uv(const Kinetics& k, double layer_um,
                                         const std::vector<double>& blue, const UvLamp& lamp,
                                         const Process& process, double needed) {
  if (!process.uv_lamp_share.empty() || process.uv.kind != UvKind::constant ||
      !(process.uv.uv_mw_cm2 > 0))
    return std::nullopt;
  const auto works = [&](double uv) {
    double lit = blue.back();
    for (std::size_t l = blue.size(); !process.allow_window_cure && l-- > 0;) {
      lit = blue[l];
      if (keeps_dead_zone(k, lit, uv)) break;
    }
    const auto dose = [&](double at) { return steady_dose_under_uv(k, process, layer_um, at, uv); };
    const double black = dose(blue.front());
    return uv > 0 && (process.allow_window_cure || keeps_dead_zone(k, lit, uv)) &&
           dose(lit) > needed * (1 + kTables) && dose(lit) - black > kEnds && black < 1 - kTables;
  };
  const double least = lamp.min_mw_cm2(), most = lamp.max_mw_cm2();
  const double now = std::clamp(process.uv.uv_mw_cm2, least, most);
  if (now != process.uv.uv_mw_cm2 && works(now)) return typed_uv(now, now == least, lamp, works);
  for (const double end : {most, std::max(least, now / 1e4)}) {
    constexpr int steps = 100;
    double fails = now;
    for (int i = 1; i <= steps && end != now; ++i) {
      double holds = now * std::pow(end / now, static_cast<double>(i) / steps);
      if (!works(holds)) {
        fails = holds;
        continue;
      }
      // What holds may lie on either side.
      const Bracket b = halved({std::min(holds, fails), std::max(holds, fails)}, 40,
                               [&](double x) { return works(x) == (holds < fails); });
      return typed_uv(holds < fails ? b.low : b.high, end > now, lamp, works);
    }
  }
  return std::nullopt;
}

std::optional<double> detail::working_dead_zone_um(const Kinetics& k, double layer_um,
                                                   const std::vector<double>& blue,
                                                   double brightest_mw_cm2, const UvLamp& lamp,
                                                   const Process& process) {
  // A pattern has levels, so its UV light is a little stronger than needed: room for that.
  constexpr double gels = 1.02;
  const auto works = [&](double zone_um) {
    const double uv = uv_for_dead_zone(k, brightest_mw_cm2, zone_um);
    const auto dose = [&](double at) { return steady_dose_under_uv(k, process, layer_um, at, uv); };
    const double black = dose(blue.front());
    return uv >= lamp.min_mw_cm2() && uv <= lamp.max_mw_cm2() && dose(blue.back()) - black > gels &&
           black < 1 - kTables;
  };
  double fails = process.uv.dead_zone_um, holds = fails;
  for (int i = 0; i < 200; ++i) {
    holds *= 0.97;
    if (works(holds)) break;
    fails = holds;
  }
  if (!works(holds)) return std::nullopt;
  const double typed = rounded_down(halved({holds, fails}, 40, works).low);
  return works(typed) ? std::optional(typed) : std::nullopt;
}

double detail::steady_dose_under_uv(const Kinetics& k, const Process& process, double layer_um,
                                    double blue_mw_cm2, double uv_mw_cm2) {
  if (process.mode == ExposureMode::continuous) {
    return passing_dose_prime(k, blue_mw_cm2, uv_mw_cm2, process.speed_mm_h) /
           k.critical_dose_prime;
  }
  double sum = 0;
  // Up to 1e-12 of the light: what is further away adds no more than that.
  const int layers = static_cast<int>(std::ceil(28 * k.hb_um / k.m / layer_um)) + 1;
  for (int j = layers; j > 0; --j) {
    sum += dose_prime_at(k, blue_mw_cm2, uv_mw_cm2, j * layer_um, process.exposure_s);
  }
  return sum / k.critical_dose_prime;
}

}  // namespace slicecorr
