// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The keys of either kind of file, each in a table of its own.
#pragma once

#include <span>
#include <string_view>

#include "slicecorr/definition_keys.hpp"

namespace slicecorr::detail {

/// What a number may be: from `low` to `high`, `low` itself only when it counts.
struct KeyBounds {
  double low = 0, high = 0;
  bool low_counts = false;
};
constexpr KeyBounds between(double low, double high) { return {low, high}; }
constexpr KeyBounds up_to(double high) { return {0, high}; }
constexpr KeyBounds from(double low, double high) { return {low, high, true}; }

/// Rows of one table: a key, what it holds, within which bounds or of which choices, and what it is.
struct KeysOf {
  std::string_view table;

  constexpr KeyRule operator()(std::string_view key, KeyType type, std::string_view what) const {
    return {.table = table, .key = key, .type = type, .what = what};
  }
  constexpr KeyRule operator()(std::string_view key, KeyType type, KeyBounds in,
                               std::string_view what) const {
    return {.table = table,
            .key = key,
            .type = type,
            .low = in.low,
            .high = in.high,
            .low_counts = in.low_counts,
            .what = what};
  }
  constexpr KeyRule operator()(std::string_view key, KeyType type, std::string_view choices,
                               std::string_view what) const {
    return {.table = table, .key = key, .type = type, .choices = choices, .what = what};
  }
};
inline constexpr KeysOf kRoot{""}, kProvenance{"provenance"};
constexpr KeyRule required(KeyRule rule) {
  rule.required = true;
  return rule;
}
constexpr KeyRule also_at_top(KeyRule rule) {
  rule.also_at_top = true;
  return rule;
}

std::span<const KeyRule> resin_keys();
std::span<const KeyRule> printer_keys();

}  // namespace slicecorr::detail
