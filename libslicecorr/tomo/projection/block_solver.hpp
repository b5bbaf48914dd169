// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Projected L-BFGS on the slices of one block: the penalty of tomo/ladder.hpp, with bounds on the light.
/// Slices share the operators and nothing else: each has steps and a memory of its own.
#pragma once

#include <limits>
#include <vector>

#include "slicecorr/tomo/projection.hpp"

namespace slicecorr::tomo::detail {

struct Penalty {
  double rung = 0;       ///< rho_c
  double most_dose = 0;  ///< d_u; infinite: no limit
  double cap = 0;        ///< infinite: no limit
};

/// What is asked of the cells of a block: `CellKinds`, where they begin.
struct BlockCells {
  const Kind* kinds = nullptr;
  const float *least = nullptr, *most = nullptr;  ///< null: kinds say all

  BlockCells(const CellKinds& cells, std::size_t first)
      : kinds(cells.kinds.data() + first),
        least(cells.banded() ? cells.least.data() + first : nullptr),
        most(cells.banded() ? cells.most.data() + first : nullptr) {}
};

/// What a step left of one slice. Where doses lie in bands, the least is over what is wanted at least, and
/// the most over what is at most.
struct SliceStep {
  double loss = 0;
  double min_gel = std::numeric_limits<double>::infinity(), max_void = 0, max_dose = 0;
  double void_gelled = 0;
  /// Infinite where void is dark.
  double contrast() const {
    return max_void > 0 ? min_gel / max_void : std::numeric_limits<double>::infinity();
  }
};

struct BlockRun {
  int steps = 0;  ///< that were run
  /// Per slice, step by step; the first entry is of the light given. A slice that is done ends early.
  std::vector<std::vector<SliceStep>> slices;
};

/// Runs up to `steps` steps on `light`, in place, or until all losses are 0 or can't fall; `dose`
/// becomes A^T light. `may_leave`: returns when half of the slices are done, so that the others can
/// be put together with slices of other blocks.
BlockRun solve_block(const Projector& projector, std::size_t block, const BlockCells& cells,
                     const Penalty& penalty, int steps, int memory, bool may_leave,
                     const ExecutionContext& context, float* light, float* dose);

/// Per lane the factor of `dose` with the least loss; 0 where no gel gets any.
std::vector<double> best_scales(const Shape& shape, const BlockCells& cells, const float* dose,
                                const Penalty& penalty, const ExecutionContext& context);

}  // namespace slicecorr::tomo::detail
