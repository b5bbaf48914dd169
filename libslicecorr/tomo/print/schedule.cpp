// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/print/schedule.hpp"

#include <algorithm>
#include <cmath>

namespace slicecorr::tomo::detail {

LitRuns::LitRuns(const Schedule& schedule, int angles) {
  const long n = schedule.cells();
  const auto stage_of = [&](long cell) {
    const auto m = std::lround(static_cast<double>(cell) * angles / static_cast<double>(n));
    return static_cast<int>((m % angles + angles) % angles);
  };
  const auto alike = [&](long a, long b) {
    const std::vector<Schedule::Part>&one = schedule.at(a), &other = schedule.at(b);
    return stage_of(a) == stage_of(b) &&
           std::equal(one.begin(), one.end(), other.begin(), other.end(),
                      [](const Schedule::Part& p, const Schedule::Part& q) {
                        return p.angle == q.angle &&
                               std::abs(p.exposed_s - q.exposed_s) <= 1e-9 * q.exposed_s;
                      });
  };
  long begin = 0;
  while (begin < n && alike(begin, begin - 1)) ++begin;
  run_of_cell_.resize(static_cast<std::size_t>(n));
  for (long cell = begin; cell < begin + n; ++cell) {
    if (runs_.empty() || !alike(cell, cell - 1)) {
      runs_.push_back({cell, cell, stage_of(cell), &schedule.at(cell)});
    }
    runs_.back().end = cell + 1;
    run_of_cell_[static_cast<std::size_t>(cell % n)] = static_cast<int>(runs_.size()) - 1;
  }
}

Schedule planned(const TomoJob& job, const Bench& bench) {
  Schedule schedule(bench.grid.angles);
  const double each_s = bench.exposure.turn_s * job.turns / bench.grid.angles;
  for (int m = 0; m < bench.grid.angles; ++m) schedule.add(m, m, each_s);
  return schedule;
}

Schedule scheduled(std::span<const Showing> shown, const Bench& bench) {
  Schedule schedule(Schedule::kCellsPerStep * bench.grid.angles);
  const double cells_per_deg = schedule.cells() / 360.0;
  for (const Showing& s : shown) {
    const int angle = s.frame == kBlackFrame ? kBlackFrame : bench.frame_of_angle(s.frame);
    const double light_s = s.exposed_s * s.share;
    // th falls where the vial turns counterclockwise.
    const double side = (bench.clockwise ? 1 : -1) * cells_per_deg;
    const double a = side * s.from_deg + 0.5, b = side * s.to_deg + 0.5;
    const double low = std::min(a, b), high = std::max(a, b), width = high - low;
    const auto first = static_cast<long>(std::floor(low));
    if (!(width > 1e-9)) {
      schedule.add(first, angle, light_s);
      continue;
    }
    // Whole turns leave the same in each cell.
    const int cells = schedule.cells();
    const double whole = std::floor(width / cells), end = high - whole * cells;
    for (int cell = 0; whole > 0 && cell < cells; ++cell) {
      schedule.add(cell, angle, light_s * whole / width);
    }
    for (long cell = first; static_cast<double>(cell) < end; ++cell) {
      const double from = std::max(low, static_cast<double>(cell)),
                   to = std::min(end, static_cast<double>(cell) + 1);
      if (to > from) schedule.add(cell, angle, light_s * (to - from) / width);
    }
  }
  return schedule;
}

}  // namespace slicecorr::tomo::detail
