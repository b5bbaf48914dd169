// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo/widths.hpp
/// How far dose spreads in a resin (`Resin::dose_diffusion_m2_s`), from widths measured on one print.
///
/// The job's dose is computed with one diffusion after another (`dose_of`), and widths are those of what has
/// the gel dose, linear between the middles of voxels. Sought is the diffusion with the least sum of squares of
/// predicted less measured widths, by steps of a quarter of a voxel of spread and then by golden sections.
///
/// Thread-safe. Errors are `InputError`.
#pragma once

#include <string>
#include <vector>

#include "slicecorr/mesh.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/tomo/job.hpp"
#include "slicecorr/tomo/npy.hpp"

namespace slicecorr::tomo {

/// Of what is solid at a place, along an axis: x and y from the axis of rotation, z from the optical axis.
struct MeasuredWidth {
  Point3 at_mm{};
  int along = 0;  ///< 0: x, 1: y, 2: z
  double width_mm = 0;
};
/// A table with the columns x_mm, y_mm, z_mm, along (x, y or z) and width_mm.
std::vector<MeasuredWidth> read_widths(const std::string& path);

/// Width of what has the gel dose there, mm; 0 where the place has not. NaN where it reaches the last voxel.
double width_of(const Box<float>& dose, const Sampling& sampling, double gel_dose,
                const MeasuredWidth& where);

struct DiffusionFit {
  double diffusion_m2_s = 0;
  double spread_mm = 0;  ///< by which dose spreads over the whole print with it
  std::vector<double> predicted_mm;
  double rms_mm = 0;          ///< of predicted less measured widths
  double without_rms_mm = 0;  ///< the same without diffusion
  bool at_bound = false;  ///< as much as was looked for, four voxels: widths are of something else
  std::string to_json(const std::vector<MeasuredWidth>& widths) const;
};
/// Throws where a place that was measured never gels, or what gels there has no end.
DiffusionFit fit_diffusion(const TomoJob& job, const std::vector<MeasuredWidth>& widths,
                           const ExecutionContext& context = {});

}  // namespace slicecorr::tomo
