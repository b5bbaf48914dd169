// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "programs/common/mesh_options.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <filesystem>
#include <utility>

#include "programs/common/mesh_box.hpp"
#include "programs/common/program.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::cli {

namespace {

constexpr int kMostCopies = 1000;

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
