#include <fmt/format.h>

#include <atomic>
#include <cmath>
#include <mutex>

#include "base/band_tape.hpp"
#include "pipeline/bands.hpp"
#include "pipeline/relief.hpp"
#include "pipeline/uv_images.hpp"
#include "slicecorr/dead_zone.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/version.hpp"

namespace slicecorr {

using detail::bands_of;
using detail::BandTape;
using detail::columns_of;
using detail::Relief;
using detail::whole_image;

namespace {

std::string program_name() { return std::string("slicecorr ") + version; }

/// What the first pass over a target collects besides handing its slices on.
class TargetScan {
 public:
  explicit TargetScan(const SliceSource& target)
      : target_(target), relief_(target.bounds(), target.grid().layers) {}

  void read(const PixelBox& band, const SliceSource::Sink& sink) {
    const std::size_t columns = columns_of(band);
    std::vector<std::int32_t> last_lit(columns, 0);
    std::uint64_t sum = 0;
    target_.read_band(band, [&](int n, const std::uint8_t* rows) {
      if (rows) {
        for (std::size_t i = 0; i < columns; ++i) {
          sum += rows[i];
          last_lit[i] = rows[i] ? n + 1 : last_lit[i];
        }
      }
      sink(n, rows);
    });
    coverage_sum_ += sum;
    relief_.add(band, last_lit);
  }
  /// To be called after all bands.
  void fill(StackInfo& info) const {
    if (coverage_sum_ == 0) {
      throw InputError("nothing in the part is solid: all slices are empty");
    }
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
};

void check_fits(const Grid& grid, const Printer& printer) {
  if (grid.width_px != printer.width_px || grid.height_px != printer.height_px) {
    throw InputError(fmt::format("the slices are {} x {} pixels; printer '{}' has {} x {}",
                                 grid.width_px, grid.height_px, printer.name, printer.width_px,
                                 printer.height_px));
  }
  const auto differ = [](double a, double b) { return std::abs(a - b) > 0.01 * b; };
  if (differ(grid.pixel_x_um, printer.pixel_x_um) || differ(grid.pixel_y_um, printer.pixel_y_um)) {
    throw InputError(fmt::format(
        "the slices were made for pixels of {:g} x {:g} um; those of printer '{}' are {:g} x {:g} "
        "um",
        grid.pixel_x_um, grid.pixel_y_um, printer.name, printer.pixel_x_um, printer.pixel_y_um));
  }
}

}  // namespace

StackInfo write_target(const SliceSource& target, const StackFile& file, const Job& job) {
  const Grid& grid = target.grid();
  StackWriter writer(file, grid, job);
  TargetScan scan(target);
  const auto bands = bands_of(grid, target.bounds());
  parallel_for(job, "slice", bands.size(), [&](std::size_t i) {
    StackWriter::BandEncoder encoder(writer, bands[i].y0, bands[i].y1);
    scan.read(bands[i], [&](int n, const std::uint8_t* rows) {
      if ((n & 63) == 0) job.check_cancelled();
      encoder.put(n, bands[i].x0, bands[i].x1, rows);
    });
  });
  StackInfo info;
  info.grid = grid;
  info.kind = StackKind::target;
  scan.fill(info);
  writer.finish(info, scan.picture());
  return info;
}

CorrectionPlan plan_correction(const SliceSource& target, const Setup& setup) {
  const Grid& grid = target.grid();
  check_fits(grid, setup.printer);
  CureModel model = make_cure_model(setup.printer, setup.resin, setup.process, grid.layer_um);
  check_feasible(model, setup.printer, setup.process);
  const int slices = slices_with_burst(model, grid.layers, grid.layers - 1);
  const double travel_mm = slices * grid.layer_um * 1e-3;
  if (setup.printer.travel_mm > 0 && travel_mm > setup.printer.travel_mm * (1 + 1e-9)) {
    if (slices == grid.layers) {
      throw InfeasibleError(
          fmt::format("the part is {:.3f} mm high; the stage of '{}' travels {:g} mm", travel_mm,
                      setup.printer.name, setup.printer.travel_mm));
    }
    throw InfeasibleError(
        fmt::format("curing the part's end takes {} slices after it, {:.3f} mm in all; the stage "
                    "of '{}' travels "
                    "{:g} mm. Print slower, with more light, or a part at least {:.3f} mm lower",
                    slices - grid.layers, travel_mm, setup.printer.name, setup.printer.travel_mm,
                    travel_mm - setup.printer.travel_mm));
  }
  return {std::move(model), setup.process, grid.layers, slices};
}

Correction correct_stack(const SliceSource& target, const Setup& asked, const StackFile& file,
                         bool with_before, const Job& job) {
  Setup setup = asked;
  setup.process = schedule_uv(target, asked, job);
  const CorrectionPlan plan = plan_correction(target, setup);
  const CureModel& model = plan.model;
  Grid grid = target.grid();
  grid.layers = plan.all_layers;
  const PixelCurve curve = pixel_curve(model);
  std::uint8_t pixel_of[256] = {};
  for (int level = 0; level < plan.levels.size(); ++level) {
    pixel_of[level] = static_cast<std::uint8_t>(pixel_of_level(level, plan.levels.size()));
  }
  const bool all_levels = plan.levels.size() == 256;

  StackWriter writer(file, grid, job);
  detail::set_uv_images(writer, model, plan.levels.size());
  std::optional<WindowTotal> window;
  if (model.inhibited) window.emplace(model, plan.all_layers);
  TargetScan scan(target);
  const auto bands = bands_of(grid, target.bounds());
  // Merging does not depend on the order of bands, and a band's histograms are large.
  Prediction after, before;
  std::mutex merging;
  parallel_for(job, "correct", bands.size(), [&](std::size_t i) {
    const PixelBox& band = bands[i];
    const std::size_t columns = columns_of(band);
    BandCorrector corrector(plan, columns);
    scan.read(band, [&](int n, const std::uint8_t* rows) {
      if ((n & 63) == 0) job.check_cancelled();
      corrector.add_layer(rows);
    });
    StackWriter::BandEncoder encoder(writer, band.y0, band.y1);
    BandPredictor predict_after(model, curve, plan.all_layers, columns);
    BandPredictor predict_before(model, curve, plan.all_layers, columns);
    std::optional<WindowWatch> watch;
    if (window) watch.emplace(model, plan.all_layers, columns);
    std::vector<std::uint8_t> pixels(columns);
    corrector.solve(
        [&](int n, const std::uint8_t* levels, const std::uint8_t* coverage, bool dark) {
          if ((n & 63) == 0) job.check_cancelled();
          const std::uint8_t* shown = levels;
          if (!all_levels) {
            for (std::size_t k = 0; k < columns; ++k) pixels[k] = pixel_of[levels[k]];
            shown = pixels.data();
          }
          encoder.put(n, band.x0, band.x1, dark ? nullptr : shown);
          if (watch) watch->add_slice(n, dark ? nullptr : shown);
          predict_after.add_slice(n, shown, coverage);
          if (with_before) {
            predict_before.add_slice(n, n < plan.layers ? coverage : nullptr, coverage);
          }
        });
    const Prediction band_after = predict_after.finish(band.x0, band.y0, band.width());
    const Prediction band_before = predict_before.finish(band.x0, band.y0, band.width());
    const std::lock_guard lock(merging);
    after.merge(band_after);
    if (watch) window->merge(*watch);
    if (with_before) before.merge(band_before);
  });

  Correction result;
  if (window) {
    result.after.dead_zones = window->result();
    const DeadZones& zones = *result.after.dead_zones;
    if (zones.cured_pixels > 0 && !setup.process.allow_window_cure) {
      throw InfeasibleError(fmt::format(
          "the resin cures to the window at {} pixels, first in slice {}: UV light does not hold a "
          "dead zone there; use more UV light, print slower, or allow it with --window-cure allow",
          zones.cured_pixels, zones.cured_slice));
    }
  }
  StackInfo& info = result.info;
  info.grid = grid;
  info.kind = StackKind::corrected;
  info.printer = setup.printer;
  info.resin = setup.resin;
  info.process = setup.process;
  scan.fill(info);
  writer.finish(info, scan.picture());

  auto zones = std::move(result.after.dead_zones);
  result.after = whole_image(after, model, grid, plan.all_layers, bands);
  result.after.dead_zones = std::move(zones);
  if (with_before) result.before = whole_image(before, model, grid, plan.layers, bands);
  const Prediction& p = result.after;
  if (p.target_voxels == 0) {
    job.tell(
        "no voxel is covered fully: the part is finer than a pixel; are units and scale right?");
  }
  if (p.cure_through_voxels + p.undercure_voxels > 0) {
    job.tell(fmt::format(
        "{} voxels will still cure through and {} stay undercured: no choice of the {} grey levels "
        "was "
        "found that avoids it; one level moves an edge by up to {:.3g} um",
        p.cure_through_voxels, p.undercure_voxels, plan.levels.size(), model.level_step_um()));
  }
  // Printers of this kind want some 20 um of liquid under the part.
  constexpr double kThin_um = 10;
  if (p.dead_zones && setup.process.uv.dead_zone_um == 0 && p.dead_zones->least() < kThin_um) {
    job.tell(
        fmt::format("the dead zone gets as thin as {:.2g} um; --dead-zone-um asks for more of it",
                    p.dead_zones->least()));
  }
  if (p.one_slice_gaps > 0) {
    job.tell(fmt::format("{} gaps are one slice high: {}", p.one_slice_gaps,
                         plan.merge_one_slice_gaps ? "merged"
                         : model.mode == ExposureMode::layerwise
                             ? "kept open"
                             : "kept open, at the cost of the edges beside them"));
  }
  return result;
}

CorrectedSlices::CorrectedSlices(const SliceSource& target, const Setup& setup)
    : target_(target), plan_(plan_correction(target, setup)), grid_(target.grid()) {
  grid_.layers = plan_.all_layers;
}

void CorrectedSlices::read_band(const PixelBox& band, const Sink& sink) const {
  const std::size_t columns = columns_of(band);
  BandCorrector corrector(plan_, columns);
  target_.read_band(band, [&](int, const std::uint8_t* rows) { corrector.add_layer(rows); });
  // The solve gives the last slice first.
  BandTape upwards(columns);
  std::vector<std::uint8_t> pixels(columns);
  corrector.solve([&](int, const std::uint8_t* levels, const std::uint8_t*, bool) {
    for (std::size_t k = 0; k < columns; ++k) {
      pixels[k] = static_cast<std::uint8_t>(pixel_of_level(levels[k], plan_.levels.size()));
    }
    upwards.append(pixels.data());
  });
  for (int n = 0; n < plan_.all_layers; ++n) {
    const int at = plan_.all_layers - 1 - n;
    upwards.read(at, pixels.data());
    sink(n, upwards.black(at) ? nullptr : pixels.data());
  }
}

}  // namespace slicecorr
