// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/machine_light.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/inhibited.hpp"
#include "slicecorr/light_unit.hpp"

namespace slicecorr {
namespace {

/// Relative difference of intensities that comes of rounding.
constexpr double kSlack = 1e-6;
/// Share of the dose that gels which black may give while the lamp shines around exposures.
constexpr double kMostBlackExcess = 0.05;
/// The same while the lamp warms up.
constexpr double kMostWarmUp = 0.5;

double black_mw_cm2(const LitPrint& print) { return level_intensities(print.printer).front(); }

/// The lamp goes off a cycle or two after the image has gone; one that warms up is on before it.
double black_s(const MachineMotion& machine) {
  double time_s = 1.5 * machine.cycle_s;
  if (machine.blue_warm_up_s > 0) time_s += machine.blue_settle_s + 4 * machine.cycle_s;
  return time_s;
}

/// The blue lamp warms up behind black, which may give light, too.
void check_warm_up(const LitPrint& print, const MachineMotion& machine) {
  const double black = black_mw_cm2(print);
  if (!(black > 0) || !(machine.blue_warm_up_s > 0)) return;
  // At the window the resin gains dose fastest.
  const Kinetics k = make_kinetics(print.resin, false, false);
  const double dose = dose_prime_at(k, black, 0, 0, machine.blue_warm_up_s) / k.critical_dose_prime;
  if (dose <= kMostWarmUp) return;
  throw InfeasibleError(fmt::format(
      "the blue lamp warms up for {:g} s behind black, which still gives {:g} {}: {:.0f} % "
      "of the dose that gels the resin; {:g} % are borne",
      machine.blue_warm_up_s, black, unit_of_light(print.resin.unit), dose * 100,
      kMostWarmUp * 100));
}

}  // namespace

double flood_mw_cm2(const UvSchedule& uv, const Kinetics& kinetics, double full_mw_cm2, int n) {
  if (uv.kind == UvKind::per_slice && !uv.slice_mw_cm2.empty()) {
    const auto last = uv.slice_mw_cm2.size() - 1;
    return uv.slice_mw_cm2[std::min(static_cast<std::size_t>(n), last)];
  }
  if (uv.uv_mw_cm2 > 0) return uv.uv_mw_cm2;
  return uv_for_dead_zone(kinetics, full_mw_cm2, uv.dead_zone_um);
}

double black_excess(const LitPrint& print, const MachineMotion& machine) {
  const double black = black_mw_cm2(print);
  if (print.process.mode != ExposureMode::layerwise || print.process.uv.kind != UvKind::off ||
      !(black > 0)) {
    return 0;
  }
  const Kinetics k = make_kinetics(print.resin, false, true);
  return dose_prime_at(k, black, 0, 0, black_s(machine)) / k.critical_dose_prime /
         -std::expm1(-k.m * print.layer_um / k.hb_um);
}

void check_black_light(const LitPrint& print, const MachineMotion& machine) {
  if (print.process.uv.kind != UvKind::off) return;
  check_warm_up(print, machine);
  const double excess = black_excess(print, machine);
  if (excess <= kMostBlackExcess) return;
  throw InfeasibleError(fmt::format(
      "the lamp of printer '{}' shines behind black for {:.0f} ms more in each layer (cycle_s{}), "
      "which adds up to {:.1f} % of the dose that gels; {:g} % are borne",
      machine.printer, black_s(machine) * 1e3, machine.blue_warm_up_s > 0 ? ", warm_up_s" : "",
      excess * 100, kMostBlackExcess * 100));
}

void check_uv_range(const LitPrint& print, const MachineMotion& machine,
                    const std::vector<double>& uv_mw_cm2) {
  if (uv_mw_cm2.empty() || !print.printer.uv) return;
  const Process& process = print.process;
  const double m = make_kinetics(print.resin, true, true).m;
  // It follows the speed as blue light does.
  const auto share = [&](int n) {
    if (process.mode != ExposureMode::continuous || process.slice_speed_mm_h.empty() ||
        slices_differ(process)) {
      return 1.0;
    }
    return std::min(1.0, std::pow(slice_speed_mm_h(process, n) / process.speed_mm_h, 1 / m));
  };
  double least = uv_mw_cm2.front() * share(0), greatest = uv_mw_cm2.front();
  for (int n = 0; n < std::max(print.slices, static_cast<int>(uv_mw_cm2.size())); ++n) {
    const double uv = uv_mw_cm2[std::min(static_cast<std::size_t>(n), uv_mw_cm2.size() - 1)];
    least = std::min(least, uv * share(n));
    greatest = std::max(greatest, uv);
  }
  const double most = print.printer.uv->max_mw_cm2(), dimmest = machine.least_uv_share * most;
  if (greatest <= most * (1 + kSlack) && least >= dimmest * (1 - kSlack)) return;
  throw InfeasibleError(fmt::format(
      "the stack asks for {:.4g} to {:.4g} mW/cm² of UV light, the lamp of printer '{}' gives "
      "{:.4g} to {:.4g}",
      least, greatest, machine.printer, dimmest, most));
}

void check_lamps(const LitPrint& print, const MachineMotion& machine) {
  check_black_light(print, machine);
  const UvSchedule& uv = print.process.uv;
  if (uv.kind == UvKind::off || uv.kind == UvKind::patterned || !print.printer.uv) return;
  // A dead zone is held where slices get the most light.
  const Process lit = as_lamp_shines(print.process);
  double most_share = lit.light_share.empty() ? 1 : 0;
  for (const double share : lit.light_share) most_share = std::max(most_share, share);
  const double full = level_intensities(print.printer).back() * most_share;
  const Kinetics k = make_kinetics(print.resin, true, true);
  std::vector<double> light{flood_mw_cm2(uv, k, full, 0)};
  for (int n = 1; n < static_cast<int>(uv.slice_mw_cm2.size()); ++n) {
    light.push_back(flood_mw_cm2(uv, k, full, n));
  }
  check_uv_range(print, machine, light);
}

}  // namespace slicecorr
