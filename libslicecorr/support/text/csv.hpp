// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file csv.hpp
/// Tables of text with commas, as RFC 4180 has them: one reader for all of them.
///
/// Lines end with LF, CRLF or CR; a byte order mark is passed over. Cells are separated by commas,
/// may stand in double quotes, where a quote is written twice, and are given without the quotes and
/// the blanks around them. Rows may have different numbers of cells. Blank lines are passed over,
/// and so are lines that begin with `#`. A reader is used by one thread at a time; the functions
/// are pure.
#pragma once

#include <cstdio>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace slicecorr {

/// Where tables differ from what is said above, because their files always did.
struct CsvRules {
  /// `#` outside of quotes starts a comment wherever it stands, not only at the begin of a line.
  /// Measurements, with remarks behind rows.
  bool comments_behind_cells = false;
  /// A quote opens and closes quotes also inside a cell: `5 "per cent"` is `5 per cent`. Otherwise
  /// it does so only where a cell begins, and is a character like others elsewhere. Tables of
  /// published curves.
  bool quotes_inside_cells = false;
  /// Quotes may hold line ends. Files of jobs.
  bool lines_in_quotes = false;
  /// Rows of empty cells alone are passed over: spreadsheets write empty rows as commas.
  bool skip_empty_rows = false;
  /// A control byte outside of quotes is a fault, so that binary files are found out.
  bool control_bytes_are_faults = false;
  /// A longer line is a fault: a file without line ends must not fill the memory.
  std::size_t longest_line_bytes = std::numeric_limits<std::size_t>::max();
};

/// A row. Where it has a fault, its cells are given as well as they could be read.
struct CsvRow {
  enum class Fault {
    none,
    open_quote,        ///< quotes that are not closed; `at_fault` is what stands in them
    text_after_quote,  ///< `at_fault` is what stands behind the quotes up to the end of the line
    control_byte,      ///< `at_fault` is the byte
    long_line          ///< without cells
  };
  int line = 0;  ///< that it begins on, from 1
  std::vector<std::string> cells;
  Fault fault = Fault::none;  ///< the first
  std::string at_fault;
};

/// Rows of a file or text, one after the other.
class CsvReader {
 public:
  /// Opens a file; throws `InputError` when it can't be read. Takes memory for a row, not for the
  /// file.
  static CsvReader of_file(const std::string& path, const CsvRules& rules = {});
  static CsvReader of_text(std::string_view text, const std::string& source,
                           const CsvRules& rules = {});

  /// Gives the next row; false at the end. Throws `InputError` for UTF-16 and workbooks, and
  /// `DeviceError` when reading fails.
  bool next(CsvRow& row);
  const std::string& source() const { return source_; }
  /// "line N" of the row that `next` gave.
  std::string place() const;

 private:
  CsvReader(std::string source, const CsvRules& rules)
      : source_(std::move(source)), rules_(rules) {}
  /// Drops what was given, and reads on.
  void fill();
  void begin();
  /// The next line, valid until the next call, and how it ends.
  bool read_line(std::string_view& line, std::string_view& ending);
  /// Splits a line, and those that its quotes reach into; whether any cell stands in quotes.
  bool split(std::string_view line, std::string_view ending, CsvRow& row);

  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  std::string source_;
  CsvRules rules_;
  std::unique_ptr<std::FILE, Close> file_;
  std::string buffer_;
  std::size_t at_ = 0;
  bool ended_ = false, begun_ = false;
  int number_ = 0, row_line_ = 0;
};

/// A cell as it is written: in quotes where it needs them, on one line.
std::string csv_cell(const std::string& text);

/// The pieces between the commas of a line of a table that programs write, without quotes; one
/// empty piece for an empty line. Views into the line.
std::vector<std::string_view> comma_separated(std::string_view line);

/// The whole text as a finite number; blanks around it don't count.
std::optional<double> number_in_text(std::string_view text);

}  // namespace slicecorr
