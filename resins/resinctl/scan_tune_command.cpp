// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// tune --scan.
#include "scan_tune_command.hpp"

#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <optional>

#include "programs/common/make_part.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/place_models.hpp"
#include "slicecorr/resins/scan_tune.hpp"
#include "slicecorr/solid.hpp"
#include "slicecorr/stack.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::resinctl {

namespace {

using namespace resins;

/// How a stack was printed, with these files.
Setup setup_of(const StackInfo& info, const std::string& printer, const std::string& resin,
               bool other_light) {
  SetupChoices choices;
  choices.printer = printer;
  choices.resin = resin;
  if (other_light) choices.other_wavelength = "take";
  return resolve_setup(choices, &info, &info, ChoiceNames::options);
}

/// Corrects the design anew, and says what is expected: of the first print with what is known now, and of the next.
void correct_next(const cli::TuneOptions& a, const StackReader& printed, const Setup& setup,
                  const ExecutionContext& context, cli::Console& console) {
  const StackReader target(cli::design(a.target), cli::folder_of(a.next), context);
  const StackFile file(a.next);
  const FittedSlices fitted = cli::fit_for_output(target, file, setup.printer, context);
  const Correction made = correct_stack(*fitted, setup, file, {}, context);
  const FittedSlices like_first =
      FittedSlices::like(printed, target, cli::folder_of(a.next), context);
  const std::unique_ptr<const SliceSource> exposures = printed.exposures(setup.resin.m);
  const Prediction first =
      verify_stack(exposures ? *exposures : printed, *like_first, setup, context);
  const Histogram &before = first.design_error_um(), &after = made.after.design_error_um();
  console.say(
      fmt::format("{}: {} slices, corrected with what was found", a.next, made.info.grid.layers));
  cli::print_result(fmt::format(
      "expected, as edges along z: the print that was scanned is off by {:.2f} um in the mean, 95 % within {:.2f} um; "
      "the next one by {:.2f} um, 95 % within {:.2f} um\n",
      before.mean(), before.quantile(0.95), after.mean(), after.quantile(0.95)));
}

}  // namespace

int tune_by_scans_command(const cli::TuneOptions& a, const ExecutionContext& context,
                          cli::Console& console) {
  if (!a.tables.empty() || !a.printed.empty()) {
    throw InputError(
        "scans and tables at once; expected one after the other: what the first finds counts as known before with the "
        "files that it writes");
  }
  if (a.stack.empty())
    throw InputError("--scan: expected the corrected stack that was printed, by --stack");
  if (a.next.empty() != a.target.empty()) {
    throw InputError(
        "--next is the stack to write and --target its design; expected both or neither");
  }
  const std::string resin_path = find_definition(a.resin, "resin");
  const std::string printer_path = find_definition(a.printer, "printer");
  const std::string printer_output = printer_output_of(a);
  if (!a.next.empty() && (a.output.empty() || printer_output.empty())) {
    throw InputError("--next corrects with the files that are written; expected --output, too");
  }
  std::vector<std::string> inputs = a.scans;
  inputs.insert(inputs.end(), {resin_path, printer_path, a.stack, a.target});
  for (const std::string* output : {&a.output, &printer_output, &a.next})
    cli::check_output(*output, inputs);
  const Printer printer = load_printer(printer_path);
  refuse_relative(printer, "what is known of stray light before tuning");
  const std::string text = read_text_file(resin_path);
  const Resin resin = parse_resin(text, resin_path);
  const TunePrior prior = prior_of(text, resin_path, printer);
  const StackReader stack(a.stack, cli::folder_of(a.next.empty() ? a.output : a.next), context);
  const StackInfo& info = stack.info();
  if (info.kind != StackKind::corrected || !info.process) {
    throw InputError(a.stack, "", "is no corrected stack; expected the one that was printed");
  }
  const bool other_light = a.other_wavelength && a.other_wavelength->count() > 0;
  const Setup setup = setup_of(info, printer_path, resin_path, other_light);
  const std::unique_ptr<const SliceSource> exposures = stack.exposures(setup.resin.m);
  const SliceSource& shown = exposures ? *exposures : stack;
  // What scans should look like, for their unit.
  const PlaceModels models(setup.printer, setup.resin, setup.process, stack.grid(), stack.frame());
  SolidOptions coarse;
  coarse.reduce = size_of_solid(shown, models, context).reduction(2e5);
  const TriangleMesh surface = solid_mesh(shown, models, coarse, context);
  ScanReading reading;
  reading.unit = a.scan_unit;
  reading.voxel_um = a.voxel_um;
  std::vector<Scan> scans;
  for (const std::string& path : a.scans)
    scans.push_back(read_scan(path, surface, reading, context));
  std::vector<PrintScan> prints;
  for (const Scan& scan : scans) prints.push_back({&scan, &shown});
  const ScanTuneResult found = tune_by_scans(prints, setup, prior, {}, context);
  Printer renamed = printer;
  if (!printer_output.empty()) renamed.name = name_in_file(printer_output, printer.name);
  write_tuned({resin_path, text, resin, a.output}, {printer_path, renamed, printer_output},
              found.tuned, console);
  cli::print_result(found.to_text(printer, resin, prior) +
                    next_text(next_parts(printer, resin, found.tuned, info.process,
                                         stack.grid().layer_um, a.sigma_um),
                              a.sigma_um));
  if (!a.next.empty()) {
    correct_next(a, stack, setup_of(info, printer_output, a.output, other_light), context, console);
  }
  return cli::kDone;
}

}  // namespace slicecorr::resinctl
