// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "options.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>

#include "programs/common/program.hpp"
#include "slicecorr/assumed_light.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/print_file.hpp"
#include "slicecorr/same_light.hpp"
#include "slicecorr/settings.hpp"
#include "slicecorr/units.hpp"
#include "support/json/read_json.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::cli {

namespace {
const char* kind_name(StackKind kind) {
  switch (kind) {
    case StackKind::target:
      return "target";
    case StackKind::corrected:
      return "corrected";
    case StackKind::recorded:
      return "recorded";
    default:
      return "foreign";
  }
}

/// What a recording says of all its slices.
struct RecordingFigures {
  int lit_slices = 0;
  std::size_t most_images = 0;
  double least_light = 0, greatest_light = 0;  ///< of slices with light
  double least_um_s = 0, greatest_um_s = 0, least_uv = 0, greatest_uv = 0;  ///< of lit parts
};

RecordingFigures figures_of(const StackInfo& info) {
  RecordingFigures f;
  const auto widen = [](double value, bool first, double& least, double& greatest) {
    least = first ? value : std::min(least, value);
    greatest = first ? value : std::max(greatest, value);
  };
  bool first = true;
  for (int n = 0; n < info.recording->slices(); ++n) {
    double light = 0;
    std::vector<int> images;
    for (const Recording::Showing& p : info.recording->of(n)) {
      if (!(p.light > 0)) continue;
      light += p.light;
      images.push_back(p.image);
      widen(p.speed_um_s, first, f.least_um_s, f.greatest_um_s);
      widen(p.uv_mw_cm2, first, f.least_uv, f.greatest_uv);
      first = false;
    }
    if (images.empty()) continue;
    std::sort(images.begin(), images.end());
    const auto different = std::unique(images.begin(), images.end()) - images.begin();
    f.most_images = std::max(f.most_images, static_cast<std::size_t>(different));
    widen(light, f.lit_slices == 0, f.least_light, f.greatest_light);
    ++f.lit_slices;
  }
  return f;
}

std::string describe_recording(const StackInfo& info) {
  const RecordingFigures f = figures_of(info);
  std::string text = fmt::format("part         {} layers, {:.3f} mm high\n", info.target_layers,
                                 info.target_layers * info.grid.layer_um * 1e-3);
  text += fmt::format("shown        {} images; {} slices with light, of {} images at most\n",
                      info.grid.layers, f.lit_slices, f.most_images);
  if (f.lit_slices > 0) {
    text += fmt::format("light        {:.4g} to {:.4g} of that of the plan\n", f.least_light,
                        f.greatest_light);
    text += fmt::format("speed        {:.4g} to {:.4g} um/s while lit\n", f.least_um_s,
                        f.greatest_um_s);
    if (f.greatest_uv > 0) {
      text += fmt::format("UV measured  {:.4g} to {:.4g} mW/cm²\n", f.least_uv, f.greatest_uv);
    }
  }
  if (!info.recording->other_uv_images.empty()) {
    text += fmt::format("UV images    {} were others than those of their slices\n",
                        info.recording->other_uv_images.size());
  }
  return text;
}

/// Height of each layer, um; empty where all are alike.
std::vector<double> heights_of(const StackInfo& info, int layers) {
  std::vector<double> heights;
  bool differ = false;
  for (int n = 0; n < layers; ++n) {
    heights.push_back(layer_height_um(info, n));
    differ = differ || heights.back() != info.grid.layer_um;
  }
  if (!differ) heights.clear();
  return heights;
}
}  // namespace

std::string describe_stack(const StackInfo& info, const LayerAreas* areas) {
  const Grid& g = info.grid;
  const auto or_not_said = [](double um, const std::string& text) {
    return um > 0 ? text : std::string("not said");
  };
  std::string text = fmt::format("kind         {}, format {}\n", kind_name(info.kind), info.format);
  const int slices = info.recording ? info.recording->slices() : g.layers;
  const std::vector<double> heights = heights_of(info, slices);
  const auto [least, most] = std::minmax_element(heights.begin(), heights.end());
  text += fmt::format(
      "slices       {} of {}\n", slices,
      or_not_said(g.layer_um,
                  fmt::format("{} um, {:.3f} mm in all",
                              heights.empty() ? fmt::format("{:g}", g.layer_um)
                                              : fmt::format("{:g} to {:g}", *least, *most),
                              stack_height_um(info, slices) * 1e-3)));
  text += fmt::format(
      "images       {} x {} pixels of {}\n", g.width_px, g.height_px,
      or_not_said(g.pixel_x_um, fmt::format("{:g} x {:g} um", g.pixel_x_um, g.pixel_y_um)));
  if (info.orientation != Orientation{}) {
    text += "orientation  " + in_words(info.orientation) + "\n";
  }
  const ArchiveProfiles& names = info.profiles;
  for (const auto& [what, name] :
       {std::pair{"printer", &names.printer}, std::pair{"material", &names.material},
        std::pair{"print", &names.print}}) {
    if (!name->empty()) text += fmt::format("profile      {}: {}\n", what, text::printable(*name));
  }
  if (info.kind == StackKind::corrected) {
    text += fmt::format("part         {} layers, {:.3f} mm high; {} slices added after its end\n",
                        info.target_layers, stack_height_um(info, info.target_layers) * 1e-3,
                        g.layers - info.target_layers);
  }
  if (info.recording) text += describe_recording(info);
  if (info.printer) text += fmt::format("printer      {}\n", text::printable(info.printer->name));
  if (info.printer && info.printer->flat_field) {
    text += fmt::format("light        {}, over the display\n", light_in_words(*info.printer));
  }
  if (info.printer && info.printer->distortion) {
    text += fmt::format("distortion   {}\n", distortion_in_words(*info.printer));
  }
  if (info.printer && !info.printer->spread.none()) {
    text += fmt::format("spread       {}\n", spread_in_words(info.printer->spread));
  }
  if (info.resin && info.resin->scatter_um2_per_um > 0) {
    text += fmt::format("scatter      {:g} um²/um\n", info.resin->scatter_um2_per_um);
  }
  if (info.printer && info.printer->resin_depth_um > 0) {
    text += fmt::format("bath         {:g} um of resin\n", info.printer->resin_depth_um);
  }
  if (info.printer && info.printer->platform_reflectance > 0) {
    text += fmt::format("platform     sends back {:.4g} % of the light\n",
                        100 * info.printer->platform_reflectance);
  }
  if (info.resin) {
    text += fmt::format("resin        {}, {:g} um base 10, aimed at {}\n",
                        text::printable(info.resin->name), info.resin->absorbance_height10_um,
                        dose_in_words(*info.resin));
  }
  if (info.resin && info.resin->shrinkage.any()) {
    text += fmt::format("shrinkage    {}\n", shrinkage_in_words(info.resin->shrinkage));
  }
  if (info.made_for.any()) {
    text += fmt::format("made for     a resin that {}\n", shrinkage_in_words(info.made_for));
  }
  if (info.printer && info.resin) {
    const bool uv = info.process && info.process->uv.kind != UvKind::off;
    for (const std::string& sentence : light_notices(*info.printer, *info.resin, uv)) {
      text += "light        " + text::printable(sentence) + "\n";
    }
  }
  if (info.printer && info.resin && info.process) {
    const std::string words = assumption_in_words(*info.printer, *info.resin, *info.process);
    if (!words.empty()) text += "light        " + text::printable(words) + "\n";
  }
  const bool layerwise = info.process && info.process->mode == ExposureMode::layerwise;
  if (layerwise) {
    text += fmt::format("process      layer by layer, {}\n", exposures_in_words(*info.process));
  } else if (info.process) {
    text += fmt::format(
        "process      continuous, {}, dose cap {}\n", speeds_in_words(*info.process),
        info.process->omega_max >= kNoCap ? "none" : fmt::format("{:g}", info.process->omega_max));
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
    if (info.process->even_light) {
      text += fmt::format("dead zone    even although resin flows, {:.4g} um ({})\n",
                          info.process->even_light->gap_um, name_of(info.process->even_dead_zone));
    }
  }
  if (!info.process && info.exposure_s > 0) {
    text += "exposure     " + exposures_in_words(process_of_times(info)) + "\n";
  }
  if (const std::string light = light_share_in_words(process_of_times(info)); !light.empty()) {
    text += "lit with     " + light + "\n";
  }
  if (info.process && !info.process->lamp_share.empty()) {
    Process lamp;
    lamp.light_share = info.process->lamp_share;
    text += "lamp         " + light_share_in_words(lamp) + "\n";
  }
  if (info.process && !info.process->uv_lamp_share.empty()) {
    text += "UV lamp      gives " + shares_in_words(info.process->uv_lamp_share) +
            " of what is asked of it\n";
  }
  if (!info.exposures.empty()) {
    const auto spots = std::count_if(info.exposures.begin(), info.exposures.end(),
                                     [](const LayerExposure& e) { return e.spot; });
    text += fmt::format(
        "exposures    {} of {} layers, whose doses add up{}\n", info.exposures.size(), slices,
        spots > 0 ? fmt::format("; {} of a pixel or none, which stay as they are", spots) : "");
  }
  if (print_time(info).light_s > 0) {
    text += "print time   " + print_time_in_words(info) + "\n";
    if (!info.recording && process_of_times(info).mode == ExposureMode::layerwise) {
      text += "a layer      " +
              layer_time(process_of_times(info), lift_times_of(info), g.layer_um).in_words() + "\n";
    }
  }
  if (info.own_print_time_s > 0) {
    text += "              the archive itself says " +
            print_time_in_words({info.own_print_time_s, 0.0}) + "\n";
  }
  if (areas) text += areas->in_words();
  if (info.part_volume_mm3 > 0) {
    text += fmt::format("resin volume {:.4f} ml\n", info.part_volume_mm3 * 1e-3);
  }
  const bool corrected = info.kind == StackKind::corrected && info.process;
  if (info.kind == StackKind::target || corrected) {
    const bool mesh = corrected ? info.process->surface == Surface::mesh : info.has_edge_heights;
    text +=
        fmt::format("edges        {}\n", !mesh       ? "at the heights of the slices"
                                         : corrected ? "at the heights of the mesh"
                                                     : "at the heights of the mesh (edge heights)");
  }
  if (!info.program.empty())
    text += fmt::format("made by      {}\n", text::printable(info.program));
  if (info.kind != StackKind::foreign && !info.parameters_checked) {
    text += "checksum     of the images alone: nothing tells whether parameters were changed\n";
  }
  return text;
}

namespace {

/// A number where all layers get the same share of the light, else one for each.
nlohmann::ordered_json light_json(const StackInfo& info, int slices) {
  const Process p = process_of_times(info);
  if (!light_differs(p)) return usual_light_share(p);
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (int n = 0; n < slices; ++n) list.push_back(light_share(p, n));
  return list;
}

}  // namespace

std::string info_json(const StackInfo& info, const std::string& path, const LayerAreas* areas) {
  using nlohmann::ordered_json;
  const Grid& g = info.grid;
  ordered_json j;
  j["file"] = path;
  j["kind"] = kind_name(info.kind);
  j["format"] = info.format;
  const int slices = info.recording ? info.recording->slices() : g.layers;
  j["layers"] = slices;
  if (const std::vector<double> heights = heights_of(info, slices); heights.empty()) {
    j["layer_um"] = g.layer_um;
  } else {
    j["layer_um"] = heights;
  }
  j["light_share"] = light_json(info, slices);
  if (info.process && !info.process->lamp_share.empty()) {
    j["lamp_share"] = info.process->lamp_share;
  }
  if (info.process && !info.process->uv_lamp_share.empty()) {
    j["uv_lamp_share"] = info.process->uv_lamp_share;
  }
  if (!info.exposures.empty()) {
    auto& list = j["exposures"];
    for (const LayerExposure& e : info.exposures) {
      list.push_back({{"layer", e.layer},
                      {"time_s", e.time_s},
                      {"light_share", e.light_share},
                      {"spot", e.spot}});
    }
  }
  j["width_px"] = g.width_px;
  j["height_px"] = g.height_px;
  j["pixel_um"] = {g.pixel_x_um, g.pixel_y_um};
  j["height_mm"] = stack_height_um(info, slices) * 1e-3;
  j["orientation"] = {{"portrait", info.orientation.portrait},
                      {"mirror_x", info.orientation.mirror_x},
                      {"mirror_y", info.orientation.mirror_y}};
  j["profiles"] = {{"printer", info.profiles.printer},
                   {"material", info.profiles.material},
                   {"print", info.profiles.print}};
  if (info.recording) {
    const RecordingFigures f = figures_of(info);
    j["recording"] = {{"images", g.layers},
                      {"slices", slices},
                      {"parts", info.recording->showings.size()},
                      {"lit_slices", f.lit_slices},
                      {"most_images_in_a_slice", f.most_images},
                      {"light", {f.least_light, f.greatest_light}},
                      {"speed_um_s", {f.least_um_s, f.greatest_um_s}},
                      {"uv_mw_cm2", {f.least_uv, f.greatest_uv}},
                      {"other_uv_images", info.recording->other_uv_images}};
  }
  if (info.target_layers > 0) j["target_layers"] = info.target_layers;
  if (info.printer) j["printer"] = info.printer->name;
  if (info.printer && info.printer->flat_field) {
    const FlatField& f = *info.printer->flat_field;
    j["flat_field"] = {{"least", 1.0 * f.least() / f.reference},
                       {"greatest", 1.0 * f.greatest() / f.reference},
                       {"frame", f.of_plate ? "plate" : "image"}};
  }
  if (info.printer && info.printer->distortion) {
    const Distortion& d = *info.printer->distortion;
    const PitchRange pitch = pitch_range(d, *info.printer);
    j["distortion"] = {{"most_off_um", d.most_off_um},
                       {"rms_off_um", d.rms_off_um},
                       {"points", d.points},
                       {"rms_um", d.rms_um},
                       {"pitch_x_um", {pitch.least_x_um, pitch.greatest_x_um}},
                       {"pitch_y_um", {pitch.least_y_um, pitch.greatest_y_um}}};
  }
  if (info.printer && info.printer->resin_depth_um > 0) {
    j["resin_depth_um"] = info.printer->resin_depth_um;
  }
  if (info.printer && info.printer->platform_reflectance > 0) {
    j["platform_reflectance"] = info.printer->platform_reflectance;
  }
  const auto add_shrinkage = [&](const char* key, const Shrinkage& s) {
    if (s.any()) j[key] = slicecorr::detail::own_json<ordered_json>(s.to_json());
  };
  if (info.resin) add_shrinkage("shrinkage", info.resin->shrinkage);
  add_shrinkage("made_for", info.made_for);
  if (info.resin) {
    j["resin"] = info.resin->name;
    j["absorbance_height10_um"] = info.resin->absorbance_height10_um;
    // Of all light and doses, whatever their keys are called.
    j["unit"] = unit_in_files(info.resin->unit);
    if (info.resin->has_gel_time()) {
      j["gel_a_mj_cm2"] = info.resin->gel_a_mj_cm2;
      j["gel_b_sqrt_mw_cm2_s"] = info.resin->gel_b_sqrt_mw_cm2_s;
    } else {
      j["critical_dose_mj_cm3"] = info.resin->critical_dose_mj_cm3;
    }
    if (const auto& bleaching = info.resin->bleaching) {
      j["bleached_absorbance_height10_um"] = bleaching->absorbance_height10_um;
      j["bleaching_dose_mj_cm2"] = bleaching->dose_mj_cm2;
    }
    if (info.resin->critical_dose_prime > 0) {
      j["critical_dose_prime"] = info.resin->critical_dose_prime;
    }
    if (info.resin->gel_dose_mj_cm3 > 0) j["gel_dose_mj_cm3"] = info.resin->gel_dose_mj_cm3;
  }
  if (info.printer && info.printer->wavelength_nm > 0) {
    j["wavelength_nm"] = info.printer->wavelength_nm;
  }
  if (info.resin && info.resin->wavelength_nm > 0) {
    j["resin_wavelength_nm"] = info.resin->wavelength_nm;
  }
  if (info.printer && info.resin) {
    if (const auto other = other_wavelength(*info.printer, *info.resin)) {
      j["other_wavelength"] = {{"printer_nm", other->printer_nm}, {"resin_nm", other->resin_nm}};
    }
    if (const auto other = other_display(*info.printer, *info.resin)) {
      j["other_display"] =
          other->empty() ? nlohmann::ordered_json() : nlohmann::ordered_json(*other);
    }
  }
  if (info.process) {
    if (info.process->assumed != AssumedLight::none) j["assumed"] = name_of(info.process->assumed);
    if (info.process->mode == ExposureMode::layerwise) {
      j["mode"] = "layerwise";
      j["exposure_s"] = info.process->exposure_s;
      j["bottom_exposure_s"] = layer_exposure_s(*info.process, 0);
      j["bottom_layers"] = info.process->bottom_layers;
      j["fade_layers"] = info.process->fade_layers;
    } else {
      j["mode"] = "continuous";
      j["speed_mm_h"] = info.process->speed_mm_h;
      if (const auto& speeds = info.process->slice_speed_mm_h; !speeds.empty()) {
        j["slice_speed_mm_h"] = speeds;
        j["slice_lamps"] = info.process->slice_lamps == SliceLamps::stay ? "stay" : "follow";
      }
    }
    const UvSchedule& uv = info.process->uv;
    if (uv.kind != UvKind::off) {
      j["uv"] = {{"uv_mw_cm2", uv.uv_mw_cm2},
                 {"dead_zone_um", uv.dead_zone_um},
                 {"schedule", uv.kind == UvKind::constant    ? "constant"
                              : uv.kind == UvKind::per_slice ? "per-slice"
                                                             : "patterned"}};
    }
    if (info.process->even_dead_zone != EvenDeadZone::off) {
      j["even_dead_zone"] = name_of(info.process->even_dead_zone);
      if (info.process->even_light) j["gap_um"] = info.process->even_light->gap_um;
    }
    for (const Setting& s : settings()) {
      if (s.group != kHowItIsCorrected) continue;
      std::visit(
          [&](const auto& value) {
            using Value = std::decay_t<decltype(value)>;
            if constexpr (!std::is_same_v<Value, std::monostate>) j[std::string(s.name)] = value;
          },
          setting_value(s, *info.process));
    }
  }
  const PrintTime time = print_time(info);
  const bool lit = time.light_s > 0;
  const bool layerwise = process_of_times(info).mode == ExposureMode::layerwise;
  const auto seconds = [&](const std::optional<double>& s) {
    return lit && s ? ordered_json(*s) : ordered_json();
  };
  j["light_s"] = seconds(time.light_s);
  j["dark_s"] = seconds(time.dark_s);
  j["print_time_s"] = seconds(time.all_s());
  j["own_print_time_s"] =
      info.own_print_time_s > 0 ? ordered_json(info.own_print_time_s) : ordered_json();
  if (layerwise && lit && !info.recording) {
    j["layer_s"] = slicecorr::detail::own_json<ordered_json>(
        layer_time(process_of_times(info), lift_times_of(info), g.layer_um).to_json());
  }
  if (areas) j.update(slicecorr::detail::own_json<ordered_json>(areas->to_json()));
  j["resin_volume_ml"] =
      info.part_volume_mm3 > 0 ? ordered_json(info.part_volume_mm3 * 1e-3) : ordered_json();
  if (info.kind == StackKind::target) j["edge_heights"] = info.has_edge_heights;
  if (!info.program.empty()) j["program"] = info.program;
  if (info.kind != StackKind::foreign) j["parameters_checked"] = info.parameters_checked;
  for (const auto& [name, value] : print_file_facts(path)) j["archive"][name] = value;
  // Names come from archives, and need not be UTF-8.
  return j.dump(2, ' ', false, ordered_json::error_handler_t::replace);
}

}  // namespace slicecorr::cli
