// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// How light spreads, scatters and inhibits, told by scans; and what of a scan's rows is a derivative.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "scan_lab.hpp"
#include "slicecorr/resins/scan_tune.hpp"
#include "tune/scan_print.hpp"

namespace slicecorr::resins {
namespace {

using namespace slicecorr::test;

/// A scan of what `real` prints of a stack, tuned by what is believed.
ScanTuneResult tuned(const SliceSource& stack, const slicecorr::Setup& believed,
                     const slicecorr::Setup& real, const ScanTuneOptions& options = {}) {
  std::mt19937 random(11);
  const Scan scan =
      scanned(solid_mesh(stack, models_of(real, stack)), random_pose(random), 2500, {1}, random);
  ScanTuneOptions few = options;
  few.points = 2000;
  return tune_by_scans({{&scan, &stack}}, believed, default_prior(), few);
}

MemorySlices corrected_hook(const slicecorr::Setup& setup) {
  return MemorySlices(CorrectedSlices(hook_part(), setup));
}

void expect_found(const ScanTuneResult& r, ScanInput input, double truth) {
  const ScanFinding& f = r.finding(input);
  EXPECT_TRUE(f.sought);
  EXPECT_TRUE(f.told()) << f.sd << " of " << f.sd_before;
  EXPECT_NEAR(f.value, truth, 4 * f.sd);
}

TEST(ScanLight, FindsHowFarLightSpreads) {
  slicecorr::Setup believed = lab_setup();
  const MemorySlices stack = corrected_hook(believed);
  believed.printer.spread.gaussians = {{24, 0.8}, {60, 0.2}};
  slicecorr::Setup real = believed;
  real.printer.spread = spread_as_wide(believed.printer.spread, 42);
  const double before = spread_width_um(believed.printer.spread);
  EXPECT_NEAR(before, std::sqrt(0.8 * 24 * 24 + 0.2 * 60 * 60), 1e-12);
  const ScanTuneResult r = tuned(stack, believed, real);
  expect_found(r, ScanInput::spread, 42 - before);
  ASSERT_TRUE(r.tuned.spread);
  EXPECT_EQ(r.tuned.spread->gaussians.size(), 2U);
  EXPECT_NEAR(r.tuned.spread->gaussians[0].sigma_um, 24 * 42 / before, 3);
  EXPECT_FALSE(r.finding(ScanInput::scatter).sought);
  EXPECT_FALSE(r.finding(ScanInput::dead_zone).sought);
}

// Where no file says it, it is looked for when it is asked for, and begins at nothing.
TEST(ScanLight, FindsSpreadThatNobodySaid) {
  const slicecorr::Setup believed = lab_setup();
  const MemorySlices stack = corrected_hook(believed);
  slicecorr::Setup real = believed;
  real.printer.spread.gaussians = {{36, 1}};
  ScanTuneOptions asked;
  asked.seek = {ScanInput::spread};
  const ScanTuneResult r = tuned(stack, believed, real, asked);
  expect_found(r, ScanInput::spread, 36);
  EXPECT_TRUE(r.tuned.spread);
  // A printer whose light does not spread: nothing is written.
  const ScanTuneResult none = tuned(stack, believed, believed, asked);
  EXPECT_GE(none.finding(ScanInput::spread).value, 0);
  EXPECT_FALSE(none.tuned.spread);
  EXPECT_NE(
      none.to_text(believed.printer, believed.resin, default_prior()).find("light spreads, um"),
      std::string::npos);
}

TEST(ScanLight, FindsHowFarLightScatters) {
  slicecorr::Setup believed = lab_setup();
  const MemorySlices stack = corrected_hook(believed);
  believed.resin.scatter_um2_per_um = 3;
  slicecorr::Setup real = believed;
  real.resin.scatter_um2_per_um = 4;
  const ScanTuneResult r = tuned(stack, believed, real);
  expect_found(r, ScanInput::scatter, 1);
  ASSERT_TRUE(r.tuned.scatter_um2_per_um);
  EXPECT_NEAR(*r.tuned.scatter_um2_per_um, 4, 0.5);
}

/// Rows of a scan that lies on what is predicted, and the same after something changed.
class Rows {
 public:
  Rows()
      : stack_(corrected_hook(lab_setup())),
        inputs_(lab_setup(), default_prior(), {}, false, false) {
    std::mt19937 random(5);
    scan_ = scanned(solid_mesh(stack_, models_of(lab_setup(), stack_)), random_pose(random), 2000,
                    {}, random);
  }
  ScanPrint print() const {
    return {{&scan_, &stack_, nullptr}, lab_setup(), inputs_, 2000, ExecutionContext{}};
  }
  const ScanInputs& inputs() const { return inputs_; }

 private:
  MemorySlices stack_;
  ScanInputs inputs_;
  Scan scan_;
};

/// The share of rows whose distance changed as `by` says, to a tenth and `within_mm`.
double share_right(const std::vector<ScanRow>& low, const std::vector<ScanRow>& middle,
                   const std::vector<ScanRow>& high, std::size_t unknown, double step) {
  int all = 0, right = 0;
  for (std::size_t i = 0; i < middle.size(); ++i) {
    if (!low[i].counts || !middle[i].counts || !high[i].counts) continue;
    const double moved = (high[i].off_mm - low[i].off_mm) / (2 * step);
    ++all;
    // Vertices are rounded to a thousandth of a layer.
    right += std::abs(moved - middle[i].by[unknown]) <
             0.1 * std::abs(middle[i].by[unknown]) + 5e-5 / step;
  }
  EXPECT_GT(all, 1000);
  return static_cast<double>(right) / all;
}

// The distance of each point changes by its derivative where an input changes: but for points beside edges, whose
// nearest place jumps.
TEST(ScanLight, RowsChangeByTheirDerivatives) {
  const Rows lab;
  ScanPrint print = lab.print();
  const ScanState begin{{}, true, 0.02};
  const std::vector<ScanRow> middle = print.rows(begin, {});
  const double steps[kScanInputs] = {0.01, 0.01, 0.03, 0, 0.002, 0.002, 0.005, 0.01, 0, 0, 0};
  for (std::size_t k = 0; k < kScanInputs; ++k) {
    if (!(steps[k] > 0)) continue;
    ScanState low = begin, high = begin;
    low.anew = high.anew = false;
    low.change[k] = k == at(ScanInput::first_layers) ? 0 : -steps[k];
    high.change[k] = k == at(ScanInput::first_layers) ? 2 * steps[k] : steps[k];
    EXPECT_GT(share_right(print.rows(low, {}), middle, print.rows(high, {}), k, steps[k]), 0.97)
        << kScanNames[k];
  }
}

// In closed form: lengths by what is shrunk of them, walls and first layers by how upright they are.
TEST(ScanLight, RowsOfShapesAreInClosedForm) {
  const Rows lab;
  ScanPrint print = lab.print();
  for (const ScanRow& row : print.rows({{}, true, 0.02}, {})) {
    if (!row.counts) continue;
    const double* const way = row.by.data() + kScanInputs + 3;
    const double level = std::hypot(way[0], way[1]);
    EXPECT_NEAR(row.by[at(ScanInput::shrinkage_z)], way[2] * row.place[2], 1e-9);
    EXPECT_NEAR(
        row.by[at(ScanInput::shrinkage_plane)],
        way[0] * (row.place[0] - print.middle()[0]) + way[1] * (row.place[1] - print.middle()[1]),
        1e-9);
    EXPECT_NEAR(row.by[at(ScanInput::walls)], -level, 0.02);
    if (level < 0.9) continue;
    EXPECT_NEAR(row.by[at(ScanInput::first_layers)], -level * std::max(0.0, 1 - row.place[2] / 0.5),
                0.02);
  }
}

}  // namespace
}  // namespace slicecorr::resins
