// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "measure/number_table.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "slicecorr/error.hpp"
#include "support/text/csv.hpp"

namespace slicecorr::resins {

namespace {

constexpr int kMostRows = 100000;
constexpr std::size_t kNotThere = std::numeric_limits<std::size_t>::max();
/// A column for people.
constexpr std::size_t kName = kNotThere - 1;
/// A column that counts for nothing.
constexpr std::size_t kPassedOver = kNotThere - 2;

CsvReader reader_of(const std::string& path) {
  return CsvReader::of_file(
      path,
      {.skip_empty_rows = true, .control_bytes_are_faults = true, .longest_line_bytes = 65536});
}

std::size_t column_named(const std::vector<NumberColumn>& columns, const std::string& name) {
  for (std::size_t i = 0; i < columns.size(); ++i) {
    if (name == columns[i].name) return i;
  }
  return kNotThere;
}

double value_of(const NumberColumn& c, const std::string& text, const std::string& path,
                const std::string& place) {
  if (text.empty() && c.may_be_empty) return std::numeric_limits<double>::quiet_NaN();
  std::string words;
  for (std::size_t i = 0; i < c.words.size(); ++i) {
    if (text == c.words[i]) return static_cast<double>(i);
    words += fmt::format("{}{}", i ? " or " : "", c.words[i]);
  }
  const auto value = c.words.empty() ? number_in_text(text) : std::nullopt;
  if (value && *value >= c.low && *value <= c.high) return *value;
  if (words.empty()) words = fmt::format("a number from {:g} to {:g}", c.low, c.high);
  throw InputError(path, place, fmt::format("{} is '{}'; expected {}", c.name, text, words));
}

}  // namespace

std::vector<std::string> table_header(const std::string& path) {
  CsvReader reader = reader_of(path);
  CsvRow row;
  if (!reader.next(row)) return {};
  return row.cells;
}

void read_number_table(const std::string& path, const std::vector<NumberColumn>& columns,
                       const std::string& expected, const std::string& rows,
                       const NumberRowSink& sink, std::vector<std::string>* passed_over) {
  CsvReader reader = reader_of(path);
  CsvRow row;
  if (!reader.next(row)) {
    throw InputError(path, "", fmt::format("is empty; expected a header and {}", rows));
  }
  std::vector<std::size_t> order;
  for (const std::string& name : row.cells) {
    std::size_t column = column_named(columns, name);
    if (column == kNotThere && name == "name") column = kName;
    if (column == kNotThere && passed_over) {
      passed_over->push_back(name);
      order.push_back(kPassedOver);
      continue;
    }
    const bool twice = std::find(order.begin(), order.end(), column) != order.end();
    if (column == kNotThere || twice) {
      throw InputError(path, reader.place(),
                       fmt::format("column '{}'{}; expected a header with {}", name,
                                   twice ? " stands twice" : " is not known", expected));
    }
    order.push_back(column);
  }
  for (std::size_t i = 0; i < columns.size(); ++i) {
    if (columns[i].required && std::find(order.begin(), order.end(), i) == order.end()) {
      throw InputError(path, reader.place(), fmt::format("has no column {}", columns[i].name));
    }
  }
  int count = 0;
  std::vector<double> values(columns.size());
  while (reader.next(row)) {
    if (row.fault != CsvRow::Fault::none || row.cells.size() != order.size()) {
      throw InputError(
          path, reader.place(),
          fmt::format("has {} cells; expected {}, as the header", row.cells.size(), order.size()));
    }
    if (count++ == kMostRows) {
      throw InputError(path, reader.place(),
                       fmt::format("has more {} than expected; at most {}", rows, kMostRows));
    }
    std::fill(values.begin(), values.end(), std::numeric_limits<double>::quiet_NaN());
    for (std::size_t i = 0; i < order.size(); ++i) {
      if (order[i] == kName || order[i] == kPassedOver) continue;
      values[order[i]] = value_of(columns[order[i]], row.cells[i], path, reader.place());
    }
    sink(row.line, reader.place(), values);
  }
  if (count == 0) {
    throw InputError(path, "", fmt::format("has no {}; expected rows below its header", rows));
  }
}

}  // namespace slicecorr::resins
