// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file flow_part.hpp
/// What a part does to the resin under it, slice by slice: where resin is drawn in through the gap
/// under gelled material, and where it comes from.
///
/// Slices are looked at on a coarse grid of square cells, the flow's cells, with a ring of bath all
/// around. In a slice, a cell is
///
///     part    where the slice is lit and gelled material, or the platform, is above: resin is drawn
///             in here;
///     blind   where the slice is dark, or has nothing gelled above it yet, in a void that no earlier
///             slice connects with the bath: it is filled through the gap, too;
///     bath    everywhere else: dark places beside the part and in holes whose void reaches the bath,
///             and the first slice of an overhang. Suction is 0 here.
///
/// A void is what is dark, connected within slices (by edges of cells) and from a slice to the next;
/// the platform closes it, so a hole that runs to the platform is blind until a later slice opens it
/// to the side.
///
/// `FlowPart` is immutable and thread-safe once made. Functions throw `InputError` for what does not
/// fit, and `Cancelled`.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "slicecorr/flow_section.hpp"
#include "slicecorr/grid.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr {

/// What the bytes of the slices are.
enum class FlowPixels {
  coverage,  ///< of a target: cells are lit whose pixels are covered by half and more
  light,     ///< grey levels: a pixel is lit above black
};

/// Coarsest cells that are taken where nothing is said, um: wide plates of small parts keep them.
inline constexpr double kMostFlowPitchUm = 250;

struct FlowPartOptions {
  /// Side of a cell, um; 0: the greater of gap and 1/64 of the part, at most `most_pitch_um` and a
  /// third of the part's shorter side, in whole pixels.
  double pitch_um = 0;
  double most_pitch_um = kMostFlowPitchUm;
  double gap_um = 0;  ///< of the resin under the part, for that; >= 0
  FlowPixels pixels = FlowPixels::coverage;
};

/// Where the cells lie, row by row from the image's upper left.
struct FlowGrid {
  int columns = 0, rows = 0;  ///< cells, the ring of bath among them
  double pitch_um = 0;
  /// The upper left corner of the first cell in the image, um from the image's upper left corner.
  double left_um = 0, top_um = 0;
  double image_width_um = 0, image_height_um = 0;
  std::size_t cells() const {
    return static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows);
  }
  /// The middle of a cell, mm from the image's lower left corner: the plate's, where images lie like
  /// the plate.
  std::array<double, 2> place_mm(std::size_t cell) const {
    const std::size_t row = cell / static_cast<std::size_t>(columns);
    const std::size_t column = cell % static_cast<std::size_t>(columns);
    const double x = static_cast<double>(column) + 0.5, y = static_cast<double>(row) + 0.5;
    return {(left_um + x * pitch_um) * 1e-3, (image_height_um - top_um - y * pitch_um) * 1e-3};
  }
};

/// A void that the bath does not reach for a while: a cup, a hole that runs to the platform, or a
/// hollow.
struct BlindVoid {
  double x_mm = 0, y_mm = 0;   ///< middle of it where it is widest, as `FlowGrid::place_mm`
  int first = 0, last = 0;     ///< slices in which it is blind
  double volume_mm3 = 0;       ///< of its dark cells in these slices
  double area_mm2 = 0;         ///< where it is widest
  bool from_platform = false;  ///< it begins at the platform
  bool vented = false;         ///< slice `last` + 1 connects it with the bath
};

class FlowPart {
 public:
  /// Reads `source` once, band by band. Throws `InputError` when no pixel is lit, or cells are wider
  /// than a third of the part's shorter side or smaller than a pixel.
  FlowPart(const SliceSource& source, const FlowPartOptions& options,
           const ExecutionContext& context = {});
  ~FlowPart();
  FlowPart(FlowPart&&) noexcept;

  int slices() const;
  double layer_um() const;
  const FlowGrid& grid() const;
  /// Masks that differ, in the order in which slices first have them; a slice without a cell of
  /// part has none: -1.
  std::size_t masks() const;
  int mask_of(int slice) const;
  int first_slice_of(std::size_t mask) const;
  /// The cells of a mask with coverage and voids; `grid()` says where they are.
  FlowSection section(std::size_t mask) const;
  /// Largest first; equal ones by slice and place.
  const std::vector<BlindVoid>& blind() const;
  /// Memory of the masks, bytes.
  std::size_t bytes() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// An upper bound of Phi over a section (flow_section.hpp), um², without solving anything: of each
/// connected piece that of the disc of its area, 3 A/pi (Talenti), and that of the strip of its
/// shorter side w, 1.5 w², whichever is less; the greatest of all pieces.
double phi_bound_um2(const FlowSection& section);

/// What a mask does, whatever speed, gap and viscosity: suction and force go with Phi.
struct MaskPhi {
  double max_phi_um2 = 0, integral_um4 = 0;
  std::size_t cell = 0;  ///< where Phi is greatest
  /// It is too narrow to be solved, less than three cells across: `phi_bound_um2`, and the integral
  /// that goes with it at most.
  bool bound = false;
};
MaskPhi mask_phi(const FlowPart& part, std::size_t mask, const ExecutionContext& context = {});

/// The slowest slice: that with the greatest Phi, the first of equal ones. Masks are solved from the
/// greatest bound on until no bound is left that is greater than what was found.
struct SlowestSlice {
  int slice = 0;
  MaskPhi phi;
  std::size_t solved = 0;  ///< masks that were solved for it
};
SlowestSlice slowest_slice(const FlowPart& part, const ExecutionContext& context = {});

}  // namespace slicecorr
