// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Level light of pixels in the directions of the resin: the light of cells of directions, of frames
/// that are shown meanwhile.
#pragma once

#include <cstddef>
#include <vector>

#include "slicecorr/tomo/projector.hpp"
#include "tomo/operators/directions.hpp"

namespace slicecorr::tomo::detail {

class CellLines {
 public:
  /// Light that the vial turns by what each pixel's `turn_rad` says: of whatever is shown in a cell.
  /// `weight`: per pixel of `grid`; pixels without any are dark.
  CellLines(const TomoGrid& grid, const RayTables& optics, const Directions& directions,
            std::vector<float> weight);
  /// Light that keeps its direction: of the frame of the cell's own step.
  CellLines(const TomoGrid& grid, const Directions& directions, std::vector<float> weight);
  /// Light of a cell, [pixel][lane], its share of a step; `light` is a block's.
  void of_cell(int k, std::size_t lanes, const float* light, float* to) const;
  /// Whether all pixels share frames alike: then `back_frame` is the transpose.
  bool alike() const { return shares_.empty(); }
  /// Light of a frame, of the lines of all cells, [cell][pixel][lane].
  void back_frame(int frame, std::size_t lanes, const float* lines, float* light) const;
  /// The transpose, of one pixel: adds to the light of its frames.
  void back(int k, int pixel, std::size_t lanes, const float* lines, float* light) const;

 private:
  const std::vector<FrameShare>& shares_of(int pixel, int k) const {
    return shares_[static_cast<std::size_t>(pixel) * static_cast<std::size_t>(cells_) +
                   static_cast<std::size_t>(k % cells_)];
  }
  /// Place of a pixel of the frame `shift` after that of cell k.
  std::size_t place(int k, int shift, int pixel) const;

  int pixels_, angles_, cells_;
  std::vector<float> weight_;                    ///< [pixel]
  FrameShare of_cell_;                           ///< of all pixels alike
  std::vector<std::vector<FrameShare>> shares_;  ///< [pixel][cell of a step], else
};

}  // namespace slicecorr::tomo::detail
