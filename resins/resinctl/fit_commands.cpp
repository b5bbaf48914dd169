// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// fit.
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <memory>

#include "commands.hpp"
#include "new_resin.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/kinetics.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/resins/database.hpp"
#include "slicecorr/resins/exchange.hpp"
#include "slicecorr/resins/fit.hpp"
#include "slicecorr/resins/gel_time_fit.hpp"
#include "slicecorr/resins/threshold_fit.hpp"
#include "slicecorr/vial.hpp"

namespace slicecorr::resinctl {

namespace {

namespace fs = std::filesystem;
using namespace resins;
using cli::Console;

struct FitArguments {
  std::vector<std::string> data, fixed, bounds;
  std::string model, resin, json, output, name;
  std::string weights = "none", loss = "none";
  double loss_scale_um = 0;
  int starts = 8, bootstrap = 0;
  std::uint64_t seed = 1;
  bool one_m = false;
  double conversion = 0;
  bool threshold = false;
  std::string svg;
};

double number_in_option(const std::string& option, const std::string& text, const std::string& part,
                        const char* expected) {
  const auto value = cli::number_of(part);
  if (!value) throw InputError(fmt::format("{} {}: expected {}", option, text, expected));
  return *value;
}

/// NAME=REST, split at the first sign.
std::pair<std::string, std::string> split_at_sign(const std::string& option,
                                                  const std::string& text, const char* expected) {
  const std::size_t sign = text.find('=');
  if (sign == std::string::npos || sign == 0) {
    throw InputError(fmt::format("{} {}: expected {}", option, text, expected));
  }
  return {text.substr(0, sign), text.substr(sign + 1)};
}

FitOptions options_of(const FitArguments& a) {
  FitOptions o;
  if (a.weights == "scatter") o.weights = Weights::scatter;
  if (a.loss == "soft-l1") o.loss = Loss::soft_l1;
  if (a.loss == "cauchy") o.loss = Loss::cauchy;
  o.loss_scale_um = a.loss_scale_um;
  o.starts = a.starts;
  o.bootstrap = a.bootstrap;
  o.seed = a.seed;
  o.separate_m = !a.one_m;
  const auto once = [](bool inserted, const char* option, const std::string& name) {
    if (!inserted) throw InputError(fmt::format("{} names {} twice", option, name));
  };
  for (const std::string& text : a.fixed) {
    constexpr const char* expected = "NAME=VALUE, such as m=1";
    const auto [name, value] = split_at_sign("--fix", text, expected);
    once(o.fixed.emplace(name, number_in_option("--fix", text, value, expected)).second, "--fix",
         name);
  }
  for (const std::string& text : a.bounds) {
    constexpr const char* expected = "NAME=LOW:HIGH, such as m=0.5:1";
    const auto [name, range] = split_at_sign("--bound", text, expected);
    const std::size_t colon = range.find(':');
    if (colon == std::string::npos) number_in_option("--bound", text, "", expected);
    const Bounds bounds{number_in_option("--bound", text, range.substr(0, colon), expected),
                        number_in_option("--bound", text, range.substr(colon + 1), expected)};
    once(o.bounds.emplace(name, bounds).second, "--bound", name);
  }
  return o;
}

bool is_dead_zone_model(FitModel m) { return !kind_of(m).heights; }

/// The blue law that a dead-zone fit stands on.
void take_blue_law(const FitArguments& a, FitModel model, FitOptions& o, Console& console) {
  if (!is_dead_zone_model(model)) return;
  if (a.resin.empty()) {
    throw InputError(
        fmt::format("--model {} needs --resin: hb and D'c of the resin come from its cure fit (or "
                    "fit all measurements at once with --model joint)",
                    a.model));
  }
  const Resin resin = load_resin(a.resin);
  refuse_relative(resin, "a dead zone");
  if (resin.has_gel_time()) {
    throw InputError(resin.name, "cure.model",
                     "is \"gel-time\"; dead zones follow the kinetic law: expected a resin of it");
  }
  const Kinetics k = make_kinetics(resin, false, false);
  o.hb_um = k.hb_um;
  o.critical_dose_prime = k.critical_dose_prime;
  o.m = k.m;
  if (model == FitModel::dead_zone_transient && resin.dose_factor == 1 &&
      resin.gel_dose_mj_cm3 == 0) {
    console.say(fmt::format("{} gives one dose and no dose_factor: it is taken for the dose of gel",
                            a.resin));
  }
}

bool same_file(const std::string& a, const std::string& b) {
  std::error_code error;
  return fs::equivalent(a, b, error);
}

/// Whether a record at its place adds to the one that it was asked to begin with. Throws where none can be written.
bool check_record(const FitArguments& a, const ResinRecord* previous) {
  const fs::path path = a.output;
  const std::string stem = path.stem().string();
  if (path.extension() != ".toml" || stem.empty()) {
    throw InputError(a.output, "", "expected NAME.toml, with the name of the resin");
  }
  if (!a.name.empty() && a.name != stem) {
    throw InputError(a.output, "",
                     fmt::format("the resin is named {}; expected {}.toml, as a file bears the "
                                 "name of its resin",
                                 a.name, a.name));
  }
  const bool exists = fs::exists(path);
  const bool onto_itself = exists && previous && same_file(previous->path, a.output);
  if (exists && !onto_itself) {
    throw InputError(a.output, "",
                     fmt::format("is there already; expected a new name, or --resin {} to add this "
                                 "fit to it",
                                 a.output));
  }
  return onto_itself;
}

std::optional<ResinRecord> previous_record(const FitArguments& a) {
  if (a.resin.empty()) return std::nullopt;
  return load_record(a.resin);
}

/// Writes the resin file, with the measurements beside it.
void write_record(const FitArguments& a, FitResult result, Console& console) {
  const std::optional<ResinRecord> previous = previous_record(a);
  const ResinRecord* const record = previous ? &*previous : nullptr;
  const bool onto_itself = check_record(a, record);
  const std::string stem = fs::path(a.output).stem().string();
  const std::string folder = cli::folder_of(a.output);
  // A text that can't be made must not leave copies of measurements behind.
  record_text_from_fit(stem, {result}, record, folder);
  for (std::string& source : result.sources) {
    if (same_file(cli::folder_of(source), folder)) continue;
    source = (fs::path(folder) / save_measurements(folder, stem, source)).string();
  }
  const std::string text = record_text_from_fit(stem, {result}, record, folder);
  // A file outside of the database that is new leaves nothing else in its folder.
  const auto folders = definition_folders("resin");
  const bool in_database = std::any_of(folders.begin(), folders.end(),
                                       [&](const std::string& f) { return same_file(f, folder); });
  const std::string message =
      in_database || onto_itself
          ? fmt::format("{} fit, R² {:.4f}", name_of(result.model), result.r2)
          : std::string();
  const Saved saved = save_definition(
      folder, stem, text, "resin", onto_itself ? Replace::keep_history : Replace::refuse, message,
      onto_itself ? std::optional(previous->version) : std::nullopt);
  console.say(saved.unchanged ? fmt::format("{}: unchanged, version {}", saved.path, saved.version)
                              : fmt::format("{}: version {} written{}", saved.path, saved.version,
                                            saved.replaced ? ", the one before is kept" : ""));
}

/// gel-time from times to gel.
int run_time_fit(const FitArguments& a, Console& console) {
  for (const std::string& output : {a.output, a.json, a.svg}) cli::check_output(output, a.data);
  const GelTimeFit fit = fit_gel_time(
      read_times_to_gel(a.data, a.conversion > 0 ? std::optional(a.conversion) : std::nullopt));
  if (!a.output.empty()) {
    if (a.resin.empty()) {
      throw InputError(
          "times to gel say nothing of how light fades: -o needs --resin, a resin of which all else "
          "is taken");
    }
    const ResinRecord previous = load_record(a.resin);
    CureLaw law;
    law.model = CureModelKind::gel_time;
    law.gel_time = fit.gel_time();
    if (fit.a.at_bound || fit.b.at_bound) {
      law.model = fit.b.at_bound ? CureModelKind::jacobs : CureModelKind::kinetic;
      law.m = 0.5;
      law.critical_dose_prime = fit.b.at_bound ? fit.a.value : fit.b.value;
    }
    const std::string name = fs::path(a.output).stem().string();
    write_new_resin(
        a.output,
        record_text_with_law(
            name, law,
            {{"fit", fmt::format("gel-time: worst error {:.2g} %, n {}", 100 * fit.worst_error,
                                 fit.times.size())},
             {"standard_errors", fmt::format("gel_a_mj_cm2 {:.4g}, gel_b_sqrt_mw_cm2_s {:.4g}",
                                             fit.a.stderr_, fit.b.stderr_)},
             {"covariance",
              fmt::format("gel_a_mj_cm2, gel_b_sqrt_mw_cm2_s: [[{:.6g}, {:.6g}], [{:.6g}, {:.6g}]]",
                          fit.a.stderr_ * fit.a.stderr_, fit.covariance, fit.covariance,
                          fit.b.stderr_ * fit.b.stderr_)},
             {"times",
              fmt::format("{} times to gel from {}{}", fit.times.size(), fit.sources.front(),
                          fit.conversion > 0
                              ? fmt::format(", to a conversion of {:g}", fit.conversion)
                              : std::string())}},
            previous),
        console);
  }
  if (!a.svg.empty()) {
    cli::write_text_file(a.svg, fit.to_svg(a.name));
    console.say(fmt::format("{}: written", a.svg));
  }
  if (!a.json.empty()) cli::print_or_write(a.json, fit.to_json());
  if (a.json == "-") {
    console.say(fit.to_text());
  } else {
    cli::print_result(fit.to_text() + "\n");
  }
  return cli::kDone;
}

/// A dose and a threshold from times to gel.
int run_threshold_fit(const FitArguments& a, Console& console) {
  if (!a.output.empty() || !a.svg.empty()) {
    throw InputError(
        "--threshold says two figures of a resin of tomographic printing; expected no -o and no --svg: "
        "enter them in the resin's file");
  }
  cli::check_output(a.json, a.data);
  const ThresholdFit fit = fit_threshold(
      read_times_to_gel(a.data, a.conversion > 0 ? std::optional(a.conversion) : std::nullopt));
  const double active = a.resin.empty() ? 0 : 10 * curing_absorption_per_mm(load_resin(a.resin));
  if (!a.json.empty()) cli::print_or_write(a.json, fit.to_json(active));
  if (a.json == "-") {
    console.say(fit.to_text(active));
  } else {
    cli::print_result(fit.to_text(active) + "\n");
  }
  return cli::kDone;
}

int run_fit(const FitArguments& a, const ExecutionContext& context, Console& console) {
  const FitModel model = fit_model_named(a.model);
  const auto is_times = [](const std::string& path) { return is_table_of_times(path); };
  const bool times = std::any_of(a.data.begin(), a.data.end(), is_times);
  if (a.threshold) {
    if (model == FitModel::gel_time && times) return run_threshold_fit(a, console);
    throw InputError("--threshold is for --model gel-time with a table of times");
  }
  if (model == FitModel::gel_time && times) {
    return run_time_fit(a, console);
  }
  if (a.conversion > 0 || !a.svg.empty()) {
    throw InputError(
        "--conversion and --svg are for --model gel-time with a table of times; resinctl plot draws "
        "other fits");
  }
  FitOptions options = options_of(a);
  if (a.one_m && model != FitModel::joint) {
    throw InputError("--one-m is for --model joint");
  }
  for (const std::string& output : {a.output, a.json}) cli::check_output(output, a.data);
  take_blue_law(a, model, options, console);
  const Measurements measurements = read_measurements(a.data, context);
  FitResult result = fit(measurements, model, options, context);
  if (!kind_of(model).dead_zones) {
    result.left_out = compare_left_out(measurements, options, context);
  }
  if (!a.output.empty()) {
    const std::optional<ResinRecord> previous = previous_record(a);
    check_record(a, previous ? &*previous : nullptr);
  }
  if (!a.json.empty()) cli::print_or_write(a.json, result.to_json());
  if (a.json == "-") {
    console.say(result.to_text());
  } else {
    cli::print_result(result.to_text() + "\n");
  }
  // Whoever is told that no file can be made of it has seen what was found.
  if (!a.output.empty()) write_record(a, result, console);
  return cli::kDone;
}

constexpr const char* kFitFooter =
    "Models and their columns (a header row names them; any order; # starts a comment):\n"
    "  jacobs              dose_mj_cm2,cured_height_um, or as for kinetic\n"
    "  kinetic             intensity_mw_cm2,exposure_s,cured_height_um\n"
    "  gel-time            the same, or times to gel: intensity_mw_cm2,time_s, and conversion\n"
    "  bleaching           as for jacobs: heights that grow faster at higher doses\n"
    "  deadzone-steady     blue_mw_cm2,uv_mw_cm2,exposure_s,dead_zone_um, and --resin\n"
    "  deadzone-transient  the same\n"
    "  joint               one file of each kind\n"
    "A column sigma_um gives the scatter of a measurement. Heights are base e, doses areal.\n"
    "Parameters: h_um, dc_mj_cm2 (jacobs); h_um, m, critical_dose_prime (kinetic); h_um, "
    "gel_a_mj_cm2, gel_b_sqrt_mw_cm2_s (gel-time); h_um, dc_mj_cm2, h_bleached_um, "
    "bleaching_dose_mj_cm2 (bleaching); beta, huv_um, "
    "and m (dead zones); all of them, and m_uv (joint).\n"
    "Examples:\n"
    "  resinctl fit heights.csv --model kinetic -o my-resin.toml\n"
    "  resinctl fit zones.csv --model deadzone-transient --resin my-resin.toml -o my-resin.toml\n"
    "  resinctl fit heights.csv --model jacobs --loss cauchy --bootstrap 1000 --json -";

}  // namespace

void add_fit(cli::Program& program) {
  const auto a = std::make_shared<FitArguments>();
  CLI::App* sub = program.add(
      "fit",
      "Fit a cure model to measurements: parameters, intervals, outliers, and what the data can't "
      "tell",
      [a](const ExecutionContext& context, Console& console) {
        return run_fit(*a, context, console);
      });
  sub->add_option("DATA", a->data, "Measurements (.csv); several files are fitted together")
      ->required();
  sub->add_option("--model", a->model, "Law to fit")
      ->required()
      ->check(CLI::IsMember(fit_model_names()));
  sub->add_option("--resin", a->resin,
                  "Resin, a .toml file or a name: dead-zone fits take hb, D'c and m from it, and "
                  "-o keeps its other figures and words");
  sub->add_option("-o,--output", a->output,
                  "Resin file to write (NAME.toml), measurements beside it; an existing one only "
                  "with --resin, and its earlier version is kept");
  sub->add_option("--name", a->name, "Name of the resin; must be that of the file [the file's]")
      ->check(cli::value_is(cli::ValueKind::text));
  sub->add_option("--json", a->json, "Result as JSON: a file, or - for stdout");
  sub->add_option("--weights", a->weights,
                  "scatter: measurements count by their sigma_um, or by the scatter of replicates")
      ->check(CLI::IsMember({"none", "scatter"}))
      ->capture_default_str();
  sub->add_option("--loss", a->loss, "A robust loss makes outliers count less")
      ->check(CLI::IsMember({"none", "soft-l1", "cauchy"}))
      ->capture_default_str();
  sub->add_option("--loss-scale-um", a->loss_scale_um,
                  "Residual from which on they do [from the scatter seen]")
      ->check(cli::number_above_zero());
  sub->add_option("--bootstrap", a->bootstrap,
                  "Resamplings for intervals that assume no normal scatter, such as 1000")
      ->check(CLI::Range(0, 1000000))
      ->capture_default_str();
  sub->add_option("--seed", a->seed, "Of the resampling")->capture_default_str();
  sub->add_option("--fix", a->fixed, "NAME=VALUE: hold a parameter; can be given several times")
      ->check(cli::value_is(cli::ValueKind::text))
      ->take_all()
      ->expected(1)
      ->allow_extra_args(false);
  sub->add_option("--bound", a->bounds,
                  "NAME=LOW:HIGH: keep a parameter between; can be given several times")
      ->check(cli::value_is(cli::ValueKind::text))
      ->take_all()
      ->expected(1)
      ->allow_extra_args(false);
  sub->add_option("--starts", a->starts, "Starting points to try")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  sub->add_option("--conversion", a->conversion,
                  "gel-time, of a table with a column conversion: that at which the resin gels")
      ->check(cli::number_in(0, 1));
  sub->add_flag(
      "--threshold", a->threshold,
      "gel-time, of times: t = E/(i - i0), a threshold below which oxygen comes back faster than "
      "light takes it, in place of A/i + B/sqrt(i); with --resin its figures in a volume");
  sub->add_option("--svg", a->svg, "gel-time, of times: a picture of the fit");
  sub->add_flag("--one-m", a->one_m, "joint: one exponent with and without UV light");
  sub->footer(kFitFooter);
}

}  // namespace slicecorr::resinctl
