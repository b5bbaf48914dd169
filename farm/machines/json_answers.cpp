// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "machines/json_answers.hpp"

#include "slicecorr/error.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::farm::detail {

Json json_of(const HttpAnswer& answer, const std::string& where) {
  Json json = slicecorr::detail::try_json<Json>(answer.body, kAnswerBounds);
  if (!json.is_structured()) throw DeviceError(where + ": answers with what is no JSON");
  return json;
}

void check_answer(const HttpAnswer& answer, const std::string& where, const std::string& what) {
  if (answer.ok()) return;
  const std::string text = where + ": " + what + ": " + http_trouble(answer);
  if (answer.status >= 300 && answer.status < 500) throw InputError(text);
  throw DeviceError(text);
}

std::string shown_text(const Json& json, const char* key) {
  return text::printable(text_in(json, key).substr(0, 200));
}

bool loose_flag(const Json& json, const char* key) {
  const Json& value = member_of(json, key);
  return value.is_boolean() ? value.get<bool>() : value.is_number() && value.get<double>() != 0;
}

}  // namespace slicecorr::farm::detail
