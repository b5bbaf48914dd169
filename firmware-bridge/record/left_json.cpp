// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "record/left_json.hpp"

#include <cmath>

#include "support/json/members.hpp"

namespace slicecorr::bridge {
namespace {

using Json = nlohmann::ordered_json;

Json or_null(const std::optional<double>& value) { return value ? Json(*value) : Json(nullptr); }

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
  using slicecorr::detail::flag_in, slicecorr::detail::number_in, slicecorr::detail::text_in;
  if (!json.is_object() || !json.contains("confirmed")) return std::nullopt;
  Left left;
  left.touched = flag_in(json, "touched");
  left.lamps_taken = flag_in(json, "lamps_taken");
  left.heard = flag_in(json, "heard");
  left.dark = flag_in(json, "dark");
  left.stands = flag_in(json, "stands");
  left.bridge_gone = flag_in(json, "bridge_gone");
  left.measured = flag_in(json, "measured");
  left.measured_s_ago = number_in(json, "measured_s_ago");
  left.blue_measured = number_in(json, "blue_measured").value_or(0);
  left.uv_measured = number_in(json, "uv_measured");
  left.stage_um = number_in(json, "stage_um");
  left.stage_deg = number_in(json, "stage_deg");
  left.time = text_in(json, "time");
  return left;
}

}  // namespace slicecorr::bridge
