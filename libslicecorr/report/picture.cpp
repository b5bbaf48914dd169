// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "report/cure_colours.hpp"
#include "slicecorr/report.hpp"

namespace slicecorr {

namespace {

using detail::Colour, detail::kCureThrough, detail::kEmpty, detail::kGreyEmpty,
    detail::kGreyPrinted, detail::kRight, detail::kUndercure;
constexpr Colour kNotYet{178, 203, 245}, kWindow{27, 31, 36};

/// Draws voxel by voxel at the scale at which the section fits; a picture pixel shows the voxel at
/// its middle, but a wrong voxel it covers is never left out.
template <typename ColourOf, typename Weight>
ColourImage draw(const Section& s, double pixel_x_um, double layer_um, int most_px, ColourOf colour,
                 Weight weight) {
  const double width_um = s.width * pixel_x_um, height_um = s.layers * layer_um;
  // Not finer than two picture pixels per voxel, not coarser than fits.
  const double scale =
      std::min(2.0 / std::min(pixel_x_um, layer_um), most_px / std::max(width_um, height_um));
  ColourImage image;
  image.width_px = std::max(1, static_cast<int>(std::lround(width_um * scale)));
  image.height_px = std::max(1, static_cast<int>(std::lround(height_um * scale)));
  image.rgb.resize(static_cast<std::size_t>(image.width_px) *
                   static_cast<std::size_t>(image.height_px) * 3);
  const auto range = [](int i, int pixels, int voxels) {
    const int from = static_cast<int>(static_cast<std::int64_t>(i) * voxels / pixels);
    const int to = static_cast<int>(static_cast<std::int64_t>(i + 1) * voxels / pixels);
    return std::pair(from, std::max(from + 1, to));
  };
  for (int py = 0; py < image.height_px; ++py) {
    const auto [n0, n1] = range(py, image.height_px, s.layers);
    for (int px = 0; px < image.width_px; ++px) {
      const auto [x0, x1] = range(px, image.width_px, s.width);
      std::size_t best =
          static_cast<std::size_t>((n0 + n1) / 2) * static_cast<std::size_t>(s.width) +
          static_cast<std::size_t>((x0 + x1) / 2);
      int most = weight(best);
      for (int n = n0; n < n1; ++n) {
        for (int x = x0; x < x1; ++x) {
          const std::size_t k = static_cast<std::size_t>(n) * static_cast<std::size_t>(s.width) +
                                static_cast<std::size_t>(x);
          if (weight(k) > most) {
            most = weight(k);
            best = k;
          }
        }
      }
      const Colour c = colour(best);
      std::copy(c.begin(), c.end(),
                image.rgb.begin() + 3 * (static_cast<std::ptrdiff_t>(py) * image.width_px + px));
    }
  }
  return image;
}

}  // namespace

ColourImage cure_picture(const Section& s, double pixel_x_um, double layer_um, int most_px) {
  const auto wrong = [&](std::size_t k) {
    const bool printed = s.dose[k] >= 1.0F;
    return (s.coverage[k] == 0 && printed) || (s.coverage[k] == 255 && !printed) ? 1 : 0;
  };
  const auto colour = [&](std::size_t k) {
    const bool printed = s.dose[k] >= 1.0F;
    if (s.coverage[k] == 0) return printed ? kCureThrough : kEmpty;
    if (s.coverage[k] == 255) return printed ? kRight : kUndercure;
    return printed ? kGreyPrinted : kGreyEmpty;
  };
  return draw(s, pixel_x_um, layer_um, most_px, colour, wrong);
}

ColourImage grey_picture(const Section& s, double pixel_x_um, double layer_um, int most_px) {
  const auto colour = [&](std::size_t k) { return Colour{s.pixels[k], s.pixels[k], s.pixels[k]}; };
  return draw(s, pixel_x_um, layer_um, most_px, colour, [](std::size_t) { return 0; });
}

namespace {

/// From `kEmpty` at no dose to a pale grey at 1, and from blue at 1 to yellow at `most`.
Colour colour_of_dose(double dose, double most) {
  static constexpr std::array<Colour, 5> scale{
      {{59, 82, 139}, {33, 145, 140}, {94, 201, 98}, {173, 220, 48}, {253, 231, 37}}};
  const auto mixed = [](const Colour& a, const Colour& b, double share) {
    Colour c;
    for (std::size_t k = 0; k < c.size(); ++k) {
      c[k] = static_cast<std::uint8_t>(std::lround(a[k] + share * (b[k] - a[k])));
    }
    return c;
  };
  if (dose < 1) return mixed(kEmpty, kGreyEmpty, std::max(0.0, dose));
  const double at = std::clamp((dose - 1) / (most - 1), 0.0, 1.0) * (scale.size() - 1);
  const auto from = std::min(static_cast<std::size_t>(at), scale.size() - 2);
  return mixed(scale[from], scale[from + 1], at - static_cast<double>(from));
}

}  // namespace

std::string dose_colour(double dose, double most) {
  const Colour c = colour_of_dose(dose, most);
  return fmt::format("#{:02x}{:02x}{:02x}", c[0], c[1], c[2]);
}

ColourImage dose_picture(const Section& s, bool wanted, double most, double pixel_x_um,
                         double layer_um, int most_px) {
  const auto colour = [&](std::size_t k) {
    if (!wanted) return colour_of_dose(s.dose[k], most);
    return s.coverage[k] == 255 ? colour_of_dose(s.wanted[k], most) : kEmpty;
  };
  return draw(s, pixel_x_um, layer_um, most_px, colour, [](std::size_t) { return 0; });
}

namespace {

/// Cells as squares, small maps enlarged; empty where there is nothing.
template <typename ColourOf>
ColourImage draw_cells(const SurfaceMaps& maps, const std::vector<float>& um, ColourOf colour) {
  constexpr int least_side = 320;
  const int times = std::max(1, least_side / std::max({1, maps.width, maps.height}));
  ColourImage image{std::max(1, maps.width * times), std::max(1, maps.height * times), {}};
  image.rgb.assign(
      static_cast<std::size_t>(image.width_px) * static_cast<std::size_t>(image.height_px) * 3,
      255);
  for (int y = 0; y < maps.height * times; ++y) {
    for (int x = 0; x < maps.width * times; ++x) {
      const auto cell = static_cast<std::size_t>(y / times) * static_cast<std::size_t>(maps.width) +
                        static_cast<std::size_t>(x / times);
      const Colour c = std::isnan(um[cell]) ? kEmpty : colour(um[cell]);
      std::copy(c.begin(), c.end(),
                image.rgb.begin() + 3 * (static_cast<std::ptrdiff_t>(y) * image.width_px + x));
    }
  }
  return image;
}

Colour between(const Colour& from, const Colour& to, double share) {
  Colour c;
  for (std::size_t k = 0; k < c.size(); ++k) {
    c[k] = static_cast<std::uint8_t>(std::lround(from[k] + share * (to[k] - from[k])));
  }
  return c;
}

}  // namespace

ColourImage surface_picture(const SurfaceMaps& maps, bool from_below, double scale_um) {
  return draw_cells(maps, from_below ? maps.below_um : maps.above_um, [&](float value) {
    const double share = std::clamp(value / scale_um, -1.0, 1.0);
    return between(kGreyEmpty, share > 0 ? kCureThrough : kUndercure, std::abs(share));
  });
}

ColourImage sensitivity_picture(const SurfaceMaps& maps, bool upper, double scale_um) {
  // From pale yellow over orange to black: the order of the brightness is that of the width.
  constexpr std::array<Colour, 4> scale = {Colour{255, 247, 205}, Colour{245, 160, 55},
                                           Colour{160, 40, 60}, Colour{25, 5, 30}};
  return draw_cells(maps, upper ? maps.below_um : maps.above_um, [&](float value) {
    const double at = std::clamp(value / scale_um, 0.0, 1.0) * (scale.size() - 1);
    const auto from = std::min(static_cast<std::size_t>(at), scale.size() - 2);
    return between(scale[from], scale[from + 1], at - static_cast<double>(from));
  });
}

ColourImage progress_picture(const SectionHistory& h, std::size_t frame, int most_px) {
  const SectionHistory::Still& f = h.frames[frame];
  Section s;
  s.width = h.width;
  s.layers = h.layers;
  const auto width = static_cast<std::size_t>(h.width);
  const double reached = f.z_window_um / h.layer_um - 0.5;
  const auto coverage = [&](std::size_t k) { return h.coverage.empty() ? 255 : h.coverage[k]; };
  const auto colour = [&](std::size_t k) {
    const bool printed = f.gelled[k] != 0;
    if (h.coverage.empty()) return printed ? kRight : kEmpty;
    const int c = coverage(k);
    if (c == 0) return printed ? kCureThrough : kEmpty;
    if (printed) return c == 255 ? kRight : kGreyPrinted;
    const std::size_t layer = k / width;
    if (static_cast<double>(layer) > reached || c < 255) return kGreyEmpty;
    return f.ended ? kUndercure : kNotYet;
  };
  const auto wrong = [&](std::size_t k) { return f.gelled[k] != 0 && coverage(k) == 0 ? 1 : 0; };
  ColourImage image = draw(s, h.pixel_x_um, h.layer_um, most_px, colour, wrong);
  const double per_um = image.height_px / (h.layers * h.layer_um);
  const int line = std::clamp(static_cast<int>(f.z_window_um * per_um), 0, image.height_px - 1);
  for (int x = 0; x < image.width_px; ++x) {
    std::copy(kWindow.begin(), kWindow.end(),
              image.rgb.begin() + 3 * (static_cast<std::ptrdiff_t>(line) * image.width_px + x));
  }
  return image;
}

}  // namespace slicecorr
