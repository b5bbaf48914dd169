// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What the help of each subcommand shows as an example; what prints whole parts brings its own
/// (whole_parts.hpp), because the demo's program has none of it.
#pragma once

#include "programs/common/program.hpp"

namespace slicecorr::cli {

void add_examples(Program& program);

}  // namespace slicecorr::cli
