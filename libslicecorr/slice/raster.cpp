#include "slice/raster.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include "base/kernels.hpp"

#define SLICECORR_INLINE inline __attribute__((always_inline))

namespace slicecorr::detail {

struct Raster::Frame {
  int x0, y0, y1;
  int width;
  std::size_t words;   ///< 64 marks each
  std::size_t stride;  ///< sums per row
};

/// A segment from its upper end to its lower one, whichever way the contour goes: neighbours then
/// round alike. x is counted from the band's left side.
struct Raster::Line {
  double ux, uy, lx, ly;
  double slope, least, most;
  bool down;

  SLICECORR_INLINE Line(const Segment& s, const Frame& f) {
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
  SLICECORR_INLINE int first_row(const Frame& f) const {
    return uy > f.y0 ? static_cast<int>(uy) : f.y0;
  }
  SLICECORR_INLINE int last_row(const Frame& f) const {
    if (ly >= f.y1) return f.y1 - 1;
    const int row = static_cast<int>(ly);
    return row < ly ? row : row - 1;
  }
};

namespace {

/// A row's height, or a whole pixel, in the units of the sums: windings up to 2^17 fit 64 bits, and
/// roundings stay below those of coordinates (a double of 2048 has 42 bits after the point).
constexpr int kOneBits = 46;
constexpr std::int64_t kOne = std::int64_t{1} << kOneBits;
constexpr double kOneReal = static_cast<double>(kOne);
/// Up to here insertion sorts are quick enough.
constexpr std::ptrdiff_t kFew = 48;

SLICECORR_INLINE unsigned level_of(std::int64_t sum) {
  const std::int64_t covered = std::min(sum < 0 ? -sum : sum, kOne);
  return static_cast<unsigned>((covered * 255 + kOne / 2) >> kOneBits);
}

SLICECORR_INLINE int column_of(double x, int width) {
  return std::min(static_cast<int>(x), width - 1);
}

using Pair = double __attribute__((vector_size(16)));
using WholePair = std::int64_t __attribute__((vector_size(16)));

/// Whole numbers up to 2^51 added to this have them in their lowest bits, rounded.
constexpr double kShift = 0x1.8p52;

SLICECORR_INLINE double rounded(double v) { return (v + kShift) - kShift; }

SLICECORR_INLINE void add_to(PixelSums& sums, double cover, double area) {
  WholePair at;
  std::memcpy(&at, &sums, sizeof at);
  const Pair shift = {kShift, kShift}, moved = Pair{cover, area} + shift;
  at += std::bit_cast<WholePair>(moved) - std::bit_cast<WholePair>(shift);
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

/// Adds a piece from xa to xb to the sums of its row, which go on for one pixel past the last, and
/// marks its pixels. `height` is a whole number, negative for pieces that go up; `per_pixel` is the
/// height per pixel of the way along x. Tells the column of the left end.
SLICECORR_INLINE int add_piece(PixelSums* sums, std::uint64_t* marks, double xa, double xb,
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
    return first;
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
  return first;
}

/// Fills pixels from..to - 1 with `value`. Pixels after these, up to `end`, are written later.
SLICECORR_INLINE void fill(std::uint8_t* from, const std::uint8_t* to, const std::uint8_t* end,
                           std::uint8_t value) {
  constexpr std::ptrdiff_t kStep = 32;
  if (end - to < kStep) {
    std::memset(from, value, static_cast<std::size_t>(to - from));
    return;
  }
  std::uint8_t step[kStep];
  std::memset(step, value, kStep);
  for (; from < to; from += kStep) std::memcpy(from, step, kStep);
}

}  // namespace

Raster::Raster(int x0, int y0, int x1, int y1, bool antialias)
    : x0_(x0),
      y0_(y0),
      x1_(x1),
      y1_(y1),
      antialias_(antialias),
      width_(static_cast<std::size_t>(x1 - x0)),
      words_((width_ + 63) / 64) {
  const auto rows = static_cast<std::size_t>(y1 - y0);
  pixels_.resize(rows * width_);
  touched_.resize(rows);
  drawn_.resize(rows);
  marks_.resize(rows * words_ * (antialias ? 2 : 1));
  if (antialias) {
    sums_.resize(rows * (width_ + 1));
    row_counts_.resize(rows);
    row_ends_.resize(rows);
  } else {
    steps_.resize(rows * width_);
  }
}

const std::uint8_t* Raster::draw(std::span<const Segment> segments) {
  const Frame f = {x0_, y0_, y1_, x1_ - x0_, words_, width_ + 1};
  segments_ = segments;
  listed_ = false;
  crossing_count_ = 0;
  if (antialias_) {
    std::fill(row_counts_.begin(), row_counts_.end(), 0);
    add_areas(f);
  } else {
    add_centres(f);
  }
  bool lit = false;
  for (int r = 0; r < y1_ - y0_; ++r) {
    const auto row = static_cast<std::size_t>(r);
    if (touched_[row] || (antialias_ && row_counts_[row])) {
      lit |= antialias_ ? draw_area_row(r, f) : draw_centre_row(r, f);
      touched_[row] = 0;
      drawn_[row] = 1;
    } else if (drawn_[row]) {
      std::memset(pixels_.data() + row * width_, 0, width_);
      drawn_[row] = 0;
    }
  }
  return lit ? pixels_.data() : nullptr;
}

SLICECORR_CLONES
void Raster::add_areas(const Frame& f) {
  for (std::uint32_t segment = 0; segment < segments_.size(); ++segment) {
    const Segment& s = segments_[segment];
    if (s.ay == s.by) {
      add_horizontal(s, f);
      continue;
    }
    const Line line(s, f);
    if (line.ly <= f.y0 || line.uy >= f.y1) continue;
    const double one = line.down ? kOneReal : -kOneReal;
    const double per_pixel = one * ((line.ly - line.uy) / (line.most - line.least));
    const int last = line.last_row(f);
    int row = line.first_row(f);
    double x = line.ux, from = 0;
    if (line.uy > row) {
      from = rounded((line.uy - row) * one);
    } else {
      x = line.x_at(row);
    }
    auto at = static_cast<std::size_t>(row - f.y0);
    PixelSums* sums = sums_.data() + at * f.stride;
    std::uint64_t* marks = marks_.data() + (2 * at + (line.down ? 0 : 1)) * f.words;
    const auto rows = static_cast<std::size_t>(last - row + 1);
    if (crossings_.size() < crossing_count_ + rows) crossings_.resize(2 * crossing_count_ + rows);
    Crossing* crossing = crossings_.data() + crossing_count_;
    crossing_count_ += rows;
    const auto add = [&](double end, double height) __attribute__((always_inline)) {
      const int column = add_piece(sums, marks, x, end, height, per_pixel, f.width);
      *crossing++ = {static_cast<std::uint32_t>(at), column, segment};
      ++row_counts_[at];
    };
    for (; row < last; ++row) {
      const double end = line.x_at(row + 1);
      add(end, one - from);
      x = end;
      from = 0;
      ++at;
      sums += f.stride;
      marks += 2 * f.words;
    }
    if (line.ly < last + 1) {
      add(line.lx, rounded((line.ly - last) * one) - from);
    } else {
      add(line.x_at(last + 1), one - from);
    }
  }
}

/// A horizontal segment turns nothing, but its pixels are covered partly: they can't be filled by
/// one winding. Marked both ways they are looked at closely.
void Raster::add_horizontal(const Segment& s, const Frame& f) {
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

SLICECORR_CLONES
bool Raster::draw_area_row(int row, const Frame& f) {
  const auto at = static_cast<std::size_t>(row);
  std::uint8_t* const pixels = pixels_.data() + at * width_;
  std::uint8_t* const end = pixels + width_;
  PixelSums* const sums = sums_.data() + at * f.stride;
  std::uint64_t* const down = marks_.data() + 2 * at * f.words;
  std::uint64_t* const up = down + f.words;
  std::int64_t running = 0;
  unsigned lit = 0;
  int done = 0;  // pixels before this one are written
  for (std::size_t w = 0; w < f.words; ++w) {
    std::uint64_t marks = down[w] | up[w];
    while (marks) {
      // A run of marked pixels. No piece leaves it, so the winding is one number on either side.
      const int bit = std::countr_zero(marks);
      const int count = std::countr_one(marks >> bit);
      const int first = static_cast<int>(64 * w) + bit;
      int last = first + count - 1;
      bool one_way;
      if (bit + count < 64) {
        const std::uint64_t run = ((std::uint64_t{1} << count) - 1) << bit;
        one_way = !(down[w] & run) || !(up[w] & run);
        marks ^= run;
      } else {
        const std::uint64_t run = ~std::uint64_t{0} << bit;
        std::uint64_t any_down = down[w] & run, any_up = up[w] & run;
        marks = 0;
        while (w + 1 < f.words) {
          const std::uint64_t next = down[w + 1] | up[w + 1];
          const int more = std::countr_one(next);
          const std::uint64_t here =
              more == 64 ? ~std::uint64_t{0} : (std::uint64_t{1} << more) - 1;
          if (more == 0) break;
          ++w;
          any_down |= down[w] & here;
          any_up |= up[w] & here;
          last += more;
          marks = next & ~here;
          if (more < 64) break;
        }
        one_way = !any_down || !any_up;
      }
      if (done < first) {
        const bool inside = running != 0;
        fill(pixels + done, pixels + first, end, inside ? 255 : 0);
        lit |= inside;
      }
      done = last + 1;
      if (!one_way) {
        lit |= draw_run(row, first, last, running, f);
        continue;
      }
      const std::int64_t before = running;
      for (int p = first; p <= last; ++p) {
        const unsigned level = level_of(running + sums[p].area);
        running += sums[p].cover;
        sums[p] = {0, 0};
        pixels[p] = static_cast<std::uint8_t>(level);
        lit |= level;
      }
      // Pieces of one direction that change the winding by one: at every height there is just one.
      const std::int64_t change = running - before;
      if (change != kOne && change != -kOne && change != 0) {
        lit |= draw_tangle(row, first, last, static_cast<int>((before + kOne / 2) >> kOneBits), f);
      }
    }
  }
  std::memset(down, 0, 2 * f.words * sizeof *down);
  const bool inside = running != 0 && pixels + done < end;
  std::memset(pixels + done, inside ? 255 : 0, width_ - static_cast<std::size_t>(done));
  return lit || inside;
}

/// A run of pixels with pieces in both directions.
unsigned Raster::draw_run(int row, int first, int last, std::int64_t& running, const Frame& f) {
  const auto at = static_cast<std::size_t>(row);
  std::uint8_t* const pixels = pixels_.data() + at * width_;
  PixelSums* const sums = sums_.data() + at * f.stride;
  const std::uint64_t* const down = marks_.data() + 2 * at * f.words;
  const std::uint64_t* const up = down + f.words;
  const std::int64_t before = running;
  bool simple = true;
  unsigned lit = 0;
  // Where pixels of one direction follow those of the other without sharing any, no piece crosses
  // from one to the other, and each part is as simple as a run of its own.
  std::int64_t part = running;
  bool part_down = false;
  for (int p = first; p <= last; ++p) {
    const auto w = static_cast<std::size_t>(p) / 64;
    const unsigned bit = static_cast<unsigned>(p) % 64;
    const bool goes_down = down[w] >> bit & 1, goes_up = up[w] >> bit & 1;
    if (p == first || part_down != goes_down) {
      const std::int64_t change = running - part;
      simple &= change == kOne || change == -kOne || change == 0;
      part = running;
      part_down = goes_down;
    }
    simple &= !(goes_down && goes_up);
    const unsigned level = level_of(running + sums[p].area);
    running += sums[p].cover;
    sums[p] = {0, 0};
    pixels[p] = static_cast<std::uint8_t>(level);
    lit |= level;
  }
  const std::int64_t change = running - part;
  simple &= change == kOne || change == -kOne || change == 0;
  if (simple) return lit;
  return draw_tangle(row, first, last, static_cast<int>((before + kOne / 2) >> kOneBits), f);
}

/// Crossings by row.
void Raster::list_rows() {
  listed_ = true;
  std::uint32_t begin = 0;
  for (std::size_t r = 0; r < row_counts_.size(); ++r) {
    row_ends_[r] = begin;
    begin += row_counts_[r];
  }
  if (by_row_.size() < crossing_count_) by_row_.resize(crossings_.size());
  for (std::size_t i = 0; i < crossing_count_; ++i) {
    const Crossing& c = crossings_[i];
    by_row_[row_ends_[c.row]++] = {c.column, c.segment};
  }
}

/// Pixels in which pieces may overlap or cross. Left and right of them the winding is one number
/// per row.
unsigned Raster::draw_tangle(int r, int first, int last, int winding, const Frame& f) {
  if (!listed_) list_rows();
  const auto at = static_cast<std::size_t>(r);
  const int row = f.y0 + r;
  pieces_.clear();
  events_.clear();
  for (std::uint32_t i = row_ends_[at] - row_counts_[at]; i < row_ends_[at]; ++i) {
    if (by_row_[i].column < first || by_row_[i].column > last) continue;
    const Line line(segments_[by_row_[i].segment], f);
    Piece p;
    p.y0 = line.uy > row ? line.uy - row : 0.0;
    p.x0 = line.uy > row ? line.ux : line.x_at(row);
    p.y1 = line.ly < row + 1 ? line.ly - row : 1.0;
    p.x1 = line.ly < row + 1 ? line.lx : line.x_at(row + 1);
    if (!(p.y0 < p.y1)) continue;
    p.slope = (p.x1 - p.x0) / (p.y1 - p.y0);
    p.winding = line.down ? 1 : -1;
    pieces_.push_back(p);
    events_.push_back(p.y0);
    events_.push_back(p.y1);
  }
  std::sort(events_.begin(), events_.end());
  events_.erase(std::unique(events_.begin(), events_.end()), events_.end());
  // An order that follows from the pieces alone.
  std::sort(pieces_.begin(), pieces_.end(), [](const Piece& a, const Piece& b) {
    if (a.y0 != b.y0) return a.y0 < b.y0;
    if (a.x0 != b.x0) return a.x0 < b.x0;
    if (a.x1 != b.x1) return a.x1 < b.x1;
    return a.y1 != b.y1 ? a.y1 < b.y1 : a.winding < b.winding;
  });
  PixelSums* const sums = sums_.data() + at * f.stride;
  std::uint64_t* const marks = marks_.data() + 2 * at * f.words;  // of pixels that have some
  active_.clear();
  std::size_t next = 0;
  for (std::size_t e = 0; e + 1 < events_.size(); ++e) {
    const double from = events_[e], to = events_[e + 1];
    std::erase_if(active_, [&](const Active& a) { return a.piece->y1 <= from; });
    for (; next < pieces_.size() && pieces_[next].y0 <= from; ++next) {
      active_.push_back({&pieces_[next], 0, 0});
    }
    if (!active_.empty()) draw_strip(sums, marks, from, to, winding, f);
  }
  unsigned lit = 0;
  std::int64_t running = winding ? kOne : 0;
  std::uint8_t* const pixels = pixels_.data() + at * width_;
  for (int p = first; p <= last; ++p) {
    const unsigned level = level_of(std::max<std::int64_t>(running + sums[p].area, 0));
    running += sums[p].cover;
    sums[p] = {0, 0};
    pixels[p] = static_cast<std::uint8_t>(level);
    lit |= level;
  }
  return lit;
}

void Raster::draw_strip(PixelSums* sums, std::uint64_t* marks, double from, double to, int winding,
                        const Frame& f) {
  const auto before = [](const Active& a, const Active& b) {
    return a.x != b.x ? a.x < b.x : a.x_end < b.x_end;
  };
  // No piece begins or ends within a strip; where two cross, it is cut there. Each cut orders at
  // least one pair for good; the bound only guards against rounding.
  for (std::size_t cuts = 0; from < to; ++cuts) {
    double until = to;
    for (Active& a : active_) {
      a.x = a.piece->at(from);
      a.x_end = a.piece->at(to);
    }
    if (active_.size() > 1) {
      // Mostly in order from the strip before.
      if (static_cast<std::ptrdiff_t>(active_.size()) > kFew) {
        std::stable_sort(active_.begin(), active_.end(), before);
      } else {
        for (std::size_t k = 1; k < active_.size(); ++k) {
          const Active a = active_[k];
          std::size_t to_k = k;
          for (; to_k > 0 && before(a, active_[to_k - 1]); --to_k)
            active_[to_k] = active_[to_k - 1];
          active_[to_k] = a;
        }
      }
      const std::size_t most = active_.size() * active_.size();
      for (std::size_t k = 0; k + 1 < active_.size() && cuts < most;) {
        const double gap = active_[k + 1].x - active_[k].x;
        const double gap_end = active_[k + 1].x_end - active_[k].x_end;
        const double y = gap_end < 0 ? from + (to - from) * (gap / (gap - gap_end)) : to;
        if (y <= from) {
          // They cross right here, but rounding has them in the order from before. Every swap
          // leaves one pair less in the wrong order at the lower side.
          std::swap(active_[k], active_[k + 1]);
          if (k > 0) --k;
          continue;
        }
        if (y < until) until = y;
        ++k;
      }
    }
    const double height = rounded(until * kOneReal) - rounded(from * kOneReal);
    int w = winding;
    for (const Active& a : active_) {
      const int after = w + a.piece->winding;
      if ((w == 0) != (after == 0)) {
        const double x_end = until == to ? a.x_end : a.piece->at(until);
        const double change = w == 0 ? height : -height;
        add_piece(sums, marks, a.x, x_end, change, change / std::abs(x_end - a.x), f.width);
      }
      w = after;
    }
    from = until;
  }
}

SLICECORR_CLONES
void Raster::add_centres(const Frame& f) {
  for (const Segment& s : segments_) {
    if (s.ay == s.by) continue;
    const Line line(s, f);
    // Rows whose centre line y satisfies uy <= y < ly: shared ends count once.
    const int first = line.uy > f.y0 ? static_cast<int>(std::ceil(line.uy - 0.5)) : f.y0;
    const int last = line.ly < f.y1 ? static_cast<int>(std::ceil(line.ly - 0.5)) - 1 : f.y1 - 1;
    for (int row = first; row <= last; ++row) {
      // The first pixel whose centre is not left of the line; past the band's end it turns nothing.
      const int column = static_cast<int>(std::ceil(line.x_at(row + 0.5) - 0.5));
      if (column >= f.width) continue;
      const auto at = static_cast<std::size_t>(row - f.y0);
      steps_[at * width_ + static_cast<std::size_t>(column)] += line.down ? 1 : -1;
      mark(marks_.data() + at * f.words, static_cast<unsigned>(column),
           static_cast<unsigned>(column));
      touched_[at] = 1;
    }
  }
}

SLICECORR_CLONES
bool Raster::draw_centre_row(int row, const Frame& f) {
  const auto at = static_cast<std::size_t>(row);
  std::uint8_t* const pixels = pixels_.data() + at * width_;
  std::uint8_t* const end = pixels + width_;
  std::int32_t* const steps = steps_.data() + at * width_;
  std::uint64_t* const marks = marks_.data() + at * f.words;
  std::int32_t winding = 0;
  bool lit = false;
  int done = 0;
  for (std::size_t w = 0; w < f.words; ++w) {
    for (std::uint64_t left = marks[w]; left; left &= left - 1) {
      const int p = static_cast<int>(64 * w) + std::countr_zero(left);
      if (steps[p] == 0) continue;
      if (winding == 0 || winding + steps[p] == 0) {
        fill(pixels + done, pixels + p, end, winding ? 255 : 0);
        lit |= winding != 0;
        done = p;
      }
      winding += steps[p];
      steps[p] = 0;
    }
    marks[w] = 0;
  }
  lit |= winding != 0;
  std::memset(pixels + done, winding ? 255 : 0, width_ - static_cast<std::size_t>(done));
  return lit;
}

}  // namespace slicecorr::detail
