// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Codes of nibbles. PW0 of Photon Workshop: grey above, length below; black and full light have 12 bits of
// length, the lower eight in the next byte. LGS of Longer: grey above, one hexadecimal digit of the length
// below; neighbours of the same grey make one number, highest digit first.
#include <algorithm>

#include "stack/layer_code/codes.hpp"

namespace slicecorr::detail {
namespace {

constexpr std::size_t kMostLong = 0xfff, kMostShort = 0xf;

ShownGrey two_greys() { return grey_in_steps(2); }

class Pw0Code final : public LayerCodec {
 public:
  Pw0Code(int width_px, int height_px, bool two_levels)
      : LayerCodec(width_px, height_px, two_levels ? two_greys() : grey_in_steps(16)) {}

  std::size_t decode(std::span<const std::vector<std::uint8_t>> pieces, std::uint8_t* pixels,
                     const LayerName& name) const override {
    PixelFill fill(pixels, pixel_count(), name);
    const std::vector<std::uint8_t>& code = pieces[0];
    // Of a file without grey any code but black shines full.
    const bool two_levels = levels_of(shown_) == 2;
    for (std::size_t i = 0; i < code.size();) {
      const unsigned value = code[i] >> 4;
      std::size_t count = code[i++] & 0x0f;
      if (is_long(value)) {
        if (i == code.size()) name.fail("its code is cut off");
        count = count << 8 | code[i++];
      }
      if (count == 0) name.fail("a run has no pixels");
      // Version 1 may end with a checksum of two bytes, which nobody has written down well enough.
      if (fill.room() == 0 && code.size() - i <= 2) {
        name.fail("has bytes behind its last pixel, maybe a checksum of a kind that can't be made");
      }
      // Some programs write the last run longer than there is room for it.
      if (i == code.size() && count > fill.room() && fill.room() > 0) count = fill.room();
      const unsigned grey = two_levels && value != 0 ? 255 : value * 17;
      fill.put(static_cast<std::uint8_t>(grey), count);
    }
    return fill.finish(width_px_);
  }

  void encode(int, const std::uint8_t* pixels,
              std::vector<std::vector<std::uint8_t>>& pieces) const override {
    pieces.resize(1);
    std::vector<std::uint8_t>& out = pieces[0];
    out.clear();
    each_pixel_run(pixels, pixel_count(), [&](std::uint8_t grey, std::size_t count) {
      const unsigned value = grey >> 4;
      const std::size_t most = is_long(value) ? kMostLong : kMostShort;
      for (; count > 0;) {
        const std::size_t run = std::min(count, most);
        if (is_long(value)) {
          out.push_back(static_cast<std::uint8_t>(value << 4 | run >> 8));
          out.push_back(static_cast<std::uint8_t>(run));
        } else {
          out.push_back(static_cast<std::uint8_t>(value << 4 | run));
        }
        count -= run;
      }
    });
  }

 private:
  static bool is_long(unsigned value) { return value == 0 || value == 0xf; }
};

class LgsCode final : public LayerCodec {
 public:
  LgsCode(int width_px, int height_px) : LayerCodec(width_px, height_px, grey_in_steps(16)) {}

  std::size_t decode(std::span<const std::vector<std::uint8_t>> pieces, std::uint8_t* pixels,
                     const LayerName& name) const override {
    PixelFill fill(pixels, pixel_count(), name);
    const std::vector<std::uint8_t>& code = pieces[0];
    for (std::size_t i = 0; i < code.size();) {
      const unsigned value = code[i] >> 4;
      std::size_t count = 0;
      for (; i < code.size() && code[i] >> 4 == value; ++i) {
        if (count > pixel_count()) name.fail("runs of pixels go beyond the image");
        count = count << 4 | (code[i] & 0x0f);
      }
      if (count == 0) name.fail("a run has no pixels");
      fill.put(static_cast<std::uint8_t>(value * 17), count);
    }
    return fill.finish(width_px_);
  }

  void encode(int, const std::uint8_t* pixels,
              std::vector<std::vector<std::uint8_t>>& pieces) const override {
    pieces.resize(1);
    std::vector<std::uint8_t>& out = pieces[0];
    out.clear();
    each_pixel_run(pixels, pixel_count(), [&](std::uint8_t grey, std::size_t count) {
      int digits = 1;
      while (count >> (4 * digits) != 0) ++digits;
      for (int d = digits - 1; d >= 0; --d) {
        out.push_back(static_cast<std::uint8_t>((grey & 0xf0) | (count >> (4 * d) & 0x0f)));
      }
    });
  }
};

}  // namespace

LayerCodecPtr pw0_code(int width_px, int height_px, bool two_levels) {
  return std::make_shared<Pw0Code>(width_px, height_px, two_levels);
}
LayerCodecPtr lgs_code(int width_px, int height_px) {
  return std::make_shared<LgsCode>(width_px, height_px);
}

}  // namespace slicecorr::detail
