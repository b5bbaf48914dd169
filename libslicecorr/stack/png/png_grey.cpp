// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <libdeflate.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <cstring>

#include "base/coded_band.hpp"
#include "stack/png/png_layout.hpp"

namespace slicecorr::detail {
namespace {

using Bytes = std::span<const std::uint8_t>;

/// Most bytes of an image that is inflated as a whole. The C library keeps freed blocks of up to
/// 32 MiB for the next image; fresh memory for larger ones would cost more time than inflating band
/// by band.
constexpr std::uint64_t kMostAtOnce = std::uint64_t{31} << 20;

/// Fills `out` and takes all of `in`, or returns false.
class Inflater {
 public:
  Inflater() : state_(libdeflate_alloc_decompressor(), &libdeflate_free_decompressor) {}
  bool fill(Bytes in, std::span<std::uint8_t> out) {
    if (!state_) return false;
    std::size_t taken = 0, made = 0;
    return libdeflate_deflate_decompress_ex(state_.get(), in.data(), in.size(), out.data(),
                                            out.size(), &taken, &made) == LIBDEFLATE_SUCCESS &&
           taken == in.size() && made == out.size();
  }

 private:
  std::unique_ptr<libdeflate_decompressor, decltype(&libdeflate_free_decompressor)> state_;
};

/// Bytes before and after the deflate blocks of a zlib stream.
constexpr std::size_t kZlibStart = 2, kZlibEnd = 4;

bool is_zlib_start(Bytes b) {
  // Deflate with a window of up to 32 KiB, and no dictionary.
  return b.size() >= kZlibStart && (b[0] & 15) == 8 && b[0] >> 4 <= 7 && (b[1] & 32) == 0 &&
         (b[0] * 256 + b[1]) % 31 == 0;
}

/// Bands of rows on their way from inflating to the sink.
class GreyBands {
 public:
  GreyBands(const PngLayout& layout, int rows, const PngName& name, const RawBandSink& sink)
      : name_(name),
        sink_(sink),
        width_(static_cast<int>(layout.width)),
        height_(static_cast<int>(layout.height)),
        rows_(rows),
        last_(raw_stride(width_), 0) {}

  /// Starts again from the top. Bands that went to the sink already don't go there again.
  void restart() {
    y_ = 0;
    stored_adler_ = adler_ = 1;
    std::fill(last_.begin(), last_.end(), std::uint8_t{0});
  }
  bool done() const { return y_ == height_; }
  bool is_last() const { return y_ + rows_ >= height_; }
  std::size_t next_bytes() const {
    return raw_stride(width_) * static_cast<std::size_t>(std::min(rows_, height_ - y_));
  }
  int count() const { return (height_ + rows_ - 1) / rows_; }

  /// Takes the next band as it is stored. `check` is called before the band goes to the sink: after
  /// the last band nothing may be found wrong with the whole any more.
  template <class Check>
  bool take(std::uint8_t* band, const Check& check) {
    const int y1 = std::min(height_, y_ + rows_);
    const std::size_t stride = raw_stride(width_), size = next_bytes();
    stored_adler_ = adler_after(stored_adler_, {band, size});
    bool filtered = false;
    const std::uint8_t* above = last_.data();
    std::uint8_t* row = band;
    for (int y = y_; y < y1; ++y, row += stride) {
      if (row[0] != 0) {
        check_filter(row[0], static_cast<std::uint32_t>(y), name_);
        unfilter_row(row[0], row + 1, above + 1, width_);
        row[0] = 0;
        filtered = true;
      }
      above = row;
    }
    differs_ = differs_ || filtered;
    adler_ = differs_ ? adler_after(adler_, {band, size}) : stored_adler_;
    std::copy_n(above, stride, last_.data());
    return pass_on(y1, band, check);
  }
  /// Takes a next band whose stored bytes are all zeros.
  template <class Check>
  bool take_black(const Check& check) {
    stored_adler_ = adler_after_zeros(stored_adler_, next_bytes());
    adler_ = differs_ ? adler_after_zeros(adler_, next_bytes()) : stored_adler_;
    std::fill(last_.begin(), last_.end(), std::uint8_t{0});
    return pass_on(std::min(height_, y_ + rows_), nullptr, check);
  }
  std::uint32_t stored_adler() const { return stored_adler_; }
  std::uint32_t adler() const { return adler_; }

 private:
  template <class Check>
  bool pass_on(int y1, const std::uint8_t* band, const Check& check) {
    if (y1 == height_ && !check()) return false;
    if (y_ >= passed_) {
      sink_(y_, y1, band);
      passed_ = y1;
    }
    y_ = y1;
    return true;
  }

  const PngName& name_;
  const RawBandSink& sink_;
  int width_, height_, rows_;
  int y_ = 0, passed_ = 0;
  std::vector<std::uint8_t> last_;  ///< last row of the band above
  std::uint32_t stored_adler_ = 1, adler_ = 1;
  bool differs_ = false;  ///< whether these are of different bytes
};

/// Our own images: a chunk for the start of the stream, one per band that ends on a byte and refers
/// to nothing before it, and one for the end. Images that only look like it are found by size and
/// checksum. Returns false for these, and when anything is wrong.
bool decode_pieces(const PngLayout& layout, Inflater& inflater, GreyBands& bands) {
  const std::vector<Bytes>& chunks = layout.idat;
  constexpr std::array<std::uint8_t, 4> mark = {0, 0, 255, 255};  // ends an empty stored block
  constexpr std::array<std::uint8_t, 2> last_block = {3, 0};      // with nothing in it
  if (chunks.size() != static_cast<std::size_t>(bands.count()) + 2 ||
      chunks.front().size() != kZlibStart || !is_zlib_start(chunks.front()) ||
      chunks.back().size() != last_block.size() + kZlibEnd ||
      !std::equal(last_block.begin(), last_block.end(), chunks.back().begin())) {
    return false;
  }
  std::vector<std::uint8_t> piece, band(bands.next_bytes());
  Bytes black;                  // a chunk that makes zeros ...
  std::size_t black_bytes = 0;  // ... so many
  const auto check = [&] {
    return bands.stored_adler() == load_u32(chunks.back().data() + last_block.size());
  };
  for (std::size_t i = 1; !bands.done(); ++i) {
    const Bytes chunk = chunks[i];
    const std::size_t size = bands.next_bytes();
    if (size == black_bytes && std::ranges::equal(chunk, black)) {
      if (!bands.take_black(check)) return false;
      continue;
    }
    if (chunk.size() < mark.size() || !std::equal(mark.begin(), mark.end(), chunk.end() - 4)) {
      return false;
    }
    piece.assign(chunk.begin(), chunk.end());
    piece.insert(piece.end(), last_block.begin(), last_block.end());
    if (!inflater.fill(piece, {band.data(), size})) return false;
    // Only long runs pack so well, so it is worth asking whether all bytes are zeros.
    if (chunk.size() < size / 256 && all_zero(band.data(), size)) {
      black = chunk;
      black_bytes = size;
      if (!bands.take_black(check)) return false;
    } else if (!bands.take(band.data(), check)) {
      return false;
    }
  }
  return true;
}

/// The chunks' contents as one, which need `joined` when there are several.
Bytes join(const PngLayout& layout, std::vector<std::uint8_t>& joined) {
  if (layout.idat.size() == 1) return layout.idat.front();
  joined.reserve(layout.idat_bytes);
  for (const Bytes chunk : layout.idat) joined.insert(joined.end(), chunk.begin(), chunk.end());
  return joined;
}

/// The whole zlib stream but for its checksum.
bool inflate_all(Bytes stream, Inflater& inflater, std::span<std::uint8_t> out) {
  return stream.size() > kZlibStart + kZlibEnd && is_zlib_start(stream) &&
         inflater.fill(stream.subspan(kZlibStart, stream.size() - kZlibStart - kZlibEnd), out);
}

bool decode_whole(const PngLayout& layout, Inflater& inflater, GreyBands& bands) {
  const std::uint64_t size = layout.raw_bytes();
  if (size > kMostAtOnce) return false;
  std::vector<std::uint8_t> joined;
  const Bytes stream = join(layout, joined);
  const auto image = std::make_unique_for_overwrite<std::uint8_t[]>(size);
  if (!inflate_all(stream, inflater, {image.get(), size})) return false;
  const auto check = [&] {
    return bands.stored_adler() == load_u32(stream.data() + stream.size() - kZlibEnd);
  };
  for (std::uint8_t* at = image.get(); !bands.done();) {
    const std::size_t n = bands.next_bytes();
    if (!bands.take(at, check)) return false;
    at += n;
  }
  return true;
}

/// Band by band through the library that says what is wrong.
void decode_stream(const PngLayout& layout, const PngName& name, GreyBands& bands) {
  std::vector<std::uint8_t> band(bands.next_bytes());
  IdatStream stream(layout, name);
  while (!bands.done()) {
    stream.read({band.data(), bands.next_bytes()});
    bands.take(band.data(), [&] {
      stream.finish();
      return true;
    });
  }
}

/// The pixels of each byte of a 1-bit image.
constexpr auto kPixelsOfByte = [] {
  std::array<std::array<std::uint8_t, 8>, 256> table{};
  for (unsigned byte = 0; byte < 256; ++byte) {
    for (unsigned i = 0; i < 8; ++i) table[byte][i] = (byte >> (7 - i) & 1) != 0 ? 255 : 0;
  }
  return table;
}();

}  // namespace

std::uint8_t paeth_guess(int left, int up, int corner) {
  const int to_left = std::abs(up - corner);
  const int to_up = std::abs(left - corner);
  const int to_corner = std::abs(left + up - 2 * corner);
  if (to_left <= to_up && to_left <= to_corner) return static_cast<std::uint8_t>(left);
  return static_cast<std::uint8_t>(to_up <= to_corner ? up : corner);
}

void unfilter_row(int filter, std::uint8_t* row, const std::uint8_t* above, int bytes) {
  int left = 0, corner = 0;
  switch (filter) {
    case 1:
      for (int x = 0; x < bytes; ++x) left = row[x] = static_cast<std::uint8_t>(row[x] + left);
      break;
    case 2:
      for (int x = 0; x < bytes; ++x) row[x] = static_cast<std::uint8_t>(row[x] + above[x]);
      break;
    case 3:
      for (int x = 0; x < bytes; ++x) {
        left = row[x] = static_cast<std::uint8_t>(row[x] + (left + above[x]) / 2);
      }
      break;
    case 4:
      for (int x = 0; x < bytes; ++x) {
        left = row[x] = static_cast<std::uint8_t>(row[x] + paeth_guess(left, above[x], corner));
        corner = above[x];
      }
      break;
    default:
      break;
  }
}

void check_filter(int filter, std::uint32_t y, const PngName& name) {
  if (filter > 4) {
    bad_png(name, "row " + std::to_string(y) + " of the PNG has the unknown filter " +
                      std::to_string(filter));
  }
}

std::uint32_t decode_grey(const PngLayout& layout, int rows, const PngName& name,
                          const RawBandSink& sink) {
  GreyBands bands(layout, rows, name, sink);
  Inflater inflater;
  if (decode_pieces(layout, inflater, bands)) return bands.adler();
  bands.restart();
  if (decode_whole(layout, inflater, bands)) return bands.adler();
  bands.restart();
  decode_stream(layout, name, bands);
  return bands.adler();
}

std::uint32_t decode_bits(const PngLayout& layout, int rows, const PngName& name,
                          const RawBandSink& sink) {
  const int width = static_cast<int>(layout.width), height = static_cast<int>(layout.height);
  const std::size_t bytes = (layout.width + 7) / 8, stride = raw_stride(width);
  std::vector<std::uint8_t> image((bytes + 1) * layout.height), joined;
  const Bytes stream = join(layout, joined);
  Inflater inflater;
  if (!inflate_all(stream, inflater, image) ||
      adler_of(image) != load_u32(stream.data() + stream.size() - kZlibEnd)) {
    IdatStream slow(layout, name);
    slow.read(image);
    slow.finish();
  }
  std::vector<std::uint8_t> band(stride * static_cast<std::size_t>(std::min(rows, height)) + 8);
  const std::vector<std::uint8_t> none(bytes + 1, 0);
  const std::uint8_t* above = none.data();
  std::uint8_t* row = image.data();
  std::uint32_t adler = 1;
  for (int y0 = 0; y0 < height; y0 += rows) {
    const int y1 = std::min(height, y0 + rows);
    std::uint8_t* out = band.data();
    for (int y = y0; y < y1; ++y, row += bytes + 1, out += stride) {
      check_filter(row[0], static_cast<std::uint32_t>(y), name);
      unfilter_row(row[0], row + 1, above + 1, static_cast<int>(bytes));
      above = row;
      out[0] = 0;
      // Up to seven bytes too many: the next row, or nothing, is written there.
      for (std::size_t i = 0; i < bytes; ++i) {
        std::memcpy(out + 1 + 8 * i, kPixelsOfByte[row[1 + i]].data(), 8);
      }
    }
    const std::size_t size = stride * static_cast<std::size_t>(y1 - y0);
    adler = adler_after(adler, {band.data(), size});
    sink(y0, y1, band.data());
  }
  return adler;
}

}  // namespace slicecorr::detail
