// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What all patches of a coupled correction share.
#pragma once

#include <algorithm>
#include <array>
#include <functional>
#include <memory>
#include <vector>

#include "correct/coupled_uv.hpp"
#include "cure/light_spread.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/grid.hpp"

namespace slicecorr::detail {

/// Whether columns can be corrected together: where doses of a model add up from slice to slice, and
/// under UV light that is not patterned.
bool can_couple(const CureModel& model);

/// Shares of light that the pixels of a box get, of that of the plan, row by row.
using LightShares = std::function<void(const PixelBox& box, double* shares)>;

struct CoupledPlan {
  /// `column_plan`: with UV light that is not patterned or without, in a bath that does not end,
  /// before a platform that sends no light back; throws `InputError` for others. Under UV light no
  /// light may scatter, nor be uneven. `display_box`: beyond it it is dark. `dose_margin`: how far from 1
  /// doses are aimed at; 0: as levels ask. `light_shares`: empty where light is even. All but the
  /// last three must outlive the plan.
  CoupledPlan(const CorrectionPlan& column_plan, const LightBlur& light_blur,
              const SliceScatter& slice_scatter, const PixelBox& display_box, double dose_margin,
              LightShares light_shares);

  const CorrectionPlan& columns;
  std::shared_ptr<const CoupledUv> uv;  ///< null without UV light
  const LightBlur& blur;
  const SliceScatter& scatter;
  PixelBox display;
  LightShares shares;
  int slices, layers;
  bool layerwise;
  double a, b, m;
  /// Dose in the middle of a layer: that of its upper node and `middle_below` times that of the
  /// lower one, over `middle_norm`. Layer by layer nodes are seen from inside their layer.
  double middle_below, middle_norm;
  /// Light of phi = 1, so that doses are (1 - a) light + a below in both modes.
  double unit;
  /// Light of a slice over that of `light_of`.
  double ratio(int slice) const { return columns.model.ratio(slice); }
  /// With lifts: dose that an exposure is to leave where a layer meets the one above it; else 0.
  double joint;
  /// The least light of a slice's own exposure in a feature whose column alone gets `own`: it holds, or is
  /// the film that the column has there. 0: it is liquid on purpose, or nothing is lifted.
  double least_own(double own) const {
    return joint > 0 && own >= unit * (1 - 1e-6) ? std::min(joint / b, own) : 0;
  }
  double margin;
  std::array<double, 256> shine_of;  ///< by grey level: what is blurred, light^(1/m)
  std::array<double, 256> light_of;  ///< by grey level
  int top;                           ///< the highest grey level
  double shine_step;                 ///< greatest between two neighbouring levels
  bool hands_on;  ///< what pixels have too much is handed on in the plane: see `levels_of_plane`

  int reach_x, reach_y;
  /// What a pixel gives to those around it: rows of `taps_width`, the first 2 reach_x + 1 of which
  /// are weights.
  int taps_rows, taps_width;
  std::vector<double> taps;
  std::vector<float> taps_single;
  /// The same nearer than `near_x` and `near_y`, where weights matter for the choice of light.
  int near_x, near_y, near_rows, near_width;
  std::vector<float> near_taps;
  /// Pixels that are tried for one that is missed lie no further from it.
  int try_x, try_y;

  /// Pixels around a patch that are solved with it and thrown away, and those around judged ones
  /// whose doses scatter to them.
  int overlap_x, overlap_y, halo_x, halo_y;
  /// How requests fade from the slice of a wrong voxel on to those below it, and how far they go.
  double fading;
  int depth;
};

/// Slices after the last layer of a part in which its corners cure, which get a part of the light
/// only; where full light does not do for them, its straight edges. At least `slices_to_gel`, and
/// no more than there are in an absorbance height, from beyond which a tenth of the light is left.
int slices_to_gel_at_edges(const CureModel& model, const LightBlur& blur,
                           const SliceScatter& scatter);

}  // namespace slicecorr::detail
