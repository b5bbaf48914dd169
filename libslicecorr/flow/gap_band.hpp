// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file gap_band.hpp
/// The balance of dose in one cell over the levels of the gap: a matrix with two diagonals below and
/// one above, solved without pivots (its diagonal dominates).
#pragma once

#include <cmath>
#include <cstddef>
#include <vector>

namespace slicecorr::detail {

/// Levels of the gap, finer towards the window, where resin stays for long: faces at (j/n)^1.5.
struct GapLevels {
  explicit GapLevels(int levels) : face{0} {
    for (int j = 1; j <= levels; ++j) {
      const double s = static_cast<double>(j) / levels, q = s * std::sqrt(s);
      face.push_back(q);
      middle.push_back(0.5 * (q + face[face.size() - 2]));
      top.push_back(j == levels ? 1 : q * q * (3 - 2 * q));
      share.push_back(top.back() - (j > 1 ? top[top.size() - 2] : 0.0));
      const std::size_t m = middle.size();
      slope.push_back(m > 1 ? (q - middle[m - 1]) / (middle[m - 1] - middle[m - 2]) : 0.0);
      if (m > 1) per_step.push_back(1 / (middle[m - 1] - middle[m - 2]));
    }
    per_step.push_back(0);
  }
  std::size_t size() const { return top.size(); }
  std::vector<double> face;      ///< q below level 0, above it, above the next...
  std::vector<double> middle;    ///< q in the middle of each level
  std::vector<double> top;       ///< F at the upper face of each level
  std::vector<double> share;     ///< of the flow in the plan: F at its top less at its bottom
  std::vector<double> slope;     ///< the value at its top is Y + slope (Y - Y of the level below)
  std::vector<double> per_step;  ///< 1 over the way to the next level's middle; 0 at the front
};

/// Factors of one cell: rows j of L are (below2, below, 1), of U (1/inverse, above).
template <typename Number>
struct BandFactors {
  Number* below2;
  Number* below;
  Number* inverse;
  double spread;  ///< c/(S h); the diagonal above is -spread per step
};
using BandView = BandFactors<const double>;

/// One row of the matrix; above it is -spread, but for the last.
struct BandRow {
  double below2 = 0, below = 0, diagonal = 0;
};

/// `diagonal` of the plan's flow, `area` drawn in, `spread` = c/(S h). Faces between levels take the
/// value that the slope below gives (second order).
inline BandRow band_row(const GapLevels& levels, std::size_t j, double diagonal, double area,
                        double spread) {
  const double up = area * levels.top[j];
  BandRow row;
  row.diagonal =
      levels.share[j] * diagonal + up * (1 + levels.slope[j]) + spread * levels.per_step[j];
  if (j == 0) return row;
  const double down = area * levels.top[j - 1], back = spread * levels.per_step[j - 1];
  row.diagonal += back;
  row.below = -up * levels.slope[j] - down * (1 + levels.slope[j - 1]) - back;
  row.below2 = down * levels.slope[j - 1];
  return row;
}

/// Factors rows, `row(j)` each; `fixed(j)`: the level's dose is what the right-hand side says.
template <typename Row, typename Fixed>
void factor_band(const GapLevels& levels, Row row, Fixed fixed, const BandFactors<double>& band) {
  double last_above = 0, before_above = 0, last_inverse = 0, before_inverse = 0;
  for (std::size_t j = 0; j < levels.size(); ++j) {
    const bool held = fixed(j);
    const BandRow r = held ? BandRow{0, 0, 1} : row(j);
    const double below2 = r.below2 * before_inverse;
    const double below = (r.below - below2 * before_above) * last_inverse;
    const double inverse = 1 / (r.diagonal - below * last_above);
    band.below2[j] = below2;
    band.below[j] = below;
    band.inverse[j] = inverse;
    before_above = last_above;
    before_inverse = last_inverse;
    last_above = held ? 0 : -band.spread * levels.per_step[j];
    last_inverse = inverse;
  }
}

/// Solves A y = y in place.
template <typename Fixed>
void solve_band(const GapLevels& levels, const BandView& band, Fixed fixed, double* y) {
  const std::size_t n = levels.size();
  double last = 0, before = 0;
  for (std::size_t j = 0; j < n; ++j) {
    const double v = (y[j] - band.below2[j] * before) - band.below[j] * last;
    before = last;
    last = y[j] = v;
  }
  double next = y[n - 1] *= band.inverse[n - 1];
  for (std::size_t j = n - 1; j-- > 0;) {
    const double above = fixed(j) ? 0 : band.spread * levels.per_step[j] * band.inverse[j];
    next = y[j] = y[j] * band.inverse[j] + above * next;
  }
}

/// Solves A^T y = y in place.
template <typename Fixed>
void solve_transposed(const GapLevels& levels, const BandView& band, Fixed fixed, double* y) {
  const std::size_t n = levels.size();
  double last = y[0] *= band.inverse[0];
  for (std::size_t j = 1; j < n; ++j) {
    const double above = fixed(j - 1) ? 0 : band.spread * levels.per_step[j - 1] * band.inverse[j];
    last = y[j] = y[j] * band.inverse[j] + above * last;
  }
  y[n - 2] -= band.below[n - 1] * y[n - 1];
  for (std::size_t j = n - 2; j-- > 0;) {
    y[j] = (y[j] - band.below2[j + 2] * y[j + 2]) - band.below[j + 1] * y[j + 1];
  }
}

/// Four cells at once, each as by the functions above: their chains of sums run beside each other.
inline constexpr std::size_t kBeside = 4;
void solve_bands(const GapLevels& levels, const BandView* bands, double* const* y);
void solve_bands_transposed(const GapLevels& levels, const BandView* bands, double* const* y);
/// into = share * sum of weight * from, level by level.
void mix_profiles(const GapLevels& levels, const double* y, const int* from, const double* weight,
                  std::size_t count, double* into);
/// Sum of a * y.
double level_sum(std::size_t n, const double* a, const double* y);
/// into of each `from` += weight * y.
void share_profile(std::size_t n, const double* y, const int* from, const double* weight,
                   std::size_t count, double* into);

}  // namespace slicecorr::detail
