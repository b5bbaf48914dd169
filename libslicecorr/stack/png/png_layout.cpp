// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/png/png_layout.hpp"

#include <algorithm>
#include <cctype>
#include <cstring>

#include "slicecorr/error.hpp"
#include "stack/isa_l.hpp"

namespace slicecorr::detail {
namespace {

using Bytes = std::span<const std::uint8_t>;

/// Deflate makes at most 1032 bytes of one.
constexpr std::uint64_t kLargestRatio = 1032;

int channels(std::uint8_t colour) {
  switch (colour) {
    case rgb:
      return 3;
    case grey_alpha:
      return 2;
    case rgb_alpha:
      return 4;
    default:
      return 1;
  }
}

bool valid_format(std::uint8_t depth, std::uint8_t colour) {
  switch (colour) {
    case grey:
      return depth == 1 || depth == 2 || depth == 4 || depth == 8 || depth == 16;
    case palette:
      return depth == 1 || depth == 2 || depth == 4 || depth == 8;
    case rgb:
    case grey_alpha:
    case rgb_alpha:
      return depth == 8 || depth == 16;
    default:
      return false;
  }
}

std::string size_text(std::uint64_t width, std::uint64_t height) {
  return std::to_string(width) + " x " + std::to_string(height) + " pixels";
}

void read_header(Bytes data, int width_px, int height_px, const PngName& name, PngLayout& layout) {
  if (data.size() != 13) bad_png(name, "PNG header has not 13 bytes");
  layout.width = load_u32(data.data());
  layout.height = load_u32(data.data() + 4);
  layout.bit_depth = data[8];
  layout.colour = data[9];
  layout.interlaced = data[12] == 1;
  if (layout.width != static_cast<std::uint32_t>(width_px) ||
      layout.height != static_cast<std::uint32_t>(height_px)) {
    bad_png(name, "image is " + size_text(layout.width, layout.height) + ", expected " +
                      size_text(static_cast<unsigned>(width_px), static_cast<unsigned>(height_px)));
  }
  if (!valid_format(layout.bit_depth, layout.colour) || data[10] != 0 || data[11] != 0 ||
      data[12] > 1) {
    bad_png(name, "PNG header asks for a format that PNG does not have");
  }
}

}  // namespace

PngHeader read_png_header(Bytes png, const PngName& name) {
  if (png.size() < 33 || std::memcmp(png.data(), kPngSignature, 8) != 0 ||
      std::memcmp(png.data() + 12, "IHDR", 4) != 0) {
    bad_png(name, "not a PNG image");
  }
  const std::uint8_t* const data = png.data() + 16;
  const PngHeader header{load_u32(data), load_u32(data + 4), data[8], data[9]};
  if (header.width == 0 || header.height == 0 || !valid_format(header.bit_depth, header.colour)) {
    bad_png(name, "PNG header asks for a format that PNG does not have");
  }
  return header;
}

int PngHeader::channels() const { return detail::channels(colour); }

std::optional<PixelCode> PngHeader::code() const {
  if (colour == palette || bit_depth < 8) return std::nullopt;
  const int bytes = bit_depth / 8, channels = this->channels();
  const bool alpha = colour == grey_alpha || colour == rgb_alpha;
  return PixelCode{(channels - alpha) * bytes, alpha * bytes, bit_depth, colour, false};
}

void bad_png(const PngName& name, const std::string& message) {
  throw InputError(name.file, name.entry, message);
}

std::vector<PngLayout::Rows> PngLayout::rows() const {
  const unsigned bits = bit_depth * static_cast<unsigned>(channels(colour));
  std::vector<Rows> rows;
  const auto add = [&](std::uint64_t w, std::uint64_t h) {
    if (w > 0 && h > 0) rows.push_back({h, 1 + (w * bits + 7) / 8});
  };
  // The passes of Adam7: first column and row, and the steps between.
  static constexpr unsigned kPasses[7][4] = {{0, 0, 8, 8}, {4, 0, 8, 8}, {0, 4, 4, 8}, {2, 0, 4, 4},
                                             {0, 2, 2, 4}, {1, 0, 2, 2}, {0, 1, 1, 2}};
  if (!interlaced) add(width, height);
  for (const auto& [x, y, dx, dy] : kPasses) {
    if (interlaced && x < width && y < height) {
      add((width - x + dx - 1) / dx, (height - y + dy - 1) / dy);
    }
  }
  return rows;
}

std::uint64_t PngLayout::raw_bytes() const {
  std::uint64_t sum = 0;
  for (const Rows& r : rows()) sum += r.count * r.bytes;
  return sum;
}

PngLayout read_png_layout(Bytes png, int width_px, int height_px, const PngName& name) {
  if (png.size() < 8 || std::memcmp(png.data(), kPngSignature, 8) != 0) {
    bad_png(name, "not a PNG image");
  }
  PngLayout layout;
  std::size_t at = 8;
  bool ended = false, after_idat = false;
  std::uint32_t colours = 0;  // in the palette
  for (int number = 0; !ended; ++number) {
    if (png.size() - at < 12) bad_png(name, "PNG is cut off: its end chunk is missing");
    const std::uint32_t length = load_u32(png.data() + at);
    const Bytes type = png.subspan(at + 4, 4);
    if (length > png.size() - at - 12) {
      bad_png(name,
              "PNG chunk at byte " + std::to_string(at) + " reaches over the end of the image");
    }
    const Bytes data = png.subspan(at + 8, length);
    if (isal::crc32(0, type.data(), length + 4) != load_u32(data.data() + length)) {
      bad_png(name, "PNG chunk at byte " + std::to_string(at) + " has a wrong checksum");
    }
    const auto is = [&](const char* text) { return std::memcmp(type.data(), text, 4) == 0; };
    if ((number == 0) != is("IHDR")) bad_png(name, "PNG has no header at its start, or two");
    bool core = true;
    if (number == 0) {
      read_header(data, width_px, height_px, name, layout);
    } else if (is("IDAT")) {
      if (after_idat) bad_png(name, "PNG has other chunks between those with the image");
      if (layout.colour == palette && colours == 0) bad_png(name, "PNG has no palette");
      layout.idat.push_back(data);
      layout.idat_bytes += length;
    } else if (is("IEND")) {
      if (length != 0) bad_png(name, "PNG has an end chunk with contents");
      ended = true;
    } else if (is("PLTE")) {
      const bool fits =
          (layout.colour & rgb) != 0 && length > 0 && length % 3 == 0 && length <= 768;
      if (colours != 0 || !layout.idat.empty() || !fits) bad_png(name, "PNG has a wrong palette");
      colours = length / 3;
    } else if (is("tRNS")) {
      const bool fits = layout.colour == grey      ? length == 2
                        : layout.colour == rgb     ? length == 6
                        : layout.colour == palette ? length > 0 && length <= colours
                                                   : false;
      if (layout.transparent_colour || !layout.idat.empty() || !fits) {
        bad_png(name, "PNG has a wrong transparency chunk");
      }
      layout.transparent_colour = true;
    } else if (std::isupper(type[0])) {
      bad_png(name, "PNG has a chunk of unknown kind that must not be ignored");
    } else {
      core = false;
    }
    if (!layout.idat.empty() && !is("IDAT")) after_idat = true;
    if (core) layout.core.push_back(png.subspan(at, length + std::size_t{12}));
    at += length + std::size_t{12};
  }
  if (at != png.size()) bad_png(name, "PNG has bytes behind its end");
  if (layout.raw_bytes() > kLargestRatio * (layout.idat_bytes + 1)) {
    bad_png(name, "PNG holds too little data for " + size_text(layout.width, layout.height));
  }
  return layout;
}

IdatStream::IdatStream(const PngLayout& layout, const PngName& name)
    : layout_(layout), name_(name), state_(std::make_unique_for_overwrite<inflate_state>()) {
  isal_inflate_init(state_.get());
  state_->crc_flag = ISAL_ZLIB;
  state_->avail_in = 0;
  state_->next_in = nullptr;
}

IdatStream::~IdatStream() = default;

std::size_t IdatStream::fill(std::span<std::uint8_t> out) {
  // The counters of the library have 32 bits.
  constexpr std::size_t most = std::size_t{1} << 30;
  inflate_state& z = *state_;
  std::size_t done = 0;
  while (done < out.size()) {
    if (z.block_state == ISAL_BLOCK_FINISH) break;
    if (z.avail_in == 0 && next_chunk_ < layout_.idat.size()) {
      const Bytes chunk = layout_.idat[next_chunk_++];
      z.next_in = const_cast<std::uint8_t*>(chunk.data());
      z.avail_in = static_cast<std::uint32_t>(chunk.size());
    }
    const bool last_input = next_chunk_ == layout_.idat.size();
    const auto avail_in = z.avail_in;
    z.next_out = out.data() + done;
    z.avail_out = static_cast<std::uint32_t>(std::min(out.size() - done, most));
    if (isal::inflate(&z) != ISAL_DECOMP_OK) {
      bad_png(name_, "compressed data of the PNG are damaged");
    }
    const auto filled = static_cast<std::size_t>(z.next_out - (out.data() + done));
    done += filled;
    if (filled == 0 && last_input && z.avail_in == avail_in) break;  // cut off
  }
  return done;
}

void IdatStream::read(std::span<std::uint8_t> out) {
  if (fill(out) != out.size()) bad_png(name_, "compressed data of the PNG end too early");
}

void IdatStream::finish() {
  std::uint8_t excess[1];
  if (fill(excess) != 0) bad_png(name_, "PNG holds more data than its size needs");
  if (state_->block_state != ISAL_BLOCK_FINISH) {
    bad_png(name_, "compressed data of the PNG end too early");
  }
  const bool more_chunks =
      std::any_of(layout_.idat.begin() + static_cast<std::ptrdiff_t>(next_chunk_),
                  layout_.idat.end(), [](Bytes b) { return !b.empty(); });
  if (more_chunks || state_->avail_in + state_->read_in_length / 8 != 0) {
    bad_png(name_, "PNG has bytes behind its compressed data");
  }
}

}  // namespace slicecorr::detail
