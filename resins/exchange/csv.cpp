// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "exchange/csv.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "slicecorr/error.hpp"
#include "support/text/ascii.hpp"
#include "support/text/csv.hpp"

namespace slicecorr::resins {

CsvTable::CsvTable(std::string_view text, std::string source, Header header)
    : source_(std::move(source)) {
  CsvReader reader = CsvReader::of_text(text, source_, {.quotes_inside_cells = true});
  for (CsvRow row; reader.next(row);) {
    if (header_.empty() && header == Header::optional &&
        std::all_of(row.cells.begin(), row.cells.end(),
                    [](const std::string& cell) { return number_in_text(cell).has_value(); })) {
      for (std::size_t i = 0; i < row.cells.size(); ++i) header_.push_back(std::to_string(i + 1));
    }
    if (header_.empty()) {
      for (std::string& name : row.cells) name = lower_case(name);
      header_ = std::move(row.cells);
      for (std::size_t i = 0; i < header_.size(); ++i) {
        if (std::count(header_.begin(), header_.end(), header_[i]) > 1) {
          throw InputError(source_, reader.place(),
                           fmt::format("column '{}' stands twice in the header", header_[i]));
        }
      }
      continue;
    }
    if (row.cells.size() > header_.size()) {
      throw InputError(source_, reader.place(),
                       fmt::format("has {} cells; expected the {} of the header", row.cells.size(),
                                   header_.size()));
    }
    row.cells.resize(header_.size());
    rows_.push_back({row.line, std::move(row.cells)});
  }
  if (header_.empty()) throw InputError(source_, "", "is empty; expected a header row");
}

int CsvTable::index(std::string_view column) const {
  const auto at = std::find(header_.begin(), header_.end(), column);
  return at == header_.end() ? -1 : static_cast<int>(at - header_.begin());
}

std::string CsvTable::cell(const Row& row, std::string_view column) const {
  const int i = index(column);
  return i < 0 ? "" : row.cells[static_cast<std::size_t>(i)];
}

std::optional<double> CsvTable::number(const Row& row, std::string_view column) const {
  const std::string text = cell(row, column);
  if (text.empty()) return std::nullopt;
  const auto value = number_in_text(text);
  if (!value) fail(row, column, fmt::format("is '{}'; expected a number", text));
  return value;
}

void CsvTable::fail(const Row& row, std::string_view column, const std::string& message) const {
  throw InputError(source_, fmt::format("line {}: column {}", row.line, column), message);
}

}  // namespace slicecorr::resins
