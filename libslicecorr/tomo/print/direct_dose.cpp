// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Doses of a job by a direct sum, to judge what the solver's operators say.
#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <span>
#include <vector>

#include "parallel/silent.hpp"
#include "slicecorr/tomo/print.hpp"
#include "slicecorr/tomo/shown.hpp"
#include "tomo/print/changing_resin.hpp"
#include "tomo/print/direct_sum.hpp"

namespace slicecorr::tomo {

using detail::Schedule;

double detail::Judged::arc() const {
  const TomoGrid& g = bench.grid;
  const double part_mm = part_radius_mm(job.part, job.sampling.voxel_mm);
  const double radius_mm =
      part_mm > 0 ? std::min(bench.radius_mm, part_mm + g.voxel_mm()) : bench.radius_mm;
  return 2 * std::numbers::pi / g.angles * radius_mm / g.voxel_mm();
}

int detail::Judged::angle_near(long cell) const {
  const long angles = bench.grid.angles, cells = schedule.cells();
  const auto m = std::lround(static_cast<double>(cell) * static_cast<double>(angles) /
                             static_cast<double>(cells));
  return static_cast<int>((m % angles + angles) % angles);
}

namespace {

/// In resin that stays as it is, all the light of the print; else that of `turns` one by one, which
/// bring the same light each.
struct Lit {
  const Schedule& schedule;
  int turns = 1;
  JudgedAt at = JudgedAt::means;
};
Box<float> dose_of(const TomoJob& job, const Bench& bench, const Lit& lit,
                   const ExecutionContext& context) {
  const auto& [schedule, turns, at] = lit;
  const TomoGrid& grid = bench.grid;
  const detail::Judged judged{job, bench, schedule, at};
  const std::unique_ptr<detail::DirectSum> direct =
      bench.traced     ? detail::make_traced_sum(judged, context)
      : grid.coupled() ? detail::make_ray_sum(judged, context)
                       : detail::make_level_sum(judged);
  const double per_unit = bench.exposure.alpha_a_per_cm;
  Box<float> dose{grid.slices, grid.voxels, grid.voxels, {}};
  dose.values.assign(static_cast<std::size_t>(grid.slices) * static_cast<std::size_t>(grid.voxels) *
                         static_cast<std::size_t>(grid.voxels),
                     0.0F);
  const auto slices = static_cast<std::size_t>(grid.slices);
  const bool comes_back = bench.resupply_mj_cm3_s > 0;
  if (comes_back || job.resin.dose_diffusion_m2_s > 0) {
    detail::check_spread(bench, job.resin, turns);
    detail::TurnDose turn{std::move(dose), {}, {}, {}};
    if (comes_back) turn.lowest = turn.highest = turn.rise = turn.gain;
    const auto frames = comes_back ? static_cast<std::size_t>(grid.angles) : std::size_t{1};
    const double share = per_unit / turns;
    const double back =
        bench.resupply_mj_cm3_s * bench.exposure.turn_s / static_cast<double>(frames);
    parallel_for(context, "judge", static_cast<std::size_t>(grid.voxels), [&](std::size_t row) {
      const int y = static_cast<int>(row);
      std::vector<double> sum(frames * slices);
      std::vector<detail::TurnOfVoxel> voxels(slices);
      for (int x = grid.inside(y).first; x < grid.inside(y).end; ++x) {
        std::fill(sum.begin(), sum.end(), 0.0);
        direct->add(x, y, sum);
        std::fill(voxels.begin(), voxels.end(), detail::TurnOfVoxel{});
        for (std::size_t k = 0; k < sum.size(); ++k) voxels[k % slices].add(share * sum[k], back);
        for (std::size_t z = 0; z < slices; ++z) {
          const detail::TurnOfVoxel& voxel = voxels[z];
          const std::size_t v = turn.gain.at(static_cast<int>(z), y, x);
          turn.gain.values[v] = static_cast<float>(voxel.gain);
          if (!comes_back) continue;
          turn.lowest.values[v] = static_cast<float>(voxel.lowest);
          turn.highest.values[v] = static_cast<float>(voxel.highest);
          turn.rise.values[v] = static_cast<float>(voxel.rise);
        }
      }
    });
    return detail::effective_dose(bench, job.resin, job.insert, turns, turn,
                                  slicecorr::detail::silent(context));
  }
  parallel_for(context, "judge", static_cast<std::size_t>(grid.voxels), [&](std::size_t row) {
    const int y = static_cast<int>(row);
    std::vector<double> sum(slices);
    const TomoGrid::Range range = grid.inside(y);
    for (int x = range.first; x < range.end; ++x) {
      std::fill(sum.begin(), sum.end(), 0.0);
      direct->add(x, y, sum);
      for (int z = 0; z < grid.slices; ++z) {
        dose.values[dose.at(z, y, x)] =
            static_cast<float>(per_unit * sum[static_cast<std::size_t>(z)]);
      }
    }
  });
  return dose;
}

}  // namespace

Box<float> dose_of(const TomoJob& job, const ExecutionContext& context, JudgedAt at) {
  const Bench bench = make_bench(job.printer, job.resin, job.sampling);
  const Schedule schedule = detail::planned(job, bench);
  return dose_of(job, bench, {schedule, job.turns, at}, context);
}

Box<float> dose_of(const TomoJob& job, std::span<const Showing> shown,
                   const ExecutionContext& context, JudgedAt at) {
  const Bench bench = make_bench(job.printer, job.resin, job.sampling);
  double lit_s = 0;
  for (const Showing& s : shown) lit_s += s.frame == kBlackFrame ? 0 : s.exposed_s;
  const double turns = std::clamp(std::round(lit_s / bench.exposure.turn_s), 1.0, 1e9);
  const Schedule schedule = detail::scheduled(shown, bench);
  return dose_of(job, bench, {schedule, static_cast<int>(turns), at}, context);
}

}  // namespace slicecorr::tomo
