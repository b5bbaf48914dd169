// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Finds edges by what they follow from: a table of its own, since a lookup, of which each edge of each
/// column needs one, is most often a single look at memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace slicecorr::detail {

/// What makes an edge: the next edge above, slices between, coverage below, height, and the node where
/// slices differ (else 0).
struct EdgeKey {
  std::int32_t edge, slices;
  std::uint8_t below, height;
  std::int32_t node;
  bool operator==(const EdgeKey&) const = default;
};

/// Ids by keys. Not thread-safe.
class EdgeIds {
 public:
  static constexpr std::int32_t kNone = -1;

  EdgeIds() : slots_(kLeast) {}
  std::size_t size() const { return size_; }
  /// The id that was put for a key; kNone: none was.
  std::int32_t find(const EdgeKey& key) const { return slots_[at(key)].id; }
  /// Puts the id of a key that has none yet.
  void put(const EdgeKey& key, std::int32_t id) {
    if (2 * (size_ + 1) > slots_.size()) grow();
    slots_[at(key)] = {key, id};
    ++size_;
  }

 private:
  struct Slot {
    EdgeKey key{};
    std::int32_t id = kNone;
  };
  static constexpr std::size_t kLeast = 1024;  ///< a power of two, like all sizes

  static std::uint64_t hash(const EdgeKey& k) {
    const std::uint64_t where = static_cast<std::uint64_t>(static_cast<std::uint32_t>(k.edge))
                                    << 32 |
                                static_cast<std::uint32_t>(k.slices);
    const std::uint64_t what = static_cast<std::uint64_t>(static_cast<std::uint32_t>(k.node))
                                   << 16 |
                               static_cast<std::uint64_t>(k.height) << 8 | k.below;
    std::uint64_t x = (where ^ what * 0xD6E8FEB86659FD93ULL) * 0x9E3779B97F4A7C15ULL;
    x = (x ^ x >> 32) * 0xD6E8FEB86659FD93ULL;
    return x ^ x >> 29;
  }
  /// Where a key is, or would be put.
  std::size_t at(const EdgeKey& key) const {
    const std::size_t mask = slots_.size() - 1;
    std::size_t i = static_cast<std::size_t>(hash(key)) & mask;
    while (slots_[i].id != kNone && slots_[i].key != key) i = (i + 1) & mask;
    return i;
  }
  void grow() {
    std::vector<Slot> old(2 * slots_.size());
    old.swap(slots_);
    for (const Slot& slot : old) {
      if (slot.id != kNone) slots_[at(slot.key)] = slot;
    }
  }

  std::vector<Slot> slots_;  ///< at most half of them taken
  std::size_t size_ = 0;
};

}  // namespace slicecorr::detail
