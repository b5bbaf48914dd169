// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file files.hpp
/// The worker's side of the files in an attempt's folder.
#pragma once

#include <string>

#include "slicecorr/farm/work.hpp"

namespace slicecorr::farm::detail {

/// Of order.json and result.json: a worker of another version says so instead of guessing. 2 are
/// tomographic prints, everything else says 1.
inline constexpr int kOrderFormat = 1, kTomoOrderFormat = 2;

void write_progress(const std::string& folder, const ProgressNote& progress);
void write_outcome(const std::string& folder, const WorkOutcome& outcome);

}  // namespace slicecorr::farm::detail
