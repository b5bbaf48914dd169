// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Which light belongs to which slice.
#pragma once

#include <optional>
#include <vector>

#include "sim/motion.hpp"
#include "slicecorr/bridge/model.hpp"

namespace slicecorr::bridge::detail {

/// Sums light by slice and image. It is told of pieces of time in which one image was lit and the
/// stage did not leave a slice; `until_edge` says how long such a piece may be.
class Exposures {
 public:
  void begin(const SliceFacts& facts);
  const SliceFacts& facts() const { return facts_; }
  bool recording() const { return facts_.layer_um > 0; }

  /// The stage has jumped, or light comes on: finds its slice anew.
  void find(const Motion& stage);
  /// Time until the stage leaves its slice.
  double until_edge(const Motion& stage, double acceleration_um_s2) const;
  /// It has reached the edge that `until_edge` was about.
  void cross(const Motion& stage);

  struct Lit {
    int image = kBlackImage;
    double time_s = 0, light_s = 0;
    double blue_s = 0, uv_s = 0;  ///< integrals of blue's share and of UV, mW/cm²
    double from_um = 0, to_um = 0;
  };
  void add(const Lit& lit);
  /// What comes next does not continue what was added last.
  void interrupt() { last_ = nullptr; }
  const std::vector<SliceExposure>& slices() const { return slices_; }

 private:
  double edge_um(long slice) const;
  struct Sums {
    double blue_s = 0, uv_s = 0;
  };

  SliceFacts facts_;
  long slice_ = 0;
  std::vector<SliceExposure> slices_;
  SliceExposure::Showing* last_ = nullptr;  ///< what was added to last, while it may go on
  long last_slice_ = 0;
  Sums sums_;  ///< of the last
};

}  // namespace slicecorr::bridge::detail
