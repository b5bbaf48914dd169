// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Images that others made, as jobs: what comes back is what was shown, and what does not fit is told by name.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "run_program.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/tomo/convert.hpp"
#include "stack_fixture.hpp"
#include "support/text/natural.hpp"
#include "tomo_definitions.hpp"
#include "tomo_jobs.hpp"

namespace slicecorr::tomo {
namespace {

using testing::AllOf;
using testing::HasSubstr;
namespace fs = std::filesystem;

TEST(NaturalOrder, CountsAsPeopleDo) {
  const std::vector<std::string> sorted{"",
                                        "frame",
                                        "frame1",
                                        "frame2",
                                        "frame10",
                                        "frame10a",
                                        "frame10b",
                                        "frame11",
                                        "g1_9",
                                        "g1_10",
                                        "g99999999999999999999",
                                        "g100000000000000000000",
                                        "\xC3\xA4"};
  for (std::size_t i = 0; i < sorted.size(); ++i) {
    for (std::size_t j = 0; j < sorted.size(); ++j) {
      const int order = natural_order(sorted[i], sorted[j]);
      EXPECT_EQ(order < 0, i < j) << sorted[i] << " " << sorted[j];
      EXPECT_EQ(order > 0, i > j) << sorted[i] << " " << sorted[j];
    }
  }
  EXPECT_EQ(natural_order("a007", "a7"), 0);
  EXPECT_EQ(natural_order("a0", "a"), 1);
  EXPECT_LT(natural_order("a007b", "a7c"), 0);
}

class TomoConvert : public ::testing::Test {
 protected:
  std::string path(const std::string& name) const { return folder_ / name; }
  /// The job's images, named as others do: image_0.png ... image_10.png.
  void show(const TomoJob& job) const {
    fs::remove_all(path("images"));
    fs::create_directories(path("images"));
    const Bench bench = make_bench(job.printer, job.resin, job.sampling);
    for (int f = 0; f < bench.grid.angles; ++f) {
      test::write_file(path(fmt::format("images/image_{}.png", f)),
                       encode_png(frame_image(job, bench, f)));
    }
  }
  void replace(const std::string& name, int width, int height, std::uint8_t value) const {
    GreyImage image{width, height, {}};
    image.pixels.assign(static_cast<std::size_t>(width) * static_cast<std::size_t>(height), value);
    test::write_file(path("images/" + name), encode_png(image));
  }
  ImageSequence sequence(double step = 15, int turns = 3) const {
    return {path("images"), step, turns, std::nullopt};
  }
  std::string refused(const ImageSequence& images, const Printer& printer,
                      const Box<std::uint8_t>& part = {}, double voxel_mm = 0) const {
    try {
      job_of_images(images, printer, bench_resin(), part, voxel_mm);
    } catch (const InputError& e) {
      return e.what();
    }
    return "taken";
  }
  test::TemporaryFolder folder_;
};

/// Rows of half a voxel that differ: each slice shows the mean light of its rows, to half a level, as the
/// calibration is straight; that is said.
TEST_F(TomoConvert, RowsFinerThanVoxelsBecomeTheirMean) {
  const Printer printer = bench_printer();
  const TomoJob fine = random_job(printer, 4, 24);
  show(fine);
  std::string told;
  ExecutionContext context;
  context.notice = [&](const std::string& text) { told += text; };
  const TomoJob job = job_of_images(sequence(), printer, bench_resin(), {}, 0.5, context);
  EXPECT_THAT(told, HasSubstr("finer rows than slices of 0.5 mm"));
  ASSERT_EQ(job.sampling.slices, 2);
  const Bench bench = make_bench(printer, job.resin, job.sampling),
              of_fine = make_bench(printer, fine.resin, fine.sampling);
  for (int f = 0; f < 24; ++f) {
    const GreyImage coarse = frame_image(job, bench, f), theirs = frame_image(fine, of_fine, f);
    for (int row = 18; row < 22; row += 2) {
      for (int column = 8; column < 40; ++column) {
        const auto at = static_cast<std::size_t>(row * 48 + column);
        EXPECT_EQ(coarse.pixels[at], coarse.pixels[at + 48]);
        ASSERT_NEAR(coarse.pixels[at], 0.5 * (theirs.pixels[at] + theirs.pixels[at + 48]), 0.501)
            << row << ' ' << column;
      }
    }
  }
}

TEST_F(TomoConvert, AJobsImagesComeBackAsThatJob) {
  for (const Printer& printer : {bench_printer(), dry_printer()}) {
    for (const int slices : {3, 4}) {
      TomoJob job = random_job(printer, slices, 24);
      // A slice below and above what is wholly dark: rows in the middle are lit in all.
      show(job);
      const TomoJob again = job_of_images(sequence(), printer, job.resin, job.part, 0.25);
      EXPECT_EQ(again.sampling.slices, slices);
      EXPECT_EQ(again.sampling.angles, 24);
      EXPECT_EQ(again.turns, 3);
      EXPECT_EQ(again.levels, job.levels);
      EXPECT_EQ(again.part.values, job.part.values);
      EXPECT_EQ(again.printer, job.printer);
      const TomoJob alone = job_of_images(sequence(), printer, job.resin, {}, 0);
      EXPECT_EQ(alone.sampling.voxel_mm, 0.25);
      EXPECT_EQ(std::count(alone.part.values.begin(), alone.part.values.end(), 0),
                static_cast<std::ptrdiff_t>(alone.part.values.size()));
    }
  }
}

TEST_F(TomoConvert, LightBesideThePartIsKept) {
  // Six slices are lit; a part of two lies in their middle.
  const TomoJob job = random_job(bench_printer(), 6, 24);
  show(job);
  Box<std::uint8_t> part{2, 33, 33, std::vector<std::uint8_t>(2 * 33 * 33)};
  part.values[part.at(0, 16, 16)] = part.values[part.at(1, 16, 18)] = 255;
  std::string told;
  ExecutionContext context;
  context.notice = [&](const std::string& text) { told += text; };
  const TomoJob again = job_of_images(sequence(), job.printer, job.resin, part, 0.25, context);
  EXPECT_EQ(again.sampling.slices, 6);
  EXPECT_EQ(again.levels, job.levels);
  EXPECT_EQ(again.part.values[again.part.at(2, 16, 16)], 255);
  EXPECT_EQ(again.part.values[again.part.at(3, 16, 18)], 255);
  EXPECT_EQ(std::count(again.part.values.begin(), again.part.values.end(), 255), 2);
  EXPECT_THAT(told, HasSubstr("2 slices of void"));
}

TEST_F(TomoConvert, TheOtherDirectionTurnsTheFramesRound) {
  const TomoJob job = random_job(bench_printer(), 3, 24);
  show(job);
  ImageSequence images = sequence();
  images.direction = TurnDirection::counterclockwise;
  const TomoJob again = job_of_images(images, job.printer, job.resin, job.part, 0.25);
  EXPECT_EQ(again.printer.rotation->direction, TurnDirection::counterclockwise);
  const TomoGrid grid = make_bench(job.printer, job.resin, job.sampling).grid;
  for (int m = 0; m < 24; ++m) {
    for (int i = 0; i < grid.pixels; ++i) {
      ASSERT_EQ(again.levels[grid.pixel((24 - m) % 24, i, 1)], job.levels[grid.pixel(m, i, 1)]);
    }
  }
  // Shown, both are the same images in the same order.
  const Bench bench = make_bench(again.printer, again.resin, again.sampling);
  const Bench before = make_bench(job.printer, job.resin, job.sampling);
  for (int f = 0; f < 24; ++f) {
    EXPECT_EQ(frame_image(again, bench, f).pixels, frame_image(job, before, f).pixels) << f;
  }
}

TEST_F(TomoConvert, WhatDoesNotFitIsRefusedByName) {
  const Printer printer = bench_printer();
  const TomoJob job = random_job(printer, 3, 24);
  show(job);
  EXPECT_THAT(refused(sequence(7), printer), AllOf(HasSubstr("51.429"), HasSubstr("(51 images)")));
  EXPECT_THAT(refused(sequence(14.98), printer), HasSubstr("do not divide a whole turn"));
  EXPECT_THAT(refused(sequence(14.9999), printer), "taken");  // off by a 7000th of a step
  EXPECT_THAT(refused(sequence(0), printer), HasSubstr("more than 0"));
  EXPECT_THAT(refused(sequence(180), printer), HasSubstr("at most 120"));
  EXPECT_THAT(refused(sequence(1e-9), printer), HasSubstr("at most 100000"));
  EXPECT_THAT(refused(sequence(15, 0), printer), HasSubstr("0 turns"));
  EXPECT_THAT(refused(sequence(10), printer),
              AllOf(HasSubstr("images"), HasSubstr("holds 24 PNG images; expected 36")));
  EXPECT_THAT(refused({path("none"), 15, 1, {}}, printer), HasSubstr("none"));

  Printer other = printer;
  other.width_px = 50;
  EXPECT_THAT(refused(sequence(), other),
              AllOf(HasSubstr("image_0.png"), HasSubstr("48 x 40"), HasSubstr("50 x 40")));
  replace("image_7.png", 40, 48, 0);
  EXPECT_THAT(refused(sequence(), printer), AllOf(HasSubstr("image_7.png"), HasSubstr("40 x 48")));
  test::write_file(path("images/image_7.png"), test::to_bytes("no image"));
  EXPECT_THAT(refused(sequence(), printer), AllOf(HasSubstr("image_7.png"), HasSubstr("PNG")));
  show(job);
  fs::rename(path("images/image_23.png"), path("images/image_07.png"));
  EXPECT_THAT(refused(sequence(), printer), HasSubstr("has the number of image_07.png"));
  show(job);
  fs::remove(path("images/image_5.png"));
  EXPECT_THAT(refused(sequence(), printer), HasSubstr("holds 23"));

  // Levels that a projector of 4 bits has not: multiples of 17 alone.
  Printer coarse = printer;
  coarse.bit_depth = 4;
  coarse.calibration = {{0, 0.002}, {15, 2.0}};
  for (int f = 0; f < 24; ++f) replace(fmt::format("image_{}.png", f), 48, 40, 34);
  EXPECT_EQ(refused(sequence(), coarse), "taken");
  replace("image_3.png", 48, 40, 35);
  EXPECT_THAT(refused(sequence(), coarse),
              AllOf(HasSubstr("image_3.png"), HasSubstr("column 0, row 0 is 35")));
  // A part that is too wide, and one of other voxels than images have rows.
  Box<std::uint8_t> wide{1, 41, 41, std::vector<std::uint8_t>(41 * 41, 255)};
  EXPECT_THAT(refused(sequence(), printer, wide, 0.25), HasSubstr("voxel"));
  EXPECT_THAT(refused(sequence(), printer, {}, 0.1), HasSubstr("0.25 mm high"));
}

/// A line of light before a pinhole: its row lights the slice in the middle of three, and no light is looked for.
TEST_F(TomoConvert, ImagesOfOneRowAreJudged) {
  Printer line = bench_printer();
  line.height_px = 1;
  line.optics->kind = OpticsKind::pinhole;
  line.optics->distance_mm = 60;
  fs::create_directories(path("images"));
  for (int f = 0; f < 24; ++f) replace(fmt::format("image_{}.png", f), 48, 1, 200);
  const TomoJob job = job_of_images(sequence(), line, bench_resin(), {}, 0.25);
  ASSERT_EQ(job.sampling.slices, 3);
  const Box<float> dose = dose_of(job);
  const int c = dose.nx / 2;
  const double low = dose.values[dose.at(0, c, c)], middle = dose.values[dose.at(1, c, c)],
               high = dose.values[dose.at(2, c, c)];
  EXPECT_GT(middle, 10 * low);
  EXPECT_NEAR(low / high, 1, 1e-3);
  try {
    check_print(square_part(), 0.25, line, bench_resin());
    ADD_FAILURE();
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr("has one row"));
  }
}

TEST_F(TomoConvert, RowsThatRepeatMakeCoarserVoxels) {
  // Each slice of 0.5 mm is two rows of 0.25 mm.
  TomoJob job;
  job.printer = bench_printer();
  job.resin = bench_resin();
  job.sampling = {0.5, 4, 24};
  const Bench bench = make_bench(job.printer, job.resin, job.sampling);
  const TomoGrid& g = bench.grid;
  job.part = {4, g.voxels, g.voxels, {}};
  job.part.values.assign(4 * static_cast<std::size_t>(g.voxels * g.voxels), 0);
  job.levels.assign(g.blocks() * g.light_of_block(), 0);
  for (int m = 0; m < 24; ++m) {
    for (int i = 0; i < g.pixels; ++i) {
      for (int z = 0; z < 4; ++z) {
        job.levels[g.pixel(m, i, z)] = static_cast<std::uint16_t>(1 + (m * 7 + i * 3 + z) % 255);
      }
    }
  }
  show(job);
  const TomoJob again = job_of_images(sequence(), job.printer, job.resin, {}, 0.5);
  EXPECT_EQ(again.sampling.slices, 4);
  EXPECT_EQ(again.levels, job.levels);
}

class TomoConvertProgram : public TomoConvert {
 protected:
  void SetUp() override {
    job_ = random_job(bench_printer(), 3, 24);
    show(job_);
    write_npy(path("part.npy"), job_.part);
    test::write_file(path("bench.toml"), test::to_bytes(test::bench_printer_toml()));
    test::write_file(path("resin.toml"), test::to_bytes(test::bench_resin_toml("2.5")));
  }
  test::RunResult call(std::vector<std::string> words) const {
    test::RunOptions options;
    options.folder = folder_.path();
    words.insert(words.begin(), {SLICECORR_BIN_DIR "/slicecorr", "tomo"});
    return test::run_program(words, options);
  }
  std::vector<std::string> convert(const std::vector<std::string>& more) const {
    std::vector<std::string> words{
        "convert",          "images", "--printer", "bench.toml", "--resin", "resin.toml",
        "--angle-step-deg", "15",     "--turns",   "3",          "-o",      "a.frames"};
    words.insert(words.end(), more.begin(), more.end());
    return words;
  }
  TomoJob job_;
};

TEST_F(TomoConvertProgram, OtherPeoplesFramesAreJudgedAsOurs) {
  const test::RunResult r = call(convert({"--part-npy", "part.npy", "--voxel-mm", "0.25"}));
  ASSERT_EQ(r.exit_code, 0) << r.err;
  write_job(path("ours.frames"), job_);
  const test::RunResult theirs = call({"verify", "a.frames", "--json", "-"}),
                        ours = call({"verify", "ours.frames", "--json", "-"});
  EXPECT_EQ(theirs.exit_code, 5);
  EXPECT_EQ(nlohmann::json::parse(theirs.out), nlohmann::json::parse(ours.out));
  EXPECT_EQ(call({"report", "a.frames", "-o", "a.html"}).exit_code, 0);

  // Without a part: a volume judges it.
  const test::RunResult alone = call(convert({}));
  ASSERT_EQ(alone.exit_code, 0) << alone.err;
  EXPECT_THAT(alone.err, HasSubstr("no part"));
  EXPECT_EQ(call({"verify", "a.frames"}).exit_code, 2);
}

TEST_F(TomoConvertProgram, WrongUseIsToldByName) {
  const auto refused = [&](const std::vector<std::string>& more) {
    const test::RunResult r = call(convert(more));
    EXPECT_EQ(r.exit_code, 2);
    EXPECT_FALSE(fs::exists(path("a.frames")));
    return r.err;
  };
  EXPECT_THAT(refused({"--part-npy", "part.npy"}), HasSubstr("--voxel-mm"));
  EXPECT_THAT(refused({"--direction", "left"}), HasSubstr("--direction"));
  EXPECT_THAT(refused({"--part-npy", "none.npy", "--voxel-mm", "0.25"}), HasSubstr("none.npy"));
  EXPECT_THAT(call({"convert", "images", "--printer", "bench.toml", "--resin", "resin.toml",
                    "--angle-step-deg", "0", "--turns", "1", "-o", "a.frames"})
                  .err,
              HasSubstr("--angle-step-deg"));
}

}  // namespace
}  // namespace slicecorr::tomo
