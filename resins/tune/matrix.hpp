// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Covariances of tuning, as Eigen has matrices.
#pragma once

#include <Eigen/Dense>
#include <array>

#include "slicecorr/resins/tune.hpp"

namespace slicecorr::resins {

/// What messages call the unknowns.
inline constexpr std::array<const char*, kTuned> kTunedNames = {"ha", "light", "stray"};

inline Eigen::Matrix3d matrix_of(const TuneMatrix& m) {
  Eigen::Matrix3d out;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      out(i, j) = m[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)];
    }
  }
  return out;
}
inline TuneMatrix matrix_of(const Eigen::Matrix3d& m) {
  TuneMatrix out{};
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      out[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)] = m(i, j);
    }
  }
  return out;
}

}  // namespace slicecorr::resins
