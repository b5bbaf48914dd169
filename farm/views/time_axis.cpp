// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "views/time_axis.hpp"

#include <algorithm>

#include "slicecorr/farm/clock.hpp"

namespace slicecorr::farm::detail {

std::vector<TimeTick> time_ticks(std::int64_t from_ms, std::int64_t until_ms, int most) {
  constexpr std::int64_t s = 1000, min = 60 * s, h = 60 * min, day = 24 * h;
  std::int64_t step = day;
  for (const std::int64_t each : {s, 2 * s, 5 * s, 10 * s, 30 * s, min, 2 * min, 5 * min, 10 * min,
                                  15 * min, 30 * min, h, 2 * h, 3 * h, 6 * h, 12 * h, day}) {
    step = each;
    if ((until_ms - from_ms) / each < most) break;
  }
  while ((until_ms - from_ms) / step >= most) step *= 2;
  // Counted from local midnight, so that two-hour steps fall on even hours.
  std::int64_t at = next_local_minute(from_ms - 2 * day, 0);
  at += (std::max<std::int64_t>(0, from_ms - at) + step - 1) / step * step;
  std::vector<TimeTick> ticks;
  for (; at <= until_ms; at += step) {
    const std::string text = local_time_text(at);
    ticks.push_back({at, step >= day   ? text.substr(5, 5)
                         : step >= min ? text.substr(11, 5)
                                       : text.substr(11)});
  }
  return ticks;
}

}  // namespace slicecorr::farm::detail
