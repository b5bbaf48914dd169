// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// When cells of a part gel, for a picture of it in the round.
#pragma once

#include <cstddef>
#include <functional>
#include <string>

#include "slicecorr/tomo/report.hpp"
#include "support/page/html_page.hpp"

namespace slicecorr::tomo::detail {

/// Voxels, x fastest. Functions take the place of a voxel among all.
struct RoundSource {
  int nx = 0, ny = 0, nz = 0;
  double voxel_mm = 0;
  /// The time at which it gels, over that of the print; up to 1: with it.
  std::function<double(std::size_t k)> share_of_time;
  std::function<Kept(std::size_t k, int x, int y)> kept;
  /// Whether the part, or an edge of it, is there: always shown.
  std::function<bool(std::size_t k)> has_part;
};

/// As `gel_times`.
GelTimes gel_cells(const RoundSource& source, int voxels_per_cell);

struct RoundWords {
  double time_s = 0;
  int turns = 0;  ///< 0: nothing turns
  bool insert = false;
  std::string grows;  ///< how light adds up, and what is beyond 100 %
};
/// Adds the cells, as fine as fits, and the scripts that show them.
void add_round(page::Page& page, const RoundSource& source, const RoundWords& words);

}  // namespace slicecorr::tomo::detail
