// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "flow/image_light.hpp"

#include <algorithm>
#include <cmath>

#include "flow/coarser_section.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr {

namespace {

constexpr std::size_t kOwn = 4;  ///< a cell's share of its own light

/// Calls `f(cell, neighbour, share)` for all shares of cells of part that are not 0.
template <class F>
void each_share(const FlowSection& s, const ImageLight& image, const F& f) {
  for (int y = 0; y < s.height; ++y) {
    for (int x = 0; x < s.width; ++x) {
      const std::size_t cell = s.index(x, y);
      if (s.cells[cell] != FlowCell::part) continue;
      for (int k = 0; k < 9; ++k) {
        const float share = image.shares[cell][static_cast<std::size_t>(k)];
        if (share == 0) continue;
        const int u = std::clamp(x + k % 3 - 1, 0, s.width - 1);
        const int v = std::clamp(y + k / 3 - 1, 0, s.height - 1);
        f(cell, s.index(u, v), static_cast<double>(share));
      }
    }
  }
}

}  // namespace

namespace detail {

std::vector<std::size_t> asked_cells(const FlowSection& section, const ImageLight* image) {
  std::vector<char> asked(section.size(), 0);
  for (std::size_t i = 0; i < section.size(); ++i) {
    asked[i] = static_cast<char>(section.cells[i] == FlowCell::part);
  }
  if (image) {
    each_share(section, *image, [&](std::size_t, std::size_t from, double) { asked[from] = 1; });
  }
  std::vector<std::size_t> cells;
  for (std::size_t i = 0; i < section.size(); ++i) {
    if (asked[i]) cells.push_back(i);
  }
  return cells;
}

std::vector<double> followed(const FlowSection& section, const ImageLight* image,
                             std::vector<double> asked) {
  if (!image) return asked;
  std::vector<double> shown(section.size(), 0.0);
  each_share(section, *image, [&](std::size_t cell, std::size_t from, double share) {
    shown[cell] += share * asked[from];
  });
  return shown;
}

std::vector<double> by_asked(const FlowSection& section, const ImageLight* image,
                             std::vector<double> by_shown) {
  if (!image) return by_shown;
  std::vector<double> asked(section.size(), 0.0);
  each_share(section, *image, [&](std::size_t cell, std::size_t from, double share) {
    asked[from] += share * by_shown[cell];
  });
  return asked;
}

ImageLight coarser_image(const FlowSection& fine, const FlowSection& coarse, int factor,
                         const ImageLight& image) {
  std::vector<double> all(fine.size(), 0.0);
  each_share(fine, image, [&](std::size_t cell, std::size_t, double share) { all[cell] += share; });
  const auto sums = [&](const std::vector<double>& v) {
    return sums_on_coarser(fine, coarse, factor, v);
  };
  const std::vector<double> cells = sums(std::vector<double>(fine.size(), 1.0));
  const auto means = [&](const std::vector<double>& v) {
    std::vector<double> of = sums(v);
    for (std::size_t i = 0; i < of.size(); ++i) of[i] /= std::max(1.0, cells[i]);
    return of;
  };
  ImageLight result;
  result.uv = image.uv;
  result.blue_mw_cm2 = means(image.blue_mw_cm2);
  result.uv_mw_cm2 = means(image.uv_mw_cm2);
  for (const double share : means(all)) {
    result.shares.emplace_back();
    result.shares.back()[kOwn] = static_cast<float>(std::min(share, 1.0));
  }
  return result;
}

void check_image(const FlowSection& section, const ImageLight& image) {
  const bool sizes = image.shares.size() == section.size() &&
                     image.blue_mw_cm2.size() == section.size() &&
                     image.uv_mw_cm2.size() == section.size();
  if (!sizes) throw InputError("flow", "image", "does not have a number per cell of the section");
  for (const auto& shares : image.shares) {
    double sum = 0;
    for (const float share : shares) {
      if (!(share >= 0)) throw InputError("flow", "image", "has a share that is not 0 or more");
      sum += static_cast<double>(share);
    }
    if (sum > 1 + 1e-4) throw InputError("flow", "image", "shows more than is asked for");
  }
  for (const auto* light : {&image.blue_mw_cm2, &image.uv_mw_cm2}) {
    for (const double v : *light) {
      if (!(v >= 0) || !std::isfinite(v)) {
        throw InputError("flow", "image", "has light that is not 0 or more");
      }
    }
  }
}

}  // namespace detail

std::vector<double> ImageLight::of_blue(const FlowSection& section,
                                        const std::vector<double>& asked) const {
  std::vector<double> shown = detail::followed(section, this, asked);
  for (std::size_t i = 0; i < shown.size(); ++i) shown[i] += blue_mw_cm2[i];
  return shown;
}

std::vector<double> ImageLight::of_uv(const FlowSection& section,
                                      const std::vector<double>& asked) const {
  if (!uv) return asked;
  std::vector<double> shown = detail::followed(section, this, asked);
  for (std::size_t i = 0; i < shown.size(); ++i) shown[i] += uv_mw_cm2[i];
  return shown;
}

}  // namespace slicecorr
