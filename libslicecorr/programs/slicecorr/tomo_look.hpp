// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The subcommands `tomo look`: what has gelled, by the images of a camera; and `tomo diffusion`: how far dose
/// spreads, by widths of a print.
#pragma once

#include <string>

#include "programs/common/program.hpp"
#include "slicecorr/tomo/look.hpp"

namespace slicecorr::cli {

struct TomoLookOptions {
  std::string job, seen, picture, json, widths;
  tomo::LookOptions look;
};

/// Adds both to the group `tomo`; they keep what they are told in `options`.
void add_tomo_look(Program& program, CLI::App* group, TomoLookOptions& options);

}  // namespace slicecorr::cli
