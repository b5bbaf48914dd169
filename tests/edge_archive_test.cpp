// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Edge heights in archives: written, read, turned, converted, damaged.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "memory_slices.hpp"
#include "meshes.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/print_file.hpp"
#include "slicecorr/turned.hpp"
#include "stack_fixture.hpp"

namespace slicecorr {
namespace {

using nlohmann::json;
using test::Bytes;
using test::Entries;
using test::MemorySlices;
using test::TemporaryFolder;
using testing::HasSubstr;

constexpr int kWidth = 70, kHeight = 90;

MeshSlices sphere_slices(bool edge_heights = true) {
  SliceOptions options = test::layer_of(100);
  options.edge_heights = edge_heights;
  options.center_mm = {1.5, 2.6};
  return {test::sphere(1.2, 3), test::printer(kWidth, kHeight, 50, 50), options};
}

std::string surface(int node) {
  char name[50];
  std::snprintf(name, sizeof name, "slicecorr/surface/%08d.png", node);
  return name;
}

json block_of(const Entries& entries) {
  for (const auto& e : entries) {
    if (e.first == "config.json") return json::parse(test::to_text(e.second))["slicecorr"];
  }
  return {};
}

class EdgeArchive : public testing::Test {
 protected:
  EdgeArchive() : slices_(sphere_slices()) { write_target(slices_, path_); }

  std::string told_by(const std::function<void(const ExecutionContext&)>& work) {
    std::string told;
    ExecutionContext context;
    context.notice = [&](const std::string& text) { told += text + "\n"; };
    work(context);
    return told;
  }
  void expect_refused(const Entries& entries, const std::string& part) {
    test::make_zip(folder_ / "bad.uvj", entries);
    try {
      const StackReader reader(folder_ / "bad.uvj", folder_.path());
      FAIL() << "read, expected an error with: " << part;
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), HasSubstr("bad.uvj"));
      EXPECT_THAT(error.what(), HasSubstr(part));
    }
  }

  TemporaryFolder folder_;
  const std::string path_ = folder_ / "sphere.uvj";
  const MeshSlices slices_;
};

TEST_F(EdgeArchive, HoldsWhatTheSlicerGives) {
  const StackReader reader(path_, folder_.path());
  ASSERT_NE(reader.edge_heights(), nullptr);
  EXPECT_TRUE(reader.info().has_edge_heights);
  EXPECT_TRUE(StackReader::read_info(path_).has_edge_heights);
  EXPECT_FALSE(reader.edge_heights_changed());
  EXPECT_EQ(reader.edge_heights()->grid().layers, reader.grid().layers + 1);
  EXPECT_EQ(MemorySlices(*reader.edge_heights()), MemorySlices(*slices_.edge_heights()));
  EXPECT_EQ(MemorySlices(reader), MemorySlices(slices_));
  const PixelBox all{0, 0, kWidth, kHeight}, lit = reader.edge_heights()->bounds();
  EXPECT_EQ(lit.united(reader.bounds()).width(), reader.bounds().width());
  EXPECT_LT(lit.width(), all.width());
  for (const std::string& name : reader.other_entries()) EXPECT_THAT(name, Not(HasSubstr("surf")));
  // Boxes are parts of the whole.
  const MemorySlices whole(*reader.edge_heights());
  reader.edge_heights()->read_band({11, 40, 30, 73}, [&](int n, const std::uint8_t* rows) {
    for (int y = 40; y < 73; ++y) {
      for (int x = 11; x < 30; ++x) {
        ASSERT_EQ(rows ? rows[(y - 40) * 19 + x - 11] : 0, whole.at(n, x, y));
      }
    }
  });
}

TEST_F(EdgeArchive, SaysSoInItsBlockAndOnlyThen) {
  const Entries with = test::unzip(path_);
  EXPECT_EQ(block_of(with)["format"], 5);
  EXPECT_TRUE(block_of(with).contains("edge_images_crc32"));
  write_target(sphere_slices(false), folder_ / "plain.uvj");
  const Entries without = test::unzip(folder_ / "plain.uvj");
  EXPECT_EQ(block_of(without)["format"], 1);
  EXPECT_FALSE(block_of(without).contains("edge_images_crc32"));
  EXPECT_EQ(with.size(), without.size() + static_cast<std::size_t>(slices_.grid().layers) + 1);
  // All else has the same bytes.
  for (const auto& e : without) {
    if (e.first == "config.json") continue;
    Entries copy = with;
    EXPECT_EQ(test::entry(copy, e.first), e.second) << e.first;
  }
  const StackReader reader(folder_ / "plain.uvj", folder_.path());
  EXPECT_EQ(reader.edge_heights(), nullptr);
  EXPECT_FALSE(reader.info().has_edge_heights);
}

TEST_F(EdgeArchive, BytesDoNotDependOnThreads) {
  for (const bool archive : {false, true}) {
    Bytes first;
    for (const int threads : {1, 2, 5}) {
      ExecutionContext context;
      context.threads = threads;
      StackFile file(folder_ / "again.uvj");
      file.archive = archive;
      write_target(slices_, file, context);
      const Bytes bytes = test::read_file(file.path);
      if (first.empty()) first = bytes;
      EXPECT_EQ(bytes, first) << threads;
    }
    if (!archive) {
      EXPECT_EQ(first, test::read_file(path_));
    }
    const StackReader reader(folder_ / "again.uvj", folder_.path());
    EXPECT_EQ(MemorySlices(*reader.edge_heights()), MemorySlices(*slices_.edge_heights()));
  }
}

TEST_F(EdgeArchive, IsTurnedWithItsSlices) {
  for (const Turn turn :
       {Turn{true, false, false}, Turn{false, true, false}, Turn{true, true, true}}) {
    const TurnedSlices turned_slices(slices_, turn, folder_.path());
    ASSERT_NE(turned_slices.edge_heights(), nullptr);
    const MemorySlices is(*turned_slices.edge_heights());
    const TurnedSlices expected(*slices_.edge_heights(), turn, folder_.path());
    EXPECT_EQ(is, MemorySlices(expected));
    write_target(turned_slices, folder_ / "turned.uvj");
    const StackReader reader(folder_ / "turned.uvj", folder_.path());
    EXPECT_EQ(MemorySlices(*reader.edge_heights()), is);
    // Edges still lie at the edges of the part.
    const MemorySlices coverage(reader);
    int edges = 0;
    for (int n = 1; n < coverage.grid().layers; ++n) {
      for (int y = 0; y < coverage.grid().height_px; ++y) {
        for (int x = 0; x < coverage.grid().width_px; ++x) {
          if (std::abs(coverage.at(n, x, y) - coverage.at(n - 1, x, y)) != 255) continue;
          ++edges;
          EXPECT_NE(is.at(n, x, y), 0);
        }
      }
    }
    EXPECT_GT(edges, 100);
  }
  const MeshSlices plain = sphere_slices(false);
  EXPECT_EQ(TurnedSlices(plain, {true, false, false}, folder_.path()).edge_heights(), nullptr);
}

TEST_F(EdgeArchive, ConversionsKeepOrLoseThem) {
  const StackReader reader(path_, folder_.path());
  for (const bool kept : {false, true}) {
    StackFile file(folder_ / "copy.uvj");
    if (kept) file.keep_from = path_;
    EXPECT_THAT(told_by([&](const auto& context) { convert_stack(reader, file, context); }),
                Not(HasSubstr("edge heights")));
    const StackReader copy(file.path, folder_.path());
    ASSERT_NE(copy.edge_heights(), nullptr);
    EXPECT_EQ(MemorySlices(*copy.edge_heights()), MemorySlices(*slices_.edge_heights()));
    EXPECT_FALSE(copy.edge_heights_changed());
  }
  for (const FormatInfo& format : archive_formats()) {
    if (format.name == "uvj" || !limits_of_format(format.name).made_new) continue;
    SCOPED_TRACE(format.name);
    StackFile file(folder_ / ("copy" + (format.endings.empty() ? "" : format.endings[0])));
    file.format = format.name;
    EXPECT_THAT(told_by([&](const auto& context) { convert_stack(reader, file, context); }),
                HasSubstr("edge heights"));
    const StackReader copy(file.path, folder_.path(), {}, {50, 50, 100});
    EXPECT_EQ(copy.edge_heights(), nullptr);
    EXPECT_FALSE(copy.info().has_edge_heights);
    EXPECT_EQ(copy.info().kind, StackKind::target);
    // And slicing into it at once is the same.
    EXPECT_THAT(told_by([&](const auto& context) { write_target(slices_, file, context); }),
                HasSubstr("edge heights"));
    EXPECT_EQ(StackReader(file.path, folder_.path(), {}, {50, 50, 100}).edge_heights(), nullptr);
  }
}

TEST_F(EdgeArchive, DamagedImagesAreRefused) {
  const Entries sound = test::unzip(path_);
  const int nodes = slices_.grid().layers + 1;
  const auto without = [&](const std::string& name) {
    Entries entries = sound;
    std::erase_if(entries, [&](const auto& e) { return e.first == name; });
    return entries;
  };
  expect_refused(without(surface(0)), surface(0));
  expect_refused(without(surface(7)), surface(7));
  expect_refused(without(surface(nodes - 1)), surface(nodes - 1));

  Entries more = sound;
  more.push_back(more.back());
  more.back().first = surface(nodes);
  expect_refused(more, surface(nodes) + ": is one node too many");
  more.back().first = "slicecorr/surface/a.png";
  expect_refused(more, "a.png");

  Entries wrong_size = sound;
  test::entry(wrong_size, surface(5)) =
      encode_png({kHeight, kWidth, Bytes(static_cast<std::size_t>(kWidth * kHeight), 9)});
  expect_refused(wrong_size, surface(5));

  const Bytes png = test::entry(wrong_size, surface(6));
  for (std::size_t i = 0; i < png.size(); i += 7) {
    Entries entries = sound;
    test::entry(entries, surface(6))[i] ^= static_cast<std::uint8_t>(1u << i % 8);
    expect_refused(entries, surface(6));
    if (HasFailure()) FAIL() << "byte " << i;
  }
}

TEST_F(EdgeArchive, ChangedImagesAreNamed) {
  Entries entries = test::unzip(path_);
  Bytes& png = test::entry(entries, surface(6));
  GreyImage image = decode_png(png, kWidth, kHeight, "a", "b");
  image.pixels[static_cast<std::size_t>(37 * kWidth + 30)] ^= 3;
  png = encode_png(image);
  test::make_zip(folder_ / "changed.uvj", entries);
  const std::string told = told_by([&](const auto& context) {
    const StackReader reader(folder_ / "changed.uvj", folder_.path(), context);
    EXPECT_TRUE(reader.edge_heights_changed());
    EXPECT_FALSE(reader.images_changed());
  });
  EXPECT_THAT(told, HasSubstr("edge heights were changed"));
}

TEST_F(EdgeArchive, BlocksThatContradictAreRefused) {
  const Entries sound = test::unzip(path_);
  const auto with = [&](const std::function<void(json&)>& change) {
    Entries entries = sound;
    Bytes& config = test::entry(entries, "config.json");
    json text = json::parse(test::to_text(config));
    change(text["slicecorr"]);
    config = test::to_bytes(text.dump());
    return entries;
  };
  expect_refused(with([](json& b) { b.erase("edge_images_crc32"); }), "edge_images_crc32");
  expect_refused(with([](json& b) { b["edge_images_crc32"] = -1; }), "edge_images_crc32");
  expect_refused(with([](json& b) { b["kind"] = "foreign"; }), "kind");
  expect_refused(with([](json& b) { b["format"] = 16; }), "newer version");
  // Of an earlier version they would be entries like others; but the checksum tells.
  expect_refused(with([](json& b) { b["format"] = 1; }), "checksum");
}

}  // namespace
}  // namespace slicecorr
