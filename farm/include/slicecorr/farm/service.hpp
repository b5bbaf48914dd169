// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file service.hpp
/// The service: takes jobs from the queue, has an engine do them, checks and keeps the results.
/// Several may work on one farm; they share its limits. May be stopped, or killed, at any time.
/// Functions are thread-safe, but engines and queues belong to one thread each. Functions throw
/// `DeviceError` when a disk or the database fails; `run_service` bears it for ten minutes first.
#pragma once

#include <atomic>
#include <functional>
#include <limits>
#include <memory>
#include <string>

#include "slicecorr/farm/engine.hpp"
#include "slicecorr/farm/folder.hpp"
#include "slicecorr/farm/queue.hpp"

namespace slicecorr::farm {

struct ServiceOptions {
  bool until_empty = false;  ///< ends when nothing is queued or running
  /// Called from the service's main thread, with one line for people.
  std::function<void(const std::string&)> say;
  const FarmClock* clock = &system_clock();
  std::int64_t renewal_ms = kLeaseRenewalMs;  ///< between two renewals of the leases
};

struct ServiceTotals {
  std::int64_t done = 0, from_cache = 0, put_back = 0;  ///< jobs; those from the cache are done
  /// Jobs of the farm that failed since this service began, whoever did them, and were not tried
  /// again.
  std::int64_t failed = 0;
};

/// Runs until `stop` is set (workers of engines that do not outlive it are ended, their jobs go
/// back into the queue), the farm is drained, or, with `until_empty`, all is done.
ServiceTotals run_service(const FarmFolder& folder, Engine& engine, const ServiceOptions& options,
                          const std::atomic<bool>& stop);

/// Finishes a claimed job from the cache: verifies, delivers, commits. False: the entry is damaged
/// (and forgotten), the job is queued again.
bool finish_from_cache(const FarmFolder& folder, Queue& queue, const Claim& claim);

/// Finishes jobs that can be claimed and have this key, whose result is in the cache, `most` of
/// them at most. `service`: who does it. Gives how many were done.
std::int64_t serve_from_cache(const FarmFolder& folder, Queue& queue, const std::string& service,
                              const std::string& key,
                              std::int64_t most = std::numeric_limits<std::int64_t>::max());

struct GcOptions {
  double older_than_days = -1;  ///< < 0: any age
  std::int64_t max_mb = -1;     ///< keep the cache below; < 0: no limit
  bool dry_run = false;
};
struct GcTotals {
  std::int64_t results = 0, inputs = 0;  ///< removed
  std::int64_t bytes = 0;                ///< of all that was removed
  /// Folders of attempts and of Slurm's batches that have ended, halves of results.
  std::int64_t leftovers = 0;
  bool inputs_in_use = false;  ///< a submission was at work: inputs were left alone
};
/// Removes results of the cache (least recently used first), inputs that no job needs or that the
/// record does not know, and what attempts left. Never what a queued or running job needs; outputs
/// that were delivered are never touched.
GcTotals collect_garbage(const FarmFolder& folder, Queue& queue, const GcOptions& options);

}  // namespace slicecorr::farm
