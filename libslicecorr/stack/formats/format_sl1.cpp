// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// SL1 and SL1S: what PrusaSlicer exports for Prusa's resin printers, and for many others.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "slicecorr/error.hpp"
#include "slicecorr/image_size.hpp"
#include "stack/formats/archive_format.hpp"
#include "stack/formats/format_times.hpp"
#include "stack/formats/uvj_config.hpp"
#include "stack/png/preview.hpp"

namespace slicecorr::detail {
namespace {

constexpr const char* kSl1Config = "config.ini";
constexpr const char* kSl1Settings = "prusaslicer.ini";
constexpr int kNameDigits = 5;

/// What an image's name is before its digits; nothing when it is no name of an image.
std::optional<std::string> sl1_prefix_of(std::string_view name) {
  constexpr std::string_view ending = ".png";
  if (!name.ends_with(ending) || name.find('/') != name.npos) return std::nullopt;
  name.remove_suffix(ending.size());
  if (name.size() < kNameDigits) return std::nullopt;
  const std::string_view digits = name.substr(name.size() - kNameDigits);
  if (digits.find_first_not_of("0123456789") != digits.npos) return std::nullopt;
  return std::string(name.substr(0, name.size() - kNameDigits));
}

/// The images' common prefix: that of the job, else the only one there is.
std::string image_prefix(const Container& archive, const std::string& context) {
  std::vector<std::string> prefixes;
  for (const Container::Entry& entry : archive.entries()) {
    const auto prefix = sl1_prefix_of(entry.name);
    if (prefix && std::find(prefixes.begin(), prefixes.end(), *prefix) == prefixes.end()) {
      prefixes.push_back(*prefix);
    }
  }
  if (prefixes.size() == 1) return prefixes.front();
  if (std::find(prefixes.begin(), prefixes.end(), context) != prefixes.end()) return context;
  if (prefixes.empty()) {
    throw InputError(archive.path(), "",
                     "has no layer images, expected " + context + "00000.png on");
  }
  throw InputError(archive.path(), kSl1Config,
                   "jobDir is " + shown_name(context) + ", but images are named otherwise: " +
                       shown_name(prefixes[0]) + ", " + shown_name(prefixes[1]));
}

std::string image_name(const std::string& prefix, int layer) {
  return fmt::format("{}{:05}.png", prefix, layer);
}

/// Displays of the models that old archives name without saying their size.
struct Model {
  std::string_view name;
  int width_px, height_px;
  double pixel_um;
};
constexpr Model kModels[] = {
    {"SL1", 1440, 2560, 47.25}, {"SL1S", 1620, 2560, 50}, {"M1", 1620, 2560, 50}};

void read_display(const KeyValueText& config, const std::optional<KeyValueText>& settings,
                  ArchiveContents& contents) {
  StackInfo& info = contents.info;
  Grid& grid = info.grid;
  if (settings) {
    const auto width_mm = settings->number("display_width", 0, 1e5);
    const auto height_mm = settings->number("display_height", 0, 1e5);
    const auto x_px = settings->number("display_pixels_x", 1, kMostPixelsAcross);
    const auto y_px = settings->number("display_pixels_y", 1, kMostPixelsAcross);
    info.orientation_known = settings->find("display_orientation").has_value();
    info.orientation.portrait = settings->find("display_orientation") == "portrait";
    info.orientation.mirror_x = settings->find("display_mirror_x") == "1";
    info.orientation.mirror_y = settings->find("display_mirror_y") == "1";
    info.machine_height_mm =
        machine_height_of(lift_number(*settings, "max_print_height").value_or(0));
    if (width_mm && height_mm && x_px && y_px && *width_mm > 0 && *height_mm > 0) {
      const double x_um = std::round(*width_mm / *x_px * 1e9) / 1e6;
      const double y_um = std::round(*height_mm / *y_px * 1e9) / 1e6;
      const bool turned = info.orientation.portrait;
      grid.pixel_x_um = turned ? y_um : x_um;
      grid.pixel_y_um = turned ? x_um : y_um;
      const double across = turned ? *y_px : *x_px, down = turned ? *x_px : *y_px;
      if (grid.width_px != across || grid.height_px != down) {
        contents.warnings.push_back(fmt::format("images are {} x {} pixels, {} says {:g} x {:g}",
                                                grid.width_px, grid.height_px, kSl1Settings, across,
                                                down));
      }
      return;
    }
  }
  const std::string model = config.find("printerModel").value_or("");
  for (const Model& m : kModels) {
    if (model != m.name || grid.width_px != m.width_px || grid.height_px != m.height_px) continue;
    grid.pixel_x_um = grid.pixel_y_um = m.pixel_um;
    info.orientation = {true, true, false};
    info.orientation_known = true;
  }
}

/// Reads exposures as the printer's firmware does: the first layer has the first time, layers from
/// fade - 1 on the normal one, those between in equal steps.
void read_exposure(const KeyValueText& config, StackInfo& info) {
  info.exposure_s = config.number("expTime", 0, 1e6).value_or(0);
  const double first_s = config.number("expTimeFirst", 0, 1e6).value_or(0);
  const auto fade = static_cast<int>(config.number("numFade", 0, 1e6).value_or(0));
  if (info.exposure_s > 0 && first_s > 0 && first_s != info.exposure_s) {
    info.bottom_exposure_s = first_s;
    info.bottom_layers = 1;
    info.fade_layers = std::max(0, fade - 2);
  }
}

/// A vat that tilts takes a time for layers with little area, and another for those with much; which
/// these are is not said, but how many: each layer gets the mean.
void read_tilts(const KeyValueText& config, const std::optional<KeyValueText>& settings,
                StackInfo& info) {
  info.own_print_time_s = lift_number(config, "printTime").value_or(0);
  if (!settings) return;
  const auto fast_s = lift_number(*settings, "fast_tilt_time"),
             slow_s = lift_number(*settings, "slow_tilt_time");
  const double fast = config.number("numFast", 0, 1e6).value_or(0),
               slow = config.number("numSlow", 0, 1e6).value_or(0);
  if (!fast_s || !slow_s || !(fast + slow > 0)) return;
  LiftTimes lifts;
  lifts.normal.tilt_s = (fast * *fast_s + slow * *slow_s) / (fast + slow);
  take_lifts(std::move(lifts), info);
}

/// Numbers as PrusaSlicer writes them.
struct Times {
  double normal_s, first_s;
  int fade;
};

Times times_of(const ArchiveRequest& r) {
  const ExposureSummary s = head_summary(r.info);
  const bool longer_first = s.bottom_layers + s.fade_layers > 0;
  if (r.warnings && s.uneven) {
    r.warnings->push_back(
        longer_first
            ? fmt::format(
                  "SL1 archives have no exposure time of their own for each layer: {:g} s is written for "
                  "the first, {:g} s for all others, and {} in even steps between",
                  s.bottom_s, s.normal_s,
                  s.fade_layers == 1 ? "1 layer" : fmt::format("{} layers", s.fade_layers))
            : fmt::format(
                  "SL1 archives have no exposure time of their own for each layer: {:g} s is "
                  "written for all",
                  s.normal_s));
  }
  if (!longer_first) return {s.normal_s, s.normal_s, 2};
  if (r.warnings && s.bottom_layers > 1) {
    r.warnings->push_back(fmt::format(
        "an SL1 printer gives the longer first exposure to one layer, not to {}", s.bottom_layers));
  }
  return {s.normal_s, s.bottom_s, s.fade_layers + 2};
}

void change_sl1(const ArchiveRequest& r, ContainerOutput& output) {
  const std::string path = r.kept->path();
  KeyValueText config(r.kept->text(kSl1Config), '=', path, kSl1Config);
  const std::string before = config.text();
  const int layers = r.info.grid.layers;
  if (layers != r.kept_contents->info.grid.layers) {
    const auto slow = static_cast<int>(config.number("numSlow", 0, 1e6).value_or(0));
    config.set("numFast", std::to_string(layers - std::min(slow, layers)));
    if (config.find("numSlow")) config.set("numSlow", std::to_string(std::min(slow, layers)));
  }
  if (r.exposure_changes) {
    const Times t = times_of(r);
    config.set("expTime", number_text(t.normal_s));
    config.set("expTimeFirst", number_text(t.first_s));
    config.set("numFade", std::to_string(t.fade));
    if (r.kept->has(kSl1Settings)) {
      KeyValueText settings(r.kept->text(kSl1Settings), '=', path, kSl1Settings);
      settings.set("exposure_time", number_text(t.normal_s));
      settings.set("initial_exposure_time", number_text(t.first_s));
      settings.set("faded_layers", std::to_string(t.fade));
      output.add_text(kSl1Settings, settings.text());
    }
  }
  if (config.text() != before) output.add_text(kSl1Config, config.text());
}

/// A printer takes what it knows: names of profiles, sizes, times. Sorted, as PrusaSlicer does.
void make_new(const ArchiveRequest& r, ContainerOutput& output) {
  const StackInfo& info = r.info;
  const Grid& g = info.grid;
  const Times t = times_of(r);
  const auto or_else = [](const std::string& text, const char* other) {
    return text.empty() ? std::string(other) : text;
  };
  const bool turned = info.orientation.portrait;
  const int x_px = turned ? g.height_px : g.width_px, y_px = turned ? g.width_px : g.height_px;
  const double x_um = turned ? g.pixel_y_um : g.pixel_x_um;
  const double y_um = turned ? g.pixel_x_um : g.pixel_y_um;
  const double width_mm = std::round(x_px * x_um * 1e6) / 1e9;
  const double height_mm = std::round(y_px * y_um * 1e6) / 1e9;
  const std::string layer_mm = number_text(std::round(g.layer_um * 1e6) / 1e9);
  const auto its = std::find_if(std::begin(kModels), std::end(kModels), [&](const Model& m) {
    return m.width_px == g.width_px && m.height_px == g.height_px;
  });
  const std::string model(its != std::end(kModels) ? its->name : "SL1");
  if (its == std::end(kModels)) {
    warn(r, fmt::format(
                "no printer of this format has {} x {} pixels: the file names an SL1, which has "
                "{} x {}",
                g.width_px, g.height_px, kModels[0].width_px, kModels[0].height_px));
  }
  const std::string material =
      or_else(info.profiles.material, info.resin ? info.resin->name.c_str() : "slicecorr");
  const std::string printer =
      or_else(info.profiles.printer, info.printer ? info.printer->name.c_str() : "slicecorr");
  const std::string print = or_else(info.profiles.print, "slicecorr");
  double light_s = 0;
  for (int n = 0; n < g.layers; ++n) light_s += light_on_of_layer(info, n);
  output.add_text(
      kSl1Config,
      fmt::format("action = print\nexpTime = {}\nexpTimeFirst = {}\nexpUserProfile = 0\n"
                  // No clock time: the same stack gives the same bytes.
                  "fileCreationTimestamp = 1980-01-01 at 00:00:00 UTC\nhollow = 0\njobDir = {}\n"
                  "layerHeight = {}\nmaterialName = {}\nnumFade = {}\nnumFast = {}\nnumSlow = 0\n"
                  "printProfile = {}\nprintTime = {:.6f}\nprinterModel = {}\nprinterProfile = {}\n"
                  "printerVariant = default\nprusaSlicerVersion = PrusaSlicer-2.5.0\n"
                  "usedMaterial = {:.6f}\n",
                  number_text(t.normal_s), number_text(t.first_s), r.stem, layer_mm, material,
                  t.fade, g.layers, print, light_s, model, printer, info.part_volume_mm3 * 1e-3));
  const std::string bed =
      fmt::format("0x0,{0}x0,{0}x{1},0x{1}", number_text(width_mm), number_text(height_mm));
  output.add_text(
      kSl1Settings,
      fmt::format(
          "absolute_correction = 0\narea_fill = 50\nbed_shape = {}\ndisplay_height = {}\n"
          "display_mirror_x = {}\ndisplay_mirror_y = {}\ndisplay_orientation = {}\n"
          "display_pixels_x = {}\ndisplay_pixels_y = {}\ndisplay_width = {}\n"
          "elefant_foot_compensation = 0\nexposure_time = {}\nfaded_layers = {}\n"
          "gamma_correction = 1\ninitial_exposure_time = {}\ninitial_layer_height = {}\n"
          "layer_height = {}\nmax_print_height = {}\npad_enable = 0\nprinter_model = {}\n"
          "printer_settings_id = {}\nprinter_technology = SLA\nprinter_variant = default\n"
          "relative_correction = 1,1\nsla_material_settings_id = {}\nsla_print_settings_id = {}\n"
          "slice_closing_radius = 0\nsupports_enable = 0\n",
          bed, number_text(height_mm), int{info.orientation.mirror_x},
          int{info.orientation.mirror_y}, turned ? "portrait" : "landscape", x_px, y_px,
          number_text(width_mm), number_text(t.normal_s), t.fade, number_text(t.first_s), layer_mm,
          layer_mm, number_text(new_machine_height_mm(info, g.layers * g.layer_um * 1e-3)), model,
          printer, material, print));
  if (!r.preview.pixels.empty()) {
    output.add("thumbnail/thumbnail400x400.png", encode_png(framed(r.preview, 400, 400)));
    output.add("thumbnail/thumbnail800x480.png", encode_png(framed(r.preview, 800, 480)));
  }
}

class Sl1 final : public ArchiveFormat {
 public:
  std::string_view name() const override { return "sl1"; }
  std::string_view what() const override { return "Prusa SL1 and SL1S, as PrusaSlicer exports it"; }
  std::vector<std::string_view> endings() const override { return {".sl1", ".sl1s", ".m1"}; }
  bool recognises(const Container& archive) const override { return archive.has(kSl1Config); }
  // People build machines of their own that read it.
  PrintersLift printers_lift() const override { return PrintersLift::as_a_rule; }

  ArchiveContents read(const Container& archive) const override {
    const std::string& path = archive.path();
    const KeyValueText config(archive.text(kSl1Config), '=', path, kSl1Config);
    std::optional<KeyValueText> settings;
    if (archive.has(kSl1Settings)) {
      settings.emplace(archive.text(kSl1Settings), '=', path, kSl1Settings);
    }
    ArchiveContents contents;
    StackInfo& info = contents.info;
    const std::string prefix = image_prefix(archive, config.find("jobDir").value_or(""));
    std::vector<NumberedEntry> images = numbered_entries(archive, prefix, ".png");
    std::erase_if(images,
                  [&](const NumberedEntry& e) { return sl1_prefix_of(e.entry->name) != prefix; });
    // Some old programs count from 1.
    const long first = !images.empty() && images.front().number == 1 ? 1 : 0;
    contents.images = complete_names(archive, images, first, image_name(prefix, 0) + " on");
    info.grid.layers = static_cast<int>(contents.images.size());
    const auto slow = config.number("numSlow", 0, 1e6), fast = config.number("numFast", 0, 1e6);
    if (slow && fast && *slow + *fast != info.grid.layers) {
      const int counted = static_cast<int>(*slow + *fast);
      if (counted > info.grid.layers) {
        throw InputError(path, image_name(prefix, info.grid.layers),
                         fmt::format("is missing: {} has {} layers", kSl1Config, counted));
      }
      contents.warnings.push_back(fmt::format("{} says {} layers, there are {} images", kSl1Config,
                                              counted, info.grid.layers));
    }
    const ImageSize size = image_size(archive, contents.images.front());
    info.grid.width_px = size.width_px;
    info.grid.height_px = size.height_px;
    info.grid.layer_um = std::round(config.number("layerHeight", 0, 1).value_or(0) * 1e9) / 1e6;
    if (settings) {
      if (info.grid.layer_um == 0) {
        info.grid.layer_um =
            std::round(settings->number("layer_height", 0, 1).value_or(0) * 1e9) / 1e6;
      }
      const double first_um = settings->number("initial_layer_height", 0, 10).value_or(0) * 1e3;
      if (first_um > 0) {
        for (int n = 0; n < info.grid.layers; ++n) {
          contents.z_mm.push_back((first_um + n * info.grid.layer_um) * 1e-3);
        }
      }
    }
    if (config.number("calibrateRegions", 0, 1e6).value_or(0) > 0) {
      contents.warnings.emplace_back(
          "is a calibration print: the printer shows its regions with other exposure times");
    }
    read_display(config, settings, contents);
    read_exposure(config, info);
    read_tilts(config, settings, info);
    info.target_layers = info.grid.layers;
    info.profiles.printer = config.find("printerProfile").value_or("");
    if (info.profiles.printer.empty()) {
      info.profiles.printer = config.find("printerModel").value_or("");
    }
    info.profiles.material = config.find("materialName").value_or("");
    info.profiles.print = config.find("printProfile").value_or("");
    return contents;
  }

  std::vector<std::string> write(const ArchiveRequest& r, ContainerOutput& output) const override {
    std::vector<std::string> names;
    std::string prefix = r.stem;
    if (!lifts(r.info)) warn_of_mode(r, "SL1", printers_lift());
    if (r.kept != nullptr) {
      change_sl1(r, output);
      names = r.kept_contents->images;
      prefix = *sl1_prefix_of(names.front());
    } else {
      make_new(r, output);
    }
    int next = static_cast<int>(names.size());
    if (next > 0 && names.front() == image_name(prefix, 1)) ++next;
    while (static_cast<int>(names.size()) < r.info.grid.layers) {
      names.push_back(image_name(prefix, next++));
    }
    names.resize(static_cast<std::size_t>(r.info.grid.layers));
    return names;
  }
};

}  // namespace

const ArchiveFormat& sl1_format() {
  static const Sl1 format;
  return format;
}

}  // namespace slicecorr::detail
