/// Rays through a block of slices, along samples: what `make_ray_projector` runs.
///
/// Sample j of a ray lies at u = -half + (j + 0.5) du, at x, y of the grid turned by the frame's
/// angle plus the ray's turn, and at z = entry + slope (u + half). Its weight on a voxel plane k is
/// max(0, 1 - |f - k|) along each axis. Both operators compute places and weights by the same
/// operations in single precision, so they are transposes to the rounding of sums.
#pragma once

#include <vector>

#include "slicecorr/tomo/volume.hpp"

namespace slicecorr::tomo::detail {

/// A ray in units of voxels.
struct WalkRay {
  float cos_turn = 1, sin_turn = 0;
  float t = 0;           ///< mm over the voxel's side
  float u0 = 0, du = 0;  ///< of the first sample, and between samples, over the voxel's side
  float z0 = 0, dz = 0;  ///< place among slices of the first sample, and between samples
  float start = 0;       ///< weight of the first sample
  float fade = 1;        ///< of a sample against the one before it
  int samples = 0;       ///< 0: the ray misses
};

struct RayWalk {
  TomoGrid grid;
  int per_pixel = 1;
  std::vector<WalkRay> rays;         ///< [column][row][ray]
  std::vector<double> cosine, sine;  ///< of the angles
};

/// Half-open ranges of rows whose rays come near a slab of slices, per column.
struct RowRange {
  int first = 0, end = 0;
};

/// light[m][column][row] = A field, of one angle.
void walk_forward(const RayWalk& walk, int angle, const float* field, float* light);
/// Adds A^T light of all angles to slices [first, end) of the field, `end` > `first` + 1.
void walk_adjoint(const RayWalk& walk, int first, int end, const std::vector<RowRange>& rows,
                  const float* light, float* field);

}  // namespace slicecorr::tomo::detail
