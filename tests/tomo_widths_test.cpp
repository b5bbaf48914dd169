// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Diffusion of dose from widths of one print.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <string>

#include "run_program.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/tomo/print.hpp"
#include "slicecorr/tomo/widths.hpp"
#include "stack_fixture.hpp"
#include "tomo_jobs.hpp"

namespace slicecorr::tomo {
namespace {

using testing::HasSubstr;

/// A ridge along y that falls by 4 mJ/cm³ a mm: its width at the gel dose is a straight line's.
TEST(TomoWidths, OfARidge) {
  Sampling sampling{.voxel_mm = 0.25, .slices = 3};
  sampling.middle_z_mm = 1;
  Box<float> dose{3, 33, 33, {}};
  for (int z = 0; z < 3; ++z) {
    for (int y = 0; y < 33; ++y) {
      for (int x = 0; x < 33; ++x) {
        dose.values.push_back(static_cast<float>(24 - 4 * std::abs((x - 16) * 0.25 - 0.5)));
      }
    }
  }
  MeasuredWidth w{{0.6, -1, 1.2}, 0, 1};
  EXPECT_NEAR(width_of(dose, sampling, 20, w), 2, 1e-6);
  EXPECT_NEAR(width_of(dose, sampling, 21.3, w), 2 * 2.7 / 4, 1e-6);
  EXPECT_EQ(width_of(dose, sampling, 25, w), 0);
  w.along = 1;
  EXPECT_TRUE(std::isnan(width_of(dose, sampling, 20, w)));
  w.at_mm[2] = 0;
  EXPECT_THROW(width_of(dose, sampling, 20, w), InputError);
}

class TomoDiffusion : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    Box<std::uint8_t> part{3, 33, 33, std::vector<std::uint8_t>(3 * 33 * 33)};
    for (int z = 0; z < 3; ++z) {
      for (int y = 8; y < 25; ++y) {
        for (int x = 6; x < 27; ++x) {
          if (x < 9 || (x >= 12 && x < 17) || x >= 20) part.values[part.at(z, y, x)] = 255;
        }
      }
    }
    PrintOptions options;
    options.angles = 45;
    options.solve.steps = 30;
    Printer dim = bench_printer();
    dim.calibration.back().intensity_mw_cm2 = 0.5;
    job_ = new TomoJob(solve_print(part, 0.25, dim, bench_resin(1), options).job);
    // As long as bars stand when their dose has spread.
    job_->turns = static_cast<int>(std::ceil(1.25 * job_->turns));
  }
  static void TearDownTestSuite() { delete job_; }
  /// What a calliper reads, to 5 um, of a print whose dose has spread by so many voxels.
  static std::vector<MeasuredWidth> measured(double voxels, double& diffusion) {
    const double sigma = voxels * 0.25e-3;
    diffusion = sigma * sigma / (2 * job_->turns * job_->printer.rotation->turn_s());
    TomoJob with = *job_;
    with.resin.dose_diffusion_m2_s = diffusion;
    const Box<float> dose = dose_of(with);
    std::vector<MeasuredWidth> all;
    for (const int y : {12, 16, 20}) {
      for (const int middle : {7, 14, 23}) {
        const float* const row = &dose.values[dose.at(1, y, 0)];
        const auto end = [&](int step) {
          int x = middle;
          while (row[x + step] >= 20) x += step;
          return x + step * (row[x] - 20.0) / (row[x] - row[x + step]);
        };
        if (row[middle] < 20) continue;
        const double width = std::round((end(1) - end(-1)) * 0.25 / 0.005) * 0.005;
        all.push_back({{(middle - 16) * 0.25, (y - 16) * 0.25, 0}, 0, width});
      }
    }
    return all;
  }
  static TomoJob* job_;
};
TomoJob* TomoDiffusion::job_ = nullptr;

/// Rounding to 5 um is 1.4 um rms: spread is found to some hundredths of a voxel.
TEST_F(TomoDiffusion, IsFoundFromWidths) {
  double truth = 0;
  const auto widths = measured(0.8, truth);
  ASSERT_GE(widths.size(), 5U);
  const DiffusionFit fit = fit_diffusion(*job_, widths);
  EXPECT_NEAR(fit.spread_mm, 0.8 * 0.25, 0.03 * 0.25);
  EXPECT_NEAR(fit.diffusion_m2_s / truth, 1, 0.08);
  EXPECT_LT(fit.rms_mm, 0.003);
  EXPECT_GT(fit.without_rms_mm, 4 * fit.rms_mm);
  EXPECT_FALSE(fit.at_bound);
}

TEST_F(TomoDiffusion, RefusedByName) {
  EXPECT_THROW(fit_diffusion(*job_, {}), InputError);
  const std::vector<MeasuredWidth> beside{{{0, 3.5, 0}, 0, 1}};
  EXPECT_THROW(fit_diffusion(*job_, beside), InputError);
}

using TomoDiffusionProgram = TomoDiffusion;
TEST_F(TomoDiffusionProgram, TakesATable) {
  const test::TemporaryFolder folder;
  write_job(folder / "a.frames", *job_);
  double truth = 0;
  std::string table = "x_mm,y_mm,z_mm,along,width_mm\n";
  for (const MeasuredWidth& w : measured(0.8, truth)) {
    table += fmt::format("{},{},0,x,{}\n", w.at_mm[0], w.at_mm[1], w.width_mm);
  }
  test::write_file(folder / "widths.csv", test::to_bytes(table));
  test::RunOptions options;
  options.folder = folder.path();
  const auto run = [&](const std::string& file) {
    return test::run_program({SLICECORR_BIN_DIR "/slicecorr", "--quiet", "tomo", "diffusion",
                              "a.frames", file, "--json", "-"},
                             options);
  };
  const test::RunResult r = run("widths.csv");
  ASSERT_EQ(r.exit_code, 0) << r.err;
  const auto j = nlohmann::json::parse(r.out);
  EXPECT_NEAR(j["dose_diffusion_m2_s"].get<double>() / truth, 1, 0.08);
  for (const auto& [text, expected] :
       {std::pair{"x_mm,y_mm,z_mm,width_mm\n0,0,0,1\n", "has no column 'along'"},
        {"x_mm,y_mm,z_mm,along,width_mm\n0,0,0,u,1\n", "along is 'u'"},
        {"x_mm,y_mm,z_mm,along,width_mm\n0,0,0,x,-1\n", "not above 0"},
        {"x_mm,y_mm,z_mm,along,width_mm\n", "has no width"}}) {
    test::write_file(folder / "bad.csv", test::to_bytes(text));
    const test::RunResult bad = run("bad.csv");
    EXPECT_EQ(bad.exit_code, 2);
    EXPECT_THAT(bad.err, HasSubstr(expected));
  }
}

}  // namespace
}  // namespace slicecorr::tomo
