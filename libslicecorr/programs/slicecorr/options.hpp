// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What the subcommands share, and what stacks say about themselves.
#pragma once

#include <string>

#include "programs/common/figures.hpp"
#include "programs/common/mesh_options.hpp"
#include "programs/common/setup_options.hpp"
#include "slicecorr/layer_areas.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr::cli {

/// `areas`: of its images; null: not looked at.
std::string describe_stack(const StackInfo& info, const LayerAreas* areas);
std::string info_json(const StackInfo& info, const std::string& path, const LayerAreas* areas);

}  // namespace slicecorr::cli
