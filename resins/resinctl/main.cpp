// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The program `resinctl`: keeps and fits the resin database.

#include <filesystem>
#include <string>

#include "commands.hpp"

int main(int argc, char** argv) {
  using namespace slicecorr;
  // `slicecorr tune` hands over to this program and keeps the name that was typed.
  const std::string typed = std::filesystem::path(argc > 0 ? argv[0] : "").filename().string();
  cli::Program program(typed == "slicecorr" ? typed : "resinctl",
                       "Keeps the database of resins and printers, and fits cure models to "
                       "measurements.",
                       "resinctl fit heights.csv --model kinetic --json - -o my-resin.toml");
  resinctl::add_list(program);
  resinctl::add_database(program);
  resinctl::add_fit(program);
  resinctl::add_derive(program);
  resinctl::add_optics(program);
  resinctl::add_spread(program);
  resinctl::add_tune(program);
  resinctl::add_calibrate(program);
  resinctl::add_plot(program);
  resinctl::add_design(program);
  resinctl::add_chemistry(program);
  program.examples({
      {"list", "resinctl list black --wavelength-nm 405"},
      {"show", "resinctl show custom-resin-1"},
      {"validate", "resinctl validate my-resin.toml"},
      {"add", "resinctl add my-resin.toml -m \"batch 12\""},
      {"history", "resinctl history my-resin"},
      {"diff", "resinctl diff my-resin 1 2"},
      {"restore", "resinctl restore my-resin 1"},
      {"import", "resinctl import curve.csv --printer ember --name my-ember"},
      {"export", "resinctl export da-2-ppo --format csv"},
      {"new-printer", "resinctl new-printer"},
      {"plot", "resinctl plot da-2-ppo -o curve.svg"},
      {"predict",
       "resinctl predict --resin egg-resin --printer dual-wavelength-dlp --exposure-s 5"},
      {"recommend",
       "resinctl recommend --resin egg-resin --printer dual-wavelength-dlp --speed-mm-h 800 "
       "--tolerance-um 25"},
      {"chemistry", "resinctl chemistry model-diacrylate --intensity-mw-cm2 10 -o cell.svg"},
  });
  return program.run(argc, argv);
}
