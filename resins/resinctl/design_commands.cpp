// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// resinctl predict and recommend

#include <fmt/format.h>

#include <memory>

#include "commands.hpp"
#include "programs/common/setup_options.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/resins/design.hpp"

namespace slicecorr::resinctl {

namespace {

using namespace resins;

struct PredictArguments {
  cli::LightOptions light;
  std::string resin, printer, dose = "gel", json;
  Question question;
};

struct RecommendArguments {
  cli::LightOptions light;
  std::string resin, printer, json;
  Wish wish;
};

/// To stdout; to stderr, and quietly, when stdout carries JSON.
void tell(cli::Console& console, const std::string& json, const std::vector<std::string>& lines) {
  std::string text;
  for (const std::string& line : lines) text += line + "\n";
  if (json == "-") {
    if (!text.empty()) text.pop_back();
    console.say(text);
  } else {
    cli::print_result(text);
  }
}

int predict_command(const PredictArguments& a, cli::Console& console) {
  const Resin resin = load_resin(a.resin);
  if (a.printer.empty()) refuse_relative(resin, "--blue-mw-cm2");
  Question q = a.question;
  q.aim = a.dose == "aim";
  if (!a.printer.empty()) {
    const Printer printer = load_printer(a.printer);
    for (const std::string& text : a.light.checked(printer, resin, q.uv_mw_cm2 > 0)) {
      console.say(text);
    }
    // Light that is given is that of the place it is asked for.
    if (q.blue_mw_cm2 <= 0) {
      q.blue_mw_cm2 = printer.calibration.back().intensity_mw_cm2;
      q.take_flat_field(printer);
    } else if (printer.flat_field) {
      console.say(fmt::format(
          "This holds for places that get {:g} {}; the flat-field of printer '{}' "
          "gives {}.",
          q.blue_mw_cm2, unit_of_light(printer.unit), printer.name, light_in_words(printer)));
    }
    if (printer.uv_flat_field && q.uv_mw_cm2 > 0) {
      const FlatField& field = *printer.uv_flat_field;
      console.say(fmt::format(
          "This holds for places that get {:g} mW/cm² of UV light; the flat-field of the UV lamp of printer "
          "'{}' gives {:.3g} to {:.3g} % of the calibration.",
          q.uv_mw_cm2, printer.name, 100.0 * field.least() / field.reference,
          100.0 * field.greatest() / field.reference));
    }
    if (q.black_mw_cm2 <= 0) q.black_mw_cm2 = printer.calibration.front().intensity_mw_cm2;
  }
  if (q.blue_mw_cm2 <= 0) {
    throw InputError(
        "the light is not given; expected --blue-mw-cm2, or --printer for its full light");
  }
  const Forecast f = predict(resin, q);
  if (!a.json.empty()) cli::print_or_write(a.json, f.to_json());
  std::vector<std::string> lines{aim_words(resin)};
  lines.insert(lines.end(), f.sentences.begin(), f.sentences.end());
  tell(console, a.json, lines);
  if (!f.unanswered.empty()) throw InfeasibleError(f.unanswered);
  return cli::kDone;
}

int recommend_command(const RecommendArguments& a, cli::Console& console) {
  const Resin resin = load_resin(a.resin);
  const Printer printer = load_printer(a.printer);
  for (const std::string& text : a.light.checked(printer, resin, a.wish.dead_zone_um > 0)) {
    console.say(text);
  }
  const Recommendation r = recommend(resin, printer, a.wish);
  if (!a.json.empty()) cli::print_or_write(a.json, r.to_json());
  if (!r.feasible) {
    std::string text = "no absorber meets the wish";
    for (const std::string& way : r.ways_out) text += "\n  " + way;
    throw InfeasibleError(text);
  }
  std::vector<std::string> lines = r.reasons;
  for (const std::string& w : r.warnings) lines.push_back("Warning: " + w + ".");
  tell(console, a.json, lines);
  return cli::kDone;
}

}  // namespace

void add_design(cli::Program& program) {
  using cli::number_above_zero;
  using cli::number_in;
  {
    const auto a = std::make_shared<PredictArguments>();
    CLI::App* app = program.add(
        "predict", "What a light does to a resin: cured height, dead zone, curing fronts, speeds.",
        [a](const ExecutionContext&, cli::Console& console) {
          return predict_command(*a, console);
        });
    Question& q = a->question;
    app->add_option("--resin", a->resin, "Resin: a .toml file or a name")->required();
    app->add_option("--blue-mw-cm2", q.blue_mw_cm2, "Curing light at the window")
        ->check(number_above_zero());
    app->add_option("--uv-mw-cm2", q.uv_mw_cm2, "Inhibiting light at the window [0]")
        ->check(number_in(0, 1e6));
    app->add_option("--exposure-s", q.exposure_s,
                    "What is cured after this time, the window standing still")
        ->check(number_above_zero());
    app->add_option("--height-um", q.height_um,
                    "How long until resin at this height above the window gels")
        ->check(number_above_zero());
    app->add_option("--speed-mm-h", q.speed_mm_h, "What continuous printing at this speed gives")
        ->check(number_above_zero());
    app->add_option("--layer-um", q.layer_um, "Slice height")
        ->check(number_above_zero())
        ->capture_default_str();
    app->add_option("--black-mw-cm2", q.black_mw_cm2,
                    "Light of a black pixel, for the slowest speed [that of --printer]")
        ->check(number_above_zero());
    app->add_option("--printer", a->printer,
                    "Printer whose full light and black are taken where none is given");
    a->light.add_to(*app);
    app->add_option("--dose", a->dose,
                    "gel: where the resin turns solid; aim: where it has the dose that correction "
                    "aims at")
        ->check(CLI::IsMember({"gel", "aim"}))
        ->capture_default_str();
    app->add_option("--json", a->json, "Write figures as JSON here (- for stdout)");
  }
  const auto a = std::make_shared<RecommendArguments>();
  CLI::App* app = program.add(
      "recommend", "The absorber that a speed and a tolerance need, with correction and without.",
      [a](const ExecutionContext&, cli::Console& console) {
        return recommend_command(*a, console);
      });
  Wish& w = a->wish;
  app->add_option("--resin", a->resin, "Resin: a .toml file or a name")->required();
  app->add_option("--printer", a->printer, "Printer: a .toml file or a name")->required();
  a->light.add_to(*app);
  app->add_option("--speed-mm-h", w.speed_mm_h, "Print speed")
      ->required()
      ->check(number_above_zero());
  app->add_option("--tolerance-um", w.tolerance_um, "Error of edges that is allowed")
      ->required()
      ->check(number_above_zero());
  app->add_option("--layer-um", w.layer_um, "Slice height")
      ->check(number_above_zero())
      ->capture_default_str();
  app->add_option("--dead-zone-um", w.dead_zone_um,
                  "Dead zone to keep under full blue light [not asked for]")
      ->check(number_above_zero());
  app->add_option(
         "--omega-max", w.omega_max,
         "Dose that features are to reach inside, above 1: from which height on they do [not asked "
         "for]")
      ->check(number_above_zero());
  app->add_option(
         "--disc-radius-mm", w.disc_radius_mm,
         "A disc: its suction and, with UV light, how even the dead zone under it can be [not asked "
         "for]")
      ->check(number_above_zero());
  app->add_option("--json", a->json, "Write figures as JSON here (- for stdout)");
}

}  // namespace slicecorr::resinctl
