// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The tiles of a band, coded: appended from the first slices on, read in any order.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>

#include "base/record_log.hpp"
#include "base/tile_kernels.hpp"

namespace slicecorr::detail {

/// A tile is kept as its first row and, for each later row that differs from the one before it, the
/// lanes that differ and their bytes: memory grows with the edges of a part.
class CodedTiles {
 public:
  std::size_t tiles() const { return tiles_.size(); }

  /// Adds the next tile: `count` rows of 64 bytes. `changed[k]`: lanes in which row k + 1 differs
  /// from row k.
  void append(const std::uint8_t* rows, std::size_t stride, int count, const LaneMask* changed) {
    LaneMask any = 0;
    std::uint64_t which[2] = {};  // of the rows after the first
    for (int k = 0; k + 1 < count; ++k) {
      any |= changed[k];
      which[k / 64] |= static_cast<std::uint64_t>(changed[k] != 0) << (k % 64);
    }
    const std::uint8_t head = rows[0];
    const bool even = (head == 0 || head == 255) && std::memcmp(rows, rows + 1, kLanes - 1) == 0;
    if (any != 0 || head != 0 || !even) {
      tiles_.push(static_cast<std::uint8_t>((even ? head == 0 ? black : full : mixed) |
                                            (any ? changes : 0)));
      if (!even) tiles_.push(rows, kLanes);
    }
    if (any != 0) {
      put(which, sizeof which);
      for (int k = 0; k + 1 < count; ++k) {
        rows += stride;
        if (changed[k] == 0) continue;
        put(&changed[k], sizeof changed[k]);
        std::uint8_t bytes[kLanes];
        std::size_t n = 0;
        for (LaneMask m = changed[k]; m; m &= m - 1) bytes[n++] = rows[std::countr_zero(m)];
        tiles_.push(bytes, n);
      }
    }
    tiles_.end_record();
  }

  /// Whether all bytes of a tile are 0, or all are 255.
  struct Even {
    bool black, full;
  };
  Even even(std::size_t tile) const {
    if (tiles_[tile].empty()) return {true, false};
    return {false, tiles_[tile].front() == full};
  }

  /// Writes the `count` rows of a tile one after the other; false, with nothing written, where all
  /// of them are black.
  bool read(std::size_t tile, int count, std::uint8_t* rows) const {
    if (tiles_[tile].empty()) return false;
    const std::uint8_t* in = tiles_[tile].data();
    const std::uint8_t kind = *in++;
    if ((kind & ~changes) == mixed) {
      std::memcpy(rows, in, kLanes);
      in += kLanes;
    } else {
      std::memset(rows, (kind & ~changes) == full ? 255 : 0, kLanes);
    }
    std::uint64_t which[2] = {};
    if (kind & changes) {
      std::memcpy(which, in, sizeof which);
      in += sizeof which;
    }
    for (int k = 0; k + 1 < count; ++k) {
      std::memcpy(rows + kLanes, rows, kLanes);
      rows += kLanes;
      if (!(which[k / 64] >> (k % 64) & 1)) continue;
      LaneMask m;
      std::memcpy(&m, in, sizeof m);
      in += sizeof m;
      for (; m; m &= m - 1) rows[std::countr_zero(m)] = *in++;
    }
    return true;
  }

  /// Forgets all tiles from `first` on.
  void drop_from(std::size_t first) { tiles_.drop_from(first); }

 private:
  enum Kind : std::uint8_t { black = 0, full = 1, mixed = 2, changes = 4 };
  void put(const void* data, std::size_t n) {
    tiles_.push(static_cast<const std::uint8_t*>(data), n);
  }
  RecordLog<std::uint8_t> tiles_;
};

}  // namespace slicecorr::detail
