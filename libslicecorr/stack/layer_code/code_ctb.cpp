// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// CTB's code: a byte is a value of 7 bits, its top bit says that a length follows, which is of 7, 14, 21
// or 28 bits after as many ones and a zero, highest byte first.
#include "stack/layer_code/codes.hpp"

namespace slicecorr::detail {
namespace {

ShownGrey seven_bits() {
  ShownGrey shown;
  for (unsigned v = 0; v < 256; ++v) shown[v] = static_cast<std::uint8_t>(v < 2 ? 0 : v | 1);
  return shown;
}

class CtbCode final : public LayerCodec {
 public:
  CtbCode(int width_px, int height_px, std::uint32_t key)
      : LayerCodec(width_px, height_px, seven_bits()), key_(key) {}

  std::size_t decode(std::span<const std::vector<std::uint8_t>> pieces, std::uint8_t* pixels,
                     const LayerName& name) const override {
    std::vector<std::uint8_t> plain;
    const std::vector<std::uint8_t>* code = &pieces[0];
    if (key_ != 0) {
      plain = pieces[0];
      cipher(name.layer, plain);
      code = &plain;
    }
    PixelFill fill(pixels, pixel_count(), name);
    const std::uint8_t *in = code->data(), *const end = in + code->size();
    while (in < end) {
      const std::uint8_t head = *in++;
      const auto value = static_cast<std::uint8_t>(head & 0x7f);
      const auto grey = static_cast<std::uint8_t>(value == 0 ? 0 : value << 1 | 1);
      std::size_t count = 1;
      if (head & 0x80) {
        if (in == end) name.fail("its code is cut off");
        const std::uint8_t first = *in++;
        const int more = first < 0x80   ? 0
                         : first < 0xc0 ? 1
                         : first < 0xe0 ? 2
                         : first < 0xf0 ? 3
                                        : -1;
        if (more < 0) name.fail("a run has a length that its code does not know (byte F0 or more)");
        if (end - in < more) name.fail("its code is cut off");
        constexpr std::uint8_t mask[] = {0x7f, 0x3f, 0x1f, 0x0f};
        count = first & mask[more];
        for (int i = 0; i < more; ++i) count = count << 8 | *in++;
        if (count == 0) name.fail("a run has no pixels");
      }
      fill.put(grey, count);
    }
    return fill.finish(width_px_);
  }

  void encode(int layer, const std::uint8_t* pixels,
              std::vector<std::vector<std::uint8_t>>& pieces) const override {
    pieces.resize(1);
    std::vector<std::uint8_t>& out = pieces[0];
    out.clear();
    each_pixel_run(pixels, pixel_count(), [&](std::uint8_t grey, std::size_t count) {
      const auto value = static_cast<std::uint8_t>(grey >> 1);
      for (; count > kMostIn28Bits; count -= kMostIn28Bits) put(value, kMostIn28Bits, out);
      put(value, count, out);
    });
    if (key_ != 0) cipher(layer, out);
  }

 private:
  static void put(std::uint8_t value, std::size_t count, std::vector<std::uint8_t>& out) {
    if (count == 1) return out.push_back(value);
    out.push_back(value | 0x80);
    const int more = count < 0x80 ? 0 : count < 0x4000 ? 1 : count < 0x200000 ? 2 : 3;
    constexpr std::uint8_t ones[] = {0, 0x80, 0xc0, 0xe0};
    out.push_back(static_cast<std::uint8_t>(ones[more] | count >> (8 * more)));
    for (int i = more - 1; i >= 0; --i) out.push_back(static_cast<std::uint8_t>(count >> (8 * i)));
  }
  void cipher(int layer, std::vector<std::uint8_t>& bytes) const {
    const std::uint32_t step = key_ * 0x2d83cdacu + 0xd8a83423u;
    const std::uint32_t start =
        (static_cast<std::uint32_t>(layer) * 0x1e1530cdu + 0xec3d47cdu) * step;
    apply_word_cipher(start, step, bytes);
  }

  std::uint32_t key_;
};

}  // namespace

LayerCodecPtr ctb_code(int width_px, int height_px, std::uint32_t key) {
  return std::make_shared<CtbCode>(width_px, height_px, key);
}

}  // namespace slicecorr::detail
