// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Where the outline of what prints lies beside the design's, in the plane of each slice.
#pragma once

#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "slicecorr/grid.hpp"
#include "slicecorr/predict.hpp"

namespace slicecorr::detail {

/// Measures along rows and columns of pixels, from each edge of a designed feature to the nearest
/// place where the dose in the middle of the layer passes 1. A designed edge lies between a pixel of
/// coverage 1 and one of coverage 0; greys between them move it by their coverage. Between the
/// middles of two pixels the dose goes as that of a straight edge under a Gaussian does, between the
/// levels that it has on both sides: the normal integral of the distance.
class PlaneEdges {
 public:
  /// Doses and coverages are given over `field`; features of pixels in `window`, a part of it, are
  /// measured. An outline further than `reach` pixels away is none of the edge's: it is counted as
  /// closed or lost, without a distance.
  PlaneEdges(const Grid& grid, const PixelBox& field, const PixelBox& window, int reach);
  /// The dose in the middle of each layer; `coverage` null: nothing is designed.
  void add(int slice, const double* dose, const std::uint8_t* coverage);
  /// Puts what was measured into `figures`.
  void add_to(Prediction& figures) const;

 private:
  struct Axis {
    std::ptrdiff_t step;  ///< in the field
    int before, after;    ///< pixels of the field that lie on either side
    double pitch_um;
  };
  void measure(int slice, std::size_t at, const Axis& axis, const double* dose,
               const std::uint8_t* coverage);

  const PixelBox field_, window_;
  const int reach_;
  const double pitch_x_um_, pitch_y_um_;
  /// Pixels of the field through consecutive slices, which come from the last to the first.
  class Places {
   public:
    void add(std::size_t at, int slice);
    void add_to(FeatureExamples& examples, const PixelBox& field) const;

   private:
    struct Slices {
      int first, last;
    };
    std::map<std::size_t, Slices> open_;
    std::vector<std::pair<std::size_t, Slices>> ended_;
  };
  Places closed_, lost_;
  Prediction figures_;
  std::vector<std::uint8_t> at_edge_;
};

}  // namespace slicecorr::detail
