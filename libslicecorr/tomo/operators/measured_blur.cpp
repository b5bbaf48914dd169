// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/operators/measured_blur.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace slicecorr::tomo::detail {

namespace {

/// Pictures at least as wide are told by numbers at whole pixels.
constexpr double kWide = 2 * kBox;
constexpr double kLeast = 1e-4;

/// What part of each picture pixel comes into which pixel, along an axis.
struct Axis {
  Eigen::MatrixXd shares;  ///< [picture pixel][pixel]
  double left = 0;         ///< variance that is not in them
};

/// `light`: of all picture pixels at a place of the axis, in all 1. `side`: of theirs, in pixels.
Axis axis_of(const Eigen::VectorXd& light, double side) {
  const auto count = static_cast<int>(light.size());
  const int in_middle = count / 2;
  const auto at = [&](int i) { return (i - in_middle) * side; };
  double mean = 0, variance = side * side * kBox;
  for (int i = 0; i < count; ++i) mean += light[i] * at(i);
  for (int i = 0; i < count; ++i) variance += light[i] * (at(i) - mean) * (at(i) - mean);
  const int reach = static_cast<int>(std::ceil(0.5 * count * side + 0.5)) + 1;
  Axis axis{Eigen::MatrixXd::Zero(count, 2 * reach + 1), 0};
  if (variance < kWide) {
    // All of it goes the same way, between two pixels.
    const int low = static_cast<int>(std::floor(mean));
    const double share = mean - low;
    axis.shares.col(reach + low).setConstant(1 - share);
    axis.shares.col(reach + low + 1).setConstant(share);
    axis.left = std::max(0.0, variance - share * (1 - share));
    return axis;
  }
  for (int i = 0; i < count; ++i) {
    for (int k = -reach; k <= reach; ++k) {
      const double from = std::max(at(i) - side / 2, k - 0.5),
                   to = std::min(at(i) + side / 2, k + 0.5);
      axis.shares(i, reach + k) = std::max(0.0, to - from) / side;
    }
  }
  // Less the second difference of a box's variance, halved.
  const Eigen::MatrixXd whole = axis.shares;
  const auto last = whole.cols() - 1;
  for (Eigen::Index k = 0; k <= last; ++k) {
    axis.shares.col(k) += kBox * whole.col(k);
    if (k > 0) axis.shares.col(k) -= kBox / 2 * whole.col(k - 1);
    if (k < last) axis.shares.col(k) -= kBox / 2 * whole.col(k + 1);
  }
  return axis;
}

std::vector<float> numbers_of(const Eigen::VectorXd& v) {
  std::vector<float> numbers(static_cast<std::size_t>(v.size()));
  std::transform(v.begin(), v.end(), numbers.begin(),
                 [](double x) { return static_cast<float>(x); });
  return numbers;
}

}  // namespace

MeasuredBlur measured_blur(const SpreadPicture& picture, double column_mm, double row_mm) {
  Eigen::MatrixXd light(picture.width_px, picture.height_px);  // [to the right][upwards]
  std::size_t at = 0;
  for (int y = 0; y < picture.height_px; ++y) {
    for (int x = 0; x < picture.width_px; ++x) {
      light(x, picture.height_px - 1 - y) = (*picture.values)[at++];
    }
  }
  light /= light.sum();
  const double side_mm = 1e-3 * picture.pitch_um;
  const Axis columns = axis_of(light.rowwise().sum(), side_mm / column_mm),
             rows = axis_of(light.colwise().sum().transpose(), side_mm / row_mm);
  const Eigen::MatrixXd weights = columns.shares.transpose() * light * rows.shares;
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(weights, Eigen::ComputeThinU | Eigen::ComputeThinV);
  MeasuredBlur blur{{}, columns.left, rows.left};
  for (Eigen::Index k = 0; k < svd.singularValues().size(); ++k) {
    const double value = svd.singularValues()[k];
    if (value < kLeast * svd.singularValues()[0]) break;
    blur.products.emplace_back(numbers_of(value * svd.matrixU().col(k)),
                               numbers_of(svd.matrixV().col(k)));
  }
  return blur;
}

std::vector<float> widened(const std::vector<float>& numbers, const std::vector<float>& even) {
  const int reach = static_cast<int>(even.size()) - 1, count = static_cast<int>(numbers.size());
  std::vector<float> wide(numbers.size() + 2 * static_cast<std::size_t>(reach));
  for (int i = 0; i < count; ++i) {
    for (int k = -reach; k <= reach; ++k) {
      wide[static_cast<std::size_t>(i + reach + k)] +=
          numbers[static_cast<std::size_t>(i)] * even[static_cast<std::size_t>(std::abs(k))];
    }
  }
  return wide;
}

}  // namespace slicecorr::tomo::detail
