// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file kept_room.hpp
/// Room for numbers that is used again and again.
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <mutex>

namespace slicecorr::detail {

/// Keeps a few arrays of one size for who needs one next: to ask the system for megabytes anew for every sweep
/// costs a fifth of it. Thread-safe; must outlive what it gave.
class KeptRoom {
 public:
  /// Hands an array back.
  struct Return {
    KeptRoom* to = nullptr;
    void operator()(double* numbers) const noexcept { to->put(numbers); }
  };
  using Room = std::unique_ptr<double[], Return>;

  /// What the numbers are is not known. `size` must be the same each time.
  Room take(std::size_t size) {
    {
      const std::lock_guard lock(mutex_);
      for (std::unique_ptr<double[]>& numbers : free_) {
        if (numbers) return {numbers.release(), Return{this}};
      }
    }
    return {std::make_unique_for_overwrite<double[]>(size).release(), Return{this}};
  }

 private:
  void put(double* numbers) noexcept {
    std::unique_ptr<double[]> back(numbers);
    const std::lock_guard lock(mutex_);
    for (std::unique_ptr<double[]>& place : free_) {
      if (!place) return place.swap(back);
    }
  }

  std::mutex mutex_;
  std::array<std::unique_ptr<double[]>, 4> free_;
};

}  // namespace slicecorr::detail
