// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "setup/lamps.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "setup/exposures.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/inhibited.hpp"
#include "slicecorr/limit.hpp"

namespace slicecorr::detail {

void take_lamp_log(const std::vector<double>& shares, const std::string& name,
                   std::vector<double>& kept) {
  if (!shares.empty()) kept = trimmed(shares);
  for (const double share : kept) {
    if (share > 0 && share <= 1) continue;
    throw InputError(fmt::format(
        "{}: a share of {:g}; expected shares above 0 and at most 1, the light of the calibration",
        name, share));
  }
  if (kept.size() == 1 && kept.front() == 1) kept.clear();
}

double uv_for_weakest_place(const Setup& setup, double dead_zone_um) {
  const FlatField& field = *setup.printer.uv_flat_field;
  const double least = 1.0 * field.least() / field.reference;
  const Process lit = as_lamp_shines(setup.process);
  double most_share = usual_light_share(lit);
  for (const double share : lit.light_share) most_share = std::max(most_share, share);
  const double full = level_intensities(setup.printer).back() * most_share;
  const double needed =
      uv_for_dead_zone(make_kinetics(setup.resin, true, true), full, dead_zone_um) / least;
  const double most = setup.printer.uv->max_mw_cm2();
  if (needed <= most) return needed;
  throw InfeasibleError(fmt::format(
      "a dead zone of {:g} um under full light where the UV lamp of printer '{}' gives {:.4g} of its "
      "light takes {:.4g} mW/cm²; it gives at most {}",
      dead_zone_um, setup.printer.name, least, needed, at_most(most)));
}

}  // namespace slicecorr::detail
