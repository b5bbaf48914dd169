// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The subcommands of `slicefarm`, one function for each group of them.
#pragma once

#include <memory>
#include <string>

#include "programs/common/program.hpp"
#include "slicecorr/farm/folder.hpp"

namespace slicecorr::farm {

/// What every subcommand is told.
struct FarmOptions {
  std::string dir;
  /// Adds --dir.
  void add_to(CLI::App& app);
  /// Makes the farm where there is none yet.
  FarmFolder open(const std::string& store = {}) const;
  /// Throws `InputError` where there is no farm.
  FarmFolder existing() const;
};

void add_submit_commands(cli::Program& program);   ///< submit
void add_run_commands(cli::Program& program);      ///< run, worker
void add_control_commands(cli::Program& program);  ///< cancel, retry, set, pause, resume, drain ...
void add_status_commands(cli::Program& program);   ///< status, logs
void add_follow_commands(cli::Program& program);   ///< watch, report, serve, notify
void add_serve_commands(cli::Program& program);    ///< serve, notify
void add_scan_commands(cli::Program& program);     ///< scan, scans, next
void add_machine_commands(cli::Program& program);  ///< machines ...

/// Who works here: $USER, else the account's name.
std::string user_name();

}  // namespace slicecorr::farm
