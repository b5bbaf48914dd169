// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// For how long a print may take where nobody said: contrast costs light, and light time.
#pragma once

#include <cstdint>

#include "slicecorr/tomo/bench.hpp"
#include "slicecorr/tomo/print.hpp"

namespace slicecorr::tomo::detail {

/// Light is looked for within a few times the least time in which any light prints the part, and within
/// many times that where this has too little contrast.
class LightGoal {
 public:
  /// `turns` in which all pixels at their brightest print the part (`least_turns`).
  LightGoal(const Bench& bench, double turns);

  /// How often light has been looked for before: 0, 1.
  int attempt() const { return attempt_; }
  /// Goes on with that one.
  void resume(int attempt) { attempt_ = attempt; }
  /// Whole turns that the light may take.
  int turns() const;
  /// Whether that bounds it: more than one, of which any light that prints takes a part.
  bool needs_cap() const { return turns() > 1; }
  /// Whether no more time is allowed after this attempt.
  bool last() const;
  /// Whether this light, which takes so many turns, has enough contrast, or no other can have it.
  bool enough(const FoundLight& found, double contrast, int turns) const;
  void next() { ++attempt_; }

 private:
  double critical_mj_cm3_, back_mj_cm3_;  ///< to gel; that inhibitors take in a turn
  double least_turns_;
  int attempt_ = 0;
};

/// Most light, as `LadderOptions::cap`, that prints in so many turns where it falls as bright as in the mean.
double likely_cap(const Bench& bench, int turns);
/// The same wherever it falls: what the dimmest place can show bounds all light.
double cap_of_turns(const Bench& bench, int turns);

/// Turns in which all pixels at their brightest give the part's weakest voxel its dose, not rounded.
/// No light does in fewer. Throws `InfeasibleError` where inhibitor comes back as fast as that, naming
/// the voxel; where dose `spreads`, as fast as the brightest of all gets light.
double least_turns(const Bench& bench, const Projector& projector, const Target& target,
                   bool spreads, const ExecutionContext& context);

/// Throws `InfeasibleError` where no light prints the part in the turns that are allowed.
void check_turns(const Bench& bench, double least_turns, int most_turns);

/// Whole turns until the weakest gel voxel has its dose, and what it needs by then.
struct Turns {
  int count = 0;
  double dose_mj_cm3 = 0;
  bool never = false;  ///< it has, with this light
};
/// It gets `turn_mj_cm3` in a turn. Where inhibitor takes as much, which other light might not let it:
/// so many as were `planned`.
Turns turns_for(const Bench& bench, double turn_mj_cm3, int planned);

/// Says when a projector is so bright that the print is done with few of its levels, the brightest of them
/// `top`, at what price.
void tell_levels(const ExecutionContext& context, const Bench& bench, double contrast_of_light,
                 const PrintFigures& figures, std::uint16_t top);

}  // namespace slicecorr::tomo::detail
