// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Sections on coarser cells, where what is sought is smooth, and values from one to the other.
#pragma once

#include <vector>

#include "slicecorr/flow_section.hpp"

namespace slicecorr::detail {

/// `factor` x `factor` cells as one: part where half of it and more is covered.
FlowSection coarser(const FlowSection& fine, int factor);
/// Sums over the cells of part that are one cell of a section coarser by `factor`; empty: nothing.
std::vector<double> sums_on_coarser(const FlowSection& fine, const FlowSection& coarse, int factor,
                                    const std::vector<double>& values);
/// Values of a section of cells twice as coarse on finer ones: straight lines between middles.
std::vector<double> on_finer(const FlowSection& fine, const FlowSection& coarse,
                             const std::vector<double>& values);

}  // namespace slicecorr::detail
