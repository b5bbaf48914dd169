/// Levels of continuous exposure in a bath that ends, by the search for one that doesn't.
///
/// A slice counts for phi_n - a^B phi_(n + B) (cure.hpp), and what is taken is known when the slice is
/// solved: B slices after it. The search is told a lower dose to begin with instead, such that its
/// levels bring the run's upper edge to the dose that it plans. In between the true dose is higher
/// than it plans, by at most what leaves the bath in a few slices.
#pragma once

#include <algorithm>

#include "correct/continuous_plan.hpp"
#include "correct/level_search.hpp"
#include "slicecorr/correct.hpp"

namespace slicecorr::detail {

struct InBath {
  /// Of slice n of `run`, with the dose `omega` at its lower node. `far(k)`: phi of the slice that
  /// leaves the bath when slice k is shown.
  template <typename Far>
  InBath(const CorrectionPlan& plan, const RunAt& run, int n, double omega, Far far)
      : below(omega) {
    const ContinuousPlan& p = *plan.continuous;
    const int ahead = n - run.node + 1;
    slices = ahead <= p.together ? ahead : 1;
    slices = std::min(slices, plan.model.bath_slices);
    for (int i = 0; i < slices; ++i) {
      below -= plan.model.beyond * far(n - i) * p.b * p.grown[static_cast<std::size_t>(i) + 1];
    }
  }
  double below;  ///< what the search is told
  int slices;    ///< of the levels that it chooses, so many are right at most
};

}  // namespace slicecorr::detail
