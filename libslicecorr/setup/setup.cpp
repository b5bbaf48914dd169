// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/setup.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "setup/assume.hpp"
#include "setup/counts.hpp"
#include "setup/exposures.hpp"
#include "setup/lamps.hpp"
#include "setup/resolver.hpp"
#include "setup/stacks.hpp"
#include "slicecorr/assumed_light.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/kinetics.hpp"
#include "slicecorr/light_spreads.hpp"
#include "slicecorr/load_display.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/machine_motion.hpp"
#include "slicecorr/misfit.hpp"
#include "slicecorr/print_file.hpp"
#include "slicecorr/settings.hpp"
#include "slicecorr/supports.hpp"
#include "slicecorr/tuned_together.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr {

namespace detail {

void Resolver::resolve_exposure(Process& process, const StackInfo* times) const {
  const bool layerwise =
      c_.mode.empty() ? process.mode == ExposureMode::layerwise : c_.mode == "layerwise";
  if (layerwise && c_.speed_mm_h > 0) {
    misfit({"speed_mm_h"},
           fmt::format("{} is for continuous exposure; expected {} with {} layerwise",
                       o("speed_mm_h"), o("exposure_s"), o("mode")));
  }
  if (const auto moving = said_of({"ramp", "ramp_mm", "slice_speed_mm_h", "slice_lamps"});
      layerwise && !moving.empty()) {
    misfit({moving.front()},
           fmt::format("{} is for continuous exposure: layer by layer the stage stands still",
                       o(moving.front())));
  }
  if (const auto times_said = said_of(
          {"exposure_s", "bottom_exposure_s", "bottom_layers", "fade_layers", "layer_exposure_s"});
      !layerwise && !times_said.empty()) {
    misfit({times_said.front()},
           fmt::format(
               "exposure times are for layer by layer exposure; expected {} layerwise with them",
               o("mode")));
  }
  const ExposureMode now = layerwise ? ExposureMode::layerwise : ExposureMode::continuous;
  if (now != process.mode) {
    // Nothing of the schedule that it had before holds.
    process.speed_mm_h = process.exposure_s = process.bottom_exposure_s = process.ramp_mm = 0;
    process.bottom_layers = process.fade_layers = 0;
    process.layer_exposure_s.clear();
    process.slice_speed_mm_h.clear();
    process.slice_lamps = SliceLamps::follow;
    process.ramp = Ramp::none;
    process.mode = now;
  }
  if (layerwise) {
    resolve_layerwise(process, times);
  } else {
    if (times && c_.mode.empty() && c_.speed_mm_h > 0 && printers_always_lift(times->format)) {
      wrong(fmt::format(
          "printers that read files of the format {} lift after each layer; expected no {}: {} layerwise takes "
          "the file's exposure times; {} continuous only where the platform does not lift",
          times->format, o("speed_mm_h"), o("mode"), o("mode")));
    }
    // Who has a file with times of layers, or assumes light, prints layer by layer.
    const bool by_layer = (times && times->exposure_s > 0) || !c_.assume.empty();
    if (by_layer && c_.mode.empty() && !(c_.speed_mm_h > 0) && !(process.speed_mm_h > 0)) {
      wrong(
          fmt::format("{} is required: without {} the print is continuous; expected a speed, or {} "
                      "layerwise, which takes the archive's exposure times",
                      o("speed_mm_h"), o("mode"), o("mode")));
    }
    resolve_continuous(process);
  }
}

void Resolver::resolve_continuous(Process& process) const {
  if (c_.speed_mm_h > 0) process.speed_mm_h = c_.speed_mm_h;
  if (!(process.speed_mm_h > 0)) wrong(o("speed_mm_h") + " is required");
  resolve_slice_speeds(process);
  if (c_.ramp.empty()) {
    if (c_.ramp_mm > 0) {
      wrong(
          fmt::format("{}: expected {} lamp-follows or outside with it", o("ramp_mm"), o("ramp")));
    }
    return;
  }
  apply_choice(*find_setting("ramp"), c_, process);
  process.ramp_mm = c_.ramp_mm;
  if (process.ramp == Ramp::lamp_follows && !(c_.ramp_mm > 0)) {
    wrong(fmt::format("{} lamp-follows: expected {}, the distance that the lamp has to follow",
                      o("ramp"), o("ramp_mm")));
  }
  if (process.ramp == Ramp::none && c_.ramp_mm > 0) {
    wrong(fmt::format("{} goes with a {}", o("ramp_mm"), o("ramp")));
  }
}

/// Light and heights of single layers: as chosen, else as the archive says whose times count.
void Resolver::resolve_layers(Process& process, const StackInfo* times, bool recorded) const {
  const bool archive = times && !recorded;
  if (!c_.light_share.empty()) {
    process.light_share = trimmed(c_.light_share);
  } else if (archive) {
    process.light_share = trimmed(times->light_share);
  }
  if (process.light_share.size() == 1 && process.light_share.front() == 1) {
    process.light_share.clear();
  }
  take_lamp_log(c_.lamp_log, o("lamp_log"), process.lamp_share);
  take_lamp_log(c_.uv_lamp_log, o("uv_lamp_log"), process.uv_lamp_share);
  if (!c_.layer_heights_um.empty()) {
    process.layer_heights_um = trimmed(c_.layer_heights_um);
  } else if (archive) {
    process.layer_heights_um = trimmed(times->layer_heights_um);
  }
  // Listed, but all as the stack says.
  std::vector<double>& um = process.layer_heights_um;
  if (um.size() == 1 && times && um.front() == times->grid.layer_um) um.clear();
}

/// What is said of lifts counts before what printer and resin files say, and that before what a stack
/// was made for.
void Resolver::resolve_lifts(Setup& setup, bool recorded) const {
  Process& p = setup.process;
  const bool said =
      !c_.lifts.empty() || c_.green_strength > 0 || c_.skin > 0 || c_.lift_exchange >= 0;
  if (p.mode != ExposureMode::layerwise) {
    if (said) {
      const char* const what = !c_.lifts.empty() ? "lifts" : how_said();
      misfit({what}, fmt::format("{} is for layer by layer exposure; expected {} layerwise with it",
                                 o(what), o("mode")));
    }
    p.lifts = Lifts::none;
    return;
  }
  const bool how = c_.green_strength > 0 || c_.skin > 0 || c_.lift_exchange >= 0;
  if (!recorded) {
    // A dead zone keeps the part off the window: printers that lift in spite of one are told so.
    const bool dead_zone = p.uv.kind != UvKind::off && c_.lifts.empty();
    p.lifts = dead_zone ? Lifts::none : setup.printer.lifts;
    p.lift_exchange = dead_zone ? kUnknownExchange : setup.printer.lift_exchange;
    if (setup.resin.green_strength > 0) p.green_strength = setup.resin.green_strength;
  }
  if (!c_.lifts.empty()) apply_choice(*find_setting("lifts"), c_, p);
  if (how && p.lifts == Lifts::none) {
    misfit({how_said()},
           fmt::format("{} is for layers that hold at each lift; expected {} each with it",
                       o(how_said()), o("lifts")));
  }
  if (c_.green_strength > 0) p.green_strength = c_.green_strength;
  if (c_.skin > 0) p.skin = c_.skin;
  if (c_.lift_exchange >= 0) p.lift_exchange = c_.lift_exchange;
  if (recorded) return;
  // With lifts the strength at joints takes the place of a factor on all doses.
  Process counted = p;
  leave_out_lifts(setup.printer, setup.resin, counted);
  const bool dose_said = c_.dose_factor > 0 || c_.dc_mj_cm3 > 0;
  if (counted.lifts == Lifts::each && !dose_said && setup.resin.dose_factor > 1) {
    ResinOverrides gel;
    gel.dose_factor = 1;
    setup.resin = with_overrides(setup.resin, gel);
  }
}

void Resolver::resolve_slice_speeds(Process& process) const {
  std::vector<double>& speeds = process.slice_speed_mm_h;
  if (!c_.slice_speed_mm_h.empty()) {
    speeds = trimmed(c_.slice_speed_mm_h);
    process.slice_lamps = SliceLamps::follow;
  }
  if (!c_.slice_lamps.empty()) {
    if (speeds.empty()) {
      misfit({"slice_lamps"}, fmt::format("{} {}: expected speeds of slices with it ({})",
                                          o("slice_lamps"), c_.slice_lamps, o("slice_speed_mm_h")));
    }
    process.slice_lamps = c_.slice_lamps == "stay" ? SliceLamps::stay : SliceLamps::follow;
  }
  for (std::size_t n = 0; n < speeds.size(); ++n) {
    if (speeds[n] > 0 && speeds[n] <= process.speed_mm_h) continue;
    wrong(
        fmt::format("{}: slice {} at {:g} mm/h; expected a speed above 0, at most the {:g} mm/h "
                    "that the light is for ({})",
                    o("slice_speed_mm_h"), n, speeds[n], process.speed_mm_h, o("speed_mm_h")));
  }
  if (speeds.size() == 1 && speeds.front() == process.speed_mm_h) speeds.clear();
  if (speeds.empty()) process.slice_lamps = SliceLamps::follow;
}

void Resolver::resolve_layerwise(Process& process, const StackInfo* times) const {
  if (!c_.layer_exposure_s.empty()) {
    if (any_exposure()) {
      auto both = said_of({"exposure_s", "bottom_exposure_s", "bottom_layers", "fade_layers"});
      // Of several, one alone does not do.
      if (both.size() > 1) both.resize(1);
      both.emplace_back("layer_exposure_s");
      misfit(both,
             fmt::format("{} says the exposure of every layer; expected no other times with it",
                         o("layer_exposure_s")));
    }
    process.layer_exposure_s = trimmed(c_.layer_exposure_s);
    process.exposure_s = process.layer_exposure_s.back();
    process.bottom_exposure_s = 0;
    process.bottom_layers = process.fade_layers = 0;
  } else if (any_exposure()) {
    if (c_.exposure_s > 0) {
      process.exposure_s = c_.exposure_s;
    } else if (!(process.exposure_s > 0) && times) {
      process.exposure_s = times->exposure_s;
    }
    process.layer_exposure_s.clear();
    // The longer first exposure makes a part stick to the platform: an archive's holds on, unless
    // it lists all its layers, or is no longer one beside the new exposure.
    const bool has_first =
        has_first_exposure(times) && times->bottom_exposure_s > process.exposure_s;
    process.bottom_exposure_s = c_.bottom_exposure_s > 0 ? c_.bottom_exposure_s
                                : has_first              ? times->bottom_exposure_s
                                                         : 0;
    process.bottom_layers = c_.bottom_layers >= 0 ? c_.bottom_layers
                            : has_first           ? times->bottom_layers
                                                  : 0;
    process.fade_layers = c_.fade_layers >= 0 ? c_.fade_layers : has_first ? times->fade_layers : 0;
    if (process.bottom_layers > 0 && !(process.bottom_exposure_s > 0)) {
      wrong(fmt::format("{}: expected {} with it", o("bottom_layers"), o("bottom_exposure_s")));
    }
    if (process.bottom_layers + process.fade_layers == 0) {
      if (c_.bottom_exposure_s > 0) {
        wrong(fmt::format("{}: expected {} with it", o("bottom_exposure_s"), o("bottom_layers")));
      }
      process.bottom_exposure_s = 0;
    }
    if (process.fade_layers > 0 && !(process.bottom_exposure_s > 0)) {
      wrong(fmt::format("{}: expected {} with it, which they start from", o("fade_layers"),
                        o("bottom_exposure_s")));
    }
    // Steps of any size that the archive lists hold on, too.
    if (said_of({"bottom_exposure_s", "bottom_layers", "fade_layers"}).empty()) {
      process.layer_exposure_s = detail::listed_first_exposures(times, process.exposure_s);
    }
  } else if (!(process.exposure_s > 0) && times) {
    process.exposure_s = times->exposure_s;
    process.layer_exposure_s = trimmed(times->layer_exposure_s);
    process.bottom_exposure_s = times->bottom_exposure_s;
    process.bottom_layers = times->bottom_layers;
    process.fade_layers = times->fade_layers;
  }
  if (!(process.exposure_s > 0)) {
    wrong(o("exposure_s") +
          " is required: no exposure times are given, and there are none in an archive");
  }
}

Printer Resolver::printer() const {
  if (assumes()) {
    Printer display = c_.printer_toml.empty() ? load_display(c_.printer)
                                              : parse_display(c_.printer_toml, o("printer_toml"));
    const AssumedLight light = assumed_light(c_.assume, display);
    return with_assumed_light(std::move(display), light);
  }
  return c_.printer_toml.empty() ? load_printer(c_.printer)
                                 : complete_printer(c_.printer_toml, o("printer_toml"));
}

ResinOverrides Resolver::overrides() const {
  const ResinOverrides overrides = resin_overrides(c_);
  if (overrides.dc_mj_cm3 && overrides.dose_factor) {
    misfit({"dc_mj_cm3", "dose_factor"},
           fmt::format("{} and {} are two ways to set the dose; expected one of them",
                       o("dc_mj_cm3"), o("dose_factor")));
  }
  return overrides;
}

Resin Resolver::resin() const {
  return c_.resin_toml.empty() ? load_resin(c_.resin, overrides())
                               : parse_resin(c_.resin_toml, o("resin_toml"), overrides());
}

Printer Resolver::chosen_printer() const {
  if (c_.printer.empty() && c_.printer_toml.empty()) {
    wrong(fmt::format("no printer; expected {}", o("printer")));
  }
  return printer();
}

Resin Resolver::chosen_resin() const {
  if (c_.resin.empty() && c_.resin_toml.empty()) {
    wrong(fmt::format("no resin; expected {}", o("resin")));
  }
  return resin();
}

void Resolver::resolve_ramp(Setup& setup) const {
  if (setup.process.mode != ExposureMode::continuous || !c_.ramp.empty()) return;
  const auto machine = c_.printer_toml.empty()
                           ? load_machine_motion(c_.printer)
                           : parse_machine_motion(c_.printer_toml, o("printer_toml"));
  if (!machine) return;
  const double m = make_kinetics(setup.resin, setup.process.uv.kind != UvKind::off, true).m;
  take_ramp(*machine, m, setup.resin.absorbance_height10_um, setup.process);
}

Setup Resolver::resolve(const StackInfo* info, const StackInfo* times) const {
  Setup setup;
  check_choices(c_, names_);
  const bool recorded = info && info->printer && info->resin && info->process;
  const auto need = [&](bool given, std::string_view option) {
    if (given || recorded) return;
    const bool by_layer = assumes() || (times && times->exposure_s > 0);
    throw InputError(
        option == "speed_mm_h" && by_layer
            ? fmt::format("the stack does not say how it is printed; expected {} layerwise, which "
                          "takes the archive's exposure times, or {}",
                          o("mode"), o(option))
            : fmt::format(
                  "the stack does not say how it is printed; expected {} (and {}, {}, {} or "
                  "{} layerwise)",
                  o(option), o("printer"), o("resin"), o("speed_mm_h"), o("mode")));
  };
  const bool printer_given = !c_.printer.empty() || !c_.printer_toml.empty();
  const bool resin_given = !c_.resin.empty() || !c_.resin_toml.empty();
  need(printer_given, "printer");
  need(resin_given, "resin");
  if (assumes() && !(printer_given && resin_given)) {
    wrong(fmt::format("{} is for {} and {}; expected them with it", o("assume"), o("printer"),
                      o("resin")));
  }
  if (info) need(c_.speed_mm_h > 0 || c_.mode == "layerwise" || c_.exposure_s > 0, "speed_mm_h");
  setup.printer = printer_given ? printer() : *info->printer;
  if (printer_given && setup.printer.vial) {
    throw InputError(fmt::format(
        "printer '{}' turns a vial, in which a whole part gels at once: it shows no slices; expected a "
        "printer of slices, or \"slicecorr tomo solve\", which makes a job for this one",
        setup.printer.name));
  }
  if (c_.resin_depth_um > 0) setup.printer.resin_depth_um = c_.resin_depth_um;
  if (c_.platform_reflectance >= 0) setup.printer.platform_reflectance = c_.platform_reflectance;
  setup.resin = resin_given ? resin() : with_overrides(*info->resin, overrides());
  if (recorded) setup.process = *info->process;
  resolve_exposure(setup.process, times);
  resolve_layers(setup.process, times, recorded);
  if (c_.even_dead_zone.empty()) {
    resolve_uv(setup);
  } else {
    resolve_even_dead_zone(setup);
  }
  if (printer_given && !recorded) resolve_ramp(setup);
  resolve_lifts(setup, recorded && setup.process.mode == info->process->mode);
  const StackInfo* const assumed =
      recorded && info->process->assumed != AssumedLight::none ? info : nullptr;
  assume_strength(c_, assumed, setup.process);
  if (assumes()) {
    const StackInfo* const sized = info ? info : times;
    if (!sized && !(c_.layer_um > 0) && setup.process.layer_heights_um.empty()) {
      wrong(fmt::format(
          "{} counts on exposures that print: expected a correction or a prediction, whose "
          "exposures and layer heights are known",
          o("assume")));
    }
    setup.process.assumed = assumed_light(c_.assume, setup.printer);
    assume_dose({c_, names_, assumed, times}, sized ? sized->grid.layer_um : c_.layer_um, setup);
  } else if (printer_given) {
    setup.process.assumed = AssumedLight::none;
  }
  // What a stack has of both was taken when it was made.
  if (printer_given || resin_given) {
    check_light(setup.printer, setup.resin, setup.process.uv.kind != UvKind::off);
  }
  if (printer_given && resin_given && !assumes()) {
    check_tuned_together(c_.printer_toml.empty()
                             ? DefinitionText::of_printer(c_.printer)
                             : DefinitionText{c_.printer_toml, o("printer_toml")},
                         setup.resin);
  }
  setup.gap_um = std::max(0.0, c_.gap_um);
  setup.refuse_loose = c_.loose == "refuse";
  setup.least_neck_mm2 = std::max(0.0, c_.least_neck_mm2);
  const StackInfo* const lifted = times && times->lift_times ? times : info;
  setup.lift_times =
      lifted && lifted->lift_times ? lifted->lift_times : lift_times_of(setup.printer);
  if (!recorded) {
    for (const Setting& s : settings()) {
      if (s.group == kHowItIsCorrected) apply_choice(s, c_, setup.process);
    }
    leave_out_heights(setup.printer, setup.resin, setup.process);
    // Without light that spreads there are no rounds, and nothing to say of them.
    if (!light_spreads(setup.printer, setup.resin, setup.process)) {
      setup.process.spread_rounds = Process::kDefaultSpreadRounds;
    } else if (c_.spread_correction == "off") {
      setup.process.spread_rounds = 0;
    }
  }
  check_counts(setup, c_, names_);
  if (setup.process.assumed != AssumedLight::none) assume_errors(setup);
  if (info && info->recording) check_recorded(setup, *info);
  setup.printer = for_resin(std::move(setup.printer), setup.resin);
  return setup;
}

}  // namespace detail

using detail::Resolver;

ResinOverrides resin_overrides(const SetupChoices& choices) {
  ResinOverrides overrides;
  if (choices.dc_mj_cm3 > 0) overrides.dc_mj_cm3 = choices.dc_mj_cm3;
  if (choices.ha_um > 0) overrides.ha_um = choices.ha_um;
  if (choices.dose_factor > 0) overrides.dose_factor = choices.dose_factor;
  return overrides;
}

std::pair<Printer, Resin> chosen_definitions(const SetupChoices& choices, ChoiceNames names) {
  const Resolver resolver(choices, names);
  if (resolver.assumes()) {
    throw InputError(
        fmt::format("{} is for prints layer by layer: expected light that was measured",
                    setting_name(names, "assume")));
  }
  std::pair<Printer, Resin> chosen{resolver.chosen_printer(), resolver.chosen_resin()};
  resolver.check_light(chosen.first, chosen.second, false);
  return chosen;
}

void check_chosen_light(const Printer& printer, const Resin& resin, bool uv,
                        const SetupChoices& choices, ChoiceNames names) {
  Resolver(choices, names).check_light(printer, resin, uv);
}

Setup resolve_setup(const SetupChoices& choices, const StackInfo* info, const StackInfo* times,
                    ChoiceNames names) {
  return Resolver(choices, names).resolve(info, times);
}

}  // namespace slicecorr
