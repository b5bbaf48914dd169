// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "picture/canvas.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/hologram.hpp"

namespace slicecorr {
namespace {

constexpr int kSide = 420, kEdge = 16;

/// Power as a picture of at most `kSide` pixels each way, as high as the field is wide; white is
/// `white`. Each of its pixels is the mean of what it shows.
ColourImage picture_of(const std::vector<float>& power, std::size_t width, double white) {
  const std::size_t height = power.size() / width;
  ColourImage image{kSide, kSide, std::vector<std::uint8_t>(std::size_t{3} * kSide * kSide)};
  for (std::size_t v = 0; v < kSide; ++v) {
    const std::size_t y0 = v * height / kSide, y1 = std::max(y0 + 1, (v + 1) * height / kSide);
    for (std::size_t u = 0; u < kSide; ++u) {
      const std::size_t x0 = u * width / kSide, x1 = std::max(x0 + 1, (u + 1) * width / kSide);
      double sum = 0;
      for (std::size_t y = y0; y < y1; ++y) {
        for (std::size_t x = x0; x < x1; ++x) sum += power[y * width + x];
      }
      const double share = sum / static_cast<double>((y1 - y0) * (x1 - x0)) / white;
      std::fill_n(&image.rgb[3 * (v * kSide + u)], 3,
                  static_cast<std::uint8_t>(std::lround(255 * std::clamp(share, 0.0, 1.0))));
    }
  }
  return image;
}

std::string name_of(const HologramPlane& p) {
  std::string text = p.name;
  if (p.dx_mm != 0 || p.dy_mm != 0)
    text += fmt::format(", moved by {:.4g}, {:.4g} mm", p.dx_mm, p.dy_mm);
  if (p.dz_mm != 0) text += fmt::format(", {:+.4g} mm deep", p.dz_mm);
  return text;
}

}  // namespace

std::string hologram_picture(const PhaseDisplay& display, const HologramOptics& optics,
                             const std::vector<HologramPlane>& planes,
                             const std::vector<std::vector<float>>& phases_rad,
                             const std::string& file, const ExecutionContext& context,
                             const std::vector<SeenPlane>* seen) {
  const bool svg = file.ends_with(".svg");
  if (!svg && !file.ends_with(".png")) {
    throw InputError(file, "", "expected a name that ends in .png or .svg");
  }
  const auto canvas = detail::make_canvas(svg, "Wanted images and what the hologram makes of them");
  const double width = 2 * kSide + 3 * kEdge;
  double y = kEdge;
  for (std::size_t k = 0; k < planes.size(); ++k) {
    const HologramPlane& p = planes[k];
    SeenPlane here;
    if (!seen) here.figures = figures_of(display, optics, p, phases_rad, context, &here.power);
    const SeenPlane& known = seen ? (*seen)[k] : here;
    const ImageFigures& f = known.figures;
    y += detail::Canvas::kLine;
    canvas->text(kEdge, y - 6, "wanted: " + name_of(p));
    canvas->text(2 * kEdge + kSide, y - 6, "what falls into its plane");
    const float most = *std::max_element(p.power.begin(), p.power.end());
    canvas->image(kEdge, y, picture_of(p.power, display.width_px, most));
    // About the optical axis: what was judged is that of images that were not moved aside.
    const bool moved = p.dx_mm != 0 || p.dy_mm != 0;
    std::vector<float> about_axis;
    for (std::size_t n = 0; moved && n < phases_rad.size(); ++n) {
      const auto one = power_at(display, optics, phases_rad[n], p.dz_mm, 2, context);
      about_axis.resize(one.size());
      for (std::size_t i = 0; i < one.size(); ++i) {
        about_axis[i] += one[i] / static_cast<float>(phases_rad.size());
      }
    }
    const std::vector<float>& power = moved ? about_axis : known.power;
    // White is twice the mean that the brightest of the target would get, so that grains show.
    double wanted = 0;
    for (const float v : p.power) wanted += v;
    const double white = 2 * f.efficiency * most / wanted / 4;
    canvas->image(2 * kEdge + kSide, y,
                  picture_of(power, 2 * static_cast<std::size_t>(display.width_px), white));
    y += kSide + detail::Canvas::kLine;
    canvas->text(
        kEdge, y - 4,
        fmt::format("{:.1f} % on target, RMS error {:.3f}", 100 * f.efficiency, f.rms_error));
    canvas->text(2 * kEdge + kSide, y - 4,
                 fmt::format("between pixels {:.3f}, speckle {:.3f}", f.rms_error_padded,
                             f.speckle_contrast));
    y += kEdge;
  }
  canvas->text(kEdge, y + 8,
               fmt::format("field {:.4g} mm wide and high", geometry_of(display, optics).field_mm));
  return canvas->file(width, y + detail::Canvas::kLine);
}

}  // namespace slicecorr
