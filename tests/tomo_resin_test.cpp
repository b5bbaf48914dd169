// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Resin that changes while it is printed: inhibitor that comes back, dose that spreads.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <filesystem>
#include <functional>
#include <memory>
#include <numbers>
#include <random>
#include <vector>

#include "refusal.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/tomo/print.hpp"
#include "slicecorr/tomo/rays.hpp"
#include "slicecorr/tomo/shown.hpp"
#include "slicecorr/vial.hpp"
#include "stack_fixture.hpp"
#include "tomo/operators/dose_spread.hpp"
#include "tomo/operators/spread_projector.hpp"
#include "tomo/print/changing_resin.hpp"
#include "tomo_jobs.hpp"

namespace slicecorr::tomo {
namespace {

using detail::DoseSpread;
using detail::TurnOfVoxel;
using testing::HasSubstr;

using std::numbers::pi;

// ---- inhibitor that comes back

/// A turn in steps of light.
TurnOfVoxel turn_of(const std::vector<double>& light, double back) {
  TurnOfVoxel turn;
  for (const double l : light) turn.add(l, back);
  return turn;
}

/// E step by step: what it is in the end, and what it was at most.
struct Marched {
  double end = 0, most = 0;
};
Marched march(const std::vector<double>& light, double back, int turns, double before) {
  Marched m{before, before};
  for (int n = 0; n < turns; ++n) {
    for (const double l : light) {
      m.end = std::max(0.0, m.end + l - back);
      m.most = std::max(m.most, m.end);
    }
  }
  return m;
}

TEST(TomoInhibition, EvenLightTakesTheInhibitorInTheTimeOfTheClosedForm) {
  // t_inh = D_inh / (dD/dt - rho): D_inh 3, 0.5 and 0.2 mJ/cm³ a second: 10 s, turns of 2 s.
  const TurnOfVoxel turn = turn_of({1.0}, 0.4);
  EXPECT_DOUBLE_EQ(detail::after_turns(turn, 5, 0), 3.0);
  EXPECT_DOUBLE_EQ(detail::most_in_turns(turn, 5, 0), 3.0);
  // Never, with light that is as weak as what comes back, or weaker.
  EXPECT_EQ(detail::most_in_turns(turn_of({0.4}, 0.4), 1000000, 0), 0);
  EXPECT_EQ(detail::most_in_turns(turn_of({0.3}, 0.4), 1000000, 0), 0);
}

TEST(TomoInhibition, TurnsInClosedFormAreTheSameAsStepByStep) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> share(0, 1);
  int below = 0, above = 0;
  for (int round = 0; round < 300; ++round) {
    std::vector<double> light(1 + random() % 24);
    for (double& l : light) l = random() % 3 == 0 ? share(random) : 0;
    const double back = 0.5 * share(random), before = round % 2 ? 3 * share(random) : 0;
    const TurnOfVoxel turn = turn_of(light, back);
    const int turns = 1 + static_cast<int>(random() % 9);
    const Marched m = march(light, back, turns, before);
    EXPECT_NEAR(detail::after_turns(turn, turns, before), m.end, 1e-12);
    EXPECT_NEAR(detail::most_in_turns(turn, turns, before), m.most, 1e-12);
    // Averages are too low, by no more than what comes back in a turn.
    const double average = std::max(0.0, turns * turn.gain);
    if (before == 0) {
      EXPECT_GE(m.most, average - 1e-12);
      EXPECT_LE(m.most, average + back * static_cast<double>(light.size()) + 1e-12);
    }
    (turn.gain > 0 ? above : below)++;
  }
  EXPECT_GT(below, 50);
  EXPECT_GT(above, 50);
}

/// A job whose light comes unevenly, and what frames leave one by one.
TomoJob uneven_job(TurnDirection direction, int angles) {
  Printer printer = bench_printer();
  printer.calibration = {{0, 0.0}, {255, 2.0}};
  printer.rotation->direction = direction;
  TomoJob job = random_job(printer, 2, angles);
  const Bench bench = make_bench(job.printer, job.resin, job.sampling);
  const TomoGrid& g = bench.grid;
  for (int m = 0; m < g.angles; ++m) {
    for (int i = 0; i < g.pixels; ++i) {
      for (int z = 0; z < g.slices; ++z) {
        if ((i / 6 + m / 2 + z) % 3 != 0) job.levels[g.pixel(m, i, z)] = 0;
      }
    }
  }
  return job;
}

std::vector<Box<float>> doses_of_frames(const TomoJob& job) {
  const Bench bench = make_bench(job.printer, job.resin, job.sampling);
  const TomoGrid& g = bench.grid;
  std::vector<Box<float>> doses;
  TomoJob one = job;
  one.turns = 1;
  one.resin.inhibition_resupply_mj_cm3_s = one.resin.dose_diffusion_m2_s = 0;
  for (int frame = 0; frame < g.angles; ++frame) {
    std::fill(one.levels.begin(), one.levels.end(), std::uint16_t{0});
    const int m = bench.frame_of_angle(frame);
    for (int i = 0; i < g.pixels; ++i) {
      for (int z = 0; z < g.slices; ++z) {
        one.levels[g.pixel(m, i, z)] = job.levels[g.pixel(m, i, z)];
      }
    }
    doses.push_back(dose_of(one));
  }
  return doses;
}

TEST(TomoInhibition, DosesOfJobsAreThoseOfFramesOneAfterAnother) {
  for (const auto direction : {TurnDirection::clockwise, TurnDirection::counterclockwise}) {
    TomoJob job = uneven_job(direction, 12);
    const double turn_s = job.printer.rotation->turn_s();
    const std::vector<Box<float>> frames = doses_of_frames(job);
    double most = 0;
    for (std::size_t v = 0; v < frames[0].values.size(); ++v) {
      double sum = 0;
      for (const Box<float>& frame : frames) sum += frame.values[v];
      most = std::max(most, sum);
    }
    // A third of what the brightest voxel gets comes back.
    job.resin.inhibition_resupply_mj_cm3_s = most / 3 / turn_s;
    const Box<float> dose = dose_of(job);
    double apart = 0;
    std::size_t gelled = 0, gelled_by_averages = 0;
    const double to_gel = 0.4 * most;
    for (std::size_t v = 0; v < dose.values.size(); ++v) {
      std::vector<double> light;
      double sum = 0;
      for (const Box<float>& frame : frames) {
        light.push_back(frame.values[v]);
        sum += frame.values[v];
      }
      const double back = job.resin.inhibition_resupply_mj_cm3_s * turn_s / 12;
      const Marched m = march(light, back, job.turns, 0);
      // Doses in single precision, of 12 frames and as a whole.
      ASSERT_NEAR(dose.values[v], m.most, 3e-6 * most);
      const double average = std::max(0.0, job.turns * (sum - 12 * back));
      apart = std::max(apart, m.most - average);
      gelled += m.most >= to_gel;
      gelled_by_averages += average >= to_gel;
    }
    // It matters: averages miss up to what comes back in a turn.
    EXPECT_GT(apart, 0.05 * most);
    EXPECT_LE(apart, most / 3 * (1 + 1e-5));
    EXPECT_GT(gelled, gelled_by_averages);
    // What was really shown is judged alike.
    std::vector<Showing> shown;
    for (int n = 0; n < job.turns * 12; ++n) {
      shown.push_back({n % 12, 30.0 * n - 15, 30.0 * n + 15, turn_s / 12, 1});
    }
    const Box<float> of_shown = dose_of(job, shown);
    for (std::size_t v = 0; v < dose.values.size(); ++v) {
      ASSERT_NEAR(of_shown.values[v], dose.values[v], 3e-6 * most);
    }
    // A print that stopped after two of three turns is one of two.
    shown.resize(24);
    TomoJob two = job;
    two.turns = 2;
    const Box<float> of_stopped = dose_of(job, shown), of_two = dose_of(two);
    for (std::size_t v = 0; v < dose.values.size(); ++v) {
      ASSERT_NEAR(of_stopped.values[v], of_two.values[v], 3e-6 * most);
    }
  }
}

TEST(TomoInhibition, PrintsTakeTheTurnsThatTheClosedFormSays) {
  Resin resin = bench_resin();
  PrintOptions options;
  options.angles = 60;
  options.solve.rungs = {0.98, 0.9};
  const Print still = solve_print(square_part(), 0.25, bench_printer(), resin, options);
  // Half of what the weakest voxel gets comes back.
  const double turn_mj_cm3 = 20.0 / still.figures.turns;
  resin.inhibition_resupply_mj_cm3_s = 0.5 * turn_mj_cm3 / 14.4;
  resin.inhibition_dose_mj_cm3 = 10;
  const Print print = solve_print(square_part(), 0.25, bench_printer(), resin, options);
  EXPECT_EQ(print.figures.gel_dose_mj_cm3, 30);
  EXPECT_TRUE(print.figures.feasible());
  EXPECT_GE(print.figures.metrics.min_gel, 30);
  EXPECT_LT(print.figures.metrics.min_gel, 30.5);
  EXPECT_LE(print.figures.metrics.contrast, print.figures.contrast_bound);
  // Inhibitors take their share of what void has, too.
  EXPECT_GT(print.figures.metrics.contrast, still.figures.metrics.contrast);
  // (20 + 10) / (d - d / 2), rounded up, where the dose of a turn at full light is d or a bit more.
  EXPECT_LE(print.figures.turns, 3 * still.figures.turns);
  EXPECT_GE(print.figures.turns, 3 * (still.figures.turns - 1));
}

TEST(TomoInhibition, WhatComesBackAsFastIsRefusedNamingTheVoxel) {
  Resin resin = bench_resin();
  resin.inhibition_resupply_mj_cm3_s = 10;
  PrintOptions options;
  options.angles = 60;
  options.solve.rungs = {0.98};
  try {
    solve_print(square_part(), 0.25, bench_printer(), resin, options);
    FAIL();
  } catch (const InfeasibleError& e) {
    EXPECT_THAT(e.what(), testing::MatchesRegex(
                              "inhibitor comes back as fast as light takes it: 10 mJ/cm³ a second, "
                              "and the part's voxel [12][0-9], [12][0-9] in slice 0 gets [0-9.]+ "
                              "where all pixels are at their brightest; expected more light"));
  }
}

// ---- dose that spreads

/// exp(-kappa L) by small steps in double precision, one voxel after another, with its own idea of
/// what touches what: resin of the grid, `dark` slices more at both ends.
class SmallSteps {
 public:
  SmallSteps(const TomoGrid& grid, const Box<std::uint8_t>& insert, int dark)
      : grid_(grid), dark_(dark), nz_(grid.slices + 2 * dark), n_(grid.voxels) {
    open_.assign(static_cast<std::size_t>(n_ * n_ * nz_), false);
    values.assign(open_.size(), 0.0);
    const double middle = 0.5 * (n_ - 1);
    for (int z = 0; z < nz_; ++z) {
      for (int y = 0; y < n_; ++y) {
        for (int x = 0; x < n_; ++x) {
          const int slice = std::clamp(z - dark_, 0, grid.slices - 1);
          const bool opaque = !insert.values.empty() && insert.values[insert.at(slice, y, x)] > 0;
          open_[at(x, y, z)] = std::hypot(x - middle, y - middle) <= middle + 1e-9 && !opaque;
        }
      }
    }
  }
  void spread(double kappa) {
    const int steps = static_cast<int>(std::ceil(kappa / 0.002));
    const double share = kappa / steps;
    std::vector<double> next;
    for (int s = 0; s < steps; ++s) {
      next = values;
      for (int z = 0; z < nz_; ++z) {
        for (int y = 0; y < n_; ++y) {
          for (int x = 0; x < n_; ++x) {
            flow(x, y, z, x + 1, y, z, share, next);
            flow(x, y, z, x, y + 1, z, share, next);
            flow(x, y, z, x, y, z + 1, share, next);
          }
        }
      }
      values.swap(next);
    }
  }
  bool open(int x, int y, int slice) const { return open_[at(x, y, slice + dark_)]; }
  double& value(int x, int y, int slice) { return values[at(x, y, slice + dark_)]; }
  std::vector<double> values;

 private:
  std::size_t at(int x, int y, int z) const {
    return static_cast<std::size_t>((z * n_ + y) * n_ + x);
  }
  void flow(int x0, int y0, int z0, int x1, int y1, int z1, double share,
            std::vector<double>& next) const {
    if (x1 >= n_ || y1 >= n_ || z1 >= nz_) return;
    const std::size_t a = at(x0, y0, z0), b = at(x1, y1, z1);
    if (!open_[a] || !open_[b]) return;
    next[a] += share * (values[b] - values[a]);
    next[b] += share * (values[a] - values[b]);
  }
  TomoGrid grid_;
  int dark_, nz_, n_;
  std::vector<bool> open_;
};

Box<std::uint8_t> rod(const TomoGrid& grid, int x0, int x1, int y0, int y1) {
  Box<std::uint8_t> insert{grid.slices, grid.voxels, grid.voxels, {}};
  insert.values.assign(static_cast<std::size_t>(grid.slices * grid.voxels * grid.voxels), 0);
  for (int z = 0; z < grid.slices; ++z) {
    for (int y = y0; y < y1; ++y) {
      for (int x = x0; x < x1; ++x) insert.values[insert.at(z, y, x)] = 255;
    }
  }
  return insert;
}

void spread(const DoseSpread& by, double kappa, Array<float>& numbers) {
  by.apply(by.series([&](double lambda) { return detail::spread_for(kappa, lambda); }), numbers,
           {});
}

template <class Use>
void each_voxel(const TomoGrid& grid, const Use& use) {
  for (int y = 0; y < grid.voxels; ++y) {
    for (int x = grid.inside(y).first; x < grid.inside(y).end; ++x) use(x, y);
  }
}

TEST(TomoSpread, AnEvenDoseStaysAsItIs) {
  const TomoGrid grid = square_grid(23, 8, 5);
  for (const bool with_insert : {false, true}) {
    const Box<std::uint8_t> insert = with_insert ? rod(grid, 9, 13, 5, 12) : Box<std::uint8_t>{};
    const DoseSpread by(grid, insert, 2 * grid.voxel_mm());
    Array<float> numbers(by.size(), 0.0F);
    const int rows = grid.slices + 2 * by.below();
    const auto each = [&](const auto& use) {
      each_voxel(grid, [&](int x, int y) {
        if (with_insert && insert.values[insert.at(0, y, x)] > 0) return;
        for (int z = 0; z < rows; ++z) use(numbers[by.at(x, y) - by.below() + z]);
      });
    };
    each([](float& d) { d = 3; });
    spread(by, 2, numbers);
    // Some 30 sums of single precision.
    each([](const float& d) { ASSERT_NEAR(d, 3, 3e-6); });
  }
}

TEST(TomoSpread, WavesAreDampedByTheClosedForm) {
  // Along z, between ends that nothing leaves by, waves of whole half periods keep their form.
  const TomoGrid grid = square_grid(9, 8, 40);
  const DoseSpread by(grid, {}, 0);
  const int rows = grid.slices + 2 * by.below();
  for (const int halves : {1, 6, 20}) {
    const double k = pi * halves / rows, kappa = 0.7;
    Array<float> numbers(by.size(), 0.0F);
    const auto wave = [&](int z) { return std::cos(k * (z + 0.5)); };
    each_voxel(grid, [&](int x, int y) {
      for (int z = 0; z < rows; ++z) {
        numbers[by.at(x, y) - by.below() + z] = static_cast<float>(wave(z));
      }
    });
    spread(by, kappa, numbers);
    const double damped = std::exp(-kappa * (2 - 2 * std::cos(k)));
    // Of a Gaussian exp(-k² sigma²/2), sigma² = 2 kappa: the voxels' differences are less than k² by
    // k^4/12.
    EXPECT_NEAR(damped, std::exp(-kappa * k * k), kappa * std::pow(k, 4) / 12);
    each_voxel(grid, [&](int x, int y) {
      for (int z = 0; z < rows; ++z) {
        ASSERT_NEAR(numbers[by.at(x, y) - by.below() + z], damped * wave(z), 2e-6);
      }
    });
  }
}

TEST(TomoSpread, APointSpreadsWithItsVariance) {
  const TomoGrid grid = square_grid(41, 8, 41);
  const double kappa = 1.5, deviation = std::sqrt(2 * kappa);
  const DoseSpread by(grid, {}, deviation * grid.voxel_mm());
  Array<float> numbers(by.size(), 0.0F);
  numbers[by.at(20, 20) + 20] = 1;
  spread(by, kappa, numbers);
  double sum = 0, xx = 0, yy = 0, zz = 0;
  each_voxel(grid, [&](int x, int y) {
    for (int z = -by.below(); z < grid.slices + by.below(); ++z) {
      const double d = numbers[by.at(x, y) + z];
      sum += d;
      xx += d * (x - 20) * (x - 20);
      yy += d * (y - 20) * (y - 20);
      zz += d * (z - 20) * (z - 20);
    }
  });
  EXPECT_NEAR(sum, 1, 1e-5);
  for (const double variance : {xx, yy, zz}) EXPECT_NEAR(variance, 2 * kappa, 1e-3);
}

TEST(TomoSpread, WallsAndInsertsLetNoDoseThrough) {
  const TomoGrid grid = square_grid(21, 8, 4);
  // A plate that cuts the vial in two.
  const Box<std::uint8_t> plate = rod(grid, 9, 11, 0, 21);
  const DoseSpread by(grid, plate, 3 * grid.voxel_mm());
  Array<float> numbers(by.size(), 0.0F);
  for (int z = 0; z < 4; ++z) numbers[by.at(7, 10) + z] = 1;
  spread(by, 4.5, numbers);
  double left = 0;
  each_voxel(grid, [&](int x, int y) {
    for (int z = -by.below(); z < grid.slices + by.below(); ++z) {
      const float d = numbers[by.at(x, y) + z];
      if (x >= 9) {
        ASSERT_EQ(d, 0);
      } else {
        left += d;
      }
    }
  });
  EXPECT_NEAR(left, 4, 1e-4);
}

TEST(TomoSpread, SmallStepsSayTheSame) {
  const TomoGrid grid = square_grid(15, 8, 5);
  for (const bool with_insert : {false, true}) {
    const Box<std::uint8_t> insert = with_insert ? rod(grid, 6, 9, 4, 9) : Box<std::uint8_t>{};
    const double kappa = 0.6, deviation = std::sqrt(2 * kappa);
    const DoseSpread by(grid, insert, deviation * grid.voxel_mm());
    SmallSteps steps(grid, insert, by.below());
    Array<float> numbers(by.size(), 0.0F);
    std::mt19937 random(7);
    each_voxel(grid, [&](int x, int y) {
      for (int z = 0; z < grid.slices; ++z) {
        const float d = static_cast<float>(random() % 1000) / 1000;
        numbers[by.at(x, y) + z] = d;
        if (steps.open(x, y, z)) steps.value(x, y, z) = d;
      }
    });
    spread(by, kappa, numbers);
    steps.spread(kappa);
    // Steps of 0.002: (0.002 lambda)²/2 each, 300 of them; exp(-0.6 lambda) lambda² is at most 1.5.
    each_voxel(grid, [&](int x, int y) {
      for (int z = 0; z < grid.slices; ++z) {
        ASSERT_NEAR(numbers[by.at(x, y) + z], steps.open(x, y, z) ? steps.value(x, y, z) : 0, 1e-3);
      }
    });
  }
}

TEST(TomoSpread, TurnsAreTheMeanOfWhatEachLeaves) {
  for (const double one : {1e-9, 0.01, 0.3, 4.0}) {
    for (const int turns : {1, 2, 17}) {
      double sum = 0;
      for (int k = 1; k <= turns; ++k) sum += std::exp(-one * (turns - k + 0.5));
      EXPECT_NEAR(detail::spread_of_turns(turns, 0.5 * one, 2), sum / turns, 1e-12);
    }
  }
  EXPECT_EQ(detail::spread_of_turns(5, 0.3, 0), 1);
}

/// <A x, b> and <x, A^T b>: relative difference to the product of their parts' sizes.
void expect_transposes(const Projector& projector, const TomoGrid& grid) {
  ASSERT_EQ(projector.shape(), grid.shape());
  ASSERT_EQ(grid.blocks(), 1U);
  std::mt19937 random(11);
  std::uniform_real_distribution<float> number(-1, 1);
  Field x(grid);
  each_voxel(grid, [&](int i, int j) {
    for (int z = 0; z < grid.slices; ++z) x.values[grid.voxel(i, j, z)] = number(random);
  });
  Light b(grid);
  const int rows = grid.coupled() ? grid.rows : grid.slices;
  for (int m = 0; m < grid.angles; ++m) {
    for (int i = 0; i < grid.pixels; ++i) {
      for (int z = 0; z < rows; ++z) b.values[grid.pixel(m, i, z)] = number(random);
    }
  }
  const Light ax = forward(projector, {}, x);
  const Field atb = adjoint(projector, {}, b);
  double one = 0, other = 0, size = 0;
  for (std::size_t i = 0; i < b.values.size(); ++i) {
    const double product = static_cast<double>(ax.values[i]) * b.values[i];
    one += product;
    size += std::abs(product);
  }
  for (std::size_t i = 0; i < x.values.size(); ++i) {
    other += static_cast<double>(x.values[i]) * atb.values[i];
  }
  EXPECT_GT(size, 0);
  EXPECT_NEAR(one, other, 1e-6 * size);
  ExecutionContext three;
  three.threads = 3;
  EXPECT_EQ(forward(projector, three, x).values, ax.values);
  EXPECT_EQ(adjoint(projector, three, b).values, atb.values);
}

TEST(TomoSpread, OperatorsAreTransposes) {
  for (const int slices : {1, 5, 40, 130}) {
    for (const bool with_insert : {false, true}) {
      SCOPED_TRACE(slices);
      const TomoGrid grid = square_grid(25, 24, slices, 3);
      const Box<std::uint8_t> insert = with_insert ? rod(grid, 10, 13, 9, 12) : Box<std::uint8_t>{};
      std::shared_ptr<const Shadow> shadow;
      if (with_insert) {
        Volume opaque(grid);
        each_voxel(grid, [&](int x, int y) {
          for (int z = 0; z < slices; ++z) {
            opaque.coverage[grid.voxel(x, y, z)] = insert.values[insert.at(z, y, x)];
          }
        });
        shadow = std::make_shared<Shadow>(cast_shadow(opaque));
      }
      const double kappa = 0.2;
      const int turns = 6;
      auto by = std::make_shared<DoseSpread>(grid, insert,
                                             std::sqrt(2 * kappa * turns) * grid.voxel_mm());
      auto series =
          by->series([&](double lambda) { return detail::spread_of_turns(turns, kappa, lambda); });
      const auto projector = detail::make_spread_projector(
          make_projector(grid, {.alpha_per_mm = 0.2}, shadow), grid, by, series);
      EXPECT_EQ(projector->shape().coupled, slices > 1);
      expect_transposes(*projector, detail::spread_grid(grid));
    }
  }
}

Printer pinhole_printer() {
  Printer printer = bench_printer();
  printer.optics->kind = OpticsKind::pinhole;
  printer.optics->distance_mm = 60;
  return printer;
}

TEST(TomoSpread, OperatorsOfRaysAreTransposes) {
  const Bench bench = make_bench(pinhole_printer(), bench_resin(), {0.25, 6, 24});
  ASSERT_TRUE(bench.grid.coupled());
  auto by = std::make_shared<DoseSpread>(bench.grid, Box<std::uint8_t>{}, 0.3);
  auto series = by->series([](double lambda) { return detail::spread_of_turns(6, 0.1, lambda); });
  const auto projector =
      detail::make_spread_projector(make_projector(bench), bench.grid, by, series);
  expect_transposes(*projector, bench.grid);
}

/// Doses of a job whose dose spreads, turn by turn and frame by frame.
Box<float> marched(const TomoJob& job, double kappa) {
  const Bench bench = make_bench(job.printer, job.resin, job.sampling);
  const TomoGrid& grid = bench.grid;
  const std::vector<Box<float>> frames = doses_of_frames(job);
  const int dark = static_cast<int>(std::ceil(4 * std::sqrt(2 * kappa * job.turns))) + 1;
  SmallSteps now(grid, job.insert, dark);
  const double back = bench.resupply_mj_cm3_s * bench.exposure.turn_s / grid.angles;
  Box<float> above = frames[0];
  for (int n = 0; n < job.turns; ++n) {
    now.spread(0.5 * kappa);
    // Nothing lights the slices above and below.
    SmallSteps dimmed = now;
    for (double& e : dimmed.values) e = std::max(0.0, e - back * grid.angles);
    each_voxel(grid, [&](int x, int y) {
      for (int z = 0; z < grid.slices; ++z) {
        const std::size_t v = above.at(z, y, x);
        std::vector<double> light;
        for (const Box<float>& frame : frames) light.push_back(frame.values[v]);
        if (!now.open(x, y, z)) continue;
        const Marched m = march(light, back, 1, now.value(x, y, z));
        above.values[v] = static_cast<float>(m.most - m.end);
        dimmed.value(x, y, z) = m.end;
      }
    });
    now = dimmed;
    now.spread(0.5 * kappa);
  }
  each_voxel(grid, [&](int x, int y) {
    for (int z = 0; z < grid.slices; ++z) {
      float& d = above.values[above.at(z, y, x)];
      d = now.open(x, y, z) ? d + static_cast<float>(now.value(x, y, z)) : 0;
    }
  });
  return above;
}

/// Whose dose spreads by so many voxels in a turn.
Resin spreading(const Printer& printer, double voxels, double voxel_mm = 0.25) {
  Resin resin = bench_resin();
  const double deviation_mm = voxels * voxel_mm;
  resin.dose_diffusion_m2_s = 1e-6 * deviation_mm * deviation_mm / 2 / printer.rotation->turn_s();
  return resin;
}

void expect_doses_of_small_steps(bool all) {
  for (const bool comes_back : {false, true}) {
    for (const bool with_insert : {false, true}) {
      if (!all && comes_back != with_insert) continue;
      TomoJob job = uneven_job(TurnDirection::counterclockwise, 12);
      job.resin = spreading(job.printer, 0.6);
      if (with_insert) {
        job.insert = rod(make_bench(job.printer, job.resin, job.sampling).grid, 14, 18, 15, 20);
      }
      const double kappa = 0.5 * 0.6 * 0.6;
      TomoJob still = job;
      still.resin = bench_resin();
      const double most = largest(dose_of(still));
      if (comes_back) {
        job.resin.inhibition_resupply_mj_cm3_s =
            0.3 * most / job.turns / job.printer.rotation->turn_s();
      }
      const Box<float> dose = dose_of(job), expected = marched(job, kappa);
      EXPECT_LT(largest(dose), 0.9 * most);
      // Steps of 0.002 in kappa, as above, of some 0.54 in all.
      for (std::size_t v = 0; v < dose.values.size(); ++v) {
        ASSERT_NEAR(dose.values[v], expected.values[v], 2e-3 * most);
      }
      // As it was shown, too: each frame for its whole step.
      std::vector<Showing> shown;
      for (int n = 0; n < job.turns * 12; ++n) {
        shown.push_back(
            {n % 12, 30.0 * n - 15, 30.0 * n + 15, job.printer.rotation->turn_s() / 12, 1});
      }
      const Box<float> of_shown = dose_of(job, shown);
      for (std::size_t v = 0; v < dose.values.size(); ++v) {
        ASSERT_NEAR(of_shown.values[v], dose.values[v], 1e-5 * most);
      }
    }
  }
}
TEST(TomoSpread, DosesOfJobsAreThoseOfSmallSteps) { expect_doses_of_small_steps(false); }
TEST(TomoSpreadNight, DosesOfJobsAreThoseOfSmallSteps) { expect_doses_of_small_steps(true); }

TEST(TomoSpread, TheSolversOperatorAndTheDosesOfJobsAgree) {
  // The mean over turns in one series, and turn by turn; of many turns in 64 steps, which are wrong
  // by (L/64)²/24 of what is left, L up to 10.
  for (const int turns : {1, 7, 200}) {
    Printer printer = bench_printer();
    TomoJob job = random_job(printer, 3, 24);
    job.turns = turns;
    job.resin = spreading(printer, 1.3 / std::sqrt(turns));
    TomoJob still = job;
    still.resin = bench_resin();
    const Bench bench = make_bench(job.printer, job.resin, job.sampling);
    const Box<float> dose = dose_of(job), without = dose_of(still);
    const DoseSpread by(bench.grid, {}, 1.3 * 0.25);
    Array<float> numbers(by.size(), 0.0F);
    each_voxel(bench.grid, [&](int x, int y) {
      for (int z = 0; z < 3; ++z) numbers[by.at(x, y) + z] = without.values[without.at(z, y, x)];
    });
    by.apply(by.series([&](double lambda) {
      return detail::spread_of_turns(turns, detail::kappa_of_turn(bench, job.resin), lambda);
    }),
             numbers, {});
    const double most = largest(without);
    each_voxel(bench.grid, [&](int x, int y) {
      for (int z = 0; z < 3; ++z) {
        ASSERT_NEAR(dose.values[dose.at(z, y, x)], numbers[by.at(x, y) + z],
                    (turns > 64 ? 1e-3 : 1e-5) * most);
      }
    });
  }
}

/// Two blocks that touch the middle slices, and a gap of one voxel between them.
Box<std::uint8_t> blocks_with_a_gap() {
  Box<std::uint8_t> part{7, 33, 33, std::vector<std::uint8_t>(7 * 33 * 33)};
  for (int z = 1; z < 6; ++z) {
    for (int y = 11; y < 22; ++y) {
      for (int x = 9; x < 24; ++x) {
        if (x < 15 || x >= 18) part.values[part.at(z, y, x)] = 255;
      }
    }
  }
  return part;
}

TEST(TomoSpread, SolversMakeUpForIt) {
  const Printer printer = bench_printer();
  Resin resin = bench_resin();
  PrintOptions options;
  options.angles = 60;
  options.solve.rungs = {0.98, 0.9, 0.8};
  options.solve.most_steps = 240;
  const Box<std::uint8_t> part = blocks_with_a_gap();
  const Print still = solve_print(part, 0.25, printer, resin, options);
  resin = spreading(printer, 0.9 / std::sqrt(still.figures.turns));
  TomoJob uncounted = still.job;
  uncounted.resin = resin;
  const double before = figures_of(uncounted, dose_of(uncounted), part).metrics.contrast;
  const Print print = solve_print(part, 0.25, printer, resin, options);
  const double after = print.figures.metrics.contrast;
  EXPECT_LT(before, 0.9 * still.figures.metrics.contrast);
  EXPECT_GT(after, 1.1 * before);
  EXPECT_TRUE(print.figures.feasible());
  EXPECT_EQ(print.figures.metrics.void_gelled, 0U);
  EXPECT_LE(after, print.figures.contrast_bound);
  // The figures are those of the job as it is judged again.
  EXPECT_EQ(figures_of(print.job, dose_of(print.job), part).metrics.contrast, after);
  ExecutionContext three;
  three.threads = 3;
  EXPECT_EQ(solve_print(part, 0.25, printer, resin, options, three).job.levels, print.job.levels);
}

TEST(TomoSpread, SolversThatWereStoppedGoOn) {
  const test::TemporaryFolder folder;
  const Printer printer = bench_printer();
  const Resin resin = spreading(printer, 0.4);
  const Box<std::uint8_t> part = blocks_with_a_gap();
  PrintOptions options;
  options.angles = 40;
  options.solve.rungs = {0.98, 0.95, 0.9};
  int places = 0;
  options.solve.checkpoint = [&](const SolverPlace&) { ++places; };
  int solves = 0;
  ExecutionContext listening;
  listening.notice = [&](const std::string& text) {
    solves += text.find("light for dose that spreads") != std::string::npos;
  };
  const Print whole = solve_print(part, 0.25, printer, resin, options, listening);
  ASSERT_GT(solves, 1);
  options.checkpoint = folder / "a.resume";
  options.checkpoint_s = 0;
  options.resume = true;
  ASSERT_GT(places, 3);
  // Stopped after each place in turn, those of the second solve among them.
  for (int stop = 2; stop <= places; stop += 2) {
    std::filesystem::remove(options.checkpoint);
    int seen = 0;
    std::atomic<bool> cancel{false};
    ExecutionContext context;
    context.cancel = &cancel;
    options.solve.checkpoint = [&](const SolverPlace&) {
      if (++seen == stop) cancel = true;
    };
    try {
      solve_print(part, 0.25, printer, resin, options, context);
      FAIL() << stop;
    } catch (const Cancelled&) {
    }
    options.solve.checkpoint = nullptr;
    EXPECT_EQ(solve_print(part, 0.25, printer, resin, options).job.levels, whole.job.levels);
  }
}

TEST(TomoSpread, OtherMethodsSeeItToo) {
  const Printer printer = bench_printer();
  const Resin resin = spreading(printer, 0.4);
  PrintOptions options;
  options.angles = 60;
  for (const Method method : {Method::osmo, Method::kelly, Method::fbp}) {
    options.solve.method = method;
    const Print print = solve_print(blocks_with_a_gap(), 0.25, printer, resin, options);
    EXPECT_GT(print.figures.metrics.best_jaccard, 0.8) << static_cast<int>(method);
  }
}

TEST(TomoSpread, ASliceAloneIsSolvedToo) {
  const Printer printer = bench_printer();
  PrintOptions options;
  options.angles = 60;
  options.solve.rungs = {0.98, 0.9};
  const Print print = solve_print(square_part(), 0.25, printer, spreading(printer, 0.2), options);
  EXPECT_TRUE(print.figures.feasible());
}

TEST(TomoSpread, LightOfAPinholeAndInsertsAreSolvedToo) {
  PrintOptions options;
  options.angles = 60;
  options.solve.rungs = {0.98};
  for (const bool of_rays : {false, true}) {
    const Printer printer = of_rays ? pinhole_printer() : bench_printer();
    const Resin resin = spreading(printer, 0.2);
    const Box<std::uint8_t> part = blocks_with_a_gap();
    options.insert = part;
    std::fill(options.insert.values.begin(), options.insert.values.end(), std::uint8_t{0});
    for (int z = 0; z < part.nz; ++z) {
      for (int y = 24; y < 26; ++y) {
        for (int x = 15; x < 18; ++x) options.insert.values[part.at(z, y, x)] = 255;
      }
    }
    const Print print = solve_print(part, 0.25, printer, resin, options);
    EXPECT_TRUE(print.figures.feasible()) << of_rays;
    const Box<float> dose = dose_of(print.job);
    for (std::size_t v = 0; v < dose.values.size(); ++v) {
      if (options.insert.values[v] > 0) {
        EXPECT_EQ(dose.values[v], 0);
      }
    }
  }
}

TEST(TomoSpread, JobsKeepIt) {
  const test::TemporaryFolder folder;
  TomoJob job = random_job(bench_printer(), 2, 20);
  job.resin = spreading(job.printer, 0.5);
  job.resin.inhibition_resupply_mj_cm3_s = 0.01;
  write_job(folder / "a.frames", job);
  const TomoJob back = read_job(folder / "a.frames");
  EXPECT_EQ(back.resin, job.resin);
  EXPECT_EQ(dose_of(back).values, dose_of(job).values);
}

TEST(TomoSpread, DoseThatSpreadsOverTheVialIsRefused) {
  TomoJob job = random_job(bench_printer(), 2, 20);
  job.resin = spreading(job.printer, 4.1 / 0.25 / std::sqrt(3.0));
  EXPECT_THAT(test::refusal([&] { dose_of(job); }),
              testing::AllOf(HasSubstr("resin: dose_diffusion_m2_s: is"),
                             HasSubstr("dose spreads by 4.1 mm in 3 turns of 14.4 s, and the "
                                       "resin has a radius of 4 mm")));
  PrintOptions options;
  options.angles = 60;
  try {
    solve_print(square_part(), 0.25, bench_printer(), spreading(bench_printer(), 17), options);
    FAIL();
  } catch (const InfeasibleError& e) {
    EXPECT_THAT(e.what(), HasSubstr("in which its dose spreads by"));
  }
}

}  // namespace
}  // namespace slicecorr::tomo
