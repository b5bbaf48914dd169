// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The clock of flowing resin and what resin files say of it, against closed forms.
#include "slicecorr/flow.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "slicecorr/error.hpp"

namespace slicecorr {
namespace {

TEST(Flow, ShareAndItsInverse) {
  EXPECT_NEAR(flow_share_inverse(0.25), 0.32635, 5e-6);
  EXPECT_NEAR(flow_share_inverse(0.81), 0.72107, 5e-6);
  for (int k = 0; k <= 1000; ++k) {
    // dF/dq is 0 at both ends: q there is known to the root of the rounding only.
    EXPECT_NEAR(flow_share_inverse(flow_share(k / 1000.0)), k / 1000.0, 1e-8) << k;
  }
}

TEST(Flow, TimeUnderWay) {
  // h 80 um, 300 mm/h; shares r̄² of r̄ = 0.1, 0.5, 0.9; five digits are given.
  EXPECT_NEAR(seconds_under_way(0.01, 80, 300), 5.9426, 5e-5);
  EXPECT_NEAR(seconds_under_way(0.25, 80, 300), 1.0815, 5e-5);
  EXPECT_NEAR(seconds_under_way(0.81, 80, 300), 0.28812, 5e-6);
  EXPECT_EQ(seconds_under_way(1, 80, 300), 0);
  EXPECT_TRUE(std::isinf(seconds_under_way(0, 80, 300)));
}

TEST(Flow, ResinsSayWhatFlowNeeds) {
  const std::string cure =
      "[cure]\nabsorbance_height_um = 550\nabsorbance_base = \"e\"\ngel_dose_mj_cm3 = 40\n";
  try {
    flow_resin(parse_resin(cure, "r.toml"));
    FAIL() << "a resin without viscosity";
  } catch (const InputError& e) {
    EXPECT_NE(std::string(e.what()).find("viscosity_pa_s"), std::string::npos) << e.what();
  }
  const FlowResin r = flow_resin(
      parse_resin(cure + "viscosity_pa_s = 0.3\ndose_diffusion_m2_s = 1e-10\n", "r.toml"));
  EXPECT_EQ(r.viscosity_pa_s, 0.3);
  EXPECT_EQ(r.diffusion_m2_s, 1e-10);
  EXPECT_TRUE(std::isinf(r.inhibitor_life_s));
  EXPECT_NEAR(r.kinetics.hb_um, 550, 1e-9);
}

}  // namespace
}  // namespace slicecorr
