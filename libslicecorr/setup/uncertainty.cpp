// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// By how much the inputs of a setup may be off.
#include <fmt/format.h>

#include <algorithm>

#include "slicecorr/error.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/settings.hpp"
#include "slicecorr/setup.hpp"
#include "slicecorr/supports.hpp"
#include "support/files/text_file.hpp"

namespace slicecorr {

namespace {

/// What a fit's errors leave open that the printer's file says of its lifts; 0: nothing.
double exchange_sd(const Setup& setup, const Uncertainty& u) {
  const Printer& printer = setup.printer;
  if (!u.from_fit || u.sd(UncertainInput::exchange) > 0 || !(printer.lift_exchange_sd > 0))
    return 0;
  Process process = setup.process;
  leave_out_lifts(printer, setup.resin, process);
  const bool counted = process.mode == ExposureMode::layerwise && process.lifts == Lifts::each;
  // A share that was said for this print has no error from the file.
  if (!counted || process.lift_exchange != printer.lift_exchange) return 0;
  constexpr double most = 0.3;  // as errors by hand
  return std::min({printer.lift_exchange_sd, printer.lift_exchange, most});
}

}  // namespace

Uncertainty chosen_uncertainty(const std::string& text, const Setup& setup,
                               const SetupChoices& choices, ChoiceNames names) {
  ResinText resin{choices.resin_toml, "the resin"};
  if (resin.text.empty() && !choices.resin.empty()) {
    resin.source = find_definition(choices.resin, "resin");
    resin.text = read_text_file(resin.source);
  }
  const double full_mw_cm2 = usual_light_share(as_lamp_shines(setup.process)) *
                             setup.printer.calibration.back().intensity_mw_cm2;
  Uncertainty u = parse_uncertainty(text, setup.process.mode, full_mw_cm2, resin);
  if (const double sd = exchange_sd(setup, u); sd > 0) {
    u = parse_uncertainty(fmt::format("{},exchange={:.3g}", text, sd), setup.process.mode,
                          full_mw_cm2, resin);
  }
  if (u.sd(UncertainInput::stray) > 0) {
    refuse_relative(setup.printer, "an error of stray light (uncertain)");
  }
  if (u.from_fit && (choices.ha_um > 0 || choices.dc_mj_cm3 > 0)) {
    throw InputError(fmt::format(
        "{} fit says how sure the file's own height and dose are, and another is given by {} or {}; "
        "expected its error by hand, as in ha=8%",
        setting_name(names, "uncertain"), setting_name(names, "ha_um"),
        setting_name(names, "dc_mj_cm3")));
  }
  return u;
}

}  // namespace slicecorr
