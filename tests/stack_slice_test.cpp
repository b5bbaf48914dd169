// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Whole images of single slices, images of the UV lamp, and what checksums say of both.
#include <thread>

#include "stack_fixture.hpp"

namespace slicecorr {
namespace {

using test::Bytes;
using test::Images;
using test::TemporaryFolder;

/// A corrected stack of a printer whose UV lamp is patterned: uv = 255 - v / 2, so that black is
/// bright.
std::uint8_t uv_of(std::uint8_t v) { return static_cast<std::uint8_t>(255 - v / 2); }

void write_patterned(const StackFile& file, const Images& images) {
  const Grid& grid = images.grid;
  StackInfo info = test::info_of(grid);
  info.kind = StackKind::corrected;
  info.printer.emplace();
  info.printer->name = "p";
  info.printer->width_px = grid.width_px;
  info.printer->height_px = grid.height_px;
  info.printer->pixel_x_um = grid.pixel_x_um;
  info.printer->pixel_y_um = grid.pixel_y_um;
  info.printer->calibration = {{0, 0}, {255, 9}};
  info.printer->uv = UvLamp{365, true, {{0, 0}, {255, 9}}};
  info.resin = Resin{"r", CureModelKind::jacobs, 1, 100, 20, 0, 0, 0, 0, 1, {}};
  info.resin->inhibition = Inhibition{0.7, 30, 1, 0};
  info.process.emplace();
  info.process->speed_mm_h = 10;
  info.process->uv.kind = UvKind::patterned;
  info.process->uv.dead_zone_um = 50;
  StackWriter writer(file, grid, {});
  std::array<std::uint8_t, 256> map{};
  for (std::size_t v = 0; v < 256; ++v) map[v] = uv_of(static_cast<std::uint8_t>(v));
  writer.set_uv_pattern(map);
  StackWriter::BandEncoder encoder(writer, 0, grid.height_px);
  for (int n = 0; n < grid.layers; ++n) {
    encoder.put(n, 0, grid.width_px, images.slices[static_cast<std::size_t>(n)].data());
  }
  writer.finish(info, {});
}

std::size_t pixels_of(const Images& images) {
  return static_cast<std::size_t>(images.grid.width_px * images.grid.height_px);
}

TEST(StackSlice, IsTheWholeImage) {
  const TemporaryFolder folder;
  for (const auto& [width, height] : {std::pair{1, 1}, {70, 100}, {33, 64}, {257, 65}}) {
    const Images images = test::random_images(width, height, 9, static_cast<unsigned>(width));
    test::write_stack(folder / "a.uvj", images, test::info_of(images.grid));
    const StackReader reader(folder / "a.uvj", folder.path());
    Bytes pixels(pixels_of(images), 77);
    for (const int n : {8, 0, 3, 3, 1, 2, 4, 5, 6, 7}) {
      reader.read_slice(n, pixels.data());
      ASSERT_EQ(pixels, images.slices[static_cast<std::size_t>(n)]) << n;
    }
    EXPECT_FALSE(reader.has_uv_images());
    EXPECT_THROW(reader.read_uv_slice(0, pixels.data()), std::logic_error);
    EXPECT_THROW(reader.read_slice(-1, pixels.data()), std::out_of_range);
    EXPECT_THROW(reader.read_slice(9, pixels.data()), std::out_of_range);
  }
}

TEST(StackSlice, IsReadByManyThreads) {
  const TemporaryFolder folder;
  const Images images = test::random_images(120, 90, 40, 5);
  write_patterned(folder / "a.uvj", images);
  const StackReader reader(folder / "a.uvj", folder.path());
  std::atomic<int> wrong{0};
  std::vector<std::jthread> threads;
  for (unsigned t = 0; t < 4; ++t) {
    threads.emplace_back([&, t] {
      Bytes pixels(pixels_of(images));
      for (int k = 0; k < 80; ++k) {
        const int n = (k * 7 + static_cast<int>(t) * 11) % 40;
        const Bytes& expected = images.slices[static_cast<std::size_t>(n)];
        reader.read_slice(n, pixels.data());
        if (pixels != expected) ++wrong;
        reader.read_uv_slice(n, pixels.data());
        for (std::size_t i = 0; i < pixels.size(); ++i) wrong += pixels[i] != uv_of(expected[i]);
      }
    });
  }
  threads.clear();
  EXPECT_EQ(wrong, 0);
}

TEST(StackSlice, UvImagesAreThoseOfTheArchive) {
  const TemporaryFolder folder;
  const Images images = test::random_images(61, 70, 5, 9);
  // In the second the slices are packed, three pixels in one, and the UV images are not.
  for (const char* name : {"a.uvj", "a.nanodlp", "a.sl1"}) {
    SCOPED_TRACE(name);
    write_patterned(folder / name, images);
    const StackReader reader(folder / name, folder.path());
    ASSERT_TRUE(reader.has_uv_images());
    EXPECT_TRUE(reader.has_checksums());
    EXPECT_FALSE(reader.images_changed());
    EXPECT_FALSE(reader.uv_images_changed());
    Bytes pixels(pixels_of(images));
    for (int n = 0; n < 5; ++n) {
      Bytes expected = images.slices[static_cast<std::size_t>(n)];
      for (std::uint8_t& v : expected) v = uv_of(v);
      reader.read_uv_slice(n, pixels.data());
      EXPECT_EQ(pixels, expected);
    }
  }
}

TEST(StackSlice, ChecksumsTellWhichImagesWereChanged) {
  const TemporaryFolder folder;
  const Images images = test::random_images(61, 70, 5, 9);
  write_patterned(folder / "a.uvj", images);
  const auto changed = [&](const char* name) {
    test::Entries entries = test::unzip(folder / "a.uvj");
    Bytes& png = test::entry(entries, name);
    GreyImage image = decode_png(png, 61, 70, "a", name);
    image.pixels[1234] ^= 1;
    png = encode_png(image);
    test::make_zip(folder / "b.uvj", entries);
    std::vector<std::string> told;
    ExecutionContext context;
    context.notice = [&](const std::string& text) { told.push_back(text); };
    const StackReader reader(folder / "b.uvj", folder.path(), context);
    EXPECT_EQ(told.size(), 1u);
    Bytes pixels(61 * 70);
    reader.read_uv_slice(2, pixels.data());
    EXPECT_EQ(pixels == image.pixels, reader.uv_images_changed());
    return std::pair(reader.images_changed(), reader.uv_images_changed());
  };
  EXPECT_EQ(changed("slice/00000002.png"), std::pair(true, false));
  EXPECT_EQ(changed("uv/00000002.png"), std::pair(false, true));
}

TEST(StackSlice, ForeignStacksHaveNoChecksums) {
  const TemporaryFolder folder;
  const Images images = test::random_images(20, 20, 2, 1);
  std::filesystem::create_directory(folder / "in");
  for (int n = 0; n < 2; ++n) {
    test::write_file(folder / ("in/" + std::to_string(n) + ".png"),
                     encode_png({20, 20, images.slices[static_cast<std::size_t>(n)]}));
  }
  const StackReader reader(folder / "in", folder.path(), {}, {50, 50, 50});
  EXPECT_FALSE(reader.has_checksums());
  EXPECT_FALSE(reader.images_changed());
  EXPECT_FALSE(reader.uv_images_changed());
}

}  // namespace
}  // namespace slicecorr
