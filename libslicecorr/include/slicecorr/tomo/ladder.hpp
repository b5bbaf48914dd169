// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo/ladder.hpp
/// Light with the most contrast: b >= 0 with enough dose in the part and little in void.
///
/// `ladder` minimises, for a contrast rung rho_c,
///   sum_gel (1-D)+^2 + sum_void (D-rho_c)+^2 + sum_gel (D-d_u)+^2,  D = A^T b, 0 <= b <= cap,
/// by projected L-BFGS, slice by slice, rung by rung warm-started while the loss reaches 0, and keeps
/// for each slice the light with the best contrast C that the part can use. Where a rung is missed,
/// what is left of the loss on one out of reach proves how far C can go with any light at all
/// (`contrast_bound`), for the slices that limit the part. Slices without gel stay dark.
///
/// Thread-safe; the same bytes for any number of threads. Memory: twice light and dose of the part,
/// and 2 memory + 6 times the light of as many blocks as there are threads.
#pragma once

#include <functional>
#include <limits>
#include <vector>

#include "slicecorr/parallel.hpp"
#include "slicecorr/tomo/projection.hpp"

namespace slicecorr::tomo {

/// One step of a solver. The ladder's VER counts each slice against its own weakest gel voxel; other
/// figures are the part's.
struct Step {
  double rung = 0;  ///< rho_c; 0 where there is none
  int step = 0;     ///< from 0, within the rung
  double loss = 0;  ///< ladder only
  double ver = 0, pw = 0, contrast = 0;
};

struct FoundLight {
  /// Scaled: A^T light is 1 at the weakest gel voxel, with the ladder at that of each slice.
  Array<float> light;
  Array<float> dose;  ///< A^T light
  double rung = 0;    ///< at which it was found
  /// No light b >= 0 whatever has a higher contrast C; infinite when nothing was proven.
  double contrast_bound = std::numeric_limits<double>::infinity();
  /// The slice that the bound is of; -1 without one.
  int bound_slice = -1;
  std::vector<Step> history;
};

/// Between two rungs or steps, what a solver goes on with.
struct SolverPlace {
  const Array<float>& numbers;         ///< light; of OSMO its model
  const Array<float>& dose;            ///< ladder: of the light
  std::vector<double> of_slices = {};  ///< ladder: what it knows of each slice
  std::vector<int> missed = {};  ///< ladder: slices that missed the rung; none: it was reached
  double rung = 0;               ///< ladder: that was missed, or comes next; 0: none does
  int step = 0;                  ///< OSMO, Kelly: which comes next
  const FoundLight& best;        ///< so far, not scaled yet
};
/// The same, kept.
struct SolverState {
  Array<float> numbers, dose;
  std::vector<double> of_slices;
  std::vector<int> missed;
  double rung = 0;
  int step = 0;
  FoundLight best;
};

struct LadderOptions {
  /// Steps per rung, or in all. 0: 60 per rung; OSMO 20, the start being the first; Kelly 10.
  int steps = 0;

  /// A slice goes on beyond `steps`, up to this many, doubling them each time, while the second half
  /// of them takes 0.3 of its loss away; half as many once the contrast is 1. A slice that misses
  /// the rung ends the ladder.
  int most_steps = 1000;
  /// Rungs of the ladder, falling, each in (0, 1).
  std::vector<double> rungs = {0.995, 0.98, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2};
  /// d_u, the dose over the gel dose above which gel costs; > 1. Lower is more even, with less
  /// contrast.
  double most_dose = 1.28;
  /// Most light, in units of which 1 everywhere gives A^T 1; the gel dose is 1 unit. With a time
  /// that is fixed: alpha_a T_rot N I_max / (M Dc). 0: no cap.
  double cap = 0;
  int memory = 5;         ///< of L-BFGS, 1..50
  int proof_steps = 160;  ///< for the proof, once a rung is missed; 0: none
  /// What the bound of contrast is proven with: the same cells, and all light that can be shown, where
  /// `projector` knows of light in groups alone. Lanes may be others. Null: `projector`.
  const Projector* prover = nullptr;

  /// The ladder's start is first scaled to the least loss, slice by slice.
  bool scale_start = false;
  /// Called after each rung, or step of OSMO and Kelly; may keep the place, which is valid only in
  /// the call.
  std::function<void(const SolverPlace&)> checkpoint = nullptr;
  /// Goes on from here, to the same bytes as the solve that kept it. Must be of the same problem and
  /// options. May be null.
  const SolverState* resume = nullptr;
};

/// From `start`, unless it goes on. Options must be in range, and each cell of gel lit. Throws
/// `Cancelled`. A bound below 1 is returned, not thrown.
FoundLight ladder(const ExecutionContext& context, const Projector& projector,
                  const CellKinds& cells, Array<float> start, const LadderOptions& options);

}  // namespace slicecorr::tomo
