// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The dose under inhibiting UV light as one function of the distance from the cured front.
///
/// With s = 1/huv - 1/hb and zf = ln(beta Iuv / Ib) / s, where UV light and blue light cancel, the
/// rate at distance d is, for every pair of intensities,
///
///     (Ib e^(-d/hb) - beta Iuv e^(-d/huv))^m = Ib^m e^(-m zf/hb) rate(d - zf),
///     rate(y) = (e^(-y/hb) - e^(-y/huv))^m for y > 0, and 0 nearer.
///
/// So one table of `rate` and of what lies beyond, `rest(y)` = integral of `rate` from y on, serves
/// all grey levels and settings.
#pragma once

#include <cmath>
#include <cstddef>
#include <vector>

#include "slicecorr/kinetics.hpp"

namespace slicecorr::detail {

/// Immutable; may be shared between threads.
class FrontProfile {
 public:
  explicit FrontProfile(const Kinetics& kinetics);

  /// Where the front of these intensities lies, um above the window; below 0 when it lies behind
  /// the window, without UV light so far behind that UV takes no share of the rate.
  double front_um(double blue_mw_cm2, double inhibiting_mw_cm2) const;
  /// The factor of `rate` and `rest` for a front at `front_um`.
  double amount(double blue_mw_cm2, double front_um) const {
    return blue_mw_cm2 > 0 ? std::pow(blue_mw_cm2, m_) * std::exp(-m_ * front_um / hb_) : 0.0;
  }

  /// The rate at `y_um` above the front, right to 1e-8 of the greatest rate.
  double rate(double y_um) const {
    if (y_um <= 0) return 0;
    if (y_um >= end_) return std::exp(-m_ * y_um / hb_);
    const double p = y_um * per_um_;
    const auto i = static_cast<std::size_t>(p);
    const double u = p - static_cast<double>(i);
    if (i < kBegin) {
      const Begin &low = begin_[i], &high = begin_[i + 1];
      return power(y_um) * cubic(low.rate, low.rate_slope, high.rate, high.rate_slope, u);
    }
    return cubic(node_[i].rate, node_[i].slope, node_[i + 1].rate, node_[i + 1].slope, u);
  }
  double rest(double y_um) const {
    if (y_um <= 0) return whole_;
    if (y_um >= end_) return hb_ / m_ * std::exp(-m_ * y_um / hb_);
    const double p = y_um * per_um_;
    const auto i = static_cast<std::size_t>(p);
    const double u = p - static_cast<double>(i);
    if (i < kBegin) {
      const Begin &low = begin_[i], &high = begin_[i + 1];
      return whole_ -
             y_um * power(y_um) * cubic(low.sum, low.sum_slope, high.sum, high.sum_slope, u);
    }
    return cubic(node_[i].rest, node_[i].fall, node_[i + 1].rest, node_[i + 1].fall, u);
  }

 private:
  /// Values and slopes per cell.
  struct Node {
    double rate, slope, rest, fall;
  };
  /// Near the front the rate begins like y^m: rate / y^m and its integral / y^(m + 1) are smooth.
  struct Begin {
    double rate, rate_slope, sum, sum_slope;
  };
  static constexpr std::size_t kBegin = 8;

  double power(double y) const { return m_ == 1.0 ? y : std::pow(y, m_); }
  static double cubic(double low, double low_slope, double high, double high_slope, double u) {
    const double d = high - low;
    return low + u * (low_slope + u * (3.0 * d - 2.0 * low_slope - high_slope +
                                       u * (low_slope + high_slope - 2.0 * d)));
  }

  double m_, hb_, slope_;  ///< slope_: s
  double end_ = 0;         ///< from here on the share of UV light is below 1e-9
  double per_um_ = 1;      ///< cells per um
  double whole_ = 0;       ///< rest(0)
  std::vector<Node> node_;
  Begin begin_[kBegin + 1] = {};
};

}  // namespace slicecorr::detail
