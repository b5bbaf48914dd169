// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file chemistry_cell.hpp
/// The full equations of chemistry.hpp in one cell of well mixed resin, under light that is switched.
///
/// Reactions are stepped implicitly to second order (chemistry/reaction_kernels.hpp), with steps as
/// short as the tolerance asks for. Plain values and functions, thread-safe.
#pragma once

#include <cstddef>
#include <limits>
#include <string>
#include <vector>

#include "slicecorr/chemistry.hpp"
#include "slicecorr/parallel.hpp"

namespace slicecorr {

/// Concentrations in a cell, mol/l.
struct CellState {
  double I = 0, Ir = 0, P0 = 0, P1 = 0, P2 = 0, P3 = 0, O = 0, Q = 0;
  bool operator==(const CellState&) const = default;
};
/// Before light: I, P0, O and Q as the resin has them, the others 0.
CellState cell_at_start(const Chemistry& c);
/// Bonded end groups over those at the start, P2 / P0(0).
double conversion(const Chemistry& c, const CellState& s);
/// End groups used up over those at the start, 1 - P0 / P0(0): what the gel conversion is of.
double used_up(const Chemistry& c, const CellState& s);

/// Light of one intensity, 0 or more, for so long, > 0.
struct LightStep {
  double seconds = 0, intensity_mw_cm2 = 0;
};

struct CellQuestion {
  std::vector<LightStep> light;  ///< one after the other
  /// ks, 1/s: oxygen comes from outside at ks (O(0) - O).
  double supply_per_s = 0;
  /// What two halves of a step may differ from the whole: of O(0), of a tenth of P0(0), and of P1. The
  /// result is of the next order, and so better than this.
  double tolerance = 1e-3;
};

struct CellMoment {
  double time_s = 0, intensity_mw_cm2 = 0;
  CellState state;
};

struct CellRun {
  /// Every step from time 0 on; where light is switched, a moment under the light before.
  std::vector<CellMoment> moments;
  /// When radicals set free came to outnumber oxygen and inhibitor, with what came from outside, and when
  /// the resin had gelled; infinite where they did not.
  double inhibition_time_s = std::numeric_limits<double>::infinity();
  double gel_time_s = std::numeric_limits<double>::infinity();
  /// By how much P0 + P1 + P2 + P3 has come to differ, over P0(0).
  double balance_error = 0;
  std::size_t steps = 0;
  /// What the cell holds at a time within the run, between moments on a straight line.
  CellState at(double time_s) const;
  /// time_s,intensity_mw_cm2,initiator_mol_l,...,conversion,used_up: a row for each of at most `most`
  /// moments that lie evenly in time or tell most.
  std::string to_csv(const Chemistry& c, std::size_t most = 2000) const;
};
/// Throws `InputError` for light that is no light (negative or not finite, no time), no steps at all,
/// and a tolerance outside of 1e-9..0.1; `Cancelled`.
CellRun run_cell(const Chemistry& c, const CellQuestion& question,
                 const ExecutionContext& context = {});

/// Times of the full equations at one intensity that stays on, however long that takes, and what the
/// resin would need where it never gels.
struct CellTimes {
  double inhibition_time_s = std::numeric_limits<double>::infinity();
  double gel_time_s = std::numeric_limits<double>::infinity();
};
/// `supply_per_s` as in `CellQuestion`. Follows the cell for at most `most_gel_times` times the closed
/// form of its time to gel with an initiator that is used up.
CellTimes cell_times(const Chemistry& c, double intensity_mw_cm2, double supply_per_s = 0,
                     const ExecutionContext& context = {});
/// Why resin never gels under a light, and the least initiator or intensity that would do; empty where
/// nothing speaks against it. Under too little light oxygen stops chains after a group or so: over hours
/// they may use up as many groups as a gel has, and are none.
std::string never_gels(const Chemistry& c, double intensity_mw_cm2, double supply_per_s = 0);

}  // namespace slicecorr
