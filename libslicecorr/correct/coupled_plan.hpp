/// What all patches of a coupled correction share.
#pragma once

#include <array>
#include <vector>

#include "cure/light_spread.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/grid.hpp"

namespace slicecorr::detail {

struct CoupledPlan {
  /// `column_plan`: of continuous exposure without UV light in a bath that does not end; throws
  /// `InputError` for others. `display_box`: beyond it it is dark. `dose_margin`: how far from 1
  /// doses are aimed at; 0: as levels ask. All but the last two must outlive the plan.
  CoupledPlan(const CorrectionPlan& column_plan, const LightBlur& light_blur,
              const SliceScatter& slice_scatter, const PixelBox& display_box, double dose_margin);

  const CorrectionPlan& columns;
  const LightBlur& blur;
  const SliceScatter& scatter;
  PixelBox display;
  int slices, layers;
  double a, b, root_a, m;
  double margin;
  std::array<double, 256> shine_of;  ///< by grey level: what is blurred, phi^(1/m)
  std::array<double, 256> phi_of;    ///< by grey level
  int top;                           ///< the highest grey level
  double shine_step;                 ///< greatest between two neighbouring levels

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

}  // namespace slicecorr::detail
