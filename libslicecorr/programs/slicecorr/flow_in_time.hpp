// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// `flow --in-time`: a print followed from its first instant.
#pragma once

#include "flow.hpp"

namespace slicecorr::cli {

int flow_in_time(const FlowOptions& options, const ExecutionContext& context, Console& console);
/// Throws where something is said that only a print in time has.
void refuse_in_time_options(const FlowOptions& options);

}  // namespace slicecorr::cli
