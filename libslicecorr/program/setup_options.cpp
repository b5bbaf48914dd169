#include "program/setup_options.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "program/program.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::cli {

namespace {

double omega_max_of(const std::string& text) {
  if (text == "inf") return 1e300;
  std::size_t used = 0;
  double value = 0;
  try {
    value = std::stod(text, &used);
  } catch (const std::exception&) {
    used = 0;
  }
  if (used != text.size() || text.empty() || !(value >= 1.0)) {
    throw InputError(fmt::format("--omega-max {}: expected inf or a number of at least 1", text));
  }
  return std::min(value, 1e300);
}

[[noreturn]] void wrong(const std::string& message) { throw InputError(message); }

/// Without the repeated end: the last entry holds for later layers.
std::vector<double> trimmed(std::vector<double> times) {
  while (times.size() > 1 && times.back() == times[times.size() - 2]) times.pop_back();
  return times;
}

}  // namespace

void SetupOptions::add_to(CLI::App& app, bool required, bool correcting) {
  auto* p = app.add_option("--printer", printer, "Printer: a .toml file or a name");
  auto* r = app.add_option("--resin", resin, "Resin: a .toml file or a name");
  if (required) {
    p->required();
    r->required();
  }
  app.add_option("--mode", mode,
                 "How the printer exposes: while the stage moves, or standing still for each layer "
                 "[continuous]")
      ->check(CLI::IsMember({"continuous", "layerwise"}));
  app.add_option("--speed-mm-h", speed_mm_h, "Print speed (continuous)")
      ->check(number_above_zero());
  app.add_option("--exposure-s", exposure_s,
                 "Exposure of a layer (layerwise) [the times in the archive]")
      ->check(number_above_zero());
  app.add_option("--bottom-exposure-s", bottom_exposure_s,
                 "Exposure of the first layers (layerwise)")
      ->check(number_above_zero());
  app.add_option("--bottom-layers", bottom_layers, "Number of these first layers (layerwise)")
      ->check(CLI::Range(0, 1000000));
  app.add_option("--fade-layers", fade_layers,
                 "Layers after them in which the exposure goes to the normal one in equal steps "
                 "(layerwise)")
      ->check(CLI::Range(0, 1000000));
  app.add_option("--dc-mj-cm3", dc_mj_cm3, "Dose to aim at, instead of the resin file's")
      ->check(number_above_zero());
  app.add_option("--ha-um", ha_um, "Absorbance height, base 10, instead of the resin file's")
      ->check(number_above_zero());
  if (correcting) {
    app.add_option("--omega-max", omega_max,
                   "Cap of the dose inside features, in critical doses: inf, 1 or more")
        ->capture_default_str();
    app.add_option(
           "--one-slice-gaps", one_slice_gaps,
           "Gaps one slice high: keep them open (the upper feature loses some height) or merge "
           "them")
        ->check(CLI::IsMember({"open", "merge"}))
        ->capture_default_str();
    app.add_option("--platform-features", platform_features,
                   "Whether --omega-max holds for features on the platform, which have nothing "
                   "behind them to protect")
        ->check(CLI::IsMember({"capped", "uncapped"}))
        ->capture_default_str();
  }
  app.add_option("--uv-mw-cm2", uv_mw_cm2, "Intensity of inhibiting UV light, the same throughout")
      ->check(number_above_zero());
  app.add_option("--dead-zone-um", dead_zone_um,
                 "Dead zone at the window that the UV light is to hold, in place of --uv-mw-cm2")
      ->check(number_above_zero());
  app.add_option("--uv-schedule", uv_schedule,
                 "How the UV light goes: one intensity; one per slice; one per pixel and slice "
                 "[constant, or what the lamp can do for --dead-zone-um]")
      ->check(CLI::IsMember({"constant", "per-slice", "patterned"}));
  app.add_option("--window-cure", window_cure,
                 "What to do when the resin would cure to the window, which ruins the vat [refuse]")
      ->check(CLI::IsMember({"refuse", "allow"}));
  app.add_option("--ramp", ramp,
                 "Where the stage speeds up and slows down (continuous): the lamp follows it, or "
                 "outside of the lit slices [none: not said]")
      ->check(CLI::IsMember({"none", "lamp-follows", "outside"}));
  app.add_option("--ramp-mm", ramp_mm, "Distance in which the stage reaches its speed")
      ->check(number_above_zero());
}

void SetupOptions::resolve_exposure(Process& process, const StackInfo* times) const {
  const bool layerwise =
      mode.empty() ? process.mode == ExposureMode::layerwise : mode == "layerwise";
  const bool any_exposure =
      exposure_s > 0 || bottom_exposure_s > 0 || bottom_layers >= 0 || fade_layers >= 0;
  if (layerwise && speed_mm_h > 0) {
    wrong("--speed-mm-h is for continuous exposure; expected --exposure-s with --mode layerwise");
  }
  if (layerwise && (!ramp.empty() || ramp_mm > 0)) {
    wrong("--ramp is for continuous exposure: layer by layer the stage stands still");
  }
  if (!layerwise && any_exposure) {
    wrong("exposure times are for layer by layer exposure; expected --mode layerwise with them");
  }
  const ExposureMode now = layerwise ? ExposureMode::layerwise : ExposureMode::continuous;
  if (now != process.mode) {
    // Nothing of the other schedule holds.
    process.speed_mm_h = process.exposure_s = process.bottom_exposure_s = process.ramp_mm = 0;
    process.bottom_layers = process.fade_layers = 0;
    process.layer_exposure_s.clear();
    process.ramp = Ramp::none;
    process.mode = now;
  }
  if (!layerwise) {
    if (speed_mm_h > 0) process.speed_mm_h = speed_mm_h;
    if (!(process.speed_mm_h > 0)) wrong("--speed-mm-h is required");
    if (!ramp.empty()) {
      process.ramp = ramp == "lamp-follows" ? Ramp::lamp_follows
                     : ramp == "outside"    ? Ramp::outside
                                            : Ramp::none;
      process.ramp_mm = ramp_mm;
      if (process.ramp == Ramp::lamp_follows && !(ramp_mm > 0)) {
        wrong("--ramp lamp-follows: expected --ramp-mm, the distance that the lamp has to follow");
      }
      if (process.ramp == Ramp::none && ramp_mm > 0) wrong("--ramp-mm goes with a --ramp");
    } else if (ramp_mm > 0) {
      wrong("--ramp-mm: expected --ramp lamp-follows or outside with it");
    }
    return;
  }
  if (any_exposure) {
    if (exposure_s > 0) {
      process.exposure_s = exposure_s;
    } else if (!(process.exposure_s > 0) && times) {
      process.exposure_s = times->exposure_s;
    }
    process.layer_exposure_s.clear();
    process.bottom_exposure_s = bottom_exposure_s;
    process.bottom_layers = std::max(0, bottom_layers);
    process.fade_layers = std::max(0, fade_layers);
    if (process.bottom_layers > 0 && !(bottom_exposure_s > 0)) {
      wrong("--bottom-layers: expected --bottom-exposure-s with it");
    }
    if (bottom_exposure_s > 0 && process.bottom_layers + process.fade_layers == 0) {
      wrong("--bottom-exposure-s: expected --bottom-layers with it");
    }
    if (process.fade_layers > 0 && !(bottom_exposure_s > 0)) {
      wrong("--fade-layers: expected --bottom-exposure-s with it, which they start from");
    }
  } else if (!(process.exposure_s > 0) && times) {
    process.exposure_s = times->exposure_s;
    process.layer_exposure_s = trimmed(times->layer_exposure_s);
    process.bottom_exposure_s = times->bottom_exposure_s;
    process.bottom_layers = times->bottom_layers;
    process.fade_layers = times->fade_layers;
  }
  if (!(process.exposure_s > 0)) {
    wrong(
        "--exposure-s is required: no exposure times are given, and there are none in an archive");
  }
}

void SetupOptions::resolve_uv(Setup& setup) const {
  UvSchedule& uv = setup.process.uv;
  if (!window_cure.empty()) setup.process.allow_window_cure = window_cure == "allow";
  if (uv_mw_cm2 > 0 && dead_zone_um > 0) {
    wrong("--uv-mw-cm2 and --dead-zone-um are two ways to set the UV light; expected one of them");
  }
  if (!(uv_mw_cm2 > 0) && !(dead_zone_um > 0)) {
    if (!uv_schedule.empty()) {
      wrong(uv_schedule == "constant"
                ? "--uv-schedule constant: expected --uv-mw-cm2 with it"
                : fmt::format("--uv-schedule {}: expected --dead-zone-um with it", uv_schedule));
    }
    return;
  }
  const char* const option = uv_mw_cm2 > 0 ? "--uv-mw-cm2" : "--dead-zone-um";
  if (!setup.resin.inhibition) {
    wrong(fmt::format("{}: resin '{}' has no [inhibition]; expected one that UV light inhibits",
                      option, setup.resin.name));
  }
  if (!setup.printer.uv) {
    wrong(fmt::format("{}: printer '{}' has no [uv] lamp", option, setup.printer.name));
  }
  const bool patterned = setup.printer.uv->patterned;
  uv = {};
  if (uv_mw_cm2 > 0) {
    if (!uv_schedule.empty() && uv_schedule != "constant") {
      wrong(
          fmt::format("--uv-schedule {} holds a dead zone; expected --dead-zone-um in place of "
                      "--uv-mw-cm2",
                      uv_schedule));
    }
    uv.kind = UvKind::constant;
    uv.uv_mw_cm2 = uv_mw_cm2;
    return;
  }
  if (uv_schedule == "constant") {
    wrong("--uv-schedule constant: expected --uv-mw-cm2 in place of --dead-zone-um");
  }
  if (uv_schedule == "patterned" && !patterned) {
    wrong(fmt::format("--uv-schedule patterned: the UV lamp of printer '{}' floods the window",
                      setup.printer.name));
  }
  uv.kind = uv_schedule == "patterned" || (uv_schedule.empty() && patterned) ? UvKind::patterned
                                                                             : UvKind::per_slice;
  uv.dead_zone_um = dead_zone_um;
}

Setup SetupOptions::resolve(const StackInfo* info, const StackInfo* times) const {
  Setup setup;
  const bool recorded = info && info->printer && info->resin && info->process;
  const auto need = [&](bool given, const char* option) {
    if (!given && !recorded) {
      throw InputError(fmt::format(
          "the stack does not say how it is printed; expected {} (and --printer, --resin, "
          "--speed-mm-h or --mode layerwise)",
          option));
    }
  };
  need(!printer.empty(), "--printer");
  need(!resin.empty(), "--resin");
  if (info) need(speed_mm_h > 0 || mode == "layerwise" || exposure_s > 0, "--speed-mm-h");
  setup.printer = printer.empty() ? *info->printer : load_printer(printer);
  ResinOverrides overrides;
  if (dc_mj_cm3 > 0) overrides.dc_mj_cm3 = dc_mj_cm3;
  if (ha_um > 0) overrides.ha_um = ha_um;
  if (!resin.empty()) {
    setup.resin = load_resin(resin, overrides);
  } else {
    setup.resin = *info->resin;
    if (ha_um > 0) setup.resin.absorbance_height10_um = ha_um;
    if (dc_mj_cm3 > 0) {
      setup.resin.critical_dose_mj_cm3 = dc_mj_cm3;
      setup.resin.critical_dose_prime = 0;
    }
  }
  if (recorded) setup.process = *info->process;
  resolve_exposure(setup.process, times);
  resolve_uv(setup);
  const double cap = omega_max_of(omega_max);
  if (!recorded) {
    setup.process.omega_max = cap;
    setup.process.one_slice_gaps =
        one_slice_gaps == "merge" ? OneSliceGaps::merge : OneSliceGaps::open;
    setup.process.cap_platform_features = platform_features == "capped";
  }
  return setup;
}

const std::string& design(const std::string& path) {
  if (StackReader::read_info(path).kind == StackKind::corrected) {
    throw InputError(path, "", "is a corrected stack; expected the target that it was made from");
  }
  return path;
}

std::string notice(const Setup& setup) {
  if (setup.process.uv.kind == UvKind::off && setup.resin.inhibition && setup.printer.uv) {
    return fmt::format(
        "the UV lamp of printer '{}' counts as off: without --uv-mw-cm2 or --dead-zone-um the "
        "inhibition of resin '{}' is not considered",
        setup.printer.name, setup.resin.name);
  }
  return {};
}

}  // namespace slicecorr::cli
