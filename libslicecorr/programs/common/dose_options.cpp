// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "programs/common/dose_options.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <limits>
#include <utility>

#include "programs/common/program.hpp"
#include "programs/common/setup_options.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::cli {

namespace {

struct Region {
  std::string path;
  double dose = 1;
};

Region region_of(const std::string& text) {
  const std::size_t sign = text.rfind('=');
  const auto dose = sign == std::string::npos ? std::nullopt : number_of(text.substr(sign + 1));
  if (sign == std::string::npos || sign == 0 || !dose) {
    throw InputError(fmt::format("--region {}: expected MESH=VALUE, as in rim.stl=1.5", text));
  }
  if (*dose < 1) {
    throw InputError(fmt::format(
        "--region {}: expected a dose of 1 or more, since less leaves features liquid", text));
  }
  return {text.substr(0, sign), *dose};
}

/// Where a part's meshes lay in their files, and where the middle of them is on the plate.
struct PartPlace {
  std::array<Point3, 2> box_mm;
  std::array<double, 2> center_mm;
};

PartPlace place_of(const std::array<Point3, 2>& box_mm, const Printer& printer,
                   const MeshOptions& meshes) {
  const Grid plate = plate_grid(printer);
  PartPlace place{
      box_mm, {plate.width_px * plate.pixel_x_um / 2e3, plate.height_px * plate.pixel_y_um / 2e3}};
  if (!meshes.center_mm.empty()) place.center_mm = {meshes.center_mm[0], meshes.center_mm[1]};
  return place;
}

std::array<Point3, 2> box_of(const TriangleMesh& mesh) {
  Point3 low, high;
  low.fill(std::numeric_limits<double>::infinity());
  high.fill(-std::numeric_limits<double>::infinity());
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    if (!mesh.adds(i)) continue;
    for (const std::uint32_t v : mesh.triangles[i]) {
      for (std::size_t k = 0; k < 3; ++k) {
        low[k] = std::min(low[k], mesh.vertices[v][k]);
        high[k] = std::max(high[k], mesh.vertices[v][k]);
      }
    }
  }
  return {low, high};
}

}  // namespace

void DoseOptions::add_to(CLI::App& app) {
  const OptionGroup group(app, "Wanted doses");
  app.add_option(
      "--dose-target", target,
      "Stack of the doses that features are to have: 8-bit images as large as the part's, "
      "where black is a dose of 1 and white that of --dose-target-max");
  app.add_option("--dose-target-max", most, "The dose of white in --dose-target, in critical doses")
      ->check(number_in(1, 1e6));
  app.add_option(
         "--region", regions,
         "MESH=VALUE: the dose that features inside a mesh are to have, in critical doses, 1 or "
         "more; may be given several times, later ones count over earlier ones; outside of all "
         "meshes it is 1")
      ->allow_extra_args(false);
  app.add_option(
         "--dose-side", side,
         "Where wanted doses change too steeply along z: come as near as possible (nearest), "
         "stay nowhere below them (at-least), or nowhere above them (at-most) [nearest]")
      ->check(CLI::IsMember({"nearest", "at-least", "at-most"}));
}

std::vector<std::string> DoseOptions::inputs() const {
  std::vector<std::string> files = designs;
  if (!target.empty()) files.push_back(target);
  for (const std::string& text : regions) files.push_back(text.substr(0, text.rfind('=')));
  return files;
}

WantedDoses::WantedDoses(const DoseOptions& options, const SliceSource& target,
                         const Printer& printer, const MeshOptions& meshes, const MeshSlices* part,
                         const MissingFacts& missing, const std::string& scratch,
                         const ExecutionContext& context)
    : target_(&target) {
  if (!options.any()) {
    const char* const alone = options.most > 0        ? "--dose-target-max"
                              : !options.side.empty() ? "--dose-side"
                                                      : nullptr;
    if (alone) {
      throw InputError(fmt::format("{}: expected --dose-target or --region with it", alone));
    }
    return;
  }
  if (!options.target.empty() && !options.regions.empty()) {
    throw InputError(
        "--dose-target and --region are two ways to say the wanted doses; expected one of them");
  }
  if (!options.target.empty()) {
    if (!(options.most > 0)) {
      throw InputError("--dose-target: expected --dose-target-max, the dose of its white");
    }
    doses_.scale = DoseScale::even(options.most);
    name_ranges(doses_);
    stack_.emplace(design(options.target), scratch, context, missing);
    const bool alike = target.heights().alike() && stack_->heights().alike();
    if (!alike && target.heights() != stack_->heights()) {
      throw InputError(options.target, "",
                       "has layers of other heights than the part; expected the same");
    }
    fitted_.emplace(FittedSlices::like(target, *stack_, scratch, context));
  } else {
    if (options.most > 0) throw InputError("--dose-target-max goes with --dose-target");
    read_regions(options, printer, meshes, part, context);
    fitted_.emplace(FittedSlices::like(target, *images_, scratch, context));
  }
  if (!options.side.empty()) doses_.scale.side = dose_side_named(options.side);
  doses_.images = &**fitted_;
  graded_.emplace(target, doses_);
}

void WantedDoses::read_regions(const DoseOptions& options, const Printer& printer,
                               const MeshOptions& meshes, const MeshSlices* part,
                               const ExecutionContext& context) {
  std::vector<Region> regions;
  for (const std::string& text : options.regions) regions.push_back(region_of(text));
  if (regions.size() > 255) {
    throw InputError(fmt::format("{} regions; expected at most 255", regions.size()));
  }
  std::optional<PartPlace> place;
  // Regions are scaled as the parts are.
  MeshOptions all = meshes;
  if (part) {
    if (meshes.arranges() || meshes.plate.has_own()) {
      throw InputError(
          "--region lies beside the parts as their files have them; expected parts that are not arranged, and "
          "have no sizes or turns of their own");
    }
    place = place_of(part->box_mm(), printer, meshes);
  } else if (!options.designs.empty()) {
    all.parts = options.designs;
    place = place_of(box_of(read_parts(all, context).mesh), printer, meshes);
  }
  const Grid& grid = target_->grid();
  const LayerHeights heights = target_->heights();
  const double first_um = heights.of(0, grid.layer_um), layer_mm = first_um * 1e-3;
  std::vector<RegionImages::Region> images;
  doses_.regions = {"outside of all regions"};
  for (const Region& region : regions) {
    MeshOptions one = all;
    one.parts = {region.path};
    PlateParts mesh = read_parts(one, context);
    const std::array<Point3, 2> box = box_of(mesh.mesh);
    // Where it lies on the plate, cut where the part is cut.
    SliceOptions how;
    how.layer_um = grid.layer_um;
    how.antialias = false;
    how.center_mm = {0.5 * (box[0][0] + box[1][0]), 0.5 * (box[0][1] + box[1][1])};
    double platform_mm = 0;
    if (place) {
      for (std::size_t k = 0; k < 2; ++k) {
        (*how.center_mm)[k] +=
            place->center_mm[k] - 0.5 * (place->box_mm[0][k] + place->box_mm[1][k]);
      }
      platform_mm = place->box_mm[0][2];
    }
    const double under = std::max(0.0, std::ceil((platform_mm - box[0][2]) / layer_mm - 1e-6));
    if (under > 1e6) {
      throw InputError(fmt::format("--region {}: it lies {:g} mm behind the platform", region.path,
                                   platform_mm - box[0][2]));
    }
    how.platform_z_mm = std::min(platform_mm - under * layer_mm, box[0][2]);
    std::vector<double> um = heights.um();
    if (!heights.alike()) um.insert(um.begin(), static_cast<std::size_t>(under), first_um);
    try {
      slices_.push_back(std::make_unique<const MeshInLayers>(
          std::move(mesh.mesh), printer, how, LayerHeights(um), context, &mesh.edge_defects));
    } catch (const InputError& e) {
      throw InputError(fmt::format("--region {}: {}", region.path, e.what()));
    }
    images.push_back({&**slices_.back(), static_cast<int>(under)});
    const std::size_t byte = images.size();
    doses_.scale.dose[byte] = region.dose;
    doses_.region_of[byte] = static_cast<std::uint8_t>(byte);
    doses_.regions.push_back(std::filesystem::path(region.path).filename().string());
  }
  Grid plate = (**slices_.front()).grid();
  plate.layers = grid.layers;
  images_.emplace(plate, std::move(images));
}

}  // namespace slicecorr::cli
