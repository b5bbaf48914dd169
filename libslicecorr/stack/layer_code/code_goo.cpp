// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// GOO's code: 55h, runs, and the complement of the sum of the runs' bytes. A run's first byte has its
// kind in the top two bits, the number of further length bytes in the next two and the lowest four bits
// of the length in the others.
#include "stack/layer_code/codes.hpp"

namespace slicecorr::detail {
namespace {

constexpr std::uint8_t kStart = 0x55;
enum Kind { black = 0, grey = 1, difference = 2, white = 3 };

class GooCode final : public LayerCodec {
 public:
  GooCode(int width_px, int height_px, bool sixteen_levels)
      : LayerCodec(width_px, height_px, sixteen_levels ? grey_in_steps(16) : all_grey()),
        sixteen_(sixteen_levels) {}

  std::size_t decode(std::span<const std::vector<std::uint8_t>> pieces, std::uint8_t* pixels,
                     const LayerName& name) const override {
    const std::vector<std::uint8_t>& code = pieces[0];
    if (code.size() < 2 || code.front() != kStart) name.fail("does not start with the byte 55h");
    const std::uint8_t *in = code.data() + 1, *const end = code.data() + code.size() - 1;
    std::uint8_t sum = 0;
    for (const std::uint8_t* p = in; p < end; ++p) sum = static_cast<std::uint8_t>(sum + *p);
    if (static_cast<std::uint8_t>(~sum) != *end) name.fail("its check byte is wrong");
    PixelFill fill(pixels, pixel_count(), name);
    const auto next = [&]() -> std::size_t {
      if (in == end) name.fail("its code is cut off");
      return *in++;
    };
    std::uint8_t value = 0;
    while (in < end) {
      const std::uint8_t head = *in++;
      std::size_t count = 1;
      switch (head >> 6) {
        case black:
          value = 0;
          break;
        case white:
          value = full();
          break;
        case grey:
          value = static_cast<std::uint8_t>(next());
          break;
        default: {
          const auto change = static_cast<std::uint8_t>(head & 0x0f);
          value = static_cast<std::uint8_t>(head & 0x20 ? value - change : value + change);
          if (head & 0x10) count = next();
        }
      }
      if (head >> 6 != difference) {
        std::size_t high = 0;
        for (int more = head >> 4 & 3; more > 0; --more) high = high << 8 | next();
        count = high << 4 | (head & 0x0f);
      }
      if (count == 0) name.fail("a run has no pixels");
      if (value > full()) name.fail("a grey value is above 15, which is the file's brightest");
      fill.put(sixteen_ ? static_cast<std::uint8_t>(value * 17) : value, count);
    }
    return fill.finish(width_px_);
  }

  void encode(int, const std::uint8_t* pixels,
              std::vector<std::vector<std::uint8_t>>& pieces) const override {
    pieces.resize(1);
    std::vector<std::uint8_t>& out = pieces[0];
    out.assign(1, kStart);
    each_pixel_run(pixels, pixel_count(), [&](std::uint8_t v, std::size_t count) {
      const auto value = static_cast<std::uint8_t>(sixteen_ ? v / 17 : v);
      for (; count > kMostIn28Bits; count -= kMostIn28Bits) put(value, kMostIn28Bits, out);
      put(value, count, out);
    });
    std::uint8_t sum = 0;
    for (std::size_t i = 1; i < out.size(); ++i) sum = static_cast<std::uint8_t>(sum + out[i]);
    out.push_back(static_cast<std::uint8_t>(~sum));
  }

 private:
  std::uint8_t full() const { return sixteen_ ? 15 : 255; }
  /// Never a difference: some printers stop at them.
  void put(std::uint8_t value, std::size_t count, std::vector<std::uint8_t>& out) const {
    const std::size_t high = count >> 4;
    const int more = high == 0 ? 0 : high < 0x100 ? 1 : high < 0x10000 ? 2 : 3;
    const Kind kind = value == 0 ? black : value == full() ? white : grey;
    out.push_back(static_cast<std::uint8_t>(kind << 6 | more << 4 | (count & 0x0f)));
    if (kind == grey) out.push_back(value);
    for (int i = more - 1; i >= 0; --i) out.push_back(static_cast<std::uint8_t>(high >> (8 * i)));
  }

  bool sixteen_;
};

}  // namespace

LayerCodecPtr goo_code(int width_px, int height_px, bool sixteen_levels) {
  return std::make_shared<GooCode>(width_px, height_px, sixteen_levels);
}

}  // namespace slicecorr::detail
