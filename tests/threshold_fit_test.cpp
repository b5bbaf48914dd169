// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Times to gel with a threshold.
#include "slicecorr/resins/threshold_fit.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <random>

#include "run_program.hpp"
#include "slicecorr/error.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::resins {
namespace {

/// t = E/(i - i0) exactly, in any order: both figures back, and what they are in a volume.
TEST(ThresholdFit, ExactTimesGiveExactFigures) {
  TimesToGel data;
  data.sources = {"times.csv"};
  for (const double i : {1.6, 0.4, 0.8, 1.2, 0.3}) data.times.push_back({i, 24.0 / (i - 0.2), {}});
  const ThresholdFit fit = fit_threshold(data);
  EXPECT_NEAR(fit.dose_mj_cm2.value, 24, 1e-9);
  EXPECT_NEAR(fit.threshold_mw_cm2.value, 0.2, 1e-11);
  EXPECT_LT(fit.worst_error, 1e-12);
  EXPECT_NEAR(fit.gel_dose_mj_cm3(0.55), 13.2, 1e-9);
  EXPECT_NEAR(fit.resupply_mj_cm3_s(0.55), 0.11, 1e-11);
  EXPECT_TRUE(fit.warnings.empty());
  // Without one, or where times fall faster than light rises, it is 0.
  for (TimeToGel& t : data.times) t.time_s = 24 / t.intensity_mw_cm2;
  const ThresholdFit none = fit_threshold(data);
  EXPECT_NEAR(none.threshold_mw_cm2.value, 0, 1e-9);
  for (TimeToGel& t : data.times) t.time_s = 24 / std::sqrt(t.intensity_mw_cm2);
  EXPECT_TRUE(fit_threshold(data).at_bound);
  EXPECT_THAT(fit_threshold(data).warnings.front(), testing::HasSubstr("came out at 0"));
  data.times.resize(1);
  EXPECT_THROW(fit_threshold(data), InputError);
}

/// Rates that scatter by 5 %: intervals of 95 % hold the truth about as often (of 400, four standard
/// deviations of a binomial are 17).
TEST(ThresholdFit, IntervalsHoldTheTruth) {
  std::mt19937 random(3);
  std::normal_distribution<double> off(1, 0.05);
  int dose = 0, threshold = 0;
  constexpr int kTries = 400;
  for (int k = 0; k < kTries; ++k) {
    TimesToGel data;
    data.sources = {"times.csv"};
    for (const double i : {0.3, 0.4, 0.6, 0.8, 1.2, 1.6, 2.4}) {
      data.times.push_back({i, 24.0 / ((i - 0.2) * off(random)), {}});
    }
    const ThresholdFit fit = fit_threshold(data);
    dose += fit.dose_mj_cm2.ci95[0] <= 24 && 24 <= fit.dose_mj_cm2.ci95[1];
    threshold += fit.threshold_mw_cm2.ci95[0] <= 0.2 && 0.2 <= fit.threshold_mw_cm2.ci95[1];
  }
  EXPECT_NEAR(dose, 0.95 * kTries, 17);
  EXPECT_NEAR(threshold, 0.95 * kTries, 17);
}

TEST(ThresholdFit, AsAUserCallsIt) {
  const test::TemporaryFolder folder;
  test::write_file(
      folder / "times.csv",
      test::to_bytes("intensity_mw_cm2,time_s\n0.4,120\n0.8,40\n1.2,24\n1.6,17.142857\n"));
  test::RunOptions options;
  options.folder = folder.path();
  const auto fit = [&](std::vector<std::string> more) {
    std::vector<std::string> words{SLICECORR_BIN_DIR "/resinctl", "fit", "times.csv", "--model"};
    words.insert(words.end(), more.begin(), more.end());
    return test::run_program(words, options);
  };
  const test::RunResult r =
      fit({"gel-time", "--threshold", "--resin", "kelly-bpagda-pegda", "--json", "-"});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  const auto j = nlohmann::json::parse(r.out);
  EXPECT_NEAR(j["parameters"]["threshold_mw_cm2"]["value"].get<double>(), 0.2, 1e-6);
  EXPECT_NEAR(j["resin"]["inhibition_resupply_mj_cm3_s"].get<double>(), 0.11, 1e-6);
  EXPECT_NEAR(j["resin"]["gel_dose_mj_cm3"].get<double>(), 0.55 * 24, 1e-4);
  // What reading the times told is told on.
  const std::string rows = "0.4,120,red\n0.8,40,red\n1.2,24,red\n1.6,17.142857,red\n";
  test::write_file(folder / "times.csv",
                   test::to_bytes("intensity_mw_cm2,time_s,colour\n" + rows + rows));
  const test::RunResult twice = fit({"gel-time", "--threshold"});
  EXPECT_NE(twice.out.find("4 of 8 measurements repeat earlier ones digit for digit"),
            std::string::npos)
      << twice.out;
  EXPECT_NE(twice.out.find("column 'colour' is passed over"), std::string::npos) << twice.out;
  EXPECT_EQ(fit({"jacobs", "--threshold"}).exit_code, 2);
  EXPECT_EQ(fit({"gel-time", "--threshold", "-o", "x.toml"}).exit_code, 2);
}

}  // namespace
}  // namespace slicecorr::resins
