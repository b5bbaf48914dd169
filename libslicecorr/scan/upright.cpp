// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "scan/upright.hpp"

#include "scan/vectors.hpp"

namespace slicecorr::detail {

namespace {

/// Calls `visit` with the index of each square that a triangle's box covers.
template <class Column, class Visit>
void squares_of(const TriangleMesh& mesh, std::size_t triangle, int across, const Column& column,
                const Visit& visit) {
  PointBox box;
  for (const std::uint32_t v : mesh.triangles[triangle]) box.add(mesh.vertices[v]);
  for (int y = column(box.low[1], 1); y <= column(box.high[1], 1); ++y) {
    for (int x = column(box.low[0], 0); x <= column(box.high[0], 0); ++x) {
      visit(static_cast<std::size_t>(y) * static_cast<std::size_t>(across) +
            static_cast<std::size_t>(x));
    }
  }
}

}  // namespace

UprightLines::UprightLines(const TriangleMesh& mesh) : mesh_(mesh) {
  const PointBox box(mesh.vertices);
  low_ = box.low;
  const double x = box.high[0] - low_[0], y = box.high[1] - low_[1];
  const double squares =
      std::clamp(std::sqrt(static_cast<double>(mesh.triangles.size())), 4.0, 512.0);
  side_ = std::max({x, y, 1e-9}) / squares;
  across_ = static_cast<int>(x / side_) + 1;
  along_ = static_cast<int>(y / side_) + 1;
  const auto columns = [this](double v, std::size_t axis) { return column(v, axis); };
  begin_.assign(static_cast<std::size_t>(across_) * static_cast<std::size_t>(along_) + 1, 0);
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    squares_of(mesh, i, across_, columns, [&](std::size_t square) { ++begin_[square + 1]; });
  }
  for (std::size_t i = 1; i < begin_.size(); ++i) begin_[i] += begin_[i - 1];
  list_.resize(begin_.back());
  std::vector<std::uint32_t> at(begin_.begin(), begin_.end() - 1);
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    squares_of(mesh, i, across_, columns,
               [&](std::size_t square) { list_[at[square]++] = static_cast<std::uint32_t>(i); });
  }
}

int UprightLines::column(double v, std::size_t axis) const {
  const int count = axis == 0 ? across_ : along_;
  return static_cast<int>(std::clamp(std::floor((v - low_[axis]) / side_), 0.0, count - 1.0));
}

std::optional<double> UprightLines::below(const Point3& from) const {
  std::optional<double> best;
  const std::size_t square =
      static_cast<std::size_t>(column(from[1], 1)) * static_cast<std::size_t>(across_) +
      static_cast<std::size_t>(column(from[0], 0));
  for (std::uint32_t k = begin_[square]; k < begin_[square + 1]; ++k) {
    const auto& t = mesh_.triangles[list_[k]];
    const Point3 &a = mesh_.vertices[t[0]], &b = mesh_.vertices[t[1]], &c = mesh_.vertices[t[2]];
    const double det = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    if (det == 0) continue;
    const double x = from[0] - a[0], y = from[1] - a[1];
    const double u = (x * (c[1] - a[1]) - y * (c[0] - a[0])) / det;
    const double v = (y * (b[0] - a[0]) - x * (b[1] - a[1])) / det;
    if (u < 0 || v < 0 || u + v > 1) continue;
    const double z = a[2] + u * (b[2] - a[2]) + v * (c[2] - a[2]);
    if (z < from[2] && (!best || z > *best)) best = z;
  }
  return best;
}

}  // namespace slicecorr::detail
