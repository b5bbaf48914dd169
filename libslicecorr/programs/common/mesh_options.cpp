// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "programs/common/mesh_options.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <limits>
#include <utility>

#include "programs/common/program.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::cli {

namespace {

Units units_named(const std::string& name) {
  if (name == "mm") return Units::mm;
  if (name == "inch") return Units::inch;
  if (name == "m") return Units::m;
  return Units::automatic;
}

struct Box {
  Point3 low, high;
  Box() {
    low.fill(std::numeric_limits<double>::infinity());
    high.fill(-std::numeric_limits<double>::infinity());
  }
  void add(const TriangleMesh& mesh) {
    for (const auto& triangle : mesh.triangles) {
      for (const std::uint32_t v : triangle) {
        for (std::size_t k = 0; k < 3; ++k) {
          low[k] = std::min(low[k], mesh.vertices[v][k]);
          high[k] = std::max(high[k], mesh.vertices[v][k]);
        }
      }
    }
  }
  double middle(std::size_t k) const { return 0.5 * (low[k] + high[k]); }
  double longest_side() const {
    return std::max({high[0] - low[0], high[1] - low[1], high[2] - low[2]});
  }
};

}  // namespace

void MeshOptions::add_to(CLI::App& app) {
  app.add_option("PART", parts, "Meshes (stl, obj, ply, off, 3mf; also .gz) that share the plate")
      ->required();
  app.add_option("--layer-um", layer_um, "Slice height, 1 to 1000")
      ->required()
      ->check(number_in(1, 1000));
  add_antialias_to(app);
  add_placement_to(app);
}

void MeshOptions::add_antialias_to(CLI::App& app) {
  app.add_option("--antialias", antialias,
                 "on: grey is the share of a pixel that the part covers; off: a pixel is lit where "
                 "the part covers its centre")
      ->check(CLI::IsMember({"on", "off"}))
      ->capture_default_str();
}

void MeshOptions::add_placement_to(CLI::App& app) {
  const OptionGroup group(app, "How the meshes lie");
  app.add_option(
         "--center-mm", center_mm,
         "X,Y: where the centre of the parts lies on the plate, from its corner at the least x and "
         "y [the middle]")
      ->delimiter(',')
      ->expected(2)
      ->check(number_in(-1e6, 1e6));
  app.add_option("--units", units, "Units of the meshes [those of the file, else mm]")
      ->check(CLI::IsMember({"auto", "mm", "inch", "m"}));
  CLI::Option* factor =
      app.add_option("--scale", scale, "Factor on all lengths")->capture_default_str();
  app.add_option(
         "--fit-mm", fit_mm,
         "Scale all parts alike so that the longest side of all together is this long, whatever "
         "units their files have")
      ->check(number_in(1e-3, 1e5))
      ->excludes(factor);
  app.add_option("--rotate-deg", rotate_deg,
                 "X,Y,Z: turn the parts about the fixed axes x, y and z, in this order")
      ->delimiter(',')
      ->expected(3)
      ->check(number_in(-1e6, 1e6));
}

Placement MeshOptions::placement() const {
  Placement p;
  p.units = units_named(units);
  p.scale = scale;
  if (!rotate_deg.empty()) p.rotate_deg = {rotate_deg[0], rotate_deg[1], rotate_deg[2]};
  if (fit_mm <= 0 || parts.empty()) return p;
  if (fit_factor_ == 0) {
    Box box;
    for (const std::string& path : parts) box.add(read_mesh(path, p));
    const double longest = box.longest_side();
    if (!(longest > 0)) throw InputError(parts.front(), "", "has no size that could be scaled");
    fit_factor_ = fit_mm / longest;
  }
  p.scale *= fit_factor_;
  return p;
}

SliceOptions MeshOptions::slice_options(Surface surface) const {
  SliceOptions o;
  o.layer_um = layer_um;
  o.antialias = antialias == "on";
  o.edge_heights = surface == Surface::mesh;
  if (!center_mm.empty()) o.center_mm = {center_mm[0], center_mm[1]};
  return o;
}

PlateParts read_parts(const MeshOptions& options, const ExecutionContext& context) {
  PlateParts all;
  for (const std::string& path : options.parts) {
    context.check_cancelled();
    TriangleMesh part = read_mesh(path, options.placement(), context);
    EdgeDefects edge_defects;
    const MeshReport r = inspect(part, context, &edge_defects);
    context.tell(fmt::format("{}: {} {}, {} {}, {:.3f} x {:.3f} x {:.3f} mm", path, r.triangles,
                             r.triangles == 1 ? "triangle" : "triangles", r.bodies,
                             r.bodies == 1 ? "body" : "bodies", r.upper[0] - r.lower[0],
                             r.upper[1] - r.lower[1], r.upper[2] - r.lower[2]));
    if (r.defects.any()) {
      const std::string text = fmt::format("{}: {}", path, describe(r.defects));
      context.tell(text);
      // Triangles without area and bodies that touch are told, and print as they are meant.
      const MeshDefects& d = r.defects;
      if (d.open_edges + d.misoriented_edges + d.flipped_triangles > 0) all.defects.push_back(text);
    }
    if (all.mesh.triangles.empty()) {
      all.mesh = std::move(part);
      all.edge_defects = std::move(edge_defects);
    } else {
      append(all.edge_defects, all.mesh, edge_defects);
      append(all.mesh, part);
    }
  }
  return all;
}

namespace {

MeshSlices slice_placed(PlateParts parts, const SliceOptions& options, const Printer& printer,
                        const ExecutionContext& context) {
  MeshSlices slices(std::move(parts.mesh), printer, options, context, &parts.edge_defects);
  const ThinFeatures thin = slices.thin_features(context);
  // Every round part has a few at its rims.
  if (50 * thin.columns > thin.of_columns) {
    context.tell(fmt::format(
        "{} pixel columns have something thin between the middles of two layers, {:.3g} mm³ in all, "
        "which prints nothing; the thickest, {:.3g} um, is at x = {:.2f}, y = {:.2f}, z = {:.3f} mm "
        "of the plate; thinner slices would draw it",
        thin.columns, thin.volume_mm3, thin.thickest_um, thin.x_mm, thin.y_mm, thin.z_mm));
  }
  return slices;
}

}  // namespace

MeshSlices slice_parts(const MeshOptions& options, const Printer& printer, Surface surface,
                       const ExecutionContext& context) {
  return slice_placed(read_parts(options, context), options.slice_options(surface), printer,
                      context);
}

MeshSlices slice_parts(const MeshOptions& options, const Printer& printer, Surface surface,
                       const std::vector<std::string>& left_alone, MeshesLeftAlone& place,
                       const ExecutionContext& context, PartFacts* facts) {
  place.placement = options.placement();
  place.antialias = options.antialias == "on";
  PlateParts parts = read_parts(options, context);
  if (facts) *facts = {parts.mesh.triangles.size(), parts.defects};
  if (std::none_of(left_alone.begin(), left_alone.end(), is_mesh_name)) {
    return slice_placed(std::move(parts), options.slice_options(surface), printer, context);
  }
  Box part;
  part.add(parts.mesh);
  Box all = part;
  for (const std::string& path : left_alone) {
    if (is_mesh_name(path)) all.add(read_mesh(path, place.placement, context));
  }
  SliceOptions placed = options.slice_options(surface);
  const Grid plate = plate_grid(printer);
  const std::array<double, 2> center_mm = placed.center_mm.value_or(std::array<double, 2>{
      plate.width_px * plate.pixel_x_um * 0.5e-3, plate.height_px * plate.pixel_y_um * 0.5e-3});
  place.origin_mm = {center_mm[0] - all.middle(0), center_mm[1] - all.middle(1), -all.low[2]};
  placed.center_mm = {place.origin_mm[0] + part.middle(0), place.origin_mm[1] + part.middle(1)};
  placed.platform_z_mm = all.low[2];
  return slice_placed(std::move(parts), placed, printer, context);
}

void add_leave_alone_to(CLI::App& app, std::vector<std::string>& files) {
  app.add_option("--leave-alone", files,
                 "Supports or rafts, as a mesh or stack: they are shown as sliced, and the part is "
                 "corrected around them (may be given several times)")
      ->allow_extra_args(false)
      ->take_all();
}

}  // namespace slicecorr::cli
