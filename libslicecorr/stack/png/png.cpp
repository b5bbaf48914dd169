// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/png/png.hpp"

#include <libdeflate.h>
#include <zlib.h>

#include <algorithm>
#include <cstring>
#include <utility>

#include "stack/isa_l.hpp"
#include "stack/png/png_layout.hpp"
#include "stack/png/run_deflate.hpp"

namespace slicecorr {
namespace detail {
namespace {

void append_u32(std::uint32_t value, std::vector<std::uint8_t>& out) {
  for (int shift = 24; shift >= 0; shift -= 8)
    out.push_back(static_cast<std::uint8_t>(value >> shift));
}

void store_u32(std::uint32_t value, std::uint8_t* at) {
  for (int i = 0; i < 4; ++i) at[i] = static_cast<std::uint8_t>(value >> (24 - 8 * i));
}

}  // namespace

std::size_t begin_chunk(const char* type, std::vector<std::uint8_t>& out) {
  const std::size_t start = out.size();
  out.insert(out.end(), 4, 0);  // the length comes at the end
  out.insert(out.end(), type, type + 4);
  return start;
}

void end_chunk(std::size_t start, std::vector<std::uint8_t>& out) {
  const std::size_t length = out.size() - start - 8;
  store_u32(static_cast<std::uint32_t>(length), out.data() + start);
  append_u32(isal::crc32(0, out.data() + start + 4, length + 4), out);
}

struct IdatEncoder::Impl {
  RunDeflater deflater;
};

IdatEncoder::IdatEncoder() : impl_(std::make_unique<Impl>()) {}
IdatEncoder::~IdatEncoder() = default;
IdatEncoder::IdatEncoder(IdatEncoder&&) noexcept = default;

IdatEncoder::Found IdatEncoder::take(const GreyRows& r) {
  RunDeflater& deflater = impl_->deflater;
  const auto before = static_cast<std::size_t>(r.x0), width = static_cast<std::size_t>(r.x1 - r.x0);
  const std::size_t after = static_cast<std::size_t>(r.width_px) - before - width;
  deflater.clear();
  for (int y = 0; y < r.rows; ++y) {
    deflater.add_zeros(1 + before);
    deflater.add(r.pixels + width * static_cast<std::size_t>(y), width);
    deflater.add_zeros(after);
  }
  deflater.end();
  if (deflater.only_zeros()) return Found::black;
  return deflater.repeats_last() ? Found::repeated : Found::other;
}

void IdatEncoder::make(std::vector<std::uint8_t>& out) {
  const std::size_t chunk = begin_chunk("IDAT", out);
  impl_->deflater.write(out);
  end_chunk(chunk, out);
}

std::uint32_t IdatEncoder::encode(std::span<const std::uint8_t> raw,
                                  std::vector<std::uint8_t>& out) {
  impl_->deflater.clear();
  impl_->deflater.add(raw.data(), raw.size());
  impl_->deflater.end();
  make(out);
  return adler_of(raw);
}

std::size_t PixelCode::stride(int width_px) const {
  const auto bytes = static_cast<std::size_t>(value_bytes + opaque_bytes);
  return 1 + static_cast<std::size_t>(png_width(width_px)) * (packed_rgb ? 3 : bytes);
}

void PixelCode::expand(std::span<const std::uint8_t> grey_rows, int width_px,
                       std::vector<std::uint8_t>& out) const {
  const std::size_t from = raw_stride(width_px), to = stride(width_px);
  const auto bytes = static_cast<std::size_t>(value_bytes + opaque_bytes);
  out.assign(grey_rows.size() / from * to, packed_rgb ? 0 : 255);
  std::uint8_t* row = out.data();
  for (std::size_t at = 0; at < grey_rows.size(); at += from, row += to) {
    row[0] = 0;
    if (packed_rgb) {
      std::copy_n(grey_rows.data() + at + 1, from - 1, row + 1);
      for (std::size_t x = 1; blue_first && x < to; x += 3) std::swap(row[x], row[x + 2]);
      continue;
    }
    std::uint8_t* pixel = row + 1;
    for (std::size_t x = 1; x < from; ++x, pixel += bytes) {
      std::fill_n(pixel, value_bytes, grey_rows[at + x]);
    }
    // Differences to the pixel before (filter 1): areas of one value become runs of one byte, which
    // is all that the encoder looks for.
    if (bytes == 1) continue;
    row[0] = 1;
    for (std::size_t i = to - 1; i > bytes; --i) {
      row[i] = static_cast<std::uint8_t>(row[i] - row[i - bytes]);
    }
  }
}

void append_png_header(int width_px, int height_px, const PixelCode& code,
                       std::vector<std::uint8_t>& out) {
  out.insert(out.end(), std::begin(kPngSignature), std::end(kPngSignature));
  const std::size_t chunk = begin_chunk("IHDR", out);
  append_u32(static_cast<std::uint32_t>(code.png_width(width_px)), out);
  append_u32(static_cast<std::uint32_t>(height_px), out);
  out.insert(out.end(), {code.bit_depth, code.colour, 0, 0, 0});
  end_chunk(chunk, out);
}

void append_png_iend(std::vector<std::uint8_t>& out) { end_chunk(begin_chunk("IEND", out), out); }

void append_png_start(int width_px, int height_px, const PixelCode& code,
                      std::vector<std::uint8_t>& out) {
  append_png_header(width_px, height_px, code, out);
  const std::size_t chunk = begin_chunk("IDAT", out);
  out.insert(out.end(), {0x78, 0x01});
  end_chunk(chunk, out);
}

void append_png_end(std::uint32_t adler, std::vector<std::uint8_t>& out) {
  const std::size_t chunk = begin_chunk("IDAT", out);
  out.insert(out.end(), {0x03, 0x00});  // a last block with nothing in it
  append_u32(adler, out);
  end_chunk(chunk, out);
  append_png_iend(out);
}

std::uint32_t adler_of(std::span<const std::uint8_t> bytes) { return adler_after(1, bytes); }

std::uint32_t adler_after(std::uint32_t adler, std::span<const std::uint8_t> bytes) {
  // Of no bytes at all the library may begin anew.
  return bytes.empty() ? adler : libdeflate_adler32(adler, bytes.data(), bytes.size());
}

std::uint32_t adler_after_zeros(std::uint32_t adler, std::uint64_t count) {
  // The low half of an Adler-32 is 1 plus the sum of the bytes, the high half the sum of the low
  // halves after each byte.
  constexpr std::uint32_t modulus = 65521;
  const std::uint64_t low = adler & 0xffff;
  const std::uint64_t high = (adler >> 16) + count % modulus * low;
  return static_cast<std::uint32_t>(high % modulus << 16 | low);
}

std::uint32_t adler_of(const GreyRows& r) {
  const auto width = static_cast<std::size_t>(r.x1 - r.x0);
  const auto before = static_cast<std::size_t>(r.x0) + 1;
  const std::size_t after = raw_stride(r.width_px) - before - width;
  std::uint32_t adler = 1;
  for (int y = 0; y < r.rows; ++y) {
    adler = adler_after_zeros(adler, before);
    adler = adler_after(adler, {r.pixels + width * static_cast<std::size_t>(y), width});
    adler = adler_after_zeros(adler, after);
  }
  return adler;
}

std::uint32_t join_adler(std::uint32_t first, std::uint32_t second, std::uint64_t second_bytes) {
  return static_cast<std::uint32_t>(
      adler32_combine(first, second, static_cast<z_off_t>(second_bytes)));
}

}  // namespace detail

std::vector<std::uint8_t> encode_png(const GreyImage& image) {
  using namespace detail;
  const std::size_t stride = raw_stride(image.width_px);
  const int rows = static_cast<int>(std::max<std::size_t>(1, (std::size_t{4} << 20) / stride));
  std::vector<std::uint8_t> out;
  append_png_start(image.width_px, image.height_px, {}, out);
  IdatEncoder encoder;
  std::uint32_t adler = 1;
  for (int y0 = 0; y0 < image.height_px; y0 += rows) {
    const GreyRows piece{image.width_px, 0, image.width_px, std::min(rows, image.height_px - y0),
                         image.pixels.data() + static_cast<std::size_t>(y0) * (stride - 1)};
    encoder.take(piece);
    encoder.make(out);
    adler = join_adler(adler, adler_of(piece), stride * static_cast<std::size_t>(piece.rows));
  }
  append_png_end(adler, out);
  return out;
}

GreyImage decode_png(const std::vector<std::uint8_t>& png, int expected_width_px,
                     int expected_height_px, const std::string& file, const std::string& what) {
  GreyImage image{expected_width_px, expected_height_px, {}};
  const std::size_t stride = detail::raw_stride(expected_width_px);
  const auto take = [&](int y0, int y1, const std::uint8_t* raw) {
    // Allocated only once the image has proved to be as large as expected.
    image.pixels.resize((stride - 1) * static_cast<std::size_t>(expected_height_px));
    if (raw == nullptr) return;
    for (int y = y0; y < y1; ++y) {
      std::copy_n(raw + static_cast<std::size_t>(y - y0) * stride + 1, stride - 1,
                  image.pixels.data() + static_cast<std::size_t>(y) * (stride - 1));
    }
  };
  detail::decode_png_bands(png, expected_width_px, expected_height_px, 32, {file, what}, take);
  return image;
}

}  // namespace slicecorr
