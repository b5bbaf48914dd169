// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Options of slices whose light is changed for oxygen that diffuses in their plane.
#pragma once

#include "programs/common/program.hpp"
#include "slicecorr/oxygen_step.hpp"

namespace slicecorr::cli {

struct OxygenOptions {
  bool even = false;
  OxygenAsk ask;
  void add_to(CLI::App& app);
};

/// Says of a stack whose light was changed so what its doses mean.
void tell_even_oxygen(const StackInfo& info, const ExecutionContext& context);

}  // namespace slicecorr::cli
