// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What the preview picture is made from: when each column of a band was lit last.
#include "pipeline/relief.hpp"

#include <gtest/gtest.h>

#include <random>

namespace slicecorr::detail {
namespace {

/// Slices of random pixels against the plain rule; some black, some not given at all.
TEST(LitColumns, AreThoseOfThePlainRule) {
  std::mt19937 random(7);
  for (const std::size_t columns : {1U, 63U, 64U, 65U, 200U, 1000U}) {
    for (const unsigned one_in : {1U, 3U, 40U}) {
      LitColumns lit(columns);
      std::vector<std::int32_t> last(columns, 0);
      std::uint64_t sum = 0;
      std::vector<std::uint8_t> rows(columns);
      for (int n = 0; n < 60; ++n) {
        const auto kind = random() % 6;
        if (kind == 0) continue;
        if (kind == 1) {
          lit.add(n, nullptr);
          continue;
        }
        // Some columns stay as they are, as in real parts.
        for (auto& v : rows) {
          if (random() % 2) continue;
          v = random() % one_in ? 0 : static_cast<std::uint8_t>(random() % 256);
        }
        lit.add(n, rows.data());
        for (std::size_t i = 0; i < columns; ++i) {
          sum += rows[i];
          if (rows[i]) last[i] = n + 1;
        }
      }
      EXPECT_EQ(lit.finish(), last) << columns << " columns";
      EXPECT_EQ(lit.sum(), sum);
    }
  }
}

}  // namespace
}  // namespace slicecorr::detail
