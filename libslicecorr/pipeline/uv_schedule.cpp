// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>
#include <mutex>

#include "pipeline/bands.hpp"
#include "pipeline/place_plans.hpp"
#include "slicecorr/dead_zone.hpp"
#include "slicecorr/even_dead_zone.hpp"
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
  const auto bands = detail::bands_of(target.grid(), target.bounds());
  std::mutex merging;
  parallel_for(context, "choose UV", bands.size(), [&](std::size_t i) {
    const auto watch_columns = [&](std::uint8_t value, std::size_t columns,
                                   const detail::BandReader& read) {
      const CorrectionPlan& plan = plans.plan(value);
      BandCorrector corrector(plan, columns);
      read([&](int n, const std::uint8_t* rows) {
        if ((n & 63) == 0) context.check_cancelled();
        corrector.add_layer(rows);
      });
      WindowWatch watch(plan.model, plan.all_layers, columns);
      std::vector<std::uint8_t> pixels(columns);
      corrector.solve([&](int n, const std::uint8_t* levels, const std::uint8_t*, bool dark) {
        if ((n & 63) == 0) context.check_cancelled();
        for (std::size_t k = 0; k < columns; ++k) {
          pixels[k] = static_cast<std::uint8_t>(pixel_of_level(levels[k], plan.levels.size()));
        }
        watch.add_slice(n, dark ? nullptr : pixels.data());
      });
      const std::lock_guard lock(merging);
      total.merge(value, watch);
    };
    const detail::BandReader read = [&](const SliceSource::Sink& sink) {
      target.read_band(bands[i], sink);
    };
    if (plans.even()) {
      return watch_columns(models.map().reference(), detail::columns_of(bands[i]), read);
    }
    const detail::GroupedBand grouped(models.map(), bands[i], detail::BandReaders({read}));
    for (const auto& g : grouped.groups) watch_columns(g.value, g.columns.size(), g.reader(0));
  });
  const InhibitedKernel& kernel = *models.brightest().inhibited();
  const double greatest = kernel.setting_uv_mw_cm2(0, plans.levels() - 1);
  for (const double blue : total.greatest_mw_cm2()) {
    const double needed = uv_for_dead_zone(kernel.kinetics(), blue, process.uv.dead_zone_um);
    process.uv.slice_mw_cm2.push_back(on_ladder(needed, greatest, setup.printer.uv->min_mw_cm2()));
  }
  return process;
}

}  // namespace slicecorr
