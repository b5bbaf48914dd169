// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// From light to grey levels and whole turns.
#pragma once

#include <cstdint>

#include "slicecorr/tomo/bench.hpp"
#include "slicecorr/tomo/print.hpp"

namespace slicecorr::tomo::detail {

/// Up to so many levels that are used it is tried which way to round them.
inline constexpr std::size_t kFewLevels = 64;

/// Light that was found, to be shown.
struct ToShow {
  const Bench& bench;
  const Target& target;
  const Light& light;       ///< of the bench, in any unit
  double scale = 0;         ///< mW/cm2 of that unit, about
  double brightest = 0;     ///< most of them that the projector has
  int turns = 1;            ///< about
  int most_turns = 0;       ///< 0: as many as it takes
  double black_mj_cm3 = 0;  ///< that black light leaves in a turn, at most
  int hold = 0;  ///< frames of each angle; 0: as many as gain contrast where few levels are used
};

/// What was shown.
struct RoundedPrint {
  PrintFigures figures;
  std::uint16_t top = 0;  ///< brightest level of frames that are not held
  int hold = 1;
};
/// Gives `job`, which has all else, its levels, turns and angles. Rounding to levels, and the direct sum, which
/// weighs light otherwise, may find the weakest voxel a little short: a little more for all, or a turn more.
/// Where no turn more is allowed, pixels that can't be brighter stay as they are. Doses in bands are brought to
/// the middle between their least and their most. Progress is of the stage "judging".
RoundedPrint show_light(const ToShow& show, const ExecutionContext& context, TomoJob& job);

/// Frames of an angle that may be asked for with `angles` of them: odd, so that one is of the angle itself. Throws
/// `InputError` for others, for more frames than the projector shows in a turn, and for an axis that wobbles,
/// which each angle's frame follows.
void check_hold(const Printer& printer, int angles, int hold);

}  // namespace slicecorr::tomo::detail
