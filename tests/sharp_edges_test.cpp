// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "base/sharp_edges.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <random>
#include <vector>

#include "rounds.hpp"

namespace slicecorr {
namespace {

using detail::CodedBand;
using detail::SharpEdges;
using Bytes = std::vector<std::uint8_t>;

/// Columns side by side: coverage by slice, heights by node, one more of these.
struct Columns {
  std::vector<Bytes> coverage, heights;
  bool operator==(const Columns&) const = default;
};

Columns resolved(const Columns& columns) {
  CodedBand heights(columns.heights[0].size());
  for (const Bytes& row : columns.heights) heights.append(row.data());
  Columns out;
  const std::size_t width = heights.columns();
  int next = 0;
  SharpEdges sharp(heights, [&](int n, const std::uint8_t* rows, const std::uint8_t* kept) {
    EXPECT_EQ(n, next++);
    EXPECT_LE(out.coverage.size(), columns.coverage.size());
    if (n < static_cast<int>(columns.coverage.size())) {
      out.coverage.push_back(rows ? Bytes(rows, rows + width) : Bytes(width, 0));
    } else {
      EXPECT_EQ(rows, nullptr);
    }
    out.heights.push_back(kept ? Bytes(kept, kept + width) : Bytes(width, 0));
    EXPECT_TRUE(!kept || std::any_of(kept, kept + width, [](auto v) { return v != 0; }));
  });
  for (const Bytes& row : columns.coverage) {
    const bool black = std::all_of(row.begin(), row.end(), [](auto v) { return v == 0; });
    sharp.add(black ? nullptr : row.data());
  }
  sharp.finish();
  return out;
}

/// The definition, column by column.
Columns expected(Columns c) {
  const int slices = static_cast<int>(c.coverage.size());
  const auto at = [&](int n, std::size_t x) -> std::uint8_t {
    return n < 0 || n >= slices ? 0 : c.coverage[static_cast<std::size_t>(n)][x];
  };
  const auto is_grey = [&](int n, std::size_t x) { return at(n, x) != 0 && at(n, x) != 255; };
  for (std::size_t x = 0; x < c.heights[0].size(); ++x) {
    for (int first = 0; first < slices; ++first) {
      if (!is_grey(first, x) || is_grey(first - 1, x)) continue;
      int past = first;
      while (is_grey(past, x)) ++past;
      if (past - first > SharpEdges::kLongestRun || at(first - 1, x) == at(past, x)) continue;
      std::vector<int> edges;
      for (int n = first; n <= past; ++n) {
        if (c.heights[static_cast<std::size_t>(n)][x]) edges.push_back(n);
      }
      if (edges.size() != 1) continue;
      const std::uint8_t before = at(first - 1, x), after = at(past, x);
      for (int n = first; n < past; ++n) {
        c.coverage[static_cast<std::size_t>(n)][x] = n < edges[0] ? before : after;
      }
    }
    for (int n = 0; n <= slices; ++n) {
      if (at(n - 1, x) == at(n, x) || is_grey(n - 1, x) || is_grey(n, x)) {
        c.heights[static_cast<std::size_t>(n)][x] = 0;
      }
    }
  }
  return c;
}

/// One column.
Columns column(const Bytes& coverage, const Bytes& heights) {
  Columns c;
  for (const std::uint8_t v : coverage) c.coverage.push_back({v});
  for (const std::uint8_t v : heights) c.heights.push_back({v});
  return c;
}

void expect_column(const Bytes& coverage, const Bytes& heights, const Bytes& coverage_then,
                   const Bytes& heights_then) {
  const Columns is = resolved(column(coverage, heights));
  EXPECT_EQ(is, column(coverage_then, heights_then));
  EXPECT_EQ(expected(column(coverage, heights)), is);
}

TEST(SharpEdges, PlainEdgesKeepTheirHeights) {
  expect_column({0, 255, 255, 0}, {0, 9, 0, 200, 0}, {0, 255, 255, 0}, {0, 9, 0, 200, 0});
}

TEST(SharpEdges, ARunBecomesFullOnTheFullSide) {
  // From empty to full at node 2, then from full to empty at node 4, 5 and 3.
  expect_column({0, 90, 255, 255}, {0, 0, 77, 0, 0}, {0, 0, 255, 255}, {0, 0, 77, 0, 0});
  expect_column({0, 90, 255, 255}, {0, 77, 0, 0, 0}, {0, 255, 255, 255}, {0, 77, 0, 0, 0});
  expect_column({255, 255, 255, 40, 80, 0}, {0, 0, 0, 0, 1, 0, 0}, {255, 255, 255, 255, 0, 0},
                {0, 0, 0, 0, 1, 0, 0});
  expect_column({255, 255, 255, 40, 80, 0}, {0, 0, 0, 0, 0, 1, 0}, {255, 255, 255, 255, 255, 0},
                {0, 0, 0, 0, 0, 1, 0});
  expect_column({255, 255, 255, 40, 80, 0}, {0, 0, 0, 1, 0, 0, 0}, {255, 255, 255, 0, 0, 0},
                {0, 0, 0, 1, 0, 0, 0});
}

TEST(SharpEdges, BeyondBothEndsIsEmpty) {
  expect_column({255, 40, 80}, {0, 0, 3, 0}, {255, 255, 0}, {0, 0, 3, 0});
  expect_column({255, 40, 80}, {0, 0, 0, 3}, {255, 255, 255}, {0, 0, 0, 3});
  expect_column({40, 255, 255}, {0, 4, 0, 0}, {0, 255, 255}, {0, 4, 0, 0});
  expect_column({40, 255, 255}, {4, 0, 0, 250}, {255, 255, 255}, {4, 0, 0, 250});
  expect_column({255}, {7, 8}, {255}, {7, 8});
  expect_column({0}, {7, 8}, {0}, {0, 0});
}

TEST(SharpEdges, OtherGreysStayAndHaveNoHeights) {
  // Too long; between two empties, two fulls; without a height, with two.
  Bytes leaning(SharpEdges::kLongestRun + 1, 9), heights(leaning.size() + 3, 0);
  leaning.insert(leaning.begin(), 0);
  leaning.push_back(255);
  heights[2] = 5;
  expect_column(leaning, heights, leaning, Bytes(heights.size(), 0));
  expect_column({0, 9, 0}, {0, 0, 5, 0}, {0, 9, 0}, {0, 0, 0, 0});
  expect_column({255, 9, 255}, {0, 0, 5, 6}, {255, 9, 255}, {0, 0, 0, 6});
  expect_column({255, 9, 0}, {0, 0, 0, 0}, {255, 9, 0}, {0, 0, 0, 0});
  expect_column({255, 9, 0}, {0, 5, 5, 0}, {255, 9, 0}, {0, 0, 0, 0});
  // Heights at nodes within one body mean nothing.
  expect_column({255, 255, 0}, {0, 5, 6, 7}, {255, 255, 0}, {0, 0, 6, 0});
}

TEST(SharpEdges, RunsThatFollowEachOther) {
  expect_column({0, 50, 255, 60, 0, 70, 80, 255}, {0, 0, 1, 2, 0, 0, 3, 0, 0},
                {0, 0, 255, 0, 0, 0, 255, 255}, {0, 0, 1, 2, 0, 0, 3, 0, 0});
}

Columns random_columns(std::mt19937_64& random, std::size_t width, int slices) {
  const auto pick = [&](int most) { return std::uniform_int_distribution<int>(0, most)(random); };
  Columns c;
  c.coverage.assign(static_cast<std::size_t>(slices), Bytes(width, 0));
  c.heights.assign(static_cast<std::size_t>(slices) + 1, Bytes(width, 0));
  for (std::size_t x = 0; x < width; ++x) {
    if (pick(3) == 0) continue;
    for (int n = 0; n < slices;) {
      const int kind = pick(2);
      for (int left = pick(4); left >= 0 && n < slices; --left, ++n) {
        c.coverage[static_cast<std::size_t>(n)][x] =
            static_cast<std::uint8_t>(kind == 0   ? 0
                                      : kind == 1 ? 255
                                                  : 1 + pick(253));
      }
    }
    for (Bytes& row : c.heights) {
      if (pick(2) == 0) row[x] = static_cast<std::uint8_t>(1 + pick(254));
    }
  }
  // Rows without anything, as there are many.
  for (Bytes& row : c.coverage) {
    if (pick(9) == 0) std::fill(row.begin(), row.end(), std::uint8_t{0});
  }
  for (Bytes& row : c.heights) {
    if (pick(3) == 0) std::fill(row.begin(), row.end(), std::uint8_t{0});
  }
  return c;
}

TEST(SharpEdges, RandomColumnsAreThoseOfTheDefinition) {
  std::mt19937_64 random(11);
  for (int round = 0; round < test::rounds(300); ++round) {
    const auto width = std::uniform_int_distribution<std::size_t>(1, 150)(random);
    const Columns c = random_columns(random, width, 1 + round % 40);
    ASSERT_EQ(resolved(c), expected(c)) << round;
  }
}

TEST(SharpEdges, ColumnsDoNotActOnEachOther) {
  std::mt19937_64 random(12);
  const Columns c = random_columns(random, 200, 60);
  const Columns whole = resolved(c);
  const auto part = [](const Columns& of, std::size_t begin, std::size_t end) {
    Columns cut = of;
    for (auto* rows : {&cut.coverage, &cut.heights}) {
      for (Bytes& row : *rows) {
        row = Bytes(row.begin() + static_cast<std::ptrdiff_t>(begin),
                    row.begin() + static_cast<std::ptrdiff_t>(end));
      }
    }
    return cut;
  };
  for (const auto& [begin, end] : {std::pair<std::size_t, std::size_t>{0, 1}, {1, 65}, {65, 200}}) {
    EXPECT_EQ(resolved(part(c, begin, end)), part(whole, begin, end));
  }
}

}  // namespace
}  // namespace slicecorr
