// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file measuring_form.hpp
/// Tables to fill in: what of a test part is to be measured, and what was.
///
/// A form is a CSV table. Its first line is a comment that names the part, with a hash of all but
/// what is filled in, so that tables of another part, or whose rows were moved, are found out:
///
///     # slicecorr testpart,comb,layer_um,50,...,known,3,hash,0123456789abcdef
///     name,kind,designed_um,measured_um
///     tooth 1 begins,upper,1000,
///
/// Plain values; functions are thread-safe.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace slicecorr {

struct MeasuringForm {
  std::string source;  ///< what messages call it
  std::string part;    ///< kind of the part: "comb"
  /// What else is to be known of it: "layer_um", "50". No commas.
  std::vector<std::pair<std::string, std::string>> facts;
  std::vector<std::string> columns;            ///< those that are known come first
  std::size_t known = 0;                       ///< how many are
  std::vector<std::vector<std::string>> rows;  ///< cells, as many as columns or fewer
  std::vector<int> lines;                      ///< of the rows in the file, from 1
  std::string note;                            ///< for whoever fills it in; one line

  /// A number to six digits.
  void add_fact(const std::string& name, double value);
  /// Throws `InputError` where the fact is missing or no number from `least` to `most`.
  double fact(const std::string& name, double least, double most) const;
  /// The cell of a column; empty where the row is short or there is no such column.
  std::string cell(std::size_t row, const std::string& column) const;
  /// Throws `InputError`, naming the column, where the table has none of this name.
  void expect_column(const std::string& column) const;
  /// The number in it; nothing where it is empty. Throws `InputError` with line and column.
  std::optional<double> number(std::size_t row, const std::string& column, double least,
                               double most) const;
};

/// The table as text, with its hash.
std::string form_text(const MeasuringForm& form);

/// Reads a form that was filled in; nothing where the file is another table. Throws `InputError`
/// where it can't be read, or where what should only be filled in does not have the hash.
std::optional<MeasuringForm> read_form(const std::string& path);

/// For readers of tables who know what to do with the forms of some parts: throws `InputError` when
/// the file is a form of another part, and names the program that reads it. Other tables pass.
void expect_form_of(const std::string& path, const std::vector<std::string>& parts);

/// The form of one of these parts. Throws `InputError` when the file is anything else, or not there.
MeasuringForm read_form_of(const std::string& path, const std::vector<std::string>& parts);

}  // namespace slicecorr
