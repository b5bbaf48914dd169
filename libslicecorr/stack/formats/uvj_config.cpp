// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/formats/uvj_config.hpp"

#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "slicecorr/light_spreads.hpp"
#include "slicecorr/light_unit.hpp"
#include "stack/block_check.hpp"
#include "stack/formats/definition_json.hpp"
#include "stack/formats/even_light_json.hpp"
#include "stack/formats/format_times.hpp"
#include "stack/isa_l.hpp"
#include "stack/recording_entry.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr::detail {
namespace {

using OrderedJson = nlohmann::ordered_json;

std::string dump(const OrderedJson& json, int indent) {
  return json.dump(indent, ' ', false, OrderedJson::error_handler_t::replace);
}

/// An exposure, and what the platform does after it where the archive that the slices are of said that: a
/// way up and one back, each at the mean speed of its stages; waits are in the time without light. Elsewhere
/// there are no lifts, in continuous mode, or they are the printer's own.
OrderedJson exposure_json(double light_on_s, int pwm = 255, const LiftMotion& lift = {}) {
  LiftMotion moves = lift;
  moves.before_lift_s = moves.after_lift_s = moves.before_light_s = moves.light_off_s =
      moves.tilt_s = moves.acceleration_mm_s2 = 0;
  const double up_mm = lift.up_mm + lift.up_2_mm;
  // The whole way back: UVJ has no layer's height in it.
  const DarkTime moving = dark_time(moves, 0), all = dark_time(lift, 0);
  const bool waits = all.all_s() > moving.all_s() * (1 + 1e-9);
  const auto per_min = [&](double seconds) { return seconds > 0 ? 60 * up_mm / seconds : 0.0; };
  if (!(up_mm > 0)) {
    return {{"LightOnTime", light_on_s}, {"LightOffTime", 0}, {"LightPWM", pwm},
            {"LiftHeight", 0},           {"LiftSpeed", 0},    {"RetractHeight", 0},
            {"RetractSpeed", 0}};
  }
  return {{"LightOnTime", light_on_s},
          {"LightOffTime", waits ? all.all_s() : 0.0},
          {"LightPWM", pwm},
          {"LiftHeight", up_mm},
          {"LiftSpeed", per_min(moving.lift_s)},
          {"RetractHeight", up_mm},
          {"RetractSpeed", per_min(moving.return_s)}};
}

/// Nothing where no archive said it.
LiftMotion lift_of(const StackInfo& info, int layer) {
  return info.lift_times && info.lift_times->by_archive ? info.lift_times->of(layer) : LiftMotion{};
}

int pwm_of(const SliceLight& light) { return static_cast<int>(std::lround(255 * light.share)); }

OrderedJson properties_json(const StackInfo& info, double light_on_s, double bottom_s,
                            int bottom_layers) {
  const Grid& grid = info.grid;
  const auto pwm = [&](int layer) { return pwm_of({1, share_of_layer(info, layer)}); };
  OrderedJson properties;
  properties["Size"] = {{"X", grid.width_px},
                        {"Y", grid.height_px},
                        {"Millimeter",
                         {{"X", mm_of_um(grid.width_px * grid.pixel_x_um)},
                          {"Y", mm_of_um(grid.height_px * grid.pixel_y_um)}}},
                        {"Layers", grid.layers},
                        {"LayerHeight", mm_of_um(grid.layer_um)}};
  properties["Exposure"] =
      exposure_json(light_on_s, pwm(grid.layers - 1), lift_of(info, grid.layers - 1));
  properties["Bottom"] = exposure_json(bottom_s, pwm(0), lift_of(info, 0));
  properties["Bottom"]["Count"] = bottom_layers;
  properties["AntiAliasLevel"] = 1;
  return properties;
}

/// What the version of our block must be for these parameters: 1 has those of the correction alone.
int block_format(const Process& p) {
  Process plain;
  for (const Setting& s : settings()) {
    if (s.block == BlockPart::correction) copy_setting(s, p, plain);
  }
  return p == plain ? 1 : 2;
}

int block_format(const StackInfo& info) {
  const bool shows_light = info.kind == StackKind::corrected || info.kind == StackKind::recorded;
  const bool bath =
      info.printer && (info.printer->resin_depth_um > 0 || info.printer->platform_reflectance > 0);
  const bool spreads = info.printer && info.resin && info.process &&
                       light_spreads(*info.printer, *info.resin, *info.process);
  const bool relative =
      (info.printer && is_relative(*info.printer)) || (info.resin && is_relative(*info.resin));
  // Older programs would take such parts for as large as they print.
  if (info.made_for.any() || (info.resin && info.resin->shrinkage.any())) return 15;
  // Older programs would take such a lamp to do what is asked of it.
  if (info.process && !info.process->uv_lamp_share.empty()) return 14;
  // Older programs would take such light for steady, and for even.
  if (info.printer && (info.printer->grey == GreyLight::pulsed || info.printer->uv_flat_field)) {
    return 13;
  }
  if (info.process && !info.process->lamp_share.empty()) return 13;
  if (relative) return 12;
  if (info.process &&
      (!info.process->light_share.empty() || !info.process->layer_heights_um.empty()))
    return 11;
  if (shows_light && info.resin && info.resin->bleaches()) return 10;
  if (shows_light && info.process && slices_differ(*info.process)) return 9;
  if (shows_light && info.process && !info.process->slice_speed_mm_h.empty()) return 8;
  if (info.process && info.process->even_dead_zone != EvenDeadZone::off) return 7;
  if (shows_light && (bath || spreads)) return 6;
  if (info.has_edge_heights) return 5;
  if (info.kind == StackKind::recorded) return 4;
  if (info.printer && info.printer->flat_field) return 3;
  return info.process ? block_format(*info.process) : 1;
}

void add_settings(OrderedJson& json, const Process& p, BlockPart part) {
  static const Process unset;
  for (const Setting& s : settings()) {
    if (s.block != part || (s.changed_only && same_setting(s, p, unset))) continue;
    OrderedJson& json_value = json[block_key(s)];
    std::visit(
        [&](const auto& value) {
          using Value = std::decay_t<decltype(value)>;
          if constexpr (std::is_same_v<Value, std::string_view>) {
            json_value = block_word(value);
          } else if constexpr (std::is_same_v<Value, std::span<const double>>) {
            json_value = std::vector<double>(value.begin(), value.end());
          } else if constexpr (!std::is_same_v<Value, std::monostate>) {
            json_value = value;
          }
        },
        setting_value(s, p));
  }
}

OrderedJson process_json(const Process& p, int format) {
  OrderedJson json;
  add_settings(json, p, BlockPart::correction);
  if (format == 1) return json;
  add_settings(json, p, BlockPart::exposure);
  json["uv"] = {{"kind", kNamesOfUv[static_cast<std::size_t>(p.uv.kind)]},
                {"uv_mw_cm2", p.uv.uv_mw_cm2},
                {"dead_zone_um", p.uv.dead_zone_um},
                {"slice_mw_cm2", p.uv.slice_mw_cm2}};
  add_settings(json, p, BlockPart::stage);
  if (p.even_dead_zone != EvenDeadZone::off) json["even_dead_zone"] = name_of(p.even_dead_zone);
  if (p.even_light) json["even_light"] = even_light_json(*p.even_light);
  return json;
}

OrderedJson recording_json(const Recording& recording) {
  return {{"file", kRecordingEntry},
          {"slices", recording.slices()},
          {"parts", recording.showings.size()},
          {"crc32", recording_crc32(recording_csv(recording))},
          {"other_uv_images", recording.other_uv_images}};
}

OrderedJson block_json(const StackInfo& info, const ImageChecksums& checksums) {
  OrderedJson block;
  const int format = block_format(info);
  block["format"] = format;
  block["kind"] = info.kind == StackKind::corrected  ? "corrected"
                  : info.kind == StackKind::recorded ? "recorded"
                  : info.kind == StackKind::target   ? "target"
                                                     : "foreign";
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
  if (info.machine_height_mm > 0 &&
      !(info.printer && info.printer->travel_mm == info.machine_height_mm)) {
    block["machine_height_mm"] = info.machine_height_mm;
  }
  if (info.resin) block["resin"] = resin_json(*info.resin);
  if (info.process) block["process"] = process_json(*info.process, format);
  if (info.for_display) {
    block["frame"] = {{"images", "display"}};
    if (info.orientation_known) block["frame"]["orientation"] = orientation_json(info.orientation);
  }
  if (info.made_for.any()) block["made_for"] = own_json<OrderedJson>(info.made_for.to_json());
  if (!info.original_sha256.empty()) block["original_sha256"] = info.original_sha256;
  if (info.recording) block["recording"] = recording_json(*info.recording);
  // Slices of other programs get no checksums.
  if (info.kind != StackKind::foreign) block["images_crc32"] = checksums.slices;
  if (checksums.uv) block["uv_images_crc32"] = *checksums.uv;
  if (checksums.edges) block["edge_images_crc32"] = *checksums.edges;
  return block;
}

OrderedJson checked(OrderedJson block) {
  // Of what is read: texts that are no UTF-8 change when they are written.
  block[kBlockCrc32Key] = block_crc32(own_json(dump(block, -1)));
  return block;
}

}  // namespace

std::string uv_image_name(int slice) {
  char text[40];
  std::snprintf(text, sizeof text, "uv/%08d.png", slice);
  return text;
}

std::string edge_image_name(int node) {
  char text[50];
  std::snprintf(text, sizeof text, "slicecorr/surface/%08d.png", node);
  return text;
}

std::string write_uvj_config(const StackInfo& info, const ImageChecksums& checksums) {
  const ExposureSummary s = head_summary(info);
  std::string text = "{\n\"Properties\": " +
                     dump(properties_json(info, s.normal_s, s.bottom_s, s.bottom_layers), 2);
  // One line per layer, joined as text: a tree of a million layers would fill the memory.
  text += ",\n\"Layers\": [";
  SliceLight shown{-1, -1};
  LiftMotion lifted;
  std::string exposure;
  const bool own_heights = has_own_heights(info);
  double z_um = 0;
  for (int n = 0; n < info.grid.layers; ++n) {
    const SliceLight light = light_of_layer(info, n);
    const LiftMotion lift = lift_of(info, n);
    if (light.time_s != shown.time_s || light.share != shown.share || lift != lifted) {
      exposure =
          ", \"Exposure\": " + dump(exposure_json(light.time_s, pwm_of(light), lift), -1) + "}";
      shown = light;
      lifted = lift;
    }
    text += n == 0 ? "\n" : ",\n";
    z_um = own_heights ? z_um + layer_height_um(info, n) : (n + 1) * info.grid.layer_um;
    text += "{\"Z\": " + dump(mm_of_um(z_um), -1) + exposure;
  }
  text += "\n]";
  if (info.kind != StackKind::foreign) {
    text += ",\n\"slicecorr\": " + write_provenance(info, checksums);
  }
  return text + "\n}\n";
}

std::string change_uvj_config(const std::string& original, const StackInfo& info,
                              const ImageChecksums& checksums, bool exposure_changes,
                              bool light_changes) {
  std::string_view text = original;
  if (text.starts_with("\xef\xbb\xbf")) text.remove_prefix(3);
  OrderedJson json = read_json<OrderedJson>(text, {"config.json", ""}, kManyLayers);
  const ExposureSummary s = head_summary(info);
  OrderedJson& properties = json["Properties"];
  properties["Size"]["Layers"] = info.grid.layers;
  if (exposure_changes) {
    properties["Exposure"]["LightOnTime"] = s.normal_s;
    if (properties.contains("Bottom") || s.bottom_layers > 0) {
      properties["Bottom"]["LightOnTime"] = s.bottom_s;
      properties["Bottom"]["Count"] = s.bottom_layers;
    }
  }
  const auto count = static_cast<std::size_t>(info.grid.layers);
  const bool lists = json.contains("Layers") && !json["Layers"].empty();
  if (light_changes) {
    properties["Exposure"]["LightPWM"] = pwm_of(light_of_layer(info, info.grid.layers - 1));
    if (properties.contains("Bottom")) {
      properties["Bottom"]["LightPWM"] = pwm_of(light_of_layer(info, 0));
    }
  }
  if (lists || (exposure_changes && (s.uneven || s.fade_layers > 0)) ||
      (light_changes && light_differs(process_of_times(info)))) {
    OrderedJson& layers = json["Layers"];
    if (!lists) layers = OrderedJson::array();
    const std::size_t before = layers.size();
    for (std::size_t n = layers.size(); n < count; ++n) {
      layers.push_back(n > 0 ? layers[n - 1] : OrderedJson{{"Exposure", exposure_json(0)}});
      layers[n]["Z"] = mm_of_um(stack_height_um(info, static_cast<int>(n) + 1));
    }
    // A list that says the light of some layers alone says none.
    bool dims = light_changes;
    for (std::size_t n = 0; n < count; ++n) {
      dims = dims || light_of_layer(info, static_cast<int>(n)).share != 1;
    }
    for (std::size_t n = exposure_changes || light_changes ? 0 : before; n < count; ++n) {
      const SliceLight light = light_of_layer(info, static_cast<int>(n));
      layers[n]["Exposure"]["LightOnTime"] = light.time_s;
      if (dims) layers[n]["Exposure"]["LightPWM"] = pwm_of(light);
    }
  }
  json.erase("slicecorr");
  if (info.kind != StackKind::foreign) {
    json["slicecorr"] = checked(block_json(info, checksums));
  }
  return dump(json, 2) + "\n";
}

std::string write_provenance(const StackInfo& info, const ImageChecksums& checksums) {
  return dump(checked(block_json(info, checksums)), 2);
}

std::string setup_block(const StackInfo& info) { return dump(block_json(info, {}), 2); }

std::uint32_t images_crc32(const std::vector<std::uint32_t>& slice_adlers) {
  std::uint32_t crc = 0;
  for (const std::uint32_t adler : slice_adlers) {
    const std::uint8_t bytes[4] = {
        static_cast<std::uint8_t>(adler >> 24), static_cast<std::uint8_t>(adler >> 16),
        static_cast<std::uint8_t>(adler >> 8), static_cast<std::uint8_t>(adler)};
    crc = isal::crc32(crc, bytes, sizeof bytes);
  }
  return crc;
}

}  // namespace slicecorr::detail
