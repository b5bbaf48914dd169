// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What prints whole parts at once: `tomo` and `beams`. Apart from the other commands, so that a
/// program without them can be linked (the demo's, which is built in minutes).
#pragma once

#include "programs/common/program.hpp"

namespace slicecorr::cli {

/// Called once; what it adds lives as long as the process.
void add_whole_parts(Program& program);

}  // namespace slicecorr::cli
