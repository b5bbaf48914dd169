// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// tune.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>

#include "commands.hpp"
#include "fitted.hpp"
#include "new_resin.hpp"
#include "programs/common/database_band.hpp"
#include "programs/common/tune_options.hpp"
#include "scan_tune_command.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/kinetics.hpp"
#include "slicecorr/light_map.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/resins/dose_combs_fit.hpp"
#include "slicecorr/resins/exchange.hpp"
#include "slicecorr/resins/gel_time_fit.hpp"
#include "slicecorr/resins/repeated_rows.hpp"
#include "slicecorr/resins/time_scale.hpp"
#include "slicecorr/resins/tune.hpp"
#include "slicecorr/stack.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::resinctl {

namespace {

using namespace resins;
namespace fs = std::filesystem;

/// Light of the column that was measured, as the stack shows it.
void take_light(TuningTable& table, const std::string& path, const Printer& printer,
                const ExecutionContext& context) {
  const StackReader stack(path, cli::folder_of(path), context);
  const StackInfo& info = stack.info();
  if (info.kind != StackKind::corrected || !info.process) {
    throw InputError(path, "", "is no corrected stack; expected the one that was printed");
  }
  const Grid& g = stack.grid();
  if (std::abs(g.layer_um - table.part.layer_um) > 1e-6 * g.layer_um || table.x_px >= g.width_px ||
      table.y_px >= g.height_px || g.width_px != table.width_px || g.height_px != table.height_px) {
    throw InputError(path, "",
                     fmt::format("has {} x {} pixels and slices of {:g} um, the part of {} {} x {} "
                                 "and {:g} um; expected that part, corrected",
                                 g.width_px, g.height_px, g.layer_um, table.part.source,
                                 table.width_px, table.height_px, table.part.layer_um));
  }
  const LightMap map(printer, g, stack.frame());
  const double here = map.factor(map.value(table.x_px, table.y_px));
  const std::vector<double> levels = level_intensities(printer);
  table.part.process = *info.process;
  std::size_t lit = 0;
  stack.read_band(
      {table.x_px, table.y_px, table.x_px + 1, table.y_px + 1}, [&](int, const std::uint8_t* row) {
        const int level = row ? level_of_pixel(*row, printer.levels()) : 0;
        lit += level > 0;
        table.part.intensity_mw_cm2.push_back(here * levels[static_cast<std::size_t>(level)]);
      });
  if (lit == 0) {
    throw InputError(path, "",
                     fmt::format("is dark at pixel {}, {}, where the teeth are measured; expected "
                                 "the comb of {}, corrected",
                                 table.x_px, table.y_px, table.part.source));
  }
}

}  // namespace

MeasuredParts measured_parts(const cli::TuneOptions& a, const Printer& printer, const Resin& resin,
                             const ExecutionContext& context) {
  MeasuredParts all;
  check_given_once(a.tables);
  for (const std::string& path : a.tables) {
    TuningTable table = read_tuning_table(path);
    all.layer_um = table.part.layer_um;
    all.as_measured.push_back(table.part);
    // As high as it was before it shrank.
    for (MeasuredEdge& edge : table.part.edges) edge.measured_um /= resin.shrinkage.left(2);
    if (table.printed()) {
      if (a.printed.empty()) {
        throw InputError(path, "", "is of a print; name the corrected stack by --printed");
      }
      take_light(table, a.printed, printer, context);
      all.process = table.part.process;
    }
    all.parts.push_back(std::move(table.part));
  }
  std::vector<std::vector<double>> rows;
  for (const MeasuredPart& part : all.as_measured) {
    for (const MeasuredEdge& e : part.edges) {
      if (std::isnan(e.measured_um)) continue;
      rows.push_back({static_cast<double>(e.kind), e.designed_um, e.intensity_mw_cm2, e.exposure_s,
                      e.dark_s, e.dark_mw_cm2, e.measured_um});
    }
  }
  if (const std::string words = repeats_in_words(std::move(rows)); !words.empty())
    context.tell(words);
  if (resin.shrinkage.z_per_cent != 0) {
    context.tell(
        fmt::format("heights in tables are taken as what they were before the resin shrank by "
                    "{:.4g} % along z",
                    resin.shrinkage.z_per_cent));
  }
  return all;
}

TunePrior known_before(const cli::TuneOptions& a, const std::string& resin_text,
                       const std::string& resin_path, const Printer& printer) {
  // Laboratories that measured one resin lie far apart: one part measured here says more than all of them.
  return cli::database_band(a.resin).empty()
             ? prior_of(resin_text, resin_path, printer)
             : foreign_prior(cli::kDatabaseHeightSd, cli::kDatabaseDoseSd);
}

std::string next_text(const std::vector<NextPart>& parts, double sigma_um) {
  std::string out = fmt::format("\nto measure next, to {:g} um (nat):\n", sigma_um);
  bool tuned = true;
  for (const NextPart& p : parts) {
    if (tuned && !p.tuned) out += "of other things, where little is known of them:\n";
    tuned = p.tuned;
    out += fmt::format("  {:10} {:7.2f}  {}\n", p.part, p.nat, p.text);
  }
  return out;
}

/// Beside the resin: "tuned.toml" makes "tuned-printer.toml".
std::string printer_output_of(const cli::TuneOptions& a) {
  if (!a.printer_output.empty() || a.output.empty() || a.output == "-") return a.printer_output;
  const fs::path resin(a.output);
  return (resin.parent_path() / (resin.stem().string() + "-printer.toml")).string();
}

void write_tuned(const ResinToTune& resin, const PrinterToTune& printer, const TuneResult& told,
                 cli::Console& console) {
  TuneResult found = told;
  found.resin_before = resin.before.name;
  if (!resin.output.empty()) {
    cli::write_text_file(
        resin.output,
        resin_with_tuning(resin.text, resin.path, name_in_file(resin.output, resin.before.name),
                          printer.renamed, found));
  }
  if (printer.output.empty()) return;
  copy_its_files(printer.path, printer.output);
  cli::write_text_file(printer.output, printer_with_tuning(read_text_file(printer.path),
                                                           printer.path, printer.renamed, found));
  console.say(fmt::format(
      "{}: height and dose{}; {}: stray light, in the calibration. They belong together.",
      resin.output, found.shrinkage ? ", and what it shrinks by" : "", printer.output));
}

namespace {

/// Times to gel in place of parts: one scale on all doses.
int tune_by_times(const cli::TuneOptions& a, cli::Console& console) {
  if (!std::all_of(a.tables.begin(), a.tables.end(),
                   [](const std::string& path) { return is_table_of_times(path); })) {
    throw InputError(
        "some tables are of times to gel, others of parts; expected one kind at a time");
  }
  if (!a.printed.empty() || !a.printer_output.empty()) {
    throw InputError(
        "times to gel say nothing of a printed stack or of a printer's light; expected tables of parts "
        "with --printed and --printer-output");
  }
  cli::check_output(a.output, a.tables);
  const ResinRecord before = load_record(a.resin);
  refuse_relative(before.resin, "a time at an intensity in mW/cm²");
  for (const std::string& told : a.light.checked(load_printer(a.printer), before.resin)) {
    console.say(told);
  }
  const TimesToGel times = read_times_to_gel(a.tables);
  for (const std::string& w : times.warnings) console.say("warning: " + w);
  const TimeScale found = scale_by_times(before.resin, times);
  if (!a.output.empty()) {
    const Kinetics k = make_kinetics(before.resin, false, false);
    CureLaw law{before.resin.model, before.resin.m, found.scale * k.critical_dose_prime, {}};
    if (before.resin.has_gel_time()) {
      law.gel_time = {found.scale * k.gel_time.A, found.scale * k.gel_time.B};
    }
    write_new_resin(
        a.output,
        record_text_with_law(
            fs::path(a.output).stem().string(), law,
            {{"scaled", fmt::format("{:.6g} times the doses of {}, by times to gel ({}) of {}",
                                    found.scale, before.resin.name, times.times.size(),
                                    fs::path(times.sources.front()).filename().string())}},
            before),
        console);
  }
  cli::print_result(found.to_text(before.resin));
  return cli::kDone;
}

/// Combs that were corrected for several critical doses: the dose to aim at.
int tune_by_dose_combs(const cli::TuneOptions& a, cli::Console& console) {
  if (a.tables.size() != 1) {
    throw InputError(
        a.tables.front(), "",
        "is among several tables, one of dose-combs; expected a table of dose-combs alone");
  }
  if (!a.printed.empty() || !a.printer_output.empty()) {
    throw InputError(
        "combs by critical dose say nothing of a printed stack or of a printer's light; expected their table "
        "without --printed and --printer-output");
  }
  const std::string resin_path = find_definition(a.resin, "resin");
  cli::check_output(a.output, {a.tables.front(), resin_path});
  const std::string text = read_text_file(resin_path);
  for (const std::string& told :
       a.light.checked(load_printer(a.printer), parse_resin(text, resin_path))) {
    console.say(told);
  }
  const DoseCombsFit fit = fit_dose_combs(a.tables.front());
  if (!a.output.empty()) {
    cli::write_text_file(a.output,
                         resin_with_dose_factor(text, resin_path, name_in_file(a.output, ""), fit));
  }
  cli::print_result(fit.to_text());
  return cli::kDone;
}

int tune_command(const cli::TuneOptions& a, const ExecutionContext& context,
                 cli::Console& console) {
  const auto of_times = [](const std::string& path) {
    try {
      return is_table_of_times(path);
    } catch (const InputError&) {
      return false;  // the reader of parts says what is wrong with it
    }
  };
  if (!a.scans.empty()) return tune_by_scans_command(a, context, console);
  if (!a.stacks.empty() && a.tables.empty()) return forecast_scans_command(a, context);
  std::vector<std::string> of_scans = a.stacks;
  of_scans.insert(of_scans.end(), {a.next, a.target});
  of_scans.insert(of_scans.end(), a.seek.begin(), a.seek.end());
  for (const std::string& path : of_scans) {
    if (!path.empty()) {
      throw InputError(path, "", "belongs to scans; expected --scan, too, or only tables");
    }
  }
  if (std::any_of(a.tables.begin(), a.tables.end(), of_times)) return tune_by_times(a, console);
  if (std::any_of(a.tables.begin(), a.tables.end(), is_dose_combs_table)) {
    return tune_by_dose_combs(a, console);
  }
  const std::string resin_path = find_definition(a.resin, "resin");
  const std::string printer_path = find_definition(a.printer, "printer");
  const std::string printer_output = printer_output_of(a);
  std::vector<std::string> inputs = a.tables;
  inputs.insert(inputs.end(), {resin_path, printer_path, a.printed});
  cli::check_output(a.output, inputs);
  cli::check_output(printer_output, inputs);
  const Printer printer = load_printer(printer_path);
  const std::string text = read_text_file(resin_path);
  const Resin resin = parse_resin(text, resin_path);
  // What it was tuned with before is no matter: it is tuned anew.
  Resin measured = resin;
  measured.tuned_with.clear();
  for (const std::string& told : a.light.checked(printer, measured)) console.say(told);
  const TunePrior prior = known_before(a, text, resin_path, printer);
  const auto [parts, as_measured, process, layer_um] = measured_parts(a, printer, resin, context);
  if (parts.empty()) {
    if (!a.output.empty() || !a.printer_output.empty()) {
      throw InputError("nothing was measured: there is nothing to write; expected tables");
    }
    TuneResult nothing;
    nothing.covariance = prior.covariance;
    cli::print_result(
        fmt::format("known before: {}\n", prior.text) +
        next_text(next_parts(printer, resin, nothing, process, layer_um, a.sigma_um), a.sigma_um));
    return cli::kDone;
  }
  check_not_counted(text, resin_path, as_measured);
  TuneResult found = tune(parts, printer, resin, prior, a.sigma_um);
  for (const MeasuredPart& part : as_measured) found.counted.push_back(mark_of(part));
  Printer renamed = printer;
  if (!printer_output.empty()) renamed.name = name_in_file(printer_output, printer.name);
  write_tuned({resin_path, text, resin, a.output}, {printer_path, renamed, printer_output}, found,
              console);
  cli::print_result(
      found.to_text(printer, resin, prior) +
      next_text(next_parts(printer, resin, found, process, layer_um, a.sigma_um), a.sigma_um));
  return cli::kDone;
}

}  // namespace

void add_tune(cli::Program& program) {
  const auto a = std::make_shared<cli::TuneOptions>();
  CLI::App* sub =
      program.add("tune", "Find what resin and light really are from test parts that were measured",
                  [a](const ExecutionContext& context, cli::Console& console) {
                    return tune_command(*a, context, console);
                  });
  a->add_to(*sub, true);
  sub->footer(
      "Example:\n  slicecorr tune comb.csv stairs.csv --printer my-printer.toml --resin "
      "my-resin.toml --printed print.uvj -o tuned.toml");
}

}  // namespace slicecorr::resinctl
