// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "commands.hpp"
#include "programs/common/database_band.hpp"
#include "programs/common/make_part.hpp"
#include "slicecorr/assumed_light.hpp"
#include "slicecorr/bodies.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/first_slices.hpp"
#include "slicecorr/light_spreads.hpp"
#include "slicecorr/report.hpp"
#include "slicecorr/same_light.hpp"
#include "slicecorr/solid.hpp"
#include "slicecorr/turned.hpp"
#include "slicecorr/version.hpp"
#include "support/json/read_json.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::cli::commands {

namespace {

/// `a` with the target that `run` left beside the stack, where none is named, and what it left alone. Throws
/// `InputError`, saying how to come by one.
Arguments with_target(Arguments a) {
  namespace fs = std::filesystem;
  const bool its_own = a.target.empty() || a.target == target_beside(a.input);
  if (const std::string kept = left_alone_beside(a.input);
      its_own && a.leave_alone.empty() && a.inside.empty() && fs::exists(kept)) {
    a.leave_alone = {kept};
  }
  const std::string left = target_beside(a.input);
  if (!a.target.empty()) {
    if (fs::exists(a.target) || !fs::exists(left)) return a;
    throw InputError(
        a.target, "",
        fmt::format("there is no such file; {} lies beside the stack: leave --target out", left));
  }
  // What is no stack says so itself.
  if (!fs::exists(a.input)) return a;
  a.target = left;
  if (fs::exists(left)) return a;
  StackReader::read_info(a.input);  // what can't be read says that before anything is asked for
  if (const std::string kept = a.input + ".orig"; fs::exists(kept)) {
    throw InputError(
        a.input, "",
        fmt::format(
            "is measured against the design, and {} is not there; {} lies beside the stack, the "
            "slicer's file that `slicecorr-post` kept: expected --target {}",
            left, kept, kept));
  }
  throw InputError(
      a.input, "",
      fmt::format(
          "is measured against the design, and {} is not there; expected --target STACK, the "
          "stack of `slicecorr slice` that it was corrected from. `slicecorr run` leaves it "
          "beside what it makes; of the mesh, with the placement that it had: `slicecorr slice "
          "PART.stl -o {} --printer P --layer-um H`",
          left, left));
}

/// A stack and the target that it was made for, in the stack's grid: checked against each other.
/// Unpacks in the folders that it is given.
struct StackAndDesign {
  StackAndDesign(const Arguments& a, const std::string& folder, const std::string& target_folder,
                 const ExecutionContext& context)
      : stack(a.open(a.input, folder, context)),
        setup(a.uncertain.put(a.setup.resolve(&stack.info(), &stack.info()), a.setup)),
        exposures(stack.exposures(setup.resin.m)),
        read(a.open(design(a.target), target_folder, context)),
        fitted(FittedSlices::like(stack, read, target_folder, context)),
        target(*fitted, a.leave_alone, {}, setup.printer, target_folder, context,
               parts_inside(a.inside, a.mesh)) {
    for (const std::string& text :
         definition_notices(setup.printer, setup.resin, setup.process.uv.kind != UvKind::off)) {
      context.tell(text);
    }
    for (const std::string& text : other_than_made(setup, stack.info(), ChoiceNames::options)) {
      context.tell(text);
    }
    for (const std::string& text : choices_past(a.setup, stack.info(), ChoiceNames::options)) {
      context.tell(text);
    }
    const AssumedLight assumed = setup.process.assumed;
    if (assumed != AssumedLight::none) {
      context.tell(assumption_in_words(setup.printer, setup.resin, setup.process));
    }
    tell_database_band(setup.resin, context, assumed);
    const bool all = a.leave_alone.empty() && a.inside.empty();
    check_target(stack, stack.info(), *target, a.target,
                 all ? std::optional(read.pixel_sum()) : std::nullopt, context);
  }
  StackAndDesign(const StackAndDesign&) = delete;
  StackAndDesign& operator=(const StackAndDesign&) = delete;

  /// What is shown: of layers that are exposed more than once each exposure.
  const SliceSource& shown() const { return exposures ? *exposures : stack; }

  const StackReader stack;
  const Setup setup;
  const std::unique_ptr<const SliceSource> exposures;
  const StackReader read;
  const FittedSlices fitted;
  const LeftAloneFiles target;
};

/// What a stack prints, and what its slices light.
Prediction verified(const StackAndDesign& given, const SliceSource& target,
                    const ExecutionContext& context) {
  Prediction p = verify_stack(given.shown(), target, given.setup, context);
  // Images of a recording are no slices, and those of several exposures not all of a layer's.
  if (!given.shown().recording()) {
    p.areas =
        std::make_shared<const LayerAreas>(lit_areas(given.stack, &given.setup.printer, context));
  }
  return p;
}

/// The reduction that makes a mesh which other programs open with ease. Says how large it will be.
int handy_reduction(const Arguments& a, const SliceSource& stack, const PlaceModels& models,
                    const ExecutionContext& context) {
  constexpr double kHandy = 1e6;
  const SolidSize size = size_of_solid(stack, models, context);
  const int reduce = size.reduction(kHandy);
  const auto in_words = [&](double triangles) {
    std::string text = fmt::format("{:.2g} million triangles", triangles * 1e-6);
    // Bytes of a triangle: an STL's record; of a PLY's faces and half as many vertices.
    const double bytes = a.output.ends_with(".stl") ? 50 : a.output.ends_with(".ply") ? 19 : 0;
    if (bytes > 0) text += ", " + text::bytes(bytes * triangles);
    return text;
  };
  if (reduce > 1) {
    context.tell(fmt::format(
        "{} takes one pixel in {} along x and y: some {} (--reduce 1 would make some {}); volume and "
        "distances are measured on the whole surface all the same",
        a.output, reduce, in_words(size.triangles(reduce)), in_words(size.triangles(1))));
  }
  return reduce;
}

/// The comparison as the report shows it.
ComparisonTable table_of(const std::vector<Figures>& columns) {
  ComparisonTable table;
  table.columns = {"Method",     "mean error", "95 % within", "largest", "cured through",
                   "undercured", "lost",       "merged",      "overlap"};
  for (const Figures& c : columns) {
    const Prediction& p = *c.prediction;
    const auto edge = [&](double um) {
      return p.design_error_um().count() ? fmt::format("{:.2f} um", um) : std::string("-");
    };
    table.rows.push_back(
        {c.heading, edge(p.design_error_um().mean()), edge(p.design_error_um().quantile(0.95)),
         edge(p.design_error_um().greatest()), fmt::format("{}", p.cure_through_voxels),
         fmt::format("{}", p.undercure_voxels), fmt::format("{}", p.lost_features),
         fmt::format("{}", p.merged_features), fmt::format("{:.5f}", p.iou())});
  }
  table.note =
      "Height errors at designed edges, from the mesh where its heights are known; voxels cured through and undercured; features lost and "
      "gaps merged, by column. Erase: the first N slices next to a gap are left out, with the N "
      "that is best for this part. Z comp.: PrusaSlicer's Z compensation, where each slice keeps what "
      "the N before it have, too. Grey table: 25, 15, 10, 5 are taken off where the next four "
      "slices are lit.";
  return table;
}

/// What of a print hangs on nothing, and what it traps.
void tell_bodies(const Prediction& p, const ExecutionContext& context) {
  if (!p.bodies) return;
  for (const std::string& sentence : bodies_in_words(*p.bodies)) context.tell(sentence);
}

/// The bodies of what a stack prints, whatever its design; nothing of a recording.
std::optional<Bodies> printed_bodies(const StackReader& stack, const Setup& setup,
                                     const ExecutionContext& context) {
  if (stack.recording()) return {};
  ExecutionContext quiet = context;
  quiet.notice = {};
  Setup judged = setup;
  judged.uncertainty.reset();
  const Prediction p = verify_stack(stack, AsSliced(stack), judged, quiet);
  if (!p.bodies) return {};
  return p.bodies->printed;
}

}  // namespace

int verify(const Arguments& asked, const ExecutionContext& context, Console& console) {
  check_placement(asked, names_meshes(asked));
  const Arguments a = with_target(asked);
  check_output(a.json, {a.input, a.target});
  check_output(a.output, {a.input, a.target});
  check_output(a.uncertain.map, {a.input, a.target});
  const StackAndDesign given(a, folder_of(a.input), folder_of(a.target), context);
  tell_even_oxygen(given.stack.info(), context);
  const WantedDoses wanted(a.doses, *given.target, given.setup.printer, a.mesh, nullptr,
                           a.missing(), folder_of(a.target), context);
  const Prediction p = verified(given, *wanted, context);
  std::optional<FirstSlices> first;
  if (given.setup.process.even_light) {
    first = follow_first_slices(given.stack, FlowPixels::light, given.setup, context);
  }
  if (!a.output.empty()) {
    const double scale_um = 0.5 * given.stack.grid().layer_um;
    const auto png = encode_png(side_by_side(surface_picture(*p.maps, true, scale_um),
                                             surface_picture(*p.maps, false, scale_um)));
    write_text_file(a.output, {png.begin(), png.end()});
    context.tell(fmt::format(
        "{}: left from below, right from above; red: {:.3g} um and more too far, blue: so much is "
        "missing, white: right, beside the part, or on the platform",
        a.output, scale_um));
  }
  a.uncertain.write_map(p, console);
  if (a.json.empty()) {
    print_result(summary(p, std::nullopt) +
                 lifts_line(given.stack.info().format, given.setup.process));
  } else {
    auto figures = slicecorr::detail::own_json<nlohmann::ordered_json>(figures_json(p));
    if (first) {
      figures["first_slices"]["slices"] = first->slices;
      figures["first_slices"]["prints"] =
          first->slices > 0 ? nlohmann::ordered_json(!first->sticks) : nlohmann::ordered_json();
      if (first->sticks) {
        figures["first_slices"]["sticks"] = {{"slice", first->sticks->slice},
                                             {"seconds", first->sticks->seconds},
                                             {"x_mm", first->sticks->x_mm},
                                             {"y_mm", first->sticks->y_mm}};
      }
    }
    print_or_write(a.json, first ? figures.dump(2) : figures_json(p));
  }
  if (first) context.tell(first->in_words());
  tell_bodies(p, context);
  bool missed = false;
  const auto limit = [&](const char* name, const Histogram& errors, double most_um) {
    if (most_um < 0 || errors.count() == 0 || errors.greatest() <= most_um) return;
    write_stderr(fmt::format("slicecorr: largest {} error {:.3f} um, allowed are {:g} um\n", name,
                             errors.greatest(), most_um));
    missed = true;
  };
  limit("height", p.height_error_um, a.max_height_error_um);
  limit("surface", p.surface_error_um, a.max_surface_error_um);
  const std::uint64_t loose = p.bodies ? p.bodies->printed.loose_bodies : 0;
  if (a.max_loose_bodies >= 0 && loose > static_cast<std::uint64_t>(a.max_loose_bodies)) {
    write_stderr(
        fmt::format("slicecorr: {} on the platform, allowed are {}\n",
                    loose == 1 ? "1 body never hangs" : fmt::format("{} bodies never hang", loose),
                    a.max_loose_bodies));
    missed = true;
  }
  return missed ? kMissed : kDone;
}

int probe(const Arguments& asked, const ExecutionContext& context, Console&) {
  // What `run` left adds no column that nobody asked for.
  const Arguments a = asked.target.empty() ? asked : with_target(asked);
  const StackReader stack = a.open(a.input, folder_of(a.input), context);
  const Setup setup = a.setup.resolve(&stack.info(), &stack.info());
  std::optional<StackReader> read;
  std::optional<FittedSlices> target;
  if (!a.target.empty()) {
    read.emplace(design(a.target), folder_of(a.target), context, a.missing());
    target.emplace(FittedSlices::like(stack, *read, folder_of(a.target), context));
    check_target(stack, stack.info(), **target, a.target, read->pixel_sum(), context);
  }
  const std::unique_ptr<const SliceSource> exposures = stack.exposures(setup.resin.m);
  const SliceSource& shown = exposures ? *exposures : stack;
  const auto rows = probe_stack(shown, target ? &**target : nullptr, setup, a.x, a.y);
  std::string text =
      fmt::format("slice,z_um,grey,intensity_mw_cm2,phi,dose{}\n", target ? ",target" : "");
  for (const ProbeRow& r : rows) {
    text += fmt::format("{},{},{},{},{},{}", r.slice, r.z_um, r.grey, r.intensity_mw_cm2, r.phi,
                        r.dose);
    if (target) text += fmt::format(",{}", r.target);
    text += "\n";
  }
  print_result(text);
  return kDone;
}

int report(const Arguments& asked, const ExecutionContext& context, Console& console) {
  check_placement(asked, names_meshes(asked));
  const Arguments a = with_target(asked);
  check_output(a.output, {a.input, a.target});
  const StackAndDesign given(a, folder_of(a.output), folder_of(a.output), context);
  const StackReader& stack = given.stack;
  tell_even_oxygen(stack.info(), context);
  const WantedDoses wanted(a.doses, *given.target, given.setup.printer, a.mesh, nullptr,
                           a.missing(), folder_of(a.output), context);
  const SliceSource& target = *wanted;
  const Prediction after = verified(given, target, context);
  tell_bodies(after, context);
  const AsSliced uncorrected(*given.target);
  const Prediction before = verify_stack(uncorrected, *given.target, given.setup, context);
  const StackInfo& info = stack.info();
  write_text_file(a.output, make_report(gather_report(given.shown(), target, given.setup, info,
                                                      after, before, title_of(a.input), context),
                                        context));
  console.say(fmt::format("{}: written\n{}", a.output,
                          summary(after, before) + lifts_line(info.format, given.setup.process)));
  return kDone;
}

int section(const Arguments& asked, const ExecutionContext& context, Console& console) {
  const Arguments a = with_target(asked);
  check_output(a.output, {a.input, a.target});
  const bool svg = ending_of(a.output, {".png", ".svg"}) == ".svg";
  const StackAndDesign given(a, folder_of(a.output), folder_of(a.output), context);
  const StackReader& stack = given.stack;
  const SliceSource& target = *given.target;
  const PixelBox box = target.bounds();
  const int row = a.y >= 0 ? a.y : (box.y0 + box.y1) / 2;
  const Grid& g = stack.grid();
  const std::string where = row_in_words(stack, row);
  write_text_file(
      a.output,
      section_sheet(section_of(target, target, given.setup, row),
                    section_of(given.shown(), target, given.setup, row), g.pixel_x_um, g.layer_um,
                    fmt::format("{}: {}; platform up", title_of(a.input), where), svg));
  console.say(fmt::format(
      "{}: section at {}, platform up; left as sliced, right this stack; grey is right, "
      "red cured through, blue undercured",
      a.output, where));
  return kDone;
}

int solid(const Arguments& a, const ExecutionContext& context, Console& console) {
  check_placement(a, !a.mesh.parts.empty());
  std::vector<std::string> inputs = a.mesh.parts;
  inputs.insert(inputs.end(), {a.input, a.target});
  check_output(a.output, inputs);
  check_output(a.json, inputs);
  const StackReader stack = a.open(a.input, folder_of(a.output), context);
  const Setup setup = a.setup.resolve(&stack.info(), &stack.info());
  const Grid& g = stack.grid();
  const PlaceModels models(setup.printer, setup.resin, setup.process, g, stack.frame());
  std::optional<MeshDistance> design_mesh;
  if (!a.mesh.parts.empty()) {
    const TriangleMesh placed = on_plate(read_parts(a.mesh, context).mesh, setup.printer,
                                         a.mesh.slice_options(Surface::slices).center_mm);
    check_design_size(stack, stack_height_um(stack.info(), g.layers) * 1e-3, placed);
    design_mesh.emplace(placed);
  }
  nlohmann::ordered_json figures;
  if (!a.target.empty()) {
    const StackReader target = a.open(design(a.target), folder_of(a.output), context);
    const FittedSlices fitted = FittedSlices::like(stack, target, folder_of(a.output), context);
    const bool all = !std::filesystem::exists(left_alone_beside(a.input));
    check_target(stack, stack.info(), *fitted, a.target,
                 all ? std::optional(target.pixel_sum()) : std::nullopt, context);
    const bool alike = target.info().layer_heights_um.empty();
    figures["design_volume_mm3"] = !alike ? coverage_mm3(target, context)
                                          : static_cast<double>(target.pixel_sum()) / 255.0 *
                                                g.pixel_x_um * g.pixel_y_um * g.layer_um * 1e-9;
  }
  const MeshDistance* const measured_to = design_mesh ? &*design_mesh : nullptr;
  const int chosen = a.reduce > 0 ? 0 : handy_reduction(a, stack, models, context);
  // A reduction that nobody asked for thins the mesh out, and nothing that is measured.
  const bool whole = chosen > 1;
  const SolidOptions options{whole ? chosen : std::max(1, a.reduce), whole ? nullptr : measured_to};
  const std::unique_ptr<const SliceSource> exposures = stack.exposures(setup.resin.m);
  const SliceSource& shown = exposures ? *exposures : stack;
  SolidReport r = write_solid(shown, models, a.output, options, context);
  if (whole) {
    const std::uint64_t triangles = r.triangles;
    r = measure_solid(shown, models, {1, measured_to}, context);
    r.triangles = triangles;
  }
  console.say(
      fmt::format("{}: {} triangles, {:.4f} mm³, from {:.3f}, {:.3f}, {:.3f} to {:.3f}, {:.3f}, "
                  "{:.3f} mm",
                  a.output, r.triangles, r.volume_mm3, r.lower[0], r.lower[1], r.lower[2],
                  r.upper[0], r.upper[1], r.upper[2]));
  if (!light_spreads(setup.printer, setup.resin, setup.process)) {
    console.say(fmt::format(
        "walls of the surface lie where the dose, drawn straight from pixel to pixel, is 1: as far as half "
        "a pixel ({:g} um) outside of where light ends, and the volume is as much above that of what prints",
        std::max(g.pixel_x_um, g.pixel_y_um) / 2));
  }
  if (figures.contains("design_volume_mm3")) {
    console.say(
        fmt::format("design as sliced: {:.4f} mm³", figures["design_volume_mm3"].get<double>()));
  }
  const std::optional<Bodies> bodies = printed_bodies(stack, setup, context);
  if (bodies) {
    for (const std::string& sentence : bodies_in_words(*bodies)) context.tell(sentence);
  }
  const Histogram& d = r.distance_um;
  if (d.count()) {
    console.say(
        fmt::format("distance to the design: mean {:.3f} um, 95 % within {:.3f} um, largest {:.3f} "
                    "um, at {} vertices of the whole surface, walls and the steps of pixels "
                    "included; the height errors of verify are those of edges along z alone",
                    d.mean(), d.quantile(0.95), d.greatest(), d.count()));
  }
  if (!a.json.empty()) {
    figures["triangles"] = r.triangles;
    figures["volume_mm3"] = r.volume_mm3;
    figures["lower_mm"] = r.lower;
    figures["upper_mm"] = r.upper;
    figures["reduce"] = options.reduce;
    if (d.count()) {
      figures["distance_um"] = {{"mean_abs", d.mean()},
                                {"p95_abs", d.quantile(0.95)},
                                {"max_abs", d.greatest()},
                                {"vertices", d.count()}};
    }
    if (bodies) {
      figures.update(slicecorr::detail::own_json<nlohmann::ordered_json>(bodies->to_json()));
    }
    print_or_write(a.json, figures.dump(2));
  }
  return kDone;
}

int compare(const Arguments& a, const ExecutionContext& context, Console& console) {
  check_output(a.json, a.mesh.parts);
  check_output(a.output, a.mesh.parts);
  SetupOptions chosen = a.setup;
  chosen.layer_um = a.mesh.layer_um;
  Setup setup = chosen.resolve(nullptr, nullptr);
  tell_notices(setup, nullptr, context);
  tell_database_band(chosen.resin, context, setup.process.assumed);
  MeshOptions mesh = a.mesh;
  mesh.shrinkage = setup.resin.shrinkage;
  tell_heights_left_out(setup, chosen.wanted_surface(), context);
  const MeshSlices target = slice_parts(mesh, setup.printer, setup.process.surface, context);
  setup.process = schedule_uv(target, setup, context);
  const Comparison c = compare_methods(target, setup, context);
  if (!a.json.empty()) {
    // Only erase and Z compensation have an N; the key is there for every method.
    nlohmann::ordered_json json;
    const auto add = [&](const char* method, const Prediction& p) {
      json[method] = slicecorr::detail::own_json<nlohmann::ordered_json>(p.to_json());
      json[method]["best_n"] = nullptr;
    };
    add("uncorrected", c.uncorrected);
    add("erase", c.erase);
    add("z_compensation", c.z_compensation);
    add("table", c.table);
    if (c.to_slices) add("ours_to_slices", *c.to_slices);
    add("ours", c.ours);
    json["erase"]["best_n"] = c.best_n;
    json["z_compensation"]["best_n"] = c.best_z;
    print_or_write(a.json, json.dump(2));
  }
  std::vector<Figures> columns = {{"uncorrected", &c.uncorrected},
                                  {fmt::format("erase, N = {}", c.best_n), &c.erase},
                                  {fmt::format("Z comp., N = {}", c.best_z), &c.z_compensation},
                                  {"grey table", &c.table}};
  if (c.to_slices) columns.push_back({"corrected to slices", &*c.to_slices});
  columns.push_back({"corrected", &c.ours});
  if (a.json != "-") print_result(figures_table(columns));
  if (!a.output.empty()) {
    const CorrectedSlices corrected(target, setup, context);
    StackInfo info;
    info.grid = corrected.grid();
    info.target_layers = target.grid().layers;
    info.program = std::string("slicecorr ") + version;
    ReportContent content = gather_report(corrected, target, setup, info, c.ours, c.uncorrected,
                                          title_of(a.output), context);
    content.comparison = table_of(columns);
    write_text_file(a.output, make_report(content, context));
    console.say(fmt::format("{}: written", a.output));
  }
  return kDone;
}

}  // namespace slicecorr::cli::commands
