// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "slicecorr/error.hpp"
#include "slicecorr/solid.hpp"

namespace slicecorr {

namespace {

Point3 minus(const Point3& a, const Point3& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
Point3 along(const Point3& a, const Point3& d, double t) {
  return {a[0] + t * d[0], a[1] + t * d[1], a[2] + t * d[2]};
}
double dot(const Point3& a, const Point3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
double square(const Point3& a) { return dot(a, a); }

double square_to_edge(const Point3& p, const Point3& a, const Point3& b) {
  const Point3 d = minus(b, a);
  const double length = square(d);
  const double t = length > 0 ? std::clamp(dot(minus(p, a), d) / length, 0.0, 1.0) : 0.0;
  return square(minus(p, along(a, d, t)));
}

/// Of a triangle that may be without area.
double square_to_triangle(const Point3& p, const Point3& a, const Point3& b, const Point3& c) {
  const Point3 u = minus(b, a), v = minus(c, a), w = minus(p, a);
  const double uu = square(u), uv = dot(u, v), vv = square(v), wu = dot(w, u), wv = dot(w, v);
  const double det = uu * vv - uv * uv;
  if (det > 1e-14 * uu * vv) {
    const double s = (wu * vv - wv * uv) / det, t = (wv * uu - wu * uv) / det;
    if (s >= 0 && t >= 0 && s + t <= 1) return square(minus(w, along(along({}, u, s), v, t)));
  }
  return std::min({square_to_edge(p, a, b), square_to_edge(p, b, c), square_to_edge(p, c, a)});
}

Point3 cross(const Point3& a, const Point3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

/// The point of an edge that is nearest to p.
Point3 on_edge(const Point3& p, const Point3& a, const Point3& b) {
  const Point3 d = minus(b, a);
  const double length = square(d);
  return along(a, d, length > 0 ? std::clamp(dot(minus(p, a), d) / length, 0.0, 1.0) : 0.0);
}

/// The point of a triangle that is nearest to p.
Point3 on_triangle(const Point3& p, const Point3& a, const Point3& b, const Point3& c) {
  const Point3 n = cross(minus(b, a), minus(c, a));
  const double nn = square(n);
  if (nn > 0) {
    const Point3 foot = along(p, n, -dot(minus(p, a), n) / nn);
    const auto left_of = [&](const Point3& from, const Point3& to) {
      return dot(cross(minus(to, from), minus(foot, from)), n) >= 0;
    };
    if (left_of(a, b) && left_of(b, c) && left_of(c, a)) return foot;
  }
  Point3 best = on_edge(p, a, b);
  for (const Point3& other : {on_edge(p, b, c), on_edge(p, c, a)}) {
    if (square(minus(p, other)) < square(minus(p, best))) best = other;
  }
  return best;
}

}  // namespace

/// A uniform grid of boxes with the triangles whose bounding box meets them.
struct MeshDistance::Impl {
  struct Corners {
    Point3 a, b, c;
  };
  // As a mesh has them: corners of each triangle by itself would be three times as much.
  std::vector<Point3> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  Point3 lower{}, upper{};
  double side = 1;
  std::array<int, 3> size{1, 1, 1};
  std::vector<std::uint32_t> begin, list;

  Corners corners(std::uint32_t i) const {
    const auto& t = triangles[i];
    return {vertices[t[0]], vertices[t[1]], vertices[t[2]]};
  }
  int cell(double v, std::size_t axis) const {
    return static_cast<int>(
        std::clamp(std::floor((v - lower[axis]) / side), 0.0, size[axis] - 1.0));
  }
  std::size_t index(int x, int y, int z) const {
    return (static_cast<std::size_t>(z) * static_cast<std::size_t>(size[1]) +
            static_cast<std::size_t>(y)) *
               static_cast<std::size_t>(size[0]) +
           static_cast<std::size_t>(x);
  }
  double square_to_box(const Point3& p, const std::array<int, 3>& box) const {
    double sum = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const double low = lower[k] + box[k] * side;
      const double d = std::max({low - p[k], p[k] - low - side, 0.0});
      sum += d * d;
    }
    // A little less: the sides of boxes are rounded.
    return sum * (1 - 1e-9);
  }
  template <class Visit>
  void boxes_of(const Corners& t, const Visit& visit) const {
    int low[3], high[3];
    for (std::size_t k = 0; k < 3; ++k) {
      low[k] = cell(std::min({t.a[k], t.b[k], t.c[k]}), k);
      high[k] = cell(std::max({t.a[k], t.b[k], t.c[k]}), k);
    }
    for (int z = low[2]; z <= high[2]; ++z) {
      for (int y = low[1]; y <= high[1]; ++y) {
        for (int x = low[0]; x <= high[0]; ++x) visit(index(x, y, z));
      }
    }
  }
  /// Calls `visit` with triangles and the square of their distance, nearer boxes first, until none can be
  /// nearer than what was found, or than `most` (a square).
  template <class Visit>
  void search(const Point3& point, double most, const Visit& visit) const;
};

MeshDistance::MeshDistance(const TriangleMesh& mesh) : impl_(std::make_unique<Impl>()) {
  Impl& s = *impl_;
  if (mesh.triangles.empty()) throw InputError("the design has no triangle to measure from");
  for (const TriangleMesh::Share& share : mesh.shares) {
    if (share.role == SolidRole::added) continue;
    throw InputError(
        "volumes are taken away from the design, or it is kept within some, and distances are measured "
        "to surfaces of meshes only; expected a design whose mesh is its surface");
  }
  s.lower.fill(std::numeric_limits<double>::infinity());
  s.upper.fill(-std::numeric_limits<double>::infinity());
  for (const auto& t : mesh.triangles) {
    for (const std::uint32_t v : t) {
      for (std::size_t k = 0; k < 3; ++k) {
        const double x = mesh.vertices.at(v)[k];
        if (!std::isfinite(x)) throw InputError("a corner of the design is not at a finite place");
        s.lower[k] = std::min(s.lower[k], x);
        s.upper[k] = std::max(s.upper[k], x);
      }
    }
  }
  s.vertices = mesh.vertices;
  s.triangles.assign(mesh.triangles.begin(), mesh.triangles.end());
  // About as many boxes along the surface as there are triangles.
  const Point3 d = minus(s.upper, s.lower);
  const double longest = std::max({d[0], d[1], d[2], 1e-9});
  const double boxes = std::clamp(std::sqrt(static_cast<double>(s.triangles.size())), 4.0, 128.0);
  s.side = longest / boxes;
  for (std::size_t k = 0; k < 3; ++k) {
    s.size[k] = std::max(1, static_cast<int>(std::ceil(d[k] / s.side)));
  }
  s.begin.assign(s.index(0, 0, s.size[2]) + 1, 0);
  const auto count = static_cast<std::uint32_t>(s.triangles.size());
  for (std::uint32_t i = 0; i < count; ++i) {
    s.boxes_of(s.corners(i), [&](std::size_t box) { ++s.begin[box + 1]; });
  }
  for (std::size_t i = 1; i < s.begin.size(); ++i) s.begin[i] += s.begin[i - 1];
  s.list.resize(s.begin.back());
  std::vector<std::uint32_t> at(s.begin.begin(), s.begin.end() - 1);
  for (std::uint32_t i = 0; i < count; ++i) {
    s.boxes_of(s.corners(i), [&](std::size_t box) { s.list[at[box]++] = i; });
  }
}

MeshDistance::~MeshDistance() = default;
MeshDistance::MeshDistance(MeshDistance&&) noexcept = default;

template <class Visit>
void MeshDistance::Impl::search(const Point3& point, double most, const Visit& visit) const {
  // Boxes in shells around the one nearest to the point. The boxes of shell r are at least (r - 1)
  // sides away from any point of the middle box, and no nearer to the point itself.
  int middle[3];
  Point3 inside = point;
  for (std::size_t k = 0; k < 3; ++k) {
    inside[k] = std::clamp(point[k], lower[k], upper[k]);
    middle[k] = cell(point[k], k);
  }
  const double outside = square(minus(point, inside));
  double best = most;
  const int shells = std::max({size[0], size[1], size[2]});
  for (int r = 0; r <= shells; ++r) {
    const double reach = std::max(0, r - 1) * side;
    if (best <= outside + reach * reach) break;
    const auto row = [&](int y, int z, int x, int step) {
      if (y < 0 || y >= size[1] || z < 0 || z >= size[2]) return;
      for (; x <= middle[0] + r; x += step) {
        if (x < 0 || x >= size[0]) continue;
        const std::size_t box = index(x, y, z);
        if (begin[box] == begin[box + 1] || square_to_box(point, {x, y, z}) >= best) continue;
        for (std::uint32_t i = begin[box]; i < begin[box + 1]; ++i) {
          const Corners t = corners(list[i]);
          const double distance = square_to_triangle(point, t.a, t.b, t.c);
          best = std::min(best, distance);
          visit(list[i], distance);
        }
      }
    };
    for (int z = middle[2] - r; z <= middle[2] + r; ++z) {
      for (int y = middle[1] - r; y <= middle[1] + r; ++y) {
        const bool whole = std::abs(z - middle[2]) == r || std::abs(y - middle[1]) == r;
        row(y, z, middle[0] - r, whole ? 1 : std::max(1, 2 * r));
      }
    }
  }
}

double MeshDistance::to(const Point3& point) const {
  double best = std::numeric_limits<double>::infinity();
  impl_->search(point, best,
                [&](std::uint32_t, double distance) { best = std::min(best, distance); });
  return std::sqrt(best);
}

std::optional<NearestPlace> MeshDistance::nearest(const Point3& point, double most_mm) const {
  const Impl& s = *impl_;
  NearestPlace found;
  double best = most_mm * most_mm, face_on = -1;
  bool any = false;
  s.search(point, best, [&](std::uint32_t triangle, double distance) {
    // Triangles that meet at the nearest point are equally far to some digits.
    if (distance > best * (1 + 1e-9) + 1e-24) return;
    const Impl::Corners t = s.corners(triangle);
    const Point3 n = cross(minus(t.b, t.a), minus(t.c, t.a));
    const double length = std::sqrt(square(n));
    if (!(length > 0)) return;
    const Point3 at = on_triangle(point, t.a, t.b, t.c);
    const Point3 normal = along({}, n, 1 / length), off = minus(point, at);
    // Of those the one that is seen most from the front or from behind says which side it is.
    const double seen = std::abs(dot(off, normal)) / std::max(std::sqrt(distance), 1e-12);
    const bool nearer = !any || distance < best * (1 - 1e-9) - 1e-24;
    if (!nearer &&
        (seen < face_on - 1e-12 || (seen < face_on + 1e-12 && triangle >= found.triangle))) {
      return;
    }
    best = std::min(best, distance);
    any = true;
    face_on = seen;
    found = {at, normal, std::copysign(std::sqrt(distance), dot(off, normal)), triangle};
  });
  if (!any) return {};
  return found;
}

TriangleMesh on_plate(const TriangleMesh& mesh, const Printer& printer,
                      const std::optional<std::array<double, 2>>& center_mm) {
  Point3 low, high;
  low.fill(std::numeric_limits<double>::infinity());
  high.fill(-std::numeric_limits<double>::infinity());
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    if (!mesh.adds(i)) continue;
    for (const std::uint32_t v : mesh.triangles[i]) {
      for (std::size_t k = 0; k < 3; ++k) {
        low[k] = std::min(low[k], mesh.vertices.at(v)[k]);
        high[k] = std::max(high[k], mesh.vertices[v][k]);
      }
    }
  }
  const Grid plate = plate_grid(printer);
  const Point3 shift = {(center_mm ? (*center_mm)[0] : plate.width_px * plate.pixel_x_um / 2e3) -
                            0.5 * (low[0] + high[0]),
                        (center_mm ? (*center_mm)[1] : plate.height_px * plate.pixel_y_um / 2e3) -
                            0.5 * (low[1] + high[1]),
                        -low[2]};
  TriangleMesh placed = mesh;
  for (Point3& v : placed.vertices) v = along(v, shift, 1.0);
  return placed;
}

}  // namespace slicecorr
