// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// derive.
#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "commands.hpp"
#include "new_resin.hpp"
#include "programs/common/setup_options.hpp"
#include "slicecorr/chemistry.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/gel_time.hpp"
#include "slicecorr/kinetics.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/resins/database.hpp"
#include "slicecorr/resins/exchange.hpp"

namespace slicecorr::resinctl {

namespace {

using namespace resins;
namespace fs = std::filesystem;

/// A law of one exponent whose times and doses are off by no more is taken for the resin itself:
/// heights then miss by less than a tenth of the absorbance height over its exponent.
constexpr double kGoodEnough = 0.1;

struct DeriveArguments {
  cli::LightOptions light;
  std::string resin, printer, as = "advice", mode = "continuous", output, json;
  double from = 0, to = 0, depth_um = 0;
  int points = kPointsOfRange;
};

/// Intensities that places of the resin get while it is printed.
struct Range {
  double from = 0, to = 0;
  std::string words;
};

/// Light at the window, and how deep below it still counts.
Range range_of(const DeriveArguments& a, const Resin& resin, cli::Console& console) {
  refuse_relative(resin, "a law that is derived");
  Range r{a.from, a.to, {}};
  std::optional<Printer> printer;
  if (!a.printer.empty()) {
    printer = load_printer(a.printer);
    for (const std::string& text : a.light.checked(*printer, resin)) console.say(text);
  }
  const double full = printer ? printer->calibration.back().intensity_mw_cm2 : 0.0;
  if (r.to <= 0) r.to = full;
  if (r.to <= 0) {
    throw InputError(
        "the range of intensities is not given; expected --from and --to, or --printer");
  }
  if (r.from <= 0) {
    // What the window gets fades on its way; three heights down it adds little (e^-3 is 5 %).
    constexpr double heights = 3;
    r.from = r.to * std::exp(-heights);
    if (a.depth_um <= 0) {
      r.words = fmt::format(
          "{:g} mW/cm² at the window down to what is left of it {:g} absorbance "
          "heights deep",
          r.to, heights);
    }
  }
  if (a.depth_um > 0) {
    const double height_um = make_kinetics(resin, false, false).hb_um;
    r.from = (a.from > 0 ? a.from : r.to) * std::exp(-a.depth_um / height_um);
    r.words =
        fmt::format("{:g} mW/cm² at the window down to what is left of {:g} mW/cm² {:g} um deep",
                    r.to, a.from > 0 ? a.from : r.to, a.depth_um);
  }
  if (r.words.empty()) r.words = fmt::format("{:g} to {:g} mW/cm²", r.from, r.to);
  return r;
}

/// A and B of a resin: those of its file, else what its chemistry gives.
GelTime gel_time_of_resin(const Resin& resin) {
  if (resin.has_gel_time()) return make_kinetics(resin, false, false).gel_time;
  if (resin.chemistry) return gel_time_of(*resin.chemistry);
  throw InputError(resin.name, "cure.model",
                   "gives no time to gel from which laws could be derived; expected model = "
                   "\"gel-time\" with gel_a_mj_cm2 and gel_b_sqrt_mw_cm2_s (resinctl fit --model "
                   "gel-time finds them from measured times or heights), or a [chemistry]");
}

int derive_command(const DeriveArguments& a, cli::Console& console) {
  cli::check_output(a.output, {a.resin});
  cli::check_output(a.json, {a.resin});
  const ResinRecord record = load_record(a.resin);
  const GelTime g = gel_time_of_resin(record.resin);
  const Range range = range_of(a, record.resin, console);
  const NearestLaw kinetic = nearest_kinetic(g, range.from, range.to, a.points),
                   jacobs = nearest_jacobs(g, range.from, range.to, a.points);
  const bool layerwise = a.mode == "layerwise";
  const auto good = [&](const NearestLaw& law) {
    return law.worst_error <= kGoodEnough &&
           (layerwise || std::abs(law.continuous_dose - 1) <= kGoodEnough);
  };
  const CureModelKind advice = good(jacobs)    ? CureModelKind::jacobs
                               : good(kinetic) ? CureModelKind::kinetic
                                               : CureModelKind::gel_time;
  nlohmann::ordered_json j;
  j["resin"] = record.name;
  j["from_mw_cm2"] = range.from;
  j["to_mw_cm2"] = range.to;
  j["points"] = a.points;
  j["A"] = g.A;
  j["B"] = g.B;
  j["m"] = kinetic.m;
  j["critical_dose_prime"] = kinetic.critical_dose_prime;
  j["worst_error"] = kinetic.worst_error;
  j["continuous_dose"] = kinetic.continuous_dose;
  j["jacobs"] = {{"dc_mj_cm2", jacobs.critical_dose_prime},
                 {"worst_error", jacobs.worst_error},
                 {"continuous_dose", jacobs.continuous_dose}};
  j["local_m"] = {{"from", local_exponent(g, range.from)}, {"to", local_exponent(g, range.to)}};
  j["advice"] = name_of(advice);
  std::string text = fmt::format(
      "{} gels after {:.5g}/i + {:.5g}/sqrt(i) s. In the range printed in, {}:\n"
      "  exact     model gel-time; the exponent goes from {:.3f} to {:.3f}\n"
      "  kinetic   m {:.5f}, D'c {:.6g} (mW/cm²)^m·s; times off by up to {:.1f} %\n"
      "  Jacobs    Dc {:.6g} mJ/cm²; times off by up to {:.1f} %\n"
      "That is said of constant light. In continuous printing bright light comes first and is spent on "
      "the\ninhibitor: inside a part that just gels the kinetic law sees a dose of {:.3f}, Jacobs' one of "
      "{:.3f}.\n",
      record.name, g.A, g.B, range.words, local_exponent(g, range.from),
      local_exponent(g, range.to), kinetic.m, kinetic.critical_dose_prime,
      100 * kinetic.worst_error, jacobs.critical_dose_prime, 100 * jacobs.worst_error,
      kinetic.continuous_dose, jacobs.continuous_dose);
  const char* const where = layerwise ? "Layer by layer" : "In continuous printing";
  switch (advice) {
    case CureModelKind::jacobs:
      text += fmt::format("{} Jacobs' law is good enough: doses alone count.\n", where);
      break;
    case CureModelKind::kinetic:
      text += fmt::format("{} the kinetic law is good enough, Jacobs' is not.\n", where);
      break;
    case CureModelKind::gel_time:
      text += fmt::format(
          "{} no single exponent is good enough (to {:.0f} %): print with model gel-time.\n", where,
          100 * kGoodEnough);
      break;
  }
  if (!a.output.empty()) {
    CureLaw law;
    law.model = a.as == "advice"    ? advice
                : a.as == "jacobs"  ? CureModelKind::jacobs
                : a.as == "kinetic" ? CureModelKind::kinetic
                                    : CureModelKind::gel_time;
    law.gel_time = g;
    const NearestLaw& nearest = law.model == CureModelKind::jacobs ? jacobs : kinetic;
    law.m = nearest.m;
    law.critical_dose_prime = nearest.critical_dose_prime;
    const std::string found =
        law.model == CureModelKind::gel_time
            ? fmt::format("time to gel of resin {}", record.name)
            : fmt::format(
                  "nearest to the time to gel of resin {}, {:.5g}/i + {:.5g}/sqrt(i) s, from "
                  "{:g} to {:g} mW/cm²: off by up to {:.2g} %",
                  record.name, g.A, g.B, range.from, range.to, 100 * nearest.worst_error);
    write_new_resin(
        a.output,
        record_text_with_law(fs::path(a.output).stem().string(), law, {{"derived", found}}, record),
        console);
  }
  if (!a.json.empty()) cli::print_or_write(a.json, j.dump(2));
  if (a.json == "-") {
    text.pop_back();
    console.say(text);
  } else {
    cli::print_result(text);
  }
  return cli::kDone;
}

}  // namespace

void write_new_resin(const std::string& path, const std::string& text, cli::Console& console) {
  const fs::path file = path;
  if (file.extension() != ".toml" || file.stem().empty()) {
    throw InputError(path, "", "expected NAME.toml, with the name of the resin");
  }
  if (fs::exists(file)) {
    throw InputError(path, "", "is there already; expected the name of a new resin");
  }
  const Saved saved = save_definition(cli::folder_of(path), file.stem().string(), text, "resin",
                                      Replace::refuse, "");
  console.say(fmt::format("{}: written", saved.path));
}

void add_derive(cli::Program& program) {
  const auto a = std::make_shared<DeriveArguments>();
  CLI::App* app = program.add(
      "derive",
      "Which law a resin with a time to gel wants in the light that it is printed in: Jacobs', one "
      "exponent, or the time to gel itself.",
      [a](const ExecutionContext&, cli::Console& console) { return derive_command(*a, console); });
  app->add_option("RESIN", a->resin,
                  "A resin of model gel-time or with a [chemistry] (name or .toml file)")
      ->required();
  app->add_option(
         "--from,--from-mw-cm2", a->from,
         "Least intensity in mW/cm² that cures [full light, three absorbance heights deep]")
      ->check(cli::number_above_zero());
  app->add_option("--to,--to-mw-cm2", a->to, "Greatest, mW/cm² [full light of --printer]")
      ->check(cli::number_above_zero());
  app->add_option("--printer", a->printer,
                  "Printer whose full light is taken where --to is not given");
  a->light.add_to(*app);
  app->add_option("--depth-um", a->depth_um,
                  "How deep below the window the least intensity is: it fades on its way")
      ->check(cli::number_above_zero());
  app->add_option("--points", a->points, "Intensities at which laws are compared")
      ->check(CLI::Range(2, 100000))
      ->capture_default_str();
  app->add_option("--mode", a->mode, "How the resin will be printed; the advice is for that")
      ->check(CLI::IsMember({"continuous", "layerwise"}))
      ->capture_default_str();
  app->add_option("--as", a->as, "Model of the resin that -o writes; advice: the one advised")
      ->check(CLI::IsMember({"advice", "jacobs", "kinetic", "gel-time"}))
      ->capture_default_str();
  app->add_option("-o,--output", a->output, "Resin file to write (NAME.toml)");
  app->add_option("--json", a->json, "Result as JSON: a file, or - for stdout");
  app->footer(
      "Examples:\n"
      "  resinctl derive model-hydrogel --from 1 --to 100\n"
      "  resinctl derive bis-ema-tpo-gel-time --printer prusa-sl1s --depth-um 1000 -o my-resin.toml");
}

}  // namespace slicecorr::resinctl
