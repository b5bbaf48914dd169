// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>
#include <mutex>

#include "base/coded_band.hpp"
#include "pipeline/bands.hpp"
#include "pipeline/compare_spread.hpp"
#include "pipeline/correct_spread.hpp"
#include "pipeline/place_plans.hpp"
#include "pipeline/vanished.hpp"
#include "slicecorr/baseline.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/pipeline.hpp"

namespace slicecorr {

using detail::BandReader;
using detail::bands_of;
using detail::CodedBand;
using detail::columns_of;
using detail::GroupedBand;
using detail::pixels_of_columns;
using detail::PlacePlans;
using detail::whole_image;

namespace {

/// Mean height error with each N up to the last that can be best.
std::vector<double> erase_errors(const SliceSource& target, const PlacePlans& plans,
                                 const std::vector<PixelBox>& bands,
                                 const ExecutionContext& context) {
  struct Sum {
    unsigned __int128 scaled = 0;
    std::uint64_t edges = 0;
  };
  const int most = std::min(cure_through_slices(plans.models().brightest()), plans.layers());
  std::vector<Sum> sums(static_cast<std::size_t>(most) + 1);
  std::mutex adding;
  parallel_for(context, "erase", bands.size(), [&](std::size_t i) {
    // Only columns that are lit somewhere have edges.
    const GroupedBand grouped(plans.models().map(), bands[i],
                              detail::BandReaders({detail::reader_of(target, bands[i])}));
    for (const GroupedBand::Group& group : grouped.groups) {
      const CodedBand& coded = group.sources[0];
      const std::size_t columns = coded.columns();
      std::vector<std::uint8_t> rows(columns);
      BandErase erase(columns);
      for (int n = 0; n < plans.layers(); ++n) {
        coded.read(n, rows.data());
        erase.add_layer(rows.data());
      }
      // One N after the other, so that the state of its prediction stays in the cache.
      for (std::size_t k = 0; k < sums.size(); ++k) {
        context.check_cancelled();
        BandErase::Walk walk(erase, static_cast<int>(k));
        BandPredictor predictor(plans.models().model(group.value),
                                plans.models().curve(group.value), plans.layers(), columns);
        for (int n = plans.layers(); n-- > 0;) {
          coded.read(n, rows.data());
          predictor.add_slice(n, walk.next(rows.data()), rows.data());
        }
        const Prediction p = predictor.finish(0, 0, static_cast<int>(columns));
        const std::lock_guard lock(adding);
        sums[k].scaled += p.height_error_um.scaled_sum();
        sums[k].edges += p.height_error_um.count();
      }
    }
  });
  std::vector<double> means;
  for (const Sum& sum : sums) {
    const double edges = static_cast<double>(std::max<std::uint64_t>(sum.edges, 1));
    means.push_back(std::ldexp(static_cast<double>(sum.scaled), -20) / edges);
  }
  return means;
}

}  // namespace

Comparison compare_methods(const SliceSource& whole_target, const Setup& asked,
                           const ExecutionContext& context) {
  const Setup setup = setup_to_correct(whole_target, asked, context);
  const SlicesAlone alone(whole_target);
  const SliceSource& target = setup.process.surface == Surface::mesh ? whole_target : alone;
  const PlacePlans plans(target, setup, context);
  const PlaceModels& models = plans.models();
  const auto bands = bands_of(target.grid(), target.bounds());

  Comparison result;
  result.erase_mean_um = erase_errors(target, plans, bands, context);
  const auto least = std::min_element(result.erase_mean_um.begin(), result.erase_mean_um.end());
  result.best_n = static_cast<int>(least - result.erase_mean_um.begin());

  if (detail::spreads(setup)) {
    detail::compare_spread_methods(target, setup, result, context);
    return result;
  }
  std::uint8_t pixel_of[256] = {};
  for (int level = 0; level < plans.levels(); ++level) {
    pixel_of[level] = static_cast<std::uint8_t>(pixel_of_level(level, plans.levels()));
  }
  enum Method { uncorrected, erased, darkened, ours, to_slices, methods };
  std::array<Prediction, methods> totals;
  detail::LightCounts in_groups{};
  std::mutex merging;
  parallel_for(context, "compare", bands.size(), [&](std::size_t i) {
    const PixelBox& band = bands[i];
    std::array<Prediction, methods> figures;
    // Compares the columns of one value of light; figures are added to those of values before.
    const auto compare = [&](std::uint8_t value, std::size_t columns, const BandReader& read,
                             const CodedBand* edge_heights,
                             const BandPredictor::PixelOfColumn& place) {
      const CorrectionPlan& plan = plans.plan(value);
      const BandCorrector::ColumnLevels most = plans.even_levels(value, place);
      BandErase erase(columns);
      CodedBand target_rows(columns);
      const BandReader kept = [&](const SliceSource::Sink& sink) {
        read([&](int n, const std::uint8_t* rows) {
          if ((n & 63) == 0) context.check_cancelled();
          erase.add_layer(rows);
          target_rows.append(rows);
          sink(n, rows);
        });
      };
      const detail::CodedDesign design(columns, kept, edge_heights, Surface::mesh, nullptr);
      std::vector<std::uint8_t> rows(columns), heights(columns), pixels(columns);
      // Where the target has edge heights, its slices alone are corrected, too.
      CodedBand upwards(columns);
      if (edge_heights) {
        BandCorrector alone(plan, columns);
        if (most) alone.keep_light(most);
        for (int n = 0; n < plan.layers; ++n) {
          target_rows.read(n, rows.data());
          alone.add_layer(rows.data());
        }
        alone.solve([&](int, const std::uint8_t* levels, const std::uint8_t*, bool) {
          for (std::size_t k = 0; k < columns; ++k) pixels[k] = pixel_of[levels[k]];
          upwards.append(pixels.data());
        });
      }
      BandCorrector corrector(plan, columns);
      if (most) corrector.keep_light(most);
      for (int n = 0; n < plan.layers; ++n) {
        design.coverage.read(n, rows.data());
        corrector.add_layer(rows.data(), design.heights_at(n, heights.data()));
      }
      if (edge_heights) {
        corrector.add_layer(nullptr, design.heights_at(plan.layers, heights.data()));
      }
      BandErase::Walk walk(erase, result.best_n);
      BandGreyTable table(columns);
      std::vector<std::unique_ptr<BandPredictor>> predict;
      for (Prediction& so_far : figures) {
        predict.push_back(std::make_unique<BandPredictor>(plan.model, models.curve(value),
                                                          plan.all_layers, columns));
        if (edge_heights) predict.back()->aim_at_heights();
        predict.back()->go_on_from(std::move(so_far));
      }
      corrector.solve([&](int n, const std::uint8_t* levels, const std::uint8_t* coverage, bool) {
        if ((n & 63) == 0) context.check_cancelled();
        for (std::size_t k = 0; k < columns; ++k) pixels[k] = pixel_of[levels[k]];
        const std::uint8_t* const its_heights = design.heights_at(n, heights.data());
        predict[ours]->add_slice(n, pixels.data(), coverage, its_heights);
        if (edge_heights) {
          upwards.read(plan.all_layers - 1 - n, pixels.data());
          predict[to_slices]->add_slice(n, pixels.data(), coverage, its_heights);
        }
        // Only the correction shows slices after the part's end.
        const bool shown = n < plan.layers;
        target_rows.read(n, rows.data());
        const std::uint8_t* const lit = rows.data();
        predict[uncorrected]->add_slice(n, shown ? lit : nullptr, coverage, its_heights);
        predict[erased]->add_slice(n, shown ? walk.next(lit) : nullptr, coverage, its_heights);
        predict[darkened]->add_slice(n, shown ? table.next(lit) : nullptr, coverage, its_heights);
      });
      for (std::size_t m = 0; m < methods; ++m) figures[m] = predict[m]->finish(place);
    };
    const BandReader read = detail::reader_of(target, band);
    detail::LightCounts counts{};
    if (plans.even()) {
      const auto coded = detail::edge_heights_of(target, band);
      compare(models.map().reference(), columns_of(band), read, coded ? &*coded : nullptr,
              pixels_of_columns(band));
    } else {
      const GroupedBand grouped(models.map(), band, detail::with_target({read}, target, band));
      for (const GroupedBand::Group& g : grouped.groups) {
        counts[g.value] = g.columns.size();
        compare(g.value, g.columns.size(), g.reader(0), g.heights(),
                pixels_of_columns(band, g.columns));
      }
    }
    const std::lock_guard lock(merging);
    for (std::size_t m = 0; m < methods; ++m) totals[m].merge(figures[m]);
    for (std::size_t v = 0; v < counts.size(); ++v) in_groups[v] += counts[v];
  });
  if (totals[ours].target_voxels == 0) detail::refuse_vanished(target);
  const Grid& grid = target.grid();
  const auto whole = [&](Method method, int slices) {
    return plans.even() ? whole_image(totals[method], models.brightest(), grid, slices, bands)
                        : whole_image(totals[method], models, grid, slices, in_groups);
  };
  result.uncorrected = whole(uncorrected, plans.layers());
  result.erase = whole(erased, plans.layers());
  result.table = whole(darkened, plans.layers());
  result.ours = whole(ours, plans.all_layers());
  if (target.edge_heights()) result.to_slices = whole(to_slices, plans.all_layers());
  return result;
}

}  // namespace slicecorr
