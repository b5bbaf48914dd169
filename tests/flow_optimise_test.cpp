// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The best light of a section, and what is refused of sections, sweeps and goals.
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <numeric>

#include "flow_shapes.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/flow_section.hpp"

namespace slicecorr {
namespace {

using namespace test;

constexpr double kSpeedMmH = 300;

SectionGoal chapter_goal(FlowPattern pattern, double least_um, double most_um) {
  SectionGoal g;
  g.pattern = pattern;
  g.min_gap_um = least_um;
  g.max_gap_um = most_um;
  g.max_blue_mw_cm2 = 200;
  g.max_uv_mw_cm2 = 275;
  return g;
}

SectionOptimum optimum(const FlowSection& s, const SectionGoal& goal, int threads = 2) {
  ExecutionContext context;
  context.threads = threads;
  return optimise_section(s, solve_pressure(s), chapter_iv_resin2(), kSpeedMmH, goal, context);
}

TEST(OptimiseSection, ConstantLightOfADisc) {
  const FlowSection s = disc_section(10e3, 40);
  const SectionOptimum o = optimum(s, chapter_goal(FlowPattern::constant, 10, 300));
  // 158.8 and 275 at 82 um; the least is flat, and a grid's outline is worth 3 percent.
  const std::size_t middle = s.index(s.width / 2, s.height / 2);
  EXPECT_NEAR(o.blue_mw_cm2[middle] / 158.8, 1, 0.03);
  EXPECT_NEAR(o.uv_mw_cm2[middle], 275, 1e-6);
  EXPECT_TRUE(o.uv_at_cap);
  EXPECT_FALSE(o.blue_at_cap);
  EXPECT_FALSE(o.gap_at_limit);
  EXPECT_NEAR(o.gap_um, 82, 5);
  EXPECT_NEAR(o.summary.within_10, 0.17, 0.02);
  EXPECT_LE(o.summary.max_window, 0.98);
  // Weights 1/r are the dr of chapter IV: less gap, more blue light.
  SectionGoal by_radius = chapter_goal(FlowPattern::constant, 10, 300);
  by_radius.weight.resize(s.size());
  for (int y = 0; y < s.height; ++y) {
    for (int x = 0; x < s.width; ++x) {
      by_radius.weight[s.index(x, y)] =
          1 / std::hypot(x - s.width / 2.0 + 0.5, y - s.height / 2.0 + 0.5);
    }
  }
  const SectionOptimum dr = optimum(s, by_radius);
  EXPECT_NEAR(dr.blue_mw_cm2[middle] / 171.1, 1, 0.03);
  EXPECT_NEAR(dr.gap_um, 70, 4);
  EXPECT_NEAR(dr.summary.within_10, 0.225, 0.02);
}

TEST(OptimiseSection, KnowsWhatImagesShow) {
  const FlowSection s = full_section(24, 24, 250);
  const SectionGoal plain = chapter_goal(FlowPattern::both, 120, 120);
  const auto image_of = [&](double own, double beside, double grey) {
    auto image = std::make_shared<ImageLight>();
    image->uv = true;
    image->blue_mw_cm2.assign(s.size(), 0.0);
    image->uv_mw_cm2.assign(s.size(), 0.0);
    for (std::size_t i = 0; i < s.size(); ++i) {
      auto& shares = image->shares.emplace_back();
      shares.fill(static_cast<float>(beside / 8));
      shares[4] = static_cast<float>(own);
      if (i % 5 != 0) continue;
      // Some cells show half of what they are asked for, and dim light of their own.
      for (float& share : shares) share *= static_cast<float>(1 - grey);
      image->blue_mw_cm2[i] = 20 * grey;
      image->uv_mw_cm2[i] = 30 * grey;
    }
    return image;
  };
  // Images that show all of it change nothing.
  SectionGoal all = plain;
  all.image = image_of(1, 0, 0);
  const SectionOptimum without = optimum(s, plain), with = optimum(s, all);
  EXPECT_NEAR(with.summary.mean_square, without.summary.mean_square, 1e-3);
  // What is told is the dose of what is shown.
  SectionGoal smooth = plain;
  smooth.image = image_of(0.6, 0.4, 0.5);
  const SectionOptimum o = optimum(s, smooth);
  const double gap = 120;
  const SectionSweep sweep(s, solve_pressure(s), chapter_iv_resin2(), kSpeedMmH, {&gap, 1});
  const auto shown = [&](const SectionOptimum& asked) {
    return summarise(s, sweep.dose(smooth.image->of_blue(s, asked.blue_mw_cm2),
                                   smooth.image->of_uv(s, asked.uv_mw_cm2)));
  };
  EXPECT_NEAR(shown(o).mean_square, o.summary.mean_square, 1e-9);
  // And less is missed than with light that does not know of it.
  EXPECT_LT(shown(o).mean_square, shown(without).mean_square);
  // Grey cells have their part in constant light, too.
  SectionGoal constant = chapter_goal(FlowPattern::constant, 120, 120);
  constant.image = smooth.image;
  const SectionOptimum even = optimum(s, constant);
  EXPECT_NEAR(shown(even).mean_square, even.summary.mean_square, 1e-9);
  for (const double factor : {0.97, 1.03}) {
    SectionOptimum other = even;
    for (double& v : other.blue_mw_cm2) v *= factor;
    EXPECT_GT(shown(other).mean_square, even.summary.mean_square);
  }
  SectionGoal wrong = plain;
  wrong.image = image_of(0.9, 0.4, 0);
  EXPECT_THROW(optimum(s, wrong), InputError);
  auto short_of = image_of(1, 0, 0);
  short_of->uv_mw_cm2.pop_back();
  wrong.image = short_of;
  EXPECT_THROW(optimum(s, wrong), InputError);
}

TEST(OptimiseSection, PatternsOfASquare) {
  const FlowSection s = full_section(32, 32, 250);
  // Shares of area: 20, 77, 93 percent with 15 patterns a light and a sweep of the first order, which
  // is a cell's width kinder to the outline.
  const SectionOptimum constant = optimum(s, chapter_goal(FlowPattern::constant, 80, 80));
  const SectionOptimum blue = optimum(s, chapter_goal(FlowPattern::blue, 120, 120));
  const SectionOptimum both = optimum(s, chapter_goal(FlowPattern::both, 200, 200));
  EXPECT_NEAR(constant.summary.within_10, 0.18, 0.03);
  EXPECT_NEAR(blue.summary.within_10, 0.79, 0.03);
  EXPECT_NEAR(both.summary.within_10, 0.91, 0.03);
  EXPECT_LT(blue.summary.mean_square, 0.5 * constant.summary.mean_square);
  EXPECT_LT(both.summary.mean_square, blue.summary.mean_square);
  for (const SectionOptimum* o : {&constant, &blue, &both}) {
    EXPECT_LE(o->summary.max_window, 0.98);
    for (const double b : o->blue_mw_cm2) EXPECT_TRUE(b >= 0 && b <= 200) << b;
    for (const double u : o->uv_mw_cm2) EXPECT_TRUE(u >= 0 && u <= 275) << u;
  }
  EXPECT_EQ(*std::max_element(blue.uv_mw_cm2.begin(), blue.uv_mw_cm2.end()),
            *std::min_element(blue.uv_mw_cm2.begin(), blue.uv_mw_cm2.end()));
}

TEST(OptimiseSection, TheGapIsFoundAndMorePatternsAreBetter) {
  const FlowSection s = full_section(20, 20, 400);
  double last = 1;
  for (const FlowPattern p : {FlowPattern::constant, FlowPattern::uv, FlowPattern::both}) {
    SectionGoal goal = chapter_goal(p, 10, 300);
    goal.iterations = 60;
    const SectionOptimum o = optimum(s, goal);
    EXPECT_LT(o.summary.mean_square, last);
    last = o.summary.mean_square;
    // Not the outermost h.
    goal.leave_out_gaps = 4;
    EXPECT_LT(optimum(s, goal).summary.mean_square, o.summary.mean_square);
  }
}

TEST(OptimiseSection, OtherLawsToo) {
  const FlowSection s = full_section(16, 16, 500);
  FlowResin resin = chapter_iv_resin2();
  resin.diffusion_m2_s = 0;
  resin.inhibitor_life_s = 0;
  SectionGoal goal = chapter_goal(FlowPattern::constant, 80, 80);
  const GapPressure p = solve_pressure(s);
  const SectionOptimum constant = optimise_section(s, p, resin, kSpeedMmH, goal);
  EXPECT_NEAR(constant.summary.mean, 0.85, 0.15);
  goal.pattern = FlowPattern::blue;
  const SectionOptimum blue = optimise_section(s, p, resin, kSpeedMmH, goal);
  EXPECT_LT(blue.summary.mean_square, 0.7 * constant.summary.mean_square);
}

TEST(OptimiseSection, SameBitsForAnyThreads) {
  const FlowSection s = odd_section();
  SectionGoal goal = chapter_goal(FlowPattern::both, 60, 200);
  goal.iterations = 20;
  const SectionOptimum one = optimum(s, goal, 1), three = optimum(s, goal, 3);
  EXPECT_EQ(one.gap_um, three.gap_um);
  EXPECT_EQ(one.blue_mw_cm2, three.blue_mw_cm2);
  EXPECT_EQ(one.uv_mw_cm2, three.uv_mw_cm2);
  EXPECT_EQ(one.dose.front, three.dose.front);
}

// ------------------------------------------------------------------------------------ bad input

template <typename E = InputError, typename F>
void refuses(const std::string& word, F f) {
  try {
    f();
    ADD_FAILURE() << "took a wrong " << word;
  } catch (const E& e) {
    EXPECT_NE(std::string(e.what()).find(word), std::string::npos) << e.what();
  }
}

TEST(FlowRefuses, Sections) {
  const FlowSection good = full_section(8, 8, 250);
  const auto with = [&](auto change) {
    FlowSection s = good;
    change(s);
    return [s] { solve_pressure(s); };
  };
  refuses("no cell is part", with([](FlowSection& s) { s.cells.assign(64, FlowCell::bath); }));
  refuses("third", with([](FlowSection& s) {
            s.cells.assign(64, FlowCell::bath);
            s.cells[20] = s.cells[21] = FlowCell::part;
          }));
  refuses("pitch", with([](FlowSection& s) { s.pitch_x_um = 0; }));
  refuses("pitch", with([](FlowSection& s) { s.pitch_y_um = NAN; }));
  refuses("size", with([](FlowSection& s) { s.width = 0; }));
  refuses("cells", with([](FlowSection& s) { s.cells.pop_back(); }));
  refuses("coverage", with([](FlowSection& s) { s.coverage.assign(64, 0.4f); }));
  refuses("voids", with([](FlowSection& s) { s.voids.assign(3, 0); }));
  refuses("gap_um", [&] { solve_pressure(good, std::vector<double>(64, 0.0), 80); });
  refuses("gap_um", [&] { solve_pressure(good, std::vector<double>(3, 80.0), 80); });
  refuses("reference_gap_um", [&] { solve_pressure(good, std::vector<double>(64, 80.0), -1); });
  refuses("viscosity", [] { suction_pa(1, 0, 300, 80); });
  refuses("speed", [] { suction_pa(1, 0.3, NAN, 80); });
  refuses("gap_um", [] { suction_force_n(1, 0.3, 300, 0); });
  refuses("suction_limit", [] { suction_speed_limit_mm_h(1, 0.3, 80, 0); });
}

TEST(FlowRefuses, Sweeps) {
  const FlowSection s = full_section(8, 8, 250);
  const GapPressure p = solve_pressure(s);
  const auto make = [&](const FlowResin& r, double speed, double gap, int levels) {
    return [&s, &p, r, speed, gap, levels] { SectionSweep(s, p, r, speed, {&gap, 1}, {levels}); };
  };
  const FlowResin good = chapter_iv_resin2();
  FlowResin bad = good;
  bad.kinetics.huv_um = bad.kinetics.hb_um;
  refuses("huv_um", make(bad, 300, 80, 48));
  bad = good;
  bad.diffusion_m2_s = -1e-12;
  refuses("dose_diffusion_m2_s", make(bad, 300, 80, 48));
  bad = good;
  bad.inhibitor_life_s = -1;
  refuses("inhibitor_life_s", make(bad, 300, 80, 48));
  refuses("speed_mm_h", make(good, 0, 80, 48));
  refuses("gap_um", make(good, 300, INFINITY, 48));
  refuses("levels", make(good, 300, 80, 7));
  refuses("gap_um", [&] { SectionSweep(s, p, good, 300, std::vector<double>(s.size(), 80.0)); });
  const SectionSweep sweep = sweep_of(s, good);
  refuses("blue_mw_cm2", [&] { even_dose(sweep, -1, 0); });
  refuses("uv_mw_cm2", [&] { even_dose(sweep, 1, NAN); });
  refuses("blue_mw_cm2", [&] { sweep.dose(std::vector<double>(3), std::vector<double>(64)); });
  refuses("front_weight", [&] { sweep.adjoint(std::vector<double>(3), std::vector<double>(64)); });
  bad = good;
  bad.inhibitor_life_s = 1;
  refuses("inhibitor_life_s",
          [&] { sweep_of(s, bad).adjoint(std::vector<double>(64), std::vector<double>(64)); });
}

TEST(FlowRefuses, Goals) {
  const FlowSection s = full_section(8, 8, 250);
  const auto with = [&](auto change) {
    SectionGoal g = chapter_goal(FlowPattern::constant, 10, 300);
    change(g);
    return [&s, g] { optimum(s, g); };
  };
  refuses("max_gap_um", with([](SectionGoal& g) { g.max_gap_um = 5; }));
  refuses("min_gap_um", with([](SectionGoal& g) { g.min_gap_um = 0; }));
  refuses("max_blue_mw_cm2", with([](SectionGoal& g) { g.max_blue_mw_cm2 = 0; }));
  refuses("max_uv_mw_cm2", with([](SectionGoal& g) { g.max_uv_mw_cm2 = -1; }));
  refuses("max_window", with([](SectionGoal& g) { g.max_window = NAN; }));
  refuses("weight", with([](SectionGoal& g) { g.weight.assign(3, 1.0); }));
  refuses("leave_out_gaps", with([](SectionGoal& g) { g.leave_out_gaps = 1e4; }));
  refuses<InfeasibleError>("no dead zone", with([](SectionGoal& g) { g.max_uv_mw_cm2 = 0; }));
  refuses<InfeasibleError>("no dead zone", [&] {
    FlowResin resin = chapter_iv_resin2();
    resin.kinetics.beta = 0;
    optimise_section(s, solve_pressure(s), resin, kSpeedMmH,
                     chapter_goal(FlowPattern::uv, 10, 300));
  });
  refuses("varies", [&] {
    const std::vector<double> gap(s.size(), 80.0);
    optimise_section(s, solve_pressure(s, gap, 80), chapter_iv_resin2(), kSpeedMmH,
                     chapter_goal(FlowPattern::uv, 10, 300));
  });
  std::atomic<bool> stop{true};
  ExecutionContext context;
  context.cancel = &stop;
  EXPECT_THROW(solve_pressure(s, context), Cancelled);
}
}  // namespace
}  // namespace slicecorr
