// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// fit-optics.
#include <fmt/format.h>

#include <filesystem>
#include <fstream>
#include <memory>

#include "commands.hpp"
#include "fitted.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/resins/database.hpp"
#include "slicecorr/resins/optics_fit.hpp"
#include "slicecorr/vial.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::resinctl {

namespace {

using namespace resins;
namespace fs = std::filesystem;

struct OpticsArguments {
  std::string points, printer, resin, json, plot, wobble, write;
  std::vector<std::string> fixed, free;
  bool keep_outliers = false;
};

/// The printer file with what was found, its earlier version kept.
void write_printer(const OpticsArguments& a, const OpticsFit& fit, cli::Console& console) {
  const std::string text = read_text_file(a.write);
  const std::string found = printer_with_optics(text, a.write, fit);
  complete_printer(found, a.write);
  const fs::path path = a.write;
  const Saved saved = save_definition(
      cli::folder_of(a.write), path.stem().string(), found, "printer", Replace::keep_history,
      fmt::format("optics fitted to {} points of {}", fit.residuals.size(), fit.source));
  say_saved(saved, console);
}

int fit_optics_command(const OpticsArguments& a, cli::Console& console) {
  for (const std::string& output : {a.json, a.plot, a.wobble}) {
    cli::check_output(output, {a.points});
  }
  const Printer printer = load_printer(a.printer);
  require_tomographic(printer);
  if (!a.write.empty() && !fs::exists(a.write)) {
    throw InputError(a.write, "", "is not there; expected the printer file to write into");
  }
  OpticsFitOptions options;
  options.keep_outliers = a.keep_outliers;
  options.free.insert(a.free.begin(), a.free.end());
  read_fixed(a.fixed, "n=1.4997", options.held, options.fixed);
  const double n = a.resin.empty() ? printer.vial->n_outside > 1.01 ? printer.vial->n_outside : 1.5
                                   : index_of(load_resin(a.resin));
  const OpticsFit fit = fit_optics(read_optics_points(a.points), printer, n, options);
  if (!a.plot.empty()) cli::write_text_file(a.plot, optics_fit_svg(fit));
  if (!a.wobble.empty()) cli::write_text_file(a.wobble, fit.wobble_csv());
  if (!a.write.empty() && !fit.fits) {
    throw InputError(a.write, "", "nothing is written: " + fit.notes.back());
  }
  if (!a.write.empty()) write_printer(a, fit, console);
  tell_fit(fit, a.json, console);
  return cli::kDone;
}

constexpr const char* kOpticsFooter =
    "Columns of POINTS (a header row names them; any order; # starts a comment):\n"
    "  angle_deg   that the stage has turned, in the direction in which it prints\n"
    "  radius_mm   of the pin from the axis\n"
    "  pin_deg     where it stands in the vial, counterclockwise seen from above [0]\n"
    "  column_px   whose light falls on it; parts of a column by interpolation\n"
    "  row_px      row that was looked at [that of the optical axis]; with z_mm that of the mark\n"
    "  z_mm        height of a mark on the pin, above any datum [no mark]\n"
    "  sigma_px    scatter against that of other points [1]\n"
    "Parameters: distance_mm, axis_right_px, axis_up_px, tilt_deg, outer_mm, inner_mm, n_wall, n "
    "(the resin's index), pin_deg and z_mm (of all pins).\n"
    "Examples:\n"
    "  resinctl fit-optics pins.csv --printer my-printer.toml --resin my-resin.toml --plot off.svg\n"
    "  resinctl fit-optics pins.csv --printer my-printer.toml --fix n=1.4997 --write "
    "my-printer.toml";

}  // namespace

void add_optics(cli::Program& program) {
  const auto a = std::make_shared<OpticsArguments>();
  CLI::App* sub = program.add(
      "fit-optics",
      "Fit a tomographic printer's axes, lens and vial to pins that were found in its light",
      [a](const ExecutionContext&, cli::Console& console) {
        return fit_optics_command(*a, console);
      });
  sub->add_option("POINTS", a->points, "Pins and the columns whose light falls on them (.csv)")
      ->required();
  sub->add_option("--printer", a->printer, "Printer to begin with: a .toml file or a name")
      ->required();
  sub->add_option("--resin", a->resin,
                  "Resin in the vial, whose index to begin with [that of a bath, else 1.5]");
  sub->add_option("--fix", a->fixed,
                  "NAME or NAME=VALUE: hold a parameter; can be given several times")
      ->check(cli::value_is(cli::ValueKind::text))
      ->take_all()
      ->expected(1)
      ->allow_extra_args(false);
  sub->add_option("--free", a->free,
                  "Fit a parameter that is held otherwise, such as inner_mm; can be given several "
                  "times")
      ->check(cli::value_is(cli::ValueKind::text))
      ->take_all()
      ->expected(1)
      ->allow_extra_args(false);
  sub->add_flag("--keep-outliers", a->keep_outliers,
                "Count points that can't belong to the others, too");
  sub->add_option("--plot", a->plot, "Draw what is left by angle (.svg)");
  sub->add_option("--wobble", a->wobble,
                  "Write what is left by angle as a file of [rotation] wobble (.csv)");
  sub->add_option("--write", a->write,
                  "Printer file to write what was found into; its earlier version is kept");
  sub->add_option("--json", a->json, "Result as JSON: a file, or - for stdout");
  sub->footer(kOpticsFooter);
}

}  // namespace slicecorr::resinctl
