// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <mutex>
#include <span>

#include "bands/bands.hpp"
#include "bands/design_band.hpp"
#include "bands/dose_meter.hpp"
#include "bands/place_plans.hpp"
#include "bands/surface_collector.hpp"
#include "bands/uncertain_walk.hpp"
#include "base/coded_band.hpp"
#include "cure/shown_slices.hpp"
#include "cure/spread_band.hpp"
#include "pipeline/printed_bodies.hpp"
#include "pipeline/vanished.hpp"
#include "predict/plane_edges.hpp"
#include "slicecorr/absorbance_in_layer.hpp"
#include "slicecorr/dead_zone.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/even_dead_zone.hpp"
#include "slicecorr/pipeline.hpp"

namespace slicecorr {

using detail::bands_of;
using detail::CodedBand;
using detail::CodedDesign;
using detail::columns_of;

namespace {

void check_inside(const Grid& grid, int x, int y) {
  if (x < 0 || x >= grid.width_px || y < 0 || y >= grid.height_px) {
    throw InputError(fmt::format("pixel {}, {} is outside the image; expected 0..{}, 0..{}", x, y,
                                 grid.width_px - 1, grid.height_px - 1));
  }
}

void tell_settings(const detail::ShownSlices& slices, const ExecutionContext& context) {
  context.tell(
      fmt::format("measured UV light is taken as one of {} intensities, off by up to {:.2g} %",
                  slices.process().uv.slice_mw_cm2.size(), 100 * slices.setting_deviation()));
}

/// Slices of a recording that were passed faster than their own speed: their light may be right, but
/// nobody has asked whether resin and vat bear it.
void tell_speeds(const SliceSource& stack, const Process& process,
                 const ExecutionContext& context) {
  if (!stack.recording() || process.slice_speed_mm_h.empty()) return;
  const double rounding = 1.01;  // of speeds as machines are told and measure them
  constexpr double mm_h_of_um_s = 3.6;
  int slices = 0, worst = 0;
  double worst_mm_h = 0, greatest = rounding;
  for (int n = 0; n < stack.recording()->slices(); ++n) {
    double fastest = 0;
    for (const Recording::Showing& part : stack.recording()->of(n)) {
      if (part.light > 0) fastest = std::max(fastest, part.speed_um_s * mm_h_of_um_s);
    }
    const double ratio = fastest / slice_speed_mm_h(process, n);
    if (ratio <= rounding) continue;
    ++slices;
    if (ratio <= greatest) continue;
    greatest = ratio;
    worst = n;
    worst_mm_h = fastest;
  }
  if (slices == 0) return;
  context.tell(fmt::format(
      "{} slices were passed faster than at their own speeds, most of all slice {} at {:.4g} mm/h "
      "in place of {:.4g}",
      slices, worst, worst_mm_h, slice_speed_mm_h(process, worst)));
}

/// UV images that were others than those of their slices for so short that it does not count.
void tell_other_uv(const detail::ShownSlices& slices, const ExecutionContext& context) {
  if (!(slices.other_uv_light() > 0)) return;
  context.tell(fmt::format(
      "for up to {:.2g} % of a slice's light another UV image was shown than the one that goes with "
      "the blue image; it counts as if it had been that one",
      100 * slices.other_uv_light()));
}

/// Grey values of a recorded slice as they would be at the light of the plan.
void mix(std::span<const ImageShowing> parts, std::size_t columns, std::uint8_t* pixels) {
  for (std::size_t i = 0; i < columns; ++i) {
    double sum = 0;
    for (const ImageShowing& part : parts) sum += part.light * part.pixels[i];
    pixels[i] = static_cast<std::uint8_t>(std::lround(std::min(sum, 255.0)));
  }
}

/// One run of verify_stack: what the bands share, and what they add up to.
class Verification {
 public:
  Verification(const SliceSource& stack, const SliceSource& target,
               const detail::ShownSlices& slices, const Setup& setup,
               const ExecutionContext& context)
      : stack_(stack),
        target_(target),
        context_(context),
        surface_(setup.process.surface),
        slices_(slices),
        recorded_(slices.recorded() ? &slices : nullptr),
        models_(slices.printer(), setup.resin, slices.process(), stack.grid(), stack.frame()),
        layers_(slices.slices()),
        all_layers_(std::max(layers_, target.grid().layers + (target.edge_heights() ? 1 : 0))),
        spread_(models_, stack.grid(), stack.frame()),
        bands_(bands_of_all()),
        least_neck_mm2_(setup.least_neck_mm2),
        bodies_(bands_, std::max(layers_, target.grid().layers), models_.brightest(), context),
        surface_maps_(target.bounds()) {
    if (models_.brightest().inhibited()) window_.emplace(models_, layers_);
    if (!setup.uncertainty) return;
    if (recorded_) {
      throw InputError(
          "how sure a recorded print is can't be said: its light was measured; expected a stack that "
          "is no recording");
    }
    Setup scheduled = setup;
    scheduled.process = slices.process();
    uncertain_.emplace(scheduled, models_, stack.bounds().united(target.bounds()));
  }

  void predict_bands() {
    parallel_for(context_, "predict", bands_.size(), [&](std::size_t i) { predict_band(i); });
  }
  /// After all bands: what the whole image prints.
  Prediction result() const {
    const Grid& grid = stack_.grid();
    Prediction p =
        !spread_.none()
            ? detail::whole_image(total_, models_.brightest(), grid, layers_, bands_, recorded_)
            : detail::whole_image(total_, models_, grid, layers_, grouped_columns_, recorded_);
    if (window_) p.dead_zones = window_->result();
    if (uncertain_) p.uncertain = uncertain_->result();
    if (const auto finest = spread_.finest()) p.finest = {finest->line_um, finest->gap_um};
    p.maps = std::make_shared<const SurfaceMaps>(surface_maps_.maps());
    p.bodies = bodies_.judge(grid, stack_.frame(), models_.brightest().heights, least_neck_mm2_);
    return p;
  }

 private:
  /// So many pixels beside a feature its outline is looked for.
  static constexpr int kLeastBeside = 8;
  int beside_y() const { return std::max(kLeastBeside, spread_.reach_y()); }
  /// Of all columns that the stack or the target light. Where light spreads each band is as high as
  /// what it needs around it.
  std::vector<PixelBox> bands_of_all() const {
    const PixelBox box = stack_.bounds().united(target_.bounds());
    if (spread_.none()) return bands_of(stack_.grid(), box);
    const Grid& grid = stack_.grid();
    const int beside_x = std::max(kLeastBeside, spread_.reach_x());
    const PixelBox all{std::max(0, box.x0 - beside_x), std::max(0, box.y0 - beside_y()),
                       std::min(grid.width_px, box.x1 + beside_x),
                       std::min(grid.height_px, box.y1 + beside_y())};
    const int rows = std::max(32, 4 * beside_y());
    std::vector<PixelBox> bands;
    for (int y = all.y0; y < all.y1; y += rows) {
      bands.push_back({all.x0, y, all.x1, std::min(y + rows, all.y1)});
    }
    return bands;
  }
  void predict_band(std::size_t index);
  /// The same where light spreads.
  void predict_spread(std::size_t index);
  /// Columns of one value of light, whose figures go on from those before them.
  void predict(const detail::DesignGroup& group, Prediction& figures,
               detail::PrintedBodies::Band& bodies);
  bool aims_at_heights() const { return surface_ == Surface::mesh && target_.edge_heights(); }
  /// Slices of a recording, which show several images. `watch`: null, or takes them, too.
  void predict_showings(BandPredictor& predictor, const CodedBand& shown, const CodedDesign& design,
                        WindowWatch* watch) const;

  const SliceSource& stack_;
  const SliceSource& target_;
  const ExecutionContext& context_;
  const Surface surface_;
  const detail::ShownSlices& slices_;
  const detail::ShownSlices* const recorded_;  ///< null: one image per slice
  const PlaceModels models_;
  const int layers_, all_layers_;
  const detail::SpreadLight spread_;
  const std::vector<PixelBox> bands_;
  std::optional<detail::PlaceWindows> window_;  ///< where UV light keeps a dead zone

  const double least_neck_mm2_;
  detail::PrintedBodies bodies_;
  detail::SurfaceCollector surface_maps_;
  std::optional<detail::UncertainTotal> uncertain_;  ///< where it is asked how sure it is
  std::mutex merging_;
  Prediction total_;
  detail::LightCounts grouped_columns_{};  ///< by value of light, where none spreads
};

void Verification::predict(const detail::DesignGroup& group, Prediction& figures,
                           detail::PrintedBodies::Band& bodies) {
  const CodedDesign design = group.coded(surface_);
  const CodedBand& shown = *group.beside;
  const std::size_t columns = group.columns;
  const CureModel& model = models_.model(group.value);
  BandPredictor predictor(model, models_.curve(group.value), all_layers_, columns,
                          slices_.recorded());
  if (aims_at_heights()) predictor.aim_at_heights();
  predictor.keep_sides();
  bodies.listen(predictor, group.of_band);
  predictor.go_on_from(std::move(figures));
  std::optional<WindowWatch> watch;
  if (window_) watch.emplace(model, layers_, columns);
  if (recorded_) {
    predict_showings(predictor, shown, design, watch ? &*watch : nullptr);
  } else {
    detail::predict_shown(predictor, {shown, layers_, watch ? &*watch : nullptr}, design, context_);
  }
  figures = predictor.finish(group.place);
  surface_maps_.add(predictor.sides(), group.place);
  if (uncertain_) {
    std::vector<std::uint8_t> pixels(columns);
    const auto shown_at = [&](int n) -> const std::uint8_t* {
      if (n >= layers_) return nullptr;
      shown.read(n, pixels.data());
      return pixels.data();
    };
    uncertain_->add(group, {shown_at, all_layers_, aims_at_heights()}, design, context_);
  }
  if (!watch) return;
  const std::lock_guard lock(merging_);
  window_->merge(group.value, *watch);
}

void Verification::predict_showings(BandPredictor& predictor, const CodedBand& shown,
                                    const CodedDesign& design, WindowWatch* watch) const {
  std::vector<std::uint8_t> coverage(shown.columns()), heights(shown.columns());
  detail::ShownBand band_shown(slices_, shown);
  detail::LeftAloneRows left_alone(design.left_alone);
  for (int n = all_layers_; n-- > 0;) {
    if ((n & 63) == 0) context_.check_cancelled();
    design.coverage.read(n, coverage.data());
    const std::span<const ImageShowing> parts = band_shown.of(n);
    predictor.add_slice(n, parts,
                        {coverage.data(), design.heights_at(n, heights.data()), left_alone.at(n)});
    if (watch && n < layers_) watch->add_slice(n, parts);
  }
}

void Verification::predict_spread(std::size_t index) {
  const PixelBox& band = bands_[index];
  // Outlines are followed into the rows beside the band.
  const PixelBox field{band.x0, std::max(0, band.y0 - beside_y()), band.x1,
                       std::min(stack_.grid().height_px, band.y1 + beside_y())};
  const std::size_t columns = columns_of(band), in_field = columns_of(field);
  const auto first =
      static_cast<std::size_t>(band.y0 - field.y0) * static_cast<std::size_t>(field.width());
  const auto edge_heights = detail::edge_heights_of(target_, field);
  const auto left_alone = detail::left_alone_of(target_, field);
  const CodedDesign design(
      in_field,
      {detail::reader_of(target_, field), edge_heights ? &*edge_heights : nullptr,
       left_alone ? &*left_alone : nullptr},
      surface_);
  const CureModel& model = spread_.model();
  BandPredictor predictor(model, pixel_curve(model), all_layers_, columns, true);
  if (aims_at_heights()) predictor.aim_at_heights();
  predictor.keep_sides();
  detail::PrintedBodies::Band bodies(bodies_, index, band);
  bodies.listen(predictor, nullptr);
  detail::SpreadBand light(spread_, stack_, slices_, field);
  BandDose dose(model, in_field);
  detail::PlaneEdges plane(stack_.grid(), field, band, beside_y());
  std::vector<std::uint8_t> coverage(in_field), room(in_field);
  std::vector<ImageShowing> in_band;
  std::optional<WindowWatch> watch;
  if (window_) watch.emplace(model, layers_, columns);
  std::optional<UncertainBand> uncertain;
  if (uncertain_) {
    uncertain.emplace(
        uncertain_->band(models_.map().greatest(), all_layers_, columns, aims_at_heights()));
  }
  detail::LeftAloneRows left_rows(design.left_alone);
  std::vector<std::uint8_t> outlined(in_field), judged(uncertain ? in_field : 0);
  for (int n = all_layers_; n-- > 0;) {
    if ((n & 63) == 0) context_.check_cancelled();
    const std::span<const ImageShowing> showings = light.of(n);
    in_band.assign(showings.begin(), showings.end());
    for (ImageShowing& showing : in_band) {
      if (showing.phi) showing.phi += first;
      if (!showing.fronts) continue;
      showing.fronts += first;
      showing.pixels += first;
    }
    design.coverage.read(n, coverage.data());
    const std::uint8_t* const heights = design.heights_at(n, room.data());
    const std::uint8_t* const left = left_rows.at(n);
    predictor.add_slice(n, in_band,
                        {coverage.data() + first, heights ? heights + first : nullptr,
                         left ? left + first : nullptr});
    dose.add_slice(n, showings);
    if (watch && n < layers_) watch->add_slice(n, in_band);
    if (uncertain) {
      const std::uint8_t* const here = detail::marked(coverage.data(), left, judged);
      uncertain->add_slice(n, in_band, here + first, heights ? heights + first : nullptr);
    }
    // Beside what is left alone features have no outline.
    plane.add(n, dose.middle(),
              design.coverage.black(n) ? nullptr : detail::marked(coverage.data(), left, outlined));
  }
  const auto place = detail::pixels_of_columns(band);
  Prediction figures = predictor.finish(place);
  bodies.finish();
  plane.add_to(figures);
  surface_maps_.add(predictor.sides(), place);
  if (uncertain) uncertain_->add(*uncertain, place);
  const std::lock_guard lock(merging_);
  total_.merge(figures);
  if (watch) window_->merge(models_.map().greatest(), *watch);
}

void Verification::predict_band(std::size_t index) {
  if (!spread_.none()) return predict_spread(index);
  const PixelBox& band = bands_[index];
  detail::PrintedBodies::Band bodies(bodies_, index, band);
  Prediction figures;
  detail::LightCounts counts{};
  const detail::DesignBand design(target_, models_.map(), band,
                                  {.beside = &stack_, .doses = false});
  design.count(counts);
  for (const detail::DesignGroup& g : design.groups()) predict(g, figures, bodies);
  bodies.finish();
  const std::lock_guard lock(merging_);
  total_.merge(figures);
  for (std::size_t v = 0; v < counts.size(); ++v) grouped_columns_[v] += counts[v];
}

/// What a recorded slice shows of a column.
ProbeRow probe_recorded(const CureModel& model, const std::vector<double>& intensity,
                        std::span<const ImageShowing> parts) {
  ProbeRow row;
  double most = 0, sum = 0;
  for (const ImageShowing& part : parts) {
    const int grey = level_of_pixel(*part.pixels, static_cast<int>(intensity.size()));
    const auto level = static_cast<std::size_t>(grey);
    if (part.light > most) row.grey = grey;
    most = std::max(most, part.light);
    sum += part.light * (model.gel_time() ? intensity[level] : std::pow(intensity[level], model.m));
    row.phi += part.light * (model.inhibited() ? model.inhibited()->steady_dose(part.setting, grey)
                                               : model.level_phi[level]);
  }
  // One image with the planned light: computed without a power, so that it is the same as in a
  // stack that is no recording.
  row.intensity_mw_cm2 = parts.size() == 1 && most == 1
                             ? intensity[static_cast<std::size_t>(row.grey)]
                             : std::pow(sum, 1.0 / model.m);
  return row;
}

/// phi of the light of a single column.
double phi_of(const CureModel& model, const ImageShowing& light) {
  return light.fronts ? model.phi(model.inhibited()->blue_of(*light.fronts)) : *light.phi;
}

}  // namespace

void check_same_voxels(const Grid& stack, const Grid& target) {
  if (stack.width_px != target.width_px || stack.height_px != target.height_px) {
    throw InputError(
        fmt::format("the stack is {} x {} pixels, the target {} x {}; expected the same",
                    stack.width_px, stack.height_px, target.width_px, target.height_px));
  }
  const auto differ = [](double a, double b) { return std::abs(a - b) > 1e-4 * b; };
  if (differ(stack.layer_um, target.layer_um) || differ(stack.pixel_x_um, target.pixel_x_um) ||
      differ(stack.pixel_y_um, target.pixel_y_um)) {
    throw InputError(fmt::format(
        "the stack has voxels of {:g} x {:g} x {:g} um, the target of {:g} x {:g} x {:g}; expected "
        "the same",
        stack.pixel_x_um, stack.pixel_y_um, stack.layer_um, target.pixel_x_um, target.pixel_y_um,
        target.layer_um));
  }
}

Prediction verify_stack(const SliceSource& stack, const SliceSource& target, const Setup& setup,
                        const ExecutionContext& context) {
  check_absorbance_height(setup.resin, target.grid().layer_um);
  check_same_voxels(stack.grid(), target.grid());
  refuse_recording(target);
  const detail::ShownSlices slices(stack, setup.printer, setup.resin, setup.process);
  if (slices.setting_deviation() > 0) tell_settings(slices, context);
  tell_other_uv(slices, context);
  tell_speeds(stack, setup.process, context);
  Verification verification(stack, target, slices, setup, context);
  verification.predict_bands();
  Prediction p = verification.result();
  p.other_wavelength = other_wavelength(setup.printer, setup.resin);
  p.other_display = other_display(setup.printer, setup.resin);
  p.assumed = setup.process.assumed;
  p.slits_merged = setup.process.one_slice_gaps == OneSliceGaps::merge;
  if (target.doses()) {
    const PlaceModels models(setup.printer, setup.resin, setup.process, stack.grid(),
                             stack.frame());
    detail::check_doses(*target.doses(), target, models, setup);
    p.regions = detail::measure_doses(stack, target, models, slices, context);
  }
  // A recording shows several images a slice: what flowed then is nobody's guess.
  if (setup.process.even_light && !slices.recorded()) {
    p.flow = flow_doses(target, &stack, setup, context);
  }
  detail::tell_nothing_prints(p, context);
  if (p.dead_zones && p.dead_zones->cured_pixels > 0) {
    context.tell(fmt::format("the resin cures to the window at {} pixels, first in slice {}",
                             p.dead_zones->cured_pixels, p.dead_zones->cured_slice));
  }
  return p;
}

std::vector<ProbeRow> probe_stack(const SliceSource& stack, const SliceSource* target,
                                  const Setup& setup, int x, int y) {
  const Grid& grid = stack.grid();
  check_inside(grid, x, y);
  if (target) check_same_voxels(grid, target->grid());
  const PixelBox pixel{x, y, x + 1, y + 1};
  const detail::ShownSlices slices(stack, setup.printer, setup.resin, setup.process);
  const PlaceModels models(slices.printer(), setup.resin, slices.process(), grid, stack.frame());
  const std::vector<double> intensity =
      level_intensities(models.printer_at(models.map().value(x, y)));
  const CodedBand coded = detail::coded_band_of(stack, pixel);
  detail::ShownBand shown(slices, coded);
  const detail::SpreadLight spread(models, grid, stack.frame());
  const CureModel& model = spread.none() ? models.model_at(x, y) : spread.model();
  std::optional<detail::SpreadBand> light;
  if (!spread.none()) light.emplace(spread, stack, slices, pixel);
  std::vector<ProbeRow> rows(static_cast<std::size_t>(slices.slices()));
  BandDose dose(model, 1);
  for (int n = slices.slices(); n-- > 0;) {
    ProbeRow& row = rows[static_cast<std::size_t>(n)];
    if (slices.recorded()) {
      const std::span<const ImageShowing> parts = shown.of(n);
      row = probe_recorded(spread.none() ? model : models.brightest(), intensity, parts);
      if (!light) dose.add_slice(n, parts);
    } else {
      std::uint8_t value = 0;
      coded.read(n, &value);
      row.grey = level_of_pixel(value, setup.printer.levels());
      row.intensity_mw_cm2 = intensity[static_cast<std::size_t>(row.grey)];
      row.phi = model.level_phi[static_cast<std::size_t>(row.grey)];
      if (!light) dose.add_slice(n, &value);
    }
    if (light) {
      row.phi = 0;
      const std::span<const ImageShowing> parts = light->of(n);
      for (const ImageShowing& part : parts) row.phi += part.light * phi_of(model, part);
      row.intensity_mw_cm2 = model.intensity_mw_cm2(std::max(0.0, row.phi));
      dose.add_slice(n, parts);
    }
    row.slice = n;
    row.z_um = model.heights.place_um(n, grid.layer_um);
    row.phi *= model.ratio(n);
    row.dose = *dose.upper();
    row.dose_middle = *dose.middle();
    row.dose_lower = *dose.lower();
  }
  if (target) {
    for (ProbeRow& row : rows) row.target = 0;
    target->read_band(pixel, [&](int n, const std::uint8_t* value) {
      if (static_cast<std::size_t>(n) < rows.size()) {
        rows[static_cast<std::size_t>(n)].target = (value ? *value : 0) / 255.0;
      }
    });
  }
  return rows;
}

Section section_of(const SliceSource& stack, const SliceSource& target, const Setup& setup, int y) {
  const Grid& grid = stack.grid();
  check_same_voxels(grid, target.grid());
  check_inside(grid, 0, y);
  const detail::ShownSlices slices(stack, setup.printer, setup.resin, setup.process);
  const PlaceModels models(slices.printer(), setup.resin, slices.process(), grid, stack.frame());
  const detail::SpreadLight spread(models, grid, stack.frame());
  PixelBox box = stack.bounds().united(target.bounds());
  if (!spread.none()) box = spread.around(box);
  Section s;
  s.y = y;
  s.x0 = box.x0;
  s.width = box.width();
  s.layers = std::max(slices.slices(), target.grid().layers);
  const auto width = static_cast<std::size_t>(s.width);
  const std::size_t size = width * static_cast<std::size_t>(s.layers);
  s.coverage.resize(size);
  s.pixels.resize(size);
  s.dose.resize(size);
  const PixelBox row{box.x0, y, box.x1, y + 1};
  const CodedBand design = detail::marked_band_of(target, row);
  for (int n = 0; n < design.slices(); ++n) {
    design.read(n, s.coverage.data() + static_cast<std::size_t>(n) * width);
  }
  if (const DoseTarget* const doses = target.doses()) {
    const CodedBand wanted = detail::coded_band_of(*doses->images, row);
    std::vector<std::uint8_t> bytes(width);
    s.wanted.resize(size, 1.0F);
    for (int n = 0; n < wanted.slices(); ++n) {
      wanted.read(n, bytes.data());
      for (std::size_t x = 0; x < width; ++x) {
        s.wanted[static_cast<std::size_t>(n) * width + x] =
            static_cast<float>(doses->scale.dose[bytes[x]]);
      }
    }
  }
  const CodedBand coded = detail::coded_band_of(stack, row);
  detail::ShownBand shown(slices, coded);
  std::optional<detail::SpreadBand> light;
  std::optional<BandDose> of_light;
  if (!spread.none()) {
    light.emplace(spread, stack, slices, row);
    of_light.emplace(spread.model(), width);
  }
  PlaceDose dose(models, row);
  for (int n = s.layers; n-- > 0;) {
    const std::size_t at = static_cast<std::size_t>(n) * width;
    if (slices.recorded()) {
      const std::span<const ImageShowing> parts = shown.of(n);
      if (!light) dose.add_slice(n, parts);
      mix(parts, width, s.pixels.data() + at);
    } else {
      if (n < grid.layers) coded.read(n, s.pixels.data() + at);
      if (!light) dose.add_slice(n, n < grid.layers ? s.pixels.data() + at : nullptr);
    }
    if (light) of_light->add_slice(n, light->of(n));
    const double* const middle = light ? of_light->middle() : dose.middle();
    for (std::size_t x = 0; x < width; ++x) s.dose[at + x] = static_cast<float>(middle[x]);
  }
  return s;
}

}  // namespace slicecorr
