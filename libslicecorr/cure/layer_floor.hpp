// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What the dose inside a layer is at least, layer by layer, from the doses at its ends and in its middle.
///
/// With u = e^(-y (1/huv - 1/hb)), the profile f(y) = (e^(-y/hb) (1 - u))^m of a light (front_profile.hpp) has, for
/// m <= 1,
///
///     f'' <= (m/hb)^2 f  beyond its front,    f'' <= 0  as long as  u/(1 - u) >= v,    (e^(m y/hb) f)' >= 0,
///
/// and far light has f'' = (m/hb)^2 f. With t in slices and c = m hs/hb, the sum S of all light whose front is not in the
/// layer has S'' <= c^2 S. So between two places a < b it is nowhere below
///
///     [(b - t) S(a) + (t - a) S(b)] / (b - a) - c^2/2 max(S(a), S(b)) (t - a) (b - t):
///
/// the solution phi of phi'' = c^2 phi with the same ends is a bound, as S - phi could have no lowest point below 0
/// between them, and phi is no greater than at its ends. A light whose front is in the layer is 0 before it, and beyond
/// it, where it is concave, nowhere below the straight line to the next place at which it is known.
#pragma once

#include <algorithm>
#include <vector>

#include "slicecorr/inhibited.hpp"

namespace slicecorr::detail {

/// For one thread. Places are distances from the layer's lower end, in slices, 0..1.
class LayerFloor {
 public:
  explicit LayerFloor(const InhibitedKernel& kernel);

  /// Whether there is such a bound: layer by layer, layers alike in resin without end, no grey by pulses, m <= 1, and
  /// layers in which light is concave beyond its front.
  bool exists() const { return exists_; }
  void begin() { fronts_.clear(); }
  /// Takes slices first .. last further down, which show one level, `weight` times; only while `exists()`.
  void add(int first, int last, int setting, int level, double weight) {
    const double x = kernel_.source(setting, level).front_um * per_um_;
    if (x > first && x < last + 1) take_front(x, setting, level, weight);
  }
  /// The doses of the layer at its lower end (with its own slice's light), in its middle and at its upper end.
  struct Doses {
    double lower, middle, upper;
    double least() const { return std::min({lower, middle, upper}); }
  };
  /// After the last `add`: a dose that no place of the layer is below.
  double least(const Doses& doses) const;
  /// A dose that no place of the layer is above.
  double most(const Doses& doses) const {
    return std::max(doses.middle, doses.upper) * rise_in_half_;
  }

 private:
  /// A light whose front is in the layer, at `t`: its dose in the middle and at the upper end.
  struct Front {
    double t, middle, upper;
  };
  void take_front(double x, int setting, int level, double weight);
  double least_of_half(double from, double to, bool upper_half) const;

  const InhibitedKernel& kernel_;
  bool exists_ = false;
  double per_um_;              ///< slices
  double bend_ = 0;            ///< c^2
  double rise_in_half_ = 1;    ///< e^(c/2)
  std::vector<Front> fronts_;  ///< ascending
};

}  // namespace slicecorr::detail
