// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file layer_settings.hpp
/// `layersettings.csv` of the Ember printer: settings that single layers have of their own.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace slicecorr::detail {

/// A header row of names, the first for the layer's number, from 1; then a row per layer. Rows that
/// do not begin with a number are comments, and cells may be empty, as the printer's firmware has
/// it.
class LayerSettings {
 public:
  /// Throws `InputError` naming `file` and `entry` when columns or layers are doubled.
  LayerSettings(std::string_view text, const std::string& file, const std::string& entry);
  /// An empty table with these columns after the first.
  explicit LayerSettings(const std::vector<std::string>& columns);

  bool has(std::string_view column) const { return index_of(column).has_value(); }
  /// Nothing where the cell is missing or empty. Throws `InputError` when it is no number from 0 to
  /// `most`.
  std::optional<double> number(int layer, std::string_view column, double most) const;
  /// Adds the row, and the column, where they are missing.
  void set(int layer, std::string_view column, const std::string& value);
  std::string text() const;

 private:
  std::optional<std::size_t> index_of(std::string_view column) const;
  std::vector<std::string>& row_of(int layer);

  std::string file_, entry_;
  std::vector<std::vector<std::string>> rows_;  ///< cells as they are written; the first row: names
  std::vector<std::size_t> row_of_layer_;       ///< 0: none; by layer - 1
};

}  // namespace slicecorr::detail
