// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>
#include <numbers>

#include "fourier/fft.hpp"
#include "hologram/centred.hpp"
#include "parallel/silent.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/hologram.hpp"

namespace slicecorr {
namespace {

using detail::from_axis;
using detail::PlaneFft;
using detail::Way;
using Complex = std::complex<float>;

using std::numbers::pi;

/// What a way of `z_mm` does to plane waves, against one along the axis.
class Spectrum {
 public:
  /// `window_x_mm`, `window_y_mm`: sides of the padded plane.
  Spectrum(double wavelength_mm, double z_mm, double window_x_mm, double window_y_mm)
      : l_(wavelength_mm), z_(z_mm), most_x_(most(window_x_mm)), most_y_(most(window_y_mm)) {}

  /// Of frequencies in 1/mm.
  Complex operator()(double fx, double fy) const {
    if (z_ == 0) return {1, 0};
    if (std::abs(fx) > most_x_ || std::abs(fy) > most_y_) return {};
    const double sine2 = l_ * l_ * (fx * fx + fy * fy);
    if (sine2 >= 1) return {};  // evanescent
    // sqrt(1 - s) - 1 without losing its digits.
    const double turns = -z_ / l_ * sine2 / (1 + std::sqrt(1 - sine2));
    return Complex(std::polar(1.0, 2 * pi * (turns - std::floor(turns))));
  }

 private:
  double most(double window_mm) const {
    const double slope = 2 * z_ / window_mm;
    return 1 / (l_ * std::sqrt(slope * slope + 1));
  }
  double l_, z_, most_x_, most_y_;
};

template <class Body>
void over_rows(const ExecutionContext& context, std::size_t rows, const Body& body) {
  constexpr std::size_t kRows = 16;
  parallel_for(detail::silent(context), "", (rows + kRows - 1) / kRows, [&](std::size_t b) {
    for (std::size_t y = b * kRows; y < std::min(rows, (b + 1) * kRows); ++y) body(y);
  });
}

/// Power of a plane seen through a tilt, so that a moved image lies on samples: see `power_of`.
struct Look {
  double dx_mm = 0, dy_mm = 0, dz_mm = 0;
  int padding = 1;
};

std::vector<float> power_of(const PhaseDisplay& display, const HologramOptics& optics,
                            const std::vector<float>& phase_rad, const Look& look,
                            const ExecutionContext& context) {
  check(display, optics);
  const auto width = static_cast<std::size_t>(display.width_px);
  const auto height = static_cast<std::size_t>(display.height_px);
  if (phase_rad.size() != width * height) {
    throw InputError("a phase image of another size than the display's");
  }
  if (look.padding < 1 || look.padding > 8) throw InputError("expected a padding of 1 to 8");
  const std::size_t wide = width * look.padding, high = height * look.padding;
  const double l = optics.wavelength_nm * 1e-6, d = display.pitch_um * 1e-3, f = optics.focal_mm;
  const double m = optics.magnification();
  const bool turned = optics.relay_f1_mm > 0;
  const double field = l * f / d;
  const double dx = (turned ? -look.dx_mm : look.dx_mm) / m,
               dy = (turned ? look.dy_mm : -look.dy_mm) / m;
  const Spectrum way(l, look.dz_mm / (m * m), field, field);
  std::vector<Complex> plane(wide * high);
  std::vector<std::uint8_t> lit_rows(high);
  for (std::size_t y = 0; y < height; ++y)
    lit_rows[detail::unwound(y + high / 2 - height / 2, high)] = 1;
  over_rows(context, height, [&](std::size_t y) {
    const double v = from_axis(y, height) * d;
    Complex* row = &plane[detail::unwound(y + high / 2 - height / 2, high) * wide];
    for (std::size_t x = 0; x < width; ++x) {
      const double u = from_axis(x, width) * d;
      Complex z(std::polar(1.0, static_cast<double>(phase_rad[y * width + x]) -
                                    2 * pi * (u * dx + v * dy) / (l * f)));
      z *= way(u / (l * f), v / (l * f));
      row[detail::unwound(x + wide / 2 - width / 2, wide)] = z;
    }
  });
  const PlaneFft<float> fft(high, wide);
  const auto scale = static_cast<float>(
      1 / std::sqrt(static_cast<double>(width) * height * static_cast<double>(wide) * high));
  fft.along_rows(context, plane.data(), Way::forward, scale, lit_rows.data());
  fft.along_columns(context, plane.data(), Way::forward, 1);
  const HologramGeometry g = geometry_of(display, optics);
  std::vector<float> of_column(wide), power(wide * high);
  for (std::size_t x = 0; x < wide; ++x) {
    of_column[x] = static_cast<float>(fall_off(
        display, optics, from_axis(x, wide) * g.pixel_x_mm / look.padding + look.dx_mm, 0));
  }
  over_rows(context, high, [&](std::size_t y) {
    const Complex* row =
        &plane[detail::unwound(turned ? detail::mirrored(y, high) : y, high) * wide];
    const auto of_row = static_cast<float>(fall_off(
        display, optics, 0, -from_axis(y, high) * g.pixel_y_mm / look.padding + look.dy_mm));
    for (std::size_t x = 0; x < wide; ++x) {
      power[y * wide + x] =
          of_row * of_column[x] *
          std::norm(row[detail::unwound(turned ? detail::mirrored(x, wide) : x, wide)]);
    }
  });
  return power;
}

struct Sums {
  double on_target = 0, all = 0, error = 0, contrast = 0;
};

/// `wanted` at these samples: each pixel of the target is `padding` of them wide.
Sums judge(const PhaseDisplay& display, const HologramPlane& plane, const std::vector<float>& power,
           int padding) {
  const auto width = static_cast<std::size_t>(display.width_px);
  const auto height = static_cast<std::size_t>(display.height_px);
  const std::size_t wide = width * padding, high = height * padding;
  Sums s;
  double wanted_sum = 0, ratio = 0, ratio2 = 0;
  std::size_t count = 0;
  const auto each = [&](const auto& use) {
    for (std::size_t y = 0; y < high; ++y) {
      // Sample padding * i lies on pixel i.
      const std::size_t py = height / 2 + y / padding - high / 2 / padding;
      for (std::size_t x = 0; x < wide; ++x) {
        const std::size_t px = width / 2 + x / padding - wide / 2 / padding;
        const double p = power[y * wide + x];
        const bool inside = py < height && px < width;
        use(p, inside ? static_cast<double>(plane.power[py * width + px]) : 0.0);
      }
    }
  };
  each([&](double p, double wanted) {
    s.all += p;
    if (wanted <= 0) return;
    s.on_target += p;
    wanted_sum += wanted;
    ratio += p / wanted;
    ratio2 += p / wanted * p / wanted;
    ++count;
  });
  if (count == 0 || !(s.on_target > 0)) return s;
  const double mean = s.on_target / static_cast<double>(count);
  const double mean_wanted = wanted_sum / static_cast<double>(count);
  each([&](double p, double wanted) {
    if (wanted <= 0) return;
    const double off = p / mean - wanted / mean_wanted;
    s.error += off * off;
  });
  const auto n = static_cast<double>(count);
  s.error = std::sqrt(s.error / n);
  const double mean_ratio = ratio / n;
  s.contrast = std::sqrt(std::max(0.0, ratio2 / n - mean_ratio * mean_ratio)) / mean_ratio;
  return s;
}

}  // namespace

std::vector<float> power_at(const PhaseDisplay& display, const HologramOptics& optics,
                            const std::vector<float>& phase_rad, double dz_mm, int padding,
                            const ExecutionContext& context) {
  return power_of(display, optics, phase_rad, {0, 0, dz_mm, padding}, context);
}

ImageFigures figures_of(const PhaseDisplay& display, const HologramOptics& optics,
                        const HologramPlane& plane,
                        const std::vector<std::vector<float>>& phases_rad,
                        const ExecutionContext& context, std::vector<float>* power) {
  if (phases_rad.empty()) throw InputError("expected a phase image to judge");
  ImageFigures figures;
  for (const int padding : {1, 2}) {
    std::vector<float> mean;
    for (const std::vector<float>& phase : phases_rad) {
      const std::vector<float> one = power_of(
          display, optics, phase, {plane.dx_mm, plane.dy_mm, plane.dz_mm, padding}, context);
      if (mean.empty()) mean.resize(one.size());
      for (std::size_t i = 0; i < one.size(); ++i) {
        mean[i] += one[i] / static_cast<float>(phases_rad.size());
      }
    }
    const Sums s = judge(display, plane, mean, padding);
    if (padding == 1) {
      figures.efficiency = s.all > 0 ? s.on_target / s.all : 0;
      figures.rms_error = s.error;
    } else {
      figures.rms_error_padded = s.error;
      figures.speckle_contrast = s.contrast;
      if (power) *power = std::move(mean);
    }
  }
  return figures;
}

void propagate(std::vector<std::complex<float>>& field, int width_px, int height_px,
               double pitch_mm, double wavelength_nm, double z_mm,
               const ExecutionContext& context) {
  if (width_px < 1 || height_px < 1 ||
      field.size() != static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px)) {
    throw InputError("a field needs as many numbers as pixels");
  }
  if (!(pitch_mm > 0) || !(wavelength_nm > 0) || !std::isfinite(z_mm)) {
    throw InputError("a field needs a pitch and a wavelength above 0 and a finite way");
  }
  const auto width = static_cast<std::size_t>(width_px),
             height = static_cast<std::size_t>(height_px);
  const std::size_t wide = 2 * width, high = 2 * height;
  std::vector<Complex> plane(wide * high);
  for (std::size_t y = 0; y < height; ++y) {
    std::copy_n(&field[y * width], width, &plane[y * wide]);
  }
  const double window_x = static_cast<double>(wide) * pitch_mm;
  const double window_y = static_cast<double>(high) * pitch_mm;
  const Spectrum way(wavelength_nm * 1e-6, z_mm, window_x, window_y);
  const PlaneFft<float> fft(high, wide);
  fft.transform(context, plane.data(), Way::forward, detail::Scale::unitary);
  const auto frequency = [](std::size_t k, std::size_t n, double window) {
    return (static_cast<double>(k) - (2 * k >= n ? static_cast<double>(n) : 0.0)) / window;
  };
  over_rows(context, high, [&](std::size_t y) {
    const double fy = frequency(y, high, window_y);
    for (std::size_t x = 0; x < wide; ++x) {
      plane[y * wide + x] *= way(frequency(x, wide, window_x), fy);
    }
  });
  fft.transform(context, plane.data(), Way::backward, detail::Scale::unitary);
  for (std::size_t y = 0; y < height; ++y) {
    std::copy_n(&plane[y * wide], width, &field[y * width]);
  }
}

}  // namespace slicecorr
