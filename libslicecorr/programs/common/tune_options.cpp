// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "programs/common/tune_options.hpp"

#include "programs/common/program.hpp"

namespace slicecorr::cli {

void TuneOptions::add_to(CLI::App& app, bool required) {
  app.add_option("MEASURED", tables,
                 "Tables of slicecorr testpart comb, staircase or wedge, filled in (.csv); none: "
                 "only what to measure first. Or times to gel (intensity_mw_cm2,time_s), one is "
                 "enough: all doses are scaled");
  app.add_option("--printer", printer, "Printer: a .toml file or a name")->required(required);
  app.add_option("--resin", resin, "Resin as it was known: a .toml file or a name")
      ->required(required);
  light.add_to(app);
  app.add_option("--printed", printed, "Combs: the corrected stack that was printed");
  app.add_option("--sigma-um", sigma_um, "Standard deviation of what was measured")
      ->check(number_in(0.01, 1000))
      ->capture_default_str();
  app.add_option("-o,--output", output, "Resin file to write (.toml)");
  app.add_option("--printer-output", printer_output,
                 "Printer file to write, with stray light in its calibration [beside the resin, "
                 "NAME-printer.toml]");
}

}  // namespace slicecorr::cli
