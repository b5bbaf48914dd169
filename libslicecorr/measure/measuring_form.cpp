// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/measuring_form.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <system_error>

#include "measure/sheet_commands.hpp"
#include "slicecorr/error.hpp"
#include "support/text/csv.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr {

namespace {

constexpr std::string_view kBegin = "# slicecorr testpart";
/// Rows of the largest part, many times over.
constexpr std::size_t kMostRows = 10000;

/// Spreadsheets write 0.70 as 0.7: numbers count by their value.
std::string hashed(const std::string& cell) {
  const auto value = number_in_text(cell);
  return value ? fmt::format("{:.6g}", *value) : cell;
}

/// 16 hex digits of all that is known.
std::string hash_of(const MeasuringForm& form) {
  std::uint64_t hash = 14695981039346656037ull;  // FNV-1a
  const auto add = [&](const std::string& cell) {
    for (const char c : hashed(cell) + ",") {
      hash ^= static_cast<unsigned char>(c);
      hash *= 1099511628211ull;
    }
  };
  add(form.part);
  for (const auto& [name, value] : form.facts) {
    add(name);
    add(value);
  }
  const auto known = [&](const std::vector<std::string>& cells) {
    for (std::size_t i = 0; i < form.known; ++i) {
      add(i < cells.size() ? cells[i] : std::string());
    }
  };
  known(form.columns);
  for (const auto& row : form.rows) known(row);
  return fmt::format("{:016x}", hash);
}

}  // namespace

void MeasuringForm::add_fact(const std::string& name, double value) {
  facts.emplace_back(name, fmt::format("{:.6g}", value));
}

double MeasuringForm::fact(const std::string& name, double least, double most) const {
  const auto found =
      std::find_if(facts.begin(), facts.end(), [&](const auto& f) { return f.first == name; });
  const auto value = found == facts.end() ? std::nullopt : number_in_text(found->second);
  if (value && *value >= least && *value <= most) return *value;
  throw InputError(
      source, name,
      fmt::format("is '{}' in its first line; expected a number of {:g} to {:g}",
                  found == facts.end() ? "" : text::printable(found->second), least, most));
}

void MeasuringForm::expect_column(const std::string& column) const {
  if (std::find(columns.begin(), columns.end(), column) != columns.end()) return;
  throw InputError(source, column,
                   fmt::format("is no column of this table, which has {}; expected it filled in, "
                               "under its own name",
                               text::printable(fmt::format("{}", fmt::join(columns, ", ")))));
}

std::string MeasuringForm::cell(std::size_t row, const std::string& column) const {
  const auto at =
      static_cast<std::size_t>(std::find(columns.begin(), columns.end(), column) - columns.begin());
  return at < rows[row].size() ? rows[row][at] : std::string();
}

std::optional<double> MeasuringForm::number(std::size_t row, const std::string& column,
                                            double least, double most) const {
  const std::string text = cell(row, column);
  if (text.empty()) return std::nullopt;
  const auto value = number_in_text(text);
  if (value && *value >= least && *value <= most) return value;
  throw InputError(source, fmt::format("line {}, {}", lines[row], column),
                   fmt::format("is '{}'; expected a number of {:g} to {:g}", text::printable(text),
                               least, most));
}

std::string form_text(const MeasuringForm& form) {
  std::string text = fmt::format("{},{}", kBegin, form.part);
  for (const auto& [name, value] : form.facts) text += fmt::format(",{},{}", name, value);
  text += fmt::format(",known,{},hash,{}\n# {}\n", form.known, hash_of(form), form.note);
  for (std::size_t i = 0; i < form.columns.size(); ++i) {
    text += (i ? "," : "") + form.columns[i];
  }
  text += "\n";
  for (const auto& row : form.rows) {
    for (std::size_t i = 0; i < form.columns.size(); ++i) {
      text += std::string(i ? "," : "") + (i < row.size() ? csv_cell(row[i]) : std::string());
    }
    text += "\n";
  }
  return text;
}

std::optional<MeasuringForm> read_form(const std::string& path) {
  std::error_code error;
  // What is read once only, a pipe, is left to those who read all of it.
  if (!std::filesystem::is_regular_file(path, error)) return std::nullopt;
  std::string first(1 << 12, '\0');
  {
    std::ifstream in(path, std::ios::binary);
    in.read(first.data(), static_cast<std::streamsize>(first.size()));
    first.resize(static_cast<std::size_t>(in.gcount()));
  }
  first = first.substr(0, first.find_first_of("\r\n"));
  if (first.starts_with("\xEF\xBB\xBF")) first.erase(0, 3);
  first.erase(std::remove(first.begin(), first.end(), '"'), first.end());
  if (!first.starts_with(kBegin)) return std::nullopt;
  if (first.find(';') != std::string::npos) {
    throw InputError(path, "line 1", "has semicolons; expected commas between columns");
  }
  MeasuringForm form;
  form.source = path;
  std::string hash;
  // Spreadsheets write empty cells to the end of the widest row.
  const std::vector<std::string_view> cells = comma_separated(first);
  if (cells.size() > 1) form.part = cells[1];
  for (std::size_t i = 2; i + 1 < cells.size(); i += 2) {
    const std::string name(cells[i]), value(cells[i + 1]);
    if (name.empty()) break;
    if (name == "hash") {
      hash = value;
    } else if (name == "known") {
      const auto known = number_in_text(value);
      form.known = known && *known >= 1 && *known <= 100 ? static_cast<std::size_t>(*known) : 0;
    } else {
      form.facts.emplace_back(name, value);
    }
  }
  CsvRules rules;
  rules.skip_empty_rows = true;
  rules.control_bytes_are_faults = true;
  rules.longest_line_bytes = 1 << 16;
  CsvReader reader = CsvReader::of_file(path, rules);
  for (CsvRow row; reader.next(row);) {
    if (row.fault != CsvRow::Fault::none || form.rows.size() == kMostRows) {
      throw InputError(path, reader.place(), "can't be read; expected a row of a test part");
    }
    if (form.columns.empty()) {
      form.columns = row.cells;
    } else {
      form.rows.push_back(row.cells);
      form.lines.push_back(row.line);
    }
  }
  if (form.rows.empty()) throw InputError(path, "", "has no rows; expected those of a part");
  if (form.known == 0 || hash != hash_of(form)) {
    throw InputError(
        path, "hash",
        fmt::format("is {} in the first line and {} of the rows: they are of another part, or were "
                    "changed; expected columns to be filled in and nothing else",
                    text::printable(hash.empty() ? "missing" : hash), hash_of(form)));
  }
  return form;
}

void expect_form_of(const std::string& path, const std::vector<std::string>& parts) {
  const auto form = read_form(path);
  if (!form || std::find(parts.begin(), parts.end(), form->part) != parts.end()) return;
  throw InputError(path, "line 1",
                   fmt::format("is the table of a test part '{}', which {} reads",
                               text::printable(form->part), detail::readers_of(form->part)));
}

MeasuringForm read_form_of(const std::string& path, const std::vector<std::string>& parts) {
  expect_form_of(path, parts);
  if (auto form = read_form(path)) return *std::move(form);
  std::error_code error;
  if (!std::filesystem::exists(path, error)) throw InputError(path, "", "is not there");
  throw InputError(path, "line 1",
                   fmt::format("is not that of a test part; expected a table of slicecorr testpart "
                               "{}, filled in",
                               fmt::join(parts, " or ")));
}

}  // namespace slicecorr
