#include <algorithm>
#include <cmath>
#include <mutex>

#include "base/band_tape.hpp"
#include "pipeline/bands.hpp"
#include "slicecorr/baseline.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/pipeline.hpp"

namespace slicecorr {

using detail::bands_of;
using detail::BandTape;
using detail::columns_of;
using detail::whole_image;

namespace {

/// Only the columns of a band that are lit somewhere: no other has an edge.
BandTape lit_columns(const SliceSource& target, const PixelBox& band) {
  const std::size_t columns = columns_of(band);
  BandTape all(columns);
  std::vector<std::uint8_t> rows(columns), any(columns, 0);
  target.read_band(band, [&](int, const std::uint8_t* layer) {
    all.append(layer);
    for (std::size_t i = 0; layer && i < columns; ++i) any[i] |= layer[i];
  });
  std::vector<std::uint32_t> lit;
  for (std::size_t i = 0; i < columns; ++i) {
    if (any[i]) lit.push_back(static_cast<std::uint32_t>(i));
  }
  BandTape tape(lit.size());
  std::vector<std::uint8_t> kept(lit.size());
  for (int n = 0; n < all.slices(); ++n) {
    all.read(n, rows.data());
    for (std::size_t i = 0; i < lit.size(); ++i) kept[i] = rows[lit[i]];
    tape.append(kept.data());
  }
  return tape;
}

/// Mean height error with each N up to the last that can be best.
std::vector<double> erase_errors(const SliceSource& target, const CorrectionPlan& plan,
                                 const std::vector<PixelBox>& bands, const Job& job) {
  struct Sum {
    unsigned __int128 scaled = 0;
    std::uint64_t edges = 0;
  };
  const PixelCurve curve = pixel_curve(plan.model);
  const int most = std::min(cure_through_slices(plan.model), plan.layers);
  std::vector<Sum> sums(static_cast<std::size_t>(most) + 1);
  std::mutex adding;
  parallel_for(job, "erase", bands.size(), [&](std::size_t i) {
    const BandTape tape = lit_columns(target, bands[i]);
    const std::size_t columns = tape.columns();
    if (columns == 0) return;
    std::vector<std::uint8_t> rows(columns);
    BandErase erase(columns);
    for (int n = 0; n < plan.layers; ++n) {
      tape.read(n, rows.data());
      erase.add_layer(rows.data());
    }
    // One N after the other: the state of a single prediction stays in the cache.
    for (std::size_t k = 0; k < sums.size(); ++k) {
      job.check_cancelled();
      BandErase::Walk walk(erase, static_cast<int>(k));
      BandPredictor predictor(plan.model, curve, plan.layers, columns);
      for (int n = plan.layers; n-- > 0;) {
        tape.read(n, rows.data());
        predictor.add_slice(n, walk.next(rows.data()), rows.data());
      }
      const Prediction p = predictor.finish(0, 0, static_cast<int>(columns));
      const std::lock_guard lock(adding);
      sums[k].scaled += p.height_error_um.scaled_sum();
      sums[k].edges += p.height_error_um.count();
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

Comparison compare_methods(const SliceSource& target, const Setup& setup, const Job& job) {
  const CorrectionPlan plan = plan_correction(target, setup);
  const CureModel& model = plan.model;
  const PixelCurve curve = pixel_curve(model);
  const auto bands = bands_of(target.grid(), target.bounds());

  Comparison result;
  result.erase_mean_um = erase_errors(target, plan, bands, job);
  const auto least = std::min_element(result.erase_mean_um.begin(), result.erase_mean_um.end());
  result.best_n = static_cast<int>(least - result.erase_mean_um.begin());

  std::uint8_t pixel_of[256] = {};
  for (int level = 0; level < plan.levels.size(); ++level) {
    pixel_of[level] = static_cast<std::uint8_t>(pixel_of_level(level, plan.levels.size()));
  }
  Prediction uncorrected, erased, darkened, ours;
  bool solid = false;
  std::mutex merging;
  parallel_for(job, "compare", bands.size(), [&](std::size_t i) {
    const PixelBox& band = bands[i];
    const std::size_t columns = columns_of(band);
    BandCorrector corrector(plan, columns);
    BandErase erase(columns);
    bool lit = false;
    target.read_band(band, [&](int n, const std::uint8_t* rows) {
      if ((n & 63) == 0) job.check_cancelled();
      lit = lit || (rows && !detail::all_zero(rows, columns));
      corrector.add_layer(rows);
      erase.add_layer(rows);
    });
    BandErase::Walk walk(erase, result.best_n);
    BandGreyTable table(columns);
    std::vector<std::uint8_t> pixels(columns);
    BandPredictor predict_uncorrected(model, curve, plan.all_layers, columns);
    BandPredictor predict_erased(model, curve, plan.all_layers, columns);
    BandPredictor predict_darkened(model, curve, plan.all_layers, columns);
    BandPredictor predict_ours(model, curve, plan.all_layers, columns);
    corrector.solve([&](int n, const std::uint8_t* levels, const std::uint8_t* coverage, bool) {
      if ((n & 63) == 0) job.check_cancelled();
      for (std::size_t k = 0; k < columns; ++k) pixels[k] = pixel_of[levels[k]];
      predict_ours.add_slice(n, pixels.data(), coverage);
      // Only the correction shows slices after the part's end.
      const bool shown = n < plan.layers;
      predict_uncorrected.add_slice(n, shown ? coverage : nullptr, coverage);
      predict_erased.add_slice(n, shown ? walk.next(coverage) : nullptr, coverage);
      predict_darkened.add_slice(n, shown ? table.next(coverage) : nullptr, coverage);
    });
    const auto merge = [&](Prediction& sum, BandPredictor& predictor) {
      const Prediction figures = predictor.finish(band.x0, band.y0, band.width());
      const std::lock_guard lock(merging);
      sum.merge(figures);
      solid = solid || lit;
    };
    merge(uncorrected, predict_uncorrected);
    merge(erased, predict_erased);
    merge(darkened, predict_darkened);
    merge(ours, predict_ours);
  });
  if (!solid) throw InputError("nothing in the part is solid: all slices are empty");
  const Grid& grid = target.grid();
  result.uncorrected = whole_image(uncorrected, model, grid, plan.layers, bands);
  result.erase = whole_image(erased, model, grid, plan.layers, bands);
  result.table = whole_image(darkened, model, grid, plan.layers, bands);
  result.ours = whole_image(ours, model, grid, plan.all_layers, bands);
  return result;
}

}  // namespace slicecorr
