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

double machine_height_of(double mm) {
  constexpr double most_mm = 1e5, steps_per_mm = 1e4;
  if (!(mm > 0 && mm <= most_mm)) return 0;
  return std::round(mm * steps_per_mm) / steps_per_mm;
}

namespace {

/// An archive that says less than the part is high says no height of a machine: printers' files do.
bool machine_height_known(const StackInfo& info) {
  if (!(info.machine_height_mm > 0)) return false;
  if (info.printer && info.printer->travel_mm == info.machine_height_mm) return true;
  return info.machine_height_mm >= stack_height_um(info, info.grid.layers) * 1e-3 - 1e-6;
}

}  // namespace

double new_machine_height_mm(const StackInfo& info, double otherwise_mm) {
  return machine_height_known(info) ? info.machine_height_mm : std::ceil(otherwise_mm);
}

void take_layer_times(std::vector<double> times_s, StackInfo& info) {
  if (times_s.empty()) return;
  if (info.exposure_s == 0) info.exposure_s = times_s.back();
  const auto layers = static_cast<int>(times_s.size());
  const auto at = [&](int n) { return times_s[static_cast<std::size_t>(n)]; };
  struct Pattern {
    double bottom_s;
    int bottom, fade;
  };
  const auto fits = [&](const Pattern& p) {
    for (int n = 0; n < layers; ++n) {
      double expected_s = n < p.bottom ? p.bottom_s : info.exposure_s;
      if (n >= p.bottom && n < p.bottom + p.fade) {
        expected_s =
            p.bottom_s + (info.exposure_s - p.bottom_s) * (n - p.bottom + 1) / (p.fade + 1);
      }
      if (!same_time(at(n), expected_s)) return false;
    }
    return true;
  };
  const int said = info.bottom_exposure_s > 0 ? std::min(info.bottom_layers, layers) : 0;
  if (fits({info.bottom_exposure_s, said, info.fade_layers})) return;
  // As the head says of first layers, else as the list does: longer ones, and even steps down from them.
  int longer = 0;
  while (longer < layers && at(0) > info.exposure_s && same_time(at(longer), at(0))) ++longer;
  for (Pattern p : {Pattern{info.bottom_exposure_s, said, 0}, Pattern{at(0), longer, 0}}) {
    while (p.bottom > 0 && p.bottom + p.fade < layers &&
           !same_time(at(p.bottom + p.fade), info.exposure_s)) {
      ++p.fade;
    }
    if (p.bottom == 0 || p.bottom + p.fade >= layers || !fits(p)) continue;
    info.bottom_exposure_s = p.bottom_s;
    info.bottom_layers = p.bottom;
    info.fade_layers = p.fade;
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

void tell_head_times(const ArchiveRequest& request, std::string_view format) {
  const ExposureSummary s = head_summary(request.info);
  if (!lifts(request.info) || (!s.uneven && s.fade_layers == 0)) return;
  warn(
      request,
      fmt::format(
          "the head of {} archives says {}{:g} s for all layers{}: times of single layers are in the "
          "G-code, which printers run",
          format,
          s.bottom_layers > 0
              ? fmt::format(
                    "{:g} s for the first {}, and ", s.bottom_s,
                    s.bottom_layers == 1 ? "layer" : fmt::format("{} layers", s.bottom_layers))
              : "",
          s.normal_s, s.bottom_layers > 0 ? " after them" : ""));
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

namespace {

constexpr double kSecondsPerMinute = 60;

/// A motion of which files say all.
LiftMotion without_unsaid(LiftMotion m) {
  m.tilt_s = m.acceleration_mm_s2 = 0;
  return m;
}

bool same_waits(const LiftMotion& a, const LiftMotion& b) {
  return a.before_lift_s == b.before_lift_s && a.after_lift_s == b.after_lift_s &&
         a.before_light_s == b.before_light_s;
}

/// "7 mm at 70 mm/min, back at 150 mm/min, and 0.5 s of rest".
std::string motion_in_words(const LiftMotion& m) {
  const OneStage stage = one_stage(m);
  std::string words = stage.mm > 0 || m.tilt_s == 0
                          ? fmt::format("{:.4g} mm", stage.mm)
                          : fmt::format("none but tilts of {:.4g} s", m.tilt_s);
  if (stage.mm > 0) {
    words +=
        fmt::format(" at {:.4g} mm/min, back at {:.4g} mm/min", stage.up_mm_min, stage.back_mm_min);
  }
  const double rest_s = stage.wait_s - m.tilt_s;
  return words + (rest_s > 1e-6 ? fmt::format(", and {:.4g} s of rest", rest_s) : "");
}

}  // namespace

OneStage one_stage(const LiftMotion& motion) {
  LiftMotion moves = motion;
  moves.before_lift_s = moves.after_lift_s = moves.before_light_s = 0;
  moves.light_off_s = moves.tilt_s = 0;
  const DarkTime moving = dark_time(moves, 0);
  OneStage stage;
  stage.mm = motion.up_mm + motion.up_2_mm;
  if (stage.mm > 0) {
    // To what text says of them.
    const auto rounded = [](double mm_min) { return std::round(mm_min * 1e6) / 1e6; };
    stage.up_mm_min = rounded(kSecondsPerMinute * stage.mm / moving.lift_s);
    stage.back_mm_min = rounded(kSecondsPerMinute * stage.mm / moving.return_s);
  }
  stage.wait_s = std::max(0.0, dark_time(motion, 0).all_s() - moving.all_s());
  return stage;
}

bool NewLift::differs_from_head(int bottom_layers, bool waits) const {
  if (!times.layers.empty()) return true;
  if (times.bottom_layers != bottom_layers && (times.bottom_layers > 0 || bottom_layers > 0) &&
      !(times.bottom == times.normal)) {
    return true;
  }
  return bottom_layers > 0 && !waits && !same_waits(times.bottom, times.normal);
}

NewLift new_lift(const StackInfo& info) {
  NewLift lift;
  lift.times.normal.up_mm_s = kLiftMmMin / kSecondsPerMinute;
  lift.times.normal.back_mm_s = kDropMmMin / kSecondsPerMinute;
  lift.times.bottom = lift.times.normal;
  if (!lifts(info)) return lift;
  if (info.lift_times && info.lift_times->by_archive) {
    lift.from = NewLift::From::archive;
    lift.times = *info.lift_times;
  } else if (info.printer && info.printer->lift_motion && info.printer->lift_motion->up_mm > 0) {
    lift.from = NewLift::From::printer;
    lift.times.normal = *info.printer->lift_motion;
  } else {
    lift.times.normal.up_mm = kLiftMm;
  }
  LiftTimes& times = lift.times;
  if (times.bottom_layers == 0) times.bottom = times.normal;
  for (LiftMotion* const m : {&times.normal, &times.bottom}) *m = without_unsaid(*m);
  for (LiftMotion& m : times.layers) m = without_unsaid(m);
  return lift;
}

void tell_new_lift(const ArchiveRequest& request, std::string_view format, const NewLift& lift) {
  const int layers = request.info.grid.layers;
  const LiftMotion &last = lift.times.of(std::max(0, layers - 1)), &first = lift.times.of(0);
  const char* const from = lift.from == NewLift::From::archive ? ", as the file that was read does"
                           : lift.from == NewLift::From::printer
                               ? ", as the printer file does"
                               : ": set what the printer needs, or give a file of the "
                                 "printer's slicer as a template";
  warn(request,
       fmt::format(
           "a new {} file says lifts of {}{}{}", format, motion_in_words(last),
           first == last ? "" : fmt::format(" (the first layer: {})", motion_in_words(first)),
           from));
  // With lifts that are proposed it is told that a template says what the printer needs.
  if (lift.from != NewLift::From::proposed && !machine_height_known(request.info)) {
    warn(
        request,
        fmt::format("the new {} file says a machine as high as the part: the height of the machine "
                    "is not known",
                    format));
  }
  const std::optional<LiftTimes>& read = request.info.lift_times;
  if (lift.from == NewLift::From::archive && read->normal.tilt_s > 0) {
    warn(request,
         fmt::format("{} files say nothing of vats that tilt: {:g} s of it are left behind", format,
                     read->normal.tilt_s));
  }
}

void tell_lifts_left(const ArchiveRequest& request, std::string_view format) {
  const StackInfo& info = request.info;
  if (request.kept != nullptr || !lifts(info) || !info.lift_times || !info.lift_times->by_archive) {
    return;
  }
  const LiftMotion& usual = info.lift_times->of(std::max(0, info.grid.layers - 1));
  warn(
      request,
      fmt::format(
          "lifts of the file that was read, {}, are left behind: new {} archives don't say them, and "
          "printers go by what they say or know",
          motion_in_words(usual), format));
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
