// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/png/preview.hpp"

#include <algorithm>
#include <cstdint>

namespace slicecorr::detail {

GreyImage shrink(const GreyImage& image, int most_px) {
  const int longest = std::max(image.width_px, image.height_px);
  if (longest <= most_px) return image;
  const auto scaled = [&](int px) {
    return std::max(1, static_cast<int>(std::int64_t{px} * most_px / longest));
  };
  GreyImage small{scaled(image.width_px), scaled(image.height_px), {}};
  const auto edge = [](int i, int count, int px) {
    return static_cast<std::size_t>(std::int64_t{i} * px / count);
  };
  for (int y = 0; y < small.height_px; ++y) {
    const std::size_t y0 = edge(y, small.height_px, image.height_px);
    const std::size_t y1 = edge(y + 1, small.height_px, image.height_px);
    for (int x = 0; x < small.width_px; ++x) {
      const std::size_t x0 = edge(x, small.width_px, image.width_px);
      const std::size_t x1 = edge(x + 1, small.width_px, image.width_px);
      std::uint64_t sum = 0;
      for (std::size_t row = y0; row < y1; ++row) {
        for (std::size_t column = x0; column < x1; ++column) {
          sum += image.pixels[row * static_cast<std::size_t>(image.width_px) + column];
        }
      }
      const std::uint64_t count = (y1 - y0) * (x1 - x0);
      small.pixels.push_back(static_cast<std::uint8_t>((sum + count / 2) / count));
    }
  }
  return small;
}

GreyImage framed(const GreyImage& image, int width_px, int height_px) {
  GreyImage out{width_px, height_px, {}};
  out.pixels.resize(static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px));
  if (image.pixels.empty()) return out;
  // The longest side that still fits both ways.
  const std::int64_t longest = std::max(image.width_px, image.height_px);
  const std::int64_t fits =
      std::min(longest * width_px / image.width_px, longest * height_px / image.height_px);
  GreyImage small = shrink(image, static_cast<int>(std::max<std::int64_t>(1, fits)));
  const int w = std::min(small.width_px, width_px), h = std::min(small.height_px, height_px);
  const int x0 = (width_px - w) / 2, y0 = (height_px - h) / 2;
  for (int y = 0; y < h; ++y) {
    std::copy_n(small.pixels.data() +
                    static_cast<std::size_t>(y) * static_cast<std::size_t>(small.width_px),
                w,
                out.pixels.data() +
                    static_cast<std::size_t>(y0 + y) * static_cast<std::size_t>(width_px) + x0);
  }
  return out;
}

}  // namespace slicecorr::detail
