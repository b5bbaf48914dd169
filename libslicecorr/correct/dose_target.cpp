// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/dose_target.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include "base/coded_band.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr {

DoseSide dose_side_named(std::string_view name) {
  if (name == "nearest") return DoseSide::nearest;
  if (name == "at-least") return DoseSide::at_least;
  if (name == "at-most") return DoseSide::at_most;
  throw InputError(fmt::format("side of doses '{}'; expected nearest, at-least or at-most", name));
}

double DoseScale::greatest() const { return *std::max_element(dose.begin(), dose.end()); }

DoseScale DoseScale::even(double most) {
  if (!(most >= 1.0) || !std::isfinite(most)) {
    throw InputError(
        fmt::format("a greatest wanted dose of {:g}; expected a number of at least 1, where "
                    "features are just cured",
                    most));
  }
  DoseScale scale;
  for (std::size_t v = 0; v < scale.dose.size(); ++v) {
    scale.dose[v] = 1.0 + (most - 1.0) * static_cast<double>(v) / 255.0;
  }
  return scale;
}

void name_ranges(DoseTarget& doses) {
  constexpr int ranges = 8, bytes = 256 / ranges;
  doses.regions.clear();
  for (int r = 0; r < ranges; ++r) {
    const auto first = static_cast<std::size_t>(r * bytes);
    doses.regions.push_back(fmt::format("wanted {:.4g} to {:.4g}", doses.scale.dose[first],
                                        doses.scale.dose[first + bytes - 1]));
    for (std::size_t v = first; v < first + bytes; ++v) {
      doses.region_of[v] = static_cast<std::uint8_t>(r);
    }
  }
}

GradedTarget::GradedTarget(const SliceSource& target, const DoseTarget& doses)
    : target_(target), doses_(doses) {
  const Grid &t = target.grid(), &d = doses.images->grid();
  if (t.width_px != d.width_px || t.height_px != d.height_px || t.layers != d.layers) {
    throw InputError(fmt::format(
        "the wanted doses are {} images of {} x {} pixels; expected those of the part, {} of {} x "
        "{}",
        d.layers, d.width_px, d.height_px, t.layers, t.width_px, t.height_px));
  }
  const auto differ = [](double a, double b) { return a > 0 && std::abs(a - b) > 0.01 * b; };
  if (differ(d.pixel_x_um, t.pixel_x_um) || differ(d.pixel_y_um, t.pixel_y_um) ||
      differ(d.layer_um, t.layer_um)) {
    throw InputError(fmt::format(
        "the wanted doses are for voxels of {:g} x {:g} x {:g} um; expected those of the part, "
        "{:g} x {:g} x {:g} um",
        d.pixel_x_um, d.pixel_y_um, d.layer_um, t.pixel_x_um, t.pixel_y_um, t.layer_um));
  }
  for (const double dose : doses_.scale.dose) {
    if (!(dose >= 1.0) || !std::isfinite(dose)) {
      throw InputError(fmt::format(
          "a wanted dose of {:g}; expected 1 or more, since less leaves a feature liquid", dose));
    }
  }
  graded_ = doses_.scale.greatest() > 1.0 &&
            (doses_.scale.dose[0] > 1.0 || !doses_.images->bounds().empty());
}

RegionImages::RegionImages(const Grid& grid, std::vector<Region> regions)
    : grid_(grid), regions_(std::move(regions)), bounds_{} {
  if (regions_.size() > 255) {
    throw InputError(fmt::format("{} regions; expected at most 255", regions_.size()));
  }
  for (const Region& r : regions_) bounds_ = bounds_.united(r.slices->bounds());
}

void RegionImages::read_band(const PixelBox& band, const Sink& sink) const {
  const auto columns =
      static_cast<std::size_t>(band.width()) * static_cast<std::size_t>(band.height());
  std::vector<detail::CodedBand> slices;
  for (const Region& r : regions_) {
    detail::CodedBand& coded = slices.emplace_back(columns);
    r.slices->read_band(band, [&](int, const std::uint8_t* rows) { coded.append(rows); });
  }
  std::vector<std::uint8_t> out(columns), rows(columns);
  for (int n = 0; n < grid_.layers; ++n) {
    bool any = false;
    for (std::size_t r = 0; r < regions_.size(); ++r) {
      const int at = n + regions_[r].begin;
      if (at < 0 || at >= slices[r].slices() || slices[r].black(at)) continue;
      if (!any) std::fill(out.begin(), out.end(), std::uint8_t{0});
      any = true;
      slices[r].read(at, rows.data());
      for (std::size_t k = 0; k < columns; ++k) {
        if (rows[k] >= 128) out[k] = static_cast<std::uint8_t>(r + 1);
      }
    }
    sink(n, any ? out.data() : nullptr);
  }
}

double graded_phi(double height10_um, double dose, double slope_per_um) {
  return dose - height10_um / units::kLn10 * slope_per_um;
}

double fall_height_um(double height10_um, double from, double to, double phi_max) {
  if (from <= to) return 0;
  if (phi_max <= from) return std::numeric_limits<double>::infinity();
  return height10_um / units::kLn10 * std::log((phi_max - to) / (phi_max - from));
}

double rise_height_um(double height10_um, double from, double to, double phi_min) {
  if (to <= from) return 0;
  if (phi_min >= from) return std::numeric_limits<double>::infinity();
  return height10_um / units::kLn10 * std::log((to - phi_min) / (from - phi_min));
}

}  // namespace slicecorr
