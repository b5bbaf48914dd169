// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// resinctl chemistry

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "commands.hpp"
#include "slicecorr/chemistry_cell.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/resins/chemistry_plots.hpp"
#include "support/chart/chart.hpp"

namespace slicecorr::resinctl {

namespace {

using chart::figure;

struct ChemistryArguments {
  std::string resin, json, csv, output;
  std::vector<std::string> light;
  double intensity_mw_cm2 = 0, supply_per_s = 0;
  std::optional<double> wall_mol_l;
};

/// "100:1.6" is 100 mW/cm² for 1.6 s.
LightStep light_step(const std::string& text) {
  const std::size_t colon = text.find(':');
  if (colon != std::string::npos) {
    const double i = cli::number_of(text.substr(0, colon)).value_or(-1);
    const double s = cli::number_of(text.substr(colon + 1)).value_or(-1);
    if (i >= 0 && s > 0) return {s, i};
  }
  throw InputError(
      fmt::format("--light {}: expected mW/cm² and seconds, as in 100:1.6 or 0:5", text));
}

nlohmann::ordered_json number(double value) {
  return std::isfinite(value) ? nlohmann::ordered_json(value) : nlohmann::ordered_json(nullptr);
}

std::string seconds(double value) { return std::isfinite(value) ? figure(value) + " s" : "never"; }

/// Where oxygen comes through the window, how high it keeps resin liquid.
struct DeadZone {
  double wall_mol_l = 0, even_um = 0, deep_um = 0;
};
std::optional<DeadZone> dead_zone(const Chemistry& c, const ChemistryArguments& a) {
  if (!c.oxygen_um2_s) return std::nullopt;
  const double wall = a.wall_mol_l.value_or(c.oxygen_mol_l);
  return DeadZone{wall, permeable_dead_zone_um(c, a.intensity_mw_cm2, wall),
                  permeable_dead_zone_um(c, a.intensity_mw_cm2, wall, light_height_um(c))};
}

nlohmann::ordered_json json_of(const Chemistry& c, const ChemistryArguments& a,
                               const CellTimes& t) {
  const GelTime g = gel_time_of(c);
  const double i = a.intensity_mw_cm2;
  nlohmann::ordered_json j;
  j["intensity_mw_cm2"] = i;
  j["t_inh_s"] = number(t.inhibition_time_s);
  j["t_gel_s"] = number(t.gel_time_s);
  j["A"] = g.A;
  j["B"] = g.B;
  j["m"] = local_exponent(g, i);
  j["closed"] = {{"t_inh_s", number(inhibition_time_s(c, i))},
                 {"t_inh_used_up_s", number(inhibition_time_used_up_s(c, i))},
                 {"t_gel_s", number(gel_time_s(g, i))}};
  if (a.supply_per_s > 0) {
    j["threshold_intensity_mw_cm2"] = threshold_intensity_mw_cm2(c, a.supply_per_s);
    j["closed"]["t_inh_supplied_s"] = number(inhibition_time_supplied_s(c, i, a.supply_per_s));
  }
  j["initiation_per_s"] = initiation_per_s(c, i);
  j["radicals_mol_l_s"] = radicals_mol_l_s(c, i);
  j["chains_mol_l"] = {{"inhibited", number(inhibited_radicals_mol_l(c, i))},
                       {"steady", steady_radicals_mol_l(c, i)}};
  j["rise_s"] = rise_time_s(c, i);
  j["light_height_um"] = light_height_um(c);
  j["dark_conversion_1_s"] = dark_conversion(c, i, 1);
  if (const auto z = dead_zone(c, a)) {
    j["dead_zone_um"] = {{"wall_oxygen_mol_l", z->wall_mol_l},
                         {"even_light", number(z->even_um)},
                         {"falling_light", number(z->deep_um)}};
  }
  return j;
}

std::string text_of(const std::string& name, const Chemistry& c, const ChemistryArguments& a,
                    const CellTimes& t) {
  const GelTime g = gel_time_of(c);
  const double i = a.intensity_mw_cm2;
  std::string out = fmt::format("{} under {} mW/cm²\n", name, figure(i));
  const auto row = [&](const char* what, const std::string& full, const std::string& closed) {
    out += fmt::format("  {:<22}{:<18}{}\n", what, full, closed);
  };
  row("", "full equations", "closed form");
  row("inhibited until", seconds(t.inhibition_time_s),
      seconds(a.supply_per_s > 0 ? inhibition_time_supplied_s(c, i, a.supply_per_s)
                                 : inhibition_time_used_up_s(c, i)));
  row("gelled at", seconds(t.gel_time_s), seconds(gel_time_s(g, i)));
  out +=
      fmt::format("  time to gel = A/I + B/sqrt(I), A {} mJ/cm², B {} (mW/cm²)^½·s; m = {} here\n",
                  figure(g.A), figure(g.B), figure(local_exponent(g, i)));
  out += fmt::format("  chains {} mol/l while inhibited, then {} mol/l within {} s\n",
                     figure(inhibited_radicals_mol_l(c, i)), figure(steady_radicals_mol_l(c, i)),
                     figure(rise_time_s(c, i)));
  out += fmt::format("  light falls to 1/e over {} um\n", figure(light_height_um(c)));
  out += fmt::format(
      "  a second in the dark after long light uses up another {} % of the end groups\n",
      figure(100 * dark_conversion(c, i, 1)));
  if (a.supply_per_s > 0) {
    out +=
        fmt::format("  with oxygen from outside at {} per s it gels above {} mW/cm²\n",
                    figure(a.supply_per_s), figure(threshold_intensity_mw_cm2(c, a.supply_per_s)));
  }
  if (const auto z = dead_zone(c, a)) {
    out += fmt::format(
        "  a permeable window that holds {} mol/l of oxygen keeps {} um liquid ({} um "
        "as light falls)\n",
        figure(z->wall_mol_l), figure(z->even_um),
        std::isfinite(z->deep_um) ? figure(z->deep_um) : "all");
  }
  return out;
}

int chemistry_command(const ChemistryArguments& a, const ExecutionContext& context,
                      cli::Console& console) {
  const std::string path = find_definition(a.resin, "resin");
  for (const std::string& output : {a.json, a.csv, a.output}) cli::check_output(output, {path});
  if (!a.output.empty() && std::filesystem::path(a.output).extension() != ".svg") {
    throw InputError(a.output, "", "expected a picture that ends in .svg");
  }
  const Resin resin = load_resin(path);
  if (!resin.chemistry) {
    throw InputError(path, "chemistry", "missing; expected a table with the resin's chemistry");
  }
  const Chemistry& c = *resin.chemistry;
  CellQuestion q;
  q.supply_per_s = a.supply_per_s;
  q.tolerance = 1e-4;
  for (const std::string& step : a.light) q.light.push_back(light_step(step));

  const std::string never = never_gels(c, a.intensity_mw_cm2, a.supply_per_s);
  const CellTimes times = cell_times(c, a.intensity_mw_cm2, a.supply_per_s, context);
  if (q.light.empty()) {
    const double shown = std::isfinite(times.gel_time_s)
                             ? 2 * times.gel_time_s
                             : 3 * inhibition_time_s(c, a.intensity_mw_cm2);
    q.light = {{shown, a.intensity_mw_cm2}};
  }
  if (!a.csv.empty() || !a.output.empty() || !a.light.empty()) {
    const CellRun run = run_cell(c, q, context);
    if (!a.csv.empty()) cli::print_or_write(a.csv, run.to_csv(c));
    if (!a.output.empty()) {
      cli::write_text_file(a.output, resins::cell_svg(c, run, resin.name));
      console.say(fmt::format("{}: written", a.output));
    }
    const CellState& s = run.moments.back().state;
    console.say(fmt::format("After {:g} s {} % of the end groups are used up; gelled: {}.",
                            run.moments.back().time_s, figure(100 * used_up(c, s)),
                            seconds(run.gel_time_s)));
  }
  if (!a.json.empty()) cli::print_or_write(a.json, json_of(c, a, times).dump(2));
  if (a.json != "-" && a.csv != "-") cli::print_result(text_of(resin.name, c, a, times));
  if (!never.empty()) throw InfeasibleError(never);
  return cli::kDone;
}

}  // namespace

void add_chemistry(cli::Program& program) {
  const auto a = std::make_shared<ChemistryArguments>();
  CLI::App* app = program.add(
      "chemistry", "What light does to a resin whose file has [chemistry]: one well mixed cell.",
      [a](const ExecutionContext& context, cli::Console& console) {
        return chemistry_command(*a, context, console);
      });
  app->add_option("NAME", a->resin, "Resin: a .toml file or a name")
      ->check(cli::value_is(cli::ValueKind::resin))
      ->required();
  app->add_option("--intensity-mw-cm2", a->intensity_mw_cm2, "Light in the cell")
      ->required()
      ->check(cli::number_above_zero());
  app->add_option("--light", a->light,
                  "Light one after the other, mW/cm² and seconds, for --csv and -o: 100:1.6 0:5 is "
                  "dark after 1.6 s [the light above for twice the time to gel]")
      ->check(cli::value_is(cli::ValueKind::text))
      ->take_all()
      ->expected(1, 1000);
  app->add_option("--oxygen-supply-per-s", a->supply_per_s,
                  "Oxygen comes from outside at this rate times what is missing [0]")
      ->check(cli::number_in(0, 1e9));
  app->add_option("--wall-oxygen-mol-l", a->wall_mol_l,
                  "Oxygen at a permeable window, for its dead zone [that of the resin]")
      ->check(cli::number_in(0, kMostConcentration));
  app->add_option("--csv", a->csv, "Write concentrations over time here (- for stdout)");
  app->add_option("-o,--output", a->output, "Draw them here (.svg)");
  app->add_option("--json", a->json, "Write figures as JSON here (- for stdout)");
}

}  // namespace slicecorr::resinctl
