// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Solved columns, kept for those that are alike in any band of a stack: the two halves of a boat that
/// is the same on both sides are solved once.
#pragma once

#include <array>
#include <cstddef>
#include <mutex>
#include <string>
#include <unordered_map>

namespace slicecorr::detail {

/// What follows from a key, as bytes that only the caller understands. Which are kept changes the
/// time, never a level. Thread-safe.
class SolvedColumns {
 public:
  /// Of all that live in a process together, bytes; beyond it what was not asked for lately is
  /// forgotten.
  static constexpr std::size_t kMostBytes = std::size_t{96} << 20;

  explicit SolvedColumns(std::size_t most_bytes = kMostBytes) : most_bytes_(most_bytes) {}
  ~SolvedColumns();
  SolvedColumns(const SolvedColumns&) = delete;
  SolvedColumns& operator=(const SolvedColumns&) = delete;

  /// Whether `key` is known; then `value` gets what was kept with it.
  bool find(const std::string& key, std::string& value);
  void keep(const std::string& key, const std::string& value);

 private:
  using Map = std::unordered_map<std::string, std::string>;
  /// What was asked for lately, and before that.
  struct Shelf {
    std::mutex lock;
    Map lately, before;
    std::size_t lately_bytes = 0, before_bytes = 0;
  };
  Shelf& shelf_of(const std::string& key);
  void add(Shelf& shelf, const std::string& key, std::string value);
  static void forget_before(Shelf& shelf);

  std::size_t most_bytes_;
  std::array<Shelf, 16> shelves_;
};

}  // namespace slicecorr::detail
