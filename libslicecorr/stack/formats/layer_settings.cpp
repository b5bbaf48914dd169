// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/formats/layer_settings.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>

#include "slicecorr/error.hpp"
#include "stack/formats/archive_format.hpp"
#include "stack/formats/format_times.hpp"
#include "support/text/ascii.hpp"
#include "support/text/csv.hpp"

namespace slicecorr::detail {
namespace {

/// The layer that a row is for; 0 for a comment.
int layer_of(std::string_view cell) {
  const std::string_view text = trimmed(cell);
  int layer = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), layer);
  return error == std::errc() && layer >= 1 && layer <= kMaxLayers ? layer : 0;
}

}  // namespace

LayerSettings::LayerSettings(std::string_view text, const std::string& file,
                             const std::string& entry)
    : file_(file), entry_(entry) {
  // Lines end with CR, LF or both.
  for (std::size_t start = 0; start < text.size();) {
    const std::size_t end = std::min(text.find_first_of("\r\n", start), text.size());
    const auto cells = comma_separated(text.substr(start, end - start));
    rows_.emplace_back(cells.begin(), cells.end());
    start = end + (text.substr(end, 2) == "\r\n" ? 2 : 1);
  }
  if (rows_.empty()) rows_.push_back({"Layer"});
  const std::vector<std::string>& names = rows_.front();
  for (std::size_t i = 0; i < names.size(); ++i) {
    const std::string_view name = trimmed(names[i]);
    if (!name.empty() && index_of(name) != i) {
      throw InputError(file, entry, "has two columns named " + shown_name(name));
    }
  }
  for (std::size_t i = 1; i < rows_.size(); ++i) {
    const int layer = layer_of(rows_[i].front());
    if (layer == 0) continue;
    const auto at = static_cast<std::size_t>(layer - 1);
    if (row_of_layer_.size() <= at) row_of_layer_.resize(at + 1);
    if (row_of_layer_[at] != 0) {
      throw InputError(file, entry, fmt::format("has two rows for layer {}", layer));
    }
    row_of_layer_[at] = i;
  }
}

LayerSettings::LayerSettings(const std::vector<std::string>& columns) {
  rows_.push_back({"Layer"});
  rows_.front().insert(rows_.front().end(), columns.begin(), columns.end());
}

std::optional<std::size_t> LayerSettings::index_of(std::string_view column) const {
  const std::vector<std::string>& names = rows_.front();
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (trimmed(names[i]) == column) return i;
  }
  return std::nullopt;
}

std::optional<double> LayerSettings::number(int layer, std::string_view column, double most) const {
  const auto at = static_cast<std::size_t>(layer - 1);
  const auto index = index_of(column);
  if (!index || at >= row_of_layer_.size() || row_of_layer_[at] == 0) return std::nullopt;
  const std::vector<std::string>& row = rows_[row_of_layer_[at]];
  const std::string_view text = *index < row.size() ? trimmed(row[*index]) : std::string_view();
  if (text.empty()) return std::nullopt;
  double number = NAN;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc() || end != text.data() + text.size() ||
      !(number >= 0 && number <= most)) {
    throw InputError(file_, entry_,
                     fmt::format("{} of layer {} is {}, expected a number from 0 to {}", column,
                                 layer, shown_name(text), number_text(most)));
  }
  return number;
}

std::vector<std::string>& LayerSettings::row_of(int layer) {
  const auto at = static_cast<std::size_t>(layer - 1);
  if (row_of_layer_.size() <= at) row_of_layer_.resize(at + 1);
  if (row_of_layer_[at] == 0) {
    row_of_layer_[at] = rows_.size();
    rows_.push_back({std::to_string(layer)});
  }
  return rows_[row_of_layer_[at]];
}

void LayerSettings::set(int layer, std::string_view column, const std::string& value) {
  if (!has(column)) rows_.front().emplace_back(column);
  const std::size_t index = *index_of(column);
  std::vector<std::string>& row = row_of(layer);
  if (row.size() <= index) row.resize(index + 1);
  row[index] = value;
}

std::string LayerSettings::text() const {
  // The oldest firmware takes CR alone as the end of a line and skips the LF after it.
  std::string text;
  for (const std::vector<std::string>& row : rows_) {
    for (std::size_t i = 0; i < row.size(); ++i) text += (i == 0 ? "" : ",") + row[i];
    text += "\r\n";
  }
  return text;
}

}  // namespace slicecorr::detail
