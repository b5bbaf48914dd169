// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Slices in memory, whole images.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "slicecorr/target.hpp"

namespace slicecorr::test {

class MemorySlices final : public SliceSource {
 public:
  explicit MemorySlices(const Grid& grid)
      : grid_(grid), pixels_(static_cast<std::size_t>(grid.layers) * area()) {}
  /// All slices of another source.
  explicit MemorySlices(const SliceSource& source) : MemorySlices(source.grid()) {
    frame_ = source.frame();
    source.read_band({0, 0, grid_.width_px, grid_.height_px}, [&](int n, const std::uint8_t* rows) {
      if (rows) std::copy_n(rows, area(), &at(n, 0, 0));
    });
  }
  MemorySlices(const MemorySlices&) = default;
  MemorySlices& operator=(const MemorySlices&) = default;

  std::uint8_t& at(int slice, int x, int y) {
    return pixels_[static_cast<std::size_t>(slice) * area() +
                   static_cast<std::size_t>(y * grid_.width_px + x)];
  }
  std::uint8_t at(int slice, int x, int y) const {
    return const_cast<MemorySlices*>(this)->at(slice, x, y);
  }
  void set_frame(const ImageFrame& frame) { frame_ = frame; }
  bool operator==(const MemorySlices& o) const {
    return grid_.width_px == o.grid_.width_px && grid_.height_px == o.grid_.height_px &&
           grid_.layers == o.grid_.layers && pixels_ == o.pixels_;
  }

  const Grid& grid() const override { return grid_; }
  PixelBox bounds() const override {
    PixelBox box;
    for (int n = 0; n < grid_.layers; ++n) {
      for (int y = 0; y < grid_.height_px; ++y) {
        for (int x = 0; x < grid_.width_px; ++x) {
          if (at(n, x, y)) box = box.united({x, y, x + 1, y + 1});
        }
      }
    }
    return box;
  }
  ImageFrame frame() const override { return frame_; }
  void read_band(const PixelBox& band, const Sink& sink) const override {
    std::vector<std::uint8_t> rows;
    for (int n = 0; n < grid_.layers; ++n) {
      rows.clear();
      for (int y = band.y0; y < band.y1; ++y) {
        for (int x = band.x0; x < band.x1; ++x) rows.push_back(at(n, x, y));
      }
      const bool black = std::all_of(rows.begin(), rows.end(), [](auto v) { return v == 0; });
      sink(n, black ? nullptr : rows.data());
    }
  }

 private:
  std::size_t area() const {
    return static_cast<std::size_t>(grid_.width_px) * static_cast<std::size_t>(grid_.height_px);
  }
  Grid grid_;
  std::vector<std::uint8_t> pixels_;
  ImageFrame frame_;
};

}  // namespace slicecorr::test
