// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fstream>
#include <iterator>

#include "record/left_json.hpp"
#include "slicecorr/bridge/view.hpp"
#include "support/files/text_file.hpp"
#include "support/json/read_json.hpp"
#include "view/state_json.hpp"

namespace slicecorr::bridge {

using detail::Json;

std::string status_text(const StateFolder& folder, const std::string& printer,
                        const std::optional<std::string>& running) {
  Json json;
  json["printer"] = printer;
  json["running"] = running.has_value();
  std::string text = running.value_or("");
  if (!running) {
    text = text_of_file(folder.file("status.json")).value_or("");
  }
  const Json last = slicecorr::detail::try_json<Json>(text);
  if (last.is_object()) json.update(last);
  // Not what a damaged file says of them.
  json["printer"] = printer;
  json["running"] = running.has_value();
  const auto latch = read_latch(folder, false);
  json["latched"] = latch.has_value();
  if (latch) {
    if (latch->left) json["after_fault"] = left_json(*latch->left);
    json["fault"] = name_of(latch->fault);
    json["detail"] = latch->detail;
    json["latched_frame"] = latch->frame;
    json["latched_stage_um"] = latch->stage_um;
    json["latched_z_um"] = latch->z_um;
  }
  const auto fault = fault_of(detail::text_in(json, "fault"));
  if (fault && *fault != Fault::none) json["to_do"] = what_to_do(*fault);
  return detail::dumped(json, 1);
}

Seen seen_in(const std::string& status) {
  const Json json = slicecorr::detail::try_json<Json>(status);
  Seen seen;
  seen.printer = detail::text_in(json, "printer");
  seen.running = detail::flag_in(json, "running");
  seen.known = !detail::text_in(json, "phase").empty();
  seen.facts = detail::facts_in(json);
  seen.state = detail::state_in(json);
  seen.around = detail::around_in(json);
  seen.left_s = detail::number_in(json, "left_s");
  seen.latched = detail::flag_in(json, "latched");
  if (seen.latched) {
    seen.latched_fault = seen.state.fault;
    seen.latched_detail = seen.state.detail;
  }
  return seen;
}

}  // namespace slicecorr::bridge
