// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <map>
#include <mutex>

#include "bands/bands.hpp"
#include "bands/correct_group.hpp"
#include "bands/correct_spread.hpp"
#include "bands/uv_of_slices.hpp"
#include "parallel/silent.hpp"
#include "slicecorr/dead_zone.hpp"
#include "slicecorr/even_dead_zone.hpp"
#include "slicecorr/pipeline.hpp"

namespace slicecorr {

namespace {

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
    // Black lights, too, in slices of nothing else as well.
    double black = 0;
    for (const std::uint8_t place : places) {
      std::vector<double>& levels = blue[place];
      if (levels.empty()) {
        levels = level_intensities(models.printer_at(place));
        for (double& blue_mw : levels) blue_mw *= detail::paired_share(models, place);
      }
      black = std::max(black, levels.front());
    }
    std::fill(of_band.begin(), of_band.end(), black);
    first.read_band(band, [&](int n, const std::uint8_t* rows) {
      for (std::size_t k = 0; rows && k < places.size(); ++k) {
        if (rows[k] == 0) continue;
        const std::vector<double>& levels = blue[places[k]];
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
  if (!detail::chooses_uv_of_slices(setup.process)) return setup.process;
  // A first correction, with the UV light that full light needs, shows what the brightest pixel of
  // each slice is.
  const detail::PlacePlans plans(target, setup, context);
  const std::vector<double> brightest = detail::spreads(setup)
                                            ? brightest_together(target, setup, context)
                                            : brightest_alone(target, plans, context);
  return detail::with_uv_of_slices(setup, plans.models(), brightest);
}

}  // namespace slicecorr
