// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file png_layout.hpp
/// The chunks of a PNG and its zlib stream, checked without looking at pixels.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "stack/png/png.hpp"

struct inflate_state;

namespace slicecorr::detail {

inline constexpr std::uint8_t kPngSignature[8] = {0x89, 'P', 'N', 'G', 0x0d, 0x0a, 0x1a, 0x0a};

enum PngColour : std::uint8_t { grey = 0, rgb = 2, palette = 3, grey_alpha = 4, rgb_alpha = 6 };

/// What IHDR says, and the chunks that matter for decoding.
struct PngLayout {
  std::uint32_t width = 0, height = 0;
  std::uint8_t bit_depth = 0, colour = 0;
  bool interlaced = false;
  bool transparent_colour = false;                  ///< has tRNS
  std::vector<std::span<const std::uint8_t>> idat;  ///< contents of the IDAT chunks
  std::vector<std::span<const std::uint8_t>> core;  ///< whole chunks, without the ancillary ones
  std::size_t idat_bytes = 0;

  /// Equal rows of the filtered image, filter bytes included.
  struct Rows {
    std::uint64_t count = 0, bytes = 0;
  };
  /// All rows in their order: of the image, or of the passes of an interlaced one.
  std::vector<Rows> rows() const;
  std::uint64_t raw_bytes() const;
};

/// Four bytes, highest first.
inline std::uint32_t load_u32(const std::uint8_t* p) {
  return std::uint32_t{p[0]} << 24 | std::uint32_t{p[1]} << 16 | std::uint32_t{p[2]} << 8 | p[3];
}

[[noreturn]] void bad_png(const PngName& name, const std::string& message);

/// Checks signature, chunk lengths, order and checksums, IHDR and the expected size.
PngLayout read_png_layout(std::span<const std::uint8_t> png, int width_px, int height_px,
                          const PngName& name);

/// The inflated contents of the IDAT chunks, read piece by piece.
class IdatStream {
 public:
  IdatStream(const PngLayout& layout, const PngName& name);
  ~IdatStream();
  /// Fills `out` completely or throws.
  void read(std::span<std::uint8_t> out);
  /// Checks that the stream ends here, with the right Adler-32 and nothing behind it.
  void finish();

 private:
  /// Inflates into `out`; returns the number of bytes, fewer only at the end of the stream.
  std::size_t fill(std::span<std::uint8_t> out);

  const PngLayout& layout_;
  const PngName& name_;
  std::size_t next_chunk_ = 0;
  std::unique_ptr<inflate_state> state_;
};

/// 8-bit grey PNG that is not interlaced, and 1-bit: as `decode_png_bands`.
std::uint32_t decode_grey(const PngLayout& layout, int rows, const PngName& name,
                          const RawBandSink& sink);
std::uint32_t decode_bits(const PngLayout& layout, int rows, const PngName& name,
                          const RawBandSink& sink);

/// Undoes the filter of a row of bytes, each of which a pixel or several, in place. `above` is the
/// row above without filter.
void unfilter_row(int filter, std::uint8_t* row, const std::uint8_t* above, int bytes);
std::uint8_t paeth_guess(int left, int up, int corner);
void check_filter(int filter, std::uint32_t y, const PngName& name);

}  // namespace slicecorr::detail
