// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Tomographic jobs as videos: read again, every image is the job's.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "run_program.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/tomo/video.hpp"
#include "stack_fixture.hpp"
#include "tomo_jobs.hpp"

namespace slicecorr::tomo {
namespace {

using testing::HasSubstr;
namespace fs = std::filesystem;

/// A reader of grey YUV4MPEG2 of its own.
struct Video {
  std::string head;
  std::vector<std::vector<std::uint8_t>> images;

  Video(const std::vector<std::uint8_t>& file, std::size_t image_bytes) {
    const auto end = std::find(file.begin(), file.end(), '\n');
    head.assign(file.begin(), end);
    auto at = static_cast<std::size_t>(end - file.begin()) + 1;
    constexpr std::string_view mark = "FRAME\n";
    while (at < file.size()) {
      if (file.size() - at < mark.size() + image_bytes ||
          !std::equal(mark.begin(), mark.end(), file.begin() + static_cast<std::ptrdiff_t>(at))) {
        ADD_FAILURE() << "no image at byte " << at;
        return;
      }
      const auto first = file.begin() + static_cast<std::ptrdiff_t>(at + mark.size());
      images.emplace_back(first, first + static_cast<std::ptrdiff_t>(image_bytes));
      at += mark.size() + image_bytes;
    }
  }
};

/// The images of a turn, in order, as the job's file has them.
std::vector<std::vector<std::uint8_t>> images_of(const TomoJob& job) {
  const Bench bench = make_bench(job.printer, job.resin, job.sampling);
  std::vector<std::vector<std::uint8_t>> images;
  for (int f = 0; f < bench.grid.angles; ++f) {
    images.push_back(frame_image(job, bench, f).pixels);
  }
  return images;
}

TEST(TomoVideo, IsTheJobsImagesTurnByTurnAndThenBlack) {
  for (const Printer& printer : {bench_printer(), dry_printer()}) {
    const TomoJob job = random_job(printer, 3, 24);
    const VideoPlan plan = plan_video(job, {.turns = 2, .fps = 0, .tail_s = 2});
    // 24 angles in 14.4 s: 5/3 a second; 3.33 images of black, rounded up.
    EXPECT_EQ(plan.rate, 5);
    EXPECT_EQ(plan.per_s, 3);
    EXPECT_EQ(plan.tail, 4);
    EXPECT_EQ(plan.images, 52);
    EXPECT_NEAR(plan.deg_s, 25, 1e-9);
    std::vector<std::uint8_t> file;
    std::size_t largest = 0;
    write_y4m(job, plan, [&](const std::uint8_t* bytes, std::size_t count) {
      file.insert(file.end(), bytes, bytes + count);
      largest = std::max(largest, count);
    });
    EXPECT_EQ(largest, 48U * 40U);  // one image at a time
    const Video video(file, 48U * 40U);
    EXPECT_EQ(video.head, "YUV4MPEG2 W48 H40 F5:3 Ip A1:1 Cmono XCOLORRANGE=FULL");
    const auto images = images_of(job);
    ASSERT_EQ(video.images.size(), 52U);
    for (std::size_t i = 0; i < 48; ++i) ASSERT_EQ(video.images[i], images[i % 24]) << i;
    for (std::size_t i = 48; i < 52; ++i) {
      ASSERT_EQ(video.images[i], std::vector<std::uint8_t>(48U * 40U, 0)) << i;
    }
  }
}

TEST(TomoVideo, RatesAreFractionsThatPlayersRead) {
  TomoJob job = random_job(bench_printer(), 1, 199);
  const auto rate = [&](double fps) {
    const VideoPlan p = plan_video(job, {.turns = 1, .fps = fps, .tail_s = 0});
    EXPECT_NEAR(p.fps(), fps, 1e-9 * fps);
    EXPECT_EQ(p.images, 199);
    return std::pair(p.rate, p.per_s);
  };
  EXPECT_EQ(rate(25), std::pair(std::int64_t{25}, std::int64_t{1}));
  EXPECT_EQ(rate(24000.0 / 1001), std::pair(std::int64_t{24000}, std::int64_t{1001}));
  EXPECT_EQ(rate(0.5), std::pair(std::int64_t{1}, std::int64_t{2}));
  const VideoPlan own = plan_video(job);
  EXPECT_EQ(own.turns, job.turns);
  EXPECT_EQ(own.rate, 995);  // 199 in 14.4 s
  EXPECT_EQ(own.per_s, 72);
  EXPECT_EQ(own.tail, 14);
  // Speeds that no short fraction has.
  job.printer.rotation->deg_s = 25.000123456;
  EXPECT_NEAR(plan_video(job).fps() / (199 * 25.000123456 / 360), 1, 1e-9);
}

TEST(TomoVideo, WhatCanNotBeShownIsRefused) {
  const TomoJob job = random_job(bench_printer(), 1, 24);
  const auto refused = [&](const VideoOptions& options) {
    try {
      plan_video(job, options);
    } catch (const InputError& e) {
      return std::string(e.what());
    }
    return std::string("taken");
  };
  EXPECT_THAT(refused({.turns = 1, .fps = 61}), HasSubstr("shows 60 at most"));
  EXPECT_EQ(refused({.turns = 1, .fps = 60}), "taken");
  EXPECT_THAT(refused({.turns = -1}), HasSubstr("-1 turns"));
  EXPECT_THAT(refused({.turns = 1, .fps = 1e-5}), HasSubstr("1e-05 images"));
  EXPECT_THAT(refused({.turns = 1, .fps = 0, .tail_s = -1}), HasSubstr("tail"));
}

class TomoVideoProgram : public ::testing::Test {
 protected:
  void SetUp() override {
    job_ = random_job(dry_printer(), 3, 24);
    write_job(path("a.frames"), job_);
  }
  std::string path(const std::string& name) const { return folder_ / name; }
  test::RunResult call(std::vector<std::string> words,
                       const std::map<std::string, std::string>& environment = {}) const {
    test::RunOptions options;
    options.folder = folder_.path();
    options.environment = environment;
    words.insert(words.begin(), {SLICECORR_BIN_DIR "/slicecorr", "tomo", "video", "a.frames"});
    return test::run_program(words, options);
  }
  /// A program named ffmpeg of these lines, first in the search path.
  std::map<std::string, std::string> with_ffmpeg(const std::string& lines) const {
    fs::create_directories(path("bin"));
    test::write_file(path("bin/ffmpeg"), test::to_bytes("#!/bin/sh\n" + lines));
    ::chmod(path("bin/ffmpeg").c_str(), 0755);
    return {{"PATH", path("bin") + ":" + std::getenv("PATH")}};
  }
  TomoJob job_;
  test::TemporaryFolder folder_;
};

TEST_F(TomoVideoProgram, WritesWhatTheJobShows) {
  const test::RunResult r = call({"-o", "a.y4m", "--tail-s", "0"});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  EXPECT_THAT(r.err, testing::AllOf(HasSubstr("72 images"), HasSubstr("3 turns"),
                                    HasSubstr("counterclockwise at 25 degrees")));
  const Video video(test::read_file(path("a.y4m")), 48U * 40U);
  const auto images = images_of(job_);
  ASSERT_EQ(video.images.size(), 72U);
  for (std::size_t i = 0; i < 72; ++i) ASSERT_EQ(video.images[i], images[i % 24]) << i;
}

TEST_F(TomoVideoProgram, WrongUseIsToldByName) {
  const auto refused = [&](const std::vector<std::string>& words) {
    const test::RunResult r = call(words);
    EXPECT_EQ(r.exit_code, 2);
    return r.err;
  };
  EXPECT_THAT(refused({"-o", "a.avi"}), HasSubstr(".mp4"));
  EXPECT_THAT(refused({"-o", "a_9rpm.mp4"}), HasSubstr("says 9 rpm"));
  EXPECT_THAT(refused({"-o", "a.y4m", "--channel", "blue"}),
              HasSubstr("--channel blue is for .mkv"));
  EXPECT_THAT(refused({"-o", "a.y4m", "--turns", "0"}), HasSubstr("--turns"));
  EXPECT_THAT(refused({"-o", "a.y4m", "--fps", "100"}), HasSubstr("60 at most"));
  EXPECT_THAT(refused({"-o", "a.y4m", "--tail-s", "nan"}), HasSubstr("--tail-s"));
  EXPECT_FALSE(fs::exists(path("a.y4m")));
}

/// Through ffmpeg and back where it is installed; where not, that is what is said.
TEST_F(TomoVideoProgram, MatroskaLosesNothing) {
  const bool installed = fs::exists("/usr/bin/ffmpeg");
  const test::RunResult r = call({"-o", "a.mkv", "--turns", "1"});
  if (!installed) {
    EXPECT_EQ(r.exit_code, 2);
    EXPECT_THAT(r.err, testing::AllOf(HasSubstr("ffmpeg"), HasSubstr(".y4m")));
    EXPECT_FALSE(fs::exists(path("a.mkv")));
    return;
  }
  ASSERT_EQ(r.exit_code, 0) << r.err;
  test::RunOptions options;
  options.folder = folder_.path();
  const test::RunResult back =
      test::run_program({"/usr/bin/ffmpeg", "-loglevel", "error", "-i", "a.mkv", "-f", "rawvideo",
                         "-pix_fmt", "gray", "a.raw"},
                        options);
  ASSERT_EQ(back.exit_code, 0) << back.err;
  std::vector<std::uint8_t> wanted;
  for (const auto& image : images_of(job_)) wanted.insert(wanted.end(), image.begin(), image.end());
  wanted.resize(wanted.size() + 2U * 48U * 40U);  // a second of 5/3 images of black
  EXPECT_EQ(test::read_file(path("a.raw")), wanted);
}

/// As grey values of `images`, and what is said of the file.
TEST_F(TomoVideoProgram, Mp4IsWhatPlayersTakeAndOneColourIsOne) {
  if (!fs::exists("/usr/bin/ffmpeg")) {
    EXPECT_THAT(call({"-o", "a.mp4"}).err, HasSubstr("ffmpeg"));
    return;
  }
  // 25 degrees a second are 25/6 rpm.
  const test::RunResult r = call({"-o", "a_4.167rpm.mp4", "--turns", "1"});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  test::RunOptions options;
  options.folder = folder_.path();
  const auto decoded = [&](const std::string& file, const std::string& pixels) {
    const test::RunResult back =
        test::run_program({"/usr/bin/ffmpeg", "-y", "-loglevel", "error", "-i", file, "-f",
                           "rawvideo", "-pix_fmt", pixels, "a.raw"},
                          options);
    EXPECT_EQ(back.exit_code, 0) << back.err;
    return test::read_file(path("a.raw"));
  };
  std::vector<std::uint8_t> wanted;
  for (const auto& image : images_of(job_)) wanted.insert(wanted.end(), image.begin(), image.end());
  wanted.resize(wanted.size() + 2U * 48U * 40U);
  const auto grey = decoded("a_4.167rpm.mp4", "gray");
  ASSERT_EQ(grey.size(), wanted.size());
  // Random levels are the hardest to code: little is lost of them.
  double off = 0, squares = 0;
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    off = std::max(off, std::abs(1.0 * grey[i] - wanted[i]));
    squares += (1.0 * grey[i] - wanted[i]) * (1.0 * grey[i] - wanted[i]);
  }
  EXPECT_LT(std::sqrt(squares / static_cast<double>(wanted.size())), 1.5);
  EXPECT_LE(off, 6);
  const test::RunResult said = test::run_program(
      {"/usr/bin/ffprobe", "-v", "error", "-show_entries", "stream=codec_name,pix_fmt,r_frame_rate",
       "-of", "csv=p=0", "a_4.167rpm.mp4"},
      options);
  EXPECT_EQ(said.out, "h264,yuv420p,5/3\n");

  ASSERT_EQ(call({"-o", "b.mkv", "--turns", "1", "--channel", "blue"}).exit_code, 0);
  const auto colours = decoded("b.mkv", "rgb24");
  ASSERT_EQ(colours.size(), 3 * wanted.size());
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    ASSERT_EQ(colours[3 * i], 0);
    ASSERT_EQ(colours[3 * i + 1], 0);
    ASSERT_EQ(colours[3 * i + 2], wanted[i]) << i;
  }
}

TEST_F(TomoVideoProgram, TheStreamGoesThroughFfmpegAndFailuresLeaveNothing) {
  ASSERT_EQ(call({"-o", "a.y4m", "--turns", "1"}).exit_code, 0);
  // The last argument is the file to make.
  const auto keeps = with_ffmpeg("for last; do :; done\nexec cat > \"${last#file:}\"\n");
  ASSERT_EQ(call({"-o", "a.mkv", "--turns", "1"}, keeps).exit_code, 0);
  EXPECT_EQ(test::read_file(path("a.mkv")), test::read_file(path("a.y4m")));
  const std::size_t files = std::distance(fs::directory_iterator(folder_.path()), {});
  const std::vector<std::uint8_t> before = test::read_file(path("a.mkv"));
  for (const char* lines : {"head -c 5000 > /dev/null\necho no room >&2\nexit 1\n",
                            "cat > /dev/null\nexit 1\n", "kill -9 $$\n"}) {
    const test::RunResult r = call({"-o", "a.mkv"}, with_ffmpeg(lines));
    EXPECT_EQ(r.exit_code, 4) << lines;
    EXPECT_THAT(r.err, HasSubstr("ffmpeg ended before the video was whole"));
    EXPECT_EQ(test::read_file(path("a.mkv")), before);
    EXPECT_EQ(std::distance(fs::directory_iterator(folder_.path()), {}),
              static_cast<std::ptrdiff_t>(files));
  }
}

}  // namespace
}  // namespace slicecorr::tomo
