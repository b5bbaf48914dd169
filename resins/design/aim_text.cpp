// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include "slicecorr/light_unit.hpp"
#include "slicecorr/resins/design.hpp"
#include "slicecorr/resins/record.hpp"

namespace slicecorr::resins {

std::string aim_words(const Resin& resin) {
  const ResinFigures f = figures_of(resin);
  const std::string not_known =
      " The file gives no gel dose: where one is needed, the dose aimed at is taken.";
  if (resin.has_gel_time()) {
    return fmt::format(
        "Correction aims at {:.4g}/i + {:.4g}/sqrt(i) s, {:g} times the time to gel.",
        resin.gel_a_mj_cm2, resin.gel_b_sqrt_mw_cm2_s, resin.dose_factor);
  }
  if (resin.m != 1) {
    if (!(f.aim_prime > 0)) return "The record has no dose that correction could aim at.";
    const std::string unit = fmt::format("(mW/cm²)^{:.3g} s", resin.m);
    if (f.dose_factor > 1) {
      return fmt::format("Correction aims at D′ = {:.4g} {}: {:g} times the gel dose of {:.4g}.",
                         f.aim_prime, unit, f.dose_factor, f.gel_prime);
    }
    return fmt::format("Correction aims at the gel dose itself, D′c = {:.4g} {}.", f.aim_prime,
                       unit);
  }
  if (is_relative(resin)) {
    return fmt::format("Correction aims at {:.4g} {}.", critical_dose_s(resin),
                       unit_of_dose(resin.unit));
  }
  if (!(f.aim_mj_cm3 > 0)) return "The record has no dose that correction could aim at.";
  std::string text = fmt::format("Correction aims at {:.4g} mJ/cm³ ({:.4g} mJ/cm² areal)",
                                 f.aim_mj_cm3, f.aim_mj_cm2);
  if (!(f.gel_mj_cm3 > 0)) return text + "." + not_known;
  return text + fmt::format(": {:.4g} times the gel dose of {:.4g} mJ/cm³ ({:.4g} mJ/cm²).",
                            f.aim_mj_cm3 / f.gel_mj_cm3, f.gel_mj_cm3, f.gel_mj_cm2);
}

}  // namespace slicecorr::resins
