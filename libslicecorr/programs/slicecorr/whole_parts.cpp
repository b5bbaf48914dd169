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
}

}  // namespace slicecorr::cli
