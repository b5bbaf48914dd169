// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What a lab measures of light that spreads, with and without scatter.
#pragma once

#include <cmath>
#include <numbers>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "models.hpp"
#include "slicecorr/resins/spread_fit.hpp"

namespace slicecorr::test {

using resins::EdgeSample;
using resins::KnifeEdge;
using resins::PrintedWidth;
using resins::SpreadFitOptions;
using resins::SpreadMeasurements;
using resins::WidthKind;

inline double normal(double t) { return 0.5 * std::erfc(-t / std::numbers::sqrt2); }

/// What a lab has in front of it.
struct Lab {
  std::vector<SpreadGaussian> spread = {{40, 1}};
  double scatter = 0, dose = 6.25, dark = 0.01, m = 1, height_e_um = 0;
  bool moving = false;

  double share(double half, double x, double depth) const {
    double sum = 0;
    for (const auto& [sigma, weight] : spread) {
      const double s = std::sqrt(sigma * sigma + scatter * depth);
      sum += weight * (normal((x + half) / s) - normal((x - half) / s));
    }
    return sum;
  }
  double light(bool gap, double full, double half, double x, double depth) const {
    const double b = share(half, x, depth);
    return dark + (full - dark) * (gap ? 1 - b : b);
  }
  double dose_at(bool gap, double full, double half, double x, double depth) const {
    if (!moving) {
      const double left = height_e_um > 0 ? std::exp(-m * depth / height_e_um) : 1;
      return dose * left * std::pow(light(gap, full, half, x, depth), m);
    }
    // Thin slices, each at the depth of its middle; up to where 2e-9 is left.
    const double he = height_e_um / m, thin = he / 500, end = std::min(depth, 20 * he);
    double sum = 0;
    for (double u = 0; u < end; u += thin) {
      const double to = std::min(u + thin, end);
      sum += (std::exp(-u / he) - std::exp(-to / he)) *
             std::pow(light(gap, full, half, x, 0.5 * (u + to)), m);
    }
    return dose * sum;
  }
  /// By halving, to 1e-9 um.
  double width(WidthKind kind, double designed, double depth = 0, double full = 1) const {
    const bool gap = kind == WidthKind::gap;
    const auto printed = [&](double x) { return dose_at(gap, full, designed / 2, x, depth) >= 1; };
    if (printed(0) == gap) return 0;
    double in = 0, out = designed + 1500;
    for (int i = 0; i < 42; ++i) {
      const double middle = 0.5 * (in + out);
      (printed(middle) == gap ? out : in) = middle;
    }
    return 2 * in;
  }
};

/// Lines and gaps of 1 to 12 pixels of 50 um; what is not left is 0.
inline SpreadMeasurements measured(const Lab& lab, double noise_um, unsigned seed, int repeats = 1,
                                   const std::vector<double>& depths = {0}) {
  SpreadMeasurements all;
  all.source = "widths.csv";
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0, noise_um);
  int line = 1;
  for (const double depth : depths) {
    for (const WidthKind kind : {WidthKind::line, WidthKind::gap}) {
      for (int n = 1; n <= 12; ++n) {
        const double width = lab.width(kind, 50.0 * n, depth);
        for (int r = 0; r < repeats; ++r) {
          PrintedWidth w{++line, kind, 50.0 * n, width};
          if (noise_um > 0 && width > 0) w.printed_um = std::max(0.0, width + noise(random));
          w.depth_um = depth;
          all.widths.push_back(w);
        }
      }
    }
  }
  return all;
}

/// Black is a hundredth of full light.
inline Printer printer_of_lab() {
  Printer p = test::linear_printer(1, 100);
  p.width_px = 1280;
  p.height_px = 800;
  p.pixel_x_um = p.pixel_y_um = 50;
  return p;
}

inline SpreadFitOptions with(const Printer& printer) {
  SpreadFitOptions o;
  o.printer = &printer;
  return o;
}

inline KnifeEdge scan(double sigma, double noise, unsigned seed, double depth = 0,
                      const std::vector<SpreadGaussian>& spread = {}) {
  KnifeEdge e;
  e.source = "edge.csv";
  e.depth_um = depth;
  std::mt19937 random(seed);
  std::normal_distribution<double> scatter(0, 1);
  int line = 1;
  for (double x = -300; x <= 300; x += 7.5) {
    double share = normal((x - 12.3) / sigma);
    if (!spread.empty()) {
      share = 0;
      for (const auto& g : spread) share += g.weight * normal((x - 12.3) / g.sigma_um);
    }
    double v = 3 + 40 * share;
    if (noise > 0) v += 40 * noise * scatter(random);
    e.samples.push_back({++line, x, v});
  }
  return e;
}
inline SpreadMeasurements scans(std::vector<KnifeEdge> edges) {
  SpreadMeasurements all;
  all.source = "edge.csv";
  all.edges = std::move(edges);
  return all;
}

}  // namespace slicecorr::test
