// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file file_times.hpp
/// Which exposure times archives can say. Thread-safe.
#pragma once

#include "slicecorr/stack.hpp"

namespace slicecorr {

/// Throws `InputError` where the archive that `file` changes (`keep_from`) can't say the exposures of
/// `info`, as writing it would: before anything is computed. New archives tell what they can't say when
/// they are written. `info`: its grid, kind, process and times count.
void check_file_times(const StackFile& file, const StackInfo& info);

}  // namespace slicecorr
