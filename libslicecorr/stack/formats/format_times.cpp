// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/formats/format_times.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "slicecorr/error.hpp"
#include "slicecorr/image_size.hpp"
#include "stack/formats/uvj_config.hpp"

namespace slicecorr::detail {
namespace {

double checked_um(double mm, const Container& archive, const std::string& says, const char* what) {
  const double um = um_of_mm(mm);
  if (um == 0) return 0;
  if (!(um >= 1 && um <= 1000)) {
    throw InputError(archive.path(), says,
                     fmt::format("says {} of {:g} um, expected 1 to 1000 um", what, um));
  }
  return um;
}

}  // namespace

double um_of_mm(double mm) { return std::round(mm * 1e9) / 1e6; }
double mm_of_um(double um) { return std::round(um * 1e6) / 1e9; }

std::optional<int> whole(std::optional<double> value, const std::string& file,
                         const std::string& entry, const std::string& key) {
  if (!value) return std::nullopt;
  if (*value != std::floor(*value) || std::abs(*value) > 1e9) {
    throw InputError(file, entry, key + " is " + number_text(*value) + ", expected a whole number");
  }
  return static_cast<int>(*value);
}

void take_image_size(const Container& archive, std::optional<int> width_px,
                     std::optional<int> height_px, const std::string& says, bool may_be_packed,
                     ArchiveContents& contents) {
  if (contents.images.size() > kMaxLayers) {
    throw InputError(
        archive.path(), "",
        fmt::format("has {} layers, expected at most {}", contents.images.size(), kMaxLayers));
  }
  const std::string& first = contents.images.front();
  const ImageSize size = image_size(archive, first);
  const int width = width_px && *width_px > 0 ? *width_px : size.width_px;
  const int height = height_px && *height_px > 0 ? *height_px : size.height_px;
  const bool packed = may_be_packed && size.channels == 3 && size.width_px == (width + 2) / 3;
  if ((size.width_px != width && !packed) || size.height_px != height) {
    const std::string packing =
        may_be_packed ? fmt::format(", or {} x {} in RGB", (width + 2) / 3, height) : "";
    throw InputError(archive.path(), first,
                     fmt::format("is {} x {} pixels{}, expected {} x {}{}, as {} says",
                                 size.width_px, size.height_px, size.channels == 3 ? " in RGB" : "",
                                 width, height, packing, says));
  }
  if (!is_image_size(width, height)) {
    throw InputError(
        archive.path(), first,
        fmt::format("is {} x {} pixels, expected at most {} pixels", width, height, kMostPixels));
  }
  contents.packed_rgb = packed;
  contents.info.grid.width_px = width;
  contents.info.grid.height_px = height;
}

double pixel_um(double pixel_mm, const Container& archive, const std::string& says) {
  return checked_um(pixel_mm, archive, says, "pixels");
}

double layer_um(double layer_mm, const Container& archive, const std::string& says) {
  return checked_um(layer_mm, archive, says, "layers");
}

void take_layer_times(std::vector<double> times_s, StackInfo& info) {
  if (times_s.empty()) return;
  if (info.exposure_s == 0) info.exposure_s = times_s.back();
  const auto layers = static_cast<int>(times_s.size());
  const int bottom = info.bottom_exposure_s > 0 ? std::min(info.bottom_layers, layers) : 0;
  const auto fits = [&](int fade) {
    for (int n = 0; n < layers; ++n) {
      double expected_s = n < bottom ? info.bottom_exposure_s : info.exposure_s;
      if (n >= bottom && n < bottom + fade) {
        expected_s = info.bottom_exposure_s +
                     (info.exposure_s - info.bottom_exposure_s) * (n - bottom + 1) / (fade + 1);
      }
      if (!same_time(times_s[static_cast<std::size_t>(n)], expected_s)) return false;
    }
    return true;
  };
  if (fits(info.fade_layers)) return;
  int fade = 0;
  while (bottom > 0 && bottom + fade < layers &&
         !same_time(times_s[static_cast<std::size_t>(bottom + fade)], info.exposure_s)) {
    ++fade;
  }
  if (fade > 0 && fits(fade)) {
    info.fade_layers = fade;
    return;
  }
  info.layer_exposure_s = std::move(times_s);
}

void take_light(const std::vector<double>& light, double full, const std::string& file,
                const std::string& says, StackInfo& info, std::vector<std::string>* warnings) {
  if (light.empty()) return;
  if (std::all_of(light.begin(), light.end(), [](double l) { return l == 0; })) {
    if (warnings) {
      warnings->push_back(fmt::format(
          "says that all layers are lit with 0 of {:g}, which no printer heeds: they are "
          "taken as lit fully",
          full));
    }
    return;
  }
  std::vector<double> shares;
  for (std::size_t n = 0; n < light.size(); ++n) {
    if (!(light[n] >= 0 && light[n] <= full)) {
      throw InputError(
          file, says,
          fmt::format("says that layer {} is lit with {:g} of {:g}; expected more than 0 "
                      "and at most {:g}",
                      n, light[n], full, full));
    }
    shares.push_back(light[n] / full);
  }
  while (shares.size() > 1 && shares.back() == shares[shares.size() - 2]) shares.pop_back();
  if (shares.size() > 1 || shares.front() != 1) info.light_share = std::move(shares);
}

void check_lit(const StackInfo& info, const std::string& file) {
  for (std::size_t n = 0; n < info.light_share.size(); ++n) {
    if (info.light_share[n] > 0) continue;
    throw InputError(
        file, "", fmt::format("says that layer {} is lit with 0 of 255; expected more than 0", n));
  }
}

LightSteps light_steps(const ArchiveRequest& request, const std::string& path, int bottom_layers) {
  constexpr double full = 255;
  LightSteps steps;
  for (int n = 0; n < request.info.grid.layers; ++n) {
    const double exact = full * share_of_layer(request.info, n);
    const double step = std::round(exact);
    if (std::abs(exact - step) > 0.02 || step < 1) {
      throw InputError(
          path, "",
          fmt::format("says light in steps of 1/255, so it can't say {:g} of full light; "
                      "expected a whole number of steps, as {:.6g}",
                      share_of_layer(request.info, n), std::max(1.0, step) / full));
    }
    steps.layers.push_back(static_cast<unsigned>(step));
  }
  if (steps.layers.empty()) return steps;
  steps.usual = steps.layers.back();
  steps.bottom = bottom_layers > 0 ? steps.layers.front() : steps.usual;
  for (std::size_t n = 0; n < steps.layers.size(); ++n) {
    const bool bottom = n < static_cast<std::size_t>(bottom_layers);
    steps.uneven |= steps.layers[n] != (bottom ? steps.bottom : steps.usual);
  }
  return steps;
}

void refuse_other_light(const ArchiveRequest& request, const std::string& entry) {
  if (!request.light_changes) return;
  throw InputError(
      request.kept->path(), entry,
      "light of layers is not changed in archives of this format; expected the light that "
      "the archive says, or a new archive");
}

double last_layer_mm(const ArchiveRequest& request) {
  const StackInfo& kept = request.kept_contents->info;
  return (kept.layer_heights_um.empty() ? request.info.grid.layer_um
                                        : kept.layer_heights_um.back()) *
         1e-3;
}

void tell_own_settings(const ArchiveRequest& request, std::string_view format) {
  warn(request,
       fmt::format(
           "layers have times or light of their own: the new {} file lists them and says that "
           "printers are to heed the list, which some do not",
           format));
}

void tell_unheeded_times(const std::vector<double>& times_s, const StackInfo& info,
                         std::vector<std::string>& warnings) {
  for (std::size_t n = 0; n < times_s.size(); ++n) {
    const double counts_s = light_on_of_layer(info, static_cast<int>(n));
    if (same_time(times_s[n], counts_s)) continue;
    warnings.push_back(fmt::format(
        "lists {:g} s for layer {}, and others, but its mark says that printers do not heed times of single "
        "layers: those of its head count, {:g} s there, {}",
        times_s[n], n, counts_s, exposures_in_words(process_of_times(info))));
    return;
  }
}

double LiftNumbers::at(std::size_t at) {
  const double value = block_.f32(at);
  if (value >= 0 && value <= kMostLiftNumber) return value;
  known_ = false;
  return 0;
}

std::optional<double> lift_number(const KeyValueText& text, std::string_view key) {
  const auto value = text.find(key);
  const auto number = value ? leading_number(*value) : std::nullopt;
  if (!number || !(number->value >= 0 && number->value <= kMostLiftNumber)) return std::nullopt;
  return number->value;
}

void take_lifts(LiftTimes lifts, StackInfo& info) {
  const auto makes_sense = [](const LiftMotion& m) {
    const bool lifted = m.up_mm + m.up_2_mm > 0;
    return (m.up_mm == 0 || m.up_mm_s > 0) && (m.up_2_mm == 0 || m.up_2_mm_s > 0) &&
           (!lifted || m.back_mm_s > 0 || m.back_2_mm >= m.up_mm + m.up_2_mm) &&
           (m.back_2_mm == 0 || m.back_2_mm_s > 0);
  };
  if (!makes_sense(lifts.normal) || (lifts.bottom_layers > 0 && !makes_sense(lifts.bottom)) ||
      !std::all_of(lifts.layers.begin(), lifts.layers.end(), makes_sense)) {
    return;
  }
  lifts.by_archive = true;
  if (!lifts.layers.empty()) {
    LiftTimes without = lifts;
    without.layers.clear();
    bool same = true;
    for (std::size_t n = 0; n < lifts.layers.size() && same; ++n) {
      same = lifts.layers[n] == without.of(static_cast<int>(n));
    }
    if (same) lifts.layers.clear();
  }
  info.lift_times = std::move(lifts);
}

std::vector<std::string> continued_names(const ArchiveRequest& request, std::string_view suffix) {
  std::vector<std::string> names = request.kept_contents->images;
  const auto layers = static_cast<std::size_t>(request.info.grid.layers);
  if (names.size() > layers) {
    throw InputError(request.kept->path(), "",
                     fmt::format("has {} layers, expected at most the {} of the stack that is put "
                                 "in place",
                                 names.size(), layers));
  }
  if (names.size() == layers) return names;
  const std::string stem = names.back().substr(0, names.back().size() - suffix.size());
  const std::size_t digits = stem.find_last_not_of("0123456789") + 1;  // npos + 1 is 0
  const std::size_t width = stem.size() - digits;
  const std::string prefix = stem.substr(0, digits);
  for (long number = std::stol(stem.substr(digits)) + 1; names.size() < layers; ++number) {
    names.push_back(fmt::format("{}{:0{}}{}", prefix, number, width, suffix));
    if (request.kept->has(names.back())) {
      throw InputError(request.kept->path(), names.back(),
                       "is in the way of a layer that is to be added");
    }
  }
  return names;
}

void warn(const ArchiveRequest& request, std::string text) {
  if (request.warnings != nullptr) request.warnings->push_back(std::move(text));
}

NewLift new_lift(const StackInfo& info) {
  NewLift lift;
  if (!lifts(info)) return lift;
  lift.mm = kLiftMm;
  if (!info.printer || !info.printer->lift_motion || info.printer->lift_motion->up_mm == 0)
    return lift;
  const LiftMotion& m = *info.printer->lift_motion;
  constexpr double s_per_min = 60;
  return {m.up_mm, m.up_mm_s * s_per_min, m.back_mm_s * s_per_min, m.before_light_s, true};
}

void tell_new_lift(const ArchiveRequest& request, std::string_view format, const NewLift& lift) {
  warn(
      request,
      fmt::format("a new {} file says lifts of {:g} mm at {:g} mm/min, back at {:g} mm/min{}",
                  format, lift.mm, lift.up_mm_min, lift.back_mm_min,
                  lift.of_printer
                      ? fmt::format(", and {:g} s of rest, as the printer file does", lift.wait_s)
                      : ": set what the printer needs, or give a file of the printer's slicer as a "
                        "template"));
}

bool lifts(const StackInfo& info) {
  return !(info.process && info.process->mode == ExposureMode::continuous);
}

void warn_of_mode(const ArchiveRequest& request, std::string_view format, PrintersLift lift) {
  const StackInfo& info = request.info;
  if (!lifts(info)) {
    warn(request,
         fmt::format("{} archives can't say that the platform moves while slices are "
                     "shown: each slice is shown for {:g} s, and {}",
                     format, exposure_summary(info).normal_s,
                     lift == PrintersLift::not_known ? "nothing is lifted"
                                                     : "printers that read them lift after each"));
  } else if (exposure_summary(info).normal_s == 0) {
    warn(request,
         "the stack says no exposure times: 0 s is written, which must be set before printing");
  }
}

}  // namespace slicecorr::detail
