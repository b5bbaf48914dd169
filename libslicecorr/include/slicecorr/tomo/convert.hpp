// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo/convert.hpp
/// Other people's frames as jobs, to be judged as ours are.
///
/// Thread-safe.
#pragma once

#include <optional>
#include <string>

#include "slicecorr/parallel.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/tomo/job.hpp"

namespace slicecorr::tomo {

struct ImageSequence {
  std::string path;           ///< a folder of PNG images, or a zip of them
  double angle_step_deg = 0;  ///< from image to image; a whole number of them is a turn
  int turns = 1;              ///< 1..1000000000
  /// In which the vial turns while they are shown; nothing: as the printer's file says.
  std::optional<TurnDirection> direction = std::nullopt;
};

/// A job of these images in the natural order of their names ("2" before "10"), each of the
/// projector's size and as seen from it. `part`: what should print, a volume of voxels of
/// `voxel_mm`, which is middled on the axis; slices without part are added above and below where
/// images have light there. Without it (no values) the job has a part without voxels, as high as
/// the light; `voxel_mm` 0: the rows' height.
///
/// Throws `InputError` naming folder and image for images of another size, kind or number than a
/// turn of the projector has, and for levels that the printer does not have; as `placed` and
/// `make_bench`. Rows that light one slice and differ become the level nearest to their mean light, with a
/// notice.
TomoJob job_of_images(const ImageSequence& sequence, const Printer& printer, const Resin& resin,
                      const Box<std::uint8_t>& part, double voxel_mm,
                      const ExecutionContext& context = {});

}  // namespace slicecorr::tomo
