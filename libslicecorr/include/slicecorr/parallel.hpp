// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file parallel.hpp
/// The thin layer over TBB: loops over independent items, cancellation and progress. All functions
/// are thread-safe, and several loops may run with the same context. Cancelled work throws
/// `Cancelled`.
#pragma once

#include <atomic>
#include <cstddef>
#include <functional>
#include <string>
#include <string_view>

namespace slicecorr {

/// How a long operation runs and whom it tells. A default `ExecutionContext` uses all cores and
/// tells nobody. The callbacks may be called from any thread, but never from two at once.
struct ExecutionContext {
  /// Number of threads, >= 0; 0 means all cores. Results do not depend on it.
  int threads = 0;
  /// When it becomes true, loops stop before their next item and throw `Cancelled`. May be null.
  const std::atomic<bool>* cancel = nullptr;
  /// Progress of a stage: its name, and the fraction done (0..1, never falling within a stage).
  std::function<void(std::string_view stage, double fraction)> progress;
  /// One-line remarks a user should see: scratch files, defects closed while slicing.
  std::function<void(const std::string& text)> notice;

  /// Throws `Cancelled` when `cancel` is set.
  void check_cancelled() const;
  /// Calls `notice`, when there is one, never beside another callback.
  void tell(const std::string& text) const;
  /// Calls `progress`, when there is one, never beside another callback.
  void report(std::string_view stage, double fraction) const;
};

/// Calls `body(i)` once for every i in [0, count), in any order, on `context.threads` threads.
/// Checks for cancellation before every item. The first exception of a body stops the loop and is
/// rethrown. Bodies must not depend on each other.
void parallel_for(const ExecutionContext& context, std::string_view stage, std::size_t count,
                  const std::function<void(std::size_t)>& body);

/// The number of threads that `context` will use, 1 or more.
int thread_count(const ExecutionContext& context);

}  // namespace slicecorr
