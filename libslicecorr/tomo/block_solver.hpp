/// Projected L-BFGS on one block: the penalty of solve.hpp, with bounds on the light.
#pragma once

#include <vector>

#include "slicecorr/tomo/projector.hpp"
#include "slicecorr/tomo/volume.hpp"

namespace slicecorr::tomo::detail {

struct Penalty {
  double rung = 0;       ///< rho_c
  double most_dose = 0;  ///< d_u; infinite: no limit
  double cap = 0;        ///< infinite: no limit
};

/// What a step left, per block.
struct BlockStep {
  double loss = 0;
  float min_gel = 0, max_void = 0, max_dose = 0;
  std::size_t void_gelled = 0;
};

/// Runs up to `steps` steps on `light`, in place, or until the loss is 0; `dose` becomes A^T light.
/// The first entry is of the light given.
std::vector<BlockStep> solve_block(const Projector& projector, std::size_t block, const Kind* kinds,
                                   const Penalty& penalty, int steps, int memory,
                                   const ExecutionContext& context, float* light, float* dose);

/// The factor of `dose` with the least loss.
double best_scale(const Kind* kinds, std::size_t count, const float* dose, const Penalty& penalty);

}  // namespace slicecorr::tomo::detail
