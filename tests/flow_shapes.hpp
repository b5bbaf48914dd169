// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file flow_shapes.hpp
/// Sections for tests and tables of resin flow, and chapter IV's resins on them.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "chapter_iv_resins.hpp"
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

/// A ring of 3 to 9 mm whose hole is open, or blind: what is inside of the middle radius and no part.
inline FlowSection ring_section(double pitch_um, FlowCell hole = FlowCell::bath) {
  FlowSection s = section_where(9e3, 9e3, pitch_um, [](double x, double y) {
    const double r = std::hypot(x, y);
    return r > 3e3 && r < 9e3;
  });
  for (int y = 0; y < s.height; ++y) {
    for (int x = 0; x < s.width; ++x) {
      const double r = s.pitch_x_um * std::hypot(x - s.width / 2 + 0.5, y - s.height / 2 + 0.5);
      FlowCell& cell = s.cells[s.index(x, y)];
      if (r < 6e3 && cell == FlowCell::bath) cell = hole;
    }
  }
  return s;
}

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

/// Places of a disc over its radius, and means around it there.
inline constexpr std::array<double, 5> kRadii{0.1, 0.3, 0.5, 0.7, 0.9};
inline std::array<double, 5> around(const FlowSection& s, const std::vector<double>& values,
                                    double radius_um) {
  std::array<double, 5> means{};
  for (std::size_t k = 0; k < kRadii.size(); ++k) {
    for (int a = 0; a < 64; ++a) {
      const double r = kRadii[k] * radius_um, angle = 2 * std::numbers::pi * a / 64;
      means[k] += value_at(s, values, r * std::cos(angle), r * std::sin(angle)) / 64;
    }
  }
  return means;
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
