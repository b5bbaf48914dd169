// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Hidden laboratories: what a print was really made with is found by a scan of it.
#include "slicecorr/resins/scan_tune.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>

#include "refusal.hpp"
#include "rounds.hpp"
#include "scan_lab.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::resins {
namespace {

using namespace slicecorr::test;

struct Truth {
  TuneVector x{};
  double shrink_plane = 0, shrink_z = 0;
  double growth_mm = 0;  ///< of the first layers, >= 0
};

/// As `default_prior` says, but half as far, so that no gap of the small part closes altogether.
Truth drawn(std::mt19937& random) {
  std::normal_distribution<double> normal;
  const auto within = [&](double sd) { return std::clamp(normal(random), -2.0, 2.0) * sd; };
  Truth t;
  t.x = {within(0.05), within(0.05), within(0.1), 0};
  t.shrink_plane = within(0.005);
  t.shrink_z = within(0.005);
  t.growth_mm = std::abs(within(0.03));
  return t;
}

TunePrior half_prior() {
  TunePrior prior = default_prior();
  prior.covariance[0][0] = prior.covariance[1][1] = 0.05 * 0.05;
  prior.covariance[2][2] = 0.1 * 0.1;
  return prior;
}

class ScanLab {
 public:
  explicit ScanLab(std::mt19937& random)
      : truth(drawn(random)), shown(CorrectedSlices(hook_part(), lab_setup())) {}

  /// What the hidden laboratory prints of a stack.
  TriangleMesh printed(const SliceSource& stack) const {
    slicecorr::Setup real = tuned_setup(lab_setup(), truth.x);
    real.resin.shrinkage.growth_um = 1e3 * truth.growth_mm;
    TriangleMesh mesh = solid_mesh(stack, models_of(real, stack));
    // By itself: what `solid_mesh` does is tested elsewhere.
    for (Point3& v : mesh.vertices) {
      for (std::size_t k = 0; k < 3; ++k) v[k] *= 1 - (k < 2 ? truth.shrink_plane : truth.shrink_z);
    }
    return mesh;
  }

  MemorySlices corrected(const TuneVector& x) const {
    return MemorySlices(CorrectedSlices(hook_part(), tuned_setup(lab_setup(), x)));
  }
  /// The mean error of edges along z when a stack is printed here.
  double off_um(const SliceSource& stack, const SliceSource& design) const {
    return verify_stack(stack, design, tuned_setup(lab_setup(), truth.x)).design_error_um().mean();
  }

  Truth truth;
  MemorySlices shown;
};

TEST(ScanTune, FindsAHiddenLaboratory) {
  std::mt19937 random(1);
  ScanLab lab(random);
  lab.truth = {{0.06, -0.04, 0.1, 0}, 0.004, -0.003};
  const Scan scan = scanned(lab.printed(lab.shown), random_pose(random), 20'000, {5}, random);
  const ScanTuneResult r = tune_by_scans({{&scan, &lab.shown}}, lab_setup(), half_prior());
  if (by_night())
    std::puts(r.to_text(lab_setup().printer, lab_setup().resin, half_prior()).c_str());
  for (std::size_t k = 0; k < 3; ++k) {
    EXPECT_NEAR(r.tuned.x[k], lab.truth.x[k], 4 * r.findings[k].sd) << k;
  }
  const MemorySlices part = hook_part(), next = lab.corrected(r.tuned.x);
  const double first_um = lab.off_um(lab.shown, part), second_um = lab.off_um(next, part);
  EXPECT_GT(first_um, 2);
  EXPECT_LT(second_um, 0.25 * first_um);
}

/// Shares of 0.05 in so many trials: what one in a thousand exceeds.
int most_misses(int trials) {
  double chance = 1, below = 0;
  for (int i = 0; i < trials; ++i) chance *= 0.95;
  for (int k = 0; k <= trials; ++k) {
    below += chance;
    if (below > 0.999) return k;
    chance *= 0.05 / 0.95 * (trials - k) / (k + 1.0);
  }
  return trials;
}

/// How often intervals of an input held what is true.
struct Held {
  const char* name;
  std::size_t input;
  int trials = 0, misses = 0;
  double squares = 0;  ///< of errors in standard deviations
  void add(const ScanFinding& f, double truth) {
    ++trials;
    misses += std::abs(f.value - truth) > 1.96 * f.sd;
    squares += (f.value - truth) * (f.value - truth) / (f.sd * f.sd);
  }
};

// What is said to hold in 95 % of all laboratories does; and what was found makes the next print right.
TEST(ScanTune, IntervalsHoldAndTheNextPrintIsRight) {
  std::mt19937 random(2);
  const MemorySlices part = hook_part();
  std::array<Held, 6> held{Held{"absorbance height", 0}, Held{"light over dose", 1},
                           Held{"stray light", 2},       Held{"shrinkage in the plane", 4},
                           Held{"shrinkage along z", 5}, Held{"growth of the first layers", 7}};
  int trials = 0, misses = 0;
  double first_um = 0, second_um = 0;
  // Two by day, two hundred by night.
  const int laboratories = by_night() ? 200 : 2;
  for (int round = 0; round < laboratories; ++round) {
    const ScanLab lab(random);
    const Scan scan =
        scanned(lab.printed(lab.shown), random_pose(random), 6000,
                {round % 2 ? 20.0 : 5.0, round % 2 == 1, true, round % 3 != 2}, random);
    ScanTuneOptions options;
    options.points = 4000;
    const ScanTuneResult r =
        tune_by_scans({{&scan, &lab.shown}}, lab_setup(), half_prior(), options);
    const std::array<double, 6> truth{lab.truth.x[0],     lab.truth.x[1],
                                      lab.truth.x[2],     lab.truth.shrink_plane,
                                      lab.truth.shrink_z, lab.truth.growth_mm};
    for (std::size_t k = 0; k < truth.size(); ++k) {
      const ScanFinding& f = r.findings[held[k].input];
      held[k].add(f, truth[k]);
      EXPECT_LT(std::abs(f.value - truth[k]), 5 * f.sd) << round << " " << held[k].name;
    }
    if (by_night() && round % 20 == 19) {
      std::printf("%d laboratories; held:", round + 1);
      for (const Held& h : held) std::printf(" %d", h.trials - h.misses);
      std::puts("");
    }
    // Of laboratories with little noise: each costs two verifications and a correction.
    if (round % 20 != 0 || !by_night()) continue;
    first_um += lab.off_um(lab.shown, part);
    second_um += lab.off_um(lab.corrected(r.tuned.x), part);
  }
  for (const Held& h : held) {
    trials += h.trials;
    misses += h.misses;
    // One in a thousand laboratories' worth of each input exceeds that by chance.
    EXPECT_LE(h.misses, most_misses(h.trials)) << h.name << ", of " << h.trials;
    if (by_night()) {
      std::printf("%-28s holds in %d of %d; errors %.2f standard deviations rms\n", h.name,
                  h.trials - h.misses, h.trials, std::sqrt(h.squares / h.trials));
    }
  }
  if (by_night()) {
    std::printf("%d of %d intervals hold; the next print %.2f of %.2f um\n", trials - misses,
                trials, second_um / 10, first_um / 10);
    // All laboratories together: one in which little was off has little to gain.
    EXPECT_LT(second_um, 0.25 * first_um);
  }
  EXPECT_LE(misses, most_misses(trials)) << "of " << trials;
}

TEST(ScanTune, SaysWhatAPartCannotTell) {
  // A plain block: every face that light reaches moves alike.
  const Grid grid{40, 40, 30, 50, 50, 50};
  MemorySlices block(grid);
  for (int n = 0; n < 30; ++n) {
    for (int y = 8; y < 32; ++y) {
      for (int x = 8; x < 30; ++x) block.at(n, x, y) = 255;
    }
  }
  slicecorr::Setup setup = lab_setup();
  setup.printer.width_px = setup.printer.height_px = 40;
  std::mt19937 random(3);
  const Scan scan =
      scanned(solid_mesh(block, models_of(setup, block)), random_pose(random), 5000, {10}, random);
  ScanTuneOptions options;
  options.points = 2500;
  const ScanTuneResult r = tune_by_scans({{&scan, &block}}, setup, default_prior(), options);
  EXPECT_FALSE(r.findings[2].told());
  EXPECT_FALSE(r.not_apart.empty());
  EXPECT_TRUE(r.unexplained.empty());
}

// What is told and sure comes into the resin's file, on top of what it says; all else stays.
TEST(ScanTune, WritesWhatIsSureAlone) {
  std::vector<ScanFinding> f(kScanInputs, {0, 1, 1});
  const Shrinkage before{0.5, 0.3, 40, 500};
  EXPECT_FALSE(found_shrinkage(f, before));
  f[4] = {0.01, 0.001, 0.01};
  f[5] = {0.001, 0.001, 0.01};  // told, but not beyond its 95 %
  f[7] = {-0.06, 0.001, 0.1};   // less than nothing
  const auto now = found_shrinkage(f, before);
  ASSERT_TRUE(now);
  // What is left is 0.995 of 0.99.
  EXPECT_NEAR(now->plane_per_cent, 100 * (1 - 0.995 * 0.99), 1e-12);
  EXPECT_EQ(now->z_per_cent, 0.3);
  EXPECT_EQ(now->growth_um, 0);
}

// A table's answer is where the scan's begins: a prior that is sure is not left, and its mean is where it is.
TEST(ScanTune, WhatWasKnownBeforeCounts) {
  std::mt19937 random(4);
  ScanLab lab(random);
  lab.truth = {{0.06, 0, 0, 0}, 0, 0, 0};
  const Scan scan = scanned(lab.printed(lab.shown), random_pose(random), 5000, {5}, random);
  TunePrior sure = half_prior();
  sure.covariance[0][0] = 1e-8;
  sure.mean[0] = 0.06;
  ScanTuneOptions options;
  options.points = 2500;
  options.rounds = 3;
  const ScanTuneResult r = tune_by_scans({{&scan, &lab.shown}}, lab_setup(), sure, options);
  EXPECT_NEAR(r.tuned.x[0], 0.06, 4e-4);
  EXPECT_LE(r.findings[0].sd, 1.01e-4);
  // The same print by its own process.
  const Process process = lab_setup().process;
  const ScanTuneResult own =
      tune_by_scans({{&scan, &lab.shown, &process}}, lab_setup(), sure, options);
  EXPECT_EQ(own.tuned.x, r.tuned.x);
}

// What was scanned once counts once, whatever its file is called.
TEST(ScanTune, AScanCountsOnce) {
  Scan one, other;
  one.source = "one.ply";
  other.source = "other.ply";
  one.points = {{0, 0, 0}, {1, 2, 3}};
  other.points = {{0, 0, 0}, {1, 2, 3.000001}};
  const std::vector<std::string> marks = marks_to_count({one, other}, "name = \"r\"\n", "r.toml");
  ASSERT_EQ(marks.size(), 2U);
  EXPECT_NE(marks[0], marks[1]);
  const std::string counted =
      "name = \"r\"\n[provenance]\ntuned_by = \"0123456789abcdef, " + marks[1] + "\"\n";
  EXPECT_EQ(marks_to_count({one}, counted, "r.toml").size(), 1U);
  EXPECT_NE(refusal([&] {
              marks_to_count({one, other}, counted, "r.toml");
            }).find("other.ply: was counted before: 'r.toml'"),
            std::string::npos);
  other.points = one.points;
  EXPECT_NE(refusal([&] {
              marks_to_count({one, other}, "", "r.toml");
            }).find("other.ply: is one of the other scans once more"),
            std::string::npos);
}

TEST(ScanTune, RefusesNothingAndOtherParts) {
  EXPECT_THROW(tune_by_scans({}, lab_setup(), half_prior()), InputError);
}

}  // namespace
}  // namespace slicecorr::resins
