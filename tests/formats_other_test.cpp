// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// VDT, VDA, Ember archives and folders of images: new ones of each, and folders changed and
// damaged.
#include <gmock/gmock.h>

#include <algorithm>
#include <filesystem>

#include "foreign_fixture.hpp"

namespace slicecorr {
namespace {

using test::Bytes;
using test::Entries;
using test::expect_refused;
using test::file;
using test::Images;
using test::kFacts;
using test::like;
using test::Notices;
using test::png_of;
using test::stamped_images;
using test::TemporaryFolder;
using test::to_bytes;
using testing::ElementsAre;
using testing::HasSubstr;

// ---- new archives of all formats -----------------------------------------------------------

struct Case {
  std::string format, path;
};
void PrintTo(const Case& c, std::ostream* out) { *out << c.format; }

class NewOtherArchive : public testing::TestWithParam<Case> {};

TEST_P(NewOtherArchive, IsReadBackAsItWas) {
  const TemporaryFolder folder;
  const Images images = test::random_images(70, 30, 12, 3);
  for (const StackKind kind : {StackKind::target, StackKind::corrected}) {
    StackInfo info = test::info_of(images.grid);
    info.kind = kind;
    info.part_volume_mm3 = 4.25;
    if (kind == StackKind::corrected) {
      info.printer = Printer{"p", 70, 30, 50, 40.5, 8, 405, {{0, 0}, {255, 9}}, 0, 0, {}};
      info.resin = Resin{"r", CureModelKind::jacobs, 1, 100, 20, 0, 0, 0, 0, 1, {}};
      info.process.emplace();
      info.process->speed_mm_h = 10;
      info.target_layers = 10;
    }
    const std::string path = folder / GetParam().path;
    std::filesystem::remove_all(path);
    test::write_stack(file(path, GetParam().format), images, info);
    const StackReader reader(path, folder.path());
    const StackInfo& read = reader.info();
    EXPECT_EQ(test::read_images(reader), images.slices);
    EXPECT_EQ(read.format, GetParam().format);
    EXPECT_EQ(read.kind, kind);
    EXPECT_EQ(read.grid.layers, 12);
    // Of Ember archives only whole micrometres are left, which was told.
    const bool rounded = GetParam().format.starts_with("ember");
    EXPECT_NEAR(read.grid.layer_um, images.grid.layer_um, rounded ? 0.5 : 0);
    EXPECT_EQ(read.grid.pixel_x_um, images.grid.pixel_x_um);
    EXPECT_EQ(read.grid.pixel_y_um, images.grid.pixel_y_um);
    EXPECT_EQ(read.target_layers, info.target_layers);
    EXPECT_EQ(read.part_volume_mm3, 4.25);
    EXPECT_EQ(read.printer, info.printer);
    EXPECT_EQ(read.resin, info.resin);
    EXPECT_EQ(read.process, info.process);
    EXPECT_EQ(StackReader::read_info(path).format, GetParam().format);
    EXPECT_EQ(folder.count(), 1) << "something is left over";
  }
}

TEST_P(NewOtherArchive, IsTheSameEachTime) {
  const TemporaryFolder folder;
  const Images images = test::random_images(40, 50, 5, 4);
  std::vector<Bytes> written[2];
  for (int i = 0; i < 2; ++i) {
    const std::string sub = folder / std::to_string(i);
    std::filesystem::create_directory(sub);
    const std::string path = sub + "/" + GetParam().path;
    ExecutionContext context;
    context.threads = 1 + i;
    test::write_stack(file(path, GetParam().format), images, test::info_of(images.grid), context);
    if (std::filesystem::is_directory(path)) {
      std::vector<std::string> files;
      for (const auto& e : std::filesystem::directory_iterator(path)) files.push_back(e.path());
      std::sort(files.begin(), files.end());
      EXPECT_EQ(files.size(), 6u);
      for (const std::string& f : files) written[i].push_back(test::read_file(f));
    } else {
      written[i].push_back(test::read_file(path));
    }
  }
  EXPECT_EQ(written[0], written[1]);
}

INSTANTIATE_TEST_SUITE_P(Formats, NewOtherArchive,
                         testing::Values(Case{"vdt", "a.vdt"}, Case{"vda", "a.zip"},
                                         Case{"ember", "a.zip"}, Case{"ember-tar", "a.tar.gz"},
                                         Case{"folder", "a"}),
                         [](const auto& info) {
                           std::string name = info.param.format;
                           std::replace(name.begin(), name.end(), '-', '_');
                           return name;
                         });

TEST_P(NewOtherArchive, ImagesInUvLightAreKeptBesideTheSlices) {
  const TemporaryFolder folder;
  const Images images = stamped_images(40, 50, 3, 5);
  StackInfo info = test::info_of(images.grid);
  info.kind = StackKind::corrected;
  info.printer = Printer{"p",
                         40,
                         50,
                         50,
                         40.5,
                         8,
                         405,
                         {{0, 0}, {255, 9}},
                         0,
                         0,
                         UvLamp{365, true, {{0, 0}, {255, 9}}}};
  info.resin = Resin{"r", CureModelKind::jacobs, 1, 100, 20, 0, 0, 0, 0, 1, {}};
  info.resin->inhibition = Inhibition{0.7, 30, 1, 0};
  info.process.emplace();
  info.process->speed_mm_h = 10;
  info.process->uv.kind = UvKind::patterned;
  info.process->uv.dead_zone_um = 50;
  const std::string path = folder / GetParam().path;
  {
    StackWriter writer(file(path, GetParam().format), images.grid, {});
    std::array<std::uint8_t, 256> inverse;
    for (std::size_t v = 0; v < 256; ++v) inverse[v] = static_cast<std::uint8_t>(255 - v);
    writer.set_uv_pattern(inverse);
    StackWriter::BandEncoder encoder(writer, 0, 50);
    for (int n = 0; n < 3; ++n) {
      encoder.put(n, 0, 40, images.slices[static_cast<std::size_t>(n)].data());
    }
    writer.finish(info, {});
  }
  Notices notices;
  const StackReader reader(path, folder.path(), notices.context);
  EXPECT_EQ(test::read_images(reader), images.slices);
  EXPECT_EQ(reader.info().process->uv, info.process->uv);
  EXPECT_EQ(notices.all().find("UV images were changed"), std::string::npos) << notices.all();
}

TEST(FormatNames, EndingsChoose) {
  EXPECT_EQ(format_of("a.vdt"), "vdt");
  EXPECT_EQ(format_of("a.TAR.GZ"), "ember-tar");
  EXPECT_EQ(format_of("a.tgz"), "ember-tar");
  EXPECT_EQ(format_of("some.where/"), "folder");
  EXPECT_EQ(format_of(file("a.zip", "vda")), "vda");
}

// ---- folders -------------------------------------------------------------------------------

class ImageFolder : public testing::Test {
 protected:
  std::string make(const Entries& files) {
    std::filesystem::remove_all(folder_ / "in");
    std::filesystem::create_directory(folder_ / "in");
    for (const auto& [name, data] : files) {
      const std::string path = folder_ / ("in/" + name);
      std::filesystem::create_directories(std::filesystem::path(path).parent_path());
      test::write_file(path, data);
    }
    return folder_ / "in";
  }
  /// Images of one stack by these names, in this order.
  Entries named(const std::vector<std::string>& names) const {
    Entries files;
    for (std::size_t n = 0; n < names.size(); ++n) files.emplace_back(names[n], png_of(images_, n));
    return files;
  }
  TemporaryFolder folder_;
  Images images_ = stamped_images(70, 30, 11, 41);
};

TEST_F(ImageFolder, NumbersCountHoweverTheyAreWritten) {
  const std::vector<std::vector<std::string>> ways{
      {"0.png", "1.png", "2.png", "3.png", "4.png", "5.png", "6.png", "7.png", "8.png", "9.png",
       "10.png"},
      {"slice_1.png", "slice_2.png", "slice_3.png", "slice_4.png", "slice_5.png", "slice_6.png",
       "slice_7.png", "slice_8.png", "slice_9.png", "slice_10.png", "slice_11.png"},
      {"a0001.png", "a0002.png", "a0003.png", "a0004.png", "a0005.png", "a0006.png", "a0007.png",
       "a0008.png", "a0009.png", "a0010.png", "a0011.png"}};
  for (const auto& names : ways) {
    SCOPED_TRACE(names.front());
    Entries files = named(names);
    files.emplace_back("notes.txt", to_bytes("notes"));
    files.emplace_back("cover.png", to_bytes("no slice"));
    files.emplace_back("thumbs/1.png", to_bytes("no slice"));
    const StackReader reader(make(files), folder_.path(), {}, kFacts);
    EXPECT_EQ(test::read_images(reader), images_.slices);
    EXPECT_EQ(reader.info().format, "folder");
    EXPECT_EQ(reader.info().kind, StackKind::foreign);
    EXPECT_EQ(reader.grid().pixel_x_um, kFacts.pixel_x_um);
  }
  const StackInfo info = StackReader::read_info(folder_ / "in");
  EXPECT_EQ(info.grid.pixel_x_um, 0);
  EXPECT_EQ(info.grid.layer_um, 0);
}

TEST_F(ImageFolder, TheLargestSetOfImagesCounts) {
  Notices notices;
  Entries files = named({"a1.png", "a2.png", "a3.png"});
  files.emplace_back("preview1.png", to_bytes("no slice"));
  files.emplace_back("preview2.png", to_bytes("no slice"));
  const StackReader reader(make(files), folder_.path(), notices.context, kFacts);
  EXPECT_EQ(reader.grid().layers, 3);
  EXPECT_THAT(notices.all(), HasSubstr("2 images named previewNUMBER.png left out"));
  files.emplace_back("preview3.png", to_bytes("no slice"));
  expect_refused(make(files), "as many images named aNUMBER.png as previewNUMBER.png");
}

TEST_F(ImageFolder, ChangedOnesKeepTheirNames) {
  Entries before = named({"s0008.png", "s0009.png"});
  before = named(
      {"s1.png", "s2.png", "s3.png", "s4.png", "s5.png", "s6.png", "s7.png", "s8.png", "s9.png"});
  before.emplace_back("notes.txt", to_bytes("notes"));
  make(before);
  StackInfo info = test::info_of(images_.grid);
  info.target_layers = 11;
  const Images others = like(images_, 11, 42);
  for (const std::string name : {"out", "in"}) {
    test::write_stack(file(folder_ / name, "folder", folder_ / "in"), others, info);
    EXPECT_EQ(test::read_file(folder_ / (name + "/notes.txt")), to_bytes("notes"));
    EXPECT_TRUE(std::filesystem::exists(folder_ / (name + "/s11.png")));
    const StackReader reader(folder_ / name, folder_.path());
    EXPECT_EQ(test::read_images(reader), others.slices);
    EXPECT_EQ(reader.info().kind, StackKind::target);
    EXPECT_EQ(reader.grid().pixel_y_um, images_.grid.pixel_y_um) << "slicecorr.json says it";
    EXPECT_THAT(reader.other_entries(), ElementsAre("notes.txt", "slicecorr.json"));
  }
  EXPECT_EQ(folder_.count(), 2);
}

TEST_F(ImageFolder, Damages) {
  expect_refused(make({}), "has no layer images");
  expect_refused(make({{"notes.txt", to_bytes("x")}, {"cover.png", to_bytes("x")}}),
                 "has no layer images");
  expect_refused(make(named({"0.png", "1.png", "3.png"})), "3.png: follows a gap: image 2");
  expect_refused(make(named({"2.png", "3.png"})), "2.png: is the first image, expected number 0");
  expect_refused(make(named({"1.png", "01.png", "2.png"})), "has the number of another image");
  Entries files = named({"0.png", "1.png"});
  files[1].second = encode_png({71, 30, Bytes(71 * 30)});
  expect_refused(make(files), "1.png");
  files[1].second = Bytes(10);
  expect_refused(make(files), "1.png");
  files[0].second = to_bytes("no picture");
  expect_refused(make(files), "0.png");
  make(named({"0.png"}));
  try {
    const StackReader reader(folder_ / "in", folder_.path());
    FAIL() << "sizes are not known";
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("pixels"));
  }
}

TEST_F(ImageFolder, ForeignFoldersAreNotReplaced) {
  make(named({"0.png"}));
  EXPECT_THROW(test::write_stack(folder_ / "in/", images_, test::info_of(images_.grid)),
               InputError);
  EXPECT_EQ(test::read_file(folder_ / "in/0.png"), png_of(images_, 0));
  test::write_stack(folder_ / "ours/", images_, test::info_of(images_.grid));
  const Images others = like(images_, 3, 43);
  test::write_stack(folder_ / "ours/", others, test::info_of(others.grid));
  EXPECT_EQ(test::read_images(StackReader(folder_ / "ours", folder_.path())), others.slices);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "ours/00000003.png"));
}

}  // namespace
}  // namespace slicecorr
