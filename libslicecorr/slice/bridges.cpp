#include "slice/bridges.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <unordered_map>

namespace slicecorr::detail {

namespace {

struct Pair {
  double distance2;
  std::uint32_t end, beginning;
};

/// Up to this many loose ends all pairs are looked at; more are thinned out through a grid first.
constexpr std::size_t kAllPairs = 512;
/// Candidates per end and round of the grid search.
constexpr std::size_t kCandidates = 32;

std::int64_t cell_key(std::int64_t cx, std::int64_t cy) { return cx * 0x9E3779B1LL + cy; }

}  // namespace

std::vector<Segment> bridge(LooseEnds loose, double scale_x, double scale_y, double& longest_mm) {
  std::vector<Segment> joints;
  auto& ends = loose.ends;
  auto& beginnings = loose.beginnings;
  std::vector<Pair> pairs;
  const auto distance2 = [&](std::size_t e, std::size_t b) {
    const double dx = (ends[e].x - beginnings[b].x) * scale_x;
    const double dy = (ends[e].y - beginnings[b].y) * scale_y;
    return dx * dx + dy * dy;
  };
  // Takes the pairs from the nearest on, and keeps what is left loose.
  const auto join = [&] {
    std::sort(pairs.begin(), pairs.end(), [](const Pair& p, const Pair& q) {
      if (p.distance2 != q.distance2) return p.distance2 < q.distance2;
      return p.end != q.end ? p.end < q.end : p.beginning < q.beginning;
    });
    std::vector<bool> end_joined(ends.size()), beginning_joined(beginnings.size());
    for (const Pair& p : pairs) {
      if (end_joined[p.end] || beginning_joined[p.beginning]) continue;
      end_joined[p.end] = beginning_joined[p.beginning] = true;
      if (p.distance2 > 0) {
        const auto& e = ends[p.end];
        const auto& b = beginnings[p.beginning];
        joints.push_back({e.x, e.y, b.x, b.y});
        longest_mm = std::max(longest_mm, std::sqrt(p.distance2));
      }
    }
    const auto keep = [](std::vector<LooseEnds::Place>& places, const std::vector<bool>& joined) {
      std::size_t n = 0;
      for (std::size_t i = 0; i < places.size(); ++i) {
        if (!joined[i]) places[n++] = places[i];
      }
      places.resize(n);
    };
    keep(ends, end_joined);
    keep(beginnings, beginning_joined);
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
            const double d2 = distance2(e, b);
            if (d2 <= reach_mm * reach_mm && found < kCandidates) {
              pairs.push_back({d2, e, b});
              ++found;
            }
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
