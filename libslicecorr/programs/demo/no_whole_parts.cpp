// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The demo's program has no `tomo` and no `beams`: it is built in less time.

#include "programs/slicecorr/whole_parts.hpp"

namespace slicecorr::cli {

void add_whole_parts(Program& /*program*/) {}

}  // namespace slicecorr::cli
