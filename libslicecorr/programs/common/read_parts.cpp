// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Reads the parts that options name, puts them on the plate and slices them.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <optional>
#include <utility>

#include "programs/common/mesh_box.hpp"
#include "programs/common/mesh_options.hpp"
#include "programs/common/program.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::cli {

namespace {

/// A file's part.
struct ReadPart {
  std::string path;
  Placement placement;
  TriangleMesh mesh;
  EdgeDefects edge_defects;
  std::string defects;  ///< that change what prints; else empty
  MeshReport report;
  std::vector<std::string> notes;
  int quarter_turns = 0;
};

bool same_size_and_turn(const Placement& a, const Placement& b) {
  return a.scale == b.scale && a.rotate_deg == b.rotate_deg;
}

/// All parts as their files place them; each file is read and told once.
std::vector<ReadPart> read_each(const MeshOptions& options, const ExecutionContext& context) {
  std::vector<ReadPart> all;
  for (const PlacedFile& file : options.placed_files()) {
    const std::string& path = file.path;
    context.check_cancelled();
    const auto same = std::find_if(all.begin(), all.end(), [&](const ReadPart& p) {
      return p.path == path && same_size_and_turn(p.placement, file.placement);
    });
    if (same != all.end() && options.places()) {
      const ReadPart copy = *same;
      all.push_back(copy);
      all.back().defects.clear();
      continue;
    }
    ReadPart& part = all.emplace_back();
    part.path = path;
    part.placement = file.placement;
    part.mesh = read_mesh(path, file.placement, context, &part.notes);
    const MeshReport r = part.report = inspect(part.mesh, context, &part.edge_defects);
    context.tell(fmt::format("{}: {} {}, {} {}, {:.3f} x {:.3f} x {:.3f} mm", path, r.triangles,
                             r.triangles == 1 ? "triangle" : "triangles", r.bodies,
                             r.bodies == 1 ? "body" : "bodies", r.upper[0] - r.lower[0],
                             r.upper[1] - r.lower[1], r.upper[2] - r.lower[2]));
    if (!r.defects.any()) continue;
    const std::string text = fmt::format("{}: {}", path, describe(r.defects));
    context.tell(text);
    // Triangles without area and bodies that touch are told, and print as they are meant.
    const MeshDefects& d = r.defects;
    if (d.open_edges + d.misoriented_edges + d.flipped_triangles > 0) part.defects = text;
  }
  return all;
}

PlateParts together(std::vector<ReadPart> parts) {
  PlateParts all;
  for (ReadPart& part : parts) {
    if (!part.defects.empty()) all.defects.push_back(part.defects);
    if (all.mesh.triangles.empty()) {
      all.mesh = std::move(part.mesh);
      all.edge_defects = std::move(part.edge_defects);
    } else {
      append(all.edge_defects, all.mesh, part.edge_defects);
      append(all.mesh, part.mesh);
    }
  }
  return all;
}

/// Moves each part to where it was said to lie.
void put_parts(const MeshOptions& options, std::vector<ReadPart>& parts) {
  const PlateChoices& p = options.plate;
  if (p.arrange || !options.center_mm.empty()) {
    throw InputError(
        "places of parts are said one by one, or found (--arrange), or moved together (--center-mm); "
        "expected one of them");
  }
  if (p.places_mm.size() != 2 * parts.size() ||
      (!p.quarter_turns.empty() && p.quarter_turns.size() != parts.size())) {
    throw InputError(fmt::format(
        "{} places and {} quarter turns for {} parts; expected x and y for each, and a turn for each or "
        "none",
        p.places_mm.size() / 2, p.quarter_turns.size(), parts.size()));
  }
  for (std::size_t i = 0; i < parts.size(); ++i) {
    ArrangedPart place;
    place.quarters = p.quarter_turns.empty() ? 0 : static_cast<int>(p.quarter_turns[i]);
    Box box;
    box.add(parts[i].mesh);
    // Turned about the middle of its box, which stays where it is.
    place.move_mm = {p.places_mm[2 * i] - box.middle(0), p.places_mm[2 * i + 1] - box.middle(1),
                     -box.low[2]};
    parts[i].mesh = at_place(parts[i].mesh, place);
    parts[i].quarter_turns = place.quarters;
  }
}

/// Where parts were put, all together lie there.
SliceOptions slicing_of(const MeshOptions& options, Surface surface,
                        const std::vector<ReadPart>& parts) {
  SliceOptions slicing = options.slice_options(surface);
  if (options.plate.places_mm.empty()) return slicing;
  Box all;
  for (const ReadPart& part : parts) all.add(part.mesh);
  slicing.center_mm = {all.middle(0), all.middle(1)};
  return slicing;
}

/// Moves the parts to their places, and keeps those of the plate that is asked for. Returns how many plates
/// there are.
int arrange_parts(const MeshOptions& options, const Printer& printer, std::vector<ReadPart>& parts,
                  const ExecutionContext& context) {
  const bool put = !options.plate.places_mm.empty();
  if (put) put_parts(options, parts);
  if (!options.arranges()) {
    const PlateChoices& p = options.plate;
    if (!put && !p.quarter_turns.empty()) {
      throw InputError("--quarter-turns is for parts whose places are said; expected --places-mm");
    }
    if (p.spacing_mm != PlateChoices{}.spacing_mm || p.turn_about_z || options.plates > 1) {
      throw InputError(
          "--spacing-mm, --turn-about-z and --plates are for parts that are arranged; expected --arrange, "
          "or copies (PART*N), with them");
    }
    return 1;
  }
  if (!options.center_mm.empty()) {
    throw InputError(
        "--center-mm places parts as their files have them; expected none where they are arranged");
  }
  const Grid plate = plate_grid(printer);
  ArrangeOptions how;
  how.width_mm = plate.width_px * plate.pixel_x_um * 1e-3;
  how.height_mm = plate.height_px * plate.pixel_y_um * 1e-3;
  how.spacing_mm = options.plate.spacing_mm;
  how.turn = options.plate.turn_about_z;
  std::vector<TriangleMesh> meshes;
  meshes.reserve(parts.size());
  for (ReadPart& part : parts) meshes.push_back(std::move(part.mesh));
  const std::vector<ArrangedPart> places = arrange(
      meshes, how, [&](std::size_t i) { return parts[i].path; }, context);
  int plates = 1;
  for (const ArrangedPart& place : places) plates = std::max(plates, place.plate + 1);
  std::vector<ReadPart> kept;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    if (places[i].plate != options.of_plate) continue;
    kept.push_back(std::move(parts[i]));
    kept.back().mesh = at_place(meshes[i], places[i]);
    kept.back().quarter_turns = places[i].quarters;
    meshes[i] = {};
  }
  context.tell(
      fmt::format("{} parts on {} {}", places.size(), plates, plates == 1 ? "plate" : "plates"));
  parts = std::move(kept);
  return plates;
}

void check_overlaps(const MeshOptions& options, const std::vector<ReadPart>& parts,
                    const Printer& printer, const SliceOptions& slicing,
                    const ExecutionContext& context) {
  // Outlines that are arranged have nothing in common.
  if (options.plate.overlap == "join" || options.arranges() || parts.size() < 2) return;
  std::vector<TriangleMesh> meshes;
  meshes.reserve(parts.size());
  for (const ReadPart& part : parts) meshes.push_back(part.mesh);
  const std::optional<PartOverlap> o = find_overlap(meshes, printer, slicing, context);
  if (!o) return;
  throw InputError(fmt::format(
      "{} and {} overlap: {:.4g} mm³ belong to both, the lowest at x = {:.2f}, y = {:.2f}, z = {:.3f} mm of "
      "the plate; expected parts side by side (--arrange lays them so), or --overlap join, which prints "
      "their union",
      parts[o->first].path, parts[o->second].path, o->volume_mm3, o->x_mm, o->y_mm, o->z_mm));
}

/// Read, arranged where that is asked for.
std::vector<ReadPart> parts_of_plate(const MeshOptions& options, const Printer& printer,
                                     const ExecutionContext& context) {
  std::vector<ReadPart> parts = read_each(options, context);
  const int plates = arrange_parts(options, printer, parts, context);
  if (plates > options.plates) {
    throw InputError(fmt::format(
        "the parts take {} plates of {}'s display; expected fewer parts, a smaller --spacing-mm, "
        "--turn-about-z, as many stacks (--plates {} of slice and run), or as many jobs",
        plates, printer.name, plates));
  }
  return parts;
}

}  // namespace

PlateParts read_parts(const MeshOptions& options, const ExecutionContext& context) {
  if (options.places()) {
    throw InputError(
        "parts lie as their files have them here; expected no copies and none that are arranged");
  }
  return together(read_each(options, context));
}

int plates_needed(const MeshOptions& options, const Printer& printer,
                  const ExecutionContext& context) {
  std::vector<ReadPart> parts = read_each(options, context);
  return arrange_parts(options, printer, parts, context);
}

namespace {

MeshSlices slice_placed(PlateParts parts, const SliceOptions& options, const Printer& printer,
                        const ExecutionContext& context) {
  if (const Shrinkage& s = options.shrinkage; s.any()) {
    context.tell(fmt::format(
        "parts are {:.4f} times as large along x and y and {:.4f} times along z{}, for a resin that {}",
        1 / s.left(0), 1 / s.left(2),
        s.grows() ? ", the outlines of their first layers smaller" : "", shrinkage_in_words(s)));
  }
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
  std::vector<ReadPart> parts = parts_of_plate(options, printer, context);
  const SliceOptions slicing = slicing_of(options, surface, parts);
  check_overlaps(options, parts, printer, slicing, context);
  return slice_placed(together(std::move(parts)), slicing, printer, context);
}

MeshSlices slice_parts(const MeshOptions& options, const Printer& printer, Surface surface,
                       const std::vector<std::string>& left_alone, MeshesLeftAlone& place,
                       const ExecutionContext& context, PartFacts* facts) {
  place.placement = options.placement();
  place.antialias = options.antialias == "on";
  if ((options.places() || options.plate.has_own()) && !left_alone.empty()) {
    throw InputError(
        "what is left alone lies beside the parts as their files have them; expected parts that are not "
        "arranged, and have no sizes or turns of their own");
  }
  std::vector<ReadPart> each = parts_of_plate(options, printer, context);
  const SliceOptions slicing = slicing_of(options, surface, each);
  check_overlaps(options, each, printer, slicing, context);
  PlateParts parts = together(std::move(each));
  if (facts) *facts = {parts.mesh.triangles.size(), parts.defects};
  if (std::none_of(left_alone.begin(), left_alone.end(), is_mesh_name)) {
    return slice_placed(std::move(parts), slicing, printer, context);
  }
  Box part;
  part.add(parts.mesh);
  Box all = part;
  ExecutionContext untold = context;
  untold.notice = nullptr;  // whoever slices them tells
  for (const std::string& path : left_alone) {
    if (is_mesh_name(path)) all.add(read_mesh(path, place.placement, untold));
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

std::vector<PlacedPart> placed_parts(const MeshOptions& options, const Printer& printer,
                                     const ExecutionContext& context) {
  std::vector<ReadPart> parts = parts_of_plate(options, printer, context);
  const SliceOptions slicing = slicing_of(options, Surface::slices, parts);
  Box all;
  for (const ReadPart& part : parts) all.add(part.mesh);
  const Grid plate = plate_grid(printer);
  const std::array<double, 2> center_mm = slicing.center_mm.value_or(std::array<double, 2>{
      plate.width_px * plate.pixel_x_um * 0.5e-3, plate.height_px * plate.pixel_y_um * 0.5e-3});
  const Point3 move{center_mm[0] - all.middle(0), center_mm[1] - all.middle(1), -all.low[2]};
  std::vector<PlacedPart> placed;
  for (ReadPart& part : parts) {
    PlacedPart& p = placed.emplace_back();
    p.path = part.path;
    p.on_plate = std::move(part.mesh);
    for (Point3& v : p.on_plate.vertices) {
      for (std::size_t k = 0; k < 3; ++k) v[k] += move[k];
    }
    p.quarter_turns = part.quarter_turns;
    p.report = part.report;
    p.notes = part.notes;
  }
  return placed;
}

}  // namespace slicecorr::cli
