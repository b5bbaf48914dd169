// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/print/changing_resin.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <vector>

#include "slicecorr/error.hpp"
#include "slicecorr/vial.hpp"
#include "tomo/operators/dose_spread.hpp"

namespace slicecorr::tomo::detail {

namespace {

/// Steps of turns at most, in which dose spreads. A wave that spreads to exp(-L) in all of the print
/// is wrong by (L/64)²/24 of what is left of it at most: as if all light of a step came in its middle.
constexpr int kMostSteps = 64;

TurnOfVoxel turn_at(const TurnDose& turn, std::size_t v) {
  const double gain = turn.gain.values[v];
  if (turn.rise.values.empty()) return {gain, 0, gain, gain};
  return {gain, turn.lowest.values[v], turn.highest.values[v], turn.rise.values[v]};
}

}  // namespace

void TurnOfVoxel::add(double light, double back) {
  // Straight between both ends, so that only these are looked at.
  gain += light - back;
  rise = std::max(rise, gain - lowest);
  lowest = std::min(lowest, gain);
  highest = std::max(highest, gain);
}

double after_turns(const TurnOfVoxel& turn, int turns, double before) {
  // A turn leaves max(E + gain, gain - lowest): the second where E was 0 on the way.
  const double again = turn.gain > 0 ? (turns - 1) * turn.gain : 0;
  return std::max(before + turns * turn.gain, turn.gain - turn.lowest + again);
}

double most_in_turns(const TurnOfVoxel& turn, int turns, double before) {
  // Turns begin with ever more, or ever less, so that the most is in the last or the first.
  const double last = turns > 1 ? after_turns(turn, turns - 1, before) : before;
  return std::max(std::max(before, last) + turn.highest, turn.rise);
}

double spread_mm(const Bench& bench, const Resin& resin, double turns) {
  return dose_spread_mm(resin, turns * bench.exposure.turn_s);
}

double kappa_of_turn(const Bench& bench, const Resin& resin) {
  const double deviation = spread_mm(bench, resin, 1) / bench.grid.voxel_mm();
  return 0.5 * deviation * deviation;
}

void check_spread(const Bench& bench, const Resin& resin, int turns) {
  const double deviation = spread_mm(bench, resin, turns);
  if (deviation <= bench.radius_mm) return;
  throw InputError(resin.name, "dose_diffusion_m2_s",
                   fmt::format("is {:g}: dose spreads by {:.3g} mm in {} turns of {:g} s, and the "
                               "resin has a radius of {:g} mm; expected less",
                               resin.dose_diffusion_m2_s, deviation, turns, bench.exposure.turn_s,
                               bench.radius_mm));
}

Box<float> effective_dose(const Bench& bench, const Resin& resin, const Box<std::uint8_t>& insert,
                          int turns, const TurnDose& turn, const ExecutionContext& context) {
  check_spread(bench, resin, turns);
  Box<float> dose = turn.gain;
  const TomoGrid& grid = bench.grid;
  const auto each_row = [&](const auto& use) {
    parallel_for(context, "spread", static_cast<std::size_t>(grid.voxels), [&](std::size_t row) {
      const int y = static_cast<int>(row);
      for (int x = grid.inside(y).first; x < grid.inside(y).end; ++x) use(x, y);
    });
  };
  const double kappa = kappa_of_turn(bench, resin);
  if (!(kappa > 0)) {
    each_row([&](int x, int y) {
      for (int z = 0; z < grid.slices; ++z) {
        const std::size_t v = dose.at(z, y, x);
        dose.values[v] = static_cast<float>(most_in_turns(turn_at(turn, v), turns, 0));
      }
    });
    return dose;
  }

  const DoseSpread spread(grid, insert, spread_mm(bench, resin, turns));
  Array<float> now(spread.size(), 0.0F);
  // By twice the number of turns.
  std::map<int, SpreadSeries> spreads;
  const auto spread_by = [&](int half_turns) {
    auto [at, fresh] = spreads.try_emplace(half_turns);
    if (fresh) {
      at->second = spread.series(
          [&](double lambda) { return spread_for(0.5 * half_turns * kappa, lambda); });
    }
    spread.apply(at->second, now, context);
  };
  const TurnOfVoxel dark = [&] {
    TurnOfVoxel t;
    t.add(0, bench.resupply_mj_cm3_s * bench.exposure.turn_s);
    return t;
  }();
  const int steps = std::min(turns, kMostSteps);
  int done = 0, before = 0;
  for (int s = 0; s < steps; ++s) {
    context.check_cancelled();
    const int count = static_cast<int>((static_cast<long long>(turns) * (s + 1)) / steps) - done;
    done += count;
    if (s > 0) spread_by(before + count);
    before = count;
    each_row([&](int x, int y) {
      float* const column = now.data() + spread.at(x, y);
      for (int z = -spread.below(); z < grid.slices + spread.below(); ++z) {
        const bool lit = z >= 0 && z < grid.slices;
        const std::size_t v = lit ? dose.at(z, y, x) : 0;
        const TurnOfVoxel t = lit ? turn_at(turn, v) : dark;
        const double start = column[z], end = after_turns(t, count, start);
        column[z] = static_cast<float>(end);
        // What was there for a while in the last turns, above what is left of it.
        if (lit && done == turns) {
          dose.values[v] = static_cast<float>(most_in_turns(t, count, start) - end);
        }
      }
    });
  }
  spread_by(before);
  each_row([&](int x, int y) {
    const float* const column = now.data() + spread.at(x, y);
    for (int z = 0; z < grid.slices; ++z) {
      float& d = dose.values[dose.at(z, y, x)];
      d = std::max(0.0F, d + column[z]);
      if (!insert.values.empty() && insert.values[insert.at(z, y, x)] > 0) d = 0;
    }
  });
  return dose;
}

}  // namespace slicecorr::tomo::detail
