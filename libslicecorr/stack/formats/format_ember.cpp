// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Autodesk Ember: zip and tar.gz.

#include <fmt/format.h>

#include <charconv>
#include <cmath>

#include "slicecorr/error.hpp"
#include "stack/formats/archive_format.hpp"
#include "stack/formats/format_times.hpp"
#include "stack/formats/layer_settings.hpp"
#include "support/json/json_node.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr::detail {
namespace {

using Json = nlohmann::ordered_json;

constexpr const char* kSettingsEntry = "printsettings";
constexpr const char* kLayersEntry = "layersettings.csv";
constexpr const char* kImagePrefix = "slice_";
constexpr const char* kImageSuffix = ".png";

// Names of settings in the printer's firmware.
constexpr const char* kRootKey = "Settings";
constexpr const char* kLayerUmKey = "LayerThicknessMicrons";
constexpr const char* kBurnInLayersKey = "BurnInLayers";
constexpr const char* kFirstKey = "FirstExposureSec";
constexpr const char* kBurnInKey = "BurnInExposureSec";
constexpr const char* kModelKey = "ModelExposureSec";

/// The printer's display: 64 mm x 40 mm.
constexpr int kDisplayWidthPx = 1280, kDisplayHeightPx = 800;
constexpr double kDisplayPixelUm = 50;

constexpr double kMostS = 1e6;

Json parse_settings(const Container& archive) {
  return read_json<Json>(archive.text(kSettingsEntry), {archive.path(), kSettingsEntry});
}

/// The first firmware's portal put numbers in quotes, and that firmware read them.
std::optional<double> number_at(const Json& settings, const char* key, double least, double most,
                                const JsonSource& place) {
  const auto found = settings.find(key);
  if (found == settings.end()) return std::nullopt;
  const JsonNode<Json> node(*found, std::string(kRootKey) + "." + key, place);
  if (!found->is_string()) return node.number(least, most);
  const std::string text = found->get<std::string>();
  double number = NAN;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc() || end != text.data() + text.size() ||
      !(number >= least && number <= most)) {
    node.fail("a number from " + number_text(least) + " to " + number_text(most));
  }
  return number;
}

/// Exposures as the firmware knows them: of layer 1, of the burn-in layers after it, of all others.
struct Exposures {
  std::optional<double> first_s, burn_in_s, model_s;
  int burn_in_layers = 0;
  const std::optional<double>& of_layer(int layer) const {  ///< from 1
    return layer == 1 ? first_s : layer <= 1 + burn_in_layers ? burn_in_s : model_s;
  }
  const char* key_of_layer(int layer) const {
    return layer == 1 ? kFirstKey : layer <= 1 + burn_in_layers ? kBurnInKey : kModelKey;
  }
};

Exposures exposures_of(const Json& settings, const JsonSource& place) {
  Exposures e;
  e.first_s = number_at(settings, kFirstKey, 0, kMostS, place);
  e.burn_in_s = number_at(settings, kBurnInKey, 0, kMostS, place);
  e.model_s = number_at(settings, kModelKey, 0, kMostS, place);
  e.burn_in_layers = whole(number_at(settings, kBurnInLayersKey, 0, kMaxLayers, place), place.file,
                           place.entry, kBurnInLayersKey)
                         .value_or(0);
  return e;
}

bool says_exposure(const LayerSettings& table) {
  return table.has(kFirstKey) || table.has(kBurnInKey) || table.has(kModelKey);
}

/// Light-on time of each layer, where all are said.
std::vector<double> ember_times(const Exposures& e, const LayerSettings* table, int layers) {
  std::vector<double> times_s;
  for (int n = 1; n <= layers; ++n) {
    std::optional<double> time_s = e.of_layer(n);
    if (table != nullptr) {
      if (const auto own_s = table->number(n, e.key_of_layer(n), kMostS)) time_s = own_s;
    }
    if (!time_s) return {};
    times_s.push_back(*time_s);
  }
  return times_s;
}

void read_settings(const Container& archive, ArchiveContents& contents) {
  StackInfo& info = contents.info;
  const JsonSource place{archive.path(), kSettingsEntry};
  Exposures exposures;
  if (archive.has(kSettingsEntry)) {
    const Json json = parse_settings(archive);
    const JsonNode<Json> root(json, "", place);
    const JsonNode<Json> settings = root[kRootKey];
    settings.has(kLayerUmKey);  // an object
    const Json& values = json[kRootKey];
    if (const auto um = number_at(values, kLayerUmKey, 1, 1000, place)) info.grid.layer_um = *um;
    exposures = exposures_of(values, place);
    if (settings.has("JobName")) info.profiles.print = settings["JobName"].string();
  }
  std::optional<LayerSettings> table;
  if (archive.has(kLayersEntry)) {
    table.emplace(archive.text(kLayersEntry), archive.path(), kLayersEntry);
    double z_mm = 0;
    for (int n = 1; n <= info.grid.layers; ++n) {
      z_mm += table->number(n, kLayerUmKey, 10000).value_or(info.grid.layer_um) * 1e-3;
      contents.z_mm.push_back(z_mm);
    }
  }
  info.exposure_s = exposures.model_s.value_or(0);
  if (exposures.first_s && exposures.first_s != exposures.model_s) {
    info.bottom_exposure_s = *exposures.first_s;
    info.bottom_layers = 1;
    if (exposures.burn_in_s == exposures.first_s) info.bottom_layers += exposures.burn_in_layers;
  }
  take_layer_times(ember_times(exposures, table ? &*table : nullptr, info.grid.layers), info);
}

/// What a stack's exposures are in the printer's settings. `table` is needed where these can't say
/// them.
struct NewExposures {
  Exposures settings;
  bool table = false;
};

NewExposures new_exposures(const StackInfo& info) {
  const ExposureSummary s = head_summary(info);
  NewExposures e;
  e.settings.model_s = s.normal_s;
  e.settings.first_s = e.settings.burn_in_s = s.bottom_layers > 0 ? s.bottom_s : s.normal_s;
  e.settings.burn_in_layers = std::max(0, s.bottom_layers - 1);
  e.table = s.uneven || s.fade_layers > 0;
  return e;
}

/// Sets the time of a layer, whichever of the kinds the printer takes the layer for.
void set_times(int layer, double time_s, LayerSettings& table) {
  for (const char* key : {kFirstKey, kBurnInKey, kModelKey}) {
    table.set(layer, key, number_text(time_s));
  }
}

void fill_table(const StackInfo& info, LayerSettings& table) {
  for (int n = 0; n < info.grid.layers; ++n) set_times(n + 1, light_on_of_layer(info, n), table);
}

void set(Json& settings, const char* key, const Json& value, bool& changed) {
  const auto found = settings.find(key);
  if (found != settings.end() && *found == value) return;
  settings[key] = value;
  changed = true;
}

void set_exposures(const Exposures& e, Json& settings, bool& changed) {
  set(settings, kFirstKey, *e.first_s, changed);
  set(settings, kBurnInLayersKey, e.burn_in_layers, changed);
  set(settings, kBurnInKey, *e.burn_in_s, changed);
  set(settings, kModelKey, *e.model_s, changed);
}

std::string dumped(const Json& json) {
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

void warn_of_light(const ArchiveRequest& r) {
  for (int n = 0; n < r.info.grid.layers; ++n) {
    if (light_of_layer(r.info, n).share == 1) continue;
    warn(r, "the Ember can't dim single layers, which this stack needs while the stage ramps");
    return;
  }
}

/// Layers that are added to an archive whose times stay, and get others than its settings say.
void add_rows(const ArchiveRequest& r, ContainerOutput& output) {
  const int before = r.kept_contents->info.grid.layers;
  Exposures said;
  if (r.kept->has(kSettingsEntry)) {
    said = exposures_of(parse_settings(*r.kept)[kRootKey], {r.kept->path(), kSettingsEntry});
  }
  std::optional<LayerSettings> table;
  for (int n = before + 1; n <= r.info.grid.layers; ++n) {
    const double time_s = light_on_of_layer(r.info, n - 1);
    if (time_s == said.of_layer(n).value_or(0)) continue;
    if (!table) {
      table.emplace(r.kept->has(kLayersEntry) ? r.kept->text(kLayersEntry) : "Layer\r\n",
                    r.kept->path(), kLayersEntry);
    }
    set_times(n, time_s, *table);
  }
  if (table) output.add_text(kLayersEntry, table->text());
}

void change_ember(const ArchiveRequest& r, ContainerOutput& output) {
  if (!r.exposure_changes) {
    add_rows(r, output);
    return;
  }
  warn_of_light(r);
  const NewExposures e = new_exposures(r.info);
  bool changed = false;
  Json json = Json::object();
  if (r.kept->has(kSettingsEntry)) json = parse_settings(*r.kept);
  set_exposures(e.settings, json[kRootKey], changed);
  if (changed) output.add_text(kSettingsEntry, dumped(json));
  std::optional<LayerSettings> table;
  std::string before;
  if (r.kept->has(kLayersEntry)) {
    before = r.kept->text(kLayersEntry);
    table.emplace(before, r.kept->path(), kLayersEntry);
    if (!e.table && !says_exposure(*table)) return;
  } else if (e.table) {
    table.emplace(std::vector<std::string>{});
  }
  if (!table) return;
  fill_table(r.info, *table);
  if (const std::string text = table->text(); text != before) output.add_text(kLayersEntry, text);
}

void write_new(const ArchiveRequest& r, ContainerOutput& output) {
  const StackInfo& info = r.info;
  const Grid& grid = info.grid;
  if (grid.width_px != kDisplayWidthPx || grid.height_px != kDisplayHeightPx ||
      grid.pixel_x_um != kDisplayPixelUm || grid.pixel_y_um != kDisplayPixelUm) {
    warn(r, fmt::format("the Ember shows {} x {} pixels of {:g} um, this stack has {} x {} of {:g} "
                        "x {:g} um",
                        kDisplayWidthPx, kDisplayHeightPx, kDisplayPixelUm, grid.width_px,
                        grid.height_px, grid.pixel_x_um, grid.pixel_y_um));
  }
  const auto layer_um = static_cast<int>(std::lround(grid.layer_um));
  if (layer_um != grid.layer_um) {
    warn(r, fmt::format("the Ember takes whole micrometres: layers of {:g} um become {} um",
                        grid.layer_um, layer_um));
  }
  // The printer refuses settings that it does not know, and takes its own for those that are not
  // there.
  Json settings = {{"JobName", r.stem}, {kLayerUmKey, layer_um}};
  const NewExposures e = new_exposures(info);
  bool changed = false;
  if (*e.settings.model_s > 0) set_exposures(e.settings, settings, changed);
  Json json;
  json[kRootKey] = settings;
  output.add_text(kSettingsEntry, dumped(json));
  if (!e.table) return;
  LayerSettings table(std::vector<std::string>{});
  fill_table(info, table);
  output.add_text(kLayersEntry, table.text());
  warn_of_light(r);
}

class Ember final : public ArchiveFormat {
 public:
  explicit Ember(ContainerKind kind) : kind_(kind) {}
  std::string_view name() const override { return is_tar() ? "ember-tar" : "ember"; }
  std::string_view what() const override {
    return is_tar() ? "tar.gz of the Autodesk Ember" : "zip of the Autodesk Ember";
  }
  std::vector<std::string_view> endings() const override {
    if (is_tar()) return {".tar.gz", ".tgz"};
    return {".zip"};
  }
  ContainerKind container() const override { return kind_; }

  bool recognises(const Container& archive) const override {
    return archive.kind() == kind_ &&
           (archive.has(kSettingsEntry) ||
            !numbered_entries(archive, kImagePrefix, kImageSuffix).empty());
  }

  ArchiveContents read(const Container& archive) const override {
    ArchiveContents contents;
    StackInfo& info = contents.info;
    contents.images = complete_names(archive, numbered_entries(archive, kImagePrefix, kImageSuffix),
                                     1, "slice_1.png on");
    if (contents.images.size() > static_cast<std::size_t>(kMaxLayers)) {
      throw InputError(
          archive.path(), "",
          fmt::format("has {} images, expected at most {}", contents.images.size(), kMaxLayers));
    }
    info.grid.layers = info.target_layers = static_cast<int>(contents.images.size());
    take_image_size(archive, {}, {}, "", false, contents);
    if (info.grid.width_px == kDisplayWidthPx && info.grid.height_px == kDisplayHeightPx) {
      info.grid.pixel_x_um = info.grid.pixel_y_um = kDisplayPixelUm;
    }
    read_settings(archive, contents);
    contents.layer_step_um = 1;
    return contents;
  }

  std::vector<std::string> write(const ArchiveRequest& r, ContainerOutput& output) const override {
    if (r.kept == nullptr || r.exposure_changes) warn_of_mode(r, "Ember");
    if (r.kept != nullptr) {
      change_ember(r, output);
      return continued_names(r, kImageSuffix);
    }
    write_new(r, output);
    std::vector<std::string> names;
    for (int n = 1; n <= r.info.grid.layers; ++n) {
      names.push_back(fmt::format("{}{}{}", kImagePrefix, n, kImageSuffix));
    }
    return names;
  }

 private:
  bool is_tar() const { return kind_ == ContainerKind::tar_gz; }
  ContainerKind kind_;
};

}  // namespace

const ArchiveFormat& ember_zip_format() {
  static const Ember format(ContainerKind::zip);
  return format;
}

const ArchiveFormat& ember_tar_format() {
  static const Ember format(ContainerKind::tar_gz);
  return format;
}

}  // namespace slicecorr::detail
