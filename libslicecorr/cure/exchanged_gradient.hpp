// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Derivatives of the dose where each lift exchanges a share x of the liquid (docs/lifts.md): at the window
/// of layer n the resin has had D_k = sum over j = n..k of phi_j a^(j-n) (1-x)^(k-j) at the lift k, and
/// the greatest of them decides. Each k is carried on by itself, with its derivatives.
#pragma once

#include <vector>

#include "slicecorr/cure.hpp"
#include "slicecorr/dose_derivatives.hpp"

namespace slicecorr::detail {

/// Immutable.
class ExchangedGradient {
 public:
  /// A lift that may still decide: what share of the next exposure counts at it, and how that changes with
  /// x; and what has been dosed by then.
  struct Lift {
    double kept, by_exchange;
    DoseGradient sum;
  };
  /// `exchange`: the share, 0..1.
  ExchangedGradient(const CureModel& model, double exchange);
  /// The window of the next layer towards the platform, whose own exposure gives it `light`. `lifts`: of the
  /// column, the furthest first; empty before the last slice.
  DoseGradient add(std::vector<Lift>& lifts, const LightGradient& light) const;

 private:
  double keeps_, a_, depth_, per_m_, most_;
};

}  // namespace slicecorr::detail
