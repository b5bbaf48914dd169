// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "flow/rubber.hpp"

#include <cmath>
#include <numbers>

namespace slicecorr::detail {

namespace {

/// A half-space at r under even suction within the radius a: w G/s.
double half_space(double r, double a) {
  if (a <= 0) return 0;
  if (r <= a) return a / std::numbers::pi * std::comp_ellint_2(r / a);
  const double q = a / r;
  return r / std::numbers::pi * (std::comp_ellint_2(q) - (1 - q * q) * std::comp_ellint_1(q));
}

/// 2 k G L - 1, of x = k t.
double beyond_half_space(double x) {
  // (sinh 2x - 2x) - (cosh 2x + 1 + 2x²), without the great parts of both.
  return -(std::exp(-2 * x) + 1 + 2 * x + 2 * x * x) / (std::cosh(2 * x) + 1 + 2 * x * x);
}

}  // namespace

Eigen::MatrixXd rubber_rise(const std::vector<double>& edges, const std::vector<double>& at,
                            double thickness) {
  const auto rows = static_cast<Eigen::Index>(at.size());
  const auto rings = static_cast<Eigen::Index>(edges.size());
  // Of discs first; rings are differences of neighbours.
  Eigen::MatrixXd discs(rows, rings);
  for (Eigen::Index i = 0; i < rows; ++i) {
    for (Eigen::Index j = 0; j < rings; ++j) {
      discs(i, j) = half_space(at[static_cast<std::size_t>(i)], edges[static_cast<std::size_t>(j)]);
    }
  }
  // The sum over k by Simpson's rule: e^(-2x) is below 1e-15 beyond x = 20, and a Bessel function of R k
  // has some fifty points a wave.
  const double most = 20 / thickness;
  const int steps = 2 * static_cast<int>(std::ceil(most / 0.25));
  const double step = most / steps;
  Eigen::VectorXd of_place(rows), of_edge(rings);
  for (int n = 1; n <= steps; ++n) {
    const double k = n * step;
    const double weight = (n == steps ? 1 : n % 2 == 1 ? 4 : 2) * step / 3;
    for (Eigen::Index i = 0; i < rows; ++i) {
      of_place[i] = std::cyl_bessel_j(0.0, k * at[static_cast<std::size_t>(i)]);
    }
    for (Eigen::Index j = 0; j < rings; ++j) {
      const double a = edges[static_cast<std::size_t>(j)];
      of_edge[j] = a > 0 ? a * std::cyl_bessel_j(1.0, k * a) / (2 * k) : 0;
    }
    discs += weight * beyond_half_space(k * thickness) * of_place * of_edge.transpose();
  }
  // At k = 0 a J1(k a)/(2k) is a²/4.
  for (Eigen::Index j = 0; j < rings; ++j) {
    const double a = edges[static_cast<std::size_t>(j)];
    discs.col(j).array() += step / 3 * beyond_half_space(0) * a * a / 4;
  }
  return discs.rightCols(rings - 1) - discs.leftCols(rings - 1);
}

}  // namespace slicecorr::detail
