// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file block_kernels.hpp
/// The loops of prediction over a block of columns, compiled for each instruction set with the same
/// bits. All arrays have `kBlock` values. Pure functions of what they are given.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>

#include "base/kernels.hpp"

namespace slicecorr::detail {

/// Sums per lane of a block.
struct BlockSums {
  BlockSums() {
    std::fill_n(inside_low, kBlock, std::numeric_limits<double>::infinity());
    std::fill_n(outside_low, kBlock, std::numeric_limits<double>::infinity());
    std::fill_n(inside_high, kBlock, -std::numeric_limits<double>::infinity());
    std::fill_n(outside_high, kBlock, -std::numeric_limits<double>::infinity());
  }
  double inside_low[kBlock], inside_high[kBlock], outside_low[kBlock], outside_high[kBlock];
  std::int64_t run_voxels[kBlock] = {}, run_printed[kBlock] = {}, gap_printed[kBlock] = {};
};

/// The numbers of the model that the loops need.
struct Factors {
  double a, one_minus_a, r, one_minus_r;
};

/// Steps a block whose columns see `phi`, with doses `omega` below the slice, and that has one
/// class; `dose`: what stands above it. `low`, `high`: least and greatest dose at mid-layer so far.
/// False, with nothing changed but `dose`, unless all doses lie on one side of 1, below it where
/// `below_one`.
bool step_block(Factors f, const double* phi, const double* omega, double* dose, double* low,
                double* high, bool below_one);

/// The same of any coverage. `classes`: of the columns before the slice; `least`: least dose of
/// each run so far; `events`: set where the class changes, the dose crosses 1 or the coverage is
/// grey.
void mixed_block(Factors f, const double* phi, const double* omega, double* dose, double* middle,
                 const std::uint8_t* cover, const std::uint8_t* classes, double* least,
                 BlockSums& sums, std::uint8_t* events);

/// As `step_block` and `mixed_block`, of doses that are known: below the lower node, at it, at
/// mid-layer and at the upper node.
bool one_sided_block(const double* before, const double* lower, const double* middle,
                     const double* upper, double* low, double* high, bool below_one);
void mixed_known_block(const double* before, const double* lower, const double* middle,
                       const double* upper, const std::uint8_t* cover, const std::uint8_t* classes,
                       double* least, BlockSums& sums, std::uint8_t* events);

/// The lesser of the two, to `least`.
void take_least(double* least, const double* dose);

}  // namespace slicecorr::detail
