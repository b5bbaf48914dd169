// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Reads the inputs of requests as a worker will, and asks the physics.

#include <optional>

#include "programs/common/mesh_options.hpp"
#include "programs/common/part_slices.hpp"
#include "programs/common/setup_options.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/place_models.hpp"
#include "submit/fields.hpp"
#include "submit/heights.hpp"
#include "submit/resolved.hpp"

namespace slicecorr::farm::detail {

namespace {

/// Asks the physics, of the places that the part is printed at where light is uneven.
void plan(const SliceSource& slices, const Setup& setup, const JobRequest& r,
          const ExecutionContext& context, Checked& c) {
  const bool left_alone = !r.leave_alone.empty() || !r.part_inside.empty();
  check_correction(setup, {left_alone, false});
  const Grid& grid = slices.grid();
  // What is ready in the morning is to print.
  const std::string refused = cli::refused_by_machine(
      setup, r.setup.printer, grid, r.as_options ? ChoiceNames::options : ChoiceNames::fields);
  if (!refused.empty()) throw InfeasibleError(refused);
  const bool uneven = light_is_uneven(setup.printer, setup.process);
  const CorrectionPlan plan = uneven
                                  ? plan_correction(slices, setup, context)
                                  : plan_correction(GridOnly(grid, slices.frame()), setup, context);
  judge_suction(slices, setup, context);
  c.layers = grid.layers;
  c.memory.width_px = grid.width_px;
  c.memory.left_alone = left_alone;
  c.memory.together = corrects_together(setup) && !left_alone && !uneven;
  look_at_light(slices, setup.printer, setup.process, plan, c.memory);
}

void check_meshes(const JobRequest& r, const Setup& setup, const std::string& scratch_folder,
                  const ExecutionContext& context, Checked& c) {
  cli::MeshOptions o = mesh_options_of(r);
  o.shrinkage = setup.resin.shrinkage;
  cli::PartFacts facts;
  const cli::PartSlices slices(
      o, setup.printer,
      {LayerHeights(setup.process.layer_heights_um), Surface::slices, r.leave_alone}, context,
      &facts);
  c.memory.triangles = facts.triangles;
  plan(*slices, setup, r, context, c);
  const LeftAloneFiles target(*slices, r.leave_alone, slices.place(), setup.printer, scratch_folder,
                              context);
  const PixelBox box = (*target).bounds();
  c.memory.voxels = std::int64_t{c.layers} * box.width() * box.height();
}

/// How the meshes of a request are turned and scaled.
cli::MeshOptions turns_of(const JobRequest& r) {
  cli::MeshOptions o;
  o.units = r.units;
  o.scale = r.scale;
  o.rotate_deg = r.rotate_deg;
  return o;
}

void check_archive(const JobRequest& r, const Setup& setup, const std::string& scratch_folder,
                   const ExecutionContext& context, Checked& c) {
  const StackInfo info = StackReader::read_info(r.parts[0]);
  MissingFacts facts;
  facts.layer_um = r.layer_um;
  facts.pixel_x_um = setup.printer.pixel_x_um;
  facts.pixel_y_um = setup.printer.pixel_y_um;
  Grid grid = info.grid;
  if (grid.layer_um <= 0) grid.layer_um = facts.layer_um;
  if (grid.layer_um <= 0) {
    throw InputError(r.parts[0], "",
                     std::string("does not say its layer height; expected ") +
                         (r.as_options ? "--layer-um" : "layer_um"));
  }
  if (grid.pixel_x_um <= 0) {
    grid.pixel_x_um = facts.pixel_x_um;
    grid.pixel_y_um = facts.pixel_y_um;
  }
  const GridOnly target(grid, image_frame(info));
  std::optional<StackReader> images;
  if (light_is_uneven(setup.printer, setup.process) || judges_suction(setup) ||
      !r.part_inside.empty()) {
    images.emplace(r.parts[0], scratch_folder, context, facts);
    plan(*images, setup, r, context, c);
  } else {
    plan(target, setup, r, context, c);
  }
  const LeftAloneFiles left(images ? static_cast<const SliceSource&>(*images) : target,
                            r.leave_alone, {}, setup.printer, scratch_folder, context,
                            cli::parts_inside(r.part_inside, turns_of(r)));
  c.memory.voxels = std::int64_t{grid.layers} * grid.width_px * grid.height_px;
}

}  // namespace

std::vector<std::string> inputs_of(const JobRequest& request) {
  std::vector<std::string> list = request.parts;
  if (!is_tomographic(kind_of(request))) {
    list.insert(list.end(), request.leave_alone.begin(), request.leave_alone.end());
    list.insert(list.end(), request.part_inside.begin(), request.part_inside.end());
  } else {
    list.insert(list.end(), request.inserts.begin(), request.inserts.end());
  }
  return list;
}

Checked check_inputs(const JobRequest& request, const Resolved& resolved,
                     const std::string& scratch_folder, const ExecutionContext& context) {
  Checked c;
  try {
    if (resolved.spec.tomo) {
      c.tomo = look_at_tomographic(resolved.spec, inputs_of(request), resolved.setup.printer,
                                   resolved.setup.resin, context);
      c.layers = c.tomo.slices;
    } else if (resolved.mesh) {
      check_meshes(request, resolved.setup, scratch_folder, context, c);
    } else {
      check_archive(request, resolved.setup, scratch_folder, context, c);
    }
  } catch (const Cancelled&) {
    throw;
  } catch (const InfeasibleError& e) {
    c.error = e.what();
    c.reason = Reason::infeasible;
  } catch (const Error& e) {
    c.error = e.what();
    c.reason = Reason::bad_input;
  }
  return c;
}

}  // namespace slicecorr::farm::detail
