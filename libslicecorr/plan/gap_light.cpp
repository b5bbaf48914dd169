// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Closed forms of a gap: contrast and the speeds that keep it.

#include <algorithm>
#include <cmath>
#include <limits>

#include "slicecorr/plan.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr {

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Sorted, with what overlaps put together.
std::vector<SpeedRange> united(std::vector<SpeedRange> ranges) {
  std::sort(ranges.begin(), ranges.end(),
            [](const SpeedRange& a, const SpeedRange& b) { return a.least_mm_h < b.least_mm_h; });
  std::vector<SpeedRange> out;
  for (const SpeedRange& r : ranges) {
    if (!out.empty() && r.least_mm_h <= out.back().greatest_mm_h) {
      out.back().greatest_mm_h = std::max(out.back().greatest_mm_h, r.greatest_mm_h);
    } else {
      out.push_back(r);
    }
  }
  return out;
}

/// 1 - a^slices, and a^-slices - 1.
double fall(const PlanLight& light, double slices) {
  return -std::expm1(-slices * light.layer_um / light.lam_um);
}
double rise(const PlanLight& light, double slices) {
  return std::expm1(slices * light.layer_um / light.lam_um);
}

}  // namespace

std::vector<SpeedRange> common(const std::vector<SpeedRange>& a, const std::vector<SpeedRange>& b) {
  std::vector<SpeedRange> out;
  for (const SpeedRange& p : a) {
    for (const SpeedRange& q : b) {
      const SpeedRange both{std::max(p.least_mm_h, q.least_mm_h),
                            std::min(p.greatest_mm_h, q.greatest_mm_h)};
      if (both.least_mm_h <= both.greatest_mm_h) out.push_back(both);
    }
  }
  return united(std::move(out));
}

double PlanLight::a() const { return std::exp(-layer_um / lam_um); }

double PlanLight::burst_um(double speed_mm_h) const {
  const double p = full(speed_mm_h);
  return p > 1 ? -lam_um * std::log1p(-1 / p) : kInfinity;
}

PlanLight plan_light(const CureModel& model, double speed_mm_h) {
  PlanLight light;
  light.smax_mm_h = speed_mm_h * model.phi_max();
  light.smin_mm_h = speed_mm_h * model.phi_min();
  light.layer_um = model.layer_um;
  light.lam_um = model.layer_um / (model.eta * units::kLn10);
  return light;
}

double gap_contrast(const PlanLight& light, int slices, double speed_mm_h) {
  const double p = light.full(speed_mm_h), p0 = light.black(speed_mm_h);
  double best = 0;
  for (int j = 1; j < slices; ++j) {
    best = std::max(best, std::min((1 - p0) * fall(light, j), (p - 1) * rise(light, slices - j)));
  }
  return best;
}

std::vector<SpeedRange> gap_speeds(const PlanLight& light, int slices, double contrast) {
  std::vector<SpeedRange> ranges;
  for (int j = 1; j < slices; ++j) {
    // The greatest black that leaves the contrast after j dark slices.
    const double p0 = 1 - contrast / fall(light, j);
    const double p = 1 + contrast / rise(light, slices - j);
    if (!(p0 > 0)) continue;
    const SpeedRange r{light.smin_mm_h / p0, light.smax_mm_h / p};
    if (r.least_mm_h <= r.greatest_mm_h) ranges.push_back(r);
  }
  return united(std::move(ranges));
}

std::vector<SpeedRange> platform_gap_speeds(const PlanLight& light, int slices, double contrast) {
  const double p0 = 1 - contrast / fall(light, slices);
  if (!(p0 > 0) || light.smin_mm_h / p0 > light.smax_mm_h) return {};
  return {{light.smin_mm_h / p0, light.smax_mm_h}};
}

BestGap best_gap(const PlanLight& light, int slices) {
  BestGap best;
  const double r = light.smin_mm_h / light.smax_mm_h;
  for (int j = 1; j < slices; ++j) {
    // What falls with the speed and what rises with it meet at P = (A + B) / (B + r A).
    const double dark = fall(light, j), lit = rise(light, slices - j);
    const double p = (dark + lit) / (lit + r * dark);
    if ((p - 1) * lit > best.contrast) best = {light.smax_mm_h / p, (p - 1) * lit};
  }
  return best;
}

std::optional<SpeedRange> tolerated_speeds(const PlanLight& light, double tolerance_um,
                                           double light_error) {
  const double share = light.lam_um * light_error / tolerance_um;
  if (!(share < 1)) return std::nullopt;
  const SpeedRange r{light.smin_mm_h / (1 - share), light.smax_mm_h / (1 + share)};
  if (r.least_mm_h > r.greatest_mm_h) return std::nullopt;
  return r;
}

}  // namespace slicecorr
