// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Light of a feature above a gap that must hold at every lift (docs/lifts.md).
///
/// Layers are counted from the feature's upper node u on, j = 0 first. c_j = phi_j a^(j+1) is what the
/// exposure of layer j leaves at u; with the share x of the resin exchanged at each lift the resin there has
/// had D_j = (1 - x) D_(j-1) + c_j, and has gelled up to u where the greatest D_j is 1.
///
/// - x unknown, or `LiftModel::each_holds`: every layer holds, and layers get more than that, those nearest the window first, as far
///   as the edge for x = 0 moves by no more than `kLiftToleranceUm`.
/// - x known: as few layers as possible stay liquid, the one after them is a film, all others hold, and
///   layers get more, those nearest the window first, as far as no D_j passes what the edge leaves.
/// - x known to lie in a range: as for its greatest. The dose of every place falls with x, so that with
///   less of it edges lie further out; no layer is rounded down that would leave the greatest D_j short.
#pragma once

#include <optional>
#include <vector>

#include "slicecorr/cure.hpp"

namespace slicecorr::detail {

/// By how much an edge may move, um, so that light rises to the slicer's level faster.
inline constexpr double kLiftToleranceUm = 2;

/// Immutable; functions are pure.
class LiftedFeature {
 public:
  /// `model`: with lifts; outlives this. `levels`: those of the printer; null: any light between black
  /// and full. `most_exchange`: `CorrectionPlan::most_exchange`.
  LiftedFeature(const CureModel& model, const LevelTable* levels,
                std::optional<double> most_exchange = {});

  /// Layers further from the upper node than this get full light.
  int reach() const { return reach_; }

  /// The first layers of a feature.
  struct Ask {
    int node = 0;      ///< u, above 0
    int layers = 0;    ///< 1 or more: all, or `reach`
    double after = 0;  ///< dose that later slices leave at the lower node of the last of them
    double below = 0;  ///< how far below u the edge belongs, slices: -0.5..0.5
  };
  /// phi of each layer, at the normal exposure, and how many of the first stay liquid.
  struct Light {
    std::vector<double> phi;
    int liquid = 0;
  };
  Light solve(const Ask& ask) const;
  /// Where every layer holds: the least phi of each. Empty where the edge is put to its place, which takes
  /// all the light of `solve`.
  std::vector<double> least_light(const Ask& ask) const;

 private:
  double least(double phi) const;
  double most(double phi) const;
  /// phi with which layer n gets `dose` from its own exposure, at `up` slices above its window.
  double own(int n, double dose, double up) const;
  /// Least light of all layers where the first `liquid` stay liquid; where the exchange is not known
  /// none does, and the first one holds.
  std::vector<double> floors(const Ask& ask, int liquid) const;
  void brighten(const Ask& ask, double most_dose, double exchange, Light& light) const;
  /// Raises one layer so that the greatest D_j is no less than `least_dose`, by as little as can be; false
  /// where none can do it.
  bool lift_to(const Ask& ask, double least_dose, double exchange, Light& light) const;
  /// The greatest D_j.
  double peak(const Ask& ask, const std::vector<double>& phi, double exchange) const;

  const CureModel& model_;
  const LevelTable* levels_;
  std::optional<double> most_exchange_;
  int reach_;
};

}  // namespace slicecorr::detail
