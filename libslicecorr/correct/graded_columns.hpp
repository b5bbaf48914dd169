// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Levels of columns of whose features doses are wanted (docs/graded-dose.md).
#pragma once

#include <cstdint>
#include <memory>

#include "slicecorr/correct.hpp"

namespace slicecorr::detail {

/// Solves columns one by one; keeps its buffers. For one thread.
class GradedColumns {
 public:
  virtual ~GradedColumns() = default;
  /// `coverage`, `doses`: of `plan.layers` layers; `heights`: of one more. `levels`: of all slices.
  virtual void solve(const std::uint8_t* coverage, const std::uint8_t* heights,
                     const std::uint8_t* doses, std::uint8_t* levels) = 0;
};

/// Layer by layer. The plan and the scale outlive it.
std::unique_ptr<GradedColumns> make_graded_layers(const CorrectionPlan& plan,
                                                  const DoseScale& scale);

}  // namespace slicecorr::detail
