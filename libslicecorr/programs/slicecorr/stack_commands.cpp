// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>
#include <unistd.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>

#include "commands.hpp"
#include "programs/common/database_band.hpp"
#include "programs/common/make_part.hpp"
#include "programs/common/part_slices.hpp"
#include "slicecorr/bodies.hpp"
#include "slicecorr/even_greys.hpp"
#include "slicecorr/print_file.hpp"
#include "slicecorr/supports.hpp"
#include "slicecorr/turned.hpp"
#include "support/json/read_json.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::cli {

void check_layer_height(const std::string& path, double layer_um) {
  if (!(layer_um > 0)) return;
  constexpr double same = 1e-3;  // as where a stack is read
  const double said_um = StackReader::read_info(path).grid.layer_um;
  if (!(said_um > 0) || std::abs(said_um - layer_um) <= same * said_um) return;
  throw InputError(
      path, "",
      fmt::format("says layers of {:.6g} um, and --layer-um {:.6g} is for archives that say none; "
                  "expected it not to be given",
                  said_um, layer_um));
}

void check_placement(const Arguments& a, bool meshes) {
  if (!a.doses.designs.empty() && a.doses.regions.empty()) {
    throw InputError(
        "--design says of which meshes a stack was sliced, beside which each --region lies; expected --region with it");
  }
  static const MeshOptions unset;
  const MeshOptions& m = a.mesh;
  const char* const said = !m.center_mm.empty()       ? "--center-mm"
                           : m.units != unset.units   ? "--units"
                           : m.scale != unset.scale   ? "--scale"
                           : m.fit_mm != unset.fit_mm ? "--fit-mm"
                           : !m.rotate_deg.empty()    ? "--rotate-deg"
                                                      : nullptr;
  if (said == nullptr || meshes) return;
  throw InputError(fmt::format(
      "{} says how meshes lie, and a stack stays as it is; expected it with a mesh alone", said));
}

}  // namespace slicecorr::cli

namespace slicecorr::cli::commands {

namespace {

/// Makes the stacks of all plates, OUT-1, OUT-2 and so on where there are several.
template <typename Make>
int each_plate(const Arguments& a, const Printer& printer, const ExecutionContext& context,
               const Make& make) {
  const int plates = a.mesh.plates > 1 ? plates_needed(a.mesh, printer, context) : 1;
  if (plates == 1 || plates > a.mesh.plates) return make(a);
  const std::filesystem::path output(a.output);
  for (int k = 0; k < plates; ++k) {
    Arguments one = a;
    one.mesh.of_plate = k;
    one.output = (output.parent_path() / fmt::format("{}-{}{}", output.stem().string(), k + 1,
                                                     output.extension().string()))
                     .string();
    if (const int code = make(one); code != kDone) return code;
  }
  return kDone;
}

/// `file` with the height of the machine, which targets and archives of others do not have a printer file for.
StackFile for_machine(StackFile file, const Printer& printer, double otherwise_mm = 0) {
  file.machine_height_mm = printer.travel_mm > 0 ? printer.travel_mm : otherwise_mm;
  return file;
}

/// Tells that the printer that was named does not read what is written.
void tell_not_read(const Arguments& a, const StackFile& file, const ExecutionContext& context) {
  if (a.setup.printer.empty()) return;
  const std::string words = not_read_in_words(a.setup.printer, file);
  if (!words.empty()) context.tell(fmt::format("{}: {}", file.path, words));
}

int slice_plate(const Arguments& a, const ExecutionContext& context, Console& console);
int run_plate(const Arguments& a, const Setup& setup, const ExecutionContext& context,
              Console& console);

}  // namespace

int slice(const Arguments& given, const ExecutionContext& context, Console& console) {
  Arguments a = given;
  format_of(a.file());
  if (!a.setup.resin.empty()) {
    const Resin resin = load_resin(a.setup.resin);
    tell_unread(resin.unread, context);
    a.mesh.shrinkage = resin.shrinkage;
  }
  const Printer printer = load_display(a.setup.printer);
  tell_unread(printer.unread, context);
  check_can_be_made(a.file(), !a.layers.empty() || !a.adaptive_um.empty());
  tell_not_read(a, a.file(), context);
  return each_plate(a, printer, context,
                    [&](const Arguments& one) { return slice_plate(one, context, console); });
}

namespace {

/// The heights that the options ask for; alike where one height is.
LayerHeights wanted_heights(const Arguments& a) {
  if (!a.layers.empty()) return LayerHeights(read_by_slice(a.layers, "layer_um"));
  if (a.adaptive_um.empty()) {
    if (a.mesh.layer_um > 0) return {};
    throw InputError("expected the height of layers: --layer-um, --layers or --adaptive-um");
  }
  return adaptive_heights_of(a.mesh, a.leave_alone, a.adaptive_um);
}

int slice_unevenly(const Arguments& a, const LayerHeights& heights, const Printer& printer,
                   const ExecutionContext& context, Console& console) {
  const PartSlices slices(a.mesh, printer, {heights}, context);
  const FittedSlices fitted = fit_for_output(*slices, a.file(), printer, context);
  const StackInfo info = write_target(*fitted, heights, for_machine(a.file(), printer), context);
  const auto [least, most] =
      std::minmax_element(info.layer_heights_um.begin(), info.layer_heights_um.end());
  console.say(
      fmt::format("{}: {} slices of {:g} to {:g} um, {:.4f} ml; edges lie at slices: the "
                  "mesh's own heights are not counted in layers of different heights",
                  a.output, info.grid.layers, *least, *most, info.part_volume_mm3 * 1e-3));
  return kDone;
}

int slice_plate(const Arguments& a, const ExecutionContext& context, Console& console) {
  check_output(a.output, a.mesh.files());
  const Printer printer = load_display(a.setup.printer);
  const LayerHeights heights = wanted_heights(a);
  if (!heights.alike()) return slice_unevenly(a, heights, printer, context, console);
  const MeshSlices slices = slice_parts(a.mesh, printer, a.setup.wanted_surface(), context);
  const FittedSlices fitted = fit_for_output(slices, a.file(), printer, context);
  const StackInfo info = write_target(*fitted, for_machine(a.file(), printer), context);
  console.say(fmt::format("{}: {} slices, {:.4f} ml", a.output, info.grid.layers,
                          info.part_volume_mm3 * 1e-3));
  return kDone;
}

}  // namespace

namespace {

/// How long a stack prints by what its file says: formats of printers have lifts of their own, also where
/// nobody named any.
PrintTime written_time(StackInfo info, const std::string& path) {
  if (!info.lift_times) info.lift_times = StackReader::read_info(path).lift_times;
  return print_time(info);
}

}  // namespace

int correct(const Arguments& a, const ExecutionContext& context, Console& console) {
  check_placement(a, names_meshes(a));
  StackFile file = a.file();
  check_output(a.output, a.with_left_alone({a.input}));
  check_output(a.output, a.doses.inputs());
  check_output(a.json, a.with_left_alone({a.input, a.output}));
  check_output(a.json, a.doses.inputs());
  const StackInfo times = StackReader::read_info(design(a.input));
  file.format = format_of(file, times.format);
  const Setup setup = a.uncertain.put(a.setup.resolve(nullptr, &times), a.setup);
  file = for_machine(file, setup.printer, times.machine_height_mm);
  tell_notices(setup, &times, context);
  tell_database_band(a.setup.resin, context, setup.process.assumed);
  tell_doubted_grey(a.setup.printer, setup, context);
  // What a slicer wrote besides the slices stays, also where the file was made from a template.
  if (times.format == file.format && keeps_settings(a.input, times)) {
    file.keep_from = a.input;
  }
  check_can_be_made(file, !times.layer_heights_um.empty());
  check_lifts(file, setup.process, a.setup.mode == "continuous", ChoiceNames::options);
  tell_not_read(a, file, context);
  const StackReader target = a.open(a.input, folder_of(a.output), context);
  tell_even_greys(target, times.kind, context);
  const FittedSlices fitted = fit_for_output(target, file, setup.printer, context);
  tell_machine(setup, a.setup.printer, (*fitted).grid(), context);
  const LeftAloneFiles part(*fitted, a.leave_alone, {}, setup.printer, folder_of(a.output), context,
                            parts_inside(a.inside, a.mesh));
  const WantedDoses wanted(a.doses, *part, setup.printer, a.mesh, nullptr, a.missing(),
                           folder_of(a.output), context);
  const CorrectionAsk ask{.before = !console.quiet()};
  const auto tell = [&](const Correction& c, const std::string& more) {
    if (!a.json.empty()) print_or_write(a.json, figures_json(c.after));
    if (a.json == "-") return;
    console.say(fmt::format("{}: {} slices, print time {}\n{}{}", a.output, c.info.grid.layers,
                            print_time_in_words(written_time(c.info, a.output)),
                            summary(c.after, c.before) + lifts_line(file.format, setup.process),
                            more));
  };
  if (a.oxygen.even) {
    const OxygenCorrection even = with_dose_words(setup, [&] {
      return correct_even_oxygen(*wanted, setup, file, ask, a.oxygen.ask, context);
    });
    tell(even.correction, oxygen_in_words(even.oxygen));
    return kDone;
  }
  const Correction result =
      with_dose_words(setup, [&] { return correct_stack(*wanted, setup, file, ask, context); });
  tell(result, "");
  return kDone;
}

int run(const Arguments& given, const ExecutionContext& context, Console& console) {
  Arguments a = given;
  check_can_be_made(a.file(), !a.layers.empty() || !a.adaptive_um.empty());
  SetupOptions chosen = a.setup;
  // Heights of layers by slopes are those of the part as it is sliced.
  if (!chosen.resin.empty()) a.mesh.shrinkage = load_resin(chosen.resin).shrinkage;
  chosen.layer_heights_um = wanted_heights(a).um();
  chosen.layer_um = a.mesh.layer_um;
  const Setup setup = a.uncertain.put(chosen.resolve(nullptr, nullptr), chosen);
  check_lifts(a.file(), setup.process, chosen.mode == "continuous", ChoiceNames::options);
  tell_notices(setup, nullptr, context);
  tell_database_band(chosen.resin, context, setup.process.assumed);
  tell_doubted_grey(chosen.printer, setup, context);
  tell_not_read(a, a.file(), context);
  return each_plate(a, setup.printer, context,
                    [&](const Arguments& one) { return run_plate(one, setup, context, console); });
}

namespace {

/// Says what was left beside a stack.
void say_left(const std::string& path, const std::string& what, const Arguments& a,
              Console& console) {
  console.say(fmt::format("{}: {} ({}), by which verify, section and report measure {}", path, what,
                          text::bytes(static_cast<double>(std::filesystem::file_size(path))),
                          a.output));
}

int run_plate(const Arguments& a, const Setup& setup, const ExecutionContext& context,
              Console& console) {
  const std::string base =
      (std::filesystem::path(a.output).parent_path() / title_of(a.output)).string();
  for (const char* kind : {"", ".html", ".json"}) {
    const std::string path = *kind ? base + kind : a.output;
    check_output(path, a.with_left_alone(a.mesh.files()));
    check_output(path, a.doses.inputs());
  }
  const std::string design_path = target_beside(a.output), left_path = left_alone_beside(a.output);
  for (const std::string& path : {design_path, left_path}) {
    check_output(path, a.with_left_alone(a.mesh.files()));
    check_output(path, a.doses.inputs());
  }
  const PartSlices slices(
      a.mesh, setup.printer,
      {LayerHeights(setup.process.layer_heights_um), setup.process.surface, a.leave_alone},
      context);
  tell_heights_left_out(setup, a.setup.wanted_surface(), context);
  const FittedSlices fitted = fit_for_output(*slices, a.file(), setup.printer, context);
  tell_machine(setup, a.setup.printer, (*fitted).grid(), context);
  const LeftAloneFiles part(*fitted, a.leave_alone, slices.place(), setup.printer,
                            folder_of(a.output), context);
  const WantedDoses wanted(a.doses, *part, setup.printer, a.mesh, &slices.cuts(), a.missing(),
                           folder_of(a.output), context);
  const Correction result = with_dose_words(setup, [&] {
    // What an older stack of this name left alone goes before the new one comes.
    return make_part(*wanted, setup, a.file(), base, title_of(a.output), context,
                     [&] { ::unlink(left_path.c_str()); });
  });
  // The verdict comes last.
  const LayerHeights heights = wanted_heights(a);
  leave_beside(*slices, heights, design_path, context);
  say_left(design_path, "the design as sliced", a, console);
  if (!a.leave_alone.empty()) {
    leave_left_alone(slices, a.leave_alone, setup.printer, heights, left_path, context);
    say_left(left_path, "what was left alone", a, console);
  }
  console.say(fmt::format(
      "{3}, {0}.html, {0}.json: {1} slices, print time {4}\n{2}", base, result.info.grid.layers,
      summary(result.after, result.before) + lifts_line(format_of(a.file()), setup.process),
      a.output, print_time_in_words(written_time(result.info, a.output))));
  return kDone;
}

}  // namespace

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
  check_can_be_made(file, !stack.info().layer_heights_um.empty());
  // For a printer whose display is known the images are turned to it.
  Printer printer;
  if (!a.setup.printer.empty()) {
    printer = load_display(a.setup.printer);
    tell_unread(printer.unread, context);
    tell_not_read(a, file, context);
    file = for_machine(file, printer);
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
  if (is_mesh_name(a.input)) return mesh_info(a, context);
  StackInfo info = StackReader::read_info(a.input);
  // Light is no shape: of what is corrected `verify` says what hangs together.
  std::optional<Bodies> bodies;
  std::optional<LayerAreas> areas;
  // Images of a recording are no slices.
  bool several_images = false;
  if (info.kind != StackKind::recorded) {
    // All images are looked at, whatever their size: a damaged archive is not described.
    const StackReader stack(a.input, folder_of(a.input), context, {1, 1, 1});
    const Grid& g = info.grid;
    several_images = stack.several_images_layer() >= 0;
    const LayerHeights heights(process_of_times(info).layer_heights_um);
    if (info.kind != StackKind::corrected && !several_images) {
      if (info.part_volume_mm3 == 0) {
        info.part_volume_mm3 = coverage_mm3(stack, context);
        if (!(g.layer_um > 0 && g.pixel_x_um > 0 && g.pixel_y_um > 0)) info.part_volume_mm3 = 0;
      }
      bodies = find_bodies(stack, context);
      bodies->grid = g;
      bodies->heights = heights;
    }
    if (g.pixel_x_um > 0 && g.pixel_y_um > 0 && g.layer_um > 0 && !several_images) {
      areas = lit_areas(stack, info.printer ? &*info.printer : nullptr, context);
      areas->heights = heights;
    }
  }
  if (a.json.empty()) {
    std::string text = describe_stack(info, areas ? &*areas : nullptr);
    for (const auto& [name, value] : print_file_facts(a.input)) {
      text += fmt::format("{:<12} {}\n", name, text::printable(value));
    }
    text +=
        fmt::format("{:<12} {}\n", "bodies",
                    bodies ? fmt::format("{} on the platform, {} loose, by the images alone",
                                         bodies->on_platform, bodies->loose_bodies)
                    : several_images ? "not said where exposures of a layer show different images"
                                     : "not said by light; verify says what hangs together");
    if (bodies) {
      for (const std::string& sentence : bodies_in_words(*bodies)) {
        text += fmt::format("{:<12} {}\n", "", sentence);
      }
    }
    print_result(text);
  } else {
    auto json = slicecorr::detail::own_json<nlohmann::ordered_json>(
        info_json(info, a.input, areas ? &*areas : nullptr));
    if (bodies) {
      json.update(slicecorr::detail::own_json<nlohmann::ordered_json>(bodies->to_json()));
      json["bodies_by"] = "images";
    } else {
      json["loose_bodies"] = nullptr;
    }
    print_or_write(a.json, json.dump(2));
  }
  return kDone;
}

}  // namespace slicecorr::cli::commands
