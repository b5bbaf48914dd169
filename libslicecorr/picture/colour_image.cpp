// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <libdeflate.h>

#include <algorithm>
#include <cstdlib>
#include <memory>
#include <new>

#include "slicecorr/picture.hpp"
#include "stack/png/png.hpp"

namespace slicecorr {

ColourImage side_by_side(const ColourImage& left, const ColourImage& right) {
  constexpr int gap = 24;
  ColourImage both{
      left.width_px + gap + right.width_px, std::max(left.height_px, right.height_px), {}};
  both.rgb.assign(
      static_cast<std::size_t>(both.width_px) * static_cast<std::size_t>(both.height_px) * 3, 255);
  const auto paste = [&](const ColourImage& part, int x) {
    for (int y = 0; y < part.height_px; ++y) {
      std::copy_n(part.rgb.begin() + static_cast<std::ptrdiff_t>(y) * part.width_px * 3,
                  static_cast<std::ptrdiff_t>(part.width_px) * 3,
                  both.rgb.begin() + (static_cast<std::ptrdiff_t>(y) * both.width_px + x) * 3);
    }
  };
  paste(left, 0);
  paste(right, left.width_px + gap);
  return both;
}

ColourImage tiled(const std::vector<ColourImage>& pictures, int columns) {
  constexpr int gap = 24;
  ColourImage all;
  if (pictures.empty()) return all;
  const int width = pictures[0].width_px, height = pictures[0].height_px;
  const int count = static_cast<int>(pictures.size());
  const int across = std::clamp(columns, 1, count), rows = (count + across - 1) / across;
  all.width_px = across * width + (across - 1) * gap;
  all.height_px = rows * height + (rows - 1) * gap;
  all.rgb.assign(
      static_cast<std::size_t>(all.width_px) * static_cast<std::size_t>(all.height_px) * 3, 255);
  for (int i = 0; i < count; ++i) {
    const int x = i % across * (width + gap), top = i / across * (height + gap);
    const ColourImage& part = pictures[static_cast<std::size_t>(i)];
    for (int y = 0; y < height; ++y) {
      std::copy_n(part.rgb.begin() + static_cast<std::ptrdiff_t>(y) * width * 3,
                  static_cast<std::ptrdiff_t>(width) * 3,
                  all.rgb.begin() + (static_cast<std::ptrdiff_t>(top + y) * all.width_px + x) * 3);
    }
  }
  return all;
}

namespace {

/// A row of RGB pixels as PNG stores it: the filter's number, then the bytes less what it guesses
/// from the pixel to the left (1), from the row above (2), or nothing (0). Of these the one whose
/// bytes are the smallest in sum.
void filter_row(const std::uint8_t* row, const std::uint8_t* above, std::size_t bytes,
                std::uint8_t* out) {
  const auto filtered = [&](int filter, std::size_t i) {
    const std::uint8_t left = i < 3 ? 0 : row[i - 3];
    return static_cast<std::uint8_t>(row[i] - (filter == 1 ? left : filter == 2 ? above[i] : 0));
  };
  std::uint64_t least = UINT64_MAX;
  int best = 0;
  for (const int filter : {0, 2, 1}) {
    std::uint64_t sum = 0;
    for (std::size_t i = 0; i < bytes; ++i) {
      sum += static_cast<unsigned>(std::abs(static_cast<std::int8_t>(filtered(filter, i))));
    }
    if (sum >= least) continue;
    least = sum;
    best = filter;
  }
  out[0] = static_cast<std::uint8_t>(best);
  for (std::size_t i = 0; i < bytes; ++i) out[i + 1] = filtered(best, i);
}

}  // namespace

std::vector<std::uint8_t> encode_png(const ColourImage& image) {
  const auto bytes = static_cast<std::size_t>(image.width_px) * 3;
  const auto height = static_cast<std::size_t>(image.height_px);
  std::vector<std::uint8_t> raw((bytes + 1) * height);
  const std::vector<std::uint8_t> black(bytes, 0);
  for (std::size_t y = 0; y < height; ++y) {
    const std::uint8_t* const row = image.rgb.data() + y * bytes;
    filter_row(row, y ? row - bytes : black.data(), bytes, raw.data() + y * (bytes + 1));
  }
  const std::unique_ptr<libdeflate_compressor, decltype(&libdeflate_free_compressor)> compressor(
      libdeflate_alloc_compressor(4), libdeflate_free_compressor);
  if (!compressor) throw std::bad_alloc();
  std::vector<std::uint8_t> png;
  detail::PixelCode rgb;
  rgb.colour = 2;
  detail::append_png_header(image.width_px, image.height_px, rgb, png);
  const std::size_t chunk = detail::begin_chunk("IDAT", png), start = png.size();
  png.resize(start + libdeflate_zlib_compress_bound(compressor.get(), raw.size()));
  png.resize(start + libdeflate_zlib_compress(compressor.get(), raw.data(), raw.size(),
                                              png.data() + start, png.size() - start));
  detail::end_chunk(chunk, png);
  detail::append_png_iend(png);
  return png;
}

}  // namespace slicecorr
