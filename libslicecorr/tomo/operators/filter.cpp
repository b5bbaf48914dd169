// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/tomo/filter.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <iterator>
#include <numbers>
#include <unsupported/Eigen/FFT>

#include "slicecorr/error.hpp"
#include "tomo/operators/axis_projector.hpp"

namespace slicecorr::tomo {
namespace {

using Complex = std::complex<float>;
using std::numbers::pi;

/// `share` is |k| over the highest frequency, 0..1.
double window_at(Window window, double share) {
  switch (window.kind) {
    case Window::hamming:
      return 0.54 + 0.46 * std::cos(pi * share);
    case Window::kelly:
      return std::exp(-std::pow(share / window.k0, 4));
    case Window::ram_lak:
      break;
  }
  return 1;
}

void scale_to_one(Array<float>& values) {
  const float most = values.empty() ? 0 : *std::max_element(values.begin(), values.end());
  if (most <= 0) return;
  for (float& v : values) v /= most;
}

}  // namespace

Window window_named(std::string_view name) {
  constexpr Window kAll[] = {Window::hamming, Window::ram_lak, Window::kelly};
  static_assert(std::size(kAll) == std::size(kWindowNames));
  const auto* const found = std::find(std::begin(kWindowNames), std::end(kWindowNames), name);
  if (found != std::end(kWindowNames)) return kAll[found - std::begin(kWindowNames)];
  throw InputError(fmt::format("no window '{}'; expected {}", name, fmt::join(kWindowNames, ", ")));
}

void ramp_filter(const ExecutionContext& context, Light& light, Window window, double cut_per_mm) {
  const TomoGrid& grid = light.grid;
  int size = 2;
  // A cut filter is wide along t, so copies of the line have to be farther away.
  while (size < (cut_per_mm > 0 ? 16 : 2) * grid.pixels) size *= 2;
  std::vector<float> ramp(size);
  for (int k = 0; k < size; ++k) {
    const double share = 2.0 * std::min(k, size - k) / size;
    // Samples are 2 pi / (size p) apart, which is not small against a cut: the mean over a sample's
    // range puts it where it is.
    const double cut = cut_per_mm * grid.pixel_mm / pi, half = 1.0 / size;
    const double low = std::max(share - half, cut), high = std::max(share + half, cut);
    // The range of 0 has both signs.
    const double mean = (high * high - low * low) / (k == 0 ? 2 * half : 4 * half);
    ramp[k] = static_cast<float>((cut > 0 ? mean : share) * window_at(window, share));
  }
  const auto lanes = static_cast<std::size_t>(grid.light_lanes()),
             pixels = static_cast<std::size_t>(grid.pixels);
  // Two rows at once, one as the real and one as the imaginary part: the filter is real and even.
  const std::size_t rows = static_cast<std::size_t>(grid.angles) * lanes;
  parallel_for(context, "filtering", light.grid.blocks(), [&](std::size_t b) {
    Eigen::FFT<float> fft;
    std::vector<Complex> line(size), spectrum(size);
    float* block = light.block(b);
    const auto at = [&](std::size_t row) {
      return block + row / lanes * pixels * lanes + row % lanes;
    };
    for (std::size_t row = 0; row < rows; row += 2) {
      float* first = at(row);
      float* second = row + 1 < rows ? at(row + 1) : nullptr;
      std::fill(line.begin(), line.end(), Complex());
      for (std::size_t i = 0; i < pixels; ++i) {
        line[i] = {first[i * lanes], second == nullptr ? 0 : second[i * lanes]};
      }
      fft.fwd(spectrum.data(), line.data(), size);
      for (int k = 0; k < size; ++k) spectrum[k] *= ramp[k];
      fft.inv(line.data(), spectrum.data(), size);
      for (std::size_t i = 0; i < pixels; ++i) {
        first[i * lanes] = line[i].real();
        if (second != nullptr) second[i * lanes] = line[i].imag();
      }
    }
  });
}

namespace {

/// Where a row of light is among the slices: below this one and the next, by shares; -1: in none.
struct BetweenSlices {
  int below = -1;
  float share = 0;
};
std::vector<BetweenSlices> slices_of_rows(const TomoGrid& grid, const RayTables& optics) {
  std::vector<BetweenSlices> rows(static_cast<std::size_t>(grid.rows));
  if (optics.row_mm.size() != rows.size()) {
    throw InputError("optics", "row_mm",
                     fmt::format("has {} heights; expected {}, one for each row",
                                 optics.row_mm.size(), rows.size()));
  }
  for (std::size_t r = 0; r < rows.size(); ++r) {
    const double z = (optics.row_mm[r] - grid.lowest_mm) / grid.slice_height_mm();
    // Half a slice beyond the part's ends, too.
    if (!(z > -0.5 && z < grid.slices - 0.5)) continue;
    const double within = std::clamp(z, 0.0, grid.slices - 1.0);
    rows[r].below = std::min(static_cast<int>(within), grid.slices - 2);
    rows[r].share = static_cast<float>(within - rows[r].below);
  }
  return rows;
}

}  // namespace

Light filtered_start(const ExecutionContext& context, const Target& target, const RayTables& optics,
                     Window window) {
  const TomoGrid& grid = target.grid;
  // Level lines, slice by slice.
  TomoGrid level = grid;
  level.rows = 0;
  const auto axis = detail::make_axis_projector(level, -optics.alpha_per_mm);
  Field gel(level);
  for (int z = 0; z < grid.slices; ++z) {
    for (int y = 0; y < grid.voxels; ++y) {
      for (int x = 0; x < grid.voxels; ++x) {
        const bool is_gel = target.kinds[grid.voxel(x, y, z)] == Kind::gel;
        gel.values[level.voxel(x, y, z)] = is_gel ? 1.0f : 0.0f;
      }
    }
  }
  Light lines = forward(*axis, context, gel);
  ramp_filter(context, lines, window, optics.alpha_per_mm);
  Light light(grid);
  std::vector<BetweenSlices> between;
  if (grid.coupled()) between = slices_of_rows(grid, optics);
  const int pixels = grid.pixels, angles = grid.angles;
  const auto lanes = static_cast<std::size_t>(level.lanes());
  Array<float> line(level.blocks() * lanes);  // of all slices
  for (int i = 0; i < pixels; ++i) {
    const double t = optics.line_mm.empty() ? grid.pixel_at_mm(i) : optics.line_mm[i];
    const double weight = optics.weight.empty() ? 1 : optics.weight[i];
    if (weight <= 0) continue;
    const double f = t / grid.pixel_mm + 0.5 * (pixels - 1);
    if (f < 0 || f > pixels - 1) continue;
    const int column = std::min(static_cast<int>(f), pixels - 2);
    const auto beside = static_cast<float>(f - column);
    const double ahead = optics.turn_rad.empty() ? 0 : optics.turn_rad[i] * angles / (2 * pi);
    const double whole = std::floor(ahead);
    const auto later = static_cast<float>(ahead - whole);
    int shift = static_cast<int>(std::fmod(whole, angles));
    if (shift < 0) shift += angles;
    const double chord = std::sqrt(std::max(0.0, grid.radius_mm * grid.radius_mm - t * t));
    const auto gain = static_cast<float>(std::exp(optics.alpha_per_mm * chord) / weight);
    for (int m = 0; m < angles; ++m) {
      const std::size_t m0 = (m + shift) % angles, m1 = (m + shift + 1) % angles;
      for (std::size_t b = 0; b < level.blocks(); ++b) {
        const float* const p0 = lines.block(b) + (m0 * pixels + column) * lanes;
        const float* const p1 = lines.block(b) + (m1 * pixels + column) * lanes;
        float* const out = line.data() + b * lanes;
        for (std::size_t l = 0; l < lanes; ++l) {
          const float now = (1 - beside) * p0[l] + beside * p0[l + lanes];
          const float next = (1 - beside) * p1[l] + beside * p1[l + lanes];
          out[l] = std::max(0.0f, gain * ((1 - later) * now + later * next));
        }
        if (!grid.coupled()) {
          std::copy_n(out, lanes,
                      light.block(b) + (static_cast<std::size_t>(m) * pixels + i) * lanes);
        }
      }
      for (std::size_t r = 0; r < between.size(); ++r) {
        const BetweenSlices& at = between[r];
        if (at.below < 0) continue;
        light.values[grid.pixel(m, i, static_cast<int>(r))] =
            (1 - at.share) * line[at.below] + at.share * line[at.below + 1];
      }
    }
  }
  scale_to_one(light.values);
  return light;
}

Field filtered_model(const ExecutionContext& context, const Target& target, Window window) {
  const TomoGrid& grid = target.grid;
  const int n = grid.voxels;
  Field model(grid);
  std::vector<float> share(n);
  for (int k = 0; k < n; ++k) share[k] = static_cast<float>(2.0 * std::min(k, n - k) / n);
  parallel_for(context, "filtering", static_cast<std::size_t>(grid.slices), [&](std::size_t z) {
    Eigen::FFT<float> fft;
    std::vector<Complex> plane(static_cast<std::size_t>(n) * n), line(n), out(n);
    const auto each_line = [&](std::size_t step, std::size_t next, bool inverse) {
      for (int r = 0; r < n; ++r) {
        for (int k = 0; k < n; ++k) line[k] = plane[r * next + k * step];
        if (inverse) {
          fft.inv(out.data(), line.data(), n);
        } else {
          fft.fwd(out.data(), line.data(), n);
        }
        for (int k = 0; k < n; ++k) plane[r * next + k * step] = out[k];
      }
    };
    const int slice = static_cast<int>(z);
    for (int y = 0; y < n; ++y) {
      for (int x = 0; x < n; ++x) {
        plane[y * n + x] = target.kinds[grid.voxel(x, y, slice)] == Kind::gel ? 1.0f : 0.0f;
      }
    }
    each_line(1, n, false);
    each_line(n, 1, false);
    for (int y = 0; y < n; ++y) {
      for (int x = 0; x < n; ++x) {
        const double k = std::hypot(share[x], share[y]);
        plane[y * n + x] *= static_cast<float>(k * window_at(window, std::min(k, 1.0)));
      }
    }
    each_line(n, 1, true);
    each_line(1, n, true);
    for (int y = 0; y < n; ++y) {
      for (int x = grid.inside(y).first; x < grid.inside(y).end; ++x) {
        model.values[grid.voxel(x, y, slice)] = plane[y * n + x].real();
      }
    }
  });
  scale_to_one(model.values);
  return model;
}

}  // namespace slicecorr::tomo
