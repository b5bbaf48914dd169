// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Series that are too long to draw, thinned so that nothing that sticks out is lost.
#pragma once

#include <vector>

#include "support/chart/chart.hpp"

namespace slicecorr::bridge::detail {

/// Columns that a long series is thinned to: as many as a panel has pixels across.
inline constexpr int kEnvelopeColumns = 560;

/// Of each of `columns` equal pieces of x the first, least, greatest and last point, in their
/// order: drawn as a line it looks as the whole. Points that are not finite are left out; order of
/// x is not needed.
std::vector<chart::Point> envelope(std::vector<chart::Point> points,
                                   int columns = kEnvelopeColumns);

/// Of each piece the point furthest from 0, and how many there are.
struct Peak {
  chart::Point at;
  std::size_t index = 0;  ///< in `points`
  int count = 0;
};
std::vector<Peak> peaks(const std::vector<chart::Point>& points,
                        int columns = kEnvelopeColumns / 4);

}  // namespace slicecorr::bridge::detail
