// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The best light of those that a solver passes through.
#pragma once

#include "slicecorr/tomo/solve.hpp"

namespace slicecorr::tomo::detail {

void scale(Array<float>& values, double factor);
float largest(const Array<float>& values);

class Best {
 public:
  Best(const Target& target, Solution& solution) : target_(target), solution_(solution) {}

  /// Goes on from what another was offered.
  void resume(const Solution& best);
  /// By VER first, and then by process window.
  void offer(const Light& light, const Field& dose, const Metrics& m);
  /// Scales to 1 at the weakest gel voxel.
  void finish();

 private:
  const Target& target_;
  Solution& solution_;
  bool any_ = false;
};

}  // namespace slicecorr::tomo::detail
