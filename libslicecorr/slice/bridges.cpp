// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slice/bridges.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <unordered_map>

namespace slicecorr::detail {

namespace {

struct EndPair {
  double distance2;
  std::uint32_t end, beginning;
};

/// Up to this many loose ends all pairs are looked at; more are thinned out through a grid first.
constexpr std::size_t kAllPairs = 512;
/// Candidates per end and round of the grid search.
constexpr std::size_t kCandidates = 32;

/// Different points with how many loose ends lie at each: points that lie over each other are
/// looked at once.
struct Points {
  std::vector<LooseEnds::Point> at;
  std::vector<std::size_t> count;

  explicit Points(const std::vector<LooseEnds::Point>& all) {
    std::unordered_map<std::uint64_t, std::vector<std::uint32_t>> known;
    const auto bits = [](double v) { return std::bit_cast<std::uint64_t>(v + 0.0); };
    for (const LooseEnds::Point& place : all) {
      auto& near = known[bits(place.x) * 0x9E3779B97F4A7C15u ^ bits(place.y)];
      const auto same = std::find_if(near.begin(), near.end(), [&](std::uint32_t i) {
        return at[i].x == place.x && at[i].y == place.y;
      });
      if (same != near.end()) {
        ++count[*same];
        continue;
      }
      near.push_back(static_cast<std::uint32_t>(at.size()));
      at.push_back(place);
      count.push_back(1);
    }
  }
  std::size_t size() const { return at.size(); }
  bool empty() const { return at.empty(); }
  const LooseEnds::Point& operator[](std::size_t i) const { return at[i]; }
  /// Drops points at which no loose end is left.
  void drop_used() {
    std::size_t n = 0;
    for (std::size_t i = 0; i < at.size(); ++i) {
      if (count[i] == 0) continue;
      at[n] = at[i];
      count[n++] = count[i];
    }
    at.resize(n);
    count.resize(n);
  }
};

std::int64_t cell_key(std::int64_t cx, std::int64_t cy) { return cx * 0x9E3779B1LL + cy; }

}  // namespace

std::vector<Segment> bridge(const LooseEnds& loose, double scale_x, double scale_y,
                            double& longest_mm) {
  std::vector<Segment> joints;
  Points ends(loose.ends), beginnings(loose.beginnings);
  std::vector<EndPair> pairs;
  const auto distance2 = [&](std::size_t e, std::size_t b) {
    const double dx = (ends[e].x - beginnings[b].x) * scale_x;
    const double dy = (ends[e].y - beginnings[b].y) * scale_y;
    return dx * dx + dy * dy;
  };
  // Takes the pairs from the nearest on, and keeps what is left loose.
  const auto join = [&] {
    std::sort(pairs.begin(), pairs.end(), [](const EndPair& p, const EndPair& q) {
      if (p.distance2 != q.distance2) return p.distance2 < q.distance2;
      return p.end != q.end ? p.end < q.end : p.beginning < q.beginning;
    });
    for (const EndPair& p : pairs) {
      const std::size_t n = std::min(ends.count[p.end], beginnings.count[p.beginning]);
      if (n == 0) continue;
      ends.count[p.end] -= n;
      beginnings.count[p.beginning] -= n;
      if (p.distance2 > 0) {
        const auto& e = ends[p.end];
        const auto& b = beginnings[p.beginning];
        joints.insert(joints.end(), n, {e.x, e.y, b.x, b.y});
        longest_mm = std::max(longest_mm, std::sqrt(p.distance2));
      }
    }
    ends.drop_used();
    beginnings.drop_used();
    pairs.clear();
  };

  // Greedy joining with growing reach: what stays loose after a round has no partner within it.
  for (double reach_mm = 1e-3; ends.size() > kAllPairs && reach_mm < 1e5; reach_mm *= 4) {
    std::unordered_map<std::int64_t, std::vector<std::uint32_t>> cells;
    const auto cell = [&](double v, double scale) {
      return static_cast<std::int64_t>(std::floor(v * scale / reach_mm));
    };
    for (std::uint32_t b = 0; b < beginnings.size(); ++b) {
      cells[cell_key(cell(beginnings[b].x, scale_x), cell(beginnings[b].y, scale_y))].push_back(b);
    }
    for (std::uint32_t e = 0; e < ends.size(); ++e) {
      std::size_t found = 0;
      for (std::int64_t dy = -1; dy <= 1; ++dy) {
        for (std::int64_t dx = -1; dx <= 1; ++dx) {
          const auto it =
              cells.find(cell_key(cell(ends[e].x, scale_x) + dx, cell(ends[e].y, scale_y) + dy));
          if (it == cells.end()) continue;
          for (const std::uint32_t b : it->second) {
            if (found == kCandidates) break;
            const double d2 = distance2(e, b);
            if (d2 > reach_mm * reach_mm) continue;
            pairs.push_back({d2, e, b});
            ++found;
          }
        }
      }
    }
    join();
  }
  while (!ends.empty() && !beginnings.empty()) {
    const std::size_t some = std::min(ends.size(), 4 * kAllPairs);
    const std::size_t others = std::min(beginnings.size(), 4 * kAllPairs);
    for (std::uint32_t e = 0; e < some; ++e) {
      for (std::uint32_t b = 0; b < others; ++b) pairs.push_back({distance2(e, b), e, b});
    }
    join();
  }
  return joints;
}

}  // namespace slicecorr::detail
