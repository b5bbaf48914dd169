// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Kernels of slices that do not all lie alike: in layers of different heights, or below a platform that sends
// light back.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include "cure/front_profile.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/inhibited.hpp"

namespace slicecorr {

namespace {

/// Less than this share of light that comes back is nothing: rounding has a margin of 1e-9 of a dose.
constexpr double kNoLightBack = 1e-11;
/// Bound of the tables of all settings.
constexpr double kMostTableBytes = 1024.0 * 1024 * 1024;

/// Which part of a layer lies between its lower end and a place.
double part_of(InhibitedKernel::LayerPosition place) { return 0.25 * static_cast<int>(place); }

double slope_per_um(const Kinetics& k) { return 1.0 / k.huv_um - 1.0 / k.hb_um; }

}  // namespace

double InhibitedKernel::fade(double um) const {
  return std::exp(-kinetics_.m * um / kinetics_.hb_um);
}

double InhibitedKernel::returned_blue(double place_um) const {
  return reflectance_ > 0
             ? 1 + reflectance_ * std::exp(-2 * std::max(0.0, place_um) / kinetics_.hb_um)
             : 1.0;
}

double InhibitedKernel::returned(double place_um) const {
  return reflectance_ > 0 ? std::pow(returned_blue(place_um), kinetics_.m) : 1.0;
}

InhibitedKernel::Back InhibitedKernel::back(double place_um) const {
  if (!(reflectance_ > 0)) return {};
  const double blue = returned_blue(place_um), nearer = std::log(blue) / slope_per_um(kinetics_);
  return {nearer, std::pow(blue, kinetics_.m) * std::exp(kinetics_.m * nearer / kinetics_.hb_um),
          blue};
}

double InhibitedKernel::blue_at_front(int slice, double front_um) const {
  if (!(reflectance_ > 0)) return 1.0;
  // The window stands nearest to the platform when a slice begins, layer by layer all along where it ends.
  const double window_um = place_um(slice + (layer_by_layer() ? 1 : 0));
  return returned_blue(window_um - front_um);
}

/// The same light of the front itself: where it lies depends on what comes back there.
double InhibitedKernel::front_blue(int slice, double blue_mw_cm2, double uv_mw_cm2) const {
  if (slice < 0 || !(reflectance_ > 0)) return blue_mw_cm2;
  double low = 1, high = 1 + reflectance_;
  // More light moves the front towards the window, where less comes back.
  for (int step = 0; step < 50; ++step) {
    const double times = 0.5 * (low + high);
    const double front = steady_dead_zone_um(kinetics_, blue_mw_cm2 * times, uv_mw_cm2);
    const bool more = std::isfinite(front) && blue_at_front(slice, front) > times;
    (more ? low : high) = times;
  }
  return blue_mw_cm2 * high;
}

/// Whether a level is even light in the slices of a setting, or more: with what comes back, where the window is
/// nearest to the platform.
bool InhibitedKernel::is_even(int setting, int level) const {
  const int slice = slice_of(setting);
  if (level >= least_even_level_ || slice < 0) return level >= least_even_level_;
  const double next = blue_[static_cast<std::size_t>(level) + 1] * blue_at_front(slice, gap_um_);
  return next > least_even_mw_cm2_ * (1 + 1e-9);
}

double InhibitedKernel::window_blue(int setting, double blue_mw_cm2) const {
  const int slice = slice_of(setting);
  return slice < 0 ? blue_mw_cm2 : blue_mw_cm2 * blue_at_front(slice, 0);
}

/// Gives each slice whose neighbours are not those of any other a setting of its own.
void InhibitedKernel::surround(const Printer& printer, const Process& process) {
  const std::vector<double>& um = process.layer_heights_um;
  const bool level = std::all_of(um.begin(), um.end(), [&](double h) { return h == layer_um_; });
  if (!level) heights_ = LayerHeights(um);
  reflectance_ = printer.platform_reflectance > kNoLightBack ? printer.platform_reflectance : 0;
  if (alike()) return;
  const double mirrored_um =
      reflectance_ > 0 ? 0.5 * kinetics_.hb_um * std::log(reflectance_ / kNoLightBack) : 0;
  const int own_heights = heights_.alike() ? 0 : static_cast<int>(um.size());
  int slices = std::max(own_heights, static_cast<int>(slice_setting_.size()));
  while (place_um(slices) < mirrored_um) ++slices;
  slices += near_;
  const std::vector<std::uint16_t> of_uv = slice_setting_;
  const int plain = settings();
  slice_of_setting_.assign(static_cast<std::size_t>(plain), -1);
  // By the setting of UV light and the heights of the layers from the slice on towards the platform; of those on
  // which light from the platform falls, by the slice.
  std::map<std::pair<int, std::vector<double>>, int> known;
  std::vector<int> setting_of;
  for (int n = 0; n <= slices; ++n) {
    const int uv =
        of_uv.empty() ? 0 : of_uv[std::min(static_cast<std::size_t>(n), of_uv.size() - 1)];
    const int farthest = std::max(0, n - near_ + 1);
    std::vector<double> above;
    if (place_um(farthest) < mirrored_um) {
      above = {-1.0, static_cast<double>(n)};
    } else {
      for (int k = n; k > n - near_; --k) above.push_back(height_um(std::max(0, k)));
      if (std::all_of(above.begin(), above.end(), [&](double h) { return h == layer_um_; })) {
        setting_of.push_back(uv);
        continue;
      }
    }
    const auto [entry, is_new] = known.try_emplace({uv, std::move(above)}, settings());
    setting_of.push_back(entry->second);
    if (!is_new) continue;
    slice_of_setting_.push_back(n);
    const auto from = static_cast<std::size_t>(uv);
    setting_uv_.push_back(setting_uv_[from]);
    if (!blue_share_.empty()) blue_share_.push_back(blue_share_[from]);
    if (!setting_share_.empty()) setting_share_.push_back(setting_share_[from]);
    for (int l = 0; l < levels(); ++l) {
      sources_.push_back(source(uv, l));
      if (!flow_factor_.empty()) {
        flow_factor_.push_back(flow_factor_[static_cast<std::size_t>(uv * levels() + l)]);
        rest_at_gap_.push_back(rest_at_gap_[static_cast<std::size_t>(uv * levels() + l)]);
      }
      if (!pulses_.empty()) pulses_.push_back(pulses_[static_cast<std::size_t>(uv * levels() + l)]);
    }
    if (table_bytes() > kMostTableBytes) {
      throw InputError(fmt::format(
          "the first {} slices lie each in an own sequence of heights, for which tables under UV light take more than "
          "{:g} MiB; expected heights that change less often, or no UV light",
          n + 1, kMostTableBytes / (1024 * 1024)));
    }
  }
  slice_setting_.assign(setting_of.begin(), setting_of.end());
}

/// Of a setting that belongs to one slice: places and light as they are there.
void InhibitedKernel::tabulate_around(int setting) {
  const int slice = slice_of(setting);
  const auto count = blue_.size();
  for (const LayerPosition place : {lower_end, middle, upper_end}) {
    const auto at = static_cast<std::size_t>(setting * kPlaces + place);
    std::vector<double>& table = tables_[at];
    table.assign(static_cast<std::size_t>(near_) * count, 0.0);
    // The first layers go on beyond the platform: other slices of the setting have layers there.
    for (int j = 0; j < near_; ++j) {
      const double zeta = slice - j + 1 - part_of(place);
      for (int l = 0; l < levels(); ++l) {
        table[static_cast<std::size_t>(j) * count + static_cast<std::size_t>(l)] =
            added_by(setting, slice, l, zeta, 1.0);
      }
    }
    const int last = slice - near_ + 1;
    std::vector<double>& row = last_rows_[at];
    row.resize(count);
    const double times = returned(place_um(last + 1 - part_of(place)));
    for (std::size_t l = 0; l < count; ++l) {
      row[l] = table[static_cast<std::size_t>(near_ - 1) * count + l] / times;
    }
  }
  // At a layer's lower end its inside counts, which lies beyond the end already.
  const int end = static_cast<int>(std::lround(depth_um_ / layer_um_));
  if (layer_by_layer() && ends() && end < near_) {
    const auto at = static_cast<std::size_t>(setting * kPlaces + lower_end);
    std::fill_n(tables_[at].begin() + end * static_cast<std::ptrdiff_t>(count), count, 0.0);
  }
}

const double* InhibitedKernel::last_row(int setting, LayerPosition place) const {
  if (slice_of(setting) < 0)
    return table(setting, place) + static_cast<std::ptrdiff_t>(near_ - 1) * levels();
  return last_rows_[static_cast<std::size_t>(setting * kPlaces + place)].data();
}

double InhibitedKernel::added(int slice, int level, double zeta, double share) const {
  return added_by(setting_of_slice(slice), slice, level, zeta, share);
}

/// What a slice of a level adds at a place, with the UV light of a setting.
double InhibitedKernel::added_by(int setting, int slice, int level, double zeta,
                                 double share) const {
  const double at_um = place_um(zeta), end_um = place_um(slice + 1) - at_um;
  const Back light = back(at_um);
  const double amount = source(setting, level).amount;
  if (layer_by_layer()) return share * amount * rate(setting, level, std::max(0.0, end_um), light);
  const double begin = std::max(0.0, place_um(slice) - at_um);
  const double end = share < 1.0 ? end_um - (1.0 - share) * height_um(slice) : end_um;
  if (!(end > begin)) return 0;
  return amount * (rest(setting, level, begin, light) - rest(setting, level, end, light));
}

double InhibitedKernel::steady_dose_at(int setting, int level, const Place& place) const {
  const Back light = back(place.place_um);
  const double height_um = place.height_um;
  const double amount = source(setting, level).amount;
  if (!layer_by_layer()) return amount * rest(setting, level, 0, light);
  double sum = 0, last = 0;
  const double near_um = near_ * layer_um_;
  int j = 0;
  for (; j < 2 || j * height_um < near_um; ++j) {
    last = amount * rate(setting, level, (j + place.part) * height_um, light);
    sum += last;
  }
  const double a = fade(height_um);
  return ends() ? sum : sum + last * a / (1 - a);
}

}  // namespace slicecorr
