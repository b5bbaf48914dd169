// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo/projector.hpp
/// The two operators of tomographic printing, exact transposes of each other: A sums a field along
/// the lines of light, A^T gives the dose of light.
///
/// Light of pixel i at angle m runs along the line (t_i, th_m) in the resin. A voxel at t takes it
/// by linear weights between the two nearest pixels (voxel-driven pair):
///   D[v] = sum_m e_v (b[m,i] k_i s_i (1-w) + b[m,i+1] k_(i+1) s_(i+1) w),  f = t/p + (P-1)/2,
///   i = floor f, w = f - i, e_v = exp(-alpha u), k_i = weight_i exp(-alpha sqrt(R^2 - t_i^2)),
/// s_i is 0 behind an insert, else 1. A takes the same weights the other way. Light outside of the
/// detector is 0. D is in units of light times angles: times alpha_a T_rot / M it is the dose of a
/// turn.
///
/// Refraction in the plane (a vial in air) turns rays by an angle that depends on their pixel
/// alone. So first each column of pixels is turned to its angle in the resin, linear between
/// frames: as each frame is shown for 1/M of a turn, that is the mean over the same time. Then the
/// light is parallel-beam light.
///
/// Thread-safe.
#pragma once

#include <memory>
#include <vector>

#include "slicecorr/tomo/volume.hpp"

namespace slicecorr::tomo {

/// What the vial does to the light of each pixel. Empty tables: 1, and no turn.
struct RayTables {
  /// Absorption along the exact chord, 1/mm, >= 0.
  double alpha_per_mm = 0;
  /// Per pixel, >= 0: Fresnel transmittance times n3/n1/cos^3 psi; 0 where a ray misses the resin.
  std::vector<double> weight = {};
  /// Per pixel, radians: th' - th, by which the ray is turned in the resin.
  std::vector<double> turn_rad = {};
  /// Per pixel, mm, strictly rising: t' of its line in the resin. Empty: as the grid has them, which
  /// telecentric light does (t' = n1 q / n3). Others are interpolated linearly to the grid's pixels,
  /// which are then pixels of a detector in the resin; those beyond the first or last are dark.
  std::vector<double> line_mm = {};
  /// Per row, mm, rising: z of its light on the axis. Where slices share light only, of which these
  /// tables say what is nearest to level rays: `filtered_start` begins there.
  std::vector<double> row_mm = {};
  /// Lit share of a pixel's width, in its middle, with all of its light; > 0, at most 1.
  double lit = 1;
};

/// Where an insert ends the light: per angle and pixel the u, mm, at which it is hit; +infinity
/// where it is not. Laid out as light.
struct Shadow {
  TomoGrid grid;
  Array<float> hit_mm;
};

/// The shadow of the opaque voxels (coverage > 0) of `insert`. A voxel shadows the pixels that its
/// square covers as seen at each angle, at least the nearest; light ends where it enters the voxel.
Shadow cast_shadow(const Volume& insert);

/// The fast projector, in single precision and vector registers. Throws `InputError` for tables
/// that don't fit the grid, and values out of range.
std::unique_ptr<Projector> make_projector(const TomoGrid& grid, const RayTables& optics = {},
                                          std::shared_ptr<const Shadow> shadow = nullptr);

/// All blocks of what has the projector's grid; the same bytes for any number of threads. Voxels with
/// r > R are ignored, and become 0.
Light forward(const Projector& projector, const ExecutionContext& context, const Field& field);
Field adjoint(const Projector& projector, const ExecutionContext& context, const Light& light);

}  // namespace slicecorr::tomo
