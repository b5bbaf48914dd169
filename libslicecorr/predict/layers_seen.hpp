// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What was found inside the layers of one slice, so that columns with the same light are looked at once.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "slicecorr/dose.hpp"

namespace slicecorr {

/// Columns whose doses are the same at both ends of a layer and in its middle have had the same light. For one thread.
class LayersSeen {
 public:
  /// What was found inside of a layer with these doses: all that is less than `known`.
  struct Layer {
    int slice = -1;
    double lower = 0, middle = 0, upper = 0;
    double known = 0;
    InsideLayer inside;
    bool is(int n, double at_lower, double at_middle, double at_upper) const {
      return slice == n && lower == at_lower && middle == at_middle && upper == at_upper;
    }
    void take(int n, double at_lower, double at_middle, double at_upper) {
      slice = n;
      lower = at_lower;
      middle = at_middle;
      upper = at_upper;
    }
  };
  /// Where such a layer stands, or would.
  Layer& of(double lower, double middle, double upper) {
    if (layers_.empty()) layers_.resize(kLayers);
    const std::uint64_t mixed =
        ((std::bit_cast<std::uint64_t>(lower) * kMix ^ std::bit_cast<std::uint64_t>(middle)) *
             kMix ^
         std::bit_cast<std::uint64_t>(upper)) *
        kMix;
    return layers_[static_cast<std::size_t>(mixed >> 40U) % kLayers];
  }

 private:
  static constexpr std::size_t kLayers = 256;
  static constexpr std::uint64_t kMix = 0x9E3779B97F4A7C15ULL;
  std::vector<Layer> layers_;  ///< made when it is first asked for one
};

}  // namespace slicecorr
