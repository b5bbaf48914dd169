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
  other_wavelength = light.add_to(app);
  app.add_option("--printed", printed, "Combs: the corrected stack that was printed");
  app.add_option("--sigma-um", sigma_um, "Standard deviation of what was measured")
      ->check(number_in(0.01, 1000))
      ->capture_default_str();
  app.add_option("-o,--output", output, "Resin file to write (.toml)");
  app.add_option("--printer-output,--printer-out", printer_output,
                 "Printer file to write, with stray light in its calibration [beside the resin, "
                 "NAME-printer.toml]");
  app.add_option(
         "--scan", scans,
         "Scans of prints, beside tables or alone: meshes or points (.stl, .ply, .obj, .off, .3mf)")
      ->take_all()
      ->expected(1, 1000);
  app.add_option(
         "--stack", stacks,
         "Scans: the corrected stack that was printed, one for all scans or one for each in their order; without scans: "
         "what a scan of each would tell, to --sigma-um")
      ->take_all()
      ->expected(1, 1000);
  app.add_option("--scan-unit", scan_unit,
                 "Unit of the scans' numbers: auto, um, mm, cm, inch or m")
      ->check(CLI::IsMember({"auto", "um", "mm", "cm", "inch", "m"}))
      ->capture_default_str();
  app.add_option("--voxel-um", voxel_um,
                 "Scans that are volumes (.npy, a folder of TIFF slices): side of a voxel")
      ->check(number_above_zero());
  app.add_option(
         "--seek", seek,
         "Scans: spread or scatter, where the files say nothing of light that spreads at the window or "
         "scatters in the resin; else there is none")
      ->take_all()
      ->expected(1, 2)
      ->check(CLI::IsMember({"spread", "scatter"}));
  app.add_option(
      "--next", next,
      "Scans: stack to write, --target corrected with what was found (.uvj, or another format)");
  app.add_option(
      "--target", target,
      "For --next: the mesh of the design, which is sliced for what the resin was found to shrink by, or its "
      "slices as they are");
}

}  // namespace slicecorr::cli
