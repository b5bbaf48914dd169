// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Binary print files: small files of every kind, real ones.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <set>

#include "newer_print_file_fixture.hpp"
#include "rounds.hpp"
#include "slicecorr/file_times.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/print_file.hpp"
#include "stack/container/binary_file.hpp"
#include "stack/formats/archive_format.hpp"

namespace slicecorr::test {

void PrintTo(const SmallFile& file, std::ostream* out) { *out << file.name; }

namespace {

using ::testing::HasSubstr;

// ---- small files ------------------------------------------------------------------------------

class SmallPrintFiles : public testing::TestWithParam<SmallFile> {
 protected:
  SmallPrintFiles() : path_(folder_ / GetParam().name) { write_file(path_, GetParam().bytes); }
  StackReader reader(ExecutionContext context = {}) const {
    return {path_, folder_.path(), context};
  }
  TemporaryFolder folder_;
  std::string path_;
};
/// Binary ones, and the zip whose layers have a code of their own.
std::vector<SmallFile> all_small_files() {
  std::vector<SmallFile> files = small_binary_files();
  files.push_back(small_anycubic_zip());
  return files;
}
INSTANTIATE_TEST_SUITE_P(Print, SmallPrintFiles, testing::ValuesIn(all_small_files()),
                         [](const auto& info) { return name_of(info.param.name); });

TEST_P(SmallPrintFiles, AreRead) {
  const StackReader r = reader();
  EXPECT_EQ(r.info().format, GetParam().format);
  EXPECT_EQ(r.info().kind, StackKind::foreign);
  EXPECT_EQ(r.grid().layers, kFileLayers);
  EXPECT_NEAR(r.grid().pixel_x_um, 50, 1e-3);
  EXPECT_NEAR(r.grid().pixel_y_um, 50, 1e-3);
  EXPECT_NEAR(r.grid().layer_um, 50, 1e-3);
  EXPECT_EQ(read_images(r), GetParam().slices);
  EXPECT_GT(r.info().exposure_s, 0);
  EXPECT_GT(r.info().bottom_layers, 0);
}

TEST_P(SmallPrintFiles, RewrittenWithoutAChangeTheyAreTheSameBytes) {
  const std::string out = folder_ / ("out_" + GetParam().name);
  StackFile file(out);
  file.keep_from = path_;
  convert_stack(reader(), file, {});
  EXPECT_EQ(read_file(out), GetParam().bytes);
}

Images changed_images(const StackReader& r, int layers) {
  Images images{r.grid(), read_images(r)};
  images.grid.layers = layers;
  // One pixel of one layer, and what is added.
  images.slices[2][5 * kFileWidth + 7] = images.slices[2][5 * kFileWidth + 7] > 0 ? 0 : 255;
  images.slices.resize(static_cast<std::size_t>(layers), images.slices.back());
  return images;
}

TEST_P(SmallPrintFiles, ChangedImagesAndMoreLayersAreReadBack) {
  for (const int layers : {kFileLayers, kFileLayers + 3, kFileLayers - 1}) {
    const std::string out = folder_ / ("out_" + GetParam().name);
    const StackReader r = reader();
    const Images images = changed_images(r, layers);
    StackFile file(out);
    file.keep_from = path_;
    StackInfo info = r.info();
    info.grid.layers = info.target_layers = layers;
    write_stack(file, images, info);
    const StackReader back(out, folder_.path());
    EXPECT_EQ(read_images(back), images.slices) << layers;
    EXPECT_EQ(back.info().exposure_s, r.info().exposure_s);
    EXPECT_EQ(back.info().bottom_layers, r.info().bottom_layers);
    EXPECT_EQ(back.info().layer_exposure_s, r.info().layer_exposure_s);
    // And the same file again from the changed one.
    StackFile again(folder_ / ("again_" + GetParam().name));
    again.keep_from = out;
    convert_stack(back, again, {});
    EXPECT_EQ(read_file(again.path), read_file(out));
  }
}

TEST_P(SmallPrintFiles, ExposuresAreChangedWhereTheyAreAskedFor) {
  const StackReader r = reader();
  StackInfo info = r.info();
  info.exposure_s = 3;
  info.bottom_exposure_s = 50;
  info.bottom_layers = 3;
  info.fade_layers = 0;
  info.layer_exposure_s.clear();
  StackFile file(folder_ / ("out_" + GetParam().name));
  file.keep_from = path_;
  write_stack(file, {r.grid(), read_images(r)}, info);
  const StackReader back(file.path, folder_.path());
  EXPECT_NEAR(back.info().exposure_s, 3, 1e-6);
  EXPECT_NEAR(back.info().bottom_exposure_s, 50, 1e-6);
  EXPECT_EQ(back.info().bottom_layers, 3);
  EXPECT_TRUE(back.info().layer_exposure_s.empty());
  EXPECT_EQ(read_images(back), GetParam().slices);
}

using SmallBinaryFiles = SmallPrintFiles;
INSTANTIATE_TEST_SUITE_P(Print, SmallBinaryFiles, testing::ValuesIn(small_binary_files()),
                         [](const auto& info) { return name_of(info.param.name); });

/// The record lies beside, and counts for the file that it is of.
TEST_P(SmallBinaryFiles, ARecordBesideIsBelievedOnlyOfItsOwnFile) {
  const StackReader r = reader();
  StackFile file(folder_ / ("out_" + GetParam().name));
  file.keep_from = path_;
  StackInfo info = r.info();
  info.kind = StackKind::target;
  write_stack(file, {r.grid(), read_images(r)}, info);
  ASSERT_TRUE(std::filesystem::exists(record_beside(file.path)));
  EXPECT_EQ(StackReader::read_info(file.path).kind, StackKind::target);
  EXPECT_EQ(StackReader(file.path, folder_.path()).images_changed(), false);
  // Exported anew, with another layer.
  StackFile other(folder_ / ("other_" + GetParam().name));
  other.keep_from = path_;
  StackInfo foreign = r.info();
  write_stack(other, changed_images(r, kFileLayers), foreign);
  EXPECT_FALSE(std::filesystem::exists(record_beside(other.path)));
  std::filesystem::copy_file(other.path, file.path,
                             std::filesystem::copy_options::overwrite_existing);
  std::string told;
  ExecutionContext context;
  context.notice = [&](const std::string& text) { told += text; };
  EXPECT_EQ(StackReader(file.path, folder_.path(), context).info().kind, StackKind::foreign);
  EXPECT_THAT(told, HasSubstr("is of another file"));
  // Renamed, a file takes its record along, and one of the old file goes.
  rename_with_record(other.path, file.path);
  EXPECT_FALSE(std::filesystem::exists(record_beside(file.path)));
}

/// The same bytes for any damage: read, or refused with the file's name. No crash, no hang.
TEST_P(SmallPrintFiles, RandomDamageIsRefusedOrRead) {
  const int count = rounds(150);
  std::mt19937 random(3);
  const std::string path = folder_ / ("damaged_" + GetParam().name);
  // Most of GOO and CXDLP are previews: damage is wanted elsewhere.
  std::vector<std::size_t> places;
  const Bytes& sound = GetParam().bytes;
  for (std::size_t i = 0; i < sound.size(); ++i) {
    if (i < 256 || sound[i] != 0 || (i > 0 && sound[i - 1] != 0)) places.push_back(i);
  }
  for (int round = 0; round < count; ++round) {
    Bytes bytes = sound;
    if (random() % 8 == 0) bytes.resize(random() % bytes.size());
    for (unsigned hits = 1 + random() % 3; hits > 0; --hits) {
      const std::size_t at = places[random() % places.size()];
      if (at >= bytes.size()) continue;
      constexpr std::uint8_t values[] = {0, 1, 0x7f, 0x80, 0xff};
      bytes[at] = random() % 2 ? values[random() % 5] : static_cast<std::uint8_t>(random());
    }
    // A wrong checksum hides all else.
    if (round % 4 > 0) set_cxdlp_sum(bytes.data(), bytes.size());
    write_file(path, bytes);
    try {
      StackReader(path, folder_.path(), {}, {50, 50, 50});
    } catch (const InputError& e) {
      EXPECT_THAT(e.what(), HasSubstr(path));
    }
  }
}

TEST(PrintFiles, FormatsSayWhatTheyCanHold) {
  EXPECT_TRUE(limits_of_format("goo").made_new);
  EXPECT_EQ(limits_of_format("goo").levels, 256);
  EXPECT_TRUE(limits_of_format("ctb").made_new);
  EXPECT_EQ(limits_of_format("ctb").levels, 128);
  EXPECT_TRUE(limits_of_format("sl1").made_new);
  for (const char* name :
       {"photon", "photon-workshop", "phz", "fdg", "cxdlp", "lgs", "anycubic-zip"}) {
    EXPECT_FALSE(limits_of_format(name).made_new) << name;
  }
}

TEST(PrintFiles, WhatIsOnlyChangedIsNotMadeFromNothing) {
  const TemporaryFolder folder;
  const Images images = random_images(8, 8, 2, 1);
  try {
    write_stack(folder / "a.lgs", images, info_of(images.grid));
    ADD_FAILURE();
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr("as the template"));
  }
}

// ---- real files --------------------------------------------------------------------------------

struct RealPrintFile {
  const char *name, *format;
  int layers, width_px, height_px, levels_found;
};
void PrintTo(const RealPrintFile& file, std::ostream* out) { *out << file.name; }

constexpr RealPrintFile kReal[] = {
    {"pfe_smilie.v1.photon", "photon", 13, 1440, 2560, 2},
    {"pyphotonfile_reference.v1.photon", "photon", 10, 1440, 2560, 2},
    {"mariner_pyramid.v3.ctb", "ctb", 50, 1440, 2560, 76},
    {"msla_saturn.v4.ctb", "ctb", 426, 3840, 2400, 82},
    {"msla_mars4max.goo.gz", "goo", 426, 5760, 3600, 194},
    {"msla_photon_mono.v515.pwmo.gz", "photon-workshop", 426, 1620, 2560, 2},
    {"msla_photon_mono_x.v516.pwmx.gz", "photon-workshop", 426, 3840, 2400, 2},
    {"msla_photon_mono_4k.v516.pwma.gz", "photon-workshop", 426, 3840, 2400, 2},
    {"msla_photon_m3.v516.pm3.gz", "photon-workshop", 426, 4096, 2560, 2},
    {"msla_halot_one_plus.v3.cxdlp.gz", "cxdlp", 622, 4320, 2560, 2},
    {"uv3dp_microsupports3.lgs", "lgs", 251, 480, 854, 16},
};

class RealPrintFiles : public testing::TestWithParam<RealPrintFile> {};
INSTANTIATE_TEST_SUITE_P(Print, RealPrintFiles, testing::ValuesIn(kReal),
                         [](const auto& info) { return name_of(info.param.name); });

void read_and_rewrite(const RealPrintFile& real) {
  const Bytes bytes = real_print_file(real.name);
  if (bytes.empty()) GTEST_SKIP() << lacks(real_file(std::string("slices/binary/") + real.name));
  const TemporaryFolder folder;
  write_file(folder / "in.bin", bytes);
  std::string told;
  ExecutionContext context;
  context.notice = [&](const std::string& text) { told += text; };
  const StackReader r(folder / "in.bin", folder.path(), context);
  // Its table fades in other steps than printers do, which go by its head.
  const bool unheeded = std::string(real.name).starts_with("msla_mars4max");
  EXPECT_EQ(told.find("do not heed times of single layers") != told.npos, unheeded) << told;
  EXPECT_EQ(told.empty(), !unheeded) << told;
  if (unheeded) {
    EXPECT_NEAR(layer_exposure_s(process_of_times(r.info()), 2), 35 - 32.5 / 6, 1e-6);
  }
  EXPECT_EQ(r.info().format, real.format);
  EXPECT_EQ(r.grid().layers, real.layers);
  EXPECT_EQ(r.grid().width_px, real.width_px);
  EXPECT_EQ(r.grid().height_px, real.height_px);
  EXPECT_EQ(r.grid().layer_um, 50);
  StackFile out(folder / "out.bin");
  out.format = real.format;
  out.keep_from = folder / "in.bin";
  convert_stack(r, out, context);
  EXPECT_TRUE(read_file(out.path) == bytes) << "other bytes";
}

/// Of files of one program, one version and one kind of pixels the first by day, the others at night.
std::vector<RealPrintFile> real_files(bool night) {
  std::vector<RealPrintFile> files;
  for (const RealPrintFile& real : kReal) {
    const std::string name = real.name;
    const bool sibling =
        name == "msla_photon_mono_4k.v516.pwma.gz" || name == "msla_photon_m3.v516.pm3.gz";
    if (sibling == night) files.push_back(real);
  }
  return files;
}
using RealPrintFilesWhole = RealPrintFiles;
INSTANTIATE_TEST_SUITE_P(Print, RealPrintFilesWhole, testing::ValuesIn(real_files(false)),
                         [](const auto& info) { return name_of(info.param.name); });
TEST_P(RealPrintFilesWhole, AreReadAndRewrittenToTheSameBytes) { read_and_rewrite(GetParam()); }

using RealPrintFilesNight = RealPrintFiles;
INSTANTIATE_TEST_SUITE_P(Print, RealPrintFilesNight, testing::ValuesIn(real_files(true)),
                         [](const auto& info) { return name_of(info.param.name); });
TEST_P(RealPrintFilesNight, AreReadAndRewrittenToTheSameBytes) { read_and_rewrite(GetParam()); }

/// Our codes make the bytes of the slicers' own where these write longest runs. By day every seventh
/// layer of what has black and white alone is looked at.
TEST_P(RealPrintFiles, CodesAreThoseOfTheSlicer) {
  const RealPrintFile& real = GetParam();
  const int step = rounds(1) == 1 && real.layers > 400 && real.levels_found == 2 ? 7 : 1;
  const Bytes bytes = real_print_file(real.name);
  if (bytes.empty()) GTEST_SKIP() << lacks(real_file(std::string("slices/binary/") + real.name));
  const TemporaryFolder folder;
  write_file(folder / "in.bin", bytes);
  const detail::BinaryFile file(folder / "in.bin");
  const detail::ArchiveContents contents = detail::read_contents(file);
  const auto pieces = static_cast<std::size_t>(contents.codec->pieces());
  int same = 0, seen = 0;
  std::set<std::uint8_t> levels;
  Bytes pixels(contents.codec->pixel_count());
  for (std::size_t n = 0; n < static_cast<std::size_t>(real.layers);
       n += static_cast<std::size_t>(step)) {
    std::vector<Bytes> old(pieces);
    for (std::size_t p = 0; p < pieces; ++p) {
      const auto& place = contents.places[n * pieces + p];
      file.read_at(place.offset, place.size, old[p], "layer");
    }
    contents.codec->decode(old, pixels.data(), {real.name, static_cast<int>(n)});
    detail::each_pixel_run(pixels.data(), pixels.size(),
                           [&](std::uint8_t v, std::size_t) { levels.insert(v); });
    same += coded(*contents.codec, static_cast<int>(n), pixels) == old;
    ++seen;
  }
  EXPECT_EQ(static_cast<int>(levels.size()), real.levels_found);
  RecordProperty("same_layers", same);
  const bool longest_runs =
      std::string(real.format) != "ctb" && std::string(real.format) != "photon";
  if (longest_runs) {
    EXPECT_EQ(same, seen);
  }
}

/// One of the two has the sets of each layer together. Read as printers read it, it is a stack of its
/// own, whose sets are nested like those of the other: nothing in the file tells.
TEST(RealPrintFilesToo, OfEightSetsHaveNineLevels) {
  const std::string zip = real_file("slices/binary/photonsters_aa_test.cbddlp.zip");
  if (const std::string why = lacks(zip); !why.empty()) GTEST_SKIP() << why;
  const TemporaryFolder folder;
  int read = 0;
  for (const auto& [name, entry] : unzip(zip)) {
    write_file(folder / "in.cbddlp", entry);
    const StackReader r(folder / "in.cbddlp", folder.path());
    EXPECT_EQ(r.grid().layers, 8);
    std::set<std::uint8_t> levels;
    for (const Bytes& slice : read_images(r)) {
      detail::each_pixel_run(slice.data(), slice.size(),
                             [&](std::uint8_t v, std::size_t) { levels.insert(v); });
    }
    EXPECT_EQ(levels.size(), 9u);
    StackFile out(folder / "out.cbddlp");
    out.keep_from = folder / "in.cbddlp";
    convert_stack(r, out, {});
    EXPECT_TRUE(read_file(out.path) == entry) << name;
    ++read;
  }
  EXPECT_EQ(read, 2);
}

TEST(RealPrintFilesToo, OneThatLacksAPixelIsReadAndTold) {
  const Bytes bytes = real_print_file("pyphotonfile_short_layer.v1.photon");
  if (bytes.empty()) GTEST_SKIP() << lacks(real_file("slices/binary"));
  const TemporaryFolder folder;
  write_file(folder / "in.photon", bytes);
  std::string told;
  ExecutionContext context;
  context.notice = [&](const std::string& text) { told += text; };
  const StackReader r(folder / "in.photon", folder.path(), context);
  EXPECT_THAT(told, HasSubstr("by 1 pixels, which are taken as black"));
  StackFile out(folder / "out.photon");
  out.keep_from = folder / "in.photon";
  convert_stack(r, out, context);
  EXPECT_EQ(read_file(out.path), bytes);
}

}  // namespace
}  // namespace slicecorr::test
