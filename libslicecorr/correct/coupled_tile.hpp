// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What a coupled correction holds of a tile of pixels.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <utility>

#include "correct/coupled.hpp"

namespace slicecorr::detail {

/// How much more is asked for at first than would do if every slice gave it: many can't, being dark or
/// bright already.
inline constexpr double kUrgency = 4;
/// By this factor the loss of a patch may rise where fewer voxels are wrong.
inline constexpr double kMostLossRise = 2;

/// What of a tile is wrong; see `PatchFigures`.
struct CoupledCorrection::Figures {
  std::uint64_t through = 0, under = 0, parted = 0, unmet = 0;
  double loss = 0;
  Kept misses;  ///< null: none
  bool all_misses = true;
  std::uint64_t wrong() const {
    return through + under + parted + CoupledRound::kUnmetCounts * unmet;
  }
  /// Fewer wrong voxels or a smaller loss: some voxels that are wrong by little may be the way to
  /// none.
  bool gains_on(const Figures& before, const CoupledRound& round) const {
    if (round.lifted && parted != before.parted) return parted < before.parted;
    if (round.unmet_first && unmet != before.unmet) return unmet < before.unmet;
    return loss < before.loss || (wrong() < before.wrong() && loss <= kMostLossRise * before.loss);
  }
};

struct CoupledCorrection::Tile {
  PixelBox box;
  KeptTile coverage, columns, now, best;
  KeptTile left_alone;  ///< black where nothing is
  // Where columns want their light only.
  KeptTile heights;               ///< of edges, at nodes
  KeptTile wanted;                ///< the light that is to reach columns, as levels
  Figures figures, best_figures;  ///< of `now` and of `best`
  double urgency = kUrgency;
  std::map<std::pair<std::int32_t, std::size_t>, std::uint8_t>
      wanted_doses;  ///< by slice and pixel
  KeptTile aims;     ///< the same; black: none
};

}  // namespace slicecorr::detail
