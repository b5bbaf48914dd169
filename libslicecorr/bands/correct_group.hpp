// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The one way through the correction: columns of equal light become pixels, and what listens beside is
/// told what they print.
#pragma once

#include "bands/design_groups.hpp"
#include "bands/place_plans.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/dead_zone.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/predict.hpp"
#include "slicecorr/uncertain_print.hpp"

namespace slicecorr::detail {

/// What is told of a group, and within what light it is corrected; of all but `put` what is null is not
/// asked.
struct GroupListeners {
  PutRows put;  ///< pixels of every slice, from the last to the first
  BandPredictor* after = nullptr;
  BandPredictor* before = nullptr;  ///< of the target as it is sliced; not of a robust correction
  WindowWatch* watch = nullptr;
  DesignSink design = {};  ///< the design as it is corrected, first slice first
  /// Of a robust correction: what the plain one prints, and the figures of both.
  BandPredictor* plain = nullptr;
  RobustFigures* robust = nullptr;
  BandCorrector::ColumnLevels most = {};  ///< as for `BandCorrector::keep_light`; of even light
};

/// Corrects columns that share a plan. The group's light (`DesignGroup::value`) counts for nothing.
/// Throws `Cancelled`.
void correct_group(const CorrectionPlan& plan, const DesignGroup& group, const GroupListeners& to,
                   const ExecutionContext& context);
/// The same by the plan of the group's light, robust where the plans are, with their even light.
void correct_group(const PlacePlans& plans, const DesignGroup& group, const GroupListeners& to,
                   const ExecutionContext& context);

/// Gives the pixels of a corrected band, from the last slice to the first. Throws as `correct_group`.
void correct_band(const SliceSource& target, const PlacePlans& plans, const PixelBox& band,
                  const PutRows& put, const ExecutionContext& context = {});

}  // namespace slicecorr::detail
