#include "options.hpp"

#include <fmt/format.h>

#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>
#include <numeric>

#include "slicecorr/error.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::cli {

namespace {

Units units_named(const std::string& name) {
  if (name == "mm") return Units::mm;
  if (name == "inch") return Units::inch;
  if (name == "m") return Units::m;
  return Units::automatic;
}

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

}  // namespace

void MeshOptions::add_to(CLI::App& app) {
  app.add_option("PART", parts, "Meshes (stl, obj, ply, off, 3mf; also .gz) that share the plate")
      ->required();
  app.add_option("--layer-um", layer_um, "Slice height, 1 to 1000")
      ->required()
      ->check(number_in(1, 1000));
  app.add_option("--antialias", antialias, "Area coverage in 256 levels, or the pixel-centre rule")
      ->check(CLI::IsMember({"on", "off"}))
      ->capture_default_str();
  add_placement_to(app);
}

void MeshOptions::add_placement_to(CLI::App& app) {
  app.add_option(
         "--center-mm", center_mm,
         "X,Y: where the centre of the parts lies on the plate, from its corner at the least "
         "x and y [the middle]")
      ->delimiter(',')
      ->expected(2)
      ->check(number_in(-1e6, 1e6));
  app.add_option("--units", units, "Units of the meshes [those of the file, else mm]")
      ->check(CLI::IsMember({"auto", "mm", "inch", "m"}));
  app.add_option("--scale", scale, "Factor on all lengths")->capture_default_str();
  app.add_option("--rotate-deg", rotate_deg, "X,Y,Z: turned about the fixed axes, in this order")
      ->delimiter(',')
      ->expected(3)
      ->check(number_in(-1e6, 1e6));
}

Placement MeshOptions::placement() const {
  Placement p;
  p.units = units_named(units);
  p.scale = scale;
  if (!rotate_deg.empty()) p.rotate_deg = {rotate_deg[0], rotate_deg[1], rotate_deg[2]};
  return p;
}

SliceOptions MeshOptions::slice_options() const {
  SliceOptions o;
  o.layer_um = layer_um;
  o.antialias = antialias == "on";
  if (!center_mm.empty()) o.center_mm = {center_mm[0], center_mm[1]};
  return o;
}

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

namespace {

[[noreturn]] void wrong(const std::string& message) { throw InputError(message); }

/// Without the repeated end: the last entry holds for later layers.
std::vector<double> trimmed(std::vector<double> times) {
  while (times.size() > 1 && times.back() == times[times.size() - 2]) times.pop_back();
  return times;
}

}  // namespace

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

TriangleMesh read_parts(const MeshOptions& options, const Job& job) {
  TriangleMesh all;
  for (const std::string& path : options.parts) {
    job.check_cancelled();
    const TriangleMesh part = read_mesh(path, options.placement());
    const MeshReport r = inspect(part);
    job.tell(fmt::format("{}: {} {}, {} {}, {:.3f} x {:.3f} x {:.3f} mm", path, r.triangles,
                         r.triangles == 1 ? "triangle" : "triangles", r.bodies,
                         r.bodies == 1 ? "body" : "bodies", r.upper[0] - r.lower[0],
                         r.upper[1] - r.lower[1], r.upper[2] - r.lower[2]));
    if (r.defects.any()) job.tell(fmt::format("{}: {}", path, describe(r.defects)));
    append(all, part);
  }
  return all;
}

std::string figures_table(const std::vector<Figures>& columns) {
  std::string text;
  const auto line = [&](const char* name, auto figure) {
    text += fmt::format("  {:<34}", name);
    for (const Figures& c : columns) text += fmt::format("{:>18}", figure(*c.prediction));
    text += "\n";
  };
  if (columns.size() > 1) {
    text += fmt::format("  {:<34}", "");
    for (const Figures& c : columns) text += fmt::format("{:>18}", c.heading);
    text += "\n";
  }
  const auto edge = [](const Prediction& p, double value) {
    return p.height_error_um.count() ? fmt::format("{:.3f} um", value) : std::string("-");
  };
  line("height error, mean",
       [&](const Prediction& p) { return edge(p, p.height_error_um.mean()); });
  line("height error, 95 % within",
       [&](const Prediction& p) { return edge(p, p.height_error_um.quantile(0.95)); });
  line("height error, largest",
       [&](const Prediction& p) { return edge(p, p.height_error_um.greatest()); });
  line("gap voxels cured through",
       [](const Prediction& p) { return fmt::format("{}", p.cure_through_voxels); });
  line("feature voxels undercured",
       [](const Prediction& p) { return fmt::format("{}", p.undercure_voxels); });
  line("column features lost",
       [](const Prediction& p) { return fmt::format("{} of {}", p.lost_features, p.runs); });
  line("column gaps merged",
       [](const Prediction& p) { return fmt::format("{} of {}", p.merged_features, p.gaps); });
  line("one-slice gaps", [](const Prediction& p) { return fmt::format("{}", p.one_slice_gaps); });
  line("overlap with the design",
       [](const Prediction& p) { return fmt::format("{:.6f}", p.iou()); });
  return text;
}

std::string summary(const Prediction& after, const std::optional<Prediction>& before) {
  std::vector<Figures> columns;
  if (before) columns.push_back({"uncorrected", &*before});
  columns.push_back({"corrected", &after});
  std::string text = figures_table(columns);
  if (const auto& l = after.layerwise) {
    text += fmt::format(
        "  layer by layer: black light alone cures {:.3f} um above a feature{}; the dose within a "
        "layer varies {:.3f}-fold{}\n",
        l->cut_through_um,
        l->max_cut_through_um > l->cut_through_um
            ? fmt::format(" ({:.3f} um where exposures are longest)", l->max_cut_through_um)
            : "",
        l->heterogeneity,
        l->gels_further_teeth ? "; it is enough to gel layers further up beside their windows"
                              : "");
  }
  if (const auto& zones = after.dead_zones; zones && std::isfinite(zones->least())) {
    text += fmt::format("  dead zone over lit pixels: {:.3f} to {:.3f} um{}\n", zones->least(),
                        zones->greatest(),
                        zones->cured_pixels == 0
                            ? ""
                            : fmt::format("; the resin cures to the window at {} pixels, first in "
                                          "slice {}",
                                          zones->cured_pixels, zones->cured_slice));
  }
  return text;
}

double print_time_s(const StackInfo& info) {
  const Grid& g = info.grid;
  if (info.process)
    return light_on_s(*info.process, info.resin ? info.resin->m : 1.0, g.layer_um, g.layers);
  if (!info.layer_exposure_s.empty()) {
    return std::accumulate(info.layer_exposure_s.begin(), info.layer_exposure_s.end(), 0.0);
  }
  const int bottom = std::min(info.bottom_layers, g.layers);
  return (g.layers - bottom) * info.exposure_s + bottom * info.bottom_exposure_s;
}

namespace {
const char* kind_name(StackKind kind) {
  switch (kind) {
    case StackKind::target:
      return "target";
    case StackKind::corrected:
      return "corrected";
    default:
      return "foreign";
  }
}

std::string exposures(const Process& p) {
  if (!p.layer_exposure_s.empty()) {
    const auto [least, greatest] =
        std::minmax_element(p.layer_exposure_s.begin(), p.layer_exposure_s.end());
    return fmt::format("{:g} to {:g} s each, {:g} s as a rule", *least, *greatest, p.exposure_s);
  }
  std::string text = fmt::format("{:g} s each", p.exposure_s);
  if (p.bottom_layers + p.fade_layers > 0) {
    text += fmt::format("; the first {} {:g} s, then {} between", p.bottom_layers,
                        layer_exposure_s(p, 0), p.fade_layers);
  }
  return text;
}
}  // namespace

std::string describe_stack(const StackInfo& info) {
  const Grid& g = info.grid;
  std::string text = fmt::format(
      "kind         {}\nslices       {} of {:g} um, {:.3f} mm in all\nimages       {} x {} pixels "
      "of "
      "{:g} "
      "x {:g} um\n",
      kind_name(info.kind), g.layers, g.layer_um, g.layers * g.layer_um * 1e-3, g.width_px,
      g.height_px, g.pixel_x_um, g.pixel_y_um);
  if (info.kind == StackKind::corrected) {
    text += fmt::format("part         {} layers, {:.3f} mm high; {} slices added after its end\n",
                        info.target_layers, info.target_layers * g.layer_um * 1e-3,
                        g.layers - info.target_layers);
  }
  if (info.printer) text += fmt::format("printer      {}\n", info.printer->name);
  if (info.resin) {
    text += fmt::format("resin        {}, {:g} um base 10, aimed at {}\n", info.resin->name,
                        info.resin->absorbance_height10_um, dose_in_words(*info.resin));
  }
  const bool layerwise = info.process && info.process->mode == ExposureMode::layerwise;
  if (layerwise) {
    text += fmt::format("process      layer by layer, {}\n", exposures(*info.process));
  } else if (info.process) {
    text += fmt::format(
        "process      continuous, {:g} mm/h, dose cap {}\n", info.process->speed_mm_h,
        info.process->omega_max >= 1e300 ? "none" : fmt::format("{:g}", info.process->omega_max));
    if (info.process->ramp == Ramp::lamp_follows) {
      text += fmt::format("ramps        over {:g} mm at both ends, the lamp follows the speed\n",
                          info.process->ramp_mm);
    } else if (info.process->ramp == Ramp::outside) {
      text += "ramps        outside of the lit slices\n";
    }
  }
  if (info.process) {
    if (const std::string uv = uv_in_words(info.process->uv); !uv.empty()) {
      text += "UV light     " + uv + "\n";
    }
  }
  if (const double time = print_time_s(info); time > 0) {
    text += fmt::format(
        "print time   {:.0f} min {:02.0f} s{}\n", std::floor(time / 60), std::fmod(time, 60.0),
        layerwise ? " of light; lifts come on top, the stack does not know them" : "");
  }
  if (info.part_volume_mm3 > 0) {
    text += fmt::format("resin volume {:.4f} ml\n", info.part_volume_mm3 * 1e-3);
  }
  if (!info.program.empty()) text += fmt::format("made by      {}\n", info.program);
  return text;
}

std::string info_json(const StackInfo& info, const std::string& path) {
  using nlohmann::ordered_json;
  const Grid& g = info.grid;
  ordered_json j;
  j["file"] = path;
  j["kind"] = kind_name(info.kind);
  j["layers"] = g.layers;
  j["layer_um"] = g.layer_um;
  j["width_px"] = g.width_px;
  j["height_px"] = g.height_px;
  j["pixel_um"] = {g.pixel_x_um, g.pixel_y_um};
  j["height_mm"] = g.layers * g.layer_um * 1e-3;
  if (info.target_layers > 0) j["target_layers"] = info.target_layers;
  if (info.printer) j["printer"] = info.printer->name;
  if (info.resin) {
    j["resin"] = info.resin->name;
    j["absorbance_height10_um"] = info.resin->absorbance_height10_um;
    j["critical_dose_mj_cm3"] = info.resin->critical_dose_mj_cm3;
    if (info.resin->critical_dose_prime > 0) {
      j["critical_dose_prime"] = info.resin->critical_dose_prime;
    }
    if (info.resin->gel_dose_mj_cm3 > 0) j["gel_dose_mj_cm3"] = info.resin->gel_dose_mj_cm3;
  }
  if (info.process) {
    if (info.process->mode == ExposureMode::layerwise) {
      j["mode"] = "layerwise";
      j["exposure_s"] = info.process->exposure_s;
      j["bottom_exposure_s"] = layer_exposure_s(*info.process, 0);
      j["bottom_layers"] = info.process->bottom_layers;
      j["fade_layers"] = info.process->fade_layers;
    } else {
      j["mode"] = "continuous";
      j["speed_mm_h"] = info.process->speed_mm_h;
    }
    if (info.process->omega_max >= 1e300) {
      j["omega_max"] = "inf";
    } else {
      j["omega_max"] = info.process->omega_max;
    }
    const UvSchedule& uv = info.process->uv;
    if (uv.kind != UvKind::off) {
      j["uv"] = {{"uv_mw_cm2", uv.uv_mw_cm2},
                 {"dead_zone_um", uv.dead_zone_um},
                 {"schedule", uv.kind == UvKind::constant    ? "constant"
                              : uv.kind == UvKind::per_slice ? "per-slice"
                                                             : "patterned"}};
    }
    j["one_slice_gaps"] = info.process->one_slice_gaps == OneSliceGaps::merge ? "merge" : "open";
    j["platform_features"] = info.process->cap_platform_features ? "capped" : "uncapped";
  }
  const double time = print_time_s(info);
  j["print_time_s"] = time > 0 ? ordered_json(time) : ordered_json();
  j["resin_volume_ml"] =
      info.part_volume_mm3 > 0 ? ordered_json(info.part_volume_mm3 * 1e-3) : ordered_json();
  if (!info.program.empty()) j["program"] = info.program;
  return j.dump(2);
}

}  // namespace slicecorr::cli
