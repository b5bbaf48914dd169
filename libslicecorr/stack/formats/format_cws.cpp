// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// CWS: slices of Creation Workshop and NovaMaker. NAME0000.png, ... and NAME.gcode, whose head has
// the settings as ";(Key = value unit )"; NovaMaker adds slice.conf, Creation Workshop
// manifest.xml. Monochrome panels that are wired as colour ones get three neighbouring pixels in
// one RGB pixel.

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <pugixml.hpp>

#include "slicecorr/error.hpp"
#include "slicecorr/image_size.hpp"
#include "slicecorr/version.hpp"
#include "stack/formats/format_times.hpp"
#include "stack/formats/layer_gcode.hpp"
#include "stack/formats/read_xml.hpp"

namespace slicecorr::detail {
namespace {

constexpr const char* kConfigEntry = "slice.conf";
constexpr const char* kCwsManifest = "manifest.xml";

/// What the text says of a key, as far as it is a number: "4000 ms )" is 4000.
std::optional<double> parameter(const KeyValueText& text, const char* key, double most,
                                const std::string& file, const std::string& entry) {
  const auto value = text.find(key);
  if (!value) return std::nullopt;
  const auto number = leading_number(*value);
  if (!number || !(number->value >= 0 && number->value <= most)) {
    throw InputError(file, entry,
                     fmt::format("{} is {}, expected a number from 0 to {:g}",
                                 *key == '(' ? key + 1 : key, shown_name(*value), most));
  }
  return number->value;
}

/// Replaces the number, leaving what follows it.
void set_parameter(KeyValueText& text, const char* key, const std::string& number) {
  const auto value = text.find(key);
  if (!value) return;
  // It was read before, so there is one.
  const auto old = leading_number(*value);
  if (old) text.set(key, number + value->substr(old->length));
}

/// Top-level entries that end like this.
std::vector<std::string> names_ending(const Container& archive, std::string_view ending) {
  std::vector<std::string> names;
  for (const Container::Entry& e : archive.entries()) {
    if (e.name.ends_with(ending) && e.name.find('/') == std::string::npos) names.push_back(e.name);
  }
  return names;
}

/// What the names of images have before their digits: what most of them have.
std::string common_prefix(const Container& archive) {
  std::map<std::string, int> counts;
  for (const std::string& name : names_ending(archive, ".png")) {
    const std::size_t stem = name.size() - 4;
    const std::size_t digits = name.substr(0, stem).find_last_not_of("0123456789") + 1;
    if (digits < stem) ++counts[name.substr(0, digits)];
  }
  const auto most = std::max_element(counts.begin(), counts.end(),
                                     [](auto& a, auto& b) { return a.second < b.second; });
  return most == counts.end() ? "" : most->first;
}

/// The G-code and the beginning of the images' names, which are the same as a rule.
struct Names {
  std::string gcode, prefix;
};

Names names_of(const Container& archive) {
  const std::vector<std::string> gcodes = names_ending(archive, ".gcode");
  for (const std::string& gcode : gcodes) {
    const std::string stem = gcode.substr(0, gcode.size() - 6);
    if (!numbered_entries(archive, stem, ".png").empty()) return {gcode, stem};
  }
  if (gcodes.size() > 1) {
    throw InputError(archive.path(), gcodes[1],
                     "is a second G-code, expected one that is named like the images");
  }
  if (gcodes.empty()) return {"", common_prefix(archive)};
  return {gcodes.front(), common_prefix(archive)};
}

/// What both texts say of the same things.
struct CwsSettings {
  std::optional<KeyValueText> config, head;
  std::string file, gcode;

  CwsSettings(const Container& archive, const std::string& gcode_entry,
              const std::string& gcode_text)
      : file(archive.path()), gcode(gcode_entry) {
    if (archive.has(kConfigEntry)) {
      config.emplace(archive.text(kConfigEntry), '=', file, kConfigEntry);
    }
    if (!gcode_entry.empty()) {
      head.emplace(gcode_text.substr(0, end_of_head(gcode_text)), '=', file, gcode_entry, ";");
    }
  }
  /// `slice.conf` counts; a key that only one of them has may be null.
  std::optional<double> number(const char* config_key, const char* head_key, double most) const {
    std::optional<double> value;
    if (config && config_key) value = parameter(*config, config_key, most, file, kConfigEntry);
    if (!value && head && head_key) value = parameter(*head, head_key, most, file, gcode);
    return value;
  }
  std::optional<int> count(const char* config_key, const char* head_key, double most) const {
    return whole(number(config_key, head_key, most), file, config ? kConfigEntry : gcode,
                 config_key);
  }
  double size_um(const char* config_key, const char* head_key, const char* display_key, int pixels,
                 const Container& archive) const {
    const std::string says = config ? kConfigEntry : gcode;
    const double per_mm = number(config_key, head_key, 1e5).value_or(0);
    if (per_mm > 0) return pixel_um(1 / per_mm, archive, says);
    return pixel_um(number(nullptr, display_key, 1e5).value_or(0) / pixels, archive, says);
  }
};

ArchiveContents read_cws(const Container& archive) {
  const std::string& path = archive.path();
  const Names names = names_of(archive);
  const std::string text = names.gcode.empty() ? "" : archive.text(names.gcode, kMaxGcodeBytes);
  const CwsSettings settings(archive, names.gcode, text);
  ArchiveContents contents;
  StackInfo& info = contents.info;
  Grid& grid = info.grid;
  contents.images = complete_names(archive, numbered_entries(archive, names.prefix, ".png"), 0,
                                   shown_name(names.prefix) + "0000.png on");
  grid.layers = info.target_layers = static_cast<int>(contents.images.size());
  const int said = settings.count("layers_num", "Number of Slices", kMaxLayers).value_or(0);
  if (said > 0 && said < grid.layers) {
    throw InputError(path, settings.config ? kConfigEntry : names.gcode,
                     fmt::format("says {} slices, but there are {} images", said, grid.layers));
  }
  if (said > grid.layers) {
    contents.warnings.push_back(
        fmt::format("has {} of {} slices, the last ones are missing: those that are there are read",
                    grid.layers, said));
  }
  take_image_size(archive, settings.count("xres", "(X Resolution", kMostPixelsAcross),
                  settings.count("yres", "(Y Resolution", kMostPixelsAcross),
                  settings.config ? kConfigEntry : names.gcode, true, contents);
  contents.packed_bgr = contents.packed_rgb;
  grid.pixel_x_um =
      settings.size_um("xppm", "(Pix per mm X", "(Platform X Size", grid.width_px, archive);
  grid.pixel_y_um =
      settings.size_um("yppm", "(Pix per mm Y", "(Platform Y Size", grid.height_px, archive);
  grid.layer_um = layer_um(settings.number("thickness", "(Layer Thickness", 1e5).value_or(0),
                           archive, settings.config ? kConfigEntry : names.gcode);
  const auto is_true = [&](const char* key) {
    const auto value = settings.head ? settings.head->find(key) : std::nullopt;
    return value && value->starts_with("True");
  };
  info.orientation.mirror_x = is_true("(Flip X");
  info.orientation.mirror_y = is_true("(Flip Y");
  if (settings.head) {
    info.machine_height_mm =
        machine_height_of(lift_number(*settings.head, "(Platform Z Size").value_or(0));
  }
  info.exposure_s = settings.number("layers_expo_ms", "(Layer Time", 1e9).value_or(0) / 1000;
  const double bottom_s =
      settings.number("head_layers_expo_ms", "(Bottom Layers Time", 1e9).value_or(0) / 1000;
  const int bottom =
      settings.count("head_layers_num", "(Number of Bottom Layers", kMaxLayers).value_or(0);
  if (bottom_s > 0 && bottom > 0) {
    info.bottom_exposure_s = bottom_s;
    info.bottom_layers = bottom;
  }
  if (!names.gcode.empty()) {
    const LayerGcode body(text.substr(end_of_head(text)), kCwsGcode, path, names.gcode);
    if (!body.shows(grid.layers)) {
      contents.warnings.push_back(
          fmt::format("{} does not show slices 0 to {} in this order: times are those of its head",
                      shown_name(names.gcode), grid.layers - 1));
    } else {
      take_layer_times(body.exposures_s(grid.layers), info);
      // Such programs wait while the platform moves.
      LiftTimes lifts;
      bool waits = false;
      for (const LayerGcode::Layer& layer : body.layers()) {
        LiftMotion m;
        m.before_light_s = layer.dark_ms / 1000;
        waits = waits || layer.dark_ms > 0;
        lifts.layers.push_back(m);
      }
      if (waits) {
        lifts.normal = lifts.layers.back();
        take_lifts(std::move(lifts), info);
      }
      take_light(body.light(grid.layers), 255, path, names.gcode, info, &contents.warnings);
      contents.z_mm = body.places_mm(grid.layers);
    }
    if (const auto machine = settings.head->find("(Machine Type")) {
      info.profiles.printer = machine->substr(0, machine->find_last_not_of(" )") + 1);
    }
  }
  return contents;
}

std::string milliseconds(double s) { return fmt::format("{:.0f}", s * 1000); }

void set_times(KeyValueText& text, const ExposureSummary& s, const char* normal, const char* bottom,
               const char* bottom_layers) {
  set_parameter(text, normal, milliseconds(s.normal_s));
  set_parameter(text, bottom, milliseconds(s.bottom_s));
  set_parameter(text, bottom_layers, std::to_string(s.bottom_layers));
}

std::string xml_text(const std::string& text) {
  std::string out;
  for (const char c : text) {
    out += c == '&' ? "&amp;" : c == '<' ? "&lt;" : c == '>' ? "&gt;" : std::string(1, c);
  }
  return out;
}

/// Lists the added slices after the others, in copies of the last one; all other bytes stay.
void change_manifest(const ArchiveRequest& r, const std::vector<std::string>& names,
                     ContainerOutput& output) {
  std::string text = r.kept->text(kCwsManifest);
  pugi::xml_document document;
  read_xml(document, text, r.kept->path(), kCwsManifest);
  pugi::xml_node slice;
  for (const pugi::xml_node node : document.first_element_by_path("manifest/Slices")) slice = node;
  const std::ptrdiff_t element = slice.offset_debug();
  const std::ptrdiff_t name = slice.child("name").first_child().offset_debug();
  const std::string end_tag = std::string("</") + slice.name() + ">";
  const auto from = static_cast<std::size_t>(std::max<std::ptrdiff_t>(element, 0));
  const std::size_t end = text.find(end_tag, from);
  if (element < 1 || name <= element || end == text.npos) {
    throw InputError(r.kept->path(), kCwsManifest,
                     "lists no slices, expected manifest/Slices/Slice/name");
  }
  // The element with the white space before it.
  const std::size_t begin = text.rfind('>', from - 1) + 1;
  const auto name_begin = static_cast<std::size_t>(name);
  const std::size_t name_end = text.find('<', name_begin), after = end + end_tag.size();
  const std::string before_name = text.substr(begin, name_begin - begin);
  const std::string after_name = text.substr(name_end, after - name_end);
  std::string added;
  for (std::size_t n = r.kept_contents->images.size(); n < names.size(); ++n) {
    added += before_name + xml_text(names[n]) + after_name;
  }
  output.add_text(kCwsManifest, text.insert(after, added));
}

void change_cws(const ArchiveRequest& r, const std::vector<std::string>& images,
                ContainerOutput& output) {
  const Container& kept = *r.kept;
  const int layers = r.info.grid.layers, kept_layers = r.kept_contents->info.grid.layers;
  const Names names = names_of(kept);
  const std::string text = names.gcode.empty() ? "" : kept.text(names.gcode, kMaxGcodeBytes);
  CwsSettings settings(kept, names.gcode, text);
  const auto exposure_s = [&](int layer) -> std::optional<double> {
    if (!r.exposure_changes) return std::nullopt;
    return light_on_of_layer(r.info, layer);
  };
  const LayerGcode body(text.substr(end_of_head(text)), kCwsGcode, kept.path(), names.gcode);
  refuse_other_light(r, names.gcode);
  const bool same_times = !r.exposure_changes || names.gcode.empty() ||
                          body.says(std::min(layers, kept_layers), exposure_s);
  if (layers == kept_layers && same_times) return;
  if (!names.gcode.empty() && !body.shows(kept_layers)) {
    throw InputError(kept.path(), names.gcode,
                     fmt::format("does not show slices 0 to {} in this order, so that neither "
                                 "layers nor times can be changed",
                                 kept_layers - 1));
  }
  const ExposureSummary s = head_summary(r.info);
  if (settings.config) {
    KeyValueText& config = *settings.config;
    const std::string before = config.text();
    // Some archives promise more than they hold.
    if (layers > settings.number("layers_num", nullptr, 1e9).value_or(1e9)) {
      set_parameter(config, "layers_num", std::to_string(layers));
    }
    if (r.exposure_changes) {
      set_times(config, s, "layers_expo_ms", "head_layers_expo_ms", "head_layers_num");
    }
    if (config.text() != before) output.add_text(kConfigEntry, config.text());
  }
  if (settings.head) {
    KeyValueText& head = *settings.head;
    if (layers > settings.number(nullptr, "Number of Slices", 1e9).value_or(1e9)) {
      set_parameter(head, "Number of Slices", std::to_string(layers));
    }
    if (r.exposure_changes) {
      set_times(head, s, "(Layer Time", "(Bottom Layers Time", "(Number of Bottom Layers");
    }
    const std::string changed = head.text() + body.changed(layers, last_layer_mm(r), exposure_s);
    if (changed != text) output.add_text(names.gcode, changed);
  }
  if (layers != kept_layers && kept.has(kCwsManifest)) change_manifest(r, images, output);
}

/// Movements as NovaMaker proposes them.
constexpr double kNovaLiftMm = 4, kNovaMmMin = 120;

std::string mm_text(double value) { return number_text(std::round(value * 1e6) / 1e6); }

/// How far the platform is lifted off the window between layers.
double lift_mm(const StackInfo& info) { return lifts(info) ? kNovaLiftMm : 0; }

std::string new_config(const StackInfo& info) {
  const Grid& g = info.grid;
  const ExposureSummary s = head_summary(info);
  std::string config = fmt::format("# slicecorr {}\n# conf version 1.0\n\n", version);
  const auto say = [&](const char* key, const std::string& value) {
    config += fmt::format("{:<24}= {}\n", key, value);
  };
  say("xppm", number_text(1e3 / g.pixel_x_um));
  say("yppm", number_text(1e3 / g.pixel_y_um));
  say("xres", std::to_string(g.width_px));
  say("yres", std::to_string(g.height_px));
  say("thickness", mm_text(g.layer_um * 1e-3));
  say("layers_num", std::to_string(g.layers));
  say("head_layers_num", std::to_string(s.bottom_layers));
  say("layers_expo_ms", milliseconds(s.normal_s));
  say("head_layers_expo_ms", milliseconds(s.bottom_s));
  say("wait_before_expo_ms", "0");
  say("lift_distance", number_text(lift_mm(info)));
  say("lift_up_speed", number_text(kNovaMmMin));
  say("lift_down_speed", number_text(kNovaMmMin));
  say("lift_when_finished", "80");
  return config;
}

/// The comments and commands before the first layer.
std::string new_gcode_head(const StackInfo& info) {
  const Grid& g = info.grid;
  const ExposureSummary s = head_summary(info);
  const double build_mm =
      new_machine_height_mm(info, stack_height_um(info, g.layers) * 1e-3 + kNovaLiftMm);
  std::string text =
      fmt::format("; slicecorr {}\n;(****Build and Slicing Parameters****)\n", version);
  const auto add = [&](const char* key, const std::string& value) {
    text += fmt::format(";({:<24}= {} )\n", key, value);
  };
  add("Pix per mm X", number_text(1e3 / g.pixel_x_um));
  add("Pix per mm Y", number_text(1e3 / g.pixel_y_um));
  add("X Resolution", std::to_string(g.width_px));
  add("Y Resolution", std::to_string(g.height_px));
  add("Layer Thickness", mm_text(g.layer_um * 1e-3) + " mm");
  add("Layer Time", milliseconds(s.normal_s) + " ms");
  add("Bottom Layers Time", milliseconds(s.bottom_s) + " ms");
  add("Number of Bottom Layers", std::to_string(s.bottom_layers));
  add("Blanking Layer Time", "0 ms");
  add("Build Direction", "Bottom_Up");
  add("Lift Distance", number_text(lift_mm(info)) + " mm");
  add("Slide/Tilt Value", "0");
  add("Anti Aliasing", "True");
  add("Use Mainlift GCode Tab", "False");
  add("Anti Aliasing Value", "2.0");
  add("Z Lift Feed Rate", number_text(kNovaMmMin) + " mm/s");
  add("Z Bottom Lift Feed Rate", number_text(kNovaMmMin) + " mm/s");
  add("Z Lift Retract Rate", number_text(kNovaMmMin) + " mm/s");
  add("Flip X", info.orientation.mirror_x ? "True" : "False");
  add("Flip Y", info.orientation.mirror_y ? "True" : "False");
  text += fmt::format(";Number of Slices         = {}\n", g.layers);
  text += ";(****Machine Configuration ******)\n";
  add("Platform X Size", mm_text(g.width_px * g.pixel_x_um * 1e-3) + "mm");
  add("Platform Y Size", mm_text(g.height_px * g.pixel_y_um * 1e-3) + "mm");
  add("Platform Z Size", mm_text(build_mm) + "mm");
  add("Max X Feedrate", "200mm/s");
  add("Max Y Feedrate", "200mm/s");
  add("Max Z Feedrate", "200mm/s");
  add("Machine Type", "UV_LCD");
  text +=
      "\nG28\nG21 ;Set units to be mm\nG91 ;Relative Positioning\nM17 ;Enable motors\n"
      "<Slice> Blank\nM106 S0\n\n";
  return text;
}

/// As NovaMaker writes them, which the printer itself reads.
void make_new(const ArchiveRequest& r, const std::string& name, ContainerOutput& output) {
  const StackInfo& info = r.info;
  const double up_mm = lift_mm(info);
  const LightSteps light = light_steps(r, r.stem, head_summary(info).bottom_layers);
  output.add_text(kConfigEntry, new_config(info));
  std::string text = new_gcode_head(info);
  bool rounded = false;
  for (int n = 0; n < info.grid.layers; ++n) {
    // The way after a layer is told as that layer's. The printer does not wait for its movements.
    const double layer_mm = layer_height_um(info, n) * 1e-3;
    const double travel_mm = up_mm > 0 ? 2 * up_mm - layer_mm : layer_mm;
    const double light_ms = light_on_of_layer(info, n) * 1e3;
    rounded = rounded || std::abs(light_ms - std::round(light_ms)) > 1e-6;
    text += fmt::format(";<Slice> {}\nM106 S{}\n;<Delay> {:.0f}\nM106 S0\n;<Slice> Blank\n", n,
                        light.layers[static_cast<std::size_t>(n)], light_ms);
    if (up_mm > 0) text += fmt::format("G1 Z{} F{:g}\n", mm_text(up_mm), kNovaMmMin);
    text += fmt::format("G1 Z{} F{:g}\n;<Delay> {:.0f}\n\n", mm_text(layer_mm - up_mm), kNovaMmMin,
                        std::ceil(travel_mm / kNovaMmMin * 60e3));
  }
  text += "M18 ;Disable Motors\nM106 S0\nG1 Z80\n;<Completed>\n";
  output.add_text(name + ".gcode", text);
  if (rounded) warn(r, "CWS archives have times of whole milliseconds: they were rounded");
}

class Cws final : public ArchiveFormat {
 public:
  explicit Cws(bool packed) : packed_(packed) {}
  std::string_view name() const override { return packed_ ? "rgb-cws" : "cws"; }
  std::string_view what() const override {
    return packed_ ? "CWS for monochrome panels, three pixels in each RGB pixel"
                   : "CWS of Creation Workshop and NovaMaker";
  }
  std::vector<std::string_view> endings() const override {
    if (packed_) return {".rgb.cws"};
    return {".cws", ".xml.cws"};
  }
  bool says_light() const override { return true; }
  bool says_heights() const override { return true; }
  bool packs_rgb() const override { return packed_; }
  bool packs_bgr() const override { return packed_; }

  bool recognises(const Container& archive) const override {
    if (!is_cws(archive)) return false;
    if (!packed_) return true;
    try {
      return read_cws(archive).packed_rgb;
    } catch (const InputError&) {
      // Not recognised here: the plain format then says what is wrong.
      return false;
    }
  }
  ArchiveContents read(const Container& archive) const override { return read_cws(archive); }

  std::vector<std::string> write(const ArchiveRequest& r, ContainerOutput& output) const override {
    warn_of_mode(r, "CWS");
    if (r.kept == nullptr || r.exposure_changes) tell_head_times(r, "CWS");
    if (r.kept != nullptr) {
      std::vector<std::string> names = continued_names(r, ".png");
      change_cws(r, names, output);
      return names;
    }
    if (packed_ && r.info.grid.width_px % 3 != 0) {
      warn(r, fmt::format("images are {} pixels wide, which is no multiple of three: UVtools does "
                          "not open such archives",
                          r.info.grid.width_px));
    }
    // Digits at the end would be taken for those of the number.
    std::string name = r.stem;
    if (name.empty() || (name.back() >= '0' && name.back() <= '9')) name += '_';
    make_new(r, name, output);
    const std::size_t digits =
        std::max<std::size_t>(4, std::to_string(r.info.grid.layers - 1).size());
    std::vector<std::string> names;
    names.reserve(static_cast<std::size_t>(r.info.grid.layers));
    for (int n = 0; n < r.info.grid.layers; ++n) {
      names.push_back(fmt::format("{}{:0{}}.png", name, n, digits));
    }
    return names;
  }

 private:
  /// Other formats have G-code, too: where an archive has nothing else, the words in it tell.
  static bool is_cws(const Container& archive) {
    if (archive.has(kConfigEntry)) return true;
    const std::vector<std::string> gcodes = names_ending(archive, ".gcode");
    return std::any_of(gcodes.begin(), gcodes.end(), [&](const std::string& gcode) {
      return archive.text(gcode, kMaxGcodeBytes).find(kCwsGcode.show) != std::string::npos;
    });
  }

  bool packed_;
};

}  // namespace

const ArchiveFormat& cws_format() {
  static const Cws format(false);
  return format;
}

const ArchiveFormat& rgb_cws_format() {
  static const Cws format(true);
  return format;
}

}  // namespace slicecorr::detail
