// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Lines of CXDLP: 13 bits of the first row, 13 of the last, 14 of the column, all highest bit first, and a
// byte of grey. Columns ascend, and rows within them.
#include <algorithm>
#include <cstring>

#include "stack/layer_code/codes.hpp"

namespace slicecorr::detail {
namespace {

/// Columns are gathered in strips of so many, so that rows are walked in whole cache lines.
constexpr int kStrip = 64;

class CxdlpCode final : public LayerCodec {
 public:
  CxdlpCode(int width_px, int height_px) : LayerCodec(width_px, height_px, all_grey()) {}

  std::size_t decode(std::span<const std::vector<std::uint8_t>> pieces, std::uint8_t* pixels,
                     const LayerName& name) const override {
    std::memset(pixels, 0, pixel_count());
    const std::vector<std::uint8_t>& code = pieces[0];
    if (code.size() % kCxdlpLineBytes != 0) name.fail("its last line is cut off");
    const auto width = static_cast<std::size_t>(width_px_);
    for (std::size_t i = 0; i < code.size(); i += kCxdlpLineBytes) {
      std::uint64_t bits = 0;
      for (std::size_t k = 0; k < 5; ++k) bits = bits << 8 | code[i + k];
      const auto first = static_cast<int>(bits >> 27), last = static_cast<int>(bits >> 14 & 0x1fff),
                 column = static_cast<int>(bits & 0x3fff);
      if (last < first || last >= height_px_ || column >= width_px_) {
        name.fail("a line goes from row " + std::to_string(first) + " to " + std::to_string(last) +
                  " of column " + std::to_string(column) + ", which is not inside of " +
                  std::to_string(width_px_) + " x " + std::to_string(height_px_) + " pixels");
      }
      std::uint8_t* p = pixels + width * static_cast<std::size_t>(first) + column;
      for (int y = first; y <= last; ++y, p += width) *p = code[i + 5];
    }
    return 0;
  }

  void encode(int, const std::uint8_t* pixels,
              std::vector<std::vector<std::uint8_t>>& pieces) const override {
    pieces.resize(1);
    std::vector<std::uint8_t>& out = pieces[0];
    out.clear();
    // Most rows and columns of most layers are black, and looking at them is quicker than turning them.
    const auto width = static_cast<std::size_t>(width_px_);
    std::vector<std::uint8_t> lit(width);  // of columns, all their pixels
    std::size_t top = 0, bottom = 0;       // of the lit rows
    for (std::size_t y = 0; y < static_cast<std::size_t>(height_px_); ++y) {
      const std::uint8_t* const row = pixels + width * y;
      if (row[0] == 0 && run_end(row, 0, width) == width) continue;
      if (bottom == 0) top = y;
      bottom = y + 1;
      for (std::size_t x = 0; x < width; ++x) lit[x] |= row[x];
    }
    const std::size_t height = bottom - top;
    std::vector<std::uint8_t> columns(static_cast<std::size_t>(kStrip) * height);
    for (int x0 = 0; x0 < width_px_; x0 += kStrip) {
      const int n = std::min(kStrip, width_px_ - x0);
      if (std::all_of(&lit[static_cast<std::size_t>(x0)], lit.data() + x0 + n,
                      [](std::uint8_t v) { return v == 0; })) {
        continue;
      }
      gather(pixels + width * top, height, x0, n, columns.data());
      for (int c = 0; c < n; ++c) {
        std::uint64_t y = top;
        each_pixel_run(columns.data() + height * static_cast<std::size_t>(c), height,
                       [&](std::uint8_t grey, std::size_t count) {
                         const std::uint64_t first = y, last = y + count - 1;
                         y += count;
                         if (grey == 0) return;
                         const std::uint64_t bits =
                             first << 27 | last << 14 | static_cast<std::uint64_t>(x0 + c);
                         for (int shift = 32; shift >= 0; shift -= 8) {
                           out.push_back(static_cast<std::uint8_t>(bits >> shift));
                         }
                         out.push_back(grey);
                       });
      }
    }
  }

 private:
  /// Some columns of some rows, each of them in one piece.
  void gather(const std::uint8_t* pixels, std::size_t height, int x0, int n,
              std::uint8_t* columns) const {
    const auto width = static_cast<std::size_t>(width_px_);
    for (std::size_t y = 0; y < height; ++y) {
      const std::uint8_t* const row = pixels + width * y + x0;
      for (int c = 0; c < n; ++c) columns[height * static_cast<std::size_t>(c) + y] = row[c];
    }
  }
};

}  // namespace

LayerCodecPtr cxdlp_code(int width_px, int height_px) {
  return std::make_shared<CxdlpCode>(width_px, height_px);
}

}  // namespace slicecorr::detail
