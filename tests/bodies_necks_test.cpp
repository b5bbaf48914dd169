// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Necks: by how much bodies hang, against shapes whose answers are known and a count by hand of towers.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <nlohmann/json.hpp>
#include <random>
#include <vector>

#include "bodies/necks.hpp"
#include "bodies_grid.hpp"
#include "memory_slices.hpp"
#include "rounds.hpp"
#include "slicecorr/bodies.hpp"

namespace slicecorr::test {
namespace {

using testing::HasSubstr;

TEST(Bodies, HangByWhatTheyShareWithTheSliceBefore) {
  // A lamp on a stem of 4 x 2 pixels of 50 um: 0.02 mm².
  MemorySlices lamp(grid_of(40, 40, 30));
  fill(lamp, {5, 5, 0}, {35, 35, 3});
  fill(lamp, {20, 18, 3}, {24, 20, 12});
  fill(lamp, {10, 10, 12}, {30, 30, 20});
  fill(lamp, {12, 12, 20}, {13, 13, 30});  // a pin on top is no body that hangs
  Bodies b = find_bodies(lamp, {}, {true, 0.1});
  ASSERT_EQ(b.necks.size(), 1U);
  EXPECT_EQ(b.necks_in_all, 1U);
  EXPECT_EQ(b.necks[0], (Neck{3, 8, 9 * 8 + 8 * 400 + 10, 22, 19}));
  const auto j = nlohmann::json::parse(b.to_json());
  EXPECT_NEAR(j["necks"][0]["area_mm2"].get<double>(), 0.02, 1e-12);
  EXPECT_EQ(j["necks"][0]["at_um"], 300);
  EXPECT_NEAR(j["necks"][0]["volume_mm3"].get<double>(), (72 + 3200 + 10) * 0.05 * 0.05 * 0.1,
              1e-12);
  EXPECT_THAT(bodies_in_words(b).front(),
              HasSubstr("1 body hangs by less than 0.1 mm²: 0.8205 mm³, by 0.02 mm² at 300 um"));
  EXPECT_TRUE(b.any_loose());
  // As much as is asked for is enough, and nobody looks unless asked.
  EXPECT_EQ(find_bodies(lamp, {}, {true, 0.02}).necks_in_all, 0U);
  EXPECT_EQ(find_bodies(lamp).necks_in_all, 0U);

  // By more than the widest slice has, 2.25 mm², nothing can hang: that is no print without necks.
  EXPECT_FALSE(find_bodies(lamp, {}, {true, 2.25}).none_so_wide());
  const Bodies wide = find_bodies(lamp, {}, {true, 2.26});
  ASSERT_TRUE(wide.none_so_wide() && wide.any_loose());
  EXPECT_EQ(wide.necks_in_all, 0U);
  EXPECT_THAT(
      bodies_in_words(wide).front(),
      HasSubstr(
          "no body is as wide as the 2.26 mm² by which each is to hang: the widest has 2.25 mm²"));
  EXPECT_NEAR(nlohmann::json::parse(wide.to_json())["widest_mm2"].get<double>(), 2.25, 1e-12);
  EXPECT_FALSE(find_bodies(lamp).none_so_wide());

  // On two stems it hangs by both.
  MemorySlices two = lamp;
  fill(two, {26, 18, 3}, {28, 20, 12});
  b = find_bodies(two, {}, {true, 0.1});
  ASSERT_EQ(b.necks_in_all, 1U);
  EXPECT_EQ(b.necks[0].voxels, 12U);
  EXPECT_EQ(b.necks[0].slice, 12);
  EXPECT_EQ(find_bodies(two, {}, {true, 0.03}).necks_in_all, 0U);

  // A ball on the platform hangs by what lies on it.
  MemorySlices foot(grid_of(40, 40, 20));
  fill(foot, {20, 20, 0}, {21, 22, 1});
  fill(foot, {15, 15, 1}, {25, 25, 20});
  b = find_bodies(foot, {}, {true, 0.1});
  ASSERT_EQ(b.necks_in_all, 1U);
  EXPECT_EQ(b.necks[0], (Neck{0, 2, 2 + 1900, 20.5, 21}));

  // An hourglass has one neck, where it is narrowest.
  MemorySlices hourglass(grid_of(40, 40, 20));
  for (int n = 0; n < 20; ++n) {
    const int r = 2 + std::abs(n - 10);
    fill(hourglass, {20 - r, 20 - r, n}, {20 + r, 20 + r, n + 1});
  }
  b = find_bodies(hourglass, {}, {true, 0.2});
  ASSERT_EQ(b.necks_in_all, 1U);
  EXPECT_EQ(b.necks[0].slice, 10);
  EXPECT_EQ(b.necks[0].voxels, 16U);
}

TEST(Bodies, TowersHangByTheirNarrowestStoreySoFar) {
  std::mt19937 random(65);
  std::uint64_t necks = 0;
  for (int round = 0; round < rounds(300); ++round) {
    SCOPED_TRACE(round);
    MemorySlices slices(grid_of(12, 1, 24));
    const std::uint64_t least = 1 + random() % 8;
    int begin = 0, end = 12;
    // What each slice hangs by, and what is expected of it: a neck begins where it gets less.
    std::uint64_t bears = 0;
    struct Open {
      int slice;
      std::uint64_t voxels;
      bool wide;
    };
    std::vector<Open> chain;
    for (int n = 0; n < 24; ++n) {
      const int before_begin = begin, before_end = end;
      if (random() % 2 == 0) {
        begin = static_cast<int>(random() % 12);
        end = begin + 1 + static_cast<int>(random() % (12 - static_cast<unsigned>(begin)));
        if (n > 0 && std::min(end, before_end) <= std::max(begin, before_begin)) {
          begin = before_begin;
          end = before_end;
        }
      }
      fill(slices, {begin, 0, n}, {end, 1, n + 1});
      const int shared =
          n == 0 ? end - begin : std::min(end, before_end) - std::max(begin, before_begin);
      const std::uint64_t held = n == 0 ? 12 : bears;
      bears = std::min<std::uint64_t>(held, static_cast<std::uint64_t>(shared));
      if (bears < least && (chain.empty() || bears < chain.back().voxels)) {
        chain.push_back({n, bears, false});
      }
      if (!chain.empty() && static_cast<std::uint64_t>(end - begin) >= least) {
        chain.back().wide = true;
      }
    }
    std::vector<std::pair<int, std::uint64_t>> expected, found;
    for (const Open& o : chain) {
      if (o.wide) expected.emplace_back(o.slice, o.voxels);
    }
    const double mm2 = static_cast<double>(least) * kPixelUm * kPixelUm * 1e-6;
    for (const Neck& neck : find_bodies(slices, {}, {true, mm2}).necks) {
      found.emplace_back(neck.slice, neck.voxels);
    }
    std::sort(found.begin(), found.end());
    EXPECT_EQ(found, expected);
    if (HasFailure()) return;
    necks += found.size();
  }
  EXPECT_GT(necks, 100U);
}

TEST(Bodies, TheLargestNecksAreListedAndAllAreCounted) {
  // 300 lamps of 3 x 3 pixels on stems of one, of other heights: 1 of stem in each slice, 9 of bulb.
  const int across = 20, down = 15;
  MemorySlices lamps(grid_of(4 * across, 4 * down, 12));
  std::vector<std::uint64_t> borne;
  for (int k = 0; k < across * down; ++k) {
    const int x = k % across * 4, y = k / across * 4, stem = 1 + k % 3, top = stem + 1 + k % 7;
    fill(lamps, {x + 1, y + 1, 0}, {x + 2, y + 2, stem});
    fill(lamps, {x, y, stem}, {x + 3, y + 3, top});
    borne.push_back(static_cast<std::uint64_t>(stem + 9 * (top - stem)));
  }
  std::sort(borne.begin(), borne.end(), std::greater<>());
  const Bodies b = find_bodies(lamps, {}, {true, 2 * kPixelUm * kPixelUm * 1e-6});
  EXPECT_EQ(b.necks_in_all, borne.size());
  const auto j = nlohmann::json::parse(b.to_json());
  EXPECT_EQ(j["necks_in_all"], borne.size());
  ASSERT_EQ(j["necks"].size(), Bodies::kMost);
  for (std::size_t k = 0; k < Bodies::kMost; ++k) EXPECT_EQ(b.necks[k].borne, borne[k]) << k;
}

TEST(Bodies, NecksAreForgottenWhenNothingHangsByThem) {
  // Storeys of a plate, pins of one voxel on it, and a bulb on each, which together bear the next plate.
  const int storeys = 1000, pins = 25, pitch = 4, side = 20;
  std::uint64_t found = 0;
  detail::NeckFinder finder(side, 4, [&](const Neck& neck) {
    EXPECT_EQ(neck.borne, 1U + 9U);
    EXPECT_EQ(neck.voxels, 1U);
    ++found;
  });
  const auto slice = [&](int width, int from) {
    std::vector<BodyTracker::Run> runs;
    for (int x = from; x < side; x += pitch) runs.push_back({x, x + width, 0});
    for (int y = 0; y < side; ++y) {
      const bool lit = y % pitch >= from && y % pitch < from + width;
      finder.set_row(y, lit ? std::span(runs) : std::span<BodyTracker::Run>());
    }
    finder.end_slice(0);
  };
  std::size_t most = 0;
  for (int n = 0; n < storeys; ++n) {
    slice(pitch, 0);
    slice(1, 1);
    slice(3, 0);
    most = std::max(most, finder.kept());
  }
  finder.finish();
  EXPECT_EQ(finder.kept(), 0U);
  EXPECT_EQ(most, static_cast<std::size_t>(pins));
  EXPECT_EQ(found, static_cast<std::uint64_t>(storeys * pins));
}

}  // namespace
}  // namespace slicecorr::test
