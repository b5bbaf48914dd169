// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/operators/ray_map.hpp"

#include <algorithm>
#include <cmath>

#include "parallel/silent.hpp"

namespace slicecorr::tomo::detail {

namespace {

constexpr int kSteps = 30;
/// Of pixels, to which Newton's method meets a place.
constexpr double kMet = 1e-7;

/// A ray between those of pixels.
struct Between {
  double t = 0, entry = 0, slope = 0, power = 0;
  double half = 0;
  double z(double u) const { return entry + slope * (u + half); }
};

/// Rays of a frame, linear between pixels and beyond the outer ones that meet the resin.
class Frame {
 public:
  Frame(const LabRays& rays, int ray) : rays_(rays), ray_(ray) {
    for (int r = 0; r < rays.rows; ++r) {
      int first = rays.columns, last = -1;
      for (int c = 0; c < rays.columns; ++c) {
        if (!(at(c, r).half_mm > 0)) continue;
        first = std::min(first, c);
        last = c;
      }
      first_.push_back(first);
      last_.push_back(last);
    }
  }

  bool any() const {
    for (std::size_t r = 0; r < first_.size(); ++r) {
      if (last_[r] > first_[r]) return true;
    }
    return false;
  }

  Between of(double column, double row) const {
    const int r = std::clamp(static_cast<int>(std::floor(row)), 0, std::max(rays_.rows - 2, 0));
    if (rays_.rows == 1) return on_row(column, 0);
    return mix(on_row(column, r), on_row(column, r + 1), row - r);
  }

 private:
  const LabRay& at(int c, int r) const {
    return rays_.rays[(static_cast<std::size_t>(c) * static_cast<std::size_t>(rays_.rows) +
                       static_cast<std::size_t>(r)) *
                          static_cast<std::size_t>(rays_.per_pixel) +
                      static_cast<std::size_t>(ray_)];
  }
  Between mix(const Between& a, const Between& b, double w) const {
    Between m;
    m.t = a.t + w * (b.t - a.t);
    m.entry = a.entry + w * (b.entry - a.entry);
    m.slope = a.slope + w * (b.slope - a.slope);
    m.power = std::max(0.0, a.power + w * (b.power - a.power));
    m.half = std::sqrt(std::max(0.0, rays_.vial_mm * rays_.vial_mm - m.t * m.t));
    return m;
  }
  Between pixel(int c, int r) const {
    const LabRay& ray = at(c, r);
    return {ray.t_mm, ray.entry_z_mm, ray.slope, ray.power, ray.half_mm};
  }
  Between on_row(double column, int r) const {
    const int first = first_[static_cast<std::size_t>(r)],
              last = last_[static_cast<std::size_t>(r)];
    if (last <= first) return {};
    const int c = std::clamp(static_cast<int>(std::floor(column)), first, last - 1);
    return mix(pixel(c, r), pixel(c + 1, r), column - c);
  }

  const LabRays& rays_;
  int ray_;
  std::vector<int> first_, last_;  ///< columns that meet the resin, per row
};

struct Found {
  float parts[RayMapPart::count] = {};
};

/// Newton's method from `found`'s place.
Found source_of(const Frame& frame, const LabRays& rays, double t, double u, double z,
                const Found& near) {
  double column = near.parts[RayMapPart::column], row = near.parts[RayMapPart::row];
  Found found;
  for (int step = 0; step < kSteps; ++step) {
    const Between now = frame.of(column, row);
    const Between right = frame.of(column + 0.5, row), left = frame.of(column - 0.5, row);
    const Between above = frame.of(column, row + 0.5), under = frame.of(column, row - 0.5);
    const double tc = right.t - left.t, tr = above.t - under.t;
    const double zc = right.z(u) - left.z(u), zr = above.z(u) - under.z(u);
    const double det = tc * zr - tr * zc;
    if (!(tc > 0 && zr > 0 && det > 0)) return {};
    const double dt = t - now.t, dz = z - now.z(u);
    const double by_column = (dt * zr - dz * tr) / det, by_row = (dz * tc - dt * zc) / det;
    const double stretch = std::sqrt(1 + now.slope * now.slope);
    const double way = std::max(0.0, now.half + u) * stretch;
    found.parts[RayMapPart::column] = static_cast<float>(column);
    found.parts[RayMapPart::row] = static_cast<float>(row);
    found.parts[RayMapPart::along] = static_cast<float>(zr / det);
    found.parts[RayMapPart::up] = static_cast<float>(tc / det);
    found.parts[RayMapPart::slope] = static_cast<float>(now.slope);
    found.parts[RayMapPart::light] = static_cast<float>(
        now.half > 0 ? now.power * rays.pixel_area_mm2 * stretch / det *
                           std::exp(-rays.alpha_per_mm * way) * rays.depth.at(way)
                     : 0);
    if (std::abs(by_column) + std::abs(by_row) < kMet) return found;
    column += by_column;
    row += by_row;
  }
  return {};
}

}  // namespace

RayMap::RayMap(const TomoGrid& grid, const LabRays& rays, int ray, int up) : grid_(grid) {
  const double slice_mm = grid.slice_height_mm(), height_mm = slice_mm * (grid.slices - 1);
  heights_ = std::clamp(static_cast<int>(std::ceil(height_mm * up / rays.vial_mm)), 1, 512) + 1;
  height_mm_ = height_mm / (heights_ - 1);
  most_mm_ = grid.radius_mm;
  const auto column = static_cast<std::size_t>(heights_) * RayMapPart::count;
  nodes_.assign(static_cast<std::size_t>(kAcross) * kAlong * column, 0.0F);
  const Frame frame(rays, ray);
  if (!frame.any()) return;
  parallel_for({}, "", kAcross, [&](std::size_t t) {
    const double t_mm = most_mm_ * (2.0 * static_cast<double>(t) / (kAcross - 1) - 1);
    for (int u = 0; u < kAlong; ++u) {
      const double u_mm = most_mm_ * (2.0 * u / (kAlong - 1) - 1);
      float* const to = nodes_.data() + (t * kAlong + static_cast<std::size_t>(u)) * column;
      Found near;
      near.parts[RayMapPart::column] = static_cast<float>(0.5 * (rays.columns - 1));
      near.parts[RayMapPart::row] = static_cast<float>(0.5 * (rays.rows - 1));
      for (int h = 0; h < heights_; ++h) {
        const Found found =
            source_of(frame, rays, t_mm, u_mm, grid.lowest_mm + height_mm_ * h, near);
        const bool is = found.parts[RayMapPart::along] > 0;
        if (is) near = found;
        for (int p = 0; p < RayMapPart::count; ++p) {
          to[p * heights_ + h] = p == RayMapPart::light ? found.parts[p] : near.parts[p];
        }
      }
    }
  });
  const bool all_depths = rays.depth.all();
  for (int t = 0; t < kAcross; ++t) {
    for (int u = 0; u < kAlong; ++u) {
      const float* const at = node(t, u);
      for (int h = 0; h < heights_; ++h) {
        // Light of other depths lies between nodes, too.
        const int known = all_depths ? RayMapPart::light : RayMapPart::along;
        if (!(at[known * heights_ + h] > 0)) continue;
        const auto most = [&](double& of, int part) {
          of = std::max<double>(of, std::abs(at[part * heights_ + h]));
        };
        most(most_along_, RayMapPart::along);
        most(most_up_, RayMapPart::up);
        most(most_slope_, RayMapPart::slope);
      }
    }
  }
}

double RayMap::height_of(int slice) const {
  return height_mm_ > 0 ? grid_.slice_height_mm() * slice / height_mm_ : 0;
}

void RayMap::over(double t_mm, double u_mm, float* parts, int count) const {
  const double ft = (t_mm / most_mm_ + 1) * 0.5 * (kAcross - 1),
               fu = (u_mm / most_mm_ + 1) * 0.5 * (kAlong - 1);
  const int t = std::clamp(static_cast<int>(std::floor(ft)), 0, kAcross - 2),
            u = std::clamp(static_cast<int>(std::floor(fu)), 0, kAlong - 2);
  const auto wt = static_cast<float>(std::clamp(ft - t, 0.0, 1.0)),
             wu = static_cast<float>(std::clamp(fu - u, 0.0, 1.0));
  const float *a = node(t, u), *b = node(t, u + 1), *c = node(t + 1, u), *d = node(t + 1, u + 1);
  const float wa = (1 - wt) * (1 - wu), wb = (1 - wt) * wu, wc = wt * (1 - wu), wd = wt * wu;
  const int n = heights_ * count;
  for (int i = 0; i < n; ++i) parts[i] = wa * a[i] + wb * b[i] + wc * c[i] + wd * d[i];
}

}  // namespace slicecorr::tomo::detail
