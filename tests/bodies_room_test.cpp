// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What waits until it gels takes the room of the bodies that it has become, not of its columns.
#include <gtest/gtest.h>

#include <cstddef>
#include <cstdlib>
#include <vector>

#include "bodies/solid_rows.hpp"

namespace slicecorr::test {
namespace {

using detail::GelTime;
using detail::SolidRows;

TEST(BodiesRoom, WhatWaitsIsPutTogetherOnceItIsOneBody) {
  // A block without anything below gels first in the middle, a slice later with each pixel further away,
  // and a slice deeper with each slice.
  constexpr int kRows = 4, kColumns = 64, kSlices = 40, kLatest = 140;
  const auto gels = [](int slice, int x, int y) {
    return kLatest - slice + std::abs(x - kColumns / 2) + y;
  };
  SolidRows strip(0, kRows, 1);
  for (int n = 0; n < kSlices; ++n) {
    for (int y = 0; n > 0 && y < kRows; ++y) {
      std::vector<SolidRows::Change> changes;
      for (int x = 0; x < kColumns; ++x) {
        changes.push_back({x, x + 1, n == 1, true, GelTime::at_once(gels(n, x, y))});
      }
      strip.change_row(y, changes);
    }
    strip.end_slice(0);
  }
  // Each column told when each of its voxels gels.
  const std::size_t columns = std::size_t{kRows} * kColumns;
  EXPECT_GT(strip.labelled(), columns * (kSlices - 2));
  strip.make_room();
  // Runs, and of the body in each step how much has gelled and where it is lowest; at most as many joins.
  const std::size_t steps = kSlices + kColumns / 2 + kRows;
  EXPECT_GE(strip.labelled(), columns + steps);
  EXPECT_LE(strip.labelled(), columns + 3 * steps);
  const std::size_t once = strip.labelled();
  strip.make_room();
  EXPECT_EQ(strip.labelled(), once);
}

}  // namespace
}  // namespace slicecorr::test
