// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// NanoDLP plates: 1.png, 2.png, ... and the settings in several JSON files. Monochrome panels that
// are wired as colour ones get three neighbouring pixels in one RGB pixel, which is the usual kind.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "slicecorr/error.hpp"
#include "slicecorr/image_size.hpp"
#include "slicecorr/version.hpp"
#include "stack/formats/format_times.hpp"
#include "stack/png/preview.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr::detail {
namespace {

/// Keeps the order of keys, and those that we know nothing of.
using Json = nlohmann::ordered_json;

constexpr const char* kMetaEntry = "meta.json";
constexpr const char* kPlateEntry = "plate.json";
constexpr const char* kProfileEntry = "profile.json";
constexpr const char* kOverrideEntry = "override.json";  ///< its keys count over the profile's
constexpr const char* kSlicerEntry = "slicer.json";
constexpr const char* kOptionsEntry = "options.json";  ///< some programs say the slicer's here
constexpr const char* kInfoEntry = "info.json";

/// Most bytes of a JSON file: room for lists of a million layers.
constexpr std::uint64_t kMaxJsonBytes = std::uint64_t{256} << 20;

struct Document {
  std::string file, entry;
  std::string text;
  Json json;

  [[noreturn]] void fail(const std::string& message) const {
    throw InputError(file, entry, message);
  }
  bool has(const char* key) const { return json.contains(key) && !json[key].is_null(); }
  std::optional<double> number(const char* key, double most) const {
    if (!has(key)) return std::nullopt;
    const Json& value = json[key];
    const double number = value.is_number() ? value.get<double>() : NAN;
    if (!(number >= 0 && number <= most)) {
      fail(fmt::format("{} is {}, expected a number from 0 to {:g}", key,
                       value.is_structured() ? "a list or object" : shown_name(value.dump()),
                       most));
    }
    return number;
  }
  std::optional<int> count(const char* key, double most) const {
    return whole(number(key, most), file, entry, key);
  }
  /// A list of numbers; empty when there is none.
  std::vector<double> numbers(const char* key) const {
    if (!has(key)) return {};
    std::vector<double> list;
    if (!json[key].is_array()) fail(fmt::format("{} is no list, expected one of numbers", key));
    for (const Json& value : json[key]) {
      const double number = value.is_number() ? value.get<double>() : NAN;
      if (!(number >= 0 && number <= 1e6)) {
        fail(fmt::format("{}[{}] is no number from 0 to 1e6", key, list.size()));
      }
      list.push_back(number);
    }
    return list;
  }
  std::string string(const char* key) const {
    return has(key) && json[key].is_string() ? json[key].get<std::string>() : "";
  }
  /// The document as text, indented if the text that was read was.
  std::string dump() const { return json.dump(text.find('\n') == text.npos ? -1 : 2); }
};

Document open(const Container& archive, const char* entry) {
  Document d{archive.path(), entry, archive.text(entry, kMaxJsonBytes), {}};
  d.json = read_json<Json>(d.text, {d.file, d.entry});
  const bool is_list = std::string_view(entry) == kInfoEntry;
  if (is_list ? !d.json.is_array() : !d.json.is_object()) {
    d.fail(is_list ? "is no list" : "is no object");
  }
  return d;
}

std::optional<Document> open_optional(const Container& archive, const char* entry) {
  if (!archive.has(entry)) return std::nullopt;
  return open(archive, entry);
}

/// The slicer's settings: of `slicer.json`, or of `options.json` where that holds something else.
std::optional<Document> open_slicer(const Container& archive) {
  std::optional<Document> slicer = open_optional(archive, kSlicerEntry);
  if (slicer && slicer->has("PWidth")) return slicer;
  std::optional<Document> options = open_optional(archive, kOptionsEntry);
  return options && options->has("PWidth") ? options : slicer;
}

/// Exposure settings: of the profile, with what overrides them.
struct Profile {
  Document profile;
  std::optional<Document> over;

  explicit Profile(const Container& archive)
      : profile(open(archive, kProfileEntry)), over(open_optional(archive, kOverrideEntry)) {}
  Document& with(const char* key) { return over && over->has(key) ? *over : profile; }
  const Document& with(const char* key) const { return over && over->has(key) ? *over : profile; }
};

void read_exposure(const Profile& p, StackInfo& info, std::vector<std::string>& warnings) {
  const auto number = [&](const char* key, double most) { return p.with(key).number(key, most); };
  const auto count = [&](const char* key) {
    return p.with(key).count(key, kMaxLayers).value_or(0);
  };
  info.exposure_s = number("CureTime", 1e6).value_or(0);
  const double bottom_s = number("SupportCureTime", 1e6).value_or(0);
  const int bottom = count("SupportLayerNumber");
  if (bottom_s > 0 && bottom > 0) {
    info.bottom_exposure_s = bottom_s;
    info.bottom_layers = bottom;
    info.fade_layers = count("TransitionalLayer");
  }
  if (!p.with("DynamicCureTime").string("DynamicCureTime").empty()) {
    warnings.emplace_back(
        "the printer computes exposure times with an equation (DynamicCureTime): the times of the "
        "profile are taken");
  }
}

ArchiveContents read_nanodlp(const Container& archive) {
  const Document meta = open(archive, kMetaEntry), plate = open(archive, kPlateEntry);
  const std::optional<Document> slicer = open_slicer(archive);
  const Profile profile(archive);
  ArchiveContents contents;
  StackInfo& info = contents.info;
  Grid& grid = info.grid;
  contents.images =
      complete_names(archive, numbered_entries(archive, "", ".png"), 1, "1.png, 2.png, ...");
  grid.layers = info.target_layers = static_cast<int>(contents.images.size());
  const int said = plate.count("LayersCount", kMaxLayers).value_or(0);
  if (said > 0 && said != grid.layers) {
    plate.fail(fmt::format("LayersCount is {}, but there are {} images", said, grid.layers));
  }
  const auto size_of = [&](const char* key) {
    return slicer ? slicer->count(key, kMostPixelsAcross) : std::optional<int>();
  };
  const std::string says = slicer ? slicer->entry : kPlateEntry;
  take_image_size(archive, size_of("PWidth"), size_of("PHeight"), says, true, contents);
  if (slicer) {
    grid.pixel_x_um = pixel_um(slicer->number("XPixelSize", 1e5).value_or(0), archive, says);
    grid.pixel_y_um = pixel_um(slicer->number("YPixelSize", 1e5).value_or(0), archive, says);
    info.orientation.mirror_x = slicer->number("ImageMirror", 255).value_or(0) != 0;
    grid.layer_um = layer_um(slicer->number("Thickness", 1e5).value_or(0) * 1e-3, archive, says);
  }
  if (grid.layer_um == 0) {
    grid.layer_um =
        layer_um(profile.profile.number("Depth", 1e5).value_or(0) * 1e-3, archive, kProfileEntry);
  }
  const std::vector<double> heights = plate.numbers("DynamicThickness");
  if (heights.size() == contents.images.size()) {
    double z_mm = 0;
    for (const double um : heights) contents.z_mm.push_back(z_mm += um * 1e-3);
  } else if (!heights.empty()) {
    contents.warnings.push_back(
        fmt::format("DynamicThickness has {} heights for {} layers: that of the profile is taken",
                    heights.size(), grid.layers));
  }
  read_exposure(profile, info, contents.warnings);
  std::vector<double> times = plate.numbers("CureTimes");
  if (times.size() == contents.images.size()) {
    take_layer_times(std::move(times), info);
  } else if (!times.empty()) {
    contents.warnings.push_back(
        fmt::format("CureTimes has {} times for {} layers: those of the profile are taken",
                    times.size(), grid.layers));
  }
  info.profiles.printer = meta.string("distro");
  info.profiles.material = profile.profile.string("Title");
  return contents;
}

/// Whether images are whole although they are in colour, which `DisplayController` 0 tells, too.
bool is_rgb(const Container& archive) {
  const ArchiveContents contents = read_nanodlp(archive);
  if (contents.packed_rgb) return false;
  if (image_size(archive, contents.images.front()).channels >= 3) return true;
  const std::optional<Document> slicer = open_slicer(archive);
  return slicer && slicer->number("DisplayController", 255) == 0;
}

/// Sets what the document says, and nothing that it does not.
void set_where_there(Document& d, const char* key, const Json& value) {
  if (d.has(key) && d.json[key] != value) d.json[key] = value;
}

/// Lengthens a list that has something for each layer.
void lengthen(Json& list, int kept_layers, int layers, const Json& added) {
  if (!list.is_array() || list.size() != static_cast<std::size_t>(kept_layers)) return;
  while (list.size() < static_cast<std::size_t>(layers)) list.push_back(added);
}

void change_nanodlp(const ArchiveRequest& r, ContainerOutput& output) {
  const Container& kept = *r.kept;
  const int layers = r.info.grid.layers, kept_layers = r.kept_contents->info.grid.layers;
  const auto add_if_changed = [&](const Document& d, const Json& before) {
    if (d.json != before) output.add_text(d.entry, d.dump());
  };
  Document plate = open(kept, kPlateEntry);
  const Json plate_before = plate.json;
  const bool has_times = plate.numbers("CureTimes").size() == static_cast<std::size_t>(kept_layers);
  set_where_there(plate, "LayersCount", layers);
  set_where_there(plate, "LayerCount", layers);
  if (layers > kept_layers) {
    for (const char* key : {"CureTimes", "DynamicThickness"}) {
      if (plate.has(key) && !plate.json[key].empty()) {
        lengthen(plate.json[key], kept_layers, layers, Json(plate.json[key].back()));
      }
    }
    if (auto info = open_optional(kept, kInfoEntry)) {
      const Json before = info->json;
      Json empty = before.empty() ? Json() : before.back();
      for (Json& value : empty) {
        if (value.is_number()) value = 0;
      }
      lengthen(info->json, kept_layers, layers, empty);
      add_if_changed(*info, before);
    }
    if (auto slicer = open_slicer(kept)) {
      const Json before = slicer->json;
      if (slicer->count("LayerCount", 1e9) == kept_layers) {
        set_where_there(*slicer, "LayerCount", layers);
      }
      add_if_changed(*slicer, before);
    }
  }
  if (r.exposure_changes) {
    const ExposureSummary s = head_summary(r.info);
    Profile p(kept);
    const Json before = p.profile.json, over_before = p.over ? p.over->json : Json();
    const auto set = [&](const char* key, const Json& value) {
      Document& d = p.with(key);
      // Left as it is written where it is the same number: 2 and 2.0.
      if (d.has(key) && d.json[key].is_number() && d.json[key].get<double>() == value.get<double>())
        return;
      d.json[key] = value;
    };
    set("CureTime", s.normal_s);
    if (s.bottom_layers > 0) set("SupportCureTime", s.bottom_s);
    if (s.bottom_layers > 0 || p.with("SupportLayerNumber").has("SupportLayerNumber")) {
      set("SupportLayerNumber", s.bottom_layers);
    }
    if (s.fade_layers > 0 || p.with("TransitionalLayer").has("TransitionalLayer")) {
      set("TransitionalLayer", s.fade_layers);
    }
    add_if_changed(p.profile, before);
    if (p.over) add_if_changed(*p.over, over_before);
    if (s.uneven || has_times) {
      Json times = Json::array();
      for (int n = 0; n < layers; ++n) times.push_back(light_on_of_layer(r.info, n));
      plate.json["CureTimes"] = std::move(times);
    }
  }
  add_if_changed(plate, plate_before);
}

/// Makes a new plate that says what NanoDLP and other writers of plates say, as far as we know it.
void make_new(const ArchiveRequest& r, bool packed, ContainerOutput& output) {
  const StackInfo& info = r.info;
  const Grid& g = info.grid;
  const ExposureSummary s = head_summary(info);
  const auto rounded = [](double value) { return std::round(value * 1e6) / 1e6; };
  const double height_mm = rounded(stack_height_um(info, g.layers) * 1e-3);
  const double half_x_mm = rounded(g.width_px * g.pixel_x_um * 0.5e-3);
  const double half_y_mm = rounded(g.height_px * g.pixel_y_um * 0.5e-3);
  const double lift_mm = one_stage(new_lift(info).times.normal).mm;
  const Json boundary{{"XMin", -half_x_mm}, {"XMax", half_x_mm}, {"YMin", -half_y_mm},
                      {"YMax", half_y_mm},  {"ZMin", 0},         {"ZMax", height_mm}};
  const auto add = [&](const char* entry, const Json& json) {
    output.add_text(entry, json.dump(2) + "\n");
  };
  add(kMetaEntry, {{"format_version", 2},
                   {"distro", info.profiles.printer.empty() ? "generic" : info.profiles.printer},
                   {"program", "slicecorr"},
                   {"version", version},
                   {"os", ""},
                   {"arch", ""},
                   {"profile", false}});
  add(kSlicerEntry, {{"Type", "stl"},
                     {"PWidth", g.width_px},
                     {"PHeight", g.height_px},
                     {"StartLayer", 0},
                     {"SupportDepth", g.layer_um},
                     {"SupportLayerNumber", s.bottom_layers},
                     {"Thickness", g.layer_um},
                     {"XOffset", g.width_px / 2},
                     {"YOffset", g.height_px / 2},
                     {"ZOffset", 0},
                     {"XPixelSize", g.pixel_x_um * 1e-3},
                     {"YPixelSize", g.pixel_y_um * 1e-3},
                     {"Boundary", boundary},
                     {"ImageMirror", info.orientation.mirror_x ? 1 : 0},
                     {"DisplayController", packed ? 1 : 0},
                     {"LayerCount", g.layers}});
  Json plate{{"PlateID", 0},
             {"ProfileID", 0},
             {"Path", r.stem},
             {"LayersCount", g.layers},
             {"TotalSolidArea", rounded(info.part_volume_mm3 * 1e-3)},
             {"CureTimes", Json::array()},
             {"DynamicThickness", Json::array()}};
  plate.update(boundary);
  if (s.uneven) {
    for (int n = 0; n < g.layers; ++n) plate["CureTimes"].push_back(light_on_of_layer(info, n));
  }
  if (has_own_heights(info)) {
    for (int n = 0; n < g.layers; ++n) {
      plate["DynamicThickness"].push_back(layer_height_um(info, n));
    }
  }
  add(kPlateEntry, plate);
  std::string material = info.profiles.material;
  if (material.empty() && info.resin) material = info.resin->name;
  add(kProfileEntry, {{"ResinID", 0},
                      {"ProfileID", 0},
                      {"Title", material.empty() ? "slicecorr" : material},
                      {"Depth", g.layer_um},
                      {"SupportDepth", g.layer_um},
                      {"CureTime", s.normal_s},
                      {"SupportCureTime", s.bottom_s},
                      {"SupportLayerNumber", s.bottom_layers},
                      {"TransitionalLayer", s.fade_layers},
                      {"WaitHeight", lift_mm},
                      {"SupportWaitHeight", lift_mm},
                      {"WaitBeforePrint", 0},
                      {"WaitAfterPrint", 0},
                      {"SupportWaitBeforePrint", 0},
                      {"SupportWaitAfterPrint", 0},
                      {"FillColor", "#ffffff"},
                      {"BlankColor", "#000000"},
                      {"CustomValues", Json::object()}});
  if (!r.preview.pixels.empty()) output.add("3d.png", encode_png(framed(r.preview, 607, 487)));
}

class NanoDlp final : public ArchiveFormat {
 public:
  explicit NanoDlp(bool rgb) : rgb_(rgb) {}
  std::string_view name() const override { return rgb_ ? "rgb-nanodlp" : "nanodlp"; }
  std::string_view what() const override {
    return rgb_ ? "NanoDLP plate for colour panels"
                : "NanoDLP plate for monochrome panels, three pixels in each RGB pixel";
  }
  std::vector<std::string_view> endings() const override {
    if (rgb_) return {".rgb.nanodlp"};
    return {".nanodlp"};
  }
  bool packs_rgb() const override { return !rgb_; }
  bool says_heights() const override { return true; }

  bool recognises(const Container& archive) const override {
    if (!archive.has(kMetaEntry) || !archive.has(kPlateEntry)) return false;
    if (!rgb_) return true;
    try {
      return is_rgb(archive);
    } catch (const InputError&) {
      // Not recognised here: the usual kind then says what is wrong.
      return false;
    }
  }
  ArchiveContents read(const Container& archive) const override { return read_nanodlp(archive); }

  std::vector<std::string> write(const ArchiveRequest& r, ContainerOutput& output) const override {
    warn_of_mode(r, "NanoDLP");
    if (r.kept != nullptr) {
      std::vector<std::string> names = continued_names(r, ".png");
      change_nanodlp(r, output);
      return names;
    }
    if (!rgb_ && r.info.grid.width_px % 3 != 0) {
      warn(r, fmt::format("images are {} pixels wide, which is no multiple of three: UVtools does "
                          "not open such archives",
                          r.info.grid.width_px));
    }
    make_new(r, !rgb_, output);
    std::vector<std::string> names;
    for (int n = 1; n <= r.info.grid.layers; ++n) names.push_back(std::to_string(n) + ".png");
    return names;
  }

 private:
  bool rgb_;
};

}  // namespace

const ArchiveFormat& nanodlp_format() {
  static const NanoDlp format(false);
  return format;
}

const ArchiveFormat& rgb_nanodlp_format() {
  static const NanoDlp format(true);
  return format;
}

}  // namespace slicecorr::detail
