// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// VDT: Voxeldance Tango.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "slicecorr/error.hpp"
#include "slicecorr/image_size.hpp"
#include "stack/formats/archive_format.hpp"
#include "stack/formats/format_times.hpp"
#include "stack/png/preview.hpp"
#include "support/json/json_node.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr::detail {
namespace {

using Json = nlohmann::ordered_json;
using Node = JsonNode<Json>;

constexpr const char* kVdtManifest = "manifest.json";
constexpr int kFullLight = 255;

/// Most bytes of the manifest: it lists every layer, with some 15 values each.
std::uint64_t manifest_limit(const Container& archive) {
  return (std::uint64_t{64} << 20) + 1024 * archive.entries().size();
}

/// What is needed of a layer; nothing where the manifest does not say it.
struct Layer {
  std::optional<double> height_mm, time_s;
  int light = kFullLight;
};

/// There may be a million layers: each is dropped as soon as it has been read.
Json parse_manifest(const Container& archive, const JsonSource& place, std::vector<Layer>& layers) {
  const std::string text = archive.text(kVdtManifest, manifest_limit(archive));
  bool in_layers = false;
  const auto keep = [&](int depth, Json::parse_event_t event, Json& value) {
    if (event == Json::parse_event_t::key && depth == 1) in_layers = value == "layers";
    if (!in_layers || depth != 2 || event != Json::parse_event_t::object_end) return true;
    const Node node(value, fmt::format("layers[{}]", layers.size()), place);
    Layer layer;
    if (node.has("height")) layer.height_mm = node["height"].number(0, 1e6);
    if (node.has("exposure_time")) layer.time_s = node["exposure_time"].number(0, 1e9);
    if (node.has("light_pwm")) layer.light = node["light_pwm"].integer(0, kFullLight);
    layers.push_back(layer);
    return false;
  };
  return read_json<Json>(text, place, kManyLayers, keep);
}

double number_at(const Node& object, const char* key, double most) {
  return object.has(key) ? object[key].number(0, most) : 0;
}
int integer_at(const Node& object, const char* key, int most) {
  return object.has(key) ? object[key].integer(0, most) : 0;
}
std::string text_at(const Node& object, const char* key) {
  return object.has(key) ? object[key].string() : "";
}
bool flag_at(const Node& object, const char* key) { return object.has(key) && object[key].flag(); }

void read_machine(const Container& archive, const Node& machine, ArchiveContents& contents) {
  StackInfo& info = contents.info;
  Grid& grid = info.grid;
  take_image_size(archive, integer_at(machine, "resolution_x", kMostPixelsAcross),
                  integer_at(machine, "resolution_y", kMostPixelsAcross), kVdtManifest, false,
                  contents);
  grid.pixel_x_um =
      pixel_um(number_at(machine, "lcd_width", 1e5) / grid.width_px, archive, kVdtManifest);
  grid.pixel_y_um =
      pixel_um(number_at(machine, "lcd_height", 1e5) / grid.height_px, archive, kVdtManifest);
  info.orientation.mirror_x = flag_at(machine, "x_mirror");
  info.orientation.mirror_y = flag_at(machine, "y_mirror");
  info.profiles.printer = text_at(machine, "name");
  if (machine.has("z_height") && machine["z_height"].json().is_number()) {
    info.machine_height_mm = machine_height_of(machine["z_height"].json().get<double>());
  }
}

void read_print(const Container& archive, const Node& print, StackInfo& info) {
  info.grid.layer_um = layer_um(number_at(print, "layer_thickness", 1e3), archive, kVdtManifest);
  info.exposure_s = number_at(print, "exposure_time", 1e9);
  const double bottom_s = number_at(print, "bottom_exposure_time", 1e9);
  const int bottom = integer_at(print, "bottom_layers", kMaxLayers);
  if (bottom > 0 && bottom_s > 0) {
    info.bottom_exposure_s = bottom_s;
    info.bottom_layers = bottom;
    info.fade_layers = integer_at(print, "transition_layer", kMaxLayers);
  }
}

/// Places and light of single layers.
void take_layers(const std::vector<Layer>& layers, const std::string& file,
                 ArchiveContents& contents) {
  std::vector<double> light;
  for (const Layer& layer : layers) {
    light.push_back(layer.light);
    if (layer.height_mm) contents.z_mm.push_back(*layer.height_mm);
  }
  // Heights are rounded to a hundredth of a millimetre by some.
  contents.z_step_um = 10.1;
  take_light(light, kFullLight, file, kVdtManifest, contents.info, &contents.warnings);
}

ArchiveContents read_vdt(const Container& archive) {
  const JsonSource place{archive.path(), kVdtManifest};
  std::vector<Layer> layers;
  const Json json = parse_manifest(archive, place, layers);
  const Node root(json, "", place);
  // Entries of the list that were not taken as layers are none.
  if (!root["layers"].list(0, kMaxLayers).empty()) {
    root["layers"].refuse("layers holds a value that is no object");
  }
  ArchiveContents contents;
  StackInfo& info = contents.info;
  contents.images = complete_names(archive, numbered_entries(archive, "", ".png"), 0, "0.png on");
  if (contents.images.size() != layers.size()) {
    root.refuse(fmt::format("lists {} layers, but there are {} images", layers.size(),
                            contents.images.size()));
  }
  if (layers.size() > static_cast<std::size_t>(kMaxLayers)) {
    root.refuse(fmt::format("lists {} layers, expected at most {}", layers.size(), kMaxLayers));
  }
  read_machine(archive, root["machine"], contents);
  read_print(archive, root["print"], info);
  info.grid.layers = info.target_layers = static_cast<int>(layers.size());
  if (root.has("resin")) info.profiles.material = text_at(root["resin"], "name");
  info.program = text_at(root, "application_name");
  if (const std::string version = text_at(root, "application_version"); !version.empty()) {
    info.program += (info.program.empty() ? "" : " ") + version;
  }
  std::vector<double> times_s;
  for (const Layer& layer : layers) {
    if (layer.time_s) times_s.push_back(*layer.time_s);
  }
  // In continuous prints without a speed all layers say 0.
  const bool said = times_s.size() == layers.size() &&
                    std::any_of(times_s.begin(), times_s.end(), [](double t) { return t > 0; });
  if (said) take_layer_times(std::move(times_s), info);
  take_layers(layers, archive.path(), contents);
  return contents;
}

/// No lifts in continuous mode; else the reader's defaults, since only the printer's owner knows
/// them.
void add_lifts(Json& json, std::string_view prefix, bool still) {
  if (!still) return;
  for (const char* key : {"lift_distance", "lift_speed", "lift_distance2", "lift_speed2",
                          "retract_speed", "retract_distance2", "retract_speed2"}) {
    json[std::string(prefix) + key] = 0;
  }
}
void add_waits(Json& json, std::string_view prefix) {
  for (const char* key :
       {"light_off_delay", "wait_time_before_cure", "wait_time_after_cure", "wait_time_after_lift"})
    json[std::string(prefix) + key] = 0;
}

Json print_json(const StackInfo& info) {
  const ExposureSummary s = head_summary(info);
  Json print = {{"layer_thickness", mm_of_um(info.grid.layer_um)},
                {"bottom_layers", s.bottom_layers},
                {"transition_layer", s.fade_layers},
                {"bottom_exposure_time", s.bottom_s},
                {"exposure_time", s.normal_s}};
  for (const char* prefix : {"bottom_", ""}) {
    add_waits(print, prefix);
    add_lifts(print, prefix, !lifts(info));
  }
  return print;
}

std::string new_manifest(const ArchiveRequest& r) {
  const StackInfo& info = r.info;
  const Grid& grid = info.grid;
  double light_on_s = 0;
  for (int n = 0; n < grid.layers; ++n) light_on_s += light_on_of_layer(info, n);
  Json manifest = {{"application_name", "slicecorr"},
                   {"application_version", info.program},
                   {"create_datetime", "1980-01-01 00:00:00"},
                   {"file_version", 1},
                   {"project_name", r.stem},
                   {"machine",
                    {{"name", info.printer ? info.printer->name : info.profiles.printer},
                     {"type", "Default"},
                     {"lcd_width", mm_of_um(grid.width_px * grid.pixel_x_um)},
                     {"lcd_height", mm_of_um(grid.height_px * grid.pixel_y_um)},
                     {"z_height", info.machine_height_mm},
                     {"resolution_x", grid.width_px},
                     {"resolution_y", grid.height_px},
                     {"x_mirror", info.orientation.mirror_x},
                     {"y_mirror", info.orientation.mirror_y},
                     {"notes", ""},
                     {"uvtools_convert_to", ""}}},
                   {"advanced_parameters",
                    {{"antialasing_level", 1},
                     {"grey_level", 0},
                     {"image_blur_level", 0},
                     {"bottom_light_pwm", kFullLight},
                     {"light_pwm", kFullLight},
                     {"beam_compensation", 0}}},
                   {"resin",
                    {{"name", info.resin ? info.resin->name : info.profiles.material},
                     {"cost", 0},
                     {"density", 1},
                     {"notes", ""}}},
                   {"print", print_json(info)},
                   {"print_statistics",
                    {{"price", 0},
                     {"price_currency", ""},
                     {"estimated_time", static_cast<std::int64_t>(light_on_s)},
                     {"volume", info.part_volume_mm3 / 1000},
                     {"weight", 0}}}};
  std::string text = manifest.dump(2, ' ', false, Json::error_handler_t::replace);
  text.resize(text.size() - 2);  // "\n}"
  // One line per layer, joined as text: a tree of a million layers would fill the memory.
  text += ",\n  \"layers\": [";
  const bool own_heights = has_own_heights(info);
  double z_um = 0;
  for (int n = 0; n < grid.layers; ++n) {
    const SliceLight light = light_of_layer(info, n);
    z_um = own_heights ? z_um + layer_height_um(info, n) : (n + 1) * info.grid.layer_um;
    Json layer = {{"height", mm_of_um(z_um)}, {"exposure_time", light.time_s}};
    add_waits(layer, "");
    add_lifts(layer, "", !lifts(info));
    layer["light_pwm"] = std::lround(kFullLight * light.share);
    text += (n == 0 ? "\n    " : ",\n    ") + layer.dump();
  }
  return text + "\n  ]\n}\n";
}

/// The kept manifest changed to what the stack says. Remembers whether anything did change.
class Change {
 public:
  explicit Change(const ArchiveRequest& r) : r_(r) {
    json_ = read_json<Json>(r.kept->text(kVdtManifest, manifest_limit(*r.kept)),
                            {r.kept->path(), kVdtManifest}, kManyLayers);
    add_layers();
    if (r.exposure_changes) set_exposure();
    if (r.light_changes) set_light();
  }
  bool changed() const { return changed_; }
  std::string text() const {
    return json_.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
  }

 private:
  void set(Json& object, const char* key, const Json& value) {
    const auto found = object.find(key);
    if (found != object.end() && *found == value) return;
    object[key] = value;
    changed_ = true;
  }

  /// Adds the layers that are missing, each like the last one.
  void add_layers() {
    Json& layers = json_["layers"];
    const StackInfo& kept = r_.kept_contents->info;
    const double layer_um =
        kept.grid.layer_um > 0 ? layer_height_um(kept, kept.grid.layers) : r_.info.grid.layer_um;
    while (layers.size() < static_cast<std::size_t>(r_.info.grid.layers)) {
      Json layer = layers.back();
      if (layer.contains("height")) {
        layer["height"] = mm_of_um(layer["height"].get<double>() * 1000 + layer_um);
      }
      layers.push_back(std::move(layer));
      changed_ = true;
    }
  }

  void set_exposure() {
    const ExposureSummary s = head_summary(r_.info);
    Json& print = json_["print"];
    set(print, "exposure_time", s.normal_s);
    set(print, "bottom_exposure_time", s.bottom_s);
    set(print, "bottom_layers", s.bottom_layers);
    set(print, "transition_layer", s.fade_layers);
    Json& layers = json_["layers"];
    for (int n = 0; n < r_.info.grid.layers; ++n) {
      const SliceLight light = light_of_layer(r_.info, n);
      Json& layer = layers[static_cast<std::size_t>(n)];
      set(layer, "exposure_time", light.time_s);
      if (light.share != 1) set(layer, "light_pwm", std::lround(kFullLight * light.share));
    }
  }

  void set_light() {
    Json& layers = json_["layers"];
    for (int n = 0; n < r_.info.grid.layers; ++n) {
      set(layers[static_cast<std::size_t>(n)], "light_pwm",
          std::lround(kFullLight * light_of_layer(r_.info, n).share));
    }
  }

  const ArchiveRequest& r_;
  Json json_;
  bool changed_ = false;
};

class Vdt final : public ArchiveFormat {
 public:
  std::string_view name() const override { return "vdt"; }
  std::string_view what() const override { return "VDT of Voxeldance Tango"; }
  std::vector<std::string_view> endings() const override { return {".vdt"}; }

  bool says_light() const override { return true; }
  bool says_heights() const override { return true; }

  bool recognises(const Container& archive) const override {
    return archive.kind() == ContainerKind::zip && archive.has(kVdtManifest) &&
           (archive.path().ends_with(".vdt") || archive.has("0.png"));
  }

  ArchiveContents read(const Container& archive) const override { return read_vdt(archive); }

  std::vector<std::string> write(const ArchiveRequest& r, ContainerOutput& output) const override {
    warn_of_mode(r, "VDT");
    if (r.kept != nullptr) {
      const Change change(r);
      if (change.changed()) output.add_text(kVdtManifest, change.text());
      return continued_names(r, ".png");
    }
    if (lifts(r.info) && !(r.info.lift_times && r.info.lift_times->by_archive)) {
      warn(r,
           "the stack says nothing of lifts between layers: whoever opens the archive takes its "
           "own");
    }
    output.add_text(kVdtManifest, new_manifest(r));
    if (!r.preview.pixels.empty()) {
      output.add("Preview_FLT.png", encode_png(framed(r.preview, 200, 200)));
      output.add("Preview_FLT_48.png", encode_png(framed(r.preview, 48, 48)));
    }
    std::vector<std::string> names;
    names.reserve(static_cast<std::size_t>(r.info.grid.layers));
    for (int n = 0; n < r.info.grid.layers; ++n) names.push_back(fmt::format("{}.png", n));
    return names;
  }
};

}  // namespace

const ArchiveFormat& vdt_format() {
  static const Vdt format;
  return format;
}

}  // namespace slicecorr::detail
