// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Uses the installed library from outside: headers, linking of all that it needs, and the version.
#include <cmath>
#include <cstdio>
#include <string>

#include "slicecorr/error.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/units.hpp"
#include "slicecorr/version.hpp"

namespace {

const char* const kPrinterToml = R"(name = "outside"
[display]
width_px = 1280
height_px = 800
pixel_um = 50.0
bit_depth = 8
[blue]
wavelength_nm = 460
calibration = [[0, 1.0], [255, 100.0]]
[stage]
max_speed_mm_h = 2000
travel_mm = 100
)";

bool check(bool ok, const char* what) {
  if (!ok) std::fprintf(stderr, "failed: %s\n", what);
  return ok;
}

}  // namespace

int main() {
  bool ok = true;
  // 15 mJ/cm² at 1500 um (base 10) are 230.26 mJ/cm³.
  const double dc =
      slicecorr::units::volumetric_from_areal(15.0, slicecorr::units::height_e_from_10(1500.0));
  ok &= check(std::abs(dc - 230.2585) < 1e-3, "areal to volumetric dose");

  const slicecorr::Printer printer = slicecorr::parse_printer(kPrinterToml, "outside.toml");
  ok &= check(printer.name == "outside", "name of the printer");
  ok &= check(printer.width_px == 1280 && printer.height_px == 800, "size of the display");
  ok &= check(printer.levels() == 256, "levels of the projector");

  bool thrown = false;
  try {
    slicecorr::parse_printer("name = ", "broken.toml");
  } catch (const slicecorr::InputError& error) {
    thrown = std::string(error.what()).find("broken.toml") != std::string::npos;
  }
  ok &= check(thrown, "a broken printer file is refused by name");

  std::printf("slicecorr %s\n", slicecorr::version);
  return ok ? 0 : 1;
}
