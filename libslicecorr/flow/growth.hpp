// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file growth.hpp
/// A print in time over a plan of any cells: dose between the window and a front that moves. Rings of
/// a disc, slabs of a strip and the cells of a section are such plans. Private to the module.
#pragma once

#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "slicecorr/flow.hpp"

namespace slicecorr::detail {

/// What lies behind a face where it is no cell.
inline constexpr int kFreshBath = -1;  ///< the bath: resin without dose
inline constexpr int kMirror = -2;     ///< an axis, or nothing: as the cell before it

/// Resin goes from `from` to `to` where `flux_um3_s` is above 0.
struct GrowthFace {
  int to = 0, from = kFreshBath;                      ///< `to` is a cell, `from` a cell or the bath
  int beyond_to = kMirror, beyond_from = kFreshBath;  ///< the next ones in the face's line
  double flux_um3_s = 0;  ///< through the whole gap; of rings per 2 pi, of slabs per um of width
  double exchange = 0;    ///< width over distance, by which dose diffuses; 0: not at all
  double reach_um = 0;    ///< from the middle of a cell to the face
};

/// The cells of a slice and what flows between them: into each cell goes S times its area.
struct GrowthPlan {
  std::vector<double> area_um2;  ///< in the unit of the fluxes
  std::vector<GrowthFace> faces;
  /// Of each cell the neighbours, and how far their middles are, um: that far the front may rise.
  std::vector<std::vector<std::pair<int, double>>> near;
  std::vector<double> blue_mw_cm2, uv_mw_cm2;
  std::size_t cells() const { return area_um2.size(); }
};

/// How finely, and from where on.
struct GrowthScale {
  double speed_um_s = 0, first_gap_um = 0;
  double slope = 0;        ///< by which a front may rise for what flows
  double level_um = 0;     ///< height of a level
  std::size_t levels = 0;  ///< above the window
};

/// Y on cells and levels, moved by Q F(z/hf) through each face: what is gelled, Y >= 1, rises with the
/// part, and h is where the lowest such is, or the platform. Heun's two stages with limited slopes.
class GapGrowth {
 public:
  GapGrowth(const FlowResin& resin, const GrowthScale& scale);

  /// From now on the plan is this one; `dose` is Y/D'c of its cells, level by level from the window.
  void set_plan(GrowthPlan plan, std::vector<double> dose);
  /// Of each face, in their order, while the rest of the plan stays.
  void set_fluxes(const std::vector<double>& flux_um3_s);
  void set_light(std::vector<double> blue_mw_cm2, std::vector<double> uv_mw_cm2);

  /// One step, at most this long; gives its length, s.
  double step(double most_s);
  /// Lets time pass in which nothing changes.
  void wait(double seconds) { seconds_ += seconds; }
  /// Finds h and the gap that the flow feels from the dose as it is.
  void find_gap();

  double seconds() const { return seconds_; }
  double platform_um() const { return scale_.first_gap_um + scale_.speed_um_s * seconds_; }
  const GrowthPlan& plan() const { return plan_; }
  const std::vector<double>& dose() const { return y_; }
  const std::vector<double>& gap_um() const { return gap_; }
  /// hf: the least of h + slope times the distance.
  const std::vector<double>& felt_um() const { return felt_; }
  double window_dose(std::size_t cell) const { return y_[cell * nz_]; }
  /// The first cell whose resin has its dose at the window.
  std::optional<std::size_t> stuck() const;
  /// Cells and levels in which dose is being undone.
  std::size_t undone() const;

 private:
  void set_rates();
  void find_flow();
  double longest_step_s() const;
  void find_change(const std::vector<double>& y);
  void add_across(const std::vector<double>& y);
  void add_upward(const std::vector<double>& y);
  double face_gap_um(const GrowthFace& face) const;

  FlowResin resin_;
  GrowthScale scale_;
  double diffusion_um2_s_;
  bool clamped_;
  std::size_t nz_;
  GrowthPlan plan_;
  std::vector<double> store_, gain_;  ///< of cells and levels, relative dose per second
  std::vector<double> y_, stage_, change_;
  std::vector<double> across_;  ///< through faces and levels, from -> to
  std::vector<double> upward_;  ///< of cells, through the bounds of levels
  std::vector<double> gap_, felt_;
  std::vector<double> carried_;
  double seconds_ = 0;
};

}  // namespace slicecorr::detail
