// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file members.hpp
/// Members of objects of which nothing is sure: what is missing or of another type is as if it was
/// not said, and so is all of what is no object.
#pragma once

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

namespace slicecorr::detail {

/// The member, or null.
template <class Json>
const Json& member_of(const Json& json, const char* key) {
  static const Json none;
  if (!json.is_object()) return none;
  const auto found = json.find(key);
  return found == json.end() ? none : *found;
}

/// A finite number.
template <class Json>
std::optional<double> number_in(const Json& json, const char* key) {
  const Json& member = member_of(json, key);
  if (!member.is_number()) return std::nullopt;
  const double value = member.template get<double>();
  return std::isfinite(value) ? std::optional(value) : std::nullopt;
}
template <class Json>
double number_in(const Json& json, const char* key, double otherwise) {
  return number_in(json, key).value_or(otherwise);
}
/// The whole number, cut to what an int holds.
template <class Json>
int whole_in(const Json& json, const char* key, int otherwise) {
  const auto value = number_in(json, key);
  return value ? static_cast<int>(std::clamp(*value, -2e9, 2e9)) : otherwise;
}
template <class Json>
bool flag_in(const Json& json, const char* key) {
  const Json& member = member_of(json, key);
  return member.is_boolean() && member.template get<bool>();
}
template <class Json>
std::string text_in(const Json& json, const char* key) {
  const Json& member = member_of(json, key);
  return member.is_string() ? member.template get<std::string>() : std::string();
}

}  // namespace slicecorr::detail
