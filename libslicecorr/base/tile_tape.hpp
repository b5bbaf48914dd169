/// The tiles of a band, coded: written from the first slices on, read in any order.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

#include "base/tile_kernels.hpp"

namespace slicecorr::detail {

/// A tile is kept as its first row and, for each later row that differs from the one before, the
/// lanes that do and their bytes: memory goes with the edges of a part.
class TileTape {
 public:
  std::size_t tiles() const { return starts_.size(); }

  /// Adds the next tile: `count` rows of 64 bytes. `changed[k]`: lanes in which row k + 1 differs
  /// from row k.
  void append(const std::uint8_t* rows, std::size_t stride, int count, const LaneMask* changed) {
    starts_.push_back(code_.size());
    LaneMask any = 0;
    std::uint64_t which[2] = {};  // of the rows after the first
    for (int k = 0; k + 1 < count; ++k) {
      any |= changed[k];
      which[k / 64] |= static_cast<std::uint64_t>(changed[k] != 0) << (k % 64);
    }
    const std::uint8_t head = rows[0];
    const bool even = (head == 0 || head == 255) && std::memcmp(rows, rows + 1, kLanes - 1) == 0;
    if (any == 0 && head == 0 && even) return;
    code_.push_back(
        static_cast<std::uint8_t>((even ? head == 0 ? black : full : mixed) | (any ? changes : 0)));
    if (!even) code_.insert(code_.end(), rows, rows + kLanes);
    if (any == 0) return;
    put(which, sizeof which);
    for (int k = 0; k + 1 < count; ++k) {
      rows += stride;
      if (changed[k] == 0) continue;
      put(&changed[k], sizeof changed[k]);
      std::uint8_t bytes[kLanes];
      std::size_t n = 0;
      for (LaneMask m = changed[k]; m; m &= m - 1) bytes[n++] = rows[std::countr_zero(m)];
      code_.insert(code_.end(), bytes, bytes + n);
    }
  }

  /// Whether all bytes of a tile are 0, or all are 255.
  struct Even {
    bool black, full;
  };
  Even even(std::size_t tile) const {
    const std::size_t end = tile + 1 < starts_.size() ? starts_[tile + 1] : code_.size();
    if (starts_[tile] == end) return {true, false};
    return {false, code_[starts_[tile]] == full};
  }

  /// Writes the `count` rows of a tile one after the other; false, with nothing written, where all
  /// of them are black.
  bool read(std::size_t tile, int count, std::uint8_t* rows) const {
    const std::size_t end = tile + 1 < starts_.size() ? starts_[tile + 1] : code_.size();
    if (starts_[tile] == end) return false;
    const std::uint8_t* in = code_.data() + starts_[tile];
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

 private:
  enum Kind : std::uint8_t { black = 0, full = 1, mixed = 2, changes = 4 };
  void put(const void* data, std::size_t n) {
    const auto* bytes = static_cast<const std::uint8_t*>(data);
    code_.insert(code_.end(), bytes, bytes + n);
  }
  std::vector<std::uint8_t> code_;
  std::vector<std::size_t> starts_;
};

}  // namespace slicecorr::detail
