// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/formats/exposure_pattern.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "slicecorr/units.hpp"

namespace slicecorr::detail {

namespace {

/// What holds for a layer of a list whose last entry holds for later ones.
double at_layer(const std::vector<double>& list, int layer) {
  return list[std::min(static_cast<std::size_t>(layer), list.size() - 1)];
}

}  // namespace

double share_of_layer(const StackInfo& info, int layer) {
  const bool ours = info.kind == StackKind::corrected || info.kind == StackKind::recorded;
  if (ours && info.process) return light_share(*info.process, layer);
  return info.light_share.empty() ? 1.0 : at_layer(info.light_share, layer);
}

bool has_own_heights(const StackInfo& info) {
  const bool ours = info.kind == StackKind::corrected || info.kind == StackKind::recorded;
  return !(ours && info.process ? info.process->layer_heights_um : info.layer_heights_um).empty();
}

SliceLight light_of_layer(const StackInfo& info, int layer) {
  const double m = info.resin ? info.resin->m : 1.0;
  if (info.kind == StackKind::recorded && info.process) {
    // Images of a recording are no slices: the light that the process plans for a slice.
    return {planned_light_s(*info.process, info.grid.layer_um, layer, m), 1};
  }
  if (info.kind == StackKind::corrected && info.process) {
    return slice_light(*info.process, m, info.grid.layer_um, layer, info.grid.layers);
  }
  // Looked up here, because a Process would copy the whole list for each of its layers.
  if (const auto& times_s = info.layer_exposure_s; !times_s.empty()) {
    return {times_s[std::min(static_cast<std::size_t>(layer), times_s.size() - 1)],
            share_of_layer(info, layer)};
  }
  return slice_light(process_of_times(info), m, info.grid.layer_um, layer, info.grid.layers);
}

bool same_time(double a_s, double b_s) {
  return std::abs(a_s - b_s) <= std::min(0.0051, 0.01 * std::abs(b_s));
}

namespace {

/// Whether the times of layers follow the pattern: one time for the first layers, equal steps to
/// the normal time, and the normal time for all others. Fills `s` then.
bool follows_pattern(const std::vector<double>& times_s, ExposureSummary& s) {
  Process p;
  p.mode = ExposureMode::layerwise;
  p.exposure_s = times_s.back();
  p.bottom_exposure_s = times_s.front();
  std::size_t n = 0;
  while (n < times_s.size() && times_s[n] == times_s.front()) ++n;
  p.bottom_layers = static_cast<int>(n);
  while (n < times_s.size() && times_s[n] != times_s.back()) ++n;
  p.fade_layers = static_cast<int>(n) - p.bottom_layers;
  for (std::size_t k = 0; k < times_s.size(); ++k) {
    if (!same_time(times_s[k], layer_exposure_s(p, static_cast<int>(k)))) return false;
  }
  s.normal_s = p.exposure_s;
  s.bottom_s = p.bottom_exposure_s;
  const bool alike = p.bottom_exposure_s == p.exposure_s;
  s.bottom_layers = alike ? 0 : p.bottom_layers;
  s.fade_layers = alike ? 0 : p.fade_layers;
  return true;
}

}  // namespace

ExposureSummary exposure_summary(const StackInfo& info) {
  const Process p = process_of_times(info);
  ExposureSummary s;
  if (p.mode == ExposureMode::continuous) {
    s.normal_s = s.bottom_s = units::slice_time_s(info.grid.layer_um, p.speed_mm_h);
    s.uneven =
        p.ramp == Ramp::lamp_follows || !p.slice_speed_mm_h.empty() || !p.layer_heights_um.empty();
    if (s.uneven) s.bottom_s = light_of_layer(info, 0).time_s;
    return s;
  }
  s.normal_s = s.bottom_s = p.exposure_s;
  if (!p.layer_exposure_s.empty()) {
    s.uneven = !follows_pattern(p.layer_exposure_s, s);
    if (s.uneven) s.bottom_s = p.layer_exposure_s.front();
  } else if (p.bottom_exposure_s > 0 && p.bottom_layers + p.fade_layers > 0) {
    s.bottom_s = p.bottom_exposure_s;
    s.bottom_layers = p.bottom_layers;
    s.fade_layers = p.fade_layers;
  }
  return s;
}

ExposureSummary head_summary(const StackInfo& info) {
  ExposureSummary s = exposure_summary(info);
  if (!s.uneven) return s;
  const std::vector<double> times_s = process_of_times(info).layer_exposure_s;
  if (times_s.empty() || !(times_s.front() > s.normal_s)) return s;
  const auto layers = static_cast<int>(times_s.size());
  const auto at = [&](int n) { return times_s[static_cast<std::size_t>(n)]; };
  while (s.bottom_layers < layers && same_time(at(s.bottom_layers), at(0))) ++s.bottom_layers;
  int end = s.bottom_layers;
  while (end < layers && at(end) > s.normal_s && at(end) < at(end - 1)) ++end;
  // Layers that never come down to the others do not fade.
  if (end < layers && same_time(at(end), s.normal_s)) s.fade_layers = end - s.bottom_layers;
  return s;
}

bool shares_differ(const StackInfo& a, const StackInfo& b) {
  const int layers = std::min(a.grid.layers, b.grid.layers);
  for (int n = 0; n < layers; ++n) {
    if (std::abs(share_of_layer(a, n) - share_of_layer(b, n)) > 1e-9) return true;
  }
  return false;
}

bool exposures_differ(const StackInfo& a, const StackInfo& b) {
  const int layers = std::min(a.grid.layers, b.grid.layers);
  for (int n = 0; n < layers; ++n) {
    if (light_on_of_layer(a, n) != light_on_of_layer(b, n)) return true;
  }
  return false;
}

}  // namespace slicecorr::detail

namespace slicecorr {

Process process_of_times(const StackInfo& info) {
  const bool ours = info.kind == StackKind::corrected || info.kind == StackKind::recorded;
  if (ours && info.process) return *info.process;
  Process p;
  p.mode = ExposureMode::layerwise;
  p.exposure_s = info.exposure_s;
  p.bottom_exposure_s = info.bottom_exposure_s;
  p.bottom_layers = info.bottom_layers;
  p.fade_layers = info.fade_layers;
  p.layer_exposure_s = info.layer_exposure_s;
  p.light_share = info.light_share;
  p.layer_heights_um = info.layer_heights_um;
  return p;
}

double light_on_s(const StackInfo& info) {
  if (info.recording && info.process) {
    double sum = 0;
    const double m = info.resin ? light_exponent(*info.resin, *info.process) : 1.0;
    for (int n = 0; n < info.recording->slices(); ++n) {
      const double planned = planned_light_s(*info.process, info.grid.layer_um, n, m);
      for (const Recording::Showing& p : info.recording->of(n)) sum += p.light * planned;
    }
    return sum;
  }
  return light_on_s(process_of_times(info), info.resin ? info.resin->m : 1.0, info.grid.layer_um,
                    info.grid.layers);
}

double layer_height_um(const StackInfo& info, int layer) {
  const bool ours = info.kind == StackKind::corrected || info.kind == StackKind::recorded;
  const std::vector<double>& own =
      ours && info.process ? info.process->layer_heights_um : info.layer_heights_um;
  return own.empty() ? info.grid.layer_um : detail::at_layer(own, layer);
}

double stack_height_um(const StackInfo& info, int layers) {
  if (!detail::has_own_heights(info)) return layers * info.grid.layer_um;
  double sum = 0;
  for (int n = 0; n < layers; ++n) sum += layer_height_um(info, n);
  return sum;
}

namespace {

/// How long the images of a recording were lit, s: by the way and the speed of the window while each was, else by its
/// light.
double recorded_light_s(const StackInfo& info) {
  const double m = info.resin ? light_exponent(*info.resin, *info.process) : 1.0;
  double sum = 0;
  for (int n = 0; n < info.recording->slices(); ++n) {
    for (const Recording::Showing& p : info.recording->of(n)) {
      if (!(p.light > 0)) continue;
      if (p.speed_um_s != 0 && p.to_um != p.from_um) {
        sum += std::abs((p.to_um - p.from_um) / p.speed_um_s);
      } else if (p.blue_share > 0) {
        sum += p.light * planned_light_s(*info.process, info.grid.layer_um, n, m) /
               std::pow(p.blue_share, m);
      }
    }
  }
  return sum;
}

}  // namespace

PrintTime print_time(const StackInfo& info) {
  // Nobody has timed what was dark between the images of a recording.
  if (info.recording && info.process) return {recorded_light_s(info)};
  const double light_s = light_on_s(info);
  if (process_of_times(info).mode == ExposureMode::continuous) return {light_s, 0.0};
  return print_time_of_layers(lift_times_of(info), light_s,
                              stack_height_um(info, info.grid.layers) / info.grid.layers,
                              info.grid.layers);
}

std::string print_time_in_words(const StackInfo& info) {
  const PrintTime time = print_time(info);
  if (!info.recording) return print_time_in_words(time);
  return print_time_in_words({time.light_s, 0.0}) +
         " with light, as recorded: nobody has timed what was dark between";
}

std::optional<LiftTimes> lift_times_of(const StackInfo& info) {
  if (info.lift_times) return info.lift_times;
  return info.printer ? lift_times_of(*info.printer) : std::nullopt;
}

}  // namespace slicecorr
