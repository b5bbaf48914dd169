// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Parts to plan: columns of runs, and what their corrections print.
#pragma once

#include <utility>
#include <vector>

#include "memory_slices.hpp"
#include "models.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/plan.hpp"

namespace slicecorr::test {

/// The light of figure 2.2.
inline const PlanLight kFigure22 = plan_light(figure_2_2(), 1000);

/// Columns of runs [first, last], one a pixel of a row, full from the platform.
inline MemorySlices comb(const std::vector<std::vector<std::pair<int, int>>>& columns, int layers) {
  MemorySlices part({static_cast<int>(columns.size()), 1, layers, 50, 50, 50});
  for (std::size_t x = 0; x < columns.size(); ++x) {
    for (const auto& [first, last] : columns[x]) {
      for (int n = first; n <= last; ++n) part.at(n, static_cast<int>(x), 0) = 255;
    }
  }
  return part;
}

inline slicecorr::Setup setup_of(const SliceSource& part) {
  slicecorr::Setup s;
  s.printer = linear_printer(1, 100);
  s.printer.width_px = part.grid().width_px;
  s.printer.height_px = part.grid().height_px;
  s.resin = resin(576, 2000);
  s.process = process(1);
  return s;
}

/// What the whole correction of a part prints.
inline Prediction printed(const SliceSource& part, const slicecorr::Setup& setup) {
  const CorrectedSlices corrected(part, setup);
  return verify_stack(corrected, part, setup);
}

}  // namespace slicecorr::test
