// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Loops of the solver over numbers of a block, [row][column].
///
/// A column is a lane of the block; a block of one slice is dealt to 16 columns that count as one.
/// Sums go into columns in a fixed order, so that they are vector code with the same result on every
/// processor, and rows in chunks of a fixed size, so that any number of threads gives the same.
#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <vector>

#include "slicecorr/parallel.hpp"

namespace slicecorr::tomo::detail {

inline constexpr int kColumns = 32;  ///< at most; 16 or 32
using Floats = std::array<float, kColumns>;
using Doubles = std::array<double, kColumns>;

/// 16 columns of some rows: number (row, k) is at `at + row * stride + k`.
struct Stretch {
  std::size_t at = 0, rows = 0, stride = 0;
  int first = 0;  ///< of the columns
};

class ColumnLoops {
 public:
  ColumnLoops(int lanes, const ExecutionContext& context)
      : lanes_(lanes), width_(lanes == 32 ? 32 : 16), context_(context) {}

  int lanes() const { return lanes_; }
  int columns() const { return width_; }
  /// `count` numbers, rounded up to whole rows.
  std::size_t padded(std::size_t count) const {
    const auto width = static_cast<std::size_t>(width_);
    return (count + width - 1) / width * width;
  }

  void each(std::size_t count, const std::function<void(const Stretch&)>& body) const;
  /// body(stretch, sums) adds to sums[kind][16]. Of one slice all columns get the whole sum.
  std::vector<Doubles> sum(std::size_t count, int kinds,
                           const std::function<void(const Stretch&, double*)>& body) const;

 private:
  int lanes_, width_;
  const ExecutionContext& context_;
};

/// What voxels ask for: below `least` and above `most` dose costs. Gel has a least above 0, void
/// none and a finite most.
struct Asked {
  const float *least, *most;
};

/// dose += t change; excess = (D - most)+ - (least - D)+, half of the derivative of the loss by the
/// dose. Sums: loss. Extremes: least of gel, most of void, most, [16] each.
void step_dose(const Stretch& s, const Asked& asked, const float* change, const float* t,
               float* dose, float* excess, double* sums, float* extremes);
/// Void voxels with at least this dose.
void count_void(const Stretch& s, const Asked& asked, const float* dose, const float* at_least,
                double* sums);
/// Of doses in bands: the least of dose / least and the most of dose / most, [16] each, behind those
/// that `extremes` has. Factors are 0 where there is no such bound.
void extremes_in_bands(const Stretch& s, const float* per_least, const float* per_most,
                       const float* dose, float* extremes);
/// Cells whose dose / most is at least this.
void count_above(const Stretch& s, const float* per_most, const float* dose, const float* at_least,
                 double* sums);
/// Half of the derivative of the loss along D + t d.
void slope(const Stretch& s, const Asked& asked, const float* dose, const float* change,
           const float* t, double* sums);
/// change^2 where there is excess.
void curvature(const Stretch& s, const float* excess, const float* change, double* sums);

/// Light, its gradient, and the pairs of L-BFGS.
struct Quadratic {
  const float *light, *gradient;
  float cap;
  const float* live;  ///< per column 1, or 0 where it is done
  std::vector<const float*> steps, changes;
  int sums() const {
    const int p = static_cast<int>(steps.size());
    return 1 + 2 * p + 2 * p * p;
  }
  /// Places among the sums: q q, s_i q, y_i q, s_i y_j, y_i y_j; s_i y_j of i up to j alone, y_i y_j of j up to i.
  int sq(int i) const { return 1 + i; }
  int yq(int i) const { return 1 + static_cast<int>(steps.size()) + i; }
  int sy(int i, int j) const {
    const int p = static_cast<int>(steps.size());
    return 1 + 2 * p + i * p + j;
  }
  int yy(int i, int j) const {
    const int p = static_cast<int>(steps.size());
    return 1 + 2 * p + p * p + i * p + j;
  }
};
/// y = gradient - before, where `y` is not null.
void change_of_gradient(const Stretch& s, const float* gradient, const float* before, float* y);
/// q: the gradient of pixels that no bound holds.
void free_gradient(const Stretch& s, const Quadratic& of, float* q);
/// All products over the pixels that no bound holds.
void products(const Stretch& s, const Quadratic& of, double* sums);
/// direction = within the bounds of light - (cq q + cs s + cy y), less light. Factors: [16] of q,
/// then of each s, then of each y.
void descend(const Stretch& s, const Quadratic& of, const float* factors, float* direction);
/// step = t direction; light += step, within the bounds.
void step_light(const Stretch& s, const float* direction, const float* t, float cap, float* light,
                float* step);

}  // namespace slicecorr::tomo::detail
