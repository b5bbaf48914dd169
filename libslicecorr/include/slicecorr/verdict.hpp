// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file verdict.hpp
/// What a prediction comes to, in one sentence that a person can act on.
#pragma once

#include <cstdint>
#include <string>

namespace slicecorr {

struct Prediction;

enum class Outcome {
  as_designed,  ///< every voxel that was judged is as designed, and all of it hangs together
  look,         ///< some places are otherwise: somebody should look at them before printing
  fails         ///< it does not hold, sticks, or is another part
};
/// "as-designed", "look", "fails".
const char* name_of(Outcome outcome);

/// From this share on, of voxels, of edges, or of gaps or features by column, the print is another part.
/// An edge counts that is off by more than a layer, or an outline by more than a pixel: what is
/// nearer can be nothing but how slices round a design.
inline constexpr double kAnotherPart = 0.01;
/// Gaps with less contrast (`Prediction::gap_contrast`) close if light is a twentieth brighter; what a
/// plan asks for where nobody says.
inline constexpr double kLeastGapContrast = 0.05;

/// Gaps by column that stay open with a contrast below `kLeastGapContrast`.
std::uint64_t narrow_gaps(const Prediction& p);

struct PrintVerdict {
  Outcome outcome = Outcome::as_designed;
  /// One sentence for the gravest finding and at most two for others; plain text, with a full stop.
  std::string words;
};
/// Of what is in `p` alone: what nobody looked for (bodies, joints, dead zones) is not judged.
/// Thread-safe.
PrintVerdict verdict_of(const Prediction& p);
/// One sentence where the correction makes the print worse than none: no fewer voxels are wrong, and
/// edges are further from the design by 1 um or more, on average. Else "".
std::string worse_than_none(const Prediction& after, const Prediction& before);

}  // namespace slicecorr
