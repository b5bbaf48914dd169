// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file beside.hpp
/// Programs of the project that this one runs, and what they say. Functions are thread-safe; where this
/// program can't be found they throw `DeviceError`.
#pragma once

#include <string>
#include <vector>

#include "support/process/command.hpp"

namespace slicecorr::farm::detail {

/// The path of a program that lies beside this one.
std::string beside_this_program(const std::string& name);

/// The last line that a program said, without its name; empty: none.
std::string last_said(const CommandResult& result);

/// Runs a program of ours in `folder` to its end. Where it refuses its input this throws `InputError` with
/// its own words, where physics is in the way `InfeasibleError`, else `DeviceError`.
CommandResult run_beside(std::vector<std::string> arguments, const std::string& folder);

}  // namespace slicecorr::farm::detail
