// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The hot loops of the coupled correction, each compiled for several instruction sets with the
/// same results. Fields are rows of `stride` values.
#pragma once

#include <cstddef>
#include <cstdint>

namespace slicecorr::detail {

/// Side of the squares in which a field is awake or asleep.
inline constexpr int kSquare = 16;
/// Rows of weights are padded with zeros to a multiple of this.
inline constexpr int kTapLanes = 8;

/// Adds `change` times weights of `rows` rows of `width` values (a multiple of kTapLanes).
void add_taps(float* field, std::size_t stride, const float* taps, int rows, int width,
              float change);
void add_taps(double* field, std::size_t stride, const double* taps, int rows, int width,
              double change);

/// Doses of a square one slice on: dose = gain light + kept below.
void step_square(float* dose, const float* light, const float* below, std::size_t stride,
                 float gain, float kept);
void step_square(double* dose, const double* light, const double* below, std::size_t stride,
                 double gain, double kept);

/// What a solve asks of the doses of a square, arrays with a common stride; see `DoseBounds`.
struct BoundRows {
  float *least, *most, *share, *over_guide, *under_guide, *soft;
  float holds;  ///< guides from here on do not lower `least`
};
/// Whether doses of a square, stepped by its light, pass their bounds by more than `slack`; soft
/// bounds count where `with_soft`.
bool passes_bounds(const float* light, const float* below, const float* dose, const float* guide,
                   const BoundRows& bounds, std::size_t stride, float gain, float kept, float slack,
                   bool with_soft);
/// Whether neither doses nor lights of a square pass bounds that stay as they are, so that no dose
/// on its way from one to the other does.
bool stays_inside(const float* light, const float* dose, const float* guide, const float* own,
                  const BoundRows& bounds, std::size_t stride);

/// What is asked of lights: those at least `lo` and at most `hi` are well; others count with
/// weights.
struct AimRows {
  float *lo, *hi, *lo_weight, *hi_weight;
};
/// How a square's bounds of doses become aims of lights.
struct AimRule {
  float gain, kept;
  float bright;       ///< no light above it is aimed at
  float room;         ///< aims lie so far inside of the bounds where there is room
  float soft_weight;  ///< of `BoundRows::soft`; 1 is that of all that is not soft
  bool with_soft;     ///< else soft bounds only keep what is gained already
};
/// Weights of softly missed guides.
struct SoftRows {
  const float *low_weight, *high_weight;
};
/// Bounds of light of a square and, a bit inside of them, aims. Arrays as those of `passes_bounds`.
void aim_square(const float* light, const float* below, const float* dose, const float* guide,
                const BoundRows& bounds, const SoftRows& soft, std::size_t stride,
                const AimRule& rule, const AimRows& aim, float* raw_lo, float* raw_hi);
/// Whether any light of a square passes its bounds by more than `slack`.
bool any_missed(const float* light, const float* raw_lo, const float* raw_hi, std::size_t stride,
                float slack);

/// Slope and curvature of half the weighted sum of squares of what lights miss, for a change of the
/// one pixel whose weights these are. `light` and `aim` point to the first pixel of the first row.
struct Pull {
  float slope, curvature;
};
Pull pull_of(const float* light, const AimRows& aim, std::size_t at, std::size_t stride,
             const float* taps, int rows, int width);

/// Wrong voxels of a square, and features' nodes that part two layers.
struct SquareSums {
  std::uint64_t through = 0, under = 0, parted = 0;
  double loss = 0;
};
/// How the dose in the middle of a layer follows from those of its nodes: (upper + below_share
/// lower) / norm.
struct MiddleRule {
  double below_share, norm;
  double of(double upper, double lower) const { return (upper + below_share * lower) / norm; }
};
/// Judges a square: `dose` at the upper node, `below` at the lower one, `kind` 1 of features (2:
/// they must not part from the layer above), -1 of gaps, 0 of what nobody asks for. True when anything misses its aim by more than `near` allows
/// gaps to come near 1.
bool judge_square(const double* dose, const double* below, const double* kind, std::size_t stride,
                  const MiddleRule& rule, double near, SquareSums& sums);
/// Whether doses and lights are all on the right side of 1, those of gaps below `near`.
bool stays_right(const double* light, const double* dose, const double* kind, std::size_t stride,
                 double near);

}  // namespace slicecorr::detail
