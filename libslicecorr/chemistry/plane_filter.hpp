/// Filters of real fields on a plane of cells, by their waves.
#pragma once

#include <complex>
#include <functional>
#include <vector>

#include "slicecorr/chemistry_pattern.hpp"

namespace slicecorr::detail {

/// Multiplies each wave of a field by a real number, the same for waves that run the other way. With
/// walls the field is mirrored at its sides. Not thread-safe; results are the same for any number of
/// threads of `context`.
class PlaneFilter {
 public:
  PlaneFilter(int width, int height, Sides sides);
  /// `of` is asked for the phases per cell along x and y, 0..pi.
  void set(const std::function<double(double, double)>& of);
  /// `field`: width x height numbers, row by row.
  void apply(std::vector<double>& field, const ExecutionContext& context);

 private:
  int width_, height_;
  bool walls_;
  int nx_, ny_;  ///< of what is transformed: twice the field's where it is mirrored
  std::vector<double> factor_;
  std::vector<std::complex<double>> waves_;
};

}  // namespace slicecorr::detail
