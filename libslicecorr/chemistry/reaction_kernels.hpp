// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// One step in time of the reactions of chemistry.hpp, for many cells at once.
///
/// A step of backward Euler over h takes the initiator's decay exactly and what it sets free,
/// X = Ir + 2I (1 - exp(-kd h)), as a source. With p the new P1:
///
///     starts s      s (1 + h kp P1)/(h kI) = (P0 - s)(X - s): the smaller root; Ir = X - s
///     oxygen        O = (O + h ks Os) / (1 + h ks + h ktO p), inhibitor Q = Q / (1 + h ktQ p)
///     end groups    P0 = (P0 - s) / (1 + h kp p)
///     p             p + 2 h kt p² + h ktO p O(p) + h ktQ p Q(p) = P1 + s
///
/// whose left side rises in p: one root, above 0, found by Newton's method within a bracket. Nothing
/// gets below 0, and P0 + P1 + P2 + P3 is kept to rounding. With kIO radicals of the initiator share
/// between end groups and oxygen by the root of another rising function.
///
/// Of second order are two ways to put such steps together:
///
/// - Cells of a plane take two stages over gamma h each, gamma = 1 - sqrt(1/2), the second from
///   (1/gamma - 1) times as far as the first has come, with gamma of what the initiator sets free over h
///   as the source of each: as Alexander's diagonally implicit method of two stages, L-stable, with the
///   exact initiator. Stages that begin below 0 are lifted: as much of the reaction of O, Q or Ir is undone as puts
///   them to 0; where that is not enough, the cell takes one plain step over h.
/// - A single cell, whose steps are chosen by their error, takes two steps over h/2 less one over h, Y =
///   2 Y(h/2, h/2) - Y(h), lifted in the same way; where that is not enough the two halves count
///   alone. This takes half as long again.
///
/// All instruction sets give the same bits.
#pragma once

#include <cstddef>

#include "slicecorr/chemistry.hpp"

namespace slicecorr::detail {

/// Cells are worked on so many at a time: arrays hold a multiple of it.
inline constexpr std::size_t kCellBlock = 16;

/// Concentrations, mol/l, a number per cell each.
struct CellArrays {
  double *I = nullptr, *Ir = nullptr, *P0 = nullptr, *P1 = nullptr, *P2 = nullptr, *P3 = nullptr,
         *O = nullptr, *Q = nullptr;
};

/// What is the same for all cells in a step.
struct ReactionStep {
  double h = 0;  ///< s
  double kI = 0, kp = 0, kt = 0, ktO = 0, kIO = 0, ktQ = 0;
  double supply_per_s = 0, outside_mol_l = 0;  ///< ks and Os of oxygen from outside
  double gel_p0 = 0;                           ///< P0 at which a cell has gelled
  double time = 0;                             ///< at the step's beginning, s
};
ReactionStep reaction_of(const Chemistry& c);

/// `broken[i]`: 1 - exp(-kd h/2) of cell i, its share of the initiator that breaks in half a step.
/// `gel_time`: where a cell comes to gel in this step, its time is noted, by a straight line between
/// its ends; null: not asked. `error`: null, with two stages, or with halves and whole, room for the greatest difference that the halves make
/// in any cell, over 1: O over `scale_O`, P0 over `scale_P`, P1 over itself plus `scale_p`.
struct StepError {
  double scale_O = 1, scale_P = 1, scale_p = 1;
  double worst = 0;
};
void react(const ReactionStep& step, const double* broken, const CellArrays& cells,
           std::size_t count, double* gel_time, StepError* error);

}  // namespace slicecorr::detail
