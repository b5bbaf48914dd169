// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file eventually.hpp
/// Waits for what other processes do.
#pragma once

#include <poll.h>

#include <algorithm>
#include <chrono>

namespace slicecorr::test {

/// Waits until something holds; false when it does not in this time. To look, at a database, at all
/// processes or through a program, may cost more than what is waited for: so it looks again after a
/// tenth of the time that has passed, 250 ms at most, and rests three times as long as it looked,
/// 500 ms at most.
template <typename Holds>
bool eventually(Holds holds, std::chrono::milliseconds most = std::chrono::seconds(120)) {
  using std::chrono::milliseconds;
  using Clock = std::chrono::steady_clock;
  const Clock::time_point begin = Clock::now();
  for (;;) {
    const Clock::time_point look = Clock::now();
    if (holds()) return true;
    const Clock::time_point now = Clock::now();
    if (now - begin > most) return false;
    const Clock::duration by_time =
        std::clamp<Clock::duration>((now - begin) / 10, milliseconds(5), milliseconds(250));
    const Clock::duration by_cost = std::min<Clock::duration>(3 * (now - look), milliseconds(500));
    const auto pause = std::chrono::ceil<milliseconds>(std::max(by_time, by_cost));
    ::poll(nullptr, 0, static_cast<int>(pause.count()));
  }
}

}  // namespace slicecorr::test
