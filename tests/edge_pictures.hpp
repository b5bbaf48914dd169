// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Pictures of a straight edge as a camera takes them, with known spread.
#pragma once

#include <png.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <numbers>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

namespace slicecorr::test {

struct EdgePictureOptions {
  int width = 200, height = 160;
  double angle_deg = 3, sigma_px = 3;
  double low = 0.05, high = 0.8;  ///< shares of white
  double noise = 0;               ///< of white
  double off_px = 4.3;            ///< of the edge from the middle
  double bar_px = 0;              ///< dark again so far behind the edge; 0: not
  bool level = false;             ///< the edge lies level
  int bits = 16;
  int specks = 0;  ///< dark pixels
  unsigned seed = 1;
};

/// By libpng, with the filters that it chooses; `bytes` row by row, the higher one first.
inline void write_png(const std::string& path, int width, int height, int bits, int colour,
                      const std::vector<std::uint8_t>& bytes) {
  std::FILE* const file = std::fopen(path.c_str(), "wb");
  if (!file) throw std::runtime_error(path);
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png_create_info_struct(png);
  png_init_io(png, file);
  png_set_IHDR(png, info, static_cast<png_uint_32>(width), static_cast<png_uint_32>(height), bits,
               colour, PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  png_write_info(png, info);
  const std::size_t stride = bytes.size() / static_cast<std::size_t>(height);
  for (std::size_t y = 0; y < static_cast<std::size_t>(height); ++y) {
    png_write_row(png, bytes.data() + y * stride);
  }
  png_write_end(png, nullptr);
  png_destroy_write_struct(&png, &info);
  std::fclose(file);
}

/// Each pixel is the mean over its square, by the rule of Gauss and Legendre of four places a side.
inline void write_edge_picture(const std::string& path, const EdgePictureOptions& o) {
  const double angle = o.angle_deg * std::numbers::pi / 180;
  const auto share = [&](double t) {
    // Far from the edge the last level is the same.
    if (std::abs(t) > 6 * o.sigma_px + 1) return t > 0 ? 1.0 : 0.0;
    return 0.5 * std::erfc(-t / o.sigma_px / std::numbers::sqrt2);
  };
  constexpr double places[] = {-0.43056815579702629, -0.16999052179242813, 0.16999052179242813,
                               0.43056815579702629};
  constexpr double weights[] = {0.17392742256872693, 0.32607257743127307, 0.32607257743127307,
                                0.17392742256872693};
  std::mt19937 random(o.seed);
  std::normal_distribution<double> noise(0, 1);
  const int white = (1 << o.bits) - 1;
  std::vector<int> values(static_cast<std::size_t>(o.width) * static_cast<std::size_t>(o.height));
  for (int y = 0; y < o.height; ++y) {
    for (int x = 0; x < o.width; ++x) {
      double sum = 0;
      for (int i = 0; i < 16; ++i) {
        double u = x - 0.5 * (o.width - 1) + places[i % 4];
        double v = y - 0.5 * (o.height - 1) + places[i / 4];
        if (o.level) std::swap(u, v);
        const double t = (u - o.off_px) * std::cos(angle) + v * std::sin(angle);
        sum +=
            weights[i % 4] * weights[i / 4] * (share(t) - (o.bar_px > 0 ? share(t - o.bar_px) : 0));
      }
      double light = o.low + (o.high - o.low) * sum;
      if (o.noise > 0) light += o.noise * noise(random);
      values[static_cast<std::size_t>(y) * static_cast<std::size_t>(o.width) +
             static_cast<std::size_t>(x)] =
          std::clamp(static_cast<int>(std::lround(light * white)), 0, white);
    }
  }
  for (int k = 0; k < o.specks; ++k) values[random() % values.size()] = white;
  std::vector<std::uint8_t> bytes;
  for (const int v : values) {
    if (o.bits == 16) bytes.push_back(static_cast<std::uint8_t>(v >> 8));
    bytes.push_back(static_cast<std::uint8_t>(v & 255));
  }
  write_png(path, o.width, o.height, o.bits, PNG_COLOR_TYPE_GRAY, bytes);
}

}  // namespace slicecorr::test
