// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Zip archives of Chitubox: 1.png, 2.png, ... and run.gcode, whose head has the settings as
// ";key:value" and whose body is what the printer runs.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "slicecorr/error.hpp"
#include "slicecorr/image_size.hpp"
#include "stack/formats/format_times.hpp"
#include "stack/formats/layer_gcode.hpp"
#include "stack/png/preview.hpp"

namespace slicecorr::detail {
namespace {

constexpr const char* kGcodeEntry = "run.gcode";
constexpr double kFullPower = 255;
constexpr const char* kCwsEntry = "slice.conf";  ///< such an archive has G-code of another kind

std::string file_text(const Container& archive) {
  return archive.text(kGcodeEntry, kMaxGcodeBytes);
}

KeyValueText head_of(const std::string& text, const std::string& path) {
  return {text.substr(0, end_of_head(text)), ':', path, kGcodeEntry, ";"};
}

/// The value under the key that is written today, else under the one that old versions wrote.
std::optional<double> number_of(const KeyValueText& head, const char* key, const char* old_key,
                                double most) {
  const auto value = head.number(key, 0, most);
  return value ? value : head.number(old_key, 0, most);
}

/// What the head says of lifts; nothing without ways and speeds.
void take_lifts_of(const KeyValueText& head, StackInfo& info) {
  const auto number = [&](const char* key) { return lift_number(head, key); };
  const auto motion = [&](const char* way, const char* speed, const char* off) {
    LiftMotion m;
    m.up_mm = number(way).value_or(0);
    m.up_mm_s = number(speed).value_or(0) / 60;
    m.back_mm_s = number("normalDropSpeed").value_or(0) / 60;
    m.light_off_s = number(off).value_or(0);
    return m;
  };
  if (!number("normalLayerLiftHeight") || !number("bottomLayerLiftHeight")) return;
  LiftTimes lifts;
  lifts.normal = motion("normalLayerLiftHeight", "normalLayerLiftSpeed", "lightOffTime");
  lifts.bottom = motion("bottomLayerLiftHeight", "bottomLayerLiftSpeed", "bottomLightOffTime");
  lifts.bottom_layers = info.bottom_layers;
  take_lifts(std::move(lifts), info);
}

void set_where_there(KeyValueText& head, const char* key, const std::string& value) {
  if (head.find(key)) head.set(key, value);
}

void change_chitubox(const ArchiveRequest& r, ContainerOutput& output) {
  const int layers = r.info.grid.layers;
  const int kept_layers = r.kept_contents->info.grid.layers;
  const std::string text = file_text(*r.kept);
  KeyValueText head = head_of(text, r.kept->path());
  const LayerGcode body(text.substr(end_of_head(text)), kChituboxGcode, r.kept->path(),
                        kGcodeEntry);
  const auto exposure_s = [&](int layer) -> std::optional<double> {
    if (!r.exposure_changes) return std::nullopt;
    return light_on_of_layer(r.info, layer);
  };
  refuse_other_light(r, kGcodeEntry);
  if (layers == kept_layers && (!r.exposure_changes || body.says(layers, exposure_s))) return;
  if (!body.shows(kept_layers)) {
    throw InputError(r.kept->path(), kGcodeEntry,
                     fmt::format("does not show images 1 to {} in this order, so that neither "
                                 "layers nor times can be changed",
                                 kept_layers));
  }
  if (layers != kept_layers) set_where_there(head, "totalLayer", std::to_string(layers));
  if (r.exposure_changes) {
    const ExposureSummary s = head_summary(r.info);
    const std::string count = std::to_string(s.bottom_layers), bottom = number_text(s.bottom_s);
    set_where_there(head, "normalExposureTime", number_text(s.normal_s));
    for (const char* key : {"bottomLayExposureTime", "bottomLayerExposureTime"}) {
      set_where_there(head, key, bottom);
    }
    for (const char* key : {"bottomLayCount", "bottomLayerCount"}) {
      set_where_there(head, key, count);
    }
  }
  output.add_text(kGcodeEntry, head.text() + body.changed(layers, last_layer_mm(r), exposure_s));
}

std::string new_gcode(const ArchiveRequest& r) {
  const StackInfo& info = r.info;
  const Grid& g = info.grid;
  const ExposureSummary s = head_summary(info);
  const NewLift lift = new_lift(info);
  if (lift.from == NewLift::From::archive) tell_new_lift(r, "Chitubox", lift);
  const OneStage usual = one_stage(lift.times.of(g.layers - 1)),
                 bottom = one_stage(lift.times.of(0));
  const double up_mm = std::max(usual.mm, bottom.mm);
  const auto or_else = [](const std::string& text, const std::string& other) {
    return text.empty() ? other : text;
  };
  const auto mm = [](double value) { return number_text(std::round(value * 1e6) / 1e6); };
  const double layer_mm = g.layer_um * 1e-3;
  const double build_mm = new_machine_height_mm(
      info, stack_height_um(info, g.layers) * 1e-3 + std::max(kLiftMm, up_mm));
  std::string body = ";START_GCODE_BEGIN\nG21;\nG90;\nM106 S0;\nG28 Z0;\n\n;START_GCODE_END\n\n";
  double total_s = 0;
  bool rounded = false;
  const LightSteps light = light_steps(r, r.stem, s.bottom_layers);
  for (int n = 0; n < g.layers; ++n) {
    const double z_mm = stack_height_um(info, n + 1) * 1e-3;
    const double light_ms = light_on_of_layer(info, n) * 1e3;
    rounded = rounded || std::abs(light_ms - std::round(light_ms)) > 1e-6;
    body += fmt::format(";LAYER_START:{}\n;currPos:{}\nM6054 \"{}.png\";show Image\n", n, mm(z_mm),
                        n + 1);
    const OneStage move = one_stage(lift.times.of(n));
    if (move.mm > 0) body += fmt::format("G0 Z{} F{:g};\n", mm(z_mm + move.mm), move.up_mm_min);
    body += fmt::format(
        "G0 Z{} F{:g};\nG4 P{:.0f};\nM106 S{};light on\nG4 P{:.0f};\nM106 S0; light "
        "off\n\n;LAYER_END\n\n",
        mm(z_mm), move.back_mm_min, move.wait_s * 1e3, light.layers[static_cast<std::size_t>(n)],
        light_ms);
    total_s += light_ms / 1e3 + move.dark_s();
  }
  body += fmt::format(";END_GCODE_BEGIN\nM106 S0;\nG1 Z{} F25;\nM18;\n\n;END_GCODE_END\n",
                      mm(build_mm));
  if (rounded) warn(r, "Chitubox's G-code has times of whole milliseconds: they were rounded");
  std::string head;
  const auto add = [&](const char* key, const std::string& value) {
    head += fmt::format(";{}:{}\n", key, value);
  };
  add("fileName", r.stem);
  add("machineType", or_else(info.profiles.printer, info.printer ? info.printer->name : "Default"));
  add("estimatedPrintTime", number_text(std::round(total_s * 10) / 10));
  add("volume", number_text(std::round(info.part_volume_mm3) / 1e3));
  add("resin", or_else(info.profiles.material, info.resin ? info.resin->name : "Normal"));
  add("weight", "0");
  add("price", "0");
  add("layerHeight", mm(layer_mm));
  add("resolutionX", std::to_string(g.width_px));
  add("resolutionY", std::to_string(g.height_px));
  add("machineX", mm(g.width_px * g.pixel_x_um * 1e-3));
  add("machineY", mm(g.height_px * g.pixel_y_um * 1e-3));
  add("machineZ", mm(build_mm));
  add("projectType", info.orientation.mirror_x ? "LCD_mirror" : "Normal");
  add("normalExposureTime", number_text(s.normal_s));
  add("bottomLayExposureTime", number_text(s.bottom_s));
  add("bottomLayerExposureTime", number_text(s.bottom_s));
  add("normalDropSpeed", number_text(usual.back_mm_min));
  add("normalLayerLiftHeight", number_text(usual.mm));
  add("zSlowUpDistance", "0");
  add("normalLayerLiftSpeed", number_text(usual.up_mm_min));
  add("bottomLayCount", std::to_string(s.bottom_layers));
  add("bottomLayerCount", std::to_string(s.bottom_layers));
  add("mirror", info.orientation.mirror_x ? "1" : "0");
  add("totalLayer", std::to_string(g.layers));
  add("bottomLayerLiftHeight", number_text(bottom.mm));
  add("bottomLayerLiftSpeed", number_text(bottom.up_mm_min));
  // The head has no rest: light stays off for all of it.
  const auto off_s = [](const OneStage& m) { return number_text(m.wait_s > 0 ? m.dark_s() : 0); };
  add("bottomLightOffTime", off_s(bottom));
  add("lightOffTime", off_s(usual));
  add("bottomPWMLight", std::to_string(light.bottom));
  add("PWMLight", std::to_string(light.usual));
  add("antiAliasLevel", "8");
  return head + body;
}

class ChituboxZip final : public ArchiveFormat {
 public:
  std::string_view name() const override { return "chitubox"; }
  std::string_view what() const override { return "zip of Chitubox, with run.gcode"; }
  std::vector<std::string_view> endings() const override { return {".zip"}; }
  bool says_light() const override { return true; }
  bool says_heights() const override { return true; }
  bool says_lifts() const override { return true; }
  bool recognises(const Container& archive) const override {
    return archive.has(kGcodeEntry) && !archive.has(kCwsEntry) &&
           numbered_entries(archive, "run", ".png").empty();
  }

  ArchiveContents read(const Container& archive) const override {
    const std::string& path = archive.path();
    const std::string text = file_text(archive);
    const KeyValueText head = head_of(text, path);
    const auto count = [&](const char* key, double most) {
      return whole(head.number(key, 0, most), path, kGcodeEntry, key);
    };
    ArchiveContents contents;
    StackInfo& info = contents.info;
    Grid& grid = info.grid;
    contents.images =
        complete_names(archive, numbered_entries(archive, "", ".png"), 1, "1.png, 2.png, ...");
    const auto total = count("totalLayer", kMaxLayers);
    if (total && *total > 0 && static_cast<std::size_t>(*total) != contents.images.size()) {
      throw InputError(
          path, kGcodeEntry,
          fmt::format("totalLayer is {}, but there are {} images", *total, contents.images.size()));
    }
    grid.layers = info.target_layers = static_cast<int>(contents.images.size());
    take_image_size(archive, count("resolutionX", kMostPixelsAcross),
                    count("resolutionY", kMostPixelsAcross), kGcodeEntry, false, contents);
    const double width_mm = head.number("machineX", 0, 1e5).value_or(0);
    const double height_mm = head.number("machineY", 0, 1e5).value_or(0);
    grid.pixel_x_um = pixel_um(width_mm / grid.width_px, archive, kGcodeEntry);
    grid.pixel_y_um = pixel_um(height_mm / grid.height_px, archive, kGcodeEntry);
    grid.layer_um = layer_um(head.number("layerHeight", 0, 1e5).value_or(0), archive, kGcodeEntry);
    info.machine_height_mm = machine_height_of(lift_number(head, "machineZ").value_or(0));
    info.orientation.mirror_x = head.number("mirror", 0, 255).value_or(0) != 0;
    info.exposure_s = head.number("normalExposureTime", 0, 1e6).value_or(0);
    const double bottom_s =
        number_of(head, "bottomLayerExposureTime", "bottomLayExposureTime", 1e6).value_or(0);
    const auto bottom = whole(number_of(head, "bottomLayerCount", "bottomLayCount", kMaxLayers),
                              path, kGcodeEntry, "bottomLayerCount");
    if (bottom_s > 0 && bottom.value_or(0) > 0) {
      info.bottom_exposure_s = bottom_s;
      info.bottom_layers = *bottom;
    }
    const LayerGcode body(text.substr(end_of_head(text)), kChituboxGcode, path, kGcodeEntry);
    std::vector<double> light;
    if (!body.shows(grid.layers)) {
      contents.warnings.push_back(
          fmt::format("{} does not show images 1 to {} in this order: times are those of its head",
                      kGcodeEntry, grid.layers));
    } else {
      take_layer_times(body.exposures_s(grid.layers), info);
      light = body.light(grid.layers);
      contents.z_mm = body.places_mm(grid.layers);
    }
    if (light.empty()) {
      // Without a body that shows the images, the head says it.
      const double usual = head.number("PWMLight", 0, kFullPower).value_or(kFullPower);
      light.assign(static_cast<std::size_t>(grid.layers), usual);
      std::fill_n(light.begin(), std::min(info.bottom_layers, grid.layers),
                  head.number("bottomPWMLight", 0, kFullPower).value_or(usual));
    }
    take_light(light, kFullPower, path, kGcodeEntry, info, &contents.warnings);
    take_lifts_of(head, info);
    info.own_print_time_s = lift_number(head, "estimatedPrintTime").value_or(0);
    info.profiles.printer = head.find("machineType").value_or("");
    info.profiles.material = head.find("resin").value_or("");
    return contents;
  }

  std::vector<std::string> write(const ArchiveRequest& r, ContainerOutput& output) const override {
    warn_of_mode(r, "Chitubox");
    if (r.kept == nullptr || r.exposure_changes) tell_head_times(r, "Chitubox");
    if (r.kept != nullptr) {
      std::vector<std::string> names = continued_names(r, ".png");
      change_chitubox(r, output);
      return names;
    }
    output.add_text(kGcodeEntry, new_gcode(r));
    if (!r.preview.pixels.empty()) {
      output.add("preview.png", encode_png(framed(r.preview, 954, 850)));
      output.add("preview_cropping.png", encode_png(framed(r.preview, 168, 150)));
    }
    std::vector<std::string> names;
    for (int n = 1; n <= r.info.grid.layers; ++n) names.push_back(std::to_string(n) + ".png");
    return names;
  }
};

}  // namespace

const ArchiveFormat& chitubox_zip_format() {
  static const ChituboxZip format;
  return format;
}

}  // namespace slicecorr::detail
