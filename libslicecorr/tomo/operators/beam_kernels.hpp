// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The parallel-beam pair on one block: light that is already weighted per pixel, along the lines of
/// the grid's pixels and angles.
///
///   f(x, y) = cx x + cy y + f0   place of a voxel on the detector, in pixels; i = floor f, w = f - i
///   adjoint:  D[v] = sum_m e(x, y) ((1-w) b[m,i] + w b[m,i+1])
///   forward:  b[m,j] = sum_v e(x, y) max(0, 1 - |f - j|) D[v]
///   e = ex[m][x] ey[m][y] = exp(-alpha u)
///
/// With a shadow, a term counts where ux[m][x] + uy[m][y] < hit[m][pixel].
///
/// Both see the same weights to the rounding of single precision, and the same shadow exactly.
/// Angles that are 90 degrees apart share f and e on the slice turned by as much: only those of the
/// first quarter of a turn are worked out.
#pragma once

#include <memory>
#include <vector>

#include "slicecorr/parallel.hpp"
#include "slicecorr/tomo/volume.hpp"

namespace slicecorr::tomo::detail {

struct BeamAngle {
  double cx = 0, cy = 0, f0 = 0;  ///< pixels per voxel along x and y; place of voxel (0, 0)
};

struct SliceTables;

/// Light that comes in parallel to itself at each angle of a turn.
struct ParallelBeam {
  TomoGrid grid;
  std::vector<BeamAngle> angles;  ///< half of the grid's where light of both directions is one
  /// Of the angles, how many are 90 degrees apart each: angle m + t base_angles() is angle m turned
  /// by 90 t degrees. 1, 2 or 4.
  int turns = 1;
  std::vector<TomoGrid::Range> inside;
  bool attenuated = false;
  Array<float> ex, ey;  ///< [angle][x], [angle][y]; empty unless attenuated
  bool shadow = false;
  Array<float> ux, uy;  ///< as ex, ey; empty without an insert
  /// Of one slice; null where the kernels of blocks do that.
  std::shared_ptr<const SliceTables> slice;

  int base_angles() const { return static_cast<int>(angles.size()) / turns; }
};

/// Light and fields of one block, `hit` that block's shadow or null. `light` has `beam.angles`
/// angles. The field is 0 outside of R (adjoint), or read inside of R only (forward). Work is shared
/// among the context's threads, with the same result for any number.
void beam_adjoint(const ParallelBeam& beam, const float* hit, const float* light, float* field,
                  const ExecutionContext& context);
void beam_forward(const ParallelBeam& beam, const float* hit, const float* field, float* light,
                  const ExecutionContext& context);

/// Rows of voxels, and angles, that are worked on together.
inline constexpr int kAdjointRows = 8, kForwardAngles = 16;

/// Slices in lanes.
void lane_adjoint(const ParallelBeam& beam, const float* hit, const float* light, float* field,
                  const ExecutionContext& context);
void lane_forward(const ParallelBeam& beam, const float* hit, const float* field, float* light,
                  const ExecutionContext& context);

}  // namespace slicecorr::tomo::detail
