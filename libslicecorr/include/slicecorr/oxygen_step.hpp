// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file oxygen_step.hpp
/// A correction layer by layer whose slices are changed for the oxygen that diffuses in their plane.
///
/// Small features and edges gel late, because the dark around feeds them with oxygen. Each slice is
/// corrected as ever, and its light is then changed so that oxygen is used up as if none came from
/// beside (chemistry/even_oxygen.hpp): by the light where a layer gels last, at its far edge. What
/// black pixels show stays.
///
/// All functions are thread-safe and give the same bytes and figures for any number of threads.
/// Errors are those of `correct_stack`, and `InputError` for what this does not go with.
#pragma once

#include <cstddef>
#include <string>

#include "slicecorr/pipeline.hpp"

namespace slicecorr {

struct OxygenAsk {
  /// Share of its oxygen that what is not to gel keeps until the brightest of a slice runs out, 0..1.
  double margin = 0.15;
  int steps = 80;  ///< of the search for each slice's light, 1..10000
};

/// What changing the light came to. Voxels are those of the design that are lit.
struct OxygenFigures {
  int slices = 0;    ///< that have some
  int distinct = 0;  ///< that differ from the one before: those were reckoned
  std::size_t voxels = 0;
  /// Oxygen used up over what is wanted, by the linear theory: the mean error, and the least of any voxel;
  /// before light is changed by the full equations as well.
  double missed_before = 0, missed_after = 0, least_before = 0, least_after = 0;
  std::size_t short_of_light = 0;  ///< stay further than the margin below it even so
  double brightest = 1;            ///< most that a voxel's light has grown by
  /// Of voxels that would gel in their own exposure without diffusion, by the full equations at its end: end
  /// groups used up over those without diffusion (their mean), and how many have less than half of
  /// it.
  std::size_t judged = 0;
  double cure_before = 0, cure_after = 0;
  /// The same voxels: how far times to gel are from those without diffusion, the mean of |ln|; what does
  /// not gel in 1.25 times its exposure counts as gelling then.
  double off_before = 0, off_after = 0;
  std::size_t behind_before = 0, behind_after = 0;
  std::size_t dark_gelled_before = 0, dark_gelled_after = 0;  ///< voxels not lit that gel
};
/// In lines for people.
std::string oxygen_in_words(const OxygenFigures& f);

/// What it takes at most, before it begins; `seconds` is good to a factor of a few.
struct OxygenEffort {
  int slices = 0;
  double most_cells = 0, bytes = 0, seconds = 0;
};

/// Throws `InputError` where oxygen can't be evened out: continuous prints, resins without chemistry,
/// oxygen or diffusivities, UV light, wanted doses, pixels that are not square, uneven displays, scatter, light that
/// spreads otherwise than as one Gaussian; `InfeasibleError` where full light does not use up the
/// oxygen of a layer in its exposure, with the exposure and intensity that would.
void check_even_oxygen(const Setup& setup, const SliceSource& target, const OxygenAsk& ask);

struct OxygenCorrection {
  /// `after` and `before` count doses as if no oxygen diffused: of the slices as they are before their
  /// light is changed, which is what prints where oxygen is even.
  Correction correction;
  OxygenFigures oxygen;
};

/// Corrects `target` as `correct_stack` does, changes the light of its slices, and writes the stack,
/// whose `StackInfo::program` says so. What it takes is told before; progress is reported as "evening
/// out oxygen". `ask.volume_cells` must be 0.
OxygenCorrection correct_even_oxygen(const SliceSource& target, const Setup& asked,
                                     const StackFile& file, const CorrectionAsk& ask,
                                     const OxygenAsk& oxygen, const ExecutionContext& context = {});

/// Whether a stack says that its light was changed so: doses of its pixels then count light that
/// oxygen takes back.
bool oxygen_is_even(const StackInfo& info);

}  // namespace slicecorr
