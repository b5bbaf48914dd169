// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file png.hpp
/// PNG made of independent bands, and checked decoding band by band.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "slicecorr/stack.hpp"

namespace slicecorr {
struct CameraPicture;
}

namespace slicecorr::detail {

/// An image's rows as PNG stores them with filter 0: a zero byte before each row of pixels.
/// Their Adler-32 stands for the image.
inline std::size_t raw_stride(int width_px) { return static_cast<std::size_t>(width_px) + 1; }

/// How the pixels of an image stand in the bytes of a PNG's rows. The kinds that repeat a grey
/// value: grey, RGB, with and without an opaque alpha, of 8 or 16 bits (v * 257 is v twice); and
/// three neighbouring grey pixels in one RGB pixel.
struct PixelCode {
  int value_bytes = 1;   ///< bytes that repeat the value
  int opaque_bytes = 0;  ///< bytes of 255 after them
  std::uint8_t bit_depth = 8, colour = 0;
  bool packed_rgb = false;  ///< images are ceil(width / 3) pixels wide; the row's end is black
  bool blue_first = false;  ///< the first of three packed pixels is the blue one, not the red one
  bool is_plain() const { return value_bytes == 1 && opaque_bytes == 0 && !packed_rgb; }
  /// Pixels in a row of the PNG.
  int png_width(int width_px) const { return packed_rgb ? (width_px + 2) / 3 : width_px; }
  /// Bytes of a row with its filter byte.
  std::size_t stride(int width_px) const;
  /// Rows of `raw_stride(width_px)` bytes to rows of `stride(width_px)`, with filter 1 where a
  /// pixel has several bytes of its own.
  void expand(std::span<const std::uint8_t> grey_rows, int width_px,
              std::vector<std::uint8_t>& out) const;
};

/// What the header of a PNG says; nothing else of it is looked at.
struct PngHeader {
  std::uint32_t width = 0, height = 0;
  std::uint8_t bit_depth = 0, colour = 0;
  int channels() const;
  /// The pixel code for writing images of the same depth and colour; nothing for palettes and fewer
  /// than 8 bits, which can't hold every grey value.
  std::optional<PixelCode> code() const;
};
PngHeader read_png_header(std::span<const std::uint8_t> png, const struct PngName& name);

/// Columns [x0, x1) of the rows of a grey image, one row behind the other. What is beside them is
/// black.
struct GreyRows {
  int width_px = 0;  ///< of the image
  int x0 = 0, x1 = 0;
  int rows = 0;
  const std::uint8_t* pixels = nullptr;
};

/// Deflates rows to finished IDAT chunks that can be joined in any number: each ends on a byte and
/// refers to nothing before it. Chunks follow from the bytes alone. Reusable, not thread-safe.
class IdatEncoder {
 public:
  IdatEncoder();
  ~IdatEncoder();
  IdatEncoder(IdatEncoder&&) noexcept;

  /// What `take` found.
  enum class Found {
    black,     ///< no light: there is nothing to make
    repeated,  ///< the same bytes as those of the last chunk
    other
  };
  /// Looks at rows as filter 0 stores them, for `make`. Work is done for columns [x0, x1) only.
  Found take(const GreyRows& rows);
  /// Appends the chunk of what was taken last to `out`.
  void make(std::vector<std::uint8_t>& out);

  /// Appends the chunk of any bytes to `out` and returns their Adler-32.
  std::uint32_t encode(std::span<const std::uint8_t> raw, std::vector<std::uint8_t>& out);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Bytes that `append_png_header` and `append_png_iend` add, both together.
inline constexpr std::size_t kPngFrameBytesOfOne = 8 + 25 + 12;
/// Signature and IHDR; IEND. What is between is one zlib stream in IDAT chunks.
void append_png_header(int width_px, int height_px, const PixelCode& code,
                       std::vector<std::uint8_t>& out);
void append_png_iend(std::vector<std::uint8_t>& out);

/// The same around chunks of `IdatEncoder`: with the start of the zlib stream in an IDAT of its
/// own, and its end with the Adler-32 of all raw bytes.
inline constexpr std::size_t kPngFrameBytes = kPngFrameBytesOfOne + (12 + 2) + (12 + 6);
void append_png_start(int width_px, int height_px, const PixelCode& code,
                      std::vector<std::uint8_t>& out);
void append_png_end(std::uint32_t adler, std::vector<std::uint8_t>& out);

/// Starts a chunk of a type of four letters, and ends the one that starts at this place.
std::size_t begin_chunk(const char* type, std::vector<std::uint8_t>& out);
void end_chunk(std::size_t start, std::vector<std::uint8_t>& out);

std::uint32_t adler_of(std::span<const std::uint8_t> bytes);
/// Adler-32 of rows, each with a filter byte of 0 in front.
std::uint32_t adler_of(const GreyRows& rows);
/// Adler-32 after more bytes.
std::uint32_t adler_after(std::uint32_t adler, std::span<const std::uint8_t> bytes);
/// Adler-32 after `count` more bytes of 0.
std::uint32_t adler_after_zeros(std::uint32_t adler, std::uint64_t count);
/// Adler-32 of two byte strings joined, the second of `second_bytes`.
std::uint32_t join_adler(std::uint32_t first, std::uint32_t second, std::uint64_t second_bytes);

/// Where an image comes from, for messages.
struct PngName {
  const std::string& file;
  const std::string& entry;
};

/// Takes rows [y0, y1) as `raw_stride(width)` bytes each, every filter byte 0; null: all are black.
/// The last band may be shorter than the others.
using RawBandSink = std::function<void(int y0, int y1, const std::uint8_t* raw)>;

/// Decodes any PNG of exactly this size to 8-bit grey, in bands of `rows` from the top. Structure,
/// sizes and checksums are checked first or on the way; throws `InputError`. `packed_rgb`,
/// `blue_first`: see PixelCode. Returns the Adler-32 of the rows that went to the sink.
std::uint32_t decode_png_bands(std::span<const std::uint8_t> png, int width_px, int height_px,
                               int rows, const PngName& name, const RawBandSink& sink,
                               bool packed_rgb = false, bool blue_first = false);

/// Any PNG of exactly this size with all that it tells of light: 16 bits as they are, 8 bits and
/// fewer (and interlaced ones of 16) up to 255. Colours are averaged, transparent is black.
CameraPicture decode_camera_png(std::span<const std::uint8_t> png, int width_px, int height_px,
                                const PngName& name);

}  // namespace slicecorr::detail
