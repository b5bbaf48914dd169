// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo/solve.hpp
/// Finding the light of a part in a vial that turns, by one of four methods. `ladder` is that of
/// tomo/ladder.hpp, which starts from filtered back projection.
/// `osmo` is Rackson's object-space optimisation as in Webber 2023, 2.7; the model is scaled to a
/// maximum of 1, because its steps are doses. `kelly` is Kelly's projected gradient (thesis 4.1);
/// its unit step is scaled so that A^T ramp A target steps by 1 between gel and void, and its
/// threshold is the best-Jaccard one of each step, because the ramp has no constant part. `fbp` is
/// the filtered back projection alone.
///
/// Thread-safe; the same bytes for any number of threads. Memory: light and dose of the part, and
/// for the ladder what it takes.
#pragma once

#include <string_view>

#include "slicecorr/parallel.hpp"
#include "slicecorr/tomo/filter.hpp"
#include "slicecorr/tomo/ladder.hpp"
#include "slicecorr/tomo/metrics.hpp"
#include "slicecorr/tomo/projector.hpp"
#include "slicecorr/tomo/volume.hpp"

namespace slicecorr::tomo {

enum class Method { ladder, osmo, kelly, fbp };

/// As people name them: "ladder", "osmo", "kelly", "fbp". Throws `InputError` for other names.
Method method_named(std::string_view name);
/// Every name, the default first.
inline constexpr std::string_view kMethodNames[] = {"ladder", "osmo", "kelly", "fbp"};

struct Solution : FoundLight {
  Metrics metrics;  ///< of `dose`
};

struct SolveOptions : LadderOptions {
  Method method = Method::ladder;
  /// Start of the ladder, of Kelly, and all of FBP.
  Window window = Window::hamming;
  /// Ladder and Kelly start from this light instead. May be null.
  const Array<float>* start = nullptr;

  double osmo_high = 0.85, osmo_low = 0.6;  ///< D_H, D_L over the largest dose; high > low
  /// OSMO as in Webber 2023: light above the mean and this many standard deviations is cut off in
  /// the end, and what is left rounded to 256 levels. 0: neither.
  double clip_sigma = 0;
  /// OSMO stops when what the part lacks of D_H, and void has above D_L, is less than this share of
  /// D_H in all of the part. 0: only after `steps`.
  double stop_error = 0;
};

/// Throws `InputError` for options out of range and targets of another grid, `InfeasibleError` when
/// a gel voxel is lit from no angle, `Cancelled`. A bound below 1 is returned, not thrown.
/// `optics` are those of `projector`.
Solution solve(const ExecutionContext& context, const Projector& projector, const Target& target,
               const RayTables& optics, const SolveOptions& options = {});

}  // namespace slicecorr::tomo
