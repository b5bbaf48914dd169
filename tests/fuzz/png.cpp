// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Any bytes as the PNG of a layer, for clang's fuzzer: decoded or refused with an `InputError` that names
// archive and entry. Checksums are mended first, or hardly any input would get beyond them. Decoded in
// bands of any height and as a camera's picture, an image is the same.
#include "stack/png/png.hpp"

#include <zlib.h>

#include <algorithm>
#include <vector>

#include "fuzz.hpp"
#include "slicecorr/load_printer.hpp"

using namespace slicecorr;

namespace {

using Bytes = std::vector<std::uint8_t>;

std::uint32_t u32_at(const Bytes& png, std::size_t at) {
  return std::uint32_t{png[at]} << 24 | std::uint32_t{png[at + 1]} << 16 |
         std::uint32_t{png[at + 2]} << 8 | png[at + 3];
}

void set_u32(Bytes& png, std::size_t at, std::uint32_t value) {
  for (std::size_t i = 0; i < 4; ++i)
    png[at + i] = static_cast<std::uint8_t>(value >> (24 - 8 * i));
}

/// Calls `each(place of the data, bytes of it)` for the chunks that lie in the file.
template <class Each>
void for_chunks(const Bytes& png, const Each& each) {
  for (std::size_t at = 8; at + 12 <= png.size();) {
    const std::size_t bytes = u32_at(png, at);
    if (bytes > png.size() - at - 12) return;
    each(at + 8, bytes);
    at += 12 + bytes;
  }
}

/// The Adler-32 at the end of the zlib stream, where that ends with the data.
void mend_adler(Bytes& png) {
  Bytes stream;
  std::vector<std::size_t> places;  // of its bytes in the file
  for_chunks(png, [&](std::size_t at, std::size_t bytes) {
    if (!std::equal(&png[at - 4], &png[at], "IDAT")) return;
    for (std::size_t i = at; i < at + bytes; ++i) {
      stream.push_back(png[i]);
      places.push_back(i);
    }
  });
  if (stream.size() < 7) return;
  z_stream z{};
  if (inflateInit2(&z, -15) != Z_OK) return;
  z.next_in = stream.data() + 2;
  z.avail_in = static_cast<uInt>(stream.size() - 2);
  std::uint32_t adler = 1;
  int code = Z_OK;
  for (int pieces = 0; code == Z_OK && pieces < 4096; ++pieces) {
    std::uint8_t piece[4096];
    z.next_out = piece;
    z.avail_out = sizeof piece;
    code = inflate(&z, Z_NO_FLUSH);
    adler = static_cast<std::uint32_t>(adler32(adler, piece, sizeof piece - z.avail_out));
  }
  const bool ends = code == Z_STREAM_END && z.avail_in == 4;
  inflateEnd(&z);
  if (!ends) return;
  for (std::size_t i = 0; i < 4; ++i) {
    png[places[places.size() - 4 + i]] = static_cast<std::uint8_t>(adler >> (24 - 8 * i));
  }
}

void mend_chunks(Bytes& png) {
  std::vector<std::pair<std::size_t, std::size_t>> chunks;
  for_chunks(png, [&](std::size_t at, std::size_t bytes) { chunks.emplace_back(at, bytes); });
  for (const auto& [at, bytes] : chunks) {
    set_u32(png, at + bytes,
            static_cast<std::uint32_t>(crc32(0, &png[at - 4], static_cast<uInt>(bytes + 4))));
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 33) return -1;
  Bytes png(data, data + size);
  mend_adler(png);
  mend_chunks(png);
  const std::string file = "part.sl1", entry = "00000.png";
  const detail::PngName name{file, entry};
  const std::uint32_t width = u32_at(png, 16), height = u32_at(png, 20);
  // A few bytes may stand for large images, which are allowed and take their time.
  if (width == 0 || height == 0 || width > 4096 || height > 4096 || width * height > 1u << 18) {
    return -1;
  }
  const int w = static_cast<int>(width), h = static_cast<int>(height);
  const auto decode = [&](int wide, int rows, bool packed, bool blue_first) {
    Bytes pixels;
    int next = 0;
    const auto take = [&](int y0, int y1, const std::uint8_t* raw) {
      if (y0 != next || y1 <= y0 || y1 > h || y1 - y0 > rows) fuzz::fail("bands are not in order");
      next = y1;
      const std::size_t stride = detail::raw_stride(wide);
      for (int y = 0; y < y1 - y0; ++y) {
        if (raw == nullptr) {
          pixels.resize(pixels.size() + stride - 1);
        } else {
          const std::uint8_t* const row = raw + static_cast<std::size_t>(y) * stride;
          if (row[0] != 0) fuzz::fail("a row has another filter than 0");
          pixels.insert(pixels.end(), row + 1, row + stride);
        }
      }
    };
    const bool read = fuzz::read_or_refuse(
        [&] { detail::decode_png_bands(png, wide, h, rows, name, take, packed, blue_first); }, file,
        entry);
    if (read && next != h) fuzz::fail("rows are missing");
    if (!read) pixels.clear();
    return pixels;
  };
  const Bytes at_once = decode(w, h, false, false);
  if (decode(w, 7, false, false) != at_once) fuzz::fail("bands give another image");
  for (const bool blue_first : {false, true}) decode(3 * w - 1, 5, true, blue_first);
  CameraPicture picture;
  const bool seen = fuzz::read_or_refuse(
      [&] { picture = detail::decode_camera_png(png, w, h, name); }, file, entry);
  if (seen == at_once.empty())
    fuzz::fail("a camera's picture is read and a layer not, or the other way");
  if (seen && picture.white == 255 &&
      !std::equal(at_once.begin(), at_once.end(), picture.pixels.begin(), picture.pixels.end())) {
    fuzz::fail("a camera's picture has other pixels");
  }
  return 0;
}
