// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Rows from segments: sums of areas, and the pixel-centre rule.
#include "slice/raster.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include "base/kernels.hpp"
#include "slice/raster_parts.hpp"

namespace slicecorr::detail {

namespace {

using Reals = double __attribute__((vector_size(32)));
/// Unsigned: for a fragment over many pixels the second sum may overflow. It is not used then, and
/// wrapping is allowed only without a sign.
using Wholes = std::uint64_t __attribute__((vector_size(32)));
using Ints = std::int32_t __attribute__((vector_size(16)));
constexpr int kLanes = 4;

/// Writes 32 pixels: 255 for every bit that is set, else 0.
SLICECORR_INLINE void spread_half(std::uint32_t bits, std::uint8_t* pixels) {
  // Vectors of 32 bytes: wider ones are taken apart into single bytes where there is no AVX-512.
  using Bits = std::uint32_t __attribute__((vector_size(32)));
  using Words = std::uint64_t __attribute__((vector_size(32)));
  using Bytes = std::uint8_t __attribute__((vector_size(32)));
  const Bytes own = reinterpret_cast<Bytes>(Words{} + 0x8040201008040201u);
  const Bytes all = reinterpret_cast<Bytes>(Bits{} + bits);
  // For each pixel the byte that holds its bit. Shuffles work within 16 bytes, each of which
  // repeats the same four bytes.
  const Bytes of_pixel =
      __builtin_shufflevector(all, all, 0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1,  //
                              18, 18, 18, 18, 18, 18, 18, 18, 19, 19, 19, 19, 19, 19, 19, 19);
  const auto lit = (of_pixel & own) == own;
  std::memcpy(pixels, &lit, 32);
}

/// The same of 64 pixels, or the first `count` of them.
SLICECORR_INLINE void spread(std::uint64_t bits, std::uint8_t* pixels, std::size_t count) {
  const auto low = static_cast<std::uint32_t>(bits), high = static_cast<std::uint32_t>(bits >> 32);
  if (count >= 64) [[likely]] {
    spread_half(low, pixels);
    spread_half(high, pixels + 32);
    return;
  }
  alignas(32) std::uint8_t all[64];
  spread_half(low, all);
  spread_half(high, all + 32);
  std::memcpy(pixels, all, count);
}

/// Four segments as lines.
struct Lines {
  double ux[kLanes], uy[kLanes], lx[kLanes], ly[kLanes];
  double slope[kLanes], least[kLanes], most[kLanes];
  double one[kLanes];               ///< height of a row, negative where the contour goes up
  double per_pixel[kLanes];         ///< height per pixel along x
  int first[kLanes], last[kLanes];  ///< rows; none where first is beyond last

  SLICECORR_INLINE Lines(const Segment* segments, std::size_t count, double x0, double y0,
                         double y1, double width) {
    Reals ax{}, ay{}, bx{}, by{};
    for (int k = 0; k < kLanes && static_cast<std::size_t>(k) < count; ++k) {
      ax[k] = segments[k].ax, ay[k] = segments[k].ay;
      bx[k] = segments[k].bx, by[k] = segments[k].by;
    }
    const auto down = ay < by;
    const Reals right = Reals{} + width;
    Reals upper_x = (down ? ax : bx) - x0, lower_x = (down ? bx : ax) - x0;
    const Reals upper_y = down ? ay : by, lower_y = down ? by : ay;
    upper_x = upper_x > 0 ? upper_x : Reals{};
    lower_x = lower_x > 0 ? lower_x : Reals{};
    upper_x = upper_x < right ? upper_x : right;
    lower_x = lower_x < right ? lower_x : right;
    const Reals slopes = (lower_x - upper_x) / (lower_y - upper_y);
    const Reals left = upper_x < lower_x ? upper_x : lower_x;
    const Reals rest = upper_x < lower_x ? lower_x : upper_x;
    const Reals ones = down ? Reals{} + kOneReal : Reals{} - kOneReal;
    const Reals per_pixels = ones * ((lower_y - upper_y) / (rest - left));
    // Clamped before they become whole numbers, so that no row is below y0.
    Reals top = upper_y > y0 ? upper_y : Reals{} + y0;
    Reals bottom = lower_y < y1 ? lower_y : Reals{} + y1;
    top = top < y1 ? top : Reals{} + y1;
    bottom = bottom > y0 ? bottom : Reals{} + y0;
    const Ints first_row = __builtin_convertvector(top, Ints);
    Ints last_row = __builtin_convertvector(bottom, Ints);
    last_row += __builtin_convertvector(__builtin_convertvector(last_row, Reals) >= bottom, Ints);
    std::memcpy(ux, &upper_x, sizeof ux);
    std::memcpy(uy, &upper_y, sizeof uy);
    std::memcpy(lx, &lower_x, sizeof lx);
    std::memcpy(ly, &lower_y, sizeof ly);
    std::memcpy(slope, &slopes, sizeof slope);
    std::memcpy(least, &left, sizeof least);
    std::memcpy(most, &rest, sizeof most);
    std::memcpy(one, &ones, sizeof one);
    std::memcpy(per_pixel, &per_pixels, sizeof per_pixel);
    std::memcpy(first, &first_row, sizeof first);
    std::memcpy(last, &last_row, sizeof last);
  }
};

}  // namespace

Raster::Raster(int x0, int y0, int x1, int y1, bool antialias)
    : x0_(x0),
      y0_(y0),
      x1_(x1),
      y1_(y1),
      antialias_(antialias),
      width_(static_cast<std::size_t>(x1 - x0)),
      words_((width_ + 64) / 64) {
  const auto rows = static_cast<std::size_t>(y1 - y0);
  pixels_.resize(rows * width_);
  touched_.resize(rows + kLanes);
  drawn_.resize(rows);
  marks_.resize(rows * words_ * (antialias ? 2 : 1));
  if (antialias) {
    sums_.resize(rows * (width_ + 1));
    gaps_.resize(words_);
    span_of_.resize((rows + 1) * width_);
    span_row_.resize(rows + kLanes);
    spans_near_.resize(rows);
    columns_.resize(64 * words_ + 8);
    levels_.resize(columns_.size());
    areas_.resize(columns_.size());
    begins_.resize(columns_.size());
  } else {
    steps_.resize(rows * (width_ + 1));
  }
}

const std::uint8_t* Raster::draw(std::span<const Segment> segments,
                                 std::span<const SolidRule::Tag> tags, const SolidRule& rule) {
  segments_ = segments;
  tags_ = tags;
  rule_ = &rule;
  if (!find_ruled_rows()) {
    tags_ = {};
    ruled_.clear();
  }
  const std::uint8_t* const pixels = draw(segments);
  tags_ = {};
  ruled_.clear();
  return pixels;
}

const std::uint8_t* Raster::draw(std::span<const Segment> segments) {
  const BandLayout f = {x0_, y0_, y1_, x1_ - x0_, words_, width_ + 1};
  segments_ = segments;
  crossing_count_ = 0;
  overlap_spans_.clear();
  if (antialias_) {
    add_areas(f);
  } else {
    add_centres(f);
    if (!ruled_.empty()) add_ruled_centres(f);
  }
  bool lit = false;
  for (int r = 0; r < y1_ - y0_; ++r) {
    const auto row = static_cast<std::size_t>(r);
    if (!ruled_.empty() && ruled_[row]) {
      std::memset(pixels_.data() + row * width_, 0, width_);
      if (antialias_) find_ruled_spans(r, f);
      touched_[row] = 0;
      drawn_[row] = 1;
    } else if (touched_[row]) {
      lit |= antialias_ ? draw_area_row(r, f) : draw_centre_row(r, f);
      touched_[row] = 0;
      drawn_[row] = 1;
    } else if (drawn_[row]) {
      std::memset(pixels_.data() + row * width_, 0, width_);
      drawn_[row] = 0;
    }
  }
  if (!overlap_spans_.empty()) lit |= draw_overlap_spans(f) != 0;
  if (!centre_steps_.empty()) lit |= draw_ruled_centres();
  return lit ? pixels_.data() : nullptr;
}

/// Rows of a segment are worked on four at a time.
SLICECORR_CLONES
void Raster::add_areas(const BandLayout& f) {
  const Reals shift = Reals{} + kShift, lane = {0, 1, 2, 3};
  const Ints last_column = Ints{} + (f.width - 1);
  if (crossings_.size() < segments_.size()) crossings_.resize(2 * segments_.size());
  for (std::uint32_t group = 0; group < segments_.size(); group += kLanes) {
    const Lines lines(segments_.data() + group, segments_.size() - group, f.x0, f.y0, f.y1,
                      f.width);
    for (std::uint32_t k = 0; k < kLanes && group + k < segments_.size(); ++k) {
      const std::uint32_t segment = group + k;
      if (lines.uy[k] == lines.ly[k]) [[unlikely]] {
        add_horizontal(segments_[segment], f);
        continue;
      }
      struct {
        double ux, uy, lx, ly, slope, least, most;
      } const line = {lines.ux[k],    lines.uy[k],    lines.lx[k],  lines.ly[k],
                      lines.slope[k], lines.least[k], lines.most[k]};
      const double one = lines.one[k], per_pixel = lines.per_pixel[k];
      const int last = lines.last[k];
      for (int base = lines.first[k]; base <= last; base += kLanes) {
        const int count = std::min(kLanes, last - base + 1);
        const Reals top = lane + base, bottom = top + 1.0;
        const auto begins = top <= line.uy, ends = bottom >= line.ly;
        Reals upper_x = line.ux + (top - line.uy) * line.slope;
        Reals lower_x = line.ux + (bottom - line.uy) * line.slope;
        upper_x = upper_x > line.least ? upper_x : Reals{} + line.least;
        lower_x = lower_x > line.least ? lower_x : Reals{} + line.least;
        upper_x = upper_x < line.most ? upper_x : Reals{} + line.most;
        lower_x = lower_x < line.most ? lower_x : Reals{} + line.most;
        upper_x = begins ? Reals{} + line.ux : upper_x;
        lower_x = ends ? Reals{} + line.lx : lower_x;
        const Reals upper_y = begins ? line.uy - top : Reals{};
        const Reals lower_y = ends ? line.ly - top : Reals{} + 1.0;
        const Reals height = (lower_y * one + shift) - (upper_y * one + shift);
        const Reals left = upper_x < lower_x ? upper_x : lower_x;
        const Reals right = upper_x < lower_x ? lower_x : upper_x;
        Ints first_i = __builtin_convertvector(left, Ints);
        Ints last_i = __builtin_convertvector(right, Ints);
        first_i = first_i < last_column ? first_i : last_column;
        last_i = last_i < last_column ? last_i : last_column;
        const Reals column = __builtin_convertvector(first_i, Reals);
        const Reals side = column + 1.0, nearer = right < side ? right : side;
        // Cover of the first pixel and, where the fragment reaches it, of the second.
        Reals cover = (per_pixel * (nearer - left) + shift) - shift;
        cover = column == __builtin_convertvector(last_i, Reals) ? height : cover;
        const Reals area = cover * (side - 0.5 * (left + nearer));
        const Reals rest = height - cover;
        const Reals rest_area = rest * (1.0 - 0.5 * (right - side));
        const Wholes zero = reinterpret_cast<Wholes>(shift);
        const Wholes covers = reinterpret_cast<Wholes>(cover + shift) - zero;
        const Wholes areas = reinterpret_cast<Wholes>(area + shift) - zero;
        const Wholes rests = reinterpret_cast<Wholes>(rest + shift) - zero;
        const Wholes rest_areas = reinterpret_cast<Wholes>(rest_area + shift) - zero;
        alignas(64) PixelSums first_sums[kLanes], second_sums[kLanes];
        const Wholes parts[4] = {__builtin_shufflevector(covers, areas, 0, 4, 1, 5),
                                 __builtin_shufflevector(covers, areas, 2, 6, 3, 7),
                                 __builtin_shufflevector(rests, rest_areas, 0, 4, 1, 5),
                                 __builtin_shufflevector(rests, rest_areas, 2, 6, 3, 7)};
        std::memcpy(first_sums, parts, sizeof first_sums);
        std::memcpy(second_sums, parts + 2, sizeof second_sums);

        if (crossing_count_ == crossings_.size()) crossings_.resize(2 * crossings_.size());
        Crossings& crossings = crossings_[crossing_count_++];
        const auto at = static_cast<std::size_t>(base - f.y0);
        crossings.row = static_cast<std::uint32_t>(at);
        crossings.count = count;
        crossings.segment = segment;
        std::memcpy(crossings.columns, &first_i, sizeof first_i);
        alignas(32) int last_columns[kLanes];
        std::memcpy(last_columns, &last_i, sizeof last_i);
        PixelSums* sums = sums_.data() + at * f.stride;
        std::uint64_t* marks = marks_.data() + (2 * at + (one < 0)) * f.words;
        for (int i = 0; i < count; ++i) {
          const int c = crossings.columns[i];
          if (last_columns[i] > c + 1) [[unlikely]] {
            add_piece(sums, marks, upper_x[i], lower_x[i], height[i], per_pixel, f.width);
          } else {
            mark(marks, static_cast<unsigned>(c), static_cast<unsigned>(last_columns[i]));
            add_to(sums[c], first_sums[i]);
            add_to(sums[c + 1], second_sums[i]);
          }
          touched_[at + static_cast<std::size_t>(i)] = 1;
          sums += f.stride;
          marks += 2 * f.words;
        }
      }
    }
  }
}

/// A horizontal segment changes no winding, but its pixels are partly covered and can't be filled
/// by one winding. Marked as crossed both ways, they are looked at closely.
void Raster::add_horizontal(const Segment& s, const BandLayout& f) {
  if (!(s.ay > f.y0) || !(s.ay < f.y1)) return;
  const int row = static_cast<int>(s.ay);
  if (row == s.ay) return;
  const double right = f.width;
  const double a = std::clamp(s.ax - f.x0, 0.0, right), b = std::clamp(s.bx - f.x0, 0.0, right);
  const int first = column_of(std::min(a, b), f.width), last = column_of(std::max(a, b), f.width);
  const auto at = static_cast<std::size_t>(row - f.y0);
  std::uint64_t* marks = marks_.data() + 2 * at * f.words;
  mark(marks, static_cast<unsigned>(first), static_cast<unsigned>(last));
  mark(marks + f.words, static_cast<unsigned>(first), static_cast<unsigned>(last));
  touched_[at] = 1;
}

/// Draws all pixels as if no fragments overlapped, and notes where they may overlap.
SLICECORR_CLONES
bool Raster::draw_area_row(int row, const BandLayout& f) {
  const auto at = static_cast<std::size_t>(row);
  std::uint8_t* const pixels = pixels_.data() + at * width_;
  PixelSums* const sums = sums_.data() + at * f.stride;
  std::uint64_t* const down = marks_.data() + 2 * at * f.words;
  std::uint64_t* const up = down + f.words;
  std::uint64_t* const gaps = gaps_.data();  // later: where pixels that are inside begin
  // List the marked pixels, and where pixels that are crossed in different directions meet.
  std::uint32_t* const columns = columns_.data();
  std::size_t count = 0;
  std::uint64_t down_before = 0, up_before = 0;
  doubts_.clear();
  for (std::size_t w = 0; w < f.words; ++w) {
    const std::uint64_t d = down[w], u = up[w];
    std::uint64_t mixed = (d & (u | u << 1 | up_before)) | (u & (d << 1 | down_before));
    down_before = d >> 63, up_before = u >> 63;
    gaps[w] = 0;
    const auto base = static_cast<std::uint32_t>(64 * w);
    while (mixed) [[unlikely]] {
        const std::uint64_t before = (mixed & (std::uint64_t{0} - mixed)) - 1;
        doubts_.push_back(static_cast<std::uint32_t>(count) +
                          static_cast<std::uint32_t>(std::popcount((d | u) & before)));
        mixed &= mixed - 1;
      }
    // Always four at once; where there are fewer, what is too much is overwritten later.
    std::uint64_t left = d | u;
    std::uint32_t* column = columns + count;
    count += static_cast<std::size_t>(std::popcount(left));
    do {
      for (int k = 0; k < 4; ++k) {
        column[k] = base + static_cast<std::uint32_t>(std::countr_zero(left));
        left &= left - 1;
      }
      column += 4;
    } while (left);
  }
  columns[count] = 0;  // ends the list
  const std::size_t mixed_count = doubts_.size();

  // Runs of marked pixels. No fragment leaves a run, so the winding is one number on either side.
  std::int64_t* const areas = areas_.data();
  std::int64_t* const begins = begins_.data();
  std::int64_t running = 0, begin = 0;
  std::uint32_t expected = 0;
  std::uint64_t lit = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint32_t p = columns[i];
    begin = p == expected ? begin : running;
    expected = p + 1;
    areas[i] = running + sums[p].area;
    running += sums[p].cover;
    sums[p] = {0, 0};
    begins[i] = begin;
    const bool ends = columns[i + 1] != expected;
    gaps[expected / 64] |= static_cast<std::uint64_t>(ends & (running != 0)) << (expected % 64);
    // Fragments of one direction that change the winding by one in all: just one at every height.
    const bool more = static_cast<std::uint64_t>(running - begin + kOne) > 2 * kOne;
    if (ends & more) [[unlikely]]
      doubts_.push_back(static_cast<std::uint32_t>(i));
  }

  std::uint8_t* const levels = levels_.data();
  unsigned any_level = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const unsigned level = level_of(areas[i]);
    levels[i] = static_cast<std::uint8_t>(level);
    any_level |= level;
  }
  lit |= any_level;

  std::uint64_t inside = 0;
  for (std::size_t w = 0; 64 * w < width_; ++w) {
    // The carry of an added one runs through all unmarked pixels up to the next marked one.
    const std::uint64_t free = ~(down[w] | up[w]), begins = gaps[w] | inside >> 63;
    inside = free & ~(free + (free & begins));
    const std::size_t pixels_left = width_ - 64 * w;
    if (pixels_left < 64) inside &= (std::uint64_t{1} << pixels_left) - 1;
    lit |= inside;
    spread(inside, pixels + 64 * w, pixels_left);
  }
  for (std::size_t i = 0; i < count; ++i) pixels[columns[i]] = levels[i];
  if (!doubts_.empty()) {
    if (mixed_count < doubts_.size()) std::sort(doubts_.begin(), doubts_.end());
    find_overlap_spans(row, count);
  }
  std::memset(down, 0, 2 * f.words * sizeof *down);
  return lit != 0;
}

SLICECORR_CLONES
void Raster::add_centres(const BandLayout& f) {
  const Reals lane = {0.5, 1.5, 2.5, 3.5};
  for (const Segment& s : segments_) {
    if (s.ay == s.by) continue;
    const Line line(s, f);
    // Rows whose centre line y satisfies uy <= y < ly: shared ends count once.
    const int first = line.uy > f.y0 ? static_cast<int>(std::ceil(line.uy - 0.5)) : f.y0;
    const int last = line.ly < f.y1 ? static_cast<int>(std::ceil(line.ly - 0.5)) - 1 : f.y1 - 1;
    const std::int32_t step = line.down ? 1 : -1;
    for (int base = first; base <= last; base += kLanes) {
      const int count = std::min(kLanes, last - base + 1);
      Reals x = line.ux + ((lane + base) - line.uy) * line.slope;
      x = x > line.least ? x : Reals{} + line.least;
      x = x < line.most ? x : Reals{} + line.most;
      // The first pixel whose centre is not left of the line; one past the last changes no winding.
      x -= 0.5;
      Ints column = __builtin_convertvector(x, Ints);
      column -= __builtin_convertvector(x > __builtin_convertvector(column, Reals), Ints);
      alignas(32) int columns[kLanes];
      std::memcpy(columns, &column, sizeof column);
      auto at = static_cast<std::size_t>(base - f.y0);
      for (int i = 0; i < count; ++i, ++at) {
        if (!ruled_.empty() && ruled_[at]) continue;
        const auto c = static_cast<std::size_t>(columns[i]);
        steps_[at * f.stride + c] += step;
        marks_[at * f.words + c / 64] |= std::uint64_t{1} << (c % 64);
        touched_[at] = 1;
      }
    }
  }
}

SLICECORR_CLONES
bool Raster::draw_centre_row(int row, const BandLayout& f) {
  const auto at = static_cast<std::size_t>(row);
  std::uint8_t* const pixels = pixels_.data() + at * width_;
  std::int32_t* const steps = steps_.data() + at * f.stride;
  std::uint64_t* const marks = marks_.data() + at * f.words;
  std::int32_t winding = 0;
  std::uint64_t lit = 0;
  for (std::size_t w = 0; 64 * w < width_; ++w) {
    std::uint64_t inside = winding != 0 ? ~std::uint64_t{0} : 0;
    for (std::uint64_t left = marks[w]; left; left &= left - 1) {
      const int bit = std::countr_zero(left);
      std::int32_t& step = steps[64 * w + static_cast<std::size_t>(bit)];
      const std::int32_t next = winding + step;
      const bool turns = (winding != 0) != (next != 0);
      inside ^= (std::uint64_t{0} - turns) << bit;
      winding = next;
      step = 0;
    }
    marks[w] = 0;
    const std::size_t count = width_ - 64 * w;
    if (count < 64) inside &= (std::uint64_t{1} << count) - 1;
    lit |= inside;
    spread(inside, pixels + 64 * w, count);
  }
  steps[width_] = 0;
  marks[width_ / 64] = 0;
  return lit != 0;
}

}  // namespace slicecorr::detail
