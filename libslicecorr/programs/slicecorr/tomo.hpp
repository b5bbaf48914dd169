// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The subcommands of `tomo`: printing the whole part at once.
#pragma once

#include <string>

#include "programs/common/program.hpp"
#include "programs/common/setup_options.hpp"
#include "programs/common/tomo_options.hpp"
#include "tomo_limits.hpp"
#include "tomo_look.hpp"
#include "tomo_targets.hpp"
#include "tomo_views.hpp"

namespace slicecorr::cli {

struct TomoOptions : TomoPrintOptions {
  LightOptions light;
  std::string printer, resin, output, job, shown, dose, json, picture;
  double checkpoint_s = 5;
  bool resume = false;
  TomoViewOptions views;
  TomoTargetOptions targets;
  TomoLookOptions look;
  TomoLimitOptions limits;
};

/// Adds `tomo` with its subcommands, which keep what they are told in `options`.
void add_tomo(Program& program, TomoOptions& options);

}  // namespace slicecorr::cli
