// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file json_answers.hpp
/// Answers of machines over HTTP as JSON, of which nothing is sure.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "machines/http_calls.hpp"
#include "support/json/members.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr::farm::detail {

using Json = nlohmann::ordered_json;
using slicecorr::detail::member_of, slicecorr::detail::number_in, slicecorr::detail::text_in;

inline constexpr slicecorr::detail::JsonBounds kAnswerBounds{kMostAnswerBytes, 16, 200'000};

/// The object or list of an answer. Throws `DeviceError` where it is none.
Json json_of(const HttpAnswer& answer, const std::string& where);
/// Throws `InputError` for what the machine refuses (4xx, redirects), `DeviceError` for its own
/// failures.
void check_answer(const HttpAnswer& answer, const std::string& where, const std::string& what);
/// A member as a text that may be shown, at most 200 bytes; empty where it is none.
std::string shown_text(const Json& json, const char* key);
/// true, or a number other than 0.
bool loose_flag(const Json& json, const char* key);

}  // namespace slicecorr::farm::detail
