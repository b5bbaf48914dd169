// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// tune --scan.
#include "scan_tune_command.hpp"

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <memory>
#include <optional>

#include "programs/common/make_part.hpp"
#include "programs/common/mesh_options.hpp"
#include "programs/common/setup_options.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/place_models.hpp"
#include "slicecorr/resins/repeated_rows.hpp"
#include "slicecorr/resins/scan_tune.hpp"
#include "slicecorr/solid.hpp"
#include "slicecorr/stack.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::resinctl {

namespace {

using namespace resins;

/// How often tables and scans are asked at most, and a change of shrinkage, in its standard deviations, that matters to
/// neither.
constexpr int kTogetherRounds = 4;
constexpr double kSameShrinkage = 0.2;

/// How a stack was printed, with these files.
Setup setup_of(const StackInfo& info, const std::string& printer, const std::string& resin,
               bool other_light) {
  SetupChoices choices;
  choices.printer = printer;
  choices.resin = resin;
  if (other_light) choices.other_wavelength = "take";
  return resolve_setup(choices, &info, &info, ChoiceNames::options);
}

/// The design of the next print, as slices: its own, or those of its mesh.
class NextTarget {
 public:
  NextTarget(const std::string& path, const std::string& scratch_folder, const Grid& like,
             const Setup& setup, const ExecutionContext& context) {
    if (!is_mesh_name(path)) {
      own_.emplace(cli::design(path), scratch_folder, context);
      return;
    }
    cli::MeshOptions mesh;
    mesh.parts = {path};
    mesh.layer_um = like.layer_um;
    mesh.shrinkage = setup.resin.shrinkage;
    cut_.emplace(cli::slice_parts(mesh, setup.printer, setup.process.surface, context));
  }
  const SliceSource& slices() const {
    return own_ ? static_cast<const SliceSource&>(*own_) : *cut_;
  }
  const StackInfo* info() const { return own_ ? &own_->info() : nullptr; }

 private:
  std::optional<StackReader> own_;
  std::optional<MeshSlices> cut_;
};

/// A print of which there is a scan.
struct Printed {
  std::unique_ptr<const StackReader> stack;
  std::unique_ptr<const SliceSource> exposures;
  Setup setup;
  const SliceSource& shown() const { return exposures ? *exposures : *stack; }
};

Printed printed_of(const cli::TuneOptions& a, const std::string& path, const std::string& printer,
                   const std::string& resin, const ExecutionContext& context) {
  Printed p;
  p.stack = std::make_unique<const StackReader>(
      path, cli::folder_of(a.next.empty() ? a.output : a.next), context);
  const StackInfo& info = p.stack->info();
  if (info.kind != StackKind::corrected || !info.process) {
    throw InputError(path, "", "is no corrected stack; expected the one that was printed");
  }
  const bool other_light = a.other_wavelength && a.other_wavelength->count() > 0;
  p.setup = setup_of(info, printer, resin, other_light);
  p.exposures = p.stack->exposures(p.setup.resin.m);
  return p;
}

/// Corrects the design anew, and says what is expected: of the first print with what is known now, and of the next.
void correct_next(const cli::TuneOptions& a, const Printed& printed, const Setup& setup,
                  const ExecutionContext& context, cli::Console& console) {
  const std::string folder = cli::folder_of(a.next);
  const StackReader& stack = *printed.stack;
  const NextTarget target(a.target, folder, stack.grid(), setup, context);
  if (target.info()) cli::tell_notices(setup, target.info(), context);
  const StackFile file(a.next);
  const FittedSlices fitted = cli::fit_for_output(target.slices(), file, setup.printer, context);
  const Correction made = correct_stack(*fitted, setup, file, {}, context);
  console.say(
      fmt::format("{}: {} slices, corrected with what was found", a.next, made.info.grid.layers));
  const Histogram& after = made.after.design_error_um();
  std::string expected = fmt::format("the next one by {:.2f} um, 95 % within {:.2f} um",
                                     after.mean(), after.quantile(0.95));
  // The first one was made for what was known of the resin then.
  Setup then = setup;
  then.resin.shrinkage = stack.info().made_for;
  const NextTarget design(a.target, folder, stack.grid(), then, context);
  const FittedSlices like_first = FittedSlices::like(stack, design.slices(), folder, context);
  const Prediction first = verify_stack(printed.shown(), *like_first, setup, context);
  const Histogram& before = first.design_error_um();
  cli::print_result(fmt::format(
      "expected, as edges along z: the print that was scanned is off by {:.2f} um in the mean, 95 % within {:.2f} um; "
      "{}\n",
      before.mean(), before.quantile(0.95), expected));
}

/// Each scan with what was printed.
std::vector<PrintScan> paired(const std::vector<Scan>& scans, const std::vector<Printed>& prints) {
  std::vector<PrintScan> pairs;
  for (std::size_t i = 0; i < scans.size(); ++i) {
    const Printed& p = prints[prints.size() == 1 ? 0 : i];
    pairs.push_back({&scans[i], &p.shown(), &p.setup.process});
  }
  return pairs;
}

std::vector<Scan> read_scans(const cli::TuneOptions& a, const std::vector<Printed>& prints,
                             const ExecutionContext& context) {
  ScanReading reading;
  reading.unit = a.scan_unit;
  reading.voxel_um = a.voxel_um;
  check_given_once(a.scans);
  std::vector<Scan> scans;
  TriangleMesh surface;
  for (std::size_t i = 0; i < a.scans.size(); ++i) {
    // What it should look like, for its unit.
    if (i < prints.size()) {
      const Printed& p = prints[i];
      const PlaceModels models(p.setup.printer, p.setup.resin, p.setup.process, p.stack->grid(),
                               p.stack->frame());
      ExecutionContext untold = context;
      untold.notice = nullptr;  // of how finely it is taken: it gives a unit alone
      surface = predicted_surface(p.shown(), models, 2e5, untold);
    }
    scans.push_back(read_scan(a.scans[i], surface, reading, context));
  }
  return scans;
}

void check_options(const cli::TuneOptions& a, const std::string& printer_output) {
  if (a.stacks.empty())
    throw InputError("--scan: expected the corrected stack that was printed, by --stack");
  if (a.stacks.size() != 1 && a.stacks.size() != a.scans.size()) {
    throw InputError(fmt::format(
        "{} stacks for {} scans; expected one that all are of, or one for each in their order",
        a.stacks.size(), a.scans.size()));
  }
  if (a.next.empty() != a.target.empty()) {
    throw InputError(
        "--next is the stack to write and --target its design; expected both or neither");
  }
  if (!a.next.empty() && (a.output.empty() || printer_output.empty())) {
    throw InputError("--next corrects with the files that are written; expected --output, too");
  }
}

ScanTuneOptions options_of(const cli::TuneOptions& a) {
  ScanTuneOptions options;
  for (const std::string& word : a.seek) {
    options.seek.push_back(word == "spread" ? ScanInput::spread : ScanInput::scatter);
  }
  return options;
}

/// What is tuned by.
struct TogetherAsk {
  const cli::TuneOptions& options;
  const ResinToTune& resin;
  const Printer& printer;
  std::vector<PrintScan> prints;
  const Setup& setup;
};
struct FoundTogether {
  ScanTuneResult scans;
  TunePrior prior;                   ///< before the scans
  std::string said;                  ///< what tables alone say
  std::vector<std::string> counted;  ///< marks of tables
};

/// What tables tell is what is known before the scans, so that the answer is of both. The scans tell how much the resin
/// shrinks, by which heights in tables are shorter, too: so both are asked again, until that changes no more.
FoundTogether tables_and_scans(const TogetherAsk& ask, const ExecutionContext& context) {
  const cli::TuneOptions& a = ask.options;
  const TunePrior known = known_before(a, ask.resin.text, ask.resin.path, ask.printer);
  FoundTogether found;
  Resin shrunk = ask.resin.before;
  for (int round = 0; round < kTogetherRounds; ++round) {
    found.prior = known;
    std::optional<double> lift_exchange;
    if (!a.tables.empty()) {
      const MeasuredParts measured = measured_parts(a, ask.printer, shrunk, context);
      check_not_counted(ask.resin.text, ask.resin.path, measured.as_measured);
      found.counted.clear();
      for (const MeasuredPart& part : measured.as_measured) found.counted.push_back(mark_of(part));
      const TuneResult by_tables =
          tune(measured.parts, ask.printer, ask.resin.before, known, a.sigma_um);
      found.said = "tables:\n" + by_tables.to_text(ask.printer, ask.resin.before, known) +
                   "\ntables and scans:\n";
      lift_exchange = by_tables.lift_exchange;
      found.prior = {by_tables.covariance, "what the tables tell, above", by_tables.x};
    }
    found.scans = tune_by_scans(ask.prints, ask.setup, found.prior, options_of(a), context);
    if (!found.scans.tuned.lift_exchange) found.scans.tuned.lift_exchange = lift_exchange;
    const ScanFinding& z = found.scans.finding(ScanInput::shrinkage_z);
    const double now = 100 - (100 - ask.resin.before.shrinkage.z_per_cent) * (1 - z.value);
    if (a.tables.empty() || !z.told() ||
        std::abs(now - shrunk.shrinkage.z_per_cent) < 100 * kSameShrinkage * z.sd) {
      break;
    }
    shrunk.shrinkage.z_per_cent = now;
  }
  return found;
}

}  // namespace

int forecast_scans_command(const cli::TuneOptions& a, const ExecutionContext& context) {
  for (const std::string& path : {a.output, a.printer_output, a.next, a.target}) {
    if (path.empty()) continue;
    throw InputError(
        path, "",
        "needs a scan; expected --scan, too, or --stack alone, which says what scans would tell");
  }
  const std::string resin_path = find_definition(a.resin, "resin");
  const std::string printer_path = find_definition(a.printer, "printer");
  const Printer printer = load_printer(printer_path);
  refuse_relative(printer, "what is known of stray light before tuning");
  const TunePrior prior = known_before(a, read_text_file(resin_path), resin_path, printer);
  std::vector<ScanForecast> parts;
  for (const std::string& path : a.stacks) {
    const Printed p = printed_of(a, path, printer_path, resin_path, context);
    parts.push_back(forecast_scan({nullptr, &p.shown(), &p.setup.process}, p.setup, prior,
                                  a.sigma_um, options_of(a), context));
    parts.back().part = std::filesystem::path(path).stem().string();
  }
  cli::print_result(fmt::format("known before: {}\n", prior.text) +
                    forecast_text(parts, a.sigma_um));
  return cli::kDone;
}

int tune_by_scans_command(const cli::TuneOptions& a, const ExecutionContext& context,
                          cli::Console& console) {
  const std::string printer_output = printer_output_of(a);
  check_options(a, printer_output);
  const std::string resin_path = find_definition(a.resin, "resin");
  const std::string printer_path = find_definition(a.printer, "printer");
  std::vector<std::string> inputs = a.scans;
  inputs.insert(inputs.end(), a.stacks.begin(), a.stacks.end());
  inputs.insert(inputs.end(), a.tables.begin(), a.tables.end());
  inputs.insert(inputs.end(), {resin_path, printer_path, a.target, a.printed});
  for (const std::string* output : {&a.output, &printer_output, &a.next})
    cli::check_output(*output, inputs);
  const Printer printer = load_printer(printer_path);
  refuse_relative(printer, "what is known of stray light before tuning");
  const std::string text = read_text_file(resin_path);
  std::vector<Printed> prints;
  for (const std::string& path : a.stacks)
    prints.push_back(printed_of(a, path, printer_path, resin_path, context));
  const std::vector<Scan> scans = read_scans(a, prints, context);
  std::vector<std::string> counted = marks_to_count(scans, text, resin_path);
  const ResinToTune tuned{resin_path, text, parse_resin(text, resin_path), a.output};
  FoundTogether together =
      tables_and_scans({a, tuned, printer, paired(scans, prints), prints[0].setup}, context);
  ScanTuneResult& found = together.scans;
  found.tuned.counted = std::move(together.counted);
  found.tuned.counted.insert(found.tuned.counted.end(), counted.begin(), counted.end());
  Printer renamed = printer;
  if (!printer_output.empty()) renamed.name = name_in_file(printer_output, printer.name);
  write_tuned(tuned, {printer_path, renamed, printer_output}, found.tuned, console);
  cli::print_result(
      together.said + found.to_text(printer, tuned.before, together.prior) +
      next_text(next_parts(printer, tuned.before, found.tuned, prints[0].setup.process,
                           prints[0].stack->grid().layer_um, a.sigma_um),
                a.sigma_um));
  if (!a.next.empty()) {
    const bool other_light = a.other_wavelength && a.other_wavelength->count() > 0;
    correct_next(a, prints[0],
                 setup_of(prints[0].stack->info(), printer_output, a.output, other_light), context,
                 console);
  }
  return cli::kDone;
}

}  // namespace slicecorr::resinctl
