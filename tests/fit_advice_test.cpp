// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What fits say about themselves: what the data can't tell, outliers, weights, bounds, errors.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <random>

#include "fit_designs.hpp"
#include "rounds.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::resins {
namespace {

using testing::AllOf;
using testing::Contains;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

const test::Design kKinetic = test::kinetic_design("", 67, 168, 0.99, 0.983);

/// Some of the rows of a design, with scatter.
template <typename Keep>
Measurements rows_of(const test::Design& d, unsigned seed, Keep&& keep) {
  Measurements m = test::with_scatter(d, seed);
  std::erase_if(m.cured, [&](const CuredHeight& c) { return !keep(c); });
  return m;
}

std::string refusal(const Measurements& data, FitModel model, const FitOptions& options = {}) {
  try {
    fit(data, model, options);
    ADD_FAILURE() << "was fitted";
  } catch (const InputError& e) {
    return e.what();
  }
  return "";
}

CuredHeight height(double blue, double time, double um) {
  CuredHeight c;
  c.blue_mw_cm2 = blue;
  c.exposure_s = time;
  c.dose_mj_cm2 = blue * time;
  c.height_um = um;
  return c;
}

TEST(Advice, GoodMeasurementsGetNone) {
  const FitResult r = fit(test::with_scatter(kKinetic, 1), FitModel::kinetic);
  EXPECT_THAT(r.warnings, IsEmpty());
  EXPECT_THAT(r.outliers, IsEmpty());
}

TEST(Advice, OneIntensityCannotTellM) {
  const auto one = rows_of(kKinetic, 1, [](const auto& c) { return c.blue_mw_cm2 == 20; });
  const FitResult r = fit(one, FitModel::kinetic);
  EXPECT_THAT(r.warnings,
              Contains(AllOf(HasSubstr("m can't be known"),
                             HasSubstr("all 18 measurements have one intensity (20 mW/cm2)"),
                             HasSubstr("factor of 4"))));
  EXPECT_EQ(r.value("m"), 1);
  EXPECT_TRUE(r.find("m")->fixed);
  EXPECT_TRUE(std::isnan(r.find("m")->stderr_));
  // The rest is Jacobs' law.
  const FitResult jacobs = fit(one, FitModel::jacobs);
  EXPECT_NEAR(r.value("h_um") / jacobs.value("h_um"), 1, 1e-8);
  EXPECT_NEAR(r.value("critical_dose_prime") / jacobs.value("dc_mj_cm2"), 1, 1e-8);
  EXPECT_NEAR(r.find("h_um")->stderr_ / jacobs.find("h_um")->stderr_, 1, 1e-6);
  EXPECT_FALSE(r.reciprocity);
}

// A lamp that drifts in the last digits does not make several intensities.
TEST(Advice, IntensitiesThatHardlyDifferCannotTellM) {
  auto one = rows_of(kKinetic, 1, [](const auto& c) { return c.blue_mw_cm2 == 20; });
  for (std::size_t i = 0; i < one.cured.size(); ++i) {
    one.cured[i].blue_mw_cm2 *= 1 + 0.001 * static_cast<double>(i % 5);
  }
  const FitResult r = fit(one, FitModel::kinetic);
  EXPECT_THAT(r.warnings,
              Contains(AllOf(HasSubstr("m can't be known"), HasSubstr("factor of 1 only"))));
  EXPECT_EQ(r.value("m"), 1);
}

TEST(Advice, UnitsOfAnotherSizeAreSuspected) {
  const Measurements good = test::with_scatter(kKinetic, 1);
  const auto scaled = [&](double time, double light) {
    Measurements m = good;
    for (CuredHeight& c : m.cured) {
      c.exposure_s *= time;
      c.blue_mw_cm2 *= light;
      c.dose_mj_cm2 *= time * light;
    }
    return m;
  };
  for (const FitModel model : {FitModel::jacobs, FitModel::kinetic}) {
    for (const Measurements& m : {scaled(1000, 1), scaled(1, 1000), scaled(1000, 1000)}) {
      EXPECT_THAT(fit(m, model).warnings, Contains(AllOf(HasSubstr("the dose of gel comes out at"),
                                                         HasSubstr("in ms"), HasSubstr("uW"))));
    }
    EXPECT_THAT(fit(scaled(1 / 60.0, 1e-3), model).warnings, Contains(HasSubstr("in minutes")));
  }
}

// Heights by the formula have no scatter: what is left is rounding, and no lack of fit.
TEST(Advice, ExactHeightsLackNothing) {
  for (const test::Design& d :
       {test::kinetic_design("", 67, 168, 0.99, 0.983), test::jacobs_design("", 69, 170, 0.983)}) {
    EXPECT_THAT(fit(d.exact, d.model).warnings, Not(Contains(HasSubstr("lack of fit"))));
    // Nor do copies of such heights in the last digits of a double.
    Measurements data = d.exact;
    for (std::size_t i = 0; i < data.cured.size(); ++i) {
      data.cured[i].height_um *= 1 + 1e-15 * static_cast<double>(i % 3);
    }
    EXPECT_THAT(fit(data, FitModel::jacobs).warnings, Not(Contains(HasSubstr("lack of fit"))));
  }
}

TEST(Advice, OneTimeOrOneDoseCannotTellM) {
  Measurements data;
  for (const double blue : {10.0, 20.0, 40.0, 80.0}) {
    for (const double off : {-1.0, 0.0, 1.5}) {
      data.cured.push_back(height(blue, 10, 170 * std::log(blue * 10 / 69) + off));
    }
  }
  const FitResult r = fit(data, FitModel::kinetic);
  EXPECT_THAT(r.warnings, Contains(AllOf(HasSubstr("m can't be known"),
                                         HasSubstr("one exposure time (10 s)"))));
  for (CuredHeight& c : data.cured) {
    c.exposure_s = 400 / c.blue_mw_cm2;
    c.dose_mj_cm2 = 400;
  }
  for (const FitModel model : {FitModel::jacobs, FitModel::kinetic}) {
    EXPECT_THAT(refusal(data, model), HasSubstr("all 12 cured heights have one dose (400 mJ/cm2)"));
  }
}

TEST(Advice, GelDoseFarBelowTheMeasurementsIsExtrapolated) {
  Measurements high = kKinetic.exact;
  std::erase_if(high.cured, [](const auto& c) { return c.dose_mj_cm2 < 350; });
  const FitResult r = fit(high, FitModel::jacobs);
  EXPECT_THAT(r.warnings, Contains(AllOf(HasSubstr("far above gel"), HasSubstr("extrapolated"))));
  const auto narrow = rows_of(kKinetic, 1, [](const auto& c) { return c.dose_mj_cm2 < 170; });
  EXPECT_THAT(fit(narrow, FitModel::jacobs).warnings, Contains(HasSubstr("factor of 1.4")));
}

TEST(Advice, MeasurementsThatAreNoWorkingCurveAreRefused) {
  Measurements falling;
  for (const double time : {4.0, 8.0, 16.0}) {
    falling.cured.push_back(height(20, time, 300 - 10 * time));
  }
  EXPECT_THAT(refusal(falling, FitModel::jacobs), HasSubstr("do not grow with the dose"));
  EXPECT_THAT(refusal(falling, FitModel::kinetic), HasSubstr("do not grow with the dose"));
  Measurements one;
  one.cured.push_back(height(20, 4, 60));
  EXPECT_THAT(refusal(one, FitModel::jacobs), AllOf(HasSubstr("1 measurements are fewer")));
  EXPECT_THAT(refusal({}, FitModel::jacobs), HasSubstr("no cured heights"));
  EXPECT_THAT(refusal(one, FitModel::joint, {}), HasSubstr("no dead zones"));
  Measurements doses;
  for (const double d : {90.0, 180.0, 360.0, 500.0}) {
    doses.cured.push_back(height(0, 0, 100 * std::log(d / 50)));
    doses.cured.back().dose_mj_cm2 = d;
  }
  EXPECT_THAT(refusal(doses, FitModel::kinetic), HasSubstr("a dose is enough for jacobs"));
  EXPECT_NEAR(fit(doses, FitModel::jacobs).value("dc_mj_cm2"), 50, 1e-6);
}

TEST(Advice, AsManyParametersAsMeasurementsLeaveNoInterval) {
  Measurements two;
  two.cured = {height(20, 5, 60), height(20, 10, 180)};
  const FitResult r = fit(two, FitModel::jacobs);
  EXPECT_NEAR(r.value("h_um"), 120 / std::log(2.0), 1e-6);
  EXPECT_TRUE(std::isnan(r.find("h_um")->ci95[0]));
  EXPECT_THAT(r.warnings, Contains(HasSubstr("as many free parameters as measurements (2)")));
  // NaN never gets into JSON.
  const auto j = nlohmann::json::parse(r.to_json());
  EXPECT_TRUE(j["parameters"]["h_um"]["ci95"][0].is_null());
  EXPECT_TRUE(j["sigma_um"].is_null());
}

TEST(Advice, DeadZonesThatClosedAreLeftOutAndToldOf) {
  const test::Design d = test::steady_design();
  Measurements data = test::with_scatter(d, 1);
  const FitResult before = fit(data, d.model, d.options);
  DeadZone closed = data.dead_zones.front();
  closed.blue_mw_cm2 = 400;
  closed.dead_zone_um = 0;
  closed.origin.line = 99;
  data.dead_zones.push_back(closed);
  data.sources = {"zones.csv"};
  const FitResult r = fit(data, d.model, d.options);
  EXPECT_EQ(r.value("beta"), before.value("beta"));
  EXPECT_EQ(r.n, 36);
  ASSERT_EQ(r.points.size(), 37U);
  EXPECT_EQ(r.points.back().weight, 0);
  EXPECT_EQ(r.points.back().predicted_um, 0);
  EXPECT_THAT(r.warnings, Contains(AllOf(HasSubstr("1 of 37 dead zones are 0"),
                                         HasSubstr("zones.csv: line 99"))));
  EXPECT_THAT(r.warnings, Not(Contains(HasSubstr("contradict"))));
  // The same zero where the fit sees an open dead zone.
  data.dead_zones.back().blue_mw_cm2 = 5;
  EXPECT_THAT(fit(data, d.model, d.options).warnings, Contains(HasSubstr("contradict")));
  for (DeadZone& z : data.dead_zones) z.dead_zone_um = 0;
  EXPECT_THAT(refusal(data, d.model, d.options), HasSubstr("all 37 dead zones are 0"));
}

TEST(Advice, DeadZonesThatAreSteadyCannotTellTheExponent) {
  test::Design d = test::transient_design();
  // So long that the front has arrived everywhere.
  Measurements data;
  const Kinetics k{1631, 1.29, 238, 4.84, 100};
  test::Normal normal(1);
  for (const DeadZone& z : d.exact.dead_zones) {
    DeadZone late = z;
    late.exposure_s = 1e5;
    late.dead_zone_um = steady_dead_zone_um(k, z.blue_mw_cm2, z.uv_mw_cm2) + 3 * normal();
    data.dead_zones.push_back(late);
  }
  const FitResult r = fit(data, d.model, d.options);
  EXPECT_THAT(r.warnings, Contains(HasSubstr("measure at shorter exposures")));
  // Whatever the exponent, the steady law must come out right.
  EXPECT_NEAR(r.value("beta") / 4.84, 1, 0.1);
  EXPECT_NEAR(r.value("huv_um") / 100, 1, 0.1);
}

TEST(Advice, DeadZonesThatAreNotYetSteadyAreFoundInASteadyFit) {
  const test::Design d = test::transient_design();
  const FitResult r = fit(test::with_scatter(d, 1), FitModel::dead_zone_steady, d.options);
  EXPECT_THAT(r.warnings, Contains(AllOf(HasSubstr("before they were steady"),
                                         HasSubstr("deadzone-transient"))));
}

TEST(Advice, OneRatioCannotTellBetaFromItsHeight) {
  test::Design d = test::steady_design();
  for (DeadZone& z : d.exact.dead_zones) z.blue_mw_cm2 = 50;
  const auto data = test::with_scatter(d, 1);
  EXPECT_THAT(refusal(data, d.model, d.options), HasSubstr("one ratio of UV to blue (4)"));
  // One of them held, the other can be found.
  d.options.fixed["huv_um"] = 37.8;
  EXPECT_GT(fit(data, d.model, d.options).value("beta"), 0);
}

TEST(Advice, ExponentThatOneExposureHardlyTellsIsThatOfTheResin) {
  // A made-up laboratory: m 0.95, beta 0.8, 40 um of UV light, 1.5 um of scatter, 60 s each. Any exponent from 0.16 to 2
  // fits, and the best of them, 0.29, would make exposures under UV light 15 times longer.
  const std::map<double, std::array<double, 3>> measured = {
      {15.0, {110.1, 111.4, 110.3}}, {18.4, {101.3, 102.5, 99.3}}, {22.5, {90.8, 89.8, 90.6}},
      {27.6, {79.0, 79.9, 80.5}},    {33.8, {72.6, 72.9, 69.2}},   {41.4, {60.6, 62.7, 58.8}},
      {50.7, {51.7, 52.3, 54.3}},    {62.1, {44.1, 42.6, 42.6}},   {76.1, {33.5, 36.2, 33.2}},
      {93.3, {24.2, 25.2, 24.5}},    {114.3, {15.2, 13.8, 15.5}},  {140.0, {5.7, 8.1, 7.3}}};
  Measurements data;
  for (const auto& [blue, zones] : measured) {
    for (const double um : zones) {
      DeadZone zone;
      zone.blue_mw_cm2 = blue;
      zone.uv_mw_cm2 = 200;
      zone.exposure_s = 60;
      zone.dead_zone_um = um;
      data.dead_zones.push_back(zone);
    }
  }
  FitOptions options;
  options.hb_um = 389.7673;
  options.m = 0.9448115;
  options.critical_dose_prime = 69.58752;
  const FitResult r = fit(data, FitModel::dead_zone_transient, options);
  EXPECT_EQ(r.value("m"), options.m);
  EXPECT_THAT(r.warnings, Contains(HasSubstr("m can't be known, and was held at 0.9448")));
  EXPECT_NEAR(r.value("beta") / 0.8, 1, 0.05);
  EXPECT_NEAR(r.value("huv_um") / 40, 1, 0.05);
}

TEST(Advice, ExposuresOfDPrimeHideTheExponent) {
  test::Design d = test::transient_design();
  // (D'c / t)^(1/m) is 1 whatever m is.
  d.options.critical_dose_prime = 15;
  const FitResult r = fit(test::with_scatter(d, 1), d.model, d.options);
  EXPECT_THAT(r.warnings, Contains(AllOf(HasSubstr("m can't be known"), HasSubstr("cancels out"))));
  EXPECT_EQ(r.value("m"), 1.03);
}

TEST(Advice, JointFitWithoutTransientsHasOneExponent) {
  test::Design d = test::joint_design();
  Measurements data = test::with_scatter(d, 1);
  const Kinetics k{1631, 1.03, 238, 4.84, 100};
  test::Normal normal(1);
  for (DeadZone& z : data.dead_zones) {
    z.exposure_s = 1e7;
    z.dead_zone_um = steady_dead_zone_um(k, z.blue_mw_cm2, z.uv_mw_cm2) + 3 * normal();
  }
  const FitResult r = fit(data, d.model, d.options);
  EXPECT_THAT(r.warnings, Contains(HasSubstr("one m serves both")));
  EXPECT_EQ(r.find("m_uv"), nullptr);
  EXPECT_NEAR(r.value("m"), 1.03, 0.15);
}

TEST(Outliers, AreNamedWithTheirLine) {
  for (const auto& d : {kKinetic, test::steady_design(), test::transient_design()}) {
    Measurements data = test::with_scatter(d, 2);
    data.sources = {"lab.csv"};
    const bool cured = !data.cured.empty();
    if (cured) {
      data.cured[20].height_um += 8 * d.cured_sigma_um;
    } else {
      data.dead_zones[20].dead_zone_um += 8 * d.dead_zone_sigma_um;
    }
    for (const Loss loss : {Loss::none, Loss::soft_l1, Loss::cauchy}) {
      FitOptions options = d.options;
      options.loss = loss;
      const FitResult r = fit(data, d.model, options);
      ASSERT_EQ(r.outliers.size(), 1U) << name_of(d.model);
      EXPECT_EQ(r.outliers[0].point, 20U);
      EXPECT_THAT(r.outliers[0].reason, AllOf(HasSubstr("lab.csv: line 22"), HasSubstr("times")));
    }
  }
}

// Two that are both far off make the scatter look large enough for each of them.
TEST(Outliers, ThatHideEachOtherAreAllNamed) {
  for (const auto& places :
       {std::vector<std::size_t>{20, 41}, std::vector<std::size_t>{3, 4, 30}}) {
    for (const double by : {8.0, 40.0}) {
      Measurements data = test::with_scatter(kKinetic, 2);
      data.sources = {"lab.csv"};
      for (const std::size_t i : places) data.cured[i].height_um += by * kKinetic.cured_sigma_um;
      const FitResult r = fit(data, FitModel::kinetic);
      std::vector<std::size_t> named;
      for (const Outlier& o : r.outliers) named.push_back(o.point);
      EXPECT_EQ(named, places) << by;
      EXPECT_THAT(r.warnings, Contains(HasSubstr("--loss soft-l1")));
    }
  }
  FitOptions robust;
  robust.loss = Loss::soft_l1;
  Measurements data = test::with_scatter(kKinetic, 2);
  data.cured[20].height_um += 40 * kKinetic.cured_sigma_um;
  EXPECT_THAT(fit(data, FitModel::kinetic, robust).warnings, Not(Contains(HasSubstr("--loss"))));
}

// Of clean data one fit in twenty at most names any: the limit is Bonferroni's at 5 %. 400 seeded
// runs have a standard deviation of 1.1 %.
TEST(Outliers, AreSeldomNamedInCleanData) {
  int named = 0;
  for (unsigned seed = 1; seed <= 400; ++seed) {
    const FitResult r = fit(test::with_scatter(kKinetic, seed), FitModel::kinetic);
    named += r.outliers.empty() ? 0 : 1;
  }
  EXPECT_LE(named, 34);
}

// A robust loss keeps near to what the others say; least squares do not.
TEST(Outliers, CountLittleWithARobustLoss) {
  Measurements data = test::with_scatter(kKinetic, 2);
  const double clean = fit(data, FitModel::kinetic).value("m");
  const double stderr_m = fit(data, FitModel::kinetic).find("m")->stderr_;
  for (std::size_t i = 0; i < 54; i += 17) data.cured[i].height_um += 25 * kKinetic.cured_sigma_um;
  const double drawn = fit(data, FitModel::kinetic).value("m");
  EXPECT_GT(std::abs(drawn - clean), 3 * stderr_m);
  for (const Loss loss : {Loss::soft_l1, Loss::cauchy}) {
    FitOptions options;
    options.loss = loss;
    EXPECT_LT(std::abs(fit(data, FitModel::kinetic, options).value("m") - clean), 2 * stderr_m);
  }
}

// Four of five lie on a line by chance: 120 um for each doubling of the dose. The fifth was read to
// full 5 um as they were, 5 um off it; it is no outlier, and no multiple of a scatter of 0.
TEST(Outliers, ReadingsScatterByWhatTheyAreReadTo) {
  Measurements data;
  const double um[] = {210, 330, 455, 570, 690};
  for (int i = 0; i < 5; ++i) data.cured.push_back(height(1, 20 << i, um[i]));
  EXPECT_THAT(fit(data, FitModel::jacobs).outliers, IsEmpty());
  data.cured[2].height_um = 650;  // 200 um off, where all are read to full 10 um
  const FitResult off = fit(data, FitModel::jacobs);
  ASSERT_EQ(off.outliers.size(), 1U);
  EXPECT_EQ(off.outliers[0].point, 2U);
  EXPECT_NEAR(std::abs(off.points[2].studentised), 200 * std::sqrt(0.8 * 12) / 10, 1e-6);
}

// One height in mm among heights in um.
TEST(Outliers, ThousandthsAskForTheirUnit) {
  Measurements data = test::with_scatter(kKinetic, 2);
  data.cured[20].height_um /= 1000;
  const FitResult r = fit(data, FitModel::kinetic);
  ASSERT_EQ(r.outliers.size(), 1U);
  EXPECT_THAT(r.outliers[0].reason, HasSubstr("is it in mm?"));
}

// A table pasted once more, whole or in part, and not replicates that agree here and there.
TEST(Advice, MeasurementsThatRepeatOthersAreTold) {
  const Measurements once = test::with_scatter(kKinetic, 2);
  Measurements data = once;
  const auto warnings = [&] { return fit(data, FitModel::kinetic).warnings; };
  data.cured.insert(data.cured.end(), once.cured.begin(), once.cured.end());
  EXPECT_THAT(warnings(), Contains(AllOf(HasSubstr("54 of 108 measurements repeat"),
                                         HasSubstr("1.4 times too narrow"))));
  data = once;
  data.cured.insert(data.cured.begin() + 30, once.cured.begin() + 2, once.cured.begin() + 8);
  EXPECT_THAT(warnings(), Contains(HasSubstr("6 of 60 measurements repeat")));
  data = once;
  data.cured.insert(data.cured.begin() + 30, once.cured.begin() + 2, once.cured.begin() + 7);
  EXPECT_THAT(warnings(), Not(Contains(HasSubstr("repeat"))));
}

// Intensities of 10 to 40 differ by a factor of 4, and are not asked to do so.
TEST(Advice, AFactorThatIsThereIsNotAskedFor) {
  Measurements data;
  for (const double blue : {10.0, 20.0, 40.0}) {
    for (const double time : {2.0, 4.0, 8.0}) {
      const double off = (blue == 20) == (time == 4) ? 90 : -90;
      data.cured.push_back(height(blue, time, 150 * std::log(blue * time / 8) + off));
    }
  }
  const FitResult r = fit(data, FitModel::kinetic);
  EXPECT_THAT(r.warnings, Contains(HasSubstr("m ")));
  EXPECT_THAT(r.warnings, Not(Contains(HasSubstr("factor of 4"))));
}

// What can't be told is not told: an exponent of 0.55 to 1.04 is no reciprocity.
TEST(Advice, WideExponentsAreNoReciprocity) {
  Measurements data = test::with_scatter(kKinetic, 2);
  for (std::size_t i = 0; i < data.cured.size(); ++i) {
    data.cured[i].height_um += (i % 3 == 0 ? 12 : i % 3 == 1 ? -12 : 0) * kKinetic.cured_sigma_um;
  }
  const FitResult r = fit(data, FitModel::kinetic);
  ASSERT_TRUE(r.reciprocity);
  EXPECT_GT(r.reciprocity->m_ci95[1] - r.reciprocity->m_ci95[0], 0.4);
  EXPECT_THAT(r.reciprocity->verdict, HasSubstr("neither contradict reciprocity nor tell it"));
}

TEST(Outliers, PointsThatDecideAloneAreNamed) {
  Measurements data;
  for (int i = 0; i < 9; ++i) data.cured.push_back(height(20, 8 + 0.01 * i, 150 + i % 3));
  data.cured.push_back(height(20, 40, 420));
  data.cured.back().origin.line = 11;
  data.sources = {"lab.csv"};
  EXPECT_THAT(fit(data, FitModel::jacobs).warnings,
              Contains(AllOf(HasSubstr("lab.csv: line 11 alone decides"), HasSubstr("repeat it"))));
}

TEST(Weights, GivenScatterIsWeightedLeastSquares) {
  Measurements data = test::with_scatter(kKinetic, 4);
  for (std::size_t i = 0; i < data.cured.size(); ++i) data.cured[i].sigma_um = i % 2 ? 3 : 30;
  FitOptions options;
  options.weights = Weights::scatter;
  const FitResult r = fit(data, FitModel::jacobs, options);
  double w = 0, wx = 0, wy = 0, wxx = 0, wxy = 0;
  for (const auto& c : data.cured) {
    const double x = std::log(c.dose_mj_cm2), weight = 1 / (c.sigma_um * c.sigma_um);
    w += weight;
    wx += weight * x;
    wy += weight * c.height_um;
    wxx += weight * x * x;
    wxy += weight * x * c.height_um;
  }
  EXPECT_NEAR(r.value("h_um") / ((w * wxy - wx * wy) / (w * wxx - wx * wx)), 1, 1e-8);
  EXPECT_NEAR(r.points[1].weight / r.points[0].weight, 10, 1e-9);
}

TEST(Weights, ReplicatesThatScatterMoreCountLess) {
  Measurements data = test::with_scatter(kKinetic, 4);
  // Six groups of three scatter twenty times as much.
  test::Normal normal(9);
  for (std::size_t i = 0; i < 18; ++i) data.cured[i].height_um += 250 * normal();
  FitOptions options;
  options.weights = Weights::scatter;
  const FitResult r = fit(data, FitModel::kinetic, options);
  double loud = 0, quiet = 0;
  for (std::size_t i = 0; i < r.points.size(); ++i) {
    (i < 18 ? loud : quiet) += r.points[i].weight / (i < 18 ? 18 : 36);
  }
  EXPECT_GT(quiet, 4 * loud);
  EXPECT_LT(r.find("h_um")->stderr_, 0.5 * fit(data, FitModel::kinetic).find("h_um")->stderr_);
  // Nothing to weigh by.
  Measurements single;
  single.cured = {height(20, 4, 30), height(20, 8, 130), height(20, 16, 260)};
  EXPECT_THAT(refusal(single, FitModel::jacobs, options), HasSubstr("neither replicates"));
}

// Whatever is measured: a result of finite numbers or an error, and never a word on stderr.
TEST(Choices, NoMeasurementsAreTooOdd) {
  std::mt19937 random(5);
  const auto below = [&](std::size_t n) { return random() % n; };
  const auto number = [&](double low, double high) {
    return low * std::pow(high / low, random() / 4294967296.0);
  };
  int fitted = 0, refused = 0;
  const int rounds = test::by_night() ? 6000 : 300;
  testing::internal::CaptureStderr();
  for (int round = 0; round < rounds; ++round) {
    Measurements data;
    const double wide = number(1, 1e4);
    const std::size_t rows = 1 + below(9);
    for (std::size_t i = 0; i < rows; ++i) {
      data.cured.push_back(height(number(1, wide), number(1, wide), number(0.1, 10 * wide)));
      if (round % 3 == 0) data.cured.back().height_um = 100 * std::log(1.1 + number(1e-3, wide));
      DeadZone z;
      z.blue_mw_cm2 = number(1, wide);
      z.uv_mw_cm2 = number(1, wide);
      z.exposure_s = number(1, wide);
      z.dead_zone_um = below(5) ? number(0.1, wide) : 0;
      data.dead_zones.push_back(z);
    }
    FitOptions options;
    options.hb_um = number(1, 1e4);
    options.critical_dose_prime = number(1e-2, 1e4);
    options.m = number(0.5, 1.5);
    options.bootstrap = round % 20 == 0 ? 20 : 0;
    options.loss = static_cast<Loss>(below(3));
    options.weights = below(4) ? Weights::none : Weights::scatter;
    const auto model = static_cast<FitModel>(below(fit_model_kinds().size()));
    try {
      const FitResult r = fit(data, model, options);
      ++fitted;
      for (const Parameter& p : r.parameters) {
        ASSERT_TRUE(std::isfinite(p.value) && p.value > 0) << name_of(model) << " " << p.name;
        ASSERT_TRUE(std::isnan(p.ci95[0]) || p.ci95[0] <= p.value * (1 + 1e-9))
            << name_of(model) << " " << p.name << " " << round;
        ASSERT_TRUE(std::isnan(p.ci95[1]) || p.ci95[1] >= p.value * (1 - 1e-9));
      }
      for (const FitPoint& p : r.points) ASSERT_TRUE(std::isfinite(p.predicted_um));
      ASSERT_TRUE(std::isfinite(r.rmse_um));
      ASSERT_FALSE(nlohmann::json::parse(r.to_json()).is_discarded());
      ASSERT_FALSE(r.to_text().empty());
    } catch (const InputError& e) {
      ++refused;
      ASSERT_GT(std::string(e.what()).size(), 20U);
    }
  }
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
  EXPECT_GT(fitted, rounds / 4);
  EXPECT_GT(refused, rounds / 6);
}

TEST(Choices, BoundsAndFixedValuesAreKept) {
  const Measurements data = test::with_scatter(kKinetic, 1);
  FitOptions options;
  options.fixed["m"] = 0.8;
  const FitResult held = fit(data, FitModel::kinetic, options);
  EXPECT_EQ(held.value("m"), 0.8);
  EXPECT_TRUE(held.find("m")->fixed);
  EXPECT_EQ(held.free_parameters, 2);
  EXPECT_EQ(held.covariance.size(), 4U);

  options.fixed.clear();
  options.bounds["m"] = {0.5, 0.9};
  const FitResult bounded = fit(data, FitModel::kinetic, options);
  EXPECT_NEAR(bounded.value("m"), 0.9, 1e-12);
  EXPECT_TRUE(bounded.find("m")->at_bound);
  EXPECT_TRUE(std::isnan(bounded.find("m")->stderr_));
  EXPECT_THAT(bounded.warnings, Contains(HasSubstr("m ended at its bound 0.9")));
  // At the bound the others are those of a fit with it held there.
  options.bounds.clear();
  options.fixed["m"] = 0.9;
  const FitResult there = fit(data, FitModel::kinetic, options);
  EXPECT_NEAR(bounded.value("h_um") / there.value("h_um"), 1, 1e-7);
  EXPECT_NEAR(bounded.find("h_um")->stderr_ / there.find("h_um")->stderr_, 1, 1e-6);

  FitOptions all;
  all.fixed = {{"h_um", 168}, {"m", 0.99}, {"critical_dose_prime", 67}};
  const FitResult nothing_free = fit(data, FitModel::kinetic, all);
  EXPECT_EQ(nothing_free.free_parameters, 0);
  EXPECT_NEAR(nothing_free.rmse_um, kKinetic.cured_sigma_um, 0.3 * kKinetic.cured_sigma_um);
}

// The best of all ways to hold parameters at their bounds, found by trying them all.
TEST(Choices, SeveralBoundsGiveTheBestThatTheyAllow) {
  const Measurements data = test::with_scatter(kKinetic, 1);
  const std::map<std::string, Bounds> bounds = {
      {"h_um", {100, 140}}, {"m", {0.5, 0.93}}, {"critical_dose_prime", {60, 90}}};
  FitOptions bounded;
  bounded.bounds = bounds;
  const FitResult r = fit(data, FitModel::kinetic, bounded);
  double best = 1e300;
  for (int way = 0; way < 27; ++way) {
    FitOptions held;
    int rest = way;
    for (const auto& [name, range] : bounds) {
      if (rest % 3 == 1) held.fixed[name] = range.low;
      if (rest % 3 == 2) held.fixed[name] = range.high;
      rest /= 3;
    }
    const FitResult tried = fit(data, FitModel::kinetic, held);
    bool inside = true;
    for (const auto& [name, range] : bounds) {
      inside = inside && tried.value(name) >= range.low && tried.value(name) <= range.high;
    }
    if (inside) best = std::min(best, tried.rmse_um);
  }
  EXPECT_NEAR(r.rmse_um / best, 1, 1e-9);
}

TEST(Choices, WrongOnesAreRefused) {
  const Measurements data = test::with_scatter(kKinetic, 1);
  const auto with = [&](auto&& change) {
    FitOptions options;
    change(options);
    return refusal(data, FitModel::kinetic, options);
  };
  EXPECT_THAT(
      with([](auto& o) { o.fixed["beta"] = 1; }),
      AllOf(HasSubstr("'beta' is no parameter"), HasSubstr("h_um, m, critical_dose_prime")));
  EXPECT_THAT(with([](auto& o) { o.fixed["m"] = -1; }), HasSubstr("above 0"));
  EXPECT_THAT(with([](auto& o) { o.fixed["m"] = NAN; }), HasSubstr("finite"));
  EXPECT_THAT(with([](auto& o) { o.bounds["m"] = {1, 0.5}; }), HasSubstr("lower one first"));
  EXPECT_THAT(with([](auto& o) { o.bounds["m"] = {0, 0.5}; }), HasSubstr("above 0"));
  EXPECT_THAT(with([](auto& o) {
                o.bounds["m"] = {0.5, 1};
                o.fixed["m"] = 1;
              }),
              HasSubstr("both fixed and bounded"));
  EXPECT_THAT(with([](auto& o) { o.starts = 0; }), HasSubstr("starts"));
  EXPECT_THAT(with([](auto& o) { o.tolerance = 0; }), HasSubstr("tolerance"));
  const auto zones = test::steady_design();
  EXPECT_THAT(refusal(zones.exact, zones.model), HasSubstr("--resin"));
  FitOptions options = zones.options;
  options.fixed["huv_um"] = 500;
  EXPECT_THAT(refusal(zones.exact, zones.model, options), HasSubstr("curing light"));
}

}  // namespace
}  // namespace slicecorr::resins
