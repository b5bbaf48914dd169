// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "support/text/csv.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstring>
#include <utility>

#include "slicecorr/error.hpp"
#include "support/text/ascii.hpp"

namespace slicecorr {

namespace {

constexpr std::size_t kChunkBytes = std::size_t{1} << 18;

bool is_blank(char c) { return c == ' ' || c == '\t'; }

bool is_control(char c) {
  const auto byte = static_cast<unsigned char>(c);
  return (byte < 0x20 && c != '\t') || byte == 0x7F;
}

void note(CsvRow& row, CsvRow::Fault fault, std::string_view at_fault) {
  if (row.fault != CsvRow::Fault::none) return;
  row.fault = fault;
  row.at_fault = at_fault;
}

}  // namespace

CsvReader CsvReader::of_file(const std::string& path, const CsvRules& rules) {
  CsvReader reader(path, rules);
  reader.file_.reset(std::fopen(path.c_str(), "rb"));
  if (!reader.file_) {
    throw InputError(path, "", fmt::format("can't be read: {}", std::strerror(errno)));
  }
  return reader;
}

CsvReader CsvReader::of_text(std::string_view text, const std::string& source,
                             const CsvRules& rules) {
  CsvReader reader(source, rules);
  reader.buffer_ = text;
  reader.ended_ = true;
  return reader;
}

std::string CsvReader::place() const { return fmt::format("line {}", row_line_); }

void CsvReader::fill() {
  if (ended_) return;
  buffer_.erase(0, at_);
  at_ = 0;
  const std::size_t kept = buffer_.size();
  buffer_.resize(kept + kChunkBytes);
  const std::size_t n = std::fread(buffer_.data() + kept, 1, kChunkBytes, file_.get());
  buffer_.resize(kept + n);
  if (n < kChunkBytes) {
    if (std::ferror(file_.get())) {
      throw DeviceError(fmt::format("{}: reading failed: {}", source_, std::strerror(errno)));
    }
    ended_ = true;
  }
}

void CsvReader::begin() {
  begun_ = true;
  fill();
  const std::string_view head(buffer_);
  if (head.starts_with("\xEF\xBB\xBF")) at_ = 3;
  if (head.starts_with("\xFF\xFE") || head.starts_with("\xFE\xFF")) {
    throw InputError(source_, "line 1", "is UTF-16 text; save it as CSV in UTF-8");
  }
  if (head.starts_with("PK\x03\x04")) {
    throw InputError(source_, "line 1", "is a zip archive or a workbook; export the sheet as CSV");
  }
}

bool CsvReader::read_line(std::string_view& line, std::string_view& ending) {
  if (!begun_) begin();
  std::size_t from = at_, end = 0;
  while (true) {
    end = buffer_.find_first_of("\r\n", from);
    // What follows a CR must be known before its line ends.
    const bool found =
        end != std::string::npos && (buffer_[end] == '\n' || end + 1 < buffer_.size() || ended_);
    if (found || ended_ || buffer_.size() - at_ > rules_.longest_line_bytes) break;
    from = (end == std::string::npos ? buffer_.size() : end) - at_;
    fill();
  }
  if (end == std::string::npos) end = buffer_.size();
  if (at_ == buffer_.size()) return false;
  ++number_;
  line = std::string_view(buffer_).substr(at_, end - at_);
  at_ = end;
  ending = "";
  if (at_ < buffer_.size()) {
    ending = buffer_[at_] == '\n' ? "\n" : buffer_.compare(at_, 2, "\r\n") == 0 ? "\r\n" : "\r";
  }
  at_ += ending.size();
  return true;
}

bool CsvReader::split(std::string_view line, std::string_view ending, CsvRow& row) {
  std::size_t at = 0;
  bool any_quoted = false;
  const auto ends_cell = [&] {
    return at >= line.size() || line[at] == ',' ||
           (line[at] == '#' && rules_.comments_behind_cells);
  };
  // From behind the opening quote to behind the closing one.
  const auto read_quotes = [&](std::string& cell) {
    any_quoted = true;
    const std::string begin(line.substr(at));
    while (true) {
      if (at >= line.size()) {
        const std::string_view end_of_line = ending;
        if (!rules_.lines_in_quotes || !read_line(line, ending)) {
          note(row, CsvRow::Fault::open_quote, begin);
          line = {};
          at = 0;
          return;
        }
        cell += end_of_line;
        at = 0;
      } else if (line[at] != '"') {
        cell += line[at++];
      } else if (at + 1 < line.size() && line[at + 1] == '"') {
        cell += '"';
        at += 2;
      } else {
        ++at;
        return;
      }
    }
  };
  while (true) {
    std::string cell;
    while (at < line.size() && is_blank(line[at])) ++at;
    if (at < line.size() && line[at] == '"' && !rules_.quotes_inside_cells) {
      ++at;
      read_quotes(cell);
      while (at < line.size() && is_blank(line[at])) ++at;
      if (!ends_cell()) note(row, CsvRow::Fault::text_after_quote, line.substr(at));
    }
    while (!ends_cell()) {
      const char c = line[at++];
      if (c == '"' && rules_.quotes_inside_cells) {
        read_quotes(cell);
        continue;
      }
      if (is_control(c) && rules_.control_bytes_are_faults) {
        note(row, CsvRow::Fault::control_byte, std::string_view(&c, 1));
      }
      cell += c;
    }
    row.cells.emplace_back(trimmed(cell));
    if (at >= line.size() || line[at] == '#') return any_quoted;
    ++at;
  }
}

bool CsvReader::next(CsvRow& row) {
  std::string_view line, ending;
  while (read_line(line, ending)) {
    row.cells.clear();
    row.fault = CsvRow::Fault::none;
    row.at_fault.clear();
    row.line = row_line_ = number_;
    if (line.size() > rules_.longest_line_bytes) {
      row.fault = CsvRow::Fault::long_line;
      return true;
    }
    if (trimmed(line).starts_with('#')) continue;
    const bool any_quoted = split(line, ending, row);
    const bool empty = !any_quoted && std::all_of(row.cells.begin(), row.cells.end(),
                                                  [](const auto& cell) { return cell.empty(); });
    const bool passed_over = empty && (row.cells.size() == 1 || rules_.skip_empty_rows);
    if (!passed_over || row.fault != CsvRow::Fault::none) return true;
  }
  return false;
}

std::string csv_cell(const std::string& text) {
  if (text.find_first_of(",\"\n#") == std::string::npos) return text;
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"') out += '"';
    out += c == '\n' ? ' ' : c;
  }
  return out + "\"";
}

std::vector<std::string_view> comma_separated(std::string_view line) {
  std::vector<std::string_view> pieces;
  for (std::size_t at = 0;;) {
    const std::size_t comma = line.find(',', at);
    pieces.push_back(line.substr(at, comma - at));
    if (comma == std::string_view::npos) return pieces;
    at = comma + 1;
  }
}

std::optional<double> number_in_text(std::string_view text) {
  std::string_view digits = trimmed(text);
  if (digits.starts_with('+')) digits.remove_prefix(1);
  double value = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
  if (error != std::errc() || end != digits.data() + digits.size() || !std::isfinite(value)) {
    return std::nullopt;
  }
  return value;
}

}  // namespace slicecorr
