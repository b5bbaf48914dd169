// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What the sweeps of a band do to many columns at once, compiled for several instruction sets.
///
/// A tile is 64 columns ("lanes") through up to 64 slices: small enough to stay in the cache
/// nearest to the processor while all steps of a correction pass over it. Its rows are 64 bytes,
/// one per lane. Sets of lanes are the bits of a `LaneMask`. No function here rounds differently
/// from plain C++ code, whatever the instruction set: products and sums are separate.
#pragma once

#include <cstddef>
#include <cstdint>

namespace slicecorr::detail {

inline constexpr std::size_t kLanes = 64;
inline constexpr int kTileSlices = 64;
using LaneMask = std::uint64_t;

/// Compares each of `count` rows with the row before it; there must be one before the first, too.
/// `steady`: lanes that are 0 in both, or 255 in both. `changed`: lanes that differ.
void tile_changes(const std::uint8_t* rows, std::size_t stride, int count, LaneMask* steady,
                  LaneMask* changed);

/// Lanes of each of `count` rows that are 0, and that are 255.
void tile_classes(const std::uint8_t* rows, std::size_t stride, int count, LaneMask* zero,
                  LaneMask* full);

/// to = add + a * from.
void step_lanes(const double* add, double a, const double* from, double* to);
/// The same `slices` times, in place; it ends early once doses stay the same.
void step_lanes(const double* add, double a, double* dose, int slices);

/// Lanes whose dose is at least 1.
LaneMask printed_lanes(const double* dose);

/// Lanes whose `until` is above `slice`; `greatest`: set to the greatest `until` of the others.
LaneMask later_lanes(const std::int32_t* until, std::int32_t slice, std::int32_t* greatest);

/// One slice of a prediction.
struct PredictStep {
  double a, root_a;
  const double* add;         ///< phi (1 - a)
  const double* add_middle;  ///< phi (1 - root_a)
  const double* from;
  LaneMask run, gap;
  LaneMask stays;  ///< lanes in runs and gaps that were in the same one a slice before
  double* to;
  /// Per lane: least and greatest dose at mid-layer in runs, greatest in gaps, and least at nodes
  /// of lanes in `stays`.
  double *inside_low, *inside_high, *outside_high, *stretch_low;
};
struct PrintedLanes {
  LaneMask node, middle;
  int run, in_run,
      in_gap;  ///< lanes in runs, and those printed in their middle in runs and in gaps
  bool operator==(const PrintedLanes&) const = default;
};
PrintedLanes predict_lanes(const PredictStep& step);
/// Whether lanes print at the upper node and in the middle just as `is` says. Nothing is written.
bool prints_alike(const PredictStep& step, const PrintedLanes& is);

/// A slice of layers whose moments are looked for (predict/plain_moments.hpp).
struct MomentStep {
  double a, root_a, one_minus_a;
  double least;         ///< dose of a middle that may gel
  const double* light;  ///< phi
  double* dose;         ///< at the upper node; then at the lower one
  /// What is left of slices after the step in which the layer above gels, and of that step, too; then the
  /// same in this layer.
  double *left, *before;
  double* beyond;  ///< what its dose is beyond 1 in the end, at its upper node
};
struct MomentLanes {
  LaneMask may_gel;    ///< in the end
  LaneMask own;        ///< gels in its own slice
  LaneMask as_before;  ///< gels in the same step as the layer above
  LaneMask bright;     ///< the same light for ever would make it gel
};
MomentLanes moment_lanes(const MomentStep& step);

/// Copies 64 numbers. Compilers make slow code of a plain copy of this size.
void copy_lanes(const double* from, double* to);

}  // namespace slicecorr::detail
