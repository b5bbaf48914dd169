// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slice/solid_rule.hpp"

#include <algorithm>
#include <map>
#include <set>
#include <string>
#include <unordered_map>
#include <utility>

#include "slicecorr/error.hpp"

namespace slicecorr::detail {

SolidRule::SolidRule(const std::vector<TriangleMesh::Share>& shares) {
  std::set<std::uint32_t> cut, keeping;
  for (const TriangleMesh::Share& share : shares) {
    if (share.role != SolidRole::added) cut.insert(share.solid);
    if (share.role == SolidRole::kept_within) keeping.insert(share.solid);
  }
  std::map<std::uint32_t, std::uint32_t> solids;  // by number in the mesh
  std::map<std::pair<std::uint32_t, SolidRole>, Tag> tags;
  for (const TriangleMesh::Share& share : shares) {
    if (!cut.contains(share.solid)) {
      tag_of_share_.push_back(0);
      continue;
    }
    const auto solid = solids.emplace(share.solid, static_cast<std::uint32_t>(keeps_.size()));
    const bool keeps = keeping.contains(share.solid);
    if (solid.second) keeps_.push_back(keeps ? 1 : 0);
    const auto tag =
        tags.emplace(std::pair{share.solid, share.role}, static_cast<Tag>(whose_.size()));
    if (tag.second) {
      if (whose_.size() == kMostTags) {
        throw InputError("volumes are taken away from more than " + std::to_string(kMostTags / 2) +
                         " parts of a mesh; expected fewer");
      }
      whose_.push_back({solid.first->second, share.role, keeps || share.role != SolidRole::added});
    }
    tag_of_share_.push_back(tag.first->second);
  }
}

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

}  // namespace slicecorr::detail
