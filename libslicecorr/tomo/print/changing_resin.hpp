// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The dose that counts, of resin that changes while it is printed: inhibitors come back, and dose
/// spreads.
///
/// The effective dose E of a voxel grows as light comes and falls by rho each second, but not below
/// 0, where all inhibitor is back: E' = light - rho. All turns bring the same light; so what a turn
/// does to a voxel is known from four numbers of it, whatever the order in which its light comes, and
/// that of n turns in closed form. Between turns E spreads (dose_spread.hpp).
#pragma once

#include "slicecorr/parallel.hpp"
#include "slicecorr/tomo/bench.hpp"
#include "slicecorr/tomo/npy.hpp"

namespace slicecorr::tomo::detail {

/// X, what a turn has brought of light less what has come back since its start, mJ/cm³.
struct TurnOfVoxel {
  double gain = 0;     ///< X at its end
  double lowest = 0;   ///< least X, <= 0
  double highest = 0;  ///< greatest X, >= 0
  double rise = 0;     ///< most by which X rises from some moment to a later one
  /// Goes on: so much light came while so much came back, both evenly.
  void add(double light, double back);
};

/// E after so many turns that begin with `before`.
double after_turns(const TurnOfVoxel& turn, int turns, double before);
/// The most that E is while these turns last.
double most_in_turns(const TurnOfVoxel& turn, int turns, double before);

/// Of all voxels, [z][y][x]. The last three are empty where nothing comes back.
struct TurnDose {
  Box<float> gain, lowest, highest, rise;
};

/// The dose that counts when so many turns are over: the most that E was while the last of them
/// lasted, which no earlier one exceeds. `insert` may be empty. Prints of more than 64 turns go in
/// 64 steps of turns. Throws `InputError` where dose spreads farther than the vial is wide.
Box<float> effective_dose(const Bench& bench, const Resin& resin, const Box<std::uint8_t>& insert,
                          int turns, const TurnDose& turn, const ExecutionContext& context);

/// Standard deviation of dose that has spread for so many turns, mm.
double spread_mm(const Bench& bench, const Resin& resin, double turns);
/// kappa of one turn: what DoseSpread calls so.
double kappa_of_turn(const Bench& bench, const Resin& resin);
/// Throws `InputError` where dose spreads farther in these turns than the resin's radius.
void check_spread(const Bench& bench, const Resin& resin, int turns);

}  // namespace slicecorr::tomo::detail
