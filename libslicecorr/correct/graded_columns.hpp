// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Levels of columns of whose features doses are wanted (docs/graded-dose.md).
#pragma once

#include <cstdint>
#include <memory>

#include "slicecorr/correct.hpp"

namespace slicecorr::detail {

/// A column: coverage, wanted doses and what is left alone of `plan.layers` layers, heights of one more.
/// `left_alone`: pixels, 0: corrected; null: nothing is.
struct GradedColumn {
  const std::uint8_t *coverage, *heights, *doses, *left_alone;
};

/// Solves columns one by one; keeps its buffers. For one thread.
class GradedColumns {
 public:
  virtual ~GradedColumns() = default;
  /// `levels`: of all slices.
  virtual void solve(const GradedColumn& column, std::uint8_t* levels) = 0;
};

/// Layer by layer. The plan and the scale outlive it.
std::unique_ptr<GradedColumns> make_graded_layers(const CorrectionPlan& plan,
                                                  const DoseScale& scale);

}  // namespace slicecorr::detail
