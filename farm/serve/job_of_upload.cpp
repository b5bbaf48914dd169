// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "serve/job_of_upload.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "slicecorr/farm/submit.hpp"
#include "support/json/members.hpp"
#include "support/json/read_json.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::farm::detail {

std::string job_of_upload(const MachineSpec& machine, const std::string& part,
                          const std::string& name) {
  using Json = nlohmann::ordered_json;
  Json job = slicecorr::detail::own_json<Json>(machine.job_rule);
  job["part"] = part;
  job["for"] = machine.name;
  if (!job.contains("name")) job["name"] = name.substr(0, std::min(name.rfind('.'), name.size()));
  const Json body = {{"jobs", Json::array({job})}};
  return body.dump(-1, ' ', false, Json::error_handler_t::replace);
}

void check_rule(const MachineSpec& machine) {
  static_cast<void>(parse_jobs_json(job_of_upload(machine, "upload:x/part.sl1", "part.sl1"),
                                    "the rule of the machine " + machine.name));
}

std::string refusal_of(const SubmitReply& reply) {
  if (reply.status < 300) return {};
  const auto json = slicecorr::detail::try_json<nlohmann::ordered_json>(reply.json);
  const auto& error = slicecorr::detail::member_of(json, "error");
  std::string why = slicecorr::detail::text_in(error, "message");
  for (const auto& each : slicecorr::detail::member_of(error, "errors")) {
    why += "; " + slicecorr::detail::text_in(each, "message");
  }
  return why.empty() ? "the job was refused" : text::clipped(text::printable(why), 500);
}

}  // namespace slicecorr::farm::detail
