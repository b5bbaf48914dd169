// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "slicecorr/error.hpp"
#include "slicecorr/image_size.hpp"
#include "stack/block_check.hpp"
#include "stack/formats/definition_json.hpp"
#include "stack/formats/even_light_json.hpp"
#include "stack/formats/format_times.hpp"
#include "stack/formats/uvj_config.hpp"
#include "stack/recording_entry.hpp"
#include "support/json/json_node.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr::detail {
namespace {

using SortedJson = nlohmann::json;

constexpr double kLargest = JsonSource::kLargest;

using SortedNode = JsonNode<SortedJson>;

/// What the layers that say it say of light-on times, light and places, in order.
struct LayerTimes {
  std::vector<double> time_s;
  std::vector<double> light, z_mm;  ///< light of 255, -1 where a layer says none
  std::size_t layers = 0;           ///< seen so far
  bool all = true;                  ///< every layer says one
};

constexpr double kFullPwm = 255;

/// Takes what is needed of one layer.
void read_layer(const SortedJson& layer, const JsonSource& place, LayerTimes& times) {
  const SortedNode node(layer, "Layers[" + std::to_string(times.layers++) + "]", place);
  if (node.has("Z")) times.z_mm.push_back(node["Z"].number(0, 1e6));
  times.light.push_back(-1);
  // A layer may have no exposure; it gets one when times are changed.
  if (!node.has("Exposure") || node["Exposure"].json().is_null() ||
      !node["Exposure"].has("LightOnTime")) {
    times.all = false;
    return;
  }
  times.time_s.push_back(node["Exposure"]["LightOnTime"].number(0, 1e9));
  if (node["Exposure"].has("LightPWM")) {
    times.light.back() = node["Exposure"]["LightPWM"].number(0, kFullPwm);
  }
}

SortedJson parse_json(std::string_view text, const JsonSource& place, LayerTimes& times) {
  // Byte order marks are common in JSON written on Windows.
  if (text.starts_with("\xef\xbb\xbf")) text.remove_prefix(3);
  // There may be a million layers: each is dropped as soon as its time has been read.
  using Event = SortedJson::parse_event_t;
  bool in_layers = false, in_list = false;
  const auto keep = [&](int depth, Event event, SortedJson& value) {
    if (depth == 1) {
      if (event == Event::key) in_layers = value == "Layers";
      in_list = in_layers && event == Event::array_start;
    }
    const bool whole =
        event == Event::object_end || event == Event::array_end || event == Event::value;
    if (!in_list || depth != 2 || !whole) return true;
    read_layer(value, place, times);
    return false;
  };
  return read_json<SortedJson>(text, place, kManyLayers, keep);
}

/// Millimetres to micrometres, without the noise that the division by pixels left.
double tidy_um(double um) { return std::round(um * 1e6) / 1e6; }

double scale_um(double um, double least, double most, const SortedNode& node) {
  if (!(um >= least && um <= most)) {
    const auto text = [](double v) { return std::to_string(static_cast<int>(v)); };
    node.fail("what makes " + text(least) + " to " + text(most) + " um each");
  }
  return um;
}

/// Lifts of a slicer; our own stacks say 0, which is nothing.
LiftMotion read_lift(const SortedNode& node) {
  bool known = true;
  const auto number = [&](const char* key) {
    if (!node.has(key)) return 0.0;
    const double value = node[key].json().is_number() ? node[key].json().get<double>() : -1;
    known = known && value >= 0 && value <= kMostLiftNumber;
    return value;
  };
  LiftMotion m;
  m.up_mm = number("LiftHeight");
  m.up_mm_s = number("LiftSpeed") / 60;
  m.back_mm_s = number("RetractSpeed") / 60;
  m.light_off_s = number("LightOffTime");
  return known ? m : LiftMotion{};
}

void read_properties(const SortedNode& properties, StackInfo& info) {
  const SortedNode size = properties["Size"];
  Grid& grid = info.grid;
  grid.width_px = size["X"].integer(1, kMostPixelsAcross);
  grid.height_px = size["Y"].integer(1, kMostPixelsAcross);
  if (!is_image_size(grid.width_px, grid.height_px)) {
    size["X"].fail("images of at most " + std::to_string(kMostPixels) + " pixels");
  }
  // Millimetre sizes are of the whole image, LayerHeight is of one layer.
  const SortedNode mm = size["Millimeter"];
  grid.pixel_x_um = scale_um(tidy_um(mm["X"].positive() / grid.width_px * 1000), 1, 1000, mm["X"]);
  grid.pixel_y_um = scale_um(tidy_um(mm["Y"].positive() / grid.height_px * 1000), 1, 1000, mm["Y"]);
  grid.layers = size["Layers"].integer(1, 1000000);
  const SortedNode height = size["LayerHeight"];
  grid.layer_um = scale_um(tidy_um(height.positive() * 1000), 1, 1000, height);
  info.target_layers = grid.layers;
  if (properties.has("Exposure") && properties["Exposure"].has("LightOnTime")) {
    info.exposure_s = properties["Exposure"]["LightOnTime"].number(0, 1e9);
  }
  if (properties.has("Bottom")) {
    const SortedNode bottom = properties["Bottom"];
    const int count = bottom.has("Count") ? bottom["Count"].integer(0, 1000000) : 0;
    const double time_s = bottom.has("LightOnTime") ? bottom["LightOnTime"].number(0, 1e9) : 0;
    if (count > 0 && time_s > 0) {
      info.bottom_layers = count;
      info.bottom_exposure_s = time_s;
    }
  }
  if (properties.has("Exposure") && properties["Exposure"].json().is_object()) {
    LiftTimes lifts;
    lifts.normal = read_lift(properties["Exposure"]);
    lifts.bottom_layers = info.bottom_layers;
    if (info.bottom_layers > 0) lifts.bottom = read_lift(properties["Bottom"]);
    if (lifts.normal.up_mm > 0) take_lifts(std::move(lifts), info);
  }
  if (properties.has("AntiAliasLevel")) properties["AntiAliasLevel"].whole(0, 255);
}

std::vector<double> read_numbers(const SortedNode& node, double least) {
  std::vector<double> numbers;
  for (const SortedNode& n : node.list(0, 1000000)) numbers.push_back(n.number(least, 1e9));
  return numbers;
}

/// Most that numbers of a schedule may be.
constexpr double kMostOfSchedule = 1e9;

void read_setting(const Setting& s, const SortedNode& node, Process& p) {
  if (const auto* number = std::get_if<double Process::*>(&s.process)) {
    // What is not said is 0, but where it is a factor; speeds may be any.
    const double most =
        s.block == BlockPart::correction ? std::min(s.range.most, kLargest) : kMostOfSchedule;
    p.*(*number) = s.or_inf && node.is_text("inf")
                       ? kLargest
                       : node.number(s.range.above ? 0 : s.range.least, most);
  } else if (const auto* count = std::get_if<int Process::*>(&s.process)) {
    p.*(*count) = node.integer(static_cast<int>(s.range.least), static_cast<int>(s.range.most));
  } else if (const auto* list = std::get_if<std::vector<double> Process::*>(&s.process)) {
    p.*(*list) = read_numbers(node, 0);
  } else {
    std::vector<std::string> words;
    for (const std::string_view word : s.words) words.push_back(block_word(word));
    std::get<ProcessWord>(s.process).set(p, node.choice(words));
  }
}

void read_settings(const SortedNode& node, Process& p, BlockPart part) {
  for (const Setting& s : settings()) {
    if (s.block != part) continue;
    const std::string key = block_key(s);
    if (!s.changed_only || node.has(key.c_str())) read_setting(s, node[key.c_str()], p);
  }
}

/// Reads what the block has from version 2 on: schedules of exposure, UV light, ramps.
void read_schedule(const SortedNode& node, Process& p) {
  read_settings(node, p, BlockPart::exposure);
  const SortedNode uv = node["uv"];
  p.uv.kind = static_cast<UvKind>(uv["kind"].choice(kNamesOfUv));
  p.uv.uv_mw_cm2 = uv["uv_mw_cm2"].number(0, kMostOfSchedule);
  p.uv.dead_zone_um = uv["dead_zone_um"].number(0, kMostOfSchedule);
  p.uv.slice_mw_cm2 = read_numbers(uv["slice_mw_cm2"], 0);
  read_settings(node, p, BlockPart::stage);
  if (node.has("light_share")) {
    for (const SortedNode& n : node["light_share"].list(1, 1000000)) n.positive(1);
  }
  if (node.has("layer_heights_um")) {
    for (const SortedNode& n : node["layer_heights_um"].list(1, 1000000)) n.positive(1000);
  }
  if (p.mode == ExposureMode::layerwise) {
    node["exposure_s"].positive(kMostOfSchedule);
    if (node.has("slice_speed_mm_h")) {
      node["slice_speed_mm_h"].refuse("is for continuous exposure");
    }
  } else if (node.has("slice_speed_mm_h")) {
    for (const SortedNode& n : node["slice_speed_mm_h"].list(1, 1000000)) n.positive(p.speed_mm_h);
  }
}

Process read_process(const SortedNode& node, ExposureMode mode, std::int64_t format) {
  Process p;
  p.mode = mode;
  read_settings(node, p, BlockPart::correction);
  if (mode == ExposureMode::continuous) node["speed_mm_h"].positive();
  if (format >= 2) read_schedule(node, p);
  if (node.has("even_dead_zone")) {
    p.even_dead_zone = static_cast<EvenDeadZone>(
        node["even_dead_zone"].choice({"off", "constant", "blue", "uv", "both"}));
    if (node.has("even_light")) p.even_light = read_even_light(node["even_light"]);
  }
  return p;
}

/// Takes the exact value from our block. Where the archive rounds to `step_um`, its own stays: that
/// is what its readers print.
void refine(double& um, const SortedNode& exact, const char* of, std::vector<std::string>& warnings,
            double step_um = 0) {
  const double value = exact.positive();
  // Sizes of pixels went through divisions by pixels per millimetre; some formats round heights to
  // nanometres.
  if (std::abs(value - um) <= 1e-3 * um) {
    um = value;
  } else if (std::abs(value - um) <= 0.501 * step_um) {
    warnings.push_back(fmt::format("{} is {} um, as the archive rounds the {} um of the stack", of,
                                   number_text(um), number_text(value)));
  } else {
    exact.refuse(fmt::format(
        "contradicts itself: {} is {} um in the block of the stack, {} um in the archive; expected "
        "the stack as `slicecorr` wrote it. For other sizes slice and correct the part again",
        of, number_text(value), number_text(um)));
  }
}

RecordingFacts read_recording_facts(const SortedNode& node, int images) {
  RecordingFacts facts;
  facts.slices = node["slices"].integer(0, kMaxRecordedSlices);
  facts.showings = node["parts"].integer(0, kMaxRecordedShowings);
  facts.crc32 = static_cast<std::uint32_t>(node["crc32"].whole(0, 0xffffffff));
  for (const SortedNode& n : node["other_uv_images"].list(0, 1000000)) {
    facts.other_uv_images.push_back(n.integer(0, images - 1));
  }
  return facts;
}

void read_block(const SortedNode& block, ArchiveContents& config) {
  StackInfo& info = config.info;
  const auto format = block["format"].whole(1, 1000000);
  if (format > kUvjBlockFormat) {
    block.refuse("made by a newer version of this program: format " + std::to_string(format) +
                 ", this program reads up to " + std::to_string(kUvjBlockFormat));
  }
  std::vector<std::string> kinds{"target", "corrected", "foreign"};
  if (format >= 4) kinds.emplace_back("recorded");
  if (format == 5) kinds.resize(1);
  constexpr StackKind kind_of[]{StackKind::target, StackKind::corrected, StackKind::foreign,
                                StackKind::recorded};
  info.kind = kind_of[block["kind"].choice(kinds)];
  const std::vector<std::string> modes = format >= 2
                                             ? std::vector<std::string>{"continuous", "layerwise"}
                                             : std::vector<std::string>{"continuous"};
  const ExposureMode mode =
      block["mode"].choice(modes) == 1 ? ExposureMode::layerwise : ExposureMode::continuous;
  info.program = block["program"].string();
  info.target_layers = block["target_layers"].integer(0, 1000000);
  info.part_volume_mm3 = block["part_volume_mm3"].number(0, kLargest);
  if (block.has("grid")) {
    const SortedNode grid = block["grid"];
    refine(info.grid.pixel_x_um, grid["pixel_x_um"], "the width of pixels", config.warnings);
    refine(info.grid.pixel_y_um, grid["pixel_y_um"], "the height of pixels", config.warnings);
    refine(info.grid.layer_um, grid["layer_um"], "the height of layers", config.warnings,
           config.layer_step_um);
  }
  // Whoever reads a corrected stack needs to know what it was corrected for.
  const bool needed = info.kind == StackKind::corrected || info.kind == StackKind::recorded;
  if (needed || block.has("printer")) info.printer = read_printer(block["printer"]);
  if (block.has("machine_height_mm")) {
    info.machine_height_mm = block["machine_height_mm"].positive(kLargest);
  }
  if (info.printer && info.printer->flat_field) {
    config.flat_field_crc32 =
        static_cast<std::uint32_t>(block["printer"]["flat_field"]["crc32"].whole(0, 0xffffffff));
  }
  if (info.printer && info.printer->uv_flat_field) {
    config.uv_flat_field_crc32 =
        static_cast<std::uint32_t>(block["printer"]["uv_flat_field"]["crc32"].whole(0, 0xffffffff));
  }
  if (block.has("frame")) {
    block["frame"]["images"].choice({"display"});
    info.for_display = true;
    info.orientation_known = block["frame"].has("orientation");
    if (info.orientation_known) {
      info.orientation = read_orientation(block["frame"]["orientation"]);
    }
  }
  if (block.has("made_for")) info.made_for = read_shrinkage(block["made_for"]);
  if (needed || block.has("resin")) info.resin = read_resin(block["resin"]);
  if (needed || block.has("process")) {
    info.process = read_process(block["process"], mode, format);
  }
  if (block.has("original_sha256")) {
    info.original_sha256 = block["original_sha256"].string();
    const bool hex =
        info.original_sha256.find_first_not_of("0123456789abcdef") == std::string::npos;
    if (!hex || info.original_sha256.size() != 64) {
      block["original_sha256"].fail("64 hex digits, in lower case");
    }
  }
  if (info.kind == StackKind::recorded) {
    if (!info.process->layer_heights_um.empty()) {
      block["process"]["layer_heights_um"].refuse("is not for recordings, whose slices are alike");
    }
    config.recording = read_recording_facts(block["recording"], info.grid.layers);
  }
  if (info.kind != StackKind::foreign) {
    config.images_crc32 = static_cast<std::uint32_t>(block["images_crc32"].whole(0, 0xffffffff));
  }
  if (block.has("uv_images_crc32")) {
    config.uv_images_crc32 =
        static_cast<std::uint32_t>(block["uv_images_crc32"].whole(0, 0xffffffff));
  }
  if (format == 5 || block.has("edge_images_crc32")) {
    config.edge_images_crc32 =
        static_cast<std::uint32_t>(block["edge_images_crc32"].whole(0, 0xffffffff));
    info.has_edge_heights = true;
  }
  if (block.has(kBlockCrc32Key)) {
    const auto crc = static_cast<std::uint32_t>(block[kBlockCrc32Key].whole(0, 0xffffffff));
    info.parameters_checked = crc == block_crc32(block.json());
    config.block_changed = !info.parameters_checked;
  } else {
    config.warnings.emplace_back(
        "has no checksum of its parameters: an earlier version of this program made it, or it was "
        "changed since; what it says is taken as it stands");
  }
}

}  // namespace

namespace {

/// Light of single layers counts over that of the properties.
void take_uvj_light(const LayerTimes& times, const SortedNode& properties, const std::string& file,
                    StackInfo& info, std::vector<std::string>& warnings) {
  const auto layers = static_cast<std::size_t>(info.grid.layers);
  std::vector<double> light = times.light;
  light.resize(layers, -1);
  // Layers that say none have that of the properties.
  if (std::any_of(light.begin(), light.end(), [](double l) { return l < 0; })) {
    const auto said = [&](const char* part, double otherwise) {
      if (!properties.has(part) || !properties[part].json().is_object()) return otherwise;
      const SortedNode node = properties[part];
      return node.has("LightPWM") ? node["LightPWM"].number(0, kFullPwm) : otherwise;
    };
    const double usual = said("Exposure", kFullPwm), bottom = said("Bottom", usual);
    for (std::size_t n = 0; n < layers; ++n) {
      if (light[n] < 0) light[n] = static_cast<int>(n) < info.bottom_layers ? bottom : usual;
    }
  }
  if (info.kind == StackKind::corrected || info.kind == StackKind::recorded) {
    // The process counts; what the archive says is only held against it.
    for (double& l : light) l /= kFullPwm;
    if (std::any_of(light.begin(), light.end(), [](double l) { return l != 1; })) {
      info.light_share = std::move(light);
    }
    return;
  }
  take_light(light, kFullPwm, file, "config.json", info, &warnings);
}

/// The light-on times of single layers count over those of the properties.
void take_layer_times(LayerTimes times, StackInfo& info) {
  if (!times.all || static_cast<int>(times.time_s.size()) != info.grid.layers) return;
  const auto [least, greatest] = std::minmax_element(times.time_s.begin(), times.time_s.end());
  // Layers of continuous prints without a speed say 0.
  if (*greatest == 0) return;
  if (info.exposure_s == 0) info.exposure_s = times.time_s.back();
  if (*least == info.exposure_s && *greatest == info.exposure_s) return;
  detail::take_layer_times(std::move(times.time_s), info);
}

}  // namespace

ArchiveContents parse_uvj_config(std::string_view text, const std::string& file) {
  const JsonSource place{file, "config.json"};
  LayerTimes times;
  const SortedJson json = parse_json(text, place, times);
  const SortedNode root(json, "", place);
  ArchiveContents config;
  if (root.has("kind") && root["kind"].is_text("beams")) {
    root.refuse(
        "is that of a print with beams, not of slices: `printbridge print` shows it, "
        "`slicecorr beams` makes another; expected a stack");
  }
  read_properties(root["Properties"], config.info);
  if (root.has("Layers")) {
    root["Layers"].list(0, 1000000);
    take_layer_times(times, config.info);
    if (times.z_mm.size() == times.layers) config.z_mm = times.z_mm;
  }
  if (root.has("slicecorr")) read_block(root["slicecorr"], config);
  take_uvj_light(times, root["Properties"], file, config.info, config.warnings);
  // Images of a recording are no layers.
  if (config.info.kind == StackKind::recorded) config.z_mm.clear();
  return config;
}

void read_provenance(std::string_view text, const std::string& file, ArchiveContents& contents) {
  const JsonSource place{file, kProvenanceEntry};
  LayerTimes none;
  const SortedJson json = parse_json(text, place, none);
  const SortedNode root(json, "", place);
  Grid& grid = contents.info.grid;
  if (root.has("grid")) {
    // Exact values for what the archive does not say; what it says counts, see `refine`.
    const SortedNode exact = root["grid"];
    if (grid.pixel_x_um == 0) grid.pixel_x_um = exact["pixel_x_um"].positive();
    if (grid.pixel_y_um == 0) grid.pixel_y_um = exact["pixel_y_um"].positive();
    if (grid.layer_um == 0) grid.layer_um = exact["layer_um"].positive();
  }
  read_block(root, contents);
  if (contents.info.has_edge_heights) {
    root["format"].refuse("speaks of edge heights, which only UVJ archives have");
  }
  if (!contents.info.process || contents.info.process->uv.kind != UvKind::patterned) return;
  for (int n = 0; n < grid.layers; ++n) contents.uv_images.push_back(uv_image_name(n));
}

}  // namespace slicecorr::detail
