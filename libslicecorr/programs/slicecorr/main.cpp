// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The program `slicecorr`: its subcommands and their options.

#include <CLI/CLI.hpp>
#include <limits>

#include "commands.hpp"
#include "examples.hpp"
#include "features.hpp"
#include "flow.hpp"
#include "hand_over.hpp"
#include "hologram.hpp"
#include "pattern.hpp"
#include "plan.hpp"
#include "programs/common/part_slices.hpp"
#include "relief.hpp"
#include "scan.hpp"
#include "test_part.hpp"
#include "whole_parts.hpp"

namespace slicecorr::cli {
namespace {

int simulate_print(const Arguments& a, const ExecutionContext& context, Console& console) {
  return simulate(a.simulate, a.setup, context, console);
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
  const auto plates = [&](CLI::App* sub) {
    sub->add_option(
           "--plates", a.mesh.plates,
           "Arranged parts that do not fit on one plate go to up to N: OUT-1, OUT-2 and so on")
        ->check(CLI::Range(1, 1000))
        ->capture_default_str();
  };
  const auto heights = [&](CLI::App* sub) {
    sub->get_option("--layer-um")->required(false);
    add_heights_to(*sub, a.layers, a.adaptive_um);
  };
  std::string formats;
  for (const FormatInfo& f : archive_formats()) formats += (formats.empty() ? "" : ", ") + f.name;
  const auto stack_output = [&](CLI::App* sub, const char* text) {
    sub->add_option("-o,--output", a.output, text)->required();
    sub->add_option("--format", a.format,
                    "Format of the archive, where its name does not tell: " + formats)
        ->check(value_is(ValueKind::format));
    sub->add_flag("--archive", a.archive,
                  "Make the file as small as it gets, which takes longer; the pixels are the same");
  };
  CLI::App* sub = add("slice", "Slice meshes into a stack of coverage images", commands::slice);
  a.mesh.add_to(*sub);
  plates(sub);
  a.setup.add_surface_to(*sub);
  heights(sub);
  sub->add_option("--printer", a.setup.printer, "Printer: a .toml file or a name")->required();
  sub->add_option("--resin", a.setup.resin,
                  "Resin, a .toml file or a name: parts become larger by what it shrinks");
  stack_output(sub, "Stack to write (.uvj, or another format)");

  sub = add("correct", "Correct a stack for a printer, a resin and a speed", commands::correct);
  stack_input(sub, "IN", "Stack of coverage images");
  add_leave_alone_to(*sub, a.leave_alone);
  add_part_inside_to(*sub, a.inside);
  a.setup.add_to(*sub, true, true);
  a.uncertain.add_to(*sub, true);
  a.oxygen.add_to(*sub);
  doses_of_stack(sub);
  stack_output(sub, "Stack to write (.uvj, or another format)");
  sub->add_option("--json", a.json, "Write all figures as JSON to FILE, or - for stdout");

  sub = add("verify", "Predict what a stack prints, and measure it against its target",
            commands::verify);
  stack_input(sub, "STACK", "Stack to verify");
  sub->add_option("--target", a.target, "Stack of the design [the one that run left beside STACK]");
  add_leave_alone_to(*sub, a.leave_alone);
  add_part_inside_to(*sub, a.inside);
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
  sub->add_option("--max-loose-bodies", a.max_loose_bodies,
                  "Exit with 5 when more bodies than this never hang on the platform")
      ->check(CLI::Range(0, std::numeric_limits<int>::max()));

  sub = add("probe", "Grey level, intensity and dose along one pixel column, as CSV",
            commands::probe);
  stack_input(sub, "STACK", "Stack to look into");
  sub->add_option("--x", a.x, "Column of the image")->required();
  sub->add_option("--y", a.y, "Row of the image")->required();
  sub->add_option("--target", a.target, "Stack of the design [the one that run left beside STACK]");
  a.setup.add_to(*sub, false, true);

  sub = add("simulate",
            "Show how a print cures while it is made: one pixel column or an image row of a stack "
            "against time, or the fronts of a stationary exposure",
            simulate_print);
  a.simulate.add_to(*sub);
  a.setup.add_to(*sub, false, false);

  sub = add("report", "Write a page that shows what a stack prints", commands::report);
  stack_input(sub, "STACK", "Stack to report on");
  sub->add_option("--target", a.target, "Stack of the design [the one that run left beside STACK]");
  add_leave_alone_to(*sub, a.leave_alone);
  add_part_inside_to(*sub, a.inside);
  a.setup.add_to(*sub, false, true);
  a.uncertain.add_to(*sub, false);
  doses_of_stack(sub);
  sub->add_option("-o,--output", a.output, "Page to write (.html)")->required();

  sub = add("section", "Draw what prints along an image row, before and after, as PNG or SVG",
            commands::section);
  stack_input(sub, "STACK", "Stack to look into");
  sub->add_option("--target", a.target, "Stack of the design [the one that run left beside STACK]");
  sub->add_option("--y", a.y, "Row of the image [the middle of the part]")
      ->check(CLI::NonNegativeNumber);
  a.setup.add_to(*sub, false, true);
  sub->add_option("-o,--output", a.output, "Picture to write (.png or .svg)")->required();

  sub =
      add("solid", "Write the surface of what a stack prints as a mesh, to open beside the design",
          commands::solid);
  stack_input(sub, "STACK", "Stack to look into");
  sub->add_option("--target", a.target, "Stack of the design: its volume is told, too");
  sub->add_option("--design", a.mesh.parts,
                  "Meshes that were sliced: the distance of the surface to them is measured")
      ->take_all()
      ->expected(1, std::numeric_limits<int>::max());
  a.mesh.add_placement_to(*sub);
  a.setup.add_to(*sub, false, true);
  sub->add_option(
         "--reduce", a.reduce,
         "Take every Nth pixel in x and y [as many as make at most 1 million triangles; figures are those of all pixels]")
      ->check(CLI::Range(1, 64));
  sub->add_option("--json", a.json, "Write all figures as JSON to FILE, or - for stdout");
  sub->add_option("-o,--output", a.output, "Mesh to write (.stl, .ply or .3mf)")->required();

  sub = add(
      "run",
      "Slice, correct, verify and report: OUT.uvj, OUT.html, OUT.json, and the design, OUT-target.uvj",
      commands::run);
  a.mesh.add_to(*sub);
  plates(sub);
  heights(sub);
  add_leave_alone_to(*sub, a.leave_alone);
  a.setup.add_to(*sub, true, true);
  a.uncertain.add_to(*sub, true);
  a.doses.add_to(*sub);
  stack_output(sub, "Stack to write (.uvj, or another format)");

  sub = add("compare",
            "Predict a part with the usual compensations and with the correction; writes no stack",
            commands::compare);
  a.mesh.add_to(*sub);
  a.setup.add_to(*sub, true, true);
  sub->add_option("--json", a.json, "Write all figures as JSON to FILE, or - for stdout");
  sub->add_option("-o,--output", a.output,
                  "Write the report, with the comparison, to FILE (.html)");

  sub = add("convert", "Write the slices of an archive in another format", commands::convert);
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

  sub = add("info", "What a stack says about itself, or a mesh: what of it prints", commands::info);
  stack_input(sub, "STACK", "Stack or mesh to look into");
  sub->add_option("--json", a.json, "Write as JSON to FILE, or - for stdout");

  FlowOptions flow;
  PatternOptions pattern;
  PlanOptions plan;
  HologramArguments hologram;
  ReliefOptions relief;
  ScanOptions scan;
  TestPartOptions test_part;
  add_test_part(program, test_part);
  add_flow(program, flow);
  add_pattern(program, pattern);
  add_plan(program, plan);
  add_whole_parts(program);
  add_hologram(program, hologram);
  add_relief(program, relief);
  add_scan(program, scan);
  add_tables(program);
  add_tune(program, argv);
  add_examples(program);
  return program.run(own_arguments(argc, argv), argv);
}

}  // namespace
}  // namespace slicecorr::cli

int main(int argc, char** argv) { return slicecorr::cli::run_program(argc, argv); }
