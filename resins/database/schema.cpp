// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "database/schema.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace slicecorr::resins {

namespace {

using enum KeyType;

std::string expected_of(const KeyRule& r) {
  const auto range = [&] {
    return fmt::format("{} {:g}, at most {:g}", r.low_counts ? "from" : "above", r.low, r.high);
  };
  const auto listed = [&] {
    std::string list(r.choices);
    for (std::size_t at = 0; (at = list.find('|', at)) != std::string::npos;) {
      list.replace(at, 1, ", ");
    }
    return list;
  };
  switch (r.type) {
    case text:
      return "text";
    case texts:
      return "list of texts";
    case number:
      return "number " + range();
    case whole:
      return fmt::format("whole number, {:g} to {:g}", r.low, r.high);
    case choice:
      return "one of " + listed();
    case base:
      return "10 or \"e\"";
    case pixel:
      return "number or [x, y], " + range();
    case calibration:
      return "[[level, mW/cm²], ...] or a .csv";
    case spread:
      return "[[sigma um, weight], ...] or a .png";
    case mirror:
      return "true, false or one of " + listed();
    case file:
      return "file name";
    case notes:
      return "texts, numbers, dates, lists of texts";
    case parts:
      return "numbers " + range();
    case truth:
      return "true or false";
    case anything:
      return "anything";
  }
  return "";
}

}  // namespace

std::string schema_table(std::string_view kind) {
  std::string out = "| table | key | value | what |\n|---|---|---|---|\n";
  for (const KeyRule& r : definition_keys(kind)) {
    out += fmt::format(
        "| {} | {} | {}{} | {} |\n",
        r.table.empty() ? "" : fmt::format("`[{}]`{}", r.table, r.also_at_top ? " or top" : ""),
        r.key == "*" ? "any" : fmt::format("`{}`", r.key), expected_of(r),
        r.required ? "; required" : "", r.what);
  }
  return out;
}

bool is_stable_name(std::string_view name) {
  const auto good = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-' || c == '.' || c == '_';
  };
  return !name.empty() && name.size() <= 100 && std::all_of(name.begin(), name.end(), good) &&
         name[0] != '-' && name[0] != '.' && name[0] != '_' && !name.ends_with(".toml");
}

}  // namespace slicecorr::resins
