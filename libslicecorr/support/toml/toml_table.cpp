// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "support/toml/toml_table.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "slicecorr/error.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr {

unsigned TomlTable::line(std::string_view key) const {
  const toml::node* node = table_.get(key);
  return node ? node->source().begin.line : table_.source().begin.line;
}

namespace {
/// No quantity of a resin or printer comes near, in any unit.
constexpr double kLeastMagnitude = 1e-30, kMostMagnitude = 1e30;
}  // namespace

void TomlTable::fail(std::string_view key, const std::string& message) const {
  throw InputError(source_, fmt::format("line {}: {}{}", line(key), prefix_, key), message);
}

std::optional<TomlTable> TomlTable::table(std::string_view key) const {
  const toml::node* node = table_.get(key);
  if (!node) return std::nullopt;
  if (!node->is_table()) fail(key, "expected a table");
  return TomlTable(*node->as_table(), source_, prefix_ + std::string(key) + ".");
}

TomlTable TomlTable::required_table(std::string_view key) const {
  auto t = table(key);
  if (!t) fail(key, "missing; expected a table");
  return *t;
}

std::string TomlTable::text(std::string_view key, const std::string& fallback) const {
  const toml::node* node = table_.get(key);
  if (!node) return fallback;
  if (!node->is_string()) fail(key, "expected a text in quotes");
  return **node->as_string();
}

std::optional<double> TomlTable::number(std::string_view key, double low, double high,
                                        bool closed) const {
  const toml::node* node = table_.get(key);
  if (!node) return std::nullopt;
  const auto value = node->value<double>();
  if (!value || !node->is_number()) fail(key, "expected a number");
  const bool low_fits = closed ? *value >= low : *value > low;
  if (!std::isfinite(*value) || !low_fits || *value > high) {
    fail(key, fmt::format("is {:g}; expected a number {} {:g} and at most {:g}", *value,
                          closed ? "of at least" : "above", low, high));
  }
  // Products and quotients of a few such numbers are numbers.
  if (*value != 0 && std::abs(*value) < kLeastMagnitude) {
    fail(key, fmt::format("is {:g}; expected 0 or a number further from it", *value));
  }
  if (std::abs(*value) > kMostMagnitude) {
    fail(key, fmt::format("is {:g}; expected at most {:g}", *value, kMostMagnitude));
  }
  return value;
}

double TomlTable::required_number(std::string_view key, double low, double high) const {
  const auto value = number(key, low, high);
  if (!value) fail(key, "missing; expected a number");
  return *value;
}

int TomlTable::required_integer(std::string_view key, int low, int high) const {
  if (!has(key)) fail(key, "missing; expected a whole number");
  return integer(key, low, high, low);
}

int TomlTable::integer(std::string_view key, int low, int high, int fallback) const {
  const toml::node* node = table_.get(key);
  if (!node) return fallback;
  if (!node->is_integer()) fail(key, "expected a whole number");
  const auto value = **node->as_integer();
  if (value < low || value > high) {
    fail(key, fmt::format("is {}; expected {} to {}", value, low, high));
  }
  return static_cast<int>(value);
}

namespace {

/// More than any table of ours has, and little enough for functions that call themselves for each.
constexpr int kMostNames = 16, kMostNested = 32;

/// Place of the last character of a text in quotes that begins at `at`, or of the text's end.
std::size_t end_of_quotes(std::string_view text, std::size_t at) {
  const char quote = text[at];
  const std::string three(3, quote);
  const bool lines = text.substr(at, 3) == three;
  for (std::size_t i = at + (lines ? 3 : 1); i < text.size(); ++i) {
    if (quote == '"' && text[i] == '\\') {
      ++i;
    } else if (lines ? text.substr(i, 3) == three : text[i] == quote || text[i] == '\n') {
      if (!lines) return text[i] == '\n' ? i - 1 : i;
      // One or two more may stand before the three that end it.
      for (i += 2; i + 1 < text.size() && text[i + 1] == quote;) ++i;
      return i;
    }
  }
  return text.size();
}

/// Line in which a name has too many parts, `a.a.a`, or values are too deep in each other.
std::optional<std::size_t> line_too_deep(std::string_view text) {
  std::size_t line = 1;
  int names = 1, nested = 0;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (c == '#') {
      i = std::min(text.find('\n', i), text.size()) - 1;
    } else if (c == '"' || c == '\'') {
      const std::size_t end = std::min(end_of_quotes(text, i), text.size() - 1);
      line += static_cast<std::size_t>(std::count(text.begin() + static_cast<std::ptrdiff_t>(i),
                                                  text.begin() + static_cast<std::ptrdiff_t>(end),
                                                  '\n'));
      i = end;
    } else if (c == '.') {
      if (++names > kMostNames) return line;
    } else if (c == '=' || c == ',' || c == '\n') {
      names = 1;
      line += c == '\n' ? 1 : 0;
    } else if (c == '[' || c == '{') {
      names = 1;
      if (++nested > kMostNested) return line;
    } else if (c == ']' || c == '}') {
      nested = std::max(0, nested - 1);
    }
  }
  return std::nullopt;
}

}  // namespace

std::optional<toml::table> try_toml(std::string_view text, const std::string& source,
                                    TomlFault* fault) {
  const auto refuse = [&](std::size_t line, std::string what) {
    if (fault) *fault = {line, std::move(what)};
    return std::nullopt;
  };
  if (text.size() > kMostTextBytes) return refuse(0, "it is too long");
  if (const auto line = line_too_deep(text)) {
    return refuse(*line,
                  fmt::format("names of more than {} parts, or more than {} lists and tables "
                              "in each other",
                              kMostNames, kMostNested));
  }
  try {
    return toml::parse(text, source);
  } catch (const toml::parse_error& e) {
    return refuse(e.source().begin.line, text::printable(e.description()));
  }
}

toml::table parse_toml(std::string_view text, const std::string& source) {
  TomlFault fault;
  if (auto table = try_toml(text, source, &fault)) return std::move(*table);
  throw InputError(source, fmt::format("line {}", fault.line), "is not TOML: " + fault.what);
}

}  // namespace slicecorr
