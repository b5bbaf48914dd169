// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/even_greys.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <mutex>
#include <vector>

#include "slicecorr/target.hpp"

namespace slicecorr {

namespace {

/// 0 for black and white.
std::uint8_t grey(std::uint8_t p) { return static_cast<std::uint8_t>((p + 1) & 0xFE); }

struct BandCounts {
  std::uint64_t even = 0, lit = 0;
};

/// One slice of a band, `width` pixels in each of `rows`.
BandCounts count(const std::uint8_t* pixels, std::size_t width, std::size_t rows) {
  BandCounts counts;
  std::uint8_t any = 0;
  for (std::size_t i = 0; i < width * rows; ++i) {
    any |= grey(pixels[i]);
    counts.lit += pixels[i] != 0;
  }
  if (any == 0) return counts;
  for (std::size_t y = 1; y + 1 < rows; ++y) {
    const std::uint8_t* const row = pixels + y * width;
    const auto alike = [&](const std::uint8_t* three, std::uint8_t p) {
      return three[-1] == p && three[0] == p && three[1] == p;
    };
    for (std::size_t x = 1; x + 1 < width; ++x) {
      const std::uint8_t p = row[x];
      if (grey(p) == 0) continue;
      counts.even +=
          alike(row + x, p) && alike(row + x - width, p) && alike(row + x + width, p) ? 1 : 0;
    }
  }
  return counts;
}

constexpr std::uint64_t kLeastPixels = 100, kLeastShare = 2000;

}  // namespace

bool EvenGreys::look_corrected() const {
  return pixels >= kLeastPixels && pixels >= lit_pixels / kLeastShare;
}

std::string EvenGreys::in_words() const {
  if (!look_corrected()) return {};
  return fmt::format(
      "these slices look as if they were corrected already: {} pixels in {} of them, from slice {} on, lie in areas "
      "of one grey, where slicers have greys at outlines alone; corrected twice a part loses what it needs, and "
      "the figures, which take these slices for the design, do not show it. Take the slicer's own file, unless it is "
      "this one",
      pixels, layers, first);
}

EvenGreys even_greys(const SliceSource& slices, const ExecutionContext& context) {
  const Grid& grid = slices.grid();
  EvenGreys all;
  const PixelBox box = slices.bounds();
  if (box.empty()) return all;
  const int rows = band_rows(grid), first = box.y0 / rows;
  std::vector<std::uint64_t> even(static_cast<std::size_t>(grid.layers));
  std::mutex adding;
  parallel_for(
      context, "greys", static_cast<std::size_t>((box.y1 - 1) / rows - first + 1),
      [&](std::size_t i) {
        const int y0 = (first + static_cast<int>(i)) * rows;
        const PixelBox band{box.x0, std::max(y0, box.y0), box.x1, std::min(y0 + rows, box.y1)};
        std::vector<BandCounts> counts(even.size());
        slices.read_band(band, [&](int n, const std::uint8_t* pixels) {
          if (pixels == nullptr) return;
          counts[static_cast<std::size_t>(n)] =
              count(pixels, static_cast<std::size_t>(band.width()),
                    static_cast<std::size_t>(band.height()));
        });
        const std::lock_guard lock(adding);
        for (std::size_t n = 0; n < counts.size(); ++n) {
          even[n] += counts[n].even;
          all.lit_pixels += counts[n].lit;
        }
      });
  for (std::size_t n = 0; n < even.size(); ++n) {
    if (even[n] == 0) continue;
    all.pixels += even[n];
    ++all.layers;
    if (all.first < 0) all.first = static_cast<int>(n);
  }
  return all;
}

void tell_even_greys(const SliceSource& slices, StackKind kind, const ExecutionContext& context) {
  if (kind != StackKind::foreign || !context.notice) return;
  const std::string words = even_greys(slices, context).in_words();
  if (!words.empty()) context.tell(words);
}

}  // namespace slicecorr
