// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Filters of real fields on a plane of cells, by their waves.
#pragma once

#include <complex>
#include <functional>
#include <vector>

#include "fourier/fft.hpp"
#include "slicecorr/chemistry_pattern.hpp"

namespace slicecorr::detail {

/// Multiplies each wave of a field by a real number, the same for waves that run the other way; with
/// walls the waves are cosines. Not thread-safe; results are the same for any number of threads.
class PlaneFilter {
 public:
  PlaneFilter(int width, int height, Sides sides);
  /// `of` is asked for the phases per cell along x and y, 0..pi.
  void set(const std::function<double(double, double)>& of);
  /// `field`: width x height numbers, row by row.
  void apply(std::vector<double>& field, const ExecutionContext& context);

 private:
  std::size_t width_, height_;
  bool walls_;
  PlaneFft<double> periodic_;
  PlaneDct<double> between_walls_;
  std::vector<double> factor_;
  std::vector<std::complex<double>> waves_;
};

}  // namespace slicecorr::detail
