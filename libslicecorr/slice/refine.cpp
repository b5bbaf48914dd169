// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slice/refine.hpp"

#include <limits>
#include <unordered_map>
#include <utility>
#include <vector>

#include "slicecorr/error.hpp"

namespace slicecorr::detail {

namespace {

/// New corners in the middles of edges.
class Middles {
 public:
  Middles(std::vector<Point3>& corners, double longest_mm)
      : corners_(corners), longest_square_(longest_mm * longest_mm) {}
  bool splits(std::uint32_t a, std::uint32_t b) const {
    const double dx = corners_[a][0] - corners_[b][0], dy = corners_[a][1] - corners_[b][1];
    return dx * dx + dy * dy > longest_square_;
  }
  std::uint32_t of(std::uint32_t a, std::uint32_t b) {
    if (a > b) std::swap(a, b);
    const auto [at, made] = known_.try_emplace((std::uint64_t{a} << 32) | b,
                                               static_cast<std::uint32_t>(corners_.size()));
    if (!made) return at->second;
    if (corners_.size() >= std::numeric_limits<std::uint32_t>::max()) {
      throw InputError("the part is too large for the display's distortion to be followed");
    }
    const Point3 p = corners_[a], q = corners_[b];
    corners_.push_back({0.5 * (p[0] + q[0]), 0.5 * (p[1] + q[1]), 0.5 * (p[2] + q[2])});
    return at->second;
  }

 private:
  std::vector<Point3>& corners_;
  double longest_square_;
  std::unordered_map<std::uint64_t, std::uint32_t> known_;
};

using Triangle = std::array<std::uint32_t, 3>;

/// Adds what becomes of a triangle; true where it was split.
bool add_parts(const Triangle& t, Middles& middles, std::vector<Triangle>& out) {
  bool split[3];
  int count = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    split[k] = middles.splits(t[k], t[(k + 1) % 3]);
    count += split[k] ? 1 : 0;
  }
  if (count == 0) {
    out.push_back(t);
    return false;
  }
  // Turned so that the first edge is split, and, of two, the last one is not.
  std::size_t first = 0;
  if (count == 1) {
    while (!split[first]) ++first;
  } else if (count == 2) {
    while (split[(first + 2) % 3]) ++first;
  }
  const std::uint32_t a = t[first], b = t[(first + 1) % 3], c = t[(first + 2) % 3];
  const std::uint32_t ab = middles.of(a, b);
  if (count == 1) {
    out.push_back({a, ab, c});
    out.push_back({ab, b, c});
    return true;
  }
  const std::uint32_t bc = middles.of(b, c);
  out.push_back({ab, b, bc});
  if (count == 2) {
    out.push_back({a, ab, bc});
    out.push_back({a, bc, c});
    return true;
  }
  const std::uint32_t ca = middles.of(c, a);
  out.push_back({a, ab, ca});
  out.push_back({ab, bc, ca});
  out.push_back({ca, bc, c});
  return true;
}

}  // namespace

TriangleMesh refined(TriangleMesh mesh, double longest_mm) {
  for (bool again = longest_mm < std::numeric_limits<double>::infinity(); again;) {
    again = false;
    Middles middles(mesh.vertices, longest_mm);
    std::vector<Triangle> parts;
    parts.reserve(mesh.triangles.size());
    std::size_t share = 0;
    for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
      for (; share < mesh.shares.size() && mesh.shares[share].first == i; ++share) {
        mesh.shares[share].first = static_cast<std::uint32_t>(parts.size());
      }
      again = add_parts(mesh.triangles[i], middles, parts) || again;
    }
    mesh.triangles = std::move(parts);
  }
  return mesh;
}

}  // namespace slicecorr::detail
