// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "flow_input.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "programs/common/database_band.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/limit.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/same_light.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr::cli {

namespace {

[[noreturn]] void missing(const char* option) {
  throw InputError(fmt::format("the input does not say how it is printed; expected {}", option));
}

void take_process(const FlowOptions& o, const StackInfo* info, FlowInput& in,
                  const ExecutionContext& context) {
  if (!o.printer.empty()) {
    in.printer = load_printer(o.printer);
    refuse_relative(in.printer, "resin flow");
  } else if (info && info->printer) {
    in.printer = *info->printer;
  } else {
    missing("--printer");
  }
  if (!o.resin.empty()) {
    in.resin = load_resin(o.resin);
    refuse_relative(in.resin, "resin flow");
  } else if (info && info->resin) {
    in.resin = *info->resin;
  } else {
    missing("--resin");
  }
  in.speed_mm_h = o.speed_mm_h;
  if (in.speed_mm_h <= 0 && info && info->process &&
      info->process->mode == ExposureMode::continuous) {
    in.speed_mm_h = info->process->speed_mm_h;
  }
  if (!(in.speed_mm_h > 0)) missing("--speed-mm-h");
  in.uv_mw_cm2 = o.uv_mw_cm2;
  if (info && info->process && info->process->mode == ExposureMode::continuous) {
    in.process = info->process;
    in.process->speed_mm_h = in.speed_mm_h;
  }
  if (!in.uv_mw_cm2 && info && info->process && info->process->uv.kind == UvKind::constant) {
    in.uv_mw_cm2 = info->process->uv.uv_mw_cm2;
  }
  const bool uv = in.uv_mw_cm2 || (in.process && in.process->uv.kind != UvKind::off);
  // What a stack has of both was taken when it was made.
  const std::vector<std::string> told = o.printer.empty() && o.resin.empty()
                                            ? definition_notices(in.printer, in.resin, uv)
                                            : o.light.checked(in.printer, in.resin, uv);
  for (const std::string& text : told) context.tell(text);
  tell_database_band(o.resin, context);
  if (uv && in.process && !in.process->uv_lamp_share.empty()) {
    context.tell("the UV lamp of this stack fades; flow takes the UV light that is asked of it");
  }
  if (uv && in.printer.uv_flat_field) {
    context.tell(fmt::format(
        "the UV lamp of printer '{}' shines unevenly; flow takes the UV light that it is told as even",
        in.printer.name));
  }
}

}  // namespace

FlowInput read_flow_input(const FlowOptions& o, const ExecutionContext& context) {
  FlowInput in;
  const std::vector<std::string>& parts = o.mesh.parts;
  if (parts.empty()) {
    take_process(o, nullptr, in, context);
    return in;
  }
  const bool meshes = std::all_of(parts.begin(), parts.end(), is_mesh_name);
  if (meshes) {
    if (!(o.mesh.layer_um > 0)) throw InputError("--layer-um is required with meshes");
    take_process(o, nullptr, in, context);
    MeshOptions mesh = o.mesh;
    mesh.shrinkage = in.resin.shrinkage;
    in.slices =
        std::make_unique<const MeshSlices>(slice_parts(mesh, in.printer, Surface::slices, context));
    return in;
  }
  if (parts.size() != 1) throw InputError("expected meshes, or one stack");
  const StackInfo info = StackReader::read_info(parts[0]);
  if (info.kind == StackKind::recorded) {
    throw InputError(parts[0], "",
                     "is a recording of a print; expected the stack that was printed");
  }
  const bool own_heights =
      !info.layer_heights_um.empty() || (info.process && !info.process->layer_heights_um.empty());
  if (own_heights || !info.exposures.empty()) {
    throw InputError(
        parts[0], "",
        fmt::format("has layers {}, under which flow is not counted; expected layers of one "
                    "height, each exposed once",
                    own_heights ? "of different heights" : "that are exposed more than once"));
  }
  take_process(o, &info, in, context);
  MissingFacts facts;
  facts.layer_um = o.mesh.layer_um;
  facts.pixel_x_um = in.printer.pixel_x_um;
  facts.pixel_y_um = in.printer.pixel_y_um;
  in.slices = std::make_unique<const StackReader>(parts[0], folder_of(parts[0]), context, facts);
  if (info.kind == StackKind::corrected) in.pixels = FlowPixels::light;
  return in;
}

void check_uv_lamp(const Printer& printer, double uv_mw_cm2) {
  if (!printer.uv) {
    throw InputError(fmt::format("--uv-mw-cm2: printer '{}' has no [uv] lamp", printer.name));
  }
  if (uv_mw_cm2 > printer.uv->max_mw_cm2()) {
    throw InfeasibleError(
        fmt::format("the UV lamp of printer '{}' gives at most {} mW/cm²; {:g} "
                    "are asked for",
                    printer.name, at_most(printer.uv->max_mw_cm2()), uv_mw_cm2));
  }
}

void check_blue_lamp(const Printer& printer, double blue_mw_cm2) {
  const double full = printer.calibration.back().intensity_mw_cm2;
  if (blue_mw_cm2 <= full) return;
  throw InfeasibleError(
      fmt::format("printer '{}' gives at most {} mW/cm² of blue light; {:g} are asked for",
                  printer.name, at_most(full), blue_mw_cm2));
}

}  // namespace slicecorr::cli
