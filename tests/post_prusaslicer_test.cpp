// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Exports of the real PrusaSlicer, corrected in place: all else stays byte for byte, and the
/// images are those that `slicecorr correct` shows. Read with libzip and libpng, past our code.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <zip.h>

#include <algorithm>
#include <filesystem>

#include "ladder.hpp"
#include "post_fixture.hpp"
#include "real_files.hpp"
#include "rounds.hpp"

namespace slicecorr::test {
namespace {

using ::testing::HasSubstr;
namespace fs = std::filesystem;

/// An entry with what the zip says of it.
struct ZipEntry {
  std::string name, comment;
  std::uint16_t method = 0, dos_time = 0, dos_date = 0;
  Bytes data;
};

std::vector<ZipEntry> entries_of(const std::string& path) {
  std::vector<ZipEntry> entries;
  zip_t* const zip = zip_open(path.c_str(), ZIP_RDONLY | ZIP_CHECKCONS, nullptr);
  EXPECT_NE(zip, nullptr) << path;
  const zip_int64_t count = zip ? zip_get_num_entries(zip, 0) : 0;
  for (zip_uint64_t i = 0; i < static_cast<zip_uint64_t>(count); ++i) {
    zip_stat_t status;
    EXPECT_EQ(zip_stat_index(zip, i, 0, &status), 0);
    ZipEntry entry;
    entry.name = status.name;
    entry.method = status.comp_method;
    std::tm local{};
    ::localtime_r(&status.mtime, &local);
    entry.dos_date = static_cast<std::uint16_t>(((local.tm_year - 80) << 9) |
                                                ((local.tm_mon + 1) << 5) | local.tm_mday);
    entry.dos_time = static_cast<std::uint16_t>((local.tm_hour << 11) | (local.tm_min << 5) |
                                                (local.tm_sec / 2));
    zip_uint32_t length = 0;
    if (const char* comment = zip_file_get_comment(zip, i, &length, 0)) {
      entry.comment.assign(comment, length);
    }
    entry.data.resize(status.size);
    zip_file_t* const file = zip_fopen_index(zip, i, 0);
    EXPECT_EQ(zip_fread(file, entry.data.data(), entry.data.size()),
              static_cast<zip_int64_t>(entry.data.size()));
    zip_fclose(file);
    entries.push_back(std::move(entry));
  }
  if (zip) zip_discard(zip);
  return entries;
}

class PrusaSlicer : public PostFolder {
 protected:
  PrusaSlicer() {
    options_.timeout = std::chrono::minutes(5);
    // The maker's file has 4 mW/cm²; these parts are for a brighter one, on a quarter of the display.
    write("sl1s.toml",
          "name = \"sl1s-bright\"\n[display]\nwidth_px = 810\nheight_px = 1280\npixel_um = 50\n"
          "[blue]\ncalibration = [[0, 0.25], [255, 50.0]]\n");
  }
  static bool installed() { return fs::exists("/usr/bin/prusa-slicer"); }

  RunResult export_sl1(const std::string& mesh, const std::string& layer_mm,
                       const std::string& output, const Command& more = {}) const {
    return run_program(Command{"/usr/bin/prusa-slicer",
                               "--export-sla",
                               "--layer-height",
                               layer_mm,
                               "--initial-layer-height",
                               layer_mm,
                               "--supports-enable=0",
                               "--pad-enable=0",
                               "--display-width",
                               "64",
                               "--display-height",
                               "40.5",
                               "--display-pixels-x",
                               "1280",
                               "--display-pixels-y",
                               "810",
                               "--bed-shape",
                               "0x0,64x0,64x40.5,0x40.5",
                               "--display-orientation",
                               "portrait",
                               "--display-mirror-x=1",
                               "--exposure-time",
                               "8",
                               "--initial-exposure-time",
                               "20",
                               "--faded-layers",
                               "5"} +
                           more + Command{"--output", output, mesh},
                       options_);
  }

  void check_corrected(const std::string& before_path, const std::string& after_path,
                       const Command& setup) const {
    const auto before = entries_of(folder_ / before_path), after = entries_of(folder_ / after_path);
    ASSERT_EQ(after.size(), before.size() + 1);
    EXPECT_EQ(after.back().name, "slicecorr.json");
    const RunResult r = run_program(Command{SLICECORR_BIN_DIR "/slicecorr", "correct", before_path,
                                            "-o", "correct.uvj", "--mode", "layerwise"} +
                                        setup,
                                    options_);
    ASSERT_EQ(r.exit_code, 0) << r.err;
    std::vector<ZipEntry> expected;
    for (ZipEntry& e : entries_of(folder_ / "correct.uvj")) {
      if (e.name.starts_with("slice/")) expected.push_back(std::move(e));
    }
    std::size_t layer = 0, changed = 0;
    for (std::size_t i = 0; i < before.size(); ++i) {
      SCOPED_TRACE(before[i].name);
      ASSERT_EQ(after[i].name, before[i].name);
      ASSERT_EQ(after[i].comment, before[i].comment);
      if (!is_layer_image(before[i].name)) {
        ASSERT_EQ(after[i].data, before[i].data);
        ASSERT_EQ(after[i].method, before[i].method);
        ASSERT_EQ(after[i].dos_date, before[i].dos_date);
        ASSERT_EQ(after[i].dos_time, before[i].dos_time);
        continue;
      }
      const GreyImage was = png_pixels(before[i].data), is = png_pixels(after[i].data);
      ASSERT_EQ(is.width_px, was.width_px);
      ASSERT_EQ(is.height_px, was.height_px);
      ASSERT_LT(layer, expected.size());
      ASSERT_EQ(is.pixels, png_pixels(expected[layer++].data).pixels);
      changed += is.pixels != was.pixels;
    }
    EXPECT_EQ(layer, expected.size());
    // What stands on the platform keeps its light; the layers near overhangs change.
    EXPECT_GT(changed, layer / 3);
  }
};

const Command kSetup{"--printer", "sl1s.toml", "--resin", "liqcreate-strong-x-405nm"};

TEST_F(PrusaSlicer, LadderInPlace) {
  if (!installed()) GTEST_SKIP() << "prusa-slicer is not installed";
  write_stl(folder_ / "ladder.stl", ladder());
  const RunResult made = export_sl1("ladder.stl", "0.05", "ladder.sl1");
  ASSERT_EQ(made.exit_code, 0) << made.err;
  fs::copy_file(folder_ / "ladder.sl1", folder_ / "before.sl1");
  const RunResult said = good(kSetup + Command{"ladder.sl1"});
  // What PrusaSlicer wrote: 20 s, then in equal steps to 8 s from the fifth layer on.
  EXPECT_THAT(said.err,
              HasSubstr("layer by layer, 8 s each; the first layer 20 s, then 3 in steps between"));
  check_corrected("before.sl1", "ladder.sl1", kSetup);
}

TEST_F(PrusaSlicer, BenchyInPlaceAndBack) {
  if (!installed()) GTEST_SKIP() << "prusa-slicer is not installed";
  const std::string benchy = test::real_file("meshes/clean/3DBenchy.stl");
  SLICECORR_NEEDS_FILE(benchy);
  const RunResult made =
      export_sl1(benchy, "0.2", "benchy.sl1", {"--scale", by_night() ? "0.25" : "0.15"});
  ASSERT_EQ(made.exit_code, 0) << made.err;
  fs::copy_file(folder_ / "benchy.sl1", folder_ / "before.sl1");
  good(kSetup + Command{"--backup", "benchy.sl1"});
  check_corrected("before.sl1", "benchy.sl1", kSetup);
  good({"--undo", "benchy.sl1"});
  EXPECT_EQ(bytes("benchy.sl1"), bytes("before.sl1"));
}

/// A bracket with overhangs, 12 x 8 x 9 mm.
using Boxes = std::vector<std::pair<Point3, Point3>>;
const Boxes& bracket() {
  static const Boxes boxes{{{0, 0, 0}, {12, 8, 1.5}},
                           {{0, 0, 1.5}, {3, 8, 8}},
                           {{0, 0, 8}, {10, 8, 9}},
                           {{11, 1, 1.5}, {12, 3, 5}}};
  return boxes;
}

/// The recipe of docs/supports.md, judged by the images alone.
TEST_F(PrusaSlicer, SupportsStayAndThePartIsCorrected) {
  if (!installed()) GTEST_SKIP() << "prusa-slicer is not installed";
  TriangleMesh mesh;
  for (const auto& [low, high] : bracket()) add_box(mesh, low, high);
  write_stl(folder_ / "bracket.stl", mesh);
  // Of the same option the last counts.
  const RunResult made =
      export_sl1("bracket.stl", "0.05", "bracket.sl1", {"--supports-enable=1", "--pad-enable=1"});
  ASSERT_EQ(made.exit_code, 0) << made.err;
  fs::copy_file(folder_ / "bracket.sl1", folder_ / "before.sl1");
  const RunResult said = good(kSetup + Command{"--part", "bracket.stl", "bracket.sl1"});
  // In the middle of 64 x 40.5 mm, on a pad of 2 mm and supports of 5.
  EXPECT_THAT(said.err, HasSubstr("bracket.stl: found at x 32.00, y 20.25 mm, from 7.000 mm above "
                                  "the platform on: 99."));
  EXPECT_THAT(said.err, HasSubstr("mm³ outside of it are left alone"));
  const auto before = entries_of(folder_ / "before.sl1"),
             after = entries_of(folder_ / "bracket.sl1");
  ASSERT_EQ(after.size(), before.size() + 1);
  int layer = 0, alone = 0, changed = 0, near = 0;
  for (std::size_t i = 0; i < before.size(); ++i) {
    if (!is_layer_image(before[i].name)) continue;
    const GreyImage was = png_pixels(before[i].data), is = png_pixels(after[i].data);
    ASSERT_EQ(is.pixels.size(), was.pixels.size());
    for (int v = 0; v < was.height_px; ++v) {
      for (int u = 0; u < was.width_px; ++u) {
        const auto at = static_cast<std::size_t>(v * was.width_px + u);
        // Portrait and mirrored in x: x of the plate runs up the image, y to the right.
        const Point3 p{(was.height_px - v - 0.5) * 0.05 - 32 + 6, (u + 0.5) * 0.05 - 20.25 + 4,
                       (layer + 0.5) * 0.05 - 7};
        bool inside = false, grown = false;
        for (const auto& [low, high] : bracket()) {
          bool in = true, wider = true;
          for (std::size_t k = 0; k < 3; ++k) {
            in &= p[k] > low[k] && p[k] < high[k];
            // Grown by a voxel, at a place that is rounded to one.
            wider &= p[k] > low[k] - 0.1001 && p[k] < high[k] + 0.1001;
          }
          inside |= in;
          grown |= wider;
        }
        if (!grown) {
          ASSERT_EQ(is.pixels[at], was.pixels[at]) << layer << " " << u << " " << v;
          alone += was.pixels[at] > 0;
        } else if (inside) {
          ASSERT_EQ(was.pixels[at], 255) << layer << " " << u << " " << v;
          changed += is.pixels[at] != was.pixels[at];
        } else {
          near += was.pixels[at] > 0;
        }
      }
    }
    ++layer;
  }
  EXPECT_EQ(layer, 320);
  // A pad of 40 slices, larger than the part.
  EXPECT_GT(alone, 40 * 240 * 160);
  // Below the part's bottom and the upper beam at least a slice is dimmed.
  EXPECT_GT(changed, 240 * 160 + 140 * 160);
  // What of the supports is next to the part: tips of 0.4 mm.
  EXPECT_LT(near, 20000);
  // Another part is not there, and the file stays.
  write_stl(folder_ / "ladder.stl", ladder());
  const RunResult other = post(kSetup + Command{"--part", "ladder.stl", "before.sl1"});
  EXPECT_EQ(other.exit_code, 2);
  EXPECT_THAT(other.err, HasSubstr("is not in the archive"));
}

/// Why a watched folder, and not the slicer's own setting.
TEST_F(PrusaSlicer, RunsNoPostProcessingForResinPrinters) {
  if (!installed()) GTEST_SKIP() << "prusa-slicer is not installed";
  write_stl(folder_ / "ladder.stl", ladder());
  write("script", "#!/bin/sh\ntouch " + (folder_ / "ran") + "\n");
  fs::permissions(folder_ / "script", fs::perms::owner_all);
  const RunResult made =
      export_sl1("ladder.stl", "0.1", "ladder.sl1", {"--post-process", folder_ / "script"});
  ASSERT_EQ(made.exit_code, 0) << made.err;
  EXPECT_TRUE(there("ladder.sl1"));
  EXPECT_FALSE(there("ran"));
}

TEST_F(PrusaSlicer, ExportsIntoAWatchedFolderByTheirProfiles) {
  if (!installed()) GTEST_SKIP() << "prusa-slicer is not installed";
  write_stl(folder_ / "ladder.stl", ladder());
  fs::create_directory(folder_ / "exports");
  write("config/slicecorr/post.toml",
        "[[rule]]\nfolder = \"~/exports\"\nmaterial_profile = \"Strong-X*\"\nprinter = \"" +
            (folder_ / "sl1s.toml") + "\"\nresin = \"liqcreate-strong-x-405nm\"\n");
  write("profiles.ini",
        "printer_technology = SLA\nsla_material_settings_id = Strong-X @0.1\n"
        "printer_settings_id = My SL1S\n");
  const RunResult made =
      export_sl1("ladder.stl", "0.1", "exports/ladder.sl1", {"--load", folder_ / "profiles.ini"});
  ASSERT_EQ(made.exit_code, 0) << made.err;
  const RunResult watched = post({"--watch", "exports", "--once"});
  EXPECT_EQ(watched.exit_code, 0) << watched.err;
  EXPECT_THAT(watched.err, HasSubstr("corrected " + (folder_ / "exports/ladder.sl1")));
  EXPECT_THAT(watched.err, HasSubstr("rule 'rule 1'"));
}

}  // namespace
}  // namespace slicecorr::test
