// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "mesh/shapes_3mf.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <set>
#include <stdexcept>
#include <utility>

#include "mesh/clip_to_box.hpp"

namespace slicecorr::detail {
namespace {

constexpr double kTurn = 2 * std::numbers::pi;

/// Corners of a circle of which polygons of the same area stray by at most `tolerance`: its corners
/// lie r π²/(3 n²) outside, its sides half of that inside.
int corners_of_circle(double radius, double tolerance) {
  const double n = std::numbers::pi * std::sqrt(radius / (3 * tolerance));
  return static_cast<int>(std::clamp(std::ceil(n), 8.0, 4096.0));
}

/// The same for a ball of meridians and half as many parallels, whose faces lie between
/// corners in both directions: r π²/n² from the corners to the middle of the faces, two thirds of it
/// inside.
int meridians_of_ball(double radius, double tolerance) {
  const double n = std::numbers::pi * std::sqrt(2 * radius / (3 * tolerance));
  return 2 * static_cast<int>(std::clamp(std::ceil(n / 2), 4.0, 2048.0));
}

/// The factor on the radius of a regular polygon that has the circle's area.
double same_area(int corners) { return std::sqrt(kTurn / (corners * std::sin(kTurn / corners))); }

Point3 plus(const Point3& a, const Point3& b, double factor) {
  return {a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]};
}

/// Two directions that with the unit vector `axis` make a right-handed frame.
std::pair<Point3, Point3> across(const Point3& axis) {
  std::size_t least = 0;
  for (std::size_t k = 1; k < 3; ++k) {
    if (std::abs(axis[k]) < std::abs(axis[least])) least = k;
  }
  Point3 u{};
  for (std::size_t k = 0; k < 3; ++k) u[k] = (k == least ? 1.0 : 0.0) - axis[least] * axis[k];
  const double length = std::hypot(u[0], u[1], u[2]);
  for (double& x : u) x /= length;
  const Point3 v{axis[1] * u[2] - axis[2] * u[1], axis[2] * u[0] - axis[0] * u[2],
                 axis[0] * u[1] - axis[1] * u[0]};
  return {u, v};
}

/// A body made of rings around an axis, one after the other along it.
class Rings {
 public:
  Rings(Bodies3mf& bodies, const Point3& axis, int corners) : bodies_(bodies), axis_(axis) {
    std::tie(u_, v_) = across(axis);
    for (int i = 0; i < corners; ++i) {
      const double angle = kTurn * i / corners;
      circle_.emplace_back(std::cos(angle), std::sin(angle));
    }
  }
  /// A ring's centre and radius; a radius of 0 makes a point.
  void add(const Point3& centre, double radius) {
    const auto begin = static_cast<std::uint32_t>(bodies_.vertices.size());
    const bool point = radius == 0;
    if (point) {
      bodies_.vertices.push_back(centre);
    } else {
      for (const auto& [c, s] : circle_) {
        bodies_.vertices.push_back(plus(plus(centre, u_, radius * c), v_, radius * s));
      }
    }
    if (!any_) {
      if (!point) cap(begin, true);
    } else {
      join(begin, point);
    }
    any_ = true;
    before_ = begin;
    before_is_point_ = point;
  }
  void close() {
    if (!before_is_point_) cap(before_, false);
  }

 private:
  std::uint32_t count() const { return static_cast<std::uint32_t>(circle_.size()); }
  void triangle(std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    bodies_.triangles.push_back({a, b, c});
  }
  void cap(std::uint32_t begin, bool first) {
    for (std::uint32_t i = 1; i + 1 < count(); ++i) {
      if (first) {
        triangle(begin, begin + i + 1, begin + i);
      } else {
        triangle(begin, begin + i, begin + i + 1);
      }
    }
  }
  void join(std::uint32_t begin, bool point) {
    for (std::uint32_t i = 0; i < count(); ++i) {
      const std::uint32_t next = i + 1 == count() ? 0 : i + 1;
      if (before_is_point_) {
        triangle(before_, begin + next, begin + i);
      } else if (point) {
        triangle(before_ + i, before_ + next, begin);
      } else {
        triangle(before_ + i, before_ + next, begin + next);
        triangle(before_ + i, begin + next, begin + i);
      }
    }
  }

  Bodies3mf& bodies_;
  Point3 axis_, u_, v_;
  std::vector<std::pair<double, double>> circle_;
  std::uint32_t before_ = 0;
  bool any_ = false, before_is_point_ = false;
};

/// The rings of half a ball from its rim to its pole, or back. Quarters of `corners` apart.
void add_dome(Rings& rings, const Point3& centre, const Point3& axis, double radius, int corners,
              bool from_pole) {
  const int steps = std::max(2, (corners + 3) / 4);
  for (int i = 1; i <= steps; ++i) {
    const int k = from_pole ? steps + 1 - i : i;
    const double angle = kTurn / 4 * k / steps;
    const double along = (from_pole ? -1 : 1) * radius * std::sin(angle);
    rings.add(plus(centre, axis, along), k == steps ? 0 : radius * std::cos(angle));
  }
}

/// The factor on the radius of such a ball that gives it the volume of a round one: that of the frusta
/// between its rings.
double same_volume(int meridians) {
  const int parallels = meridians / 2;
  double volume = 0;
  const double area = 0.5 * meridians * std::sin(kTurn / meridians);
  for (int k = 0; k < parallels; ++k) {
    const double a = std::numbers::pi * k / parallels, b = std::numbers::pi * (k + 1) / parallels;
    const double r = std::sin(a), s = std::sin(b), height = std::cos(a) - std::cos(b);
    volume += area * height * (r * r + r * s + s * s) / 3;
  }
  return std::cbrt(2 * kTurn / 3 / volume);
}

void add_ball(Bodies3mf& bodies, const Point3& centre, double radius, int meridians) {
  const Point3 axis{0, 0, 1};
  Rings rings(bodies, axis, meridians);
  const double own = radius * same_volume(meridians);
  const int parallels = meridians / 2;
  for (int k = 0; k <= parallels; ++k) {
    const double angle = std::numbers::pi * k / parallels;
    const bool pole = k == 0 || k == parallels;
    rings.add(plus(centre, axis, -own * std::cos(angle)), pole ? 0 : own * std::sin(angle));
  }
  rings.close();
}

void drop_unused(Bodies3mf& bodies) {
  constexpr auto unused = static_cast<std::uint32_t>(-1);
  std::vector<std::uint32_t> places(bodies.vertices.size(), unused);
  std::vector<Point3> kept;
  for (auto& t : bodies.triangles) {
    for (std::uint32_t& v : t) {
      if (places[v] == unused) {
        places[v] = static_cast<std::uint32_t>(kept.size());
        kept.push_back(bodies.vertices[v]);
      }
      v = places[v];
    }
  }
  bodies.vertices = std::move(kept);
}

}  // namespace

std::size_t add_beams(const Object3mf& object, double tolerance, std::size_t most,
                      const std::optional<std::array<Point3, 2>>& box, Bodies3mf& bodies) {
  // The body that begins with this triangle, where the box ends.
  const auto cut = [&](std::size_t begin) {
    if (!box) return;
    const auto at = bodies.triangles.begin() + static_cast<std::ptrdiff_t>(begin);
    std::vector<std::array<std::uint32_t, 3>> body(at, bodies.triangles.end());
    keep_in_box(bodies.vertices, body, (*box)[0], (*box)[1]);
    bodies.triangles.resize(begin);
    bodies.triangles.insert(bodies.triangles.end(), body.begin(), body.end());
  };
  // Whether something around two points reaches into the box.
  const auto reaches = [&](const Point3& a, const Point3& b, double radius) {
    for (std::size_t k = 0; k < 3 && box; ++k) {
      if (std::max(a[k], b[k]) + radius + tolerance < (*box)[0][k]) return false;
      if (std::min(a[k], b[k]) - radius - tolerance > (*box)[1][k]) return false;
    }
    return true;
  };
  const Lattice3mf& lattice = *object.lattice;
  std::set<std::pair<std::uint32_t, double>> balls;
  std::map<std::uint32_t, double> ball_of_vertex;
  if (lattice.ball_mode != Lattice3mf::Balls::none) {
    for (const Lattice3mf::Ball& ball : lattice.balls) ball_of_vertex[ball.vertex] = ball.radius;
    balls.insert(ball_of_vertex.begin(), ball_of_vertex.end());
  }
  const auto check = [&](std::size_t more) {
    if (bodies.triangles.size() + more > most) throw std::length_error("too many triangles");
  };
  std::size_t too_short = 0;
  for (const Lattice3mf::Beam& beam : lattice.beams) {
    const Point3 &a = object.vertices[beam.v1], &b = object.vertices[beam.v2];
    Point3 axis = plus(b, a, -1);
    const double length = std::hypot(axis[0], axis[1], axis[2]);
    if (!(length > 0) || length < lattice.least_length) {
      ++too_short;
      continue;
    }
    for (double& x : axis) x /= length;
    if (beam.cap1 == Cap3mf::sphere) balls.insert({beam.v1, beam.r1});
    if (beam.cap2 == Cap3mf::sphere) balls.insert({beam.v2, beam.r2});
    if (lattice.ball_mode == Lattice3mf::Balls::all) {
      for (const std::uint32_t v : {beam.v1, beam.v2}) {
        if (!ball_of_vertex.contains(v)) balls.insert({v, *lattice.ball_radius});
      }
    }
    const double radius = std::max(beam.r1, beam.r2);
    if (!reaches(a, b, radius)) continue;
    const bool domes = beam.cap1 == Cap3mf::hemisphere || beam.cap2 == Cap3mf::hemisphere;
    const int corners =
        domes ? meridians_of_ball(radius, tolerance) : corners_of_circle(radius, tolerance);
    const double factor = same_area(corners);
    const std::size_t begin = bodies.triangles.size();
    check(static_cast<std::size_t>(corners) * (domes ? static_cast<std::size_t>(corners) + 4 : 4));
    Rings rings(bodies, axis, corners);
    if (beam.cap1 == Cap3mf::hemisphere) add_dome(rings, a, axis, factor * beam.r1, corners, true);
    rings.add(a, factor * beam.r1);
    rings.add(b, factor * beam.r2);
    if (beam.cap2 == Cap3mf::hemisphere) add_dome(rings, b, axis, factor * beam.r2, corners, false);
    rings.close();
    cut(begin);
  }
  for (const auto& [vertex, radius] : balls) {
    if (!reaches(object.vertices[vertex], object.vertices[vertex], radius)) continue;
    const int meridians = meridians_of_ball(radius, tolerance);
    check(static_cast<std::size_t>(meridians) * static_cast<std::size_t>(meridians));
    const std::size_t begin = bodies.triangles.size();
    add_ball(bodies, object.vertices[vertex], radius, meridians);
    cut(begin);
  }
  if (box) drop_unused(bodies);
  return too_short;
}

double doubled_area(const Slices3mf::Slice& slice) {
  double sum = 0;
  for (const auto& contour : slice.contours) {
    const auto& [x0, y0] = slice.points[contour[0]];
    for (std::size_t k = 1; k + 1 < contour.size(); ++k) {
      const auto &p = slice.points[contour[k]], &q = slice.points[contour[k + 1]];
      sum += (p[0] - x0) * (q[1] - y0) - (q[0] - x0) * (p[1] - y0);
    }
  }
  return sum;
}

void add_slices(const std::vector<Slices3mf::Slice>& slices, double bottom, Bodies3mf& bodies) {
  for (const Slices3mf::Slice& slice : slices) {
    for (const auto& contour : slice.contours) {
      if (contour.size() < 3) continue;  // encloses nothing
      const auto low = static_cast<std::uint32_t>(bodies.vertices.size());
      const auto count = static_cast<std::uint32_t>(contour.size());
      const std::uint32_t high = low + count;
      for (const double z : {bottom, slice.top}) {
        for (const std::uint32_t point : contour) {
          bodies.vertices.push_back({slice.points[point][0], slice.points[point][1], z});
        }
      }
      for (std::uint32_t i = 0; i < count; ++i) {
        const std::uint32_t next = i + 1 == count ? 0 : i + 1;
        bodies.triangles.push_back({low + i, low + next, high + next});
        bodies.triangles.push_back({low + i, high + next, high + i});
        // Fans from one corner: where they overlap or leave the contour, they do so in both
        // directions, and windings are right all the same.
        if (i > 0 && i + 1 < count) {
          bodies.triangles.push_back({low, low + i + 1, low + i});
          bodies.triangles.push_back({high, high + i, high + i + 1});
        }
      }
    }
    bottom = slice.top;
  }
}

}  // namespace slicecorr::detail
