// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What all patches of a coupled correction share.
#pragma once

#include <algorithm>
#include <array>
#include <functional>
#include <memory>
#include <vector>

#include "correct/coupled_columns.hpp"
#include "cure/distance_sums.hpp"
#include "cure/light_spread.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/dose_target.hpp"
#include "slicecorr/grid.hpp"

namespace slicecorr::detail {

/// Whether columns can be corrected together: not under patterned UV light.
bool can_couple(const CureModel& model);

/// Shares of light that the pixels of a box get, of that of the plan, row by row: of phi, the m-th power of
/// those of intensity.
using LightShares = std::function<void(const PixelBox& box, double* shares)>;

/// UV light that is uneven.
struct UnevenUv {
  LightShares shares{};  ///< of the plan's UV light; empty where it is even
  double most = 1;       ///< of them
  /// The plan of a pixel's own column, which outlives the plan that asks.
  std::function<const CorrectionPlan&(const Pixel&)> plan_of{};
};

struct CoupledPlan {
  /// `column_plan`: with UV light that is not patterned or without; throws `InputError` for others.
  /// `display_box`: beyond it it is dark.
  /// `dose_margin`: how far from 1 doses are aimed at; 0: as levels ask. `light_shares`: empty where
  /// light is even. All but the last three must outlive the plan.
  CoupledPlan(const CorrectionPlan& column_plan, const LightBlur& light_blur,
              const PixelBox& display_box, double dose_margin, LightShares light_shares);

  const CorrectionPlan& columns;
  /// Where columns say which light they want; null where doses are sums of light.
  std::shared_ptr<const CoupledColumns> wants;
  const LightBlur& blur;
  /// How the light of each distance spreads where it scatters; null: doses follow from slice to slice.
  const std::vector<DistanceBlur>* distances = nullptr;
  PixelBox display;
  LightShares shares;
  int slices, layers;
  bool layerwise;
  double a, b, m;
  /// Doses are as they gel, with the light that the platform sends back: that of node n is `gain` times
  /// the light of slice n and `kept` times the dose of node n + 1.
  double gain(int slice) const { return back(slice) * b_of(slice); }
  double kept(int slice) const { return columns.model.a_of(slice) * back(slice) / back(slice + 1); }
  /// What the light of a slice adds to the dose at its node, of the slice's own height; layer by layer light
  /// has the unit of a layer of the usual height.
  double b_of(int slice) const {
    const CureModel& model = columns.model;
    if (model.heights.alike()) return b;
    return layerwise ? model.a_of(slice) * b / a : model.one_minus_a_of(slice);
  }
  /// Dose in the middle of layer n: that of its upper node and `middle_below` times that of the lower
  /// one, over `middle_norm`. Layer by layer nodes are seen from inside their layer.
  double middle_below(int slice) const {
    const double its = layerwise ? 0 : columns.model.root_a_of(slice);
    return its * back(slice) / back(slice + 1);
  }
  double middle_norm(int slice) const {
    const double root = columns.model.root_a_of(slice), its = layerwise ? root : 1 + root;
    return its * back(slice) / back(slice + 0.5);
  }
  /// Whether slices up to this one have factors of their own, so that doses follow no common law. Continuous,
  /// doses go towards the light whatever the heights; layer by layer each height has its own.
  bool mirrored(int slice) const {
    return slice <= columns.model.mirrored_slices || (layerwise && !columns.model.heights.alike());
  }
  double back(double zeta) const { return columns.model.returned(zeta); }
  double below, norm;  ///< `middle_below` and `middle_norm` far from the platform, of usual layers
  double slowest;      ///< the greatest share of a dose that a slice leaves
  /// Slices that the bath holds, and what of the light of the one that leaves it is taken from that of
  /// a slice; 0: the bath has no end.
  int bath;
  double beyond;
  /// Light of phi = 1, so that doses are (1 - a) light + a below in both modes.
  double unit;
  /// Light of a slice over that of `light_of`.
  double ratio(int slice) const { return columns.model.ratio(slice); }
  /// With lifts: dose that an exposure is to leave where a layer meets the one above it; else 0.
  double joint;
  /// The least light of a slice's own exposure in a feature whose column alone gets `own`: it holds, or is
  /// the film that the column has there. 0: it is liquid on purpose, or nothing is lifted.
  double least_own(int slice, double own) const {
    if (!(joint > 0) || own * back(slice + 1) < unit * (1 - 1e-6)) return 0;
    return std::min(joint / gain(slice), own);
  }
  double margin;
  std::array<double, 256> shine_of;  ///< by grey level: what is blurred, light^(1/m)
  std::array<double, 256> light_of;  ///< by grey level
  int top;                           ///< the highest grey level
  double shine_step;                 ///< greatest between two neighbouring levels
  /// Few levels, and light that spreads with a sigma of half a pixel or more along both axes: what a pixel of a
  /// feature has too much is handed on to those beside it.
  bool hands_on;
  /// Doses are wanted: inside features the dose is to be that of the columns alone, which know them.
  bool graded = false;
  /// Which, where columns say which light they want; else null.
  const DoseTarget* doses = nullptr;
  /// Lets columns that are solved again want doses; these must outlive the plan.
  void want(const DoseTarget& its_doses);
  /// Lets light scatter by distances, which must outlive the plan; `light_blur` is that of the first. Where
  /// doses are no sums of light none may scatter.
  void scatter_by(const std::vector<DistanceBlur>& its_distances);
  /// Lets UV light differ from place to place.
  void differ(UnevenUv its_uv);
  UnevenUv uv{};
  /// The plan by which the column of a pixel is solved again; null: that of `wants`.
  const InhibitedPlan* own_plan(const Pixel& pixel) const {
    return uv.plan_of ? &careful->of(uv.plan_of(pixel), most_dose()) : nullptr;
  }
  double most_dose() const { return doses ? doses->scale.greatest() : 1.0; }
  std::shared_ptr<CarefulPlans> careful = std::make_shared<CarefulPlans>();

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
  int overlap_x, overlap_y, halo_x = 0, halo_y = 0;
  /// How requests fade from the slice of a wrong voxel on to those below it, and how far they go.
  double fading;
  int depth;
};

/// Slices after the last layer of a part in which its corners cure, which get a part of the light
/// only; where full light does not do for them, its straight edges. At least `slices_to_gel`, and
/// no more than there are in an absorbance height, from beyond which a tenth of the light is left.
/// `distances` as `CoupledPlan::distances`, empty: nothing scatters.
int slices_to_gel_at_edges(const CureModel& model, const LightBlur& blur,
                           const std::vector<DistanceBlur>& distances = {});

}  // namespace slicecorr::detail
