// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// PrusaSlicer's Z compensation of a band (baseline.hpp).
#pragma once

#include "base/coded_band.hpp"

namespace slicecorr::detail {

/// The slices compensated by one layer more than `slices` are: each keeps the least of its value and of
/// the one before it, which the first one has not.
CodedBand compensated_by_one(const CodedBand& slices);
/// The same of slices as they are by `layers` >= 0.
CodedBand compensated(CodedBand slices, int layers);

}  // namespace slicecorr::detail
