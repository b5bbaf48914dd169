// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/lift_times.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "slicecorr/process.hpp"

namespace slicecorr {

namespace {

/// From rest to rest: at constant acceleration up to the speed, or as far as the way allows.
double move_s(double mm, double mm_s, double mm_s2) {
  if (!(mm > 0) || !(mm_s > 0)) return 0;
  if (!(mm_s2 > 0)) return mm / mm_s;
  if (mm * mm_s2 < mm_s * mm_s) return 2 * std::sqrt(mm / mm_s2);
  return mm / mm_s + mm_s / mm_s2;
}

std::string minutes(double s) {
  const long all = std::lround(s);
  return all >= 3600 ? fmt::format("{} h {:02} min {:02} s", all / 3600, all % 3600 / 60, all % 60)
                     : fmt::format("{} min {:02} s", all / 60, all % 60);
}

}  // namespace

DarkTime dark_time(const LiftMotion& m, double layer_um) {
  DarkTime t;
  const double up_mm = m.up_mm + m.up_2_mm, layer_mm = layer_um * 1e-3;
  const double a = m.acceleration_mm_s2;
  if (up_mm > 0) {
    t.lift_s = move_s(m.up_mm, m.up_mm_s, a) + move_s(m.up_2_mm, m.up_2_mm_s, a);
    const double back_mm = std::max(0.0, up_mm - layer_mm);
    const double second_mm = std::min(m.back_2_mm, back_mm);
    t.return_s = move_s(back_mm - second_mm, m.back_mm_s, a) + move_s(second_mm, m.back_2_mm_s, a);
  } else {
    t.lift_s = move_s(layer_mm, m.up_mm_s, a);
  }
  t.waits_s = m.before_lift_s + m.after_lift_s + m.before_light_s;
  t.waits_s += std::max(0.0, m.light_off_s - t.all_s()) + m.tilt_s;
  return t;
}

LayerTime layer_time(const Process& process, const std::optional<LiftTimes>& lifts,
                     double layer_um) {
  LayerTime time{process.exposure_s};
  if (lifts) time.dark = dark_time(lifts->normal, layer_um);
  return time;
}

std::string LayerTime::in_words() const {
  const std::string light = fmt::format("{:.4g} s of light", light_s);
  if (!dark) return light + "; lifts not known";
  return fmt::format("{}, {:.4g} s of lift, {:.4g} s of return, {:.4g} s of waits: {:.4g} s", light,
                     dark->lift_s, dark->return_s, dark->waits_s, light_s + dark->all_s());
}

std::string LayerTime::to_json() const {
  if (!dark) {
    return fmt::format(
        R"({{"light": {}, "lift": null, "return": null, "waits": null, "all": null}})", light_s);
  }
  return fmt::format(R"({{"light": {}, "lift": {}, "return": {}, "waits": {}, "all": {}}})",
                     light_s, dark->lift_s, dark->return_s, dark->waits_s, light_s + dark->all_s());
}

const LiftMotion& LiftTimes::of(int layer) const {
  if (!layers.empty()) {
    return layers[std::min(static_cast<std::size_t>(std::max(0, layer)), layers.size() - 1)];
  }
  return layer < bottom_layers ? bottom : normal;
}

std::optional<double> PrintTime::all_s() const {
  return dark_s ? std::optional(light_s + *dark_s) : std::nullopt;
}

PrintTime print_time(const Process& process, const std::optional<LiftTimes>& lifts, double m,
                     double layer_um, int slices) {
  const double light_s = light_on_s(process, m, layer_um, slices);
  if (process.mode == ExposureMode::continuous) return {light_s, 0.0};
  return print_time_of_layers(lifts, light_s, layer_um, slices);
}

PrintTime print_time_of_layers(const std::optional<LiftTimes>& lifts, double light_s,
                               double layer_um, int slices) {
  PrintTime time{light_s};
  if (!lifts) return time;
  double dark_s = 0;
  if (lifts->layers.empty()) {
    const int bottom = std::clamp(lifts->bottom_layers, 0, slices);
    dark_s = bottom * dark_time(lifts->bottom, layer_um).all_s() +
             (slices - bottom) * dark_time(lifts->normal, layer_um).all_s();
  } else {
    for (int n = 0; n < slices; ++n) dark_s += dark_time(lifts->of(n), layer_um).all_s();
  }
  time.dark_s = dark_s;
  return time;
}

std::string print_time_in_words(const PrintTime& time) {
  if (!time.dark_s) return minutes(time.light_s) + " of light; lifts not known";
  const std::string all = minutes(*time.all_s());
  if (*time.dark_s == 0) return all;
  return fmt::format("{}, of it {} of light", all, minutes(time.light_s));
}

}  // namespace slicecorr
