// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>

#include "bands/bands.hpp"
#include "bands/correct_group.hpp"
#include "bands/correct_spread.hpp"
#include "parallel/silent.hpp"
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

/// The brightest blue light of each slice, mW/cm², where columns are corrected together.
std::vector<double> brightest_together(const SliceSource& target, const Setup& setup,
                                       const ExecutionContext& context) {
  const CorrectedSlices first(target, setup, detail::silent(context));
  const PlaceModels models(setup.printer, setup.resin, setup.process, target.grid(),
                           target.frame());
  const auto bands = detail::bands_of(first.grid(), first.bounds());
  std::vector<double> greatest(static_cast<std::size_t>(first.grid().layers), 0.0);
  std::mutex merging;
  parallel_for(context, "choose UV", bands.size(), [&](std::size_t i) {
    const PixelBox& band = bands[i];
    std::vector<std::uint8_t> places(detail::columns_of(band));
    models.map().values(band, places.data());
    std::map<std::uint8_t, std::vector<double>> blue;
    std::vector<double> of_band(greatest.size(), 0.0);
    first.read_band(band, [&](int n, const std::uint8_t* rows) {
      for (std::size_t k = 0; rows && k < places.size(); ++k) {
        if (rows[k] == 0) continue;
        std::vector<double>& levels = blue[places[k]];
        if (levels.empty()) levels = level_intensities(models.printer_at(places[k]));
        const int level = level_of_pixel(rows[k], static_cast<int>(levels.size()));
        double& most = of_band[static_cast<std::size_t>(n)];
        most = std::max(most, levels[static_cast<std::size_t>(level)]);
      }
    });
    const std::lock_guard lock(merging);
    for (std::size_t n = 0; n < greatest.size(); ++n)
      greatest[n] = std::max(greatest[n], of_band[n]);
  });
  return greatest;
}

/// The same of columns alone.
std::vector<double> brightest_alone(const SliceSource& target, const detail::PlacePlans& plans,
                                    const ExecutionContext& context) {
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
  return total.greatest_mw_cm2();
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
  const InhibitedKernel& kernel = *plans.models().brightest().inhibited();
  const std::vector<double> brightest = detail::spreads(setup)
                                            ? brightest_together(target, setup, context)
                                            : brightest_alone(target, plans, context);
  const double greatest = kernel.setting_uv_mw_cm2(0, plans.levels() - 1);
  const std::vector<double>& lamp = process.uv_lamp_share;
  const double most = setup.printer.uv->max_mw_cm2();
  for (std::size_t n = 0; const double blue : brightest) {
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
