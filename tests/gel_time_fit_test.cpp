// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Fits of times to gel: A and B from measured times and from working curves, resin files made of them.

#include "slicecorr/resins/gel_time_fit.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <random>

#include "fit/heights.hpp"
#include "gel_time_models.hpp"
#include "real_files.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/resins/exchange.hpp"
#include "slicecorr/resins/fit.hpp"
#include "slicecorr/resins/plots.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::test {
namespace {

using namespace resins;
using testing::AllOf;
using testing::HasSubstr;

TimesToGel times_of(const GelTime& g, const std::vector<double>& intensities) {
  TimesToGel t;
  t.sources = {"times.csv"};
  for (const double i : intensities) t.times.push_back({i, gel_time_s(g, i), {0, 2}});
  return t;
}

TEST(GelTimeFit, FindsWhatTimesWereMadeOf) {
  const GelTimeFit fit = fit_gel_time(times_of(kHydrogel, {0.5, 2, 10, 50, 200}));
  EXPECT_NEAR(fit.a.value / kHydrogel.A, 1, 1e-9);
  EXPECT_NEAR(fit.b.value / kHydrogel.B, 1, 1e-9);
  EXPECT_LT(fit.worst_error, 1e-12);
  EXPECT_GT(fit.exponent_error, 0.05);
  EXPECT_TRUE(fit.warnings.empty());
}

TEST(GelTimeFit, ErrorsAreThoseOfRepeatedMeasurements) {
  // Times with 3 % of scatter, again and again: the spread of B is what one fit says of it, and intervals
  // hold the truth 95 % of the time. Of 8 degrees of freedom the mean of an estimated deviation is
  // sqrt(2/8) Gamma(4.5)/Gamma(4) of the true one. Both to four deviations of so many rounds.
  std::mt19937 random(8);
  std::normal_distribution<double> scatter(0, 0.03);
  const std::vector<double> at{0.3, 0.3, 1, 3, 10, 10, 30, 100, 300, 300};
  double sum = 0, squares = 0, said = 0;
  int inside = 0;
  constexpr int rounds = 4000;
  for (int k = 0; k < rounds; ++k) {
    TimesToGel t = times_of(kHydrogel, at);
    for (TimeToGel& one : t.times) one.time_s *= 1 + scatter(random);
    const GelTimeFit fit = fit_gel_time(t);
    sum += fit.b.value;
    squares += fit.b.value * fit.b.value;
    said += fit.b.stderr_ / rounds;
    inside += fit.b.ci95[0] <= kHydrogel.B && kHydrogel.B <= fit.b.ci95[1];
  }
  const double spread = std::sqrt(squares / rounds - std::pow(sum / rounds, 2));
  EXPECT_NEAR(said / spread, 0.5 * std::tgamma(4.5) / std::tgamma(4), 4 / std::sqrt(2.0 * rounds));
  EXPECT_NEAR(static_cast<double>(inside) / rounds, 0.95, 4 * std::sqrt(0.05 * 0.95 / rounds));
}

TEST(GelTimeFit, LawsOfOnePartAreTold) {
  const GelTimeFit jacobs = fit_gel_time(times_of({30, 0}, {1, 3, 10}));
  EXPECT_NEAR(jacobs.a.value, 30, 1e-9);
  EXPECT_LT(jacobs.b.value, 1e-9);
  TimesToGel steep = times_of({30, 0}, {1, 3, 10});
  steep.times[2].time_s *= 0.8;
  const GelTimeFit held = fit_gel_time(steep);
  EXPECT_TRUE(held.b.at_bound);
  EXPECT_EQ(held.b.value, 0);
  EXPECT_THAT(held.warnings.front(), HasSubstr("Jacobs"));
  TimesToGel flat = times_of({0, 30}, {1, 3, 10});
  flat.times[2].time_s *= 1.3;
  EXPECT_TRUE(fit_gel_time(flat).a.at_bound);
}

class GelTimeFiles : public ::testing::Test {
 protected:
  std::string put(const std::string& name, const std::string& text) const {
    write_file(folder_ / name, to_bytes(text));
    return folder_ / name;
  }
  TemporaryFolder folder_;
};

TEST_F(GelTimeFiles, TablesOfTimes) {
  const std::string plain = put("a.csv", "# times\nintensity_mw_cm2,time_s\n1,10\n10,2\n");
  EXPECT_TRUE(is_table_of_times(plain));
  EXPECT_EQ(read_times_to_gel({plain}).times.size(), 2U);
  const std::string heights =
      put("h.csv", "intensity_mw_cm2,exposure_s,cured_height_um\n1,10,100\n");
  EXPECT_FALSE(is_table_of_times(heights));
  const std::string many = put(
      "m.csv",
      "irradiance_mW_cm2,conversion,time_s,dose_mJ_cm2\n1,0.1,10,10\n10,0.1,2,20\n1,0.2,15,15\n");
  EXPECT_EQ(read_times_to_gel({many}, 0.1).times.size(), 2U);
  const auto complaint = [](const std::string& path, std::optional<double> conversion = {}) {
    try {
      fit_gel_time(read_times_to_gel({path}, conversion));
    } catch (const InputError& e) {
      return std::string(e.what());
    }
    return std::string("none");
  };
  EXPECT_THAT(complaint(many), AllOf(HasSubstr("--conversion"), HasSubstr("0.1, 0.2")));
  EXPECT_THAT(complaint(many, 0.3), HasSubstr("0.1, 0.2"));
  EXPECT_THAT(complaint(plain, 0.3), HasSubstr("conversion"));
  EXPECT_THAT(complaint(many, 0.2), HasSubstr("two intensities"));
  EXPECT_THAT(complaint(put("x.csv", "intensity_mw_cm2,time_s\n1,-3\n")), HasSubstr("-3"));
  EXPECT_THAT(complaint(put("y.csv", "intensity_mw_cm2,time_s\n1,nan\n")), HasSubstr("nan"));
  // As in tables of heights, what other columns say counts for nothing, and that is told.
  const GelTimeFit coloured = fit_gel_time(
      read_times_to_gel({put("z.csv", "intensity_mw_cm2,time_s,colour\n1,10,red\n10,2,green\n")}));
  EXPECT_THAT(coloured.warnings, testing::Contains(HasSubstr("column 'colour' is passed over")));
  EXPECT_THAT(complaint(put("e.csv", "intensity_mw_cm2,time_s\n")), HasSubstr("e.csv"));
  // Repeats are measurements; a table that was pasted once more is told, and a file given twice refused.
  const std::string rows = "1,10\n2,6\n4,3.5\n10,2\n";
  const auto repeats = [&](const std::string& text) {
    return read_times_to_gel({put("p.csv", "intensity_mw_cm2,time_s\n" + text)}).warnings;
  };
  EXPECT_TRUE(repeats(rows + "1,10\n1,10\n").empty());
  EXPECT_THAT(repeats(rows + rows), testing::Contains(HasSubstr("4 of 8 measurements repeat")));
  try {
    read_times_to_gel({plain, plain});
    FAIL() << "a file counted twice";
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr("a.csv: is given twice"));
  }
}

TEST(GelTimeFit, MeasuredConversionsOfBisEma) {
  const std::string path = real_file("cure/bisema/time_to_conversion.csv");
  SLICECORR_NEEDS_FILE(path);
  // Worked out apart: by relative least squares in NumPy. Four intensities each.
  struct Row {
    double conversion, a, b, worst;
  };
  for (const Row& row : {Row{0.05, 5.715, 1.504, 0.038}, Row{0.1, 6.056, 2.952, 0.0281},
                         Row{0.3, 8.421, 8.949, 0.0199}}) {
    const GelTimeFit fit = fit_gel_time(read_times_to_gel({path}, row.conversion));
    EXPECT_NEAR(fit.a.value, row.a, 6e-4);
    EXPECT_NEAR(fit.b.value, row.b, 6e-4);
    EXPECT_NEAR(fit.worst_error, row.worst, 2e-4);
    EXPECT_EQ(fit.times.size(), 4U);
  }
  EXPECT_NEAR(fit_gel_time(read_times_to_gel({path}, 0.1)).exponent, 0.929, 5e-4);
}

Measurements heights_of(const GelTime& g, double height_um, double scatter_um) {
  std::mt19937 random(3);
  std::normal_distribution<double> scatter(0, scatter_um > 0 ? scatter_um : 1);
  Measurements m;
  m.sources = {"heights.csv"};
  for (const double i : {1.0, 4.0, 20.0, 100.0}) {
    for (const double times : {1.5, 3.0, 6.0, 15.0}) {
      const double t = times * gel_time_s(g, i);
      const double z = height_um * std::log(i / gel_intensity_mw_cm2(g, t));
      m.cured.push_back({i, t, i * t, z + (scatter_um > 0 ? scatter(random) : 0), 0, {0, 2}});
    }
  }
  return m;
}

TEST(GelTimeFit, FindsWhatWorkingCurvesWereMadeOf) {
  const GelTime g{40, 9};
  const FitResult exact = fit(heights_of(g, 300, 0), FitModel::gel_time);
  EXPECT_NEAR(exact.value("h_um"), 300, 1e-4);
  EXPECT_NEAR(exact.value("gel_a_mj_cm2"), 40, 1e-4);
  EXPECT_NEAR(exact.value("gel_b_sqrt_mw_cm2_s"), 9, 1e-5);
  const FitResult r = fit(heights_of(g, 300, 5), FitModel::gel_time);
  for (const auto& [name, truth] :
       {std::pair{"h_um", 300.0}, {"gel_a_mj_cm2", 40.0}, {"gel_b_sqrt_mw_cm2_s", 9.0}}) {
    const Parameter& p = *r.find(name);
    EXPECT_LT(std::abs(p.value - truth), 3 * p.stderr_) << name;
    EXPECT_LT(p.stderr_, 0.2 * truth) << name;
  }
  EXPECT_EQ(r.covariance.size(), 9U);
  // The kinetic law can't follow all four intensities.
  EXPECT_LT(r.rmse_um, fit(heights_of(g, 300, 5), FitModel::kinetic).rmse_um);
  const std::string picture = working_curve_svg(r, 5, "resin");
  EXPECT_THAT(picture, AllOf(HasSubstr("gel-time"), HasSubstr("I/ig(t)")));
}

TEST(GelTimeFit, DerivativesOfTheHeight) {
  // By central differences, whose error is of the square of the step.
  for (const GelTime& g : {GelTime{12, 7}, {60, 0.1}, {0.1, 9}}) {
    Slots law{};
    law[kHeight] = 200;
    law[kGelA] = g.A;
    law[kGelB] = g.B;
    const Exposure e{std::log(30.0), 0, std::log(4.0)};
    const Height z = cured_height(law, e);
    EXPECT_NEAR(z.um, 200 * std::log(30 / gel_intensity_mw_cm2(g, 4)), 1e-9);
    for (const Slot slot : {kHeight, kGelA, kGelB}) {
      constexpr double step = 1e-5;
      Slots more = law, less = law;
      more[slot] *= 1 + step;
      less[slot] *= 1 - step;
      const double slope =
          (cured_height(more, e).um - cured_height(less, e).um) / (2 * step * law[slot]);
      EXPECT_NEAR(z.by[slot] / slope, 1, 1e-7) << slot;
    }
  }
}

TEST(GelTimeRecord, FilesOfFitsAndLawsAreReadAsTheyWereMade) {
  const GelTime g{40, 9};
  const FitResult r = fit(heights_of(g, 300, 0), FitModel::gel_time);
  const std::string text = record_text_from_fit("made", {r}, nullptr);
  const Resin made = parse_resin(text, "made.toml");
  EXPECT_EQ(made.model, CureModelKind::gel_time);
  EXPECT_NEAR(made.gel_a_mj_cm2, 5 * 40, 1e-3);
  EXPECT_NEAR(make_kinetics(made, false, false).gel_time.B, 9, 1e-5);
  const ResinRecord record = parse_record(text, "made.toml");
  EXPECT_THAT(export_record(record, "json", 0, 0), HasSubstr("gel_a_mj_cm2"));
  EXPECT_THAT(export_record(record, "csv", 0, 0), HasSubstr("gel_b_sqrt_mw_cm2_s"));
  EXPECT_THAT(export_record(record, "prusaslicer", 50, 10), HasSubstr("time to gel"));
  EXPECT_THAT(record_svg(record), HasSubstr("time to gel"));
  for (const CureModelKind kind :
       {CureModelKind::jacobs, CureModelKind::kinetic, CureModelKind::gel_time}) {
    const CureLaw law{kind, 0.9, 50, g};
    const Resin resin = parse_resin(
        record_text_with_law("other", law, {{"derived", "a \"test\""}}, record), "o.toml");
    EXPECT_EQ(resin.model, kind);
    EXPECT_NEAR(resin.absorbance_height10_um / made.absorbance_height10_um, 1, 1e-6);
    EXPECT_NEAR(resin.dose_factor, 5, 1e-9);
  }
}

}  // namespace
}  // namespace slicecorr::test
