#include "exchange/csv.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <utility>

#include "slicecorr/error.hpp"
#include "support/text/ascii.hpp"

namespace slicecorr::resins {

namespace {

/// Cells of one line; a quote inside quotes is written twice.
std::vector<std::string> cells_of(std::string_view line) {
  std::vector<std::string> cells(1);
  bool quoted = false;
  for (std::size_t i = 0; i < line.size(); ++i) {
    const char c = line[i];
    if (c == '"' && quoted && i + 1 < line.size() && line[i + 1] == '"') {
      cells.back() += '"';
      ++i;
    } else if (c == '"') {
      quoted = !quoted;
    } else if (c == ',' && !quoted) {
      cells.emplace_back();
    } else {
      cells.back() += c;
    }
  }
  for (std::string& cell : cells) cell = std::string(trimmed(cell));
  return cells;
}

}  // namespace

std::optional<double> number_in_text(std::string_view text) {
  std::string t(trimmed(text));
  if (!t.empty() && t[0] == '+') t.erase(0, 1);
  double value = 0;
  const auto [end, error] = std::from_chars(t.data(), t.data() + t.size(), value);
  if (error != std::errc() || end != t.data() + t.size() || !std::isfinite(value)) {
    return std::nullopt;
  }
  return value;
}

CsvTable::CsvTable(std::string_view text, std::string source, Header header)
    : source_(std::move(source)) {
  if (text.starts_with("\xEF\xBB\xBF")) text.remove_prefix(3);
  for (int number = 1; !text.empty(); ++number) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    const std::string line(trimmed(text.substr(0, end)));
    text.remove_prefix(std::min(end + 1, text.size()));
    if (line.empty() || line[0] == '#') continue;
    Row row{number, cells_of(line)};
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
          throw InputError(source_, fmt::format("line {}", number),
                           fmt::format("column '{}' stands twice in the header", header_[i]));
        }
      }
      continue;
    }
    if (row.cells.size() > header_.size()) {
      throw InputError(source_, fmt::format("line {}", number),
                       fmt::format("has {} cells; expected the {} of the header", row.cells.size(),
                                   header_.size()));
    }
    row.cells.resize(header_.size());
    rows_.push_back(std::move(row));
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

std::string csv_cell(const std::string& text) {
  if (text.find_first_of(",\"\n#") == std::string::npos) return text;
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"') out += '"';
    out += c == '\n' ? ' ' : c;
  }
  return out + "\"";
}

}  // namespace slicecorr::resins
