// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What goes tile by tile against the definitions, for every instruction set at hand: the solve
// against single columns, the prediction against the one that goes slice by slice.
#include <gtest/gtest.h>
#include <hwy/highway.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "base/coded_tiles.hpp"
#include "base/record_log.hpp"
#include "base/tile_kernels.hpp"
#include "models.hpp"
#include "rounds.hpp"
#include "slicecorr/predict.hpp"

namespace slicecorr {
namespace {

using Column = std::vector<std::uint8_t>;

/// Runs of any length, so that some are over at once and others fill tiles.
Column random_column(std::mt19937& random, int layers) {
  Column c;
  const int kind = static_cast<int>(random() % 6);
  const bool greys = random() % 2;
  std::uint8_t value = random() % 2 ? 255 : 0;
  while (static_cast<int>(c.size()) < layers) {
    const int longest = kind == 0 ? layers : kind == 1 ? 2 : kind == 2 ? 6 : 60;
    const auto length = 1 + random() % static_cast<unsigned>(longest);
    c.insert(c.end(), length, value);
    if (greys && random() % 3) c.push_back(static_cast<std::uint8_t>(random()));
    value = static_cast<std::uint8_t>(255 - value);
    if (kind == 5) value = static_cast<std::uint8_t>(random());
  }
  c.resize(static_cast<std::size_t>(layers));
  return c;
}

struct Case {
  CureModel model;
  Process process;
  int layers, all_layers;
  std::vector<Column> designs;
  CorrectionPlan plan() const { return {model, process, layers, all_layers}; }
};

Case random_case(std::mt19937& random) {
  const int bits = random() % 4 ? 8 : static_cast<int>(1 + random() % 6);
  const double most = std::exp(std::uniform_real_distribution(1.0, 5.5)(random));
  const double gamma = random() % 2 ? 1.0 : 2.2;
  const double height = std::exp(std::uniform_real_distribution(4.5, 9.0)(random));
  // Full light gets the resin to gel, black doesn't.
  const double least = most * (random() % 2 ? 0.01 : 0.0);
  const double strength = std::uniform_real_distribution(1.05, 60.0)(random);
  const double speed = most / strength * 3600 / 10;
  CureModel model = make_cure_model(test::gamma_printer(least, most, gamma, bits),
                                    test::resin(100, height), test::process(speed), 50);
  Process process = test::process(speed);
  const double caps[] = {std::numeric_limits<double>::infinity(), 1e300, 1.0, 1.5, 6.0};
  process.omega_max = caps[random() % std::size(caps)];
  process.cap_platform_features = random() % 2;
  process.one_slice_gaps = random() % 2 ? OneSliceGaps::merge : OneSliceGaps::open;
  // Whole tiles alike: those in which nothing changes are only stepped.
  const bool alike = random() % 4 == 0;
  const int layers = 1 + static_cast<int>(random() % (!alike && random() % 3 ? 70 : 400));
  int last_lit = -1;
  std::vector<Column> designs;
  const std::size_t columns = alike ? 64 * (1 + random() % 2) : 1 + random() % 150;
  for (std::size_t i = 0; i < columns; ++i) {
    // Neighbours alike, so that whole tiles take the fast way.
    designs.push_back(i && (alike || random() % 3) ? designs.back()
                                                   : random_column(random, layers));
    for (int n = 0; n < layers; ++n) {
      if (designs.back()[static_cast<std::size_t>(n)]) last_lit = std::max(last_lit, n);
    }
  }
  const int all = std::min(slices_with_burst(model, layers, last_lit), layers + 200);
  return {std::move(model), process, layers, all, std::move(designs)};
}

std::uint8_t at(const Column& column, int n) {
  return n < static_cast<int>(column.size()) ? column[static_cast<std::size_t>(n)]
                                             : std::uint8_t{0};
}

/// Slices of the solve, column by column.
std::vector<Column> solved(const Case& c, const CorrectionPlan& plan, bool in_tiles) {
  // Where gaps are merged there are no tiles.
  const bool tiles = in_tiles && !plan.merge_one_slice_gaps;
  BandCorrector band(plan, c.designs.size());
  Column row(c.designs.size());
  for (int n = 0; n < c.layers; ++n) {
    for (std::size_t i = 0; i < row.size(); ++i) row[i] = at(c.designs[i], n);
    const bool empty = std::all_of(row.begin(), row.end(), [](auto v) { return v == 0; });
    band.add_layer(empty ? nullptr : row.data());
  }
  std::vector<Column> got(c.designs.size(), Column(static_cast<std::size_t>(c.all_layers), 77));
  std::vector<Column> seen = got;
  int expected = c.all_layers;
  const auto take = [&](int n, const std::uint8_t* levels, const std::uint8_t* coverage,
                        bool dark) {
    EXPECT_EQ(n, --expected);
    EXPECT_EQ(coverage == nullptr, tiles);
    std::uint8_t any = 0;
    for (std::size_t i = 0; i < got.size(); ++i) {
      got[i][static_cast<std::size_t>(n)] = levels[i];
      any |= levels[i] | at(c.designs[i], n);
      if (coverage) {
        EXPECT_EQ(coverage[i], at(c.designs[i], n));
      }
    }
    EXPECT_EQ(dark, any == 0);
  };
  if (!tiles) {
    band.solve(take);
    return got;
  }
  band.solve(take, [&](const BandCorrector::Tile& t) {
    for (int k = 0; k < t.slices; ++k) {
      for (std::size_t i = 0; i < t.columns; ++i) {
        const std::size_t from = static_cast<std::size_t>(k) * t.kStride + i;
        seen[t.first_column + i][static_cast<std::size_t>(t.first_slice + k)] = t.levels[from];
        EXPECT_EQ(t.coverage[from], at(c.designs[t.first_column + i], t.first_slice + k));
      }
    }
  });
  EXPECT_EQ(seen, got);
  return got;
}

void expect_same(const Prediction& got, const Prediction& want) {
  ASSERT_EQ(got.to_json(), want.to_json());
  ASSERT_EQ(got.min_dose_inside, want.min_dose_inside);
  ASSERT_EQ(got.max_dose_inside, want.max_dose_inside);
  ASSERT_EQ(got.gap_teeth, want.gap_teeth);
  ASSERT_EQ(got.lost_examples.sorted(), want.lost_examples.sorted());
  ASSERT_EQ(got.merged_examples.sorted(), want.merged_examples.sorted());
  ASSERT_EQ(got.split_examples.sorted(), want.split_examples.sorted());
  const auto same = [](const Histogram& a, const Histogram& b) {
    return a.count() == b.count() && a.scaled_sum() == b.scaled_sum() && a.least() == b.least() &&
           a.greatest() == b.greatest() && a.quantile(0.3) == b.quantile(0.3);
  };
  ASSERT_TRUE(same(got.height_error_um, want.height_error_um));
  ASSERT_TRUE(same(got.gap_contrast, want.gap_contrast));
  ASSERT_TRUE(same(got.grey_dose_error, want.grey_dose_error));
}

/// `shown` slices of `pixels`, the rest without light.
void check_prediction(const Case& c, const std::vector<Column>& pixels, int shown) {
  const PixelCurve curve = pixel_curve(c.model);
  const std::size_t columns = c.designs.size();
  BandPredictor slices(c.model, curve, c.all_layers, columns);
  BandPredictor tiles(c.model, curve, c.all_layers, columns);
  Column row(columns), cover(columns);
  for (int n = c.all_layers; n-- > 0;) {
    for (std::size_t i = 0; i < columns; ++i) {
      row[i] = at(pixels[i], n);
      cover[i] = at(c.designs[i], n);
    }
    slices.add_slice(n, n < shown ? row.data() : nullptr, cover.data());
  }
  // Some height that is no multiple of anything, dark slices apart.
  constexpr std::size_t stride = BandPredictor::kTileColumns;
  for (std::size_t first = 0; first < columns; first += stride) {
    const std::size_t count = std::min(stride, columns - first);
    for (int end = c.all_layers; end > 0;) {
      const int begin = end > shown ? std::max(shown, end - 83) : std::max(0, end - 83);
      Column light(static_cast<std::size_t>(end - begin) * stride, 0), design = light;
      for (int n = begin; n < end; ++n) {
        for (std::size_t i = 0; i < count; ++i) {
          const std::size_t to = static_cast<std::size_t>(n - begin) * stride + i;
          light[to] = at(pixels[first + i], n);
          design[to] = at(c.designs[first + i], n);
        }
      }
      tiles.add_tile({first, count, begin, end - begin}, end > shown ? nullptr : light.data(),
                     design.data());
      end = begin;
    }
  }
  const Prediction want = slices.finish(3, 5, 7);
  Prediction got = tiles.finish(3, 5, 7);
  // Slice by slice, the lanes that fill up the last block count as columns without any dose.
  if (got.max_dose_outside < 0 && want.max_dose_outside == 0) got.max_dose_outside = 0;
  ASSERT_NO_FATAL_FAILURE(expect_same(got, want));
}

void check_all(unsigned seed, int rounds) {
  std::mt19937 random(seed);
  for (int round = 0; round < rounds; ++round) {
    const Case c = random_case(random);
    const CorrectionPlan plan = c.plan();
    const auto got = solved(c, plan, round % 2);
    for (std::size_t i = 0; i < got.size(); ++i) {
      if (i && c.designs[i] == c.designs[i - 1]) {
        ASSERT_EQ(got[i], got[i - 1]);
        continue;
      }
      ASSERT_EQ(got[i], solve_column(plan, c.designs[i])) << "round " << round << " column " << i;
    }
    std::vector<Column> pixels = got;
    for (Column& column : pixels) {
      for (auto& v : column) {
        v = static_cast<std::uint8_t>(pixel_of_level(v, plan.levels.size()));
      }
    }
    ASSERT_NO_FATAL_FAILURE(check_prediction(c, pixels, c.all_layers)) << "round " << round;
    ASSERT_NO_FATAL_FAILURE(check_prediction(c, c.designs, c.layers)) << "round " << round;
    for (Column& column : pixels) {
      for (auto& v : column) v = random() % 3 ? v : static_cast<std::uint8_t>(random());
    }
    ASSERT_NO_FATAL_FAILURE(check_prediction(c, pixels, c.all_layers)) << "round " << round;
  }
}

TEST(Tiles, EqualTheDefinitions) { check_all(41, test::rounds(25)); }

TEST(Tiles, EqualTheDefinitionsWithEveryInstructionSet) {
  const std::vector<std::int64_t> targets = [] {
    std::vector<std::int64_t> all;
    for (std::int64_t left = hwy::SupportedTargets(); left; left &= left - 1) {
      all.push_back(left & -left);
    }
    return all;
  }();
  ASSERT_FALSE(targets.empty());
  for (const std::int64_t target : targets) {
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
    check_all(42, test::rounds(6));
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
}

TEST(RecordLog, GivesBackWhatWasWritten) {
  std::mt19937 random(44);
  for (const int longest : {0, 5, 3000, 400000}) {
    detail::RecordLog<std::uint32_t> log;
    std::vector<std::vector<std::uint32_t>> records(longest > 3000 ? 12 : 400);
    const auto write = [&](std::vector<std::uint32_t>& record) {
      record.resize(random() % static_cast<unsigned>(longest + 1));
      for (auto& value : record) value = static_cast<std::uint32_t>(random());
      // One by one, and several at once.
      const std::size_t single = record.size() / 3;
      for (std::size_t i = 0; i < single; ++i) log.push(record[i]);
      log.push(record.data() + single, record.size() - single);
      log.end_record();
    };
    const auto check = [&] {
      ASSERT_EQ(log.size(), records.size());
      for (std::size_t r = 0; r < records.size(); ++r) {
        ASSERT_TRUE(std::ranges::equal(log[r], records[r])) << r;
      }
    };
    for (auto& record : records) write(record);
    check();
    // An unfinished record goes with those that are dropped.
    log.push(7);
    for (const std::size_t left : {records.size() - 1, records.size() / 2, std::size_t{0}}) {
      log.drop_from(left);
      records.resize(left);
      check();
      write(records.emplace_back());
      check();
    }
  }
}

TEST(CodedTiles, GivesBackWhatWasWritten) {
  std::mt19937 random(43);
  using detail::kLanes;
  detail::CodedTiles coded;
  std::vector<std::pair<int, Column>> tiles;
  constexpr std::size_t stride = 3 * kLanes;
  for (int t = 0; t < 300; ++t) {
    const int count = 1 + static_cast<int>(random() % 67);
    const int kind = static_cast<int>(random() % 5);
    Column rows(stride * 67, 9), tile;
    for (int k = 0; k < count; ++k) {
      std::uint8_t* const row = rows.data() + static_cast<std::size_t>(k) * stride;
      for (std::size_t i = 0; i < kLanes; ++i) {
        row[i] = kind == 0                          ? std::uint8_t{0}
                 : kind == 1                        ? std::uint8_t{255}
                 : k && (kind == 2 || random() % 9) ? *(row + i - stride)
                                                    : static_cast<std::uint8_t>(random());
      }
      tile.insert(tile.end(), row, row + kLanes);
    }
    detail::LaneMask steady[67], changed[67];
    detail::tile_changes(rows.data() + stride, stride, count - 1, steady, changed);
    coded.append(rows.data(), stride, count, changed);
    tiles.emplace_back(count, std::move(tile));
  }
  for (std::size_t t = tiles.size(); t-- > 0;) {
    const auto& [count, tile] = tiles[t];
    Column rows(tile.size(), 0);
    const bool lit = coded.read(t, count, rows.data());
    EXPECT_EQ(rows, tile);
    EXPECT_EQ(lit, std::any_of(tile.begin(), tile.end(), [](auto v) { return v != 0; }));
    coded.drop_from(t);
    EXPECT_EQ(coded.tiles(), t);
  }
}

}  // namespace
}  // namespace slicecorr
