#include "stack/png.hpp"

#include <isa-l.h>
#include <zlib.h>

#include <algorithm>
#include <cstring>
#include <new>
#include <utility>

#include "slicecorr/error.hpp"
#include "stack/png_layout.hpp"

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

/// Appends length (filled in by `end_chunk`) and type; returns where the chunk starts.
std::size_t begin_chunk(const char* type, std::vector<std::uint8_t>& out) {
  const std::size_t start = out.size();
  out.insert(out.end(), 4, 0);
  out.insert(out.end(), type, type + 4);
  return start;
}

void end_chunk(std::size_t start, std::vector<std::uint8_t>& out) {
  const std::size_t length = out.size() - start - 8;
  store_u32(static_cast<std::uint32_t>(length), out.data() + start);
  append_u32(crc32_gzip_refl(0, out.data() + start + 4, length + 4), out);
}

}  // namespace

// zlib, not ISA-L: igzip picks its code by processor, and on busy machines it was seen to choose
// other matches for the same input about once in 10,000 pieces. Stacks must be the same bytes every
// time.
struct IdatEncoder::Impl {
  z_stream stream{};
};

IdatEncoder::IdatEncoder() : impl_(std::make_unique<Impl>()) {
  // Runs are what slices are made of; no other matches are worth their search. Raw deflate.
  if (deflateInit2(&impl_->stream, 1, Z_DEFLATED, -15, 9, Z_RLE) != Z_OK) throw std::bad_alloc();
}
IdatEncoder::~IdatEncoder() {
  if (impl_) deflateEnd(&impl_->stream);
}
IdatEncoder::IdatEncoder(IdatEncoder&&) noexcept = default;

std::uint32_t IdatEncoder::encode(std::span<const std::uint8_t> raw,
                                  std::vector<std::uint8_t>& out) {
  const std::size_t chunk = begin_chunk("IDAT", out);
  const std::size_t start = out.size();
  z_stream& z = impl_->stream;
  deflateReset(&z);
  // The bound is for a finished stream; a full flush adds an empty stored block.
  out.resize(start + deflateBound(&z, static_cast<uLong>(raw.size())) + 16);
  z.next_in = const_cast<std::uint8_t*>(raw.data());
  z.avail_in = static_cast<uInt>(raw.size());
  z.next_out = out.data() + start;
  z.avail_out = static_cast<uInt>(out.size() - start);
  // Byte-aligned and not final: pieces can be joined.
  if (deflate(&z, Z_FULL_FLUSH) != Z_OK || z.avail_in != 0 || z.avail_out == 0) {
    throw Error("deflating an image failed");
  }
  out.resize(static_cast<std::size_t>(z.next_out - out.data()));
  end_chunk(chunk, out);
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
  }
}

void append_png_start(int width_px, int height_px, const PixelCode& code,
                      std::vector<std::uint8_t>& out) {
  out.insert(out.end(), std::begin(png_signature), std::end(png_signature));
  std::size_t chunk = begin_chunk("IHDR", out);
  append_u32(static_cast<std::uint32_t>(code.png_width(width_px)), out);
  append_u32(static_cast<std::uint32_t>(height_px), out);
  out.insert(out.end(), {code.bit_depth, code.colour, 0, 0, 0});
  end_chunk(chunk, out);
  chunk = begin_chunk("IDAT", out);
  out.insert(out.end(), {0x78, 0x01});
  end_chunk(chunk, out);
}

void append_png_end(std::uint32_t adler, std::vector<std::uint8_t>& out) {
  std::size_t chunk = begin_chunk("IDAT", out);
  out.insert(out.end(), {0x03, 0x00});  // a last block with nothing in it
  append_u32(adler, out);
  end_chunk(chunk, out);
  chunk = begin_chunk("IEND", out);
  end_chunk(chunk, out);
}

std::uint32_t adler_of(std::span<const std::uint8_t> bytes) {
  return isal_adler32(1, bytes.data(), bytes.size());
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
  std::vector<std::uint8_t> out, raw;
  append_png_start(image.width_px, image.height_px, {}, out);
  IdatEncoder encoder;
  std::uint32_t adler = 1;
  for (int y0 = 0; y0 < image.height_px; y0 += rows) {
    const int y1 = std::min(image.height_px, y0 + rows);
    raw.assign(stride * static_cast<std::size_t>(y1 - y0), 0);
    for (int y = y0; y < y1; ++y) {
      std::copy_n(image.pixels.data() + static_cast<std::size_t>(y) * (stride - 1), stride - 1,
                  raw.data() + static_cast<std::size_t>(y - y0) * stride + 1);
    }
    adler = join_adler(adler, encoder.encode(raw, out), raw.size());
  }
  append_png_end(adler, out);
  return out;
}

GreyImage decode_png(const std::vector<std::uint8_t>& png, int expected_width_px,
                     int expected_height_px, const std::string& file, const std::string& what) {
  GreyImage image{expected_width_px, expected_height_px, {}};
  const std::size_t stride = detail::raw_stride(expected_width_px);
  const auto take = [&](int y0, int y1, const std::uint8_t* raw) {
    // Made late: only once the image has shown that it is as large as expected.
    image.pixels.resize((stride - 1) * static_cast<std::size_t>(expected_height_px));
    for (int y = y0; y < y1; ++y) {
      std::copy_n(raw + static_cast<std::size_t>(y - y0) * stride + 1, stride - 1,
                  image.pixels.data() + static_cast<std::size_t>(y) * (stride - 1));
    }
  };
  detail::decode_png_bands(png, expected_width_px, expected_height_px, 32, {file, what}, take);
  return image;
}

}  // namespace slicecorr
