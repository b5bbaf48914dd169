// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Records that are written one after the other and given back from the last one on.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <new>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

namespace slicecorr::detail {

/// Values of a record lie side by side. Finished records never move: in one vector they would, and
/// whenever it grew it would need three times the memory.
template <class T>
class RecordLog {
  static_assert(std::is_trivially_copyable_v<T> && std::is_trivially_destructible_v<T>);
  static_assert(alignof(T) <= __STDCPP_DEFAULT_NEW_ALIGNMENT__);

 public:
  /// Adds a value to the present record.
  void push(const T& value) {
    if (at_ == end_) make_room(1);
    std::construct_at(at_++, value);
  }
  void push(const T* values, std::size_t count) {
    if (static_cast<std::size_t>(end_ - at_) < count) make_room(count);
    at_ = std::uninitialized_copy_n(values, count, at_);
  }
  /// Ends the present record; what is pushed from now on belongs to the next one.
  void end_record() {
    records_.push_back({begin_, static_cast<std::uint32_t>(at_ - begin_),
                        static_cast<std::uint32_t>(blocks_.size())});
    begin_ = at_;
  }
  std::size_t size() const { return records_.size(); }
  std::span<const T> operator[](std::size_t record) const {
    return {records_[record].begin, records_[record].size};
  }
  /// Drops all records from `first` on, and the present one.
  void drop_from(std::size_t first) {
    records_.resize(std::min(first, records_.size()));
    blocks_.resize(records_.empty() ? 0 : records_.back().blocks);
    begin_ = at_ = end_ = nullptr;
  }

 private:
  struct Record {
    const T* begin;
    std::uint32_t size;
    std::uint32_t blocks;  ///< up to the one that holds it
  };
  struct Release {
    void operator()(T* block) const { ::operator delete(block); }
  };
  using Block = std::unique_ptr<T, Release>;

  /// Bytes of a block. Small logs stay small: there may be hundreds of them.
  static constexpr std::size_t kLeast = 4096, kMost = std::size_t{256} << 10;

  /// Makes room for `count` more values of the present record, which moves to a new block for that.
  void make_room(std::size_t count) {
    const auto open = static_cast<std::size_t>(at_ - begin_);
    const std::size_t bytes =
        std::max(std::clamp(bytes_, kLeast, kMost), (2 * open + count) * sizeof(T));
    Block block(static_cast<T*>(::operator new(bytes)));
    at_ = std::uninitialized_copy_n(begin_, open, block.get());
    begin_ = block.get();
    end_ = begin_ + bytes / sizeof(T);
    blocks_.push_back(std::move(block));
    bytes_ += bytes;
  }

  std::vector<Block> blocks_;
  std::vector<Record> records_;
  T *begin_ = nullptr, *at_ = nullptr, *end_ = nullptr;  ///< of the present record; of its block
  std::size_t bytes_ = 0;                                ///< of all blocks so far
};

}  // namespace slicecorr::detail
