// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/layer_code/layer_codec.hpp"

#include <cstring>
#include <set>

#include "slicecorr/error.hpp"

namespace slicecorr::detail {

ShownGrey all_grey() {
  ShownGrey shown;
  for (int v = 0; v < 256; ++v) shown[static_cast<std::size_t>(v)] = static_cast<std::uint8_t>(v);
  return shown;
}

ShownGrey grey_in_steps(int levels) {
  ShownGrey shown;
  for (int v = 0; v < 256; ++v) {
    const int level = (2 * v * (levels - 1) + 255) / 510;
    shown[static_cast<std::size_t>(v)] =
        static_cast<std::uint8_t>((2 * level * 255 + levels - 1) / (2 * (levels - 1)));
  }
  return shown;
}

int levels_of(const ShownGrey& shown) {
  return static_cast<int>(std::set<std::uint8_t>(shown.begin(), shown.end()).size());
}

void LayerName::fail(const std::string& what) const {
  throw InputError(file, "layer " + std::to_string(layer), what);
}

void PixelFill::put(std::uint8_t value, std::size_t count) {
  if (count > room()) {
    name_.fail("runs of pixels go beyond the image's " + std::to_string(count_) + " pixels");
  }
  std::memset(pixels_ + at_, value, count);
  at_ += count;
}

std::size_t PixelFill::finish(int width_px) {
  const std::size_t lacking = room();
  if (lacking > static_cast<std::size_t>(width_px)) {
    name_.fail("its code ends after " + std::to_string(at_) + " pixels, expected " +
               std::to_string(count_));
  }
  std::memset(pixels_ + at_, 0, lacking);
  at_ = count_;
  return lacking;
}

void apply_word_cipher(std::uint32_t start, std::uint32_t step, std::vector<std::uint8_t>& bytes) {
  std::uint32_t x = start;
  std::size_t i = 0;
  for (; i + 4 <= bytes.size(); i += 4, x += step) {
    std::uint32_t word;
    std::memcpy(&word, bytes.data() + i, 4);
    word ^= x;
    std::memcpy(bytes.data() + i, &word, 4);
  }
  for (int shift = 0; i < bytes.size(); ++i, shift += 8) {
    bytes[i] ^= static_cast<std::uint8_t>(x >> shift);
  }
}

}  // namespace slicecorr::detail
