// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Covariances of tuning, as Eigen has matrices.
#pragma once

#include <Eigen/Dense>
#include <array>
#include <cmath>

#include "slicecorr/resins/tune.hpp"

namespace slicecorr::resins {

/// What messages call the unknowns.
inline constexpr std::array<const char*, kTuned> kTunedNames = {"ha", "light", "stray", "exchange"};
/// Their places.
inline constexpr std::size_t kStray = 2, kExchange = 3;

inline constexpr int kUnknowns = static_cast<int>(kTuned);
/// The light of a brightest level that was 1, with the stray light that was found.
inline double full_light(const TuneVector& x) { return 1 + x[kStray] * std::exp(-x[1]); }

using TunedMatrix = Eigen::Matrix<double, kUnknowns, kUnknowns>;
using TunedVector = Eigen::Matrix<double, kUnknowns, 1>;

inline TunedMatrix matrix_of(const TuneMatrix& m) {
  TunedMatrix out;
  for (int i = 0; i < kUnknowns; ++i) {
    for (int j = 0; j < kUnknowns; ++j) {
      out(i, j) = m[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)];
    }
  }
  return out;
}
inline TuneMatrix matrix_of(const TunedMatrix& m) {
  TuneMatrix out{};
  for (int i = 0; i < kUnknowns; ++i) {
    for (int j = 0; j < kUnknowns; ++j) {
      out[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)] = m(i, j);
    }
  }
  return out;
}

}  // namespace slicecorr::resins
