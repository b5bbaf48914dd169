// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What raster.cpp (all rows) and raster_overlaps.cpp (pixels in which fragments overlap) share.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>

#include "slice/raster.hpp"

#define SLICECORR_INLINE inline __attribute__((always_inline))

namespace slicecorr::detail {

struct Raster::BandLayout {
  int x0, y0, y1;
  int width;
  std::size_t words;   ///< 64 marks each
  std::size_t stride;  ///< sums per row
};

/// A segment from its upper end to its lower one, whichever way the contour goes, so that
/// neighbours round alike. x is counted from the band's left side.
struct Raster::Line {
  double ux, uy, lx, ly;
  double slope, least, most;
  bool down;

  SLICECORR_INLINE Line(const Segment& s, const BandLayout& f) {
    down = s.ay < s.by;
    const double right = f.width;
    ux = std::min(std::max((down ? s.ax : s.bx) - f.x0, 0.0), right);
    lx = std::min(std::max((down ? s.bx : s.ax) - f.x0, 0.0), right);
    uy = down ? s.ay : s.by;
    ly = down ? s.by : s.ay;
    slope = (lx - ux) / (ly - uy);
    least = std::min(ux, lx);
    most = std::max(ux, lx);
  }
  SLICECORR_INLINE double x_at(double y) const {
    return std::min(std::max(ux + (y - uy) * slope, least), most);
  }
  SLICECORR_INLINE int first_row(const BandLayout& f) const {
    return uy > f.y0 ? static_cast<int>(uy) : f.y0;
  }
  SLICECORR_INLINE int last_row(const BandLayout& f) const {
    if (ly >= f.y1) return f.y1 - 1;
    const int row = static_cast<int>(ly);
    return row < ly ? row : row - 1;
  }
};

/// A row's height, or a whole pixel, in the units of the sums: windings up to 2^17 fit 64 bits, and
/// roundings stay below those of coordinates (a double of 2048 has 42 bits after the point).
constexpr int kOneBits = 46;
constexpr std::int64_t kOne = std::int64_t{1} << kOneBits;
constexpr double kOneReal = static_cast<double>(kOne);

SLICECORR_INLINE unsigned level_of(std::int64_t sum) {
  const std::int64_t covered = std::min(sum < 0 ? -sum : sum, kOne);
  return static_cast<unsigned>((covered * 255 + kOne / 2) >> kOneBits);
}

SLICECORR_INLINE int column_of(double x, int width) {
  return std::min(static_cast<int>(x), width - 1);
}

using Pair = double __attribute__((vector_size(16)));
using WholePair = std::int64_t __attribute__((vector_size(16)));

/// Added to a number up to 2^51, it leaves that number rounded to a whole one in the lowest bits.
constexpr double kShift = 0x1.8p52;

SLICECORR_INLINE double rounded(double v) { return (v + kShift) - kShift; }

SLICECORR_INLINE void add_to(PixelSums& sums, double cover, double area) {
  WholePair at;
  std::memcpy(&at, &sums, sizeof at);
  const Pair shift = {kShift, kShift}, moved = Pair{cover, area} + shift;
  at += reinterpret_cast<WholePair>(moved) - reinterpret_cast<WholePair>(shift);
  std::memcpy(&sums, &at, sizeof at);
}

SLICECORR_INLINE void add_to(PixelSums& sums, const PixelSums& more) {
  WholePair at, add;
  std::memcpy(&at, &sums, sizeof at);
  std::memcpy(&add, &more, sizeof add);
  at += add;
  std::memcpy(&sums, &at, sizeof at);
}

SLICECORR_INLINE void mark(std::uint64_t* marks, unsigned first, unsigned last) {
  const std::uint64_t from = ~std::uint64_t{0} << (first & 63);
  const std::uint64_t to = ~std::uint64_t{0} >> (~last & 63);
  if (first >> 6 == last >> 6) [[likely]] {
    marks[first >> 6] |= from & to;
    return;
  }
  marks[first >> 6] |= from;
  for (unsigned w = (first >> 6) + 1; w < last >> 6; ++w) marks[w] = ~std::uint64_t{0};
  marks[last >> 6] |= to;
}

/// Adds a fragment from xa to xb to the sums of its row, which go on for one pixel past the last,
/// and marks its pixels. `height` is a whole number, negative for fragments that go up; `per_pixel`
/// is the height per pixel of the way along x.
SLICECORR_INLINE void add_piece(PixelSums* sums, std::uint64_t* marks, double xa, double xb,
                                double height, double per_pixel, int width) {
  const double left = std::min(xa, xb), right = std::max(xa, xb);
  const int first = column_of(left, width), last = column_of(right, width);
  mark(marks, static_cast<unsigned>(first), static_cast<unsigned>(last));
  const double side = first + 1;
  if (last <= first + 1) [[likely]] {
    const double cover = first == last ? height : rounded(per_pixel * (side - left));
    const double mean = first == last ? 0.5 * (left + right) : 0.5 * (left + side);
    add_to(sums[first], cover, cover * (side - mean));
    const double rest = height - cover;
    add_to(sums[first + 1], rest, rest * (1.0 - 0.5 * (right - side)));
    return;
  }
  double done = rounded(per_pixel * (side - left));
  add_to(sums[first], done, done * (0.5 * (side - left)));
  for (int p = first + 1; p < last; ++p) {
    const double until = rounded(per_pixel * (p + 1 - left));
    add_to(sums[p], until - done, 0.5 * (until - done));
    done = until;
  }
  const double rest = height - done;
  add_to(sums[last], rest, rest * (1.0 - 0.5 * (right - last)));
}

}  // namespace slicecorr::detail
