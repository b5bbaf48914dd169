// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file uncertainty.hpp
/// By how much the inputs of a print may be off, and together with what.
///
/// Resin, lamp and speed are drawn once a print: their errors are shared by all columns and slices.
/// The flat-field is drawn once a column, noise for each pixel of each slice.
///
/// Plain values; functions are thread-safe. Errors are `InputError`.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "slicecorr/process.hpp"

namespace slicecorr {

/// What may be off, once a print.
enum class UncertainInput {
  ha,        ///< absorbance height, the areal dose held
  dc,        ///< areal dose that gels
  m,         ///< exponent of intensity, by itself (not relative); the dose held where I = Iref
  aim,       ///< dose to aim at over the dose that gels
  light,     ///< intensity of all levels alike
  stray,     ///< light on top of all levels, mW/cm² (not relative)
  speed,     ///< continuous
  time,      ///< exposure times alike, layer by layer
  exchange,  ///< share of resin that a lift exchanges, 0..1 (not relative)
};
/// Word by which users name an input: "ha".
const char* word_of(UncertainInput input);

struct Uncertainty {
  /// Each once; rows and columns of `covariance`.
  std::vector<UncertainInput> inputs;
  /// inputs.size()² numbers, of ln of the relative inputs and of the others as they are.
  std::vector<double> covariance;
  double flat = 0;              ///< standard deviation of each column's light, relative
  double noise = 0;             ///< of the light of each pixel in each slice, relative
  double reference_mw_cm2 = 1;  ///< Iref of `UncertainInput::m`
  /// Whether the covariance is that of a fit: its inputs are off together, not each by itself.
  bool from_fit = false;
  /// Corrections keep features above and gaps below gelling although inputs are off (robust.hpp).
  bool robust = false;
  std::string text;  ///< as it was asked for: "ha=8%,dc=10%"

  double variance(UncertainInput a, UncertainInput b) const;
  double sd(UncertainInput input) const;  ///< 0 for those not among `inputs`
  bool operator==(const Uncertainty&) const = default;
};

/// Most that a relative standard deviation may be, that of m and that of exchange: first order says little beyond.
inline constexpr double kMostRelativeSd = 0.3;
/// Most that the standard deviation of stray light may be, mW/cm².
inline constexpr double kMostStraySd = 1000;

/// Throws unless the covariance is symmetric and has no eigenvalue below -1e-12 of its greatest,
/// naming the pair of inputs where it fails, and all standard deviations are in range.
void check_uncertainty(const Uncertainty& uncertainty);

/// A resin as its file says it, and the file.
struct ResinText {
  std::string text;    ///< empty: there is no file
  std::string source;  ///< what messages call it
};

/// Reads "ha=8%,dc=10%,light=3%" or "fit,light=0.6%,speed=0.2%". Relative inputs and `flat`, `noise`
/// are standard deviations with a % sign, `m` and `exchange` without one, `stray` in mW/cm². `fit`: what the
/// covariance in the resin's file says of ha, dc and m (provenance.covariance, as `resinctl fit`
/// writes it). `full_light_mw_cm2`: Iref where m does not come from a fit. Throws for unknown words,
/// for one that is given twice, for what `mode` does not have, for `fit` of a resin without
/// measurements, and as `check_uncertainty`.
Uncertainty parse_uncertainty(std::string_view text, ExposureMode mode, double full_light_mw_cm2,
                              const ResinText& resin);

}  // namespace slicecorr
