// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cstdlib>
#include <cstring>

#include "base/image_module.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/load_printer.hpp"
#include "stack/png/png_layout.hpp"

namespace slicecorr::detail {
namespace {

using Bytes = std::span<const std::uint8_t>;

/// Undoes the filter of one row of pixels of `step` bytes in place. `above` is the row above
/// without filter.
void unfilter_wide(int filter, std::uint8_t* row, const std::uint8_t* above, int bytes, int step) {
  for (int x = 0; x < bytes; ++x) {
    const int left = x < step ? 0 : row[x - step], corner = x < step ? 0 : above[x - step];
    int guess = 0;
    if (filter == 1) guess = left;
    if (filter == 2) guess = above[x];
    if (filter == 3) guess = (left + above[x]) / 2;
    if (filter == 4) guess = paeth_guess(left, above[x], corner);
    row[x] = static_cast<std::uint8_t>(row[x] + guess);
  }
}

/// 8-bit RGB whose bytes are neighbouring grey pixels; a row may have up to two bytes more than
/// `width`.
void decode_packed(const PngLayout& layout, int width, int rows, const PngName& name,
                   const RawBandSink& sink, bool blue_first) {
  const int height = static_cast<int>(layout.height);
  const std::size_t bytes = std::size_t{3} * layout.width, stride = raw_stride(width);
  std::vector<std::uint8_t> row(bytes + 1), above(bytes + 1, 0), ordered;
  std::vector<std::uint8_t> band(stride * static_cast<std::size_t>(std::min(rows, height)));
  IdatStream stream(layout, name);
  for (int y0 = 0; y0 < height; y0 += rows) {
    const int y1 = std::min(height, y0 + rows);
    for (int y = y0; y < y1; ++y) {
      stream.read(row);
      check_filter(row[0], static_cast<std::uint32_t>(y), name);
      if (row[0] != 0) {
        unfilter_wide(row[0], row.data() + 1, above.data() + 1, static_cast<int>(bytes), 3);
      }
      std::uint8_t* const out = band.data() + stride * static_cast<std::size_t>(y - y0);
      out[0] = 0;
      // Rows refer to the one above as it was stored.
      if (blue_first) {
        ordered = row;
        for (std::size_t x = 1; x <= bytes; x += 3) std::swap(ordered[x], ordered[x + 2]);
      }
      std::copy_n((blue_first ? ordered : row).data() + 1, stride - 1, out + 1);
      above.swap(row);
    }
    if (y1 == height) stream.finish();
    sink(y0, y1, band.data());
  }
}

/// Runs through the data of any format, so that only sound ones reach the general decoder, which
/// would print what it does not like.
void check_stream(const PngLayout& layout, const PngName& name) {
  IdatStream stream(layout, name);
  std::vector<std::uint8_t> row;
  for (const PngLayout::Rows& rows : layout.rows()) {
    row.resize(rows.bytes);
    for (std::uint64_t y = 0; y < rows.count; ++y) {
      stream.read(row);
      check_filter(row[0], static_cast<std::uint32_t>(y), name);
    }
  }
  stream.finish();
}

/// The PNG without ancillary chunks: colour profiles and gamma must not touch light levels, and a
/// chunk that is not needed can't be wrong.
std::vector<std::uint8_t> core_png(const PngLayout& layout) {
  std::vector<std::uint8_t> png(std::begin(kPngSignature), std::end(kPngSignature));
  for (const Bytes chunk : layout.core) png.insert(png.end(), chunk.begin(), chunk.end());
  return png;
}

std::uint8_t to_grey(const std::uint8_t* p, int channels, bool alpha) {
  const int colours = alpha ? channels - 1 : channels;
  const int grey = colours == 3 ? (p[0] + p[1] + p[2] + 1) / 3 : p[0];
  return static_cast<std::uint8_t>(alpha ? (grey * p[channels - 1] + 127) / 255 : grey);
}

void decode_other(const PngLayout& layout, int rows, const PngName& name, const RawBandSink& sink) {
  check_stream(layout, name);
  const std::vector<std::uint8_t> png = core_png(layout);
  const int width = static_cast<int>(layout.width), height = static_cast<int>(layout.height);
  const std::size_t stride = raw_stride(width);
  std::vector<std::uint8_t> band(stride * static_cast<std::size_t>(std::min(rows, height)));
  const std::string problem = image_functions().decode_png(
      png, width, height, rows, [&](int y0, int y1, const std::uint8_t* pixels, int channels) {
        const bool alpha = channels == 2 || channels == 4;
        const std::size_t count = static_cast<std::size_t>(y1 - y0);
        for (std::size_t y = 0; y < count; ++y) {
          for (std::size_t x = 0; x < static_cast<std::size_t>(width); ++x, pixels += channels) {
            band[y * stride + 1 + x] = to_grey(pixels, channels, alpha);
          }
        }
        sink(y0, y1, band.data());
      });
  if (!problem.empty()) bad_png(name, "PNG can't be decoded: " + problem);
}

/// 16 bits, not interlaced.
std::vector<std::uint16_t> decode_wide(const PngLayout& layout, const PngName& name) {
  const bool colours = layout.colour == rgb || layout.colour == rgb_alpha;
  const bool alpha = layout.colour == grey_alpha || layout.colour == rgb_alpha;
  const int values = colours ? 3 : 1, channels = values + (alpha ? 1 : 0);
  const std::size_t bytes = std::size_t{2} * static_cast<unsigned>(channels) * layout.width;
  std::vector<std::uint8_t> row(bytes + 1), above(bytes + 1, 0);
  std::vector<std::uint16_t> pixels;
  pixels.reserve(std::size_t{layout.width} * layout.height);
  IdatStream stream(layout, name);
  for (std::uint32_t y = 0; y < layout.height; ++y) {
    stream.read(row);
    check_filter(row[0], y, name);
    unfilter_wide(row[0], row.data() + 1, above.data() + 1, static_cast<int>(bytes), 2 * channels);
    const std::uint8_t* p = row.data() + 1;
    const auto value = [](const std::uint8_t* at) { return std::uint32_t{at[0]} * 256 + at[1]; };
    for (std::uint32_t x = 0; x < layout.width; ++x, p += std::ptrdiff_t{2} * channels) {
      std::uint32_t light = colours ? (value(p) + value(p + 2) + value(p + 4) + 1) / 3 : value(p);
      if (alpha) {
        const std::uint64_t seen = std::uint64_t{light} * value(p + std::ptrdiff_t{2} * values);
        light = static_cast<std::uint32_t>((seen + 32767) / 65535);
      }
      pixels.push_back(static_cast<std::uint16_t>(light));
    }
    above.swap(row);
  }
  stream.finish();
  return pixels;
}

}  // namespace

CameraPicture decode_camera_png(Bytes png, int width_px, int height_px, const PngName& name) {
  const PngLayout layout = read_png_layout(png, width_px, height_px, name);
  CameraPicture picture{width_px, height_px, 255, {}};
  if (layout.bit_depth == 16 && !layout.interlaced) {
    picture.white = 65535;
    picture.pixels = decode_wide(layout, name);
    return picture;
  }
  const std::size_t stride = raw_stride(width_px);
  const auto take = [&](int y0, int y1, const std::uint8_t* raw) {
    picture.pixels.resize((stride - 1) * static_cast<std::size_t>(height_px));
    if (raw == nullptr) return;
    for (int y = y0; y < y1; ++y) {
      std::copy_n(raw + static_cast<std::size_t>(y - y0) * stride + 1, stride - 1,
                  picture.pixels.data() + static_cast<std::size_t>(y) * (stride - 1));
    }
  };
  decode_png_bands(png, width_px, height_px, 32, name, take);
  return picture;
}

std::uint32_t decode_png_bands(Bytes png, int width_px, int height_px, int rows,
                               const PngName& name, const RawBandSink& sink, bool packed_rgb,
                               bool blue_first) {
  const int png_width = packed_rgb ? (width_px + 2) / 3 : width_px;
  const PngLayout layout = read_png_layout(png, png_width, height_px, name);
  const bool plain = layout.colour == grey && !layout.interlaced && !layout.transparent_colour;
  if (!packed_rgb && plain && layout.bit_depth == 8) return decode_grey(layout, rows, name, sink);
  if (!packed_rgb && plain && layout.bit_depth == 1) return decode_bits(layout, rows, name, sink);
  std::uint32_t adler = 1;
  const auto take = [&](int y0, int y1, const std::uint8_t* raw) {
    adler = adler_after(adler, {raw, raw_stride(width_px) * static_cast<std::size_t>(y1 - y0)});
    sink(y0, y1, raw);
  };
  if (!packed_rgb) {
    decode_other(layout, rows, name, take);
    return adler;
  }
  if (layout.colour != rgb || layout.bit_depth != 8 || layout.interlaced) {
    bad_png(name, "expected an 8-bit RGB image that packs three grey pixels in each of its own");
  }
  decode_packed(layout, width_px, rows, name, take, blue_first);
  return adler;
}

}  // namespace slicecorr::detail
