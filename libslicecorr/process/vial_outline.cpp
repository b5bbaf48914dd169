// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/vial_outline.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace slicecorr {

namespace {

constexpr int kChordsOfCorner = 24;

double cross(const FlatPoint& a, const FlatPoint& b) { return a.x_mm * b.y_mm - a.y_mm * b.x_mm; }
FlatPoint minus(const FlatPoint& a, const FlatPoint& b) {
  return {a.x_mm - b.x_mm, a.y_mm - b.y_mm};
}
double length(const FlatPoint& a) { return std::hypot(a.x_mm, a.y_mm); }

const FlatPoint& after(const std::vector<FlatPoint>& corners, std::size_t i) {
  return corners[i + 1 < corners.size() ? i + 1 : 0];
}
const FlatPoint& before(const std::vector<FlatPoint>& corners, std::size_t i) {
  return corners[i > 0 ? i - 1 : corners.size() - 1];
}

/// Outwards from the edge that begins at a corner, of length 1.
FlatPoint outwards(const FlatPoint& from, const FlatPoint& to) {
  const FlatPoint d = minus(to, from);
  const double l = length(d);
  return {d.y_mm / l, -d.x_mm / l};
}

std::vector<FlatPoint> rounded_square(double side_mm, double corner_mm) {
  const double half = side_mm / 2 - corner_mm;
  std::vector<FlatPoint> corners;
  for (int quarter = 0; quarter < 4; ++quarter) {
    const double first = std::numbers::pi / 2 * quarter;
    const double mx = half * (quarter == 0 || quarter == 3 ? 1 : -1),
                 my = half * (quarter < 2 ? 1 : -1);
    const int chords = corner_mm > 0 ? kChordsOfCorner : 0;
    for (int k = 0; k <= chords; ++k) {
      const double at = first + (chords > 0 ? std::numbers::pi / 2 * k / chords : 0);
      corners.push_back({mx + corner_mm * std::cos(at), my + corner_mm * std::sin(at)});
    }
  }
  return corners;
}

std::vector<FlatPoint> counterclockwise(std::vector<FlatPoint> corners) {
  double twice_area = 0;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    twice_area += cross(corners[i], after(corners, i));
  }
  if (twice_area < 0) std::reverse(corners.begin(), corners.end());
  return corners;
}

/// Each edge moved inwards.
std::vector<FlatPoint> moved_inwards(const std::vector<FlatPoint>& corners, double by_mm) {
  std::vector<FlatPoint> inner;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const FlatPoint a = outwards(before(corners, i), corners[i]),
                    b = outwards(corners[i], after(corners, i));
    const double share = by_mm / (1 + a.x_mm * b.x_mm + a.y_mm * b.y_mm);
    inner.push_back(
        {corners[i].x_mm - share * (a.x_mm + b.x_mm), corners[i].y_mm - share * (a.y_mm + b.y_mm)});
  }
  return inner;
}

/// How far the nearest edge is from a place within; below 0 beyond one.
double within_mm(const std::vector<FlatPoint>& corners, const FlatPoint& place) {
  double least = 1e300;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const FlatPoint n = outwards(corners[i], after(corners, i)), d = minus(corners[i], place);
    least = std::min(least, d.x_mm * n.x_mm + d.y_mm * n.y_mm);
  }
  return least;
}

std::optional<WrongVial> wrong_corners(const Vial& v) {
  const std::vector<FlatPoint> outer = outer_outline(v);
  if (outer.size() < 3 || outer.size() > kMostCorners) {
    return WrongVial{"outline",
                     fmt::format("has {} corners; expected 3 to {}", outer.size(), kMostCorners)};
  }
  double turned = 0;
  for (std::size_t i = 0; i < outer.size(); ++i) {
    const FlatPoint in = minus(outer[i], before(outer, i)), out = minus(after(outer, i), outer[i]);
    const double a = length(in), b = length(out);
    if (!(a > 1e-9)) {
      return WrongVial{"outline", fmt::format("has two corners at ({:g}, {:g}) mm; expected each "
                                              "once",
                                              outer[i].x_mm, outer[i].y_mm)};
    }
    const double sine = cross(in, out) / (a * b);
    if (sine < -1e-9) {
      return WrongVial{
          "outline",
          fmt::format("turns inwards at ({:g}, {:g}) mm; expected an outline without dents, in "
                      "order around it: light that comes in twice is not counted",
                      outer[i].x_mm, outer[i].y_mm)};
    }
    turned += std::atan2(cross(in, out), in.x_mm * out.x_mm + in.y_mm * out.y_mm);
  }
  if (std::abs(turned - 2 * std::numbers::pi) > 1e-6) {
    return WrongVial{"outline", "goes around more than once; expected corners in order"};
  }
  const std::vector<FlatPoint> inner = inner_outline(v);
  for (std::size_t i = 0; i < inner.size(); ++i) {
    const FlatPoint was = minus(after(outer, i), outer[i]), is = minus(after(inner, i), inner[i]);
    if (was.x_mm * is.x_mm + was.y_mm * is.y_mm > 0) continue;
    return WrongVial{"wall_mm",
                     fmt::format("is {:g}, which leaves nothing of the side at ({:g}, {:g}) mm; "
                                 "expected a thinner wall, or fewer corners",
                                 v.wall_mm, outer[i].x_mm, outer[i].y_mm)};
  }
  if (!(within_mm(inner, {}) > 0)) {
    return WrongVial{"outline",
                     "has the axis of rotation, (0, 0), not in the resin; expected one "
                     "around it"};
  }
  return std::nullopt;
}

std::optional<WrongVial> wrong_rods(const Vial& v) {
  if (v.rods.size() > kMostRods) {
    return WrongVial{"glass_rods",
                     fmt::format("{} rods; expected at most {}", v.rods.size(), kMostRods)};
  }
  const std::vector<FlatPoint> inner = inner_outline(v);
  for (std::size_t i = 0; i < v.rods.size(); ++i) {
    const Rod& rod = v.rods[i];
    const char* key = rod.n > 0 ? "glass_rods" : "metal_rods";
    const FlatPoint at{rod.x_mm, rod.y_mm};
    const double room =
        v.shape == VialShape::round ? v.inner_mm - length(at) : within_mm(inner, at);
    if (!(rod.diameter_mm / 2 < room)) {
      return WrongVial{key, fmt::format("a rod of {:g} mm at ({:g}, {:g}) mm reaches into the "
                                        "wall; expected it in the resin",
                                        rod.diameter_mm, rod.x_mm, rod.y_mm)};
    }
    for (std::size_t j = 0; j < i; ++j) {
      const Rod& other = v.rods[j];
      if (length(minus(at, {other.x_mm, other.y_mm})) > (rod.diameter_mm + other.diameter_mm) / 2) {
        continue;
      }
      return WrongVial{key, fmt::format("rods at ({:g}, {:g}) and ({:g}, {:g}) mm meet; expected "
                                        "resin between them",
                                        rod.x_mm, rod.y_mm, other.x_mm, other.y_mm)};
    }
  }
  return std::nullopt;
}

}  // namespace

std::vector<FlatPoint> outer_outline(const Vial& v) {
  if (v.shape == VialShape::square) return rounded_square(v.side_mm, v.corner_mm);
  if (v.shape == VialShape::outline) return counterclockwise(v.outline);
  return {};
}

std::vector<FlatPoint> inner_outline(const Vial& v) {
  if (v.shape == VialShape::square) {
    return rounded_square(v.side_mm - 2 * v.wall_mm, std::max(0.0, v.corner_mm - v.wall_mm));
  }
  if (v.shape == VialShape::outline) return moved_inwards(outer_outline(v), v.wall_mm);
  return {};
}

void set_radii(Vial& v) {
  const auto farthest = [](const std::vector<FlatPoint>& corners) {
    double most = 0;
    for (const FlatPoint& c : corners) most = std::max(most, length(c));
    return most;
  };
  if (v.shape == VialShape::round) return;
  v.outer_mm = farthest(outer_outline(v));
  v.inner_mm = farthest(inner_outline(v));
}

std::optional<WrongVial> wrong_outline(const Vial& v) {
  if (v.shape == VialShape::square) {
    if (2 * v.wall_mm >= v.side_mm) {
      return WrongVial{"wall_mm", fmt::format("is {:g}; expected less than half of side_mm, {:g}",
                                              v.wall_mm, v.side_mm)};
    }
    if (2 * v.corner_mm >= v.side_mm) {
      return WrongVial{"corner_mm", fmt::format("is {:g}; expected less than half of side_mm, {:g}",
                                                v.corner_mm, v.side_mm)};
    }
  } else if (v.shape == VialShape::outline) {
    if (auto wrong = wrong_corners(v)) return wrong;
  }
  return wrong_rods(v);
}

ResinArea::ResinArea(const Vial& v) : corners_(inner_outline(v)), rods_(v.rods) {
  if (v.shape == VialShape::round) radius_mm_ = v.inner_mm;
  for (std::size_t i = 0; i < corners_.size(); ++i) {
    normals_.push_back(outwards(corners_[i], after(corners_, i)));
  }
}

double ResinArea::within_mm(const FlatPoint& place) const {
  double least = radius_mm_ > 0 ? radius_mm_ - length(place) : 1e300;
  for (std::size_t i = 0; i < corners_.size(); ++i) {
    const FlatPoint d = minus(corners_[i], place);
    least = std::min(least, d.x_mm * normals_[i].x_mm + d.y_mm * normals_[i].y_mm);
  }
  for (const Rod& rod : rods_) {
    least = std::min(least, length(minus(place, {rod.x_mm, rod.y_mm})) - rod.diameter_mm / 2);
  }
  return least;
}

std::vector<bool> beyond_walls(const Vial& v, int n, double voxel_mm) {
  std::vector<bool> beyond;
  if (v.shape == VialShape::round) return beyond;
  Vial walls = v;
  walls.rods.clear();
  const ResinArea area(walls);
  for (int y = 0; y < n; ++y) {
    for (int x = 0; x < n; ++x) {
      beyond.push_back(!area.has({(x - 0.5 * (n - 1)) * voxel_mm, (y - 0.5 * (n - 1)) * voxel_mm}));
    }
  }
  return beyond;
}

double nearest_wall_mm(const Vial& v) {
  return v.shape == VialShape::round ? v.inner_mm : within_mm(inner_outline(v), {});
}

const char* name_of(VialShape shape) {
  return shape == VialShape::square ? "square" : shape == VialShape::outline ? "outline" : "round";
}

}  // namespace slicecorr
