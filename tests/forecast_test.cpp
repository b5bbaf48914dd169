// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What `predict` says of an exposure, against the closed forms and the recursion of slices.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "custom_resin.hpp"
#include "models.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/resins/design.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::resins {
namespace {

using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;

Question light(double blue, double uv) {
  Question q;
  q.blue_mw_cm2 = blue;
  q.uv_mw_cm2 = uv;
  return q;
}

TEST(Predict, CustomResinUnderUv) {
  Question q = light(100, 200);
  q.exposure_s = 30;
  q.height_um = 300;
  q.speed_mm_h = 1000;
  const Forecast f = predict(test::custom_resin_1(5), q);
  EXPECT_EQ(f.kinetics.critical_dose_prime, 64);  // the gel dose, without being asked
  EXPECT_NEAR(f.steady_dead_zone_um, 15.766, 5e-4);
  EXPECT_NEAR(f.first.z_um, 114.87, 5e-3);
  EXPECT_NEAR(f.first.time_s, 0.97507, 5e-6);
  ASSERT_TRUE(f.fronts);
  EXPECT_NEAR(f.fronts->front_um, 16.709, 5e-4);
  EXPECT_NEAR(f.fronts->back_um, 1566.7, 0.05);
  EXPECT_NEAR(f.passing->phi, 1.9364, 5e-5);
  EXPECT_NEAR(f.passing->fastest_mm_h, 1936.4, 0.05);
  EXPECT_TRUE(f.unanswered.empty());
  // At the height asked for, the dose is the gel dose just then.
  EXPECT_NEAR(dose_prime_at(f.kinetics, 100, 200, 300, f.exposure_for_height_s), 64, 1e-9);
  // The critical intensity gives phi 1, at the UV light asked for.
  EXPECT_NEAR(passing_dose_prime(f.kinetics, f.passing->critical_intensity_mw_cm2, 200, 1000), 64,
              1e-9);
  // physics: a constant 54.57 mW/cm² is what long exposure takes.
  EXPECT_NEAR(f.passing->critical_intensity_mw_cm2, 54.57, 0.01);
}

TEST(Predict, AimIsTheDoseOfTheCorrection) {
  Question q = light(100, 0);
  q.aim = true;
  q.exposure_s = 10;
  q.speed_mm_h = 300;
  const Forecast aim = predict(test::custom_resin_1(5), q);
  EXPECT_EQ(aim.kinetics.critical_dose_prime, 320);
  q.aim = false;
  const Forecast gel = predict(test::custom_resin_1(5), q);
  // ln 5 / m absorbance heights lie between the two.
  EXPECT_NEAR(gel.fronts->back_um - aim.fronts->back_um, 408 / 0.99 * std::log(5), 1e-9);
  EXPECT_NEAR(gel.passing->phi, 5 * aim.passing->phi, 1e-9);
  EXPECT_THAT(aim.sentences[0], HasSubstr("what correction aims at"));
  EXPECT_THAT(gel.sentences[0], HasSubstr("gel dose"));
}

TEST(Predict, ContinuousFiguresAreThoseOfTheModel) {
  // D figure 2.2: 16 mW/cm², phi 6.25, 62.5 to 6250 mm/h, four slices to gel.
  Question q = light(100, 0);
  q.aim = true;
  q.speed_mm_h = 1000;
  q.black_mw_cm2 = 1;
  const Forecast f = predict(test::resin(576, 2000), q);
  EXPECT_NEAR(f.passing->critical_intensity_mw_cm2, 16, 1e-9);
  EXPECT_NEAR(f.passing->phi, 6.25, 1e-9);
  EXPECT_NEAR(f.passing->fastest_mm_h, 6250, 1e-6);
  EXPECT_NEAR(f.passing->slowest_mm_h, 62.5, 1e-8);
  EXPECT_NEAR(f.passing->slice_time_s, 0.18, 1e-12);
  EXPECT_EQ(f.passing->slices_to_gel, test::figure_2_2().slices_to_gel());
  // Too fast is said, and is an answer.
  q.speed_mm_h = 7000;
  const Forecast fast = predict(test::resin(576, 2000), q);
  EXPECT_LT(fast.passing->phi, 1);
  EXPECT_EQ(fast.passing->slices_to_gel, 0);
  EXPECT_THAT(fast.sentences, Contains(HasSubstr("too fast")));
  EXPECT_TRUE(fast.unanswered.empty());
}

TEST(Predict, WeakUvIsSaidPlainly) {
  Question q = light(100, 100);  // beta Iuv = 73 < 100
  q.exposure_s = 60;
  const Forecast f = predict(test::custom_resin_1(5), q);
  EXPECT_EQ(f.steady_dead_zone_um, 0);
  EXPECT_NEAR(f.window_time_s, 64 / std::pow(27, 0.99), 1e-9);
  EXPECT_THAT(f.sentences, Contains(HasSubstr("cures to the window after")));
  EXPECT_EQ(f.fronts->front_um, 0);
  EXPECT_THAT(predict(test::custom_resin_1(5), light(100, 200)).sentences,
              Not(Contains(HasSubstr("cures to the window"))));
}

/// Gelled heights after a time, by the dose law on steps of 0.02 um (3.22).
struct Gelled {
  double front = -1, back = -1;
};
Gelled gelled_after(double seconds, double blue, double uv, const Resin& r) {
  const double hb = r.absorbance_height10_um / std::log(10);
  const double huv = r.inhibition->absorbance_height10_um / std::log(10);
  Gelled g;
  for (double z = 0; z < 6 * hb; z += 0.02) {
    const double rate = blue * std::exp(-z / hb) - r.inhibition->beta * uv * std::exp(-z / huv);
    if (!(rate > 0) || std::pow(rate, r.m) * seconds < r.critical_dose_prime / r.dose_factor)
      continue;
    if (g.front < 0) g.front = z;
    g.back = z;
  }
  return g;
}

TEST(Predict, TellsWhenFrontAndBackHaveSettled) {
  const Resin resin = test::custom_resin_1(1);
  struct Case {
    double blue, uv;
  };
  for (const Case& lights : {Case{100, 200}, Case{30, 55}, Case{100, 600}}) {
    const double blue = lights.blue, uv = lights.uv;
    SCOPED_TRACE(uv);
    const Forecast f = predict(resin, light(blue, uv));
    ASSERT_TRUE(f.front_settled_s && f.back_settled_s);
    const double zone = f.steady_dead_zone_um;
    // A step is the error: 0.02 um, a thousandth of the time on either side.
    EXPECT_GE(gelled_after(*f.front_settled_s * 0.99, blue, uv, resin).front, 1.1 * zone - 0.02);
    EXPECT_LE(gelled_after(*f.front_settled_s * 1.001, blue, uv, resin).front, 1.1 * zone + 0.02);
    const auto share = [&](double seconds) {
      Resin free = resin;
      free.inhibition->beta = 0;
      return gelled_after(seconds, blue, uv, resin).back /
             gelled_after(seconds, blue, uv, free).back;
    };
    EXPECT_NEAR(share(*f.back_settled_s), 0.9, 1e-3);
    EXPECT_LT(share(*f.back_settled_s * 0.97), 0.9);
    EXPECT_GT(share(*f.back_settled_s * 3), 0.9);
    EXPECT_THAT(f.sentences, Contains(HasSubstr("the front is within a tenth of it after")));
  }
  // No dead zone lasts: the front never settles, and JSON has no number for it. Without UV light nothing
  // is said.
  const Forecast weak = predict(resin, light(100, 50));
  EXPECT_TRUE(nlohmann::json::parse(weak.to_json()).at("front_settled_s").is_null());
  EXPECT_FALSE(predict(resin, light(100, 0)).front_settled_s);
}

TEST(Predict, HeightsInTheDeadZoneHaveNoAnswer) {
  Question q = light(100, 200);
  q.height_um = 15.7;
  const Forecast never = predict(test::custom_resin_1(5), q);
  EXPECT_FALSE(never.unanswered.empty());
  // The UV light that it names is the limit for that height.
  const auto at = never.unanswered.find("below ");
  const double uv = std::stod(never.unanswered.substr(at + 6));
  q.uv_mw_cm2 = uv * 0.999;
  EXPECT_TRUE(predict(test::custom_resin_1(5), q).unanswered.empty());
  q.uv_mw_cm2 = uv * 1.001;
  EXPECT_FALSE(predict(test::custom_resin_1(5), q).unanswered.empty());
  q = light(100, 200);
  q.height_um = 15.8;
  EXPECT_TRUE(predict(test::custom_resin_1(5), q).unanswered.empty());
}

TEST(Predict, TooShortAnExposureCuresNothing) {
  Question q = light(100, 200);
  q.exposure_s = 0.9;
  const Forecast f = predict(test::custom_resin_1(5), q);
  EXPECT_FALSE(f.fronts);
  EXPECT_THAT(f.sentences, Contains(HasSubstr("nothing has gelled yet")));
  EXPECT_TRUE(nlohmann::json::parse(f.to_json()).at("cured_height_um").is_null());
}

TEST(Predict, JsonHasNoInfinities) {
  Question q = light(100, 200);
  q.exposure_s = 30;
  q.height_um = 300;
  q.speed_mm_h = 1000;
  const auto j = nlohmann::json::parse(predict(test::custom_resin_1(5), q).to_json());
  EXPECT_TRUE(j.at("window_time_s").is_null());  // never
  EXPECT_EQ(j.at("dose"), "gel");
  EXPECT_NEAR(j.at("dead_zone_um").at("steady"), 15.766, 5e-4);
  EXPECT_NEAR(j.at("dead_zone_um").at("after_exposure"), 16.709, 5e-4);
  EXPECT_NEAR(j.at("cured_height_um"), 1566.7, 0.05);
  EXPECT_NEAR(j.at("continuous").at("phi"), 1.9364, 5e-5);
}

TEST(Predict, RefusesWhatTheResinLacks) {
  EXPECT_THROW(predict(test::custom_resin_1(5), light(0, 0)), InputError);
  EXPECT_THROW(predict(test::resin(576, 2000), light(100, 50)), InputError);  // no inhibition
  EXPECT_THROW(predict(Resin{}, light(100, 0)), InputError);
}

}  // namespace
}  // namespace slicecorr::resins
