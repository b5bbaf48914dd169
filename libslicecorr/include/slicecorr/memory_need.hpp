// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file memory_need.hpp
/// How much memory a correction needs that also verifies and reports, before it is begun: what each step
/// holds, by figures of the part and of the light. For whoever gives programs a limit.
///
/// Plain values and pure functions, thread-safe.
#pragma once

#include <cstddef>
#include <cstdint>

#include "slicecorr/process.hpp"

namespace slicecorr {

class SliceSource;
struct CorrectionPlan;
struct Setup;

/// What the memory of a correction depends on.
struct MemoryFacts {
  std::size_t triangles = 0;
  int width_px = 0;
  int slices = 0;             ///< shown
  std::int64_t voxels = 0;    ///< of the part's box
  int lights = 1;             ///< different values of light over the part's box
  double tables_bytes = 0;    ///< of a value's model under UV light; 0 without
  bool left_alone = false;    ///< something is left alone beside the part
  bool stepwise = false;      ///< columns of sums of light are solved one by one
  int bath_slices = 0;        ///< of resin above the window; 0: without end
  int cut_slices = 0;         ///< slices in which cuts of light are looked for, with a time to gel
  int mirrored_slices = 0;    ///< below the platform, with plans of their own
  bool solved_whole = false;  ///< columns are solved whole, and kept for those that are alike
  bool together = false;      ///< light spreads: columns are corrected together
};

/// Whether columns are corrected together: light spreads, and nobody said to leave them alone.
bool corrects_together(const Setup& setup);

struct MemoryNeeds {
  std::int64_t base_mb = 0;    ///< with one thread
  std::int64_t thread_mb = 0;  ///< more for each further one
};

/// Half as much again as was seen, with what programs keep for their next band: a program over its limit has worked for
/// nothing.
MemoryNeeds memory_needs(const MemoryFacts& facts);

/// Fills in what depends on the light: that of `plan`, and of the printer's places.
void look_at_light(const SliceSource& slices, const Printer& printer, const Process& process,
                   const CorrectionPlan& plan, MemoryFacts& facts);

}  // namespace slicecorr
