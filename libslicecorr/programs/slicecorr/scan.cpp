// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "scan.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <optional>

#include "slicecorr/error.hpp"
#include "slicecorr/scan.hpp"
#include "slicecorr/stack.hpp"
#include "support/files/text_file.hpp"

namespace slicecorr::cli {

namespace {

/// The design where it stands in its files, its least z on the platform.
TriangleMesh on_platform(TriangleMesh mesh) {
  Point3 low, high;
  low.fill(std::numeric_limits<double>::infinity());
  high.fill(-std::numeric_limits<double>::infinity());
  widen_box(mesh, low, high);
  for (Point3& v : mesh.vertices) v[2] -= low[2];
  return mesh;
}

int compare(const ScanOptions& o, const ExecutionContext& context, Console& console) {
  std::vector<std::string> inputs = o.mesh.parts;
  inputs.insert(inputs.end(), {o.scan, o.stack});
  check_output(o.json, inputs);
  check_output(o.page, inputs);
  if (o.stack.empty() && o.mesh.parts.empty()) {
    throw InputError(
        "nothing to measure against; expected the stack that was printed, the design, or both");
  }
  std::vector<ScanSurface> surfaces;
  if (o.stack.empty()) {
    if (!o.setup.printer.empty() || !o.setup.resin.empty()) {
      throw InputError("printer and resin say what a stack prints; expected the stack, too");
    }
    surfaces.push_back({"design", on_platform(read_parts(o.mesh, context).mesh)});
  } else {
    const StackReader stack(o.stack, folder_of(o.page.empty() ? o.json : o.page), context);
    const Setup setup = o.setup.resolve(&stack.info(), &stack.info());
    tell_notices(setup, &stack.info(), context);
    if (!o.mesh.parts.empty()) {
      TriangleMesh design = on_plate(read_parts(o.mesh, context).mesh, setup.printer,
                                     o.mesh.slice_options(Surface::slices).center_mm);
      check_design_size(stack, stack_height_um(stack.info(), stack.grid().layers) * 1e-3, design);
      surfaces.push_back({"design", std::move(design)});
    }
    const PlaceModels models(setup.printer, setup.resin, setup.process, stack.grid(),
                             stack.frame());
    const std::unique_ptr<const SliceSource> exposures = stack.exposures(setup.resin.m);
    surfaces.push_back({"predicted", predicted_surface(exposures ? *exposures : stack, models,
                                                       kMostPredictedTriangles, context)});
  }
  ScanAsk ask;
  ask.reading.unit = o.unit;
  ask.reading.voxel_um = o.voxel_um;
  ask.reach_um = o.reach_um;
  const auto [scan, comparison] = compare_scan(o.scan, surfaces, ask, context);
  std::vector<const TriangleMesh*> meshes;
  meshes.reserve(surfaces.size());
  for (const ScanSurface& surface : surfaces) meshes.push_back(&surface.mesh);
  if (!o.page.empty()) write_text_file(o.page, scan_page(comparison, scan, meshes));
  if (!o.json.empty()) print_or_write(o.json, comparison.to_json());
  if (o.json != "-") print_result(comparison.to_text());
  if (!o.page.empty()) console.say(fmt::format("{}: written", o.page));
  return kDone;
}

int drift(const ScanOptions& o, Console& console) {
  check_output(o.json, o.comparisons);
  check_output(o.page, o.comparisons);
  std::vector<DriftPrint> prints;
  for (const std::string& path : o.comparisons) {
    prints.push_back(read_comparison(read_text_file(path), path));
  }
  const ScanDrift found = scan_drift(prints, static_cast<std::size_t>(o.settled));
  if (!o.page.empty()) write_text_file(o.page, found.to_page());
  if (!o.json.empty()) print_or_write(o.json, found.to_json());
  if (o.json != "-") print_result(found.to_text());
  if (!o.page.empty()) console.say(fmt::format("{}: written", o.page));
  return found.last_is_beyond() ? kMissed : kDone;
}

}  // namespace

void add_scan(Program& program, ScanOptions& o) {
  CLI::App* group = program.add_group("scan", "Measure printed parts that were scanned");
  CLI::App* sub = program.add_to(
      group, "compare", "Lay a scan onto what should have printed, and say where it is off",
      [&o](const ExecutionContext& context, Console& console) {
        return compare(o, context, console);
      });
  sub->add_option(
         "SCAN", o.scan,
         "Scan of the print, in any pose: a mesh (.stl, .ply, .obj, .off, .3mf), points (.ply, .obj), or a volume (.npy, a folder of TIFF slices)")
      ->required()
      ->check(CLI::ExistingPath);
  sub->add_option("--stack", o.stack,
                  "Stack that was printed: the scan is laid onto what it was predicted to print")
      ->check(CLI::ExistingFile);
  sub->add_option("--design", o.mesh.parts, "Meshes of the design, as they were sliced")
      ->take_all()
      ->expected(1, std::numeric_limits<int>::max());
  o.mesh.add_placement_to(*sub);
  sub->add_option("--scan-unit", o.unit, "Unit of the scan's numbers: auto, um, mm, cm, inch or m")
      ->check(CLI::IsMember({"auto", "um", "mm", "cm", "inch", "m"}))
      ->capture_default_str();
  sub->add_option("--voxel-um", o.voxel_um, "Side of a voxel, of volumes")
      ->check(number_above_zero());
  sub->add_option(
         "--reach-um", o.reach_um,
         "Points farther from the surface are no part of the print: supports, dust [a twentieth "
         "of the surface's diagonal]")
      ->check(number_above_zero());
  o.setup.add_to(*sub, false, false);
  sub->add_option("--json", o.json, "Write all figures as JSON to FILE, or - for stdout");
  sub->add_option("--html", o.page, "Write a page with the part in the round to FILE (.html)");

  sub = program.add_to(
      group, "drift", "Say whether a laboratory's prints wander, by their comparisons in order",
      [&o](const ExecutionContext&, Console& console) { return drift(o, console); });
  sub->add_option("COMPARISON", o.comparisons,
                  "What scan compare --json wrote of each print, in their order")
      ->required()
      ->check(CLI::ExistingFile);
  sub->add_option("--settled", o.settled, "The first N prints say the band [all]")
      ->check(CLI::Range(3, 1'000'000));
  sub->add_option("--json", o.json, "Write all figures as JSON to FILE, or - for stdout");
  sub->add_option("--html", o.page, "Write a page with the charts to FILE (.html)");
}

}  // namespace slicecorr::cli
