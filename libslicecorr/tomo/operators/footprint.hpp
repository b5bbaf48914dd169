// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What share of a voxel the light of a square pixel meets: the closed form that both operators take
/// their weights from.
///
/// Seen along the light, the places of a voxel's light are the sum of even variables: its sides along
/// x and y, each as wide as it looks from there, and the way that the turn of the vial moves it while
/// a frame is shown. C is the distribution function of that sum; a pixel from e0 to e1 gets
/// C(e1) - C(e0), and pixels side by side get 1 together.
///
/// Plain arithmetic without branches, which compilers put into vector lanes.
#pragma once

#include <algorithm>
#include <cmath>

namespace slicecorr::tomo::detail {

/// Boxes narrower than this, in pixels, are taken for as wide: C has to be a number of single
/// precision.
inline constexpr double kLeastBox = 0.02;

/// The sum of three boxes of these full widths, and its C.
template <class T>
class Boxes {
 public:
  Boxes(T one, T other, T third) {
    const T least = static_cast<T>(kLeastBox);
    const T a = std::max(std::max(one, other), least), b = std::max(std::min(one, other), least);
    set(a, b, std::max(third, least));
  }

  /// C. Each of the two terms is an integral: of the distribution function of the first two boxes up
  /// to either end of the third.
  [[gnu::always_inline]] T below(T x) const {
    const T high = x + half_c_, low = x - half_c_;
    const T part =
        (at_least_0(high) + lacked(std::abs(high))) - (at_least_0(low) + lacked(std::abs(low)));
    const T c = at_least_0(part * by_c_);
    return c < T(1) ? c : T(1);
  }

 private:
  [[gnu::always_inline]] static T at_least_0(T x) { return x > T(0) ? x : T(0); }
  void set(T a, T b, T c) {
    outer_ = (a + b) / 2;
    inner_ = (a - b) / 2;
    half_c_ = c / 2;
    by_c_ = 1 / c;
    by_6ab_ = 1 / (6 * a * b);
    by_2a_ = 1 / (2 * a);
    corner_ = b * b / (6 * a);
  }
  /// Integral from y >= 0 to infinity of what the first two boxes lack of 1.
  [[gnu::always_inline]] T lacked(T y) const {
    const T k = at_least_0(outer_ - y);
    const T outside = k * k * k * by_6ab_;
    const T inside = corner_ + (inner_ - y) * (T(0.5) - (inner_ + y) * by_2a_);
    return y < inner_ ? inside : outside;
  }

  T outer_, inner_, half_c_, by_c_, by_6ab_, by_2a_, corner_;
};

}  // namespace slicecorr::tomo::detail
