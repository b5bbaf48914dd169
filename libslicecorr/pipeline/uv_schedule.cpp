// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <mutex>

#include "bands/bands.hpp"
#include "bands/correct_group.hpp"
#include "slicecorr/dead_zone.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/even_dead_zone.hpp"
#include "slicecorr/limit.hpp"
#include "slicecorr/pipeline.hpp"

namespace slicecorr {

namespace {

/// `uv` rounded up to a ladder of intensities, each 5 % below the one before, down from `greatest`:
/// so few that each can have tables of its own.
double on_ladder(double uv, double greatest, double least) {
  if (uv >= greatest) return greatest;
  const double steps = std::floor(std::log(greatest / std::max(uv, 1e-9)) / std::log(1.05) + 1e-9);
  return std::max(least, greatest * std::pow(1.05, -steps));
}

}  // namespace

Process schedule_uv(const SliceSource& target, const Setup& setup,
                    const ExecutionContext& context) {
  if (setup.process.even_dead_zone != EvenDeadZone::off) {
    return find_even_light(target, setup, context);
  }
  Process process = setup.process;
  if (process.uv.kind != UvKind::per_slice || !process.uv.slice_mw_cm2.empty()) return process;
  // A first correction, with the UV light that full light needs, shows what the brightest pixel of
  // each slice is.
  const detail::PlacePlans plans(target, setup, context);
  const PlaceModels& models = plans.models();
  detail::PlaceWindows total(models, plans.all_layers());
  // Edges within slices change nothing of that.
  const SlicesAlone slices(target);
  const auto bands = detail::bands_of(target.grid(), target.bounds());
  std::mutex merging;
  parallel_for(context, "choose UV", bands.size(), [&](std::size_t i) {
    const detail::DesignBand band(slices, models.map(), bands[i]);
    for (const detail::DesignGroup& group : band.groups()) {
      WindowWatch watch(models.model(group.value), plans.all_layers(), group.columns);
      detail::correct_group(plans, group, {.put = [](int, const std::uint8_t*) {}, .watch = &watch},
                            context);
      const std::lock_guard lock(merging);
      total.merge(group.value, watch);
    }
  });
  const InhibitedKernel& kernel = *models.brightest().inhibited();
  const double greatest = kernel.setting_uv_mw_cm2(0, plans.levels() - 1);
  const std::vector<double>& lamp = process.uv_lamp_share;
  const double most = setup.printer.uv->max_mw_cm2();
  for (std::size_t n = 0; const double blue : total.greatest_mw_cm2()) {
    const double needed = uv_for_dead_zone(kernel.kinetics(), blue, process.uv.dead_zone_um);
    // Of a lamp that fades so much more is asked that this comes.
    const double comes = lamp.empty() ? 1 : lamp[std::min(n, lamp.size() - 1)];
    const double light = on_ladder(needed, greatest, setup.printer.uv->min_mw_cm2());
    if (light / comes > most * (1 + 1e-9)) {
      throw InfeasibleError(fmt::format(
          "a dead zone of {:g} um takes {:.4g} mW/cm² of UV light in slice {}, where the UV lamp still gives "
          "{:.3g} % of what is asked of it: that is {:.4g} of the {} mW/cm² that it had",
          process.uv.dead_zone_um, light, n, 100 * comes, light / comes, at_most(most)));
    }
    process.uv.slice_mw_cm2.push_back(std::min(light / comes, most));
    ++n;
  }
  return process;
}

}  // namespace slicecorr
