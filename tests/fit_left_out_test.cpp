// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Laws compared by what they predict of settings that were left out.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "fit_designs.hpp"
#include "slicecorr/gel_time.hpp"
#include "slicecorr/resins/fit.hpp"
#include "slicecorr/resins/gel_time_fit.hpp"

namespace slicecorr::test {
namespace {

using namespace resins;
using testing::ElementsAre;
using testing::HasSubstr;

void add_height(Measurements& m, double light, double time, double height_um, int source = 0) {
  m.cured.push_back(
      {light, time, light * time, height_um, 0, {source, static_cast<int>(m.cured.size()) + 2}});
}

const LeftOutLaw& law_of(const LeftOut& l, FitModel model) {
  for (const LeftOutLaw& law : l.laws) {
    if (law.model == model) return law;
  }
  throw std::runtime_error("the law is not among those compared");
}

/// Roofs that were measured (Elegoo, tests/data/measured), one intensity.
Measurements roofs() {
  Measurements m;
  m.sources = {"roofs.csv"};
  const std::pair<double, double> all[] = {{8.2, 112.7625}, {7.6, 105.7425}, {7.0, 92.115},
                                           {6.4, 79.9275},  {5.8, 69.535},   {5.2, 56.385},
                                           {4.6, 32.49}};
  for (const auto& [time, height] : all) add_height(m, 1.93824, time, height);
  return m;
}

TEST(LeftOut, AStraightLineIsThatOfTheTextbook) {
  // Jacobs' law is a line over ln t: what is left out is off by its residual over 1 - leverage.
  const Measurements m = roofs();
  double mean = 0, mean_um = 0, square = 0, both = 0;
  for (const CuredHeight& c : m.cured) {
    mean += std::log(c.dose_mj_cm2) / 7;
    mean_um += c.height_um / 7;
  }
  for (const CuredHeight& c : m.cured) {
    square += std::pow(std::log(c.dose_mj_cm2) - mean, 2);
    both += (std::log(c.dose_mj_cm2) - mean) * (c.height_um - mean_um);
  }
  double squares = 0, sum = 0;
  for (const CuredHeight& c : m.cured) {
    const double x = std::log(c.dose_mj_cm2) - mean;
    const double error =
        (mean_um + both / square * x - c.height_um) / (1 - 1.0 / 7 - x * x / square);
    squares += error * error / 7;
    sum += error / 7;
  }
  const auto left = compare_left_out(m);
  ASSERT_TRUE(left);
  EXPECT_EQ(left->settings, 7u);
  // Ceres ends at a tolerance of 1e-12.
  EXPECT_NEAR(law_of(*left, FitModel::jacobs).left_out_rmse_um, std::sqrt(squares), 1e-6);
  EXPECT_NEAR(law_of(*left, FitModel::jacobs).left_out_bias_um, sum, 1e-6);
  EXPECT_FALSE(law_of(*left, FitModel::jacobs).other_files_rmse_um);
  // Three and four parameters meet these roofs better and predict them no better than chance.
  EXPECT_EQ(left->trust, FitModel::jacobs);
  EXPECT_THAT(left->not_compared, ElementsAre(HasSubstr("kinetic: heights at one intensity")));
  EXPECT_THAT(left->verdict, HasSubstr("Trust jacobs"));
}

TEST(LeftOut, TrustsTheLawThatTheHeightsFollow) {
  // Without scatter each law meets its own heights, and those with fewer parameters can't.
  Design d = kinetic_design("custom", 238, 1631, 0.8, 0.958, 100);
  EXPECT_EQ(compare_left_out(d.exact)->trust, FitModel::kinetic);
  EXPECT_LT(law_of(*compare_left_out(d.exact), FitModel::kinetic).left_out_rmse_um, 1e-3);
  d = jacobs_design("custom", 69, 170, 0.983);
  const LeftOut exact = *compare_left_out(d.exact);
  EXPECT_EQ(exact.trust, FitModel::jacobs);
  EXPECT_EQ(exact.settings, 18u);

  Measurements gel;
  gel.sources = {"gel.csv"};
  const GelTime law{5, 3};
  for (const double light : {0.5, 5.0, 50.0}) {
    for (const double depth : {0.3, 0.8, 1.4, 2.0}) {
      add_height(gel, light, gel_time_s(law, light * std::exp(-depth)), 200 * depth);
    }
  }
  const LeftOut of_gel = *compare_left_out(gel);
  EXPECT_EQ(of_gel.trust, FitModel::gel_time);
  EXPECT_LT(law_of(of_gel, FitModel::gel_time).left_out_rmse_um, 1e-3);
  EXPECT_GT(law_of(of_gel, FitModel::jacobs).left_out_rmse_um, 5);
}

TEST(LeftOut, ScatterDoesNotBuyParameters) {
  // Of heights that follow Jacobs' law with scatter, a law with more parameters is best by chance in
  // about half of the runs; one standard error keeps most of them from it.
  const Design d = jacobs_design("custom", 69, 170, 0.983);
  int plain = 0;
  for (unsigned seed = 1; seed <= 8; ++seed) {
    plain += compare_left_out(with_scatter(d, seed))->trust == FitModel::jacobs ? 1 : 0;
  }
  EXPECT_GE(plain, 6);
}

TEST(LeftOut, AnotherFileIsLeftOutWhole) {
  // A second print of which all heights are 4 um more: each file predicts the other 4 um off.
  Measurements m;
  m.sources = {"monday.csv", "tuesday.csv"};
  for (const int day : {0, 1}) {
    for (const double dose : {12.0, 15.0, 20.0, 30.0, 40.0}) {
      add_height(m, 1, dose, 100 * std::log(dose / 10) + 4 * day, day);
    }
  }
  const LeftOut left = *compare_left_out(m);
  EXPECT_EQ(left.settings, 5u);
  EXPECT_NEAR(*law_of(left, FitModel::jacobs).other_files_rmse_um, 4, 1e-6);
  // Both days are fitted together: each is 2 um off.
  EXPECT_NEAR(law_of(left, FitModel::jacobs).left_out_rmse_um, 2, 1e-6);
  EXPECT_NEAR(law_of(left, FitModel::jacobs).left_out_bias_um, 0, 1e-6);
}

TEST(LeftOut, SaysWhatCanNotBeCompared) {
  Measurements m = roofs();
  FitOptions held;
  held.fixed["h_um"] = 100;
  EXPECT_FALSE(compare_left_out(m, held));
  m.cured.resize(3);
  EXPECT_FALSE(compare_left_out(m));
  m = roofs();
  for (CuredHeight& c : m.cured) c.blue_mw_cm2 = c.exposure_s = 0;
  const LeftOut doses = *compare_left_out(m);
  EXPECT_THAT(doses.not_compared, ElementsAre(HasSubstr("kinetic: "), HasSubstr("gel-time: ")));
  // Doses are those that light and times gave.
  EXPECT_NEAR(law_of(doses, FitModel::jacobs).left_out_rmse_um,
              law_of(*compare_left_out(roofs()), FitModel::jacobs).left_out_rmse_um, 1e-6);
}

TEST(LeftOut, IsInTheJsonOfAFit) {
  FitResult result = fit(roofs(), FitModel::jacobs);
  EXPECT_FALSE(nlohmann::json::parse(result.to_json()).contains("left_out"));
  result.left_out = compare_left_out(roofs());
  const auto json = nlohmann::json::parse(result.to_json()).at("left_out");
  EXPECT_EQ(json.at("trust"), "jacobs");
  EXPECT_EQ(json.at("settings"), 7);
  EXPECT_EQ(json.at("laws").at(0).at("model"), "jacobs");
  EXPECT_THAT(result.to_text(), HasSubstr("Trust jacobs"));
}

TEST(LeftOut, TimesAtOneIntensityByTheOthers) {
  // Bis-EMA to 15 %, four intensities; reckoned apart by least squares of relative errors.
  TimesToGel t;
  t.sources = {"times.csv"};
  for (const auto& [light, time] :
       {std::pair{0.0114463, 609.96}, {0.104445, 72.685}, {0.34108, 24.9558}, {1.0057, 10.5992}}) {
    t.times.push_back({light, time, {0, 2}});
  }
  const GelTimeFit fit = fit_gel_time(t);
  ASSERT_EQ(fit.left_out.size(), 4u);
  const double told[] = {-0.063, 0.021, 0.039, -0.079}, power[] = {-0.23, 0.09, 0.09, -0.17};
  for (std::size_t k = 0; k < 4; ++k) {
    EXPECT_NEAR(fit.left_out[k].error, told[k], 0.0006) << k;
    EXPECT_NEAR(fit.left_out[k].power_error, power[k], 0.006) << k;
  }
  EXPECT_THAT(fit.to_text(), HasSubstr("trust gel-time"));
  t.times.pop_back();
  EXPECT_TRUE(fit_gel_time(t).left_out.empty());
}

}  // namespace
}  // namespace slicecorr::test
