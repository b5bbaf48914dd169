// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// One slice: voxels or pixels in the vector lanes.
#pragma once

#include <cstddef>
#include <vector>

#include "tomo/operators/beam_kernels.hpp"

namespace slicecorr::tomo::detail {

/// A table with room before and behind each row, which is `fill`.
struct Padded {
  std::size_t stride = 0;
  int before = 0;
  Array<float> numbers;

  void size(std::size_t rows, int count, int pad, float fill);
  void make(const float* from, std::size_t rows, int count, int pad);
  const float* row(std::size_t r) const { return numbers.data() + r * stride + before; }
  float* row(std::size_t r) { return numbers.data() + r * stride + before; }
};

/// An angle along the lanes and from row to row of voxels.
struct LaneAngle {
  double c = 0, cr = 0, f0 = 0;  ///< pixels per voxel; place of voxel (0, 0)
  const float *e = nullptr, *e_rows = nullptr;
  const float *u = nullptr, *u_rows = nullptr;
};

/// Angles of the first quarter, by the axis along the lanes: [0] y, [1] x.
struct LaneAngles {
  std::vector<int> chosen[2];
  std::vector<LaneAngle> angles[2];
};

struct SliceTables {
  bool fine = false;  ///< pixels are narrower than voxels, down to half of them
  Padded ex, ey, ux, uy;
  LaneAngles flat;   ///< voxels in lanes: lines cross them by at most 0.71 pixels each
  LaneAngles steep;  ///< pixels in lanes: by at least 0.71
};

/// The tables of a beam, or null where the grid's blocks are of several slices.
std::shared_ptr<const SliceTables> make_slice_tables(const ParallelBeam& beam);

/// A slice and its light, as the kernels want them.
struct SliceWork {
  Padded light, hit;    ///< [angle][pixel]
  bool shadow = false;  ///< `hit` counts
  std::size_t stride = 0;
  Array<float> out[2][4];  ///< adjoint: doses by lanes' axis and turn, [row][lane]
  Padded voxels[2][4];     ///< forward: the slice, turned, with 0 outside of R
};

/// The rows from r0 on of the doses of turns `turn` and `turn` + 1.
void slice_adjoint_rows(const ParallelBeam& beam, SliceWork& work, bool along_x, int turn, int r0);
/// The frames of the k-th angle of an axis and of its turns.
void slice_forward_angle(const ParallelBeam& beam, const SliceWork& work, bool along_x,
                         std::size_t k, float* light);

void slice_adjoint(const ParallelBeam& beam, const float* hit, const float* light, float* field,
                   const ExecutionContext& context);
void slice_forward(const ParallelBeam& beam, const float* hit, const float* field, float* light,
                   const ExecutionContext& context);

}  // namespace slicecorr::tomo::detail
