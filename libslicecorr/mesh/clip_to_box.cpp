// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "mesh/clip_to_box.hpp"

#include <algorithm>
#include <map>
#include <unordered_map>
#include <utility>

namespace slicecorr::detail {

namespace {

/// Cuts triangles where they cross the plane on which coordinate `axis` is `at`.
void cut_at(std::vector<Point3>& corners, std::vector<std::array<std::uint32_t, 3>>& triangles,
            std::size_t axis, double at) {
  std::unordered_map<std::uint64_t, std::uint32_t> cuts;  // by edge
  const auto cut = [&](std::uint32_t a, std::uint32_t b) {
    if (a > b) std::swap(a, b);
    const auto [found, is_new] =
        cuts.emplace(std::uint64_t{a} << 32 | b, static_cast<std::uint32_t>(corners.size()));
    if (!is_new) return found->second;
    const Point3 p = corners[a], q = corners[b];
    const double t = (at - p[axis]) / (q[axis] - p[axis]);
    Point3 point;
    for (std::size_t k = 0; k < 3; ++k) point[k] = p[k] + t * (q[k] - p[k]);
    point[axis] = at;
    corners.push_back(point);
    return found->second;
  };
  const std::size_t count = triangles.size();
  for (std::size_t i = 0; i < count; ++i) {
    auto t = triangles[i];
    int sides[3];
    for (std::size_t k = 0; k < 3; ++k) {
      sides[k] = (corners[t[k]][axis] > at) - (corners[t[k]][axis] < at);
    }
    const auto [least, most] = std::minmax({sides[0], sides[1], sides[2]});
    if (least >= 0 || most <= 0) continue;
    // Turned so that the first corner is alone on its side, or on the plane.
    const bool on_plane = sides[0] == 0 || sides[1] == 0 || sides[2] == 0;
    std::size_t first = 0;
    while (on_plane
               ? sides[first] != 0
               : sides[first] == sides[(first + 1) % 3] || sides[first] == sides[(first + 2) % 3]) {
      ++first;
    }
    std::rotate(t.begin(), t.begin() + static_cast<std::ptrdiff_t>(first), t.end());
    if (on_plane) {
      const std::uint32_t m = cut(t[1], t[2]);
      triangles[i] = {t[0], t[1], m};
      triangles.push_back({t[0], m, t[2]});
    } else {
      const std::uint32_t m = cut(t[0], t[1]), n = cut(t[2], t[0]);
      triangles[i] = {t[0], m, n};
      triangles.push_back({m, t[1], t[2]});
      triangles.push_back({m, t[2], n});
    }
  }
}

}  // namespace

void clip_to_box(std::vector<Point3>& corners, std::vector<std::array<std::uint32_t, 3>>& triangles,
                 const Point3& low, const Point3& high) {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (const double at : {low[axis], high[axis]}) cut_at(corners, triangles, axis, at);
    for (const auto& t : triangles) {
      for (const std::uint32_t corner : t) {
        corners[corner][axis] = std::clamp(corners[corner][axis], low[axis], high[axis]);
      }
    }
  }
}

void keep_in_box(std::vector<Point3>& corners, std::vector<std::array<std::uint32_t, 3>>& triangles,
                 const Point3& low, const Point3& high) {
  using Edge = std::pair<std::uint32_t, std::uint32_t>;
  for (std::size_t side = 0; side < 6; ++side) {
    const std::size_t axis = side / 2;
    const bool above = side % 2 != 0;  // whether what lies above the plane goes
    const double at = above ? high[axis] : low[axis];
    const auto beyond = [&](std::uint32_t corner) {
      const double x = corners[corner][axis];
      return above ? x - at : at - x;
    };
    const bool any = std::any_of(triangles.begin(), triangles.end(), [&](const auto& t) {
      return beyond(t[0]) > 0 || beyond(t[1]) > 0 || beyond(t[2]) > 0;
    });
    if (!any) continue;
    cut_at(corners, triangles, axis, at);
    // What lies in the plane goes, too: the new face is there then.
    std::erase_if(triangles, [&](const auto& t) {
      const double most = std::max({beyond(t[0]), beyond(t[1]), beyond(t[2])});
      const double least = std::min({beyond(t[0]), beyond(t[1]), beyond(t[2])});
      return most > 0 || least == 0;
    });
    // Edges that have lost their other triangle bound the face.
    std::map<Edge, int> edges;
    for (const auto& t : triangles) {
      for (std::size_t k = 0; k < 3; ++k) {
        const Edge edge{t[k], t[(k + 1) % 3]};
        const auto other = edges.find({edge.second, edge.first});
        if (other == edges.end()) {
          ++edges[edge];
        } else if (--other->second == 0) {
          edges.erase(other);
        }
      }
    }
    if (edges.empty()) continue;
    // From the middle of its corners, which lies on none of its sides.
    const auto middle = static_cast<std::uint32_t>(corners.size());
    corners.emplace_back();
    for (const auto& [edge, count] : edges) {
      for (std::size_t k = 0; k < 3; ++k) {
        corners[middle][k] += corners[edge.first][k] / static_cast<double>(edges.size());
      }
    }
    corners[middle][axis] = at;
    for (const auto& [edge, count] : edges) {
      for (int i = 0; i < count; ++i) triangles.push_back({middle, edge.second, edge.first});
    }
  }
  // Cuts may end where corners are: those become one, and what lies between them goes.
  std::map<Point3, std::uint32_t> places;
  for (auto& t : triangles) {
    for (std::uint32_t& corner : t) corner = places.emplace(corners[corner], corner).first->second;
  }
  std::erase_if(triangles,
                [](const auto& t) { return t[0] == t[1] || t[1] == t[2] || t[2] == t[0]; });
}

}  // namespace slicecorr::detail
