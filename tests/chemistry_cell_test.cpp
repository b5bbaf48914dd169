// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The full equations in one cell: against figures worked out independently, against CVODE, and what must always hold.
#include "slicecorr/chemistry_cell.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "chemistries.hpp"
#include "cvode_peer.hpp"
#include "refusal.hpp"
#include "rounds.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr {
namespace {

using test::CvodePeer;
using test::hydrogel;
using ::testing::HasSubstr;

CellRun lit(const Chemistry& c, double i, double seconds, double tolerance = 1e-4) {
  CellQuestion q;
  q.light = {{seconds, i}};
  q.tolerance = tolerance;
  return run_cell(c, q);
}

TEST(ChemistryCell, TimesAsWorkedOut) {
  const double i[] = {1, 10, 100, 1000}, gel[] = {124.092, 13.4466, 1.67257, 0.270697};
  for (int k = 0; k < 4; ++k) {
    const CellTimes t = cell_times(hydrogel(), i[k]);
    // Known to six digits; the error of our steps is some 1e-5.
    EXPECT_NEAR(t.gel_time_s / gel[k], 1, 3e-5) << i[k];
    EXPECT_NEAR(t.inhibition_time_s / inhibition_time_used_up_s(hydrogel(), i[k]), 1, 1e-5) << i[k];
    // The closed form is within half a percent of it.
    EXPECT_NEAR(t.gel_time_s / gel_time_s(gel_time_of(hydrogel()), i[k]), 1, 5e-3);
  }
}

TEST(ChemistryCell, ConcentrationsAsWorkedOut) {
  const CellRun run = lit(hydrogel(), 100, 3);
  EXPECT_NEAR(run.at(0.5).O / 0.151001e-3, 1, 1e-5);
  EXPECT_NEAR(conversion(hydrogel(), run.at(1.5)), 0.062812, 5e-6);
  EXPECT_NEAR(conversion(hydrogel(), run.at(2)), 0.165704, 5e-6);
  EXPECT_NEAR(conversion(hydrogel(), run.at(3)), 0.338819, 5e-6);
  // P1 while there is all oxygen, after the first microseconds.
  EXPECT_NEAR(run.at(1e-3).P1 / inhibited_radicals_mol_l(hydrogel(), 100), 1, 2e-3);
}

TEST(ChemistryCell, InhibitorAndScarceInitiatorAsWorkedOut) {
  Chemistry c = hydrogel();
  c.inhibitor_mol_l = 1e-3;
  c.inhibitor_l_mol_s = c.oxygen_l_mol_s;
  EXPECT_NEAR(cell_times(c, 100).gel_time_s / 6.26726, 1, 3e-5);
  Chemistry scarce = hydrogel();
  scarce.initiator_mol_l = 1e-4;
  EXPECT_TRUE(std::isinf(cell_times(scarce, 100).gel_time_s));
  EXPECT_THAT(never_gels(scarce, 100), HasSubstr("0.00013 mol/l"));
  EXPECT_EQ(never_gels(hydrogel(), 100), "");
}

TEST(ChemistryCell, GrowsAfterTheLightHasGone) {
  CellQuestion q;
  q.light = {{1.6, 100}, {1.0, 0}};
  const CellRun run = run_cell(hydrogel(), q);
  const CellState on = run.at(1.6), off = run.moments.back().state;
  EXPECT_NEAR(run.moments.back().time_s, 2.6, 1e-12);
  // Close to steady state: the closed form holds for P1 = Ps, and of P1 it takes what there is.
  const double ended = 2 * hydrogel().termination_l_mol_s * on.P1;
  const double left =
      std::pow(1 + ended, -hydrogel().propagation_l_mol_s / (2 * hydrogel().termination_l_mol_s));
  EXPECT_NEAR(off.P0 / on.P0, left, 1e-5);
  EXPECT_NEAR(1 - off.P0 / on.P0, dark_conversion(hydrogel(), 100, 1), 2e-5);
}

TEST(ChemistryCell, AgreesWithCvode) {
  std::mt19937 random(7);
  const auto around = [&](double x, double factor) {
    return x * std::pow(factor, std::uniform_real_distribution<>(-1, 1)(random));
  };
  int never = 0;
  for (int round = 0; round < test::rounds(12); ++round) {
    Chemistry c = hydrogel();
    c.groups_mol_l = around(1.5, 3);
    c.oxygen_mol_l = around(5e-4, 4);
    c.initiation_l_mol_s = around(c.initiation_l_mol_s, 10);
    c.propagation_l_mol_s = around(c.propagation_l_mol_s, 5);
    c.termination_l_mol_s = around(c.termination_l_mol_s, 5);
    c.oxygen_l_mol_s = around(c.oxygen_l_mol_s, 5);
    if (round % 3 == 1) {
      c.inhibitor_mol_l = around(3e-4, 3);
      c.inhibitor_l_mol_s = around(1e6, 10);
    }
    if (round % 3 == 2) c.initiator_oxygen_l_mol_s = around(c.oxygen_l_mol_s, 5);
    const double i = around(100, 10), supply = round % 4 == 3 ? 0.02 : 0;
    SCOPED_TRACE(round);
    CvodePeer peer(c, {i}, 1, supply);
    CellQuestion q;
    const double end = 1.5 * cell_times(c, i, supply).gel_time_s;
    // The time until oxygen is used up, which comes first, is as sure as i - i_th.
    const double least = threshold_intensity_mw_cm2(c, supply), unsure = i / (i - least);
    if (std::isinf(end)) {
      EXPECT_LE(i, least);
      EXPECT_NE(never_gels(c, i, supply), "");
      // Until half of the initiator has gone oxygen comes in as quickly as it is used up.
      const double half_gone = std::log(2) / initiation_per_s(c, i);
      for (double t = half_gone / 100; t < half_gone; t += half_gone / 100) {
        peer.advance_to(t);
        EXPECT_GT(peer.at(0, CvodePeer::O), (1 - i / least) * c.oxygen_mol_l);
      }
      ++never;
      continue;
    }
    q.light = {{end, i}, {end, 0}};
    q.tolerance = 1e-4;
    q.supply_per_s = supply;
    const CellRun run = run_cell(c, q);
    for (const double share : {0.2, 0.5, 0.7, 0.9, 1.0, 1.3, 2.0}) {
      if (share == 1.3) peer.light(0);
      // At the first moment from there on: between moments there are straight lines.
      const auto at =
          std::find_if(run.moments.begin(), run.moments.end() - 1,
                       [&](const CellMoment& m) { return m.time_s >= share * end * (1 - 1e-12); });
      const CellState& s = at->state;
      peer.advance_to(at->time_s);
      // Of what there was at the start.
      EXPECT_NEAR(s.P0 / c.groups_mol_l, peer.at(0, CvodePeer::P0) / c.groups_mol_l, 3e-5 * unsure)
          << share;
      EXPECT_NEAR(s.O / c.oxygen_mol_l, peer.at(0, CvodePeer::O) / c.oxygen_mol_l, 3e-4) << share;
      EXPECT_NEAR(s.P2 / c.groups_mol_l, peer.at(0, CvodePeer::P2) / c.groups_mol_l, 3e-5 * unsure)
          << share;
      EXPECT_NEAR(s.P3 / c.groups_mol_l, peer.at(0, CvodePeer::P3) / c.groups_mol_l, 3e-6) << share;
      // Ours is exact; CVODE adds up its errors of 1e-9 a step.
      EXPECT_NEAR(s.I / c.initiator_mol_l, peer.at(0, CvodePeer::I) / c.initiator_mol_l, 1e-6);
    }
    CvodePeer again(c, {i}, 1, supply);
    EXPECT_NEAR(run.gel_time_s / again.gel_time(0, 2 * end), 1, 1e-4 * unsure);
  }
  EXPECT_LT(never, test::rounds(12) / 4);
}

// Once oxygen is used up, what comes in goes to chains and to the initiator's radicals as they are quick.
TEST(ChemistryCell, OxygenFromOutsideIsSharedAsByCvode) {
  Chemistry c = hydrogel();
  // Few end groups, so that radicals of the initiator last.
  c.groups_mol_l = 0.55;
  c.oxygen_mol_l = 1e-3;
  c.initiation_l_mol_s = 6e4;
  c.propagation_l_mol_s = 7e4;
  c.termination_l_mol_s = 6.5e5;
  c.oxygen_l_mol_s = 4e8;
  c.initiator_oxygen_l_mol_s = 2e9;
  const double i = 15, supply = 0.02, end = 1.5 * cell_times(c, i, supply).gel_time_s;
  CellQuestion q;
  q.light = {{end, i}};
  q.tolerance = 1e-4;
  q.supply_per_s = supply;
  const CellRun run = run_cell(c, q);
  CvodePeer peer(c, {i}, 1, supply);
  peer.advance_to(end);
  const CellState& s = run.moments.back().state;
  EXPECT_LT(s.P0, 0.05 * c.groups_mol_l);
  // Of all oxygen that came: the tolerance is of what there was at the start.
  EXPECT_NEAR(s.P3 / c.oxygen_mol_l, peer.at(0, CvodePeer::P3) / c.oxygen_mol_l, 1e-3);
}

TEST(ChemistryCell, NothingIsLostAndNothingGetsBelow0) {
  for (const bool taken : {false, true}) {
    Chemistry c = hydrogel();
    if (taken) c.initiator_oxygen_l_mol_s = c.oxygen_l_mol_s;
    CellQuestion q;
    // Blinks, then light until most of the resin is used up.
    for (int k = 0; k < 20; ++k) {
      q.light.push_back({0.05, 300});
      q.light.push_back({0.05, 0});
    }
    q.light.push_back({200, 1000});
    const CellRun run = run_cell(c, q);
    EXPECT_LT(run.balance_error, 1e-10);
    EXPECT_GT(run.steps, 1000U);
    const double out = c.initiator_mol_l, oxygen = c.oxygen_mol_l;
    for (const CellMoment& m : run.moments) {
      const CellState& s = m.state;
      for (const double x : {s.I, s.Ir, s.P0, s.P1, s.P2, s.P3, s.O, s.Q})
        ASSERT_GE(x, 0) << m.time_s;
      if (!taken) {
        // What took oxygen is dead, one for one.
        ASSERT_NEAR(s.O + s.P3, oxygen, 1e-10 * c.groups_mol_l) << m.time_s;
      }
      ASSERT_LE(s.Ir + s.P1, 2 * (out - s.I) * (1 + 1e-9) + 1e-25);
    }
    EXPECT_GT(used_up(c, run.moments.back().state), 0.99);
  }
}

TEST(ChemistryCell, TheToleranceHolds) {
  const double known = lit(hydrogel(), 100, 2, 1e-7).gel_time_s;
  for (const double tolerance : {1e-2, 1e-3, 1e-5}) {
    // What is asked is of one step; steps are as many as need be, and of second order.
    EXPECT_NEAR(lit(hydrogel(), 100, 2, tolerance).gel_time_s / known, 1, 1e-4) << tolerance;
  }
  EXPECT_GT(lit(hydrogel(), 100, 2, 1e-5).steps, 2 * lit(hydrogel(), 100, 2, 1e-3).steps);
}

TEST(ChemistryCell, OxygenFromOutsideHasAThreshold) {
  const double ks = 0.1, least = threshold_intensity_mw_cm2(hydrogel(), ks);
  EXPECT_TRUE(std::isinf(cell_times(hydrogel(), 0.99 * least, ks).gel_time_s));
  EXPECT_THAT(never_gels(hydrogel(), 0.99 * least, ks), HasSubstr("more than"));
  const CellTimes t = cell_times(hydrogel(), 3 * least, ks);
  EXPECT_NEAR(t.inhibition_time_s / inhibition_time_supplied_s(hydrogel(), 3 * least, ks), 1, 0.01);
  EXPECT_TRUE(std::isfinite(t.gel_time_s));
}

TEST(ChemistryCell, BadQuestionsAreRefused) {
  const auto refused = [](const CellQuestion& q) {
    return test::refusal([&] { run_cell(hydrogel(), q); });
  };
  EXPECT_THAT(refused({}), HasSubstr("no light"));
  EXPECT_THAT(refused({{{1, -1}}}), HasSubstr("-1 mW/cm²"));
  EXPECT_THAT(refused({{{0, 1}}}), HasSubstr("time above 0"));
  EXPECT_THAT(refused({{{1, NAN}}}), HasSubstr("nan"));
  EXPECT_THAT(refused({{{INFINITY, 1}}}), HasSubstr("inf"));
  EXPECT_THAT(refused({{{1, 1}}, -1}), HasSubstr("at least 0"));
  EXPECT_THAT(refused({{{1, 1}}, 0, 0}), HasSubstr("tolerance"));
  std::atomic<bool> stop = true;
  ExecutionContext context;
  context.cancel = &stop;
  CellQuestion q;
  q.light = {{1, 1}};
  EXPECT_THROW(run_cell(hydrogel(), q, context), Cancelled);
}

TEST(ChemistryCell, ATableHasAllMoments) {
  CellQuestion q;
  q.light = {{1.6, 100}, {1.0, 0}};
  const CellRun run = run_cell(hydrogel(), q);
  const std::string csv = run.to_csv(hydrogel(), 100);
  EXPECT_EQ(csv.rfind("time_s,intensity_mw_cm2,initiator_mol_l", 0), 0U);
  const auto rows = std::count(csv.begin(), csv.end(), '\n');
  EXPECT_GT(rows, 50);
  EXPECT_LT(rows, 110);
  EXPECT_NE(csv.find("\n1.6,100,"), std::string::npos);  // the moment of the switch
  EXPECT_NE(csv.find("\n2.6,0,"), std::string::npos);
}

}  // namespace
}  // namespace slicecorr
