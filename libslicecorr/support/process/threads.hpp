// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Threads where the system may give fewer than are wanted.
#pragma once

#include <system_error>
#include <thread>
#include <vector>

namespace slicecorr::detail {

/// Starts as many threads as the system gives, at most `count`, that run `work`. Throws
/// `std::system_error` where it gives none.
template <class Work>
std::vector<std::thread> start_threads(int count, const Work& work) {
  std::vector<std::thread> threads;
  threads.reserve(static_cast<std::size_t>(count));
  try {
    while (static_cast<int>(threads.size()) < count) threads.emplace_back(work);
  } catch (const std::system_error&) {
    if (threads.empty()) throw;
  }
  return threads;
}

}  // namespace slicecorr::detail
