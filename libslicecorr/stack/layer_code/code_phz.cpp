// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The code of PHZ and FDG: a byte with its top bit set is a pixel of 7 bits, one without says how many
// more of it follow. The brightest value that slicers write is 7C; runs start anew at each row and its
// middle.
#include <algorithm>

#include "stack/layer_code/codes.hpp"

namespace slicecorr::detail {
namespace {

constexpr std::uint8_t kBrightest = 0x7c;
constexpr std::size_t kMostMore = 0x7d;

std::uint8_t grey_of(std::uint8_t value) {
  if (value >= kBrightest) return 255;
  return static_cast<std::uint8_t>(value << 1 | (value & 1));
}

ShownGrey phz_grey() {
  ShownGrey shown;
  for (unsigned v = 0; v < 256; ++v) shown[v] = grey_of(static_cast<std::uint8_t>(v >> 1));
  return shown;
}

class PhzCode final : public LayerCodec {
 public:
  PhzCode(int width_px, int height_px, std::uint32_t key, PhzCipher cipher)
      : LayerCodec(width_px, height_px, phz_grey()), key_(key), cipher_(cipher) {}

  std::size_t decode(std::span<const std::vector<std::uint8_t>> pieces, std::uint8_t* pixels,
                     const LayerName& name) const override {
    std::vector<std::uint8_t> code = pieces[0];
    apply_cipher(name.layer, code);
    PixelFill fill(pixels, pixel_count(), name);
    std::uint8_t value = 0;
    bool known = false;
    for (const std::uint8_t byte : code) {
      if (byte & 0x80) {
        value = grey_of(byte & 0x7f);
        known = true;
        fill.put(value, 1);
      } else {
        if (!known) name.fail("its code starts with a length");
        if (byte == 0) name.fail("a run has no pixels");
        fill.put(value, byte);
      }
    }
    return fill.finish(width_px_);
  }

  void encode(int layer, const std::uint8_t* pixels,
              std::vector<std::vector<std::uint8_t>>& pieces) const override {
    pieces.resize(1);
    std::vector<std::uint8_t>& out = pieces[0];
    out.clear();
    const auto width = static_cast<std::size_t>(width_px_), half = width / 2;
    const auto put = [&](std::uint8_t grey, std::size_t count) {
      out.push_back(
          static_cast<std::uint8_t>(0x80 | std::min(kBrightest, std::uint8_t(grey >> 1))));
      for (--count; count > 0; count -= std::min(count, kMostMore)) {
        out.push_back(static_cast<std::uint8_t>(std::min(count, kMostMore)));
      }
    };
    for (int y = 0; y < height_px_; ++y) {
      const std::uint8_t* const row = pixels + width * static_cast<std::size_t>(y);
      each_pixel_run(row, half, put);
      each_pixel_run(row + half, width - half, put);
    }
    apply_cipher(layer, out);
  }

 private:
  void apply_cipher(int layer, std::vector<std::uint8_t>& bytes) const {
    if (key_ == 0) return;
    const auto i = static_cast<std::uint32_t>(layer);
    if (cipher_ == PhzCipher::phz) {
      const std::uint32_t k = key_ % 0x4324u;
      apply_word_cipher((i ^ 0x3fad2212u) * k * 0x4910913du, k * 0x34a32231u, bytes);
    } else {
      const std::uint32_t step = (key_ - 0x1dcb76c3u) ^ 0x257e2431u;
      apply_word_cipher(step * 0x82391efdu * (i ^ 0x110bdacdu), step, bytes);
    }
  }

  std::uint32_t key_;
  PhzCipher cipher_;
};

}  // namespace

LayerCodecPtr phz_code(int width_px, int height_px, std::uint32_t key, PhzCipher cipher) {
  return std::make_shared<PhzCode>(width_px, height_px, key, cipher);
}

}  // namespace slicecorr::detail
