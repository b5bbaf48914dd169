// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// How finely it is followed when layers gel.
#pragma once

#include "slicecorr/cure.hpp"

namespace slicecorr::detail {

/// Slices of a step in time, a power of two: as many as light falls in by a factor of sqrt(2) at most.
inline int gel_step(const CureModel& model) {
  constexpr double kHalf = 0.5;
  if (!model.is_plain()) return 1;
  int step = 1;
  // Twice the step: a^(2 step) is the square of what light falls by in a step.
  for (double left = model.a * model.a; step < 64 && left * left >= kHalf; left *= left) step *= 2;
  return step;
}

/// The last slice of the step that a slice belongs to.
inline int end_of_step(int slice, int step) { return slice | (step - 1); }

}  // namespace slicecorr::detail
