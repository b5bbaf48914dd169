#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>
#include <mutex>

#include "base/coded_band.hpp"
#include "pipeline/bands.hpp"
#include "pipeline/place_plans.hpp"
#include "pipeline/relief.hpp"
#include "pipeline/uv_images.hpp"
#include "pipeline/vanished.hpp"
#include "pipeline/volume_reducer.hpp"
#include "slicecorr/dead_zone.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/version.hpp"

namespace slicecorr {

using detail::BandReader;
using detail::bands_of;
using detail::CodedBand;
using detail::columns_of;
using detail::GroupedBand;
using detail::LightCounts;
using detail::LitColumns;
using detail::pixels_of_columns;
using detail::PlacePlans;
using detail::PlaceWindows;
using detail::Relief;
using detail::VolumeReducer;
using detail::whole_image;

namespace {

std::string program_name() { return std::string("slicecorr ") + version; }

struct SliceRange {
  int first, past;
};

/// The slice ranges of a band that are read in parallel: where there are few bands, the last of
/// them would keep one thread busy and leave the others idle.
std::vector<SliceRange> slice_ranges_of(const SliceSource& target, std::size_t bands) {
  constexpr int kEnough = 64, kLeastSlices = 16;
  const int layers = target.grid().layers;
  int count = 1;
  if (target.reads_any_slices() && bands > 0) {
    const int wanted = (kEnough + static_cast<int>(bands) - 1) / static_cast<int>(bands);
    count = std::clamp(wanted, 1, std::max(1, layers / kLeastSlices));
  }
  std::vector<SliceRange> ranges;
  for (int i = 0; i < count; ++i) {
    ranges.push_back({static_cast<int>(std::int64_t{layers} * i / count),
                      static_cast<int>(std::int64_t{layers} * (i + 1) / count)});
  }
  return ranges;
}

/// What the first pass over a target collects besides handing its slices on.
class TargetScan {
 public:
  explicit TargetScan(const SliceSource& target)
      : target_(target), relief_(target.bounds(), target.grid().layers) {}

  void read(const PixelBox& band, const SliceSource::Sink& sink) {
    read(band, {0, target_.grid().layers}, sink);
  }
  void read(const PixelBox& band, const SliceRange& range, const SliceSource::Sink& sink) {
    const std::size_t columns = columns_of(band);
    LitColumns lit(columns);
    const auto take = [&](int n, const std::uint8_t* rows) {
      lit.add(n, rows);
      if (rows && !full_ && std::memchr(rows, 255, columns)) full_ = true;
      sink(n, rows);
    };
    target_.read_slices(band, range.first, range.past, take);
    coverage_sum_ += lit.sum();
    relief_.add(band, lit.finish());
  }
  /// To be called after all bands.
  void fill(StackInfo& info) const {
    if (!full_) detail::refuse_vanished(target_);
    const Grid& g = target_.grid();
    info.part_volume_mm3 = static_cast<double>(coverage_sum_.load()) / 255.0 * g.pixel_x_um *
                           g.pixel_y_um * g.layer_um * 1e-9;
    info.target_layers = g.layers;
    info.program = program_name();
  }
  GreyImage picture() const { return relief_.picture(); }

 private:
  const SliceSource& target_;
  Relief relief_;
  std::atomic<std::uint64_t> coverage_sum_{0};
  std::atomic<bool> full_{false};  ///< a voxel of coverage 1 was seen
};

/// Where the slices and figures of columns that share a plan go.
struct ColumnSinks {
  /// Pixels of every slice, from the last to the first; null: black.
  std::function<void(int slice, const std::uint8_t* pixels)> put;
  BandPredictor& after;
  BandPredictor* before;  ///< null: not asked
  WindowWatch* watch;     ///< the same
};

/// Corrects columns and predicts them.
void correct_columns(const CorrectionPlan& plan, std::size_t columns, const BandReader& read,
                     const ColumnSinks& out, const ExecutionContext& context) {
  BandCorrector corrector(plan, columns);
  read([&](int n, const std::uint8_t* rows) {
    if ((n & 63) == 0) context.check_cancelled();
    corrector.add_layer(rows);
  });
  std::uint8_t pixel_of[256] = {};
  for (int level = 0; level < plan.levels.size(); ++level) {
    pixel_of[level] = static_cast<std::uint8_t>(pixel_of_level(level, plan.levels.size()));
  }
  const bool all_levels = plan.levels.size() == 256;
  std::vector<std::uint8_t> pixels(columns);
  const auto shown = [&](const std::uint8_t* levels) {
    if (all_levels) return levels;
    for (std::size_t k = 0; k < columns; ++k) pixels[k] = pixel_of[levels[k]];
    return static_cast<const std::uint8_t*>(pixels.data());
  };
  if (plan.model.is_plain()) {
    using Tile = BandCorrector::Tile;
    static_assert(Tile::kStride == BandPredictor::kTileColumns);
    std::vector<std::uint8_t> tile_pixels;
    const auto look = [&](const Tile& t) {
      const auto size = static_cast<std::size_t>(t.slices) * Tile::kStride;
      const std::uint8_t* lit = t.levels;
      if (!all_levels) {
        tile_pixels.resize(size);
        for (std::size_t k = 0; k < size; ++k) tile_pixels[k] = pixel_of[t.levels[k]];
        lit = tile_pixels.data();
      }
      out.after.add_tile(t.first_column, t.columns, t.first_slice, t.slices, lit, t.coverage);
      if (!out.before) return;
      // Slices after the part's end belong to the correction, not to the target.
      const int inside = std::clamp(plan.layers - t.first_slice, 0, t.slices);
      out.before->add_tile(t.first_column, t.columns, t.first_slice + inside, t.slices - inside,
                           nullptr, t.coverage + static_cast<std::size_t>(inside) * Tile::kStride);
      out.before->add_tile(t.first_column, t.columns, t.first_slice, inside, t.coverage,
                           t.coverage);
    };
    corrector.solve(
        [&](int n, const std::uint8_t* levels, const std::uint8_t*, bool dark) {
          if ((n & 63) == 0) context.check_cancelled();
          out.put(n, dark ? nullptr : shown(levels));
        },
        look);
    return;
  }
  corrector.solve([&](int n, const std::uint8_t* levels, const std::uint8_t* coverage, bool dark) {
    if ((n & 63) == 0) context.check_cancelled();
    const std::uint8_t* const lit = shown(levels);
    out.put(n, dark ? nullptr : lit);
    if (out.watch) out.watch->add_slice(n, dark ? nullptr : lit);
    out.after.add_slice(n, lit, coverage);
    if (out.before) out.before->add_slice(n, n < plan.layers ? coverage : nullptr, coverage);
  });
}

/// Joins the columns of groups into rows of a band. Coded bands begin with the last slice.
class Joiner {
 public:
  Joiner(const GroupedBand& band, std::size_t columns, std::vector<CodedBand> coded_bands)
      : band_(band), coded_bands_(std::move(coded_bands)), rows_(columns, 0), part_(columns) {}
  /// Null where the slice is black. Valid until the next call.
  const std::uint8_t* at(int index) {
    bool black = true;
    for (std::size_t g = 0; g < coded_bands_.size(); ++g) {
      black = black && coded_bands_[g].black(index);
      coded_bands_[g].read(index, part_.data());
      const auto& columns = band_.groups[g].columns;
      for (std::size_t k = 0; k < columns.size(); ++k) rows_[columns[k]] = part_[k];
    }
    return black ? nullptr : rows_.data();
  }

 private:
  const GroupedBand& band_;
  std::vector<CodedBand> coded_bands_;
  std::vector<std::uint8_t> rows_, part_;
};

}  // namespace

StackInfo write_target(const SliceSource& target, const StackFile& file,
                       const ExecutionContext& context) {
  const Grid& grid = target.grid();
  StackWriter writer(file, grid, context);
  TargetScan scan(target);
  const auto bands = bands_of(grid, target.bounds());
  const auto ranges = slice_ranges_of(target, bands.size());
  parallel_for(context, "slice", bands.size() * ranges.size(), [&](std::size_t i) {
    const PixelBox& band = bands[i / ranges.size()];
    StackWriter::BandEncoder encoder(writer, band.y0, band.y1);
    scan.read(band, ranges[i % ranges.size()], [&](int n, const std::uint8_t* rows) {
      if ((n & 63) == 0) context.check_cancelled();
      encoder.put(n, band.x0, band.x1, rows);
    });
  });
  StackInfo info;
  info.grid = grid;
  detail::set_frame(info, target);
  info.kind = StackKind::target;
  scan.fill(info);
  writer.finish(info, scan.picture());
  return info;
}

CorrectionPlan plan_correction(const SliceSource& target, const Setup& setup,
                               const ExecutionContext& context) {
  const PlacePlans plans(target, setup, context);
  return {plans.models().brightest(), setup.process, plans.layers(), plans.all_layers()};
}

Correction correct_stack(const SliceSource& target, const Setup& asked, const StackFile& file,
                         const CorrectionAsk& ask, const ExecutionContext& context) {
  const bool with_volume = ask.volume_cells > 0, with_before = ask.before || with_volume;
  refuse_recording(target);
  Setup setup = asked;
  setup.process = schedule_uv(target, asked, context);
  const PlacePlans plans(target, setup, context);
  const PlaceModels& models = plans.models();
  const CureModel& model = models.brightest();
  Grid grid = target.grid();
  grid.layers = plans.all_layers();

  StackWriter writer(file, grid, context);
  detail::set_uv_images(writer, model, plans.levels());
  std::optional<PlaceWindows> window;
  if (model.inhibited) window.emplace(models, plans.all_layers());
  TargetScan scan(target);
  const auto bands = bands_of(grid, target.bounds());
  std::optional<VolumeReducer> volume;
  if (with_volume) {
    volume.emplace(models, target.bounds(), plans.layers(), plans.all_layers(), plans.levels(),
                   ask.volume_cells);
  }
  // Merging does not depend on the order of bands, and a band's histograms are large.
  Prediction after, before;
  LightCounts in_groups{};
  std::mutex merging;
  parallel_for(context, "correct", bands.size(), [&](std::size_t i) {
    const PixelBox& band = bands[i];
    const std::size_t columns = columns_of(band);
    std::optional<VolumeReducer::Band> reduced;
    if (volume) reduced.emplace(*volume, band);
    CodedBand design(columns), upwards(columns);  // for the reduced volume; the last slice first
    const BandReader read = [&](const SliceSource::Sink& sink) {
      if (!reduced) return scan.read(band, sink);
      scan.read(band, [&](int n, const std::uint8_t* rows) {
        design.append(rows);
        sink(n, rows);
      });
    };
    StackWriter::BandEncoder encoder(writer, band.y0, band.y1);
    const auto put_out = [&](int n, const std::uint8_t* pixels) {
      encoder.put(n, band.x0, band.x1, pixels);
      if (reduced) upwards.append(pixels);
    };
    Prediction band_after, band_before;
    // Corrects the columns of one value of light; figures are added to those of values before.
    const auto correct = [&](std::uint8_t value, const std::vector<std::uint32_t>* of_band,
                             const BandReader& reader, const BandPredictor::PixelOfColumn& place,
                             const auto& put) {
      const std::size_t count = of_band ? of_band->size() : columns;
      const CorrectionPlan& plan = plans.plan(value);
      const PixelCurve& curve = models.curve(value);
      BandPredictor predict_after(plan.model, curve, plans.all_layers(), count);
      BandPredictor predict_before(plan.model, curve, plans.all_layers(), count);
      predict_after.go_on_from(std::move(band_after));
      predict_before.go_on_from(std::move(band_before));
      if (reduced) {
        reduced->listen_after(predict_after, of_band);
        reduced->listen_before(predict_before, of_band);
      }
      std::optional<WindowWatch> watch;
      if (window) watch.emplace(plan.model, plans.all_layers(), count);
      correct_columns(
          plan, count, reader,
          {put, predict_after, with_before ? &predict_before : nullptr, watch ? &*watch : nullptr},
          context);
      band_after = predict_after.finish(place);
      band_before = predict_before.finish(place);
      if (!watch) return;
      const std::lock_guard lock(merging);
      window->merge(value, *watch);
    };
    LightCounts counts{};
    if (plans.even()) {
      correct(models.map().reference(), nullptr, read, pixels_of_columns(band), put_out);
    } else {
      const GroupedBand grouped(models.map(), band, {read});
      std::vector<CodedBand> corrected;
      for (const GroupedBand::Group& g : grouped.groups) {
        counts[g.value] = g.columns.size();
        CodedBand& coded = corrected.emplace_back(g.columns.size());
        correct(g.value, &g.columns, g.reader(0), pixels_of_columns(band, g.columns),
                [&](int, const std::uint8_t* pixels) { coded.append(pixels); });
      }
      Joiner joined(grouped, columns, std::move(corrected));
      for (int n = plans.all_layers(); n-- > 0;) {
        put_out(n, joined.at(plans.all_layers() - 1 - n));
      }
    }
    if (reduced) {
      const int all = plans.all_layers();
      reduced->finish([&](int n, std::uint8_t* out) { upwards.read(all - 1 - n, out); },
                      [&](int n, std::uint8_t* out) { design.read(n, out); });
    }
    const std::lock_guard lock(merging);
    after.merge(band_after);
    if (with_before) before.merge(band_before);
    for (std::size_t v = 0; v < counts.size(); ++v) in_groups[v] += counts[v];
  });

  Correction result;
  if (volume) result.volume = std::make_shared<ReducedVolume>(volume->take());
  if (window) {
    result.after.dead_zones = window->result();
    check_window(*result.after.dead_zones, setup.process);
  }
  StackInfo& info = result.info;
  info.grid = grid;
  detail::set_frame(info, target);
  info.kind = StackKind::corrected;
  info.printer = setup.printer;
  info.resin = setup.resin;
  info.process = setup.process;
  info.original_sha256 = file.original_sha256;
  scan.fill(info);

  const auto whole = [&](const Prediction& figures, int slices) {
    return plans.even() ? whole_image(figures, model, grid, slices, bands)
                        : whole_image(figures, models, grid, slices, in_groups);
  };
  Prediction figures = whole(after, plans.all_layers());
  figures.dead_zones.swap(result.after.dead_zones);
  result.after = std::move(figures);
  if (with_before) result.before = whole(before, plans.layers());
  const Prediction& p = result.after;
  detail::tell_nothing_prints(p, context);
  if (p.cure_through_voxels + p.undercure_voxels > 0) {
    context.tell(fmt::format(
        "{} voxels will still cure through and {} stay undercured: no choice of the {} grey levels "
        "was found that avoids it; one level moves an edge by up to {:.3g} um",
        p.cure_through_voxels, p.undercure_voxels, plans.levels(), model.level_step_um()));
  }
  // Printers with a dead zone need some 20 um of liquid resin under the part; below half of that
  // the user is told.
  constexpr double kThinUm = 10;
  if (p.dead_zones && setup.process.uv.dead_zone_um == 0 && p.dead_zones->least() < kThinUm) {
    context.tell(
        fmt::format("the dead zone gets as thin as {:.2g} um; UV light chosen for a dead zone, in "
                    "place of an intensity, keeps more of it",
                    p.dead_zones->least()));
  }
  if (p.one_slice_gaps > 0) {
    context.tell(fmt::format("{} gaps are one slice high: {}", p.one_slice_gaps,
                             setup.process.one_slice_gaps == OneSliceGaps::merge ? "merged"
                             : model.mode == ExposureMode::layerwise             ? "kept open"
                             : setup.process.uv.kind != UvKind::off
                                 ? "kept open, at the cost of the edges beside them"
                                 : fmt::format("kept open, at the cost of up to {:.3g} um of the "
                                               "features above them",
                                               setup.process.gap_shortfall * model.layer_um)));
  }
  if (ask.before_writing) ask.before_writing(result);
  writer.finish(info, scan.picture());
  return result;
}

CorrectedSlices::CorrectedSlices(const SliceSource& target, const Setup& setup,
                                 const ExecutionContext& context)
    : target_(target),
      plans_(std::make_unique<const PlacePlans>(target, setup, context)),
      grid_(target.grid()) {
  grid_.layers = plans_->all_layers();
}

CorrectedSlices::~CorrectedSlices() = default;

void CorrectedSlices::read_band(const PixelBox& band, const Sink& sink) const {
  const std::size_t columns = columns_of(band);
  const int all = plans_->all_layers();
  const BandReader read = [&](const Sink& take) { target_.read_band(band, take); };
  // The solve gives the last slice first.
  const auto corrected = [&](const CorrectionPlan& plan, std::size_t count,
                             const BandReader& reader) {
    BandCorrector corrector(plan, count);
    reader([&](int, const std::uint8_t* rows) { corrector.add_layer(rows); });
    CodedBand upwards(count);
    std::vector<std::uint8_t> pixels(count);
    corrector.solve([&](int, const std::uint8_t* levels, const std::uint8_t*, bool) {
      for (std::size_t k = 0; k < count; ++k) {
        pixels[k] = static_cast<std::uint8_t>(pixel_of_level(levels[k], plan.levels.size()));
      }
      upwards.append(pixels.data());
    });
    return upwards;
  };
  if (plans_->even()) {
    const CodedBand upwards = corrected(plans_->plan(), columns, read);
    std::vector<std::uint8_t> pixels(columns);
    for (int n = 0; n < all; ++n) {
      const int at = all - 1 - n;
      upwards.read(at, pixels.data());
      sink(n, upwards.black(at) ? nullptr : pixels.data());
    }
    return;
  }
  const GroupedBand grouped(plans_->models().map(), band, {read});
  std::vector<CodedBand> coded_bands;
  for (const GroupedBand::Group& g : grouped.groups) {
    coded_bands.push_back(corrected(plans_->plan(g.value), g.columns.size(), g.reader(0)));
  }
  Joiner joined(grouped, columns, std::move(coded_bands));
  for (int n = 0; n < all; ++n) sink(n, joined.at(all - 1 - n));
}

}  // namespace slicecorr
