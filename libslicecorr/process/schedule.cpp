// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What is shown for how long.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "slicecorr/light_unit.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr {

double slice_height_um(const Process& process, double layer_um, int slice) {
  const std::vector<double>& own = process.layer_heights_um;
  if (own.empty()) return layer_um;
  const auto last = static_cast<int>(own.size()) - 1;
  return own[static_cast<std::size_t>(std::clamp(slice, 0, last))];
}

double slice_speed_mm_h(const Process& process, int slice) {
  const std::vector<double>& speeds = process.slice_speed_mm_h;
  if (speeds.empty()) return process.speed_mm_h;
  const auto last = static_cast<int>(speeds.size()) - 1;
  return speeds[static_cast<std::size_t>(std::clamp(slice, 0, last))];
}

bool slices_differ(const Process& process) {
  if (process.mode != ExposureMode::continuous) return false;
  return light_differs(process) ||
         (!process.slice_speed_mm_h.empty() && process.slice_lamps == SliceLamps::stay);
}

std::string speeds_in_words(const Process& process) {
  const std::vector<double>& speeds = process.slice_speed_mm_h;
  if (speeds.empty()) return fmt::format("{:g} mm/h", process.speed_mm_h);
  const auto [least, greatest] = std::minmax_element(speeds.begin(), speeds.end());
  return fmt::format("{:g} to {:g} mm/h from slice to slice{}", *least, *greatest,
                     process.slice_lamps == SliceLamps::stay ? ", lamps as they are" : "");
}

double layer_exposure_s(const Process& process, int layer) {
  if (!process.layer_exposure_s.empty()) {
    const auto last = static_cast<int>(process.layer_exposure_s.size()) - 1;
    return process.layer_exposure_s[static_cast<std::size_t>(std::clamp(layer, 0, last))];
  }
  const double bottom =
      process.bottom_exposure_s > 0 ? process.bottom_exposure_s : process.exposure_s;
  if (layer < process.bottom_layers) return bottom;
  const int faded = layer - process.bottom_layers + 1;
  if (faded > process.fade_layers) return process.exposure_s;
  return bottom + (process.exposure_s - bottom) * faded / (process.fade_layers + 1);
}

double light_share(const Process& process, int layer) {
  const std::vector<double>& shares = process.light_share;
  if (shares.empty()) return 1;
  const auto last = static_cast<int>(shares.size()) - 1;
  return shares[static_cast<std::size_t>(std::clamp(layer, 0, last))];
}

double usual_light_share(const Process& process) {
  return process.light_share.empty() ? 1 : process.light_share.back();
}

Process as_lamp_shines(Process process) {
  const std::vector<double> lamp = std::exchange(process.lamp_share, {});
  const std::vector<double> uv_lamp = std::exchange(process.uv_lamp_share, {});
  if (!lamp.empty()) {
    std::vector<double> both;
    const std::size_t slices = std::max(lamp.size(), process.light_share.size());
    for (std::size_t n = 0; n < slices; ++n) {
      both.push_back(light_share(process, static_cast<int>(n)) *
                     lamp[std::min(n, lamp.size() - 1)]);
    }
    process.light_share = std::move(both);
  }
  UvSchedule& uv = process.uv;
  if (uv_lamp.empty() || uv.kind == UvKind::off) return process;
  // What is asked of it, slice by slice, and what comes.
  std::vector<double> asked = uv.slice_mw_cm2;
  if (uv.kind == UvKind::constant) asked = {uv.uv_mw_cm2};
  if (asked.empty()) {
    // Not known yet (schedule_uv); of patterns the kernel counts what comes.
    if (uv.kind == UvKind::patterned) process.uv_lamp_share = uv_lamp;
    return process;
  }
  uv.slice_mw_cm2.clear();
  for (std::size_t n = 0; n < std::max(asked.size(), uv_lamp.size()); ++n) {
    uv.slice_mw_cm2.push_back(asked[std::min(n, asked.size() - 1)] *
                              uv_lamp[std::min(n, uv_lamp.size() - 1)]);
  }
  if (uv.kind == UvKind::constant) uv.kind = UvKind::per_slice;
  return process;
}

bool light_differs(const Process& process) {
  return std::any_of(process.light_share.begin(), process.light_share.end(),
                     [&](double share) { return share != process.light_share.back(); });
}

std::string shares_in_words(const std::vector<double>& shares) {
  const auto [least, most] = std::minmax_element(shares.begin(), shares.end());
  return *least == *most ? fmt::format("{:.4g} %", 100 * *most)
                         : fmt::format("{:.4g} to {:.4g} %", 100 * *least, 100 * *most);
}

std::string light_share_in_words(const Process& process) {
  const std::vector<double>& shares = process.light_share;
  const double usual = usual_light_share(process);
  if (usual == 1 && !light_differs(process)) return {};
  std::string text = fmt::format("{:.4g} % of full light", 100 * usual);
  if (!light_differs(process)) return text;
  std::size_t first = 0, special = shares.size();
  while (special > 0 && shares[special - 1] == usual) --special;
  while (first < special && shares[first] == shares.front()) ++first;
  if (first == special) {
    return text + fmt::format(", {:.4g} % for the first {}", 100 * shares.front(),
                              first == 1 ? "layer" : fmt::format("{} layers", first));
  }
  const auto [least, most] = std::minmax_element(shares.begin(), shares.end());
  return text + fmt::format(" as a rule, {:.4g} to {:.4g} % in all", 100 * *least, 100 * *most);
}

namespace {

/// How far the middle of a slice is from the nearer end of a print, um; where that is `most_um` or more, what
/// it is at least.
double from_nearer_end_um(const Process& process, double layer_um, int slice, int slices,
                          double most_um) {
  const int before = std::min(slice, slices - 1 - slice);
  if (process.layer_heights_um.empty()) return (before + 0.5) * layer_um;
  const auto height_um = [&](int n) { return slice_height_um(process, layer_um, n); };
  double first_um = 0.5 * height_um(slice), last_um = first_um;
  for (int n = slice; n-- > 0 && first_um < most_um;) first_um += height_um(n);
  for (int n = slice + 1; n < slices && last_um < most_um; ++n) last_um += height_um(n);
  return std::min(first_um, last_um);
}

/// `slice_light` without the layer's own share.
SliceLight paced_light(const Process& process, double m, double layer_um, int slice, int slices) {
  if (process.mode == ExposureMode::layerwise) return {layer_exposure_s(process, slice), 1.0};
  const double time_s =
      units::slice_time_s(slice_height_um(process, layer_um, slice), process.speed_mm_h);
  double speed = 1;
  if (process.ramp == Ramp::lamp_follows && process.ramp_mm > 0) {
    const double z_mm =
        from_nearer_end_um(process, layer_um, slice, slices, process.ramp_mm * 1e3) * 1e-3;
    if (z_mm < process.ramp_mm) speed = std::sqrt(z_mm / process.ramp_mm);
  }
  double own = 1;
  if (!process.slice_speed_mm_h.empty()) {
    own = slice_speed_mm_h(process, slice) / process.speed_mm_h;
    speed = std::min(speed, own);
  }
  if (speed == 1) return {time_s, 1.0};
  const double share = process.slice_lamps == SliceLamps::stay ? speed / own : speed;
  return {time_s / speed, m == 1.0 ? share : std::pow(share, 1.0 / m)};
}

}  // namespace

SliceLight slice_light(const Process& process, double m, double layer_um, int slice, int slices) {
  SliceLight light = paced_light(process, m, layer_um, slice, slices);
  light.share *= light_share(process, slice);
  return light;
}

double light_on_s(const Process& process, double m, double layer_um, int slices) {
  if (process.mode == ExposureMode::continuous && process.ramp != Ramp::lamp_follows &&
      process.slice_speed_mm_h.empty() && process.layer_heights_um.empty()) {
    return slices * units::slice_time_s(layer_um, process.speed_mm_h);
  }
  double sum = 0;
  for (int n = 0; n < slices; ++n) sum += slice_light(process, m, layer_um, n, slices).time_s;
  return sum;
}

std::string exposures_in_words(const Process& p) {
  if (!p.layer_exposure_s.empty()) {
    const auto [least, greatest] =
        std::minmax_element(p.layer_exposure_s.begin(), p.layer_exposure_s.end());
    return fmt::format("{:g} to {:g} s each, {:g} s as a rule", *least, *greatest, p.exposure_s);
  }
  std::string text = fmt::format("{:g} s each", p.exposure_s);
  if (p.bottom_layers > 0) {
    text += fmt::format("; the first {} {:g} s",
                        p.bottom_layers == 1 ? "layer" : fmt::format("{} layers", p.bottom_layers),
                        layer_exposure_s(p, 0));
    if (p.fade_layers > 0) text += fmt::format(", then {} in steps between", p.fade_layers);
  } else if (p.fade_layers > 0) {
    text += fmt::format("; the first {} in steps from {:g} s on", p.fade_layers,
                        layer_exposure_s(p, 0));
  }
  return text;
}

std::string dose_in_words(const Resin& resin) {
  std::string text =
      resin.has_gel_time() ? fmt::format("{:.4g} mJ/cm² and {:.4g} sqrt(mW/cm²)·s",
                                         resin.gel_a_mj_cm2, resin.gel_b_sqrt_mw_cm2_s)
      : resin.critical_dose_prime > 0
          ? fmt::format("{:.4g} (mW/cm²)^{:g}·s", resin.critical_dose_prime, resin.m)
      : is_relative(resin)
          ? fmt::format("{:.4g} {}", critical_dose_s(resin), unit_of_dose(resin.unit))
          : fmt::format("{:.4g} mJ/cm³", resin.critical_dose_mj_cm3);
  if (resin.gel_dose_mj_cm3 > 0) {
    text += fmt::format(", gels at {:.4g}", resin.gel_dose_mj_cm3);
  } else if (resin.dose_factor != 1.0) {
    text += fmt::format(", {:g} times its gel dose", resin.dose_factor);
  }
  return text;
}

std::string uv_in_words(const UvSchedule& uv) {
  const std::string zone =
      uv.dead_zone_um > 0 ? fmt::format(" for a dead zone of {:g} um", uv.dead_zone_um) : "";
  switch (uv.kind) {
    case UvKind::off:
      return "";
    case UvKind::constant:
      return (uv.uv_mw_cm2 > 0 ? fmt::format("{:g} mW/cm² throughout", uv.uv_mw_cm2)
                               : std::string("one intensity throughout")) +
             zone;
    case UvKind::per_slice: {
      if (uv.slice_mw_cm2.empty()) return "one intensity per slice" + zone;
      const auto [least, most] =
          std::minmax_element(uv.slice_mw_cm2.begin(), uv.slice_mw_cm2.end());
      return fmt::format("{:.4g} to {:.4g} mW/cm² from slice to slice{}", *least, *most, zone);
    }
    case UvKind::patterned:
      return "an image per slice" + zone;
  }
  return "";
}

}  // namespace slicecorr
