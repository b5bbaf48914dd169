// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "programs/common/uncertain_options.hpp"

#include <fmt/format.h>

#include "programs/common/program.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/report.hpp"
#include "slicecorr/uncertain_print.hpp"

namespace slicecorr::cli {

void UncertainOptions::add_to(CLI::App& app, bool correcting) {
  const OptionGroup group(app, "How sure the inputs are");
  app.add_option(
         "--uncertain", uncertain,
         "By how much inputs may be off, as standard deviations: ha=8%,dc=10%,light=3%,speed=1%; also "
         "m=0.02, aim=5%, stray=0.1 (mW/cm²), time (layerwise), flat, noise, "
         "exchange=0.1 (of lifts). dc is the areal dose. fit "
         "takes what the resin's measurements say. The prediction then says how sure it is")
      ->check(value_is(ValueKind::text));
  if (!correcting) return;
  app.add_flag(
      "--robust", robust,
      "Let no feature vanish and no gap fill, as far as that is possible, even where each input of "
      "--uncertain is off by its number to either side");
}

void UncertainOptions::add_map_to(CLI::App& app) {
  const OptionGroup group(app, "How sure the inputs are");
  app.add_option(
         "--uncertain-map", map,
         "Write a map of how sure edges are to FILE (.png): upper and lower edges, the darker "
         "the wider the band of 95 %")
      ->type_name("FILE");
}

void UncertainOptions::write_map(const Prediction& p, Console& console) const {
  if (map.empty()) return;
  const double scale_um = p.uncertain->map_scale_um();
  const SurfaceMaps& maps = *p.uncertain->maps;
  const auto png = encode_png(side_by_side(sensitivity_picture(maps, true, scale_um),
                                           sensitivity_picture(maps, false, scale_um)));
  write_text_file(map, {png.begin(), png.end()});
  console.say(fmt::format(
      "{}: upper edges left, lower ones right; black: {:g} um and more either way", map, scale_um));
}

Setup UncertainOptions::put(Setup setup, const SetupChoices& choices) const {
  if (uncertain.empty()) {
    if (robust) {
      throw InputError(
          "--robust needs to know by how much inputs may be off; expected --uncertain, as in "
          "--uncertain ha=5%,dc=5%");
    }
    if (!map.empty()) {
      throw InputError(
          "--uncertain-map shows how sure edges are; expected --uncertain, as in --uncertain ha=8%");
    }
    return setup;
  }
  setup.uncertainty = chosen_uncertainty(uncertain, setup, choices, ChoiceNames::options);
  setup.uncertainty->robust = robust;
  return setup;
}

}  // namespace slicecorr::cli
