// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The comparison of methods where light spreads from column to column.
#pragma once

#include "slicecorr/pipeline.hpp"

namespace slicecorr::detail {

/// Fills in the figures of all methods; `comparison` has the erase that is best for columns alone.
void compare_spread_methods(const SliceSource& target, const Setup& setup, Comparison& comparison,
                            const ExecutionContext& context);

}  // namespace slicecorr::detail
