// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The dose inside one layer of one column under inhibiting UV light.
///
/// Between nodes it has peaks and dips: layer by layer a slice acts on a layer from its front on,
/// continuous exposure wherever light changes. Samples show where, the dose itself gives how much.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "cure/layer_floor.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/inhibited.hpp"

namespace slicecorr::detail {

/// Bounds of the dose inside a layer under continuous exposure, from the doses at its ends and in
/// its middle. The dose is smooth: it bends no more than twice as far as these three show.
struct SmoothBounds {
  double low, high;
  SmoothBounds(double lower, double middle, double upper)
      : low(std::min({lower, middle, upper})), high(std::max({lower, middle, upper})) {
    const double first = middle - lower, second = upper - middle, bend = std::abs(second - first);
    if (first * second > 0 && std::min(std::abs(first), std::abs(second)) > 2.0 * bend) return;
    low -= 2.0 * bend;
    high += 2.0 * bend;
  }
};

/// For one thread. Places are distances from the layer's lower end, in slices, 0..1.
class InhibitedLayer {
 public:
  static constexpr int kSamples = InhibitedKernel::kSamples;

  /// `places`: where the dose crosses 1 is asked for, not only how often.
  explicit InhibitedLayer(const InhibitedKernel& kernel, bool places = true);

  /// Begins a layer; `far`: dose at its lower end from slices `near()` and more layers away, without the light that
  /// the platform sends back. `layer`: which one, for kernels whose layers are not alike.
  void begin(double far, int layer = 0);
  /// Adds `weight` times the light of a slice of a level whose layer lies `j` layers further down;
  /// j must not fall from call to call.
  void add(int j, int setting, int level, double weight) { add(j, j, setting, level, weight); }
  /// The same of slices first..last.
  void add(int first, int last, int setting, int level, double weight);
  /// After the last `add`, from the doses at the ends and in the middle: whether it is sure without samples that the
  /// dose does not pass 1, and that none of the layer is less than these three or `known`.
  bool stays(const LayerFloor::Doses& doses, double known);
  /// After the last `add`. Samples the dose at (i + 1) / kSamples. The doses at the ends and in the
  /// middle are the caller's: it knows them better than samples do.
  void sample(double lower, double middle, double upper);
  /// The least dose of the layer, as far as it is below `known` or 1, and where it crosses 1.
  void find(double known, InsideLayer& out);
  /// Whether the dose is at least 1 and `known` all through a layer whose nearest slices all show
  /// one level, with `far` as in `begin`. Begins a layer of its own.
  struct Same {
    int layer, setting, level;
    double weight;
  };
  bool steady_above(const Same& light, double far, double known);
  /// The dose at a place, from the integral itself.
  double at(double t) const;

 private:
  /// Slices first..last of one light.
  struct Light {
    int first, last, setting, level;
    double weight;
  };
  struct Point {
    double t, dose;
    bool kink = false;
  };
  void sharpen(double known);
  /// What one level gives at the points of a layer when all near slices show it.
  struct Steady {
    struct At {
      double light, fade;
    };
    std::vector<At> points;
    double slack = 0;  ///< by how much less the light may be between the points
    double fall = 0;   ///< `fall_` of the layers of the setting
  };
  static int cell(double t) { return std::min(static_cast<int>(t * kSamples), kSamples - 1); }
  double front(const Light& light) const;
  double front_between(const Light& light) const;
  double at_own_place(double t) const;
  bool mark_cells(double known);
  void take_points();
  Point turn(const Point& from, const Point& to, bool least) const;
  double crossing(double low, double high, bool rises) const;

  const InhibitedKernel& kernel_;
  double fall_;             ///< of the logarithm of light in the layer
  const double precision_;  ///< of crossings, in slices
  const bool places_;
  double far_ = 0;
  int layer_ = 0;  ///< at hand
  std::vector<Light> lights_;
  double dose_[kSamples + 1] = {};
  bool marked_[kSamples] = {};
  std::vector<const float*> fine_;           ///< the kernel's, per setting
  std::vector<std::vector<Steady>> steady_;  ///< [setting][level], made when it is asked for
  std::vector<Point> points_;
  double fade_[kSamples];  ///< of what comes from far
  LayerFloor floor_;
};

}  // namespace slicecorr::detail
