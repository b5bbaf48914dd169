// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "process/spread_keys.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "slicecorr/error.hpp"

namespace slicecorr {

namespace {

/// What light may reach to either side: the display's shorter side.
double most_reach_um(const Printer& printer) {
  return std::min(printer.width_px * printer.pixel_x_um, printer.height_px * printer.pixel_y_um);
}

}  // namespace

bool SpreadPicture::operator==(const SpreadPicture& o) const {
  return width_px == o.width_px && height_px == o.height_px && pitch_um == o.pitch_um &&
         (values == o.values || (values && o.values && *values == *o.values));
}

bool LightSpread::none() const {
  return !picture && std::all_of(gaussians.begin(), gaussians.end(),
                                 [](const auto& g) { return g.sigma_um == 0 || g.weight == 0; });
}

std::string spread_in_words(const LightSpread& spread) {
  if (spread.none()) return {};
  if (spread.picture) {
    return fmt::format("measured, {} x {} pixels of {:g} um", spread.picture->width_px,
                       spread.picture->height_px, spread.picture->pitch_um);
  }
  if (spread.gaussians.size() == 1) {
    return fmt::format("Gaussian, sigma {:g} um", spread.gaussians[0].sigma_um);
  }
  std::string text = "Gaussians: ";
  for (const SpreadGaussian& g : spread.gaussians) {
    text += fmt::format("{}{:.4g} % with sigma {:g} um", &g == &spread.gaussians[0] ? "" : ", ",
                        100 * g.weight, g.sigma_um);
  }
  return text;
}

void check_spread_picture(const SpreadPicture& picture, const Printer& printer,
                          const std::string& path) {
  const int w = picture.width_px, h = picture.height_px;
  if (w % 2 == 0 || h % 2 == 0) {
    throw InputError(
        path, "",
        fmt::format("is {} x {} pixels; expected odd sides, with the point that is lit "
                    "in the middle pixel",
                    w, h));
  }
  const double reach_um = picture.pitch_um * std::max(w, h) / 2;
  if (reach_um > most_reach_um(printer)) {
    throw InputError(path, "",
                     fmt::format("reaches {:g} um to each side of its middle; expected at most the "
                                 "{:g} um of the display's shorter side",
                                 reach_um, most_reach_um(printer)));
  }
  if (!picture.values) return;
  double sum = 0, x_sum = 0, y_sum = 0;
  std::size_t at = 0;
  const int middle_x = w / 2, middle_y = h / 2;
  for (int y = 0; y < h; ++y) {
    for (int x = 0; x < w; ++x) {
      const double v = (*picture.values)[at++];
      sum += v;
      x_sum += v * (x - middle_x);
      y_sum += v * (y - middle_y);
    }
  }
  if (sum == 0) {
    throw InputError(path, "", "is black; expected the light around a point, white the brightest");
  }
  if (std::hypot(x_sum, y_sum) > sum) {
    throw InputError(path, "",
                     fmt::format("has its light's centre at [{:.3g}, {:.3g}] pixels from its "
                                 "middle; expected it within one",
                                 x_sum / sum, y_sum / sum));
  }
}

namespace detail {

SpreadKeys spread_keys(const TomlTable& light, const Printer& printer) {
  const char* key = "spread";
  const toml::node* node = light.node(key);
  SpreadKeys keys;
  const bool pitch = light.has("spread_pitch_um");
  if (node && node->is_string() && !(**node->as_string()).empty()) {
    keys.file = **node->as_string();
    keys.pitch_um = light.required_number("spread_pitch_um", 0, 1e4);
    return keys;
  }
  if (pitch) light.fail("spread_pitch_um", "is given without a picture as spread");
  if (!node) return keys;
  const char* expected = "expected [[sigma_um, weight], ...] or the name of a PNG file";
  const auto* list = node->as_array();
  if (!list || list->empty()) light.fail(key, expected);
  if (list->size() > kMostSpreadGaussians) {
    light.fail(key, fmt::format("has {} Gaussians; expected at most {}", list->size(),
                                kMostSpreadGaussians));
  }
  double sum = 0;
  for (const auto& element : *list) {
    const auto* pair = element.as_array();
    if (!pair || pair->size() != 2 || !pair->get(0)->is_number() || !pair->get(1)->is_number()) {
      light.fail(key, "expected pairs [sigma_um, weight]");
    }
    const SpreadGaussian g{*pair->get(0)->value<double>(), *pair->get(1)->value<double>()};
    const std::string place = fmt::format("Gaussian {}", keys.gaussians.size() + 1);
    if (!std::isfinite(g.sigma_um) || g.sigma_um < 0) {
      light.fail(key, fmt::format("{}: sigma is {:g} um; expected 0 or more", place, g.sigma_um));
    }
    if (!std::isfinite(g.weight) || g.weight < 0) {
      light.fail(key, fmt::format("{}: the weight is {:g}; expected 0 to 1", place, g.weight));
    }
    if (kSpreadReachSigmas * g.sigma_um > most_reach_um(printer)) {
      light.fail(
          key,
          fmt::format("{}: with a sigma of {:g} um light reaches {:.4g} um, further than "
                      "the display's shorter side, {:g} um; expected micrometres",
                      place, g.sigma_um, kSpreadReachSigmas * g.sigma_um, most_reach_um(printer)));
    }
    sum += g.weight;
    keys.gaussians.push_back(g);
  }
  if (!(std::abs(sum - 1) <= kSpreadWeights)) {
    light.fail(key, fmt::format("has weights that add up to {:g}; expected 1", sum));
  }
  return keys;
}

}  // namespace detail

}  // namespace slicecorr
