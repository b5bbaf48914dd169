// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "record/left_json.hpp"

#include <cmath>

namespace slicecorr::bridge {
namespace {

using Json = nlohmann::ordered_json;

Json or_null(const std::optional<double>& value) { return value ? Json(*value) : Json(nullptr); }

bool flag(const Json& json, const char* key) {
  const auto found = json.find(key);
  return found != json.end() && found->is_boolean() && found->get<bool>();
}
std::optional<double> number(const Json& json, const char* key) {
  const auto found = json.find(key);
  if (found == json.end() || !found->is_number()) return std::nullopt;
  const double value = found->get<double>();
  return std::isfinite(value) ? std::optional(value) : std::nullopt;
}

}  // namespace

Json left_json(const Left& left) {
  Json json;
  json["confirmed"] = left.confirmed();
  json["text"] = in_words(left);
  json["time"] = left.time;
  json["touched"] = left.touched;
  json["lamps_taken"] = left.lamps_taken;
  json["heard"] = left.heard;
  json["dark"] = left.dark;
  json["stands"] = left.stands;
  json["bridge_gone"] = left.bridge_gone;
  json["measured"] = left.measured;
  json["measured_s_ago"] = or_null(left.measured_s_ago);
  json["blue_measured"] = left.measured ? Json(left.blue_measured) : Json(nullptr);
  json["uv_measured"] = left.measured ? or_null(left.uv_measured) : Json(nullptr);
  json["stage_um"] = left.measured && left.stage_um ? Json(*left.stage_um) : Json(nullptr);
  if (left.stage_deg) json["stage_deg"] = left.measured ? Json(*left.stage_deg) : Json(nullptr);
  return json;
}

std::optional<Left> left_in(const Json& json) {
  if (!json.is_object() || !json.contains("confirmed")) return std::nullopt;
  Left left;
  left.touched = flag(json, "touched");
  left.lamps_taken = flag(json, "lamps_taken");
  left.heard = flag(json, "heard");
  left.dark = flag(json, "dark");
  left.stands = flag(json, "stands");
  left.bridge_gone = flag(json, "bridge_gone");
  left.measured = flag(json, "measured");
  left.measured_s_ago = number(json, "measured_s_ago");
  left.blue_measured = number(json, "blue_measured").value_or(0);
  left.uv_measured = number(json, "uv_measured");
  left.stage_um = number(json, "stage_um");
  left.stage_deg = number(json, "stage_deg");
  const auto time = json.find("time");
  if (time != json.end() && time->is_string()) left.time = time->get<std::string>();
  return left;
}

}  // namespace slicecorr::bridge
