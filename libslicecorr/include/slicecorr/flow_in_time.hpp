// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file flow_in_time.hpp
/// A print followed in time, slice by slice: where the curing front is, the dead zone under it, what
/// flows in and the dose that resin has at the window, from the first instant to where nothing changes
/// any more (dissertation, chapter IV's time-dependent model in the limit of a thin gap).
///
/// Dose lies on cells of the plan and levels over the window, and is moved by Q F(z/hf) through the
/// faces of cells (flow.hpp). Resin whose dose is the gel dose or more is gelled and rises with the part;
/// the front h is where the lowest such is, or the platform. The flow feels hf, the least over all places
/// of h + slope times the distance. What comes in at an outline is fresh. Heun's two stages, limited
/// slopes; explicit in time, so that finer cells cost by their square.
///
/// Discs and strips go along their radius, sections on the cells of `FlowPart`, where Q comes from the
/// pressure under the gap as it is. Cells without gelled material above are bath; what is first lit in
/// a slice is bath in it and begins in the next with resin without dose. Dark voids that the bath does
/// not reach fill through the gap without light.
///
/// Functions are pure and give the same bits for any number of threads. `InputError` for what does not
/// fit, `InfeasibleError` where no dead zone can be, `Cancelled`.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "slicecorr/flow_disc.hpp"
#include "slicecorr/flow_part.hpp"
#include "slicecorr/flow_suction.hpp"
#include "slicecorr/layer_heights.hpp"
#include "slicecorr/parallel.hpp"

namespace slicecorr {

struct InTime {
  double layer_um = 50;  ///< of discs and strips; parts have their own. > 0
  /// How many are followed, 1 or more; of a part at most its own, without those at its end in which no cell has
  /// gelled material above.
  int slices = 60;
  double first_gap_um = 25;  ///< between window and platform at the first instant, > 0
  double slope = 0.7;        ///< by which the front may rise for what flows, > 0
  double level_um = 5;       ///< height of a level over the window, > 0
  double top_um = 600;       ///< how far levels go: 4 to 2000 of them
  int cells = 40;            ///< of a disc or strip, from the middle to the edge, 4..1000
  LayerHeights heights{};    ///< of a part, where its slices are of different heights
};

/// After a slice has been exposed.
struct SliceInTime {
  int slice = 0;
  double seconds = 0;   ///< since the first instant
  double area_mm2 = 0;  ///< under which resin is drawn in; of a strip per mm of its length
  /// The dead zone, um: least, mean by area (what is no front counts as `top_um`) and greatest of places
  /// that are further from an outline than it is thick there (of all where none is).
  double min_um = 0, mean_um = 0, max_um = 0;
  double middle_um = 0;     ///< at the place furthest from outlines, the first of equal ones
  double void_share = 0;    ///< of the area: nothing is gelled below `top_um` or the platform
  LevelFront level;         ///< of discs and strips by radius, of sections by area
  double window_dose = 0;   ///< greatest relative dose at the window; 1 sticks
  double least_dose = 0;    ///< least of all: below 0 it is inhibitor in store
  double inflow_mm3_s = 0;  ///< through outlines and gap
  double rim_mm_s = 0;      ///< greatest mean velocity through an outline
  double suction_pa = 0, force_n = 0;  ///< greatest; of a strip N per mm
  /// Along the radius, or from the left along the row of cells through the middle: places, h and the
  /// window's dose.
  std::vector<double> place_mm, gap_um, window_along;
};

/// Where and when resin had its gel dose at the window: the print ends there.
struct StuckInTime {
  int slice = 0;
  double seconds = 0;
  double x_mm = 0, y_mm = 0;  ///< on the plate; of discs and strips x is the radius
};

struct PrintInTime {
  std::vector<SliceInTime> slices;
  std::optional<StuckInTime> sticks;
  /// The first slice from which on least and middle of the dead zone stay within 1 um and 2 % of the
  /// last, and the window's dose within 0.02, while the area stays the same: at least five slices, or
  /// nothing.
  std::optional<int> steady_from;
  double top_um = 0;
  std::size_t undone_places = 0;  ///< as in `DiscDose`, cells and levels at the end
};

PrintInTime follow_disc(const FlowResin& resin, const DiscPrint& print, const DiscLight& light,
                        const InTime& how = {});

/// The light of a cell of `FlowPart::grid` in a slice.
using LightInTime = std::function<FlowLight(int slice, std::size_t cell)>;
/// Slices are exposed one after the other, each for its height over the speed. `pull` says speed, resin
/// and, where `light` is empty, one even light. Throws `InputError`, naming the slice, where a slice is
/// less than three cells across.
PrintInTime follow_part(const FlowPart& part, const FlowPull& pull, const InTime& how = {},
                        const LightInTime& light = {}, const ExecutionContext& context = {});

}  // namespace slicecorr
