// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Lamps that give slices less than their calibrations say, as an even dead zone is sought with them.
#pragma once

#include <algorithm>
#include <vector>

#include "process/even_back.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/setup.hpp"

namespace slicecorr::detail {

/// The setup with a printer whose full light is the usual light of slices, and shares of that.
inline Setup lit_setup(Setup setup) {
  setup.printer = as_lit(setup.printer, setup.process);
  std::vector<double> uv_lamp = std::move(setup.process.uv_lamp_share);
  setup.process.uv_lamp_share.clear();
  setup.process = as_lamp_shines(std::move(setup.process));
  setup.process.uv_lamp_share = std::move(uv_lamp);
  const double usual = usual_light_share(setup.process);
  for (double& share : setup.process.light_share) share /= usual;
  return setup;
}

/// What of the curing light of a slice there is, and what of the UV light that is asked for comes.
struct LampShares {
  const Process& process;  ///< of `lit_setup`
  double blue(int slice) const { return light_share(process, slice); }
  double uv(int slice) const {
    const std::vector<double>& lamp = process.uv_lamp_share;
    return lamp.empty()
               ? 1.0
               : lamp[std::min(static_cast<std::size_t>(std::max(0, slice)), lamp.size() - 1)];
  }
  /// In any slice.
  double least_blue() const {
    const std::vector<double>& of = process.light_share;
    return of.empty() ? 1.0 : *std::min_element(of.begin(), of.end());
  }
  double least_uv() const {
    const std::vector<double>& of = process.uv_lamp_share;
    return of.empty() ? 1.0 : *std::min_element(of.begin(), of.end());
  }
};

/// What the place of the UV lamp that gives least has of the calibration's light.
inline double least_uv_factor(const Printer& printer) {
  if (!printer.uv_flat_field) return 1;
  return 1.0 * std::max<int>(1, printer.uv_flat_field->least()) / printer.uv_flat_field->reference;
}

}  // namespace slicecorr::detail
