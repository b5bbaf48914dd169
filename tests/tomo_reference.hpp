// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What the tests of tomographic printing share: the pair of operators written out in double, voxel
/// by voxel, and the targets on which methods are compared.
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "slicecorr/tomo/projector.hpp"
#include "slicecorr/tomo/solve.hpp"
#include "slicecorr/tomo/volume.hpp"

namespace slicecorr::tomo {

/// From the engine alone: distributions differ between libraries. Multiples of 2^-16 are the same in single
/// precision.
inline std::vector<double> random_numbers(std::size_t count, unsigned seed) {
  std::mt19937 random(seed);
  std::vector<double> numbers(count);
  for (double& x : numbers) x = (random() >> 16) / 65536.0;
  return numbers;
}

/// A and A^T of one slice, from the formulas of projector.hpp.
class ReferenceProjector {
 public:
  ReferenceProjector(const TomoGrid& grid, const RayTables& optics, const Shadow* shadow = nullptr,
                     int slice = 0)
      : g_(grid), optics_(optics), shadow_(shadow), slice_(slice) {}

  /// Calls term(voxel, pixel, weight) for every weight that is not 0.
  template <class Term>
  void for_each(const Term& term) const {
    for (int m = 0; m < g_.angles; ++m) {
      const double th = g_.angle_rad(m), c = std::cos(th), s = std::sin(th);
      for (int y = 0; y < g_.voxels; ++y) {
        for (int x = g_.inside(y).first; x < g_.inside(y).end; ++x) {
          const double px = g_.voxel_at_mm(x), py = g_.voxel_at_mm(y);
          const double u = -px * s + py * c;
          const double f = (px * c + py * s) / g_.pixel_mm + 0.5 * (g_.pixels - 1);
          const double below = std::floor(f), w = f - below;
          for (const int k : {0, 1}) {
            const int i = static_cast<int>(below) + k;
            const double part = k == 0 ? 1 - w : w;
            if (i < 0 || i >= g_.pixels || part == 0) continue;
            if (shadow_ != nullptr && u >= shadow_->hit_mm[g_.pixel(m, i, slice_)]) continue;
            const double t = g_.pixel_at_mm(i), r = g_.radius_mm;
            const double l = std::sqrt(std::max(0.0, r * r - t * t)) + u;
            sources(m, i, part * std::exp(-optics_.alpha_per_mm * l),
                    [&](int pixel, double v) { term(y * g_.voxels + x, pixel, v); });
          }
        }
      }
    }
  }

  struct Pair {
    std::vector<double> forward, adjoint;
  };
  /// A of a field and A^T of light.
  Pair of(const std::vector<double>& field, const std::vector<double>& light) const {
    Pair pair{std::vector<double>(static_cast<std::size_t>(g_.angles) * g_.pixels),
              std::vector<double>(static_cast<std::size_t>(g_.voxels) * g_.voxels)};
    for_each([&](int v, int p, double w) {
      pair.forward[p] += w * field[v];
      pair.adjoint[v] += w * light[p];
    });
    return pair;
  }

 private:
  template <class Use>
  void sources(int m, int i, double value, const Use& use) const {
    if (optics_.line_mm.empty()) return from_column(m, i, value, use);
    const double t = g_.pixel_at_mm(i);
    for (int c = 0; c + 1 < g_.pixels; ++c) {
      const double a = optics_.line_mm[c], b = optics_.line_mm[c + 1];
      if (t < a || t > b || (t == a && c > 0)) continue;
      from_column(m, c, value * (b - t) / (b - a), use);
      from_column(m, c + 1, value * (t - a) / (b - a), use);
    }
  }
  template <class Use>
  void from_column(int m, int c, double value, const Use& use) const {
    if (!optics_.weight.empty()) value *= optics_.weight[c];
    const double turn = optics_.turn_rad.empty() ? 0 : optics_.turn_rad[c];
    const double angle = m - turn * g_.angles / (2 * std::numbers::pi);
    const double whole = std::floor(angle);
    const auto at = [&](double a) {
      return (static_cast<int>(a) % g_.angles + g_.angles) % g_.angles * g_.pixels + c;
    };
    use(at(whole), value * (1 - (angle - whole)));
    if (angle > whole) use(at(whole + 1), value * (angle - whole));
  }

  TomoGrid g_;
  RayTables optics_;
  const Shadow* shadow_;
  int slice_;
};

/// Sets coverage 255 where `inside(x, y, z)` holds at a voxel's centre; x, y in units of R, z from
/// -1 to 1 over the slices.
template <class Inside>
Volume part_of(const TomoGrid& grid, const Inside& inside) {
  Volume part(grid);
  for (int z = 0; z < grid.slices; ++z) {
    const double pz = grid.slices == 1 ? 0 : -1 + 2.0 * z / (grid.slices - 1);
    for (int y = 0; y < grid.voxels; ++y) {
      for (int x = 0; x < grid.voxels; ++x) {
        const double px = -1 + 2.0 * x / (grid.voxels - 1), py = -1 + 2.0 * y / (grid.voxels - 1);
        if (inside(px, py, pz)) part.coverage[grid.voxel(x, y, z)] = 255;
      }
    }
  }
  return part;
}

inline bool in_teeth(double x, double y) {
  const double r = std::hypot(x, y);
  return (r >= .30 && r < .60) || (r >= .60 && r < .75 && std::cos(8 * std::atan2(y, x)) > 0);
}
inline Volume t1(const TomoGrid& grid) {
  return part_of(
      grid, [](double x, double y, double) { return in_teeth(x, y) || std::hypot(x, y) < .12; });
}
inline Volume t2(const TomoGrid& grid) {
  return part_of(grid,
                 [](double x, double y, double) { return std::abs(x) < .45 && std::abs(y) < .45; });
}
inline Volume t3(const TomoGrid& grid) {
  return part_of(grid, [](double x, double y, double) { return in_teeth(x, y); });
}
inline Volume t3_insert(const TomoGrid& grid) {
  return part_of(grid, [](double x, double y, double) { return std::hypot(x, y) < .15; });
}
inline Volume gyroid(const TomoGrid& grid) {
  return part_of(grid, [](double x, double y, double z) {
    const double k = 3 * std::numbers::pi;
    return std::hypot(x, y) < .70 && std::abs(z) < .90 &&
           std::abs(std::sin(k * x) * std::cos(k * y) + std::sin(k * y) * std::cos(k * z) +
                    std::sin(k * z) * std::cos(k * x)) < .45;
  });
}

inline ExecutionContext on_threads(int threads) {
  ExecutionContext context;
  context.threads = threads;
  return context;
}

inline Field field_of(const Volume& part) {
  Field field(part.grid);
  for (std::size_t i = 0; i < part.coverage.size(); ++i) field.values[i] = part.coverage[i] / 255.f;
  return field;
}

inline SolveOptions osmo(int steps) {
  SolveOptions options;
  options.method = Method::osmo;
  options.steps = steps;
  return options;
}

/// The ladder on one rung, in exactly so many steps, without a proof.
inline SolveOptions rung(double value, int steps) {
  SolveOptions options;
  options.rungs = {value};
  options.steps = options.most_steps = steps;
  options.proof_steps = 0;
  return options;
}

}  // namespace slicecorr::tomo
