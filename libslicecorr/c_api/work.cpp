// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Checking, correcting, verifying: the pipeline behind the C interface.

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <numeric>
#include <optional>
#include <sstream>

#include "c_api/handles.hpp"
#include "pipeline/vanished.hpp"
#include "slicecorr/dead_zone.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/even_greys.hpp"
#include "slicecorr/inhibited.hpp"
#include "slicecorr/left_alone.hpp"
#include "slicecorr/place_models.hpp"
#include "slicecorr/plan.hpp"
#include "slicecorr/print_file.hpp"
#include "slicecorr/scan.hpp"
#include "slicecorr/solid.hpp"
#include "slicecorr/version.hpp"

namespace slicecorr::c_api {

namespace {

/// How messages name a stack.
std::string name_of(const slicecorr_stack& stack) {
  return stack.path.empty() ? "the stack in memory" : stack.path;
}

/// With what the choices say of how sure its inputs are.
Setup with_uncertainty(Setup setup, const Choices& choices) {
  const bool robust = choices.robust == "on";
  if (choices.uncertain.empty()) {
    if (robust) throw InputError("robust is on; expected uncertain with it, as in ha=5%,dc=5%");
    return setup;
  }
  setup.uncertainty = chosen_uncertainty(choices.uncertain, setup, choices, ChoiceNames::fields);
  setup.uncertainty->robust = robust;
  return setup;
}

Setup setup_for_target(const slicecorr_stack& target, const slicecorr_setup* setup) {
  check_design(target.info, name_of(target));
  const Choices& choices = need(setup, "setup").choices;
  return with_uncertainty(resolve_setup(choices, nullptr, &target.info, ChoiceNames::fields),
                          choices);
}

/// What an archive does not say: as the caller said, else from the printer.
MissingFacts missing_facts(const slicecorr_stack& stack, const Printer& printer) {
  MissingFacts m = stack.missing;
  const Grid& g = stack.info.grid;
  if (!(g.pixel_x_um > 0) && !(m.pixel_x_um > 0)) m.pixel_x_um = printer.pixel_x_um;
  if (!(g.pixel_y_um > 0) && !(m.pixel_y_um > 0)) m.pixel_y_um = printer.pixel_y_um;
  return m;
}

/// What is to be shown as it is sliced: files, and what lies outside of parts.
struct Beside {
  std::vector<std::string> files;
  PartsInside inside;
  bool empty() const { return files.empty() && inside.files.empty(); }
};

/// How the meshes of parts are turned and scaled.
Placement placement_of(const Choices& choices, const std::vector<std::string>& files) {
  Placement p;
  const bool said = !choices.units.empty() || choices.scale > 0 || choices.fit_mm > 0 ||
                    !choices.rotate_deg.empty();
  if (!said) return p;
  if (files.empty()) {
    throw InputError("units, scale, fit_mm and rotate_deg are for a part; expected part_inside");
  }
  if (choices.scale > 0 && choices.fit_mm > 0) {
    throw InputError("fit_mm and scale exclude each other; expected one of them");
  }
  if (!choices.units.empty()) p.units = units_named(choices.units);
  if (choices.scale > 0) p.scale = choices.scale;
  if (!choices.rotate_deg.empty()) {
    if (choices.rotate_deg.size() != 3) {
      throw InputError(fmt::format("rotate_deg has {} numbers; expected three, about x, y and z",
                                   choices.rotate_deg.size()));
    }
    std::copy(choices.rotate_deg.begin(), choices.rotate_deg.end(), p.rotate_deg.begin());
  }
  if (choices.fit_mm > 0) p.scale *= fit_scale(files, p, choices.fit_mm);
  return p;
}

Beside left_alone(const slicecorr_setup* setup) {
  Beside beside;
  if (!setup) return beside;
  const Choices& choices = setup->choices;
  if (!choices.leave_alone.empty()) beside.files = {choices.leave_alone};
  std::istringstream lines(choices.part_inside);
  for (std::string path; std::getline(lines, path);) {
    if (!path.empty()) beside.inside.files.push_back(path);
  }
  beside.inside.placement = placement_of(choices, beside.inside.files);
  return beside;
}

/// The images of a stack, read when they are not in memory, and with what is left alone beside them.
class Images {
 public:
  Images(const slicecorr_stack& stack, const Printer& printer, const std::string& folder,
         const ExecutionContext& context, const Beside& beside = {})
      : slices_(stack.slices), dose_images_(stack.doses) {
    if (!slices_) {
      reader_.emplace(stack.path, folder, context, missing_facts(stack, printer));
      check_unchanged(stack, reader_->info());
    }
    if (!beside.empty()) {
      left_alone_.emplace(own(), beside.files, MeshesLeftAlone{}, printer, folder, context,
                          beside.inside);
    }
    if (!dose_images_) return;
    doses_.images = dose_images_.get();
    doses_.scale = stack.dose_scale;
    name_ranges(doses_);
    graded_.emplace(ungraded(), doses_);
  }
  std::optional<std::uint64_t> pixel_sum() const {
    if (reader_ && !left_alone_) return reader_->pixel_sum();
    return std::nullopt;
  }
  const SliceSource& source() const { return graded_ ? *graded_ : ungraded(); }

 private:
  const SliceSource& own() const {
    return slices_ ? static_cast<const SliceSource&>(*slices_) : *reader_;
  }
  const SliceSource& ungraded() const { return left_alone_ ? **left_alone_ : own(); }
  std::shared_ptr<const SliceStore> slices_, dose_images_;
  std::optional<StackReader> reader_;
  std::optional<LeftAloneFiles> left_alone_;
  DoseTarget doses_;
  std::optional<GradedTarget> graded_;
};

/// A source on the way: sums its coverage, stops when the job is cancelled.
class Watched final : public SliceSource {
 public:
  Watched(const SliceSource& source, const ExecutionContext& context)
      : source_(source), context_(context) {}
  const Grid& grid() const override { return source_.grid(); }
  PixelBox bounds() const override { return source_.bounds(); }
  ImageFrame frame() const override { return source_.frame(); }
  LayerHeights heights() const override { return source_.heights(); }
  const Recording* recording() const override { return source_.recording(); }
  const DoseTarget* doses() const override { return source_.doses(); }
  const SliceSource* left_alone() const override { return source_.left_alone(); }
  void read_band(const PixelBox& band, const Sink& sink) const override {
    const auto size =
        static_cast<std::size_t>(band.width()) * static_cast<std::size_t>(band.height());
    std::uint64_t sum = 0;
    source_.read_band(band, [&](int n, const std::uint8_t* rows) {
      if ((n & 63) == 0) context_.check_cancelled();
      if (rows) sum = std::accumulate(rows, rows + size, sum);
      if (rows && !full_ && std::memchr(rows, 255, size)) full_ = true;
      sink(n, rows);
    });
    sum_ += sum;
  }
  std::uint64_t sum() const { return sum_; }
  /// Whether a voxel of coverage 1 was seen.
  bool full() const { return full_; }
  /// Sums from here on: what was read before was for planning.
  void begin() { sum_ = 0; }

 private:
  const SliceSource& source_;
  const ExecutionContext& context_;
  mutable std::atomic<std::uint64_t> sum_{0};
  mutable std::atomic<bool> full_{false};
};

/// All that a source shows, in pixels times grey values.
std::uint64_t sum_of(const SliceSource& source, const ExecutionContext& context) {
  const PixelBox box = source.bounds();
  const int rows_of_band = band_rows(source.grid());
  std::uint64_t sum = 0;
  for (int y = box.y0; y < box.y1; y += rows_of_band) {
    const PixelBox band{box.x0, y, box.x1, std::min(y + rows_of_band, box.y1)};
    const auto size =
        static_cast<std::size_t>(band.width()) * static_cast<std::size_t>(band.height());
    source.read_band(band, [&](int n, const std::uint8_t* rows) {
      if ((n & 63) == 0) context.check_cancelled();
      if (rows) sum = std::accumulate(rows, rows + size, sum);
    });
  }
  return sum;
}

void tell_notices(const Setup& setup, const slicecorr_stack& target,
                  const ExecutionContext& context) {
  for (const std::string& text : setup_notices(setup, &target.info, ChoiceNames::fields)) {
    context.tell(text);
  }
}

/// Where a stack goes: in the format that the path ends in, or in its own when it ends so, too, or
/// goes to where it came from. What else is in the archive is kept with `keep_others`, in the same
/// format.
StackFile output_file(const slicecorr_stack& stack, const char* path, bool keep_others) {
  StackFile file(&need(path, "path"));
  if (file.path.empty()) throw InputError("the path of the output is empty");
  if (!stack.path.empty()) {
    std::error_code none;
    bool own = std::filesystem::equivalent(file.path, stack.path, none);
    for (const FormatInfo& format : archive_formats()) {
      own |= format.name == stack.info.format &&
             std::any_of(format.endings.begin(), format.endings.end(),
                         [&](const std::string& ending) { return file.path.ends_with(ending); });
    }
    if (own) file.format = stack.info.format;
  }
  if (format_of(file) == stack.info.format && keep_others) file.keep_from = stack.path;
  return file;
}

std::vector<double> uv_of_pixel(const CureModel& model) {
  std::vector<double> table;
  if (!model.inhibited() || model.inhibited()->uv_levels().empty()) return table;
  const auto levels = static_cast<int>(model.level_phi.size());
  for (int v = 0; v < 256; ++v) {
    const auto level = static_cast<std::size_t>(level_of_pixel(v, levels));
    table.push_back(pixel_of_level(model.inhibited()->uv_levels()[level], levels));
  }
  return table;
}

struct InMemory {
  std::unique_ptr<slicecorr_stack> stack;
  std::unique_ptr<slicecorr_figures> after;
};

InMemory correct_in_memory(const slicecorr_stack& target, const slicecorr_setup* asked,
                           slicecorr_job* handle, bool with_after) {
  const ExecutionContext context = job_of(handle);
  const std::string folder = scratch_folder(handle);
  Setup setup = setup_for_target(target, asked);
  tell_notices(setup, target, context);
  const Images images(target, setup.printer, folder, context, left_alone(asked));
  const SliceSource& source = images.source();
  setup = setup_to_correct(source, std::move(setup), context);
  setup.process = schedule_uv(source, setup, context);
  Watched watched(source, context);
  const CorrectedSlices corrected(watched, setup, context);
  if (!corrected.kept()) watched.begin();
  InMemory result;
  result.stack = std::make_unique<slicecorr_stack>();
  slicecorr_stack& stack = *result.stack;
  stack.slices = keep_slices(corrected, "correct", folder, context);
  if (!watched.full()) slicecorr::detail::refuse_vanished(source);
  const PlaceModels models(setup.printer, setup.resin, setup.process, source.grid(),
                           source.frame());
  const CureModel& model = models.brightest();
  if (with_after || model.inhibited()) {
    const Prediction p = verify_stack(*stack.slices, source, setup, context);
    if (p.dead_zones) check_window(*p.dead_zones, setup.process);
    if (with_after) result.after = figures_of(p);
  }
  const Grid& g = source.grid();
  stack.info.grid = corrected.grid();
  stack.info.kind = StackKind::corrected;
  // It lies like the target it is made from.
  const ImageFrame frame = source.frame();
  stack.info.for_display = frame.to_display.has_value();
  stack.info.orientation_known = frame.orientation.has_value();
  stack.info.orientation = frame.orientation.value_or(Orientation{});
  stack.info.target_layers = g.layers;
  const std::uint64_t left = source.left_alone() ? sum_of(*source.left_alone(), context) : 0;
  // Sums of pixels tell volumes where layers are alike.
  stack.info.part_volume_mm3 = setup.process.layer_heights_um.empty()
                                   ? static_cast<double>(watched.sum() + left) / 255.0 *
                                         g.pixel_x_um * g.pixel_y_um * g.layer_um * 1e-9
                                   : 0.0;
  stack.info.program = std::string("slicecorr ") + version;
  stack.uv_of_pixel = uv_of_pixel(model);
  stack.info.printer = std::move(setup.printer);
  stack.info.resin = std::move(setup.resin);
  stack.info.process = std::move(setup.process);
  context.check_cancelled();
  return result;
}

/// What `stack` prints; of a target, too, with the UV light that its correction would choose.
Prediction verify(const slicecorr_stack& stack, const slicecorr_stack& target, Setup setup,
                  const Beside& beside, slicecorr_job* handle) {
  const ExecutionContext context = job_of(handle);
  const std::string folder = scratch_folder(handle);
  const bool uncorrected = &target == &stack;
  const Images shown(stack, setup.printer, folder, context, uncorrected ? beside : Beside());
  std::optional<Images> design;
  if (!uncorrected) {
    design.emplace(target, setup.printer, folder, context, beside);
    check_target(shown.source(), stack.info, design->source(), name_of(target), design->pixel_sum(),
                 context);
  }
  if (!design) setup.process = schedule_uv(shown.source(), setup, context);
  const AsSliced sliced(shown.source());
  Prediction p = design ? verify_stack(shown.source(), design->source(), setup, context)
                        : verify_stack(sliced, shown.source(), setup, context);
  context.check_cancelled();
  return p;
}

PrintPlan plan(const slicecorr_stack& target, const slicecorr_setup* asked, slicecorr_job* handle) {
  check_design(target.info, name_of(target));
  Choices choices = need(asked, "setup").choices;
  const bool layerwise = choices.mode == "layerwise";
  if (choices.speed_mm_h > 0 || choices.exposure_s > 0 || !choices.slice_speed_mm_h.empty()) {
    throw InputError(
        "a plan finds the speed, or the exposure; expected speed_mm_h, exposure_s and "
        "slice_speed_mm_h not to be set");
  }
  (layerwise ? choices.exposure_s : choices.speed_mm_h) = 1;
  const Setup setup = resolve_setup(choices, nullptr, &target.info, ChoiceNames::fields);
  PlanAsk ask;
  if (choices.tolerance_um > 0) ask.tolerance_um = choices.tolerance_um;
  if (choices.gap_contrast > 0) ask.gap_contrast = choices.gap_contrast;
  ask.stage = choices.printer_toml.empty()
                  ? load_stage_change(choices.printer)
                  : parse_stage_change(choices.printer_toml, "the printer");
  const ExecutionContext context = job_of(handle);
  tell_notices(setup, target, context);
  const Images images(target, setup.printer, scratch_folder(handle), context, left_alone(asked));
  return plan_print(images.source(), setup, ask, context);
}

std::string compare_with_scan(const std::string& scan, const slicecorr_stack& stack,
                              const Choices& choices, slicecorr_job* handle) {
  const ExecutionContext context = job_of(handle);
  if (stack.info.kind != StackKind::corrected) {
    throw InputError(name_of(stack), "",
                     "is no corrected stack; expected the one that was printed");
  }
  const Setup setup = resolve_setup(choices, &stack.info, &stack.info, ChoiceNames::fields);
  tell_notices(setup, stack, context);
  const Images images(stack, setup.printer, scratch_folder(handle), context);
  const SliceSource& shown = images.source();
  std::vector<ScanSurface> surfaces;
  if (!choices.design.empty()) {
    TriangleMesh design = on_plate(
        read_mesh(choices.design, placement_of(choices, {choices.design}), context), setup.printer);
    const int layers = stack.info.grid.layers;
    check_design_size(shown, stack_height_um(stack.info, layers) * 1e-3, design);
    surfaces.push_back({"design", std::move(design)});
  }
  const PlaceModels models(setup.printer, setup.resin, setup.process, shown.grid(), shown.frame());
  surfaces.push_back(
      {"predicted", predicted_surface(shown, models, kMostPredictedTriangles, context)});
  ScanAsk ask;
  if (!choices.scan_unit.empty()) ask.reading.unit = choices.scan_unit;
  ask.reading.voxel_um = choices.voxel_um;
  return compare_scan(scan, surfaces, ask, context).comparison.to_json();
}

}  // namespace

}  // namespace slicecorr::c_api

using namespace slicecorr::c_api;

slicecorr_status slicecorr_check(const slicecorr_stack* target, const slicecorr_setup* setup,
                                 slicecorr_job* handle) {
  return guarded(error_of(handle), [&] {
    const slicecorr_stack& t = need(target, "target");
    const slicecorr::ExecutionContext context = job_of(handle);
    const slicecorr::Setup s = setup_for_target(t, setup);
    slicecorr::Grid grid = t.info.grid;
    const slicecorr::MissingFacts missing = missing_facts(t, s.printer);
    if (missing.pixel_x_um > 0) grid.pixel_x_um = missing.pixel_x_um;
    if (missing.pixel_y_um > 0) grid.pixel_y_um = missing.pixel_y_um;
    if (missing.layer_um > 0) grid.layer_um = missing.layer_um;
    if (!(grid.layer_um > 0)) {
      throw slicecorr::InputError(name_of(t), "layer_um",
                                  "the archive does not say it; expected "
                                  "slicecorr_stack_set_number()");
    }
    tell_notices(s, t, context);
    const Beside beside = left_alone(setup);
    if (!slicecorr::light_is_uneven(s.printer, s.process) && !slicecorr::judges_suction(s) &&
        beside.empty()) {
      slicecorr::plan_correction(slicecorr::GridOnly(grid, slicecorr::image_frame(t.info)), s,
                                 context);
      return;
    }
    // Which places of an uneven display are lit is in the images alone, and so is how they pull, and
    // where a part lies among its supports.
    const Images images(t, s.printer, scratch_folder(handle), context, beside);
    slicecorr::plan_correction(images.source(), s, context);
    slicecorr::judge_suction(images.source(), s, context);
  });
}

slicecorr_status slicecorr_correct(const slicecorr_stack* target, const slicecorr_setup* setup,
                                   const char* path, slicecorr_job* handle,
                                   slicecorr_figures** after, slicecorr_figures** before) {
  return guarded(error_of(handle), [&] {
    if (after) *after = nullptr;
    if (before) *before = nullptr;
    const slicecorr_stack& t = need(target, "target");
    // Ours hold nothing else, but for those that a template made. What is in memory needs no file.
    const bool keeps = t.info.kind == slicecorr::StackKind::foreign ||
                       (!t.slices && slicecorr::keeps_settings(t.path, t.info));
    slicecorr::StackFile file = output_file(t, path, keeps);
    const slicecorr::ExecutionContext context = job_of(handle);
    const slicecorr::Setup s = setup_for_target(t, setup);
    if (!(s.printer.travel_mm > 0)) file.machine_height_mm = t.info.machine_height_mm;
    const bool continuous = need(setup, "setup").choices.mode == "continuous";
    slicecorr::check_lifts(file, s.process, continuous, slicecorr::ChoiceNames::fields);
    tell_notices(s, t, context);
    const Images images(t, s.printer, scratch_folder(handle, file.path), context,
                        left_alone(setup));
    slicecorr::tell_even_greys(images.source(), t.info.kind, context);
    const slicecorr::Correction done =
        slicecorr::correct_stack(images.source(), s, file, {.before = before != nullptr}, context);
    auto figures_after = after ? figures_of(done.after) : nullptr;
    if (before) *before = figures_of(*done.before).release();
    if (after) *after = figures_after.release();
  });
}

slicecorr_status slicecorr_correct_in_memory(const slicecorr_stack* target,
                                             const slicecorr_setup* setup, slicecorr_job* job,
                                             slicecorr_stack** corrected,
                                             slicecorr_figures** after) {
  return guarded(error_of(job), [&] {
    if (after) *after = nullptr;
    Output output(corrected, "corrected");
    InMemory made = correct_in_memory(need(target, "target"), setup, job, after != nullptr);
    output.give(std::move(made.stack));
    if (after) *after = made.after.release();
  });
}

slicecorr_status slicecorr_correct_slices(const slicecorr_grid* grid, slicecorr_slice_source source,
                                          void* source_user, const slicecorr_setup* setup,
                                          slicecorr_job* job, slicecorr_slice_sink sink,
                                          void* sink_user, slicecorr_figures** after) {
  return guarded(error_of(job), [&] {
    if (after) *after = nullptr;
    need(source, "source");
    need(sink, "sink");
    slicecorr_stack* created = nullptr;
    const slicecorr_status status = slicecorr_stack_create(grid, &created);
    const std::unique_ptr<slicecorr_stack> target(created);
    if (status == SLICECORR_BAD_INPUT) throw slicecorr::InputError(slicecorr_error_text());
    if (status != SLICECORR_OK) throw BadCall(slicecorr_error_text());

    const slicecorr::ExecutionContext running = job_of(job);
    const auto size =
        static_cast<std::size_t>(grid->width_px) * static_cast<std::size_t>(grid->height_px);
    std::vector<std::uint8_t> pixels(size);
    // A callback's own exceptions must not look like errors of the library.
    const auto stop_if = [](auto&& call) {
      int stop = 0;
      try {
        stop = call();
      } catch (...) {
        throw BadCall("a callback threw an exception");
      }
      if (stop != 0) throw slicecorr::Cancelled();
    };
    for (int n = 0; n < grid->layers; ++n) {
      running.check_cancelled();
      std::fill(pixels.begin(), pixels.end(), std::uint8_t{0});
      stop_if([&] { return source(source_user, n, pixels.data()); });
      target->slices->put(n, pixels.data(), grid->width_px);
    }
    InMemory made = correct_in_memory(*target, setup, job, after != nullptr);
    const int slices = made.stack->info.grid.layers;
    for (int n = 0; n < slices; ++n) {
      running.check_cancelled();
      made.stack->slices->get(n, pixels.data(), grid->width_px);
      stop_if([&] { return sink(sink_user, n, slices, pixels.data()); });
    }
    if (after) *after = made.after.release();
  });
}

slicecorr_status slicecorr_verify(const slicecorr_stack* stack, const slicecorr_stack* target,
                                  const slicecorr_setup* setup, slicecorr_job* job,
                                  slicecorr_figures** figures) {
  return guarded(error_of(job), [&] {
    Output output(figures, "figures");
    const slicecorr_stack& shown = need(stack, "stack");
    const slicecorr_stack& design = need(target, "target");
    slicecorr::check_design(design.info, name_of(design));
    const Choices choices = setup ? setup->choices : Choices{};
    const slicecorr::Setup s = with_uncertainty(
        slicecorr::resolve_setup(choices, &shown.info, &shown.info, slicecorr::ChoiceNames::fields),
        choices);
    output.give(figures_of(verify(shown, design, s, left_alone(setup), job)));
  });
}

slicecorr_status slicecorr_predict(const slicecorr_stack* target, const slicecorr_setup* setup,
                                   slicecorr_job* job, slicecorr_figures** figures) {
  return guarded(error_of(job), [&] {
    Output output(figures, "figures");
    const slicecorr_stack& t = need(target, "target");
    output.give(figures_of(verify(t, t, setup_for_target(t, setup), left_alone(setup), job)));
  });
}

slicecorr_status slicecorr_scan_compare(const char* scan, const slicecorr_stack* stack,
                                        const slicecorr_setup* setup, slicecorr_job* job,
                                        slicecorr_figures** figures) {
  return guarded(error_of(job), [&] {
    Output output(figures, "figures");
    need(scan, "scan");
    output.give(figures_of(
        compare_with_scan(scan, need(stack, "stack"), setup ? setup->choices : Choices{}, job)));
  });
}

slicecorr_status slicecorr_plan(const slicecorr_stack* target, const slicecorr_setup* setup,
                                slicecorr_job* job, slicecorr_figures** figures) {
  return guarded(error_of(job), [&] {
    Output output(figures, "figures");
    output.give(figures_of(plan(need(target, "target"), setup, job).to_json()));
  });
}

slicecorr_status slicecorr_convert(const slicecorr_stack* stack, const char* path,
                                   slicecorr_job* handle) {
  return guarded(error_of(handle), [&] {
    const slicecorr_stack& s = need(stack, "stack");
    const slicecorr::StackFile file = output_file(s, path, !s.path.empty());
    const slicecorr::ExecutionContext context = job_of(handle);
    if (!s.path.empty()) {
      const slicecorr::StackReader reader(s.path, scratch_folder(handle, file.path), context,
                                          s.missing);
      slicecorr::convert_stack(reader, file, context);
    } else if (s.info.kind == slicecorr::StackKind::target) {
      slicecorr::write_target(*s.slices, file, context);
    } else {
      throw BadCall("a stack corrected in memory has no archive; expected slicecorr_correct()");
    }
  });
}
