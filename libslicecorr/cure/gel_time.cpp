// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/gel_time.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "slicecorr/error.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr {

namespace {

/// What light gives in the time in which the window moves an absorbance height, and two of them.
CutLight per_light_of(const GelTime& g, double height_e_um, double speed_mm_h) {
  const double height_s = height_e_um * 1e-4 / units::cm_s_from_mm_h(speed_mm_h);
  return {height_s / g.A, 2.0 * height_s / g.B};
}

/// The dose of light for ever: x (1 - q²) = y q, q² the share of the light that is left at the cut.
double whole_dose(const CutLight& l) {
  return l.x > 0 ? 2.0 * l.x * l.y / (l.y + std::sqrt(l.y * l.y + 4.0 * l.x * l.x)) : 0.0;
}

/// ln i and ln t_gel at evenly spaced ln i.
struct Range {
  std::vector<double> ln_i, ln_t;
  double mean_i = 0, mean_t = 0;
};

Range range_of(const GelTime& g, double from, double to, int points) {
  if (!(from > 0 && to > from && std::isfinite(to))) {
    throw InputError(fmt::format(
        "intensities from {:g} to {:g} mW/cm²; expected a range that begins above 0 and rises",
        from, to));
  }
  if (points < 2) throw InputError(fmt::format("{} intensities; expected 2 or more", points));
  Range r;
  for (int k = 0; k < points; ++k) {
    const double ln_i = std::log(from) + std::log(to / from) * k / (points - 1);
    r.ln_i.push_back(ln_i);
    r.ln_t.push_back(std::log(gel_time_s(g, std::exp(ln_i))));
    r.mean_i += ln_i / points;
    r.mean_t += r.ln_t.back() / points;
  }
  return r;
}

NearestLaw law_of(const GelTime& g, const Range& r, double m) {
  NearestLaw law;
  law.m = m;
  const double ln_dose = r.mean_t + m * r.mean_i;
  law.critical_dose_prime = std::exp(ln_dose);
  for (std::size_t k = 0; k < r.ln_i.size(); ++k) {
    const double ln_off = ln_dose - m * r.ln_i[k] - r.ln_t[k];
    law.worst_error = std::max(law.worst_error, std::expm1(std::abs(ln_off)));
  }
  // The speed over the height at which full light just gels: i = A r + (B r / 2)².
  const double i = std::exp(r.ln_i.back()), b = g.B * std::sqrt(i);
  const double rate = 2.0 * i / (g.A + std::sqrt(g.A * g.A + b * b));
  law.continuous_dose = std::exp(m * r.ln_i.back() - ln_dose) / (m * rate);
  return law;
}

}  // namespace

double passing_dose(const GelTime& g, double mw_cm2, double height_e_um, double speed_mm_h) {
  const CutLight per = per_light_of(g, height_e_um, speed_mm_h);
  return whole_dose({per.x * mw_cm2, per.y * std::sqrt(mw_cm2)});
}

NearestLaw nearest_kinetic(const GelTime& g, double from, double to, int points) {
  const Range r = range_of(g, from, to, points);
  double both = 0, square = 0;
  for (std::size_t k = 0; k < r.ln_i.size(); ++k) {
    const double di = r.ln_i[k] - r.mean_i;
    both += di * (r.ln_t[k] - r.mean_t);
    square += di * di;
  }
  return law_of(g, r, -both / square);
}

NearestLaw nearest_jacobs(const GelTime& g, double from, double to, int points) {
  return law_of(g, range_of(g, from, to, points), 1.0);
}

GelTimeKernel::GelTimeKernel(const GelTime& g, double height_e_um, const Process& process,
                             double layer_um, std::vector<double> level_mw_cm2, GreyLight grey)
    : gel_time_(g),
      layerwise_(process.mode == ExposureMode::layerwise),
      pulsed_(grey == GreyLight::pulsed),
      slope_(layer_um / height_e_um),
      level_mw_cm2_(std::move(level_mw_cm2)) {
  fade_ = fade(1.0);
  if (layerwise_) {
    per_light_ = {process.exposure_s / g.A, process.exposure_s / g.B};
  } else {
    per_light_ = per_light_of(g, height_e_um, process.speed_mm_h);
  }
  if (layerwise_) {
    longest_ = std::max(1.0, process.bottom_exposure_s / process.exposure_s);
    for (const double s : process.layer_exposure_s) {
      longest_ = std::max(longest_, s / process.exposure_s);
    }
  } else if (process.slice_lamps == SliceLamps::stay) {
    for (const double mm_h : process.slice_speed_mm_h) {
      longest_ = std::max(longest_, process.speed_mm_h / mm_h);
    }
  }
  if (light_differs(process)) {
    const double usual = usual_light_share(process);
    double most = 1;
    for (std::size_t n = 0; n < process.light_share.size(); ++n) {
      const double share = light_share(process, static_cast<int>(n)) / usual;
      root_share_.push_back(std::sqrt(share));
      most = std::max(most, share);
    }
    longest_ *= most;
  }
  take_light();
}

double GelTimeKernel::least_share(int first) const {
  if (root_share_.empty()) return 1;
  const auto from = std::min(static_cast<std::size_t>(std::max(0, first)), root_share_.size() - 1);
  const double root =
      *std::min_element(root_share_.begin() + static_cast<std::ptrdiff_t>(from), root_share_.end());
  return root * root;
}

void GelTimeKernel::take_light() {
  light_.clear();
  const double black = level_mw_cm2_.front(), full = level_mw_cm2_.back();
  for (const double i : level_mw_cm2_) {
    light_.push_back(light_of(i));
    if (!pulsed_ || !(i > black && i < full)) continue;
    const double share = (i - black) / (full - black);
    light_.back().y = (1 - share) * light_of(black).y + share * light_of(full).y;
  }
  const double in_all = layerwise_ ? -longest_ / std::expm1(-slope_) : longest_;
  const double most = std::max(1.0, light_.back().x * in_all);
  reach_ = 1 + static_cast<int>(std::min(1e6, std::ceil(std::log(most / kLeftOut) / slope_)));
}

GelTimeKernel GelTimeKernel::with_light(double factor) const {
  GelTimeKernel other = *this;
  for (double& i : other.level_mw_cm2_) i *= factor;
  other.take_light();
  return other;
}

CutLight GelTimeKernel::light_of(double mw_cm2) const {
  return {per_light_.x * mw_cm2, per_light_.y * std::sqrt(mw_cm2)};
}

CutLight GelTimeKernel::fade(double slices) const {
  const double y = std::exp(-0.5 * slope_ * slices);
  return {y * y, y};
}

CutLight GelTimeKernel::light_of_phi(double phi) const {
  if (!pulsed_) return light_of(intensity_mw_cm2(phi));
  const auto nearer = [&](const CutLight& a, const CutLight& b) {
    return std::abs(phi_of(a) - phi) < std::abs(phi_of(b) - phi);
  };
  return *std::min_element(light_.begin(), light_.end(), nearer);
}

double GelTimeKernel::phi_of(const CutLight& l) const {
  if (!(l.x > 0)) return 0;
  return layerwise_ ? l.x * l.y / (l.x + l.y) : whole_dose(l);
}

double GelTimeKernel::intensity_mw_cm2(double phi) const {
  if (!(phi > 0)) return 0;
  const double ux = per_light_.x, uy = per_light_.y;
  // Continuous: Omega + (x / y²) Omega² = x. Layer by layer: 1 / Omega = 1 / x + 1 / y.
  if (!layerwise_) return (phi + ux / (uy * uy) * phi * phi) / ux;
  const double b = phi / uy;
  const double root = 0.5 * (b + std::sqrt(b * b + 4.0 * phi / ux));
  return root * root;
}

double GelTimeKernel::dose_at_end(double mw_cm2, double slices) const {
  const CutLight l = light_of(mw_cm2);
  if (!(l.x > 0)) return 0;
  const double end = fade(slices).y;
  // x (1 - q²) = y (q - end)
  const double q =
      2.0 * (l.x + l.y * end) / (l.y + std::sqrt(l.y * l.y + 4.0 * l.x * (l.x + l.y * end)));
  return l.y * std::max(0.0, q - end);
}

double GelTimeKernel::slices_to_gel(double mw_cm2) const {
  const CutLight l = light_of(mw_cm2);
  const double end = l.x > 1.0 ? std::sqrt(1.0 - 1.0 / l.x) - 1.0 / l.y : 0.0;
  return end > 0 ? -2.0 * std::log(end) / slope_ : std::numeric_limits<double>::infinity();
}

double GelTimeKernel::dose_through_layer(double mw_cm2, double ratio, int layer,
                                         double height) const {
  const CutLight l = in_slice(layer, light_of(mw_cm2), ratio),
                 left = height == 1 ? fade_ : fade(height);
  const double x = l.x * left.x, y = l.y * left.y;
  return x > 0 ? x * y / (x + y) : 0.0;
}

}  // namespace slicecorr
