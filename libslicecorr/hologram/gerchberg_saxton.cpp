// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

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

using detail::PlaneFft;
using detail::Way;
using Complex = std::complex<float>;

using std::numbers::pi;

/// The generator of first phases: each number is the next one's seed.
std::uint32_t after(std::uint32_t x) { return 1664525u * x + 1013904223u; }

/// z/|z|, and 1 of nothing. A square root, not an angle, because angles are what takes long.
Complex direction(Complex z) {
  const float power = z.real() * z.real() + z.imag() * z.imag();
  if (!(power > 0)) return {1, 0};
  const float scale = 1 / std::sqrt(power);
  return {z.real() * scale, z.imag() * scale};
}

/// One plane on the way, in the order of transforms.
struct Plane {
  std::vector<float> amplitude;         ///< wanted, t; t^2 sums to the light of the display
  std::vector<std::uint8_t> rows;       ///< those with light
  std::vector<Complex> turn_x, turn_y;  ///< what moves it, e^(i phi) by column and by row
  std::vector<Complex> image;
  float weight = 1;
  bool moved = false;
};

class Iteration {
 public:
  Iteration(const PhaseDisplay& display, const HologramOptics& optics,
            const std::vector<HologramPlane>& wanted, bool free_outside,
            const ExecutionContext& context)
      : width_(static_cast<std::size_t>(display.width_px)),
        height_(static_cast<std::size_t>(display.height_px)),
        free_outside_(free_outside),
        context_(context),
        fft_(height_, width_),
        field_(width_ * height_) {
    for (const HologramPlane& w : wanted) planes_.push_back(plane_of(display, optics, w));
  }

  std::vector<float> run(std::uint32_t& seed, int steps, double done, double share) {
    start(seed);
    for (int step = 0; step < steps; ++step) {
      context_.check_cancelled();
      to_display();
      to_images();
      context_.report("making the hologram", done + share * (step + 1) / steps);
    }
    to_display();
    return phases();
  }

 private:
  Plane plane_of(const PhaseDisplay& display, const HologramOptics& optics,
                 const HologramPlane& w) const {
    const HologramGeometry g = geometry_of(display, optics);
    const bool turned = optics.relay_f1_mm > 0;
    const double m = optics.magnification();
    Plane p;
    p.amplitude.resize(width_ * height_);
    p.rows.resize(height_);
    double power = 0;
    for (std::size_t y = 0; y < height_; ++y) {
      for (std::size_t x = 0; x < width_; ++x) {
        double t2 = w.power[y * width_ + x];
        if (t2 <= 0) continue;
        const double at_x = detail::from_axis(x, width_) * g.pixel_x_mm + w.dx_mm;
        const double at_y = -detail::from_axis(y, height_) * g.pixel_y_mm + w.dy_mm;
        t2 /= fall_off(display, optics, at_x, at_y);
        const std::size_t to_y =
            detail::unwound(turned ? detail::mirrored(y, height_) : y, height_);
        const std::size_t to_x = detail::unwound(turned ? detail::mirrored(x, width_) : x, width_);
        p.amplitude[to_y * width_ + to_x] = static_cast<float>(std::sqrt(t2));
        p.rows[to_y] = 1;
        power += t2;
      }
    }
    const double all = static_cast<double>(width_) * static_cast<double>(height_);
    const auto scale = static_cast<float>(std::sqrt(all / power));
    for (float& t : p.amplitude) t *= scale;
    if (free_outside_) std::fill(p.rows.begin(), p.rows.end(), std::uint8_t{1});

    const double l = optics.wavelength_nm * 1e-6, d = display.pitch_um * 1e-3, f = optics.focal_mm;
    const double sign = turned ? -1 : 1;
    p.moved = w.dx_mm != 0 || w.dy_mm != 0 || w.dz_mm != 0;
    const auto turns = [&](std::size_t n, double shift_mm) {
      std::vector<Complex> turn(n);
      for (std::size_t i = 0; i < n; ++i) {
        const double x = detail::from_axis(i, n) * d;
        const double phase =
            2 * pi * x * shift_mm / (l * f) + pi * (w.dz_mm / (m * m)) * x * x / (l * f * f);
        turn[detail::unwound(i, n)] = Complex(std::polar(1.0, phase));
      }
      return turn;
    };
    p.turn_x = turns(width_, sign * w.dx_mm / m);
    // Rows run downwards.
    p.turn_y = turns(height_, -sign * w.dy_mm / m);
    p.image.resize(width_ * height_);
    return p;
  }

  template <class Body>
  void over_rows(const Body& body) {
    constexpr std::size_t kRows = 16;
    parallel_for(detail::silent(context_), "", (height_ + kRows - 1) / kRows, [&](std::size_t b) {
      for (std::size_t y = b * kRows; y < std::min(height_, (b + 1) * kRows); ++y) body(y);
    });
  }

  void start(std::uint32_t& seed) {
    for (Plane& p : planes_) {
      p.weight = 1;
      for (std::size_t y = 0; y < height_; ++y) {
        for (std::size_t x = 0; x < width_; ++x) {
          seed = after(seed);
          const std::size_t to = detail::unwound(y, height_) * width_ + detail::unwound(x, width_);
          p.image[to] = p.amplitude[to] * Complex(std::polar(1.0, 2 * pi * seed / 4294967296.0));
        }
      }
    }
  }

  /// The display's field of the images, e^(i s).
  void to_display() {
    for (std::size_t k = 0; k < planes_.size(); ++k) {
      Plane& p = planes_[k];
      fft_.along_rows(context_, p.image.data(), Way::backward, 1, p.rows.data());
      fft_.along_columns(context_, p.image.data(), Way::backward, 1);
      const bool first = k == 0, last = k + 1 == planes_.size();
      over_rows([&](std::size_t y) {
        for (std::size_t i = y * width_, x = 0; x < width_; ++x, ++i) {
          Complex z = p.image[i];
          if (p.moved)
            z *= p.turn_x[x] * p.turn_y[y] * p.weight;
          else
            z *= p.weight;
          if (!first) z += field_[i];
          field_[i] = last ? direction(z) : z;
        }
      });
    }
  }

  /// The images of the display's field, with the amplitude that is wanted.
  void to_images() {
    const double all = static_cast<double>(width_) * static_cast<double>(height_);
    const auto unitary = static_cast<float>(1 / std::sqrt(all));
    std::vector<double> on_target(planes_.size());
    for (std::size_t k = 0; k < planes_.size(); ++k) {
      Plane& p = planes_[k];
      over_rows([&](std::size_t y) {
        for (std::size_t i = y * width_, x = 0; x < width_; ++x, ++i) {
          p.image[i] = p.moved ? field_[i] * std::conj(p.turn_x[x] * p.turn_y[y]) : field_[i];
        }
      });
      fft_.along_columns(context_, p.image.data(), Way::forward, unitary);
      fft_.along_rows(context_, p.image.data(), Way::forward, 1, p.rows.data());
      std::vector<double> of_row(height_);
      over_rows([&](std::size_t y) {
        Complex* row = &p.image[y * width_];
        if (p.rows[y] == 0) {
          std::fill(row, row + width_, Complex());
          return;
        }
        const float* t = &p.amplitude[y * width_];
        double sum = 0;
        for (std::size_t x = 0; x < width_; ++x) {
          if (t[x] > 0) {
            sum += std::norm(row[x]);
            row[x] = t[x] * direction(row[x]);
          } else if (!free_outside_) {
            row[x] = 0;
          }
        }
        of_row[y] = sum;
      });
      for (const double sum : of_row) on_target[k] += sum;
    }
    if (planes_.size() == 1) return;
    double mean = 0;
    for (const double sum : on_target) mean += sum / static_cast<double>(planes_.size());
    for (std::size_t k = 0; k < planes_.size(); ++k) {
      planes_[k].weight *= static_cast<float>(std::sqrt(mean / std::max(on_target[k], 1e-30)));
    }
  }

  std::vector<float> phases() {
    std::vector<float> phase(width_ * height_);
    over_rows([&](std::size_t y) {
      const Complex* row = &field_[detail::unwound(y, height_) * width_];
      for (std::size_t x = 0; x < width_; ++x) {
        const Complex z = row[detail::unwound(x, width_)];
        float s = std::atan2(z.imag(), z.real());
        if (s < 0) s += static_cast<float>(2 * pi);
        phase[y * width_ + x] = s < static_cast<float>(2 * pi) ? s : 0;
      }
    });
    return phase;
  }

  std::size_t width_, height_;
  bool free_outside_;
  const ExecutionContext& context_;
  PlaneFft<float> fft_;
  std::vector<Plane> planes_;
  std::vector<Complex> field_;
};

/// The farthest light of a plane from its middle, mm, and whether the axis lies in its light.
struct Extent {
  double x_mm = 0, y_mm = 0;
  bool on_axis = false;
};
Extent extent_of(const PhaseDisplay& display, const HologramGeometry& g, const HologramPlane& p) {
  const auto width = static_cast<std::size_t>(display.width_px);
  const auto height = static_cast<std::size_t>(display.height_px);
  Extent e;
  for (std::size_t y = 0; y < height; ++y) {
    for (std::size_t x = 0; x < width; ++x) {
      if (p.power[y * width + x] <= 0) continue;
      const double at_x = detail::from_axis(x, width) * g.pixel_x_mm + p.dx_mm;
      const double at_y = -detail::from_axis(y, height) * g.pixel_y_mm + p.dy_mm;
      e.x_mm = std::max(e.x_mm, std::abs(at_x));
      e.y_mm = std::max(e.y_mm, std::abs(at_y));
      // The spot is as wide as a pixel to either side.
      e.on_axis =
          e.on_axis || (std::abs(at_x) < 1.5 * g.pixel_x_mm && std::abs(at_y) < 1.5 * g.pixel_y_mm);
    }
  }
  return e;
}

void check_planes(const PhaseDisplay& display, const HologramOptics& optics,
                  const std::vector<HologramPlane>& planes, const ExecutionContext& context) {
  check(display, optics);
  if (planes.empty()) throw InputError("expected a target");
  const HologramGeometry g = geometry_of(display, optics);
  const std::size_t pixels =
      static_cast<std::size_t>(display.width_px) * static_cast<std::size_t>(display.height_px);
  for (const HologramPlane& p : planes) {
    if (p.power.size() != pixels) {
      throw InputError(
          p.name, "",
          fmt::format("has {} pixels, the display {}; expected as many", p.power.size(), pixels));
    }
    for (const float power : p.power) {
      if (!(power >= 0) || !std::isfinite(power)) {
        throw InputError(p.name, "", "wants power that is no number from 0 on");
      }
    }
    if (std::none_of(p.power.begin(), p.power.end(), [](float v) { return v > 0; })) {
      throw InputError(p.name, "", "is black; expected a target with light in it");
    }
    if (!(std::abs(p.dz_mm) < g.most_depth_mm)) {
      throw InputError(p.name, "",
                       fmt::format("is moved by {:.4g} mm in depth, where phases of neighbouring "
                                   "pixels differ by half a turn; expected less than {:.4g} mm",
                                   p.dz_mm, g.most_depth_mm));
    }
    const Extent e = extent_of(display, g, p);
    if (!(std::max(e.x_mm, e.y_mm) <= g.most_shift_mm * (1 + 1e-9))) {
      throw InputError(
          p.name, "",
          fmt::format("reaches {:.4g} mm from the axis, moved by {:.4g}, {:.4g} mm; expected all "
                      "of it within {:.4g} mm, beyond which it appears on the other side",
                      std::max(e.x_mm, e.y_mm), p.dx_mm, p.dy_mm, g.most_shift_mm));
    }
    if (e.on_axis && p.dz_mm == 0 && !display.stroke_turns) {
      context.tell(fmt::format(
          "{} has light on the axis, where light that the display does not delay falls as well: "
          "{:.1f} % of all if its stroke is a whole turn, {:.0f} % if it is half a turn; move the "
          "image aside, or in depth past a stop, or say the stroke as measured",
          p.name, 100 * zero_order(display.fill.value_or(0.87), display.front_reflection, 1),
          100 * zero_order(display.fill.value_or(0.87), display.front_reflection, 0.5)));
    }
  }
}

}  // namespace

std::vector<PhaseImage> make_holograms(const PhaseDisplay& display, const HologramOptics& optics,
                                       const std::vector<HologramPlane>& planes,
                                       const HologramOptions& options,
                                       const ExecutionContext& context) {
  check_planes(display, optics, planes, context);
  if (options.steps < 1 || options.steps > 100000) {
    throw InputError(fmt::format("{} steps; expected 1 to 100000", options.steps));
  }
  if (options.holograms < 1 || options.holograms > 1024) {
    throw InputError(fmt::format("{} holograms; expected 1 to 1024", options.holograms));
  }
  Iteration iteration(display, optics, planes, options.free_outside, context);
  std::vector<PhaseImage> images;
  std::uint32_t seed = options.seed;
  for (int i = 0; i < options.holograms; ++i) {
    PhaseImage image;
    image.seed = seed;
    image.phase_rad = iteration.run(seed, options.steps, static_cast<double>(i) / options.holograms,
                                    1.0 / options.holograms);
    images.push_back(std::move(image));
  }
  return images;
}

}  // namespace slicecorr
