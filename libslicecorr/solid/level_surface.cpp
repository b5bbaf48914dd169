// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "solid/level_surface.hpp"

#include <algorithm>
#include <cmath>

#include "slicecorr/units.hpp"
#include "support/numbers/bracket.hpp"

namespace slicecorr::detail {

namespace {

/// A vertex keeps this share of its edge away from the ends: those of different edges never fall
/// together, so that no triangle is without area. A thousandth of a pixel or layer.
constexpr double kMargin = 1.0 / 1024;

/// The corners of the tetrahedra, and whether their order is right-handed as x, y (up), z.
struct Tetrahedron {
  int corner[4];
  bool right_handed;
};
// The row axis runs against y: even orders of the axes are left-handed.
constexpr Tetrahedron kTetrahedra[6] = {{{0, 1, 3, 7}, false}, {{0, 2, 6, 7}, false},
                                        {{0, 4, 5, 7}, false}, {{0, 2, 3, 7}, true},
                                        {{0, 1, 5, 7}, true},  {{0, 4, 6, 7}, true}};

/// Root in [0, 1] of a function whose values at the ends have different signs.
template <typename Function>
double root_of(const Function& excess, double at_low, double at_high) {
  FalsePosition root{0, 1, at_low, at_high};
  double d = 0.5;
  for (int i = 0; i < 60 && root.high - root.low > 1e-6; ++i) {
    d = root.chord();
    const double value = excess(d);
    if (std::abs(value) < 1e-9) break;
    root.take(d, value, (value > 0) == (root.at_high > 0));
  }
  return d;
}

}  // namespace

struct LevelSurface::Cell {
  int column = 0, row = 0, layer = 0;
  unsigned inside = 0;  ///< bit c: corner c has a dose of at least 1
  double dose[8];
  double phi[4], below[4];  ///< of the four columns
  Inside kind = Inside::plain;
  std::uint64_t known = 0;  ///< bit 8 a + b: the vertex on edge a, b is in `place`
  std::array<float, 3> place[64];
};

LevelSurface::LevelSurface(const CureModel& model, std::vector<double> x_mm,
                           std::vector<double> y_mm, Sink triangle, VertexSink vertex)
    : model_(model),
      x_(std::move(x_mm)),
      y_(std::move(y_mm)),
      triangle_(std::move(triangle)),
      vertex_(std::move(vertex)),
      inside_below_(x_.size() * y_.size()),
      inside_above_(inside_below_.size()) {}

/// Share of the way from corner a to corner b at which the dose is 1.
double LevelSurface::crossing(const Cell& cell, int a, int b) const {
  const double da = cell.dose[a], db = cell.dose[b];
  if (((a ^ b) & 4) == 0) return (1.0 - da) / (db - da);
  // Through a layer: d slices above node n + 1 the dose is the mean of the two columns' closed
  // forms, weighted by the distance to them.
  const int from = a & 3, to = b & 3;
  if (cell.kind == Inside::flat) return (1.0 - da) / (db - da);
  if (cell.kind == Inside::logarithmic) {
    const auto along = [&](int column, double d) {
      const double lower = cell.dose[column + 4], upper = cell.dose[column];
      // Without light there is no logarithm.
      if (!(lower > 0 && upper > 0)) return lower + d * (upper - lower);
      return lower * std::exp(d * std::log(upper / lower));
    };
    const double lower = cell.dose[to + 4], upper = cell.dose[from];
    if (from == to && lower > 0 && upper > 0) {
      return 1.0 - std::log(lower) / std::log(lower / upper);
    }
    return 1.0 -
           root_of([&](double d) { return d * along(from, d) + (1.0 - d) * along(to, d) - 1.0; },
                   db - 1.0, da - 1.0);
  }
  const double phi_a = cell.phi[from], phi_b = cell.phi[to];
  const double below_a = cell.below[from], below_b = cell.below[to];
  const double eta = model_.eta_of(cell.layer);
  if (phi_a == phi_b && below_a == below_b) return 1.0 - model_.crossing(phi_b, below_b, eta);
  const auto excess = [&](double d) {
    const double left = std::exp(-d * eta * units::kLn10);
    return d * (phi_a + (below_a - phi_a) * left) + (1.0 - d) * (phi_b + (below_b - phi_b) * left) -
           1.0;
  };
  return 1.0 - root_of(excess, db - 1.0, da - 1.0);
}

std::array<float, 3> LevelSurface::vertex(Cell& cell, int a, int b) {
  if (a > b) std::swap(a, b);
  const int key = 8 * a + b;
  auto& place = cell.place[key];
  if ((cell.known >> key & 1) != 0) return place;
  cell.known |= std::uint64_t{1} << key;
  const double t = std::clamp(crossing(cell, a, b), kMargin, 1.0 - kMargin);
  const auto between = [t](double p, double q) { return p == q ? p : p + t * (q - p); };
  const auto at = [](const std::vector<double>& v, int i) {
    return v[static_cast<std::size_t>(i)];
  };
  const double layer_mm = model_.layer_um * 1e-3;
  const Point3 p = {
      between(at(x_, cell.column + (a & 1)), at(x_, cell.column + (b & 1))),
      between(at(y_, cell.row + (a >> 1 & 1)), at(y_, cell.row + (b >> 1 & 1))),
      cell.kind == Inside::flat
          ? model_.depth(cell.layer) * layer_mm
          : model_.depth(between(cell.layer + (a >> 2 & 1), cell.layer + (b >> 2 & 1))) * layer_mm};
  place = {static_cast<float>(p[0]), static_cast<float>(p[1]), static_cast<float>(p[2])};
  // Each edge begins in corner 0 of one cell only.
  if (a == 0 && vertex_) vertex_(p);
  return place;
}

void LevelSurface::tetrahedra(Cell& cell) {
  const auto give = [&](const std::array<float, 3>& p, const std::array<float, 3>& q,
                        const std::array<float, 3>& r) {
    // Far from the origin floats may be too coarse to tell corners apart. What collapses is left
    // out; its neighbours then share the remaining edge.
    if (p != q && q != r && r != p) triangle_({p, q, r});
  };
  for (const Tetrahedron& t : kTetrahedra) {
    int in[4], out[4], ins = 0, outs = 0;
    // An even number of exchanges keeps the handedness.
    bool even = t.right_handed;
    for (int i = 0; i < 4; ++i) {
      if ((cell.inside >> t.corner[i] & 1) != 0) {
        even ^= (outs & 1) != 0;
        in[ins++] = t.corner[i];
      } else {
        out[outs++] = t.corner[i];
      }
    }
    if (ins == 0 || outs == 0) continue;
    // In the order inside, outside, of right-handed corners; else two corners change places.
    if (ins == 1) {
      if (!even) std::swap(out[0], out[1]);
      give(vertex(cell, in[0], out[0]), vertex(cell, in[0], out[1]), vertex(cell, in[0], out[2]));
    } else if (ins == 3) {
      if (!even) std::swap(in[0], in[1]);
      give(vertex(cell, in[0], out[0]), vertex(cell, in[1], out[0]), vertex(cell, in[2], out[0]));
    } else {
      if (!even) std::swap(out[0], out[1]);
      const auto p = vertex(cell, in[0], out[0]), q = vertex(cell, in[0], out[1]);
      const auto r = vertex(cell, in[1], out[1]), s = vertex(cell, in[1], out[0]);
      give(p, q, r);
      give(p, r, s);
    }
  }
}

void LevelSurface::layer(int n, const double* phi, const double* below, const double* above) {
  cells(n, Inside::plain, phi, below, above);
}
void LevelSurface::layer(int n, const double* lower, const double* upper) {
  cells(n, Inside::logarithmic, nullptr, lower, upper);
}
void LevelSurface::jump(int node, const double* below, const double* above) {
  cells(node, Inside::flat, nullptr, below, above);
}

void LevelSurface::cells(int n, Inside kind, const double* phi, const double* below,
                         const double* above) {
  const std::size_t width = x_.size();
  std::uint8_t any = 0;
  for (std::size_t i = 0; i < inside_below_.size(); ++i) {
    inside_below_[i] = below[i] >= 1.0;
    inside_above_[i] = above[i] >= 1.0;
    any |= inside_below_[i] | inside_above_[i];
  }
  if (!any) return;
  Cell cell;
  cell.layer = n;
  cell.kind = kind;
  for (std::size_t row = 0; row + 1 < y_.size(); ++row) {
    for (std::size_t x = 0; x + 1 < width; ++x) {
      const std::size_t at[4] = {row * width + x, row * width + x + 1, (row + 1) * width + x,
                                 (row + 1) * width + x + 1};
      unsigned inside = 0;
      for (unsigned c = 0; c < 4; ++c) {
        inside |= static_cast<unsigned>(inside_above_[at[c]]) << c;
        inside |= static_cast<unsigned>(inside_below_[at[c]]) << (c + 4);
      }
      if (inside == 0 || inside == 255) continue;
      cell.column = static_cast<int>(x);
      cell.row = static_cast<int>(row);
      cell.inside = inside;
      cell.known = 0;
      for (std::size_t c = 0; c < 4; ++c) {
        cell.phi[c] = phi ? phi[at[c]] : 0.0;
        cell.below[c] = below[at[c]];
        cell.dose[c] = above[at[c]];
        cell.dose[c + 4] = below[at[c]];
      }
      tetrahedra(cell);
    }
  }
}

void LevelSurface::platform(const double* dose) {
  const std::size_t width = x_.size();
  // The faces of the tetrahedra in this plane, seen from the platform.
  constexpr int faces[2][3] = {{0, 1, 3}, {0, 3, 2}};
  const VertexSink measured = std::move(vertex_);
  vertex_ = nullptr;
  Cell cell;
  for (std::size_t row = 0; row + 1 < y_.size(); ++row) {
    for (std::size_t x = 0; x + 1 < width; ++x) {
      cell.column = static_cast<int>(x);
      cell.row = static_cast<int>(row);
      cell.inside = 0;
      cell.known = 0;
      for (std::size_t c = 0; c < 4; ++c) {
        cell.dose[c] = dose[(row + (c >> 1)) * width + x + (c & 1)];
        if (cell.dose[c] >= 1.0) cell.inside |= 1U << c;
      }
      if (cell.inside == 0) continue;
      for (const auto& face : faces) {
        std::array<float, 3> polygon[4];
        int corners = 0;
        for (int i = 0; i < 3; ++i) {
          const int a = face[i], b = face[(i + 1) % 3];
          const bool in_a = (cell.inside >> a & 1) != 0, in_b = (cell.inside >> b & 1) != 0;
          if (in_a) {
            polygon[corners++] = {static_cast<float>(x_[x + static_cast<std::size_t>(a & 1)]),
                                  static_cast<float>(y_[row + static_cast<std::size_t>(a >> 1)]),
                                  0.0F};
          }
          if (in_a != in_b) polygon[corners++] = vertex(cell, a, b);
        }
        for (int i = 2; i < corners; ++i) {
          if (polygon[0] != polygon[i - 1] && polygon[i - 1] != polygon[i] &&
              polygon[i] != polygon[0]) {
            triangle_({polygon[0], polygon[i - 1], polygon[i]});
          }
        }
      }
    }
  }
  vertex_ = measured;
}

}  // namespace slicecorr::detail
