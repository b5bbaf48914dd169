// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Times of day along an axis.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace slicecorr::farm::detail {

struct TimeTick {
  std::int64_t ms = 0;
  std::string label;
};
/// Round local times between two moments, `most` at most; days are written where the axis is long.
std::vector<TimeTick> time_ticks(std::int64_t from_ms, std::int64_t until_ms, int most);

}  // namespace slicecorr::farm::detail
