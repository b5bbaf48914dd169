// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What a correction is said to need of memory: closed forms of its figures, and which figures it takes of a print.
#include "slicecorr/memory_need.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "memory_slices.hpp"
#include "models.hpp"
#include "slicecorr/pipeline.hpp"

namespace slicecorr {
namespace {

constexpr double kMiB = 1 << 20;

/// Of what hangs together, MiB: 384 bytes a column of a band at work.
double band_mb(int width_px, int slices) {
  Grid grid;
  grid.width_px = width_px;
  grid.layers = slices;
  return 384.0 * width_px * band_rows(grid) / kMiB;
}

/// Half as much again as the sum and what is kept for the next band, in whole MiB.
constexpr double kTimes = 1.5 * 1.3;
std::int64_t to_be_sure(double mb) { return static_cast<std::int64_t>(kTimes * mb); }

TEST(MemoryNeed, OfAPlainPartIsProgramMeshPiecesAndABand) {
  MemoryFacts f;
  f.triangles = 1'000'000;
  f.width_px = 2560;
  f.slices = 1000;
  f.voxels = 100'000'000;
  const double mesh = 100e6 / kMiB, pieces = 0.2 * 1e8 / kMiB;
  const double thread = 16 + 32.0 * 2560 * 100 / kMiB + 8192.0 * 1000 / kMiB + band_mb(2560, 1000);
  // Of what hangs together: what is kept, and 16 bytes for each column while it is followed.
  const double bodies = 0.05 * 1e8 / kMiB + 16 * 1e8 / 1000 / kMiB;
  EXPECT_EQ(memory_needs(f).thread_mb, to_be_sure(thread));
  EXPECT_EQ(memory_needs(f).base_mb, to_be_sure(70 + mesh + pieces + bodies + thread));
  // Pieces beyond 64 MiB wait on the disk, and of bodies what is beyond 16: more is asked for columns alone.
  f.voxels = std::int64_t{1} << 40;
  const auto followed = [](double voxels) { return 16 * voxels / 1000 / kMiB; };
  const std::int64_t large = memory_needs(f).base_mb;
  EXPECT_EQ(large, to_be_sure(70 + mesh + 64 + 16 + followed(0x1p40) + thread));
  f.voxels *= 16;
  EXPECT_EQ(memory_needs(f).base_mb, to_be_sure(70 + mesh + 64 + 16 + followed(0x1p44) + thread));
  f.voxels /= 16;
  // Rounds of columns that are corrected together keep 80 MiB, whatever the part.
  f.together = true;
  EXPECT_NEAR(static_cast<double>(memory_needs(f).base_mb - large), kTimes * 80, 1);
  EXPECT_EQ(memory_needs(f).thread_mb, to_be_sure(thread));
}

TEST(MemoryNeed, GrowsWithEachFigureAndNeverFalls) {
  MemoryFacts plain;
  plain.width_px = 1280;
  plain.slices = 500;
  plain.voxels = 1'000'000;
  const MemoryNeeds least = memory_needs(plain);
  const auto more = [&](auto change) {
    MemoryFacts f = plain;
    change(f);
    const MemoryNeeds needs = memory_needs(f);
    EXPECT_GE(needs.thread_mb, least.thread_mb);
    return needs.base_mb > least.base_mb;
  };
  EXPECT_TRUE(more([](MemoryFacts& f) { f.triangles = 10'000'000; }));
  EXPECT_TRUE(more([](MemoryFacts& f) { f.width_px = 11520; }));
  EXPECT_TRUE(more([](MemoryFacts& f) { f.slices = 50'000; }));
  EXPECT_TRUE(more([](MemoryFacts& f) { f.voxels = 300'000'000; }));
  EXPECT_TRUE(more([](MemoryFacts& f) { f.lights = 150; }));
  EXPECT_TRUE(more([](MemoryFacts& f) { f.tables_bytes = 8 << 20; }));
  EXPECT_TRUE(more([](MemoryFacts& f) { f.stepwise = true; }));
  EXPECT_TRUE(more([](MemoryFacts& f) { f.bath_slices = 400; }));
  EXPECT_TRUE(more([](MemoryFacts& f) { f.cut_slices = 60; }));
  EXPECT_TRUE(more([](MemoryFacts& f) {
    f.stepwise = true;
    f.mirrored_slices = 100;
  }));
  EXPECT_TRUE(more([](MemoryFacts& f) { f.together = true; }));
  // Tables of many values share what takes more than 256 MiB: 200 of 8 MiB are not 1,600 MiB a set.
  MemoryFacts many = plain;
  many.tables_bytes = 8 << 20;
  many.lights = 200;
  const double tables = 256 + 8;
  const double thread = 16 + 32.0 * 1280 * 100 / kMiB + 8192.0 * 500 / kMiB + 4 * tables +
                        200 * 256.0 * 500 / kMiB + band_mb(1280, 500);
  EXPECT_EQ(memory_needs(many).thread_mb, to_be_sure(thread));
}

TEST(MemoryNeed, TakesItsFiguresOfThePrint) {
  test::MemorySlices slices(Grid{20, 10, 30, 50, 50, 50});
  for (int n = 0; n < 30; ++n) slices.at(n, 5, 5) = 255;
  slicecorr::Setup setup;
  setup.printer = test::linear_printer(1, 100);
  setup.printer.width_px = 20;
  setup.printer.height_px = 10;
  setup.resin = test::resin(576, 110);
  setup.process = test::process(1000);
  EXPECT_FALSE(corrects_together(setup));
  const CorrectionPlan plan = plan_correction(slices, setup);
  MemoryFacts facts;
  look_at_light(slices, setup.printer, setup.process, plan, facts);
  EXPECT_EQ(facts.slices, plan.all_layers);
  EXPECT_EQ(facts.lights, 1);
  EXPECT_EQ(facts.tables_bytes, 0);
  EXPECT_FALSE(facts.stepwise);
  EXPECT_EQ(facts.mirrored_slices, 0);
  EXPECT_FALSE(facts.solved_whole);
  // Beside what is left alone columns are solved one by one.
  facts.left_alone = true;
  look_at_light(slices, setup.printer, setup.process, plan, facts);
  EXPECT_TRUE(facts.stepwise);
  EXPECT_TRUE(facts.solved_whole);
  setup.printer.spread.gaussians = {{80, 1}};
  EXPECT_TRUE(corrects_together(setup));
  setup.process.spread_rounds = 0;
  EXPECT_FALSE(corrects_together(setup));
}

}  // namespace
}  // namespace slicecorr
