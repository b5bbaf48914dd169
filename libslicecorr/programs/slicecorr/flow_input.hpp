// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What `flow` looks at, and what is said of how it is printed.
#pragma once

#include <memory>
#include <optional>

#include "flow.hpp"
#include "slicecorr/flow_part.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr::cli {

struct FlowInput {
  std::unique_ptr<const SliceSource> slices;  ///< null without a part
  FlowPixels pixels = FlowPixels::coverage;
  Printer printer;
  Resin resin;
  double speed_mm_h = 0;
  std::optional<double> uv_mw_cm2;
  std::optional<Process> process;  ///< that a corrected stack was made for
};

/// Without a part: printer, resin and speed alone.
FlowInput read_flow_input(const FlowOptions& options, const ExecutionContext& context);
/// Throws where the printer has no UV lamp, or a weaker one.
void check_uv_lamp(const Printer& printer, double uv_mw_cm2);
/// Throws where the printer gives less curing light.
void check_blue_lamp(const Printer& printer, double blue_mw_cm2);

}  // namespace slicecorr::cli
