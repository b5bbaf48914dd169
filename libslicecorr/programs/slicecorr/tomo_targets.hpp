// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The subcommand `tomo target`: pictures to set a printer up by.
#pragma once

#include <string>

#include "programs/common/program.hpp"

namespace slicecorr::cli {

struct TomoTargetOptions {
  std::string kind, printer, output;
};

/// Adds it to the group `tomo`; it keeps what it is told in `options`.
void add_tomo_targets(Program& program, CLI::App* group, TomoTargetOptions& options);

}  // namespace slicecorr::cli
