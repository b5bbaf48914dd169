// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file job_entries.hpp
/// Small jobs of tomographic printers and of beams, as the entries of their files.
#pragma once

#include "beams_parts.hpp"
#include "slicecorr/beam_vat.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/tomo/beams_job.hpp"
#include "slicecorr/tomo/job.hpp"
#include "stack_fixture.hpp"
#include "tomo_jobs.hpp"

namespace slicecorr::fuzz {

inline test::Entries frames_entries() {
  const test::TemporaryFolder folder;
  const std::string path = folder / "job.frames";
  tomo::write_job(path, tomo::random_job(tomo::bench_printer(), 2, 4));
  return test::unzip(path);
}

inline test::Entries beams_entries() {
  const std::string text = R"(name = "vat"
[display]
width_px = 60
height_px = 40
pixel_um = 100
[blue]
wavelength_nm = 532
calibration = [[0, 0.5], [255, 10.0]]
[beams]
vat_mm = [2, 2, 2]
from = ["-x", "-y", "-z"]
display = [1, 2, 3]
)";
  tomo::BeamJob job;
  job.printer = parse_printer(text, "vat.toml");
  job.resin.name = "resin";
  job.resin.absorbance_height10_um = 1e5;
  job.resin.critical_dose_mj_cm3 = job.resin.gel_dose_mj_cm3 = 20;
  job.vat = *parse_beam_vat(text, "vat.toml", job.printer);
  job.setup = test::beam_setup(3, 0.1, 0);
  const tomo::BeamPrint print = tomo::find_beams(test::lattice_part(), job.setup);
  job.cells[0] = job.cells[1] = job.cells[2] = 14;
  job.brightest_mw_cm2 = 10;
  job.shown = tomo::shown_beams(print.images, job.setup, job.vat, job.printer, 10);
  job.contrast = print.figures.contrast;
  job.window = {2, std::numeric_limits<double>::infinity()};
  job.exposure_s = 4;
  const test::TemporaryFolder folder;
  const std::string path = folder / "job.uvj";
  tomo::write_beam_job(path, job);
  return test::unzip(path);
}

}  // namespace slicecorr::fuzz
