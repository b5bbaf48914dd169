// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Fits against closed forms: distributions, derivatives, exact recovery, textbook regression.
#include "slicecorr/resins/fit.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "fit/heights.hpp"
#include "fit/statistics.hpp"
#include "fit_designs.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::resins {
namespace {

using testing::HasSubstr;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

TEST(Statistics, QuantilesAreThoseOfTables) {
  // Three or more printed decimals of any table of Student's t.
  EXPECT_NEAR(student_t_quantile(0.975, 1), 12.7062, 5e-5);
  EXPECT_NEAR(student_t_quantile(0.975, 5), 2.5706, 5e-5);
  EXPECT_NEAR(student_t_quantile(0.975, 10), 2.2281, 5e-5);
  EXPECT_NEAR(student_t_quantile(0.975, 30), 2.0423, 5e-5);
  EXPECT_NEAR(student_t_quantile(0.975, 120), 1.9799, 5e-5);
  EXPECT_NEAR(student_t_quantile(0.975, 1e8), 1.959964, 1e-6);
  EXPECT_NEAR(student_t_quantile(0.995, 4), 4.6041, 5e-5);
  EXPECT_EQ(student_t_quantile(0.5, 7), 0);
  for (const double freedom : {1.0, 2.0, 3.5, 17.0, 400.0, 1e6}) {
    for (const double p : {1e-9, 0.001, 0.2, 0.5001, 0.9, 0.975, 0.999999}) {
      const double t = student_t_quantile(p, freedom);
      // T² has Fisher's distribution.
      const double tail = std::min(p, 1 - p);
      EXPECT_NEAR(f_exceedance(t * t, 1, freedom) / (2 * tail), 1, 1e-9) << p << " " << freedom;
      EXPECT_NEAR(student_t_quantile(1 - p, freedom) / -t, 1, 1e-6) << p << " " << freedom;
    }
  }
}

TEST(Statistics, FisherIsStudentSquaredAndThatOfTables) {
  EXPECT_NEAR(f_exceedance(4.9646, 1, 10), 0.05, 1e-6);
  EXPECT_NEAR(f_exceedance(3.2592, 4, 12), 0.05, 1e-5);
  EXPECT_NEAR(f_exceedance(1, 7, 7), 0.5, 1e-14);
  EXPECT_EQ(f_exceedance(0, 1, 3), 1);
  EXPECT_EQ(f_exceedance(kInfinity, 1, 3), 0);
  // Of one degree of freedom each the root of F is half of Cauchy's distribution, far in the tail, too.
  for (const double t : {0.1, 1.0, 3.0, 1e6}) {
    EXPECT_NEAR(f_exceedance(t * t, 1, 1) / (2 / M_PI * std::atan(1 / t)), 1, 1e-12) << t;
  }
}

TEST(Statistics, GammaDerivativesHaveTheirKnownValues) {
  EXPECT_NEAR(digamma(1), -0.57721566490153286, 1e-13);
  EXPECT_NEAR(digamma(0.5), -0.57721566490153286 - 2 * std::log(2.0), 1e-13);
  EXPECT_NEAR(trigamma(1), M_PI * M_PI / 6, 1e-12);
  EXPECT_NEAR(trigamma(0.5), M_PI * M_PI / 2, 1e-12);
}

TEST(Statistics, VariancesThatAreAlikeArePooledAndOthersAreKept) {
  const std::vector<double> freedoms(40, 2);
  const VariancePrior alike = variance_prior(std::vector<double>(40, 9.0), freedoms);
  EXPECT_EQ(alike.freedom, kInfinity);
  EXPECT_EQ(alike.variance, 9);
  EXPECT_EQ(alike.moderated(100, 2), 9);
  std::vector<double> different;
  for (int i = 0; i < 40; ++i) different.push_back(i % 2 ? 1.0 : 1e4);
  const VariancePrior apart = variance_prior(different, freedoms);
  EXPECT_LT(apart.freedom, 2);
  EXPECT_LT(apart.moderated(1, 2), 300);
  EXPECT_GT(apart.moderated(1e4, 2), 3000);
}

/// Every derivative of a law against central differences; their error is some eps^(2/3).
void expect_derivatives(Height (*law)(const Slots&, const Exposure&), const Slots& at,
                        const Exposure& e) {
  const Height z = law(at, e);
  for (std::size_t k = 0; k < kSlots; ++k) {
    if (at[k] == 0) {  // of another law
      EXPECT_EQ(z.by[k], 0) << "slot " << k;
      continue;
    }
    const double step = 1e-6 * at[k];
    Slots up = at, down = at;
    up[k] += step;
    down[k] -= step;
    const double difference = (law(up, e).um - law(down, e).um) / (up[k] - down[k]);
    // Heights are differences of some 100 um, and rounded as such.
    const double scale = (std::abs(z.um) + 100) / at[k] + std::abs(z.by[k]);
    EXPECT_NEAR(z.by[k], difference, 3e-8 * scale)
        << "slot " << k << " of " << testing::PrintToString(at) << ", ln t " << e.ln_time;
  }
}

TEST(Heights, DerivativesAreExact) {
  const Slots resin1{408, 0.99, 64, 0.73, 37.8, 1.2}, resin2{1631, 1.03, 238, 4.84, 100, 1.29};
  for (const Slots& law : {resin1, resin2, Slots{750, 1, 100, 1, 100, 1}}) {
    for (const double blue : {5.0, 60.0, 200.0}) {
      for (const double uv : {30.0, 100.0, 400.0}) {
        for (const double time : {0.05, 1.0, 8.0, 30.0, 1e4}) {
          const Exposure e{std::log(blue), std::log(uv), std::log(time)};
          expect_derivatives(cured_height, law, e);
          expect_derivatives(steady_height, law, e);
          expect_derivatives(front_height, law, e);
        }
      }
    }
  }
}

TEST(Heights, AreThoseOfTheCureModel) {
  const Kinetics k{408, 1.2, 64, 0.73, 37.8};
  const Slots law{408, 1.2, 64, 0.73, 37.8, 1.2};
  int fronts = 0;
  for (const double blue : {5.0, 60.0, 200.0}) {
    for (const double uv : {30.0, 100.0, 400.0}) {
      for (const double time : {0.3, 1.0, 8.0, 30.0, 1e4}) {
        const Exposure e{std::log(blue), std::log(uv), std::log(time)};
        EXPECT_NEAR(cured_height(law, e).um, cured_height_um(k, blue, time), 1e-9);
        EXPECT_NEAR(std::max(0.0, steady_height(law, e).um), steady_dead_zone_um(k, blue, uv),
                    1e-9);
        const auto exact = curing_fronts(k, blue, uv, time);
        const Height z = front_height(law, e);
        EXPECT_EQ(z.gels, exact.has_value());
        if (!exact || time < 1.01 * first_gel(k, blue, uv).time_s) continue;
        ++fronts;
        EXPECT_NEAR(std::max(0.0, z.um), exact->front_um, 1e-9);
      }
    }
  }
  EXPECT_GT(fronts, 20);
}

// Through the time of the first gel the height must go on without a step in value or slope, and
// ever upwards to earlier times: that is what leads a solver back.
TEST(Heights, GoOnSmoothlyBeforeTheFirstGel) {
  const Slots law{1631, 1.03, 238, 4.84, 100, 1.29};
  const Kinetics k{1631, 1.29, 238, 4.84, 100};
  const double ln_t0 = std::log(first_gel(k, 100, 100).time_s);
  const auto at = [&](double ln_time) {
    return front_height(law, {std::log(100.0), std::log(100.0), ln_time});
  };
  // The seam lies at s = kLeastS, m s = ln(t / t0).
  const double seam = ln_t0 + 1.29 * kLeastS;
  EXPECT_NEAR(at(seam - 1e-9).um, at(seam + 1e-9).um, 1e-4);
  for (std::size_t slot = 0; slot < kSlots; ++slot) {
    const double before = at(seam - 1e-10).by[slot], after = at(seam + 1e-10).by[slot];
    EXPECT_NEAR(before, after, 1e-5 * std::abs(after) + 1e-12) << slot;
  }
  double last = at(ln_t0 + 2).um;
  for (double x = 1.99; x > -20; x -= 0.01) {
    const double z = at(ln_t0 + x).um;
    ASSERT_TRUE(std::isfinite(z)) << x;
    ASSERT_GT(z, last) << x;
    last = z;
  }
  EXPECT_FALSE(at(ln_t0 - 0.01).gels);
  EXPECT_TRUE(at(ln_t0 + 0.01).gels);
}

// Without scatter, least squares give back what the heights were made of. Their own rounding is
// 1e-16 of a height; the least known combination magnifies it some thousand times.
TEST(Fit, GivesBackWhatHeightsWithoutScatterWereMadeOf) {
  for (const test::Design& d : test::published_designs()) {
    const FitResult r = fit(d.exact, d.model, d.options);
    for (const auto& [name, value] : d.truth) {
      EXPECT_NEAR(r.value(name) / value, 1, 1e-8)
          << name_of(d.model) << " " << d.name << " " << name;
    }
    EXPECT_LT(r.rmse_um, 1e-6) << name_of(d.model) << " " << d.name;
    EXPECT_NEAR(r.r2, 1, 1e-12);
    EXPECT_TRUE(r.outliers.empty()) << name_of(d.model) << ": " << r.outliers.front().reason;
  }
}

/// Jacobs' law is a straight line over ln D: everything has a textbook form.
TEST(Fit, JacobsIsTheRegressionOfTextbooks) {
  const test::Design d = test::jacobs_design("", 69, 170, 0.983);
  const Measurements data = test::with_scatter(d, 7);
  const FitResult r = fit(data, d.model, d.options);
  const double n = static_cast<double>(data.cured.size());
  double mx = 0, my = 0, xx = 0, xy = 0, yy = 0;
  for (const auto& c : data.cured) {
    mx += std::log(c.dose_mj_cm2) / n;
    my += c.height_um / n;
  }
  for (const auto& c : data.cured) {
    const double x = std::log(c.dose_mj_cm2) - mx, y = c.height_um - my;
    xx += x * x;
    xy += x * y;
    yy += y * y;
  }
  const double h = xy / xx, ln_dc = mx - my / h, residual = yy - h * xy;
  const double s2 = residual / (n - 2);
  EXPECT_NEAR(r.value("h_um") / h, 1, 1e-10);
  EXPECT_NEAR(r.value("dc_mj_cm2") / std::exp(ln_dc), 1, 1e-10);
  EXPECT_NEAR(r.r2, 1 - residual / yy, 1e-12);
  EXPECT_NEAR(r.rmse_um, std::sqrt(residual / n), 1e-9);
  EXPECT_NEAR(r.sigma_um, std::sqrt(s2), 1e-9);
  EXPECT_EQ(r.n, 54);
  EXPECT_EQ(r.free_parameters, 2);

  const Parameter& height = *r.find("h_um");
  EXPECT_NEAR(height.stderr_ / std::sqrt(s2 / xx), 1, 1e-9);
  const double factor = std::exp(student_t_quantile(0.975, n - 2) * std::sqrt(s2 / xx) / h);
  EXPECT_NEAR(height.ci95[0] * factor / h, 1, 1e-9);
  EXPECT_NEAR(height.ci95[1] / (h * factor), 1, 1e-9);
  // Variance of -intercept / slope by the delta method; mean and slope are independent.
  const double to_dc = mx - ln_dc;
  const Parameter& dose = *r.find("dc_mj_cm2");
  EXPECT_NEAR(dose.stderr_ / dose.value / (std::sqrt(s2 * (1 / n + to_dc * to_dc / xx)) / h), 1,
              1e-9);
  EXPECT_NEAR(r.covariance.at(0), height.stderr_ * height.stderr_, 1e-9 * r.covariance.at(0));
  EXPECT_NEAR(r.covariance.at(3), dose.stderr_ * dose.stderr_, 1e-9 * r.covariance.at(3));
  EXPECT_NEAR(r.covariance.at(1) / r.covariance.at(2), 1, 1e-12);

  double leverages = 0;
  for (const FitPoint& p : r.points) {
    const double x = std::log(p.dose_mj_cm2) - mx;
    const double leverage = 1 / n + x * x / xx;
    EXPECT_NEAR(p.leverage, leverage, 1e-12);
    leverages += p.leverage;
    const double e = p.measured_um - p.predicted_um;
    const double others = (residual - e * e / (1 - leverage)) / (n - 3);
    EXPECT_NEAR(p.studentised, e / std::sqrt(others * (1 - leverage)), 1e-8);
    EXPECT_NEAR(p.cooks_distance, e * e * leverage / (2 * s2 * std::pow(1 - leverage, 2)), 1e-8);
  }
  EXPECT_NEAR(leverages, 2, 1e-10);
  // The band of a straight line.
  const double x = std::log(100.0) - mx;
  EXPECT_NEAR(confidence_um(r, 20, 0, 5),
              student_t_quantile(0.975, n - 2) * std::sqrt(s2 * (1 / n + x * x / xx)), 1e-8);
  EXPECT_NEAR(predict_um(r, 20, 0, 5), my + h * x, 1e-8);
}

// F of one parameter is the square of its t, where the law is linear in disguise.
TEST(Fit, ReciprocityTestIsTheRegressionOfTextbooks) {
  const test::Design d = test::kinetic_design("", 148, 238, 0.91, 0.994);
  const Measurements data = test::with_scatter(d, 3);
  const FitResult kinetic = fit(data, FitModel::kinetic), jacobs = fit(data, FitModel::jacobs);
  ASSERT_TRUE(kinetic.reciprocity && jacobs.reciprocity);
  const double n = 54, sk = n * std::pow(kinetic.rmse_um, 2), sj = n * std::pow(jacobs.rmse_um, 2);
  for (const Reciprocity& r : {*kinetic.reciprocity, *jacobs.reciprocity}) {
    EXPECT_NEAR(r.f / ((sj - sk) / (sk / (n - 3))), 1, 1e-7);
    EXPECT_NEAR(r.p_value / f_exceedance(r.f, 1, n - 3), 1, 1e-9);
    EXPECT_NEAR(r.aic_kinetic, n * std::log(sk / n) + 8 + 40 / (n - 5), 1e-7);
    EXPECT_NEAR(r.aic_jacobs, n * std::log(sj / n) + 6 + 24 / (n - 4), 1e-7);
    EXPECT_NEAR(r.m, kinetic.value("m"), 1e-8);
    EXPECT_NEAR(r.m_ci95[0], kinetic.find("m")->ci95[0], 1e-8);
    EXPECT_FALSE(r.holds);
    EXPECT_THAT(r.verdict, HasSubstr("Reciprocity does not hold"));
    EXPECT_THAT(r.verdict, HasSubstr(fmt::format("{:.2f} times the dose",
                                                 std::pow(0.25, 1 - kinetic.value("m")))));
  }
  const auto reciprocal = test::jacobs_design("", 69, 170, 0.983);
  const FitResult holds = fit(test::with_scatter(reciprocal, 1), FitModel::kinetic);
  EXPECT_TRUE(holds.reciprocity.value().holds);
  EXPECT_THAT(holds.reciprocity->verdict, HasSubstr("Reciprocity holds"));
}

// R² and RMSE are about unweighted heights, whatever the weights.
TEST(Fit, QualityOfAJointFitIsThatOfItsKinds) {
  const test::Design d = test::joint_design();
  const FitResult r = fit(test::with_scatter(d, 5), d.model, d.options);
  EXPECT_EQ(r.cured.n, 54);
  EXPECT_EQ(r.dead_zones.n, 36);
  const double squares = r.cured.squares + r.dead_zones.squares;
  EXPECT_NEAR(r.r2, 1 - squares / (r.cured.total + r.dead_zones.total), 1e-12);
  EXPECT_NEAR(r.rmse_um, std::sqrt(squares / 90), 1e-9);
  // Each kind counts by the scatter that it shows.
  double cured_weight = 0, zone_weight = 0;
  for (const FitPoint& p : r.points) (p.is_dead_zone ? zone_weight : cured_weight) = p.weight;
  EXPECT_NEAR(zone_weight / cured_weight, r.cured.sigma_um / r.dead_zones.sigma_um, 1e-6);
}

TEST(Fit, BandHoldsTheDeadZoneLawsToo) {
  for (const test::Design& d :
       {test::steady_design(), test::transient_design(), test::joint_design()}) {
    const FitResult r = fit(test::with_scatter(d, 2), d.model, d.options);
    for (const FitPoint& p : r.points) {
      const double half = confidence_um(r, p.blue_mw_cm2, p.uv_mw_cm2, p.exposure_s);
      // Leverage is the variance of the prediction over that of a measurement.
      const double freedom = r.n - r.free_parameters;
      const double variance = std::pow(half / student_t_quantile(0.975, freedom), 2);
      double weighted = 0;
      for (const FitPoint& q : r.points) {
        weighted += std::pow(q.weight * (q.measured_um - q.predicted_um), 2) / freedom;
      }
      EXPECT_NEAR(variance * p.weight * p.weight / weighted, p.leverage, 1e-6 * p.leverage)
          << name_of(d.model);
    }
  }
  const FitResult jacobs = fit(test::jacobs_design("", 69, 170, 0.99).exact, FitModel::jacobs);
  EXPECT_THROW(predict_um(jacobs, 20, 10, 5), InputError);
  EXPECT_THROW(jacobs.value("m"), InputError);
}

}  // namespace
}  // namespace slicecorr::resins
