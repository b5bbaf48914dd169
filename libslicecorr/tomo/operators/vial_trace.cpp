// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/operators/vial_trace.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>

#include "slicecorr/vial.hpp"
#include "slicecorr/vial_outline.hpp"
#include "tomo/operators/flat_points.hpp"

namespace slicecorr::tomo::detail {

namespace {

constexpr double kNotMet = std::numeric_limits<double>::infinity();
/// Faces that a ray has just left are not met again, mm.
constexpr double kLeft = 1e-9;
/// Pieces of a ray that are followed; each rod adds one.
constexpr std::size_t kMostPieces = 16;

}  // namespace

/// Where a ray meets something, at `way` from where it is: the normal points against it.
struct VialTrace::Meeting {
  double way = kNotMet;
  FlatPoint normal;
  int id = 0;
  explicit operator bool() const { return way < kNotMet; }
};

/// A ray on its way.
struct VialTrace::Travelling {
  FlatPoint at, along;
  double n_outside = 1, kz = 0;
  double rise_mm = 0;
  double s = 1, p = 1;  ///< power by polarisation
  std::uint64_t history = 1469598103934665603U;

  double power() const { return (s + p) / 2; }
  void passed(std::uint64_t what) { history = (history ^ (what + 1)) * 1099511628211U; }
  /// n', by which it is bent seen from above.
  double across(double n) const { return kz == 0 ? n : index_across(n, n_outside, kz); }
  void go(double way_mm, double n) {
    at = plus(at, along, way_mm);
    rise_mm += way_mm / across(n);
  }
  /// Bent by a face; false: it is reflected as a whole.
  bool refract(const FlatPoint& normal, double n, double n_after) {
    const double flat = -dot(along, normal), before = across(n), behind = across(n_after);
    const double ratio = before / behind, left = 1 - ratio * ratio * (1 - flat * flat);
    if (!(left > 0)) return false;
    const double flat_after = std::sqrt(left);
    // Angles of incidence are those of the ray as it rises.
    const double cosine = flat * before / n, after = flat_after * behind / n_after;
    const double rs = (n * cosine - n_after * after) / (n * cosine + n_after * after),
                 rp = (n_after * cosine - n * after) / (n_after * cosine + n * after);
    s *= 1 - rs * rs;
    p *= 1 - rp * rp;
    along = to_length_1(
        plus({ratio * along.x_mm, ratio * along.y_mm}, normal, ratio * flat - flat_after));
    return true;
  }
  void reflect(const FlatPoint& normal) {
    along = to_length_1(plus(along, normal, -2 * dot(along, normal)));
  }
};

VialTrace::Face VialTrace::face_of(const std::vector<FlatPoint>& corners, double n_behind) {
  Face face;
  face.corners = corners;
  face.n_behind = n_behind;
  const std::size_t n = corners.size();
  std::vector<FlatPoint> of_edge(n);
  for (std::size_t i = 0; i < n; ++i) {
    const FlatPoint d = to_length_1(plus(corners[(i + 1) % n], corners[i], -1));
    of_edge[i] = {d.y_mm, -d.x_mm};
  }
  const double smooth = std::cos(kSmoothCornerDeg * std::numbers::pi / 180);
  std::vector<bool> curved(n);  // at the corner where an edge begins
  for (std::size_t i = 0; i < n; ++i) {
    curved[i] = dot(of_edge[(i + n - 1) % n], of_edge[i]) > smooth;
  }
  // On a circle chords share a corner's turn by their lengths; a much longer edge is a flat side, which the
  // curve goes on from.
  const auto of_corner = [&](std::size_t i) {
    constexpr double kFlat = 4;
    const std::size_t before = (i + n - 1) % n;
    const FlatPoint a = plus(corners[i], corners[before], -1),
                    b = plus(corners[(i + 1) % n], corners[i], -1);
    const double la = std::hypot(a.x_mm, a.y_mm), lb = std::hypot(b.x_mm, b.y_mm);
    if (la > kFlat * lb) return of_edge[before];
    if (lb > kFlat * la) return of_edge[i];
    return to_length_1(
        plus({lb * of_edge[before].x_mm, lb * of_edge[before].y_mm}, of_edge[i], la));
  };
  // Numbers of curves begin anew at sharp corners; without any all is one.
  const auto sharp = std::find(curved.begin(), curved.end(), false);
  const auto first = static_cast<std::size_t>(sharp == curved.end() ? 0 : sharp - curved.begin());
  face.normals.resize(2 * n);
  face.curves.resize(n);
  int curve = 0;
  for (std::size_t k = 0; k < n; ++k) {
    const std::size_t i = (first + k) % n, next = (i + 1) % n;
    if (k > 0 && !curved[i]) ++curve;
    face.curves[i] = curve;
    face.normals[2 * i] = curved[i] ? of_corner(i) : of_edge[i];
    face.normals[2 * i + 1] = curved[next] ? of_corner(next) : of_edge[i];
  }
  return face;
}

VialTrace::VialTrace(const Vial& vial, double n_resin, double alpha_per_mm)
    : rods_(vial.rods), n_outside_(vial.n_outside), n_resin_(n_resin), alpha_(alpha_per_mm) {
  if (vial.shape == VialShape::round) {
    Vial walls = vial;
    walls.rods.clear();
    for (const VialFace& f : faces_of(walls, n_resin)) {
      Face face;
      face.radius_mm = f.radius_mm;
      face.n_behind = f.n_behind;
      faces_.push_back(face);
    }
  } else {
    faces_.push_back(face_of(outer_outline(vial), vial.n_wall));
    faces_.push_back(face_of(inner_outline(vial), n_resin));
  }
  outside_mm_ = vial.outside_mm();
}

VialTrace::Meeting VialTrace::meet(const Face& face, const FlatPoint& from, const FlatPoint& along,
                                   bool inwards) {
  if (face.radius_mm > 0) return meet(Rod{0, 0, 2 * face.radius_mm}, from, along, inwards);
  Meeting met;
  const std::size_t n = face.corners.size();
  for (std::size_t i = 0; i < n; ++i) {
    const FlatPoint &a = face.corners[i], &b = face.corners[i + 1 < n ? i + 1 : 0];
    const FlatPoint edge = plus(b, a, -1), to = plus(a, from, -1);
    const double det = along.x_mm * edge.y_mm - along.y_mm * edge.x_mm;
    // Edges go counterclockwise: inwards light crosses them from the right to the left.
    if (inwards ? !(det < 0) : !(det > 0)) continue;
    const double share = (to.x_mm * along.y_mm - to.y_mm * along.x_mm) / det;
    if (share < 0 || share > 1) continue;
    const double way = (to.x_mm * edge.y_mm - to.y_mm * edge.x_mm) / det;
    if (!(way > kLeft) || way >= met.way) continue;
    met.way = way;
    const FlatPoint &na = face.normals[2 * i], &nb = face.normals[2 * i + 1];
    met.normal =
        to_length_1({na.x_mm + share * (nb.x_mm - na.x_mm), na.y_mm + share * (nb.y_mm - na.y_mm)});
    met.id = face.curves[i];
  }
  if (met && !inwards) met.normal = {-met.normal.x_mm, -met.normal.y_mm};
  // On a curve normals between edges may look away from grazing light.
  if (met && inwards && !(dot(met.normal, along) < 0)) return {};
  return met;
}

VialTrace::Meeting VialTrace::meet(const Rod& rod, const FlatPoint& from, const FlatPoint& along,
                                   bool inwards) {
  const double r = rod.diameter_mm / 2;
  const FlatPoint to = plus(from, {rod.x_mm, rod.y_mm}, -1);
  const double b = dot(to, along), beside = to.x_mm * along.y_mm - to.y_mm * along.x_mm;
  const double square = r * r - beside * beside;
  if (!(square > 0)) return {};
  const double way = inwards ? -b - std::sqrt(square) : -b + std::sqrt(square);
  if (!(way > kLeft)) return {};
  const FlatPoint out = to_length_1(plus(to, along, way));
  return {way, inwards ? out : FlatPoint{-out.x_mm, -out.y_mm}, 0};
}

void VialTrace::in_resin(Travelling& now, TracedRay& ray) const {
  bool mirrored = false;
  double dimmed_mm = 0;
  while (ray.pieces.size() < kMostPieces) {
    Meeting met = meet(faces_.back(), now.at, now.along, false);
    int rod = -1;
    for (std::size_t i = 0; i < rods_.size(); ++i) {
      const Meeting here = meet(rods_[i], now.at, now.along, true);
      if (here.way >= met.way) continue;
      met = here;
      rod = static_cast<int>(i);
    }
    // Along a wall that it has just come in by there is no way.
    if (!met) return;
    TracedPiece piece{now.at, now.along, met.way, now.power(), dimmed_mm, now.rise_mm};
    piece.power *= std::exp(-alpha_ * ray.stretch * dimmed_mm);
    ray.pieces.push_back(piece);
    dimmed_mm += met.way;
    if (rod < 0) return;
    now.go(met.way, n_resin_);
    const Rod& passed = rods_[static_cast<std::size_t>(rod)];
    now.passed(1000 + static_cast<std::uint64_t>(rod));
    if (passed.n == 0) {
      if (mirrored || passed.reflects == 0) return;
      mirrored = true;
      now.reflect(met.normal);
      now.s *= passed.reflects;
      now.p *= passed.reflects;
      continue;
    }
    if (!now.refract(met.normal, n_resin_, passed.n)) {
      now.passed(2);
      now.reflect(met.normal);
      continue;
    }
    const Meeting out = meet(passed, now.at, now.along, false);
    if (!out) return;
    now.go(out.way, passed.n);
    if (!now.refract(out.normal, passed.n, n_resin_)) return;
  }
}

void VialTrace::trace(double th, const TracedLine& line, TracedRay& ray) const {
  // Lines are followed from well outside of the vial, at 60 degrees to +Y at most.
  const double c = std::cos(th), s = std::sin(th), back = 4 * outside_mm_;
  const double right = std::sin(line.angle_rad), ahead = std::cos(line.angle_rad);
  const double x = line.x_mm - back * right, y = -back * ahead;
  Travelling now{{x * c - y * s, x * s + y * c}, {right * c - ahead * s, right * s + ahead * c}};
  now.n_outside = n_outside_;
  now.kz = line.kz;
  now.rise_mm = -back / now.across(n_outside_);
  ray.pieces.clear();
  ray.reflected = false;
  ray.rise_per_mm = 1 / now.across(n_resin_);
  ray.stretch = n_resin_ * ray.rise_per_mm;
  trace(now, ray);
}

void VialTrace::trace(Travelling& now, TracedRay& ray) const {
  double n = n_outside_;
  for (std::size_t k = 0; k < faces_.size(); ++k) {
    const Meeting met = meet(faces_[k], now.at, now.along, true);
    now.passed(met ? 2 + static_cast<std::uint64_t>(met.id) : 1);
    ray.history = now.history;
    if (!met) return;
    now.go(met.way, n);
    if (!now.refract(met.normal, n, faces_[k].n_behind)) {
      ray.reflected = true;
      now.passed(0);
      ray.history = now.history;
      return;
    }
    n = faces_[k].n_behind;
  }
  in_resin(now, ray);
  ray.history = now.history;
}

}  // namespace slicecorr::tomo::detail
