// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// How slices are packed and read: by readers that we did not write, for bytes of all kinds, and the
// same on every processor.
#include <isa-l.h>
#include <png.h>
#include <zlib.h>

#include <numeric>

#include "oiio_png.hpp"
#include "real_files.hpp"
#include "rounds.hpp"
#include "run_program.hpp"
#include "stack/formats/png_archive.hpp"
#include "stack/png/huffman.hpp"
#include "stack/png/png.hpp"
#include "stack/png/run_deflate.hpp"
#include "stack_fixture.hpp"

namespace slicecorr {
namespace {

using detail::RunDeflater;
using test::Bytes;
using test::decode_by_oiio;
using test::Images;
using test::TemporaryFolder;

TEST(HuffmanCode, IsCompleteShortAndFollowsFromFrequencies) {
  std::mt19937 random(1);
  for (int trial = 0; trial < 2000; ++trial) {
    std::vector<std::uint32_t> frequencies(1 + random() % 286);
    std::uint32_t a = 1, b = 1;
    for (auto& f : frequencies) {
      switch (trial % 4) {
        case 0:
          f = random() % 3 == 0 ? random() % 1000 : 0;
          break;
        case 1:
          f = 7;
          break;
        case 2:  // Fibonacci numbers make the longest codes
          f = std::exchange(a, std::exchange(b, std::min(a + b, 1u << 30)));
          break;
        default:
          f = random() % 40 == 0 ? 1u << random() % 30 : 0;
      }
    }
    if (frequencies.size() < 2) frequencies.push_back(0);
    const unsigned limit = trial % 2 == 0 ? 12 : 15;
    detail::HuffmanCode code, again;
    const std::uint64_t bits = code.make(frequencies, limit);
    EXPECT_EQ(again.make(frequencies, limit), bits);
    double space = 0;
    std::uint64_t sum = 0;
    std::size_t used = 0;
    for (std::size_t i = 0; i < frequencies.size(); ++i) {
      EXPECT_EQ(code[i].bits, again[i].bits);
      ASSERT_LE(code[i].count, limit);
      sum += std::uint64_t{frequencies[i]} * code[i].count;
      if (frequencies[i] > 0) ++used;
      if (frequencies[i] > 0) {
        ASSERT_GT(code[i].count, 0);
      }
      if (code[i].count > 0) space += std::ldexp(1, -code[i].count);
    }
    EXPECT_EQ(space, 1) << "not every string of bits is a symbol";
    EXPECT_EQ(sum, bits);
    // Equal frequencies: all codes within one bit of the logarithm of their number.
    if (trial % 4 == 1 && used > 1) {
      const auto floor = static_cast<std::uint64_t>(std::floor(std::log2(used)));
      EXPECT_GE(bits, 7 * used * floor);
      EXPECT_LE(bits, 7 * used * (floor + 1));
    }
  }
  // By hand: weights 1, 1, 2, 4 make codes of 3, 3, 2 and 1 bits.
  const std::vector<std::uint32_t> weights = {4, 1, 0, 2, 1};
  detail::HuffmanCode code;
  EXPECT_EQ(code.make(weights, 15), 4 * 1 + 1 * 3 + 2 * 2 + 1 * 3u);
  EXPECT_EQ(code[2].count, 0);
}

/// Bytes of many kinds.
Bytes bytes_of_kind(int kind, std::size_t n, std::mt19937& random) {
  Bytes data(n);
  std::size_t left = 0;
  std::uint8_t value = 0;
  const std::size_t period = 1 + random() % (kind == 6 ? 40000 : 400);
  for (std::size_t i = 0; i < n; ++i) {
    switch (kind) {
      case 0:
        value = 0;
        break;
      case 1:
        value = 200;
        break;
      case 2:
        value = static_cast<std::uint8_t>(random());
        break;
      case 3:  // short runs: around the shortest that count
        if (left-- == 0) {
          left = random() % 6;
          value = static_cast<std::uint8_t>(random() % 3);
        }
        break;
      case 4:  // long runs: around the longest reference
        if (left-- == 0) {
          left = 250 + random() % 600;
          value = random() % 2 == 0 ? 0 : 255;
        }
        break;
      case 5:  // patterns that come back, not quite
      case 6:  // ... from as far away as deflate reaches, and farther
        value = i < period || random() % 500 == 0 ? static_cast<std::uint8_t>(random() % 4 * 80)
                                                  : data[i - period];
        if (i > 0 && i < period && random() % 3 != 0) value = data[i - 1];
        break;
      default:  // edges between black and light
        if (left-- == 0) {
          left = random() % 3 == 0 ? random() % 2 : random() % 90;
          value = random() % 3 == 0 ? static_cast<std::uint8_t>(random()) : 255 * (random() % 2);
        }
    }
    data[i] = value;
  }
  return data;
}
constexpr int kKinds = 8;

Bytes piece_of(const Bytes& data, RunDeflater& deflater) {
  Bytes piece{42};
  deflater.clear();
  deflater.add(data.data(), data.size());
  deflater.end();
  deflater.write(piece);
  EXPECT_EQ(piece[0], 42);
  piece.erase(piece.begin());
  return piece;
}

Bytes inflate_by_zlib(const Bytes& packed, std::size_t size) {
  z_stream z{};
  EXPECT_EQ(inflateInit2(&z, -15), Z_OK);
  Bytes out(size + 1);
  z.next_in = const_cast<std::uint8_t*>(packed.data());
  z.avail_in = static_cast<uInt>(packed.size());
  z.next_out = out.data();
  z.avail_out = static_cast<uInt>(out.size());
  EXPECT_EQ(inflate(&z, Z_FINISH), Z_STREAM_END) << (z.msg ? z.msg : "");
  EXPECT_EQ(z.avail_in, 0u);
  out.resize(z.total_out);
  inflateEnd(&z);
  return out;
}

Bytes inflate_by_isal(const Bytes& packed, std::size_t size) {
  const auto z = std::make_unique<inflate_state>();
  isal_inflate_init(z.get());
  Bytes out(size + 1);
  z->next_in = const_cast<std::uint8_t*>(packed.data());
  z->avail_in = static_cast<std::uint32_t>(packed.size());
  z->next_out = out.data();
  z->avail_out = static_cast<std::uint32_t>(out.size());
  EXPECT_EQ(isal_inflate(z.get()), ISAL_DECOMP_OK);
  out.resize(z->total_out);
  return out;
}

TEST(RunDeflater, IsReadByOthersInPiecesOfAllKinds) {
  std::mt19937 random(2);
  RunDeflater deflater;
  for (int trial = 0; trial < 1500; ++trial) {
    Bytes all, stream;
    for (unsigned i = 0; i <= random() % 4; ++i) {
      const auto most = trial % 50 == 0 ? 300000u : trial % 3 == 0 ? 200u : 5000u;
      const Bytes data =
          bytes_of_kind(static_cast<int>(random() % kKinds), random() % most, random);
      const Bytes piece = piece_of(data, deflater);
      // What can't be packed grows by its codes' header and some bits per byte at most.
      ASSERT_LE(piece.size(), data.size() + data.size() / 50 + 200);
      all.insert(all.end(), data.begin(), data.end());
      stream.insert(stream.end(), piece.begin(), piece.end());
    }
    stream.insert(stream.end(), {3, 0});
    ASSERT_EQ(inflate_by_zlib(stream, all.size()), all) << trial;
    ASSERT_EQ(inflate_by_isal(stream, all.size()), all) << trial;
  }
}

TEST(RunDeflater, TakesRunsOfEveryLength) {
  RunDeflater deflater;
  for (std::size_t n = 1; n < 1100; ++n) {
    Bytes data(n, 9);
    data.insert(data.begin(), {1, 2});
    data.push_back(3);
    Bytes piece = piece_of(data, deflater);
    piece.insert(piece.end(), {3, 0});
    ASSERT_EQ(inflate_by_zlib(piece, data.size()), data) << n;
  }
  // Deflate makes at most 258 bytes of two bits.
  const std::size_t many = std::size_t{test::by_night() ? 40U : 4U} << 20;
  Bytes piece = piece_of(Bytes(many), deflater);
  EXPECT_LE(piece.size(), many / 1032 + 60);
  piece.insert(piece.end(), {3, 0});
  EXPECT_EQ(inflate_by_zlib(piece, many), Bytes(many));
}

TEST(RunDeflater, FollowsFromTheBytesAlone) {
  std::mt19937 random(3);
  RunDeflater used;
  for (int trial = 0; trial < 400; ++trial) {
    const Bytes data = bytes_of_kind(trial % kKinds, 1 + random() % 4000, random);
    RunDeflater fresh;
    const Bytes expected = piece_of(data, fresh);
    ASSERT_EQ(piece_of(data, used), expected) << "what was packed before matters";
    // In portions of any size, zeros among them told as such.
    used.clear();
    for (std::size_t at = 0; at < data.size();) {
      std::size_t n = std::min<std::size_t>(data.size() - at, 1 + random() % 300), zeros = 0;
      while (at + zeros < data.size() && data[at + zeros] == 0) ++zeros;
      if (zeros > 0) {
        n = zeros;
        used.add_zeros(n);
      } else {
        used.add(&data[at], n);
      }
      at += n;
    }
    used.end();
    EXPECT_TRUE(used.repeats_last());
    Bytes piece;
    used.write(piece);
    ASSERT_EQ(piece, expected) << "how bytes are handed over matters";
  }
}

TEST(RunDeflater, KnowsZerosAndRepetitions) {
  RunDeflater deflater;
  const auto take = [&](const Bytes& data) {
    deflater.clear();
    deflater.add(data.data(), data.size());
    deflater.end();
  };
  Bytes out;
  for (const std::size_t n : {0, 1, 2, 3, 4, 63, 64, 65, 128, 5000}) {
    take(Bytes(n));
    EXPECT_TRUE(deflater.only_zeros());
    for (std::size_t lit = 0; lit < n; lit += 1 + n / 7) {
      Bytes data(n);
      data[lit] = 1;
      take(data);
      EXPECT_FALSE(deflater.only_zeros()) << n << " " << lit;
      deflater.write(out);
      take(Bytes(n));  // not written, so not the last one
      take(data);
      EXPECT_TRUE(deflater.repeats_last());
      data[n - 1 - lit] ^= 4;
      take(data);
      EXPECT_FALSE(deflater.repeats_last());
      data.assign(n + 1, 0);
      data[lit] = 1;
      take(data);
      EXPECT_FALSE(deflater.repeats_last()) << "one byte longer";
    }
  }
}

TEST(RunDeflater, FindsRowsThatRepeat) {
  // Rows with many edges, all the same: each but the first costs little more than its references.
  std::mt19937 random(4);
  for (const std::size_t width : {100, 1281, 11521}) {
    Bytes row = bytes_of_kind(7, width, random), data;
    for (int y = 0; y < 16; ++y) data.insert(data.end(), row.begin(), row.end());
    RunDeflater deflater;
    const std::size_t one = piece_of(row, deflater).size();
    const std::size_t all = piece_of(data, deflater).size();
    EXPECT_LT(all, one + 15 * (width / 258 + 4) * 4) << width;
  }
}

Bytes decode_by_libpng(const Bytes& png, int width, int height) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  EXPECT_NE(png_image_begin_read_from_memory(&image, png.data(), png.size()), 0) << image.message;
  EXPECT_EQ(image.width, static_cast<unsigned>(width));
  EXPECT_EQ(image.height, static_cast<unsigned>(height));
  image.format = PNG_FORMAT_GRAY;
  Bytes pixels(PNG_IMAGE_SIZE(image));
  EXPECT_NE(png_image_finish_read(&image, nullptr, pixels.data(), 0, nullptr), 0) << image.message;
  EXPECT_EQ(image.warning_or_error, 0u) << image.message;
  return pixels;
}

/// Images of all kinds, 16K wide and one pixel wide among them.
std::vector<Images> images_of_all_kinds() {
  std::vector<Images> all;
  std::mt19937 random(5);
  std::vector<std::pair<int, int>> sizes{{1, 1},   {1, 300}, {2, 70},    {63, 40},
                                         {64, 33}, {65, 64}, {1280, 40}, {15360, 8}};
  if (test::by_night()) sizes.insert(sizes.end(), {{1280, 100}, {15360, 40}});
  for (const auto& [width, height] : sizes) {
    Images images{{width, height, 0, 50, 50, 50}, {}};
    const auto size = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
    for (int kind = 0; kind < kKinds; ++kind) {
      images.slices.push_back(bytes_of_kind(kind, size, random));
    }
    // Straight up, then black, then the same again; and rows that repeat.
    images.slices.push_back(images.slices.back());
    images.slices.emplace_back(size);
    images.slices.push_back(images.slices[images.slices.size() - 2]);
    Bytes rows;
    for (int y = 0; y < height; ++y) {
      rows.insert(rows.end(), images.slices[7].begin(), images.slices[7].begin() + width);
    }
    images.slices.push_back(rows);
    images.grid.layers = static_cast<int>(images.slices.size());
    all.push_back(std::move(images));
  }
  return all;
}

TEST(Codec, StacksAreReadByLibpngAndOpenImageIO) {
  const TemporaryFolder folder;
  for (const Images& images : images_of_all_kinds()) {
    for (const bool archive : {false, true}) {
      SCOPED_TRACE(std::to_string(images.grid.width_px) + (archive ? " archive" : ""));
      StackFile file(folder / "a.uvj");
      file.archive = archive;
      test::write_stack(file, images, test::info_of(images.grid));
      test::Entries entries = test::unzip(file.path);
      for (std::size_t n = 0; n < images.slices.size(); ++n) {
        char name[32];
        std::snprintf(name, sizeof name, "slice/%08zu.png", n);
        const Bytes& png = test::entry(entries, name);
        ASSERT_EQ(decode_by_libpng(png, images.grid.width_px, images.grid.height_px),
                  images.slices[n]);
        ASSERT_EQ(decode_by_oiio(png), images.slices[n]);
        ASSERT_EQ(decode_png(png, images.grid.width_px, images.grid.height_px, "f", "i").pixels,
                  images.slices[n]);
      }
      const StackReader reader(file.path, folder.path());
      EXPECT_FALSE(reader.images_changed());
      EXPECT_EQ(test::read_images(reader), images.slices);
    }
  }
}

TEST(Codec, ArchivesAreSmallerAndKeepTheirPixels) {
  const TemporaryFolder folder;
  const Images images = test::random_images(300, 200, 30, 6);
  for (const char* ending : {"uvj", "sl1", "cws"}) {
    StackFile file(folder / (std::string("a.") + ending));
    StackInfo info = test::info_of(images.grid);
    info.exposure_s = 2;
    test::write_stack(file, images, info);
    const auto size = std::filesystem::file_size(file.path);
    file.archive = true;
    test::write_stack(file, images, info);
    EXPECT_LT(std::filesystem::file_size(file.path), size) << ending;
    EXPECT_EQ(test::read_images(StackReader(file.path, folder.path())), images.slices);
  }
}

TEST(Codec, BytesDoNotDependOnThreadsNorBoxes) {
  const TemporaryFolder folder;
  Images images = test::random_images(400, 300, test::by_night() ? 40 : 16, 7);
  for (Bytes& slice : images.slices) {
    for (std::size_t i = 0; i < slice.size(); ++i) {
      if (i % 400 < 30 || i % 400 >= 350) slice[i] = 0;
    }
  }
  for (const bool archive : {false, true}) {
    for (const char* ending : {"uvj", "sl1"}) {
      StackInfo info = test::info_of(images.grid);
      info.exposure_s = 2;
      StackFile file(folder / (std::string("a.") + ending));
      file.archive = archive;
      ExecutionContext one;
      one.threads = 1;
      test::write_stack(file, images, info, one);
      const Bytes expected = test::read_file(file.path);
      for (int threads = 2; threads <= 4; ++threads) {
        ExecutionContext context;
        context.threads = threads;
        test::write_stack(file, images, info, context);
        ASSERT_EQ(test::read_file(file.path), expected) << threads;
      }
      // Only the columns that may be lit, from the last slice to the first.
      StackWriter writer(file, images.grid, {});
      const int rows = band_rows(images.grid);
      for (int y0 = 0; y0 < images.grid.height_px; y0 += rows) {
        const int y1 = std::min(images.grid.height_px, y0 + rows);
        StackWriter::BandEncoder encoder(writer, y0, y1);
        for (int n = images.grid.layers - 1; n >= 0; --n) {
          Bytes box;
          for (int y = y0; y < y1; ++y) {
            const auto row = images.slices[static_cast<std::size_t>(n)].begin() + y * 400;
            box.insert(box.end(), row + 30, row + 350);
          }
          encoder.put(n, 30, 350, box.data());
        }
      }
      writer.finish(info, {2, 1, {7, 9}});
      EXPECT_EQ(test::read_file(file.path), expected) << "boxes matter";
    }
  }
}

TEST(Codec, EqualSlicesAreKeptOnce) {
  const TemporaryFolder folder;
  // Noise, so that each piece is as large as its pixels: kept one by one they would need more
  // memory than the writer takes, and it would tell of a scratch file.
  const Grid grid{2000, 64, 2200, 50, 50, 50};
  std::mt19937 random(11);
  const Bytes pixels = bytes_of_kind(2, 2000 * 64, random);
  int told = 0;
  ExecutionContext context;
  context.notice = [&](const std::string&) { ++told; };
  StackWriter writer(folder / "a.uvj", grid, context);
  const int rows = band_rows(grid);
  for (int y0 = 0; y0 < grid.height_px; y0 += rows) {
    StackWriter::BandEncoder band(writer, y0, std::min(grid.height_px, y0 + rows));
    for (int n = 0; n < grid.layers; ++n) {
      band.put(n, 0, grid.width_px, &pixels[static_cast<std::size_t>(y0) * 2000]);
    }
  }
  EXPECT_EQ(told, 0);
}

/// A PNG of rows as they are stored, with IDAT chunks of this size.
Bytes png_of_rows(const Bytes& rows, int width, int height, std::uint8_t depth,
                  std::size_t chunk_bytes) {
  Bytes out, packed(compressBound(rows.size()));
  detail::PixelCode code;
  code.bit_depth = depth;
  detail::append_png_header(width, height, code, out);
  uLongf size = packed.size();
  EXPECT_EQ(compress2(packed.data(), &size, rows.data(), rows.size(), 6), Z_OK);
  for (std::size_t at = 0; at < size; at += chunk_bytes) {
    const std::size_t chunk = detail::begin_chunk("IDAT", out);
    const std::size_t n = std::min<std::size_t>(chunk_bytes, size - at);
    out.insert(out.end(), &packed[at], &packed[at] + n);
    detail::end_chunk(chunk, out);
  }
  detail::append_png_iend(out);
  return out;
}

TEST(Codec, ReadsOneBitImagesAsLibpngDoes) {
  std::mt19937 random(8);
  for (int width = 1; width < 70; ++width) {
    const int height = 1 + static_cast<int>(random() % 80);
    const std::size_t stride = static_cast<std::size_t>(width + 7) / 8 + 1;
    Bytes rows(stride * static_cast<std::size_t>(height));
    for (std::size_t i = 0; i < rows.size(); ++i) {
      rows[i] = static_cast<std::uint8_t>(i % stride == 0 ? random() % 5 : random());
    }
    for (const std::size_t chunk : {std::size_t{1} << 20, std::size_t{7}}) {
      const Bytes png = png_of_rows(rows, width, height, 1, chunk);
      const Bytes expected = decode_by_libpng(png, width, height);
      ASSERT_EQ(decode_png(png, width, height, "f", "i").pixels, expected);
      ASSERT_EQ(decode_by_oiio(png), expected);
    }
    // The same checks as of other images: a wrong checksum, a filter that there is not, too much.
    rows[0] = 5;
    EXPECT_THROW(decode_png(png_of_rows(rows, width, height, 1, 100), width, height, "f", "i"),
                 InputError);
    rows[0] = 0;
    EXPECT_THROW(
        decode_png(png_of_rows(rows, width, height + 1, 1, 100), width, height + 1, "f", "i"),
        InputError);
    rows.push_back(0);
    EXPECT_THROW(decode_png(png_of_rows(rows, width, height, 1, 100), width, height, "f", "i"),
                 InputError);
  }
}

TEST(Codec, ReadsEveryFilterOnEveryWay) {
  std::mt19937 random(9);
  for (int trial = 0; trial < 60; ++trial) {
    const int width = 1 + static_cast<int>(random() % 200), height = 1 + trial * 3;
    const std::size_t stride = static_cast<std::size_t>(width) + 1;
    Bytes rows(stride * static_cast<std::size_t>(height));
    for (std::size_t i = 0; i < rows.size(); ++i) {
      rows[i] = static_cast<std::uint8_t>(i % stride == 0  ? (trial % 2 == 0 ? random() % 5 : 2)
                                          : trial % 3 == 0 ? random()
                                                           : random() % 20 == 0);
    }
    const Bytes png = png_of_rows(rows, width, height, 8, trial % 3 == 0 ? 11 : 1 << 20);
    const Bytes expected = decode_by_libpng(png, width, height);
    ASSERT_EQ(decode_png(png, width, height, "f", "i").pixels, expected);

    // The same rows in chunks of our kind, whose bands refer to the rows above.
    const int band = 32;
    Bytes ours;
    detail::append_png_start(width, height, {}, ours);
    detail::IdatEncoder encoder;
    for (int y = 0; y < height; y += band) {
      const std::size_t n = stride * static_cast<std::size_t>(std::min(band, height - y));
      encoder.encode({&rows[stride * static_cast<std::size_t>(y)], n}, ours);
    }
    detail::append_png_end(detail::adler_of(rows), ours);
    ASSERT_EQ(decode_by_libpng(ours, width, height), expected);
    Bytes pixels;
    const std::uint32_t adler = detail::decode_png_bands(
        ours, width, height, band, {"f", "i"}, [&](int y0, int y1, const std::uint8_t* raw) {
          for (int y = y0; y < y1; ++y) {
            const Bytes black(stride);
            const std::uint8_t* const row =
                raw ? raw + stride * static_cast<std::size_t>(y - y0) : black.data();
            pixels.insert(pixels.end(), row + 1, row + stride);
          }
        });
    ASSERT_EQ(pixels, expected);
    EXPECT_EQ(adler, detail::adler_of({width, 0, width, height, expected.data()}));
  }
}

/// Chunks that look like ours but refer to the band above are read as any other PNG; each band goes
/// to the sink once, whichever way finds what.
TEST(Codec, ReadsChunksThatOnlyLookLikeOurs) {
  const int width = 50, height = 96, band = 32;
  std::mt19937 random(10);
  const Bytes pixels = bytes_of_kind(7, width * height, random);
  Bytes rows;
  for (int y = 0; y < height; ++y) {
    rows.push_back(0);
    rows.insert(rows.end(), pixels.begin() + y * width, pixels.begin() + (y + 1) * width);
  }
  // Equal bands: zlib refers to the first.
  const std::size_t band_bytes = rows.size() / 3;
  std::copy_n(rows.begin(), band_bytes, rows.begin() + static_cast<std::ptrdiff_t>(band_bytes));
  for (const int level : {0, 9}) {
    for (const int flush : {Z_SYNC_FLUSH, Z_FULL_FLUSH}) {
      Bytes png;
      detail::append_png_start(width, height, {}, png);
      z_stream z{};
      ASSERT_EQ(deflateInit2(&z, level, Z_DEFLATED, -15, 9, Z_DEFAULT_STRATEGY), Z_OK);
      for (int i = 0; i < 3; ++i) {
        Bytes packed(2 * band_bytes + 100);
        z.next_in = &rows[static_cast<std::size_t>(i) * band_bytes];
        z.avail_in = static_cast<uInt>(band_bytes);
        z.next_out = packed.data();
        z.avail_out = static_cast<uInt>(packed.size());
        ASSERT_EQ(deflate(&z, flush), Z_OK);
        const std::size_t chunk = detail::begin_chunk("IDAT", png);
        png.insert(png.end(), packed.begin(), packed.end() - z.avail_out);
        detail::end_chunk(chunk, png);
      }
      deflateEnd(&z);
      Bytes sound = png;
      detail::append_png_end(detail::adler_of(rows), sound);
      std::vector<int> seen;
      Bytes decoded;
      detail::decode_png_bands(sound, width, height, band, {"f", "i"},
                               [&](int y0, int y1, const std::uint8_t* raw) {
                                 seen.push_back(y0);
                                 decoded.insert(decoded.end(), raw, raw + (y1 - y0) * (width + 1));
                               });
      EXPECT_EQ(seen, (std::vector{0, 32, 64}));
      EXPECT_EQ(decoded, rows);
      detail::append_png_end(detail::adler_of(rows) ^ 1, png);
      EXPECT_THROW(decode_png(png, width, height, "f", "i"), InputError);
      EXPECT_THROW(detail::decode_png_bands(png, width, height, band, {"f", "i"},
                                            [](int, int, const std::uint8_t*) {}),
                   InputError);
    }
  }
}

TEST(Codec, DamagedStreamsAreRefusedNotMisread) {
  const int width = 120, height = 64;
  std::mt19937 random(13);
  const Bytes pixels = bytes_of_kind(7, width * height, random);
  const Bytes sound = encode_png({width, height, pixels});
  const auto fix_checksums = [](Bytes& png) {
    for (std::size_t at = 8; at + 12 <= png.size();) {
      const std::size_t n = std::size_t{png[at]} << 24 | std::size_t{png[at + 1]} << 16 |
                            std::size_t{png[at + 2]} << 8 | png[at + 3];
      if (n > png.size() - at - 12) return;
      const auto sum = static_cast<std::uint32_t>(crc32(0, &png[at + 4], static_cast<uInt>(n + 4)));
      for (std::size_t i = 0; i < 4; ++i) {
        png[at + 8 + n + i] = static_cast<std::uint8_t>(sum >> (24 - 8 * i));
      }
      at += n + 12;
    }
  };
  int refused_behind = 0;
  for (int trial = 0; trial < 4000; ++trial) {
    Bytes png = sound;
    png[33 + random() % (png.size() - 33)] ^= static_cast<std::uint8_t>(1u << random() % 8);
    // Behind the chunks' checksums the stream's own still finds every change.
    const bool behind = trial % 4 != 0;
    if (behind) fix_checksums(png);
    if (png == sound) continue;
    try {
      const GreyImage image = decode_png(png, width, height, "f", "i");
      EXPECT_EQ(image.pixels, pixels) << trial;
      EXPECT_TRUE(behind) << "a chunk's checksum was not looked at";
    } catch (const InputError& error) {
      EXPECT_EQ(std::string(error.what()).rfind("f: i: ", 0), 0u) << error.what();
      refused_behind += behind;
    }
  }
  // Of the bits in a stream only those that fill its last bytes mean nothing.
  EXPECT_GT(refused_behind, 1500);
}

/// The same bytes whatever instructions the processor has: the C library's switch turns off its own
/// choice, ours makes none.
TEST(Codec, BytesDoNotDependOnTheProcessor) {
  const std::string mesh = test::real_file("meshes/clean/3DBenchy.stl");
  SLICECORR_NEEDS_FILE(mesh);
  const TemporaryFolder folder;
  const auto slice = [&](const std::string& name, const std::string& tunables) {
    test::RunOptions options;
    options.environment["SLICECORR_DB"] = SLICECORR_PRINTERS_DIR;
    options.environment["GLIBC_TUNABLES"] = tunables;
    const test::RunResult result = test::run_program(
        {SLICECORR_BIN_DIR "/slicecorr", "slice", mesh, "-o", folder / (name + ".uvj"), "--printer",
         SLICECORR_PRINTERS_DIR "/dual-wavelength-dlp.toml", "--layer-um", "1000"},
        options);
    EXPECT_EQ(result.exit_code, 0) << result.err;
    return test::read_file(folder / (name + ".uvj"));
  };
  const Bytes a = slice("a", "");
  ASSERT_GT(a.size(), 10000u);
  EXPECT_EQ(slice("b", "glibc.cpu.hwcaps=-AVX2_Usable,-AVX512F_Usable,-AVX2,-AVX512F,-ERMS"), a);
}

}  // namespace
}  // namespace slicecorr
