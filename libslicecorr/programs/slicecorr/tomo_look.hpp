// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The subcommand `tomo look`: what has gelled, by the images of a camera.
#pragma once

#include <string>

#include "programs/common/program.hpp"
#include "slicecorr/tomo/look.hpp"

namespace slicecorr::cli {

struct TomoLookOptions {
  std::string job, seen, json;
  tomo::LookOptions look;
};

/// Adds it to the group `tomo`; it keeps what it is told in `options`.
void add_tomo_look(Program& program, CLI::App* group, TomoLookOptions& options);

}  // namespace slicecorr::cli
