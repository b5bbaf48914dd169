// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "flow.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <limits>
#include <memory>
#include <sstream>

#include "flow_in_time.hpp"
#include "flow_input.hpp"
#include "flow_text.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/flow_report.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/limit.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/same_light.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr::cli {

namespace {

/// Lights, gap and limits.
void plan_pull(const FlowOptions& o, const FlowInput& in, FlowFindings& f) {
  FlowPull& pull = f.pull;
  if (!(in.resin.viscosity_pa_s > 0)) {  // says what is missing
    flow_resin(in.resin, o.resin.empty() ? o.mesh.parts[0] : find_definition(o.resin, "resin"));
  }
  pull.viscosity_pa_s = in.resin.viscosity_pa_s;
  pull.speed_mm_h = in.speed_mm_h;
  pull.every = o.every;
  f.limit_given = in.printer.suction_limit_pa > 0;
  pull.limit_pa = f.limit_given ? in.printer.suction_limit_pa : kCavitationPa;
  const bool asked = in.uv_mw_cm2 || o.blue_mw_cm2;
  pull.gap_um = o.gap_um > 0 ? o.gap_um : kDefaultGapUm;
  f.gap_words = o.gap_um > 0 ? "as given" : "assumed; --gap-um says it";
  if (!asked) {
    const UvKind uv = in.process ? in.process->uv.kind : UvKind::off;
    f.no_dose =
        in.process && in.process->even_light
            ? "the light of this stack differs from place to place: slicecorr verify tells its dose and "
              "dead zone"
        : uv != UvKind::off
            ? "the UV light of this stack changes: dose and dead zone are known for one intensity "
              "(--uv-mw-cm2)"
            : "without UV light there is no dead zone that the light makes: dose and dead zone are not "
              "known (--uv-mw-cm2)";
    if (o.gap_um > 0 || uv == UvKind::off) return;
    const PrintGap gap = print_gap(in.printer, in.resin, *in.process, 0);
    pull.gap_um = gap.gap_um;
    f.gap_words = gap.words;
    return;
  }
  const double full = in.printer.calibration.back().intensity_mw_cm2;
  const FlowLight light{o.blue_mw_cm2.value_or(full), in.uv_mw_cm2.value_or(0)};
  check_blue_lamp(in.printer, light.blue_mw_cm2);
  if (light.uv_mw_cm2 > 0 && in.resin.inhibition) check_uv_lamp(in.printer, light.uv_mw_cm2);
  pull.resin = flow_resin(in.resin);
  // Refuses lights that leave no dead zone.
  const double even_um =
      even_gap_um(pull.resin->kinetics, light.blue_mw_cm2, light.uv_mw_cm2, in.speed_mm_h);
  pull.light = light;
  if (o.gap_um > 0) return;
  pull.gap_um = even_um;
  f.gap_words = even_um < kThickestGapUm ? "where resin has its dose in the mean"
                                         : "the thickest: the light is too weak for the speed";
}

/// The dose in the middle of the slowest slice with inhibitor that lasts for ever, and not at all.
void compare_lives(const FlowPart& part, FlowFindings& f, const ExecutionContext& context) {
  const SliceFlow& worst = f.slowest();
  if (worst.bound) return;
  const FlowSection section = part.section(worst.mask);
  const GapPressure pressure = solve_pressure(section, context);
  const std::size_t middle = section.index(pressure.max_x, pressure.max_y);
  const double blue = f.pull.light->blue_mw_cm2, uv = f.pull.light->uv_mw_cm2;
  const auto dose_with = [&](double life_s, double diffusion) {
    FlowResin resin = *f.pull.resin;
    resin.inhibitor_life_s = life_s;
    resin.diffusion_m2_s = diffusion;
    const SectionSweep sweep(section, pressure, resin, f.pull.speed_mm_h, {&f.pull.gap_um, 1});
    return sweep.dose({&blue, 1}, {&uv, 1}).front[middle];
  };
  f.middle_lasting =
      dose_with(std::numeric_limits<double>::infinity(), f.pull.resin->diffusion_m2_s);
  f.middle_fleeting = dose_with(0, 0);
}

FlowPicture picture_of(const FlowPart& part, const FlowFindings& f, const std::string& name,
                       const ExecutionContext& context) {
  FlowPicture p;
  p.title = fmt::format("{}: suction under the part", name);
  p.layer_um = f.layer_um;
  p.speed_mm_h = f.pull.speed_mm_h;
  p.gap_um = f.pull.gap_um;
  p.limit_pa = f.pull.limit_pa;
  p.limit_given = f.limit_given;
  p.slices = f.slices;
  p.notes = f.warnings;
  if (f.window) {
    std::istringstream lines(window_table(*f.window, f.slices, f.pull));
    for (std::string line; std::getline(lines, line);) {
      p.notes.push_back(line.substr(line.find_first_not_of(' ')));
    }
  }
  constexpr std::size_t kMaps = 3;
  for (const SliceFlow* s : slowest_apart(f, kMaps)) {
    if (s->bound) continue;
    FlowMap map{*s, part.section(s->mask), {}};
    const GapPressure pressure = solve_pressure(map.section, context);
    for (const double phi_um2 : pressure.phi_um2) {
      map.suction_pa.push_back(
          suction_pa(phi_um2, f.pull.viscosity_pa_s, f.pull.speed_mm_h, f.pull.gap_um));
    }
    p.maps.push_back(std::move(map));
  }
  return p;
}

/// Fronts come to rest on cells that are fine against the part, even where the gap is wider.
double pitch_for_dose_um(const SliceSource& slices) {
  constexpr double kCellsAcross = 24;
  const PixelBox box = slices.bounds();
  const Grid& grid = slices.grid();
  const double side_um = std::min(box.width() * grid.pixel_x_um, box.height() * grid.pixel_y_um);
  return std::clamp(side_um / kCellsAcross, std::max(grid.pixel_x_um, grid.pixel_y_um),
                    kMostFlowPitchUm);
}

void check_outputs(const FlowOptions& o) {
  std::vector<std::string> taken = o.mesh.parts;
  for (const std::string& output : {o.json, o.output, o.profile}) {
    check_output(output, taken);
    if (!output.empty() && output != "-") taken.push_back(output);
  }
  if (o.json == "-" && o.profile == "-") {
    throw InputError("--json and --profile both go to stdout; expected a file for one of them");
  }
  if (o.output.empty()) return;
  const std::string ending = std::filesystem::path(o.output).extension().string();
  if (ending != ".svg" && ending != ".png" && ending != ".html") {
    throw InputError(o.output, "", "expected an output that ends in .svg or .png or .html");
  }
}

void write_picture(const FlowPicture& picture, const std::string& path) {
  const std::string ending = std::filesystem::path(path).extension().string();
  write_text_file(path, ending == ".svg"   ? flow_svg(picture)
                        : ending == ".png" ? flow_png(picture)
                                           : flow_page(picture));
}

int flow(const FlowOptions& o, const ExecutionContext& context, Console& console) {
  const auto start = std::chrono::steady_clock::now();
  check_outputs(o);
  check_window(o.window);
  if (o.in_time) return flow_in_time(o, context, console);
  refuse_in_time_options(o);
  const FlowInput in = read_flow_input(o, context);
  FlowFindings f;
  plan_pull(o, in, f);
  FlowPartOptions cells{.pitch_um = o.pitch_um, .gap_um = f.pull.gap_um, .pixels = in.pixels};
  if (f.pull.light) cells.most_pitch_um = pitch_for_dose_um(*in.slices);
  const FlowPart part(*in.slices, cells, context);
  if (part.masks() == 0) {
    throw InputError(fmt::format(
        "no cell of {:g} um is lit by half; expected a part that is wider, or a finer --pitch-um",
        part.grid().pitch_um));
  }
  f.layer_um = part.layer_um();
  f.pitch_um = part.grid().pitch_um;
  f.columns = part.grid().columns;
  f.rows = part.grid().rows;
  f.part_slices = part.slices();
  f.blind = part.blind();
  f.slices = part_flow(part, f.pull, context);
  if (f.slices.empty()) {
    throw InputError("none of the slices that are looked at is lit; expected a smaller --every");
  }
  std::vector<std::size_t> masks;
  for (const SliceFlow& s : f.slices) masks.push_back(s.mask);
  std::sort(masks.begin(), masks.end());
  f.masks = static_cast<std::size_t>(std::unique(masks.begin(), masks.end()) - masks.begin());
  const FlowGrid& g = part.grid();
  const bool given = !o.platform_mm.empty();
  f.platform = platform_flow(part, f.pull, given ? o.platform_mm[0] : g.image_width_um * 1e-3,
                             given ? o.platform_mm[1] : g.image_height_um * 1e-3, context);
  if (f.pull.light) compare_lives(part, f, context);
  f.window = find_window(window_of(o.window, in.printer), f.slices, f.pull, context);
  f.warnings = flow_warnings(f);
  for (const std::string& warning : f.warnings) context.tell(warning);
  if (!o.json.empty()) print_or_write(o.json, flow_json(f));
  if (!o.profile.empty()) print_or_write(o.profile, flow_profile_csv(f));
  if (o.json != "-" && o.profile != "-") print_result(flow_table(f));
  if (!o.output.empty()) {
    const std::string name = std::filesystem::path(o.mesh.parts[0]).filename().string();
    write_picture(picture_of(part, f, name, context), o.output);
    console.say(fmt::format("{}: written", o.output));
  }
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
  console.say(fmt::format("{} {} solved, {:.1f} s, masks in {:.1f} MB", f.masks,
                          f.masks == 1 ? "section" : "sections", took.count(),
                          static_cast<double>(part.bytes()) * 1e-6));
  return kDone;
}

}  // namespace

void add_flow(Program& program, FlowOptions& o) {
  CLI::App* sub = program.add(
      "flow",
      "Show what a part does to the resin under it: suction, force and the speed that each slice "
      "bears; with UV light the dose and the dead zone",
      [&o](const ExecutionContext& context, Console& console) {
        return flow(o, context, console);
      });
  sub->add_option("PART", o.mesh.parts,
                  "Meshes (stl, obj, ply, off, 3mf; also .gz) that share the plate, or one stack");
  sub->add_flag(
      "--in-time", o.in_time,
      "Follow the print from its first instant, slice by slice: the curing front, the dead "
      "zone, what flows in and the dose at the window");
  sub->add_option("--disc-radius-mm", o.disc_radius_mm,
                  "With --in-time: a disc of this radius in place of a part")
      ->check(number_above_zero());
  sub->add_option("--strip-half-width-mm", o.strip_half_width_mm,
                  "With --in-time: a long strip of twice this width in place of a part")
      ->check(number_above_zero());
  sub->add_option(
         "--slices", o.slices,
         "With --in-time: follow so many slices [those of the part; 60 of a disc or strip]")
      ->check(CLI::Range(1, 1000000));
  sub->add_option("--first-gap-um", o.first_gap_um,
                  "With --in-time: gap between window and platform at the first instant [25]")
      ->check(number_above_zero());
  sub->add_option("--layer-um", o.mesh.layer_um,
                  "Slice height, 1 to 1000; of a stack where it says none")
      ->check(layer_height());
  o.mesh.add_antialias_to(*sub);
  o.mesh.add_placement_to(*sub);
  o.mesh.add_plate_to(*sub);
  sub->add_option(
      "--printer", o.printer,
      "Printer: a .toml file or a name; its suction_limit_pa is the limit [1 bar, where "
      "resin cavitates]");
  sub->add_option("--resin", o.resin, "Resin: a .toml file or a name; it must say viscosity_pa_s");
  o.light.add_to(*sub);
  sub->add_option("--speed-mm-h", o.speed_mm_h, "Print speed")->check(number_above_zero());
  sub->add_option(
         "--gap-um", o.gap_um,
         fmt::format("Gap between part and window [{:g}; with UV light the gap in which resin gets "
                     "its gel dose in the mean]",
                     kDefaultGapUm))
      ->check(number_in(0, kMostGapUm, true));
  sub->add_option("--uv-mw-cm2", o.uv_mw_cm2,
                  "Intensity of inhibiting UV light, even: dose and dead zone are found")
      ->check(number_in(0, std::numeric_limits<double>::max()));
  sub->add_option("--blue-mw-cm2", o.blue_mw_cm2,
                  "Intensity of the curing light, even [full light]")
      ->check(number_above_zero());
  sub->add_option("--platform-mm", o.platform_mm,
                  "W,H: sides of the platform [those of what the display shows]")
      ->delimiter(',')
      ->expected(2)
      ->check(number_in(0.1, 1e4));
  sub->add_option("--pitch-um", o.pitch_um,
                  fmt::format("Side of the flow's cells [the greater of the gap and 1/64 of the "
                              "part, at most {:g}]",
                              kMostFlowPitchUm))
      ->check(number_above_zero());
  add_window_options(*sub, o.window);
  sub->add_option("--every", o.every, "Look at every Nth slice, and the last")
      ->check(CLI::Range(1, 1000000))
      ->capture_default_str();
  sub->add_option("--json", o.json, "Write all figures as JSON to FILE, or - for stdout");
  sub->add_option("--profile", o.profile,
                  "Write the speed that each slice bears as CSV to FILE, or - for stdout");
  sub->add_option("-o,--output", o.output,
                  "Write a picture or page (.svg, .png, .html): suction over height, maps of the "
                  "slowest slices");
}

}  // namespace slicecorr::cli
