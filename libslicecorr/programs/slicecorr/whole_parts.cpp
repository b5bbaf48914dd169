// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "whole_parts.hpp"

#include "beams.hpp"
#include "tomo.hpp"

namespace slicecorr::cli {

void add_whole_parts(Program& program) {
  static TomoOptions tomo;
  static BeamsArguments beams;
  add_tomo(program, tomo);
  add_beams(program, beams);
  program.examples({
      {"tomo solve",
       "slicecorr tomo solve part.stl -o part.frames --voxel-mm 0.25 --printer model-tomography-bench --resin model-tomography-resin"},
      {"tomo verify", "slicecorr tomo verify part.frames --json -"},
      {"tomo section", "slicecorr tomo section part.frames -o cut.png"},
      {"tomo report", "slicecorr tomo report part.frames -o part.html"},
      {"tomo video", "slicecorr tomo video part.frames -o part.y4m"},
      {"tomo convert",
       "slicecorr tomo convert images -o theirs.frames --angle-step-deg 1 --turns 10 --printer model-tomography-bench --resin model-tomography-resin"},
      {"tomo target", "slicecorr tomo target focus --printer model-tomography-bench -o targets"},
      {"tomo look", "slicecorr tomo look part.frames --before empty --now turn-8 --turns 8"},
      {"tomo diffusion", "slicecorr tomo diffusion part.frames widths.csv"},
      {"tomo limits",
       "slicecorr tomo limits --printer webber-vial --resin webber-dudma-pegda --radius-mm 3.3 --voxel-mm 0.1"},
      {"beams",
       "slicecorr beams part.stl -o job.uvj --voxel-mm 0.1 --printer model-beam-vat --resin model-beam-resin"},
  });
}

}  // namespace slicecorr::cli
