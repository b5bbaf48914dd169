// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What was found, in words.
#include <fmt/format.h>

#include <cmath>

#include "slicecorr/kinetics.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/resins/tune.hpp"
#include "slicecorr/units.hpp"
#include "tune/matrix.hpp"

namespace slicecorr::resins {

std::string TuneResult::to_text(const Printer& printer, const Resin& resin,
                                const TunePrior& prior) const {
  const auto sd = [](const TuneMatrix& m, std::size_t i) { return std::sqrt(m[i][i]); };
  const Resin after = tuned_resin(resin, x);
  const Printer shines = tuned_printer(printer, resin.m, x);
  std::string out = fmt::format("known before: {}\n\n", prior.text);
  out += fmt::format("{:26} {:>10}    {:>10}   {:>22}   {}\n", "", "before", "now", "change",
                     "known to, before -> now (95 %)");
  const auto relative = [&](const char* name, double before, double now, std::size_t i) {
    out += fmt::format("{:26} {:10.5g} -> {:10.5g}   {:+20.2f} %   {:.2g} % -> {:.2g} %\n", name,
                       before, now, 100 * (now / before - 1), 196 * sd(prior.covariance, i),
                       196 * sd(covariance, i));
  };
  relative("absorbance height, um", resin.absorbance_height10_um, after.absorbance_height10_um, 0);
  relative("light over dose", 1, std::exp(x[1]), 1);
  const double stray = x[2] * std::exp(-x[1]);
  const char* const unit = is_relative(printer) ? "of full" : "mW/cm²";
  out += fmt::format("{:26} {:10.4g} -> {:10.4g}   {:+13.4g} {}   {:.2g} -> {:.2g} {}\n",
                     fmt::format("stray light, {}", unit), 0.0, stray, stray, unit,
                     1.96 * sd(prior.covariance, 2), 1.96 * sd(covariance, 2), unit);
  const auto dose = [](const Resin& r) {
    return make_kinetics(r, false, true).critical_dose_prime;
  };
  if (lift_exchange) {
    out += fmt::format("{:26} {:10.4g} -> {:10.4g}   {:+20.4g}     {:.2g} -> {:.2g}\n",
                       "exchanged at a lift, share", exchange_before(printer), *lift_exchange,
                       *lift_exchange - exchange_before(printer),
                       1.96 * sd(prior.covariance, kExchange), 1.96 * sd(covariance, kExchange));
  }
  out += fmt::format(
      "\nwhich makes: dose aimed at {:.5g} -> {:.5g} (areal), absorbance base 10; printer's black "
      "{:.4g} -> {:.4g}, full {:.4g} -> {:.4g} {}\n",
      dose(resin), dose(after), printer.calibration.front().intensity_mw_cm2,
      shines.calibration.front().intensity_mw_cm2, printer.calibration.back().intensity_mw_cm2,
      shines.calibration.back().intensity_mw_cm2, unit);
  out += fmt::format("{} edges and plugs, {:.1f} um rms from what this prints; gain {:.2f} nat\n",
                     used, rms_um, gain_nat);
  if (!lift_exchange) {
    out +=
        "the share of resin that lifts exchange can't be told by these parts; a lift-comb that was "
        "printed layer by layer tells it\n";
  }
  for (const std::string& text : missing) out += "missing: " + text + "\n";
  for (const std::string& text : outliers) out += "left out: " + text + "\n";
  for (const std::string& text : remarks) out += "warning: " + text + "\n";
  return out;
}

}  // namespace slicecorr::resins
