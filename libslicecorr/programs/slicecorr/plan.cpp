// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "plan.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <memory>
#include <optional>

#include "programs/common/database_band.hpp"
#include "slicecorr/bodies.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/left_alone.hpp"
#include "slicecorr/stack.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::cli {

namespace {

/// Speeds are what is looked for: any will do until then.
Setup resolve(const PlanOptions& o) {
  SetupOptions setup = o.setup;
  const bool layerwise = setup.mode == "layerwise";
  if (setup.speed_mm_h > 0 || setup.exposure_s > 0) {
    throw InputError(fmt::format("{} is what plan finds; expected it not to be given",
                                 setup.speed_mm_h > 0 ? "--speed-mm-h" : "--exposure-s"));
  }
  if (setup.by_slice()) {
    throw InputError(
        "--slice-speed-mm-h, --layer-exposure-s and --light-share choose speeds, exposures and light; expected "
        "none of them");
  }
  (layerwise ? setup.exposure_s : setup.speed_mm_h) = 1;
  Setup all = setup.resolve(nullptr, nullptr);
  // What an archive says of lifts counts before what its printer's file says.
  if (o.mesh.parts.size() == 1 && !is_mesh_name(o.mesh.parts[0])) {
    const StackInfo info = StackReader::read_info(o.mesh.parts[0]);
    if (info.lift_times) all.lift_times = info.lift_times;
    all.process.light_share = info.light_share;
    all.process.layer_heights_um = info.layer_heights_um;
  }
  return all;
}

std::unique_ptr<const SliceSource> read_input(const PlanOptions& o, const Setup& setup,
                                              const ExecutionContext& context) {
  const Printer& printer = setup.printer;
  const std::vector<std::string>& parts = o.mesh.parts;
  if (std::all_of(parts.begin(), parts.end(), is_mesh_name)) {
    if (!(o.mesh.layer_um > 0)) throw InputError("--layer-um is required with meshes");
    MeshOptions mesh = o.mesh;
    mesh.shrinkage = setup.resin.shrinkage;
    return std::make_unique<const MeshSlices>(
        slice_parts(mesh, printer, o.setup.wanted_surface(), context));
  }
  if (parts.size() != 1) throw InputError("expected meshes, or one stack");
  MissingFacts facts;
  facts.layer_um = o.mesh.layer_um;
  facts.pixel_x_um = printer.pixel_x_um;
  facts.pixel_y_um = printer.pixel_y_um;
  return std::make_unique<const StackReader>(design(parts[0]), folder_of(parts[0]), context, facts);
}

void check_outputs(const PlanOptions& o) {
  std::vector<std::string> taken = o.mesh.parts;
  for (const std::string& output : {o.json, o.output, o.slice_speeds}) {
    check_output(output, taken);
    if (!output.empty() && output != "-") taken.push_back(output);
  }
  if (!o.output.empty() && std::filesystem::path(o.output).extension() != ".svg") {
    throw InputError(o.output, "", "expected a picture that ends in .svg");
  }
}

/// A part whose bodies hang on nothing does not print at any speed.
PrintPlan plan_part(const SliceSource& part, const Setup& setup, const PlanAsk& ask,
                    const ExecutionContext& context) {
  const Bodies bodies = find_bodies(AsSliced(part), context, {true, setup.least_neck_mm2});
  if (setup.refuse_loose && bodies.any_loose()) {
    throw InfeasibleError(bodies_in_words(bodies).front());
  }
  for (const std::string& sentence : bodies_in_words(bodies)) context.tell(sentence);
  return plan_print(part, setup, ask, context);
}

using Rotation = std::array<double, 3>;

/// "90,0,0".
Rotation rotation_of(const std::string& text) {
  Rotation r{};
  const char* at = text.data();
  const char* const end = at + text.size();
  for (std::size_t k = 0; k < r.size(); ++k) {
    const auto [stop, error] = std::from_chars(at, end, r[k]);
    const bool last = k + 1 == r.size();
    const bool good = error == std::errc{} && std::abs(r[k]) <= 1e6 &&
                      (last ? stop == end : stop != end && *stop == ',');
    if (!good) {
      throw InputError(fmt::format("--orientations '{}': expected X,Y,Z in degrees, as in 90,0,0",
                                   text::printable(text)));
    }
    at = stop + 1;
  }
  return r;
}

/// The plan with the shortest print of all orientations.
PrintPlan plan_orientations(PlanOptions o, const Setup& setup, const PlanAsk& ask,
                            const ExecutionContext& context) {
  const std::vector<std::string>& parts = o.mesh.parts;
  if (!std::all_of(parts.begin(), parts.end(), is_mesh_name)) {
    throw InputError("--orientations turns meshes; expected meshes, or no orientations");
  }
  if (!o.mesh.rotate_deg.empty()) {
    throw InputError("--rotate-deg is one of --orientations; expected only one of them");
  }
  std::vector<Rotation> rotations;
  for (const std::string& text : o.orientations) rotations.push_back(rotation_of(text));
  std::vector<PlanOrientation> all;
  std::optional<PrintPlan> best;
  std::string refused;
  double least_s = 0;
  for (const Rotation& r : rotations) {
    o.mesh.rotate_deg.assign(r.begin(), r.end());
    PlanOrientation& one = all.emplace_back();
    one.rotate_deg = r;
    try {
      const auto part = read_input(o, setup, context);
      PrintPlan found = plan_part(*part, setup, ask, context);
      one.prints = true;
      one.speed_mm_h = found.at.speed_mm_h;
      one.exposure_s = found.at.exposure_s;
      one.time = (found.along_z ? *found.along_z : found.at).print_time();
      one.layers = found.layers;
      one.limited_by = found.limited_by;
      const double time_s = one.time.all_s().value_or(one.time.light_s);
      if (best && time_s >= least_s) continue;
      least_s = time_s;
      best = std::move(found);
      for (PlanOrientation& other : all) other.chosen = false;
      one.chosen = true;
    } catch (const InfeasibleError& e) {
      one.limited_by = e.what();
      if (refused.empty()) {
        refused = fmt::format("orientation {},{},{}: {}", r[0], r[1], r[2], e.what());
      }
    }
  }
  if (!best) throw InfeasibleError("no orientation prints this part as asked; " + refused);
  best->orientations = std::move(all);
  return std::move(*best);
}

int plan(const PlanOptions& o, const ExecutionContext& context, Console& console) {
  const auto start = std::chrono::steady_clock::now();
  check_outputs(o);
  PlanAsk ask = o.ask;
  ask.light_error = o.light_error_percent / 100;
  for (const std::string& name : o.free) {
    bool& chosen = name == "lamp"       ? ask.free.lamp
                   : name == "uv"       ? ask.free.uv
                   : name == "edge-aim" ? ask.free.edge_aim
                                        : ask.free.omega_max;
    chosen = true;
  }
  const Setup setup = resolve(o);
  ask.stage = load_stage_change(o.setup.printer);
  if (!o.slice_speeds.empty() && !ask.stage.variable_speed) {
    throw InputError(o.setup.printer, "",
                     "has no [stage] variable_speed = true; expected it with --slice-speeds");
  }
  tell_notices(setup, nullptr, context);
  tell_database_band(o.setup.resin, context);
  const PrintPlan found = o.orientations.empty()
                              ? plan_part(*read_input(o, setup, context), setup, ask, context)
                              : plan_orientations(o, setup, ask, context);
  if (!o.json.empty()) print_or_write(o.json, found.to_json());
  if (o.json != "-") print_result(plan_text(found));
  if (!o.slice_speeds.empty()) {
    if (found.slice_speed_mm_h.empty()) {
      console.say(fmt::format("{}: not written, all slices have one speed", o.slice_speeds));
    } else {
      print_or_write(o.slice_speeds, found.slice_speeds_csv());
    }
  }
  if (!o.output.empty()) {
    const std::string name = std::filesystem::path(o.mesh.parts[0]).filename().string();
    write_text_file(o.output, found.svg(fmt::format("How fast {} can print", name)));
    console.say(fmt::format("{}: written", o.output));
  }
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
  console.say(fmt::format("{} corrections of {} columns, {:.1f} s", found.tried.size(),
                          found.judged_columns, took.count()));
  return kDone;
}

}  // namespace

void add_plan(Program& program, PlanOptions& o) {
  CLI::App* sub = program.add(
      "plan",
      "Find how fast a part can be printed (layer by layer: the least exposure) with edges and gaps "
      "as asked for, and what limits it",
      [&o](const ExecutionContext& context, Console& console) {
        return plan(o, context, console);
      });
  sub->add_option("PART", o.mesh.parts,
                  "Meshes (stl, obj, ply, off, 3mf; also .gz) that share the plate, or one stack "
                  "of the design")
      ->required();
  sub->add_option("--layer-um", o.mesh.layer_um,
                  "Slice height, 1 to 1000; of a stack where it says none")
      ->check(number_in(1, 1000));
  o.mesh.add_antialias_to(*sub);
  o.mesh.add_placement_to(*sub);
  o.mesh.add_plate_to(*sub);
  o.setup.add_to(*sub, true, true);
  sub->add_option("--tolerance-um", o.ask.tolerance_um, "How far edges may lie from the design")
      ->check(number_above_zero())
      ->capture_default_str();
  sub->add_option(
         "--gap-contrast", o.ask.gap_contrast,
         "Least contrast of every gap: 1 minus the least dose in it, where 1 is the critical "
         "dose; 0 to below 1")
      ->check(CLI::Range(0.0, 1.0))
      ->capture_default_str();
  sub->add_option("--light-error-percent", o.light_error_percent,
                  "Error of the light that must not move edges by more than the tolerance; 0: none")
      ->check(number_in(0, 99))
      ->capture_default_str();
  sub->add_option("--least-gap-um", o.ask.least_gap_um,
                  "Leave out gaps lower than this, and say how many there are [those of one slice]")
      ->check(number_above_zero());
  sub->add_option(
         "--free", o.free,
         "What may be chosen besides the speed: lamp (less curing light, where stage or "
         "suction keep the print slow), omega-max (the cap of the dose), edge-aim (edges placed less "
         "finely, low gaps darker), uv (less UV light)")
      ->delimiter(',')
      ->check(CLI::IsMember({"lamp", "omega-max", "edge-aim", "uv"}));
  sub->add_option(
         "--dose-factors", o.ask.free.dose_factors,
         "Multiples of the gel dose to aim at that may be chosen in place of the resin's: lower ones "
         "print faster, and softer")
      ->delimiter(',')
      ->check(CLI::Range(1.0, 1000.0));
  sub->add_option("--orientations", o.orientations,
                  "Ways in which the meshes may lie, each X,Y,Z as for --rotate-deg: the one that "
                  "prints in the least time is planned, and all are told")
      ->check(value_is(ValueKind::text));
  sub->add_option("--tolerance-points", o.ask.tolerance_points,
                  "Points of the curve of speed over tolerance; 0: none")
      ->check(CLI::Range(0, 100))
      ->capture_default_str();
  sub->add_option("--points", o.ask.curve_points, "Points of the curve over speed; 0: none")
      ->check(CLI::Range(0, 200))
      ->capture_default_str();
  sub->add_option("--json", o.json, "Write all figures as JSON to FILE, or - for stdout");
  sub->add_option(
      "--slice-speeds", o.slice_speeds,
      "Write the speed of each slice as CSV to FILE, where the printer's stage may change "
      "its speed and that saves time");
  sub->add_option(
      "-o,--output", o.output,
      "Draw speed against contrast and errors, against tolerance, and along the height (.svg)");
}

}  // namespace slicecorr::cli
