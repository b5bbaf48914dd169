// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Looking at a print: images that a camera of the test's own sees of one that was simulated.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <numbers>
#include <random>
#include <string>

#include "run_program.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/tomo/look.hpp"
#include "slicecorr/tomo/print.hpp"
#include "stack_fixture.hpp"
#include "tomo_jobs.hpp"

namespace slicecorr::tomo {
namespace {

using testing::HasSubstr;

constexpr int kViews = 48;

class TomoLook : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    PrintOptions options;
    options.angles = 60;
    options.solve.method = Method::osmo;
    // A bar and a disc beside it: what gels first is not what gels last.
    Box<std::uint8_t> part{2, 33, 33, std::vector<std::uint8_t>(2 * 33 * 33)};
    for (int z = 0; z < 2; ++z) {
      for (int y = 0; y < 33; ++y) {
        for (int x = 0; x < 33; ++x) {
          const bool bar = x >= 8 && x < 14 && y >= 8 && y < 25;
          if (bar || std::hypot(x - 21, y - 16) < 3.5) part.values[part.at(z, y, x)] = 255;
        }
      }
    }
    // Little light: the print takes many turns, and a look in the middle sees some of it.
    Printer printer = bench_printer();
    printer.calibration.back().intensity_mw_cm2 = 0.5;
    job_ = new TomoJob(solve_print(part, 0.25, printer, bench_resin(1), options).job);
    dose_ = new Box<float>(dose_of(*job_));
  }
  static void TearDownTestSuite() {
    delete job_;
    delete dose_;
  }

  /// Images of the vial, in which voxels that have so much of their planned dose at this turn take 0.3 of
  /// the light for each mm: pixels along straight lines, half a voxel at a time, with noise.
  void photograph(const std::string& name, double share, double turns, double noise) const {
    const std::string folder = folder_ / name;
    std::filesystem::create_directories(folder);
    std::mt19937 random(7);
    std::normal_distribution<double> any(0, noise);
    const Printer& p = job_->printer;
    const double pitch = p.pixel_x_um * 1e-3, h = 0.25;
    const int n = dose_->nx;
    for (int k = 0; k < kViews; ++k) {
      // The vial turns clockwise: th grows.
      const double th = 2 * std::numbers::pi * k / kViews;
      GreyImage image{p.width_px, p.height_px, {}};
      for (int row = 0; row < p.height_px; ++row) {
        const double height = ((p.height_px - 1) / 2.0 - row) * p.pixel_y_um * 1e-3;
        const auto z = static_cast<int>(std::floor(height / h + dose_->nz / 2.0));
        for (int column = 0; column < p.width_px; ++column) {
          double taken = 0;
          const double t = (column - (p.width_px - 1) / 2.0) * pitch;
          for (double u = -4; u < 4 && z >= 0 && z < dose_->nz; u += h / 2) {
            // t = x cos + y sin, u = -x sin + y cos.
            const double x = t * std::cos(th) - u * std::sin(th),
                         y = t * std::sin(th) + u * std::cos(th);
            const auto i = static_cast<int>(std::lround(x / h + (n - 1) / 2.0)),
                       j = static_cast<int>(std::lround(y / h + (n - 1) / 2.0));
            if (i < 0 || j < 0 || i >= n || j >= n) continue;
            const double has = dose_->values[dose_->at(z, j, i)] * share * turns / job_->turns;
            if (has >= 20) taken += 0.3 * h / 2;
          }
          const double seen = 200 * std::exp(-taken) + any(random);
          image.pixels.push_back(
              static_cast<std::uint8_t>(std::clamp(std::lround(seen), 1L, 255L)));
        }
      }
      const auto png = encode_png(image);
      test::write_file(folder + fmt::format("/{}.png", k), {png.begin(), png.end()});
    }
  }
  LookOptions at(double turns) const {
    return {.before = folder_ / "before", .now = folder_ / "now", .turns = turns};
  }

  static TomoJob* job_;
  static Box<float>* dose_;
  test::TemporaryFolder folder_;
};
TomoJob* TomoLook::job_ = nullptr;
Box<float>* TomoLook::dose_ = nullptr;

/// 0.85 of the planned light came, seen when a good deal of the part has gelled: the share is found within
/// what one voxel in a hundred of the part that gelled or not makes of it.
TEST_F(TomoLook, SaysHowMuchOfThePlanHasComeAndWhenToStop) {
  const double share = 0.85;
  ASSERT_GE(job_->turns, 6);
  const double turns = std::round(1.05 * job_->turns);
  photograph("before", 0, turns, 3);
  photograph("now", share, turns, 3);
  const Look look = look_at(*job_, *dose_, at(turns));
  EXPECT_GT(look.agreement, 0.7);
  // The truth, by counting.
  std::size_t gelled = 0;
  double weakest = 1e9;
  for (std::size_t k = 0; k < dose_->values.size(); ++k) {
    gelled += dose_->values[k] * share * turns / job_->turns >= 20 ? 1 : 0;
    if (job_->part.values[k] == 255) weakest = std::min<double>(weakest, dose_->values[k]);
  }
  ASSERT_GT(gelled, 50U);
  EXPECT_LT(look.part_gelled, look.part);
  EXPECT_NEAR(static_cast<double>(look.gelled), static_cast<double>(gelled),
              0.1 * static_cast<double>(gelled));
  EXPECT_NEAR(look.share, share, 0.05 * share);
  EXPECT_LE(look.least_share, look.share);
  EXPECT_GE(look.most_share, look.share);
  EXPECT_NEAR(look.stop_turn, 20 * job_->turns / (share * weakest), 0.05 * look.stop_turn);
  EXPECT_GT(look.stop_turn, turns);
  EXPECT_GT(look.void_turn, 0);
  // With a camera a quarter of a turn ahead the same images are of other angles.
  LookOptions beside = at(turns);
  beside.camera_deg = 90;
  EXPECT_THROW(look_at(*job_, *dose_, beside), InputError);
}

/// What is seen is what takes light: 0.3 of it for each mm, in the middle of the bar.
TEST_F(TomoLook, ReconstructsWhatTakesLight) {
  const double turns = 1.3 * job_->turns;
  photograph("before", 0, turns, 0);
  photograph("now", 1, turns, 0);
  LookOptions options = at(turns);
  options.steps = 100;
  const Look look = look_at(*job_, *dose_, options);
  double sum = 0;
  for (int y = 12; y < 21; ++y) sum += look.seen.values[look.seen.at(1, y, 10)] / 9;
  // Levels of 200 round to 1 in 400 of the light that a pixel has lost; the edge of what gelled blurs.
  EXPECT_NEAR(sum, 0.3, 0.03);
  // To look at: what is seen has its line where what gelled ends, half of what it takes.
  EXPECT_NEAR(look.line_per_mm, 0.15, 0.03);
  const std::vector<PrintSection> drawn = sections_of(look, *job_, *dose_, turns);
  ASSERT_EQ(drawn.size(), 4U);
  const PrintSection &come = drawn[2], &seen = drawn[3];
  ASSERT_EQ(seen.axis, Axis::z);
  ASSERT_EQ(come.width, seen.width);
  std::size_t apart = 0, gelled = 0;
  for (std::size_t k = 0; k < seen.dose.size(); ++k) {
    gelled += come.dose[k] >= come.gel_dose ? 1 : 0;
    EXPECT_EQ(seen.target[k], come.dose[k] >= come.gel_dose ? 255 : 0);
    apart += (seen.dose[k] >= seen.gel_dose) != (seen.target[k] == 255) ? 1 : 0;
  }
  // At most the voxels around both parts, 6 x 17 and a disc of 3.5, half of which lie on either side.
  EXPECT_GT(gelled, 100U);
  EXPECT_LT(apart, 2 * (6 + 17) / 2 + 11);
  EXPECT_LE(look.stop_turn, turns);
}

TEST_F(TomoLook, RefusedByName) {
  photograph("before", 0, 1, 0);
  photograph("now", 0, 1, 3);
  const auto refusal = [&](const TomoJob& job, const LookOptions& options) -> std::string {
    try {
      look_at(job, *dose_, options);
    } catch (const InputError& e) {
      return e.what();
    }
    return "";
  };
  EXPECT_THAT(refusal(*job_, at(3)), HasSubstr("nothing of the plan is to be seen"));
  EXPECT_THAT(refusal(*job_, at(0)), HasSubstr("0 turns"));
  LookOptions odd = at(3);
  odd.camera_deg = 10;
  EXPECT_THAT(refusal(*job_, odd), HasSubstr("a whole number"));
  std::filesystem::remove(folder_ / "now/7.png");
  EXPECT_THAT(refusal(*job_, at(3)), HasSubstr("holds 47 PNG images"));
  TomoJob other = *job_;
  other.resin.inhibition_resupply_mj_cm3_s = 0.01;
  EXPECT_THAT(refusal(other, at(3)), HasSubstr("does not grow evenly"));
  other = *job_;
  other.insert = other.part;
  EXPECT_THAT(refusal(other, at(3)), HasSubstr("an insert hides"));
  other = *job_;
  other.printer.optics->kind = OpticsKind::pinhole;
  EXPECT_THAT(refusal(other, at(3)), HasSubstr("parallel lines"));
}

using TomoLookProgram = TomoLook;
TEST_F(TomoLookProgram, TellsTheTurn) {
  const double turns = job_->turns;
  photograph("before", 0, turns, 2);
  photograph("now", 0.95, turns, 2);
  write_job(folder_ / "a.frames", *job_);
  test::RunOptions options;
  options.folder = folder_.path();
  const test::RunResult r = test::run_program(
      {SLICECORR_BIN_DIR "/slicecorr", "--quiet", "tomo", "look", "a.frames", "--before", "before",
       "--now", "now", "--turns", fmt::format("{}", job_->turns), "--seen", "seen.npy", "--picture",
       "seen.png", "--json", "-"},
      options);
  ASSERT_EQ(r.exit_code, 0) << r.err;
  const auto j = nlohmann::json::parse(r.out);
  EXPECT_NEAR(j["share_of_plan"].get<double>(), 0.95, 0.05);
  EXPECT_GT(j["stop_turn"].get<double>(), 0.9 * turns);
  EXPECT_EQ(read_dose_npy(folder_ / "seen.npy").nx, dose_->nx);
  EXPECT_GT(std::filesystem::file_size(folder_ / "seen.png"), 1000U);
}

}  // namespace
}  // namespace slicecorr::tomo
