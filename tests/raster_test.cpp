// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slice/raster.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <numbers>
#include <random>
#include <string>
#include <utility>
#include <vector>

namespace slicecorr::detail {
namespace {

using Real = long double;
using Bytes = std::vector<std::uint8_t>;
using Random = std::mt19937_64;

struct Point {
  double x, y;
};
using Polygon = std::vector<Point>;
using Segments = std::vector<Segment>;

struct Box {
  int x0, y0, x1, y1;
  std::size_t width() const { return static_cast<std::size_t>(x1 - x0); }
  std::size_t height() const { return static_cast<std::size_t>(y1 - y0); }
};

void append(Segments& segments, const Polygon& polygon) {
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Point &a = polygon[i], &b = polygon[(i + 1) % polygon.size()];
    segments.push_back({a.x, a.y, b.x, b.y});
  }
}

Segments contour(const Polygon& polygon) {
  Segments segments;
  append(segments, polygon);
  return segments;
}

Polygon rectangle(double x0, double y0, double x1, double y1) {
  return {{x0, y0}, {x1, y0}, {x1, y1}, {x0, y1}};
}

Polygon reversed(Polygon p) {
  std::reverse(p.begin(), p.end());
  return p;
}

double uniform(Random& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}
int whole(Random& random, int low, int high) {
  return std::uniform_int_distribution<int>(low, high)(random);
}

Bytes draw(Raster& raster, const Segments& segments, const Box& box) {
  const std::uint8_t* rows = raster.draw(segments);
  if (!rows) return Bytes(box.width() * box.height(), 0);
  Bytes bytes(rows, rows + box.width() * box.height());
  EXPECT_TRUE(std::any_of(bytes.begin(), bytes.end(), [](std::uint8_t v) { return v != 0; }));
  return bytes;
}

Bytes draw(const Segments& segments, const Box& box, bool antialias) {
  Raster raster(box.x0, box.y0, box.x1, box.y1, antialias);
  return draw(raster, segments, box);
}

/// Where the line through a segment is at height y.
Real x_at(const Segment& s, Real y) {
  return s.ax + (y - s.ay) * ((Real{s.bx} - s.ax) / (Real{s.by} - s.ay));
}

/// The winding around a point, from its left.
int winding_at(const Segments& segments, Real x, Real y) {
  int winding = 0;
  for (const Segment& s : segments) {
    const bool down = s.ay <= y && y < s.by, up = s.by <= y && y < s.ay;
    if ((down || up) && x_at(s, y) <= x) winding += down ? 1 : -1;
  }
  return winding;
}

/// The area of the non-zero region in every pixel, by brute force: between two neighbours of all
/// heights at which anything happens in a pixel (a segment ends, two segments cross, one enters or
/// leaves the pixel), the covered width is linear in y, and the width at half height gives its mean
/// exactly.
class Reference {
 public:
  explicit Reference(const Segments& segments) : segments_(segments) {
    for (std::size_t i = 0; i < segments.size(); ++i) {
      heights_.push_back(segments[i].ay);
      for (std::size_t k = 0; k < i; ++k) add_crossing(segments[i], segments[k]);
    }
  }
  Real area(int column, int row) const {
    std::vector<Real> events = {Real(row), Real(row + 1)};
    const auto add = [&](Real y) {
      if (y > row && y < row + 1) events.push_back(y);
    };
    for (const Real y : heights_) add(y);
    for (const Segment& s : segments_) {
      if (s.ax == s.bx || s.ay == s.by) continue;
      for (const int x : {column, column + 1}) {
        add(s.ay + (x - Real{s.ax}) * ((Real{s.by} - s.ay) / (Real{s.bx} - s.ax)));
      }
    }
    std::sort(events.begin(), events.end());
    Real sum = 0;
    for (std::size_t i = 0; i + 1 < events.size(); ++i) {
      sum += (events[i + 1] - events[i]) * covered_width(column, (events[i] + events[i + 1]) / 2);
    }
    return sum;
  }

 private:
  void add_crossing(const Segment& s, const Segment& t) {
    const Real sx = Real{s.bx} - s.ax, sy = Real{s.by} - s.ay;
    const Real tx = Real{t.bx} - t.ax, ty = Real{t.by} - t.ay;
    const Real cross = sx * ty - sy * tx;
    if (cross == 0) return;
    const Real at = ((Real{t.ax} - s.ax) * ty - (Real{t.ay} - s.ay) * tx) / cross;
    // A crossing of the lines past the segments only adds a height at which nothing happens.
    if (at > -1e-6L && at < 1 + 1e-6L) heights_.push_back(s.ay + at * sy);
  }
  Real covered_width(int column, Real y) const {
    std::vector<std::pair<Real, int>> crossings;
    for (const Segment& s : segments_) {
      const bool down = s.ay <= y && y < s.by, up = s.by <= y && y < s.ay;
      if (down || up) crossings.emplace_back(x_at(s, y), down ? 1 : -1);
    }
    std::sort(crossings.begin(), crossings.end());
    Real width = 0;
    int winding = 0;
    for (std::size_t i = 0; i + 1 < crossings.size(); ++i) {
      winding += crossings[i].second;
      if (winding == 0) continue;
      const Real from = std::max(crossings[i].first, Real(column));
      const Real to = std::min(crossings[i + 1].first, Real(column + 1));
      if (from < to) width += to - from;
    }
    return width;
  }

  const Segments& segments_;
  std::vector<Real> heights_;
};

/// Areas must agree so closely that 255 times the area rounds to the same level, unless it lies
/// within this of a half: coordinates below 4096 px are rounded to 5e-13 px, and tens of pieces in
/// a pixel add up to 255 * 40 * 5e-13 = 5e-9 at the very most, far less in practice.
constexpr Real kTie = 1e-9L;

/// Whether a level is `area` rounded to 255ths.
bool fits(int level, Real area) {
  const Real value = std::clamp(area, Real{0}, Real{1}) * 255;
  return level >= std::floor(value - kTie + 0.5L) && level <= std::floor(value + kTie + 0.5L);
}

/// Compares the raster with areas per pixel; stops at the first difference.
void expect_levels(const Bytes& rows, const Box& box,
                   const std::function<Real(int column, int row)>& area, const std::string& what) {
  for (int y = box.y0; y < box.y1; ++y) {
    for (int x = box.x0; x < box.x1; ++x) {
      const int level = rows[static_cast<std::size_t>(y - box.y0) * box.width() +
                             static_cast<std::size_t>(x - box.x0)];
      const Real expected = area(x, y);
      ASSERT_TRUE(fits(level, expected)) << what << ": pixel " << x << ", " << y << " is " << level
                                         << ", area gives " << static_cast<double>(expected * 255);
    }
  }
}

void expect_exact(const Segments& segments, const Box& box, const std::string& what) {
  const Reference reference(segments);
  expect_levels(
      draw(segments, box, true), box, [&](int x, int y) { return reference.area(x, y); }, what);
}

void expect_centres(const Segments& segments, const Box& box, const std::string& what) {
  const Bytes rows = draw(segments, box, false);
  for (int y = box.y0; y < box.y1; ++y) {
    for (int x = box.x0; x < box.x1; ++x) {
      // Where a slanted edge runs through a centre, rounding decides; vertical ones are exact.
      const bool tie = std::any_of(segments.begin(), segments.end(), [&](const Segment& s) {
        const auto [top, bottom] = std::minmax(s.ay, s.by);
        return s.ax != s.bx && top <= y + 0.5 && y + 0.5 < bottom &&
               std::abs(x_at(s, y + 0.5L) - (x + 0.5L)) < 1e-9L;
      });
      if (tie) continue;
      const int expected = winding_at(segments, x + 0.5L, y + 0.5L) != 0 ? 255 : 0;
      ASSERT_EQ(expected, rows[static_cast<std::size_t>(y - box.y0) * box.width() +
                               static_cast<std::size_t>(x - box.x0)])
          << what << ": pixel " << x << ", " << y;
    }
  }
}

// --- Random contours. They stay within the columns, but reach past the rows.

struct Family {
  const char* name;
  std::function<Segments(Random&, const Box&)> make;
};

Point anywhere(Random& random, const Box& box) {
  return {uniform(random, box.x0, box.x1), uniform(random, box.y0 - 2.0, box.y1 + 2.0)};
}

/// A star of n corners that winds around its middle `turns` times; convex for one turn and
/// roughness 0.
Polygon star(Random& random, const Box& box, int n, int turns, double roughness) {
  const Point middle = {uniform(random, box.x0 + 1.0, box.x1 - 1.0),
                        uniform(random, box.y0 + 0.0, box.y1 + 0.0)};
  const double reach = std::min(middle.x - box.x0, box.x1 - middle.x);
  const double rx = uniform(random, 0.2, 1.0) * reach, ry = uniform(random, 0.3, 8.0);
  const double start = uniform(random, 0, 6.3);
  Polygon polygon;
  for (int i = 0; i < n; ++i) {
    const double angle = start + 2 * std::numbers::pi * i * turns / n;
    const double r = 1 - roughness * uniform(random, 0, 1);
    polygon.push_back({middle.x + r * rx * std::cos(angle), middle.y + r * ry * std::sin(angle)});
  }
  return whole(random, 0, 1) ? polygon : reversed(polygon);
}

Polygon random_polygon(Random& random, const Box& box, int n) {
  Polygon polygon;
  for (int i = 0; i < n; ++i) polygon.push_back(anywhere(random, box));
  return polygon;
}

/// Corners on multiples of 1/per_pixel: many edges are horizontal, vertical, on pixel borders or on
/// each other.
Polygon lattice(Random& random, const Box& box, int n, int per_pixel) {
  Polygon polygon;
  for (int i = 0; i < n; ++i) {
    polygon.push_back(
        {whole(random, box.x0 * per_pixel, box.x1 * per_pixel) / static_cast<double>(per_pixel),
         whole(random, (box.y0 - 1) * per_pixel, (box.y1 + 1) * per_pixel) /
             static_cast<double>(per_pixel)});
  }
  return polygon;
}

/// Steps along x and y only.
Polygon staircase(Random& random, const Box& box, int n) {
  Polygon polygon = {anywhere(random, box)};
  for (int i = 1; i < 2 * n; ++i) {
    Point p = anywhere(random, box);
    (i % 2 ? p.x : p.y) = i % 2 ? polygon.back().x : polygon.back().y;
    polygon.push_back(p);
  }
  polygon.push_back({polygon.back().x, polygon.front().y});
  return polygon;
}

const Family kFamilies[] = {
    {"convex",
     [](Random& random, const Box& box) {
       return contour(star(random, box, whole(random, 3, 14), 1, 0));
     }},
    {"star that overlaps itself",
     [](Random& random, const Box& box) {
       const int n = 2 * whole(random, 2, 6) + 1;
       return contour(star(random, box, n, whole(random, 2, n / 2), 0.3));
     }},
    {"crosses itself",
     [](Random& random, const Box& box) {
       return contour(random_polygon(random, box, whole(random, 3, 10)));
     }},
    {"several, mixed orientation",
     [](Random& random, const Box& box) {
       Segments segments;
       for (int i = whole(random, 2, 4); i > 0; --i) {
         append(segments, star(random, box, whole(random, 3, 7), 1, 0.6));
       }
       return segments;
     }},
    {"slivers",
     [](Random& random, const Box& box) {
       Segments segments;
       for (int i = whole(random, 1, 3); i > 0; --i) {
         const Point a = anywhere(random, box), b = anywhere(random, box);
         const double width = std::pow(10.0, uniform(random, -4, -0.2));
         const auto near = [&](const Point& p) {
           return Point{
               std::clamp(p.x + uniform(random, -width, width), 1.0 * box.x0, 1.0 * box.x1),
               p.y + uniform(random, -width, width)};
         };
         append(segments, {a, b, near(b), near(a)});
       }
       return segments;
     }},
    {"on whole pixels",
     [](Random& random, const Box& box) {
       Segments segments = contour(lattice(random, box, whole(random, 3, 8), 1));
       append(segments, lattice(random, box, whole(random, 3, 5), 1));
       return segments;
     }},
    {"on half pixels",
     [](Random& random, const Box& box) {
       return contour(lattice(random, box, whole(random, 3, 12), 2));
     }},
    {"on quarter pixels",
     [](Random& random, const Box& box) {
       Segments segments = contour(lattice(random, box, whole(random, 3, 8), 4));
       append(segments, lattice(random, box, 4, 4));
       return segments;
     }},
    {"horizontal and vertical edges",
     [](Random& random, const Box& box) {
       return contour(staircase(random, box, whole(random, 2, 5)));
     }},
};

constexpr Box kBoxes[] = {{0, 0, 13, 9}, {17, 5, 31, 12}, {4000, 2500, 4011, 2510}, {3, 0, 5, 1}};

class RasterFamily : public testing::TestWithParam<Family> {};
INSTANTIATE_TEST_SUITE_P(Random, RasterFamily, testing::ValuesIn(kFamilies),
                         [](const testing::TestParamInfo<Family>& info) {
                           std::string name = info.param.name;
                           std::erase(name, ',');
                           std::replace(name.begin(), name.end(), ' ', '_');
                           return name;
                         });

TEST_P(RasterFamily, CoverageIsTheAreaRounded) {
  Random random(1);
  for (int i = 0; i < 120 && !HasFatalFailure(); ++i) {
    const Box& box = kBoxes[i % 4];
    expect_exact(GetParam().make(random, box), box, "contour " + std::to_string(i));
  }
}

TEST_P(RasterFamily, PixelCentreRule) {
  Random random(2);
  for (int i = 0; i < 300 && !HasFatalFailure(); ++i) {
    const Box& box = kBoxes[i % 4];
    const Segments segments = GetParam().make(random, box);
    expect_centres(segments, box, "contour " + std::to_string(i));
  }
}

TEST_P(RasterFamily, RowsDoNotDependOnTheBand) {
  Random random(3);
  for (int i = 0; i < 120; ++i) {
    const Box& box = kBoxes[i % 4];
    const Segments segments = GetParam().make(random, box);
    for (const bool antialias : {true, false}) {
      const Bytes all = draw(segments, box, antialias);
      Bytes joined;
      for (int y = box.y0; y < box.y1;) {
        const int end = whole(random, y + 1, box.y1);
        const Bytes part = draw(segments, {box.x0, y, box.x1, end}, antialias);
        joined.insert(joined.end(), part.begin(), part.end());
        y = end;
      }
      ASSERT_EQ(all, joined) << "contour " << i;
      // Nor on what else is drawn to the side.
      Bytes wider = draw(segments, {box.x0 - 2, box.y0, box.x1 + 3, box.y1}, antialias);
      for (std::size_t y = 0; y < box.height(); ++y) {
        for (std::size_t x = 0; x < box.width(); ++x) {
          // With another left border sums round differently, so a tie may fall to its other side.
          ASSERT_NEAR(all[y * box.width() + x], wider[y * (box.width() + 5) + x + 2], 1);
        }
      }
    }
  }
}

// The reference above shares the idea of heights with the raster; this one does not. Of n x n
// samples, those count wrong whose cell an edge crosses: at most n (|dx| + |dy|) + 1 cells for an
// edge that runs |dx|, |dy| in the pixel.
TEST_P(RasterFamily, CoverageAgreesWithSamples) {
  constexpr int n = 24;
  Random random(4);
  for (int i = 0; i < 12; ++i) {
    const Box box = kBoxes[i % 2];
    const Segments segments = GetParam().make(random, box);
    const Bytes rows = draw(segments, box, true);
    for (int y = box.y0; y < box.y1; ++y) {
      for (int x = box.x0; x < box.x1; ++x) {
        int inside = 0;
        for (int k = 0; k < n * n; ++k) {
          inside += winding_at(segments, x + (k % n + 0.5L) / n, y + (k / n + 0.5L) / n) != 0;
        }
        double cells = 0;
        for (const Segment& s : segments) {
          // Liang-Barsky: the part of the segment in the pixel.
          double from = 0, to = 1;
          const auto clip = [&](double start, double run, double low) {
            if (run == 0) {
              if (start < low || start > low + 1) to = -1;
              return;
            }
            const double a = (low - start) / run, b = (low + 1 - start) / run;
            from = std::max(from, std::min(a, b));
            to = std::min(to, std::max(a, b));
          };
          clip(s.ax, s.bx - s.ax, x);
          clip(s.ay, s.by - s.ay, y);
          if (to < from) continue;
          cells += n * (to - from) * (std::abs(s.bx - s.ax) + std::abs(s.by - s.ay)) + 1;
        }
        // A contour on the grid of samples may take the cells of both sides.
        const double bound = 2 * cells / (n * n) + 0.5 / 255 + 1e-9;
        const int level = rows[static_cast<std::size_t>(y - box.y0) * box.width() +
                               static_cast<std::size_t>(x - box.x0)];
        ASSERT_NEAR(level / 255.0, inside / static_cast<double>(n * n), bound)
            << "contour " << i << " pixel " << x << ", " << y;
      }
    }
  }
}

// Edges that cross while they run far along the rows: a rounding error of the height of their
// crossing moves them far.
TEST(Raster, NearlyHorizontalEdgesThatCross) {
  Random random(5);
  const Box box = {0, 0, 1500, 2};
  for (int i = 0; i < 60 && !testing::Test::HasFatalFailure(); ++i) {
    Polygon polygon;
    for (int k = 0; k < 6; ++k) {
      polygon.push_back({(k % 2 ? 1500.0 : 0.0) + (k % 2 ? -1 : 1) * uniform(random, 0, 300),
                         uniform(random, 0, i % 3 ? 2 : 1)});
    }
    expect_exact(contour(polygon), box, "contour " + std::to_string(i));
  }
}

TEST(Raster, LevelsAreReachedExactlyAtHalves) {
  // One rectangle of k / 255 of a pixel for every level, by width and by height.
  for (int k = 0; k <= 255; ++k) {
    const double share = k / 255.0;
    EXPECT_EQ(draw(contour(rectangle(1, 0, 1 + share, 1)), {0, 0, 3, 1}, true),
              (Bytes{0, static_cast<std::uint8_t>(k), 0}));
    EXPECT_EQ(draw(contour(rectangle(1, 0.0, 2, share)), {0, 0, 3, 1}, true),
              (Bytes{0, static_cast<std::uint8_t>(k), 0}));
  }
}

/// The share of [p, p + 1] that [a, b] covers.
Real share(Real a, Real b, int p) {
  return std::max(Real{0}, std::min(b, Real(p + 1)) - std::max(a, Real(p)));
}

TEST(Raster, OneRectangleOverManyPixels) {
  // Its upper and lower edges are horizontal and cover their rows partly over many pixels.
  for (const double y0 : {1.0, 1.25, 1.5, 1.75, 1.999}) {
    for (const double y1 : {2.0, 4.2, 4.5, 4.9, 5.0}) {
      const Box box = {0, 0, 14, 7};
      for (const bool turned : {false, true}) {
        Polygon p = rectangle(2.3, y0, 10.7, y1);
        if (turned) p = reversed(p);
        expect_levels(
            draw(contour(p), box, true), box,
            [&](int x, int y) { return share(2.3, 10.7, x) * share(y0, y1, y); }, "rectangle");
      }
    }
  }
}

TEST(Raster, TwoOverlappingRectangles) {
  Random random(6);
  const Box box = {0, 0, 9, 8};
  for (int i = 0; i < 400 && !testing::Test::HasFatalFailure(); ++i) {
    double a[4], b[4];  // x0, y0, x1, y1
    for (double* r : {a, b}) {
      for (int k : {0, 1}) {
        r[k] = uniform(random, 0, 8);
        r[k + 2] = uniform(random, 0, 8);
        if (r[k] > r[k + 2]) std::swap(r[k], r[k + 2]);
      }
    }
    const Polygon pa = rectangle(a[0], a[1], a[2], a[3]), pb = rectangle(b[0], b[1], b[2], b[3]);
    const auto of = [](const double* r, int x, int y) {
      return share(r[0], r[2], x) * share(r[1], r[3], y);
    };
    const double both[4] = {std::max(a[0], b[0]), std::max(a[1], b[1]), std::min(a[2], b[2]),
                            std::min(a[3], b[3])};
    Segments same = contour(pa), opposite = contour(pa);
    append(same, pb);
    append(opposite, reversed(pb));
    expect_levels(
        draw(same, box, true), box,
        [&](int x, int y) { return of(a, x, y) + of(b, x, y) - of(both, x, y); }, "union");
    // Opposite windings cancel where they meet.
    expect_levels(
        draw(opposite, box, true), box,
        [&](int x, int y) { return of(a, x, y) + of(b, x, y) - 2 * of(both, x, y); }, "cancelled");
  }
}

/// Area of a convex polygon within a pixel: cut by the pixel's four sides.
Real clipped_area(const Polygon& convex, int column, int row) {
  std::vector<std::pair<Real, Real>> p;
  for (const Point& q : convex) p.emplace_back(q.x, q.y);
  const auto keep = [&](Real nx, Real ny, Real d) {  // nx x + ny y >= d
    std::vector<std::pair<Real, Real>> out;
    for (std::size_t i = 0; i < p.size(); ++i) {
      const auto &a = p[i], &b = p[(i + 1) % p.size()];
      const Real da = nx * a.first + ny * a.second - d, db = nx * b.first + ny * b.second - d;
      if (da >= 0) out.push_back(a);
      if ((da > 0 && db < 0) || (da < 0 && db > 0)) {
        const Real t = da / (da - db);
        out.emplace_back(a.first + t * (b.first - a.first), a.second + t * (b.second - a.second));
      }
    }
    p = out;
  };
  keep(1, 0, column);
  keep(-1, 0, -column - 1);
  keep(0, 1, row);
  keep(0, -1, -row - 1);
  Real twice = 0;
  for (std::size_t i = 0; i < p.size(); ++i) {
    const auto &a = p[i], &b = p[(i + 1) % p.size()];
    twice += a.first * b.second - a.second * b.first;
  }
  return std::abs(twice) / 2;
}

TEST(Raster, RotatedSquare) {
  const Box box = {0, 0, 24, 24};
  for (const double degrees : {0.0, 1e-7, 0.1, 10.0, 30.0, 45.0, 63.4349488, 89.9999}) {
    const double a = degrees * std::numbers::pi / 180, c = 7 * std::cos(a), s = 7 * std::sin(a);
    for (const double off : {0.0, 0.125, 0.377}) {
      const double x = 12 + off, y = 12 - off;
      const Polygon p = {{x + c, y + s}, {x - s, y + c}, {x - c, y - s}, {x + s, y - c}};
      const Bytes rows = draw(contour(p), box, true);
      expect_levels(
          rows, box, [&](int px, int py) { return clipped_area(p, px, py); },
          "square at " + std::to_string(degrees));
      // Its area is 2 * 7²; only pixels that the outline touches are rounded, by half a level at
      // most, and a convex outline in a box of 14 x 14 px touches at most 2 (15 + 15).
      double sum = 0;
      for (const std::uint8_t v : rows) sum += v / 255.0;
      EXPECT_NEAR(sum, 98, 60 * 0.5 / 255);
    }
  }
}

TEST(Raster, DiagonalThroughPixelCorners) {
  // The lower left half of a square, cut along its diagonal.
  const Bytes rows = draw(contour({{0, 0}, {4, 4}, {0, 4}}), {0, 0, 4, 4}, true);
  EXPECT_EQ(rows, (Bytes{128, 0, 0, 0,      //
                         255, 128, 0, 0,    //
                         255, 255, 128, 0,  //
                         255, 255, 255, 128}));
}

TEST(Raster, OppositeContoursCancelAndEqualOnesDoNotAdd) {
  Random random(7);
  const Box box = kBoxes[0];
  for (int i = 0; i < 50; ++i) {
    const Polygon p = random_polygon(random, box, 6);
    Segments once = contour(p), cancelled = once, twice = once;
    append(cancelled, reversed(p));
    append(twice, p);
    const Bytes nothing(box.width() * box.height(), 0);
    EXPECT_EQ(draw(cancelled, box, true), nothing);
    EXPECT_EQ(draw(cancelled, box, false), nothing);
    EXPECT_EQ(draw(twice, box, true), draw(once, box, true));
    EXPECT_EQ(draw(twice, box, false), draw(once, box, false));
  }
}

// Two shapes with a common edge that runs through pixel centres: every centre belongs to one.
TEST(Raster, CentresOnCommonEdgesBelongToOneSide) {
  const Box box = {0, 0, 8, 8};
  const std::pair<Polygon, Polygon> neighbours[] = {
      {rectangle(0, 0, 3.5, 8), rectangle(3.5, 0, 8, 8)},
      {rectangle(0, 0, 8, 2.5), rectangle(0, 2.5, 8, 8)},
      {{{0, 0}, {8, 8}, {0, 8}}, {{0, 0}, {8, 0}, {8, 8}}},
      {{{0, 0}, {8, 0}, {0, 8}}, {{8, 0}, {8, 8}, {0, 8}}},
      {{{0, 0}, {8, 0}, {8, 2}, {0, 6}}, {{8, 2}, {8, 8}, {0, 8}, {0, 6}}},
  };
  for (const auto& [a, b] : neighbours) {
    const Bytes in_a = draw(contour(a), box, false), in_b = draw(contour(b), box, false);
    for (std::size_t i = 0; i < in_a.size(); ++i) EXPECT_EQ(in_a[i] + in_b[i], 255) << i;
  }
}

TEST(Raster, ReusedForManySlices) {
  Random random(8);
  const Box box = kBoxes[1];
  for (const bool antialias : {true, false}) {
    Raster raster(box.x0, box.y0, box.x1, box.y1, antialias);
    for (int i = 0; i < 100; ++i) {
      const Segments segments = kFamilies[static_cast<std::size_t>(i) % 9].make(random, box);
      EXPECT_EQ(draw(raster, segments, box), draw(segments, box, antialias)) << i;
    }
    EXPECT_EQ(raster.draw({}), nullptr);
  }
}

}  // namespace
}  // namespace slicecorr::detail
