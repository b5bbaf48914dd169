// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Tables with a header row, by the names of their columns.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace slicecorr::resins {

/// A table with its header in lower case; short rows are filled up with empty cells.
class CsvTable {
 public:
  struct Row {
    int line = 0;  ///< in the file, from 1
    std::vector<std::string> cells;
  };
  /// Throws `InputError` when there is no header row, a header stands twice, or a row is too long.
  /// Where the header is `optional`, a first row of numbers alone is data; its columns are then
  /// called 1, 2, ...
  enum class Header { required, optional };
  CsvTable(std::string_view text, std::string source, Header header = Header::required);

  const std::vector<std::string>& header() const { return header_; }
  const std::vector<Row>& rows() const { return rows_; }
  bool has(std::string_view column) const { return index(column) >= 0; }
  /// Cell of a column; empty when there is no such column.
  std::string cell(const Row& row, std::string_view column) const;
  /// Number in a cell; nothing when the cell is empty. Throws `InputError` for other text.
  std::optional<double> number(const Row& row, std::string_view column) const;
  [[noreturn]] void fail(const Row& row, std::string_view column, const std::string& message) const;

 private:
  int index(std::string_view column) const;

  std::string source_;
  std::vector<std::string> header_;
  std::vector<Row> rows_;
};

}  // namespace slicecorr::resins
