// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Archives that were sliced with supports, through the programs: the part is found and corrected, all
/// else stays byte for byte.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "ladder.hpp"
#include "program_fixture.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;
using testing::HasSubstr;
using testing::Not;

const Command kLight{"--printer",    "small.toml", "--resin",     "figure-2-2",
                     "--speed-mm-h", "1000",       "--dc-mj-cm3", "100"};

class FindPartProgram : public ProgramFixture {
 protected:
  FindPartProgram() {
    write("small.toml", kSmallPrinter);
    write_stl(folder_ / "ladder.stl", ladder());
    // The ladder 0.6 mm above the platform, aside, with a raft and pillars under its rails and rung.
    TriangleMesh all;
    for (const auto& [low, high] : parts_of_ladder()) {
      add_box(all, {low[0] + kX, low[1] + kY, low[2] + kUp},
              {high[0] + kX, high[1] + kY, high[2] + kUp});
    }
    for (const auto& [low, high] : supports()) add_box(all, low, high);
    write_stl(folder_ / "all.stl", all);
    // On the plate as the file has it: its box is 5.2 x 3.2 mm, from the plate's corner on.
    good({"slice", "all.stl", "-o", "all.uvj", "--printer", "small.toml", "--layer-um", "50",
          "--center-mm", "3.5,3"});
  }
  using Boxes = std::vector<std::pair<Point3, Point3>>;
  static constexpr double kX = 3.3, kY = 3.1, kUp = 0.6;
  static Boxes parts_of_ladder() {
    return {{{-2, -1, 0}, {-1, 1, 2.5}},
            {{1, -1, 0}, {2, 1, 2.5}},
            {{-1, -1, 0.55}, {1, 1, 1.05}},
            {{-1, -1, 1.55}, {1, 1, 2.05}}};
  }
  /// From x 0.9 to 6.1 and y 1.4 to 4.6 mm.
  static Boxes supports() {
    return {{{0.9, 1.4, 0}, {6.1, 4.6, 0.2}},
            {{1.6, 2.9, 0.2}, {1.9, 3.3, 0.6}},
            {{4.7, 2.9, 0.2}, {5.0, 3.3, 0.6}},
            {{3.2, 3.0, 0.2}, {3.4, 3.2, 1.15}}};
  }
  /// Whether the middle of a voxel lies in one of the boxes, grown so far (in voxels).
  static bool inside(const Boxes& boxes, int n, int x, int y, double by, const Point3& move) {
    const Point3 p{(x + 0.5) * 0.05 - move[0], (kSmallHeight - y - 0.5) * 0.05 - move[1],
                   (n + 0.5) * 0.05 - move[2]};
    for (const auto& [low, high] : boxes) {
      bool in = true;
      for (std::size_t k = 0; k < 3; ++k) {
        in &= p[k] > low[k] - by * 0.05 && p[k] < high[k] + by * 0.05;
      }
      if (in) return true;
    }
    return false;
  }
  /// What the images light outside of the grown part is as before; some of the part is not.
  void check_images(const std::vector<Bytes>& before, const std::vector<Bytes>& after) const {
    int supports_seen = 0, changed = 0;
    for (std::size_t n = 0; n < before.size(); ++n) {
      for (int y = 0; y < kSmallHeight; ++y) {
        for (int x = 0; x < kSmallWidth; ++x) {
          const auto at = static_cast<std::size_t>(y * kSmallWidth + x);
          const int z = static_cast<int>(n);
          if (before[n][at] == 0) continue;
          // Places are found to the voxel, and the part is grown by one.
          if (!inside(parts_of_ladder(), z, x, y, 2.01, {kX, kY, kUp})) {
            ASSERT_EQ(after[n][at], before[n][at]) << n << " " << x << " " << y;
            ++supports_seen;
          } else if (inside(parts_of_ladder(), z, x, y, 0, {kX, kY, kUp})) {
            changed += after[n][at] != before[n][at];
          }
        }
      }
    }
    // The raft alone is four slices of 104 x 64 pixels.
    EXPECT_GT(supports_seen, 4 * 104 * 64);
    // Below both rungs.
    EXPECT_GT(changed, 2 * 40 * 40);
  }
};

TEST_F(FindPartProgram, SupportsStayAsTheyAre) {
  const Command correct{"correct", "all.uvj", "-o", "out.uvj", "--part", "ladder.stl"};
  const RunResult told = good(correct + kLight);
  EXPECT_THAT(
      told.err,
      HasSubstr("ladder.stl: found at x 3.30, y 3.10 mm, from 0.600 mm above the platform on: "));
  EXPECT_THAT(told.err, HasSubstr("mm³ outside of it are left alone"));
  EXPECT_THAT(told.err, HasSubstr("voxels left alone"));
  std::vector<Bytes> after = images("out.uvj");
  const std::vector<Bytes> before = images("all.uvj");
  ASSERT_GE(after.size(), before.size());
  after.resize(before.size());
  check_images(before, after);
  // Measured against the archive with the same part, nothing is missing; without it the supports count.
  const json f = figures("out.uvj", "all.uvj", {"--part", "ladder.stl"});
  EXPECT_GT(f["left_alone_voxels"], 4 * 104 * 64);
  EXPECT_EQ(f["lost_features"], 0);
  EXPECT_EQ(f["undercure_voxels"], 0);
  EXPECT_LT(f["height_error_um"]["max_abs"], 5.0);
  EXPECT_FALSE(figures("out.uvj", "all.uvj").contains("left_alone_voxels"));
  good({"report", "out.uvj", "--target", "all.uvj", "--part", "ladder.stl", "-o", "out.html"});
  // The same bytes for any number of threads.
  const Bytes bytes = read_file(folder_ / "out.uvj");
  good(correct + kLight + Command{"--threads", "1"});
  EXPECT_EQ(read_file(folder_ / "out.uvj"), bytes);
}

TEST_F(FindPartProgram, BehindASlicer) {
  const RunOptions& o = options_;
  std::filesystem::copy_file(folder_ / "all.uvj", folder_ / "before.uvj");
  const auto post = [&](const Command& more) {
    return run_program(Command{SLICECORR_BIN_DIR "/slicecorr-post"} + more, o);
  };
  // In inches it is not there, and the file stays.
  const RunResult inches =
      post(kLight + Command{"--part", "ladder.stl", "--units", "inch", "all.uvj"});
  EXPECT_EQ(inches.exit_code, 2);
  EXPECT_EQ(read_file(folder_ / "all.uvj"), read_file(folder_ / "before.uvj"));
  const RunResult done = post(kLight + Command{"--part", "ladder.stl", "--report=json", "all.uvj"});
  ASSERT_EQ(done.exit_code, 0) << done.err;
  EXPECT_THAT(done.err, HasSubstr("found at x 3.30, y 3.10 mm"));
  std::vector<Bytes> after = images("all.uvj");
  const std::vector<Bytes> before = images("before.uvj");
  ASSERT_GE(after.size(), before.size());
  after.resize(before.size());
  check_images(before, after);
  EXPECT_GT(json::parse(to_text(read_file(folder_ / "all.uvj.json")))["left_alone_voxels"],
            4 * 104 * 64);
  const RunResult lost = post(kLight + Command{"--scale", "2", "before.uvj"});
  EXPECT_EQ(lost.exit_code, 2);
  EXPECT_THAT(lost.err, HasSubstr("expected --part"));
}

TEST_F(FindPartProgram, InAWatchedFolder) {
  namespace fs = std::filesystem;
  const RunOptions& o = options_;
  const auto post = [&](const Command& more) {
    return run_program(Command{SLICECORR_BIN_DIR "/slicecorr-post"} + kLight + more, o);
  };
  // Half as large, in a file whose name looks like a list: what turns meshes holds for each archive.
  TriangleMesh half = ladder();
  for (Point3& v : half.vertices) v = {0.5 * v[0], 0.5 * v[1], 0.5 * v[2]};
  write_stl(folder_ / "half, ladder.stl", half);
  TriangleMesh plate;
  add_box(plate, {0, 0, 0}, {4, 3, 3});
  write_stl(folder_ / "plate.stl", plate);
  fs::create_directory(folder_ / "in");
  good({"slice", "plate.stl", "-o", "in/other.uvj", "--printer", "small.toml", "--layer-um", "50"});
  fs::copy_file(folder_ / "all.uvj", folder_ / "in/all.uvj");
  const Bytes other = read_file(folder_ / "in/other.uvj");
  const Command part{"--part", "half, ladder.stl", "--scale", "2", "--rotate-deg", "0,0,90"};
  const RunResult alone = post(part + Command{"all.uvj"});  // which is not taken for an angle
  ASSERT_EQ(alone.exit_code, 0) << alone.err;
  const Command watch{"--watch", "in", "--once", "--settle-s", "0.05"};
  const RunResult watched = post(part + watch);
  EXPECT_EQ(watched.exit_code, 2) << watched.err;  // one failed
  EXPECT_THAT(watched.err, HasSubstr("corrected " + (folder_ / "in/all.uvj")));
  EXPECT_THAT(watched.err, HasSubstr("half, ladder.stl: found at x 3.30, y 3.10 mm"));
  EXPECT_EQ(read_file(folder_ / "in/all.uvj"), read_file(folder_ / "all.uvj"));
  EXPECT_THAT(watched.err, HasSubstr("failed " + (folder_ / "in/other.uvj")));
  EXPECT_THAT(watched.err, HasSubstr("half, ladder.stl: is not in the archive: at best"));
  EXPECT_EQ(read_file(folder_ / "in/other.uvj"), other);
  // Meshes that can't be read are told before any archive is.
  const RunResult none = post(watch + Command{"--part", "none.stl"});
  EXPECT_EQ(none.exit_code, 2);
  EXPECT_THAT(none.err, HasSubstr("none.stl"));
  EXPECT_THAT(none.err, Not(HasSubstr("watching")));
}

TEST_F(FindPartProgram, WhatIsNotThereIsRefused) {
  const auto with = [&](const Command& more) {
    return Command{"correct", "all.uvj", "-o", "out.uvj"} + kLight + more;
  };
  TriangleMesh other;
  add_box(other, {0, 0, 0}, {3, 0.5, 0.5});
  add_box(other, {0, 0, 0}, {0.5, 3, 1});
  write_stl(folder_ / "other.stl", other);
  bad(2, with({"--part", "other.stl"}),
      {"other.stl", "is not in the archive: at best", "% of its surface agrees",
       "expected 80 % or more"});
  bad(2, with({"--part", "ladder.stl", "--scale", "1.2"}), {"ladder.stl", "is not in the archive"});
  bad(2, with({"--part", "ladder.stl", "--scale", "10"}), {"ladder.stl", "beyond the display"});
  bad(2, with({"--part", "ladder.stl", "--rotate-deg", "0,0,30"}), {"is not in the archive"});
  bad(2, with({"--part", "missing.stl"}), {"missing.stl"});
  bad(2, with({"--part", "all.uvj"}), {"all.uvj"});
  // It goes with what all that is left alone goes with.
  EXPECT_THAT(good(with({"--part", "ladder.stl", "--uncertain", "ha=5%", "--robust"})).err,
              HasSubstr("outside of it are left alone"));
  // Turned by a quarter it is the same ladder; alone on the plate nothing is outside.
  EXPECT_THAT(good(with({"--part", "ladder.stl", "--rotate-deg", "0,0,90"})).err,
              HasSubstr("turned by"));
  good({"slice", "ladder.stl", "-o", "alone.uvj", "--printer", "small.toml", "--layer-um", "50"});
  const RunResult alone = good(Command{"correct", "alone.uvj", "-o", "a.uvj", "--part",
                                       "ladder.stl", "--uncertain", "ha=5%", "--robust"} +
                               kLight);
  EXPECT_THAT(alone.err, HasSubstr("on the platform: 100.0 % of its surface agrees"));
  EXPECT_THAT(alone.err, HasSubstr("nothing is lit outside of the part"));
}

}  // namespace
}  // namespace slicecorr::test
