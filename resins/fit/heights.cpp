// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "fit/heights.hpp"

#include <algorithm>
#include <cmath>

#include "slicecorr/bleaching.hpp"
#include "support/numbers/quadrature.hpp"

namespace slicecorr::resins {

namespace {

/// w(s, q) and its derivatives.
struct Root {
  double w = 0, by_s = 0, by_q = 0, by_s_by_q = 0;
};

Root front_root(double s, double q) {
  // The root is that of G = w + ln((e^(-q w) - (1 - q) e^(-s)) / q), which is concave, rises up to
  // it, and is nearly straight where s is not small: Newton's steps from its left never pass it.
  const double rest = (1 - q) * std::expm1(-s);
  // Both are left of it: the root for s = infinity, and that of the parabola at w = 0.
  double w = std::max(std::log(q) / (1 - q), -std::sqrt(2 * s / q));
  for (int i = 0; i < 200; ++i) {
    const double near = std::expm1(-q * w);
    const double inside = (near - rest) / q;
    const double step = -(w + std::log1p(inside)) / (1 - (1 + near) / (1 + inside));
    w += step;
    if (!(step > 1e-16 * std::abs(w))) break;
  }
  Root root;
  root.w = w;
  const double far = std::exp(-w), near = std::exp(-q * w), level = std::exp(-s);
  const double f_w = q * (far - near);
  root.by_s = -(1 - q) * level / f_w;
  root.by_q = (w * near + far - level) / f_w;
  const double f_w_by_q = far - near + q * w * near + q * (q * near - far) * root.by_q;
  root.by_s_by_q = level / f_w + (1 - q) * level * f_w_by_q / (f_w * f_w);
  return root;
}

/// L = 1 / (1/huv - 1/h), and L (ln rho - shift) with derivatives by h, beta and huv.
Height scaled_log(const Slots& law, const Exposure& e, double shift) {
  const double h = law[kHeight], huv = law[kUvHeight];
  const double length = 1 / (1 / huv - 1 / h);
  const double log = std::log(law[kBeta]) + e.ln_uv - e.ln_blue - shift;
  Height z;
  z.um = length * log;
  z.by[kBeta] = length / law[kBeta];
  z.by[kUvHeight] = length / huv * (length / huv) * log;
  z.by[kHeight] = -length / h * (length / h) * log;
  return z;
}

/// Place of the first gel with derivatives.
Height first_gel(const Slots& law, const Exposure& e) {
  const double h = law[kHeight], huv = law[kUvHeight];
  Height z = scaled_log(law, e, std::log(huv / h));
  const double length = z.by[kBeta] * law[kBeta];
  z.by[kUvHeight] -= length / huv;
  z.by[kHeight] += length / h;
  return z;
}

}  // namespace

namespace {

/// By A and B (gel_time.hpp): with s = sqrt(B² + 4 A t), ln ig = 2 ln((B + s) / (2 t)).
Height gel_time_height(const Slots& law, const Exposure& e) {
  const double h = law[kHeight], a = law[kGelA], b = law[kGelB], t = std::exp(e.ln_time);
  const double s = std::sqrt(b * b + 4 * a * t);
  const double excess = e.ln_blue - 2 * (std::log(b + s) - std::log(2.0) - e.ln_time);
  Height z;
  z.um = h * excess;
  z.by[kHeight] = excess;
  z.by[kGelA] = -4 * h * t / (s * (b + s));
  z.by[kGelB] = -2 * h / s;
  return z;
}

/// As `BleachingLaw::length`, with derivatives: of dD / G(D), dG / G² of each parameter.
Height bleached_height(const Slots& law, const Exposure& e) {
  const double fresh = 1 / law[kHeight], bleached = 1 / law[kBleachedHeight];
  const double eb = law[kBleachingDose];
  const BleachingLaw resin(fresh, bleached, eb);
  const double from = std::log(law[kDose]), to = e.ln_blue + e.ln_time;
  Height z;
  z.um = resin.length(std::exp(to), law[kDose]);
  z.by[kDose] = -1 / resin.absorbed(law[kDose]);
  const auto integral = [&](auto per_dose) {
    return gauss_legendre(from, to, [&](double ln_dose) {
      const double dose = std::exp(ln_dose), g = resin.absorbed(dose);
      return -per_dose(dose, -std::expm1(-dose / eb)) * dose / (g * g);
    });
  };
  z.by[kHeight] = -fresh * fresh * integral([&](double, double spent) { return eb * spent; });
  z.by[kBleachedHeight] =
      -bleached * bleached * integral([&](double dose, double spent) { return dose - eb * spent; });
  z.by[kBleachingDose] = integral([&](double dose, double spent) {
    return (fresh - bleached) * (spent - dose / eb * (1 - spent));
  });
  return z;
}

}  // namespace

Height cured_height(const Slots& law, const Exposure& e) {
  if (law[kBleachingDose] > 0) return bleached_height(law, e);
  if (law[kGelA] > 0 || law[kGelB] > 0) return gel_time_height(law, e);
  const double h = law[kHeight], m = law[kExponent];
  const double excess = e.ln_time - std::log(law[kDose]);
  Height z;
  z.um = h * (e.ln_blue + excess / m);
  z.by[kHeight] = e.ln_blue + excess / m;
  z.by[kExponent] = -h * excess / (m * m);
  z.by[kDose] = -h / (m * law[kDose]);
  return z;
}

Height steady_height(const Slots& law, const Exposure& e) { return scaled_log(law, e, 0); }

double first_gel_height(const Slots& law, const Exposure& e) { return first_gel(law, e).um; }

Height front_height(const Slots& law, const Exposure& e) {
  const double h = law[kHeight], huv = law[kUvHeight], m = law[kUvExponent];
  const double q = huv / h;
  const Height z0 = first_gel(law, e);
  const double excess = e.ln_time - std::log(law[kDose]);
  const double s = e.ln_blue - z0.um / h + std::log1p(-q) + excess / m;
  Slots s_by{};
  s_by[kBeta] = -z0.by[kBeta] / h;
  s_by[kUvHeight] = -z0.by[kUvHeight] / h - 1 / (h - huv);
  s_by[kHeight] = (z0.um / h - z0.by[kHeight] + q / (1 - q)) / h;
  s_by[kUvExponent] = -excess / (m * m);
  s_by[kDose] = -1 / (m * law[kDose]);

  const Root root = front_root(std::max(s, kLeastS), q);
  Height z;
  z.gels = s >= 0;
  const double beyond = std::min(0.0, s - kLeastS);
  const double w = root.w + root.by_s * beyond;
  const double w_by_q = root.by_q + root.by_s_by_q * beyond;
  z.um = z0.um + huv * w;
  for (int i = 0; i < kSlots; ++i) {
    const auto k = static_cast<std::size_t>(i);
    z.by[k] = z0.by[k] + huv * root.by_s * s_by[k];
  }
  z.by[kUvHeight] += w + q * w_by_q;
  z.by[kHeight] -= q * q * w_by_q;
  return z;
}

}  // namespace slicecorr::resins
