// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The same unweighted least squares by scipy: both solvers at a tolerance of 1e-12.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "real_files.hpp"
#include "scipy_peer.hpp"
#include "stack_fixture.hpp"

namespace slicecorr::resins {
namespace {

/// Rows of the DA-2 working curve (mm); empty where the data are not there.
Measurements da2() {
  Measurements m;
  std::ifstream in(test::real_file("cure/da2/working_curve_measured.csv"));
  for (std::string line; std::getline(in, line);) {
    double dose = 0, depth_mm = 0;
    if (std::sscanf(line.c_str(), "%lf,%lf", &dose, &depth_mm) != 2) continue;
    CuredHeight c;
    c.dose_mj_cm2 = dose;
    c.height_um = 1000 * depth_mm;
    m.cured.push_back(c);
  }
  return m;
}

TEST(FitPeer, ScipyFindsTheSameParametersAndCovariances) {
  if (!test::have_scipy()) GTEST_SKIP() << "no scipy for " << test::kPython << " (python3-scipy)";
  struct Case {
    std::string name;
    FitModel model;
    Measurements data;
    FitOptions options;
    FitResult ours;
  };
  std::vector<Case> cases;
  for (const test::Design& d : test::published_designs()) {
    if (d.model == FitModel::joint) continue;
    for (unsigned seed = 1; seed <= 3; ++seed) {
      cases.push_back({d.name + fmt::format(", seed {}", seed),
                       d.model,
                       test::with_scatter(d, seed),
                       d.options,
                       {}});
    }
  }
  const Measurements real = da2();
  if (real.cured.empty()) {
  } else {
    EXPECT_EQ(real.cured.size(), 13U);
    cases.push_back({"DA-2", FitModel::jacobs, real, {}, {}});
  }
  nlohmann::json tasks = nlohmann::json::array();
  for (Case& c : cases) {
    c.ours = fit(c.data, c.model, c.options);
    std::vector<double> near;
    for (const Parameter& p : c.ours.parameters) near.push_back(p.value);
    tasks.push_back(test::scipy_task(c.model, c.data, c.options, near, 1));
  }
  const test::TemporaryFolder folder;
  const nlohmann::json theirs = test::run_scipy(tasks, SLICECORR_SOURCE_DIR, folder.path());
  ASSERT_EQ(theirs.size(), cases.size());
  for (std::size_t i = 0; i < cases.size(); ++i) {
    const FitResult& r = cases[i].ours;
    SCOPED_TRACE(fmt::format("{} {}", name_of(cases[i].model), cases[i].name));
    const std::size_t p = r.parameters.size();
    ASSERT_EQ(theirs[i]["values"].size(), p);
    for (std::size_t k = 0; k < p; ++k) {
      const double ratio = r.parameters[k].value / theirs[i]["values"][k].get<double>();
      EXPECT_NEAR(ratio, 1, 1e-6) << r.parameters[k].name;
      for (std::size_t j = 0; j < p; ++j) {
        // In units of the standard errors. Scipy's derivatives are differences of step 1.5e-8,
        // good to about that relative to the value, and a correlation near 1 magnifies it.
        const double scale = r.parameters[k].stderr_ * r.parameters[j].stderr_;
        const double covariance = theirs[i]["covariance"][k][j].get<double>();
        EXPECT_NEAR(r.covariance[k * p + j] / scale, covariance / scale, 1e-4);
      }
    }
  }
}

}  // namespace
}  // namespace slicecorr::resins
