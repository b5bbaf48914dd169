// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// One time to gel that was measured where somebody prints scales all doses of a resin.

#include "slicecorr/resins/time_scale.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "slicecorr/error.hpp"
#include "slicecorr/resins/record.hpp"

namespace slicecorr::test {
namespace {

using namespace resins;
using testing::HasSubstr;

Resin resin_of(const std::string& cure) {
  return parse_resin(
      "name = \"r\"\n[cure]\nabsorbance_height_um = 100\nabsorbance_base = \"e\"\n" + cure,
      "r.toml");
}

TimesToGel times_at(const std::vector<std::pair<double, double>>& all) {
  TimesToGel t;
  t.sources = {"times.csv"};
  for (const auto& [light, time] : all) t.times.push_back({light, time, {0, 2}});
  return t;
}

TEST(TimeScale, IsTheFactorBetweenMeasuredAndTold) {
  // A 4, B 6: 5 s at 4 mW/cm² would be 1 + 3.
  const Resin gel = resin_of("model = \"gel-time\"\ngel_a_mj_cm2 = 4\ngel_b_sqrt_mw_cm2_s = 6\n");
  const TimeScale one = scale_by_times(gel, times_at({{4, 5}}));
  EXPECT_NEAR(one.scale, 1.25, 1e-12);
  EXPECT_NEAR(one.told_s[0], 4, 1e-12);
  EXPECT_TRUE(std::isnan(one.stderr_ln));
  EXPECT_NEAR(one.worst_error, 0, 1e-12);
  EXPECT_THAT(one.to_text(gel), HasSubstr("one intensity does not tell"));

  // 20 mJ/cm² of gel, exponent 0.5: 10 s at 4 mW/cm², 5 s at 16.
  const Resin kinetic =
      resin_of("model = \"kinetic\"\nm = 0.5\ncritical_dose_prime = 20\ndose_factor = 5\n");
  const TimeScale both = scale_by_times(kinetic, times_at({{4, 20}, {16, 2.5}}));
  EXPECT_NEAR(both.scale, 1, 1e-12);
  EXPECT_NEAR(both.worst_error, 1, 1e-12);
  EXPECT_EQ(both.intensities, 2);
  // Logarithms are off by ln 2 each way.
  EXPECT_NEAR(both.stderr_ln, std::log(2), 1e-12);
  EXPECT_THAT(both.to_text(kinetic), HasSubstr("do not stand to each other"));

  const Resin jacobs = resin_of("model = \"jacobs\"\ngel_dose_mj_cm2 = 12\n");
  EXPECT_NEAR(scale_by_times(jacobs, times_at({{3, 6}})).scale, 1.5, 1e-9);
}

TEST(TimeScale, RefusesWhatHasNoDoseOfGel) {
  EXPECT_THROW(scale_by_times(resin_of("model = \"jacobs\"\ncritical_dose_mj_cm2 = 12\n"),
                              times_at({{3, 6}})),
               InputError);
  EXPECT_THROW(scale_by_times(resin_of("model = \"jacobs\"\ngel_dose_mj_cm2 = 12\n"), times_at({})),
               InputError);
}

TEST(TimeScale, RefusesWhatNoDoseMakesRight) {
  // 4 s and 1 s are told.
  const Resin jacobs = resin_of("model = \"jacobs\"\ngel_dose_mj_cm2 = 12\n");
  const auto refusal = [&](const std::vector<std::pair<double, double>>& times) -> std::string {
    try {
      scale_by_times(jacobs, times_at(times));
    } catch (const InputError& e) {
      return e.what();
    }
    return "";
  };
  EXPECT_THAT(refusal({{3, 4000}, {12, 1000}}), HasSubstr("1000 times those of the file"));
  EXPECT_THAT(refusal({{3, 4000}}), HasSubstr("were these ms?"));
  EXPECT_THAT(refusal({{3, 0.03}}), HasSubstr("expected s and mW/cm²"));
  EXPECT_EQ(refusal({{3, 300}}), "");
  // The same time at a hundred times the light.
  EXPECT_THAT(refusal({{0.3, 10}, {3, 10}, {30, 10}}), HasSubstr("do not stand to each other"));
}

}  // namespace
}  // namespace slicecorr::test
