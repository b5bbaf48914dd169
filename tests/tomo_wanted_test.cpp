// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Grey targets: doses that are wanted voxel by voxel, with tolerances and weights.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <random>
#include <string>
#include <vector>

#include "run_program.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/tomo/print.hpp"
#include "slicecorr/tomo/read_wanted.hpp"
#include "stack_fixture.hpp"
#include "tomo_definitions.hpp"
#include "tomo_jobs.hpp"

namespace slicecorr::tomo {
namespace {

using testing::HasSubstr;

constexpr double kGel = 20;

Box<float> numbers(int nz, int side, float value) {
  return {nz, side, side,
          std::vector<float>(static_cast<std::size_t>(nz) * static_cast<std::size_t>(side) *
                                 static_cast<std::size_t>(side),
                             value)};
}

/// A square of 13 voxels of which the left half wants `left` and the right one `right`.
WantedValues two_doses(float left, float right, float tolerance) {
  WantedValues v{numbers(1, 33, 0), {1, 1, 1, {tolerance}}, {}};
  for (int y = 10; y < 23; ++y) {
    for (int x = 10; x < 23; ++x) v.wanted.values[v.wanted.at(0, y, x)] = x < 16 ? left : right;
  }
  return v;
}

PrintOptions at_48(const DoseBands& wanted) {
  PrintOptions options;
  options.angles = 48;
  options.wanted = wanted;
  return options;
}

Print print_of(const DoseBands& wanted, const Resin& resin) {
  return solve_print(part_of(wanted, kGel), 0.25, bench_printer(), resin, at_48(wanted));
}

/// min dose / least over max dose / most, once more.
double slack_of(const Box<float>& dose, const DoseBands& wanted) {
  double least = 1e9, most = 0;
  for (int y = 0; y < dose.ny; ++y) {
    for (int x = 0; x < dose.nx; ++x) {
      const std::size_t i = dose.at(0, y, x);
      if (std::hypot(x - 16, y - 16) > 16 || !(wanted.weight_at(i) > 0)) continue;
      const double d = dose.values[i];
      if (wanted.least.values[i] > 0) least = std::min(least, d / wanted.least.values[i]);
      most = std::max(most, d / wanted.most.values[i]);
    }
  }
  return least / most;
}

TEST(TomoWanted, CurvesSayWhichDosesAConversionTakes) {
  const std::vector<CurvePoint> curve{{10, 0.1}, {20, 0.3}, {60, 0.7}};
  WantedValues v{{1, 1, 5, {0, 0.2F, 0.3F, 0.5F, 0.7F}}, {1, 1, 1, {0.1F}}, {}};
  const DoseBands doses = wanted_doses(v, curve, kGel);
  const std::vector<double> least{0, 10, 15, 30, 50}, most{20, 20, 30, 50, kNoMostDose};
  for (std::size_t i = 0; i < 5; ++i) {
    EXPECT_NEAR(doses.least.values[i], least[i], 1e-4) << i;
    EXPECT_NEAR(doses.most.values[i] / most[i], 1, 1e-6) << i;
  }
  // 20 gel: void and what wants 10 to 20 do not; 15 to 30 may or may not.
  EXPECT_EQ(part_of(doses, kGel).values, (std::vector<std::uint8_t>{0, 0, 128, 255, 255}));
  v.weight = {1, 1, 5, {1, 1, 1, 0, 2}};
  EXPECT_EQ(part_of(wanted_doses(v, curve, kGel), kGel).values[3], 128);
}

TEST(TomoWanted, WhatIsNoTargetIsRefusedByVoxel) {
  const auto refused = [](const WantedValues& v, const std::vector<CurvePoint>& curve,
                          const std::string& text) {
    try {
      wanted_doses(v, curve, kGel);
      ADD_FAILURE() << text;
    } catch (const InputError& e) {
      EXPECT_THAT(e.what(), HasSubstr(text));
    }
  };
  const WantedValues good{{1, 1, 2, {0, 30}}, {1, 1, 1, {3}}, {}};
  WantedValues v = good;
  v.wanted.values[1] = -1;
  refused(v, {}, "voxel 1, 0, 0: -1 is wanted");
  v = good;
  v.tolerance.values[0] = 0;
  refused(v, {}, "tolerance of 0");
  v = good;
  v.tolerance = {1, 1, 3, {1, 1, 1}};
  refused(v, {}, "the tolerance has 3 x 1 x 1 voxels");
  v = good;
  v.weight = {1, 1, 2, {1, -2}};
  refused(v, {}, "has a weight of -2");
  refused(good, {{1, 0.1}, {2, 0.5}}, "30 is wanted; expected what the curve has, 0.1 to 0.5");
  refused(good, {{1, 0.1}, {1, 0.5}}, "does not rise");
}

/// Two doses side by side, each to a fifth, are met; the direct sum says so once more, and the job has them.
TEST(TomoWanted, TwoDosesSideBySide) {
  const DoseBands wanted = wanted_doses(two_doses(36, 27, 6), {}, kGel);
  const Print print = print_of(wanted, bench_resin(1));
  ASSERT_TRUE(print.figures.wanted.has_value());
  EXPECT_TRUE(print.figures.feasible()) << print.figures.to_json();
  const Box<float> dose = dose_of(print.job);
  const double slack = slack_of(dose, wanted);
  EXPECT_GE(slack, 1);
  EXPECT_NEAR(print.figures.wanted->slack, slack, 1e-5);
  EXPECT_GE(dose.values[dose.at(0, 16, 12)], 30);
  EXPECT_LE(dose.values[dose.at(0, 16, 20)], 33);
  EXPECT_EQ(print.figures.wanted->voxels, print.figures.metrics.gel + print.figures.metrics.empty);
  test::TemporaryFolder folder;
  const std::string path = folder / "o.frames";
  write_job(path, print.job);
  const TomoJob back = read_job(path);
  EXPECT_EQ(back.wanted.least.values, wanted.least.values);
  EXPECT_EQ(back.wanted.most.values, wanted.most.values);
  EXPECT_TRUE(back.wanted.weight.values.empty());
  EXPECT_EQ(back.wanted.slack_bound, print.job.wanted.slack_bound);
  const PrintFigures again = figures_of(back, dose_of(back), back.part);
  EXPECT_EQ(again.wanted->within, again.wanted->voxels);
}

/// No light, whichever, has more slack than was proven; what was found is near.
TEST(TomoWanted, TheBoundOfSlackHoldsForAnyLight) {
  // To 4 %: too narrow for a step of a half.
  const DoseBands wanted = wanted_doses(two_doses(50, 32, 1.5), {}, kGel);
  const Print print = print_of(wanted, bench_resin(1));
  const WantedFigures& figures = *print.figures.wanted;
  EXPECT_FALSE(print.figures.feasible());
  EXPECT_THAT(std::string(print.figures.fault()), HasSubstr("tolerance"));
  ASSERT_TRUE(std::isfinite(figures.slack_bound));
  EXPECT_LE(figures.slack, figures.slack_bound);
  EXPECT_GE(figures.slack, 0.5 * figures.slack_bound);
  // Light near to what was found, and any.
  std::mt19937 random(3);
  TomoJob job = print.job;
  for (int trial = 0; trial < 12; ++trial) {
    for (std::uint16_t& level : job.levels) {
      const int by = static_cast<int>(random() % (trial < 6 ? 9 : 256)) - (trial < 6 ? 4 : 0);
      level = static_cast<std::uint16_t>(trial < 6 ? std::clamp(level + by, 0, 255) : by);
    }
    EXPECT_LE(slack_of(dose_of(job), wanted), figures.slack_bound) << trial;
  }
}

/// Of two that can't both be met the one that weighs more is; what weighs nothing is not judged.
TEST(TomoWanted, WeightsDecide) {
  const auto off_left = [](float weight_left, float weight_right) {
    WantedValues v = two_doses(50, 32, 1);
    v.weight = numbers(1, 33, 1);
    for (int y = 10; y < 23; ++y) {
      for (int x = 10; x < 23; ++x) {
        v.weight.values[v.weight.at(0, y, x)] = x < 16 ? weight_left : weight_right;
      }
    }
    const DoseBands wanted = wanted_doses(v, {}, kGel);
    const Print print = print_of(wanted, bench_resin(1));
    const Box<float> dose = dose_of(print.job);
    EXPECT_NEAR(print.figures.wanted->slack, slack_of(dose, wanted), 1e-5);
    double squares = 0;
    for (int y = 10; y < 23; ++y) {
      for (int x = 10; x < 16; ++x) {
        const double off = std::max(0.0, std::abs(dose.values[dose.at(0, y, x)] - 50.0) - 1);
        squares += off * off;
      }
    }
    return squares;
  };
  EXPECT_LT(off_left(100, 0), 0.2 * off_left(1, 100));
}

TEST(TomoWanted, WhatIsNotCountedIsRefused) {
  const DoseBands wanted = wanted_doses(two_doses(50, 32, 6), {}, kGel);
  const auto refused = [&](const Resin& resin, const PrintOptions& options,
                           const std::string& text) {
    try {
      check_print(part_of(wanted, kGel), 0.25, bench_printer(), resin, options);
      ADD_FAILURE() << text;
    } catch (const InputError& e) {
      EXPECT_THAT(e.what(), HasSubstr(text));
    }
  };
  Resin resin = bench_resin(1);
  PrintOptions options = at_48(wanted);
  options.solve.method = Method::osmo;
  refused(resin, options, "the ladder alone looks for");
  options = at_48(wanted);
  options.wanted.most.nz = 2;
  refused(resin, options, "wanted doses have 33 x 33 x 2 voxels");
  resin.inhibition_resupply_mj_cm3_s = 0.01;
  refused(resin, at_48(wanted), "inhibitor comes back");
}

std::string text_of(const std::string& path) {
  const auto bytes = test::read_file(path);
  return {bytes.begin(), bytes.end()};
}

/// Through the program: images of conversions, a curve, and a job that was changed.
TEST(TomoWantedProgram, ImagesOfConversions) {
  test::TemporaryFolder folder;
  const auto write = [&](const std::string& name, const std::string& text) {
    test::write_file(folder / name, test::to_bytes(text));
  };
  write("bench.toml", test::bench_printer_toml());
  write("resin.toml", test::bench_resin_toml("1"));
  GreyImage image{17, 17, std::vector<std::uint8_t>(17 * 17)};
  for (int y = 5; y < 12; ++y) {
    for (int x = 5; x < 12; ++x) {
      image.pixels[static_cast<std::size_t>(17 * y + x)] = x < 8 ? 153 : 128;
    }
  }
  std::filesystem::create_directory(folder / "wanted");
  test::write_file(folder / "wanted/0.png", encode_png(image));
  write("curve.csv", "dose_mj_cm3,conversion\n5,0.1\n20,0.4\n40,0.6\n80,0.8\n");
  const auto call = [&](std::vector<std::string> words) {
    test::RunOptions options;
    options.folder = folder.path();
    words.insert(words.begin(), {SLICECORR_BIN_DIR "/slicecorr", "--quiet", "tomo"});
    return test::run_program(words, options);
  };
  const std::vector<std::string> solve{
      "solve",      "--wanted", "wanted",    "--white",    "1",       "--tolerance", "0.08",
      "--voxel-mm", "0.25",     "--printer", "bench.toml", "--resin", "resin.toml",  "--angles",
      "48",         "-o",       "o.frames",  "--json",     "-"};
  std::vector<std::string> conversions = solve;
  conversions.insert(conversions.end(), {"--conversion-curve", "curve.csv"});
  const test::RunResult solved = call(conversions);
  ASSERT_EQ(solved.exit_code, 0) << solved.out << solved.err;
  const auto verified = call({"verify", "o.frames", "--json", "-"});
  EXPECT_EQ(verified.exit_code, 0) << verified.err;
  const auto figures = nlohmann::json::parse(verified.out)["wanted"];
  EXPECT_EQ(figures["within"], figures["voxels"]);
  EXPECT_GE(figures["slack"].get<double>(), 1);
  const test::RunResult page = call({"report", "o.frames", "-o", "o.html"});
  EXPECT_EQ(page.exit_code, 0) << page.err;
  EXPECT_THAT(text_of(folder / "o.html"), HasSubstr("within their tolerance"));
  const auto refused = [&](std::vector<std::string> words, const std::string& without,
                           const std::string& text) {
    if (!without.empty()) {
      const auto at = std::find(words.begin(), words.end(), without);
      words.erase(at, at + 2);
    }
    const test::RunResult result = call(words);
    EXPECT_EQ(result.exit_code, 2);
    EXPECT_THAT(result.err, HasSubstr(text));
  };
  refused(conversions, "--white", "is no .npy");
  refused(conversions, "--tolerance", "expected --tolerance");
  refused(conversions, "--wanted", "wanted doses (--wanted)");
  write("curve.csv", "dose,conversion\n5,0.1\n");
  refused(conversions, "", "has other columns");
}

}  // namespace
}  // namespace slicecorr::tomo
