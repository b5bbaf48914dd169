// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Models under inhibiting UV light that several tests share.
#pragma once

#include "models.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/kinetics.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::test::uv {

/// The dissertation's custom resin 1 (table 3.1), aimed at its gel dose.
inline Resin resin_1(double m = 0.99) {
  Resin r;
  r.name = "resin 1";
  r.model = CureModelKind::kinetic;
  r.m = m;
  r.absorbance_height10_um = units::height10_from_e(408);
  r.critical_dose_prime = 64;
  r.inhibition = Inhibition{0.73, units::height10_from_e(37.8), m, 0};
  return r;
}

inline Printer uv_printer(double least = 1, double most = 100) {
  Printer p = test::linear_printer(least, most);
  p.uv = UvLamp{365, false, {{0, 0}, {255, 275}}};
  return p;
}

inline Process uv_process(double speed_mm_h, double uv_mw_cm2) {
  Process p = test::process(speed_mm_h);
  p.uv.kind = UvKind::constant;
  p.uv.uv_mw_cm2 = uv_mw_cm2;
  return p;
}

inline CureModel model_of(const Resin& resin, const Process& process, double layer_um) {
  return make_cure_model(uv_printer(), resin, process, layer_um);
}

}  // namespace slicecorr::test::uv
