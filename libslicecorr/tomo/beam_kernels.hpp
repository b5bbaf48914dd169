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
#pragma once

#include <vector>

#include "slicecorr/tomo/volume.hpp"

namespace slicecorr::tomo::detail {

struct BeamAngle {
  double cx = 0, cy = 0, f0 = 0;  ///< pixels per voxel along x and y; place of voxel (0, 0)
};

struct Beam {
  TomoGrid grid;
  std::vector<BeamAngle> angles;  ///< half of the grid's where light of both directions is one
  std::vector<TomoGrid::Range> inside;
  bool attenuated = false;
  Array<float> ex, ey;  ///< [angle][x], [angle][y]; empty unless attenuated
  /// [angle][pixel][lane] of all blocks, null without an insert; ux, uy as ex, ey.
  const float* hit = nullptr;
  Array<float> ux, uy;
};

/// Light and fields of one block, `hit` that block's shadow or null. `light` has `beam.angles`
/// angles. The field is written (adjoint) or read (forward) inside of R only.
void beam_adjoint(const Beam& beam, const float* hit, const float* light, float* field);
void beam_forward(const Beam& beam, const float* hit, const float* field, float* light);

}  // namespace slicecorr::tomo::detail
