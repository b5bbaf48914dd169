// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo_jobs.hpp
/// Small tomographic printers and jobs for tests.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <random>
#include <vector>

#include "slicecorr/tomo/print.hpp"

namespace slicecorr::tomo {

inline double largest(const Box<float>& box) {
  return *std::max_element(box.values.begin(), box.values.end());
}

/// Pixels of 0.25 mm before a vial of 4 mm; in a bath of the resin's index unless made dry.
inline Printer bench_printer() {
  Printer p;
  p.name = "bench";
  p.width_px = 48;
  p.height_px = 40;
  p.pixel_x_um = p.pixel_y_um = 250;
  p.bit_depth = 8;
  p.wavelength_nm = 405;
  p.calibration = {{0, 0.002}, {255, 2.0}};
  p.vial = Vial{4.5, 4.0, 1.5, 1.5};
  p.optics = slicecorr::Optics{};
  p.rotation = Rotation{25, TurnDirection::clockwise, 60};
  return p;
}

inline Printer dry_printer() {
  Printer p = bench_printer();
  p.vial = Vial{4.5, 4.0, 1.0, 1.48};
  p.optics->axis_right_px = 0.3;
  p.optics->axis_up_px = -2;
  p.rotation->direction = TurnDirection::counterclockwise;
  return p;
}

inline Resin bench_resin(double alpha_per_cm = 2.5) {
  Resin r;
  r.name = "resin";
  r.m = 1;
  r.n = 1.5;
  r.absorbance_height10_um = 1e4 * std::log(10.0) / alpha_per_cm;
  r.critical_dose_mj_cm3 = 20;
  return r;
}

/// A picture of uneven light of which 200 is what the calibration says.
inline FlatField field_of(int width, int height, const std::function<int(int, int)>& value) {
  FlatField f;
  f.width_px = width;
  f.height_px = height;
  auto values = std::make_shared<std::vector<std::uint8_t>>();
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) values->push_back(static_cast<std::uint8_t>(value(x, y)));
  }
  f.values = values;
  f.reference = 200;
  return f;
}

/// A job of random levels.
inline TomoJob random_job(const Printer& printer, int slices, int angles) {
  TomoJob job;
  job.printer = printer;
  job.resin = bench_resin();
  job.sampling = {0.25, slices, angles};
  job.turns = 3;
  const Bench bench = make_bench(job.printer, job.resin, job.sampling);
  const TomoGrid& g = bench.grid;
  job.part = {g.slices, g.voxels, g.voxels, {}};
  std::mt19937 random(5);
  for (int i = 0; i < g.slices * g.voxels * g.voxels; ++i) {
    job.part.values.push_back(random() % 3 == 0 ? 255 : 0);
  }
  job.levels.assign(g.blocks() * g.light_of_block(), 0);
  for (int m = 0; m < g.angles; ++m) {
    for (int i = 0; i < g.pixels; ++i) {
      for (int z = 0; z < g.slices; ++z) {
        job.levels[g.pixel(m, i, z)] = static_cast<std::uint16_t>(random() % 256);
      }
    }
  }
  return job;
}

/// A box as a mesh.
inline TriangleMesh box_mesh(const Point3& low, const Point3& high) {
  TriangleMesh mesh;
  for (int i = 0; i < 8; ++i) {
    mesh.vertices.push_back(
        {i & 1 ? high[0] : low[0], i & 2 ? high[1] : low[1], i & 4 ? high[2] : low[2]});
  }
  mesh.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                    {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  return mesh;
}

/// A square of 13 voxels beside the axis.
inline Box<std::uint8_t> square_part() {
  Box<std::uint8_t> part{1, 33, 33, std::vector<std::uint8_t>(33 * 33)};
  for (int y = 10; y < 23; ++y) {
    for (int x = 10; x < 23; ++x) part.values[part.at(0, y, x)] = 255;
  }
  return part;
}

}  // namespace slicecorr::tomo
