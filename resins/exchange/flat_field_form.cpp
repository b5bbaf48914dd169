// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// How even a display's light is, from the heights of plugs all over its plate.
#include "exchange/flat_field_form.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "slicecorr/error.hpp"
#include "slicecorr/measuring_form.hpp"

namespace slicecorr::resins {

namespace {

/// No display is darker somewhere by more, and plugs of such light would not be there.
constexpr double kMostRatio = 20;

double middle_of(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Plugs that were not measured get the mean of those beside them, from the nearest on.
std::size_t fill_in(std::vector<double>& heights, int columns) {
  std::vector<std::size_t> missing;
  for (std::size_t i = 0; i < heights.size(); ++i) {
    if (std::isnan(heights[i])) missing.push_back(i);
  }
  const std::vector<double> measured = heights;
  const int rows = static_cast<int>(heights.size()) / columns;
  for (const std::size_t i : missing) {
    const int x = static_cast<int>(i) % columns, y = static_cast<int>(i) / columns;
    double sum = 0;
    int count = 0;
    for (int reach = 1; count == 0; ++reach) {
      for (int v = std::max(0, y - reach); v <= std::min(rows - 1, y + reach); ++v) {
        for (int u = std::max(0, x - reach); u <= std::min(columns - 1, x + reach); ++u) {
          const double h =
              measured[static_cast<std::size_t>(v) * static_cast<std::size_t>(columns) +
                       static_cast<std::size_t>(u)];
          if (std::isnan(h)) continue;
          sum += h;
          ++count;
        }
      }
    }
    heights[i] = sum / count;
  }
  return missing.size();
}

}  // namespace

GreyImage light_of_plugs(const std::string& path, double height_e_um,
                         std::vector<std::string>& say) {
  const MeasuringForm form = read_form_of(path, {"flat-field"});
  const int columns = static_cast<int>(form.fact("columns", 1, 100));
  const double hb = height_e_um > 0 ? height_e_um : form.fact("height_e_um", 1e-3, 1e6);
  if (form.rows.size() % static_cast<std::size_t>(columns) != 0) {
    throw InputError(path, "columns",
                     fmt::format("is {}, and there are {} rows; expected whole rows of plugs",
                                 columns, form.rows.size()));
  }
  std::vector<double> heights, measured;
  for (std::size_t i = 0; i < form.rows.size(); ++i) {
    const auto h = form.number(i, "cured_height_um", 0, 1e9);
    heights.push_back(h ? *h : std::numeric_limits<double>::quiet_NaN());
    if (h) measured.push_back(*h);
  }
  if (2 * measured.size() < heights.size()) {
    throw InputError(path, "cured_height_um",
                     fmt::format("was measured at {} of {} plugs; expected half of them at least",
                                 measured.size(), heights.size()));
  }
  // Plugs get 3.7 times the gel dose: 1.3 absorbance heights.
  const double middle = middle_of(measured) / hb;
  if (middle < 0.02 || middle > 50) {
    throw InputError(
        path, "cured_height_um",
        fmt::format("is {:.3g} absorbance heights (base e, {:g} um) in the middle, and "
                    "should be near 1.3; expected heights in um",
                    middle, hb));
  }
  const auto [low, high] = std::minmax_element(measured.begin(), measured.end());
  if (std::exp((*high - *low) / hb) > kMostRatio) {
    throw InputError(
        path, "cured_height_um",
        fmt::format("goes from {:g} to {:g} um, which would be {:.3g} times the light at an "
                    "absorbance height of {:g} um (base e); expected at most {:g} times: is a row "
                    "wrong, or the height?",
                    *low, *high, std::exp((*high - *low) / hb), hb, kMostRatio));
  }
  const std::size_t missing = fill_in(heights, columns);
  say.push_back(
      fmt::format("Heights of {} plugs; light goes with exp(height / {:g} um), the absorbance "
                  "height (base e), whatever the exponent of the resin.",
                  measured.size(), hb));
  if (missing > 0) {
    say.push_back(
        fmt::format("{} plugs that were not measured got the mean of those beside them.", missing));
  }
  GreyImage image{columns, static_cast<int>(heights.size()) / columns, {}};
  const double greatest = *std::max_element(heights.begin(), heights.end());
  for (const double h : heights) {
    image.pixels.push_back(
        static_cast<std::uint8_t>(std::lround(255 * std::exp((h - greatest) / hb))));
  }
  return image;
}

}  // namespace slicecorr::resins
