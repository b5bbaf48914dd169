// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// By how much the inputs of a setup may be off.
#include <fmt/format.h>

#include "slicecorr/error.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/settings.hpp"
#include "slicecorr/setup.hpp"
#include "support/files/text_file.hpp"

namespace slicecorr {

Uncertainty chosen_uncertainty(const std::string& text, const Setup& setup,
                               const SetupChoices& choices, ChoiceNames names) {
  ResinText resin{choices.resin_toml, "the resin"};
  if (resin.text.empty() && !choices.resin.empty()) {
    resin.source = find_definition(choices.resin, "resin");
    resin.text = read_text_file(resin.source);
  }
  Uncertainty u = parse_uncertainty(text, setup.process.mode,
                                    usual_light_share(as_lamp_shines(setup.process)) *
                                        setup.printer.calibration.back().intensity_mw_cm2,
                                    resin);
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
