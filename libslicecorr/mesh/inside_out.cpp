// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "mesh/inside_out.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>

namespace slicecorr::detail {

namespace {

constexpr std::size_t kDirections = 6;

/// What is known of a connected body.
struct Shell {
  double six_volumes = 0;
  /// Its outermost vertices, downwards and upwards along x, y and z.
  std::array<Point3, kDirections> outermost{};
  bool empty = true;
  /// Shells around each of these vertices, rising.
  std::array<std::vector<std::uint32_t>, kDirections> around;

  bool is_outer() const {
    return std::ranges::any_of(around, [](const auto& of) { return of.empty(); });
  }
  bool lies_in(std::uint32_t shell) const {
    return std::ranges::all_of(
        around, [&](const auto& of) { return std::ranges::binary_search(of, shell); });
  }
};

/// Triangles by where they lie in y and z, for rays along x.
class Rays {
 public:
  Rays(const TriangleMesh& mesh, const std::vector<std::uint32_t>& shell_of)
      : mesh_(mesh), shell_of_(shell_of) {
    low_ = high_ = mesh.vertices[mesh.triangles.front()[0]];
    for (const auto& corners : mesh.triangles) {
      for (const std::uint32_t v : corners) {
        for (std::size_t k = 0; k < 3; ++k) {
          low_[k] = std::min(low_[k], mesh.vertices[v][k]);
          high_[k] = std::max(high_[k], mesh.vertices[v][k]);
        }
      }
    }
    const double side = std::sqrt(static_cast<double>(mesh.triangles.size()));
    cells_ = static_cast<std::size_t>(std::clamp(side, 1.0, 2048.0));
    // Large triangles lie in many cells: then there are fewer cells.
    while (cells_ > 1 && entries() > 16 * mesh.triangles.size() + 4096) cells_ /= 2;
    first_.assign(cells_ * cells_ + 1, 0);
    each_cell([&](std::size_t cell, std::size_t) { ++first_[cell + 1]; });
    std::partial_sum(first_.begin(), first_.end(), first_.begin());
    triangles_.resize(first_.back());
    std::vector<std::size_t> next(first_.begin(), first_.end() - 1);
    each_cell([&](std::size_t cell, std::size_t t) {
      triangles_[next[cell]++] = static_cast<std::uint32_t>(t);
    });
  }

  /// The shells other than `own` whose winding at a point is not 0.
  std::vector<std::uint32_t> around(const Point3& point, std::uint32_t own) const {
    // Aside by as little as keeps rays from edges and corners, most of which lie on round numbers.
    Point3 p = point;
    p[1] += 3.7e-9 * std::max(1e-3, high_[1] - low_[1]);
    p[2] += 2.3e-9 * std::max(1e-3, high_[2] - low_[2]);
    std::vector<std::pair<std::uint32_t, int>> windings;
    const std::size_t cell = cell_of(p[1], 1) * cells_ + cell_of(p[2], 2);
    for (std::size_t i = first_[cell]; i < first_[cell + 1]; ++i) {
      const std::uint32_t t = triangles_[i], shell = shell_of_[t];
      if (shell == own) continue;
      const int passes = crossing(p, t);
      if (passes == 0) continue;
      const auto at = std::ranges::find(windings, shell, &std::pair<std::uint32_t, int>::first);
      if (at == windings.end()) {
        windings.emplace_back(shell, passes);
      } else {
        at->second += passes;
      }
    }
    std::vector<std::uint32_t> found;
    for (const auto& [shell, winding] : windings) {
      if (winding != 0) found.push_back(shell);
    }
    std::ranges::sort(found);
    return found;
  }

 private:
  std::size_t cell_of(double value, std::size_t axis) const {
    const double size = high_[axis] - low_[axis];
    if (!(size > 0)) return 0;
    const double at = (value - low_[axis]) / size * static_cast<double>(cells_);
    return static_cast<std::size_t>(std::clamp(at, 0.0, static_cast<double>(cells_ - 1)));
  }
  struct Cells {
    std::size_t y0, y1, z0, z1;
  };
  Cells cells_of(std::size_t t) const {
    const auto& corners = mesh_.triangles[t];
    const auto range = [&](std::size_t axis) {
      const double a = mesh_.vertices[corners[0]][axis], b = mesh_.vertices[corners[1]][axis],
                   c = mesh_.vertices[corners[2]][axis];
      return std::pair(cell_of(std::min({a, b, c}), axis), cell_of(std::max({a, b, c}), axis));
    };
    const auto [y0, y1] = range(1);
    const auto [z0, z1] = range(2);
    return {y0, y1, z0, z1};
  }
  std::size_t entries() const {
    std::size_t count = 0;
    for (std::size_t t = 0; t < mesh_.triangles.size(); ++t) {
      const Cells c = cells_of(t);
      count += (c.y1 - c.y0 + 1) * (c.z1 - c.z0 + 1);
    }
    return count;
  }
  template <class Take>
  void each_cell(const Take& take) const {
    for (std::size_t t = 0; t < mesh_.triangles.size(); ++t) {
      const Cells c = cells_of(t);
      for (std::size_t y = c.y0; y <= c.y1; ++y) {
        for (std::size_t z = c.z0; z <= c.z1; ++z) take(y * cells_ + z, t);
      }
    }
  }
  /// Whether a ray from `p` towards growing x passes the triangle, outwards (1) or inwards (-1).
  int crossing(const Point3& p, std::size_t t) const {
    const auto& corners = mesh_.triangles[t];
    const Point3 &a = mesh_.vertices[corners[0]], &b = mesh_.vertices[corners[1]],
                 &c = mesh_.vertices[corners[2]];
    if (std::max({a[0], b[0], c[0]}) < p[0]) return 0;
    const auto turn = [&](const Point3& u, const Point3& v) {
      return (u[1] - p[1]) * (v[2] - p[2]) - (u[2] - p[2]) * (v[1] - p[1]);
    };
    const double ab = turn(a, b), bc = turn(b, c), ca = turn(c, a);
    const bool left = ab > 0 && bc > 0 && ca > 0, right = ab < 0 && bc < 0 && ca < 0;
    if (!left && !right) return 0;
    const double x = (bc * a[0] + ca * b[0] + ab * c[0]) / (ab + bc + ca);
    return x <= p[0] ? 0 : left ? 1 : -1;
  }

  const TriangleMesh& mesh_;
  const std::vector<std::uint32_t>& shell_of_;
  Point3 low_{}, high_{};
  std::size_t cells_ = 1;
  std::vector<std::size_t> first_;
  std::vector<std::uint32_t> triangles_;
};

/// The shells, with their volumes and outermost vertices; `shell_of`: of each triangle.
std::vector<Shell> shells_of(const TriangleMesh& mesh,
                             const std::function<std::uint32_t(std::size_t)>& body_of,
                             std::vector<std::uint32_t>& shell_of) {
  constexpr std::uint32_t none = std::numeric_limits<std::uint32_t>::max();
  std::vector<std::uint32_t> number(mesh.triangles.size(), none);
  std::vector<Shell> shells;
  shell_of.resize(mesh.triangles.size());
  const Point3 apex = mesh.vertices[mesh.triangles.front()[0]];
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    std::uint32_t& own = number[body_of(t)];
    if (own == none) {
      own = static_cast<std::uint32_t>(shells.size());
      shells.emplace_back();
    }
    shell_of[t] = own;
    Shell& shell = shells[own];
    std::array<Point3, 3> corner{};
    for (std::size_t i = 0; i < 3; ++i) {
      const Point3& p = corner[i] = mesh.vertices[mesh.triangles[t][i]];
      for (std::size_t k = 0; k < kDirections; ++k) {
        Point3& most = shell.outermost[k];
        const bool further = k % 2 == 0 ? p[k / 2] < most[k / 2] : p[k / 2] > most[k / 2];
        if (shell.empty || further) most = p;
      }
      shell.empty = false;
    }
    for (Point3& p : corner) {
      for (std::size_t k = 0; k < 3; ++k) p[k] -= apex[k];
    }
    const auto& [a, b, c] = corner;
    shell.six_volumes += a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) +
                         a[2] * (b[0] * c[1] - b[1] * c[0]);
  }
  return shells;
}

}  // namespace

InsideOut inside_out(const TriangleMesh& mesh,
                     const std::function<std::uint32_t(std::size_t triangle)>& body_of) {
  InsideOut found;
  if (mesh.triangles.empty()) return found;
  std::vector<std::uint32_t> shell_of;
  std::vector<Shell> shells = shells_of(mesh, body_of, shell_of);
  const auto is_inverted = [](const Shell& s) { return s.six_volumes < 0; };
  const auto stands = [](const Shell& s) { return s.six_volumes > 0; };
  if (std::ranges::none_of(shells, is_inverted) || std::ranges::none_of(shells, stands)) {
    return found;
  }
  const Rays rays(mesh, shell_of);
  for (std::uint32_t own = 0; own < shells.size(); ++own) {
    for (std::size_t k = 0; k < kDirections; ++k) {
      // A little inwards: a hollow whose end lies in a face of its part is one that opens there.
      Point3 point = shells[own].outermost[k];
      const std::size_t axis = k / 2;
      const double size =
          shells[own].outermost[2 * axis + 1][axis] - shells[own].outermost[2 * axis][axis];
      point[axis] += (k % 2 == 0 ? 1e-6 : -1e-6) * size;
      shells[own].around[k] = rays.around(point, own);
    }
  }
  std::vector<std::uint32_t> turned, stay;
  for (std::uint32_t own = 0; own < shells.size(); ++own) {
    if (!shells[own].is_outer()) continue;
    if (is_inverted(shells[own])) turned.push_back(own);
    if (stands(shells[own])) stay.push_back(own);
  }
  if (turned.empty() || stay.empty()) return found;
  found.bodies = turned.size();
  std::vector<bool> turns(shells.size(), false);
  for (std::uint32_t own = 0; own < shells.size(); ++own) {
    const auto holds = [&](std::uint32_t outer) { return shells[own].lies_in(outer); };
    turns[own] = std::ranges::binary_search(turned, own) ||
                 (std::ranges::any_of(turned, holds) && std::ranges::none_of(stay, holds));
  }
  for (std::size_t t = 0; t < shell_of.size(); ++t) {
    if (turns[shell_of[t]]) found.triangles.push_back(static_cast<std::uint32_t>(t));
  }
  return found;
}

}  // namespace slicecorr::detail
