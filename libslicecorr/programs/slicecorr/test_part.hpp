// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// `slicecorr testpart`.
#pragma once

#include <string>

#include "programs/common/program.hpp"
#include "programs/common/setup_options.hpp"

namespace slicecorr::cli {

struct TestPartOptions {
  const CLI::App* app = nullptr;  ///< what was said, set by `add_test_part`
  LightOptions light;
  std::string printer, output, format, form, picture, kind = "spread", resin, sheet, kept;
  double height_um = 500, uv_mw_cm2 = 0;
  double layer_um = 0;    ///< 0: not said
  double exposure_s = 0;  ///< 0: not said
  double speed_mm_h = 0;  ///< of dose-combs
};
void add_test_part(Program& program, TestPartOptions& options);

}  // namespace slicecorr::cli
