// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What can be set on the command line, in [default] and in a rule of the config file: the same
/// names, the same checks, laid over each other.
#pragma once

#include <CLI/CLI.hpp>
#include <map>
#include <string>
#include <vector>

#include "programs/common/setup_options.hpp"

namespace slicecorr::post {

struct PostSettings {
  cli::SetupOptions setup;
  double layer_um = 0;  ///< where the archive does not say it; 0: not given
  std::string backup;   ///< empty: none; "keep" or "replace"
  std::string report;   ///< empty: none; "html", "json" or "both"
  bool leave_alone = false;
  void add_to(CLI::App& app);
};

/// Settings by the names of their options without dashes in front, as text: "omega-max" -> "2".
using Values = std::map<std::string, std::string>;

/// Those that were given on a command line; `app` has the options of `PostSettings`.
Values given_on(const CLI::App& app);
/// What was said there of parts, which their meshes are and how they are turned and scaled, as options
/// for another program to do the same: "--part=a.stl".
std::vector<std::string> part_options_on(const CLI::App& app);
/// `low` with `high` over it. Ways to say the exposure, and the UV light, replace each other whole:
/// a speed leaves nothing of the exposure times below it.
Values over(Values low, const Values& high);
/// Throws `InputError` when a name is not known (with the nearest one) or a value not allowed.
PostSettings settings_of(const Values& values);

}  // namespace slicecorr::post
