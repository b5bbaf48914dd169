// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Rays through both walls of a vial by Snell's law in vectors, and Fresnel's powers: nothing of the closed forms.
#pragma once

#include <array>
#include <cmath>

#include "slicecorr/vial.hpp"

namespace slicecorr::test {

using Vector = std::array<double, 3>;
inline Vector add(const Vector& a, const Vector& b, double f) {
  return {a[0] + f * b[0], a[1] + f * b[1], a[2] + f * b[2]};
}
inline double dot(const Vector& a, const Vector& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

struct Marched {
  Vector entry, direction, exit;
  double power;
};

/// Distance to a cylinder about the z axis: the nearer (-1) or farther (1) crossing. Needs one.
inline double distance_to(const Vector& at, const Vector& along, double radius, int which) {
  const double a = along[0] * along[0] + along[1] * along[1];
  const double b = at[0] * along[0] + at[1] * along[1];
  const double c = at[0] * at[0] + at[1] * at[1] - radius * radius;
  return (-b + which * std::sqrt(b * b - a * c)) / a;
}

/// Snell's law in vectors with Fresnel's powers; the normal looks outwards.
inline Vector refracted(const Vector& in, const Vector& normal, double n, double n_after, double* s,
                        double* p) {
  const double ratio = n / n_after, cosine = -dot(in, normal);
  const double after = std::sqrt(1 - ratio * ratio * (1 - cosine * cosine));
  Vector out{};
  for (std::size_t i = 0; i < 3; ++i) {
    out[i] = ratio * in[i] + (ratio * cosine - after) * normal[i];
  }
  // By fields: t = 2 n cos / (...), and the power is t² times the widths of the beams.
  const double width = n_after * after / (n * cosine);
  const double ts = 2 * n * cosine / (n * cosine + n_after * after);
  const double tp = 2 * n * cosine / (n_after * cosine + n * after);
  *s *= ts * ts * width;
  *p *= tp * tp * width;
  return out;
}

inline Marched march(const Vial& vial, double n_resin, const LightLine& line) {
  const double length = std::hypot(1.0, line.slope_x, line.slope_z);
  Vector along{line.slope_x / length, 1 / length, line.slope_z / length};
  Vector at{line.x_mm, 0, line.z_mm};
  double s = 1, p = 1;
  const auto face = [&](double radius, double n, double n_after) {
    at = add(at, along, distance_to(at, along, radius, -1));
    along = refracted(along, {at[0] / radius, at[1] / radius, 0}, n, n_after, &s, &p);
  };
  if (vial.jacket_outer_mm > 0) {
    face(vial.jacket_outer_mm, vial.n_outside, vial.n_jacket);
    face(vial.jacket_inner_mm, vial.n_jacket, vial.n_between);
  }
  face(vial.outer_mm, vial.jacket_outer_mm > 0 ? vial.n_between : vial.n_outside, vial.n_wall);
  face(vial.inner_mm, vial.n_wall, n_resin);
  return {at, along, add(at, along, distance_to(at, along, vial.inner_mm, 1)), (s + p) / 2};
}

}  // namespace slicecorr::test
