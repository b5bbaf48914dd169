// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The dead zone as the gap in which every cell's front has just its gel dose.

#include <algorithm>
#include <cmath>

#include "flow/coarser_section.hpp"
#include "flow/disc_levels.hpp"
#include "flow/front_step.hpp"
#include "flow/solvable.hpp"
#include "slicecorr/flow_suction.hpp"

namespace slicecorr {

namespace {

constexpr double kLeastGapUm = 1, kSettledUm = 0.25;
constexpr int kMostRounds = 160;
/// Of the last so many rounds a front is at rest that moves by less.
constexpr int kWatchedRounds = 12;
constexpr double kRestUm = 2, kRestShare = 0.1;
/// Where less of the cells comes to rest, the rounds say nothing.
constexpr double kLeastAtRest = 0.9;
/// Share of the cells with the thinnest gaps, and of those with the thickest, that are left out: single
/// cells of jagged outlines stray.
constexpr double kStray = 0.02;
/// Half of those of a sweep that is looked at: what moves a gap is smooth.
constexpr int kLevels = 24;

/// Coarse enough to be quick, and fine enough to be solved.
FlowSection for_fixed_point(const FlowSection& fine) {
  constexpr int kMostCells = 64;
  for (int factor = (std::max(fine.width, fine.height) + kMostCells - 1) / kMostCells; factor > 1;
       --factor) {
    FlowSection s = detail::coarser(fine, factor);
    if (detail::solvable(s)) return s;
  }
  return fine;
}

/// What resin gains from `low_um` to `high_um`, relative dose times speed.
double risen(const Kinetics& k, const FlowLight& light, double low_um, double high_um) {
  if (low_um >= high_um) return 0;
  return disc::dose_integral(k, light.blue_mw_cm2, light.uv_mw_cm2, low_um, high_um) /
         k.critical_dose_prime;
}

}  // namespace

DeadZoneRange dead_zone_under(const FlowSection& section, const FlowResin& resin, double speed_mm_h,
                              double start_um, const FlowLight& light,
                              const ExecutionContext& context) {
  const FlowSection s = for_fixed_point(section);
  const double speed_um_s = speed_mm_h / 3.6;
  const std::vector<double> distance_um = outline_distance_um(s);
  std::vector<std::size_t> part;
  for (std::size_t k = 0; k < s.size(); ++k) {
    if (s.cells[k] == FlowCell::part) part.push_back(k);
  }
  std::vector<double> gap_um(s.size(), start_um), felt_um = gap_um;
  std::vector<double> low_um(s.size(), kThickestGapUm), high_um(s.size(), 0);
  GapPressure now = solve_pressure(s, context);
  DeadZoneRange zone;
  // Where the front of the even gap comes to 1 at the rate that holds there.
  std::vector<double> first_um;
  const auto first_step_to = [&](double front) {
    const Kinetics& kinetics = resin.kinetics;
    const double net = disc::rate_at(kinetics, light.blue_mw_cm2, light.uv_mw_cm2, start_um);
    const double rate = disc::dose_rate(kinetics, std::max(net, 0.1 * light.blue_mw_cm2));
    return std::clamp(start_um + speed_um_s * kinetics.critical_dose_prime * (1 - front) / rate,
                      kLeastGapUm, kThickestGapUm);
  };
  for (bool settled = false; !settled && zone.rounds < kMostRounds; ++zone.rounds) {
    context.check_cancelled();
    const bool even = zone.rounds == 0;
    if (!even) {
      felt_um = felt_gap_um(s, gap_um);
      // Beside the part the flow feels nothing.
      for (std::size_t k = 0; k < s.size(); ++k) {
        if (s.cells[k] != FlowCell::part) felt_um[k] = start_um;
      }
      now = solve_pressure(s, felt_um, start_um, context);
    }
    const SectionSweep sweep(s, now, resin, speed_mm_h,
                             even ? std::span<const double>(&start_um, 1) : felt_um, {kLevels});
    const SectionDose dose = sweep.dose({&light.blue_mw_cm2, 1}, {&light.uv_mw_cm2, 1});
    if (even) {
      for (const std::size_t k : part) first_um.push_back(first_step_to(dose.front[k]));
    }
    settled = true;
    zone.max_window = 0;
    for (const std::size_t k : part) {
      zone.max_window = std::max(zone.max_window, dose.window[k]);
      // Between the gap that is felt and the front resin rises with the part, in full light.
      const double front =
          dose.front[k] + risen(resin.kinetics, light, felt_um[k], gap_um[k]) / speed_um_s;
      const double step = detail::front_step_um(resin.kinetics, speed_um_s, gap_um[k],
                                                light.blue_mw_cm2, light.uv_mw_cm2, front);
      const double next = std::clamp(gap_um[k] + step, kLeastGapUm, kThickestGapUm);
      settled = settled && std::abs(next - gap_um[k]) < kSettledUm;
      gap_um[k] = next;
      if (zone.rounds < kMostRounds - kWatchedRounds) continue;
      low_um[k] = std::min(low_um[k], next);
      high_um[k] = std::max(high_um[k], next);
    }
  }
  const auto rests = [&](std::size_t k) {
    return high_um[k] - low_um[k] <= kRestUm + kRestShare * gap_um[k];
  };
  const auto still =
      static_cast<double>(std::count_if(part.begin(), part.end(), [&](std::size_t k) {
        return rests(k) && gap_um[k] > kLeastGapUm;
      }));
  zone.at_rest = still >= kLeastAtRest * static_cast<double>(part.size());
  const bool inner = std::any_of(part.begin(), part.end(),
                                 [&](std::size_t k) { return distance_um[k] >= start_um; });
  std::vector<double> found;
  for (std::size_t i = 0; i < part.size(); ++i) {
    const std::size_t k = part[i];
    if (inner && distance_um[k] < start_um) continue;
    if (!zone.at_rest) {
      found.push_back(first_um[i]);
    } else if (rests(k)) {
      found.push_back(gap_um[k]);
    }
  }
  std::sort(found.begin(), found.end());
  const auto left_out = static_cast<std::size_t>(kStray * static_cast<double>(found.size()));
  zone.min_um = found[left_out];
  zone.max_um = found[found.size() - 1 - left_out];
  return zone;
}

}  // namespace slicecorr
