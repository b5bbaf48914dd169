// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Slices on the flow's cells: how much of each of them is lit.
#pragma once

#include <cstdint>
#include <vector>

#include "base/coded_band.hpp"
#include "slicecorr/flow_part.hpp"

namespace slicecorr::detail {

/// The cells for a source, with the ring of bath around those that may be lit.
FlowGrid flow_grid(const SliceSource& source, const FlowPartOptions& options);

/// A cell whose coverage is this or more is lit.
inline constexpr std::uint8_t kLitCell = 128;

/// Coverage of the cells of every slice, run-length coded in bands of cell rows, without the ring.
class CoarseSlices {
 public:
  CoarseSlices(const SliceSource& source, const FlowGrid& grid, FlowPixels pixels,
               const ExecutionContext& context);
  /// Whether a slice is lit as the one before it.
  bool as_before(int slice) const;
  /// `coverage`: a byte per cell of the grid, the ring among them; 255 is all of it.
  void read(int slice, std::vector<std::uint8_t>& coverage) const;

 private:
  struct Band {
    int first_row = 0;  ///< of cells, without the ring
    CodedBand coded;
  };
  const FlowGrid grid_;
  std::vector<Band> bands_;
};

}  // namespace slicecorr::detail
