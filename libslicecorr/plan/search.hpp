// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The fastest pace that keeps what is asked for, by corrections.
#pragma once

#include <functional>
#include <optional>
#include <vector>

namespace slicecorr::detail {

/// How near the answer is to the first pace that fails.
inline constexpr double kPaceStep = 1.005;

/// Paces rise with the speed, > 0.
struct PaceRange {
  double least = 0, greatest = 0;
};

/// The greatest pace of `ranges` (rising, the closed forms' guess) that `keeps`, to `kPaceStep`, from the
/// fastest on: the ends of ranges first, then down in steps, then halving; up again where the guess was
/// too low, to `most` at most. A pace that is kept has been tried, and so has the one `kPaceStep` faster,
/// unless that is beyond `most`. Nothing where no pace that was tried keeps.
std::optional<double> fastest_pace(const std::vector<PaceRange>& ranges, double most,
                                   const std::function<bool(double)>& keeps);

}  // namespace slicecorr::detail
