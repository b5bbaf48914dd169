// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Tables of numbers whose columns are named by a header, in any order.
#pragma once

#include <functional>
#include <limits>
#include <string>
#include <vector>

namespace slicecorr::resins {

struct NumberColumn {
  const char* name;
  double low, high;          ///< of its numbers
  bool required = false;     ///< the header must have it
  bool may_be_empty = true;  ///< whether a cell may be; it then counts as NaN
  /// What may stand there in place of numbers: the n-th word counts as n.
  std::vector<const char*> words = {};
};

/// Numbers of a row, as `columns` are; NaN where the header does not have one or a cell is empty.
/// `place` names the row in complaints.
using NumberRowSink =
    std::function<void(int line, const std::string& place, const std::vector<double>& values)>;

/// Gives all rows of a table. A column `name` is for people and passed over; others that are not known are
/// refused, or passed over and noted in `passed_over`, where that is given. `expected` says what its header is to be, `rows` what its rows are
/// ("points"). Throws `InputError` naming file and line.
void read_number_table(const std::string& path, const std::vector<NumberColumn>& columns,
                       const std::string& expected, const std::string& rows,
                       const NumberRowSink& sink, std::vector<std::string>* passed_over = nullptr);

/// The header's names.
std::vector<std::string> table_header(const std::string& path);

}  // namespace slicecorr::resins
