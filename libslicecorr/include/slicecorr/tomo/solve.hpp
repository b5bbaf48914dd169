// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo/solve.hpp
/// Finding the light of a part: b >= 0 with enough dose in the part and little in void.
///
/// `ladder` minimises, for a contrast rung rho_c,
///   sum_gel (1-D)+^2 + sum_void (D-rho_c)+^2 + sum_gel (D-d_u)+^2,  D = A^T b, 0 <= b <= cap,
/// by projected L-BFGS, slice by slice, rung by rung warm-started while the loss reaches 0, and keeps
/// for each slice the light with the best contrast C that the part can use. Where a rung is missed,
/// what is left of the loss on one out of reach proves how far C can go with any light at all
/// (`contrast_bound`), for the slices that limit the part. Slices without gel stay dark.
/// `osmo` is Rackson's object-space optimisation as in Webber 2023, 2.7; the model is scaled to a
/// maximum of 1, because its steps are doses. `kelly` is Kelly's projected gradient (thesis 4.1);
/// its unit step is scaled so that A^T ramp A target steps by 1 between gel and void, and its
/// threshold is the best-Jaccard one of each step, because the ramp has no constant part. `fbp` is
/// the filtered back projection alone.
///
/// Thread-safe; the same bytes for any number of threads. Memory: light and dose of the part, and
/// for the ladder twice that and 2 memory + 6 times the light of as many blocks as there are threads.
#pragma once

#include <functional>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include "slicecorr/parallel.hpp"
#include "slicecorr/tomo/filter.hpp"
#include "slicecorr/tomo/metrics.hpp"
#include "slicecorr/tomo/projector.hpp"
#include "slicecorr/tomo/volume.hpp"

namespace slicecorr::tomo {

enum class Method { ladder, osmo, kelly, fbp };

/// As people name them: "ladder", "osmo", "kelly", "fbp". Throws `InputError` for other names.
Method method_named(std::string_view name);
/// Every name, the default first.
inline constexpr std::string_view kMethodNames[] = {"ladder", "osmo", "kelly", "fbp"};

/// One step of a solver. The ladder's VER counts each slice against its own weakest gel voxel; other
/// figures are the part's.
struct Step {
  double rung = 0;  ///< rho_c; 0 where there is none
  int step = 0;     ///< from 0, within the rung
  double loss = 0;  ///< ladder only
  double ver = 0, pw = 0, contrast = 0;
};

struct Solution {
  explicit Solution(const TomoGrid& grid) : light(grid), dose(grid) {}

  /// Scaled: A^T light is 1 at the weakest gel voxel, with the ladder at that of each slice.
  Light light;
  Field dose;       ///< A^T light
  Metrics metrics;  ///< of `dose`
  double rung = 0;  ///< at which it was found
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
  const Solution& best;          ///< so far, not scaled yet
};
/// The same, kept.
struct SolverState {
  Array<float> numbers, dose;
  std::vector<double> of_slices;
  std::vector<int> missed;
  double rung = 0;
  int step = 0;
  Solution best;
};

struct SolveOptions {
  Method method = Method::ladder;
  /// Start of the ladder, of Kelly, and all of FBP.
  Window window = Window::hamming;
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

  double osmo_high = 0.85, osmo_low = 0.6;  ///< D_H, D_L over the largest dose; high > low
  /// OSMO as in Webber 2023: light above the mean and this many standard deviations is cut off in
  /// the end, and what is left rounded to 256 levels. 0: neither.
  double clip_sigma = 0;
  /// OSMO stops when what the part lacks of D_H, and void has above D_L, is less than this share of
  /// D_H in all of the part. 0: only after `steps`.
  double stop_error = 0;

  /// Ladder and Kelly start from this light instead. May be null.
  const Light* start = nullptr;
  /// Called after each rung, or step of OSMO and Kelly; may keep the place, which is valid only in
  /// the call.
  std::function<void(const SolverPlace&)> checkpoint = nullptr;
  /// Goes on from here, to the same bytes as the solve that kept it. Must be of the same problem and
  /// options. May be null.
  const SolverState* resume = nullptr;
};

/// Throws `InputError` for options out of range and targets of another grid, `InfeasibleError` when
/// a gel voxel is lit from no angle, `Cancelled`. A bound below 1 is returned, not thrown.
/// `optics` are those of `projector`.
Solution solve(const ExecutionContext& context, const Projector& projector, const Target& target,
               const RayTables& optics, const SolveOptions& options = {});

/// The bound of C that a dose proves: with lo = (1 - D)+ on gel, hi = (D - rho_c)+ on void and
/// delta >= 0 the least with A(hi + delta void) >= A lo on every ray, any b >= 0 has
///   min_gel D <= max_void D (sum hi + delta n_void) / sum lo.
/// Slices are independent, so the least bound of a slice is the part's. Rays are compared with a
/// margin of 1e-4 for the projector's single precision.
struct Certificate {
  double bound = std::numeric_limits<double>::infinity();
  int slice = -1;
};
Certificate contrast_bound(const ExecutionContext& context, const Projector& projector,
                           const Target& target, const Field& dose, double rung);

}  // namespace slicecorr::tomo
