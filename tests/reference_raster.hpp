// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The raster as it is defined, slow and plain, for comparisons.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

#include "slice/raster.hpp"

namespace slicecorr::test {

using detail::Segment;

/// The plain way to draw a band: fragments of every row are sorted, those that share pixels are cut
/// into scanbeams in which no two cross, and areas of spans are summed. `Raster` must give the same
/// levels.
class ReferenceRaster {
 public:
  /// Rows [y0, y1), columns [x0, x1). No segment may leave the columns.
  ReferenceRaster(int x0, int y0, int x1, int y1, bool antialias);

  void clear();
  void add(const Segment& s);
  /// Writes (y1 - y0) * (x1 - x0) bytes. False when all are 0.
  bool draw(std::uint8_t* rows);

 private:
  /// A fragment within one row; y from 0 to 1 in the row and y0 < y1. Or a horizontal one, from
  /// left to right and of winding 0, that only keeps the fragments at its two ends in one cluster.
  struct EdgeFragment {
    double x0, y0, x1, y1;
    int winding;  ///< +1: the contour goes down here (y grows), -1: up
    double at(double y) const {
      // Exact at the ends, so that fragments that meet there meet exactly.
      if (y <= y0) return x0;
      if (y >= y1) return x1;
      return x0 + (y - y0) * ((x1 - x0) / (y1 - y0));
    }
    double left() const { return x0 < x1 ? x0 : x1; }
    double right() const { return x0 < x1 ? x1 : x0; }
  };
  struct Crossing {
    double x;
    int winding;
  };
  struct Active {
    const EdgeFragment* fragment;
    double x;      ///< at the upper side of the scanbeam
    double x_end;  ///< at its lower side
  };

  bool draw_area_row(std::vector<EdgeFragment>& fragments, std::uint8_t* row);
  bool draw_centre_row(std::vector<Crossing>& crossings, std::uint8_t* row) const;
  void draw_cluster(const EdgeFragment* begin, const EdgeFragment* end, int winding);
  void draw_scanbeam(double from, double to, int winding);
  void accumulate(double xa, double xb, double height);

  int x0_, y0_, x1_, y1_;
  bool antialias_;
  std::vector<std::vector<EdgeFragment>> fragments_;  ///< per row
  std::vector<std::vector<Crossing>> crossings_;      ///< per row
  /// Per pixel: what is to be added to the running sum of areas from the left. All zero between
  /// rows.
  std::vector<double> area_;
  std::vector<double> events_;
  std::vector<const EdgeFragment*> by_start_;
  std::vector<Active> active_;
};

inline ReferenceRaster::ReferenceRaster(int x0, int y0, int x1, int y1, bool antialias)
    : x0_(x0), y0_(y0), x1_(x1), y1_(y1), antialias_(antialias) {
  const auto rows = static_cast<std::size_t>(y1 - y0);
  if (antialias) {
    fragments_.resize(rows);
    area_.resize(static_cast<std::size_t>(x1 - x0) + 2);
  } else {
    crossings_.resize(rows);
  }
}

inline void ReferenceRaster::clear() {
  for (auto& row : fragments_) row.clear();
  for (auto& row : crossings_) row.clear();
}

inline void ReferenceRaster::add(const Segment& s) {
  if (s.ay == s.by) {
    // It turns nothing, but its row is covered partly all along it: pixels between its ends can't
    // be filled by one winding.
    const double row = std::floor(s.ay);
    if (antialias_ && s.ay != row && row >= y0_ && row < y1_) {
      const double y = s.ay - row;
      fragments_[static_cast<std::size_t>(static_cast<int>(row) - y0_)].push_back(
          {std::min(s.ax, s.bx), y, std::max(s.ax, s.bx), y, 0});
    }
    return;
  }
  const bool down = s.ay < s.by;
  // The upper end first, whichever way the contour goes: neighbours then round alike.
  const double ux = down ? s.ax : s.bx, uy = down ? s.ay : s.by;
  const double lx = down ? s.bx : s.ax, ly = down ? s.by : s.ay;
  const int winding = down ? 1 : -1;
  if (ly <= y0_ || uy >= y1_) return;
  const double slope = (lx - ux) / (ly - uy);
  const auto x_at = [&](double y) {
    const double x = ux + (y - uy) * slope;
    return std::clamp(x, std::min(ux, lx), std::max(ux, lx));
  };
  if (antialias_) {
    const int first = std::max(y0_, static_cast<int>(std::floor(uy)));
    const int last = std::min(y1_ - 1, static_cast<int>(std::ceil(ly)) - 1);
    for (int row = first; row <= last; ++row) {
      const double top = row, bottom = row + 1;
      EdgeFragment p;
      p.y0 = uy > top ? uy - top : 0.0;
      p.x0 = uy > top ? ux : x_at(top);
      p.y1 = ly < bottom ? ly - top : 1.0;
      p.x1 = ly < bottom ? lx : x_at(bottom);
      p.winding = winding;
      if (p.y0 < p.y1) fragments_[static_cast<std::size_t>(row - y0_)].push_back(p);
    }
  } else {
    // Rows whose centre line y satisfies uy <= y < ly: shared ends count once.
    const int first = std::max(y0_, static_cast<int>(std::ceil(uy - 0.5)));
    const int last = std::min(y1_ - 1, static_cast<int>(std::ceil(ly - 0.5)) - 1);
    for (int row = first; row <= last; ++row) {
      crossings_[static_cast<std::size_t>(row - y0_)].push_back({x_at(row + 0.5), winding});
    }
  }
}

inline bool ReferenceRaster::draw(std::uint8_t* rows) {
  const auto width = static_cast<std::size_t>(x1_ - x0_);
  std::memset(rows, 0, width * static_cast<std::size_t>(y1_ - y0_));
  bool lit = false;
  if (antialias_) {
    for (std::size_t r = 0; r < fragments_.size(); ++r) {
      if (!fragments_[r].empty()) lit |= draw_area_row(fragments_[r], rows + r * width);
    }
  } else {
    for (std::size_t r = 0; r < crossings_.size(); ++r) {
      if (!crossings_[r].empty()) lit |= draw_centre_row(crossings_[r], rows + r * width);
    }
  }
  return lit;
}

inline bool ReferenceRaster::draw_centre_row(std::vector<Crossing>& crossings,
                                             std::uint8_t* row) const {
  std::stable_sort(crossings.begin(), crossings.end(),
                   [](const Crossing& a, const Crossing& b) { return a.x < b.x; });
  int winding = 0;
  bool lit = false;
  double begin = 0;
  for (const Crossing& c : crossings) {
    const int next = winding + c.winding;
    if (winding == 0) begin = c.x;
    if (winding != 0 && next == 0) {
      // Pixels whose centre lies in [begin, c.x).
      const int from = std::max(x0_, static_cast<int>(std::ceil(begin - 0.5)));
      const int to = std::min(x1_, static_cast<int>(std::ceil(c.x - 0.5)));
      if (from < to) {
        std::memset(row + (from - x0_), 255, static_cast<std::size_t>(to - from));
        lit = true;
      }
    }
    winding = next;
  }
  return lit;
}

inline bool ReferenceRaster::draw_area_row(std::vector<EdgeFragment>& fragments,
                                           std::uint8_t* row) {
  std::stable_sort(
      fragments.begin(), fragments.end(),
      [](const EdgeFragment& a, const EdgeFragment& b) { return a.left() < b.left(); });
  const auto column = [&](double x) {
    return std::clamp(static_cast<int>(std::floor(x)) - x0_, 0, x1_ - x0_ - 1);
  };
  int winding = 0;
  bool lit = false;
  int done = 0;  // pixels before this one are written
  for (std::size_t i = 0; i < fragments.size();) {
    // A cluster: fragments that share pixels. Left and right of it the winding is one number per
    // row.
    const int first = column(fragments[i].left());
    int last = column(fragments[i].right());
    std::size_t end = i + 1;
    for (; end < fragments.size() && column(fragments[end].left()) <= last; ++end) {
      last = std::max(last, column(fragments[end].right()));
    }
    if (winding != 0 && first > done) {
      std::memset(row + done, 255, static_cast<std::size_t>(first - done));
      lit = true;
    }
    const bool inside = winding != 0;
    draw_cluster(fragments.data() + i, fragments.data() + end, winding);
    double total = 0;
    for (std::size_t k = i; k < end; ++k)
      total += fragments[k].winding * (fragments[k].y1 - fragments[k].y0);
    winding += static_cast<int>(std::lround(total));
    double running = inside ? 1.0 : 0.0;
    for (int p = first; p <= last; ++p) {
      const auto k = static_cast<std::size_t>(p);
      running += area_[k];
      area_[k] = 0;
      const double level = std::floor(running * 255.0 + 0.5);
      row[k] = static_cast<std::uint8_t>(std::clamp(level, 0.0, 255.0));
      lit |= row[k] != 0;
    }
    area_[static_cast<std::size_t>(last) + 1] = 0;  // what it carries is the winding
    done = last + 1;
    i = end;
  }
  return lit;
}

inline void ReferenceRaster::draw_cluster(const EdgeFragment* begin, const EdgeFragment* end,
                                          int winding) {
  if (end - begin == 1 && begin->y0 == 0.0 && begin->y1 == 1.0) {
    const int next = winding + begin->winding;
    if ((winding == 0) != (next == 0)) accumulate(begin->x0, begin->x1, winding == 0 ? 1.0 : -1.0);
    return;
  }
  events_.clear();
  by_start_.clear();
  for (const EdgeFragment* p = begin; p != end; ++p) {
    if (p->winding == 0) continue;
    events_.push_back(p->y0);
    events_.push_back(p->y1);
    by_start_.push_back(p);
  }
  // Where the row's cluster has no fragment the region may still be inside: the scanbeams span all
  // of it.
  events_.push_back(0.0);
  events_.push_back(1.0);
  std::sort(events_.begin(), events_.end());
  events_.erase(std::unique(events_.begin(), events_.end()), events_.end());
  std::stable_sort(by_start_.begin(), by_start_.end(),
                   [](const EdgeFragment* a, const EdgeFragment* b) { return a->y0 < b->y0; });
  active_.clear();
  std::size_t next = 0;
  for (std::size_t e = 0; e + 1 < events_.size(); ++e) {
    const double from = events_[e], to = events_[e + 1];
    std::erase_if(active_, [&](const Active& a) { return a.fragment->y1 <= from; });
    for (; next < by_start_.size() && by_start_[next]->y0 <= from; ++next) {
      active_.push_back({by_start_[next], 0, 0});
    }
    if (!active_.empty()) draw_scanbeam(from, to, winding);
  }
}

inline void ReferenceRaster::draw_scanbeam(double from, double to, int winding) {
  // No fragment begins or ends within a scanbeam; where two cross, it is cut there. Each cut orders
  // at least one pair for good; the bound only guards against rounding.
  for (std::size_t cuts = 0; from < to; ++cuts) {
    double until = to;
    for (Active& a : active_) {
      a.x = a.fragment->at(from);
      a.x_end = a.fragment->at(to);
    }
    if (active_.size() > 1) {
      std::stable_sort(active_.begin(), active_.end(), [](const Active& a, const Active& b) {
        return a.x != b.x ? a.x < b.x : a.x_end < b.x_end;
      });
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
    int w = winding;
    for (const Active& a : active_) {
      const int next = w + a.fragment->winding;
      if ((w == 0) != (next == 0)) {
        const double x_end = until == to ? a.x_end : a.fragment->at(until);
        accumulate(a.x, x_end, w == 0 ? until - from : from - until);
      }
      w = next;
    }
    from = until;
  }
}

inline void ReferenceRaster::accumulate(double xa, double xb, double height) {
  // Adds height times the share of every pixel that lies to the right of the line from xa to xb.
  const double left = std::min(xa, xb) - x0_, right = std::max(xa, xb) - x0_;
  const int last_column = x1_ - x0_ - 1;
  const int first = std::clamp(static_cast<int>(std::floor(left)), 0, last_column);
  const int last = std::clamp(static_cast<int>(std::ceil(right)) - 1, first, last_column);
  if (first == last) {
    const double mean = 0.5 * (left + right) - first;
    area_[static_cast<std::size_t>(first)] += height * (1.0 - mean);
    area_[static_cast<std::size_t>(first) + 1] += height * mean;
    return;
  }
  const double per_pixel = height / (right - left);
  for (int p = first; p <= last; ++p) {
    const double from = std::max(left, static_cast<double>(p));
    const double to = p == last ? right : static_cast<double>(p + 1);
    const double part = per_pixel * (to - from);
    const double mean = 0.5 * (from + to) - p;
    area_[static_cast<std::size_t>(p)] += part * (1.0 - mean);
    area_[static_cast<std::size_t>(p) + 1] += part * mean;
  }
}

}  // namespace slicecorr::test
