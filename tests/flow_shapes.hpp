/// @file flow_shapes.hpp
/// Sections and resins of chapter IV, for tests and the benchmark of resin flow.
#pragma once

#include <algorithm>
#include <cmath>

#include "slicecorr/flow_section.hpp"

namespace slicecorr::test {

/// Cells of `pitch_um`, with a ring of bath, of the places where `inside(x, y)`, um from the middle.
template <typename Inside>
FlowSection section_where(double half_x_um, double half_y_um, double pitch_um, Inside inside) {
  const int width = static_cast<int>(std::ceil(2 * half_x_um / pitch_um - 1e-9)) + 2;
  const int height = static_cast<int>(std::ceil(2 * half_y_um / pitch_um - 1e-9)) + 2;
  const int fine = 16;
  std::vector<float> coverage;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      int hits = 0;
      for (int k = 0; k < fine * fine; ++k) {
        const double u = (x - width / 2.0 + (k % fine + 0.5) / fine) * pitch_um;
        const double v = (y - height / 2.0 + (k / fine + 0.5) / fine) * pitch_um;
        hits += inside(u, v) ? 1 : 0;
      }
      coverage.push_back(static_cast<float>(hits) / (fine * fine));
    }
  }
  return section_of_coverage(width, height, pitch_um, pitch_um, coverage);
}

/// A disc of so many cells across.
inline FlowSection disc_section(double radius_um, int cells) {
  return section_where(radius_um, radius_um, 2 * radius_um / cells,
                       [&](double x, double y) { return std::hypot(x, y) < radius_um; });
}

/// All cells are part.
inline FlowSection full_section(int width, int height, double pitch_um) {
  FlowSection s;
  s.width = width;
  s.height = height;
  s.pitch_x_um = s.pitch_y_um = pitch_um;
  s.cells.assign(s.size(), FlowCell::part);
  return s;
}

/// Table 4.1 has volumetric numbers.
inline FlowResin chapter_resin(double dose_mj_cm3, double hb_um, double huv_um, double beta) {
  FlowResin r;
  r.kinetics = {hb_um, 1, dose_mj_cm3 * hb_um * 1e-4, beta * hb_um / huv_um, huv_um};
  r.viscosity_pa_s = 0.3;
  r.diffusion_m2_s = 1e-10;
  return r;
}
inline FlowResin chapter_r1() { return chapter_resin(1500, 600, 50, 7.58e-2); }
inline FlowResin chapter_r2() { return chapter_resin(1600, 408, 38, 7.45e-2); }

/// Between the cells' middles, x and y um from the section's middle.
inline double value_at(const FlowSection& s, const std::vector<double>& values, double x_um,
                       double y_um) {
  const double x = x_um / s.pitch_x_um + 0.5 * s.width - 0.5;
  const double y = y_um / s.pitch_y_um + 0.5 * s.height - 0.5;
  const int i = std::clamp(static_cast<int>(std::floor(x)), 0, s.width - 2);
  const int j = std::clamp(static_cast<int>(std::floor(y)), 0, s.height - 2);
  const double u = x - i, v = y - j;
  return (1 - v) * ((1 - u) * values[s.index(i, j)] + u * values[s.index(i + 1, j)]) +
         v * ((1 - u) * values[s.index(i, j + 1)] + u * values[s.index(i + 1, j + 1)]);
}

/// At 300 mm/h and a gap of 80 um unless said.
inline SectionSweep sweep_of(const FlowSection& s, const FlowResin& resin, double gap_um = 80,
                             int levels = 48, double speed_mm_h = 300) {
  return {s, solve_pressure(s), resin, speed_mm_h, {&gap_um, 1}, {levels}};
}
inline SectionDose even_dose(const SectionSweep& sweep, double blue, double uv) {
  return sweep.dose({&blue, 1}, {&uv, 1});
}

/// A ring with a blind hole that is not in the middle, and a corner.
inline FlowSection odd_section() {
  FlowSection s = section_where(5e3, 4e3, 250, [](double x, double y) {
    return std::hypot(x, y) < 4e3 || (x > 0 && std::abs(y) < 2e3);
  });
  for (int y = 14; y < 19; ++y) {
    for (int x = 22; x < 26; ++x) s.cells[s.index(x, y)] = FlowCell::blind;
  }
  return s;
}

}  // namespace slicecorr::test
