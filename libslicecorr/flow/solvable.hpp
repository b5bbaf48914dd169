// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Whether a section is wide enough to be solved.
#pragma once

#include "slicecorr/flow_section.hpp"

namespace slicecorr::detail {

/// Part cells reach over three columns and three rows or more, which `check_section` asks for.
bool solvable(const FlowSection& section);

}  // namespace slicecorr::detail
