// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "chemistry/plane_filter.hpp"

#include <algorithm>

#include "parallel/silent.hpp"

namespace slicecorr::detail {

PlaneFilter::PlaneFilter(int width, int height, Sides sides)
    : width_(static_cast<std::size_t>(width)),
      height_(static_cast<std::size_t>(height)),
      walls_(sides == Sides::walls),
      periodic_(walls_ ? 1 : height_, walls_ ? 1 : width_),
      between_walls_(walls_ ? height_ : 1, walls_ ? width_ : 1) {}

void PlaneFilter::set(const std::function<double(double, double)>& of) {
  constexpr double pi = 3.14159265358979323846;
  // Wave k of n is 2 pi k / n per cell, or pi k / n where it is mirrored by walls.
  const auto phase = [&](std::size_t k, std::size_t n) {
    return walls_ ? pi * static_cast<double>(k) / static_cast<double>(n)
                  : 2 * pi * static_cast<double>(std::min(k, n - k)) / static_cast<double>(n);
  };
  factor_.resize(width_ * height_);
  for (std::size_t y = 0; y < height_; ++y) {
    for (std::size_t x = 0; x < width_; ++x) {
      factor_[y * width_ + x] = of(phase(x, width_), phase(y, height_));
    }
  }
}

void PlaneFilter::apply(std::vector<double>& field, const ExecutionContext& context) {
  const ExecutionContext quiet = silent(context);
  if (walls_) {
    between_walls_.transform(quiet, field.data(), Way::forward);
    for (std::size_t k = 0; k < field.size(); ++k) field[k] *= factor_[k];
    between_walls_.transform(quiet, field.data(), Way::backward);
    return;
  }
  waves_.assign(field.begin(), field.end());
  periodic_.transform(quiet, waves_.data(), Way::forward, Scale::unitary);
  for (std::size_t k = 0; k < waves_.size(); ++k) waves_[k] *= factor_[k];
  periodic_.transform(quiet, waves_.data(), Way::backward, Scale::unitary);
  for (std::size_t k = 0; k < field.size(); ++k) field[k] = waves_[k].real();
}

}  // namespace slicecorr::detail
