// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Anycubic's zip of the printers since the Photon Mono M7: settings as JSON, layers in Photon Workshop's code
// PW0. The layout is that which UVtools (AnycubicZipFile.cs) and the slicer OpenSLA (its class Pm4uFile)
// write, compared with each other.
#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <optional>

#include "slicecorr/error.hpp"
#include "stack/formats/archive_format.hpp"
#include "stack/formats/binary_block.hpp"
#include "stack/formats/format_times.hpp"
#include "support/json/json_node.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr::detail {
namespace {

using Json = nlohmann::ordered_json;
using SettingNode = JsonNode<Json>;

constexpr const char* kResinSettings = "anycubic_photon_resins.pwsp";
constexpr const char* kLayerList = "layers_controller.conf";
constexpr const char* kPrintInfo = "print_info.json";
constexpr const char* kSceneEntry = "scene.slice";
constexpr std::string_view kLayerPrefix = "layer_images/layer_", kPixelImage = ".pw0Img",
                           kOutlineImage = ".pwszImg";
constexpr std::uint64_t kMostJsonBytes = std::uint64_t{64} << 20;
constexpr std::size_t kMostZipLayers = 0xffff, kMostResins = 10'000;

Json read_entry(const Container& archive, const char* name) {
  return read_json<Json>(archive.text(name, kMostJsonBytes), {archive.path(), name});
}

double number_or(const SettingNode& object, const char* key, double most, double otherwise) {
  return object.has(key) ? object[key].number(0, most) : otherwise;
}
/// A mark that some programs write as a number, some as true or false.
bool is_set(const SettingNode& object, const char* key) {
  if (!object.has(key)) return false;
  const SettingNode mark = object[key];
  return mark.json().is_boolean() ? mark.flag() : mark.number(0, 1e9) != 0;
}
std::string text_or(const SettingNode& object, const char* key) {
  return object.has(key) && object[key].json().is_string() ? object[key].string() : "";
}

/// Where the settings of the resin stand that the file is for: among the user's own, else the maker's.
struct ResinPlace {
  const char* list = nullptr;
  std::size_t index = 0;
};
ResinPlace active_resin(const SettingNode& settings) {
  const SettingNode machine = settings["machine_extern"];
  const std::string name = machine["active_resins"].list(1, kMostResins).front().string();
  for (const char* list : {"user_resins", "factory_resins"}) {
    if (!machine.has(list)) continue;
    const auto resins = machine[list].list(0, kMostResins);
    for (std::size_t i = 0; i < resins.size(); ++i) {
      if (text_or(resins[i]["property"], "name") == name) return {list, i};
    }
  }
  settings.refuse("has no settings of the resin \"" + shown_name(name) +
                  "\", which it says is the one in use");
}

/// The settings of the layers, what is beside them for lifts, and the resin's name.
struct SliceSettings {
  SettingNode basic, more, property;
};
SliceSettings slice_settings(const SettingNode& settings, const ResinPlace& place) {
  const SettingNode resin =
      settings["machine_extern"][place.list].list(1, kMostResins)[place.index];
  return {resin["slicepara"], resin["slice_extpara"], resin["property"]};
}

bool heeds_layers(const SliceSettings& s) { return is_set(s.basic, "use_indivi_layerpara"); }
bool lifts_in_stages(const SliceSettings& s) { return is_set(s.more, "multi_state_used"); }
bool printer_chooses(const SliceSettings& s) { return is_set(s.more, "intelli_mode"); }

/// Two stages, of which the first is next to the film: there the way back is slow, too.
LiftMotion stages_of(const SettingNode& stages, const std::string& layers) {
  const SettingNode first = stages[(layers + "_0").c_str()],
                    second = stages[(layers + "_1").c_str()];
  const auto at = [](const SettingNode& stage, const char* key) {
    return stage[key].number(0, kMostLiftNumber);
  };
  LiftMotion m;
  m.up_mm = m.back_2_mm = at(first, "height");
  m.up_mm_s = at(first, "up_speed");
  m.back_2_mm_s = at(first, "down_speed");
  m.up_2_mm = at(second, "height");
  m.up_2_mm_s = at(second, "up_speed");
  m.back_mm_s = at(second, "down_speed");
  return m;
}

void take_lifts_of(const SliceSettings& s, const std::vector<SettingNode>& layers,
                   StackInfo& info) {
  LiftTimes lifts;
  const auto number = [&](const char* key, double otherwise) {
    return number_or(s.basic, key, kMostLiftNumber, otherwise);
  };
  LiftMotion& normal = lifts.normal;
  if (lifts_in_stages(s)) {
    const SettingNode stages = s.more["multi_state_paras"];
    normal = stages_of(stages, "normal");
    lifts.bottom = stages_of(stages, "bott");
  } else {
    normal.up_mm = number("zup_height", 0);
    normal.up_mm_s = number("zup_speed", 0);
    normal.back_mm_s = number("zdown_speed", 0);
    lifts.bottom = normal;
  }
  normal.before_light_s = number("off_time", 0);
  normal.before_lift_s = number("wait_before_lift", 0);
  normal.after_lift_s = number("wait_after_lift", 0);
  lifts.bottom.before_light_s = number("bott_off_time", normal.before_light_s);
  lifts.bottom.before_lift_s = number("bott_wait_before_lift", normal.before_lift_s);
  lifts.bottom.after_lift_s = number("bott_wait_after_lift", normal.after_lift_s);
  lifts.bottom_layers = info.bottom_layers;
  if (heeds_layers(s) && !lifts_in_stages(s)) {
    for (std::size_t n = 0; n < layers.size(); ++n) {
      LiftMotion m = lifts.of(static_cast<int>(n));
      m.up_mm = number_or(layers[n], "zup_height", kMostLiftNumber, m.up_mm);
      m.up_mm_s = number_or(layers[n], "zup_speed", kMostLiftNumber, m.up_mm_s);
      lifts.layers.push_back(m);
    }
  }
  take_lifts(std::move(lifts), info);
}

/// The entries of the layers, which must be images of pixels.
std::vector<std::string> image_names(const Container& archive) {
  if (const auto outlines = numbered_entries(archive, kLayerPrefix, kOutlineImage);
      !outlines.empty()) {
    throw InputError(
        archive.path(), shown_name(outlines.front().entry->name),
        "holds outlines, which the printer fills itself and which have no grey; expected layers of "
        "pixels: export the part with anti-aliasing of 8 or more, so that Photon Workshop writes "
        "them");
  }
  return complete_names(archive, numbered_entries(archive, kLayerPrefix, kPixelImage), 0,
                        "layer_images/layer_0.pw0Img on");
}

/// What the zip says of its layers one by one.
std::vector<SettingNode> layer_list(const SettingNode& list, std::size_t images) {
  std::vector<SettingNode> layers = list["paras"].list(1, kMostZipLayers);
  if (layers.size() != images) {
    list.refuse(fmt::format("lists {} layers, but there are {} images", layers.size(), images));
  }
  if (list.has("count") &&
      list["count"].whole(0, kMostZipLayers) != static_cast<std::int64_t>(layers.size())) {
    list["count"].fail(fmt::format("{}, as many as are listed", layers.size()));
  }
  for (std::size_t n = 0; n < layers.size(); ++n) {
    if (layers[n].has("layer_index") &&
        layers[n]["layer_index"].whole(0, kMostZipLayers) != static_cast<std::int64_t>(n)) {
      layers[n]["layer_index"].fail(std::to_string(n));
    }
    layers[n]["layer_thickness"].positive(100);
  }
  return layers;
}

void read_machine(const Container& archive, const SettingNode& machine, ArchiveContents& contents) {
  Grid& grid = contents.info.grid;
  const auto width = static_cast<std::uint32_t>(machine["res_x"].whole(0, 1 << 20));
  const auto height = static_cast<std::uint32_t>(machine["res_y"].whole(0, 1 << 20));
  check_image_size(archive, width, height);
  grid.width_px = static_cast<int>(width);
  grid.height_px = static_cast<int>(height);
  const auto pixel = [&](const char* display_mm, const char* its_um, int count) {
    const double mm = number_or(machine, display_mm, 1e4, 0) / count;
    return pixel_um(mm > 0 ? mm : number_or(machine, its_um, 1000, 0) * 1e-3, archive,
                    kResinSettings);
  };
  grid.pixel_x_um = pixel("print_xsize", "xy_pixel", grid.width_px);
  grid.pixel_y_um = pixel("print_ysize", "xy_pixel_y", grid.height_px);
  contents.info.profiles.printer = text_or(machine, "name");
  contents.info.machine_height_mm = machine_height_of(number_or(machine, "print_zsize", 1e9, 0));
  contents.codec = pw0_code(grid.width_px, grid.height_px, false);
}

void read_times(const SliceSettings& s, const std::vector<SettingNode>& layers,
                ArchiveContents& contents) {
  StackInfo& info = contents.info;
  const int count = info.grid.layers;
  info.exposure_s = s.basic["exposure_time"].number(0, 1e6);
  info.bottom_exposure_s = s.basic["bott_time"].number(0, 1e6);
  info.bottom_layers = std::min(s.basic["bott_layers"].integer(0, 1 << 20), count);
  info.fade_layers = static_cast<int>(
      std::min(number_or(s.more, "transition_layercount", 1e5, 0), static_cast<double>(count)));
  std::vector<double> times_s;
  double z_mm = 0;
  for (const SettingNode& layer : layers) {
    times_s.push_back(layer["exposure_time"].number(0, 1e6));
    z_mm += layer["layer_thickness"].positive(100);
    contents.z_mm.push_back(z_mm);
  }
  if (heeds_layers(s)) {
    if (lifts_in_stages(s)) {
      contents.warnings.emplace_back(
          "says that layers have settings of their own and that lifts have two stages: such files "
          "are said to be printed without the layers' own times; expected one of the two alone");
    }
    take_layer_times(std::move(times_s), info);
  } else {
    if (info.bottom_layers == 0) info.fade_layers = 0;
    tell_unheeded_times(times_s, info, contents.warnings);
  }
  if (printer_chooses(s)) {
    contents.warnings.emplace_back(kPrinterChoosesWords);
  }
}

void add_facts(const SettingNode& settings, const SliceSettings& s, ArchiveContents& contents) {
  const auto add = [&](const char* name, std::string value) {
    contents.facts.emplace_back(name, std::move(value));
  };
  const SettingNode machine = settings["machine_type"];
  const auto number = [&](const char* key) { return number_or(s.basic, key, 1e6, 0); };
  add("version", text_or(settings, "version"));
  add("code of layers", "pw0Img");
  add("display",
      fmt::format("{:g} x {:g} mm, {:g} mm high", number_or(machine, "print_xsize", 1e4, 0),
                  number_or(machine, "print_ysize", 1e4, 0),
                  number_or(machine, "print_zsize", 1e4, 0)));
  if (contents.info.own_print_time_s > 0) {
    add("time shown", fmt::format("{:.0f} s", contents.info.own_print_time_s));
  }
  add("wait before light", fmt::format("{:g} s", number("off_time")));
  add("lift", fmt::format("{:g} mm at {:g} mm/s, back at {:g} mm/s", number("zup_height"),
                          number("zup_speed"), number("zdown_speed")));
  add("lifts in two stages", lifts_in_stages(s) ? "yes" : "no");
  add("anti-aliasing", fmt::format("{:g}", number("anti_count")));
  add("times of single layers", heeds_layers(s) ? "heeded" : "not heeded");
  add("transition layers", fmt::format("{:g}", number_or(s.more, "transition_layercount", 1e5, 0)));
  add("exposures chosen by the printer", printer_chooses(s) ? "yes" : "no");
  if (!contents.info.profiles.material.empty()) add("resin", contents.info.profiles.material);
}

/// scene.slice: where the slicer's outlines lie, layer by layer.
namespace scene_at {
constexpr std::size_t kCount = 0x64, kTop = 0x7c, kMark = 0x184, kCountAgain = 0x188, kHead = 0x18c,
                      kRecord = 0x40;
}
struct Scene {
  std::vector<std::uint8_t> bytes;
  std::size_t layers = 0;
};

float float_at(const std::vector<std::uint8_t>& bytes, std::size_t at) {
  std::uint32_t word = 0;
  for (std::size_t i = 4; i-- > 0;) word = word << 8 | bytes[at + i];
  return std::bit_cast<float>(word);
}
void put_word(std::vector<std::uint8_t>& bytes, std::size_t at, std::uint32_t word) {
  for (std::size_t i = 0; i < 4; ++i) bytes[at + i] = static_cast<std::uint8_t>(word >> (8 * i));
}
void put_float(std::vector<std::uint8_t>& bytes, std::size_t at, double value) {
  put_word(bytes, at, std::bit_cast<std::uint32_t>(static_cast<float>(value)));
}

/// Nothing where the archive has none.
std::optional<Scene> read_scene(const Container& archive, std::size_t layers) {
  const Container::Entry* const entry = archive.find(kSceneEntry);
  if (entry == nullptr) return std::nullopt;
  Scene scene;
  archive.read(*entry, scene_at::kHead + (kMostZipLayers + 1) * scene_at::kRecord, scene.bytes);
  const std::size_t expected = scene_at::kHead + layers * scene_at::kRecord + 4;
  const auto fail = [&](const std::string& what) {
    throw InputError(archive.path(), kSceneEntry, what);
  };
  const auto text = [&](std::size_t at, std::string_view mark) {
    return at + mark.size() <= scene.bytes.size() &&
           std::equal(mark.begin(), mark.end(),
                      scene.bytes.begin() + static_cast<std::ptrdiff_t>(at));
  };
  if (!text(0, "ANYCUBIC-PWSZ")) fail("does not start with ANYCUBIC-PWSZ");
  if (!text(scene_at::kMark, "<---")) fail("lacks the mark <--- at byte 184h");
  const auto word = [&](std::size_t at) {
    return std::bit_cast<std::uint32_t>(float_at(scene.bytes, at));
  };
  if (scene.bytes.size() < scene_at::kHead || word(scene_at::kCount) != layers ||
      word(scene_at::kCountAgain) != layers) {
    fail(fmt::format("lists other layers than the archive's {}", layers));
  }
  if (scene.bytes.size() != expected || !text(expected - 4, "--->")) {
    fail(fmt::format("has {} bytes, expected {} with the mark ---> at their end",
                     scene.bytes.size(), expected));
  }
  scene.layers = layers;
  return scene;
}

/// With another number of layers, of which those that are added are as the last one, each as much higher as
/// that is than the one before it. What a correction makes of the outlines is not told: they are the design's.
std::vector<std::uint8_t> changed_scene(Scene scene, std::size_t layers, double layer_mm) {
  std::vector<std::uint8_t>& bytes = scene.bytes;
  const std::vector<std::uint8_t> mark(bytes.end() - 4, bytes.end());
  bytes.resize(bytes.size() - 4);
  const std::size_t last = scene_at::kHead + (scene.layers - 1) * scene_at::kRecord;
  const double top_mm = float_at(bytes, last);
  // Some programs tell the height of the layer there, not its place.
  const double step_mm =
      scene.layers == 1 ? layer_mm : top_mm - float_at(bytes, last - scene_at::kRecord);
  const std::vector<std::uint8_t> record(bytes.begin() + static_cast<std::ptrdiff_t>(last),
                                         bytes.end());
  put_float(bytes, scene_at::kTop,
            float_at(bytes, scene_at::kTop) +
                (static_cast<double>(layers) - static_cast<double>(scene.layers)) * layer_mm);
  bytes.resize(std::min(bytes.size(), scene_at::kHead + layers * scene_at::kRecord));
  for (std::size_t n = scene.layers; n < layers; ++n) {
    bytes.insert(bytes.end(), record.begin(), record.end());
    put_float(bytes, bytes.size() - scene_at::kRecord,
              top_mm + static_cast<double>(n + 1 - scene.layers) * step_mm);
  }
  put_word(bytes, scene_at::kCount, static_cast<std::uint32_t>(layers));
  put_word(bytes, scene_at::kCountAgain, static_cast<std::uint32_t>(layers));
  bytes.insert(bytes.end(), mark.begin(), mark.end());
  return std::move(bytes);
}

/// A text of the kept archive, changed to what the stack says. Remembers whether anything did change.
class JsonChange {
 public:
  JsonChange(const ArchiveRequest& r, const char* name)
      : name_(name), json_(read_entry(*r.kept, name)) {}
  Json& json() { return json_; }
  void set(Json& object, const char* key, const Json& value) {
    const auto found = object.find(key);
    if (found != object.end() && *found == value) return;
    object[key] = value;
    changed_ = true;
  }
  /// What is changed past `set`.
  void note() { changed_ = true; }
  void set_where_said(Json& object, const char* key, const Json& value) {
    if (object.contains(key)) set(object, key, value);
  }
  void add_to(ContainerOutput& output) const {
    if (changed_) {
      output.add_text(name_, json_.dump(4, ' ', false, Json::error_handler_t::replace) + "\n");
    }
  }

 private:
  const char* name_;
  Json json_;
  bool changed_ = false;
};

void change_settings(const ArchiveRequest& r, ContainerOutput& output) {
  JsonChange change(r, kResinSettings);
  const JsonSource source{r.kept->path(), kResinSettings};
  const SettingNode settings(change.json(), "", source);
  const ResinPlace place = active_resin(settings);
  const SliceSettings said = slice_settings(settings, place);
  if (printer_chooses(said)) {
    settings.refuse(kPrinterChoosesWords);
  }
  const ExposureSummary s = head_summary(r.info);
  if (!heeds_layers(said)) {
    require_even_times(r, s,
                       "the file's mark that printers heed times of single layers is not set");
  }
  Json& resin = change.json()["machine_extern"][place.list][place.index];
  Json &basic = resin["slicepara"], &more = resin["slice_extpara"];
  if (basic.contains("bott_time_dual") && basic["bott_time_dual"] == basic["bott_time"]) {
    change.set(basic, "bott_time_dual", s.bottom_s);
  }
  change.set(basic, "exposure_time", s.normal_s);
  change.set(basic, "bott_time", s.bottom_s);
  if (!s.uneven || s.bottom_layers > 0) {
    change.set(basic, "bott_layers", s.bottom_layers);
    if (s.fade_layers > 0) {
      change.set(more, "transition_layercount", s.fade_layers);
    } else {
      change.set_where_said(more, "transition_layercount", 0);
    }
  }
  change.add_to(output);
}

void change_layer_list(const ArchiveRequest& r, ContainerOutput& output) {
  JsonChange change(r, kLayerList);
  Json& list = change.json();
  Json& layers = list["paras"];
  const auto wanted = static_cast<std::size_t>(r.info.grid.layers);
  change.set_where_said(list, "count", wanted);
  if (layers.size() != wanted) change.note();
  while (layers.size() > wanted) layers.erase(layers.size() - 1);
  while (layers.size() < wanted) {
    Json layer = layers.back();
    if (layer.contains("layer_index")) layer["layer_index"] = layers.size();
    if (layer.contains("layer_minheight") && layer["layer_minheight"].is_number()) {
      layer["layer_minheight"] =
          layer["layer_minheight"].get<double>() + layer["layer_thickness"].get<double>();
    }
    layers.push_back(std::move(layer));
  }
  if (r.exposure_changes) {
    for (std::size_t n = 0; n < wanted; ++n) {
      change.set(layers[n], "exposure_time", light_on_of_layer(r.info, static_cast<int>(n)));
    }
  }
  change.add_to(output);
}

/// How many layers and how long, where the archive says it: of all, and of its only plate.
void change_print_info(const ArchiveRequest& r, ContainerOutput& output) {
  if (!r.kept->has(kPrintInfo)) return;
  JsonChange change(r, kPrintInfo);
  Json& info = change.json();
  if (!info.is_object()) return;
  const StackInfo& old = r.kept_contents->info;
  const auto old_time_s = static_cast<std::uint32_t>(std::round(old.own_print_time_s));
  const std::uint32_t time_s = changed_print_time_s(old_time_s, old, r.info);
  const auto set = [&](Json& object, const char* time) {
    if (!object.is_object()) return;
    if (old.grid.layers != r.info.grid.layers) {
      change.set_where_said(object, "model_layers_count", r.info.grid.layers);
    }
    if (time_s != old_time_s) change.set_where_said(object, time, time_s);
  };
  set(info, "print_time");
  const auto plates = info.find("sub_estimated_infos");
  if (plates != info.end() && plates->is_array() && plates->size() == 1) {
    set(plates->front(), "estimated_time");
  }
  change.add_to(output);
}

class AnycubicZip final : public ArchiveFormat {
 public:
  std::string_view name() const override { return "anycubic-zip"; }
  std::string_view what() const override { return "Anycubic's zip with layers of pixels"; }
  std::vector<std::string_view> endings() const override {
    return {".pwsz", ".pm7", ".pm7m", ".pm4u", ".pp1", ".pp1m"};
  }
  bool codes_layers() const override { return true; }
  bool made_new() const override { return false; }
  bool recognises(const Container& archive) const override {
    return archive.kind() == ContainerKind::zip && archive.has(kResinSettings) &&
           archive.has(kLayerList);
  }

  ArchiveContents read(const Container& archive) const override {
    const JsonSource settings_source{archive.path(), kResinSettings},
        list_source{archive.path(), kLayerList};
    const Json settings_json = read_entry(archive, kResinSettings),
               list_json = read_entry(archive, kLayerList);
    const SettingNode settings(settings_json, "", settings_source);
    ArchiveContents contents;
    StackInfo& info = contents.info;
    contents.images = image_names(archive);
    const std::vector<SettingNode> layers =
        layer_list(SettingNode(list_json, "", list_source), contents.images.size());
    info.grid.layers = info.target_layers = static_cast<int>(layers.size());
    read_machine(archive, settings["machine_type"], contents);
    const SliceSettings s = slice_settings(settings, active_resin(settings));
    info.grid.layer_um = layer_um(s.basic["zthick"].number(0, 100), archive, kResinSettings);
    read_times(s, layers, contents);
    take_lifts_of(s, layers, info);
    info.profiles.material = text_or(s.property, "resin_name");
    if (info.profiles.material.empty()) info.profiles.material = text_or(s.property, "name");
    if (archive.has(kPrintInfo)) {
      const Json json = read_entry(archive, kPrintInfo);
      const JsonSource source{archive.path(), kPrintInfo};
      info.own_print_time_s = number_or(SettingNode(json, "", source), "print_time", 4e9, 0);
    }
    read_scene(archive, layers.size());
    add_facts(settings, s, contents);
    return contents;
  }

  std::vector<std::string> write(const ArchiveRequest& r, ContainerOutput& output) const override {
    const auto layers = static_cast<std::size_t>(r.info.grid.layers),
               old = r.kept_contents->images.size();
    if (layers > kMostZipLayers) {
      throw InputError(
          r.kept->path(), "",
          fmt::format("would have {} layers, expected at most {}", layers, kMostZipLayers));
    }
    if (r.exposure_changes) {
      warn_of_mode(r, "Anycubic", printers_lift());
      change_settings(r, output);
    }
    change_layer_list(r, output);
    change_print_info(r, output);
    if (auto scene = read_scene(*r.kept, old); scene && layers != old) {
      output.add(kSceneEntry, changed_scene(std::move(*scene), layers, last_layer_mm(r)));
    }
    if (layers >= old) return continued_names(r, kPixelImage);
    std::vector<std::string> names = r.kept_contents->images;
    for (std::size_t n = layers; n < old; ++n) output.leave_out(names[n]);
    names.resize(layers);
    return names;
  }
};

}  // namespace

const ArchiveFormat& anycubic_zip_format() {
  static const AnycubicZip format;
  return format;
}

}  // namespace slicecorr::detail
