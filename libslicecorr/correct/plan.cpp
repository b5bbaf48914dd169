#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "correct/band_solvers.hpp"
#include "correct/inhibited_column.hpp"
#include "correct/node_goal.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr {

CorrectionPlan::CorrectionPlan(CureModel cure_model, const Process& process, int target_layers,
                               int all_slices)
    : model(std::move(cure_model)),
      levels(model.level_phi),
      omega_max(process.omega_max),
      platform_omega_max(process.cap_platform_features ? process.omega_max
                                                       : std::numeric_limits<double>::infinity()),
      merge_one_slice_gaps(process.one_slice_gaps == OneSliceGaps::merge),
      layers(target_layers),
      all_layers(all_slices) {
  if (model.inhibited) {
    inhibited = std::make_shared<const detail::InhibitedPlan>(model, merge_one_slice_gaps, layers,
                                                              all_layers);
  }
  if (!model.is_plain()) return;
  const double low = model.phi_min();
  fall.resize(static_cast<std::size_t>(all_layers) + 1);
  // Out of exp, not by repeated division: entry j must not depend on how many come before it. Past
  // any dose that light can give, the curve says nothing.
  for (std::size_t j = 0; j < fall.size(); ++j) {
    fall[j] = low + (1.0 - low) * std::exp(static_cast<double>(j) * model.eta * units::ln10);
  }
  for (int l = 1; l < levels.size() && levels.phi(l - 1) < 1.0; ++l) {
    level_step = std::max(level_step, (levels.phi(l) - levels.phi(l - 1)) * model.one_minus_a);
  }
  const double high = model.phi_max();
  for (int j = 0; j <= all_layers; ++j) {
    const double grown = std::exp(j * model.eta * units::ln10);
    // The greatest demand is 1 (and the margin on it): past this, darkness is enough.
    if (high - (high - 1.001) * grown < 0) break;
    reach.push_back(grown);
  }
}

double CorrectionPlan::open_fall(int j) const {
  const double low = model.phi_min();
  const double open = (1.0 - low * (1.0 - model.root_a)) / model.root_a - 1e-9;
  return low + (open - low) * (fall[static_cast<std::size_t>(j)] - low) / (1.0 - low);
}

int slices_with_burst(const CureModel& model, int target_layers, int last_lit) {
  if (model.inhibited) return detail::inhibited_slices(model, target_layers, last_lit);
  return std::max(target_layers, last_lit + 1 + model.slices_to_gel());
}

}  // namespace slicecorr
