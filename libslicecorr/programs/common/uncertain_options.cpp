#include "programs/common/uncertain_options.hpp"

#include "slicecorr/error.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::cli {

void UncertainOptions::add_to(CLI::App& app, bool correcting) {
  app.add_option(
      "--uncertain", uncertain,
      "By how much inputs may be off, as standard deviations: ha=8%,dc=10%,light=3%,speed=1%, the "
      "areal dose meant; also m=0.02, aim=5%, stray=0.1 (mW/cm²), time (layerwise), flat, noise; fit "
      "for what the measurements in the resin's file say. The prediction then says how sure it is");
  if (!correcting) return;
  app.add_flag(
      "--robust", robust,
      "Keep features above and gaps below gelling for all that --uncertain names, each off "
      "by so much either way, where that is possible (continuous, without UV light)");
}

Setup UncertainOptions::put(Setup setup, const SetupChoices& choices) const {
  if (uncertain.empty()) {
    if (robust) {
      throw InputError(
          "--robust needs to know by how much inputs may be off; expected --uncertain, as in "
          "--uncertain ha=5%,dc=5%");
    }
    return setup;
  }
  ResinText resin{choices.resin_toml, "the resin"};
  if (resin.text.empty() && !choices.resin.empty()) {
    resin.source = find_definition(choices.resin, "resin");
    resin.text = read_text_file(resin.source);
  }
  setup.uncertainty = parse_uncertainty(uncertain, setup.process.mode,
                                        setup.printer.calibration.back().intensity_mw_cm2, resin);
  if (setup.uncertainty->from_fit && (choices.ha_um > 0 || choices.dc_mj_cm3 > 0)) {
    throw InputError(
        "--uncertain fit says how sure the file's own height and dose are, and another is given by "
        "--ha-um or --dc-mj-cm3; expected its error by hand, as in ha=8%");
  }
  setup.uncertainty->robust = robust;
  return setup;
}

}  // namespace slicecorr::cli
