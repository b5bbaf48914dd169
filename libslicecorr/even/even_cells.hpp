// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The sections of a target on the flow's cells, and light on them.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "slicecorr/even_dead_zone.hpp"
#include "slicecorr/flow_part.hpp"
#include "slicecorr/flow_section.hpp"
#include "slicecorr/setup.hpp"

namespace slicecorr::detail {

/// Reads what is there for the resin once: a target, or what of it is lit (`LitPart`). Thread-safe once
/// made.
class EvenSections {
 public:
  /// What cells are made for: `gap_um` as `FlowPartOptions`, `pitch_um` 0: by the gap.
  struct Cells {
    double gap_um = 0, pitch_um = 0;
  };
  EvenSections(const SliceSource& part, const Setup& setup, const Cells& cells,
               const ExecutionContext& context);
  const FlowPart& part() const { return part_; }
  const FlowResin& resin() const { return resin_; }
  /// Slices 0, every, 2 every ... and the last that have a section wide enough to be solved.
  std::vector<int> slices_of(int every) const;
  bool can_be_solved(int slice) const;
  std::size_t mask_of(int slice) const { return static_cast<std::size_t>(part_.mask_of(slice)); }
  /// By how much the section of one slice differs from that of another, of the greater: 0 to 1, or more
  /// where they lie apart.
  double changed(int slice, int other) const;
  /// The mask of these slices with the greatest area.
  std::size_t largest(const std::vector<int>& slices) const;
  FlowSection section(std::size_t mask) const { return part_.section(mask); }
  GapPressure pressure(std::size_t mask, const ExecutionContext& context) const {
    return solve_pressure(part_.section(mask), context);
  }

 private:
  FlowPart part_;
  FlowResin resin_;
};

/// Area of the cells of part, mm².
double part_area_mm2(const FlowSection& section);
double mean_over_part(const FlowSection& section, const std::vector<double>& values);
/// The most curing light that every place under the part can have, mW/cm².
double even_blue_cap(const SliceSource& target, const Setup& setup);
/// The greatest UV light that comes in every slice, mW/cm².
double even_uv_cap(const Setup& setup);

/// Lights of the cells of one slice, mW/cm².
struct CellLight {
  std::vector<double> blue, uv;
  double lit = 1;                                     ///< share of the target's section that is lit
  std::shared_ptr<const ImageLight> image = nullptr;  ///< how it follows the even light
};

/// The light that images show on what of the part is lit, on the cells of their setup's even light, by
/// `slices`, which rise: the mean over what of each cell is lit. Pixels follow the even light where they
/// show it; others, as before edges and on grey outlines, show their own.
std::vector<CellLight> shown_cells(const SliceSource& shown, const SliceSource& target,
                                   const FlowGrid& grid, const std::vector<int>& slices,
                                   const Setup& setup, const ExecutionContext& context);

/// The slices in which a light is judged: those that it was found for, and those half way between.
std::vector<int> judged_slices(const EvenLight& light);
/// Slices in parts, so few that what `shown_cells` says of one part takes a bounded room.
std::vector<std::vector<int>> in_parts(const std::vector<int>& slices, const FlowGrid& grid);
/// The dose of `slices` with the light of their cells, and with the best intensities that are the same
/// everywhere. `sections`: of what is lit.
FlowDoses judge_light(const EvenSections& sections, const std::vector<int>& slices,
                      const std::vector<CellLight>& lights, const SliceSource& target,
                      const Setup& setup, const ExecutionContext& context);

}  // namespace slicecorr::detail
