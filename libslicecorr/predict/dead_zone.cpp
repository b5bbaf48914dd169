// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/dead_zone.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "slicecorr/error.hpp"

namespace slicecorr {

namespace {

constexpr double kNothing = std::numeric_limits<double>::quiet_NaN();

double extreme(const std::vector<double>& values, bool greatest) {
  double found = kNothing;
  for (const double v : values) {
    if (std::isnan(v)) continue;
    if (std::isnan(found) || (greatest ? v > found : v < found)) found = v;
  }
  return found;
}

}  // namespace

double DeadZones::least() const { return extreme(least_um, false); }
double DeadZones::greatest() const { return extreme(greatest_um, true); }

void check_window(const DeadZones& zones, const Process& process) {
  if (zones.cured_pixels == 0 || process.allow_window_cure) return;
  throw InfeasibleError(
      fmt::format("the resin cures to the window at {} pixels, first in slice {}: UV light does "
                  "not hold a dead zone there; use more UV light, print slower, or allow window "
                  "cure",
                  zones.cured_pixels, zones.cured_slice));
}

WindowWatch::WindowWatch(const CureModel& model, int slices, std::size_t columns)
    : model_(model),
      kernel_(*model.inhibited()),
      columns_(columns),
      low_(static_cast<std::size_t>(slices), 255),
      high_(static_cast<std::size_t>(slices), 0) {
  if (!kernel_.any_level_cures_to_window()) return;
  dose_.assign(columns, 0.0F);
  cured_.assign(columns, false);
}

namespace {

struct Lit {
  std::uint8_t low = 255, high = 0;  ///< of pixels above black; high 0: there are none
};

Lit lit_values(const std::uint8_t* pixels, std::size_t n) {
  Lit lit;
  for (std::size_t i = 0; i < n; ++i) {
    // Less 1, black becomes 255, so that it never is the least.
    lit.low = std::min(lit.low, static_cast<std::uint8_t>(pixels[i] - 1));
    lit.high = std::max(lit.high, pixels[i]);
  }
  lit.low = static_cast<std::uint8_t>(lit.low + 1);
  return lit;
}

}  // namespace

void WindowWatch::add_slice(int slice, const std::uint8_t* pixels) {
  const auto n = static_cast<std::size_t>(slice);
  if (!pixels || n >= high_.size()) return cure(slice, {});
  const Lit lit = lit_values(pixels, columns_);
  if (lit.high > 0) {
    low_[n] = std::min(low_[n], lit.low);
    high_[n] = std::max(high_[n], lit.high);
  }
  const ImageShowing whole{pixels, 1.0, kernel_.setting_of_slice(slice)};
  cure(slice, {&whole, 1});
}

void WindowWatch::add_slice(int slice, std::span<const ImageShowing> showings) {
  const auto n = static_cast<std::size_t>(slice);
  if (n >= high_.size()) return cure(slice, {});
  if (least_um_.empty()) {
    least_um_.assign(high_.size(), kNothing);
    greatest_um_.assign(high_.size(), kNothing);
  }
  for (const ImageShowing& showing : showings) {
    const Lit lit = lit_values(showing.pixels, columns_);
    if (lit.high == 0) continue;
    if (showing.fronts) {
      for (std::size_t i = 0; i < columns_; ++i) {
        if (showing.pixels[i] == 0) continue;
        const double zone = kernel_.setting_dead_zone_um(showing.setting, showing.fronts[i].front);
        least_um_[n] = std::fmin(least_um_[n], zone);
        greatest_um_[n] = std::fmax(greatest_um_[n], zone);
      }
      continue;
    }
    low_[n] = std::min(low_[n], lit.low);
    high_[n] = std::max(high_[n], lit.high);
    const auto zone = [&](std::uint8_t value) {
      return kernel_.setting_dead_zone_um(showing.setting, level_of_pixel(value, kernel_.levels()));
    };
    // fmin and fmax leave NaN aside.
    least_um_[n] = std::fmin(least_um_[n], zone(lit.high));
    greatest_um_[n] = std::fmax(greatest_um_[n], zone(lit.low));
  }
  cure(slice, showings);
}

/// Adds a slice's gel dose at the window, and notes the columns that cure to it.
void WindowWatch::cure(int slice, std::span<const ImageShowing> showings) {
  if (dose_.empty()) return;
  struct Level {
    double dose = 0;
    bool no_dead_zone = false;
  };
  // Long exposures, and slices that are passed slowly, give as much more.
  const double ratio = model_.ratio(slice);
  std::vector<std::array<Level, 256>> at_window(showings.size());
  for (std::size_t k = 0; k < showings.size(); ++k) {
    if (showings[k].fronts) continue;
    for (int v = 0; v < 256; ++v) {
      const int level = level_of_pixel(v, kernel_.levels());
      at_window[k][static_cast<std::size_t>(v)] = {
          showings[k].light * kernel_.setting_window_dose(showings[k].setting, level),
          !kernel_.level_keeps_dead_zone(showings[k].setting, level)};
    }
  }
  for (std::size_t i = 0; i < columns_; ++i) {
    double added = 0;
    bool no_dead_zone = false;
    for (std::size_t k = 0; k < showings.size(); ++k) {
      if (const FrontLight* const fronts = showings[k].fronts) {
        const FrontLight& light = fronts[i];
        const int setting = showings[k].setting;
        if (light.amount > 0 && !kernel_.level_keeps_dead_zone(setting, light.front)) {
          added += showings[k].light * static_cast<double>(light.amount) *
                   kernel_.setting_window_dose(setting, light.front);
          no_dead_zone = true;
        }
        continue;
      }
      const Level& at = at_window[k][showings[k].pixels[i]];
      added += at.dose;
      no_dead_zone = no_dead_zone || at.no_dead_zone;
    }
    // Once a dead zone is back, fresh resin flows in, and its dose begins at 0.
    dose_[i] = no_dead_zone ? static_cast<float>(dose_[i] + ratio * added) : 0.0F;
    if (dose_[i] < 1.0F) continue;
    if (!cured_[i]) ++count_;
    cured_[i] = true;
    if (first_ < 0 || slice < first_) first_ = slice;
  }
}

WindowTotal::WindowTotal(const CureModel& model, int slices)
    : kernel_(*model.inhibited()),
      low_(static_cast<std::size_t>(slices), 255),
      high_(static_cast<std::size_t>(slices), 0) {}

void WindowTotal::merge(const WindowWatch& band) {
  for (std::size_t n = 0; n < high_.size(); ++n) {
    low_[n] = std::min(low_[n], band.low_[n]);
    high_[n] = std::max(high_[n], band.high_[n]);
  }
  if (least_um_.empty()) {
    least_um_ = band.least_um_;
    greatest_um_ = band.greatest_um_;
  } else {
    for (std::size_t n = 0; n < band.least_um_.size(); ++n) {
      least_um_[n] = std::fmin(least_um_[n], band.least_um_[n]);
      greatest_um_[n] = std::fmax(greatest_um_[n], band.greatest_um_[n]);
    }
  }
  count_ += band.count_;
  if (band.first_ >= 0 && (first_ < 0 || band.first_ < first_)) first_ = band.first_;
}

DeadZones WindowTotal::result() const {
  DeadZones zones;
  zones.cured_pixels = count_;
  zones.cured_slice = first_;
  if (!least_um_.empty()) {
    zones.least_um = least_um_;
    zones.greatest_um = greatest_um_;
    return zones;
  }
  for (std::size_t n = 0; n < high_.size(); ++n) {
    const auto zone = [&](std::uint8_t value) {
      return kernel_.dead_zone_um(static_cast<int>(n), level_of_pixel(value, kernel_.levels()));
    };
    zones.least_um.push_back(high_[n] ? zone(high_[n]) : kNothing);
    zones.greatest_um.push_back(high_[n] ? zone(low_[n]) : kNothing);
  }
  return zones;
}

}  // namespace slicecorr
