// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/formats/vial_json.hpp"

#include "slicecorr/vial_outline.hpp"

namespace slicecorr::detail {

void read_shape(const JsonNode<nlohmann::json>& node, Vial& vial) {
  if (node.has("shape")) {
    vial.shape = static_cast<VialShape>(node["shape"].choice({"round", "square", "outline"}));
  }
  if (vial.shape == VialShape::square) {
    vial.side_mm = node["side_mm"].positive();
    vial.corner_mm = node["corner_mm"].number(0, JsonSource::kLargest);
  }
  if (vial.shape == VialShape::outline) {
    for (const auto& corner : node["outline"].list(3, kMostCorners)) {
      const auto xy = corner.list(2, 2);
      vial.outline.push_back({xy[0].number(-JsonSource::kLargest, JsonSource::kLargest),
                              xy[1].number(-JsonSource::kLargest, JsonSource::kLargest)});
    }
  }
  if (vial.shape != VialShape::round) vial.wall_mm = node["wall_mm"].positive();
  if (node.has("rods")) {
    for (const auto& rod : node["rods"].list(1, kMostRods)) {
      const auto of = rod.list(5, 5);
      vial.rods.push_back({of[0].number(-JsonSource::kLargest, JsonSource::kLargest),
                           of[1].number(-JsonSource::kLargest, JsonSource::kLargest),
                           of[2].positive(), of[3].number(0, 3), of[4].number(0, 1)});
    }
  }
  if (wrong_outline(vial)) node.fail("walls and rods that go with each other");
  set_radii(vial);
}

nlohmann::ordered_json shape_json(const Vial& vial) {
  using Json = nlohmann::ordered_json;
  Json json = Json::object();
  if (vial.shape != VialShape::round) {
    json["shape"] = name_of(vial.shape);
    json["wall_mm"] = vial.wall_mm;
  }
  if (vial.shape == VialShape::square) {
    json["side_mm"] = vial.side_mm;
    json["corner_mm"] = vial.corner_mm;
  }
  for (const FlatPoint& c : vial.outline) {
    json["outline"].push_back(Json::array({c.x_mm, c.y_mm}));
  }
  for (const Rod& r : vial.rods) {
    json["rods"].push_back(Json::array({r.x_mm, r.y_mm, r.diameter_mm, r.n, r.reflects}));
  }
  return json;
}

}  // namespace slicecorr::detail
