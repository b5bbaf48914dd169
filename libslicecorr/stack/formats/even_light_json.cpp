// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/formats/even_light_json.hpp"

#include "support/text/base64.hpp"

namespace slicecorr::detail {

namespace {

using Bytes = std::shared_ptr<const std::vector<std::uint8_t>>;

Bytes read_bytes(const JsonNode<nlohmann::json>& node) {
  auto bytes = from_base64(node.string());
  if (!bytes) node.fail("bytes in base 64");
  return std::make_shared<const std::vector<std::uint8_t>>(std::move(*bytes));
}

}  // namespace

nlohmann::ordered_json even_light_json(const EvenLight& light) {
  nlohmann::ordered_json json{{"columns", light.columns},   {"rows", light.rows},
                              {"pitch_um", light.pitch_um}, {"left_um", light.left_um},
                              {"top_um", light.top_um},     {"gap_um", light.gap_um},
                              {"slices", light.slices},     {"blue", base64(*light.blue)}};
  if (light.uv) json["uv"] = base64(*light.uv);
  return json;
}

EvenLight read_even_light(const JsonNode<nlohmann::json>& node) {
  EvenLight light;
  light.columns = node["columns"].integer(1, EvenLight::kMostCells);
  light.rows = node["rows"].integer(1, EvenLight::kMostCells);
  light.pitch_um = node["pitch_um"].positive(1e9);
  light.left_um = node["left_um"].number(-1e9, 1e9);
  light.top_um = node["top_um"].number(-1e9, 1e9);
  light.gap_um = node["gap_um"].positive(1e9);
  for (const auto& slice : node["slices"].list(1, 1000000)) {
    light.slices.push_back(slice.integer(0, 1000000));
  }
  light.blue = read_bytes(node["blue"]);
  if (node.has("uv")) light.uv = read_bytes(node["uv"]);
  try {
    check_even_light(light, "the block");
  } catch (const InputError& e) {
    node.refuse(e.what());
  }
  return light;
}

}  // namespace slicecorr::detail
