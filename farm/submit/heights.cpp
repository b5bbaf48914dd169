// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "submit/heights.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <vector>

#include "slicecorr/error.hpp"
#include "submit/fields.hpp"

namespace slicecorr::farm {

void place_as(JobRequest& r, const cli::MeshOptions& mesh) {
  r.antialias = mesh.antialias;
  r.units = mesh.units;
  r.scale = mesh.scale;
  r.fit_mm = mesh.fit_mm;
  r.center_mm = mesh.center_mm;
  r.rotate_deg = mesh.rotate_deg;
  r.plate = mesh.plate;
}

}  // namespace slicecorr::farm

namespace slicecorr::farm::detail {

cli::MeshOptions mesh_options_of(const JobRequest& r) {
  cli::MeshOptions o;
  o.parts = r.parts;
  o.layer_um = r.layer_um;
  o.antialias = r.antialias;
  o.center_mm = r.center_mm;
  o.units = r.units;
  o.scale = r.scale;
  o.rotate_deg = r.rotate_deg;
  o.plate = r.plate;
  return o;
}

HeightsBy check_heights(const JobRequest& r, bool mesh) {
  struct Way {
    HeightsBy by;
    const char *key, *option;
    bool is;
  };
  const Way ways[] = {
      {HeightsBy::alike, "layer_um", "--layer-um", r.layer_um > 0},
      {HeightsBy::each, kLayerHeights, "--layers", !r.setup.layer_heights_um.empty()},
      {HeightsBy::slopes, "adaptive_um", "--adaptive-um", !r.adaptive_um.empty()}};
  const auto name = [&](const Way& way) { return r.as_options ? way.option : way.key; };
  std::vector<const Way*> said;
  for (const Way& way : ways) {
    if (way.is) said.push_back(&way);
  }
  const auto is_default = [&](const Way* way) {
    const auto found = r.said.find(way->key);
    return found != r.said.end() && found->second.default_;
  };
  if (!std::all_of(said.begin(), said.end(), is_default)) std::erase_if(said, is_default);
  if (!mesh) {
    for (const Way* way : said) {
      if (way->by == HeightsBy::alike || is_default(way)) continue;
      throw InputError(r.parts[0], "",
                       fmt::format("is an archive, whose slices have their heights; expected no {} "
                                   "with it",
                                   name(*way)));
    }
    return HeightsBy::alike;
  }
  if (said.empty()) {
    throw InputError(fmt::format("{} is missing; expected it, {} or {}", name(ways[0]),
                                 name(ways[1]), name(ways[2])));
  }
  if (said.size() > 1) {
    throw InputError(fmt::format("{} and {} are both said; expected one of them", name(*said[0]),
                                 name(*said[1])));
  }
  return said.front()->by;
}

}  // namespace slicecorr::farm::detail
