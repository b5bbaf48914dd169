// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// fit-spread.
#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <memory>

#include "commands.hpp"
#include "fitted.hpp"
#include "programs/common/setup_options.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/kinetics.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/resins/database.hpp"
#include "slicecorr/resins/repeated_rows.hpp"
#include "slicecorr/resins/spread_fit.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::resinctl {

namespace {

using namespace resins;
namespace fs = std::filesystem;

struct SpreadArguments {
  cli::LightOptions lights;
  std::vector<std::string> data, fixed, free;
  std::vector<double> depths_um;
  std::string printer, resin, json, plot, write, write_resin, dose = "gel", light = "blue";
  double pitch_um = 0, exposure_s = 0, speed_mm_h = 0, blue_mw_cm2 = 0;
  int gaussians = 1;
  bool keep_outliers = false, moving = false;
};

bool is_picture(const std::string& path) {
  std::string ending = fs::path(path).extension().string();
  for (char& c : ending) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return ending == ".png";
}

/// Everything that was measured, tables and pictures.
SpreadMeasurements read_all(const SpreadArguments& a) {
  SpreadMeasurements all;
  check_given_once(a.data);
  const auto pictures =
      static_cast<std::size_t>(std::count_if(a.data.begin(), a.data.end(), is_picture));
  if (!a.depths_um.empty() && a.depths_um.size() != pictures) {
    throw InputError(
        fmt::format("--depth-um is given {} times for {} pictures; expected one for "
                    "each, in their order",
                    a.depths_um.size(), pictures));
  }
  if (pictures > 0 && a.pitch_um == 0) {
    throw InputError(
        "a picture needs --pitch-um, the side of its pixels at the window; divide a length that you "
        "know by the pixels that it takes up");
  }
  for (const std::string& path : a.data) {
    all.source += (all.source.empty() ? "" : ", ") + path;
    if (is_picture(path)) {
      const std::size_t at = all.edges.size();
      const double depth =
          a.depths_um.empty() ? 0 : a.depths_um.at(std::min(at, a.depths_um.size() - 1));
      all.edges.push_back(read_edge_picture(path, a.pitch_um, depth));
      continue;
    }
    SpreadMeasurements table = read_spread_table(path, a.pitch_um);
    if (pictures > 0) {
      throw InputError(path, "", "is a table among pictures; expected the one or the other");
    }
    if (!all.widths.empty() && !table.widths.empty()) {
      throw InputError(
          path, "", "is a second table of widths; expected one, with all of them below each other");
    }
    all.widths.insert(all.widths.end(), table.widths.begin(), table.widths.end());
    all.edges.insert(all.edges.end(), table.edges.begin(), table.edges.end());
  }
  return all;
}

/// Dose of even full light over that at which edges lie, by how they were exposed.
std::optional<double> dose_of_schedule(const SpreadArguments& a,
                                       const std::optional<Printer>& printer,
                                       const std::optional<Resin>& resin) {
  if (a.exposure_s == 0 && a.speed_mm_h == 0) return std::nullopt;
  const char* const option = a.exposure_s > 0 ? "--exposure-s" : "--speed-mm-h";
  if (!resin || (!printer && a.blue_mw_cm2 == 0)) {
    throw InputError(fmt::format(
        "{} needs --resin, and --printer or --blue-mw-cm2, to say which dose light gives", option));
  }
  if (a.blue_mw_cm2 > 0) refuse_relative(*resin, "--blue-mw-cm2");
  if (printer && !(a.blue_mw_cm2 > 0)) check_same_unit(*printer, *resin);
  const Kinetics k = make_kinetics(*resin, false, a.dose == "aim");
  const double blue =
      a.blue_mw_cm2 > 0 ? a.blue_mw_cm2 : printer->calibration.back().intensity_mw_cm2;
  const double dose = a.exposure_s > 0 ? dose_prime_at(k, blue, 0, 0, a.exposure_s)
                                       : passing_dose_prime(k, blue, 0, a.speed_mm_h);
  return dose / k.critical_dose_prime;
}

/// A definition with what was found, its earlier version kept.
void write(const std::string& path, const std::string& text, const char* kind, const SpreadFit& fit,
           cli::Console& console) {
  const Saved saved = save_definition(
      cli::folder_of(path), fs::path(path).stem().string(), text, kind, Replace::keep_history,
      fmt::format("{} fitted to {} {} of {}",
                  std::string_view(kind) == "resin" ? "scatter" : "spread", fit.measurements,
                  fit.of_widths ? "widths" : "places at edges", fit.source));
  say_saved(saved, console);
}

SpreadFitOptions options_of(const SpreadArguments& a) {
  SpreadFitOptions o;
  o.gaussians = a.gaussians;
  o.keep_outliers = a.keep_outliers;
  o.moving = a.moving || a.speed_mm_h > 0;
  o.free.insert(a.free.begin(), a.free.end());
  read_fixed(a.fixed, "sigma_um=38", o.held, o.fixed);
  return o;
}

int fit_spread_command(const SpreadArguments& a, cli::Console& console) {
  for (const std::string& output : {a.json, a.plot}) cli::check_output(output, a.data);
  for (const std::string& file : {a.write, a.write_resin}) {
    if (!file.empty() && !fs::exists(file)) {
      throw InputError(file, "", "is not there; expected the file to write into");
    }
  }
  if (a.exposure_s > 0 && a.moving) {
    throw InputError(
        "--exposure-s is of a platform that stands still; expected --speed-mm-h with "
        "--moving");
  }
  std::optional<Printer> printer;
  std::optional<Resin> resin;
  if (!a.printer.empty()) printer = load_printer(a.printer);
  if (!a.resin.empty()) resin = load_resin(a.resin);
  if (printer && resin) {
    for (const std::string& text : a.lights.checked(*printer, *resin)) console.say(text);
  }
  SpreadFitOptions o = options_of(a);
  if (printer) o.printer = &*printer;
  if (resin) o.resin = &*resin;
  o.dose = dose_of_schedule(a, printer, resin);
  SpreadFit fit = fit_spread(read_all(a), o);
  fit.light = a.light;
  // Files come last, and both or none.
  std::string printer_text, resin_text;
  if (!a.write.empty()) {
    printer_text = printer_with_spread(read_text_file(a.write), a.write, fit);
    complete_printer(printer_text, a.write);
  }
  if (!a.write_resin.empty()) {
    resin_text = resin_with_scatter(read_text_file(a.write_resin), a.write_resin, fit);
  }
  if (!a.plot.empty()) cli::write_text_file(a.plot, spread_fit_svg(fit));
  if (!a.write.empty()) write(a.write, printer_text, "printer", fit, console);
  if (!a.write_resin.empty()) write(a.write_resin, resin_text, "resin", fit, console);
  tell_fit(fit, a.json, console);
  return cli::kDone;
}

constexpr const char* kSpreadFooter =
    "DATA is one of (a header row names columns; any order; # starts a comment)\n"
    "  widths: kind,designed_um,printed_um of lines and gaps, as slicecorr testpart makes them\n"
    "    depth_um   where they were measured above the window; of a platform that moved, from the\n"
    "               end of the print\n"
    "    level      grey level of lit pixels [full light]; or light, in shares of full light\n"
    "    error_um   scatter against that of other rows [1]\n"
    "    printed_um 0: nothing was left; empty: not measured\n"
    "  an edge: position_um,intensity, and depth_um (of resin before it), edge (number of a scan)\n"
    "  pictures: .png of 8 or 16 bits, linear in light, one straight edge in each\n"
    "Parameters: sigma_um, sigma2_um, weight2 (the second one's share), scatter_um2_per_um, and of "
    "widths dose (of even full light, over that where edges lie) and dark (light of black pixels).\n"
    "Examples:\n"
    "  resinctl fit-spread edge.png --pitch-um 2.4 --plot edge.svg --write my-printer.toml\n"
    "  resinctl fit-spread widths.csv --printer my-printer.toml --resin my-resin.toml --write-resin "
    "my-resin.toml";

}  // namespace

void add_spread(cli::Program& program) {
  using cli::number_above_zero;
  using cli::number_in;
  const auto a = std::make_shared<SpreadArguments>();
  CLI::App* sub = program.add(
      "fit-spread",
      "Fit how far light spreads to printed lines and gaps, or to a picture of a straight edge",
      [a](const ExecutionContext&, cli::Console& console) {
        return fit_spread_command(*a, console);
      });
  const auto several = [&](const char* name, auto& to, const char* text) {
    return sub->add_option(name, to, text)->take_all()->expected(1)->allow_extra_args(false);
  };
  sub->add_option("DATA", a->data, "Widths (.csv), an edge (.csv), or pictures of edges (.png)")
      ->required();
  sub->add_option("--pitch-um", a->pitch_um,
                  "Side of a picture's pixels at the window; of a scan, what a place takes in [a "
                  "point]")
      ->check(number_in(1e-6, 1e4));
  several("--depth-um", a->depths_um,
          "Resin between window and where a picture was focused [0]; once for each picture")
      ->check(number_in(0, 1e6));
  sub->add_option(
      "--printer", a->printer,
      "Printer whose calibration says what black pixels and levels give: a .toml file or "
      "a name");
  sub->add_option("--resin", a->resin, "Resin: its absorbance height, exponent and dose");
  a->lights.add_to(*sub);
  sub->add_option("--gaussians", a->gaussians, "How many Gaussians make up the spread: 1 or 2")
      ->check(CLI::IsMember({1, 2}))
      ->capture_default_str();
  sub->add_option("--exposure-s", a->exposure_s, "Widths of one exposure so long: dose is held")
      ->check(number_above_zero());
  sub->add_option("--speed-mm-h", a->speed_mm_h,
                  "Widths of a print whose platform moved so fast: dose is held")
      ->check(number_above_zero())
      ->excludes("--exposure-s");
  sub->add_flag("--moving", a->moving, "The platform moved, the dose is to be fitted");
  sub->add_option(
         "--dose", a->dose,
         "With --exposure-s or --speed-mm-h: edges lie at the gel dose (gel), or at the dose "
         "that the correction aims at (aim)")
      ->check(CLI::IsMember({"gel", "aim"}))
      ->capture_default_str();
  sub->add_option("--blue-mw-cm2", a->blue_mw_cm2, "Full light at the window [that of --printer]")
      ->check(number_above_zero());
  several("--fix", a->fixed, "NAME or NAME=VALUE: hold a parameter; can be given several times")
      ->check(cli::value_is(cli::ValueKind::text));
  several("--free", a->free,
          "Fit a parameter that is held otherwise, such as dark; can be given several times")
      ->check(cli::value_is(cli::ValueKind::text));
  sub->add_flag("--keep-outliers", a->keep_outliers,
                "Count rows that can't belong to the others, too");
  sub->add_option("--plot", a->plot, "Draw measured and found (.svg)");
  sub->add_option("--write", a->write,
                  "Printer file to write the spread into; its earlier version is kept");
  sub->add_option("--light", a->light, "Of which light of that printer: blue or uv")
      ->check(CLI::IsMember({"blue", "uv"}))
      ->capture_default_str();
  sub->add_option("--write-resin", a->write_resin,
                  "Resin file to write the scatter into; its earlier version is kept");
  sub->add_option("--json", a->json, "Result as JSON: a file, or - for stdout");
  sub->footer(kSpreadFooter);
}

}  // namespace slicecorr::resinctl
