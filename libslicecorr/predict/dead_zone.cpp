#include "slicecorr/dead_zone.hpp"

#include <fmt/format.h>

#include <algorithm>
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
    : kernel_(*model.inhibited),
      columns_(columns),
      low_(static_cast<std::size_t>(slices), 255),
      high_(static_cast<std::size_t>(slices), 0) {
  if (!kernel_.any_level_cures_to_window()) return;
  dose_.assign(columns, 0.0F);
  cured_.assign(columns, false);
}

void WindowWatch::add_slice(int slice, const std::uint8_t* pixels) {
  const auto n = static_cast<std::size_t>(slice);
  if (!pixels || n >= high_.size()) {
    std::fill(dose_.begin(), dose_.end(), 0.0F);
    return;
  }
  std::uint8_t low = 255, high = 0;
  for (std::size_t i = 0; i < columns_; ++i) {
    // 0 becomes 255: black pixels don't count.
    low = std::min(low, static_cast<std::uint8_t>(pixels[i] - 1));
    high = std::max(high, pixels[i]);
  }
  if (high > 0) {
    low_[n] = std::min(low_[n], static_cast<std::uint8_t>(low + 1));
    high_[n] = std::max(high_[n], high);
  }
  if (dose_.empty()) return;
  double at_window[256];
  for (int v = 0; v < 256; ++v) {
    at_window[v] = kernel_.window_dose(slice, level_of_pixel(v, kernel_.levels()));
  }
  for (std::size_t i = 0; i < columns_; ++i) {
    const double added = at_window[pixels[i]];
    // Fresh resin comes in once the dead zone is back.
    dose_[i] = added > 0 ? static_cast<float>(dose_[i] + added) : 0.0F;
    if (dose_[i] < 1.0F) continue;
    if (!cured_[i]) ++count_;
    cured_[i] = true;
    if (first_ < 0 || slice < first_) first_ = slice;
  }
}

WindowTotal::WindowTotal(const CureModel& model, int slices)
    : kernel_(*model.inhibited),
      low_(static_cast<std::size_t>(slices), 255),
      high_(static_cast<std::size_t>(slices), 0) {}

void WindowTotal::merge(const WindowWatch& band) {
  for (std::size_t n = 0; n < high_.size(); ++n) {
    low_[n] = std::min(low_[n], band.low_[n]);
    high_[n] = std::max(high_[n], band.high_[n]);
  }
  count_ += band.count_;
  if (band.first_ >= 0 && (first_ < 0 || band.first_ < first_)) first_ = band.first_;
}

DeadZones WindowTotal::result() const {
  DeadZones zones;
  zones.cured_pixels = count_;
  zones.cured_slice = first_;
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
