// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Targets: what their pictures show, and what their pages say.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "refusal.hpp"
#include "run_program.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/tomo/targets.hpp"
#include "slicecorr/vial.hpp"
#include "tomo_jobs.hpp"

namespace slicecorr::tomo {
namespace {

namespace fs = std::filesystem;
using test::refusal;
using testing::HasSubstr;

Printer projector() {
  Printer p = bench_printer();
  p.width_px = 640;
  p.height_px = 480;
  p.pixel_x_um = p.pixel_y_um = 25;
  p.optics->axis_right_px = 10.25;
  p.optics->axis_up_px = -20;
  return p;
}

std::uint8_t at(const GreyImage& image, int column, int row) {
  return image.pixels[static_cast<std::size_t>(row) * static_cast<std::size_t>(image.width_px) +
                      static_cast<std::size_t>(column)];
}

TEST(TomoTargets, TheCrossLiesOnTheAxis) {
  Printer p = projector();
  p.optics->tilt_deg = 2;
  const GreyImage cross = target_pictures(TargetKind::axis, p).at(0).image;
  ASSERT_EQ(cross.width_px, 640);
  ASSERT_EQ(cross.height_px, 480);
  // The middle of the light of a row is where the axis is, at the height of that row.
  for (const int row : {3, 100, 400, 476}) {
    double sum = 0, moment = 0;
    for (int column = 0; column < 640; ++column) {
      sum += at(cross, column, row);
      moment += 1.0 * column * at(cross, column, row);
    }
    // Optical axis: row 239.5 + 20. It leans to the right at the top.
    const double wanted = 319.5 + 10.25 + (259.5 - row) * std::tan(2 * 3.14159265358979 / 180);
    EXPECT_NEAR(moment / sum, wanted, 0.01) << row;
    EXPECT_NEAR(sum, 255, 1) << row;
  }
  EXPECT_NEAR(at(cross, 5, 259) + at(cross, 5, 260), 255, 1);
}

TEST(TomoTargets, TheCombAndTheGridCountPixels) {
  const GreyImage comb = target_pictures(TargetKind::axis, projector()).at(1).image;
  const GreyImage grid = target_pictures(TargetKind::scale, projector()).at(0).image;
  for (int column = 0; column < 640; ++column) {
    const bool tooth = column % 10 == 0, thick = column % 100 < 3;
    EXPECT_EQ(at(comb, column, 20) > 0, tooth || thick) << column;
    EXPECT_EQ(at(grid, column, 75) > 0, column % 50 == 0 || thick) << column;
  }
  for (int row = 120; row < 480; ++row) {
    EXPECT_EQ(at(grid, 75, row) > 0, row % 50 == 0 || row % 100 < 3) << row;
  }
}

TEST(TomoTargets, TheBarGoesWithThePin) {
  for (const TurnDirection direction :
       {TurnDirection::clockwise, TurnDirection::counterclockwise}) {
    Printer p = projector();
    p.rotation->direction = direction;
    const auto pictures = target_pictures(TargetKind::direction, p);
    ASSERT_EQ(pictures.size(), 4U);
    for (int k = 0; k < 4; ++k) {
      // A pin at (0, -r) at first, which the projector sees at t = x cos th + y sin th.
      const double th = (direction == TurnDirection::clockwise ? 1 : -1) * k * 3.14159265358979 / 2;
      const double pin_mm = -0.7 * p.vial->inner_mm * std::sin(th);
      const int column = static_cast<int>(std::lround(329.75 + pin_mm / 0.025));
      const int other = static_cast<int>(std::lround(329.75 - pin_mm / 0.025));
      const GreyImage& image = pictures[static_cast<std::size_t>(k)].image;
      EXPECT_EQ(at(image, column, 400), 255) << k;
      if (k % 2 == 1) {
        EXPECT_EQ(at(image, other, 400), 0) << k;
      }
    }
  }
}

TEST(TomoTargets, FocusHasLinesOfEachWidthAndLightIsEven) {
  const GreyImage focus = target_pictures(TargetKind::focus, projector()).at(0).image;
  // Runs of light along the middle of the upright pairs, by their width.
  std::array<int, 9> runs{};
  for (int row = 0; row < 480; ++row) {
    std::array<int, 9> here{};
    int run = 0;
    for (int column = 0; column <= 640; ++column) {
      if (column < 640 && at(focus, column, row) > 0) {
        ++run;
      } else {
        if (run > 0 && run < 9) ++here[static_cast<std::size_t>(run)];
        run = 0;
      }
    }
    for (std::size_t w = 1; w < 9; ++w) runs[w] = std::max(runs[w], here[w]);
  }
  for (const std::size_t width : {1U, 2U, 3U, 4U, 6U, 8U}) EXPECT_GE(runs[width], 5) << width;
  const auto light = target_pictures(TargetKind::light, projector());
  ASSERT_EQ(light.size(), 9U);
  EXPECT_EQ(light.front().name, "light-000");
  EXPECT_EQ(light.back().name, "light-255");
  for (const TargetPicture& p : light) {
    EXPECT_EQ(*std::min_element(p.image.pixels.begin(), p.image.pixels.end()),
              *std::max_element(p.image.pixels.begin(), p.image.pixels.end()));
  }
  EXPECT_EQ(light.back().image.pixels.front(), 255);
  // Of one bit there are two levels.
  Printer p = projector();
  p.bit_depth = 1;
  p.calibration = {{0, 0}, {1, 2}};
  EXPECT_EQ(target_pictures(TargetKind::light, p).size(), 2U);
}

/// The pictures one after the other leave in each square the light of its row for the time of its column.
TEST(TomoTargets, ADoseMatrixIsLightTimesTime) {
  const Printer p = projector();
  const std::vector<TargetPicture> all = target_pictures(TargetKind::dose, p);
  const std::vector<int> levels = target_levels(p);
  const std::vector<double> times = target_times();
  ASSERT_EQ(all.size(), times.size());
  ASSERT_EQ(levels.size(), 8U);
  EXPECT_EQ(levels.front(), 255);
  EXPECT_NEAR(levels.back(), 25.5, 1);  // the calibration is straight
  EXPECT_NEAR(times.back() / times.front(), 20, 1e-9);
  std::vector<double> dose(all[0].image.pixels.size(), 0.0);
  double before = 0;
  for (std::size_t k = 0; k < all.size(); ++k) {
    for (std::size_t i = 0; i < dose.size(); ++i) {
      dose[i] += all[k].image.pixels[i] * (times[k] - before);
    }
    before = times[k];
  }
  std::set<long> wanted, found;
  for (const int level : levels) {
    for (const double t : times) wanted.insert(std::lround(1e4 * level * t));
  }
  for (const double d : dose) {
    if (d > 0) found.insert(std::lround(1e4 * d));
  }
  ASSERT_EQ(found.size(), wanted.size());
  for (auto a = found.begin(), b = wanted.begin(); a != found.end(); ++a, ++b) {
    EXPECT_NEAR(static_cast<double>(*a), static_cast<double>(*b), 2);
  }
}

TEST(TomoTargets, DiscsOfAThresholdStandOnTheAxis) {
  Printer p = projector();
  p.optics->axis_right_px = 12;
  const GreyImage image = target_pictures(TargetKind::threshold, p).front().image;
  const std::vector<int> levels = target_levels(p);
  const int step = p.height_px / static_cast<int>(levels.size());
  for (std::size_t k = 0; k < levels.size(); ++k) {
    double sum = 0, columns = 0;
    for (int row = static_cast<int>(k) * step; row < static_cast<int>(k + 1) * step; ++row) {
      for (int column = 0; column < p.width_px; ++column) {
        const int value = image.pixels[static_cast<std::size_t>(row * p.width_px + column)];
        if (value == 0) continue;
        EXPECT_EQ(value, levels[k]);
        sum += 1;
        columns += column;
      }
    }
    ASSERT_GT(sum, 0);
    EXPECT_NEAR(columns / sum, (p.width_px - 1) / 2.0 + 12, 0.5);
  }
}

TEST(TomoTargets, WhatCanHoldNoneIsRefused) {
  Printer p = projector();
  p.height_px = 40;
  EXPECT_THAT(refusal([&] { target_pictures(TargetKind::focus, p); }),
              HasSubstr("640 x 40 pixels; expected 64 a side"));
  p = projector();
  p.rotation.reset();
  EXPECT_THAT(refusal([&] { target_pictures(TargetKind::axis, p); }), HasSubstr("[rotation]"));
}

class TomoTargetProgram : public testing::Test {
 protected:
  void SetUp() override { fs::create_directories(folder_); }
  void TearDown() override { fs::remove_all(folder_); }
  fs::path folder_ =
      fs::path(testing::TempDir()) / ("slicecorr-targets-" + std::to_string(::getpid()));
};

TEST_F(TomoTargetProgram, WritesPicturesAndAPage) {
  for (const std::string kind :
       {"axis", "focus", "scale", "direction", "light", "dose", "threshold"}) {
    const auto result =
        test::run_program({SLICECORR_BIN_DIR "/slicecorr", "tomo", "target", kind, "--printer",
                           "webber-vial", "-o", (folder_ / kind).string()});
    ASSERT_EQ(result.exit_code, 0) << result.err;
    std::ostringstream page;
    page << std::ifstream(folder_ / kind / (kind + ".html")).rdbuf();
    EXPECT_THAT(page.str(), HasSubstr("Into the vial")) << kind;
    EXPECT_THAT(page.str(), HasSubstr("Enter it")) << kind;
    for (const TargetPicture& p : target_pictures(kind == "axis"        ? TargetKind::axis
                                                  : kind == "focus"     ? TargetKind::focus
                                                  : kind == "scale"     ? TargetKind::scale
                                                  : kind == "direction" ? TargetKind::direction
                                                  : kind == "dose"      ? TargetKind::dose
                                                  : kind == "threshold" ? TargetKind::threshold
                                                                        : TargetKind::light,
                                                  load_printer("webber-vial"))) {
      std::ostringstream png;
      png << std::ifstream(folder_ / kind / (p.name + ".png"), std::ios::binary).rdbuf();
      const auto bytes = encode_png(p.image);
      EXPECT_EQ(png.str(), std::string(bytes.begin(), bytes.end())) << p.name;
    }
  }
  const auto wrong = test::run_program(
      {SLICECORR_BIN_DIR "/slicecorr", "tomo", "target", "moon", "--printer", "webber-vial"});
  EXPECT_EQ(wrong.exit_code, 2);
}

}  // namespace
}  // namespace slicecorr::tomo
