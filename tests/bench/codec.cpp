// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Packing and unpacking of slices, in MB of pixels per second, beside what was used before, the
// fastest general packer, and a copy of memory: all in one process. Numbers to read; but what does
// not come back as it was is an error.
#include <benchmark/benchmark.h>
#include <isa-l.h>
#include <zlib.h>

#include <array>
#include <cmath>
#include <cstring>
#include <map>
#include <random>

#include "slicecorr/error.hpp"
#include "slicecorr/target.hpp"
#include "stack/formats/png_archive.hpp"
#include "stack/layer_code/codes.hpp"
#include "stack/png/png.hpp"

namespace {

using namespace slicecorr;
using Bytes = std::vector<std::uint8_t>;

enum Kind { binary, corrected, noisy, upright };
constexpr std::array<const char*, 4> kKindNames = {"binary", "corrected", "noisy", "upright"};
struct Size {
  int width_px, height_px;
};
constexpr std::array<Size, 3> kSizes = {{{1280, 800}, {2560, 1440}, {11520, 5120}}};

/// A slice of a gyroid lattice in the middle two thirds of a display, its cells some 120 pixels.
/// Corrected: grey at edges, and levels that fall towards surfaces. Noisy: such a slice for an
/// uneven display, whose neighbours differ in their last bits. Upright: walls along the rows, equal
/// row by row.
Bytes slice_of(Kind kind, Size size) {
  Bytes pixels(static_cast<std::size_t>(size.width_px) * static_cast<std::size_t>(size.height_px));
  std::mt19937 random(1);
  const float scale = 2 * 3.14159265f / 120, z = 0.7f;
  for (int y = size.height_px / 6; y < size.height_px * 5 / 6; ++y) {
    for (int x = size.width_px / 6; x < size.width_px * 5 / 6; ++x) {
      const float u = scale * static_cast<float>(x),
                  v = kind == upright ? 1 : scale * static_cast<float>(y);
      const float g =
          std::sin(u) * std::cos(v) + std::sin(v) * std::cos(z) + std::sin(z) * std::cos(u);
      float value = g > 0 ? 255 : 0;
      if (kind != binary) {
        // The field rises by about `scale` per pixel.
        const float coverage = std::clamp(g / scale + 0.5f, 0.0f, 1.0f);
        value = coverage * (g < 0.3f ? 100 + std::floor(g * 30) * 12 : 255);
      }
      if (kind == noisy && value > 8) value -= static_cast<float>(random() % 5);
      pixels[static_cast<std::size_t>(y) * static_cast<std::size_t>(size.width_px) +
             static_cast<std::size_t>(x)] =
          static_cast<std::uint8_t>(std::clamp(value, 0.f, 255.f));
    }
  }
  return pixels;
}

struct Slice {
  Size size;
  int rows;  ///< of a band, for a part of 1,000 slices
  Bytes pixels;
  std::vector<detail::GreyRows> bands;  ///< columns that may be lit
  std::vector<Bytes> band_pixels;
};

const Slice& slice_for(const benchmark::State& state) {
  static std::map<std::pair<long, long>, Slice> made;
  const auto key = std::pair(state.range(0), state.range(1));
  const auto found = made.find(key);
  if (found != made.end()) return found->second;
  Slice& s = made[key];
  s.size = kSizes[static_cast<std::size_t>(key.second)];
  s.pixels = slice_of(static_cast<Kind>(key.first), s.size);
  s.rows = band_rows({s.size.width_px, s.size.height_px, 1000, 50, 50, 50});
  const int x0 = s.size.width_px / 6, x1 = s.size.width_px * 5 / 6;
  for (int y0 = 0; y0 < s.size.height_px; y0 += s.rows) {
    const int y1 = std::min(s.size.height_px, y0 + s.rows);
    Bytes box;
    for (int y = y0; y < y1; ++y) {
      const auto row = s.pixels.begin() + static_cast<std::ptrdiff_t>(y) * s.size.width_px;
      box.insert(box.end(), row + x0, row + x1);
    }
    s.band_pixels.push_back(std::move(box));
    s.bands.push_back({s.size.width_px, x0, x1, y1 - y0, s.band_pixels.back().data()});
  }
  return s;
}

void count(benchmark::State& state, const Slice& s, std::size_t packed_bytes) {
  state.SetLabel(std::string(kKindNames[static_cast<std::size_t>(state.range(0))]) + " " +
                 std::to_string(s.size.width_px) + " x " + std::to_string(s.size.height_px));
  state.counters["MB/s"] = benchmark::Counter(
      static_cast<double>(s.pixels.size()) / 1e6 * static_cast<double>(state.iterations()),
      benchmark::Counter::kIsRate);
  if (packed_bytes > 0) state.counters["KB"] = static_cast<double>(packed_bytes) / 1e3;
}

/// As the writer does it, with its own pieces for black bands.
Bytes encoded(const Slice& s) {
  Bytes png;
  detail::IdatEncoder encoder;
  detail::append_png_start(s.size.width_px, s.size.height_px, {}, png);
  std::uint32_t adler = 1;
  for (const detail::GreyRows& band : s.bands) {
    const auto raw_bytes =
        detail::raw_stride(band.width_px) * static_cast<std::uint64_t>(band.rows);
    encoder.take(band);
    encoder.make(png);
    adler = detail::join_adler(adler, detail::adler_of(band), raw_bytes);
  }
  detail::append_png_end(adler, png);
  return png;
}

void check(const Slice& s, const Bytes& png) {
  Bytes pixels;
  const std::size_t stride = detail::raw_stride(s.size.width_px);
  const Bytes black(stride);
  detail::decode_png_bands(png, s.size.width_px, s.size.height_px, s.rows, {"bench", "slice"},
                           [&](int y0, int y1, const std::uint8_t* raw) {
                             for (int y = y0; y < y1; ++y) {
                               const std::uint8_t* const row =
                                   raw ? raw + stride * static_cast<std::size_t>(y - y0)
                                       : black.data();
                               pixels.insert(pixels.end(), row + 1, row + stride);
                             }
                           });
  if (pixels != s.pixels) throw Error("a slice did not come back as it was");
}

void copy(benchmark::State& state) {
  const Slice& s = slice_for(state);
  Bytes to(s.pixels.size());
  for (auto _ : state) {
    std::memcpy(to.data(), s.pixels.data(), to.size());
    benchmark::DoNotOptimize(to.data());
  }
  count(state, s, 0);
}

void encode(benchmark::State& state) {
  const Slice& s = slice_for(state);
  const std::size_t size = encoded(s).size();
  check(s, encoded(s));
  detail::IdatEncoder encoder;
  Bytes chunk;
  std::uint32_t sum = 0;
  for (auto _ : state) {
    for (const detail::GreyRows& band : s.bands) {
      using Found = detail::IdatEncoder::Found;
      if (encoder.take(band) != Found::other) continue;
      chunk.clear();
      encoder.make(chunk);
      sum += detail::adler_of(band);
    }
    benchmark::DoNotOptimize(sum);
  }
  count(state, s, size);
}

/// Rows with their filter bytes, as general packers take them.
std::vector<Bytes> raw_bands(const Slice& s) {
  std::vector<Bytes> bands;
  for (int y = 0; y < s.size.height_px; ++y) {
    if (y % s.rows == 0) bands.emplace_back();
    const auto row = s.pixels.begin() + static_cast<std::ptrdiff_t>(y) * s.size.width_px;
    bands.back().push_back(0);
    bands.back().insert(bands.back().end(), row, row + s.size.width_px);
  }
  return bands;
}

/// Is it black? The same short cut for all.
bool lit(const Bytes& raw) { return std::memcmp(raw.data(), raw.data() + 1, raw.size() - 1) != 0; }

/// What was used before: zlib's run strategy.
void encode_zlib(benchmark::State& state) {
  const Slice& s = slice_for(state);
  const std::vector<Bytes> bands = raw_bands(s);
  z_stream z{};
  if (deflateInit2(&z, 1, Z_DEFLATED, -15, 9, Z_RLE) != Z_OK) throw Error("no zlib");
  std::size_t size = 0;
  Bytes out(2 * bands[0].size() + 1000);
  for (auto _ : state) {
    size = 0;
    for (const Bytes& raw : bands) {
      if (!lit(raw)) continue;
      deflateReset(&z);
      z.next_in = const_cast<std::uint8_t*>(raw.data());
      z.avail_in = static_cast<uInt>(raw.size());
      z.next_out = out.data();
      z.avail_out = static_cast<uInt>(out.size());
      if (deflate(&z, Z_FULL_FLUSH) != Z_OK) throw Error("zlib failed");
      size += z.total_out + 12 + isal_adler32(1, raw.data(), raw.size()) % 2;
    }
  }
  deflateEnd(&z);
  count(state, s, size);
}

/// The fastest general packer at hand: ISA-L at level 1.
void encode_igzip(benchmark::State& state) {
  const Slice& s = slice_for(state);
  const std::vector<Bytes> bands = raw_bands(s);
  Bytes level(ISAL_DEF_LVL1_DEFAULT), out(2 * bands[0].size() + 1000);
  std::size_t size = 0;
  isal_zstream z;
  for (auto _ : state) {
    size = 0;
    for (const Bytes& raw : bands) {
      if (!lit(raw)) continue;
      isal_deflate_init(&z);
      z.level = 1;
      z.level_buf = level.data();
      z.level_buf_size = static_cast<std::uint32_t>(level.size());
      z.flush = FULL_FLUSH;
      z.next_in = const_cast<std::uint8_t*>(raw.data());
      z.avail_in = static_cast<std::uint32_t>(raw.size());
      z.next_out = out.data();
      z.avail_out = static_cast<std::uint32_t>(out.size());
      if (isal_deflate(&z) != COMP_OK) throw Error("igzip failed");
      size += z.total_out + 12 + isal_adler32(1, raw.data(), raw.size()) % 2;
    }
  }
  count(state, s, size);
}

/// `--archive`: packed once more, all bands together.
void encode_archive(benchmark::State& state) {
  const Slice& s = slice_for(state);
  std::vector<Bytes> chunks;
  detail::IdatEncoder encoder;
  std::uint32_t adler = 1;
  for (const detail::GreyRows& band : s.bands) {
    encoder.take(band);
    encoder.make(chunks.emplace_back());
  }
  std::size_t size = 0;
  for (auto _ : state) {
    detail::SmallIdat packer;
    Bytes out;
    for (std::size_t i = 0; i < chunks.size(); ++i) {
      packer.add(chunks[i],
                 detail::raw_stride(s.size.width_px) * static_cast<std::size_t>(s.bands[i].rows));
    }
    packer.finish(adler, out);
    size = out.size() + detail::kPngFrameBytesOfOne;
  }
  count(state, s, size);
}

/// The codes of binary print files, beside the PNG path: pixels to a layer's bytes and back.
detail::LayerCodecPtr print_code(long which, Size size) {
  switch (which) {
    case 0:
      return detail::ctb_code(size.width_px, size.height_px, 0xdccff65e);
    case 1:
      return detail::goo_code(size.width_px, size.height_px, false);
    case 2:
      return detail::pw0_code(size.width_px, size.height_px, false);
    case 3:
      return detail::bit_sets_code(size.width_px, size.height_px, 8, false);
    case 4:
      return detail::phz_code(size.width_px, size.height_px, 77777, detail::PhzCipher::phz);
    case 5:
      return detail::lgs_code(size.width_px, size.height_px);
    default:
      return detail::cxdlp_code(size.width_px, size.height_px);
  }
}
constexpr std::array<const char*, 7> kPrintCodeNames = {"CTB", "GOO", "PW0",  "photon, 8 sets",
                                                        "PHZ", "LGS", "CXDLP"};

void print_file(benchmark::State& state, bool decodes) {
  const Slice& s = slice_for(state);
  const detail::LayerCodecPtr codec = print_code(state.range(2), s.size);
  Bytes pixels = s.pixels, back(s.pixels.size());
  for (std::uint8_t& v : pixels) v = codec->shown()[v];
  std::vector<Bytes> pieces;
  codec->encode(0, pixels.data(), pieces);
  const std::string file = "bench";
  codec->decode(pieces, back.data(), {file, 0});
  if (back != pixels) throw Error("a layer did not come back as it was");
  std::size_t size = 0;
  for (const Bytes& piece : pieces) size += piece.size();
  for (auto _ : state) {
    if (decodes) {
      codec->decode(pieces, back.data(), {file, 0});
      benchmark::DoNotOptimize(back.data());
    } else {
      codec->encode(0, pixels.data(), pieces);
      benchmark::DoNotOptimize(pieces.data());
    }
  }
  count(state, s, size);
  state.SetLabel(std::string(kPrintCodeNames[static_cast<std::size_t>(state.range(2))]) + ", " +
                 kKindNames[static_cast<std::size_t>(state.range(0))]);
}
void encode_print(benchmark::State& state) { print_file(state, false); }
void decode_print(benchmark::State& state) { print_file(state, true); }

void decode_of(benchmark::State& state, const Slice& s, const Bytes& png) {
  check(s, png);
  int rows = 0;
  for (auto _ : state) {
    detail::decode_png_bands(png, s.size.width_px, s.size.height_px, s.rows, {"bench", "slice"},
                             [&](int y0, int y1, const std::uint8_t*) { rows += y1 - y0; });
  }
  benchmark::DoNotOptimize(rows);
  count(state, s, png.size());
}
/// Our own images.
void decode(benchmark::State& state) {
  const Slice& s = slice_for(state);
  decode_of(state, s, encoded(s));
}
/// Images as other programs make them: one stream by zlib's default level.
void decode_foreign(benchmark::State& state) {
  const Slice& s = slice_for(state);
  Bytes rows, png;
  for (const Bytes& band : raw_bands(s)) rows.insert(rows.end(), band.begin(), band.end());
  uLongf size = compressBound(rows.size());
  Bytes packed(size);
  if (compress2(packed.data(), &size, rows.data(), rows.size(), 6) != Z_OK) throw Error("no zlib");
  detail::append_png_header(s.size.width_px, s.size.height_px, {}, png);
  const std::size_t chunk = detail::begin_chunk("IDAT", png);
  png.insert(png.end(), packed.begin(), packed.begin() + static_cast<std::ptrdiff_t>(size));
  detail::end_chunk(chunk, png);
  detail::append_png_iend(png);
  decode_of(state, s, png);
}

void all(benchmark::internal::Benchmark* b) {
  b->ArgsProduct({{binary, corrected, noisy, upright}, {0, 1, 2}})->Unit(benchmark::kMicrosecond);
}
BENCHMARK(copy)->Apply(all);
BENCHMARK(encode)->Apply(all);
BENCHMARK(encode_zlib)->Apply(all);
BENCHMARK(encode_igzip)->Apply(all);
BENCHMARK(decode)->Apply(all);
BENCHMARK(decode_foreign)->Apply(all);
BENCHMARK(encode_print)
    ->ArgsProduct({{binary, corrected}, {1}, {0, 1, 2, 3, 4, 5, 6}})
    ->Unit(benchmark::kMicrosecond);
BENCHMARK(decode_print)
    ->ArgsProduct({{binary, corrected}, {1}, {0, 1, 2, 3, 4, 5, 6}})
    ->Unit(benchmark::kMicrosecond);
BENCHMARK(encode_archive)->Apply(all)->Unit(benchmark::kMillisecond);

}  // namespace
