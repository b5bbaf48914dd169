// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo/report.hpp
/// The page that shows what a tomographic job prints.
///
/// Thread-safe; the same job gives the same bytes for any number of threads.
#pragma once

#include <string>

#include "slicecorr/parallel.hpp"
#include "slicecorr/tomo/section.hpp"

namespace slicecorr::tomo {

/// One self-contained HTML page: no network. Figures with what they mean, dose against target in
/// three planes, histograms of the doses of part and void, a sinogram, frames, how the solve went,
/// contrast over the height; with scripts also the part in the round, with what has gelled when.
/// At most a few MB, whatever the part: voxels in the round are made coarser.
std::string report_page(const Printed& printed, const std::string& title,
                        const ExecutionContext& context = {});

/// What the page shows in the round: when voxels gel.
struct GelTimes {
  int nx = 0, ny = 0, nz = 0;  ///< cells, x fastest
  double cell_mm = 0;
  int voxels_per_cell = 1;  ///< along a side
  /// Hundredths of the print's time, rounded up, from 1 on: a voxel that gels at the very end has
  /// 100. Prolonged at the same light, up to `kLatest`; 0: later or never.
  std::vector<std::uint8_t> time;
  /// `Kept` of each cell.
  std::vector<std::uint8_t> kind;
};
inline constexpr int kLatest = 150;
enum class Kept : std::uint8_t { empty, part, neither, insert };

/// The box of the part and of what gels, in cells of `voxels_per_cell`: a cell shows one voxel in
/// it, a wrong one (at the end of the print) where there is one, else that in its middle. Doses are
/// taken to grow evenly, as they do turn by turn.
GelTimes gel_times(const Printed& printed, int voxels_per_cell);

/// Contrast, least dose of the part and most of void of each slice. NaN where a slice has no part
/// or no void.
struct SliceContrast {
  double z_mm = 0;
  double min_gel = 0, max_void = 0, contrast = 0;
};
std::vector<SliceContrast> contrast_of_slices(const Printed& printed);

}  // namespace slicecorr::tomo
