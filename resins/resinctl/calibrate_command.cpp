// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// calibrate.
#include <fmt/format.h>

#include <memory>

#include "commands.hpp"
#include "fitted.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/load_display.hpp"
#include "slicecorr/resins/films_fit.hpp"
#include "slicecorr/resins/tune.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::resinctl {

namespace {

using namespace resins;

struct CalibrateArguments {
  std::string films, printer, output, resin_output, json;
  double full_mw_cm2 = 0;
};

int calibrate(const CalibrateArguments& a, cli::Console& console) {
  const std::string printer_path = find_definition(a.printer, "printer");
  const std::vector<std::string> inputs = {a.films, printer_path};
  for (const std::string& output : {a.output, a.resin_output, a.json}) {
    if (output != "-") cli::check_output(output, inputs);
  }
  if (!a.output.empty() && a.output == a.resin_output) {
    throw InputError("-o and --resin-out are the same file; expected two");
  }
  const Printer printer = load_display(printer_path);
  const std::string text = read_text_file(printer_path);
  FilmsFit fit = fit_films(read_films(a.films, printer), printer);
  const std::string name = a.output.empty() ? printer.name : name_in_file(a.output, printer.name);
  // Both texts before the first file: there are both or none.
  const std::string printer_text = printer_with_films(text, printer_path, name, fit, a.full_mw_cm2);
  Printer renamed = printer;
  renamed.name = name;
  const std::string resin_text =
      resin_of_films(name_in_file(a.resin_output, "resin-of-" + name), renamed, fit, a.full_mw_cm2);
  if (!a.output.empty()) {
    copy_its_files(printer_path, a.output);
    cli::write_text_file(a.output, printer_text);
  }
  if (!a.resin_output.empty()) cli::write_text_file(a.resin_output, resin_text);
  if (!a.output.empty() && !a.resin_output.empty()) {
    console.say(fmt::format(
        "{}: the light of its grey levels; {}: absorbance height and dose. They belong together, both "
        "in units {}.",
        a.output, a.resin_output,
        unit_of_light(a.full_mw_cm2 > 0 ? LightUnit::mw_cm2 : LightUnit::brightest)));
  }
  tell_fit(fit, a.json, console);
  return cli::kDone;
}

}  // namespace

void add_calibrate(cli::Program& program) {
  const auto a = std::make_shared<CalibrateArguments>();
  CLI::App* sub = program.add(
      "calibrate",
      "Makes a printer file and a resin file of films that were measured with calipers (slicecorr "
      "testpart films): the light of grey levels in units of the brightest one, absorbance height, "
      "and seconds to gel. No power meter is needed.",
      [a](const ExecutionContext&, cli::Console& console) { return calibrate(*a, console); });
  sub->add_option("FILMS", a->films,
                  "Films that were measured (.csv): level, exposure_s, thickness_um")
      ->required();
  sub->add_option("--printer", a->printer,
                  "Printer whose films they are: a .toml file or a name; its light may be unknown")
      ->required();
  sub->add_option("-o,--output", a->output, "Printer file to write (.toml)");
  sub->add_option("--resin-out", a->resin_output, "Resin file to write (.toml)");
  sub->add_option("--json", a->json, "Result as JSON: a file, or - for stdout");
  sub->add_option(
         "--full-mw-cm2", a->full_mw_cm2,
         "Light of the brightest level at the window, where somebody measured it: both files "
         "are then in mW/cm² and mJ/cm²")
      ->check(cli::number_in(0, 1e6, true));
  sub->footer(
      "Example:\n  resinctl calibrate films.csv --printer elegoo-saturn -o my-saturn.toml "
      "--resin-out my-resin.toml");
}

}  // namespace slicecorr::resinctl
