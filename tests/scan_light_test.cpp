// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// How light spreads, scatters and inhibits, told by scans; and what of a scan's rows is a derivative.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "scan_lab.hpp"
#include "slicecorr/resins/scan_tune.hpp"
#include "tune/near_places.hpp"
#include "tune/scan_print.hpp"
#include "uv_models.hpp"

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

/// A small foot with a wall and two shelves, under UV light.
struct UvLab {
  slicecorr::Setup believed{uv::uv_printer(), uv::resin_1(), uv::uv_process(60, 40)};
  MemorySlices stack;
  UvLab() : stack(corrected()) {}

 private:
  MemorySlices corrected() {
    believed.printer.width_px = 30;
    believed.printer.height_px = 24;
    MemorySlices part(Grid{30, 24, 32, 50, 50, 50});
    const auto fill = [&](const PixelBox& box, int first, int last) {
      for (int n = first; n <= last; ++n) {
        for (int y = box.y0; y < box.y1; ++y) {
          for (int x = box.x0; x < box.x1; ++x) part.at(n, x, y) = 255;
        }
      }
    };
    fill({4, 4, 26, 20}, 0, 5);
    fill({4, 4, 10, 20}, 6, 31);
    fill({4, 4, 24, 11}, 12, 16);
    fill({4, 13, 20, 20}, 22, 27);
    return MemorySlices(CorrectedSlices(part, believed));
  }
};

// Edges stay at layers and jump to the next, so a search from what is believed ends beside the answer, and what is found is
// right to a third of what was believed, not to its interval. By night: each surface takes its time.
TEST(ScanLightNight, FindsTheDeadZone) {
  const UvLab lab;
  slicecorr::Setup real = lab.believed;
  real.resin.inhibition->beta *= std::exp(0.12);
  const ScanTuneResult r = tuned(lab.stack, lab.believed, real);
  const ScanFinding& f = r.finding(ScanInput::dead_zone);
  EXPECT_TRUE(f.told());
  // One print does not part it from the dose, which moves edges nearly alike: nearer than what was believed.
  EXPECT_LT(std::abs(f.value - 0.12), 0.12);
  EXPECT_LT(r.after_um, 0.1 * r.before_um);
  EXPECT_TRUE(r.tuned.uv_beta);
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
    ScanTuneOptions options;
    options.points = 2000;
    return {{&scan_, &stack_, nullptr}, lab_setup(), inputs_, options, ExecutionContext{}};
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

// A print whose surface would be too large at once is seen in strips, which tell the same.
TEST(ScanLight, LargePrintsAreSeenInStrips) {
  const slicecorr::Setup believed = lab_setup();
  const MemorySlices stack = corrected_hook(believed);
  const slicecorr::Setup real = tuned_setup(believed, {0.05, -0.03, 0, 0});
  // So many rounds that both have settled.
  ScanTuneOptions few, strips;
  few.rounds = strips.rounds = 12;
  strips.most_triangles = 3e4;
  const ScanTuneResult whole = tuned(stack, believed, real, few),
                       cut = tuned(stack, believed, real, strips);
  for (const std::size_t k : {0, 1, 2, 4, 5, 6, 7}) {
    EXPECT_NEAR(cut.findings[k].value, whole.findings[k].value, 0.1 * whole.findings[k].sd)
        << kScanNames[k];
  }
  EXPECT_EQ(cut.points, whole.points);
}

double distance_to_box(const Point3& p, const Point3& low, const Point3& high) {
  double squares = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    const double d = std::max({low[k] - p[k], p[k] - high[k], 0.0});
    squares += d * d;
  }
  return std::sqrt(squares);
}

// What lies within the distance is never missed; what lies farther than it and two cells along each axis never taken.
TEST(NearPlaces, AreThoseWithinTheDistance) {
  std::mt19937 random(21);
  std::uniform_real_distribution<double> even(-3, 3), size(0, 0.3);
  EXPECT_FALSE(NearPlaces({}, 1).meets({-9, -9, -9}, {9, 9, 9}));
  int met = 0, apart = 0;
  for (const double within_mm : {0.05, 0.4}) {
    std::vector<Point3> places;
    for (int i = 0; i < 60; ++i) places.push_back({even(random), even(random), even(random)});
    const NearPlaces near(places, within_mm);
    for (int i = 0; i < 20'000; ++i) {
      const Point3 low{even(random), even(random), even(random)};
      const Point3 high{low[0] + size(random), low[1] + size(random), low[2] + size(random)};
      double nearest = 1e9;
      for (const Point3& p : places) nearest = std::min(nearest, distance_to_box(p, low, high));
      if (nearest <= within_mm) {
        EXPECT_TRUE(near.meets(low, high));
        ++met;
      } else if (nearest > std::sqrt(3.0) * (within_mm + 2 * within_mm / 3)) {
        EXPECT_FALSE(near.meets(low, high));
        ++apart;
      }
    }
  }
  EXPECT_GT(met, 1000);
  EXPECT_GT(apart, 1000);
}

// Around places a surface is, triangle by triangle, what it is as a whole.
TEST(NearPlaces, SurfacesAroundThemAreTheSame) {
  slicecorr::Setup setup = lab_setup();
  setup.resin.shrinkage = {1, 0.5, 80, 500};
  const MemorySlices stack = corrected_hook(setup);
  const TriangleMesh all = solid_mesh(stack, models_of(setup, stack));
  const NearPlaces near({{0.9, 1.1, 0.02}, {1.5, 0.7, 1.4}}, 0.3);
  SolidOptions options;
  options.wanted = [&](const Point3& low, const Point3& high) { return near.meets(low, high); };
  const TriangleMesh part = solid_mesh(stack, models_of(setup, stack), options);
  const auto corners = [](const TriangleMesh& mesh, const auto& keep) {
    std::vector<std::array<Point3, 3>> found;
    for (const auto& t : mesh.triangles) {
      const std::array<Point3, 3> c{mesh.vertices[t[0]], mesh.vertices[t[1]], mesh.vertices[t[2]]};
      if (keep(c)) found.push_back(c);
    }
    return found;
  };
  const auto wanted = [&](const std::array<Point3, 3>& c) {
    Point3 low = c[0], high = c[0];
    for (const Point3& p : c) {
      for (std::size_t k = 0; k < 3; ++k) {
        low[k] = std::min(low[k], p[k]);
        high[k] = std::max(high[k], p[k]);
      }
    }
    return near.meets(low, high);
  };
  const auto kept = corners(part, [](const auto&) { return true; });
  EXPECT_EQ(kept, corners(all, wanted));
  EXPECT_GT(kept.size(), 100U);
  EXPECT_LT(kept.size(), all.triangles.size() / 2);
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
