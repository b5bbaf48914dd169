// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "mesh/properties_3mf.hpp"

namespace slicecorr::detail {

Properties3mf::Kind Properties3mf::kind_of(std::string_view element) {
  if (element == "basematerials") return Kind::base;
  if (element == "colorgroup") return Kind::colours;
  if (element == "texture2d") return Kind::texture;
  if (element == "texture2dgroup") return Kind::texture_places;
  if (element == "compositematerials") return Kind::composites;
  if (element == "multiproperties") return Kind::multiple;
  return Kind::other;
}

std::string Properties3mf::add(std::uint32_t id, Kind kind,
                               const std::vector<std::uint32_t>& references) {
  int materials = 0, colours = 0;
  for (const std::uint32_t other : references) {
    const auto found = kinds_.find(other);
    const std::string name = std::to_string(other);
    if (found == kinds_.end()) return "names the resource " + name + ", which there is not before";
    const Kind its = found->second;
    if (kind == Kind::texture_places && its != Kind::texture) {
      return "names the resource " + name + ", expected a texture2d";
    }
    if (kind == Kind::composites && its != Kind::base) {
      return "names the resource " + name + ", expected basematerials";
    }
    if (kind != Kind::multiple) continue;
    if (its == Kind::multiple) return "names the resource " + name + ", other multiproperties";
    materials += its == Kind::base || its == Kind::composites;
    colours += its == Kind::colours;
  }
  if (materials > 1) return "names more than one group of materials";
  if (colours > 1) return "names more than one group of colours";
  kinds_.emplace(id, kind);
  return {};
}

std::string Properties3mf::check_used(std::uint32_t id) const {
  const auto found = kinds_.find(id);
  const std::string name = std::to_string(id);
  if (found == kinds_.end())
    return "the property group " + name + " is not there before it is used";
  if (found->second == Kind::texture) return "the resource " + name + " is no group of properties";
  return {};
}

}  // namespace slicecorr::detail
