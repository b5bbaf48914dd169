// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "bands/uv_of_slices.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "slicecorr/error.hpp"
#include "slicecorr/inhibited.hpp"
#include "slicecorr/limit.hpp"

namespace slicecorr::detail {

double UvLadder::up(double uv_mw_cm2) const {
  if (uv_mw_cm2 >= greatest) return greatest;
  const double steps =
      std::floor(std::log(greatest / std::max(uv_mw_cm2, 1e-9)) / std::log(step) + 1e-9);
  return std::max(least, greatest * std::pow(step, -steps));
}

void UvLadder::put(const PlaceModels& models, std::vector<double>& slices_mw_cm2) {
  double lowest = 0;
  if (const int settings = models.uv_settings_that_fit();
      settings < std::numeric_limits<int>::max()) {
    lowest = greatest;
    for (const double uv : slices_mw_cm2) lowest = uv > 0 ? std::min(lowest, uv) : lowest;
    lowest = std::max({lowest, least, 1e-3 * greatest});
    // One more for the greatest, and one for rounding.
    const double steps = std::max(1e-9, settings - 2.0);
    step = std::max(step, std::pow(greatest / lowest, 1.0 / steps));
  }
  for (double& uv : slices_mw_cm2) uv = up(std::max(uv, lowest));
}

namespace {

/// How many slices further on the light of full light acts most on a node: so much later than a node may be lit
/// the first light of it comes where UV light is strong.
int latest_light(const InhibitedKernel& kernel) {
  const double* const added = kernel.table(0, InhibitedKernel::upper_end);
  const int levels = kernel.levels(), top = levels - 1;
  int most = 0;
  for (int j = 1; j < kernel.near(); ++j) {
    if (added[j * levels + top] > added[most * levels + top]) most = j;
  }
  return most;
}

/// The brightest light of each slice and of so many after it. The slices that a first correction shows in the
/// strongest UV light begin late; in weaker light those before them are wanted, too: at the platform, and
/// wherever brighter slices follow.
std::vector<double> brightest_to_come(const std::vector<double>& blue, int slices) {
  std::vector<double> most = blue;
  for (std::size_t n = 0; n < blue.size(); ++n) {
    const std::size_t end = std::min(blue.size(), n + static_cast<std::size_t>(slices) + 1);
    for (std::size_t k = n + 1; k < end; ++k) most[n] = std::max(most[n], blue[k]);
  }
  return most;
}

}  // namespace

bool chooses_uv_of_slices(const Process& process) {
  return process.uv.kind == UvKind::per_slice && process.uv.slice_mw_cm2.empty();
}

Process with_uv_of_slices(const Setup& setup, const PlaceModels& models,
                          const std::vector<double>& brightest_mw_cm2) {
  Process process = setup.process;
  const InhibitedKernel& kernel = *models.brightest().inhibited();
  // Of the lamp's light at the place that gets the least of it.
  const double least = models.uv_factor(models.map().greatest());
  // Slices may get more or less blue light than is usual.
  const Process lit = as_lamp_shines(process);
  const auto share_of = [&](int n) { return light_share(lit, n) / usual_light_share(lit); };
  double most_share = 1;
  for (int n = 0; n < static_cast<int>(lit.light_share.size()); ++n) {
    most_share = std::max(most_share, share_of(n));
  }
  std::vector<double> needed;
  for (const double blue : brightest_to_come(brightest_mw_cm2, latest_light(kernel))) {
    const auto n = static_cast<int>(needed.size());
    // With what comes back from the platform.
    const double back = kernel.blue_at_front(n, process.uv.dead_zone_um);
    needed.push_back(
        uv_for_dead_zone(kernel.kinetics(), blue * share_of(n) * back, process.uv.dead_zone_um));
  }
  UvLadder ladder{kernel.setting_uv_mw_cm2(0, kernel.levels() - 1) * most_share,
                  setup.printer.uv->min_mw_cm2() * least, 1.05};
  ladder.put(models, needed);
  const std::vector<double>& lamp = process.uv_lamp_share;
  const double most = setup.printer.uv->max_mw_cm2();
  for (std::size_t n = 0; n < needed.size(); ++n) {
    // Of a lamp that fades so much more is asked that this comes.
    const double comes = lamp.empty() ? 1 : lamp[std::min(n, lamp.size() - 1)];
    const double light = needed[n] / least;
    if (light / comes > most * (1 + 1e-9)) {
      throw InfeasibleError(fmt::format(
          "a dead zone of {:g} um takes {:.4g} mW/cm² of UV light in slice {}, where the UV lamp still gives "
          "{:.3g} % of what is asked of it: that is {:.4g} of the {} mW/cm² that it had",
          process.uv.dead_zone_um, light, n, 100 * comes, light / comes, at_most(most)));
    }
    process.uv.slice_mw_cm2.push_back(std::min(light / comes, most));
  }
  return process;
}

}  // namespace slicecorr::detail
