// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Correction of columns that share a plan, and what they print, in one pass.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>

#include "pipeline/design_band.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/dead_zone.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/predict.hpp"

namespace slicecorr::detail {

/// Where the slices and figures of columns that share a plan go.
struct ColumnSinks {
  /// Pixels of every slice, from the last to the first; null: black.
  std::function<void(int slice, const std::uint8_t* pixels)> put;
  BandPredictor& after;
  BandPredictor* before;  ///< null: not asked
  WindowWatch* watch;     ///< the same
};

/// Corrects columns and predicts them. `left_alone`: null: nothing; `doses`: null where none are
/// wanted; `most`: as for `BandCorrector::keep_light`, empty without even light. Throws `Cancelled`.
void correct_columns(const CorrectionPlan& plan, std::size_t columns, const DesignReader& read,
                     const CodedBand* left_alone, const BandDoses* doses,
                     BandCorrector::ColumnLevels most, const ColumnSinks& out,
                     const ExecutionContext& context);

}  // namespace slicecorr::detail
