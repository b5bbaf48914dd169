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

/// Of the sum of two boxes of these full widths, what C of three is made of.
template <class T>
struct TwoBoxes {
  T outer, inner, by_6ab, by_2a, corner;

  TwoBoxes(T one, T other) {
    const T least = static_cast<T>(kLeastBox);
    const T a = std::max(std::max(one, other), least), b = std::max(std::min(one, other), least);
    outer = (a + b) / 2;
    inner = (a - b) / 2;
    by_6ab = 1 / (6 * a * b);
    by_2a = 1 / (2 * a);
    corner = b * b / (6 * a);
  }
  /// C with a third box, half as wide as this. Each of the two terms is an integral: of the distribution
  /// function of the first two boxes up to either end of the third.
  [[gnu::always_inline]] T below(T x, T half_c, T by_c) const {
    const T high = x + half_c, low = x - half_c;
    const T part =
        (at_least_0(high) + lacked(std::abs(high))) - (at_least_0(low) + lacked(std::abs(low)));
    const T c = at_least_0(part * by_c);
    return c < T(1) ? c : T(1);
  }

 private:
  [[gnu::always_inline]] static T at_least_0(T x) { return x > T(0) ? x : T(0); }
  /// Integral from y >= 0 to infinity of what the two boxes lack of 1.
  [[gnu::always_inline]] T lacked(T y) const {
    const T k = at_least_0(outer - y);
    const T outside = k * k * k * by_6ab;
    const T inside = corner + (inner - y) * (T(0.5) - (inner + y) * by_2a);
    return y < inner ? inside : outside;
  }
};

/// The sum of three boxes of these full widths, and its C.
template <class T>
class Boxes {
 public:
  Boxes(T one, T other, T third) : two_(one, other) { take_third(third); }
  /// The third is not known yet.
  Boxes(T one, T other) : two_(one, other) {}
  void take_third(T third) {
    const T c = std::max(third, static_cast<T>(kLeastBox));
    half_c_ = c / 2;
    by_c_ = 1 / c;
  }

  /// Beyond this distance from 0 C is 0 or 1.
  T reach() const { return two_.outer + half_c_; }
  [[gnu::always_inline]] T below(T x) const { return two_.below(x, half_c_, by_c_); }

 private:
  TwoBoxes<T> two_;
  T half_c_ = 0, by_c_ = 0;
};

}  // namespace slicecorr::tomo::detail
