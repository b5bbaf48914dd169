// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "picture/sheet.hpp"

#include <algorithm>
#include <cmath>

#include "picture/letters.hpp"

namespace slicecorr::detail {

Sheet::Sheet(int width_px, int height_px)
    : width_(width_px),
      height_(height_px),
      light_(static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px)) {}

void Sheet::set(int column, int row, double share) {
  if (column < 0 || row < 0 || column >= width_ || row >= height_) return;
  float& pixel = light_[at(column, row)];
  pixel = std::max(pixel, static_cast<float>(share));
}

void Sheet::fill(int column, int row, int columns, int rows, double share) {
  for (int y = std::max(0, row); y < std::min(height_, row + rows); ++y) {
    for (int x = std::max(0, column); x < std::min(width_, column + columns); ++x) set(x, y, share);
  }
}

void Sheet::clear(int column, int row, int columns, int rows) {
  for (int y = std::max(0, row); y < std::min(height_, row + rows); ++y) {
    for (int x = std::max(0, column); x < std::min(width_, column + columns); ++x) {
      light_[at(x, y)] = 0;
    }
  }
}

void Sheet::share_column(double column, int row) {
  const int first = static_cast<int>(std::floor(column));
  set(first, row, 1 - (column - first));
  set(first + 1, row, column - first);
}

void Sheet::share_row(int column, double row) {
  const int first = static_cast<int>(std::floor(row));
  set(column, first, 1 - (row - first));
  set(column, first + 1, row - first);
}

void Sheet::words(int column, int row, std::string_view text, int scale) {
  for (const Letter& letter : letters_of(text)) {
    for (std::size_t x = 0; x < letter.size(); ++x) {
      for (int y = 0; y < 8; ++y) {
        if (letter[x] >> y & 1) {
          fill(column + static_cast<int>(x) * scale, row + y * scale, scale, scale);
        }
      }
    }
    column += 6 * scale;
  }
}

void Sheet::label(int column, int row, std::string_view text, int scale) {
  clear(column - scale, row - scale, width_of(text, scale) + scale, 10 * scale);
  words(column, row, text, scale);
}

int Sheet::width_of(std::string_view text, int scale) {
  return static_cast<int>(letters_of(text).size()) * 6 * scale;
}

}  // namespace slicecorr::detail
