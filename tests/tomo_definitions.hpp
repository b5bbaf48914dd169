// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo_definitions.hpp
/// The files of a small tomographic printer and its resin, those of `bench_printer` and `bench_resin`.
#pragma once

#include <string>

namespace slicecorr::test {

/// In a bath of the resin's index, turning clockwise; `dry`: a vial in air that turns the other way.
inline std::string bench_printer_toml(bool dry = false) {
  const std::string head = R"(name = "bench"
[display]
width_px = 48
height_px = 40
pixel_um = 250.0
bit_depth = 8
[blue]
wavelength_nm = 405
calibration = [[0, 0.002], [255, 2.0]]
[vial]
outer_mm = 4.5
inner_mm = 4.0
)";
  const std::string around =
      dry ? "n_outside = 1.0\nn_wall = 1.48\n" : "n_outside = 1.5\nn_wall = 1.5\n";
  return head + around +
         "[optics]\nkind = \"telecentric\"\n[rotation]\ndeg_s = 25\ndirection = \"" +
         (dry ? "counterclockwise" : "clockwise") + "\"\nmax_fps = 60\n";
}

inline std::string bench_resin_toml(const std::string& absorption_per_cm) {
  return "name = \"resin\"\n[cure]\nmodel = \"jacobs\"\nm = 1.0\nabsorption_per_cm = " +
         absorption_per_cm + "\nn = 1.5\ngel_dose_mj_cm3 = 20.0\n";
}

}  // namespace slicecorr::test
