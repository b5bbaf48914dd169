// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file flow_doses.hpp
/// The dose that flowing resin brings to a part's front, slice by slice, with light that was made for
/// it and without (even_dead_zone.hpp finds both). Plain values.
#pragma once

#include <vector>

namespace slicecorr {

/// Of one slice with one light; doses are relative: 1 gels.
struct FrontDose {
  double min = 0, mean = 0, max = 0;
  double within_10 = 0;   ///< share of the section within 10 % of 1
  double max_window = 0;  ///< greatest dose at the window: from 1 on resin sticks to it
  /// Least and greatest dead zone, um: the gap, and by how much the front moves until it has its dose
  /// at the rate that holds in it (one step of the fixed point).
  double dead_zone_min_um = 0, dead_zone_max_um = 0;
};

struct FlowDoses {
  struct Slice {
    int slice = 0;
    double area_mm2 = 0;  ///< of what is lit and has gelled material above
    /// Share of the target's section that is lit: the rest stays dark before edges.
    double lit = 1;
    FrontDose even;     ///< with the light as it is shown
    FrontDose without;  ///< with the best intensities that are the same everywhere
  };
  double gap_um = 0;          ///< dead zone that the light is for
  std::vector<Slice> slices;  ///< in order
  /// Means over all slices by their area; 0 without slices.
  double within_10() const;
  double within_10_without() const;
};

}  // namespace slicecorr
