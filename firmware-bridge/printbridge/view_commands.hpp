// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Commands that only look: status, watch, report, lamp-log, serve, metrics.
#pragma once

#include <functional>
#include <string>

#include "programs/common/program.hpp"

namespace slicecorr::bridge {

/// Adds a command that takes --printer and --dir into these.
struct PrinterOptions {
  std::string printer, dir;
};
using AddCommand = std::function<CLI::App*(const char* name, const char* text,
                                           PrinterOptions& options, cli::Program::Action action)>;
void add_view_commands(const AddCommand& add);

}  // namespace slicecorr::bridge
