// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// `slicecorr features`: what goes with what.
#pragma once

#include "programs/common/program.hpp"

namespace slicecorr::cli {

void add_features(Program& program);

}  // namespace slicecorr::cli
