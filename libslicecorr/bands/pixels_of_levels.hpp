// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The pixels that show grey levels.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "slicecorr/cure.hpp"

namespace slicecorr::detail {

class PixelsOfLevels {
 public:
  explicit PixelsOfLevels(int levels) : all_(levels == 256) {
    for (int level = 0; level < levels; ++level) {
      pixel_of_[static_cast<std::size_t>(level)] =
          static_cast<std::uint8_t>(pixel_of_level(level, levels));
    }
  }
  std::uint8_t operator()(std::uint8_t level) const { return pixel_of_[level]; }
  /// Of `count` levels; `room` takes them where they are others.
  const std::uint8_t* operator()(const std::uint8_t* levels, std::size_t count,
                                 std::vector<std::uint8_t>& room) const {
    if (all_) return levels;
    room.resize(std::max(room.size(), count));
    for (std::size_t k = 0; k < count; ++k) room[k] = pixel_of_[levels[k]];
    return room.data();
  }

 private:
  bool all_;
  std::array<std::uint8_t, 256> pixel_of_{};
};

}  // namespace slicecorr::detail
