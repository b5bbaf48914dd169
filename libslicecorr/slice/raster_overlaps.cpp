// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Pixels in which fragments may overlap or cross, scanbeam by scanbeam.
#include <algorithm>
#include <bit>
#include <cmath>
#include <span>

#include "slice/raster.hpp"
#include "slice/raster_parts.hpp"

namespace slicecorr::detail {
namespace {

/// Up to so many elements an insertion sort is quick enough.
constexpr std::ptrdiff_t kFew = 48;

}  // namespace

/// Makes overlap spans of the runs of marked pixels of a row that are to be looked at closely.
void Raster::find_overlap_spans(int row, std::size_t count) {
  std::size_t done = 0;
  for (const std::uint32_t i : doubts_) {
    if (i < done) continue;
    std::size_t first = i;
    while (first > 0 && columns_[first - 1] + 1 == columns_[first]) --first;
    for (done = i + 1; done < count && columns_[done - 1] + 1 == columns_[done];) ++done;
    overlap_spans_.push_back({row, static_cast<int>(columns_[first]),
                              static_cast<int>(columns_[done - 1]),
                              static_cast<int>((begins_[i] + kOne / 2) >> kOneBits), 0, 0});
  }
}

/// Draws all overlap spans of a slice again.
unsigned Raster::draw_overlap_spans(const BandLayout& f) {
  find_segments();
  unsigned lit = 0;
  for (const OverlapSpan& span : overlap_spans_) {
    const bool ruled = !ruled_.empty() && ruled_[static_cast<std::size_t>(span.row)];
    lit |= ruled ? draw_ruled_span(span, f) : draw_overlap_span(span, f);
  }
  return lit;
}

/// Finds the segments of each span by one look at all that cross a row: no fragment leaves a run of
/// marked pixels, so its left end says in which run it lies.
void Raster::find_segments() {
  const auto columns_of = [&](const OverlapSpan& span) {
    std::uint32_t* const row = span_of_.data() + span_row_[static_cast<std::size_t>(span.row)];
    return std::span(row + span.first, row + span.last + 1);
  };
  std::uint32_t row_begin = 0;
  for (std::uint32_t k = 0; k < overlap_spans_.size(); ++k) {
    const OverlapSpan& span = overlap_spans_[k];
    if (k == 0 || overlap_spans_[k - 1].row != span.row) {
      row_begin += static_cast<std::uint32_t>(width_);
      span_row_[static_cast<std::size_t>(span.row)] = row_begin;
      for (int row = std::max(0, span.row - 3); row <= span.row; ++row) {
        spans_near_[static_cast<std::size_t>(row)] = 1;
      }
    }
    for (std::uint32_t& column : columns_of(span)) column = k + 1;
  }
  const std::size_t most = 4 * crossing_count_ + 1;
  if (found_.size() < most) {
    found_.resize(2 * most);
    overlap_segments_.resize(2 * most);
  }
  // In rows with overlap spans without a branch, which the processor could not predict.
  std::size_t found = 0;
  for (std::size_t i = 0; i < crossing_count_; ++i) {
    const Crossings& c = crossings_[i];
    if (!spans_near_[c.row]) continue;
    for (int k = 0; k < c.count; ++k) {
      const std::uint32_t span = span_of_[span_row_[c.row + static_cast<std::size_t>(k)] +
                                          static_cast<std::size_t>(c.columns[k])];
      found_[found] = {span - 1, c.segment};
      found += span != 0;
    }
  }
  for (std::size_t i = 0; i < found; ++i) ++overlap_spans_[found_[i].span].end;
  std::uint32_t sum = 0;
  for (OverlapSpan& span : overlap_spans_) {
    span.begin = sum;
    sum += span.end;
    span.end = span.begin;
    for (std::uint32_t& column : columns_of(span)) column = 0;
  }
  for (const OverlapSpan& span : overlap_spans_) span_row_[static_cast<std::size_t>(span.row)] = 0;
  std::fill(spans_near_.begin(), spans_near_.end(), std::uint8_t{0});
  for (std::size_t i = 0; i < found; ++i) {
    overlap_segments_[overlap_spans_[found_[i].span].end++] = found_[i].segment;
  }
}

/// Whether at every height of a run there are no fragments, or one that goes down and one that goes
/// up, always in the same order. They then bound all that lies between them, and signed areas are
/// right. The fragments are those of a run, sorted by their upper ends.
bool Raster::pairs() {
  double down_end = 0, up_end = 0, order = 0;
  std::size_t i = 0, k = 0;
  const std::size_t n = fragments_.size();
  const auto next = [&](std::size_t& at, int winding) {
    while (at < n && fragments_[at].winding != winding) ++at;
    return at < n;
  };
  for (const EdgeFragment& p : fragments_) {
    double& end = p.winding > 0 ? down_end : up_end;
    if (p.y0 < end) return false;
    end = p.y1;
  }
  while (next(i, 1) && next(k, -1)) {
    const EdgeFragment &down = fragments_[i], &up = fragments_[k];
    const double from = std::max(down.y0, up.y0), to = std::min(down.y1, up.y1);
    if (from < to) {
      for (const double y : {from, to}) {
        const double gap = up.at(y) - down.at(y);
        if (gap * order < 0) return false;
        if (gap != 0) order = gap > 0 ? 1 : -1;
      }
    }
    ++(down.y1 < up.y1 ? i : k);
  }
  return true;
}

/// The fragments of an overlap span, in an order that follows from them alone.
void Raster::collect_fragments(const OverlapSpan& span, const BandLayout& f) {
  const int row = f.y0 + span.row;
  fragments_.clear();
  for (std::uint32_t i = span.begin; i < span.end; ++i) {
    const Line line(segments_[overlap_segments_[i]], f);
    EdgeFragment p;
    p.y0 = line.uy > row ? line.uy - row : 0.0;
    p.x0 = line.uy > row ? line.ux : line.x_at(row);
    p.y1 = line.ly < row + 1 ? line.ly - row : 1.0;
    p.x1 = line.ly < row + 1 ? line.lx : line.x_at(row + 1);
    if (!(p.y0 < p.y1)) continue;
    p.slope = (p.x1 - p.x0) / (p.y1 - p.y0);
    p.winding = line.down ? 1 : -1;
    p.tag = tags_.empty() ? SolidRule::Tag{0} : tags_[overlap_segments_[i]];
    fragments_.push_back(p);
  }
  std::sort(fragments_.begin(), fragments_.end(), [](const EdgeFragment& a, const EdgeFragment& b) {
    if (a.y0 != b.y0) return a.y0 < b.y0;
    if (a.x0 != b.x0) return a.x0 < b.x0;
    if (a.x1 != b.x1) return a.x1 < b.x1;
    if (a.y1 != b.y1) return a.y1 < b.y1;
    return a.winding != b.winding ? a.winding < b.winding : a.tag < b.tag;
  });
}

/// One winding for all: solid where it is not 0.
struct Raster::OneWinding {
  int winding;
  bool inside() const { return winding != 0; }
  void cross(const EdgeFragment& fragment, int way = 1) { winding += way * fragment.winding; }
};

/// Draws an overlap span scanbeam by scanbeam. Left and right of it each row has one winding.
unsigned Raster::draw_overlap_span(const OverlapSpan& span, const BandLayout& f) {
  collect_fragments(span, f);
  if (pairs()) return 0;  // already drawn
  OneWinding winding{span.winding};
  draw_fragments(span, winding, f);
  return write_levels(span, winding.inside());
}

/// Adds what the fragments of a span bound to its sums. `winding` is that left of the span.
template <class Winding>
void Raster::draw_fragments(const OverlapSpan& span, Winding& winding, const BandLayout& f) {
  const auto at = static_cast<std::size_t>(span.row);
  // Scanbeams begin and end where fragments do. Lower ends are nearly in the order of upper ones.
  lower_ends_.clear();
  for (const EdgeFragment& p : fragments_) {
    lower_ends_.push_back(p.y1);
    std::size_t k = lower_ends_.size() - 1;
    if (k > 0 && lower_ends_[k - 1] > p.y1) {
      const auto to = std::upper_bound(lower_ends_.begin(), lower_ends_.end() - 1, p.y1);
      std::rotate(to, lower_ends_.end() - 1, lower_ends_.end());
    }
  }
  events_.clear();
  std::size_t upper = 0, lower = 0;
  while (lower < lower_ends_.size()) {
    const bool begins = upper < fragments_.size() && fragments_[upper].y0 < lower_ends_[lower];
    const double y = begins ? fragments_[upper++].y0 : lower_ends_[lower++];
    if (events_.empty() || events_.back() != y) events_.push_back(y);
  }
  PixelSums* const sums = sums_.data() + at * f.stride;
  std::uint64_t* const marks = gaps_.data();  // not used any more
  active_.clear();
  std::size_t next = 0;
  for (std::size_t e = 0; e + 1 < events_.size(); ++e) {
    const double from = events_[e], to = events_[e + 1];
    std::erase_if(active_, [&](const Active& a) { return a.fragment->y1 <= from; });
    for (; next < fragments_.size() && fragments_[next].y0 <= from; ++next) {
      active_.push_back({&fragments_[next], fragments_[next].x0, 0});
    }
    if (!active_.empty()) draw_scanbeam(sums, marks, from, to, winding, f);
  }
}

unsigned Raster::write_levels(const OverlapSpan& span, bool inside) {
  const auto at = static_cast<std::size_t>(span.row);
  PixelSums* const sums = sums_.data() + at * (width_ + 1);
  unsigned lit = 0;
  std::int64_t running = inside ? kOne : 0;
  std::uint8_t* const pixels = pixels_.data() + at * width_;
  for (int p = span.first; p <= span.last; ++p) {
    const unsigned level = level_of(std::max<std::int64_t>(running + sums[p].area, 0));
    running += sums[p].cover;
    sums[p] = {0, 0};
    pixels[p] = static_cast<std::uint8_t>(level);
    lit |= level;
  }
  return lit;
}

template <class Winding>
void Raster::draw_scanbeam(PixelSums* sums, std::uint64_t* marks, double from, double to,
                           Winding& winding, const BandLayout& f) {
  const auto before = [](const Active& a, const Active& b) {
    return a.x != b.x ? a.x < b.x : a.x_end < b.x_end;
  };
  // No fragment begins or ends within a scanbeam; where two cross, it is cut there. Each cut orders
  // at least one pair for good; the bound only guards against rounding.
  for (Active& a : active_) a.x_end = a.fragment->at(to);
  for (std::size_t cuts = 0; from < to; ++cuts) {
    double until = to;
    if (active_.size() > 1) {
      // The order of the scanbeam before is mostly right.
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
    for (const Active& a : active_) {
      const bool was_inside = winding.inside();
      winding.cross(*a.fragment);
      if (was_inside != winding.inside()) {
        const double x_end = until == to ? a.x_end : a.fragment->at(until);
        const double change = was_inside ? -height : height;
        add_piece(sums, marks, a.x, x_end, change, change / std::abs(x_end - a.x), f.width);
      }
    }
    for (const Active& a : active_) winding.cross(*a.fragment, -1);
    if (until != to) {
      for (Active& a : active_) a.x = a.fragment->at(until);
    }
    from = until;
  }
  for (Active& a : active_) a.x = a.x_end;
}

// Where volumes are taken away.

/// Each tag by itself.
struct Raster::ManyWindings {
  SolidWindings& windings;
  bool inside() const { return windings.inside(); }
  void cross(const EdgeFragment& fragment, int way = 1) {
    windings.add(fragment.tag, std::int64_t{way} * fragment.winding);
  }
};

/// Notes the rows that segments cross whose tags need the rule; false where there are none.
bool Raster::find_ruled_rows() {
  const BandLayout f = {x0_, y0_, y1_, x1_ - x0_, words_, width_ + 1};
  ruled_.assign(static_cast<std::size_t>(y1_ - y0_), 0);
  bool any = false;
  for (std::size_t i = 0; i < segments_.size(); ++i) {
    if (!rule_->needs_rule(tags_[i])) continue;
    const Segment& s = segments_[i];
    int first = 0, last = 0;
    if (s.ay == s.by) {
      if (!(s.ay > y0_) || !(s.ay < y1_)) continue;
      first = last = static_cast<int>(s.ay);
      if (first == s.ay) continue;
    } else {
      const Line line(s, f);
      first = line.first_row(f);
      last = line.last_row(f);
    }
    for (int row = first; row <= last; ++row) {
      ruled_[static_cast<std::size_t>(row - y0_)] = 1;
      any = true;
    }
  }
  windings_.clear();
  windings_.emplace_back(*rule_);
  heights_.assign(rule_->tags(), 0);
  ruled_row_ = -1;
  return any;
}

/// Makes overlap spans of all runs of marked pixels of a row.
void Raster::find_ruled_spans(int row, const BandLayout& f) {
  const auto at = static_cast<std::size_t>(row);
  std::uint64_t* const down = marks_.data() + 2 * at * f.words;
  PixelSums* const sums = sums_.data() + at * f.stride;
  for (std::size_t w = 0; w < f.words; ++w) {
    for (std::uint64_t left = down[w] | down[w + f.words]; left; left &= left - 1) {
      const int p = static_cast<int>(64 * w) + std::countr_zero(left);
      sums[p] = {0, 0};
      if (!overlap_spans_.empty() && overlap_spans_.back().row == row &&
          overlap_spans_.back().last + 1 == p) {
        overlap_spans_.back().last = p;
      } else {
        overlap_spans_.push_back({row, p, p, 0, 0, 0});
      }
    }
  }
  sums[f.width] = {0, 0};
  std::fill_n(down, 2 * f.words, std::uint64_t{0});
}

/// Spans come from left to right: the windings are those that the ones before left.
unsigned Raster::draw_ruled_span(const OverlapSpan& span, const BandLayout& f) {
  SolidWindings& windings = windings_[0];
  if (span.row != ruled_row_) {
    windings.clear();
    ruled_row_ = span.row;
    ruled_column_ = 0;
  }
  unsigned lit = 0;
  std::uint8_t* const pixels = pixels_.data() + static_cast<std::size_t>(span.row) * width_;
  if (windings.inside()) {
    std::fill(pixels + ruled_column_, pixels + span.first, std::uint8_t{255});
    lit |= static_cast<unsigned>(span.first > ruled_column_);
  }
  ruled_column_ = span.last + 1;
  collect_fragments(span, f);
  ManyWindings winding{windings};
  draw_fragments(span, winding, f);
  lit |= write_levels(span, windings.inside());
  // Contours are closed: right of the span each winding is one number again.
  for (const EdgeFragment& p : fragments_) {
    heights_[p.tag] +=
        p.winding * static_cast<std::int64_t>(rounded(p.y1 * kOneReal) - rounded(p.y0 * kOneReal));
  }
  for (const EdgeFragment& p : fragments_) {
    const std::int64_t by = (heights_[p.tag] + kOne / 2) >> kOneBits;
    heights_[p.tag] = 0;
    if (by != 0) windings.add(p.tag, by);
  }
  return lit;
}

/// What `add_centres` does, by the same arithmetic, for the rows that the rule draws.
void Raster::add_ruled_centres(const BandLayout& f) {
  for (std::size_t i = 0; i < segments_.size(); ++i) {
    const Segment& s = segments_[i];
    if (s.ay == s.by) continue;
    const Line line(s, f);
    const int first = line.uy > f.y0 ? static_cast<int>(std::ceil(line.uy - 0.5)) : f.y0;
    const int last = line.ly < f.y1 ? static_cast<int>(std::ceil(line.ly - 0.5)) - 1 : f.y1 - 1;
    for (int row = first; row <= last; ++row) {
      if (!ruled_[static_cast<std::size_t>(row - f.y0)]) continue;
      const double x = line.x_at(row + 0.5) - 0.5;
      int column = static_cast<int>(x);
      column += x > column;
      centre_steps_.push_back(
          {row - f.y0, column, tags_[i], static_cast<std::int8_t>(line.down ? 1 : -1)});
    }
  }
}

bool Raster::draw_ruled_centres() {
  std::sort(centre_steps_.begin(), centre_steps_.end(),
            [](const CentreStep& a, const CentreStep& b) {
              return a.row != b.row ? a.row < b.row : a.column < b.column;
            });
  SolidWindings& windings = windings_[0];
  bool lit = false;
  for (std::size_t i = 0; i < centre_steps_.size();) {
    const int row = centre_steps_[i].row;
    std::uint8_t* const pixels = pixels_.data() + static_cast<std::size_t>(row) * width_;
    windings.clear();
    for (; i < centre_steps_.size() && centre_steps_[i].row == row; ++i) {
      windings.add(centre_steps_[i].tag, centre_steps_[i].step);
      const bool more = i + 1 < centre_steps_.size() && centre_steps_[i + 1].row == row;
      const int from = centre_steps_[i].column;
      const int to = more ? centre_steps_[i + 1].column : static_cast<int>(width_);
      if (!windings.inside() || from >= to) continue;
      std::fill(pixels + from, pixels + to, std::uint8_t{255});
      lit = true;
    }
  }
  centre_steps_.clear();
  return lit;
}

}  // namespace slicecorr::detail
