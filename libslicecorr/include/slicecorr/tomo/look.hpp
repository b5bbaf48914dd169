// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo/look.hpp
/// Looking at a print while it goes on: images of a camera, one for each angle of a turn, show how much
/// light what has gelled takes on its way. From these what stands in the vial is reconstructed, with the
/// operators that find light, and compared with the planned dose: which says how much of the planned dose
/// has really come, and so at which turn to stop.
///
/// Ours. With p = -ln(now / before) of each pixel and A the sum along its line, the reconstruction is x >= 0
/// by SIRT: x <- x + C A^T (R (p - A x)), R and C the inverses of the sums of A's rows and columns. Of all
/// doses at which the plan may be cut in two, that is sought whose cut is most like x (the correlation of x
/// with 0 and 1), exactly.
///
/// Thread-safe; the same numbers for any number of threads.
#pragma once

#include <string>
#include <vector>

#include "slicecorr/parallel.hpp"
#include "slicecorr/tomo/job.hpp"
#include "slicecorr/tomo/npy.hpp"
#include "slicecorr/tomo/section.hpp"

namespace slicecorr::tomo {

struct LookOptions {
  /// Folders (or zips) of PNG images of 8 bits, as many in each, in the natural order of their names: of the
  /// vial before any light, and now. Each has the projector's size, its pixels are those of the
  /// projector's, as seen from there; steps between them are alike and make a turn.
  std::string before, now;
  double turns = 0;  ///< that were shown until now, > 0
  double camera_deg =
      0;  ///< by which the vial must turn on from where the camera sees it to where the projector does
  int steps = 50;  ///< of SIRT, 1..10000
};

struct Look {
  Box<float> seen;       ///< 1/mm that what has gelled takes from the camera's light, [z][y][x]
  double agreement = 0;  ///< correlation with the best cut of the plan, -1..1
  /// Of the planned dose, what has come: least and most that the cut allows, and the middle of them.
  double least_share = 0, most_share = 0, share = 0;
  std::size_t gelled = 0, planned = 0;  ///< voxels beyond that cut; by the plan after these turns
  std::size_t part_gelled = 0, part = 0, void_gelled = 0;  ///< of the part, all of it, and of void
  double stop_turn = 0;    ///< at which the part's weakest voxel gels
  double void_turn = 0;    ///< at which void begins to; infinite where none ever does
  double line_per_mm = 0;  ///< between what voxels beyond the cut take in the mean, and the others
};

/// What has gelled is told of only where images agree with the plan better than this.
inline constexpr double kSeenAgreement = 0.3;

/// `dose`: that of the whole print (`dose_of`). Throws `InputError` for images that are missing, damaged,
/// of another size or number, or black before any light; for light that slices share, inserts, and resin in
/// which dose does not grow evenly; and where nothing of the plan is to be seen (`kSeenAgreement`).
Look look_at(const TomoJob& job, const Box<float>& dose, const LookOptions& options,
             const ExecutionContext& context = {});

/// To look at: in two planes through the part's middle, the dose that has come after so many turns, and what
/// is seen, scaled such that `line_per_mm` is the gel dose. The target of the first is the part, that of the
/// second what has gelled by the first.
std::vector<PrintSection> sections_of(const Look& look, const TomoJob& job, const Box<float>& dose,
                                      double turns);

}  // namespace slicecorr::tomo
