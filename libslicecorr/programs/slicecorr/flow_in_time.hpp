// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// `flow --in-time`: a print followed from its first instant.
#pragma once

#include <optional>
#include <string>

#include "flow.hpp"
#include "slicecorr/flow_in_time.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr::cli {

int flow_in_time(const FlowOptions& options, const ExecutionContext& context, Console& console);
/// Throws where something is said that only a print in time has.
void refuse_in_time_options(const FlowOptions& options);

/// The first slices of a stack whose light makes the dead zone even once the flow is steady.
struct FirstSlices {
  int slices = 0;                     ///< that were followed; 0: none could be, see the words
  std::optional<StuckInTime> sticks;  ///< nothing: they print
  std::string words;                  ///< a sentence
};
/// Follows them from the first instant, on cells of which 30 lie along the part; nothing of other stacks.
/// Some tenths of a second.
std::optional<FirstSlices> follow_first_slices(const StackReader& stack,
                                               const ExecutionContext& context);

}  // namespace slicecorr::cli
