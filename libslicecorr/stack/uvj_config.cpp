#include "stack/uvj_config.hpp"

#include <isa-l.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "slicecorr/units.hpp"

namespace slicecorr::detail {
namespace {

using Json = nlohmann::ordered_json;

/// Without the noise of the last digits, which would only make the text longer.
double tidy_mm(double mm) { return std::round(mm * 1e9) / 1e9; }

/// No limit and no lift: the continuous mode pulls without a pause, and lifts between exposures are
/// the printer's.
Json exposure_json(double light_on_s, int pwm = 255) {
  return {{"LightOnTime", light_on_s}, {"LightOffTime", 0}, {"LightPWM", pwm},
          {"LiftHeight", 0},           {"LiftSpeed", 0},    {"RetractHeight", 0},
          {"RetractSpeed", 0}};
}

Json properties_json(const StackInfo& info, double light_on_s, double bottom_s, int bottom_layers) {
  const Grid& grid = info.grid;
  Json properties;
  properties["Size"] = {{"X", grid.width_px},
                        {"Y", grid.height_px},
                        {"Millimeter",
                         {{"X", tidy_mm(grid.width_px * grid.pixel_x_um / 1000)},
                          {"Y", tidy_mm(grid.height_px * grid.pixel_y_um / 1000)}}},
                        {"Layers", grid.layers},
                        {"LayerHeight", tidy_mm(grid.layer_um / 1000)}};
  properties["Exposure"] = exposure_json(light_on_s);
  properties["Bottom"] = exposure_json(bottom_s);
  properties["Bottom"]["Count"] = bottom_layers;
  properties["AntiAliasLevel"] = 1;
  return properties;
}

Json calibration_json(const std::vector<CalibrationPoint>& calibration) {
  Json points = Json::array();
  for (const CalibrationPoint& c : calibration) {
    points.push_back({{"level", c.level}, {"intensity_mw_cm2", c.intensity_mw_cm2}});
  }
  return points;
}

Json printer_json(const Printer& p) {
  Json json = {{"name", p.name},
               {"width_px", p.width_px},
               {"height_px", p.height_px},
               {"pixel_x_um", p.pixel_x_um},
               {"pixel_y_um", p.pixel_y_um},
               {"bit_depth", p.bit_depth},
               {"wavelength_nm", p.wavelength_nm},
               {"calibration", calibration_json(p.calibration)},
               {"max_speed_mm_h", p.max_speed_mm_h},
               {"travel_mm", p.travel_mm}};
  if (p.uv) {
    json["uv"] = {{"wavelength_nm", p.uv->wavelength_nm},
                  {"kind", p.uv->patterned ? "patterned" : "flood"},
                  {"calibration", calibration_json(p.uv->calibration)}};
  }
  return json;
}

Json resin_json(const Resin& r) {
  Json json = {{"name", r.name},
               {"model", r.model == CureModelKind::kinetic ? "kinetic" : "jacobs"},
               {"m", r.m},
               {"absorbance_height10_um", r.absorbance_height10_um},
               {"critical_dose_mj_cm3", r.critical_dose_mj_cm3},
               {"critical_dose_prime", r.critical_dose_prime},
               {"gel_dose_mj_cm3", r.gel_dose_mj_cm3},
               {"dose_factor", r.dose_factor}};
  if (r.inhibition) {
    json["inhibition"] = {{"beta", r.inhibition->beta},
                          {"absorbance_height10_um", r.inhibition->absorbance_height10_um},
                          {"m", r.inhibition->m},
                          {"critical_dose_prime", r.inhibition->critical_dose_prime}};
  }
  return json;
}

/// What the version of our block must be for these parameters.
int block_format(const Process& p) {
  Process plain;
  plain.speed_mm_h = p.speed_mm_h;
  plain.omega_max = p.omega_max;
  plain.one_slice_gaps = p.one_slice_gaps;
  plain.cap_platform_features = p.cap_platform_features;
  return p == plain ? 1 : 2;
}

Json process_json(const Process& p) {
  Json json;
  json["speed_mm_h"] = p.speed_mm_h;
  if (p.omega_max >= 1e300) {
    json["omega_max"] = "inf";
  } else {
    json["omega_max"] = p.omega_max;
  }
  json["one_slice_gaps"] = p.one_slice_gaps == OneSliceGaps::merge ? "merge" : "open";
  json["platform_features"] = p.cap_platform_features ? "capped" : "uncapped";
  if (block_format(p) == 1) return json;
  json["exposure_s"] = p.exposure_s;
  json["bottom_exposure_s"] = p.bottom_exposure_s;
  json["bottom_layers"] = p.bottom_layers;
  json["fade_layers"] = p.fade_layers;
  json["layer_exposure_s"] = p.layer_exposure_s;
  json["uv"] = {{"kind", names_of_uv[static_cast<std::size_t>(p.uv.kind)]},
                {"uv_mw_cm2", p.uv.uv_mw_cm2},
                {"dead_zone_um", p.uv.dead_zone_um},
                {"slice_mw_cm2", p.uv.slice_mw_cm2}};
  json["ramp"] = names_of_ramps[static_cast<std::size_t>(p.ramp)];
  json["ramp_mm"] = p.ramp_mm;
  json["window_cure"] = p.allow_window_cure ? "allow" : "refuse";
  return json;
}

Json block_json(const StackInfo& info, std::uint32_t crc, std::optional<std::uint32_t> uv_crc) {
  Json block;
  block["format"] = info.process ? block_format(*info.process) : 1;
  block["kind"] = info.kind == StackKind::corrected ? "corrected" : "target";
  const bool layerwise = info.process && info.process->mode == ExposureMode::layerwise;
  block["mode"] = layerwise ? "layerwise" : "continuous";
  block["program"] = info.program;
  block["target_layers"] = info.target_layers;
  block["part_volume_mm3"] = info.part_volume_mm3;
  // The sizes in mm above went through a division; these are exact.
  block["grid"] = {{"pixel_x_um", info.grid.pixel_x_um},
                   {"pixel_y_um", info.grid.pixel_y_um},
                   {"layer_um", info.grid.layer_um}};
  if (info.printer) block["printer"] = printer_json(*info.printer);
  if (info.resin) block["resin"] = resin_json(*info.resin);
  if (info.process) block["process"] = process_json(*info.process);
  block["images_crc32"] = crc;
  if (uv_crc) block["uv_images_crc32"] = *uv_crc;
  return block;
}

std::string dump(const Json& json, int indent) {
  return json.dump(indent, ' ', false, Json::error_handler_t::replace);
}

}  // namespace

std::string write_uvj_config(const StackInfo& info, std::uint32_t images_crc32,
                             std::optional<std::uint32_t> uv_images_crc32) {
  const bool corrected = info.kind == StackKind::corrected && info.process.has_value();
  double light_on_s = info.exposure_s, bottom_s = info.exposure_s;
  int bottom_layers = 0;
  if (corrected && info.process->mode == ExposureMode::continuous) {
    light_on_s = bottom_s = units::slice_time_s(info.grid.layer_um, info.process->speed_mm_h);
  } else if (corrected) {
    light_on_s = info.process->exposure_s;
    bottom_s = layer_exposure_s(*info.process, 0);
    bottom_layers = info.process->layer_exposure_s.empty() ? info.process->bottom_layers : 0;
  } else if (info.bottom_exposure_s > 0) {
    bottom_s = info.bottom_exposure_s;
    bottom_layers = info.bottom_layers;
  }
  const auto exposure_of = [&](int n) {
    if (corrected) {
      const double m = info.resin ? info.resin->m : 1.0;
      return slice_light(*info.process, m, info.grid.layer_um, n, info.grid.layers);
    }
    const auto layer = static_cast<std::size_t>(n);
    if (layer < info.layer_exposure_s.size()) return SliceLight{info.layer_exposure_s[layer], 1.0};
    return SliceLight{n < bottom_layers ? bottom_s : light_on_s, 1.0};
  };
  std::string text =
      "{\n\"Properties\": " + dump(properties_json(info, light_on_s, bottom_s, bottom_layers), 2);
  // One line per layer, joined as text: a tree of a million layers would fill the memory.
  text += ",\n\"Layers\": [";
  SliceLight shown{-1, -1};
  std::string exposure;
  for (int n = 0; n < info.grid.layers; ++n) {
    const SliceLight light = exposure_of(n);
    if (light.time_s != shown.time_s || light.share != shown.share) {
      const int pwm = static_cast<int>(std::lround(255 * light.share));
      exposure = ", \"Exposure\": " + dump(exposure_json(light.time_s, pwm), -1) + "}";
      shown = light;
    }
    text += n == 0 ? "\n" : ",\n";
    text += "{\"Z\": " + dump(tidy_mm((n + 1) * info.grid.layer_um / 1000), -1) + exposure;
  }
  text += "\n]";
  if (info.kind != StackKind::foreign) {
    text += ",\n\"slicecorr\": " + dump(block_json(info, images_crc32, uv_images_crc32), 2);
  }
  return text + "\n}\n";
}

std::uint32_t images_crc32(const std::vector<std::uint32_t>& slice_adlers) {
  std::uint32_t crc = 0;
  for (const std::uint32_t adler : slice_adlers) {
    const std::uint8_t bytes[4] = {
        static_cast<std::uint8_t>(adler >> 24), static_cast<std::uint8_t>(adler >> 16),
        static_cast<std::uint8_t>(adler >> 8), static_cast<std::uint8_t>(adler)};
    crc = crc32_gzip_refl(crc, bytes, sizeof bytes);
  }
  return crc;
}

}  // namespace slicecorr::detail
