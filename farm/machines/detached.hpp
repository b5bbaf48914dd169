// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file detached.hpp
/// Programs that outlive who starts them: prints.
#pragma once

#include <sys/types.h>

#include <string>
#include <vector>

namespace slicecorr::farm::detail {

/// Starts a program (`arguments[0]`: a path, or found in $PATH) that goes on when this one ends, with
/// what it says in `log`. -1: it can't be started. Thread-safe; throws nothing.
pid_t start_detached(const std::vector<std::string>& arguments, const std::string& log);

}  // namespace slicecorr::farm::detail
