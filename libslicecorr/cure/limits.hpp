// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What light can print, and what would make it print: the words of refusals.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "slicecorr/cure.hpp"
#include "slicecorr/kinetics.hpp"

namespace slicecorr::detail {

/// Exposures of layers over `normal_s`, times the m-th power of their shares of the light over the usual
/// one; the last holds for later layers. Empty when all are 1.
std::vector<double> exposure_ratios(const Process& process, double normal_s, double m);

/// A place of the display: the model of its light.
struct LitPlace {
  const CureModel* model = nullptr;
  double factor = 1;  ///< of the calibration's light
  /// Whether the part is lit there: only then must lit pixels gel.
  bool lit = true;
  /// Relative dose that lit pixels must exceed: 1, or more where a part's end must cure within few
  /// slices.
  double needed = 1;
};

/// Why a place can't print; empty texts when it can. `needed` is not looked at. `printer`: as the
/// place sees it (`dimmed`).
struct Verdict {
  std::string weak;   ///< lit pixels don't gel
  std::string black;  ///< black ones do
};
Verdict verdict(const LitPlace& place, const Printer& printer, const Process& process);

/// Throws `InputError` when the speed is beyond the stage's.
void check_stage_speed(const Printer& printer, const Process& process);

/// What would make all `places` print, each number such that it works when it is typed back: "print
/// slower than 118.49 mm/h and faster than 2.3 mm/h, or with more than 84.4 mW/cm² of full light".
/// `printer`: with the calibration of which each place gets its factor.
std::string ways_out(const std::vector<LitPlace>& places, const Printer& printer,
                     const Process& process);

/// For a UV lamp of one intensity: the intensity, mW/cm², nearest to that of the process under
/// which a place whose levels give `blue_mw_cm2` prints. Nothing when the lamp has no such
/// intensity, or the process does not ask for an intensity.
std::optional<double> working_uv(const Kinetics& kinetics, double layer_um,
                                 const std::vector<double>& blue_mw_cm2, const UvLamp& lamp,
                                 const Process& process, double needed = 1);
/// The greatest dead zone, below the one of the process, um, that the lamp can hold under the
/// brightest light of the window while full light gels the resin.
std::optional<double> working_dead_zone_um(const Kinetics& kinetics, double layer_um,
                                           const std::vector<double>& blue_mw_cm2,
                                           double brightest_mw_cm2, const UvLamp& lamp,
                                           const Process& process);

/// Inhibited kernels: relative dose after a long run of slices of `blue_mw_cm2` under `uv_mw_cm2`.
double steady_dose_under_uv(const Kinetics& kinetics, const Process& process, double layer_um,
                            double blue_mw_cm2, double uv_mw_cm2);

/// With a time to gel, continuous: the dose after a long run of slices of an intensity, also in resin
/// that ends.
double long_run_dose(const CureModel& model, double mw_cm2);

}  // namespace slicecorr::detail
