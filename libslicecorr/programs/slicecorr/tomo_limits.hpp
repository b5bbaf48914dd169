// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The subcommand `tomo limits`: how fine a printer prints, and how much initiator its resin wants.
#pragma once

#include <string>

#include "programs/common/program.hpp"
#include "slicecorr/tomo/limits.hpp"

namespace slicecorr::cli {

struct TomoLimitOptions {
  std::string printer, resin, json;
  tomo::LimitsAsked asked;
};

/// Adds it to the group `tomo`; it keeps what it is told in `options`.
void add_tomo_limits(Program& program, CLI::App* group, TomoLimitOptions& options);

}  // namespace slicecorr::cli
