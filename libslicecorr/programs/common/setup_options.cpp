// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "programs/common/setup_options.hpp"

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <optional>
#include <utility>

#include "programs/common/program.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/flow.hpp"
#include "support/text/csv.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::cli {

void SetupOptions::add_to(CLI::App& app, bool required, bool correcting,
                          const std::vector<std::string>& more_modes) {
  std::vector<std::string> modes{"continuous", "layerwise"};
  modes.insert(modes.end(), more_modes.begin(), more_modes.end());
  std::optional<OptionGroup> group;
  // What a stack of ours says needs not be said again.
  group.emplace(app, required ? "Printer, resin and process"
                              : "Printer, resin and process, where the stack does not say them");
  auto* p = app.add_option("--printer", printer, "Printer: a .toml file or a name");
  auto* r = app.add_option("--resin", resin, "Resin: a .toml file or a name");
  if (required) {
    p->required();
    r->required();
  }
  app.add_option("--mode", mode,
                 "How the printer exposes: while the stage moves, or standing still for each layer "
                 "[continuous]")
      ->check(CLI::IsMember(modes));
  app.add_option("--speed-mm-h", speed_mm_h, "Print speed (continuous)")
      ->check(number_above_zero());
  app.add_option("--exposure-s", exposure_s,
                 "Exposure of each layer (layerwise) [the times in the archive, where it has some]")
      ->check(number_above_zero());
  app.add_option("--bottom-exposure-s", bottom_exposure_s,
                 "Exposure of the first layers (layerwise)")
      ->check(number_above_zero());
  app.add_option("--bottom-layers", bottom_layers,
                 "Number of layers with --bottom-exposure-s (layerwise)")
      ->check(CLI::Range(0, 1000000));
  app.add_option(
         "--fade-layers", fade_layers,
         "Number of layers after the bottom layers, over which the exposure falls to the normal one "
         "in equal steps (layerwise)")
      ->check(CLI::Range(0, 1000000));
  app.add_option("--dc-mj-cm3", dc_mj_cm3,
                 "Critical dose, at which the correction aims, instead of the resin file's; for an "
                 "exponent m of 1")
      ->check(number_above_zero());
  app.add_option(
         "--dose-factor", dose_factor,
         "Critical dose over gel dose, instead of the resin file's. Where the file has one dose "
         "alone, that dose is taken for the gel dose")
      ->check(number_above_zero());
  app.add_option("--ha-um", ha_um, "Absorbance height, base 10, instead of the resin file's")
      ->check(number_above_zero());
  app.add_option("--resin-depth-um", resin_depth_um,
                 "Depth of the resin above the window, instead of the printer file's")
      ->check(number_in(0, kMostDepthUm, true));
  app.add_option("--platform-reflectance", platform_reflectance,
                 "Share of the light that the platform sends back, 0 to 1, instead of the printer "
                 "file's")
      ->check(CLI::Range(0.0, 1.0));
  if (correcting) {
    group.reset();
    group.emplace(app, "Correction");
    add_surface_to(app);
    app.add_option("--omega-max", omega_max,
                   "Cap of the dose inside features, in critical doses: inf, 1 or more")
        ->check(value_is(ValueKind::text))
        ->capture_default_str();
    app.add_option(
           "--one-slice-gaps", one_slice_gaps,
           "Gaps one slice high: keep them open, for which the feature on their platform side loses "
           "some height, or let them close (merge)")
        ->check(CLI::IsMember({"open", "merge"}))
        ->capture_default_str();
    app.add_option(
           "--gap-shortfall", gap_shortfall,
           "For open gaps one slice high: share of a slice that the feature on their platform "
           "side may lose, up to 0.5; the more it may lose, the less the gap cures "
           "(continuous) [0.18]")
        ->check(number_in(0, 0.5, true));
    app.add_option("--edge-aim-um", edge_aim_um,
                   "How far from its height an edge may lie; a larger distance leaves gaps of two "
                   "and three slices darker (continuous) [as near as grey levels allow, some 0.05]")
        ->check(number_in(0, kMostEdgeAimUm, true));
    app.add_option(
           "--platform-features", platform_features,
           "Whether --omega-max caps features that lie on the platform, too (capped). Their "
           "light reaches no gap behind them, so that they may do without (uncapped)")
        ->check(CLI::IsMember({"capped", "uncapped"}))
        ->capture_default_str();
    app.add_option("--spread-correction", spread_correction,
                   "Where light spreads: correct columns together (on), or each as if it stood "
                   "alone (off)")
        ->check(CLI::IsMember({"on", "off"}))
        ->capture_default_str();
    app.add_option("--rounds", rounds,
                   fmt::format("Where light spreads: most rounds in which columns are corrected "
                               "together [{}]",
                               Process::kDefaultSpreadRounds))
        ->check(CLI::Range(0, Process::kMostSpreadRounds));
  }
  group.reset();
  group.emplace(app, "UV light and flow");
  app.add_option("--uv-mw-cm2", uv_mw_cm2, "Intensity of inhibiting UV light, the same throughout")
      ->check(number_above_zero());
  app.add_option("--dead-zone-um", dead_zone_um,
                 "Dead zone at the window that the UV light is to hold, in place of --uv-mw-cm2")
      ->check(number_above_zero());
  if (correcting) {
    app.add_option(
           "--gap-um", gap_um,
           "Gap between part and window for which suction is judged, where the resin file has "
           "viscosity_pa_s [the dead zone that the UV light holds; without UV light 80]")
        ->check(number_in(0, kMostGapUm, true));
  }
  if (correcting) {
    app.add_option(
           "--even-dead-zone", even_dead_zone,
           "Find light that makes dose and dead zone even although resin flows. constant: each "
           "lamp has one intensity per slice; blue: the curing light differs from place to place; "
           "uv: the UV light does; both: both do; auto: all that the lamps can do. --gap-um says "
           "which dead zone to reach")
        ->expected(0, 1)
        ->default_str("auto")
        ->check(CLI::IsMember({"auto", "constant", "blue", "uv", "both"}));
  }
  app.add_option("--uv-schedule", uv_schedule,
                 "How UV light changes: one intensity for all, one per slice, or one per pixel and "
                 "slice [constant; with --dead-zone-um what the lamp can do]")
      ->check(CLI::IsMember({"constant", "per-slice", "patterned"}));
  app.add_option("--window-cure", window_cure,
                 "What to do when the resin would cure to the window, which ruins the vat [refuse]")
      ->check(CLI::IsMember({"refuse", "allow"}));
  group.reset();
  group.emplace(app, "Speeds along the height");
  app.add_option("--slice-speed-mm-h", slice_speeds,
                 "Table with the columns slice,speed_mm_h: from each of these slices on the stage "
                 "goes at that speed, slower than --speed-mm-h "
                 "(continuous)")
      ->check(CLI::ExistingFile);
  app.add_option(
         "--slice-lamps", slice_lamps,
         "What the lamps do in slices with speeds of their own: follow the speed, so that doses "
         "stay the same, or stay as they are, so that a slice at half the speed gets twice the dose "
         "[follow]")
      ->check(CLI::IsMember({"follow", "stay"}));
  app.add_option(
         "--ramp", ramp,
         "Where the stage speeds up and slows down (continuous): lamp-follows: within the lit "
         "slices, and the lamp follows the speed; outside: before and after them; none: the "
         "stack does not say [none]")
      ->check(CLI::IsMember({"none", "lamp-follows", "outside"}));
  app.add_option("--ramp-mm", ramp_mm, "Distance in which the stage reaches its speed")
      ->check(number_above_zero());
}

void SetupOptions::add_surface_to(CLI::App& app) {
  app.add_option(
         "--surface", surface,
         "Where edges are to lie: where the mesh has them, as far as the stack says it (mesh), "
         "or where slices end (slices)")
      ->check(CLI::IsMember({"slices", "mesh"}))
      ->capture_default_str();
}

Setup SetupOptions::resolve(const StackInfo* info, const StackInfo* times) const {
  if (slice_speeds.empty()) return resolve_setup(*this, info, times, ChoiceNames::options);
  SetupChoices choices = *this;
  choices.slice_speed_mm_h = read_slice_speeds(slice_speeds);
  return resolve_setup(choices, info, times, ChoiceNames::options);
}

std::vector<double> read_slice_speeds(const std::string& path) {
  constexpr int most_slices = 1000000;
  CsvReader reader = CsvReader::of_file(path, {.longest_line_bytes = 1000});
  const auto wrong = [&](const std::string& what) { throw InputError(path, reader.place(), what); };
  const auto number = [&](const std::string& cell) {
    double value = 0;
    const char* const end = cell.data() + cell.size();
    const auto [stop, error] = std::from_chars(cell.data(), end, value);
    if (error != std::errc{} || stop != end || !std::isfinite(value)) {
      wrong(fmt::format("'{}' is no number", text::printable(cell)));
    }
    return value;
  };
  CsvRow row;
  std::vector<double> speeds;
  bool head = true;
  while (reader.next(row)) {
    if (row.fault != CsvRow::Fault::none || row.cells.size() != 2) {
      wrong("expected two columns, slice,speed_mm_h");
    }
    if (std::exchange(head, false)) {
      if (row.cells[0] != "slice" || row.cells[1] != "speed_mm_h") {
        wrong("expected the head slice,speed_mm_h");
      }
      continue;
    }
    const double slice = number(row.cells[0]), speed_mm_h = number(row.cells[1]);
    const auto last = static_cast<double>(speeds.size()) - 1;
    const bool rises = speeds.empty() ? slice == 0 : slice > last;
    if (!rises || slice != std::floor(slice) || slice >= most_slices) {
      wrong(fmt::format(
          "slice {}; expected {}", row.cells[0],
          speeds.empty() ? "the first row to be of slice 0"
                         : fmt::format("a whole number above {:g}, below {}", last, most_slices)));
    }
    if (!(speed_mm_h > 0)) {
      wrong(fmt::format("speed {} mm/h; expected one above 0", row.cells[1]));
    }
    if (!speeds.empty()) speeds.resize(static_cast<std::size_t>(slice), speeds.back());
    speeds.push_back(speed_mm_h);
  }
  if (speeds.empty()) throw InputError(path, "", "has no speeds; expected rows slice,speed_mm_h");
  return speeds;
}

const std::string& design(const std::string& path) {
  check_design(StackReader::read_info(path), path);
  return path;
}

std::string dose_words(const Setup& setup) {
  if (setup.process.mode != ExposureMode::layerwise || setup.resin.dose_factor <= 1) return "";
  return fmt::format(
      " (the critical dose is {:g} times the gel dose of resin '{}': its dose factor; --dose-factor "
      "sets another one, 1 aims at the gel dose itself)",
      setup.resin.dose_factor, setup.resin.name);
}

void tell_notices(const Setup& setup, const StackInfo* times, const ExecutionContext& context) {
  for (const std::string& text : setup_notices(setup, times, ChoiceNames::options))
    context.tell(text);
}

}  // namespace slicecorr::cli
