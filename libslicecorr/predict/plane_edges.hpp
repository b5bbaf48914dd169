/// Where the outline of what prints lies beside the design's, in the plane of each slice.
#pragma once

#include <cstdint>
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
  /// measured.
  PlaneEdges(const Grid& grid, const PixelBox& field, const PixelBox& window);
  /// The dose in the middle of each layer; `coverage` null: nothing is designed.
  void add(int slice, const double* dose, const std::uint8_t* coverage);
  /// Puts what was measured into `figures`.
  void add_to(Prediction& figures) const { figures.merge(figures_); }

 private:
  struct Axis {
    std::ptrdiff_t step;  ///< in the field
    int before, after;    ///< pixels of the field that lie on either side
    double pitch_um;
  };
  void measure(int slice, std::size_t at, const Pixel& pixel, const Axis& axis, const double* dose,
               const std::uint8_t* coverage);

  const PixelBox field_, window_;
  const double pitch_x_um_, pitch_y_um_;
  Prediction figures_;
  std::vector<std::uint8_t> at_edge_;
};

}  // namespace slicecorr::detail
