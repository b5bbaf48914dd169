// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "programs/common/mesh_options.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <filesystem>
#include <limits>
#include <optional>
#include <utility>

#include "programs/common/program.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::cli {

namespace {

constexpr int kMostCopies = 1000;

struct Box {
  Point3 low, high;
  Box() {
    low.fill(std::numeric_limits<double>::infinity());
    high.fill(-std::numeric_limits<double>::infinity());
  }
  void add(const TriangleMesh& mesh) { widen_box(mesh, low, high); }
  double middle(std::size_t k) const { return 0.5 * (low[k] + high[k]); }
};

}  // namespace

void MeshOptions::add_to(CLI::App& app) {
  app.add_option("PART", parts, "Meshes (stl, obj, ply, off, 3mf; also .gz) that share the plate")
      ->required();
  app.add_option("--layer-um", layer_um, "Slice height, 1 to 1000")
      ->required()
      ->check(layer_height());
  add_antialias_to(app);
  add_placement_to(app);
  add_plate_to(app);
}

void MeshOptions::add_plate_to(CLI::App& app, bool copies) {
  const OptionGroup group(app, "Parts on one plate");
  app.add_option("--overlap", plate.overlap,
                 "Parts whose solids overlap: refuse them, or join them to their union")
      ->check(CLI::IsMember({"refuse", "join"}))
      ->capture_default_str();
  const std::string how = copies ? " (PART*N: N copies, always side by side)" : "";
  app.add_flag("--arrange", plate.arrange,
               "Place the parts side by side, the largest first, not as in their files" + how);
  app.add_option("--spacing-mm", plate.spacing_mm, "Least distance of parts that are arranged")
      ->check(number_in(0, 1000))
      ->capture_default_str();
  app.add_flag("--turn-about-z", plate.turn_about_z,
               "Arranged parts may be turned by quarter turns, each by itself");
  app.add_option(
         "--places-mm", plate.places_mm,
         "X,Y,X,Y...: where the middle of each part lies on the plate, in place of its file; each "
         "then stands on the platform")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->check(number_in(-1e6, 1e6));
  app.add_option("--quarter-turns", plate.quarter_turns,
                 "N,N...: with --places-mm, by how many quarters each part is turned about z")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->check(CLI::IsMember({0, 1, 2, 3}));
  const std::string each = copies ? "; PART*N counts once" : "";
  app.add_option("--own-fit-mm", plate.own_fit_mm,
                 "MM,MM...: the longest side of each part by itself, 0: as all" + each)
      ->delimiter(',')
      ->allow_extra_args(false)
      ->check(number_in(0, 1e5));
  app.add_option("--own-scale", plate.own_scale,
                 "F,F...: the factor on the lengths of each part by itself, 0: as all" + each)
      ->delimiter(',')
      ->allow_extra_args(false)
      ->check(number_in(0, 1e9));
  app.add_option(
         "--own-rotate-deg", plate.own_rotate_deg,
         "X,Y,Z,X,Y,Z...: turn each part by itself, as --rotate-deg turns all of them" + each)
      ->delimiter(',')
      ->allow_extra_args(false)
      ->check(number_in(-1e6, 1e6));
}

namespace {

/// "part.stl*3" as name and number; 1 where it is no such name.
std::pair<std::string, int> copies_of(const std::string& part) {
  const auto star = part.rfind('*');
  if (star == part.npos || star == 0 || std::filesystem::exists(part)) return {part, 1};
  int number = 0;
  const char *const first = part.data() + star + 1, *const last = part.data() + part.size();
  const auto [end, error] = std::from_chars(first, last, number);
  if (error != std::errc{} || end != last) return {part, 1};
  if (number < 1 || number > kMostCopies) {
    throw InputError(part, "", fmt::format("expected 1 to {} copies", kMostCopies));
  }
  return {part.substr(0, star), number};
}

}  // namespace

std::vector<std::string> MeshOptions::files() const {
  std::vector<std::string> all;
  for (const std::string& part : parts) {
    const auto [file, number] = copies_of(part);
    all.insert(all.end(), static_cast<std::size_t>(number), file);
  }
  return all;
}

PlateChoices for_copies(const PlateChoices& plate, const std::vector<std::string>& parts) {
  PlateChoices all = plate;
  const auto repeat = [&](std::vector<double>& values, std::ptrdiff_t each) {
    if (values.size() != parts.size() * static_cast<std::size_t>(each)) return;
    std::vector<double> list;
    for (std::size_t i = 0; i < parts.size(); ++i) {
      const auto from = values.begin() + each * static_cast<std::ptrdiff_t>(i);
      for (int k = copies_of(parts[i]).second; k > 0; --k)
        list.insert(list.end(), from, from + each);
    }
    values = std::move(list);
  };
  repeat(all.own_fit_mm, 1);
  repeat(all.own_scale, 1);
  repeat(all.own_rotate_deg, 3);
  return all;
}

bool MeshOptions::arranges() const {
  if (!plate.places_mm.empty()) return plate.arrange;
  return plate.arrange || std::any_of(parts.begin(), parts.end(), [](const std::string& part) {
           return copies_of(part).second > 1;
         });
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
  add_turns_to(app);
}

void MeshOptions::add_turns_to(CLI::App& app) {
  const OptionGroup group(app, "How the meshes lie");
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
      ->allow_extra_args(false)  // a FILE may come behind it
      ->check(number_in(-1e6, 1e6));
}

Placement MeshOptions::placement() const {
  Placement p;
  p.units = units_named(units);
  p.scale = scale;
  p.shrinkage = shrinkage;
  if (!rotate_deg.empty()) p.rotate_deg = {rotate_deg[0], rotate_deg[1], rotate_deg[2]};
  if (fit_mm <= 0 || parts.empty()) return p;
  if (fit_factor_ == 0)
    fit_factor_ = plate.has_own() ? fit_of_others() : fit_scale(files(), p, fit_mm);
  p.scale *= fit_factor_;
  return p;
}

bool MeshOptions::own_size(std::size_t part) const {
  return (!plate.own_fit_mm.empty() && plate.own_fit_mm[part] > 0) ||
         (!plate.own_scale.empty() && plate.own_scale[part] > 0);
}

Point3 MeshOptions::turn_of(std::size_t part) const {
  if (!plate.own_rotate_deg.empty()) {
    const double* const own = &plate.own_rotate_deg[3 * part];
    return {own[0], own[1], own[2]};
  }
  return rotate_deg.empty() ? Point3{} : Point3{rotate_deg[0], rotate_deg[1], rotate_deg[2]};
}

void MeshOptions::check_own() const {
  const auto check = [&](const std::vector<double>& values, std::size_t each, const char* what) {
    if (values.empty() || values.size() == each * parts.size()) return;
    throw InputError(fmt::format(
        "{} own {} for {} {}; expected {} for each part as it is given", values.size(), what,
        parts.size(), parts.size() == 1 ? "part" : "parts", each == 1 ? "one" : "three numbers"));
  };
  check(plate.own_fit_mm, 1, plate.own_fit_mm.size() == 1 ? "longest side" : "longest sides");
  check(plate.own_scale, 1, plate.own_scale.size() == 1 ? "factor" : "factors");
  check(plate.own_rotate_deg, 3, "numbers of turns");
  if (!plate.own_rotate_deg.empty() && !rotate_deg.empty()) {
    throw InputError(
        "parts are turned one by one (--own-rotate-deg), or all alike (--rotate-deg); expected one of them");
  }
  if (plate.own_fit_mm.empty() || plate.own_scale.empty()) return;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    if (plate.own_fit_mm[i] > 0 && plate.own_scale[i] > 0) {
      throw InputError(
          parts[i], "",
          "has a longest side and a factor of its own (--own-fit-mm, --own-scale); expected "
          "one of them");
    }
  }
}

double MeshOptions::fit_of_others() const {
  check_own();
  Box box;
  bool any = false;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    if (own_size(i)) continue;
    any = true;
    const Placement p{units_named(units), scale, turn_of(i)};
    box.add(read_mesh(copies_of(parts[i]).first, p));
  }
  if (!any) {
    throw InputError("each part has a size of its own; expected no longest side of all (--fit-mm)");
  }
  const double longest =
      std::max({box.high[0] - box.low[0], box.high[1] - box.low[1], box.high[2] - box.low[2]});
  if (!(longest > 0)) throw InputError(parts[0], "", "has no size that could be scaled");
  return fit_mm / longest;
}

std::vector<PlacedFile> MeshOptions::placed_files() const {
  const Placement common = placement();
  if (plate.has_own()) check_own();
  std::vector<PlacedFile> all;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const auto [file, number] = copies_of(parts[i]);
    PlacedFile one{file, common};
    if (plate.has_own()) one.placement.rotate_deg = turn_of(i);
    if (!plate.own_scale.empty() && plate.own_scale[i] > 0) {
      one.placement.scale = plate.own_scale[i];
    } else if (!plate.own_fit_mm.empty() && plate.own_fit_mm[i] > 0) {
      one.placement.scale = 1;
      one.placement.scale = fit_scale({file}, one.placement, plate.own_fit_mm[i]);
    }
    all.insert(all.end(), static_cast<std::size_t>(number), one);
  }
  return all;
}

SliceOptions MeshOptions::slice_options(Surface surface) const {
  SliceOptions o;
  o.layer_um = layer_um;
  o.raised_um = raised_um;
  o.shrinkage = shrinkage;
  o.antialias = antialias == "on";
  o.edge_heights = surface == Surface::mesh;
  if (!center_mm.empty()) o.center_mm = {center_mm[0], center_mm[1]};
  return o;
}

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

void add_leave_alone_to(CLI::App& app, std::vector<std::string>& files) {
  app.add_option("--leave-alone", files,
                 "Supports or rafts, as a mesh or stack: they are shown as sliced, and the part is "
                 "corrected around them (may be given several times)")
      ->allow_extra_args(false)
      ->take_all();
}

void add_part_inside_to(CLI::App& app, std::vector<std::string>& files, const std::string& name) {
  app.add_option(
         name, files,
         "Mesh that the archive was sliced from: it is found there, in all its copies, and what "
         "the archive lights outside of it, supports and rafts, is left alone (may be given "
         "several times)")
      ->allow_extra_args(false)
      ->take_all();
}

PartsInside parts_inside(const std::vector<std::string>& files, const MeshOptions& options) {
  if (files.empty()) return {};
  MeshOptions all = options;
  all.parts = files;
  return {files, all.placement()};
}

}  // namespace slicecorr::cli
