// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "submit/planned.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <memory>

#include "programs/common/mesh_options.hpp"
#include "slicecorr/plan.hpp"
#include "slicecorr/stack.hpp"
#include "submit/fields.hpp"
#include "submit/heights.hpp"
#include "submit/pass_over.hpp"

namespace slicecorr::farm::detail {

namespace {

/// What messages call a field of the request.
std::string named(const JobRequest& r, std::string key) {
  if (!r.as_options) return key;
  std::replace(key.begin(), key.end(), '_', '-');
  return "--" + key;
}

std::unique_ptr<const SliceSource> part_of(const JobRequest& r, const Setup& setup,
                                           const std::string& scratch_folder,
                                           const ExecutionContext& context) {
  if (std::all_of(r.parts.begin(), r.parts.end(), is_mesh_name)) {
    if (!r.setup.layer_heights_um.empty() || !r.adaptive_um.empty()) {
      throw InputError(fmt::format(
          "layers of different heights, for which nothing is planned; expected {} alone with {}",
          named(r, "layer_um"), named(r, "plan")));
    }
    if (r.layer_um <= 0) throw InputError(named(r, "layer_um") + " is missing");
    cli::MeshOptions mesh = mesh_options_of(r);
    mesh.shrinkage = setup.resin.shrinkage;
    return std::make_unique<const MeshSlices>(
        cli::slice_parts(mesh, setup.printer, setup.process.surface, context));
  }
  if (r.parts.size() != 1) throw InputError("expected meshes, or one archive of slices");
  const StackInfo info = StackReader::read_info(r.parts[0]);
  check_design(info, r.parts[0]);
  if (!info.layer_heights_um.empty() || !info.light_share.empty()) {
    throw InputError(
        r.parts[0], "",
        "has layers of different heights or light below full, for which nothing is planned; "
        "expected layers of one height under all of the light");
  }
  MissingFacts facts;
  facts.layer_um = r.layer_um;
  facts.pixel_x_um = setup.printer.pixel_x_um;
  facts.pixel_y_um = setup.printer.pixel_y_um;
  return std::make_unique<const StackReader>(r.parts[0], scratch_folder, context, facts);
}

void plan(JobRequest& r, const std::string& scratch_folder, const ExecutionContext& context) {
  if (is_tomographic(kind_of(r))) {
    if (r.said["plan"].default_) return;  // passed over, as other defaults of the kind
    throw InputError(named(r, "plan") + " has no place in a tomographic print");
  }
  const bool layerwise = r.setup.mode == "layerwise";
  for (const char* key : {"speed_mm_h", "exposure_s"}) {
    if (!r.said.contains(key)) continue;
    const std::string why =
        fmt::format("{} is what {} finds; expected one of them", named(r, key), named(r, "plan"));
    if (pass_over(r, key, why)) continue;
    if (pass_over(r, "plan", why)) return;
    throw InputError(why);
  }
  const Setup setup = resolve_passing_over(r, [&](const JobRequest& one) {
    SetupChoices choices = one.setup;
    (layerwise ? choices.exposure_s : choices.speed_mm_h) = 1;
    return resolve_setup(choices, nullptr, nullptr,
                         r.as_options ? ChoiceNames::options : ChoiceNames::fields);
  });
  PlanAsk ask;
  ask.curve_points = ask.tolerance_points = 0;
  ask.stage = load_stage_change(r.setup.printer);
  if (r.tolerance_um > 0) ask.tolerance_um = r.tolerance_um;
  if (r.gap_contrast > 0) ask.gap_contrast = r.gap_contrast;
  const PrintPlan found =
      plan_print(*part_of(r, setup, scratch_folder, context), setup, ask, context);
  const std::string pace =
      layerwise ? fmt::format("{:g} s", found.at.exposure_s) : speeds_in_words(found.setup.process);
  (layerwise ? r.setup.exposure_s : r.setup.speed_mm_h) =
      layerwise ? found.at.exposure_s : found.at.speed_mm_h;
  r.setup.edge_aim_um = found.setup.process.edge_aim_um;
  if (!found.slice_speed_mm_h.empty()) {
    const Process& process = found.setup.process;
    r.setup.speed_mm_h = process.speed_mm_h;
    r.setup.slice_speed_mm_h = process.slice_speed_mm_h;
    r.setup.slice_lamps = process.slice_lamps == SliceLamps::stay ? "stay" : "follow";
  }
  r.planned = fmt::format("{}, limited by {}", pace, found.limited_by);
  r.labels.push_back("planned " + pace);
}

}  // namespace

void plan_all(std::vector<JobRequest>& requests, const std::string& scratch_folder,
              const ExecutionContext& context, std::vector<SubmitError>& errors) {
  for_each_sound(requests, errors, [&](JobRequest& r) {
    if (r.plan) plan(r, scratch_folder, context);
  });
}

}  // namespace slicecorr::farm::detail
