// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Time and light as goals of a solve that is not told how long it may take.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <filesystem>
#include <string>

#include "slicecorr/error.hpp"
#include "slicecorr/tomo/print.hpp"
#include "slicecorr/vial.hpp"
#include "stack_fixture.hpp"
#include "tomo_jobs.hpp"

namespace slicecorr::tomo {
namespace {

using testing::HasSubstr;

/// A ring of 2 to 3 mm, and a voxel on the axis.
Box<std::uint8_t> ring_part() {
  Box<std::uint8_t> part{1, 33, 33, std::vector<std::uint8_t>(33 * 33)};
  for (int y = 0; y < 33; ++y) {
    for (int x = 0; x < 33; ++x) {
      const double r = std::hypot(x - 16, y - 16) * 0.25;
      if ((r >= 2 && r <= 3) || r == 0) part.values[part.at(0, y, x)] = 255;
    }
  }
  return part;
}

/// mJ/cm³ a second of even light on the axis: alpha_a I e^(-alpha R).
double rate_on_axis(const Printer& p, const Resin& r) {
  return 10 * absorption_per_mm(r) * p.calibration.back().intensity_mw_cm2 *
         std::exp(-absorption_per_mm(r) * p.vial->inner_mm);
}

PrintOptions at_60_angles() {
  PrintOptions options;
  options.angles = 60;
  return options;
}

/// Inhibitor that comes back at half of what the brightest light can bring: the light with the most contrast
/// can't print it, other light can.
TEST(TomoGoal, InhibitorThatComesBackIsOvertaken) {
  const Printer printer = bench_printer();
  Resin resin = bench_resin(1);
  const double turn_s = printer.rotation->turn_s();
  resin.inhibition_resupply_mj_cm3_s = 0.5 * rate_on_axis(printer, resin);
  const Print print = solve_print(ring_part(), 0.25, printer, resin, at_60_angles());
  EXPECT_TRUE(print.figures.feasible()) << print.figures.to_json();
  EXPECT_EQ(print.figures.metrics.ver, 0);
  // Four times the least time at most, whose weakest voxel is the axis, and a turn for rounding.
  const double least = resin.critical_dose_mj_cm3 / (0.5 * rate_on_axis(printer, resin) * turn_s);
  EXPECT_LE(print.figures.turns, std::ceil(4 * least) + 1);
  EXPECT_GE(print.figures.turns, std::ceil(least));
  EXPECT_GE(print.figures.metrics.contrast, 1.2);
}

/// What is refused is what the brightest light can't do, on either side of the closed form.
TEST(TomoGoal, RefusedIsWhatNoLightPrints) {
  const Printer printer = bench_printer();
  Resin resin = bench_resin(1);
  const double most = rate_on_axis(printer, resin);
  const auto refusal = [&](double share) -> std::string {
    resin.inhibition_resupply_mj_cm3_s = share * most;
    PrintOptions options = at_60_angles();
    options.solve.steps = 2;
    options.solve.proof_steps = 0;
    options.solve.rungs = {0.98};
    options.solve.most_steps = 2;
    try {
      solve_print(ring_part(), 0.25, printer, resin, options);
    } catch (const InfeasibleError& e) {
      return e.what();
    }
    return "";
  };
  EXPECT_THAT(refusal(1.02), HasSubstr("inhibitor comes back as fast as light takes it"));
  EXPECT_THAT(refusal(1.02), HasSubstr("voxel 16, 16 in slice 0"));
  EXPECT_EQ(refusal(0.95), "");
}

/// Without inhibitor light is a goal, too: within four times the least time, where the most contrast
/// would take longer.
TEST(TomoGoal, LightIsAGoal) {
  const Printer printer = bench_printer();
  const Resin resin = bench_resin(1);
  const Print print = solve_print(ring_part(), 0.25, printer, resin, at_60_angles());
  const double least =
      resin.critical_dose_mj_cm3 / (rate_on_axis(printer, resin) * printer.rotation->turn_s());
  EXPECT_TRUE(print.figures.feasible());
  EXPECT_GE(print.figures.metrics.contrast, 1.2);
  EXPECT_LE(print.figures.turns, std::ceil(4 * least) + 1);
}

/// A part that has too little contrast within four times the least time is looked for again; a solve that
/// is stopped there goes on there, to the same levels. Progress never falls.
TEST(TomoGoal, WhatIsHardIsLookedForAgainAndGoesOn) {
  const test::TemporaryFolder folder;
  const Printer printer = bench_printer();
  const Resin resin = bench_resin(4);
  PrintOptions options = at_60_angles();
  options.solve.steps = 20;
  options.solve.most_steps = 20;
  options.solve.proof_steps = 10;
  options.checkpoint = folder / "a.resume";
  options.checkpoint_s = 0;
  std::atomic<bool> cancel{false};
  bool again = false, stop = false;
  double before = 0;
  ExecutionContext context;
  context.cancel = &cancel;
  context.notice = [&](const std::string& text) {
    again = again || text.find("more is looked for") != std::string::npos;
    // The second rung of the second attempt.
    if (stop && again && text.find("next: void below 0.9 ") != std::string::npos) cancel = true;
  };
  context.progress = [&](std::string_view stage, double done) {
    if (stage != "solving") return;
    EXPECT_GE(done, before);
    before = done;
  };
  const Print whole = solve_print(ring_part(), 0.25, printer, resin, options, context);
  ASSERT_TRUE(again);
  std::filesystem::remove(options.checkpoint);
  again = false;
  stop = true;
  before = 0;
  EXPECT_THROW(solve_print(ring_part(), 0.25, printer, resin, options, context), Cancelled);
  ASSERT_TRUE(std::filesystem::exists(options.checkpoint));
  options.resume = true;
  EXPECT_EQ(solve_print(ring_part(), 0.25, printer, resin, options).job.levels, whole.job.levels);
}

}  // namespace
}  // namespace slicecorr::tomo
