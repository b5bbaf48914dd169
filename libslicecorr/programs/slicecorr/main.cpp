// The program `slicecorr`: parses, calls the library and prints.

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>

#include "beams.hpp"
#include "examples.hpp"
#include "flow.hpp"
#include "hand_over.hpp"
#include "hologram.hpp"
#include "options.hpp"
#include "oxygen.hpp"
#include "pattern.hpp"
#include "plan.hpp"
#include "programs/common/dose_options.hpp"
#include "programs/common/make_part.hpp"
#include "programs/common/uncertain_options.hpp"
#include "simulate.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/load_display.hpp"
#include "slicecorr/print_file.hpp"
#include "slicecorr/report.hpp"
#include "slicecorr/solid.hpp"
#include "slicecorr/turned.hpp"
#include "slicecorr/version.hpp"
#include "support/text/display_text.hpp"
#include "test_part.hpp"
#include "tomo.hpp"

namespace slicecorr::cli {
namespace {

/// Options of all subcommands; only those of the one called are filled.
struct Arguments {
  MeshOptions mesh;
  SetupOptions setup;
  UncertainOptions uncertain;
  DoseOptions doses;
  OxygenOptions oxygen;
  SimulateOptions simulate;
  std::string input, output, format, target, json, kept;
  std::vector<std::string> leave_alone;
  double layer_um = 0;
  int x = -1, y = -1, reduce = 0;
  double max_height_error_um = -1, max_surface_error_um = -1;
  bool archive = false;

  StackFile file() const {
    StackFile f(output);
    f.format = format;
    f.archive = archive;
    return f;
  }
  /// What archives that do not say it are told.
  MissingFacts missing() const {
    MissingFacts facts;
    facts.layer_um = layer_um;
    if (!setup.printer.empty()) {
      const Printer p = load_display(setup.printer);
      facts.pixel_x_um = p.pixel_x_um;
      facts.pixel_y_um = p.pixel_y_um;
    }
    return facts;
  }
  /// `paths`, and the files of what is left alone.
  std::vector<std::string> with_left_alone(std::vector<std::string> paths) const {
    paths.insert(paths.end(), leave_alone.begin(), leave_alone.end());
    return paths;
  }
  StackReader open(const std::string& path, const std::string& scratch,
                   const ExecutionContext& context) const {
    return {path, scratch, context, missing()};
  }
};

int slice(const Arguments& a, const ExecutionContext& context, Console& console) {
  format_of(a.file());
  check_output(a.output, a.mesh.parts);
  const Printer printer = load_display(a.setup.printer);
  const MeshSlices slices = slice_parts(a.mesh, printer, a.setup.wanted_surface(), context);
  const FittedSlices fitted = fit_for_output(slices, a.file(), printer, context);
  const StackInfo info = write_target(*fitted, a.file(), context);
  console.say(fmt::format("{}: {} slices, {:.4f} ml", a.output, info.grid.layers,
                          info.part_volume_mm3 * 1e-3));
  return kDone;
}

int correct(const Arguments& a, const ExecutionContext& context, Console& console) {
  StackFile file = a.file();
  check_output(a.output, a.with_left_alone({a.input}));
  check_output(a.output, a.doses.inputs());
  const StackInfo times = StackReader::read_info(design(a.input));
  file.format = format_of(file, times.format);
  const Setup setup = a.uncertain.put(a.setup.resolve(nullptr, &times), a.setup);
  tell_notices(setup, &times, context);
  // What a slicer wrote besides the slices stays.
  if (times.kind == StackKind::foreign && times.format == file.format) file.keep_from = a.input;
  const StackReader target = a.open(a.input, folder_of(a.output), context);
  const FittedSlices fitted = fit_for_output(target, file, setup.printer, context);
  const LeftAloneFiles part(*fitted, a.leave_alone, {}, setup.printer, folder_of(a.output),
                            context);
  const WantedDoses wanted(a.doses, *part, setup.printer, a.mesh, nullptr, a.missing(),
                           folder_of(a.output), context);
  const CorrectionAsk ask{.before = !console.quiet()};
  if (a.oxygen.even) {
    const OxygenCorrection even = with_dose_words(setup, [&] {
      return correct_even_oxygen(*wanted, setup, file, ask, a.oxygen.ask, context);
    });
    const Correction& c = even.correction;
    console.say(fmt::format("{}: {} slices\n{}{}", a.output, c.info.grid.layers,
                            summary(c.after, c.before), oxygen_in_words(even.oxygen)));
    return kDone;
  }
  const Correction result =
      with_dose_words(setup, [&] { return correct_stack(*wanted, setup, file, ask, context); });
  console.say(fmt::format("{}: {} slices\n{}", a.output, result.info.grid.layers,
                          summary(result.after, result.before)));
  return kDone;
}

/// A stack and the target that it was made for, in the stack's grid: checked against each other.
/// Unpacks in the folders that it is given.
struct StackAndDesign {
  StackAndDesign(const Arguments& a, const std::string& folder, const std::string& target_folder,
                 const ExecutionContext& context)
      : stack(a.open(a.input, folder, context)),
        setup(a.uncertain.put(a.setup.resolve(&stack.info(), &stack.info()), a.setup)),
        read(a.open(design(a.target), target_folder, context)),
        fitted(FittedSlices::like(stack, read, target_folder, context)),
        target(*fitted, a.leave_alone, {}, setup.printer, target_folder, context) {
    const bool all = a.leave_alone.empty();
    check_target(stack, stack.info(), *target, a.target,
                 all ? std::optional(read.pixel_sum()) : std::nullopt, context);
  }
  StackAndDesign(const StackAndDesign&) = delete;
  StackAndDesign& operator=(const StackAndDesign&) = delete;

  const StackReader stack;
  const Setup setup;
  const StackReader read;
  const FittedSlices fitted;
  const LeftAloneFiles target;
};

int verify(const Arguments& a, const ExecutionContext& context, Console& console) {
  check_output(a.json, {a.input, a.target});
  check_output(a.output, {a.input, a.target});
  check_output(a.uncertain.map, {a.input, a.target});
  const StackAndDesign given(a, folder_of(a.input), folder_of(a.target), context);
  tell_even_oxygen(given.stack.info(), context);
  const WantedDoses wanted(a.doses, *given.target, given.setup.printer, a.mesh, nullptr,
                           a.missing(), folder_of(a.target), context);
  const Prediction p = verify_stack(given.stack, *wanted, given.setup, context);
  if (!a.output.empty()) {
    const double scale_um = 0.5 * given.stack.grid().layer_um;
    const auto png = encode_png(side_by_side(surface_picture(*p.maps, true, scale_um),
                                             surface_picture(*p.maps, false, scale_um)));
    write_text_file(a.output, {png.begin(), png.end()});
  }
  a.uncertain.write_map(p, console);
  if (a.json.empty()) {
    print_result(summary(p, std::nullopt));
  } else {
    print_or_write(a.json, p.to_json());
  }
  bool missed = false;
  const auto limit = [&](const char* name, const Histogram& errors, double most_um) {
    if (most_um < 0 || errors.count() == 0 || errors.greatest() <= most_um) return;
    write_stderr(fmt::format("slicecorr: largest {} error {:.3f} um, allowed are {:g} um\n", name,
                             errors.greatest(), most_um));
    missed = true;
  };
  limit("height", p.height_error_um, a.max_height_error_um);
  limit("surface", p.surface_error_um, a.max_surface_error_um);
  return missed ? kMissed : kDone;
}

int probe(const Arguments& a, const ExecutionContext& context, Console&) {
  const StackReader stack = a.open(a.input, folder_of(a.input), context);
  const Setup setup = a.setup.resolve(&stack.info(), &stack.info());
  std::optional<StackReader> read;
  std::optional<FittedSlices> target;
  if (!a.target.empty()) {
    read.emplace(design(a.target), folder_of(a.target), context, a.missing());
    target.emplace(FittedSlices::like(stack, *read, folder_of(a.target), context));
    check_target(stack, stack.info(), **target, a.target, read->pixel_sum(), context);
  }
  const auto rows = probe_stack(stack, target ? &**target : nullptr, setup, a.x, a.y);
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

int simulate_print(const Arguments& a, const ExecutionContext& context, Console& console) {
  return simulate(a.simulate, a.setup, context, console);
}

std::string title_of(const std::string& path) {
  return std::filesystem::path(path).stem().string();
}

int report(const Arguments& a, const ExecutionContext& context, Console& console) {
  check_output(a.output, {a.input, a.target});
  const StackAndDesign given(a, folder_of(a.output), folder_of(a.output), context);
  const StackReader& stack = given.stack;
  tell_even_oxygen(stack.info(), context);
  const WantedDoses wanted(a.doses, *given.target, given.setup.printer, a.mesh, nullptr,
                           a.missing(), folder_of(a.output), context);
  const SliceSource& target = *wanted;
  const Prediction after = verify_stack(stack, target, given.setup, context);
  const AsSliced uncorrected(*given.target);
  const Prediction before = verify_stack(uncorrected, *given.target, given.setup, context);
  const StackInfo& info = stack.info();
  write_text_file(a.output, make_report(gather_report(stack, target, given.setup, info, after,
                                                      before, title_of(a.input), context),
                                        context));
  console.say(fmt::format("{}: written\n{}", a.output, summary(after, before)));
  return kDone;
}

int section(const Arguments& a, const ExecutionContext& context, Console& console) {
  check_output(a.output, {a.input, a.target});
  const StackAndDesign given(a, folder_of(a.output), folder_of(a.output), context);
  const StackReader& stack = given.stack;
  const SliceSource& target = *given.target;
  const PixelBox box = target.bounds();
  const int row = a.y >= 0 ? a.y : (box.y0 + box.y1) / 2;
  const Grid& g = stack.grid();
  const std::string where = row_in_words(stack, row);
  write_text_file(
      a.output, section_sheet(section_of(target, target, given.setup, row),
                              section_of(stack, target, given.setup, row), g.pixel_x_um, g.layer_um,
                              fmt::format("{}: {}; platform up", title_of(a.input), where)));
  console.say(
      fmt::format("{}: section at {}, platform up; left uncorrected, right this stack; grey right, "
                  "red cured through, blue undercured",
                  a.output, where));
  return kDone;
}

/// The reduction that makes a mesh which other programs open with ease. Says how large it will be.
int handy_reduction(const Arguments& a, const SliceSource& stack, const PlaceModels& models,
                    const ExecutionContext& context) {
  constexpr double kHandy = 4e6;
  const SolidSize size = size_of_solid(stack, models, context);
  const int reduce = size.reduction(kHandy);
  const auto in_words = [&](double triangles) {
    std::string text = fmt::format("{:.2g} million triangles", triangles * 1e-6);
    // Bytes of a triangle: an STL's record; of a PLY's faces and half as many vertices.
    const double bytes = a.output.ends_with(".stl") ? 50 : a.output.ends_with(".ply") ? 19 : 0;
    if (bytes > 0) text += fmt::format(", {:.2g} GB", bytes * triangles * 1e-9);
    return text;
  };
  if (reduce > 1) {
    context.tell(fmt::format(
        "the surface takes one pixel in {} along x and y: some {} (--reduce 1 would make some {})",
        reduce, in_words(size.triangles(reduce)), in_words(size.triangles(1))));
  }
  return reduce;
}

int solid(const Arguments& a, const ExecutionContext& context, Console& console) {
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
    check_design_size(stack, placed);
    design_mesh.emplace(placed);
  }
  nlohmann::ordered_json figures;
  if (!a.target.empty()) {
    const StackReader target = a.open(design(a.target), folder_of(a.output), context);
    const FittedSlices fitted = FittedSlices::like(stack, target, folder_of(a.output), context);
    check_target(stack, stack.info(), *fitted, a.target, target.pixel_sum(), context);
    figures["design_volume_mm3"] = static_cast<double>(target.pixel_sum()) / 255.0 * g.pixel_x_um *
                                   g.pixel_y_um * g.layer_um * 1e-9;
  }
  const SolidOptions options{a.reduce > 0 ? a.reduce : handy_reduction(a, stack, models, context),
                             design_mesh ? &*design_mesh : nullptr};
  const SolidReport r = write_solid(stack, models, a.output, options, context);
  console.say(
      fmt::format("{}: {} triangles, {:.4f} mm³, from {:.3f}, {:.3f}, {:.3f} to {:.3f}, {:.3f}, "
                  "{:.3f} mm",
                  a.output, r.triangles, r.volume_mm3, r.lower[0], r.lower[1], r.lower[2],
                  r.upper[0], r.upper[1], r.upper[2]));
  if (figures.contains("design_volume_mm3")) {
    console.say(
        fmt::format("design as sliced: {:.4f} mm³", figures["design_volume_mm3"].get<double>()));
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
    print_or_write(a.json, figures.dump(2));
  }
  return kDone;
}

int run(const Arguments& a, const ExecutionContext& context, Console& console) {
  format_of(a.file());
  const std::string base =
      (std::filesystem::path(a.output).parent_path() / title_of(a.output)).string();
  for (const char* kind : {"", ".html", ".json"}) {
    const std::string path = *kind ? base + kind : a.output;
    check_output(path, a.with_left_alone(a.mesh.parts));
    check_output(path, a.doses.inputs());
  }
  const Setup setup = a.uncertain.put(a.setup.resolve(nullptr, nullptr), a.setup);
  tell_notices(setup, nullptr, context);
  MeshesLeftAlone place;
  const MeshSlices slices =
      slice_parts(a.mesh, setup.printer, setup.process.surface, a.leave_alone, place, context);
  const FittedSlices fitted = fit_for_output(slices, a.file(), setup.printer, context);
  const LeftAloneFiles part(*fitted, a.leave_alone, place, setup.printer, folder_of(a.output),
                            context);
  const WantedDoses wanted(a.doses, *part, setup.printer, a.mesh, &slices, a.missing(),
                           folder_of(a.output), context);
  const Correction result = with_dose_words(setup, [&] {
    return make_part(*wanted, setup, a.file(), base, title_of(a.output), context);
  });
  console.say(fmt::format("{3}, {0}.html, {0}.json: {1} slices\n{2}", base, result.info.grid.layers,
                          summary(result.after, result.before), a.output));
  return kDone;
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
      "that is best for this part. Grey table: 25, 15, 10, 5 are taken off where the next four "
      "slices are lit.";
  return table;
}

int compare(const Arguments& a, const ExecutionContext& context, Console& console) {
  check_output(a.json, a.mesh.parts);
  check_output(a.output, a.mesh.parts);
  Setup setup = a.setup.resolve(nullptr, nullptr);
  tell_notices(setup, nullptr, context);
  const MeshSlices target = slice_parts(a.mesh, setup.printer, setup.process.surface, context);
  setup.process = schedule_uv(target, setup, context);
  const Comparison c = compare_methods(target, setup, context);
  if (!a.json.empty()) {
    // Only the erase has an N; the key is there for every method.
    nlohmann::ordered_json json;
    const auto add = [&](const char* method, const Prediction& p) {
      json[method] = nlohmann::ordered_json::parse(p.to_json());
      json[method]["best_n"] = nullptr;
    };
    add("uncorrected", c.uncorrected);
    add("erase", c.erase);
    add("table", c.table);
    if (c.to_slices) add("ours_to_slices", *c.to_slices);
    add("ours", c.ours);
    json["erase"]["best_n"] = c.best_n;
    print_or_write(a.json, json.dump(2));
  }
  std::vector<Figures> columns = {{"uncorrected", &c.uncorrected},
                                  {fmt::format("erase, N = {}", c.best_n), &c.erase},
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

int convert(const Arguments& a, const ExecutionContext& context, Console& console) {
  StackFile file = a.file();
  const std::string format = format_of(file);
  check_output(a.output, {a.input});
  const StackReader stack = a.open(a.input, folder_of(a.output), context);
  if (stack.info().format == format) file.keep_from = a.input;
  if (!a.kept.empty()) {
    check_output(a.output, {a.kept});
    file.keep_from = a.kept;
    context.tell(a.kept + ": its settings and pictures stay, its layers become those of " +
                 a.input);
  }
  // For a printer whose display is known the images are turned to it.
  Printer printer;
  if (!a.setup.printer.empty()) {
    printer = load_display(a.setup.printer);
  } else if (stack.info().printer) {
    printer = *stack.info().printer;
  }
  const FittedSlices fitted = fit_for_output(stack, a.file(), printer, context);
  convert_stack(stack, file, context, &*fitted == &stack ? nullptr : &*fitted);
  console.say(fmt::format("{}: {} slices, format {}", a.output, stack.grid().layers, format));
  return kDone;
}

int info(const Arguments& a, const ExecutionContext& context, Console&) {
  check_output(a.json, {a.input});
  StackInfo info = StackReader::read_info(a.input);
  const bool light = info.kind == StackKind::corrected || info.kind == StackKind::recorded;
  if (info.part_volume_mm3 == 0 && !light) {
    // All images are looked at, whatever their size: a damaged archive is not described.
    const StackReader stack(a.input, folder_of(a.input), context, {1, 1, 1});
    const Grid& g = info.grid;
    info.part_volume_mm3 = static_cast<double>(stack.pixel_sum()) / 255.0 * g.pixel_x_um *
                           g.pixel_y_um * g.layer_um * 1e-9;
  }
  if (a.json.empty()) {
    std::string text = describe_stack(info);
    for (const auto& [name, value] : print_file_facts(a.input)) {
      text += fmt::format("{:<12} {}\n", name, text::printable(value));
    }
    print_result(text);
  } else {
    print_or_write(a.json, info_json(info, a.input));
  }
  return kDone;
}

int run_program(int argc, char** argv) {
  Arguments a;
  Program program(
      "slicecorr",
      "Makes resin prints come out as designed: slices parts, corrects the slices for light that "
      "cures through, and predicts what will print.",
      "slicecorr run part.stl -o part.uvj --layer-um 50 --printer dual-wavelength-dlp --resin "
      "egg-resin --speed-mm-h 800");
  using Command = int (*)(const Arguments&, const ExecutionContext&, Console&);
  const auto add = [&](const char* name, const char* text, Command command) {
    return program.add(name, text,
                       [&a, command](const ExecutionContext& context, Console& console) {
                         return command(a, context, console);
                       });
  };
  const auto stack_input = [&](CLI::App* sub, const char* name, const char* text) {
    sub->add_option(name, a.input, text)->required();
    if (sub->get_name() == "info") return;
    sub->add_option("--layer-um", a.layer_um, "Height of the layers, where the archive says none")
        ->check(number_in(1, 1000));
  };
  // The part is a stack: what its meshes were, and how they lay, must be told.
  const auto doses_of_stack = [&](CLI::App* sub) {
    a.doses.add_to(*sub);
    sub->add_option(
           "--design", a.doses.designs,
           "Meshes of which the stack was sliced: each --region then lies beside them as in the files "
           "[each --region lies on the plate as its file says]")
        ->take_all()
        ->expected(1, std::numeric_limits<int>::max());
    a.mesh.add_placement_to(*sub);
  };
  std::string formats;
  for (const FormatInfo& f : archive_formats()) formats += (formats.empty() ? "" : ", ") + f.name;
  const auto stack_output = [&](CLI::App* sub, const char* text) {
    sub->add_option("-o,--output", a.output, text)->required();
    sub->add_option("--format", a.format,
                    "Format of the archive, where its name does not tell: " + formats);
    sub->add_flag("--archive", a.archive,
                  "Make the file as small as it gets, which takes longer; the pixels are the same");
  };
  CLI::App* sub = add("slice", "Slice meshes into a stack of coverage images", slice);
  a.mesh.add_to(*sub);
  a.setup.add_surface_to(*sub);
  sub->add_option("--printer", a.setup.printer, "Printer: a .toml file or a name")->required();
  stack_output(sub, "Stack to write (.uvj, or another format)");

  sub = add("correct", "Correct a stack for a printer, a resin and a speed", correct);
  stack_input(sub, "IN", "Stack of coverage images");
  add_leave_alone_to(*sub, a.leave_alone);
  a.setup.add_to(*sub, true, true);
  a.uncertain.add_to(*sub, true);
  a.oxygen.add_to(*sub);
  doses_of_stack(sub);
  stack_output(sub, "Stack to write (.uvj, or another format)");

  sub = add("verify", "Predict what a stack prints, and measure it against its target", verify);
  stack_input(sub, "STACK", "Stack to verify");
  sub->add_option("--target", a.target, "Stack of the design")->required();
  add_leave_alone_to(*sub, a.leave_alone);
  a.setup.add_to(*sub, false, true);
  a.uncertain.add_to(*sub, false);
  doses_of_stack(sub);
  a.uncertain.add_map_to(*sub);
  sub->add_option("--json", a.json, "Write all figures as JSON to FILE, or - for stdout");
  sub->add_option("--map", a.output,
                  "Write a map of the surface to FILE (.png): from below and from above, red where "
                  "it reaches half a slice too far, blue where so much is missing");
  sub->add_option("--max-height-error-um", a.max_height_error_um,
                  "Exit with 5 when the largest height error is above this")
      ->check(number_in(0, std::numeric_limits<double>::max()));
  sub->add_option(
         "--max-surface-error-um", a.max_surface_error_um,
         "Exit with 5 when the largest distance of an edge from the mesh, where its height "
         "is known, is above this")
      ->check(number_in(0, std::numeric_limits<double>::max()));

  sub = add("probe", "Grey level, intensity and dose along one pixel column, as CSV", probe);
  stack_input(sub, "STACK", "Stack to look into");
  sub->add_option("--x", a.x, "Column of the image")->required();
  sub->add_option("--y", a.y, "Row of the image")->required();
  sub->add_option("--target", a.target, "Stack of the design");
  a.setup.add_to(*sub, false, true);

  sub = add("simulate",
            "Show how a print cures while it is made: one pixel column or an image row of a stack "
            "against time, or the fronts of a stationary exposure",
            simulate_print);
  a.simulate.add_to(*sub);
  a.setup.add_to(*sub, false, false);

  sub = add("report", "Write a page that shows what a stack prints", report);
  stack_input(sub, "STACK", "Stack to report on");
  sub->add_option("--target", a.target, "Stack of the design")->required();
  add_leave_alone_to(*sub, a.leave_alone);
  a.setup.add_to(*sub, false, true);
  a.uncertain.add_to(*sub, false);
  doses_of_stack(sub);
  sub->add_option("-o,--output", a.output, "Page to write (.html)")->required();

  sub = add("section", "Draw what prints along an image row, before and after, as PNG", section);
  stack_input(sub, "STACK", "Stack to look into");
  sub->add_option("--target", a.target, "Stack of the design")->required();
  sub->add_option("--y", a.y, "Row of the image [the middle of the part]")
      ->check(CLI::NonNegativeNumber);
  a.setup.add_to(*sub, false, true);
  sub->add_option("-o,--output", a.output, "Picture to write (.png)")->required();

  sub = add("solid",
            "Write the surface of what a stack prints as a mesh, to open beside the design", solid);
  stack_input(sub, "STACK", "Stack to look into");
  sub->add_option("--target", a.target, "Stack of the design: its volume is told, too");
  sub->add_option("--design", a.mesh.parts,
                  "Meshes that were sliced: the distance of the surface to them is measured")
      ->take_all()
      ->expected(1, std::numeric_limits<int>::max());
  a.mesh.add_placement_to(*sub);
  a.setup.add_to(*sub, false, true);
  sub->add_option("--reduce", a.reduce,
                  "Take every Nth pixel in x and y [as many as make at most 4 million triangles]")
      ->check(CLI::Range(1, 64));
  sub->add_option("--json", a.json, "Write all figures as JSON to FILE, or - for stdout");
  sub->add_option("-o,--output", a.output, "Mesh to write (.stl, .ply or .3mf)")->required();

  sub = add("run", "Slice, correct, verify and report: OUT.uvj, OUT.html, OUT.json", run);
  a.mesh.add_to(*sub);
  add_leave_alone_to(*sub, a.leave_alone);
  a.setup.add_to(*sub, true, true);
  a.uncertain.add_to(*sub, true);
  a.doses.add_to(*sub);
  stack_output(sub, "Stack to write (.uvj, or another format)");

  sub = add("compare",
            "Predict a part with the usual compensations and with the correction; writes no stack",
            compare);
  a.mesh.add_to(*sub);
  a.setup.add_to(*sub, true, true);
  sub->add_option("--json", a.json, "Write all figures as JSON to FILE, or - for stdout");
  sub->add_option("-o,--output", a.output,
                  "Write the report, with the comparison, to FILE (.html)");

  sub = add("convert", "Write the slices of an archive in another format", convert);
  stack_input(sub, "IN", "Archive to convert");
  stack_output(sub, "Archive to write");
  sub->add_option(
      "--template", a.kept,
      "A file of the output's format, made for the same printer: the output is this file with the "
      "layers of IN and, where IN has some, its exposure times");
  sub->add_option(
      "--printer", a.setup.printer,
      "Printer to convert for: images are turned as its display needs them, and its pixel size "
      "counts where IN has none");

  sub = add("info", "What a stack says about itself", info);
  stack_input(sub, "STACK", "Stack to look into");
  sub->add_option("--json", a.json, "Write as JSON to FILE, or - for stdout");

  FlowOptions flow;
  PatternOptions pattern;
  PlanOptions plan;
  TomoOptions tomo;
  HologramArguments hologram;
  BeamsArguments beams;
  TestPartOptions test_part;
  add_test_part(program, test_part);
  add_flow(program, flow);
  add_pattern(program, pattern);
  add_plan(program, plan);
  add_tomo(program, tomo);
  add_hologram(program, hologram);
  add_beams(program, beams);
  add_tune(program, argv);
  add_examples(program);
  return program.run(own_arguments(argc, argv), argv);
}

}  // namespace
}  // namespace slicecorr::cli

int main(int argc, char** argv) { return slicecorr::cli::run_program(argc, argv); }
