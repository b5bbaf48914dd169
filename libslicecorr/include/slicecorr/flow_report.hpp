// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file flow_report.hpp
/// Pictures and pages of what a part does to the resin under it, and of prints followed in time.
///
/// Plain values; all functions are thread-safe and throw nothing of their own. The same input gives
/// the same bytes.
#pragma once

#include <string>
#include <vector>

#include "slicecorr/flow_in_time.hpp"
#include "slicecorr/flow_suction.hpp"

namespace slicecorr {

/// Suction under one slice, drawn as a map.
struct FlowMap {
  SliceFlow flow;
  FlowSection section;
  std::vector<double> suction_pa;  ///< cells
};

struct FlowPicture {
  std::string title;
  double layer_um = 0, speed_mm_h = 0, gap_um = 0;
  double limit_pa = 0;
  bool limit_given = false;        ///< by the printer; else resin cavitates there
  std::vector<SliceFlow> slices;   ///< in order, at least one
  std::vector<FlowMap> maps;       ///< of the worst slices, the worst first
  std::vector<std::string> notes;  ///< warnings, a sentence each
};

/// Suction over height, platform up, the dose where it is known, and the maps.
std::string flow_svg(const FlowPicture& picture);
/// The same as PNG.
std::string flow_png(const FlowPicture& picture);
/// A page with the picture, the notes and a table of all slices.
std::string flow_page(const FlowPicture& picture);

struct InTimePicture {
  std::string title, words;  ///< what is shown; lights, speed and how it ends
  double layer_um = 0;
  PrintInTime print;               ///< at least one slice
  std::vector<std::string> notes;  ///< a sentence each
};

/// Fronts along the radius (of parts along a row of cells) for some slices, then over the slices dead
/// zone, dose at the window and suction.
std::string in_time_svg(const InTimePicture& picture);
/// A page with it, the notes and a table of all slices.
std::string in_time_page(const InTimePicture& picture);

}  // namespace slicecorr
