// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/setup.hpp"

namespace slicecorr {

bool judges_suction(const Setup& setup) {
  return setup.resin.viscosity_pa_s > 0 && setup.process.mode == ExposureMode::continuous;
}

std::optional<PrintSuction> judge_suction(const SliceSource& target, const Setup& setup,
                                          const ExecutionContext& context) {
  // Judged when the light is found, and with it the gap.
  if (setup.process.even_dead_zone != EvenDeadZone::off && !setup.process.even_light) return {};
  auto suction =
      print_suction(target, setup.printer, setup.resin, setup.process, setup.gap_um, context);
  if (!suction) return {};
  check_suction(*suction, setup.printer, suction->speed_mm_h);
  context.tell(suction_in_words(*suction, suction->speed_mm_h));
  return suction;
}

}  // namespace slicecorr
