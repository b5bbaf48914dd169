// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "examples.hpp"

namespace slicecorr::cli {

void add_examples(Program& program) {
  program.examples({
      {"slice",
       "slicecorr slice part.stl -o target.uvj --printer dual-wavelength-dlp --layer-um 50"},
      {"correct",
       "slicecorr correct target.uvj -o part.uvj --printer dual-wavelength-dlp --resin egg-resin "
       "--speed-mm-h 800"},
      {"verify", "slicecorr verify part.uvj --json -"},
      {"probe", "slicecorr probe part.uvj --x 640 --y 400"},
      {"simulate", "slicecorr simulate part.uvj --x 640 --y 400 -o cures.svg"},
      {"report", "slicecorr report part.uvj -o part.html"},
      {"section", "slicecorr section part.uvj -o section.png"},
      {"solid", "slicecorr solid part.uvj --design part.stl -o printed.stl"},
      {"compare",
       "slicecorr compare part.stl --layer-um 50 --printer dual-wavelength-dlp --resin egg-resin "
       "--speed-mm-h 800"},
      {"convert", "slicecorr convert part.uvj -o part.zip --format chitubox"},
      {"info", "slicecorr info part.uvj"},
      {"flow",
       "slicecorr flow part.stl --layer-um 50 --printer my-printer.toml --resin my-resin.toml "
       "--speed-mm-h 300 --gap-um 80 -o flow.html"},
      {"pattern",
       "slicecorr pattern image.png --pixel-um 20 --resin model-diacrylate --intensity-mw-cm2 40 "
       "--time-s 30 -o gels.png"},
      {"plan",
       "slicecorr plan part.stl --layer-um 50 --printer dual-wavelength-dlp --resin egg-resin -o "
       "plan.svg"},
      {"hologram",
       "slicecorr hologram target.png -o phases.png --pitch-um 8 --wavelength-nm 405 --focal-mm 200"},
      {"relief",
       "slicecorr relief --back heights.png --back-most-um 800 --printer dual-wavelength-dlp --resin "
       "custom-resin-1 -o light.png"},
      {"scan compare",
       "slicecorr scan compare scan.ply --stack part.uvj --design part.stl --html scan.html"},
      {"scan drift", "slicecorr scan drift one.json two.json three.json --html drift.html"},
      {"features", "slicecorr features --json -"},
      {"settings", "slicecorr settings"},
  });
}

}  // namespace slicecorr::cli
