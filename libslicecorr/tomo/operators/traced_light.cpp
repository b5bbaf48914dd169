// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/operators/traced_light.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <utility>

#include "slicecorr/vial.hpp"
#include "slicecorr/vial_outline.hpp"
#include "tomo/operators/flat_points.hpp"
#include "tomo/operators/footprint.hpp"

namespace slicecorr::tomo::detail {

namespace {

/// A strip is cut in halves so often at most, where its rays meet different faces.
constexpr int kMostHalvings = 6;
/// Strips whose sides differ in direction by more than this, times the resin's radius in voxels, are cut.
constexpr double kBends = 0.25;
/// Rays of a bundle differ in kz² by less than this many voxels over the resin's radius. Seen from above
/// refraction depends on kz² alone: by half of its change times 1 - (n_outside/n)² at most, over two radii.
constexpr double kBundled = 0.2;

/// A number along a piece: linear in the way.
struct Linear {
  double at_0 = 0, by_mm = 0;
  double at(double s) const { return at_0 + by_mm * s; }
};

/// Where strips begin, or end: along the way of the middle ray by how far a place lies beside it.
Linear slanted(const FlatPoint& low, const FlatPoint& high, const TracedPiece& middle) {
  const FlatPoint& d = middle.along;
  const FlatPoint a{low.x_mm - middle.from.x_mm, low.y_mm - middle.from.y_mm},
      b{high.x_mm - middle.from.x_mm, high.y_mm - middle.from.y_mm};
  const double ta = -a.x_mm * d.y_mm + a.y_mm * d.x_mm, tb = -b.x_mm * d.y_mm + b.y_mm * d.x_mm;
  const double sa = dot(a, d), sb = dot(b, d);
  if (std::abs(tb - ta) < 1e-12) return {(sa + sb) / 2, 0};
  const double by = (sb - sa) / (tb - ta);
  return {sa - by * ta, by};
}
FlatPoint end_of(const TracedPiece& piece) {
  return {piece.from.x_mm + piece.length_mm * piece.along.x_mm,
          piece.from.y_mm + piece.length_mm * piece.along.y_mm};
}

/// How far a ray lies beside the middle one, to the left of its way.
Linear beside(const TracedPiece& middle, const TracedPiece& ray) {
  const FlatPoint& d = middle.along;
  const FlatPoint left{-d.y_mm, d.x_mm};
  const FlatPoint to{ray.from.x_mm - middle.from.x_mm, ray.from.y_mm - middle.from.y_mm};
  const double along = dot(ray.along, d), by = dot(ray.along, left) / along;
  return {dot(to, left) - by * dot(to, d), by};
}

}  // namespace

std::vector<bool> resin_of(const Vial& vial, const TomoGrid& grid) {
  const ResinArea area(vial);
  std::vector<bool> resin;
  resin.reserve(static_cast<std::size_t>(grid.voxels) * static_cast<std::size_t>(grid.voxels));
  for (int y = 0; y < grid.voxels; ++y) {
    const TomoGrid::Range in = grid.inside(y);
    for (int x = 0; x < grid.voxels; ++x) {
      resin.push_back(x >= in.first && x < in.end &&
                      area.has({grid.voxel_at_mm(x), grid.voxel_at_mm(y)}));
    }
  }
  return resin;
}

TracedLine TracedRows::line(double column, double row, int ray) const {
  const PixelWindow& w = window;
  LightLine line = chief_ray(printer, w.first_column + column * w.wide + 0.5 * (w.wide - 1),
                             w.first_row + (w.rows - 1 - row) * w.high + 0.5 * (w.high - 1));
  const AperturePoint& p = points[static_cast<std::size_t>(ray)];
  line.slope_x += p.x * aperture;
  line.slope_z += p.z * aperture;
  return {line.x_mm, line.angle_rad(), line.z_mm, line.kz(), line.transmittance};
}

std::vector<TracedBundle> bundles_of(const TomoGrid& grid, const TracedRows& rows,
                                     double narrower) {
  const double most = kBundled * narrower * grid.voxel_mm() / grid.radius_mm,
               middle = 0.5 * (grid.pixels - 1);
  std::vector<TracedBundle> bundles;
  for (int ray = 0; ray < static_cast<int>(rows.points.size()); ++ray) {
    double least = 0, greatest = 0;
    for (int r = 0; r < grid.rows; ++r) {
      const double kz = rows.line(middle, r, ray).kz, square = kz * kz;
      if (r > 0 && std::max(greatest, square) - std::min(least, square) <= most) {
        least = std::min(least, square);
        greatest = std::max(greatest, square);
        bundles.back().end_row = r + 1;
        continue;
      }
      least = greatest = square;
      bundles.push_back({r, r + 1, ray});
    }
  }
  return bundles;
}

int traced_angles(const TomoGrid& grid, double step_rad) {
  const double half_voxels = 2 * grid.radius_mm * step_rad / grid.voxel_mm();
  return static_cast<int>(std::clamp(std::ceil(half_voxels - 1e-9), 1.0, 64.0));
}

/// Light between two rays.
struct TracedStrips::Strip {
  double th = 0;
  TracedBundle bundle;
  double low_at = 0, high_at = 0;  ///< columns of its sides
  TracedRay low, middle, high;
};

TracedStrips::TracedStrips(const TomoGrid& grid, const TracedLight& light, double side_mm,
                           double turn_rad)
    : grid_(grid), light_(light), side_mm_(side_mm), turn_rad_(turn_rad) {}

TracedRay TracedStrips::ray(const Strip& strip, double column) const {
  TracedRay ray;
  light_.vial.trace(strip.th, light_.line(column, strip.bundle), ray);
  return ray;
}

void TracedStrips::of_pixel(double th, int pixel, const TracedBundle& bundle,
                            const std::function<void(const TracedShare&)>& use) const {
  const TracedLine line = light_.line(pixel, bundle);
  const double beside = std::abs(line.x_mm * std::cos(line.angle_rad));
  if (beside - light_.pitch_mm > light_.vial.outside_mm()) return;
  Strip strip{th, bundle, pixel - light_.lit / 2, pixel + light_.lit / 2, {}, {}, {}};
  strip.low = ray(strip, strip.low_at);
  strip.middle = ray(strip, pixel);
  strip.high = ray(strip, strip.high_at);
  add(strip, 0, [&](const TracedShare& s) {
    use({s.x, s.y, s.share * line.transmittance, s.rise_mm});
  });
}

std::vector<double> turns_of_frame(const TomoGrid& grid, int m) {
  const double step = 2 * std::numbers::pi / grid.angles;
  const int angles = traced_angles(grid, step);
  std::vector<double> turns;
  turns.reserve(static_cast<std::size_t>(angles));
  for (int k = 0; k < angles; ++k) turns.push_back(step * (m + (k + 0.5) / angles - 0.5));
  return turns;
}

std::vector<TracedWeight> weights_of(const TracedStrips& strips, const TomoGrid& grid,
                                     const TracedBundle& bundle, const std::vector<double>& turns) {
  const auto n = static_cast<std::size_t>(grid.voxels);
  struct Sum {
    double share = 0, rise_mm = 0;
  };
  std::vector<Sum> sums(n * n);
  std::vector<std::size_t> met;
  std::vector<TracedWeight> found;
  for (int i = 0; i < grid.pixels; ++i) {
    met.clear();
    for (const double th : turns) {
      strips.of_pixel(th, i, bundle, [&](const TracedShare& s) {
        const std::size_t at = static_cast<std::size_t>(s.y) * n + static_cast<std::size_t>(s.x);
        if (sums[at].share == 0) met.push_back(at);
        sums[at].share += s.share;
        sums[at].rise_mm += s.share * s.rise_mm;
      });
    }
    for (const std::size_t at : met) {
      const Sum& sum = sums[at];
      found.push_back({static_cast<std::uint16_t>(at % n), static_cast<std::uint16_t>(at / n),
                       static_cast<std::uint16_t>(i),
                       static_cast<float>(sum.share / static_cast<double>(turns.size())),
                       static_cast<float>(sum.rise_mm / sum.share)});
      sums[at] = {};
    }
  }
  std::stable_sort(found.begin(), found.end(), [](const TracedWeight& a, const TracedWeight& b) {
    return std::pair(a.y, a.x) < std::pair(b.y, b.x);
  });
  return found;
}

void TracedStrips::add(const Strip& strip, int depth,
                       const std::function<void(const TracedShare&)>& use) const {
  const bool alike = strip.low.history == strip.middle.history &&
                     strip.high.history == strip.middle.history &&
                     strip.low.pieces.size() == strip.middle.pieces.size() &&
                     strip.high.pieces.size() == strip.middle.pieces.size();
  bool straight = true;
  if (alike) {
    for (std::size_t k = 0; k < strip.middle.pieces.size(); ++k) {
      const FlatPoint &a = strip.low.pieces[k].along, &b = strip.high.pieces[k].along;
      const double turned = std::abs(a.x_mm * b.y_mm - a.y_mm * b.x_mm);
      straight = straight && turned * grid_.radius_mm < kBends * grid_.voxel_mm();
    }
  }
  if ((!alike || !straight) && depth < kMostHalvings) {
    const double at = (strip.low_at + strip.high_at) / 2;
    Strip one{strip.th, strip.bundle, strip.low_at, at, strip.low, {}, strip.middle},
        other{strip.th, strip.bundle, at, strip.high_at, strip.middle, {}, strip.high};
    one.middle = ray(strip, (one.low_at + at) / 2);
    other.middle = ray(strip, (at + other.high_at) / 2);
    add(one, depth + 1, use);
    add(other, depth + 1, use);
    return;
  }
  const double in_air_mm = (strip.high_at - strip.low_at) * light_.pitch_mm;
  const double voxel = grid_.voxel_mm(), stretch = strip.middle.stretch,
               alpha = light_.vial.alpha_per_mm() * stretch;
  for (std::size_t k = 0; k < strip.middle.pieces.size(); ++k) {
    const TracedPiece& piece = strip.middle.pieces[k];
    // Where a side met other faces, its light is as wide as in air.
    Linear low{in_air_mm / 2, 0}, high{-in_air_mm / 2, 0};
    if (alike) {
      low = beside(piece, strip.low.pieces[k]);
      high = beside(piece, strip.high.pieces[k]);
    }
    const FlatPoint &from = piece.from, &d = piece.along;
    const FlatPoint left{-d.y_mm, d.x_mm};
    const double one = side_mm_ * std::abs(d.x_mm), other = side_mm_ * std::abs(d.y_mm);
    const double widest =
        std::max({std::abs(low.at(0)), std::abs(high.at(0)), std::abs(low.at(piece.length_mm)),
                  std::abs(high.at(piece.length_mm))});
    // The ends of a strip are slanted: voxels beside its middle ray may lie before or behind them.
    Linear begins{0, 0}, ends{piece.length_mm, 0};
    if (alike) {
      begins = slanted(strip.low.pieces[k].from, strip.high.pieces[k].from, piece);
      ends = slanted(end_of(strip.low.pieces[k]), end_of(strip.high.pieces[k]), piece);
    }
    const double margin = voxel / 4, beside_mm = widest + voxel;
    const double beyond =
        std::min(std::max(std::abs(begins.by_mm), std::abs(ends.by_mm)) * beside_mm, 20 * voxel) +
        margin;
    // How far the turn moves light of a place: by its distance along the ray from next to the axis.
    const double nearest = -dot(from, d);
    const double far = std::max(std::abs(nearest), std::abs(piece.length_mm - nearest));
    const double reach = widest + (one + other) / 2 + far * turn_rad_ / 2 +
                         std::abs(low.by_mm - high.by_mm) * beyond + 2 * kLeastBox * voxel;
    const bool by_x = std::abs(d.x_mm) > std::abs(d.y_mm);
    const double d_major = by_x ? d.x_mm : d.y_mm, d_minor = by_x ? d.y_mm : d.x_mm;
    const double from_major = by_x ? from.x_mm : from.y_mm,
                 from_minor = by_x ? from.y_mm : from.x_mm;
    const double a = from_major - beyond * d_major,
                 b = from_major + (piece.length_mm + beyond) * d_major;
    const double across = reach / std::abs(d_major);
    const auto index = [&](double mm) { return (mm + grid_.radius_mm) / voxel; };
    const int first = std::max(0, static_cast<int>(std::ceil(index(std::min(a, b))))),
              last =
                  std::min(grid_.voxels - 1, static_cast<int>(std::floor(index(std::max(a, b)))));
    for (int i = first; i <= last; ++i) {
      const double major = grid_.voxel_at_mm(i);
      const double minor = from_minor + (major - from_major) * d_minor / d_major;
      const int low_j = std::max(0, static_cast<int>(std::ceil(index(minor - across)))),
                high_j =
                    std::min(grid_.voxels - 1, static_cast<int>(std::floor(index(minor + across))));
      for (int j = low_j; j <= high_j; ++j) {
        const int x = by_x ? i : j, y = by_x ? j : i;
        if (!light_.resin[static_cast<std::size_t>(y) * static_cast<std::size_t>(grid_.voxels) +
                          static_cast<std::size_t>(x)]) {
          continue;
        }
        const FlatPoint to{grid_.voxel_at_mm(x) - from.x_mm, grid_.voxel_at_mm(y) - from.y_mm};
        const double s = dot(to, d), t = dot(to, left);
        if (s < begins.at(t) - margin || s > ends.at(t) + margin) continue;
        const double e0 = low.at(s), e1 = high.at(s);
        const double width = std::max(std::abs(e1 - e0), 1e-6 * voxel), middle = (e0 + e1) / 2;
        const Boxes<double> boxes(one / voxel, other / voxel,
                                  std::abs(s - nearest) * turn_rad_ / voxel);
        const double in = boxes.below((middle + width / 2 - t) / voxel) -
                          boxes.below((middle - width / 2 - t) / voxel);
        if (!(in > 0)) continue;
        use({x, y,
             in * in_air_mm / (width * light_.lit) * stretch * piece.power * std::exp(-alpha * s),
             piece.rise_mm + s * strip.middle.rise_per_mm});
      }
    }
  }
}

}  // namespace slicecorr::tomo::detail
