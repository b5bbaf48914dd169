// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slice/inset.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>

namespace slicecorr::detail {

namespace {

/// Half of what a pixel measures along a normal, by x and by y: the larger first.
struct Extents {
  double a, b;
  Extents(double normal_x, double normal_y, const Inset& pixel)
      : a(0.5 * std::abs(normal_x) * pixel.pixel_x_um),
        b(0.5 * std::abs(normal_y) * pixel.pixel_y_um) {
    if (a < b) std::swap(a, b);
  }
};

/// How far inside the middle of a pixel lies, of which this share is covered: `half_plane_share` turned round.
double inside_of_share(const Extents& e, double share) {
  const double u = std::clamp(share, 0.0, 1.0) - 0.5;
  if (std::abs(u) <= (e.a - e.b) / (2 * e.a)) return 2 * e.a * u;
  return std::copysign(e.a + e.b - std::sqrt(8 * e.a * e.b * (0.5 - std::abs(u))), u);
}

/// A piece of an edge in a pixel.
struct Piece {
  int x, y;
  double normal_x, normal_y;  ///< inwards
  double inside_um;           ///< of the pixel's middle
  double half_um;             ///< half its length
};

/// So much steeper is coverage on the straight side of a corner.
constexpr double kSteeper = 1.08;

constexpr std::size_t kSides = 4;
struct Nearest {
  double inside_um = std::numeric_limits<double>::infinity();
  double normal_x = 0, normal_y = 0;
};
/// The nearest piece of each side: left, right, up, down.
using Sides = std::array<Nearest, kSides>;

std::size_t side_of(const Piece& p) {
  if (std::abs(p.normal_x) >= std::abs(p.normal_y)) return p.normal_x > 0 ? 0 : 1;
  return p.normal_y > 0 ? 2 : 3;
}

class Coverage {
 public:
  Coverage(const std::uint8_t* pixels, int width, int height)
      : pixels_(pixels), width_(width), height_(height) {}
  int at(int x, int y) const {
    if (x < 0 || y < 0 || x >= width_ || y >= height_) return 0;
    return pixels_[static_cast<std::ptrdiff_t>(y) * width_ + x];
  }
  /// Calls `each` for the pieces of edges in a pixel.
  template <class Each>
  void pieces(int x, int y, const Inset& how, const Each& each) const {
    const int own = at(x, y);
    if (own == 0) return;
    // A whole pixel has an edge only where it borders on nothing.
    if (own == 255 && at(x - 1, y) > 0 && at(x + 1, y) > 0 && at(x, y - 1) > 0 &&
        at(x, y + 1) > 0) {
      return;
    }
    const auto [gx, gy] = gradient(x, y, how);
    const double size = std::hypot(gx, gy);
    if (!(size > 0)) return;  // as much to one side as to the other: a wall of one pixel
    each(piece_with(x, y, gx / size, gy / size, own, how));
    // A corner: how far its two edges reach into the pixel, the next pixel along each of them knows.
    const int in_x = gx > 0 ? 1 : -1, in_y = gy > 0 ? 1 : -1;
    if (at(x - in_x, y) > 0 || at(x, y - in_y) > 0 || gx == 0 || gy == 0) return;
    each(piece_with(x, y, in_x, 0, at(x, y + in_y), how));
    each(piece_with(x, y, 0, in_y, at(x + in_x, y), how));
  }

 private:
  struct Gradient {
    double x, y;
    double size() const { return std::hypot(x, y); }
  };
  /// Of the coverage, by the pixels on both sides, or, beside a corner, on the side where the edge goes straight on: there
  /// it is steeper.
  Gradient gradient(int x, int y, const Inset& how) const {
    double across[3], down[3];
    for (int k = 0; k < 3; ++k) {
      across[k] = (at(x + 1, y + k - 1) - at(x - 1, y + k - 1)) / how.pixel_x_um;
      down[k] = (at(x + k - 1, y + 1) - at(x + k - 1, y - 1)) / how.pixel_y_um;
    }
    const Gradient both{0.5 * across[0] + across[1] + 0.5 * across[2],
                        0.5 * down[0] + down[1] + 0.5 * down[2]};
    Gradient best = both;
    for (const int row : {0, 2}) {
      for (const int column : {0, 2}) {
        const Gradient one{across[row] + across[1], down[column] + down[1]};
        if (one.size() > kSteeper * both.size() && one.size() > best.size()) best = one;
      }
    }
    return best;
  }
  static Piece piece_with(int x, int y, double normal_x, double normal_y, int covered,
                          const Inset& how) {
    Piece p{x, y, normal_x, normal_y, 0, 0};
    p.inside_um = inside_of_share(Extents(normal_x, normal_y, how), covered / 255.0);
    p.half_um = 0.5 * (std::abs(normal_y) * how.pixel_x_um + std::abs(normal_x) * how.pixel_y_um);
    return p;
  }

  const std::uint8_t* pixels_;
  int width_, height_;
};

/// What is left of a pixel by all edges near it.
double share_left(const Sides& sides, const Inset& how) {
  const auto nearest = std::min_element(
      sides.begin(), sides.end(),
      [](const Nearest& one, const Nearest& other) { return one.inside_um < other.inside_um; });
  if (!std::isfinite(nearest->inside_um)) return 1;
  const auto share = [&](const Nearest& n) {
    return half_plane_share(n.normal_x, n.normal_y, how, n.inside_um - how.by_um);
  };
  double left = share(*nearest);
  for (const Nearest& n : sides) {
    if (&n == &*nearest || !std::isfinite(n.inside_um)) continue;
    const double alike = n.normal_x * nearest->normal_x + n.normal_y * nearest->normal_y;
    // The same edge, seen in the next pixel, tells nothing more.
    if (alike > 0.5) continue;
    left = alike < -0.5 ? std::max(0.0, left + share(n) - 1) : left * share(n);
  }
  return left;
}

}  // namespace

int Inset::reach() const {
  return static_cast<int>(std::ceil(by_um / std::min(pixel_x_um, pixel_y_um))) + 3;
}

double half_plane_share(double normal_x, double normal_y, const Inset& pixel, double inside_um) {
  const Extents e(normal_x, normal_y, pixel);
  const double t = std::abs(inside_um);
  double half = 0.5;
  if (t <= e.a - e.b) {
    half = t / (2 * e.a);
  } else if (t < e.a + e.b) {
    half = 0.5 - (e.a + e.b - t) * (e.a + e.b - t) / (8 * e.a * e.b);
  }
  return 0.5 + std::copysign(half, inside_um);
}

std::vector<std::uint8_t> inset(const std::uint8_t* coverage, int width, int height,
                                const Inset& how) {
  const Coverage before(coverage, width, height);
  const std::size_t count = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  std::vector<std::uint8_t> after(coverage, coverage + count);
  std::vector<Sides> sides;
  std::vector<std::uint32_t> place(count, 0);  // one more than where its sides are
  std::vector<std::size_t> near;
  const int reach = how.reach() - 1;  // where an edge runs, the pixels beside it tell
  const auto reaches = [&](const Piece& p) {
    const int x = p.x, y = p.y;
    const std::size_t side = side_of(p);
    for (int v = std::max(0, y - reach); v <= std::min(height - 1, y + reach); ++v) {
      for (int u = std::max(0, x - reach); u <= std::min(width - 1, x + reach); ++u) {
        const std::size_t at = static_cast<std::size_t>(v) * static_cast<std::size_t>(width) +
                               static_cast<std::size_t>(u);
        if (coverage[at] == 0) continue;
        const double dx = (u - x) * how.pixel_x_um, dy = (v - y) * how.pixel_y_um;
        const double across = dx * p.normal_x + dy * p.normal_y + p.inside_um;
        const double along = std::abs(dy * p.normal_x - dx * p.normal_y);
        const double beyond = std::max(0.0, along - p.half_um);
        // Behind the edge only its own pixels know how far.
        if (across < 0 && beyond > 0) continue;
        const double inside_um = beyond > 0 ? std::hypot(across, beyond) : across;
        if (place[at] == 0) {
          sides.emplace_back();
          near.push_back(at);
          place[at] = static_cast<std::uint32_t>(sides.size());
        }
        Nearest& n = sides[place[at] - 1][side];
        if (inside_um >= n.inside_um) continue;
        n = {inside_um, p.normal_x, p.normal_y};
      }
    }
  };
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) before.pieces(x, y, how, reaches);
  }
  for (const std::size_t at : near) {
    const double left = share_left(sides[place[at] - 1], how);
    const double most = coverage[at] / 255.0;
    after[at] = how.antialias ? static_cast<std::uint8_t>(std::lround(255 * std::min(left, most)))
                              : static_cast<std::uint8_t>(left >= 0.5 ? coverage[at] : 0);
  }
  return after;
}

}  // namespace slicecorr::detail
