// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "slicecorr/error.hpp"
#include "slicecorr/hologram.hpp"

namespace slicecorr {
namespace {

using std::numbers::pi;
constexpr int kMostSide = 16384;

double sinc(double x) { return std::abs(x) < 1e-9 ? 1 : std::sin(pi * x) / (pi * x); }

void positive(double value, const char* name, const char* unit) {
  if (std::isfinite(value) && value > 0) return;
  throw InputError(fmt::format("{} is {:g} {}; expected more than 0", name, value, unit));
}

}  // namespace

void check(const PhaseDisplay& display, const HologramOptics& optics) {
  for (const int side : {display.width_px, display.height_px}) {
    if (side < 2 || side > kMostSide) {
      throw InputError(fmt::format("the display has {} x {} pixels; expected 2 to {} each way",
                                   display.width_px, display.height_px, kMostSide));
    }
  }
  positive(display.pitch_um, "the pitch of the display", "um");
  positive(optics.wavelength_nm, "the wavelength", "nm");
  positive(optics.focal_mm, "the focal length", "mm");
  if (display.levels < 2 || display.levels > 256) {
    throw InputError(fmt::format("the display has {} levels; expected 2 to 256", display.levels));
  }
  if (display.stroke_turns) positive(*display.stroke_turns, "the stroke of the display", "turns");
  if (display.fill && !(*display.fill > 0 && *display.fill <= 1)) {
    throw InputError(fmt::format(
        "pixels are lit on {:g} of their area; expected more than 0, up to 1", *display.fill));
  }
  if (!(display.front_reflection >= 0 && display.front_reflection <= 1)) {
    throw InputError(fmt::format("the display's glass reflects {:g} of the light; expected 0 to 1",
                                 display.front_reflection));
  }
  if ((optics.relay_f1_mm != 0) != (optics.relay_f2_mm != 0)) {
    throw InputError("a relay has two lenses; expected both of its focal lengths");
  }
  if (optics.relay_f1_mm != 0) {
    positive(optics.relay_f1_mm, "the relay's first focal length", "mm");
    positive(optics.relay_f2_mm, "the relay's second focal length", "mm");
  }
  if (optics.wavelength_nm * 1e-3 >= 2 * display.pitch_um) {
    throw InputError(
        fmt::format("pixels of {:g} um are no larger than half the wavelength of {:g} nm; expected "
                    "larger ones",
                    display.pitch_um, optics.wavelength_nm));
  }
}

HologramGeometry geometry_of(const PhaseDisplay& display, const HologramOptics& optics) {
  const double l = optics.wavelength_nm * 1e-6, d = display.pitch_um * 1e-3, f = optics.focal_mm;
  const double m = optics.magnification();
  HologramGeometry g;
  g.order_deg = std::asin(std::min(1.0, l / d)) * 180 / pi;
  g.half_field_deg = std::asin(l / (2 * d)) * 180 / pi;
  g.field_mm = m * l * f / d;
  g.pixel_x_mm = g.field_mm / display.width_px;
  g.pixel_y_mm = g.field_mm / display.height_px;
  g.aperture_x = display.width_px * d / (2 * f) / m;
  g.aperture_y = display.height_px * d / (2 * f) / m;
  g.depth_of_focus_x_mm = l / (g.aperture_x * g.aperture_x);
  g.depth_of_focus_y_mm = l / (g.aperture_y * g.aperture_y);
  g.most_shift_mm = g.field_mm / 2;
  g.most_depth_mm = m * m * l * f * f / (std::max(display.width_px, display.height_px) * d * d);
  return g;
}

double zero_order(double fill, double front_reflection, double stroke_turns) {
  const double p = stroke_turns;
  // Between two pixels phase goes evenly from the one's to the other's. Simpson's rule; 200 pieces
  // leave nothing that 12 digits show up to strokes of ten turns.
  constexpr int kPieces = 200;
  double gap = 0;
  for (int i = 0; i <= kPieces; ++i) {
    const double t = static_cast<double>(i) / kPieces;
    const int weight = i == 0 || i == kPieces ? 1 : i % 2 == 1 ? 4 : 2;
    gap += weight * sinc(p * t) * sinc(p * (1 - t)) / (3.0 * kPieces);
  }
  const double amplitude = std::sqrt(1 - front_reflection) * (fill * sinc(p) + (1 - fill) * gap) +
                           std::sqrt(front_reflection);
  return amplitude * amplitude;
}

double fall_off(const PhaseDisplay& display, const HologramOptics& optics, double x_mm,
                double y_mm) {
  if (!display.fill) return 1;
  const double m = optics.magnification();
  const double lit_um = display.pitch_um * std::sqrt(*display.fill);
  const double per_mm = lit_um / (optics.wavelength_nm * optics.focal_mm * m) * 1e3;
  const double amplitude = sinc(x_mm * per_mm) * sinc(y_mm * per_mm);
  return amplitude * amplitude;
}

HologramPlane plane_of_picture(const GreyImage& picture, const std::string& name,
                               const PhaseDisplay& display, const HologramOptics& optics,
                               double pixel_um) {
  check(display, optics);
  const auto width = static_cast<std::size_t>(display.width_px);
  const auto height = static_cast<std::size_t>(display.height_px);
  HologramPlane plane;
  plane.name = name;
  plane.power.resize(width * height);
  const HologramGeometry g = geometry_of(display, optics);
  // Pixels of the picture per pixel of the image.
  const double sx = pixel_um > 0 ? g.pixel_x_mm * 1e3 / pixel_um : 1;
  const double sy = pixel_um > 0 ? g.pixel_y_mm * 1e3 / pixel_um : 1;
  const double covers_x = picture.width_px / sx, covers_y = picture.height_px / sy;
  if (covers_x > display.width_px || covers_y > display.height_px) {
    throw InputError(
        name, "",
        pixel_um > 0
            ? fmt::format(
                  "is {:.4g} x {:.4g} mm large, the field {:.4g} mm; expected a smaller one",
                  picture.width_px * pixel_um * 1e-3, picture.height_px * pixel_um * 1e-3,
                  g.field_mm)
            : fmt::format("has {} x {} pixels, the display {} x {}; expected no more",
                          picture.width_px, picture.height_px, display.width_px,
                          display.height_px));
  }
  // The mean over the pixel's area; middle on middle, where n/2 is the middle of both.
  const auto share = [](double low, double high, int i) {
    return std::max(0.0, std::min(high, i + 1.0) - std::max(low, static_cast<double>(i)));
  };
  const int middle_x = display.width_px / 2, middle_y = display.height_px / 2;
  const int middle_u = picture.width_px / 2, middle_v = picture.height_px / 2;
  bool dark = true, all_lit = true;
  for (std::size_t y = 0; y < height; ++y) {
    const double top = (static_cast<double>(y) - middle_y) * sy + middle_v;
    for (std::size_t x = 0; x < width; ++x) {
      const double left = (static_cast<double>(x) - middle_x) * sx + middle_u;
      double sum = 0;
      const int y_end = std::min(picture.height_px, static_cast<int>(std::ceil(top + sy)));
      const int x_end = std::min(picture.width_px, static_cast<int>(std::ceil(left + sx)));
      for (int v = std::max(0, static_cast<int>(std::floor(top))); v < y_end; ++v) {
        for (int u = std::max(0, static_cast<int>(std::floor(left))); u < x_end; ++u) {
          sum += share(top, top + sy, v) * share(left, left + sx, u) *
                 picture.pixels[static_cast<std::size_t>(v) * picture.width_px + u];
        }
      }
      const auto power = static_cast<float>(sum / (sx * sy) / 255);
      plane.power[y * width + x] = power;
      dark = dark && power <= 0;
      all_lit = all_lit && power > 0;
    }
  }
  if (dark) throw InputError(name, "", "is black; expected a target with light in it");
  if (all_lit) {
    throw InputError(
        name, "",
        "is lit all over, which leaves no place for the light that a hologram does not "
        "put on its target; expected a target with black around it");
  }
  return plane;
}

}  // namespace slicecorr
