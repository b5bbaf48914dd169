/// The sections of a target on the flow's cells, and light on them.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "slicecorr/even_dead_zone.hpp"
#include "slicecorr/flow_part.hpp"
#include "slicecorr/flow_section.hpp"
#include "slicecorr/pipeline.hpp"

namespace slicecorr::detail {

/// Reads a target once. Thread-safe once made.
class EvenSections {
 public:
  /// What cells are made for: `gap_um` as `FlowPartOptions`, `pitch_um` 0: by the gap.
  struct Cells {
    double gap_um = 0, pitch_um = 0;
  };
  EvenSections(const SliceSource& target, const Setup& setup, const Cells& cells,
               const ExecutionContext& context);
  const FlowPart& part() const { return part_; }
  const FlowResin& resin() const { return resin_; }
  /// Slices 0, every, 2 every ... and the last that have a section wide enough to be solved.
  std::vector<int> slices_of(int every) const;
  bool can_be_solved(int slice) const;
  std::size_t mask_of(int slice) const { return static_cast<std::size_t>(part_.mask_of(slice)); }
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

/// Lights of the cells of one slice, mW/cm².
struct CellLight {
  std::vector<double> blue, uv;
  std::vector<double> weight;  ///< 0 where nothing is lit; empty: all count
  double lit = 1;              ///< share of the section that is lit
  /// What images show of the light that was planned, 0..1; empty: all of it.
  std::vector<double> shown = {};
};

/// The even light of a setup on its own cells, in the levels that lamps have; `at`: of which of its
/// slices.
CellLight even_cells(const Setup& setup, std::size_t at);
/// The light that slices show on the part, `target`, on the cells of their setup's even light, by its
/// slices: the mean over what of each cell is part.
std::vector<CellLight> shown_cells(const SliceSource& shown, const SliceSource& target,
                                   const EvenSections& sections, const Setup& setup,
                                   const ExecutionContext& context);

}  // namespace slicecorr::detail
