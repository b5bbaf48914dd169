// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// A black image to draw lines, areas and words into, pixel by pixel.
#pragma once

#include <cstddef>
#include <string_view>
#include <vector>

namespace slicecorr::detail {

/// Light in shares of the greatest; what is drawn twice keeps the brighter one. What lies outside
/// is left out.
class Sheet {
 public:
  Sheet(int width_px, int height_px);
  int width() const { return width_; }
  int height() const { return height_; }
  /// Row by row.
  const std::vector<float>& light() const { return light_; }

  void set(int column, int row, double share);
  void fill(int column, int row, int columns, int rows, double share = 1);
  /// Black, whatever was there.
  void clear(int column, int row, int columns, int rows);
  /// A pixel wide about (column, row), its light shared between the two columns that it lies in.
  void share_column(double column, int row);
  void share_row(int column, double row);
  /// Letters of 5 x 7 dots, each `scale` pixels wide and high; (column, row) is their upper left.
  void words(int column, int row, std::string_view text, int scale);
  /// The same on black ground.
  void label(int column, int row, std::string_view text, int scale);
  static int width_of(std::string_view text, int scale);

 private:
  std::size_t at(int column, int row) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(width_) +
           static_cast<std::size_t>(column);
  }
  int width_, height_;
  std::vector<float> light_;
};

}  // namespace slicecorr::detail
