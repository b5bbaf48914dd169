// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What the subcommands share, and what stacks say about themselves.
#pragma once

#include <string>

#include "programs/common/figures.hpp"
#include "programs/common/mesh_options.hpp"
#include "programs/common/setup_options.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr::cli {

std::string describe_stack(const StackInfo& info);
std::string info_json(const StackInfo& info, const std::string& path);

}  // namespace slicecorr::cli
