// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file relief.hpp
/// Light and time with which one exposure gels from a wanted front to a wanted back at each place
/// (dissertation 3.5 and 5.1): reliefs, and roofs of channels that UV light keeps open below.
///
/// z is the distance from the window, heights are base e. After the time t resin is gelled where
///
///     Ib e^(-z/hb) - beta Iuv e^(-z/huv) >= a,   a = (D'c/t)^(1/m).                      (3.15), (3.19)
///
/// Without UV light the front is the window, and Ib = a e^(zb/hb). With it the back zb wants
/// Ib = (a + beta Iuv e^(-zb/huv)) e^(zb/hb), and the front follows, where the left side comes up to a for
/// the first time; with UV light of its own each place gets both, by two equations that are linear in both
/// lights. The greater a, the shorter the time: lamps bound it.
///
/// Pure functions, thread-safe. `InputError` for what does not fit, `InfeasibleError` where no time will do.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "slicecorr/kinetics.hpp"

namespace slicecorr {

/// What is wanted at a place: gelled from front to back, um from the window; back 0: nothing gels.
struct ReliefHeights {
  double front_um = 0, back_um = 0;
  bool operator==(const ReliefHeights&) const = default;
};

struct ReliefGoal {
  double most_blue_mw_cm2 = 0;     ///< what the display gives, > 0
  double most_uv_mw_cm2 = 0;       ///< what the UV lamp gives; 0: there is none
  bool uv_by_place = false;        ///< the lamp shows images
  std::optional<double> time_s{};  ///< this one; else the shortest that the lamps allow
  std::vector<double> weight{};    ///< how much each wish counts, > 0; empty: alike
};

/// Why a place can't be had as it is wanted.
enum class ReliefMiss {
  none,
  /// Its back is so near to the window that the resin would gel behind it first: no light has its back there.
  too_low,
  dim,  ///< it wants more curing or UV light than the lamps give in the time that was asked for
};

struct ReliefLight {
  double blue_mw_cm2 = 0, uv_mw_cm2 = 0;
  ReliefHeights comes;  ///< what gels with it; back 0: nothing
  ReliefMiss miss = ReliefMiss::none;
};

struct ReliefAnswer {
  double time_s = 0;
  double uv_mw_cm2 = 0;             ///< of a flood; the greatest where it is by place
  std::vector<ReliefLight> places;  ///< in the order of the wishes
  /// The least back that can be had with this UV light (of a flood; else without any), um.
  double least_back_um = 0;
};

/// `kinetics` under UV light where a front above 0 is wanted, else without it. Of a flood the one UV light is
/// sought with which the fronts are least off, by the mean of their squares. Places that can't be had
/// get the nearest that can, and say so.
ReliefAnswer find_relief(const Kinetics& kinetics, const std::vector<ReliefHeights>& wanted,
                         const ReliefGoal& goal);

/// What gels from which height to which after a time; back 0: nothing. Found by halving.
ReliefHeights gelled_after(const Kinetics& kinetics, double blue_mw_cm2, double uv_mw_cm2,
                           double time_s);

}  // namespace slicecorr
