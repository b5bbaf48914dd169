// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "predict/block_kernels.hpp"

namespace slicecorr::detail {

namespace {

constexpr double kNever = std::numeric_limits<double>::infinity();

/// Takes in a layer of a block that has one class, from its doses: `before` the lower node, at it,
/// at mid-layer, at the upper node. `steady`: the dose is the same on both sides of nodes and
/// turns nowhere; `before` is `lower` then. `low`, `high`: least and greatest dose at mid-layer so far,
/// per lane: no reduction, so that the loops run in vector registers. False, with nothing changed,
/// unless all doses lie on one side of 1.
template <bool steady>
[[gnu::always_inline]] inline bool one_sided(const double* __restrict before,
                                             const double* __restrict lower,
                                             const double* __restrict middle,
                                             const double* __restrict upper, double* __restrict low,
                                             double* __restrict high, bool below_one) {
  std::int64_t crossed = 0;
  if (below_one) {
    for (std::size_t i = 0; i < kBlock; ++i) {
      crossed |= (lower[i] >= 1.0) | (upper[i] >= 1.0);
      if constexpr (!steady) crossed |= (before[i] >= 1.0) | (middle[i] >= 1.0);
    }
  } else {
    for (std::size_t i = 0; i < kBlock; ++i) {
      crossed |= (lower[i] < 1.0) | (upper[i] < 1.0);
      if constexpr (!steady) crossed |= (before[i] < 1.0) | (middle[i] < 1.0);
    }
  }
  if (crossed) return false;
  for (std::size_t i = 0; i < kBlock; ++i) {
    low[i] = middle[i] < low[i] ? middle[i] : low[i];
    high[i] = middle[i] > high[i] ? middle[i] : high[i];
  }
  return true;
}

/// Takes in a layer of a block of any coverage: sums what can be summed per lane and marks in `events` the
/// columns whose class changes, whose dose crosses 1, or that are grey.
template <bool steady>
[[gnu::always_inline]] inline void mixed(
    const double* __restrict before, const double* __restrict lower,
    const double* __restrict middle, const double* __restrict upper,
    const std::uint8_t* __restrict cover, const std::uint8_t* __restrict classes,
    double* __restrict least, BlockSums& sums, std::uint8_t* __restrict events) {
  std::int64_t run[kBlock], gap[kBlock];
  for (std::size_t i = 0; i < kBlock; ++i) {
    run[i] = cover[i] == 255;
    gap[i] = cover[i] == 0;
  }
  for (std::size_t i = 0; i < kBlock; ++i) {
    const std::int64_t printed = middle[i] >= 1.0;
    sums.run_voxels[i] += run[i];
    sums.run_printed[i] += run[i] & printed;
    sums.gap_printed[i] += gap[i] & printed;
  }
  for (std::size_t i = 0; i < kBlock; ++i) {
    const double inside_low = run[i] ? middle[i] : kNever,
                 inside_high = run[i] ? middle[i] : -kNever;
    const double outside_high = gap[i] ? middle[i] : -kNever;
    sums.inside_low[i] = inside_low < sums.inside_low[i] ? inside_low : sums.inside_low[i];
    sums.inside_high[i] = inside_high > sums.inside_high[i] ? inside_high : sums.inside_high[i];
    sums.outside_high[i] =
        outside_high > sums.outside_high[i] ? outside_high : sums.outside_high[i];
  }
  for (std::size_t i = 0; i < kBlock; ++i) {
    double dose = upper[i];  // a steady dose was looked at below the lower node already
    if constexpr (!steady) {
      dose = lower[i] < dose ? lower[i] : dose;
      dose = middle[i] < dose ? middle[i] : dose;
    }
    const std::int64_t now =
        run[i] + 2 * (1 - run[i] - gap[i]);  // as in BandPredictor::State::Class
    const double here = ((run[i] | gap[i]) & (now == classes[i])) ? dose : kNever;
    least[i] = here < least[i] ? here : least[i];
  }
  for (std::size_t i = 0; i < kBlock; ++i) {
    const std::int64_t grey = 1 - run[i] - gap[i];
    const std::int64_t now = run[i] + 2 * grey;
    std::int64_t crosses = (lower[i] >= 1.0) != (upper[i] >= 1.0);
    if constexpr (!steady) {
      crosses |=
          ((before[i] >= 1.0) != (lower[i] >= 1.0)) | ((middle[i] >= 1.0) != (lower[i] >= 1.0));
    }
    events[i] = static_cast<std::uint8_t>((now != classes[i]) | crosses | grey);
  }
}

/// Doses above a slice that shows `phi`, and at mid-layer.
[[gnu::always_inline]] inline void step(const Factors f, const double* __restrict phi,
                                        const double* __restrict omega, double* __restrict dose,
                                        double* __restrict middle) {
  for (std::size_t i = 0; i < kBlock; ++i) {
    dose[i] = phi[i] * f.one_minus_a + f.a * omega[i];
    middle[i] = phi[i] * f.one_minus_r + f.r * omega[i];
  }
}

}  // namespace

SLICECORR_CLONES
bool step_block(const Factors f, const double* __restrict phi, const double* __restrict omega,
                double* __restrict dose, double* __restrict low, double* __restrict high,
                bool below_one) {
  double middle[kBlock];
  step(f, phi, omega, dose, middle);
  return one_sided<true>(omega, omega, middle, dose, low, high, below_one);
}

SLICECORR_CLONES
void mixed_block(const Factors f, const double* __restrict phi, const double* __restrict omega,
                 double* __restrict dose, double* __restrict middle,
                 const std::uint8_t* __restrict cover, const std::uint8_t* __restrict classes,
                 double* __restrict least, BlockSums& sums, std::uint8_t* __restrict events) {
  step(f, phi, omega, dose, middle);
  mixed<true>(omega, omega, middle, dose, cover, classes, least, sums, events);
}

SLICECORR_CLONES
bool one_sided_block(const double* __restrict before, const double* __restrict lower,
                     const double* __restrict middle, const double* __restrict upper,
                     double* __restrict low, double* __restrict high, bool below_one) {
  return one_sided<false>(before, lower, middle, upper, low, high, below_one);
}

SLICECORR_CLONES
void mixed_known_block(const double* __restrict before, const double* __restrict lower,
                       const double* __restrict middle, const double* __restrict upper,
                       const std::uint8_t* __restrict cover, const std::uint8_t* __restrict classes,
                       double* __restrict least, BlockSums& sums, std::uint8_t* __restrict events) {
  mixed<false>(before, lower, middle, upper, cover, classes, least, sums, events);
}

SLICECORR_CLONES
void take_least(double* __restrict least, const double* __restrict dose) {
  for (std::size_t i = 0; i < kBlock; ++i) least[i] = dose[i] < least[i] ? dose[i] : least[i];
}

}  // namespace slicecorr::detail
