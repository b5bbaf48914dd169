// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file service_loop.hpp
/// The service's loop and what it keeps in mind. Its parts, by purpose: service.cpp (the loop,
/// settings, what is told), starting.cpp (from the queue to the engine), settling.cpp (from the
/// engine to the record, whatever became of the work).
#pragma once

#include <atomic>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "service/commit.hpp"
#include "service/leases.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/engine.hpp"
#include "slicecorr/farm/queue.hpp"
#include "slicecorr/farm/service.hpp"

namespace slicecorr::farm::detail {

/// An attempt that the engine has.
struct Running {
  Job job;
  Attempt attempt;
  bool started = false;  ///< the engine says that it runs
  std::int64_t beat = -1, beat_steady_ms = 0;
  bool hung = false, cancelled = false, lost = false;
  std::optional<TaskReport> end;  ///< when it has ended
};

inline AttemptEnd without_result(Reason reason, const std::string& message) {
  AttemptEnd end;
  end.reason = reason;
  end.message = message;
  return end;
}

/// "/out: 3.1 MB free, 3.2 MB are wanted".
std::string too_little_room(const std::string& path, std::int64_t free_bytes,
                            std::int64_t wanted_bytes);

class ServiceLoop {
 public:
  ServiceLoop(const FarmFolder& folder, Engine& engine, const ServiceOptions& options,
              const std::atomic<bool>& stop);
  ~ServiceLoop();
  ServiceTotals run();

 private:
  /// One round of the loop over all there is to do. False: there is nothing more to do.
  bool round(bool& started);
  /// Bears a full disk or a locked database, which must not end the night: what was begun is
  /// remembered and tried again. Rethrows when it lasts longer than `kLongestTroubleMs`.
  void endure(const DeviceError& e);
  void say(const std::string& text);
  /// True once per interval of steady time.
  bool due(std::int64_t& at, std::int64_t interval_ms);
  void drain_wake();
  void read_settings();
  /// Why nothing may start now; empty: it may.
  std::string why_idle();
  void tell_change(const std::string& doing);
  /// Tells a trouble of the engine. Tasks are not taken back for it, since it may be over any
  /// moment.
  void tell_trouble(const std::string& trouble);
  void collect();

  // starting.cpp
  /// True when a job was started or finished: there may be more to do at once.
  bool start_jobs();
  /// Claims a job and puts it into `taken_`; false: there is none.
  bool take(const EngineCapacity& capacity);
  bool has_disk(const Claim& claim);
  /// Writes the order; none when the job can't be done here.
  std::optional<Task> order(const Claim& claim, const EngineCapacity& capacity);
  void hand_over(const std::vector<Task>& tasks);
  void deliver_cached(const Claim& claim);
  /// Jobs that were claimed when something failed, and were not started.
  void put_back_taken();
  Running running_of(const Claim& claim);
  Attempt attempt_of(const Claim& claim);

  // settling.cpp
  void end_lost();
  void end_cancelled();
  void note_progress();
  void settle_ended();
  Settled end_of(const Running& r, const TaskReport& report);
  void settle(const Running& r, Settled settled);
  /// Takes over what services that are gone left behind.
  void recover();
  void settle_adopted();
  void stop_running();

  const FarmFolder& folder_;
  Engine& engine_;
  const ServiceOptions& options_;
  const std::atomic<bool>& stop_;
  const FarmClock& clock_;
  Queue queue_;
  FarmSettings settings_;
  const std::int64_t first_event_;  ///< the last one before this service began
  int wake_fd_;
  std::string id_;
  std::unique_ptr<LeaseKeeper> leases_;
  std::map<std::string, Running> running_;  ///< by token
  std::vector<Claim> taken_;                ///< claimed, not yet the engine's
  std::vector<OwnedAttempt> adopted_;       ///< of services that are gone, not yet settled
  std::vector<std::string> cancellations_;
  std::set<std::string> full_folders_;
  std::string disk_low_, told_ = "-", told_trouble_;
  bool changed_ = true, stopping_ = false, swept_ = false;
  std::int64_t data_version_ = -1, progress_at_ = 0, orphans_at_ = 0, disk_at_ = 0, gc_at_ = 0,
               retry_at_ = 0, waiting_since_ms_ = 0, trouble_since_ms_ = 0;
  ServiceTotals totals_;
};

}  // namespace slicecorr::farm::detail
