// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file file_times.hpp
/// Which exposure times and heights of layers archives can say. Thread-safe.
#pragma once

#include "slicecorr/stack.hpp"

namespace slicecorr {

/// Throws `InputError` where the archive that `file` changes (`keep_from`) has layers of other heights
/// than `info`, or can't say its exposures: before anything is computed. New archives tell what they
/// can't say when they are written. `info`: its grid, heights, kind, process and times count.
void check_file_times(const StackFile& file, const StackInfo& info);

}  // namespace slicecorr
