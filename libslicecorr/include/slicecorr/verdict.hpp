// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file verdict.hpp
/// What a prediction comes to, in one sentence that a person can act on.
#pragma once

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

/// From this share on, of voxels, of gaps or of features by column, the print is another part.
inline constexpr double kAnotherPart = 0.01;

struct PrintVerdict {
  Outcome outcome = Outcome::as_designed;
  /// One sentence for the gravest finding and at most two for others; plain text, with a full stop.
  std::string words;
};
/// Of what is in `p` alone: what nobody looked for (bodies, joints, dead zones) is not judged.
/// Thread-safe.
PrintVerdict verdict_of(const Prediction& p);

}  // namespace slicecorr
