// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What the tables of the library say: `slicecorr features`, what goes with what, and `slicecorr
/// settings`, what can be chosen.
#pragma once

#include "programs/common/program.hpp"

namespace slicecorr::cli {

void add_tables(Program& program);

}  // namespace slicecorr::cli
