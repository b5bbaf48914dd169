// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <OpenImageIO/imageio.h>
#include <zlib.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>
#include <set>
#include <thread>

#include "oiio_png.hpp"
#include "rounds.hpp"
#include "stack_fixture.hpp"

namespace slicecorr {
namespace {

using test::Bytes;
using test::decode_by_oiio;
using test::Images;
using test::TemporaryFolder;

/// Decodes an 8-bit grey PNG with filter 0 by zlib alone.
Bytes decode_by_zlib(const Bytes& png, std::size_t width, std::size_t height) {
  const auto u32 = [&](std::size_t at) {
    return std::size_t{png[at]} << 24 | std::size_t{png[at + 1]} << 16 |
           std::size_t{png[at + 2]} << 8 | png[at + 3];
  };
  Bytes idat;
  for (std::size_t at = 8; at < png.size(); at += u32(at) + 12) {
    EXPECT_EQ(u32(at + 8 + u32(at)), crc32(0, &png[at + 4], static_cast<uInt>(u32(at) + 4)));
    if (png[at + 5] != 'D') continue;
    idat.insert(idat.end(), &png[at + 8], &png[at + 8] + u32(at));
  }
  Bytes raw((width + 1) * height), pixels;
  uLongf size = raw.size();
  EXPECT_EQ(uncompress(raw.data(), &size, idat.data(), idat.size()), Z_OK);
  EXPECT_EQ(size, raw.size());
  for (std::size_t y = 0; y < height; ++y) {
    EXPECT_EQ(raw[y * (width + 1)], 0);
    pixels.insert(pixels.end(), &raw[y * (width + 1) + 1], &raw[y * (width + 1) + 1] + width);
  }
  return pixels;
}

/// Writes a PNG by OpenImageIO: its own choice of filters, any format.
Bytes encode_by_oiio(int width, int height, int channels, OIIO::TypeDesc type, const void* pixels) {
  const TemporaryFolder folder;
  const auto output = OIIO::ImageOutput::create("png");
  OIIO::ImageSpec spec(width, height, channels, type);
  spec.attribute("oiio:UnassociatedAlpha", 1);
  EXPECT_TRUE(output->open(folder / "a.png", spec)) << output->geterror();
  EXPECT_TRUE(output->write_image(type, pixels));
  output->close();
  return test::read_file(folder / "a.png");
}

TEST(Png, RoundTripsAllWidths) {
  for (int width = 1; width <= 70; ++width) {
    const int height = 1 + width * 7 % 45;
    const Images images = test::random_images(width, height, 3, static_cast<unsigned>(width));
    for (const Bytes& pixels : images.slices) {
      const Bytes png = encode_png({width, height, pixels});
      ASSERT_EQ(decode_png(png, width, height, "file", "image").pixels, pixels);
      ASSERT_EQ(decode_by_oiio(png), pixels);
      ASSERT_EQ(decode_by_zlib(png, static_cast<unsigned>(width), static_cast<unsigned>(height)),
                pixels);
    }
  }
}

TEST(Png, DecodesForeignImagesOfAllFormats) {
  const int width = 61, height = 47;
  const Images images = test::random_images(width, height, 12, 77);
  for (Bytes grey : images.slices) {
    // A gradient makes the encoder choose every filter.
    for (std::size_t i = 0; i < grey.size(); ++i) {
      if (grey[i] == 0) grey[i] = static_cast<std::uint8_t>(i % 61 * 3 + i / 61 * (i / 61));
    }
    const Bytes png = encode_by_oiio(width, height, 1, OIIO::TypeDesc::UINT8, grey.data());
    EXPECT_EQ(decode_png(png, width, height, "f", "i").pixels, grey);

    Bytes rgb, rgba, grey_alpha, expected;
    std::vector<std::uint16_t> deep;
    for (std::size_t i = 0; i < grey.size(); ++i) {
      const std::uint8_t v = grey[i], alpha = i % 3 == 0 ? 0 : i % 3 == 1 ? 255 : 100;
      rgb.insert(rgb.end(), {v, v, v});
      rgba.insert(rgba.end(), {v, v, v, alpha});
      grey_alpha.insert(grey_alpha.end(), {v, alpha});
      deep.push_back(static_cast<std::uint16_t>(v * 257));
      expected.push_back(static_cast<std::uint8_t>((v * alpha + 127) / 255));
    }
    const auto check = [&](int channels, OIIO::TypeDesc type, const void* data,
                           const Bytes& pixels) {
      const Bytes other = encode_by_oiio(width, height, channels, type, data);
      EXPECT_EQ(decode_png(other, width, height, "f", "i").pixels, pixels) << channels;
    };
    check(3, OIIO::TypeDesc::UINT8, rgb.data(), grey);
    check(4, OIIO::TypeDesc::UINT8, rgba.data(), expected);
    check(2, OIIO::TypeDesc::UINT8, grey_alpha.data(), expected);
    check(1, OIIO::TypeDesc::UINT16, deep.data(), grey);
  }
  const Bytes colour{10, 20, 31};
  const Bytes png = encode_by_oiio(1, 1, 3, OIIO::TypeDesc::UINT8, colour.data());
  EXPECT_EQ(decode_png(png, 1, 1, "f", "i").pixels, (Bytes{20}));
}

TEST(Stack, RoundTripsRandomImages) {
  const TemporaryFolder folder;
  std::set<int> heights;
  for (int width = 1; width <= 70; width += width < 10 ? 1 : 7) {
    // Few slices give bands of 32 rows, many give fewer. By day one of the numbers of slices for each width.
    std::vector<int> counts{1, 5, 40, 41};
    if (!test::by_night()) counts = {counts[static_cast<std::size_t>(width % 4)]};
    if (width == 66) counts.push_back(31000);
    for (const int layers : counts) {
      const int height = layers > 100 ? 5 : 70;
      const bool many = layers > 100;
      Images images = test::random_images(width, height, layers, static_cast<unsigned>(width));
      if (many) {
        images.grid.layers = layers;
      }
      heights.insert(band_rows(images.grid));
      const std::string path = folder / "a.uvj";
      test::write_stack(path, images, test::info_of(images.grid));
      const StackReader reader(path, folder.path());
      ASSERT_EQ(test::read_images(reader), images.slices) << width << " x " << layers;
      std::uint64_t sum = 0;
      for (const Bytes& s : images.slices) sum = std::accumulate(s.begin(), s.end(), sum);
      EXPECT_EQ(reader.pixel_sum(), sum);
    }
  }
  EXPECT_GE(heights.size(), 2u);
  EXPECT_EQ(folder.count(), 1);
}

TEST(Stack, BandRowsDependOnTheGridAlone) {
  EXPECT_EQ(band_rows({1, 1, 1, 50, 50, 50}), 32);
  EXPECT_EQ(band_rows({2560, 1440, 1000, 50, 50, 50}), 25);
  EXPECT_EQ(band_rows({65536, 1440, 1000000, 50, 50, 50}), 8);
}

TEST(Stack, ReadsAnyBoxAndKnowsItsBounds) {
  const TemporaryFolder folder;
  const Images images = test::random_images(90, 101, 9, 3);
  const Grid& grid = images.grid;
  test::write_stack(folder / "a.uvj", images, test::info_of(grid));
  const StackReader reader(folder / "a.uvj", folder.path());
  PixelBox bounds;
  for (const Bytes& pixels : images.slices) {
    for (int i = 0; i < 90 * 101; ++i) {
      if (pixels[static_cast<std::size_t>(i)] != 0) {
        bounds = bounds.united({i % 90, i / 90, i % 90 + 1, i / 90 + 1});
      }
    }
  }
  EXPECT_EQ(reader.bounds().x0, bounds.x0);
  EXPECT_EQ(reader.bounds().x1, bounds.x1);
  EXPECT_EQ(reader.bounds().y0, bounds.y0);
  EXPECT_EQ(reader.bounds().y1, bounds.y1);
  std::mt19937 random(4);
  for (int trial = 0; trial < 200; ++trial) {
    const auto cut = [&](int n) {
      const int a = static_cast<int>(random() % static_cast<unsigned>(n + 1));
      const int b = static_cast<int>(random() % static_cast<unsigned>(n + 1));
      return std::pair(std::min(a, b), std::max(a, b));
    };
    const auto [x0, x1] = cut(grid.width_px);
    const auto [y0, y1] = cut(grid.height_px);
    const auto slices = test::read_images(reader, {x0, y0, x1, y1});
    ASSERT_EQ(slices.size(), images.slices.size());
    for (std::size_t n = 0; n < slices.size(); ++n) {
      Bytes expected;
      for (int y = y0; y < y1; ++y) {
        const auto row = images.slices[n].begin() + y * grid.width_px;
        expected.insert(expected.end(), row + x0, row + x1);
      }
      ASSERT_EQ(slices[n], x0 < x1 ? expected : Bytes{});
    }
  }
}

TEST(Stack, TakesBandsInParts) {
  const TemporaryFolder folder;
  const Images images = test::random_images(64, 80, 4, 8);
  test::write_stack(folder / "whole.uvj", images, test::info_of(images.grid));
  StackWriter writer(folder / "parts.uvj", images.grid, {});
  {
    // One encoder for all rows; columns without light left out; slices backwards.
    StackWriter::BandEncoder made(writer, 0, 80);
    StackWriter::BandEncoder encoder(std::move(made));
    for (int n = 3; n >= 0; --n) {
      const Bytes& pixels = images.slices[static_cast<std::size_t>(n)];
      int x0 = 64, x1 = 0;
      for (int i = 0; i < 64 * 80; ++i) {
        if (pixels[static_cast<std::size_t>(i)] == 0) continue;
        x0 = std::min(x0, i % 64);
        x1 = std::max(x1, i % 64 + 1);
      }
      Bytes rows;
      for (int y = 0; y < 80 && x0 < x1; ++y) {
        rows.insert(rows.end(), pixels.begin() + y * 64 + x0, pixels.begin() + y * 64 + x1);
      }
      encoder.put(n, 0, 64, nullptr);
      if (!rows.empty()) encoder.put(n, x0, x1, rows.data());
    }
  }
  writer.finish(test::info_of(images.grid), {2, 1, {7, 9}});
  EXPECT_EQ(test::read_file(folder / "whole.uvj"), test::read_file(folder / "parts.uvj"));
}

TEST(Stack, BytesDependOnNothingButTheInput) {
  const TemporaryFolder folder;
  const Images images = test::random_images(333, 201, 25, 6);
  Bytes first;
  for (const int threads : {1, 2, 8}) {
    ExecutionContext context;
    context.threads = threads;
    const std::string path = folder / (std::to_string(threads) + ".uvj");
    ::setenv("TZ", threads == 2 ? "Asia/Tokyo" : "America/Denver", 1);
    ::tzset();
    test::write_stack(path, images, test::info_of(images.grid), context);
    const Bytes bytes = test::read_file(path);
    if (first.empty()) first = bytes;
    EXPECT_EQ(bytes, first) << threads;
    const StackReader reader(path, folder.path(), context);
    EXPECT_EQ(test::read_images(reader), images.slices);
  }
  ::unsetenv("TZ");
}

TEST(Stack, HasEntriesInOrderAndPngsThatOthersRead) {
  const TemporaryFolder folder;
  const Images images = test::random_images(70, 45, 3, 9);
  GreyImage preview{300, 200, Bytes(60000, 0)};
  for (std::size_t i = 0; i < preview.pixels.size(); ++i) {
    preview.pixels[i] = static_cast<std::uint8_t>(i % 300 < 150 ? 200 : 0);
  }
  test::write_stack(folder / "a.uvj", images, test::info_of(images.grid), {}, preview);
  const test::Entries entries = test::unzip(folder / "a.uvj");
  std::vector<std::string> names;
  for (const auto& e : entries) names.push_back(e.first);
  EXPECT_EQ(names, (std::vector<std::string>{"config.json", "preview/huge.png", "preview/tiny.png",
                                             "slice/00000000.png", "slice/00000001.png",
                                             "slice/00000002.png"}));
  EXPECT_EQ(decode_by_oiio(entries[1].second), preview.pixels);
  const GreyImage tiny = decode_png(entries[2].second, 128, 85, "f", "i");
  EXPECT_EQ(tiny.pixels[0], 200);
  EXPECT_EQ(tiny.pixels[127], 0);
  for (std::size_t n = 0; n < 3; ++n) {
    EXPECT_EQ(decode_by_oiio(entries[3 + n].second), images.slices[n]);
    EXPECT_EQ(decode_by_zlib(entries[3 + n].second, 70, 45), images.slices[n]);
  }
}

TEST(Stack, KeepsAllItsParametersExactly) {
  const TemporaryFolder folder;
  Images images = test::random_images(20, 30, 4, 10);
  images.grid.pixel_x_um = 100.0 / 3;
  images.grid.pixel_y_um = 47.25;
  images.grid.layer_um = 10.0 / 7;
  StackInfo info = test::info_of(images.grid);
  info.grid.layers = 3;  // the last slice is not wanted
  info.kind = StackKind::corrected;
  info.target_layers = 2;
  info.part_volume_mm3 = 0.1 + 0.2;
  info.printer = Printer{"p \"1\"\n",
                         30,  // portrait
                         20,
                         47.25,
                         100.0 / 3,
                         4,
                         385.5,
                         {{0, 0}, {7.1, 1.0 / 3}, {15, 2e-9}},
                         1e3 / 7,
                         0,
                         UvLamp{365.5, true, {{0, 0}, {15, 1e3 / 3}}},
                         Orientation{true, false, true},
                         std::nullopt};
  info.printer->calibration[2].intensity_mw_cm2 = 12.3456789012345678;
  info.resin = Resin{"r",
                     CureModelKind::kinetic,
                     0.53,
                     123.456,
                     1e-7,
                     3.3,
                     0,
                     0,
                     0.7,
                     5.5,
                     Inhibition{0.73, 87.1, 1.29, 2.38e2}};
  info.process.emplace();
  info.process->speed_mm_h = 17.0 / 3;
  info.process->one_slice_gaps = OneSliceGaps::merge;
  test::write_stack(folder / "a.uvj", images, info);
  for (const StackInfo& back : {StackReader::read_info(folder / "a.uvj"),
                                StackReader(folder / "a.uvj", folder.path()).info()}) {
    EXPECT_EQ(back.kind, info.kind);
    EXPECT_EQ(back.grid.layers, 3);
    EXPECT_EQ(back.grid.pixel_x_um, info.grid.pixel_x_um);
    EXPECT_EQ(back.grid.pixel_y_um, info.grid.pixel_y_um);
    EXPECT_EQ(back.grid.layer_um, info.grid.layer_um);
    EXPECT_EQ(back.printer, info.printer);
    EXPECT_EQ(back.resin, info.resin);
    EXPECT_EQ(back.process, info.process);
    EXPECT_EQ(back.target_layers, 2);
    EXPECT_EQ(back.part_volume_mm3, info.part_volume_mm3);
    EXPECT_EQ(back.program, info.program);
    EXPECT_DOUBLE_EQ(back.exposure_s, info.grid.layer_um * 3.6 / (17.0 / 3));
  }
  const auto json = nlohmann::json::parse(test::to_text(test::unzip(folder / "a.uvj")[0].second));
  EXPECT_EQ(json["Layers"].size(), 3u);
  EXPECT_NEAR(json["Layers"][2]["Z"].get<double>(), 0.03 / 7, 1e-9);
  EXPECT_EQ(json["Layers"][0]["Exposure"]["LightPWM"], 255);
  EXPECT_EQ(json["slicecorr"]["process"]["omega_max"], "inf");
}

TEST(Stack, ReadsTheReferenceArchive) {
  SLICECORR_NEEDS_FILE(test::reference_uvj());
  const TemporaryFolder folder;
  const StackReader reader(test::reference_uvj(), folder.path());
  EXPECT_EQ(reader.info().kind, StackKind::foreign);
  EXPECT_EQ(reader.grid().width_px, 1440);
  EXPECT_EQ(reader.grid().height_px, 2560);
  EXPECT_EQ(reader.grid().layers, 4);
  EXPECT_EQ(reader.grid().pixel_x_um, 50);
  EXPECT_EQ(reader.grid().pixel_y_um, 50);
  EXPECT_EQ(reader.grid().layer_um, 50);
  EXPECT_EQ(reader.info().exposure_s, 11.25);
  EXPECT_FALSE(reader.bounds().empty());
  const auto slices = test::read_images(reader);
  auto entries = test::unzip(test::reference_uvj());
  for (std::size_t n = 0; n < 4; ++n) {
    const Bytes rgba =
        decode_by_oiio(test::entry(entries, "slice/0000000" + std::to_string(n) + ".png"));
    ASSERT_EQ(rgba.size(), slices[n].size() * 4);
    for (std::size_t i = 0; i < slices[n].size(); ++i) {
      if (rgba[4 * i + 3] == 255 && rgba[4 * i] == rgba[4 * i + 1] &&
          rgba[4 * i] == rgba[4 * i + 2]) {
        ASSERT_EQ(slices[n][i], rgba[4 * i]);
      }
    }
  }
}

}  // namespace
}  // namespace slicecorr
