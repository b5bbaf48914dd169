// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Frames where the axis leans and wobbles and the projector shines unevenly: what is shown is what
// arrives.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <functional>
#include <numbers>

#include "refusal.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/tomo/print.hpp"
#include "slicecorr/tomo/shown_light.hpp"
#include "slicecorr/vial.hpp"
#include "tomo_jobs.hpp"

namespace slicecorr::tomo {
namespace {

using test::refusal;
using testing::HasSubstr;

/// Frames of 64 x 64 pixels of 0.25 mm, larger than the vial.
Printer wide_printer() {
  Printer p = bench_printer();
  p.width_px = p.height_px = 64;
  return p;
}

void wobble(Printer& p, double amplitude_px) {
  for (int k = 0; k < 36; ++k) {
    const double a = k * std::numbers::pi / 18;
    p.rotation->wobble.push_back(
        {10.0 * k, amplitude_px * (std::sin(a) + 0.7 * std::sin(3 * a + 1) + 0.4 * std::sin(7 * a)),
         0});
  }
}

/// Part of several slices: a bar off the axis, and a void beside it.
Box<std::uint8_t> bars(int slices) {
  Box<std::uint8_t> part{slices, 33, 33,
                         std::vector<std::uint8_t>(static_cast<std::size_t>(slices) * 33 * 33)};
  for (int z = 0; z < slices; ++z) {
    for (int y = 8; y < 25; ++y) {
      for (int x = 8; x < 25; ++x) {
        const bool slot = x > 14 && x < 18 && y > 11 && y < 22;
        if (!slot) part.values[part.at(z, y, x)] = 255;
      }
    }
  }
  return part;
}

/// Light that is found in a second.
PrintOptions few_steps() {
  PrintOptions options;
  options.solve.rungs = {0.9, 0.8, 0.7};
  options.solve.most_steps = 60;
  options.solve.proof_steps = 0;
  return options;
}

Box<float> dose_of_print(const Print& print) { return dose_of(print.job); }

/// Greatest difference over the greatest dose.
double difference(const Box<float>& a, const Box<float>& b) {
  double most = 0, off = 0;
  for (std::size_t i = 0; i < a.values.size(); ++i) {
    most = std::max(most, static_cast<double>(a.values[i]));
    off = std::max(off, std::abs(static_cast<double>(a.values[i]) - b.values[i]));
  }
  return off / most;
}

TEST(TomoPlaces, FramesAreTurnedAndMovedWithTheAxis) {
  Printer p = wide_printer();
  p.optics->axis_right_px = 1.5;
  p.optics->axis_up_px = -2;
  p.optics->tilt_deg = 3;
  wobble(p, 1);
  for (AxisWobble& w : p.rotation->wobble) w.up_px = 2.4;
  const Sampling sampling{0.5, 5, 36};
  const Bench b = make_bench(p, bench_resin(), sampling);
  ASSERT_TRUE(b.places.moved());
  for (const int m : {0, 7, 35}) {
    for (int z = 0; z < 5; ++z) {
      for (const int i : {0, 20, b.grid.pixels - 1}) {
        // Where the image shows the place in the frame of the axis.
        const double x = (b.window.first_column + i - 31.5 - 1.5) * 0.25, height = (z - 2) * 0.5;
        const ImagePlace at = image_place(p, {x, height});
        const double column = at.column + p.rotation->wobble[m].right_px - b.window.first_column;
        EXPECT_NEAR(b.places.column_of(m, i, z), column, 1e-9);
        EXPECT_NEAR(b.places.pixel_of(m, column, z), i, 1e-9);
        // Rows go by whole rows: 2 of 2.4.
        const int row = static_cast<int>(std::lround(at.row - 2)),
                  near = static_cast<int>(std::lround(column));
        if (near < 0 || near >= b.grid.pixels) continue;
        EXPECT_EQ(b.places.lit_by(m, b.window.first_column + near, row).row, z);
      }
    }
  }
  // A pixel's ray is that of its place in the frame of the axis.
  Printer straight = p;
  straight.optics->tilt_deg = 0;
  const ImagePlace there = image_place(straight, {2, 1}), turned = image_place(p, {2, 1});
  EXPECT_NE(there.column, turned.column);
  EXPECT_NEAR(chief_ray(p, turned.column, turned.row).x_mm, 2, 1e-12);
  EXPECT_NEAR(chief_ray(p, turned.column, turned.row).z_mm, 1, 1e-12);
  EXPECT_NEAR(chief_ray(straight, there.column, there.row).x_mm, 2, 1e-12);
}

TEST(TomoPlaces, WobbleGoesByTheStageAndRoundTheTurn) {
  Rotation r{25, TurnDirection::counterclockwise, 60};
  EXPECT_EQ(wobble_at(r, 77).right_px, 0);
  r.wobble = {{30, 1, -1}, {90, 3, 0}, {330, -1, 2}};
  EXPECT_DOUBLE_EQ(wobble_at(r, 60).right_px, 2);
  EXPECT_DOUBLE_EQ(wobble_at(r, 60).up_px, -0.5);
  EXPECT_DOUBLE_EQ(wobble_at(r, 0).right_px, 0);
  EXPECT_DOUBLE_EQ(wobble_at(r, 360 + 345).right_px, -0.5);
  EXPECT_DOUBLE_EQ(wobble_at(r, -15).right_px, -0.5);
  EXPECT_DOUBLE_EQ(wobble_at(r, 90).right_px, 3);
  r.wobble = {{10, 1.5, 0}};
  EXPECT_DOUBLE_EQ(wobble_at(r, 200).right_px, 1.5);
}

// Frames of a stage that wobbles by whole columns and rows are those of a steady one, moved.
TEST(TomoWobble, OfWholePixelsMovesFrames) {
  for (const TurnDirection direction :
       {TurnDirection::clockwise, TurnDirection::counterclockwise}) {
    Printer p = wide_printer();
    p.rotation->direction = direction;
    TomoJob steady = random_job(p, 5, 36);
    Printer moved_printer = p;
    for (int k = 0; k < 36; ++k) {
      moved_printer.rotation->wobble.push_back(
          {10.0 * k, static_cast<double>(k % 5 - 2), static_cast<double>(k % 3 - 1)});
    }
    TomoJob moved = steady;
    moved.printer = moved_printer;
    const Bench a = make_bench(p, steady.resin, steady.sampling),
                b = make_bench(moved_printer, moved.resin, moved.sampling);
    moved.levels.assign(b.grid.blocks() * b.grid.light_of_block(), 0);
    for (int m = 0; m < 36; ++m) {
      const int right = a.frame_of_angle(m) % 5 - 2;
      for (int i = 0; i < a.grid.pixels; ++i) {
        for (int z = 0; z < 5; ++z) {
          moved.levels[b.grid.pixel(m, a.window.first_column + i + right - b.window.first_column,
                                    z)] = steady.levels[a.grid.pixel(m, i, z)];
        }
      }
    }
    // Where an axis moves, columns are summed by quarters: their light dims from middle to middle as it
    // does in between, to (0.25/mm 0.25 mm)^2 / 8 and to as much more near the wall.
    // And by directions of a quarter of a voxel's way, where others take two: 0.1 %, as tests of what was
    // shown say.
    EXPECT_LT(difference(dose_of(steady), dose_of(moved)), 1.1e-2) << name_of(direction);
    // As files: the images themselves are moved, and read back.
    const auto folder = std::filesystem::temp_directory_path() /
                        ("slicecorr-tomo-wobble-" + std::to_string(::getpid()));
    std::filesystem::create_directories(folder);
    const std::string path = (folder / "moved.frames").string();
    write_job(path, moved);
    const TomoJob back = read_job(path);
    EXPECT_EQ(back.printer, moved.printer);
    EXPECT_EQ(back.levels, moved.levels);
    std::filesystem::remove_all(folder);
  }
}

TEST(TomoWobble, FramesGoWithTheAxisByPartsOfAColumn) {
  const Box<std::uint8_t> part = bars(1);
  const Print still = solve_print(part, 0.25, wide_printer(), bench_resin(), few_steps());
  const double steady = still.figures.metrics.contrast;
  const Bench from = make_bench(wide_printer(), bench_resin(), still.job.sampling);
  for (const double amplitude : {0.3, 1.0, 3.0}) {
    Printer p = wide_printer();
    wobble(p, amplitude);
    const Print print = solve_print(part, 0.25, p, bench_resin(), few_steps());
    EXPECT_TRUE(print.figures.feasible()) << amplitude;
    EXPECT_EQ(print.figures.metrics.ver, 0);
    EXPECT_GT(print.figures.metrics.contrast, 1.1) << amplitude;
    EXPECT_LT(print.figures.metrics.contrast, steady + 1e-3);
    // The same frames by whole columns have less, and those that do not know of it far less.
    const Bench bench = make_bench(p, bench_resin(), print.job.sampling);
    for (const bool whole : {true, false}) {
      TomoJob other = print.job;
      other.turns = still.job.turns;
      std::fill(other.levels.begin(), other.levels.end(), 0);
      for (int m = 0; m < from.grid.angles; ++m) {
        const auto right =
            whole ? static_cast<int>(std::lround(bench.places.column_of(m, 0, 0))) : 0;
        for (int i = 0; i < from.grid.pixels; ++i) {
          const int to = from.window.first_column + i + right - bench.window.first_column;
          if (to < 0 || to >= bench.grid.pixels) continue;
          other.levels[bench.grid.pixel(m, to, 0)] = still.job.levels[from.grid.pixel(m, i, 0)];
        }
      }
      const double contrast = figures_of(other, dose_of(other), part).metrics.contrast;
      EXPECT_LT(contrast, print.figures.metrics.contrast) << amplitude << whole;
      RecordProperty(fmt::format("contrast_{}_{}", amplitude, whole ? "whole" : "unknown"),
                     fmt::format("{:.3f}", contrast));
    }
    RecordProperty(fmt::format("contrast_{}", amplitude),
                   fmt::format("{:.3f} of {:.3f}", print.figures.metrics.contrast, steady));
  }
}

TEST(TomoTilt, FramesAreTurnedSoThatThePartIsPrinted) {
  const Box<std::uint8_t> part = bars(9);
  const double straight =
      solve_print(part, 0.25, wide_printer(), bench_resin(), few_steps()).figures.metrics.contrast;
  Printer p = wide_printer();
  p.optics->tilt_deg = 4;
  const Print print = solve_print(part, 0.25, p, bench_resin(), few_steps());
  EXPECT_EQ(print.figures.metrics.ver, 0);
  EXPECT_GT(print.figures.metrics.contrast, 1.1);
  RecordProperty("contrast",
                 fmt::format("{:.3f} of {:.3f}", print.figures.metrics.contrast, straight));
  const auto folder = std::filesystem::temp_directory_path() /
                      ("slicecorr-tomo-tilt-" + std::to_string(::getpid()));
  std::filesystem::create_directories(folder);
  const std::string path = (folder / "tilt.frames").string();
  write_job(path, print.job);
  const TomoJob back = read_job(path);
  EXPECT_EQ(difference(dose_of(back), dose_of(print.job)), 0);
  std::filesystem::remove_all(folder);
  // A tilt that takes slices out of the image is told.
  p.height_px = 12;
  p.optics->tilt_deg = 20;
  EXPECT_THAT(refusal([&] { solve_print(part, 0.25, p, bench_resin(), few_steps()); }),
              HasSubstr("of the part in it"));
}

TEST(TomoFlatField, AnEvenOneIsACalibration) {
  // 100 of 200 everywhere: half of the light.
  Printer half = wide_printer(), dim = wide_printer();
  half.flat_field = field_of(8, 8, [](int, int) { return 100; });
  for (CalibrationPoint& c : dim.calibration) c.intensity_mw_cm2 /= 2;
  const Print a = solve_print(bars(1), 0.25, half, bench_resin(), few_steps()),
              b = solve_print(bars(1), 0.25, dim, bench_resin(), few_steps());
  EXPECT_EQ(a.job.turns, b.job.turns);
  EXPECT_EQ(a.job.levels, b.job.levels);
  EXPECT_LT(difference(dose_of_print(a), dose_of_print(b)), 1e-6);
  EXPECT_NEAR(a.figures.floor_mj_cm3, b.figures.floor_mj_cm3, 1e-9);
}

TEST(TomoFlatField, DarkCornersGetHigherLevels) {
  Printer p = wide_printer();
  // 100 % in the middle, 50 % at the wall of the vial, 4 mm beside it.
  p.flat_field = field_of(64, 64, [](int x, int y) {
    const double r = std::hypot(x - 31.5, y - 31.5) / 16;
    return static_cast<int>(std::lround(200 * std::max(0.2, 1 - 0.5 * r * r)));
  });
  const Box<std::uint8_t> part = bars(3);
  // As much light as it takes, so that both find the same.
  PrintOptions options = few_steps();
  options.solve.cap = 1e3;
  const Print even = solve_print(part, 0.25, wide_printer(), bench_resin(), options);
  const Print print = solve_print(part, 0.25, p, bench_resin(), options);
  EXPECT_EQ(print.figures.metrics.ver, 0);
  EXPECT_NEAR(print.figures.metrics.contrast, even.figures.metrics.contrast, 0.02);
  // What is shown is what was wanted: within half a level at each place.
  const Bench bench = make_bench(p, bench_resin(), print.job.sampling);
  const Light shown = shown_light(bench, print.job.levels);
  const Light same =
      shown_light(make_bench(wide_printer(), bench_resin(), even.job.sampling), even.job.levels);
  // Both are one light up to a scale.
  double dot = 0, squares = 0;
  for (std::size_t i = 0; i < shown.values.size(); ++i) {
    dot += static_cast<double>(shown.values[i]) * same.values[i];
    squares += static_cast<double>(same.values[i]) * same.values[i];
  }
  const double scale = dot / squares, level = 2.0 / 255;
  for (std::size_t i = 0; i < shown.values.size(); ++i) {
    EXPECT_NEAR(shown.values[i], scale * same.values[i], 0.51 * level * (1 + scale) + 0.003);
  }
  // Levels that do not know of it print worse.
  TomoJob unaware = even.job;
  unaware.printer = p;
  EXPECT_LT(figures_of(unaware, dose_of(unaware), part).metrics.contrast,
            print.figures.metrics.contrast - 0.05);
  // With a time that is fixed the dimmest place bounds all light.
  PrintOptions quick = few_steps();
  quick.most_time_s = print.figures.print_time_s;
  EXPECT_LE(solve_print(part, 0.25, p, bench_resin(), quick).figures.print_time_s,
            print.figures.print_time_s);

  const auto folder = std::filesystem::temp_directory_path() /
                      ("slicecorr-tomo-flat-" + std::to_string(::getpid()));
  std::filesystem::create_directories(folder);
  const std::string path = (folder / "flat.frames").string();
  write_job(path, print.job);
  const TomoJob back = read_job(path);
  EXPECT_EQ(back.printer, print.job.printer);
  EXPECT_EQ(back.levels, print.job.levels);
  EXPECT_EQ(difference(dose_of(back), dose_of(print.job)), 0);
  std::filesystem::remove_all(folder);
}

TEST(TomoFlatField, BlackBeforeTheResinIsRefused) {
  Printer p = wide_printer();
  p.flat_field = field_of(64, 64, [](int x, int) { return x > 34 && x < 37 ? 0 : 200; });
  EXPECT_THAT(refusal([&] { solve_print(bars(1), 0.25, p, bench_resin(), few_steps()); }),
              testing::AllOf(HasSubstr("flat-field is black in column 35"),
                             HasSubstr("where the resin is")));
  // Beside it, it does not matter.
  p.flat_field = field_of(64, 64, [](int x, int) { return x < 4 ? 0 : 200; });
  EXPECT_NO_THROW(solve_print(bars(1), 0.25, p, bench_resin(), few_steps()));
}

TEST(TomoWobble, TakesFromTheReach) {
  Printer p = bench_printer();
  p.width_px = 33;
  wobble(p, 1);
  const double still = reach_mm(
      [&] {
        Printer q = p;
        q.rotation->wobble.clear();
        return q;
      }(),
      1.5);
  EXPECT_NEAR(reach_mm(p, 1.5), still - most_wobble_px(*p.rotation) * 0.25, 1e-12);
}

}  // namespace
}  // namespace slicecorr::tomo
