// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Columns that tests of robust corrections share.
#pragma once

#include <cstddef>
#include <cstdint>
#include <random>
#include <vector>

#include "bands/design_band.hpp"

namespace slicecorr::test {

/// Columns of 60 slices, runs and gaps of `least` to `most`.
inline std::vector<std::vector<std::uint8_t>> random_columns(std::size_t count, unsigned seed,
                                                             int least = 2, int most = 12) {
  std::mt19937 random(seed);
  std::uniform_int_distribution<int> length(least, most);
  std::vector<std::vector<std::uint8_t>> columns;
  while (columns.size() < count) {
    std::vector<std::uint8_t> c(static_cast<std::size_t>(length(random)), 0);
    for (bool full = true; c.size() < 60; full = !full) {
      c.insert(c.end(), static_cast<std::size_t>(length(random)), full ? 255 : 0);
    }
    c.resize(60);
    // The last run and gap may have been cut to one slice.
    for (std::size_t n = 56; n < 60; ++n) c[n] = 0;
    if (c[55] == 255 && c[54] == 0) c[55] = 0;
    if (c[55] == 0 && c[54] == 255 && c[53] == 0) c[54] = 0;
    columns.push_back(c);
  }
  return columns;
}

/// A design of columns beside each other, which must outlive it.
inline detail::CodedDesign design_of(const std::vector<std::vector<std::uint8_t>>& columns) {
  return {columns.size(),
          {.coverage =
               [&](const SliceSource::Sink& sink) {
                 std::vector<std::uint8_t> row(columns.size());
                 for (std::size_t n = 0; n < columns.front().size(); ++n) {
                   for (std::size_t i = 0; i < columns.size(); ++i) row[i] = columns[i][n];
                   sink(static_cast<int>(n), row.data());
                 }
               }},
          Surface::mesh};
}

}  // namespace slicecorr::test
