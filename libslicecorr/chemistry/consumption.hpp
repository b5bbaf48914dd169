// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Oxygen that light uses up as long as nobody runs out of it.
///
/// Until then consumption is linear, O = O(0) - K_T * i, with the transform of K_T being
/// Ri(1) (1 - exp(-D k² T)) / (D k²), and what a light i uses up by T over what there was is
/// u = K_T * G * i / O(0), G the spread of light. Light with which u is as wanted is found by
/// projected gradients.
#pragma once

#include <vector>

#include "chemistry/plane_filter.hpp"
#include "slicecorr/chemistry_pattern.hpp"

namespace slicecorr::detail {

/// Not thread-safe; results are the same for any number of threads.
class Consumption {
 public:
  /// Cells of `cell_um`, `full_mw_cm2` the light of a share of 1. The resin must have oxygen that
  /// diffuses.
  Consumption(const Chemistry& c, int width, int height, Sides sides, double cell_um,
              double spread_um, double full_mw_cm2);
  void set_time(double T_s);
  /// Makes shares of light the oxygen that they use up, row by row.
  void apply(std::vector<double>& light, const ExecutionContext& context) {
    filter_.apply(light, context);
  }
  /// u of even light of a share of 1: no wave grows by more.
  double most() const { return most_; }

 private:
  double oxygen_um2_s_, cell_um_, used_per_s_;
  std::vector<double> weights_;
  PlaneFilter filter_;
  double most_ = 0;
};

/// What light is to do in each cell.
struct LightWanted {
  /// u that is wanted; below 0: at most `most_elsewhere`; NaN: nothing.
  std::vector<double> used_up;
  std::vector<double> least, most;  ///< shares of light that the cell may get, 0..1
  double most_elsewhere = 1;
};
/// Shares of light that minimise the squares of u less what is wanted, and of what is too much elsewhere,
/// with `A` what light uses up, by `steps` steps of projected gradient with momentum from `start` on. Progress is reported as
/// "finding light".
std::vector<double> find_light(Consumption& A, const LightWanted& wanted, std::vector<double> start,
                               int steps, const ExecutionContext& context);

}  // namespace slicecorr::detail
